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


def _translational(spring: TranslationalSpring, ends: list[End]) -> PointPatch:
    """Along the line between two points: U = k (L - L0)^2/2, and c dL/dt."""
    fields = [difference(a, b) for a, b in zip(*map(_place, ends), strict=True)]
    start = math.hypot(*(f.p0 for f in fields))
    rest = start if spring.length is None else spring.length
    return PointPatch("translational", fields, [spring.stiffness, spring.damping, rest, start])


def _rotational(spring: RotationalSpring, ends: list[End]) -> PointPatch:
    """Between sections (or the ground): U = k (theta_b - theta_a - angle)^2/2, and c d(theta_b - theta_a)/dt."""
    kinds, fields = turns([end if isinstance(end, PointRef) else None for end in ends])
    return PointPatch("rotational", fields, [spring.stiffness, spring.damping, spring.angle, *kinds])


SPRINGS: dict[type, Callable[[Any, list[End]], PointPatch]] = {
    TranslationalSpring: _translational, RotationalSpring: _rotational,
}
