"""Layout of matrices of the unknowns: places of coordinates, tree of fronts. This module needs no compiler."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.int64]


class Places(NamedTuple):
    """Position of each full coordinate among the unknowns.

    place : (n_full,) its unknown (>= 0), -1 if it is held, or -2 - k if it is the linear combination k of unknowns
    ``unknown[start[k]:start[k + 1]]`` with the same range of ``factor``.
    """

    place: Index
    start: Index
    unknown: Index
    factor: NDArray[np.float64]


class Fronts(NamedTuple):
    """The tree of fronts, children before parents: n unknowns, m fronts of s pivots and u further rows.

    first : (m + 1,) first pivot of each front; start : (m + 1,) range of its further rows in ``rows`` (unknowns) and
    ``into`` (row in the parent front); at : (m + 1,) where its (s + u, s + u) numbers start; parent : (m,) parent front
    or -1; owner : (n,) front that eliminates each unknown; largest : the largest s + u.
    """

    first: Index
    start: Index
    rows: Index
    into: Index
    at: Index
    parent: Index
    owner: Index
    largest: int


def no_fronts() -> Fronts:
    """Return a tree without fronts, which has the type of all trees."""
    none, one = np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64)
    return Fronts(one, one, none, none, one, none, none, 0)


def entries(fronts: Fronts, i: Index, j: Index) -> Index:
    """Return where entries (i, j), j <= i, of the matrix are among the numbers of all fronts."""
    q, n = fronts.owner[j], len(fronts.owner)
    first, start = fronts.first[q], fronts.start[q]
    pivots = fronts.first[q + 1] - first
    apart = pivots + fronts.start[q + 1] - start - 1
    of = np.repeat(np.arange(len(fronts.parent)), np.diff(fronts.start))
    below = np.searchsorted(of * n + fronts.rows, q * n + i) - start
    return np.asarray(fronts.at[q] + (np.where(i - first < pivots, i - first, pivots + below) + 1) * apart + j - first)
