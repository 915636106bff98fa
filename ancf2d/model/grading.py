"""Meshes with unequal elements, defined by a map of the body's axis.

A body has the map S = phi(x) from 0..1 to 0..1, and n elements end at phi(k/n). A mesh of 2 n elements then contains
all nodes of the one of n, and refined meshes keep their proportions.
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

# number of cells in which a profile of lengths is integrated, points in each, and steps of Newton's method
CELLS, POINTS, STEPS = 256, 8, 4
# relative difference below which element lengths are equal
SAME = 1e-10


@dataclass(frozen=True)
class Ratio:
    """Element lengths in a geometric series; ``ratio`` is the length at the end over that at the start of the body.

    phi(x) = (ratio^x - 1)/(ratio - 1).
    """

    ratio: float
    nodes = ()

    def places(self, x: Array) -> Array:
        """Return the places S = phi(x)."""
        log = math.log(self.ratio)
        return x if log == 0.0 else np.expm1(x * log) / math.expm1(log)

    def shares(self, s: Array) -> Array:
        """Return x with S = phi(x), the share of the elements before a place S."""
        log = math.log(self.ratio)
        return s if log == 0.0 else np.log1p(s * math.expm1(log)) / log


@dataclass(frozen=True)
class Lengths:
    """Element lengths proportional to a profile h(s): dx/ds is proportional to 1/h."""

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
        """Return x with S = phi(x), the share of the elements before a place S."""
        ends, whole = self._table
        k = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(ends) - 2)
        found: Array = (whole[k] + self._integral(ends[k], np.asarray(s, dtype=float))) / whole[-1]
        return found

    def places(self, x: Array) -> Array:
        """Return the places S = phi(x)."""
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
    """Given nodes, with elements of equal length between two of them."""

    given: tuple[float, ...]

    @property
    def nodes(self) -> tuple[float, ...]:
        """The places S inside the body that must be nodes."""
        return self.given[1:-1]

    def places(self, x: Array) -> Array:
        """Return the places S = phi(x)."""
        return np.interp(x, np.linspace(0.0, 1.0, len(self.given)), self.given)

    def shares(self, s: Array) -> Array:
        """Return x with S = phi(x), the share of the elements before a place S."""
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
    """Return the grading of a body's elements, or None if they are equally long."""
    return _of(spec.nodes, spec.grading)


def too_short(spec: Element, lengths: list[float], least: float) -> tuple[tuple[str, str], str, str] | None:
    """Return key, message and expectation if the elements are too unequal for floating-point arithmetic, else None."""
    if isinstance(spec.nodes, tuple):
        key, shortest, beside = "nodes", float(np.diff(spec.nodes).min()), "the body"
    elif spec.grading is not None:
        key, shortest, beside = "grading", min(lengths) / max(lengths), "the longest one"
    else:
        return None
    return (("element", key), f"the shortest element is {shortest:.2g} times as long as {beside}",
            f"at least {least:g} times") if shortest < least else None


def runs(lengths: Array) -> list[tuple[float, int]]:
    """Return length and number of elements for each run of equally long neighbours, in order."""
    ends = [0, *(np.flatnonzero(np.abs(np.diff(lengths)) > SAME * lengths[1:]) + 1).tolist(), len(lengths)]
    return [(float(lengths[a:b].sum()), b - a) for a, b in pairwise(ends)]
