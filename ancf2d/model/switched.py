"""Supports and joints that engage or release during a motion: their equations as constraints with multipliers.

Eliminated equations cannot be released, so these have multipliers. A support that engages holds its point where it is
then; its law stores that value as a history variable.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..case import Active, Latch
from ..elements.point_laws import PointLaw, with_multiplier
from ..elements.shape import Array
from .constraints import ALIGNED, AT_ANGLE, TURNED, Constraint, Equations, Row
from .point_patch import NOTHING, Field, PointConstraint, turn_fields
from .points import PointRef, dot

# largest violation of a joint that engages, relative to the size of its terms
CLOSED = 1e-6


def held(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Linear function of coordinates held at its value when caught plus the prescribed change: u - b - mem[0] = 0."""
    f[0], f[1] = 1.0, -1.0
    with_multiplier(p0[0] + u[0] - p0[1] - u[1] - mem[0], u, f, H)
    return 0.0, 0.0


def held_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Same as ``held``, which is linear."""
    f[0], f[1] = u1[2], -u1[2]
    f[2] = p0[0] + u1[0] - p0[1] - u1[1] - mem[0]
    return 0.0, 0.0


def held_angle(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Direction held at the angle from its reference at which it was caught: p x (cos, sin) = 0."""
    c, s = np.cos(mem[0]), np.sin(mem[0])
    f[0], f[1] = s, -c
    with_multiplier((p0[0] + u[0]) * s - (p0[1] + u[1]) * c, u, f, H)
    return 0.0, 0.0


def held_angle_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Same as ``held_angle``, which is linear."""
    c, s = np.cos(mem[0]), np.sin(mem[0])
    f[0], f[1] = u1[2] * s, -u1[2] * c
    f[2] = (p0[0] + u1[0]) * s - (p0[1] + u1[1]) * c
    return 0.0, 0.0


def held_along(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Component of a vector along a direction, held: p . (cos, sin) = mem[1].

    mem: angle of the direction and value of the component, both when caught. Fields: the vector, and the direction of
    the section, which is not held; par: angle of the direction in the reference.
    """
    c, s = np.cos(mem[0]), np.sin(mem[0])
    f[0], f[1] = c, s
    with_multiplier((p0[0] + u[0]) * c + (p0[1] + u[1]) * s - mem[1], u, f, H)
    return 0.0, 0.0


def held_along_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Same as ``held_along``, which is linear."""
    c, s = np.cos(mem[0]), np.sin(mem[0])
    f[0], f[1] = u1[4] * c, u1[4] * s
    f[4] = (p0[0] + u1[0]) * c + (p0[1] + u1[1]) * s - mem[1]
    return 0.0, 0.0


def held_aligned(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Two directions held at the angle between them when caught: p_a x R(-mem) p_b = 0."""
    c, s = np.cos(mem[0]), np.sin(mem[0])
    ax, ay, bx, by = p0[0] + u[0], p0[1] + u[1], p0[2] + u[2], p0[3] + u[3]
    f[0], f[1], f[2], f[3] = by * c - bx * s, -bx * c - by * s, -ax * s - ay * c, ax * c - ay * s
    H[0, 2], H[2, 0], H[1, 3], H[3, 1] = -s, -s, -s, -s
    H[0, 3], H[3, 0], H[1, 2], H[2, 1] = c, c, -c, -c
    with_multiplier(ax * f[0] + ay * f[1], u, f, H)
    return 0.0, 0.0


def held_aligned_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Discrete gradient: the gradient at the midpoint, which is exact for a quadratic form."""
    c, s, lam = np.cos(mem[0]), np.sin(mem[0]), u1[4]
    ax, ay = p0[0] + 0.5 * (u0[0] + u1[0]), p0[1] + 0.5 * (u0[1] + u1[1])
    bx, by = p0[2] + 0.5 * (u0[2] + u1[2]), p0[3] + 0.5 * (u0[3] + u1[3])
    f[0], f[1], f[2], f[3] = (lam * (by * c - bx * s), lam * (-bx * c - by * s), lam * (-ax * s - ay * c),
                              lam * (ax * c - ay * s))
    ax, ay, bx, by = p0[0] + u1[0], p0[1] + u1[1], p0[2] + u1[2], p0[3] + u1[3]
    f[4] = ax * (by * c - bx * s) - ay * (bx * c + by * s)
    return 0.0, 0.0


HELD = PointLaw("held", held, held_mean, constraint=True)
HELD_ANGLE = PointLaw("held_angle", held_angle, held_angle_mean, constraint=True)
HELD_ALONG = PointLaw("held_along", held_along, held_along_mean, constraint=True)
HELD_ALIGNED = PointLaw("held_aligned", held_aligned, held_aligned_mean, constraint=True)


def switched(own: Equations, window: Active | Latch | None, size: Callable[[int], float], extent: float,
             point: PointRef | None = None) -> list[Constraint]:
    """Return the equations of a support at a point, or of a joint, as constraints that act within ``window``.

    ``size(coordinate)`` is the magnitude of a coordinate for a unit displacement, ``extent`` the size of the scene.
    """
    out: list[Constraint] = [*(_constraint(row, size, extent, point) for row in own.rows), *own.constraints]
    for c in out:
        if isinstance(c, PointConstraint) and c.law is ALIGNED:
            c.law = HELD_ALIGNED
        c.active = window
        # after a release the directions may be anything
        c.facing = None
    return out


def _constraint(row: Row, size: Callable[[int], float], extent: float, point: PointRef | None) -> PointConstraint:
    if row.holds == "rotation" and point is not None and not point.turns_by_theta:
        _, fields = turn_fields(point)
        return PointConstraint(HELD_ANGLE, fields, [], row.owner, row.holds, fields[0].p0)
    if row.vector is not None and point is not None:
        columns, angle = row.vector
        _, turning = turn_fields(point)
        first, e0 = point.mesh.first_dof, point.mesh.e0
        fields = [Field(*x, dot((x[0] - first, x[1]), e0)) for x in columns]
        out = PointConstraint(HELD_ALONG, [*fields, *turning], [angle], row.owner, row.holds, _scale(row, size, extent))
        store_held_values(out, np.zeros(int(out.dofs.max()) + 1), 0.0)
        return out
    return PointConstraint(HELD, [Field(row.coords, row.coefs, row.initial_gap), NOTHING], [], row.owner, row.holds,
                           _scale(row, size, extent), row.signal, 1 if row.signal is not None else -1)


def _scale(row: Row, size: Callable[[int], float], extent: float) -> float:
    return extent * max(abs(w) * size(c) for c, w in zip(row.coords.tolist(), row.coefs.tolist(), strict=True))


def store_held_values(c: PointConstraint, d: Array, t: float) -> None:
    """Store in a constraint that engages what it holds at d (n_full,) and t.

    A prescribed motion continues from there by its change.
    """
    p, given = c.p0 + c.G @ d[c.dofs], 0.0 if c.signal is None else c.signal(t)
    if c.law is HELD:
        c.mem[0] = p[0] - given
    elif c.law in (HELD_ANGLE, AT_ANGLE):
        follows = p[2] if c.law is AT_ANGLE else 0.0
        c.mem[0] = math.remainder(math.atan2(p[1], p[0]) - follows - given, 2.0 * math.pi)
    elif c.law is HELD_ALIGNED:
        c.mem[0] = math.atan2(p[0] * p[3] - p[1] * p[2], p[0] * p[2] + p[1] * p[3])
    elif c.law is HELD_ALONG:
        c.mem[0] = c.par[0] + math.atan2(p[3], p[2])
        c.mem[1] = p[0] * math.cos(c.mem[0]) + p[1] * math.sin(c.mem[0])


def is_off(c: PointConstraint, d: Array) -> float:
    """Return how far apart the points of a joint are, relative to the size of its terms; its angle may be any."""
    if c.law is not HELD or c.holds == TURNED:
        return 0.0
    return float(abs(c.p0[0] + c.G[0] @ d[c.dofs])) / c.scale
