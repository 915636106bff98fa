"""Factors of sparse matrices, real or complex, and the argument principle by the phase of their determinants."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...elements.shape import Array
from ..ldl import Symmetric
from ..linear import TangentMatrix

if TYPE_CHECKING:
    from scipy.sparse import csc_array

# half bandwidth up to which a matrix is factored as a band
BAND = 80
# phase between neighbouring points of the circle above which a point is inserted, and the largest number of points
TURN, MOST_POINTS = 1.1, 80


class Factors:
    """The factors of a sparse matrix, stored as a band if it is narrow; ``phase`` is that of its determinant."""

    def __init__(self, A: csc_array) -> None:
        i, j = A.indices, np.repeat(np.arange(A.shape[1]), np.diff(A.indptr))
        self.bw = int(np.abs(i - j).max(initial=0))
        self.singular = False
        if self.bw <= BAND:
            self._factor_band(A, i, j)
        else:
            self._factor_sparse(A)

    def _factor_band(self, A: csc_array, i: Array, j: Array) -> None:
        from scipy.linalg import get_lapack_funcs

        bw = self.bw
        band = np.zeros((A.shape[0], 3 * bw + 1), dtype=A.dtype)
        band[j, 2 * bw + i - j] = A.data
        factor, self._backward = get_lapack_funcs(("gbtrf", "gbtrs"), (band,))
        self.lu, self.rows, info = factor(band.T, bw, bw, overwrite_ab=True)
        pivots = self.lu[2 * bw]
        self.singular = info != 0 or not np.isfinite(pivots).all()
        swaps = int((self.rows != np.arange(len(self.rows))).sum())
        self.phase = _phase(pivots, swaps) if not self.singular else 0j

    def _factor_sparse(self, A: csc_array) -> None:
        from scipy.sparse.linalg import splu

        try:
            self.sparse = splu(A, permc_spec="COLAMD")
        except RuntimeError:
            self.singular, self.phase = True, 0j
            return
        swaps = _parity(self.sparse.perm_r) + _parity(self.sparse.perm_c)
        self.phase = _phase(self.sparse.U.diagonal(), swaps)

    def solve(self, b: NDArray[Any]) -> NDArray[Any]:
        """Return A^-1 b for a vector (n,) or columns (n, k)."""
        if self.bw <= BAND:
            return np.asarray(self._backward(self.lu, self.bw, self.bw, b, self.rows)[0])
        return np.asarray(self.sparse.solve(b))


class SymmetricFactors:
    """The factors of a symmetric sparse matrix, in the storage of a model's tangent, without row exchanges."""

    def __init__(self, A: csc_array, storage: TangentMatrix) -> None:
        i, j = A.indices.astype(np.int64), np.repeat(np.arange(A.shape[1]), np.diff(A.indptr))
        lower = i >= j
        self.storage, self.singular = storage, not isinstance(storage, Symmetric)
        if isinstance(storage, Symmetric):
            storage.clear()
            storage.values.reshape(-1)[storage.at(i[lower], j[lower])] = A.data[lower]
            self.singular = storage.factor().bad >= 0

    def solve(self, b: Array) -> Array:
        """Return A^-1 b."""
        return self.storage.solve(np.ascontiguousarray(b))


def _phase(pivots: Array, swaps: int) -> complex:
    angle = float(np.angle(pivots).sum()) + math.pi * swaps
    return complex(math.cos(angle), math.sin(angle))


def _parity(permutation: Array) -> int:
    """Return the number of exchanges that make up a permutation."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(permutation)
    cycles = connected_components(coo_array((np.ones(n), (np.arange(n), permutation)), shape=(n, n)))[0]
    return n - int(cycles)


def turned_on_half_circle(phase: Callable[[float], complex], intervals: int) -> float | None:
    """Return the change of a phase angle over the upper half of a circle, with adaptive sampling.

    The samples are refined from a number of equal ``intervals``, in none of which it may turn once or more. Return None
    if too many samples would be needed, or if the phase is unknown somewhere.
    """
    angles = list(np.linspace(0.0, math.pi, intervals + 1))
    known = {a: phase(a) for a in angles}
    k, total = 0, 0.0
    while k < len(angles) - 1:
        a, b = angles[k], angles[k + 1]
        if not (known[a] and known[b]):
            return None
        step = float(np.angle(known[b] / known[a]))
        if abs(step) > TURN and b - a > 1e-9:
            if len(known) >= MOST_POINTS:
                return None
            middle = 0.5 * (a + b)
            known[middle] = phase(middle)
            angles.insert(k + 1, middle)
            continue
        total, k = total + step, k + 1
    return total
