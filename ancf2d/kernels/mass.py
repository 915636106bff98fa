"""Constant matrices of elements into the storage of the tangent, and products with it."""

from __future__ import annotations

from .jit import kernel
from .matrix import scatter


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
