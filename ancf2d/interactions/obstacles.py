"""Obstacles: discs, half planes and polylines that are fixed, move by amplitudes or move with rigid bodies."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import Flag, ListOf, Name, Number, Vector
from ..case.records import ByShape, OneOf, Record
from ..case.schema.amplitudes import Amplitude
from ..case.schema.case import register
from ..elements import contact_geometry as geometry
from ..elements.shape import Array
from ..model.mesh import BodyMesh
from ..model.point_patch import Field, constant_field, position_fields, turn_fields
from ..model.points import point_ref

PLACE = Vector(Number("m"))
MOTION = ByShape(number=Number(""), map=OneOf(Amplitude))


@record
class Motion:
    """A motion of an obstacle from its given position: displacements, and a rotation about its centre."""

    x: float | Amplitude = key(MOTION, "Displacement along x [m]", default=0.0)
    y: float | Amplitude = key(MOTION, "Displacement along y [m]", default=0.0)
    angle: float | Amplitude = key(MOTION, "Rotation, counter-clockwise [rad]", default=0.0)
    about: tuple[float, float] | None = key(
        PLACE, "Centre of the rotation, which moves with the obstacle (default: that of the circle, the point of the "
        "half plane, the mean of the corners)", default=None, example=[0, 0])


MOTION_DOC = "Motion of the obstacle (default: none)"
ON_DOC = ("Rigid body that the obstacle is fixed to; the obstacle is given in its reference position (default: the "
          "ground)")


def _check_motion(self: Any) -> Iterator[Issue]:
    if self.on is not None and self.motion is not None:
        yield Issue(("motion",), "{}: an obstacle on a body moves with the body", "on or motion")


@record
class Circle:
    """A disc or, with ``inside``, everything outside a circle."""

    tag = "circle"
    # whether the surface has no corners
    smooth = True
    center: tuple[float, float] = key(PLACE, "Centre", example=[0, -0.5])
    radius: float = key(Number("m", gt=0), "Radius", example=0.5)
    inside: bool = key(Flag(), "Whether bodies are inside the circle, as in a pipe", default=False)
    on: str | None = key(Name("the name of a body"), ON_DOC, default=None, refers="bodies")
    motion: Motion | None = key(Record(Motion), MOTION_DOC, default=None)
    check = _check_motion

    def region(self, name: str) -> str:
        """Return the region of the bodies, in words."""
        return f"inside {name}" if self.inside else f"outside {name}"

    @property
    def centre(self) -> tuple[float, float]:
        """The centre of its rotation."""
        return self.center

    def shape(self, setback: float = 0.0) -> list[float]:
        """Return the shape and its numbers for the contact law, moved back by ``setback`` [m] from the bodies."""
        return [geometry.CIRCLE, *self.center, (-self.radius if self.inside else self.radius) - setback]


@record
class HalfPlane:
    """Everything behind a straight line."""

    tag = "half_plane"
    smooth = True
    through: tuple[float, float] = key(PLACE, "A point of its surface", example=[0, 0])
    normal: tuple[float, float] = key(Vector(Number(""), nonzero=True), "Direction out of the solid, towards the "
                                      "bodies",
                                      example=[0, 1])
    on: str | None = key(Name("the name of a body"), ON_DOC, default=None, refers="bodies")
    motion: Motion | None = key(Record(Motion), MOTION_DOC, default=None)
    check = _check_motion

    def region(self, name: str) -> str:
        """Return the region of the bodies, in words."""
        return f"on the side of {name} that its normal points to"

    @property
    def centre(self) -> tuple[float, float]:
        """The centre of its rotation."""
        return self.through

    def shape(self, setback: float = 0.0) -> list[float]:
        """Return the shape and its numbers for the contact law, moved back by ``setback`` [m] from the bodies."""
        size = math.hypot(*self.normal)
        nx, ny = self.normal[0] / size, self.normal[1] / size
        return [geometry.HALF_PLANE, self.through[0] - setback * nx, self.through[1] - setback * ny, nx, ny]


@record
class PolylineObstacle:
    """Straight walls from corner to corner: closed around a solid, or open, with the solid to the right."""

    tag = "polyline"
    smooth = False
    points: tuple[tuple[float, float], ...] = key(
        ListOf(PLACE, "points", 2), "Corners in order; bodies are to the left of an open line (above it, if it runs "
        "from left to right), and outside a closed one", example=[[0, 0], [1, 0.2]])
    closed: bool = key(Flag(), "Whether the last corner is joined to the first", default=False)
    on: str | None = key(Name("the name of a body"), ON_DOC, default=None, refers="bodies")
    motion: Motion | None = key(Record(Motion), MOTION_DOC, default=None)

    def check(self) -> Iterator[Issue]:
        """Yield issues for corners that form no walls."""
        yield from _check_motion(self)
        if self.closed and len(self.points) < 3:
            yield Issue(("points",), "{}.points: a closed polyline has at least 3 corners")
        following = [*self.points[1:], *self.points[:1]] if self.closed else self.points[1:]
        for i, (a, b) in enumerate(zip(self.points, following, strict=False)):
            if a == b:
                yield Issue(("points", i), f"{{}}.points: corner {i} and the next one are the same point")
        if self.closed and len(self.points) >= 3 and _area(self.points) == 0.0:
            yield Issue(("points",), "{}.points: the corners enclose no area")

    def region(self, name: str) -> str:
        """Return the region of the bodies, in words."""
        return f"outside {name}" if self.closed else f"to the left of {name}, from its first point to its last"

    @property
    def centre(self) -> tuple[float, float]:
        """The centre of its rotation."""
        x, y = np.mean(self.points, axis=0)
        return float(x), float(y)

    def corners(self) -> Array:
        """Return the corners (n, 2), ordered so that the solid is to the right of the line."""
        points = np.array(self.points)
        return points[::-1] if self.closed and _area(self.points) > 0.0 else points

    def shape(self) -> list[float]:
        """Return the shape and its numbers for the contact law: the corners with the arc length up to each."""
        points = self.corners()
        steps = np.hypot(*np.diff([*points, points[0]], axis=0).T)
        lengths = np.concatenate([[0.0], np.cumsum(steps)])
        table = np.column_stack([points, lengths[:-1]])
        return [geometry.POLYLINE, len(points), lengths[-1] if self.closed else -1.0, *table.ravel()]


def _area(points: tuple[tuple[float, float], ...]) -> float:
    x, y = np.array(points).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


for _kind in (Circle, HalfPlane, PolylineObstacle):
    register("obstacles", _kind, ())


@dataclass(frozen=True)
class Frame:
    """The pose of an obstacle: its fields, the signals that they follow, and its constants in the contact law."""

    kind: int
    fields: tuple[Field, ...] = ()
    signals: tuple[Any, ...] = ()
    origin: tuple[float, float] = (0.0, 0.0)
    length: float = 1.0

    def pose(self, d: Array, t: float) -> tuple[float, float, float]:
        """Return the displacement of the point ``origin`` and the rotation of the obstacle at d (n_q,) and t."""
        if self.kind == geometry.STILL:
            return 0.0, 0.0, 0.0
        if self.kind == geometry.BY_ANGLE:
            x, y, angle = (signal(t) for signal in self.signals)
            return x, y, angle
        x, y, c, s = (f.p0 + float(f.weights @ d[f.coords]) for f in self.fields)
        return x - self.origin[0], y - self.origin[1], math.atan2(s, c)


def frame_of(obstacle: Any, meshes: dict[str, BodyMesh], timing: Any) -> Frame:
    """Return the frame of an obstacle: fixed, moved by its amplitudes, or moved by a rigid body."""
    if obstacle.on is not None:
        point = point_ref(meshes[obstacle.on], 0.0)
        _, direction = turn_fields(point)
        fields = (*position_fields(point), *direction)
        return Frame(geometry.BY_DIRECTION, fields, (), (fields[0].p0, fields[1].p0), direction[0].p0)
    if obstacle.motion is None:
        return Frame(geometry.STILL)
    m = obstacle.motion
    origin = obstacle.centre if m.about is None else m.about
    fields = tuple(map(constant_field, (*origin, 0.0)))
    return Frame(geometry.BY_ANGLE, fields, tuple(timing.motion(v, 0.0) for v in (m.x, m.y, m.angle)), origin)
