"""Rayleigh-Ritz whose soft motions keep their digits beside motions that are many orders of magnitude stiffer."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...elements.shape import Array
from ...model.mesh import Index

# off-diagonal entries, relative to the diagonal ones, that are round-off; most sweeps of Jacobi's method
SMALL, SWEEPS = 1e-15, 12
# a vector of which no more than this share is independent of the softer ones depends on them
DEPENDENT = 1e-10


def graded_ritz(V: Array, HV: Array, GV: Array, m: int) -> tuple[Array, Array]:
    """Return the lowest m values of V H V^T y = value V G V^T y (G positive on V), and their combinations (m, k).

    An orthogonal reduction of the whole matrix would leave every value with the round-off of the largest. Here softer
    vectors come first, no vector is combined with a stiffer one before Jacobi's method, and entries of the matrix are
    the work of the stiffer vector against the small forces of the softer one. Raises LinAlgError if vectors of V
    depend on one another.
    """
    H, G = V @ HV.T, V @ GV.T
    order = np.argsort(np.abs(np.diag(H) / np.diag(G)), kind="stable")
    H, G = (A[np.ix_(order, order)] for A in (H, G))
    L: Array = np.asarray(np.linalg.cholesky(0.5 * (G + G.T)), dtype=float)
    if np.any(np.diag(L)**2 < DEPENDENT * np.diag(G)):
        raise np.linalg.LinAlgError
    half = _forward(L, np.tril(H) + np.tril(H, -1).T)
    values, Y = jacobi(_forward(L, half.T))
    lowest = np.argsort(values, kind="stable")[:m]
    combined = np.empty((len(lowest), len(V)))
    combined[:, order] = Y[lowest] @ _forward(L, np.eye(len(V)))
    return values[lowest], combined


def _forward(L: Array, B: Array) -> Array:
    """Return L^-1 B of a lower triangle L, row by row, so that small rows keep their digits."""
    X = B.copy()
    for i in range(len(L)):
        X[i] = (X[i] - L[i, :i] @ X[:i]) / L[i, i]
    return X


def jacobi(A: Array) -> tuple[Array, Array]:
    """Return the eigenvalues of a symmetric matrix and its eigenvectors as rows, by Jacobi's rotations.

    If the matrix is graded, its small eigenvalues have small relative errors (Demmel & Veselic 1992).
    """
    A, Y = np.tril(A) + np.tril(A, -1).T, np.eye(len(A))
    for _ in range(SWEEPS):
        size = np.sqrt(np.abs(np.diag(A)))
        if np.all(np.abs(A - np.diag(np.diag(A))) <= SMALL * np.outer(size, size)):
            break
        for p, q in _rounds(len(A)):
            _rotate(A, Y, p, q)
    return np.diag(A).copy(), Y


def _rounds(n: int) -> Iterator[tuple[Index, Index]]:
    """Yield all pairs p < q of n numbers in rounds of disjoint pairs, as of a tournament."""
    ring = np.arange(n + n % 2)
    for _ in range(len(ring) - 1):
        a, b = ring[:len(ring) // 2], ring[len(ring) // 2:][::-1]
        both = np.maximum(a, b) < n
        yield np.minimum(a, b)[both], np.maximum(a, b)[both]
        ring = np.concatenate([ring[:1], ring[-1:], ring[1:-1]])


def _rotate(A: Array, Y: Array, p: Index, q: Index) -> None:
    """Rotate disjoint pairs of rows and columns so that A[p, q] vanishes."""
    a, b, c = A[p, p], A[q, q], A[p, q]
    some = c != 0.0
    p, q, a, b, c = p[some], q[some], a[some], b[some], c[some]
    tau = (b - a) / (2.0 * c)
    t = np.where(tau < 0.0, -1.0, 1.0) / (np.abs(tau) + np.hypot(1.0, tau))
    cos = (1.0 / np.hypot(1.0, t))[:, None]
    sin = t[:, None] * cos
    for X in (A, A.T, Y):
        X[p], X[q] = cos * X[p] - sin * X[q], sin * X[p] + cos * X[q]
    A[p, p], A[q, q] = a - t * c, b + t * c
    A[p, q] = A[q, p] = 0.0
