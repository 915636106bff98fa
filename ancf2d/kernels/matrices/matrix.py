"""Assembly of element matrices into a symmetric band, fronts, a general band or compressed rows, chosen by type."""

from __future__ import annotations

from typing import Any, NamedTuple

from numba.extending import overload

from ..lowlevel.arrays import array, numbers
from ..lowlevel.jit import inner, kernel
from ..lowlevel.records import array_at
from .fronts import entry, fill_rows


class SymBand(NamedTuple):
    """Lower half, row by row: values[i, bw + j - i], j <= i (kernels.matrices.band)."""

    values: Any


class Nested(NamedTuple):
    """Lower half, front by front (kernels.matrices.fronts); rows are in the order of elimination."""

    values: Any
    fronts: Any


class Band(NamedTuple):
    """General band, column by column as LAPACK's gbtrf wants it transposed: values[j, 2 bw + i - j]."""

    values: Any


class Csr(NamedTuple):
    """Compressed rows with sorted column indices."""

    values: Any
    indptr: Any
    indices: Any


def _add_symband(matrix, i, j, v):  # type: ignore[no-untyped-def]
    if j <= i:
        matrix.values[i, matrix.values.shape[1] - 1 + j - i] += v


def _add_nested(matrix, i, j, v):  # type: ignore[no-untyped-def]
    if j <= i:
        k = entry(matrix.fronts, i, j)
        if k >= 0:
            matrix.values[k] += v
        elif v != 0.0:
            matrix.fronts.missed[0] = 1


def _add_band(matrix, i, j, v):  # type: ignore[no-untyped-def]
    bw = (matrix.values.shape[1] - 1) // 3
    matrix.values[j, 2 * bw + i - j] += v


@inner
def _entry(indptr, indices, i, j):  # type: ignore[no-untyped-def]
    """Return where entry (i, j) is stored, by bisection."""
    low, high = indptr[i], indptr[i + 1]
    while high - low > 1:
        middle = (low + high) // 2
        if indices[middle] > j:
            high = middle
        else:
            low = middle
    return low


def _add_csr(matrix, i, j, v):  # type: ignore[no-untyped-def]
    matrix.values[_entry(matrix.indptr, matrix.indices, i, j)] += v


_ADD = {SymBand: _add_symband, Nested: _add_nested, Band: _add_band, Csr: _add_csr}


def add(matrix: Any, i: int, j: int, v: float) -> None:
    """Add v to entry (i, j)."""
    _ADD[type(matrix)](matrix, i, j, v)


@overload(add, inline="always")
def _add(matrix, i, j, v):  # type: ignore[no-untyped-def]
    return _ADD[matrix.instance_class]


def only_lower(matrix: Any) -> bool:
    """Return whether a matrix stores only its lower half."""
    return isinstance(matrix, SymBand | Nested)


@overload(only_lower, inline="always")
def _only_lower(matrix):  # type: ignore[no-untyped-def]
    lower = matrix.instance_class in (SymBand, Nested)
    return lambda matrix: lower


@inner
def _is_plain(place, dofs, m):  # type: ignore[no-untyped-def]
    """Return whether no coordinate of element m is a combination of unknowns."""
    plain = True
    for a in range(dofs.shape[1]):
        if place[dofs[m, a]] < -1:
            plain = False
    return plain


@inner
def scatter(matrix, Ke, dofs, m, places):  # type: ignore[no-untyped-def]
    """Add T^T Ke T of element m to the matrix; Ke is symmetric if the matrix is.

    ``places`` is a ``layout.Places`` of the rows of the matrix.
    """
    n, place = dofs.shape[1], places.place
    lower = only_lower(matrix)
    if _is_plain(place, dofs, m):
        for a in range(n):
            i = place[dofs[m, a]]
            if i >= 0:
                for b in range(a + 1 if lower else n):
                    j = place[dofs[m, b]]
                    if j >= 0:
                        if lower and j > i:
                            add(matrix, j, i, Ke[a, b])
                        else:
                            add(matrix, i, j, Ke[a, b])
    else:
        _scatter_combined(matrix, Ke, dofs[m], places)


@inner
def _scatter_combined(matrix, Ke, dofs, places):  # type: ignore[no-untyped-def]
    place, start, unknown, factor = places
    n = len(dofs)
    for a in range(n):
        i = place[dofs[a]]
        if i == -1:
            continue
        for b in range(n):
            j = place[dofs[b]]
            if j == -1:
                continue
            v = Ke[a, b]
            if i >= 0 and j >= 0:
                add(matrix, i, j, v)
            elif i >= 0:
                for q in range(start[-2 - j], start[-1 - j]):
                    add(matrix, i, unknown[q], v * factor[q])
            elif j >= 0:
                for p in range(start[-2 - i], start[-1 - i]):
                    add(matrix, unknown[p], j, v * factor[p])
            else:
                for p in range(start[-2 - i], start[-1 - i]):
                    for q in range(start[-2 - j], start[-1 - j]):
                        add(matrix, unknown[p], unknown[q], v * factor[p] * factor[q])


@kernel
def scatter_patches(matrix, Ks, dofs, first, count, places):  # type: ignore[no-untyped-def]
    """Add the matrices Ks (count, n, n) of elements (or patches) first, first + 1, ... with coordinates dofs (m, n)."""
    for m in range(count):
        scatter(matrix, Ks[m], dofs, first + m, places)


@inner
def scatter_packed(matrix, Ks, scale, entries, dofs, first, places):  # type: ignore[no-untyped-def]
    """Add ``scale`` times the symmetric matrices Ks (entries, m) of elements first, first + 1, ... to the matrix.

    ``entries`` (k, 2) are the rows a and columns b <= a of the entries of Ks; all others are zero.
    """
    lower, n, place = only_lower(matrix), dofs.shape[1], places.place
    K, starts, sources = array(n, n), numbers(dofs, len(entries)), numbers(dofs, len(entries))
    table = numbers(dofs, n * n + n)
    m = 0
    while m < Ks.shape[1]:
        run = _chain(dofs, first + m, Ks.shape[1] - m, place) if lower else 0
        if run > 0:
            _add_chain(matrix, Ks, m, run, scale, entries, dofs, first, place, starts, sources, table)
            m += run
            continue
        if not lower and _is_plain(place, dofs, first + m):
            for x in range(len(entries)):
                i, j = place[dofs[first + m, entries[x, 0]]], place[dofs[first + m, entries[x, 1]]]
                if i >= 0 and j >= 0:
                    v = scale * Ks[x, m]
                    add(matrix, i, j, v)
                    if entries[x, 0] != entries[x, 1]:
                        add(matrix, j, i, v)
        else:
            for x in range(len(entries)):
                K[entries[x, 0], entries[x, 1]] = scale * Ks[x, m]
                K[entries[x, 1], entries[x, 0]] = scale * Ks[x, m]
            _scatter_combined(matrix, K, dofs[first + m], places)
        m += 1


@inner
def _at(x, k):  # type: ignore[no-untyped-def]
    """Return x[k], k >= 0, without the check for negative indices that numba adds to x[k]."""
    return array_at(x, k, (1,))[0]


@inner
def _chain(dofs, first, most, place):  # type: ignore[no-untyped-def]
    """Return how many elements from ``first`` on form a chain: the unknowns of each are those before, shifted equally.

    The result is 1 for an element with held coordinates, 0 if a coordinate is a combination of unknowns.
    """
    n = dofs.shape[1]
    d = array_at(dofs, first * n, (most * n,))
    lowest, count = 0, 1
    for a in range(n):
        lowest = min(lowest, _at(place, d[a]))
    if lowest < 0 or most == 1:
        return 1 if lowest >= -1 else 0
    step, other = _at(place, _at(d, n)) - _at(place, d[0]), 0
    while step >= 0 and count < most:
        for k in range(count * n - n, count * n):
            other |= _at(place, _at(d, k + n)) - _at(place, _at(d, k)) - step
        if other != 0:
            break
        count += 1
    return count


def _add_chain_symband(matrix, Ks, at, count, scale, entries, dofs, first, place, starts, sources,
                       table):  # type: ignore[no-untyped-def]
    # elements at, at + 1, ... of the batch
    width, n = matrix.values.shape[1], dofs.shape[1]
    size, used = len(entries), 0
    d, e = array_at(dofs, (first + at) * n, (count * n,)), array_at(entries, 0, (2 * size,))
    step = width * (_at(place, _at(d, n)) - _at(place, d[0])) if count > 1 else 0
    for x in range(size):
        i, j = _at(place, _at(d, e[2 * x])), _at(place, _at(d, e[2 * x + 1]))
        starts[used], sources[used] = max(i, j) * width + width - 1 - abs(i - j), x * Ks.shape[1] + at
        used += i >= 0 and j >= 0
    for m in range(count):
        for x in range(used):
            array_at(matrix.values, starts[x] + m * step, (1,))[0] += scale * _at(Ks, sources[x] + m)


def _add_chain_nested(matrix, Ks, at, count, scale, entries, dofs, first, place, starts, sources,
                      table):  # type: ignore[no-untyped-def]
    n = dofs.shape[1]
    d = array_at(dofs, (first + at) * n, (count * n,))
    step = _at(place, _at(d, n)) - _at(place, d[0]) if count > 1 else 0
    for x in range(len(entries)):
        i, j = _at(place, _at(d, entries[x, 0])), _at(place, _at(d, entries[x, 1]))
        starts[x], sources[x] = (entries[x, 0], entries[x, 1]) if i > j else (entries[x, 1], entries[x, 0])
        if min(i, j) < 0:
            starts[x] = -1
    for m in range(count):
        fill_rows(matrix.fronts, d, place, m * step, n, table)
        for x in range(len(entries)):
            if starts[x] >= 0:
                low = _at(d, sources[x])
                k = _at(table, _at(table, n * n + sources[x]) * n + starts[x]) + _at(place, low) + m * step
                array_at(matrix.values, k, (1,))[0] += scale * Ks[x, at + m]


def _no_chain(matrix, Ks, at, count, scale, entries, dofs, first, place, starts, sources,
              table):  # type: ignore[no-untyped-def]
    return


def _add_chain(matrix, Ks, at, count, scale, entries, dofs, first, place, starts, sources,
               table):  # type: ignore[no-untyped-def]
    raise NotImplementedError


@overload(_add_chain, inline="always")
def _add_chain_of(matrix, Ks, at, count, scale, entries, dofs, first, place, starts, sources,
                  table):  # type: ignore[no-untyped-def]
    return {SymBand: _add_chain_symband, Nested: _add_chain_nested}.get(matrix.instance_class, _no_chain)


# rows of a product that are computed at a time, diagonal by diagonal, so that they stay in the cache
_ROWS = 512


@kernel
def scatter_classes(matrix, Ms, cls, dofs, places):  # type: ignore[no-untyped-def]
    """Add Ms[cls[m]] (classes, n, n) of every element m with coordinates dofs (ne, n) to the matrix of the unknowns."""
    for m in range(len(dofs)):
        scatter(matrix, Ms[cls[m]], dofs, m, places)


@kernel
def band_product(A, x, y):  # type: ignore[no-untyped-def]
    """Fill y = K x of a symmetric band (kernels.matrices.band's storage)."""
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
    """Fill y = M x from the nonzero diagonals of the band (``Problem.mass_offsets``), in vector instructions."""
    n = len(y)
    for first in range(0, n, _ROWS):
        last = min(first + _ROWS, n)
        out = array_at(y, first, (last - first,))
        for i in range(last - first):
            out[i] = 0.0
        for q in range(len(p.mass_offsets)):
            k, at = p.mass_offsets[q], q * n
            _add_products(p.mass_diagonals, at + first, x, first + k, y, first, min(last, n - k) - first)
            if k > 0:
                start = max(first, k)
                _add_products(p.mass_diagonals, at + start - k, x, start - k, y, start, last - start)


@inner
def _add_products(a, i, x, j, y, k, m):  # type: ignore[no-untyped-def]
    """Add a[i:i + m] * x[j:j + m] to y[k:k + m], elementwise."""
    p, q, out = array_at(a, i, (m,)), array_at(x, j, (m,)), array_at(y, k, (m,))
    for l in range(m):
        out[l] += p[l] * q[l]
