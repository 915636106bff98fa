"""Symmetric band LDL^T without pivoting: factor, solve, inertia; complex symmetric ones too.

Storage is row by row: ``A[i, bw + j - i] = K[i, j]`` for i - bw <= j <= i, shape (n, bw + 1).
"""

from __future__ import annotations

import numpy as np

from .jit import kernel


@kernel
def ldl_factor(A, tiny):  # type: ignore[no-untyped-def]
    """Factor K = L D L^T in place; return (first bad row or -1, negative pivots, smallest relative pivot).

    ``A`` holds L below and D on the diagonal afterwards. A pivot is bad where it is not a number or
    smaller than ``tiny`` times the terms that it is the difference of: the system is singular there.
    """
    n, w = A.shape
    bw = w - 1
    negative = 0
    smallest = np.inf
    for i in range(n):
        j0 = max(0, i - bw)
        row = A[i]
        scale = abs(row[bw])
        # row[bw + j - i] becomes (L D)_ij, column after column
        for j in range(j0 + 1, i):
            k0 = max(j0, j - bw)
            other = A[j]
            s = row[bw + j - i]
            a, b = bw + k0 - i, bw + k0 - j
            for k in range(j - k0):
                s -= row[a + k] * other[b + k]
            row[bw + j - i] = s
        d = row[bw]
        for j in range(j0, i):
            p = bw + j - i
            l = row[p] / A[j, bw]
            d -= l * row[p]
            scale += abs(l * row[p])
            row[p] = l
        row[bw] = d
        ratio = abs(d) / scale if scale > 0.0 else 0.0
        if ratio < smallest:
            smallest = ratio
        if not ratio > tiny:
            return i, negative, smallest
        if d.real < 0.0:
            negative += 1
    return -1, negative, smallest


@kernel
def ldl_solve(A, x):  # type: ignore[no-untyped-def]
    """Solve L D L^T x = b in place: ``x`` holds b on entry, the solution afterwards."""
    n, w = A.shape
    bw = w - 1
    for i in range(n):
        j0 = max(0, i - bw)
        s = x[i]
        for j in range(j0, i):
            s -= A[i, bw + j - i] * x[j]
        x[i] = s
    for i in range(n):
        x[i] /= A[i, bw]
    for i in range(n - 1, -1, -1):
        j0 = max(0, i - bw)
        s = x[i]
        for j in range(j0, i):
            x[j] -= A[i, bw + j - i] * s
