"""Symmetric band LDL^T without pivoting: factor, solve, inertia; complex symmetric ones too.

Storage is row by row: ``A[i, bw + j - i] = K[i, j]`` for i - bw <= j <= i, shape (n, bw + 1).
"""

from __future__ import annotations

import numpy as np

from .jit import kernel, kernel_with_memory


@kernel_with_memory
def ldl_factor(A, tiny):  # type: ignore[no-untyped-def]
    """Factor K = L D L^T in place; return (first bad row or -1, negative pivots, smallest relative pivot).

    ``A`` holds L below and D on the diagonal afterwards. A pivot is bad where it is not a number or
    smaller than ``tiny`` times the terms that it is the difference of: the system is singular there.
    Each pivot is taken out of the rows below it at once: rows are contiguous, and nothing waits for a sum.
    """
    n, w = A.shape
    return ldl_factor_with(A, tiny, np.empty(w, A.dtype), np.empty(n))


@kernel
def ldl_factor_with(A, tiny, column, scale):  # type: ignore[no-untyped-def]
    """Do as ``ldl_factor`` does, with arrays to work in: column (bw + 1 or more,) of A's kind, scale (n,)."""
    n, w = A.shape
    bw = w - 1
    negative = 0
    smallest = np.inf
    for i in range(n):
        scale[i] = abs(A[i, bw])
    for k in range(n):
        d = A[k, bw]
        ratio = abs(d) / scale[k] if scale[k] > 0.0 else 0.0
        if ratio < smallest:
            smallest = ratio
        if not ratio > tiny:
            return k, negative, smallest
        if d.real < 0.0:
            negative += 1
        over = 1.0 / d
        for m in range(min(bw, n - 1 - k)):
            i = k + 1 + m
            x = A[i, bw - 1 - m]
            l = x * over
            column[m] = x
            A[i, bw - 1 - m] = l
            scale[i] += abs(l * x)
            for j in range(m + 1):
                A[i, bw - m + j] -= l * column[j]
    return -1, negative, smallest


@kernel
def ldl_solve(A, x):  # type: ignore[no-untyped-def]
    """Solve L D L^T x = b in place: ``x`` holds b on entry, the solution afterwards."""
    n, w = A.shape
    bw = w - 1
    for k in range(n):
        s = x[k]
        for m in range(min(bw, n - 1 - k)):
            x[k + 1 + m] -= A[k + 1 + m, bw - 1 - m] * s
    for i in range(n):
        x[i] /= A[i, bw]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for j in range(max(0, i - bw), i):
            x[j] -= A[i, bw + j - i] * s
