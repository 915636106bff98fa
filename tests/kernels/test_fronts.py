"""Fronts compared with dense algebra on random frames: solutions, inertia, singular unknowns; growth of fill."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import dense
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.kernels.matrices import symmetric
from ancf2d.kernels.matrices.fronts import fronts_factor, fronts_product, fronts_solve
from ancf2d.kernels.matrices.layout import entries, stored_entries
from ancf2d.kernels.matrices.matrix import Nested
from ancf2d.model.fronts import band_cost, fronts_cost, least_degree, make_fronts

none = np.zeros(0, dtype=np.int64)


def frame(rng, members: int, length: int, size: int, loops: int) -> tuple[int, list[np.ndarray]]:
    """Return the unknowns of members in a random tree with some loops, and the unknowns of each element.

    Members have so many elements between nodes of so many unknowns each.
    """
    ends, count = [], 1
    for k in range(members):
        inside = list(range(count, count + length))
        count += length
        ends.append(([int(rng.integers(inside[0])) if k else 0, *inside])[:length + 1])
    pairs = [p for nodes in ends for p in pairwise(nodes)]
    pairs += [tuple(rng.choice(count, size=2, replace=False)) for _ in range(loops)]
    dofs = np.array([[size * a + np.arange(size), size * b + np.arange(size)] for a, b in pairs])
    return size * count, [dofs.reshape(len(pairs), 2 * size)]


def filled(rng, n: int, sets, definite: bool, kind=float):
    """Return fronts with random elements, and their matrix (n, n)."""
    fronts = make_fronts(least_degree(n, sets), sets)
    target = Nested(np.zeros(fronts.at[-1], dtype=kind), fronts)
    A = np.zeros((n, n), dtype=kind)
    for dofs in sets[0]:
        B = rng.normal(size=(len(dofs), len(dofs)))
        Ke = B @ B.T if definite else B + B.T
        if kind is complex:
            Ke = Ke + 1j * (B + B.T)
        A[np.ix_(dofs, dofs)] += Ke + (4.0 if definite else 0.0) * np.eye(len(dofs))
    i, j = stored_entries(fronts)
    target.values[entries(fronts, i, j)] = A[i, j]
    return fronts, target, A


FRAMES = {"members": st.integers(1, 8), "length": st.integers(1, 9), "size": st.integers(1, 7),
          "loops": st.integers(0, 4), "seed": st.integers(0, 10**6)}


@settings(max_examples=60, deadline=None)
@given(**FRAMES, definite=st.booleans())
def test_fronts_solve_and_count_negative_eigenvalues(members, length, size, loops, seed, definite):
    rng = np.random.default_rng(seed)
    n, sets = frame(rng, members, length, size, loops)
    fronts, target, A = filled(rng, n, sets, definite)
    # fronts hold every entry
    np.testing.assert_array_equal(dense(target, n), A)
    b, y = rng.normal(size=n), np.empty(n)
    fronts_product(fronts, target.values, b, y, False)
    np.testing.assert_allclose(y, A @ b, atol=1e-12 * np.abs(A).max() * np.abs(b).max() * size)
    fronts_product(fronts, target.values, np.abs(b), y, True)
    np.testing.assert_allclose(y, A @ b + np.abs(A) @ np.abs(b), atol=1e-12 * np.abs(A).max() * np.abs(b).max() * size)
    bad, negative, smallest = fronts_factor(fronts, target.values, 1e-14, np.zeros(n))
    x = b.copy()
    fronts_solve(fronts, target.values, x)
    assert bad == -1
    assert negative == int((np.linalg.eigvalsh(A) < 0).sum())
    # what is not definite is known as well as its smallest pivot
    assert np.linalg.norm(A @ x - b) <= 1e-13 / min(1.0, smallest) * np.linalg.norm(A) * np.linalg.norm(x)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(**FRAMES)
def test_fronts_of_complex_symmetric_matrices_solve(members, length, size, loops, seed):
    rng = np.random.default_rng(seed)
    n, sets = frame(rng, members, length, size, loops)
    fronts, target, A = filled(rng, n, sets, True, complex)
    b = rng.normal(size=n) + 1j * rng.normal(size=n)
    assert fronts_factor(fronts, target.values, 1e-14, np.zeros(n))[0] == -1
    x = b.copy()
    fronts_solve(fronts, target.values, x)
    assert np.linalg.norm(A @ x - b) < 1e-12 * np.linalg.norm(A) * np.linalg.norm(x)


@pytest.mark.parametrize("seed", range(6))
def test_an_unknown_without_stiffness_is_named(seed):
    rng = np.random.default_rng(seed)
    n, sets = frame(rng, 5, 6, 3, 2)
    fronts, target, _ = filled(rng, n, sets, True)
    free = int(rng.integers(n))
    i, j = stored_entries(fronts)
    target.values[entries(fronts, i, j)[(i == free) | (j == free)]] = 0.0
    assert fronts_factor(fronts, target.values, 1e-14, np.zeros(n))[0] == free


@settings(max_examples=30, deadline=None)
@given(**FRAMES)
def test_positions_are_an_elimination_order_with_children_before_parents(members, length, size, loops, seed):
    n, sets = frame(np.random.default_rng(seed), members, length, size, loops)
    fronts = make_fronts(least_degree(n, sets), sets)
    np.testing.assert_array_equal(fronts.unknown[fronts.row], np.arange(n))
    for q, p in enumerate(fronts.parent):
        rows = fronts.rows[fronts.start[q]:fronts.start[q + 1]]
        assert (rows >= fronts.first[q + 1]).all()
        assert (len(rows) == 0) == (p == -1)
        if p >= 0:
            assert p > q
            whole = np.append(np.arange(fronts.first[p], fronts.first[p + 1]),
                              fronts.rows[fronts.start[p]:fronts.start[p + 1]])
            np.testing.assert_array_equal(whole[fronts.into[fronts.start[q]:fronts.start[q + 1]]], rows)


def test_fronts_of_a_tree_grow_linearly():
    """Without loops no front extends beyond a node: twice the members, twice the numbers."""
    sizes = {}
    for members in (20, 40, 80):
        n, sets = frame(np.random.default_rng(7), members, 20, 3, 0)
        fronts = make_fronts(least_degree(n, sets), sets)
        assert np.diff(fronts.start).max() <= 9
        sizes[members] = fronts.at[-1] / n, fronts_cost(fronts) / n
    for grown in zip(*sizes.values(), strict=True):
        assert max(grown) < 1.15 * min(grown)


def test_fronts_of_lattices_cost_less_than_bands():
    """Nested dissection of a square of k x k members costs k^3, a band k^4 (George 1973)."""
    costs = []
    for k in (16, 32, 64):
        node = np.arange(k * k).reshape(k, k)
        pairs = np.concatenate([np.stack([node[:, :-1].ravel(), node[:, 1:].ravel()], axis=1),
                                np.stack([node[:-1].ravel(), node[1:].ravel()], axis=1)])
        sets = [(3 * pairs[:, :, None] + np.arange(3)).reshape(-1, 6)]
        fronts = make_fronts(least_degree(3 * k * k, sets), sets)
        costs.append((fronts_cost(fronts), band_cost(3 * k * k, 3 * k + 2)))
    (a, _), (b, _), (c, band) = costs
    assert b / a < 2.0**3.3
    assert c / b < 2.0**3.3
    assert c < 0.5 * band


@pytest.mark.parametrize("seed", range(3))
def test_entries_between_unknowns_of_two_kinds_are_kept_and_the_diagonal_of_the_first(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    fronts, target, A = filled(rng, *frame(rng, 3, 4, 3, 1), True)
    n, low = len(A), np.nonzero(np.tril(A))
    kind = rng.integers(0, 3, n).astype(float)
    kept = np.where((kind[:, None] != kind) | (np.eye(n, dtype=bool) & (kind == 0.0)), A, 0.0)
    symmetric.clear_same_kind_fronts.py_func(SimpleNamespace(fronts=fronts), target.values, kind)
    np.testing.assert_array_equal(target.values[entries(fronts, *low)], kept[low])
    # as a band, with A_ij at n - 1 + j - i of row i
    i, j = np.tril_indices(n)
    band = np.zeros((n, n))
    band[i, n - 1 + j - i] = A[i, j]
    monkeypatch.setattr(symmetric, "band_of", lambda p, rows: rows)
    symmetric.clear_same_kind_band.py_func(SimpleNamespace(inner=n, width=n), band, kind)
    np.testing.assert_array_equal(band[i, n - 1 + j - i], kept[i, j])
