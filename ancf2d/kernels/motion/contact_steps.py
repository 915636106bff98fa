"""Hard contact points over a step: which of them close, open or rub, the states inside it, and what friction takes."""

from __future__ import annotations

import numpy as np

from ...elements.contact_geometry import BY_CHOICE, CLOSED, CLOSES, FRICTION, HELD, SLIDES
from .. import calls
from ..compiled_laws import call_forces
from ..lowlevel.jit import addressed_with_memory, inner, seldom
from ..patches import face_bodies
from ..points import amplitude_of, fields_of_item, rests
from .dynamics import signals_at, to_full

# of Coulomb's limit: points that bear more slide
AT_LIMIT = 0.999
# fields of a contact at most
FIELDS = 100


@addressed_with_memory
@seldom
def point_sides(points, d, v, amps, out):  # type: ignore[no-untyped-def]
    """Set 1 at the multipliers (n_full,) of one-sided constraints that are closed at d, 0 at those that are open."""
    u, w, a, f = np.zeros(FIELDS), np.zeros(FIELDS), np.zeros(3), np.zeros(FIELDS)
    for i in range(len(points.forces)):
        if points.restitution[i] >= 0.0 and rests(points, i):
            out[points.multiplier[i]] = 0.0
        elif points.restitution[i] >= 0.0:
            b, m = points.field[i], points.field[i + 1] - points.field[i]
            fields_of_item(points, i, d, u)
            fields_of_item(points, i, v, w)
            amplitude_of(points, i, amps, u, w, a)
            H, C = np.zeros((m, m)), np.zeros((m, m))
            f[:m] = 0.0
            call_forces(points.forces[i], (points.p0[b:b + m], u[:m], w[:m], points.par[i], a, points.mem[i], f[:m], H,
                                           C))
            # of those that are open, the multiplier is 0
            out[points.multiplier[i]] = 1.0 if H[m - 1, m - 1] == 0.0 else 0.0


@inner
def let_rub(p, z):  # type: ignore[no-untyped-def]
    """Let points that press at z have friction in the step to come, and the others, which may close in it, have none.

    What a step that was not accepted has set is gone then.
    """
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            p.points.mem[i, SLIDES] = 0.0 if z[p.place[p.points.multiplier[i]]] < 0.0 else CLOSES


@inner
def no_friction(p):  # type: ignore[no-untyped-def]
    """Leave friction of contacts without a law out of forces."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            p.points.mem[i, SLIDES] = CLOSES


@inner
def let_choose(p):  # type: ignore[no-untyped-def]
    """Let Newton's method choose again which points are open."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            p.points.mem[i, HELD] = BY_CHOICE


@inner
def opens(p, before, z):  # type: ignore[no-untyped-def]
    """Return whether a point that presses at unknowns ``before`` is open at z."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            k = p.place[p.points.multiplier[i]]
            if before[k] < 0.0 <= z[k]:
                return True
    return False


@inner
def closes(p, s, how, i):  # type: ignore[no-untyped-def]
    """Return whether item i, which is ``how[i]`` at the end of the step from s, closed in it."""
    return how[i] == CLOSED and not s.z[p.place[p.points.multiplier[i]]] < 0.0


@inner
def go_straight(end, s):  # type: ignore[no-untyped-def]
    """Let the step from s be interpolated by a straight line: between states that touch, nothing penetrates."""
    for k in range(len(end.dense)):
        for i in range(len(s.z)):
            end.dense[k, i] = end.z[i] - s.z[i]


@inner
def on_the_way(p, s, end, h, touched, at_impact):  # type: ignore[no-untyped-def]
    """Let states inside the step from s be on the way to an impact at its end, with items open that close there.

    Where the step ends ``at_impact``, on a parabola from the rates at its start; else, as the impact may be anywhere in
    the step, straight on, so that no state is inside what neither end is in.
    """
    go_straight(end, s)
    for i in range(len(s.z) if at_impact else 0):
        if p.coordinate[i] != 0.0:
            change, rate = end.z[i] - s.z[i], h * s.v[i]
            end.dense[0, i], end.dense[2, i] = rate, 2.0 * change - rate
    for i in range(len(touched)):
        if closes(p, s, touched, i):
            end.dense[:, p.place[p.points.multiplier[i]]] = 0.0


@inner
def to_limits(p, z, friction):  # type: ignore[no-untyped-def]
    """Let friction (n,) of points that slide at z be Coulomb's limit, which their springs give but nearly."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            k = p.place[p.points.multiplier[i]]
            limit = -p.points.par[i, FRICTION] * z[k]
            if abs(friction[k]) > AT_LIMIT * limit:
                friction[k] = limit if friction[k] > 0.0 else -limit


@addressed_with_memory
@seldom
def friction_forces(p, w, z, v, t, out):  # type: ignore[no-untyped-def]
    """Fill two rows of out, at multipliers, with friction of points that press at z, and rates of their places."""
    one = np.zeros(2)
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    face_bodies(p, w.d)
    out[:2] = 0.0
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            k = p.place[p.points.multiplier[i]]
            if z[k] < 0.0:
                calls.point_friction(p.calls, (p.points, i, w.d, w.v, w.amps, False, one))
                out[0, k], out[1, k] = one[0], one[1]


@inner
def lost_to_friction(m, p, z):  # type: ignore[no-untyped-def]
    """Return the power lost to friction in a step to z with forces m.before and m.after; fill what alg has of these.

    That is of the force by which the step changes rates, at the mean rate: so much of the kinetic energy is gone. alg
    follows accelerations, and so does what it has of a force.
    """
    lost = 0.0
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            k = p.place[p.points.multiplier[i]]
            force0, rate0, alg0 = m.before[0, k], m.before[1, k], m.before[2, k]
            alg1 = ((1.0 - m.af) * m.after[0, k] + m.af * force0 - m.am * alg0) / (1.0 - m.am)
            rate = 0.5 * (rate0 + m.after[1, k]) if z[k] < 0.0 else rate0
            lost -= ((1.0 - m.gamma) * alg0 + m.gamma * alg1) * rate
            m.after[2, k] = alg1
    return lost


@inner
def turned_back(p, m, h):  # type: ignore[no-untyped-def]
    """Return how far [m] places may be off whose sliding turns back in a step of length h: friction turns then, too."""
    largest = 0.0
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            k = p.place[p.points.multiplier[i]]
            rate0, rate1 = m.before[1, k], m.after[1, k]
            if rate0 * rate1 < 0.0:
                largest = max(largest, 0.25 * h * min(abs(rate0), abs(rate1)))
    return largest
