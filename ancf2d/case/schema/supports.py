"""Boundary conditions."""

from __future__ import annotations

from collections.abc import Iterator

from ..binder import Issue
from ..declare import key, record
from ..kinds import Choice, Known, ListOf, Name, Number, Vector
from ..records import ByShape, OneOf
from .amplitudes import Amplitude
from .points import POINT, Point

NAME = Name()
SPREAD = Choice("uniform", "parabolic")
SPREAD_DOC = ("Hold the mean of the section with this weight instead of the axis (makes a difference from q = 2 on)")


def motion(unit: str) -> ByShape:
    """Return the kind of a prescribed motion: a number, or an amplitude."""
    return ByShape(number=Number(unit), map=OneOf(Amplitude))


@record
class Pin:
    """Holds the position of a point."""

    tag = "pin"
    at: Point = key(POINT, "Point that is held", example="beam@0")
    spread: str | None = key(SPREAD, SPREAD_DOC, default=None)
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)


@record
class Roller:
    """Holds one direction of a point's position."""

    tag = "roller"
    at: Point = key(POINT, "Point that is held", example="beam@1")
    fixed: str | None = key(Choice("x", "y"), "Direction that is held", default=None, example="y")
    normal: tuple[float, float] | None = key(
        Vector(Number(), "nx, ny", nonzero=True),
        "Direction that is held if it is neither x nor y; of any length", default=None)
    spread: str | None = key(SPREAD, SPREAD_DOC, default=None)
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield a problem unless exactly one of fixed and normal is given."""
        if (self.fixed is None) == (self.normal is None):
            given = "fixed and normal are both given" if self.fixed else (
                "the direction to hold is missing")
            yield Issue(("normal",) if self.fixed else (), f"{{}}: {given}",
                        "one of fixed: x, fixed: y, or normal: [nx, ny]")


@record
class Clamp:
    """Holds position and rotation of a section."""

    tag = "clamp"
    at: Point = key(POINT, "Point that is held", example="beam@0")
    hold: str | None = key(
        Choice("all", "section", "breathe"),
        "all: every nodal coordinate; section: position and section rotation; breathe: mean position and direction of "
        "the section, which stays straight but may stretch (default: position, r_y and warping for types "
        "with such coordinates, leaving strains free; section for other types; all with preset paper)",
        default=None)
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)


@record
class Fix:
    """Holds single nodal coordinates of a node."""

    tag = "fix"
    at: Point = key(POINT, "Point that is held; must be a node", example="beam@0")
    coordinates: tuple[str, ...] = key(
        ListOf(Known("nodal_coordinates"), "nodal coordinates", 1),
        "Nodal coordinates that are held", example=["x", "y", "ry_x"])
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield coordinates that are named twice."""
        for i, name in enumerate(self.coordinates):
            if name in self.coordinates[:i]:
                yield Issue(("coordinates", i), f"{{}}.coordinates: {name} is named twice")


@record
class Prescribed:
    """Moves a point, or turns its section, as told."""

    tag = "prescribed"
    at: Point = key(POINT, "Point that is moved", example="beam@1")
    x: float | Amplitude | None = key(motion("m"), "Position x", default=None)
    y: float | Amplitude | None = key(motion("m"), "Position y", default=None)
    ux: float | Amplitude | None = key(motion("m"), "Displacement in x", default=None)
    uy: float | Amplitude | None = key(motion("m"), "Displacement in y", default=None)
    angle: float | Amplitude | None = key(motion("rad"), "Rotation of the section from the "
                                          "reference", default=None)
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield a problem where nothing is prescribed, or the same thing twice."""
        given = [k for k in ("x", "y", "ux", "uy", "angle") if getattr(self, k) is not None]
        if not given:
            yield Issue((), "{}: nothing is prescribed", "one or more of x, y, ux, uy, angle")
        for a, b in (("x", "ux"), ("y", "uy")):
            if a in given and b in given:
                yield Issue((b,), f"{{}}: {a} (position) and {b} (displacement) prescribe "
                            "the same motion", f"one of {a} and {b}")


Support = Pin | Roller | Clamp | Fix | Prescribed
