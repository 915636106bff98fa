"""Multifrontal symmetric LDL^T without pivoting, for models that are not chains (``model.fronts``).

A front of s pivots and u further rows is stored row by row as the lower half of an (s + u, s + u) matrix, with rows
s + u - 1 numbers apart, which is the band storage of a full matrix (``band``). Only columns of pivots contain matrix
entries; the Schur complement in the other columns is added to the parent front.
"""

from __future__ import annotations

import numpy as np

from ..lowlevel.arrays import numbers, vector
from ..lowlevel.blocks import inverse, size, work_size
from ..lowlevel.jit import inner, kernel
from ..lowlevel.records import array_at
from .band import eliminate_pivots, solve_lower, solve_upper


@inner
def _row_in(fronts, q, i):  # type: ignore[no-untyped-def]
    """Return the row of front q that is row i of the matrix, or -1 if it has none; i is at least its first pivot.

    Rows beyond the pivots are found by bisection.
    """
    row, pivots = i - fronts.first[q], fronts.first[q + 1] - fronts.first[q]
    if row < pivots:
        return row
    low, high = fronts.start[q], fronts.start[q + 1]
    while high - low > 1:
        middle = (low + high) // 2
        if fronts.rows[middle] > i:
            high = middle
        else:
            low = middle
    return pivots + low - fronts.start[q] if low < high and fronts.rows[low] == i else -1


@inner
def _offset(fronts, q, row):  # type: ignore[no-untyped-def]
    """Return the offset of a row of front q, so that column j of the matrix is at offset + j, for pivot columns j."""
    apart = fronts.first[q + 1] - fronts.first[q] + fronts.start[q + 1] - fronts.start[q] - 1
    return fronts.at[q] + (row + 1) * apart - fronts.first[q]


@inner
def entry(fronts, i, j):  # type: ignore[no-untyped-def]
    """Return where entry (i, j), j <= i, of the matrix is stored, or -1 if the fronts do not have it."""
    q = fronts.owner[j]
    row = _row_in(fronts, q, i)
    return _offset(fronts, q, row) + j if row >= 0 else -1


@inner
def fill_rows(fronts, d, place, shift, n, table):  # type: ignore[no-untyped-def]
    """Fill ``table`` with row offsets for the entries of an element with coordinates d (n,).

    The rows are place[d] + ``shift``. Entry (a, b), where b is eliminated first, is stored at
    ``table[table[n n + b] n + a]`` + the row of b. Each front is searched only once.
    """
    known = 0
    for b in range(n):
        j = place[d[b]]
        if j < 0:
            continue
        q, c = fronts.owner[j + shift], 0
        while c < b and (place[d[c]] < 0 or fronts.owner[place[d[c]] + shift] != q):
            c += 1
        if c < b:
            table[n * n + b] = table[n * n + c]
            continue
        for a in range(n):
            i = place[d[a]] + shift
            if place[d[a]] >= 0 and i >= fronts.first[q]:
                table[known * n + a] = _offset(fronts, q, _row_in(fronts, q, i))
        table[n * n + b] = known
        known += 1


@kernel
def fronts_factor(fronts, values, tiny, scale):  # type: ignore[no-untyped-def]
    """Factor K = L D L^T in place; return (first bad unknown or -1, negative pivots, smallest relative pivot).

    Bad pivots are defined as in ``band.ldl_factor``.
    """
    C, sizes = numbers(values, work_size(fronts.largest)), vector(fronts.largest)
    for q in range(len(fronts.parent)):
        first, pivots = fronts.first[q], fronts.first[q + 1] - fronts.first[q]
        apart = pivots + fronts.start[q + 1] - fronts.start[q] - 1
        for k in range(pivots):
            scale[first + k] = size(values[fronts.at[q] + (k + 1) * apart + k])
    negative, smallest = 0, np.inf
    for q in range(len(fronts.parent)):
        first, pivots, start = fronts.first[q], fronts.first[q + 1] - fronts.first[q], fronts.start[q]
        below = fronts.start[q + 1] - start
        height = pivots + below
        for k in range(pivots):
            sizes[k] = scale[first + k]
        for k in range(below):
            sizes[pivots + k] = 0.0
        A, flat = (array_at(values, fronts.at[q], (height, height)),
                   array_at(values, fronts.at[q], (height * height,)))
        bad, found, least = eliminate_pivots(A, flat, pivots, tiny, sizes, C)
        negative += found
        smallest = least if least < smallest else smallest
        if bad >= 0:
            return fronts.unknown[first + bad], negative, smallest
        for k in range(below):
            scale[fronts.rows[start + k]] += sizes[pivots + k]
        if below > 0:
            _add_to_parent(fronts, values, q, pivots, below)
    return -1, negative, smallest


@inner
def _add_to_parent(fronts, values, q, pivots, below):  # type: ignore[no-untyped-def]
    """Add the Schur complement of front q to its parent front."""
    p, start, apart = fronts.parent[q], fronts.start[q], pivots + below - 1
    stride = fronts.first[p + 1] - fronts.first[p] + fronts.start[p + 1] - fronts.start[p] - 1
    into = array_at(fronts.into, start, (below,))
    for i in range(below):
        source = array_at(values, fronts.at[q] + (pivots + i + 1) * apart + pivots, (i + 1,))
        target = array_at(values, fronts.at[p] + (into[i] + 1) * stride, (into[i] + 1,))
        for j in range(i + 1):
            target[into[j]] += source[j]


@kernel
def fronts_solve(fronts, values, x):  # type: ignore[no-untyped-def]
    """Solve L D L^T x = b in place: ``x`` holds b on entry, the solution afterwards."""
    y, unknown = numbers(x, fronts.largest), fronts.unknown
    m = len(fronts.parent)
    for step in range(2 * m):
        q = step if step < m else 2 * m - 1 - step
        first, pivots, start = fronts.first[q], fronts.first[q + 1] - fronts.first[q], fronts.start[q]
        below = fronts.start[q + 1] - start
        height = pivots + below
        A, flat = (array_at(values, fronts.at[q], (height, height)),
                   array_at(values, fronts.at[q], (height * height,)))
        own = array_at(y, 0, (height,))
        for k in range(pivots):
            own[k] = x[unknown[first + k]]
        if step < m:
            for k in range(below):
                own[pivots + k] = 0.0
            solve_lower(A, flat, own, pivots)
            for k in range(below):
                x[unknown[fronts.rows[start + k]]] += own[pivots + k]
            for k in range(pivots):
                own[k] *= inverse(A[k, height - 1])
        else:
            for k in range(below):
                own[pivots + k] = x[unknown[fronts.rows[start + k]]]
            solve_upper(A, flat, own, pivots)
        for k in range(pivots):
            x[unknown[first + k]] = own[k]


@kernel
def fronts_product(fronts, values, x, y, sizes):  # type: ignore[no-untyped-def]
    """Fill y = K x; with ``sizes`` add |K| x to y."""
    # the parts of x and y at the pivots of a front
    own, sums, unknown = numbers(x, fronts.largest), numbers(x, fronts.largest), fronts.unknown
    if not sizes:
        y[:] = 0.0
    for q in range(len(fronts.parent)):
        first, pivots, start = fronts.first[q], fronts.first[q + 1] - fronts.first[q], fronts.start[q]
        height = pivots + fronts.start[q + 1] - start
        for k in range(pivots):
            own[k], sums[k] = x[unknown[first + k]], y[unknown[first + k]]
        for i in range(height):
            at = unknown[first + i if i < pivots else fronts.rows[start + i - pivots]]
            row, here, total = fronts.at[q] + (i + 1) * (height - 1), x[at], 0.0 * x[at]
            for j in range(min(i, pivots)):
                a = abs(values[row + j]) if sizes else values[row + j]
                total += a * own[j]
                sums[j] += a * here
            if i < pivots:
                total += (abs(values[row + i]) if sizes else values[row + i]) * here
                sums[i] += total
            else:
                y[at] += total
        for k in range(pivots):
            y[unknown[first + k]] = sums[k]
