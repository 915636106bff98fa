"""Constant matrices of elements into the storage of the tangent, and products with it."""

from __future__ import annotations

from .lowlevel.jit import inner, kernel
from .lowlevel.pointers import array_at
from .matrix import scatter

# rows of a product that are made diagonal by diagonal, so that they stay in the cache
_ROWS = 512


@kernel
def scatter_classes(matrix, Ms, cls, dofs, place, indptr, index, value):  # type: ignore[no-untyped-def]
    """Add Ms[cls[m]] (classes, n, n) of every element m with coordinates dofs (ne, n) to the matrix of the unknowns."""
    for m in range(len(dofs)):
        scatter(matrix, Ms[cls[m]], dofs, m, place, indptr, index, value)


@kernel
def band_product(A, x, y):  # type: ignore[no-untyped-def]
    """Fill y = K x of a symmetric band (kernels.band's storage)."""
    n, w = A.shape
    bw = w - 1
    y[:] = 0.0
    for i in range(n):
        xi, s = x[i], A[i, bw] * x[i]
        for j in range(max(0, i - bw), i):
            a = A[i, bw + j - i]
            s += a * x[j]
            y[j] += a * xi
        y[i] += s


@inner
def product_by_diagonals(p, x, y):  # type: ignore[no-untyped-def]
    """Fill y = M x by those diagonals of the band that are not zero: the same row of x and y side by side."""
    n = len(y)
    for first in range(0, n, _ROWS):
        last = min(first + _ROWS, n)
        out = array_at(y, first, (last - first,))
        for i in range(last - first):
            out[i] = 0.0
        for q in range(len(p.diagonals)):
            k, at = p.diagonals[q], q * n
            _add_products(p.along, at + first, x, first + k, y, first, min(last, n - k) - first)
            if k > 0:
                start = max(first, k)
                _add_products(p.along, at + start - k, x, start - k, y, start, last - start)


@inner
def _add_products(a, i, x, j, y, k, m):  # type: ignore[no-untyped-def]
    """Add the products of m numbers each, from a[i] and x[j] on, to y[k] and what follows."""
    p, q, out = array_at(a, i, (m,)), array_at(x, j, (m,)), array_at(y, k, (m,))
    for l in range(m):
        out[l] += p[l] * q[l]
