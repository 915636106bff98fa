"""Soft motions keep their digits next to motions twenty orders of magnitude stiffer."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from ancf2d.solvers.small_motions import lowest_modes
from ancf2d.solvers.small_motions.rayleigh_ritz import graded_ritz, jacobi

SIZES = 10.0 ** np.linspace(-18, 14, 12)


def graded(coupling: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Return a matrix of pairs of soft and stiff entries in any order, and its eigenvalues, in closed form."""
    A, values = np.zeros((12, 12)), []
    order = np.random.default_rng(1).permutation(12)
    for i, j in zip(order[:6], order[6:], strict=True):
        a, c = SIZES[i], SIZES[j]
        b = coupling * np.sqrt(a * c)
        A[i, i], A[j, j], A[i, j], A[j, i] = a, c, b, b
        larger = 0.5 * (a + c) + np.hypot(0.5 * (a - c), b)
        values += [larger, a * c * (1.0 - coupling**2) / larger]
    return A, np.sort(values)


def test_jacobi_keeps_relative_digits():
    A, expected = graded()
    values, Y = jacobi(A)
    np.testing.assert_allclose(np.sort(values), expected, rtol=1e-13)
    np.testing.assert_allclose(Y @ Y.T, np.eye(12), atol=1e-14)


@pytest.mark.parametrize("m", [3, 12])
def test_rayleigh_ritz_keeps_relative_digits(m):
    A, expected = graded()
    values, Y = graded_ritz(np.eye(12), A, np.eye(12), m)
    np.testing.assert_allclose(values, expected[:m], rtol=1e-13)
    np.testing.assert_allclose(Y @ Y.T, np.eye(m), atol=1e-14)


def test_dependent_vectors_are_refused():
    V = np.concatenate([np.eye(3), [[0.6, 0.8, 1e-7]]])
    with pytest.raises(np.linalg.LinAlgError):
        graded_ritz(V, V * SIZES[:3], V, 2)


class Diagonal:
    """A pencil with known eigenvalues (n,), B = 1, and factors of a stiffness with errors ``wrong`` (n,)."""

    multipliers = false = 0
    matrix = SimpleNamespace(knows_inertia=True)

    def __init__(self, values: np.ndarray, wrong: np.ndarray) -> None:
        self.values, self.wrong, self.n = values, wrong, len(values)

    def factor(self, shift: float) -> None:
        """Factor K - shift, with the errors of K."""
        self.factors = self.values + self.wrong - shift

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return the solution with these factors."""
        return b / self.factors

    def stiffness(self, x: np.ndarray) -> np.ndarray:
        """Return K x."""
        return self.values * x

    def apply_B(self, x: np.ndarray) -> np.ndarray:
        """Return x."""
        return x


def test_vectors_are_corrected_until_their_values_settle(monkeypatch):
    """With factors shifted far above the lowest eigenvalues, one correction leaves large errors."""
    values = np.concatenate([[0.0, 0.0, 0.0], np.arange(1.5, 20.0) ** 4, 10.0 ** np.arange(6, 18)])
    pencil = Diagonal(values, np.random.default_rng(3).uniform(-20.0, 20.0, len(values)))
    monkeypatch.setattr(lowest_modes, "characteristic", lambda pencil: 0.01)
    V = np.eye(10, pencil.n) + 1e-3 * np.random.default_rng(4).uniform(-1.0, 1.0, (10, pencil.n))
    found, _, error = lowest_modes._refine(pencil, values[:10] + pencil.wrong[:10], V, -400.0)
    np.testing.assert_allclose(found[:6], values[:6], rtol=1e-7, atol=1e-10)
    assert np.all(np.abs(found - values[:10]) <= 10.0 * error * (values[:10] + 0.01) + 1e-10)
