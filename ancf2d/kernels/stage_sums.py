"""Sums of stages, (s, n) with s odd: so many unknowns at a time that all their stages stay in the cache."""

from __future__ import annotations

from .lowlevel.jit import inner
from .lowlevel.pointers import array_at

# unknowns that are worked on at a time
TILE = 128


@inner
def combine(F, i, X, first, out, to, count):  # type: ignore[no-untyped-def]
    """Fill numbers of ``out`` from entry ``to`` on with the sum of F[i, j] X[j, first:first + count] over j."""
    s, n = X.shape
    total, a, b, c = (array_at(out, to, (count,)), array_at(X, first, (count,)), array_at(X, n + first, (count,)),
                      array_at(X, 2 * n + first, (count,)))
    f, g, h = F[i, 0], F[i, 1], F[i, 2]
    for k in range(count):
        total[k] = f * a[k] + g * b[k] + h * c[k]
    for j in range(3, s, 2):
        a, b = array_at(X, j * n + first, (count,)), array_at(X, (j + 1) * n + first, (count,))
        f, g = F[i, j], F[i, j + 1]
        for k in range(count):
            total[k] += f * a[k] + g * b[k]


@inner
def combine_all(F, X, out):  # type: ignore[no-untyped-def]
    """Fill out (s, n) with F X."""
    s, n = X.shape
    for first in range(0, n, TILE):
        for i in range(s):
            combine(F, i, X, first, out, i * n + first, min(TILE, n - first))


@inner
def separate(F, R, y, u, rows):  # type: ignore[no-untyped-def]
    """Fill y (n,) and u (k, n) with F R: its first row, then real and imaginary parts; rows (s, TILE) to work in."""
    n = len(y)
    for first in range(0, n, TILE):
        count = min(TILE, n - first)
        combine(F, 0, R, first, y, first, count)
        for q in range(len(u)):
            for j in (1 + 2 * q, 2 + 2 * q):
                combine(F, j, R, first, rows, j * TILE, count)
            out = u[q]
            for k in range(count):
                out[first + k] = complex(rows[1 + 2 * q, k], rows[2 + 2 * q, k])


@inner
def unite(F, y, u, R, rows):  # type: ignore[no-untyped-def]
    """Fill R (s, n) with F (y, Re u_1, Im u_1, ...); rows (s, TILE) to work in."""
    n = len(y)
    for first in range(0, n, TILE):
        count = min(TILE, n - first)
        for k in range(count):
            rows[0, k] = y[first + k]
        for q in range(len(u)):
            x = u[q]
            for k in range(count):
                rows[1 + 2 * q, k], rows[2 + 2 * q, k] = x[first + k].real, x[first + k].imag
        for i in range(len(R)):
            combine(F, i, rows, 0, R, i * n + first, count)
