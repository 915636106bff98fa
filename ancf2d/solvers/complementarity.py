"""Linear complementarity problems w = q + M z with w >= 0, z >= 0 and w z = 0, solved by Lemke's method.

C. E. Lemke, Bimatrix equilibrium points and mathematical programming, Management Science 11 (1965) 681-689; R. W.
Cottle, J.-S. Pang, R. E. Stone, The Linear Complementarity Problem, 2009, section 4.4.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..elements.shape import Array

# pivots per unknown; zero relative to a unit diagonal, where rows are dependent; tolerance of equal ratios
PIVOTS, DEPENDENT, EQUAL = 20, 1e-12, 1e-12


def lemke(M: Array, q: Array) -> Array | None:
    """Return z >= 0 (n,) with w = q + M z >= 0 and w z = 0, by Lemke's method with the lexicographic rule.

    M (n, n) must be scaled to diagonal entries of about 1. None if the method finds no solution; for positive
    semidefinite M it finds one if there is any.
    """
    n = len(q)
    if (q >= 0.0).all():
        return np.zeros(n)
    # columns: w, z, the artificial variable, the right-hand side
    T = np.hstack([np.eye(n), -M, -np.ones((n, 1)), q[:, None]])
    basis = np.arange(n)
    row, entering = int(np.argmin(q)), 2 * n
    for _ in range(PIVOTS * (n + 1)):
        T[row] /= T[row, entering]
        column = T[:, entering].copy()
        column[row] = 0.0
        T -= np.multiply.outer(column, T[row])
        left, basis[row] = int(basis[row]), entering
        if left == 2 * n:
            break
        entering = left + n if left < n else left - n
        row = _leaving_row(T, basis, entering, n)
        if row < 0:
            return None
    else:
        return None
    z = np.zeros(n)
    at = np.flatnonzero((basis >= n) & (basis < 2 * n))
    closed = basis[at] - n
    try:
        z[closed] = np.linalg.solve(M[np.ix_(closed, closed)], -q[closed])
    except np.linalg.LinAlgError:
        # dependent rows: take any of the solutions
        z[closed] = T[at, -1]
    return np.maximum(z, 0.0)


def lemke_from(M: Array, q: Array, start: Any) -> Array | None:
    """Return z as ``lemke``, starting from z of ``start`` (n,) and w of the other entries being nonzero."""
    on, off = np.flatnonzero(start), np.flatnonzero(~start)
    try:
        to = np.linalg.inv(M[np.ix_(on, on)])
    except np.linalg.LinAlgError:
        return None
    pivoted, pivoted_q = np.empty_like(M), np.empty_like(q)
    pivoted[np.ix_(on, on)], pivoted[np.ix_(on, off)] = to, -to @ M[np.ix_(on, off)]
    pivoted[np.ix_(off, on)] = M[np.ix_(off, on)] @ to
    pivoted[np.ix_(off, off)] = M[np.ix_(off, off)] - pivoted[np.ix_(off, on)] @ M[np.ix_(on, off)]
    pivoted_q[on], pivoted_q[off] = -to @ q[on], q[off] - pivoted[np.ix_(off, on)] @ q[on]
    other = lemke(pivoted, pivoted_q)
    if other is None:
        return None
    z = other.copy()
    z[on] = np.maximum(pivoted_q[on] + pivoted[on] @ other, 0.0)
    return z


def _leaving_row(T: Array, basis: Any, entering: int, n: int) -> int:
    """Return the row whose variable leaves the basis when ``entering`` enters, or -1 if there is none."""
    column = T[:, entering]
    rows = np.flatnonzero(column > DEPENDENT)
    for key in (2 * n + 1, *range(n)):
        if len(rows) < 2:
            break
        ratio = T[rows, key] / column[rows]
        rows = rows[ratio <= ratio.min() + EQUAL * (1.0 + abs(ratio.min()))]
        artificial = rows[basis[rows] == 2 * n]
        if key == 2 * n + 1 and len(artificial):
            return int(artificial[0])
    return int(rows[0]) if len(rows) else -1
