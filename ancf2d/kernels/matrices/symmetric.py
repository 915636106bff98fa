"""Symmetric matrices of the unknowns in motions, as flat arrays: the entries of a band, or front by front.

Each operation exists for both kinds of storage and is called by address from the model's table (``kernels.calls``).
"""

from __future__ import annotations

from typing import Any

from .. import calls
from ..lowlevel.jit import addressed, inlined
from ..lowlevel.records import array_at
from .band import ldl_factor, ldl_solve
from .fronts import fronts_factor, fronts_product, fronts_solve
from .layout import Places
from .matrix import Nested, SymBand, band_product, product_by_diagonals

# pivots smaller than this fraction of the terms that form them count as zero
TINY = 1e-16


@inlined
def band_of(p, A):  # type: ignore[no-untyped-def]
    """Return the flat matrix A as rows (n, width) of a band."""
    return array_at(A, 0, (p.inner, p.width))


@inlined
def in_band(p, A):  # type: ignore[no-untyped-def]
    """Return A as a band for assembly (``matrix.SymBand``)."""
    return SymBand(band_of(p, A))


@inlined
def in_fronts(p, A):  # type: ignore[no-untyped-def]
    """Return A as fronts for assembly (``matrix.Nested``)."""
    return Nested(A, p.fronts)


@inlined
def places_in(p):  # type: ignore[no-untyped-def]
    """Return the positions of coordinates among the unknowns."""
    return Places(p.place, p.indptr, p.index, p.value)


@inlined
def rows_in(p):  # type: ignore[no-untyped-def]
    """Return the positions of coordinates among the rows of matrices, for assembly."""
    return Places(p.row_place, p.indptr, p.row_index, p.value)


@addressed
def factor_band(p, A, scale):  # type: ignore[no-untyped-def]
    """Factor A = L D L^T in place; return whether it is regular.

    Overwrites ``scale`` (n,); its first number becomes the row at which the factorisation broke down, or -1.
    """
    scale[0] = ldl_factor(band_of(p, A), TINY, scale)[0]
    return scale[0] < 0.0


@addressed
def factor_fronts(p, A, scale):  # type: ignore[no-untyped-def]
    """Same as ``factor_band``, for fronts."""
    scale[0] = fronts_factor(p.fronts, A, TINY, scale)[0]
    return scale[0] < 0.0


@addressed
def solve_band(p, A, x):  # type: ignore[no-untyped-def]
    """Solve L D L^T x = b in place."""
    ldl_solve(band_of(p, A), x)


@addressed
def solve_fronts(p, A, x):  # type: ignore[no-untyped-def]
    """Solve L D L^T x = b in place."""
    fronts_solve(p.fronts, A, x)


@addressed
def product_band(p, A, x, y):  # type: ignore[no-untyped-def]
    """Fill y = A x."""
    band_product(band_of(p, A), x, y)


@addressed
def product_fronts(p, A, x, y):  # type: ignore[no-untyped-def]
    """Fill y = A x."""
    fronts_product(p.fronts, A, x, y, False)


@addressed
def mass_band(p, x, y):  # type: ignore[no-untyped-def]
    """Fill y = M x of a motion's mass matrix."""
    product_by_diagonals(p, x, y)


@addressed
def mass_fronts(p, x, y):  # type: ignore[no-untyped-def]
    """Fill y = M x of a motion's mass matrix."""
    fronts_product(p.fronts, p.mass, x, y, False)


@addressed
def sizes_band(p, A, x, y):  # type: ignore[no-untyped-def]
    """Add |A| x to y."""
    n, bw = p.inner, p.width - 1
    rows = band_of(p, A)
    for i in range(n):
        for j in range(max(0, i - bw), min(n, i + bw + 1)):
            y[i] += abs(rows[i, bw + j - i] if j <= i else rows[j, bw + i - j]) * x[j]


@addressed
def sizes_fronts(p, A, x, y):  # type: ignore[no-untyped-def]
    """Add |A| x to y."""
    fronts_product(p.fronts, A, x, y, True)


@addressed
def clear_same_kind_band(p, A, kind):  # type: ignore[no-untyped-def]
    """Set entries between unknowns of the same ``kind`` (n,) to zero, but not the diagonal of multipliers (kind 0)."""
    n, bw = p.inner, p.width - 1
    rows = band_of(p, A)
    for i in range(n):
        for j in range(max(0, i - bw), i + 1):
            if kind[i] == kind[j] and (i != j or kind[i] != 0.0):
                rows[i, bw + j - i] = 0.0


@addressed
def clear_same_kind_fronts(p, A, kind):  # type: ignore[no-untyped-def]
    """Same as ``clear_same_kind_band``, for fronts."""
    fronts, unknown = p.fronts, p.fronts.unknown
    for q in range(len(fronts.parent)):
        first, pivots, start = fronts.first[q], fronts.first[q + 1] - fronts.first[q], fronts.start[q]
        height = pivots + fronts.start[q + 1] - start
        for i in range(height):
            row = unknown[first + i if i < pivots else fronts.rows[start + i - pivots]]
            for j in range(min(i + 1, pivots)):
                other = unknown[first + j]
                if kind[row] == kind[other] and (row != other or kind[row] != 0.0):
                    A[fronts.at[q] + (i + 1) * (height - 1) + j] = 0.0


def matrix_functions(fronts: bool, problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries for matrices of the table of a model (``kernels.calls.table``)."""
    kinds = {calls.factor: (factor_band, factor_fronts), calls.factor_complex: (factor_band, factor_fronts),
             calls.solve: (solve_band, solve_fronts), calls.solve_complex: (solve_band, solve_fronts),
             calls.product: (product_band, product_fronts), calls.mass_product: (mass_band, mass_fronts),
             calls.add_sizes: (sizes_band, sizes_fronts),
             calls.clear_same_kind: (clear_same_kind_band, clear_same_kind_fronts)}
    return {call: (functions[fronts], problem) for call, functions in kinds.items()}
