"""Where the numbers of a matrix of the unknowns are: places of coordinates, tree of fronts. This needs no compiler."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.int64]


class Places(NamedTuple):
    """Where each of the full coordinates is among the unknowns.

    place : (n_full,) its unknown (>= 0), -1 where it is held, or -2 - k where it is the combination k of unknowns,
    ``unknown[start[k]:start[k + 1]]`` with factors ``factor``.
    """

    place: Index
    start: Index
    unknown: Index
    factor: NDArray[np.float64]


class Fronts(NamedTuple):
    """The tree of fronts, children before parents; n unknowns, m fronts of s pivots and u rows beyond them.

    first : (m + 1,) first pivot of each front; start : (m + 1,) where its rows are in ``rows`` (positions of unknowns)
    and ``into`` (where they stand in the parent's front); at : (m + 1,) where its (s + u, s + u) numbers start among
    all; parent : (m,) or -1; owner : (n,) the front that takes out each unknown; largest : the largest s + u.
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
    """Return a tree of no fronts: all trees are of its type."""
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
