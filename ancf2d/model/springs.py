"""Springs and dampers between points."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..case import GroundPoint, RotationalSpring, TranslationalSpring
from ..elements.point_laws import DIRECTION, PointLaw
from ..elements.shape import Array
from ..elements.spring_laws import ROTATIONAL, TRANSLATIONAL
from .point_patch import NOTHING, Field, PointPatch, position_fields, table_of, turns
from .points import PointRef

End = PointRef | GroundPoint


def _place(end: End) -> list[Field]:
    if isinstance(end, GroundPoint):
        return [Field(np.zeros(0, dtype=np.int64), np.zeros(0), v) for v in (end.x, end.y)]
    return position_fields(end)


class Spring(PointPatch):
    """A spring and damper; ``slack`` is the length or angle of the reference, where it would not pull.

    ``par`` are the constants of its law behind ``rest``; ``damped`` tells whether rates make forces.
    """

    def __init__(self, law: PointLaw, fields: list[Field], rest: float, slack: float, par: Sequence[float],
                 damped: bool, sections: Sequence[PointRef | None] = ()) -> None:
        super().__init__(law, fields, [rest, *par], sections=sections)
        self.rest, self.slack, self.damped = rest, slack, damped
        self.angle = self.law.accept is not None

    def tighten(self, share: float) -> None:
        """Let it pull in the reference as by a share of the way from slack to its own free length or angle."""
        self.par[0] = self.rest if share == 1.0 else self.slack + share * (self.rest - self.slack)


def _distance(ends: list[End]) -> list[list[Field]]:
    """Return what each end has of x and y of the way from the first to the second."""
    return [[Field(f.coords, sign * f.weights, sign * f.p0) for f in _place(end)]
            for sign, end in zip((-1.0, 1.0), ends, strict=True)]


def _turning(ends: list[End]) -> list[list[Field]]:
    """Return what each end has of the fields that tell how the two sections turn."""
    own = [turns([end if isinstance(end, PointRef) else None])[1] for end in ends]
    return [[*own[0], *(NOTHING for _ in own[1])], [*(NOTHING for _ in own[0]), *own[1]]]


def _sum(parts: list[list[Field]]) -> list[Field]:
    return [Field(np.concatenate([a.coords, b.coords]), np.concatenate([a.weights, b.weights]), a.p0 + b.p0)
            for a, b in zip(*parts, strict=True)]


def along(law: PointLaw, ends: list[End], constants: Sequence[float], damped: bool,
          length: float | None = None) -> Spring:
    """Return a spring along the line between two points; ``length``: that at which its elongation is zero."""
    fields = _sum(_distance(ends))
    start = math.hypot(*(f.p0 for f in fields))
    return Spring(law, fields, start if length is None else length, start, [start, *constants], damped)


def about(law: PointLaw, ends: list[End], constants: Sequence[float], damped: bool,
          angle: float = 0.0) -> Spring:
    """Return a spring on the angle between sections (or the ground), zero at the relative rotation ``angle``."""
    sections = [end if isinstance(end, PointRef) else None for end in ends]
    kinds, _ = turns(sections)
    counted = [end if kind == DIRECTION else None for end, kind in zip(sections, kinds, strict=True)]
    return Spring(law, _sum(_turning(ends)), angle, 0.0, [*kinds, *constants], damped, counted)


def _translational(spring: TranslationalSpring, ends: list[End]) -> Spring:
    """U = k (L - L0)^2/2, and c dL/dt."""
    return along(TRANSLATIONAL, ends, [spring.stiffness, spring.damping], spring.damped, spring.length)


def _rotational(spring: RotationalSpring, ends: list[End]) -> Spring:
    """U = k (theta_b - theta_a - angle)^2/2, and c d(theta_b - theta_a)/dt."""
    return about(ROTATIONAL, ends, [spring.stiffness, spring.damping], spring.damped, spring.angle)


SPRINGS: dict[type, Callable[[Any, list[End]], Spring]] = {
    TranslationalSpring: _translational, RotationalSpring: _rotational,
}


def end_forces(patch: Spring, ends: list[End], d: Array, v: Array | None, t: float,
               linear: bool) -> list[Array]:
    """Return the forces (n_q,) that each end of a spring and damper exerts at displacements d and their rates v.

    With ``linear`` they are those about the reference.
    """
    u = patch.G @ d[patch.coordinates]
    rates = np.zeros_like(u) if v is None else patch.G @ v[patch.coordinates]
    f, H, _ = patch.forces(np.zeros_like(u) if linear else u, t, rates)
    if linear:
        f = f + H @ u
    out = []
    for fields in (_turning if patch.angle else _distance)(ends):
        coords, G, _ = table_of(fields)
        full = np.zeros_like(d)
        full[coords] = -(G.T @ f)
        out.append(full)
    return out
