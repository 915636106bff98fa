"""Detect contact points that pass through an obstacle in a time step and are outside it at both ends."""

from __future__ import annotations

import numpy as np

from ..elements import contact_geometry
from ..elements.contact_geometry import BODY, HOME, MOST_FIELDS, PLACEMENT, SHAPE, WORK
from . import calls
from .compiled_laws import part
from .contact import DEPTH, TOUCHES, is_crossed, place_seen
from .lowlevel.jit import addressed_with_memory, inner_with_memory, seldom
from .motion.dynamics import signals_at, to_full
from .points import amplitude_of, does_not_act, fields_of_item

_distance_at = part(contact_geometry.distance_at)


@inner_with_memory
def _position_and_gap(p, d, i, amps, u, work):  # type: ignore[no-untyped-def]
    """Return x and y of point i in the frame of its obstacle, and its gap, at d (n_full,) and signals ``amps``."""
    points = p.points
    b, m = points.field[i], points.field[i + 1] - points.field[i]
    rates, amplitude = u[len(u) // 2:], work[WORK:]
    fields_of_item(points, i, d, u)
    amplitude_of(points, i, amps, u, rates, amplitude)
    x, y = place_seen(points.par[i], points.p0[b:b + m], u, points.par[i, HOME], work)
    return x, y, _distance_at(points.par[i], x, y, -1.0)[0]


@inner_with_memory
def _meets_obstacle(p, i):  # type: ignore[no-untyped-def]
    """Return whether item i is an active contact point that may touch an obstacle (not a body)."""
    return (not p.points.restitution[i] < 0.0 and p.points.mem[i, PLACEMENT] >= 0.0
            and int(p.points.par[i, SHAPE]) != BODY)


@inner_with_memory
def _stays_apart(points, i, before, after):  # type: ignore[no-untyped-def]
    """Return whether the items from i on are out of reach all the way between two states.

    They are if both states are, because the set of states that are out of reach is convex.
    """
    return points.apart[i] > 0.0 and does_not_act(points, i, before) and does_not_act(points, i, after)


@addressed_with_memory
@seldom
def tunnels(p, w, s, m, t, h):  # type: ignore[no-untyped-def]
    """Return whether a contact point passes through an obstacle or body in the step from s at t to m.end.

    It is outside of it at both ends.
    """
    n, end, depth = len(p.points.mem), m.end, DEPTH * p.extent
    near = TOUCHES * p.extent
    u, work, amps = np.zeros(2 * MOST_FIELDS), np.zeros(WORK + 3), w.amps.copy()
    signals_at(p, t, amps)
    to_full(p, s.z, amps, 0, w.d)
    start, i = w.d.copy(), 0
    signals_at(p, t + h, w.amps)
    to_full(p, end.z, w.amps, 0, w.d)
    while i < n:
        if _stays_apart(p.points, i, start, w.d):
            i += p.points.run[i]
            continue
        if _meets_obstacle(p, i):
            x0, y0, g0 = _position_and_gap(p, start, i, amps, u, work)
            if g0 > -near:
                x, y, g = _position_and_gap(p, w.d, i, w.amps, u, work)
                dx, dy = x - x0, y - y0
                if g > -near and np.sqrt(dx * dx + dy * dy) > g0 + g \
                        and is_crossed(p.points.par[i], x0, y0, g0, dx, dy, depth):
                    return True
        i += 1
    if len(p.facing.item) > 0:
        return calls.bodies_cross(p.calls, (p.facing, p.points, start, w.d))
    return False
