"""Places: points of bodies, points of the ground, probes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from ..binder import Binder, Issue, Path, dotted
from ..declare import key, record
from ..emit import number_text
from ..kinds import Book, JsonSchema, Kind, ListOf, Name, Number, Vector, good_name
from ..nodes import Node, Scalar, quoted, resolve
from ..records import ByShape, OneOf, Record
from .amplitudes import Amplitude


@record
class Point:
    """A point of a body's axis: the body's name and S in [0, 1] along its arc length."""

    body: str
    s: float

    def written(self) -> str:
        """Return the point as in a case: ``BODY@S``."""
        return f"{self.body}@{number_text(self.s)}"


@record
class GroundPoint:
    """A fixed point of the ground."""

    x: float
    y: float

    def written(self) -> tuple[float, float]:
        """Return the point as in a case: ``[x, y]``."""
        return (self.x, self.y)


@record
class MovingPoint:
    """A point that moves along a body; the load, mass or spring there acts while 0 <= s <= 1."""

    on: str = key(Name("the name of a body"), "Body along which it moves", refers="bodies", example="beam")
    s: Amplitude = key(OneOf(Amplitude), "Position S over time, from 0 to 1 along the arc length",
                       example={"type": "ramp", "t1": 2})


class PointText(Kind):
    """The kind of a text ``BODY@S``."""

    def words(self, binder: Binder) -> str:
        return "BODY@S with S in [0, 1]"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if not isinstance(node, Scalar) or node.shape != "text":
            return binder.wrong(node, path, self.words(binder))
        body, at, place = node.text.partition("@")
        if not at or not good_name(body):
            return binder.wrong(node, path, self.words(binder))
        s = resolve(place)
        if isinstance(s, bool) or not isinstance(s, int | float):
            return binder.fail(node.mark, path, f"{dotted(path)} must be {self.words(binder)}, "
                               f"got {quoted(node.text)}: {quoted(place)} is not a number")
        if not (math.isfinite(s) and 0 <= s <= 1):
            return binder.fail(node.mark, path,
                               f"{dotted(path)}: S must be in [0, 1], got {quoted(node.text)}")
        return Point(body, abs(float(s)))

    def schema(self, book: Book) -> JsonSchema:
        return {"type": "string", "pattern": r"^[^@./=\[\]]+@[-+0-9.eE]+$"}


POINT = PointText()
POSITION = Number("m")
# a point of a body, or one that moves along it
PLACE = ByShape(text=POINT, map=Record(MovingPoint))


@record
class Probe:
    """A place whose motion is recorded."""

    at: Point = key(POINT, "Point of the axis", example="beam@0.5")
    y: float = key(POSITION, "Distance from the axis, along the section's y axis", default=0.0)

    def written(self) -> Any:
        """Return the probe as in a case: just the point if it is on the axis."""
        return self.at if self.y == 0 else {"at": self.at, "y": self.y}


def named_points(thing: Any) -> list[Point]:
    """Return the points of bodies at which a support, joint, spring, mass or load acts."""
    found = list(getattr(thing, "points", None) or ())
    for value in (getattr(thing, f.name) for f in fields(thing)):
        found += [p for p in (value if isinstance(value, tuple) else (value,)) if isinstance(p, Point)]
    return found


def named_twice(points: tuple[object, ...]) -> Iterator[Issue]:
    """Yield an issue for each point that occurs twice in a key ``between``."""
    for i, point in enumerate(points):
        if point in points[:i]:
            yield Issue(("between", i), "{}.between: the same point is named twice")


PROBE = Record(Probe, short="at")
_GROUND = Vector(POSITION, "x, y", GroundPoint)
ENDS = ListOf(ByShape(text=POINT, list=_GROUND), "ends, each BODY@S or [x, y]", 2, 2)
# of springs, one of whose ends may move along a body
SPRING_ENDS = ListOf(ByShape(text=POINT, list=_GROUND, map=Record(MovingPoint)),
                     "ends, each BODY@S, [x, y] or {on: BODY, s: AMPLITUDE}", 2, 2)


def check_ends(points: tuple[object, ...]) -> Iterator[Issue]:
    """Yield an issue if two ENDS are the same point, both move, or both are on the ground."""
    yield from named_twice(points)
    if all(isinstance(end, MovingPoint) for end in points):
        yield Issue(("between",), "{}.between: both ends move along bodies", "at least one point BODY@S or [x, y]")
    if all(isinstance(end, GroundPoint) for end in points):
        yield Issue(("between",), "{}.between: both ends are on the ground", "at least one point BODY@S")
