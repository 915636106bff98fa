"""Loads; ``potential`` tells whether one has a potential, so that the tangent stays symmetric."""

from __future__ import annotations

from collections.abc import Iterator

from ..binder import Issue
from ..declare import key, record
from ..kinds import Choice, Flag, Name, Number, Vector
from ..records import OneOf
from .amplitudes import Amplitude
from .points import POINT, Point

NAME = Name()
AMPLITUDE = OneOf(Amplitude)
AMPLITUDE_DOC = "Factor as a function of load factor or time (default: ramp in static cases, otherwise constant)"
SPREAD = Choice("uniform", "parabolic")
SPREAD_DOC = "Spread the force over the section (default: on the axis)"


@record
class Force:
    """A force whose direction stays."""

    tag = "force"
    potential = True
    at: Point = key(POINT, "Where it acts", example="beam@1")
    value: tuple[float, float] = key(Vector(Number("N"), "fx, fy"), "Force", example=[0, -1000])
    spread: str | None = key(SPREAD, SPREAD_DOC, default=None)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)


@record
class FollowerForce:
    """A force that turns with the section it acts on."""

    tag = "follower_force"
    potential = False
    at: Point = key(POINT, "Where it acts", example="beam@1")
    value: tuple[float, float] = key(Vector(Number("N"), "tangential, normal"),
                                     "Force along the axes of the section", example=[0, -1000])
    spread: str | None = key(SPREAD, SPREAD_DOC, default=None)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)


@record
class Moment:
    """A moment, conjugate to the rotation of the section."""

    tag = "moment"
    potential = True
    at: Point = key(POINT, "Where it acts", example="beam@1")
    value: float = key(Number("N m"), "Moment, counter-clockwise", example=100)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)


@record
class Gravity:
    """Gravity on everything that has mass."""

    tag = "gravity"
    potential = True
    value: tuple[float, float] = key(Vector(Number("m/s^2"), "gx, gy"), "Acceleration",
                                     example=[0, -9.81])
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)


@record
class Distributed:
    """A force per unit reference length on a body's axis."""

    tag = "distributed"
    on: str = key(Name("the name of a body"), "Body it acts on", refers="bodies", example="beam")
    value: tuple[float, float] = key(
        Vector(Number("N/m"), "fx, fy"),
        "Force per length; [tangential, normal] with follower", example=[0, -500])
    from_: float = key(Number("", ge=0, le=1), "S where it begins", default=0.0)
    to: float = key(Number("", ge=0, le=1), "S where it ends", default=1.0)
    follower: bool = key(Flag(), "Turns with the axis", default=False)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def potential(self) -> bool:
        """Whether the load has a potential: one that turns with the axis has none."""
        return not self.follower

    def check(self) -> Iterator[Issue]:
        """Yield an extent that is empty or backward."""
        if not self.from_ < self.to:
            yield Issue(("to",), f"{{}}: from must be less than to, got from {self.from_:g} "
                        f"to {self.to:g}")


Load = Force | FollowerForce | Moment | Gravity | Distributed
