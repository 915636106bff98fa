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

    Rows of the matrix are in the order of elimination. first : (m + 1,) first pivot of each front; start : (m + 1,)
    range of its further rows in ``rows`` and ``into`` (row in the parent front); at : (m + 1,) where its (s + u, s + u)
    numbers start; parent : (m,) parent front or -1; owner : (n,) front that eliminates each row; largest : the largest
    s + u; unknown : (n,) unknown of each row; row : (n,) row of each unknown; missed : (2,) set to 1 when a number
    other than zero has been assembled to an entry that the fronts do not have, and which is lost; 1 while a motion is
    in the state for which the fronts were made.
    """

    first: Index
    start: Index
    rows: Index
    into: Index
    at: Index
    parent: Index
    owner: Index
    largest: int
    unknown: Index
    row: Index
    missed: Index


def no_fronts() -> Fronts:
    """Return a tree without fronts, which has the type of all trees."""
    none, one = np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64)
    return Fronts(one, one, none, none, one, none, none, 0, none, none, np.zeros(2, dtype=np.int64))


def stored_entries(fronts: Fronts, between: NDArray[np.bool_] | None = None) -> tuple[Index, Index]:
    """Return the unknowns of all entries that the fronts have, each once, of either half of the symmetric matrix.

    With ``between`` (n,), return only entries between one of these unknowns and one of the others.
    """
    i, j = [], []
    for q, (first, last) in enumerate(zip(fronts.first[:-1].tolist(), fronts.first[1:].tolist(), strict=True)):
        own = np.arange(first, last)
        rows = np.append(own, fronts.rows[fronts.start[q]:fronts.start[q + 1]])
        low, high = (x.ravel() for x in np.meshgrid(own, rows))
        chosen = high >= low
        if between is not None:
            chosen &= between[fronts.unknown[high]] != between[fronts.unknown[low]]
        i.append(fronts.unknown[high[chosen]])
        j.append(fronts.unknown[low[chosen]])
    none = np.zeros(0, dtype=np.int64)
    return np.concatenate([none, *i]), np.concatenate([none, *j])


def entries(fronts: Fronts, one: Index, other: Index) -> Index:
    """Return where entries (one, other) of two unknowns each are among the numbers of all fronts."""
    i, j = fronts.row[one], fronts.row[other]
    i, j = np.maximum(i, j), np.minimum(i, j)
    q, n = fronts.owner[j], len(fronts.owner)
    first, start = fronts.first[q], fronts.start[q]
    pivots = fronts.first[q + 1] - first
    apart = pivots + fronts.start[q + 1] - start - 1
    of = np.repeat(np.arange(len(fronts.parent)), np.diff(fronts.start))
    below = np.searchsorted(of * n + fronts.rows, q * n + i) - start
    return np.asarray(fronts.at[q] + (np.where(i - first < pivots, i - first, pivots + below) + 1) * apart + j - first)
