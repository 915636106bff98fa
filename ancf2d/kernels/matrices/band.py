"""Symmetric band LDL^T without pivoting: factor, solve, inertia; for real and complex symmetric matrices.

Storage is row by row: ``A[i, bw + j - i] = K[i, j]`` for i - bw <= j <= i, shape (n, bw + 1). Pivots are eliminated
four at a time, in blocks of four rows and four columns; in narrow bands and at the end one by one.
"""

from __future__ import annotations

import numpy as np

from ..lowlevel.arrays import numbers
from ..lowlevel.blocks import (
    backward,
    eliminate,
    forward,
    inverse,
    size,
    subtract_on_diagonal,
    subtract_product,
    work_size,
)
from ..lowlevel.jit import inner, kernel, merged

# below this half bandwidth, blocks of four would overlap more than one row
NARROW = 4


@kernel
def ldl_factor(A, tiny, scale):  # type: ignore[no-untyped-def]
    """Factor K = L D L^T in place; return (first bad row or -1, negative pivots, smallest relative pivot).

    Afterwards ``A`` holds L below and D on the diagonal; ``scale`` (n,) is work space. A pivot is bad if it is nan or
    smaller than ``tiny`` times the sum of the terms that form it: the matrix is singular there. Sizes of complex
    numbers are |re| + |im|.
    """
    n, w = A.shape
    bw = w - 1
    for i in range(n):
        scale[i] = size(A[i, bw])
    return eliminate_pivots(A, A.reshape(n * w), n, tiny, scale, numbers(A, work_size(bw)))


@inner
def eliminate_pivots(A, flat, pivots, tiny, scale, C):  # type: ignore[no-untyped-def]
    """Eliminate the first ``pivots`` pivots from all rows; returns as ``ldl_factor``.

    ``flat`` is A as one row, C work space for blocks.
    """
    bad, negative, smallest, k = -1, 0, np.inf, 0
    bw = A.shape[1] - 1
    while bad < 0 and bw >= NARROW and k + 4 <= pivots:
        bad, found, least = _four_pivots(A, flat, k, tiny, scale, C)
        negative += found
        smallest = least if least < smallest else smallest
        k += 4
    while bad < 0 and k < pivots:
        d = A[k, bw]
        ratio = size(d) / scale[k] if scale[k] > 0.0 else 0.0
        smallest = ratio if ratio < smallest else smallest
        if not ratio > tiny:
            bad = k
        else:
            negative += d.real < 0.0
            _one_pivot(A, k, scale)
            k += 1
    return bad, negative, smallest


@merged
def _one_pivot(A, k, scale):  # type: ignore[no-untyped-def]
    """Eliminate pivot k from the rows below it, the last row first, since it needs column k of the rows above it."""
    n, w = A.shape
    bw = w - 1
    over = inverse(A[k, bw])
    for i in range(min(k + bw, n - 1), k, -1):
        x = A[i, bw + k - i]
        l = x * over
        for j in range(k + 1, i + 1):
            A[i, bw + j - i] -= l * A[j, bw + k - j]
        A[i, bw + k - i] = l
        scale[i] += size(l * x)


@merged
def _triangle(flat, at, bw):  # type: ignore[no-untyped-def]
    """Factor the triangle of four pivots, the first at entry ``at``; return (D, 1/D, L D below the pivots, sizes).

    ``sizes`` are the sums of the sizes of the terms subtracted from pivots 1, 2, 3.
    """
    b, c, d = at + bw, at + 2 * bw, at + 3 * bw
    d0, x10, x20, x30 = flat[at], flat[b], flat[c], flat[d]
    o0 = inverse(d0)
    l10, l20, l30 = x10 * o0, x20 * o0, x30 * o0
    d1 = flat[b + 1] - l10 * x10
    o1 = inverse(d1)
    x21, x31 = flat[c + 1] - l20 * x10, flat[d + 1] - l30 * x10
    l21, l31 = x21 * o1, x31 * o1
    d2 = flat[c + 2] - l20 * x20 - l21 * x21
    o2 = inverse(d2)
    x32 = flat[d + 2] - l30 * x20 - l31 * x21
    l32 = x32 * o2
    d3 = flat[d + 3] - l30 * x30 - l31 * x31 - l32 * x32
    flat[b], flat[b + 1] = l10, d1
    flat[c], flat[c + 1], flat[c + 2] = l20, l21, d2
    flat[d], flat[d + 1], flat[d + 2], flat[d + 3] = l30, l31, l32, d3
    sizes = (size(l10 * x10), size(l20 * x20) + size(l21 * x21),
             size(l30 * x30) + size(l31 * x31) + size(l32 * x32))
    return (d0, d1, d2, d3), (o0, o1, o2, inverse(d3)), (x10, x20, x21, x30, x31, x32), sizes


@merged
def _four_pivots(A, flat, k, tiny, scale, C):  # type: ignore[no-untyped-def]
    """Eliminate pivots k, ..., k + 3 from the rows below; return (bad row or -1, negative pivots, smallest ratio)."""
    n, w = A.shape
    bw = w - 1
    D, over, below, sizes = _triangle(flat, k * w + bw, bw)
    for p in range(3):
        scale[k + 1 + p] += sizes[p]
    negative, smallest = 0, np.inf
    for p in range(4):
        ratio = size(D[p]) / scale[k + p] if scale[k + p] > 0.0 else 0.0
        smallest = ratio if ratio < smallest else smallest
        if not ratio > tiny:
            return k + p, negative, smallest
        negative += D[p].real < 0.0
    stride = (len(C) - 16) // 4
    for m in range(4, min(bw + 4, n - k), 4):
        at, count = (k + m) * w + bw - m, n - k - m
        if eliminate(flat, at, bw, m - bw, count, C, stride, m - 4, scale, k + m, over, below):
            for j in range(4, m, 4):
                subtract_product(flat, at + j, bw, count, C, stride, j - 4)
            subtract_on_diagonal(flat, at + m, bw, count, C, stride, m - 4)
    return -1, negative, smallest


@kernel
def ldl_solve(A, x):  # type: ignore[no-untyped-def]
    """Solve L D L^T x = b in place: ``x`` holds b on entry, the solution afterwards."""
    n, w = A.shape
    bw, flat = w - 1, A.reshape(n * w)
    solve_lower(A, flat, x, n)
    for i in range(n):
        x[i] *= inverse(A[i, bw])
    solve_upper(A, flat, x, n)


@inner
def solve_lower(A, flat, x, pivots):  # type: ignore[no-untyped-def]
    """Solve L y = x in place for the first ``pivots`` unknowns, and subtract their terms from all rows below."""
    n, w = A.shape
    bw, last = w - 1, n // 4
    below, fours = (bw + 3) // 4, pivots // 4 if bw >= NARROW else 0
    for p in range(fours):
        k = 4 * p
        forward(flat, k * w + bw, bw, x, k, min(below, last - 1 - p))
        # rows at the end that do not fill a block
        for i in range(4 * last, min(k + bw + 4, n)):
            for j in range(max(k, i - bw), k + 4):
                x[i] -= A[i, bw + j - i] * x[j]
    for j in range(4 * fours, pivots):
        for i in range(j + 1, min(j + bw, n - 1) + 1):
            x[i] -= A[i, bw + j - i] * x[j]


@inner
def solve_upper(A, flat, x, pivots):  # type: ignore[no-untyped-def]
    """Solve L^T y = x in place for the first ``pivots`` unknowns, the last one first."""
    n, w = A.shape
    bw, last = w - 1, n // 4
    below, fours = (bw + 3) // 4, pivots // 4 if bw >= NARROW else 0
    for j in range(pivots - 1, 4 * fours - 1, -1):
        for i in range(min(j + bw, n - 1), j, -1):
            x[j] -= A[i, bw + j - i] * x[i]
    for p in range(fours - 1, -1, -1):
        k = 4 * p
        for i in range(4 * last, min(k + bw + 4, n)):
            for j in range(max(k, i - bw), k + 4):
                x[j] -= A[i, bw + j - i] * x[i]
        backward(flat, k * w + bw, bw, x, k, min(below, last - 1 - p))
