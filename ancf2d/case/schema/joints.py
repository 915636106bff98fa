"""Joints between bodies, springs and point masses."""

from __future__ import annotations

from collections.abc import Iterator

from ..binder import Issue
from ..declare import key, record
from ..kinds import ListOf, Name, Number, Vector
from .points import POINT, SPRING_END, GroundPoint, Point

NAME = Name()
BETWEEN = ListOf(POINT, "points BODY@S", 2)
ENDS = ListOf(SPRING_END, "ends, each BODY@S or [x, y]", 2, 2)


def _same_twice(points: tuple[object, ...]) -> Iterator[Issue]:
    for i, point in enumerate(points):
        if point in points[:i]:
            yield Issue(("between", i), "{}.between: the same point is named twice")


@record
class PinJoint:
    """Keeps points together; the bodies turn freely."""

    tag = "pin"
    between: tuple[Point, ...] = key(BETWEEN, "Two or more points", example=["crank@1", "rod@0"])
    name: str | None = key(NAME, "Name", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield points that are named twice."""
        return _same_twice(self.between)


@record
class WeldJoint:
    """Keeps points together and the angle between the bodies; two alike that go on smoothly become one body."""

    tag = "weld"
    between: tuple[Point, ...] = key(BETWEEN, "Two or more points", example=["column@1", "beam@0"])
    name: str | None = key(NAME, "Name", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield points that are named twice."""
        return _same_twice(self.between)


@record
class SliderJoint:
    """Keeps a point on a straight line of the ground."""

    tag = "slider"
    at: Point = key(POINT, "Point that slides", example="rod@1")
    through: tuple[float, float] = key(Vector(Number("m")), "A point of the line", example=[0, 0])
    along: tuple[float, float] = key(Vector(Number(), nonzero=True),
                                     "Direction of the line, of any length", example=[1, 0])
    name: str | None = key(NAME, "Name", default=None)


@record
class PrismaticJoint:
    """Keeps a point on the axis of a deforming body, along which it slides."""

    tag = "prismatic"
    point: Point = key(POINT, "Point that slides", example="slider@0")
    on: str = key(Name("the name of a body"), "Body along which it slides", refers="bodies",
                  example="beam")
    name: str | None = key(NAME, "Name", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield a problem where a body would slide along itself."""
        if self.point.body == self.on:
            yield Issue(("on",), f"{{}}: '{self.on}' cannot slide along itself")


Joint = PinJoint | WeldJoint | SliderJoint | PrismaticJoint


def spring_issues(ends: tuple[object, ...]) -> Iterator[Issue]:
    """Yield ends that cannot be those of a spring."""
    yield from _same_twice(ends)
    if all(isinstance(end, GroundPoint) for end in ends):
        yield Issue(("between",), "{}.between: both ends are on the ground",
                    "at least one point BODY@S")


def _without_effect(stiffness: float, damping: float) -> Iterator[Issue]:
    if stiffness == 0 and damping == 0:
        yield Issue((), "{}: neither stiffness nor damping is given", "at least one of them > 0")


@record
class TranslationalSpring:
    """A spring and damper along the line between two points."""

    tag = "translational"
    between: tuple[Point | GroundPoint, ...] = key(ENDS, "The two ends",
                                                   example=["a@1", [0, 1]])
    stiffness: float = key(Number("N/m", ge=0), "Stiffness", default=0.0)
    damping: float = key(Number("N s/m", ge=0), "Damping", default=0.0)
    length: float | None = key(Number("m", ge=0), "Length at which the spring is unstressed (default: the distance "
                               "in the reference)", default=None)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def damped(self) -> bool:
        """Whether rates cause forces."""
        return self.damping > 0.0

    def check(self) -> Iterator[Issue]:
        """Yield ends that cannot be, or a spring without any effect."""
        yield from spring_issues(self.between)
        yield from _without_effect(self.stiffness, self.damping)


@record
class RotationalSpring:
    """A spring and damper on the angle between two sections."""

    tag = "rotational"
    between: tuple[Point | GroundPoint, ...] = key(ENDS, "The two ends; [x, y] is the ground",
                                                   example=["a@1", "b@0"])
    stiffness: float = key(Number("N m/rad", ge=0), "Stiffness", default=0.0)
    damping: float = key(Number("N m s/rad", ge=0), "Damping", default=0.0)
    angle: float = key(Number("rad"), "Relative rotation (second minus first) at which the moment is zero",
                       default=0.0)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def damped(self) -> bool:
        """Whether rates cause forces."""
        return self.damping > 0.0

    def check(self) -> Iterator[Issue]:
        """Yield ends that cannot be, or a spring without any effect."""
        yield from spring_issues(self.between)
        yield from _without_effect(self.stiffness, self.damping)


Spring = TranslationalSpring | RotationalSpring


@record
class Mass:
    """A point mass, with moment of inertia where it has one."""

    at: Point = key(POINT, "Point at which the mass is attached", example="rod@1")
    mass: float = key(Number("kg", ge=0), "Mass", example=1)
    inertia: float = key(Number("kg m^2", ge=0), "Moment of inertia about the point", default=0.0)
    name: str | None = key(NAME, "Name", default=None)
