"""Quantities that vary along a body: their kinks and jumps, and section constants as functions of place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case import Body, Profile, ProfileExpression, ProfileTable
from ..case.series import series
from ..elements.section import CONSTANTS, Section
from ..elements.shape import Array, gauss
from .breakpoints import breakpoints
from .timing import Signal

# distance from a jump, relative to the body's length, at which one of its sides is evaluated
SIDE = 1e-12
# tolerance for touching stretches, relative to the body's length
SAME = 1e-9
# relative difference below which slopes of a table form a straight line
STRAIGHT = 1e-9
# places along an element at which its section is compared: if equal at all, it does not vary
PLACES = np.linspace(0.0, 1.0, 9)
# number of stored evaluations (each for one set of stations and a block of elements); elements in a block
KNOWN, TOGETHER = 32, 512
# number of places at which a varying section is checked
CHECKED = 101
# profiles whose jumps make the strains jump
STIFF = ("height", "width", "A", "I", "EA", "kGA", "EI", "E")


@lru_cache(maxsize=256)
def breaks(profile: Profile) -> tuple[tuple[float, int], ...]:
    """Return (s, order) of the jumps (order 0) and kinks (order 1) of a profile between 0 and 1, in order."""
    if isinstance(profile, ProfileExpression):
        return tuple((b.t, b.order) for b in breakpoints(Signal(profile), 0.0, 1.0) if b.order < 2 and b.t < 1.0)
    return tuple(_corners(profile))


def _corners(table: ProfileTable) -> Iterator[tuple[float, int]]:
    s, v, last = table.s, table.value_, len(table.s) - 1
    steps = zip(pairwise(s), pairwise(v), strict=True)
    # slope of the stretch before each place, and after the last
    slopes = [0.0, *((d - c) / (b - a) if b > a else 0.0 for (a, b), (c, d) in steps), 0.0]
    for i, place in enumerate(s):
        if not 0.0 < place < 1.0:
            continue
        if i and s[i - 1] == place:
            yield place, 0 if v[i - 1] != v[i] else 1
            continue
        jumps, inner = i < last and s[i + 1] == place, table.smooth and 0 < i < last
        if not jumps and not inner and abs(slopes[i + 1] - slopes[i]) > STRAIGHT * max(map(abs, slopes[i:i + 2])):
            yield place, 1


def values(profile: float | Profile, s: Array) -> Array:
    """Return the values (n,) of a profile, or of a number, at places s (n,)."""
    if isinstance(profile, ProfileTable):
        return _interpolated(profile, s)
    if not isinstance(profile, ProfileExpression):
        return np.full(len(s), float(profile))
    found: Array = profile.scale * series(profile.tree, s, 0)[0]
    if not np.isfinite(found).all():
        # this raises the reason, or finds values that are infinite only in a branch that is not taken
        found = np.array([profile.value(x) for x in s.tolist()])
    return found


def _interpolated(table: ProfileTable, s: Array) -> Array:
    """Return the values (n,) of a table at places s (n,); same as ``ProfileTable.value``."""
    places, v = np.array(table.s), np.array(table.value_)
    i = np.searchsorted(places, s, side="right") - 1
    inner = (i >= 0) & (i < len(places) - 1)
    out: Array = v[np.maximum(i, 0)]
    i = i[inner]
    h, d = places[i + 1] - places[i], v[i + 1] - v[i]
    x = (s[inner] - places[i]) / h
    if table.smooth:
        m0, m1 = h * np.array(table.slopes).T[:, i]
        out[inner] = v[i] + x * (m0 + x * (3 * d - 2 * m0 - m1 + x * (m0 + m1 - 2 * d)))
    else:
        out[inner] = v[i] + d * x
    return out


def mean(profile: Profile) -> float:
    """Return the mean of a profile over the body."""
    ends, (x, w) = [0.0, *(s for s, _ in breaks(profile)), 1.0], gauss(8)
    return sum((b - a) * float(w @ values(profile, a + (b - a) * x)) for a, b in pairwise(ends))


def profiles_of(record: Any) -> dict[str, Profile]:
    """Return the profiles among the values of a section or material, by their keys."""
    found = {} if record is None else {f.name: getattr(record, f.name) for f in fields(record)}
    return {name: v for name, v in found.items() if isinstance(v, ProfileExpression | ProfileTable)}


def with_numbers(body: Body, number: Callable[[Profile], Any]) -> Body:
    """Return a body with each profile of its section and material replaced by a number or an array."""
    parts: dict[str, Any] = {}
    for name in ("section", "material"):
        part = getattr(body, name)
        found = profiles_of(part)
        if found:
            parts[name] = replace(part, **{key: number(p) for key, p in found.items()})
    return replace(body, **parts) if parts else body


def profile_breaks(body: Body) -> list[tuple[float, bool]]:
    """Return the places S where a body's section or material kinks or jumps, and whether strains can jump there."""
    every = profiles_of(body.section) | profiles_of(body.material)
    found: dict[float, bool] = {}
    for name, profile in every.items():
        for s, order in breaks(profile):
            found[s] = found.get(s, False) or (order == 0 and name in STIFF)
    return sorted(found.items())


def load_breaks(line: Any) -> list[float]:
    """Return the places S where a load along a body (a ``Line``) starts, ends, kinks or jumps."""
    inner = {s for v in line.density if not isinstance(v, float) for s, _ in breaks(v) if line.start < s < line.end}
    return sorted({line.start, line.end} | inner)


@dataclass(frozen=True)
class VaryingSection:
    """The section of a body that varies along it; ``resolve`` returns the constants of a body without profiles."""

    body: Body
    resolve: Callable[[Body], Section]

    def at(self, s: Array, first: float | Array = 0.0, last: float | Array = 1.0) -> Section:
        """Return the constants at places s (n,) of stretches from ``first`` to ``last``; arrays if they vary.

        Where the section jumps at an end of a stretch, the values are those inside.
        """
        inside = np.clip(s, first + SIDE, np.maximum(last - SIDE, first + SIDE))
        return self.resolve(with_numbers(self.body, lambda p: values(p, inside)))

    @cached_property
    def mean(self) -> Section:
        """The section of the mean values, used to judge sizes."""
        return self.resolve(with_numbers(self.body, mean))

    @cached_property
    def checked(self) -> Section:
        """The constants at ``CHECKED`` places all along the body."""
        return self.at(np.linspace(0.0, 1.0, CHECKED))

    @property
    def lowest(self) -> float:
        """The smallest height at these places."""
        return float(np.min(self.checked.height))


def alike_along(one: Body, other: Body, begin: Array, length: Array) -> NDArray[np.bool_]:
    """Return for each stretch (n,) of two bodies, given by places S, whether section and material are equal on it.

    Tables with the same places are compared piece by piece; if other values differ, no stretch counts as equal.
    """
    same = np.ones(len(begin), dtype=bool)
    for name in ("section", "material"):
        a, b = getattr(one, name), getattr(other, name)
        if type(a) is not type(b):
            return np.zeros_like(same)
        for key in fields(a) if a is not None and a != b else ():
            x, y = getattr(a, key.name), getattr(b, key.name)
            if x == y:
                continue
            if not (isinstance(x, ProfileTable) and isinstance(y, ProfileTable) and (x.s, x.smooth) == (y.s, y.smooth)):
                return np.zeros_like(same)
            for low, high in _unlike(x, y):
                same &= (begin + length <= low + SAME) | (begin >= high - SAME)
    return same


def _unlike(one: ProfileTable, other: ProfileTable) -> Iterator[tuple[float, float]]:
    """Yield the intervals between places on which two tables with the same places differ."""
    s = (-np.inf, *one.s, np.inf)
    ends = [(t.value_[0], *t.value_, t.value_[-1]) for t in (one, other)]
    slopes = [((), *t.slopes[:-1], ()) if t.smooth else ((),) * (len(t.s) + 1) for t in (one, other)]
    for k, place in enumerate(pairwise(s)):
        if any(a[k] != b[k] for a, b in ((ends[0], ends[1]), (ends[0][1:], ends[1][1:]), (slopes[0], slopes[1]))):
            yield place


class SectionsAlong:
    """The sections of equally long elements of a body whose section varies.

    ``starts`` (n,) are the places S where they start, ``l`` their length and ``cuts`` the kinks and jumps of the body,
    all as fractions of the body's length.
    """

    def __init__(self, varying: VaryingSection, starts: Array, l: float, cuts: Sequence[float]) -> None:
        self.varying, self.starts, self.l, self.cuts = varying, starts, l, cuts
        self.known: dict[Any, dict[str, Any]] = {}
        # number of the last evaluated element, and its sections by their stations
        self.last, self.now = -1, dict[bytes, Section]()

    def _together(self, block: int, xi: Array) -> dict[str, Any]:
        """Return the constants at stations of a block of elements; arrays (elements, stations) if they vary."""
        place = (block, xi.tobytes())
        if place not in self.known:
            # elements are evaluated one after another, always at the same few stations
            if len(self.known) >= KNOWN:
                self.known.clear()
            a = self.starts[block * TOGETHER:(block + 1) * TOGETHER, None]
            first, last = (np.repeat(v, len(xi), axis=1).ravel() for v in (a, a + self.l))
            found = self.varying.at((a + self.l * xi).ravel(), first, last)
            self.known[place] = {name: v.reshape(len(a), -1) if np.ndim(v := getattr(found, name)) else v
                                 for name in CONSTANTS}
        return self.known[place]

    def at(self, ie: int, xi: Array) -> Section:
        """Return the section constants at stations xi (n,) of an element."""
        stations = np.asarray(xi, dtype=float)
        place = stations.tobytes()
        if ie != self.last:
            self.last, self.now = ie, {}
        if place not in self.now:
            k, some = ie % TOGETHER, self._together(ie // TOGETHER, stations)
            numbers = {name: v[k] if isinstance(v, np.ndarray) else v for name, v in some.items()}
            self.now[place] = replace(self.varying.mean, **numbers)
        return self.now[place]

    def of(self, ie: int) -> tuple[Section, Callable[[Array], Section] | None, tuple[float, ...]]:
        """Return an element's section if constant; else the mean section, a function of xi and the element's cuts."""
        a, k = float(self.starts[ie]), ie % TOGETHER
        cuts = tuple(x for s in self.cuts if 1e-9 < (x := (s - a) / self.l) < 1.0 - 1e-9)
        at = self._together(ie // TOGETHER, PLACES)
        if cuts or not all(np.ndim(v) == 0 or np.all(v[k] == v[k, 0]) for v in at.values()):
            return self.varying.mean, partial(self.at, ie), cuts
        numbers: dict[str, Any] = {name: float(v[k, 0] if np.ndim(v) else v) for name, v in at.items()}
        return replace(self.varying.mean, **numbers), None, ()
