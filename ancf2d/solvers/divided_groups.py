"""Element groups divided among threads, with results independent of the number of threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from ..elements.shape import Array
from ..model.groups import of_elements
from ..model.numbering import Numbering
from ..processors import threads

# least number of elements of a part: for fewer, starting threads takes longer than the work
PART = 4096
MOST = 8


class DividedGroups:
    """Element groups of a model in parts that share no unknown, and the elements between the parts.

    The partition depends only on the model, and the elements between parts come last, so that sums are independent of
    the number of threads.
    """

    def __init__(self, groups: list[Any], num: Numbering) -> None:
        shares = [_share(group, num) for group in groups]
        self.stages = [stage for share in shares for stage in share]
        most = max((len(stage) for stage in self.stages), default=1)
        self.pool = ThreadPoolExecutor(min(threads(), most)) if min(threads(), most) > 1 else None

    def total(self, work: Callable[[Any], Any]) -> float:
        """Return the sum of ``work`` over all groups (None counts as zero); ``work`` runs without the GIL."""
        total = 0.0
        for stage in self.stages:
            found = map(work, stage) if self.pool is None or len(stage) == 1 else self.pool.map(work, stage)
            for value in found:
                total += value or 0.0
        return total


def _share(group: Any, num: Numbering) -> list[list[Any]]:
    """Return a group in stages: first its parts, which can run in parallel, then the elements between them."""
    ne = len(group.dofs)
    count = min(MOST, ne // PART)
    if count < 2:
        return [[group]]
    ends = np.linspace(0, ne, count + 1).astype(int)
    between = ends[1:-1]
    parts = [slice(a + (k > 0), b) for k, (a, b) in enumerate(pairwise(ends))]
    if not _independent([group.dofs[p] for p in parts], num):
        return [[group]]
    return [[of_elements(group, p) for p in parts], [of_elements(group, between)]]


def _independent(parts: list[Array], num: Numbering) -> bool:
    """Return whether no two parts share a coordinate or an unknown."""
    seen = np.zeros(len(num.place) + num.n_unknowns, dtype=bool)
    for dofs in parts:
        here = np.zeros(len(num.place), dtype=bool)
        here[dofs] = True
        coordinates = np.flatnonzero(here)
        place = num.place[coordinates]
        combined = [num.index[num.indptr[k]:num.indptr[k + 1]] for k in -2 - place[place < -1]]
        touched = np.concatenate([coordinates, len(num.place) + np.concatenate([place[place >= 0], *combined])])
        if seen[touched].any():
            return False
        seen[touched] = True
    return True
