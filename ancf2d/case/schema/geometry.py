"""Reference axes of bodies."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from ..binder import Issue
from ..declare import key, record
from ..kinds import Flag, ListOf, Number, Vector
from ..records import ByKeys
from .amplitudes import ExpressionText

Vec2 = tuple[float, float]
PLACE = Vector(Number("m"))
CLOSED_DOC = "Whether the axis returns to its start, without a kink there"


@record
class Line:
    """A straight reference axis."""

    tag = "line"
    least = 1
    start: Vec2 = key(PLACE, "Point at S = 0", example=[0, 0])
    end: Vec2 = key(PLACE, "Point at S = 1", example=[2, 0])

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the line has no length."""
        if self.start == self.end:
            yield Issue(("end",), "{}: the line has no length: start and end are the same point")


@record
class Arc:
    """A circular reference axis, stress-free; the section's y axis points to the left of travel."""

    tag = "arc"
    least = 1
    center: Vec2 = key(PLACE, "Centre of the circle", example=[0, 0])
    radius: float = key(Number("m", gt=0), "Radius", example=1)
    from_: float = key(Number("rad"), "Angle from the x axis to the point S = 0", example=0)
    to: float = key(Number("rad"), "Angle from the x axis to the point S = 1; larger than 'from' for a "
                    "counter-clockwise arc", example=1.5708)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the sweep is zero or more than a full turn."""
        sweep = self.to - self.from_
        if sweep == 0:
            yield Issue(("to",), "{}: the arc has no length: from and to are the same angle")
        elif abs(sweep) > 2 * math.pi * (1 + 1e-9):
            yield Issue(("to",), f"{{}}: the arc turns by {sweep:.6g} rad, more than a full turn",
                        "angles in rad, at most 2 pi = 6.2831853 apart")


@record
class Polyline:
    """A reference axis of straight pieces that are welded at the corners, where each piece has its own node."""

    tag = "polyline"
    points: tuple[Vec2, ...] = key(ListOf(PLACE, "points [x, y]", 2), "Corners in order",
                                   example=[[0, 0], [0, 120], [120, 120]])

    def check(self) -> Iterator[Issue]:
        """Yield an issue for each piece without length."""
        for i, (a, b) in enumerate(pairwise(self.points)):
            if a == b:
                yield Issue(("points", i + 1), f"{{}}: points {i} and {i + 1} are the same; "
                            "the piece between them has no length")

    @property
    def least(self) -> int:
        """The minimum number of elements: one for each piece."""
        return len(self.points) - 1


@record
class Spline:
    """A smooth reference axis through points: a cubic spline over the chord length, with continuous curvature."""

    tag = "spline"
    least = 1
    points: tuple[Vec2, ...] = key(ListOf(PLACE, "points [x, y]", 2), "Points in order; do not repeat the first "
                                   "one if the curve is closed", example=[[0, 0], [1, 0.4], [2, 0]])
    closed: bool = key(Flag(), CLOSED_DOC, default=False)

    def check(self) -> Iterator[Issue]:
        """Yield an issue for each point equal to the one before, and for too few points of a closed curve."""
        ends = [*self.points, self.points[0]] if self.closed else self.points
        for i, (a, b) in enumerate(pairwise(ends)):
            if a == b:
                last = i + 1 == len(self.points)
                yield Issue(("points", i if last else i + 1), "{}: the last point repeats the first one; leave "
                            "it out, because the curve is closed" if last else
                            f"{{}}: points {i} and {i + 1} are the same")
        if self.closed and len(self.points) < 3:
            yield Issue(("points",), f"{{}}: a closed spline needs at least 3 points, got {len(self.points)}")


@record
class CurveGeometry:
    """A smooth reference axis: x and y as expressions in a parameter s from 0 to 1, which need not be arc length."""

    tag = "curve"
    least = 1
    x: str = key(ExpressionText("s"), "x of the point at s", example="2*cos(pi*s/2)")
    y: str = key(ExpressionText("s"), "y of the point at s", example="sin(pi*s/2)")
    closed: bool = key(Flag(), CLOSED_DOC, default=False)


@record
class LinePiece:
    """A straight piece of a path."""

    line: float = key(Number("m", gt=0), "Length", example=0.2)


@record
class ArcPiece:
    """A circular piece of a path."""

    arc: float = key(Number("m", gt=0), "Radius", example=0.05)
    angle: float = key(Number("rad"), "Angle through which the path turns, positive counter-clockwise",
                       example=3.14159265)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the angle is zero or more than a full turn."""
        if self.angle == 0:
            yield Issue(("angle",), "{}: the arc has no length: its angle is 0")
        elif abs(self.angle) > 2 * math.pi * (1 + 1e-9):
            yield Issue(("angle",), f"{{}}: the arc turns by {self.angle:.6g} rad, more than a full turn",
                        "an angle in rad, at most 2 pi = 6.2831853")


@record(kw_only=True)
class PathGeometry:
    """A reference axis of lines and arcs, each tangent to the one before."""

    tag = "path"
    start: Vec2 = key(PLACE, "Point at S = 0", example=[0, 0])
    heading: float = key(Number("rad"), "Direction at S = 0, as an angle from the x axis", default=0.0)
    pieces: tuple[LinePiece | ArcPiece, ...] = key(
        ListOf(ByKeys((LinePiece, ("line",)), (ArcPiece, ("arc", "angle"))), "pieces", 1), "Lines and arcs in order",
        example=[{"line": 0.2}, {"arc": 0.05, "angle": 1.5708}])
    closed: bool = key(Flag(), CLOSED_DOC, default=False)

    @property
    def least(self) -> int:
        """The minimum number of elements: one for each piece."""
        return len(self.pieces)


Geometry = Line | Arc | Polyline | Spline | CurveGeometry | PathGeometry
