"""Hard contact points over a step: which of them rub, whether one opens, and what friction takes."""

from __future__ import annotations

import numpy as np

from ...elements.contact_geometry import BY_CHOICE, CLOSES, FRICTION, HELD, SLIDES
from .. import calls
from ..lowlevel.jit import addressed_with_memory, inner, seldom
from ..patches import face_bodies
from .dynamics import signals_at, to_full

# of Coulomb's limit: points that bear more slide
AT_LIMIT = 0.999


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
