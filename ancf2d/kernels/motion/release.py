"""Contact forces that end in a step of the Newmark family: what opens in a step presses no more from its start on.

A force that went on into the step would push on what has parted already, and do work from nothing; one that ends where
the step begins does none. The scheme steps with alg, which follows the accelerations a by

    (1 - am) alg_1 + am alg_0 = (1 - af) a_1 + af a_0

so alg has another part of a force than a has. With forces lambda across and along the surfaces, which make
a = M^-1 G^T lambda, the part of alg is M^-1 G^T (lambda + lag), and

    (1 - am) lag_1 + am lag_0 = (am - af) (lambda_1 - lambda_0),    lag = 0 where the motion begins anew.
"""

from __future__ import annotations

import numpy as np

from ...elements.contact_geometry import BY_CHOICE, CLOSED, CLOSES, FRICTION, HELD, OPEN, SLIDES
from .. import calls
from ..lowlevel.jit import addressed_with_memory, inner, inner_with_memory, seldom
from ..patches import face_bodies
from .consistent import constraint_matrix
from .dynamics import signals_at, to_full, to_unknowns

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
def opens_in(p, i, before, z):  # type: ignore[no-untyped-def]
    """Return whether item i is a point that opens in a step to z."""
    if not p.points.restitution[i] >= 0.0:
        return False
    k = p.place[p.points.multiplier[i]]
    return before[k] < 0.0 <= z[k]


@inner
def let_choose(p):  # type: ignore[no-untyped-def]
    """Let Newton's method choose again which points are open."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            p.points.mem[i, HELD] = BY_CHOICE


@inner
def _look(p, w, z, v, t):  # type: ignore[no-untyped-def]
    """Let the full coordinates and rates in w be those at z and v at t, and bodies face each other there."""
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    face_bodies(p, w.d)


@inner
def to_limits(p, force):  # type: ignore[no-untyped-def]
    """Let friction of points that slide, in force (3, n), be Coulomb's limit, which their springs give but nearly."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            k = p.place[p.points.multiplier[i]]
            limit = -p.points.par[i, FRICTION] * force[0, k]
            if abs(force[1, k]) > AT_LIMIT * limit:
                force[1, k] = limit if force[1, k] > 0.0 else -limit


@addressed_with_memory
@seldom
def friction_forces(p, w, z, v, t, out):  # type: ignore[no-untyped-def]
    """Fill out (2, n), at multipliers, with forces of friction of points that press at z, and rates of their places."""
    one = np.zeros(2)
    _look(p, w, z, v, t)
    out[:] = 0.0
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            k = p.place[p.points.multiplier[i]]
            if z[k] < 0.0:
                calls.point_friction(p.calls, (p.points, i, w.d, w.v, w.amps, False, one))
                out[0, k], out[1, k] = one[0], one[1]


@inner_with_memory
def _forces_of(p, w, opens, pressed, rubbed, rest, slide, out):  # type: ignore[no-untyped-def]
    """Fill out (n,) with the forces at w.d of points that open, which press and rub so much at their multipliers."""
    w.other[:] = 0.0
    for i in range(len(opens)):
        if opens[i]:
            w.d[p.points.multiplier[i]] = pressed[p.place[p.points.multiplier[i]]]
    calls.point_forces(p.calls, (p.points, w.d, w.v, w.amps, w.other))
    w.other[:] -= rest
    for i in range(len(opens)):
        if opens[i] and p.points.par[i, FRICTION] > 0.0:
            slide[:] = 0.0
            calls.point_slip(p.calls, (p.points, i, w.d, w.v, w.amps, slide))
            w.other[:] -= rubbed[p.place[p.points.multiplier[i]]] * slide
    to_unknowns(p, w.other, out, False)
    out *= p.coordinate


@addressed_with_memory
@seldom
def let_go(p, w, s, z, t, force, lag, change):  # type: ignore[no-untyped-def]
    """Let points that open in a step from s at t to z press no more; return whether accelerations are known.

    force (3, n), lag (2, n) : at their multipliers, across and along, at s; change (2, n) is filled with what alg and a
    change by.
    """
    count = len(p.points.mem)
    opens = np.zeros(count, dtype=np.bool_)
    for i in range(count):
        opens[i] = opens_in(p, i, s.z, z)
    change[:] = 0.0
    rest, slide = np.zeros(len(w.d)), np.zeros(len(w.d))
    _look(p, w, s.z, s.v, t)
    for i in range(count):
        if p.points.restitution[i] >= 0.0:
            p.points.mem[i, HELD] = OPEN
    calls.point_forces(p.calls, (p.points, w.d, w.v, w.amps, rest))
    for i in range(count):
        if opens[i]:
            p.points.mem[i, HELD] = CLOSED
            if p.points.par[i, FRICTION] > 0.0:
                p.points.mem[i, SLIDES] = CLOSES
    _forces_of(p, w, opens, force[0] + lag[0], force[1] + lag[1], rest, slide, change[0])
    _forces_of(p, w, opens, force[0], force[1], rest, slide, change[1])
    for i in range(count):
        if p.points.restitution[i] >= 0.0:
            presses = force[0, p.place[p.points.multiplier[i]]] < 0.0 and not opens[i]
            p.points.mem[i, HELD] = CLOSED if presses else OPEN
    constraint_matrix(p, w)
    regular = calls.factor(p.calls, (p, w.A, w.y))
    if regular:
        calls.solve(p.calls, (p, w.A, change[0]))
        calls.solve(p.calls, (p, w.A, change[1]))
    else:
        change[:] = 0.0
    let_choose(p)
    for i in range(count):
        if p.points.restitution[i] >= 0.0 and regular:
            # what presses on answers at once
            k = p.place[p.points.multiplier[i]]
            lag[0, k] += change[0, k] - change[1, k]
            force[0, k] += change[1, k]
        if opens[i] and regular:
            k = p.place[p.points.multiplier[i]]
            force[0, k], force[1, k], lag[0, k], lag[1, k] = 0.0, 0.0, 0.0, 0.0
    # where they press again at the end, they rub
    let_rub(p, s.z)
    return regular


@inner
def lag_behind(m, p, z):  # type: ignore[no-untyped-def]
    """Let m.lag (2, n) be that at the end z of a step, where points rub by m.drag; return the power lost to friction.

    That is of the force by which the step changes rates, at the mean rate: so much of the kinetic energy is gone.
    """
    share, lost = 1.0 / (1.0 - m.am), 0.0
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            k = p.place[p.points.multiplier[i]]
            before = m.force[1, k] + m.lag[1, k]
            for side in range(2):
                new = z[k] if side == 0 else m.drag[0, k]
                m.lag[side, k] = share * ((m.am - m.af) * (new - m.force[side, k]) - m.am * m.lag[side, k])
            rate = 0.5 * (m.force[2, k] + m.drag[1, k]) if z[k] < 0.0 else m.force[2, k]
            lost -= ((1.0 - m.gamma) * before + m.gamma * (m.drag[0, k] + m.lag[1, k])) * rate
    return lost


@inner
def no_friction(p):  # type: ignore[no-untyped-def]
    """Leave friction of contacts without a law out of forces."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            p.points.mem[i, SLIDES] = CLOSES
