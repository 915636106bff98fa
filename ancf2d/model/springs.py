"""Springs and dampers between points."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..case import GroundPoint, RotationalSpring, TranslationalSpring
from .point_patch import Field, PointPatch, difference, position_fields, turns
from .points import PointRef

End = PointRef | GroundPoint


def _place(end: End) -> list[Field]:
    if isinstance(end, GroundPoint):
        return [Field(np.zeros(0, dtype=np.int64), np.zeros(0), v) for v in (end.x, end.y)]
    return position_fields(end)


class Spring(PointPatch):
    """A spring and damper; ``slack`` is the length or angle of the reference, where it would not pull."""

    def __init__(self, law: str, fields: list[Field], stiffness: float, damping: float, rest: float, slack: float,
                 *more: float) -> None:
        super().__init__(law, fields, [stiffness, damping, rest, *more])
        self.rest, self.slack = rest, slack

    def tighten(self, share: float) -> None:
        """Let it pull in the reference as by a share of the way from slack to its own free length or angle."""
        self.par[2] = self.rest if share == 1.0 else self.slack + share * (self.rest - self.slack)


def _translational(spring: TranslationalSpring, ends: list[End]) -> Spring:
    """Along the line between two points: U = k (L - L0)^2/2, and c dL/dt."""
    fields = [difference(a, b) for a, b in zip(*map(_place, ends), strict=True)]
    start = math.hypot(*(f.p0 for f in fields))
    rest = start if spring.length is None else spring.length
    return Spring("translational", fields, spring.stiffness, spring.damping, rest, start, start)


def _rotational(spring: RotationalSpring, ends: list[End]) -> Spring:
    """Between sections (or the ground): U = k (theta_b - theta_a - angle)^2/2, and c d(theta_b - theta_a)/dt."""
    kinds, fields = turns([end if isinstance(end, PointRef) else None for end in ends])
    return Spring("rotational", fields, spring.stiffness, spring.damping, spring.angle, 0.0, *kinds)


SPRINGS: dict[type, Callable[[Any, list[End]], Spring]] = {
    TranslationalSpring: _translational, RotationalSpring: _rotational,
}
