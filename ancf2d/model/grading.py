"""Meshes of unequal elements: a map of a body's axis, of which all elements take equal shares.

A body has the map S = phi(x) from 0..1 to 0..1, and n elements end at phi(k/n). A mesh of 2 n elements then has all
nodes of one of n, and refined meshes keep their proportions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..case import Element, Profile
from ..elements.shape import gauss
from .profiles import breaks, values

Array = NDArray[np.float64]

# cells of a profile of lengths that are integrated on their own, points in each, and steps of Newton's method
CELLS, POINTS, STEPS = 256, 8, 4
# lengths of elements that differ by less, relative, are the same
SAME = 1e-10


@dataclass(frozen=True)
class Ratio:
    """Elements whose length changes evenly along the body, to ``ratio`` times that at the start: in a geometric series.

    phi(x) = (ratio^x - 1)/(ratio - 1).
    """

    ratio: float
    nodes = ()

    def places(self, x: Array) -> Array:
        """Return S at shares x of the elements."""
        log = math.log(self.ratio)
        return x if log == 0.0 else np.expm1(x * log) / math.expm1(log)

    def shares(self, s: Array) -> Array:
        """Return the shares of the elements that lie before places S."""
        log = math.log(self.ratio)
        return s if log == 0.0 else np.log1p(s * math.expm1(log)) / log


@dataclass(frozen=True)
class Lengths:
    """Elements as long, relative to one another, as a profile h(s) says: dx/ds is proportional to 1/h."""

    profile: Profile
    nodes = ()

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        """Ends of cells, and the integral of 1/h up to each."""
        ends = np.unique(np.concatenate([np.linspace(0.0, 1.0, CELLS + 1), [s for s, _ in breaks(self.profile)]]))
        return ends, np.concatenate([[0.0], np.cumsum(self._integral(ends[:-1], ends[1:]))])

    def _integral(self, a: Array, b: Array) -> Array:
        """Return the integrals of 1/h from a (n,) to b (n,)."""
        x, w = gauss(POINTS)
        at = a[:, None] + (b - a)[:, None] * x
        return (b - a) * ((1.0 / values(self.profile, at.ravel()).reshape(at.shape)) @ w)

    def shares(self, s: Array) -> Array:
        """Return the shares of the elements that lie before places S."""
        ends, whole = self._table
        k = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(ends) - 2)
        found: Array = (whole[k] + self._integral(ends[k], np.asarray(s, dtype=float))) / whole[-1]
        return found

    def places(self, x: Array) -> Array:
        """Return S at shares x of the elements."""
        ends, whole = self._table
        share = whole / whole[-1]
        k = np.clip(np.searchsorted(share, x, side="right") - 1, 0, len(ends) - 2)
        a, b = ends[k], ends[k + 1]
        s: Array = a + (b - a) * (x - share[k]) / (share[k + 1] - share[k])
        for _ in range(STEPS):
            s = np.clip(s - (self.shares(s) - x) * whole[-1] * values(self.profile, s), a, b)
        return s


@dataclass(frozen=True)
class Nodes:
    """Nodes that are given: between two of them elements are equally long."""

    given: tuple[float, ...]

    @property
    def nodes(self) -> tuple[float, ...]:
        """The places S between the ends that must be nodes."""
        return self.given[1:-1]

    def places(self, x: Array) -> Array:
        """Return S at shares x of the elements."""
        return np.interp(x, np.linspace(0.0, 1.0, len(self.given)), self.given)

    def shares(self, s: Array) -> Array:
        """Return the shares of the elements that lie before places S."""
        return np.interp(s, self.given, np.linspace(0.0, 1.0, len(self.given)))


Grading = Ratio | Lengths | Nodes


@lru_cache(maxsize=256)
def _of(nodes: object, grading: float | Profile | None) -> Grading | None:
    if isinstance(nodes, tuple):
        return Nodes(nodes)
    if grading is None:
        return None
    return Ratio(grading) if isinstance(grading, float) else Lengths(grading)


def grading_of(spec: Element) -> Grading | None:
    """Return how the lengths of a body's elements differ, None where they are equal."""
    return _of(spec.nodes, spec.grading)


def too_short(spec: Element, lengths: list[float], least: float) -> tuple[tuple[str, str], str, str] | None:
    """Return the key, why, and what is expected where a case asks for elements too unequal to compute with."""
    if isinstance(spec.nodes, tuple):
        key, shortest, beside = "nodes", float(np.diff(spec.nodes).min()), "the body"
    elif spec.grading is not None:
        key, shortest, beside = "grading", min(lengths) / max(lengths), "the longest one"
    else:
        return None
    return (("element", key), f"the shortest element is {shortest:.2g} times as long as {beside}",
            f"at least {least:g} times") if shortest < least else None


def runs(lengths: Array) -> list[tuple[float, int]]:
    """Return the length and the number of neighbours of equal length, in order."""
    ends = [0, *(np.flatnonzero(np.abs(np.diff(lengths)) > SAME * lengths[1:]) + 1).tolist(), len(lengths)]
    return [(float(lengths[a:b].sum()), b - a) for a, b in pairwise(ends)]
