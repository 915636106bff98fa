"""Hard contact points over a step: which close, open or slide, the states inside the step, and friction losses."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.contact_geometry import (
    AT_HOME,
    BY_FORCE,
    CLOSED,
    CLOSES,
    FRICTION,
    MOST_FIELDS,
    PLACEMENT,
    PULLED,
    SLIP_STATUS,
    STATUS,
    SUPPORTED,
)
from .. import calls
from ..compiled_laws import call_forces
from ..lowlevel.jit import addressed, addressed_with_memory, inner, inner_with_memory, seldom
from ..patches import face_bodies
from ..points import (
    amplitude_of,
    coordinates_of_item,
    does_not_act,
    evaluate_at,
    fields_of_item,
    is_inactive,
    weights_of_item,
    work_arrays,
)
from .dynamics import signals_at, to_full

# fraction of Coulomb's limit: points with more friction slide
AT_LIMIT = 0.999
# gaps whose gradient by a displacement is smaller are held by supports; fraction of the extent: penetration allowed
NO_GRADIENT, ALLOWED_PENETRATION = 1e-5, 1e-8


@addressed_with_memory
@seldom
def mark_closed_points(points, d, v, amps, out):  # type: ignore[no-untyped-def]
    """Set out (n_full,) to 1 at the multipliers of one-sided constraints that are closed at d, 0 at open ones."""
    u, w, a, f = np.zeros(MOST_FIELDS), np.zeros(MOST_FIELDS), np.zeros(3), np.zeros(MOST_FIELDS)
    for i in range(len(points.forces)):
        if points.restitution[i] >= 0.0 and does_not_act(points, i, d):
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
            # open points have the equation multiplier = 0, with a diagonal entry
            out[points.multiplier[i]] = 1.0 if H[m - 1, m - 1] == 0.0 else 0.0


@inner
def _has_supports(p, i):  # type: ignore[no-untyped-def]
    """Return whether supports or joints eliminate coordinates of item i, a hard contact point."""
    found = False
    if p.points.mem[i, PLACEMENT] == AT_HOME:
        dofs, _ = coordinates_of_item(p.points, i)
        for c in range(len(dofs)):
            found |= p.place[dofs[c]] < 0
    return found


@inner_with_memory
def _gap_can_change(p, i, row):  # type: ignore[no-untyped-def]
    """Return whether any unknown changes the gap of item i, whose gradient by the fields is ``row`` (fields,)."""
    dofs, _ = coordinates_of_item(p.points, i)
    G, out = weights_of_item(p.points, i), np.zeros(len(p.weights))
    for c in range(len(dofs)):
        x, k = 0.0, p.place[dofs[c]]
        for q in range(len(row)):
            x += G[c, q] * row[q]
        if k >= 0:
            out[k] += x
        elif k < -1:
            for j in range(p.indptr[-2 - k], p.indptr[-1 - k]):
                out[p.index[j]] += p.value[j] * x
    moves = False
    for k in range(len(out)):
        moves |= abs(out[k]) > NO_GRADIENT * p.weights[k]
    return moves


@inner
def _evaluate_as_closed(p, w, i, arrays):  # type: ignore[no-untyped-def]
    """Evaluate item i at w.d as if closed with zero multiplier, into the work ``arrays`` (``points.work_arrays``)."""
    u, v, a, f, H, C = arrays
    held, free, k = p.points.mem[i, STATUS], p.points.mem[i, PLACEMENT], p.points.multiplier[i]
    p.points.mem[i, STATUS], p.points.mem[i, PLACEMENT] = CLOSED, AT_HOME
    force, w.d[k] = w.d[k], 0.0
    v[:] = 0.0
    evaluate_at(p.points, i, w.d, w.amps, u, v, a, f, H, C)
    p.points.mem[i, STATUS], p.points.mem[i, PLACEMENT], w.d[k] = held, free, force


@addressed_with_memory
@seldom
def deactivate_supported(p, w, z):  # type: ignore[no-untyped-def]
    """Deactivate contact points whose gap no unknown changes at z, with signals in w.amps: supports carry them.

    Other points that were deactivated are active again. Points face the elements found in the last force evaluation.
    """
    arrays, placed = work_arrays(p.points), False
    for i in range(len(p.points.mem)):
        if not p.points.restitution[i] >= 0.0:
            continue
        if p.points.mem[i, PLACEMENT] == SUPPORTED:
            p.points.mem[i, PLACEMENT] = AT_HOME
        if not _has_supports(p, i) or is_inactive(p.points, i):
            continue
        if not placed:
            to_full(p, z, w.amps, 0, w.d)
            placed = True
        _evaluate_as_closed(p, w, i, arrays)
        m = p.points.field[i + 1] - p.points.field[i]
        if not _gap_can_change(p, i, arrays[4][(m - 1) * m:m * m - 1]):
            p.points.mem[i, PLACEMENT] = SUPPORTED


@addressed
@seldom
def deactivate_dependent(p, w):  # type: ignore[no-untyped-def]
    """Deactivate the contact point at whose multiplier a factorisation broke down (row w.y[0]); return whether any.

    Its gap is determined by other points, supports and joints.
    """
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.place[p.points.multiplier[i]] == w.y[0]:
            p.points.mem[i, PLACEMENT] = SUPPORTED
            return True
    return False


@addressed_with_memory
@seldom
def deactivated_penetrates(p, w, z):  # type: ignore[no-untyped-def]
    """Return whether a deactivated contact point penetrates at z, with the signals in w.amps."""
    arrays, faced = work_arrays(p.points), False
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.mem[i, PLACEMENT] == SUPPORTED:
            if not faced:
                to_full(p, z, w.amps, 0, w.d)
                face_bodies(p, w.d)
                faced = True
            _evaluate_as_closed(p, w, i, arrays)
            if arrays[3][p.points.field[i + 1] - p.points.field[i] - 1] < -ALLOWED_PENETRATION * p.extent:
                return True
    return False


@inner
def enable_friction(p, z):  # type: ignore[no-untyped-def]
    """Enable friction in the next step for points that press at z, and disable it for others, which may close in it.

    This also resets what a rejected step has set.
    """
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            p.points.mem[i, SLIP_STATUS] = 0.0 if z[p.place[p.points.multiplier[i]]] < 0.0 else CLOSES


@inner
def disable_friction(p):  # type: ignore[no-untyped-def]
    """Disable friction of hard contacts in forces."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            p.points.mem[i, SLIP_STATUS] = CLOSES


@inner
def fix_active_set(p, status):  # type: ignore[no-untyped-def]
    """Hold hard contact points open or closed, as in status (items,), until ``unfix_active_set``."""
    for i in range(len(status)):
        if p.points.restitution[i] >= 0.0:
            p.points.mem[i, STATUS] = status[i]


@inner
def unfix_active_set(p):  # type: ignore[no-untyped-def]
    """Let Newton's method determine the active set of contact points again."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            p.points.mem[i, STATUS] = BY_FORCE


@inner
def open_pulling_points(p, z):  # type: ignore[no-untyped-def]
    """Open points that pull at z, until they penetrate; return whether there are any.

    If two points have nearly the same gap, such as corners of bodies that lie on a floor at their joint, one may pull.
    """
    pulls = False
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            k = p.place[p.points.multiplier[i]]
            if z[k] > 0.0:
                z[k], p.points.mem[i, STATUS], pulls = 0.0, PULLED, True
    return pulls


@inner
def opened_in_step(p, before, z):  # type: ignore[no-untyped-def]
    """Return whether a point that presses at unknowns ``before`` is open at z."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            k = p.place[p.points.multiplier[i]]
            if before[k] < 0.0 <= z[k]:
                return True
    return False


@inner
def closed_in_step(p, s, status, i):  # type: ignore[no-untyped-def]
    """Return whether item i, which is ``status[i]`` at the end of the step from s, closed in it."""
    return status[i] == CLOSED and not s.z[p.place[p.points.multiplier[i]]] < 0.0


@inner
def interpolate_linearly(end, s):  # type: ignore[no-untyped-def]
    """Interpolate the step from s linearly, so that no state between two touching ones penetrates."""
    for k in range(len(end.dense)):
        for i in range(len(s.z)):
            end.dense[k, i] = end.z[i] - s.z[i]


@inner
def interpolate_with_impact(p, s, end, h, touched, at_impact):  # type: ignore[no-untyped-def]
    """Set the interpolation of a step from s with an impact at its end, where items that close have no force.

    If the step ends ``at_impact``, it is a parabola with the rates at the start. Otherwise the impact may be anywhere
    in the step, and a straight line ensures that no state penetrates an obstacle that both ends are outside of.
    """
    interpolate_linearly(end, s)
    for i in range(len(s.z) if at_impact else 0):
        if p.coordinate[i] != 0.0:
            change, rate = end.z[i] - s.z[i], h * s.v[i]
            end.dense[0, i], end.dense[2, i] = rate, 2.0 * change - rate
    for i in range(len(touched)):
        if closed_in_step(p, s, touched, i):
            end.dense[:, p.place[p.points.multiplier[i]]] = 0.0


@inner
def friction_to_limits(p, z, friction):  # type: ignore[no-untyped-def]
    """Set friction (n,) of points that slide at z to Coulomb's limit, which their springs reach only approximately."""
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            k = p.place[p.points.multiplier[i]]
            limit = -p.points.par[i, FRICTION] * z[k]
            if abs(friction[k]) > AT_LIMIT * limit:
                friction[k] = limit if friction[k] > 0.0 else -limit


@addressed_with_memory
@seldom
def friction_forces(p, w, z, v, t, out):  # type: ignore[no-untyped-def]
    """Fill out[0] with the friction of points that press at z, and out[1] with their sliding rates, at multipliers."""
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
    """Return the mean power lost to friction in a step to z with forces m.before and m.after; fill m.after[2].

    It is the force that changes the rates in the step times the mean sliding rate, which matches the loss of kinetic
    energy. m.after[2] is the friction in alg, which follows the friction as alg follows the accelerations.
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
def reversal_error(p, m, h):  # type: ignore[no-untyped-def]
    """Return the position error [m] of points whose sliding, and so friction, reverses in a step of size h."""
    largest = 0.0
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            k = p.place[p.points.multiplier[i]]
            rate0, rate1 = m.before[1, k], m.after[1, k]
            if rate0 * rate1 < 0.0:
                largest = max(largest, 0.25 * h * min(abs(rate0), abs(rate1)))
    return largest


def supported_functions(problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries for contact points that supports hold, for the table of a model with hard contacts."""
    return {calls.deactivate_supported: (deactivate_supported, problem),
            calls.deactivate_dependent: (deactivate_dependent, problem),
            calls.deactivated_penetrates: (deactivated_penetrates, problem)}
