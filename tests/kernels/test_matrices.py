"""Band factorisation and scatter of element matrices, compared with dense algebra."""

import numpy as np
import pytest
from helpers import dense
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.kernels.matrices.band import ldl_factor, ldl_solve
from ancf2d.kernels.matrices.layout import Places
from ancf2d.kernels.matrices.matrix import Band, Csr, Nested, SymBand, scatter_patches
from ancf2d.model.fronts import Fronts


def random_band(rng, n: int, bw: int, definite: bool):
    K = rng.normal(size=(n, n))
    K = np.triu(np.tril(K + K.T, bw), -bw)
    return K + (3 * bw + 3) * np.eye(n) if definite else K


def lower(K, bw: int):
    A = np.zeros((len(K), bw + 1), dtype=K.dtype)
    for i in range(len(K)):
        for j in range(max(0, i - bw), i + 1):
            A[i, bw + j - i] = K[i, j]
    return A


def factored(A, tiny: float):
    return ldl_factor(A, tiny, np.empty(len(A)))


@settings(max_examples=40, deadline=None)
@given(n=st.integers(1, 40), bw=st.integers(0, 18), seed=st.integers(0, 10**6), definite=st.booleans())
def test_band_ldl_solves_and_its_negative_pivots_are_the_negative_eigenvalues(n, bw, seed, definite):
    bw = min(bw, n - 1)
    rng = np.random.default_rng(seed)
    K = random_band(rng, n, bw, definite)
    A, b = lower(K, bw), rng.normal(size=n)
    bad, negative, smallest = factored(A, 1e-14)
    assert bad == -1
    assert negative == int((np.linalg.eigvalsh(K) < 0).sum())
    assert 0 < smallest <= 1
    x = b.copy()
    ldl_solve(A, x)
    # without pivoting an indefinite matrix may grow by 1/smallest pivot, and no more
    error = np.linalg.norm(K @ x - b) / (np.linalg.norm(K) * np.linalg.norm(x) + np.linalg.norm(b))
    assert error < 1e-13 / min(1.0, smallest)


def test_band_ldl_names_the_row_at_which_a_singular_matrix_fails():
    K = np.diag([2.0, 2.0, 2.0, 2.0]) - np.diag([1.0, 1.0, 1.0], 1) - np.diag([1.0, 1.0, 1.0], -1)
    K[0, 0] = K[3, 3] = 1.0
    assert factored(lower(K, 1), 1e-15)[0] == 3
    K[1, 1] = np.nan
    assert factored(lower(K, 1), 1e-15)[0] == 1
    assert factored(np.zeros((3, 2)), 1e-15)[0] == 0


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(n=st.integers(1, 40), bw=st.integers(0, 18), seed=st.integers(0, 10**6), gaps=st.booleans())
def test_band_ldl_of_complex_symmetric_matrices_solves(n, bw, seed, gaps):
    bw = min(bw, n - 1)
    rng = np.random.default_rng(seed)
    K = random_band(rng, n, bw, True) + 1j * random_band(rng, n, bw, False)
    if gaps:  # blocks of zeros in the band are passed over
        K[np.abs(np.subtract.outer(np.arange(n), np.arange(n))) > bw // 3] = 0.0
    A, b = lower(K, bw), rng.normal(size=n) + 1j * rng.normal(size=n)
    assert factored(A, 1e-14)[0] == -1
    x = b.copy()
    ldl_solve(A, x)
    assert np.linalg.norm(K @ x - b) < 1e-13 * np.linalg.norm(K) * np.linalg.norm(x)


@pytest.mark.slow
@pytest.mark.parametrize("power", [-900, -540, -500, 500, 540, 900])
@pytest.mark.parametrize("bw", [2, 5, 11])
def test_complex_matrices_scaled_by_powers_of_two_have_the_same_factors(bw, power):
    """Also if the squares of pivots overflow."""
    rng = np.random.default_rng(bw)
    K = random_band(rng, 31, bw, True) + 1j * random_band(rng, 31, bw, False)
    b = rng.normal(size=31) + 1j * rng.normal(size=31)
    plain, scaled = lower(K, bw), lower(K, bw) * 2.0**power
    for A in (plain, scaled):
        assert factored(A, 1e-14)[0] == -1
    np.testing.assert_allclose(scaled[:, :-1], plain[:, :-1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(scaled[:, -1] * 2.0**-power, plain[:, -1], rtol=1e-14)
    x, y = b.copy(), b * 2.0**power
    ldl_solve(plain, x)
    ldl_solve(scaled, y)
    np.testing.assert_allclose(y, x, rtol=0, atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("pivot", [3 + 4j, -1.5 + 0j, 0.7j, 1 - 1e-200j])
def test_complex_pivots_of_any_size(pivot):
    for power in range(-1020, 1021, 8):
        A, x = np.array([[pivot]]) * 2.0**power, np.array([pivot]) * 2.0**power
        assert factored(A, 1e-14)[0] == -1
        ldl_solve(A, x)
        assert abs(x[0] - 1.0) < 1e-15


KINDS = ("symmetric band", "fronts", "general band", "compressed rows")


def target(kind: str, n: int):
    """Return an empty full-width matrix of a kind."""
    if kind == "symmetric band":
        return SymBand(np.zeros((n, n)))
    if kind == "fronts":
        # a front of its own for each unknown, each of which reaches all later ones
        rows = [np.arange(k + 1, n) for k in range(n)]
        start = np.cumsum([0] + [len(r) for r in rows])
        into, at = np.concatenate([np.arange(len(r)) for r in rows]), np.cumsum([0] + [(n - k) ** 2 for k in range(n)])
        fronts = Fronts(np.arange(n + 1), start, np.concatenate(rows), into, at, np.append(np.arange(1, n), -1),
                        np.arange(n), n, np.arange(n), np.arange(n), np.zeros(2, dtype=np.int64))
        return Nested(np.zeros(at[-1]), fronts)
    if kind == "general band":
        return Band(np.zeros((n, 3 * (n - 1) + 1)))
    return Csr(np.zeros(n * n), n * np.arange(n + 1), np.tile(np.arange(n), n))


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_scatter_is_the_congruence_with_held_and_dependent_coordinates(kind, seed):
    """K = sum T_e^T K_e T_e, where rows of T are unit rows, zero rows, and combinations of unknowns."""
    rng = np.random.default_rng(seed)
    n_full, n = 9, 5
    roles = rng.permutation([*range(n), -1, -1, -2, -3])
    T = np.zeros((n_full, n))
    index, value, indptr = [], [], [0]
    for _ in range(2):
        used = rng.choice(n, size=rng.integers(1, 4), replace=False)
        index += used.tolist()
        value += rng.normal(size=len(used)).tolist()
        indptr.append(len(index))
    for c, role in enumerate(roles):
        if role >= 0:
            T[c, role] = 1.0
        elif role <= -2:
            k = -2 - role
            T[c, index[indptr[k] : indptr[k + 1]]] = value[indptr[k] : indptr[k + 1]]
    matrix = target(kind, n)
    places = Places(roles.astype(np.int64), np.array(indptr), np.array(index), np.array(value))
    expected = np.zeros((n, n))
    Ks, sets = [], []
    for _ in range(3):
        dofs = rng.choice(n_full, size=4, replace=False)
        Ke = rng.normal(size=(4, 4))
        Ke = Ke + Ke.T if kind in ("symmetric band", "fronts") else Ke
        expected += T[dofs].T @ Ke @ T[dofs]
        Ks.append(Ke)
        sets.append(dofs)
    scatter_patches(matrix, np.array(Ks[:1]), np.array(sets), 0, 1, places)
    scatter_patches(matrix, np.array(Ks[1:]), np.array(sets), 1, 2, places)
    np.testing.assert_allclose(dense(matrix, n), expected, atol=1e-12)
