"""Friction impulses of hard contact points at an impact: Coulomb's law between sliding rates and impulses.

The friction impulse p_t of a closed point is at most mu = ``friction`` times its normal impulse p_n:

    |p_t| <= mu p_n,    p_t = -mu p_n sign(s') where the point slides with the rate s' after the impact

(Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988, sections 10 to 13). s is the position of
the point along the surface that it touches. With the gradients N of gaps and S of positions s, the sliding rates
s' = s'_0 + W p_t and the impulses p_n = p_0 + P p_t are linear in p_t, by the matrix [M N^T; N 0], so that N v' is not
changed by friction. The points are solved one after another, each exactly, until none changes. Friction forces after
the impact, and at the start of a motion, solve the same problem with second rates instead of rates.
"""

from __future__ import annotations

import numpy as np

from ...elements.contact_geometry import (
    AFTER_IMPACT,
    CLOSED,
    CLOSES,
    FRICTION,
    NO_IMPACT,
    OPEN,
    SLIP_STATUS,
    STATUS,
    STICKS,
)
from .. import calls
from ..compiled_laws import call_accept, call_forces
from ..lowlevel.arrays import copy, copy_rows
from ..lowlevel.jit import addressed_with_memory, inner, inner_with_memory, seldom
from ..points import add_to, amplitude_of, fields_of_item, rates_of_item
from .consistent import allowed_rates, constraint_matrix, factored_constraints, gap_rates
from .contact_steps import closed_in_step
from .dynamics import norm, to_full, to_unknowns

# fraction of the largest rate: slower points are at rest, or stay closed; fraction of the extent: distance for
# differences of rates
AT_REST, DIFFERENCE = 1e-9, 1e-5
# most rounds over all points, and the change relative to the largest impulse that ends them
_ROUNDS, CONVERGED = 1000, 1e-14
# multiple of the largest normal force: if friction grows beyond it, the points lock and there is no solution
LOCKED = 1e6


@inner_with_memory
def _slip_gradient(points, i, u, w, a, out):  # type: ignore[no-untyped-def]
    """Fill out (fields,) with the gradient of the position of item i along the surface that it touches.

    It is computed from the difference of friction forces in both directions under a unit normal force. Overwrites the
    multiplier in u.
    """
    b, m = points.field[i], points.field[i + 1] - points.field[i]
    back, H, C, kept = np.zeros(m), np.zeros((m, m)), np.zeros((m, m)), points.mem[i, SLIP_STATUS]
    u[m - 1] = -1.0
    points.mem[i, SLIP_STATUS] = 1.0
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], out, H, C))
    H[:] = 0.0
    points.mem[i, SLIP_STATUS] = -1.0
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], back, H, C))
    points.mem[i, SLIP_STATUS] = kept
    for q in range(m - 1):
        out[q] = (back[q] - out[q]) / (2.0 * points.par[i, FRICTION])
    out[m - 1] = 0.0


@addressed_with_memory
def point_slip(points, i, d, v, amps, out):  # type: ignore[no-untyped-def]
    """Add the gradient of the position of item i along the surface to out (n_full,); return its sliding rate."""
    m, rate = points.field[i + 1] - points.field[i], 0.0
    u, w, a, slide = np.zeros(m), np.zeros(m), np.zeros(3), np.zeros(m)
    fields_of_item(points, i, d, u)
    rates_of_item(points, i, v, w)
    amplitude_of(points, i, amps, u, w, a)
    _slip_gradient(points, i, u, w, a, slide)
    for q in range(m - 1):
        rate += slide[q] * w[q]
    add_to(points, i, slide, out)
    return rate


@inner_with_memory
def _coulomb_friction(mu, rate, pressed, W, P, direction):  # type: ignore[no-untyped-def]
    """Return the friction of one point by Coulomb's law.

    rate, pressed : its sliding rate and normal force without its own friction; W, P : their changes per unit friction.
    If it slides already (``direction`` 1 or -1), friction is Coulomb's limit against that direction; if ``direction``
    is 0, it is the force that stops the point, at most the limit.
    """
    if direction == 0.0:
        if W <= 0.0:
            return 0.0
        stick = -rate / W
        if abs(stick) <= mu * (pressed + P * stick):
            return stick
        sign = 1.0 if stick > 0.0 else -1.0
    else:
        stick, sign = 0.0, -direction
    denominator = 1.0 - sign * mu * P
    # if friction increases the normal force as fast as its own limit, the point locks
    return stick if denominator <= 0.0 else sign * mu * max(pressed, 0.0) / denominator


@inner
def has_friction(p):  # type: ignore[no-untyped-def]
    """Return whether any hard contact has friction."""
    found = False
    for i in range(len(p.points.mem)):
        found |= p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0
    return found


@inner_with_memory
def _solve_friction(p, items, rate, pressed, W, P, direction, known, found):  # type: ignore[no-untyped-def]
    """Solve for the friction found (k,) of all points, except those that are ``known``.

    rate, pressed (k,) : sliding rates and normal forces without friction; W, P (k, k) : their changes per unit friction
    (``_response``); direction (k,) : of sliding, 0 at rest.
    """
    count, most = len(rate), 0.0
    for j in range(count):
        most = max(most, LOCKED * abs(pressed[j]))
    for _ in range(_ROUNDS):
        largest, change = 0.0, 0.0
        for j in range(count):
            if known[j]:
                continue
            r, pn = rate[j], pressed[j]
            for k in range(count):
                if k != j:
                    r += W[j, k] * found[k]
                    pn += P[j, k] * found[k]
            new = _coulomb_friction(p.points.par[items[j], FRICTION], r, pn, W[j, j], P[j, j], direction[j])
            change, largest = max(change, abs(new - found[j])), max(largest, abs(new))
            found[j] = new
        if change <= CONVERGED * largest:
            return
        if not largest <= most:
            # the points increase each other's normal forces as fast as friction grows: they lock, as one may
            for j in range(count):
                if not known[j]:
                    found[j] = 0.0
            return


@inner_with_memory
def _closed_with_friction(p, status, items):  # type: ignore[no-untyped-def]
    """Fill ``items`` with the items that are CLOSED in status (items,) and have friction; return their number."""
    count = 0
    for i in range(len(status)):
        if status[i] == CLOSED and p.points.par[i, FRICTION] > 0.0:
            items[count] = i
            count += 1
    return count


@inner_with_memory
def _response(p, w, n, factors, items):  # type: ignore[no-untyped-def]
    """Return the sliding rates (k,) of items (k,) at w.d and w.v, and the response of the n unknowns to their friction.

    It consists of the changes of the unknowns (k, n), sliding rates (k, k) and normal forces (k, k) per unit friction.
    """
    count = len(items)
    rate, slips, responses = np.zeros(count), np.zeros((count, n)), np.zeros((count, n))
    W, P = np.zeros((count, count)), np.zeros((count, count))
    for j in range(count):
        w.other[:] = 0.0
        rate[j] = calls.point_slip(p.calls, (p.points, items[j], w.d, w.v, w.amps, w.other))
        to_unknowns(p, w.other, slips[j], False)
        copy(slips[j], responses[j])
        calls.solve(p.calls, (p, factors, responses[j]))
    for j in range(count):
        at = p.place[p.points.multiplier[items[j]]]
        for k in range(count):
            P[j, k] = -responses[k, at]
            for q in range(n):
                W[j, k] += p.coordinate[q] * slips[j, q] * responses[k, q]
    return rate, responses, W, P


@addressed_with_memory
@seldom
def apply_friction_impulses(p, w, z, v, impulse, approach, status):  # type: ignore[no-untyped-def]
    """Change the rates v at z by the friction impulses of the items that are CLOSED in status (items,).

    ``impulse`` (n,) is the one for ``consistent``, which is called next to satisfy the constraints; ``approach`` (n,)
    are gap rates before the impact, at multipliers (v may contain a part of these). Signals are in w.amps.
    """
    n, items = len(z), np.zeros(len(status), dtype=np.int64)
    count = _closed_with_friction(p, status, items)
    if count == 0:
        return
    rhs = np.zeros(n)
    regular, factors = allowed_rates(p, w, z, v, impulse, rhs)
    if not regular:
        return
    whole_impulse, rates = np.zeros(n), np.zeros(n)
    for k in range(n):
        whole_impulse[k] = impulse[k] - approach[k]
    calls.solve(p.calls, (p, factors, whole_impulse))
    for k in range(n):
        rates[k] = (v[k] + rhs[k]) * p.coordinate[k]
    to_full(p, rates, w.amps, 1, w.v)
    rate, responses, W, P = _response(p, w, n, factors, items[:count])
    pressed, found = np.zeros(count), np.zeros(count)
    for j in range(count):
        pressed[j] = -whole_impulse[p.place[p.points.multiplier[items[j]]]]
    _solve_friction(p, items, rate, pressed, W, P, np.zeros(count), np.zeros(count, dtype=np.bool_), found)
    for j in range(count):
        for k in range(n):
            v[k] += found[j] * responses[j, k] * p.coordinate[k]


@inner_with_memory
def approach_without_contact(p, w, s, end, status, share, approach):  # type: ignore[no-untyped-def]
    """Set ``approach`` (n,), gap rates before an impact at multipliers, to the rates without the new contact forces.

    These are the rates at the end of the step from s if items that closed in it (CLOSED in status (items,)) had not
    pressed; their forces at the end act for the time ``share``. Friction then includes all normal impulses of the step:
    of the impact and of the contact after it. Nothing changes without friction. Signals are in w.amps.
    """
    if not has_friction(p):
        return
    n, forces, acts, free = len(end.z), np.zeros(len(end.z)), np.zeros(len(end.z)), end.v.copy()
    new, g, rate, second = np.zeros(len(status)), np.zeros(len(status)), np.zeros(len(status)), np.zeros(len(status))
    for i in range(len(status)):
        if closed_in_step(p, s, status, i):
            new[i], forces[p.place[p.points.multiplier[i]]] = 1.0, end.z[p.place[p.points.multiplier[i]]]
    to_full(p, end.z, w.amps, 0, w.d)
    to_full(p, end.v, w.amps, 1, w.v)
    constraint_matrix(p, w)
    calls.product(p.calls, (p, w.A, forces, acts))
    for i in range(len(status)):
        if new[i] != 0.0:
            p.points.mem[i, STATUS] = OPEN
    constraint_matrix(p, w)
    for k in range(n):
        acts[k] *= share * p.coordinate[k]
    if factored_constraints(p, w, w.A):
        calls.solve(p.calls, (p, w.A, acts))
        for k in range(n):
            free[k] = (end.v[k] + acts[k]) * p.coordinate[k]
    for i in range(len(status)):
        if new[i] != 0.0:
            p.points.mem[i, STATUS] = CLOSED
    gap_rates(p, w, end.z, free, end.a, g, rate, second)
    for i in range(len(status)):
        if new[i] != 0.0:
            approach[p.place[p.points.multiplier[i]]] = rate[i]


@inner_with_memory
def _second_rates(p, w, z, v, a, items, out):  # type: ignore[no-untyped-def]
    """Fill out (k,) with the second rates of positions along the surface, by differences of rates along the motion."""
    n, amps, fastest = len(z), w.amps.copy(), norm(p, v)
    time = DIFFERENCE * p.extent / fastest if fastest > 0.0 else 1.0
    place, rates = np.zeros(n), np.zeros(n)
    out[:] = 0.0
    for side in (-1.0, 1.0):
        for i in range(n):
            place[i] = (z[i] + side * time * v[i]) * p.coordinate[i]
            rates[i] = (v[i] + side * time * a[i]) * p.coordinate[i]
        for k in range(len(amps)):
            w.amps[k, 0] = amps[k, 0] + side * time * amps[k, 1]
            w.amps[k, 1] = amps[k, 1] + side * time * amps[k, 2]
        to_full(p, place, w.amps, 0, w.d)
        to_full(p, rates, w.amps, 1, w.v)
        for j in range(len(out)):
            w.other[:] = 0.0
            rate = calls.point_slip(p.calls, (p.points, items[j], w.d, w.v, w.amps, w.other))
            out[j] += side * rate / (2.0 * time)
    copy_rows(amps, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)


@addressed_with_memory
@seldom
def add_friction_forces(p, w, z, v, a, status):  # type: ignore[no-untyped-def]
    """Add the friction of items that are CLOSED in status (items,) to accelerations a and multipliers in z.

    Sliding points bear Coulomb's limit against their rate; points at rest bear the force that keeps them there, at most
    the limit (the same problem as for impulses, with second rates). Points that stuck before keep their force. The
    forces are stored (AFTER_IMPACT), and friction continues from them when the state is accepted. Signals are in
    w.amps.
    """
    n, items = len(z), np.zeros(len(status), dtype=np.int64)
    for i in range(len(status)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            p.points.mem[i, AFTER_IMPACT] = NO_IMPACT
    count = _closed_with_friction(p, status, items)
    if count == 0:
        return
    pressed, found, second, sticking = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(2)
    direction, known = np.zeros(count), np.zeros(count, dtype=np.bool_)
    _second_rates(p, w, z, v, a, items, second)
    constraint_matrix(p, w)
    factors = w.A.copy()
    if not factored_constraints(p, w, factors):
        return
    rate, responses, W, P = _response(p, w, n, factors, items[:count])
    fastest = norm(p, v)
    for j in range(count):
        pressed[j] = -z[p.place[p.points.multiplier[items[j]]]]
        if abs(rate[j]) > AT_REST * fastest:
            direction[j] = 1.0 if rate[j] > 0.0 else -1.0
        if p.points.mem[items[j], SLIP_STATUS] == 0.0:
            calls.point_friction(p.calls, (p.points, items[j], w.d, w.v, w.amps, True, sticking))
            if abs(sticking[0]) < p.points.par[items[j], FRICTION] * pressed[j]:
                found[j], known[j] = sticking[0], True
    _solve_friction(p, items, second, pressed, W, P, direction, known, found)
    for j in range(count):
        p.points.mem[items[j], AFTER_IMPACT] = found[j]
        for k in range(n):
            if p.coordinate[k] != 0.0:
                a[k] += found[j] * responses[j, k]
            else:
                z[k] += found[j] * responses[j, k]


@addressed_with_memory
def point_friction(points, i, d, v, amps, sticks, out):  # type: ignore[no-untyped-def]
    """Fill out (2,) with the friction force of item i along the surface, and the sliding rate conjugate to its power.

    With ``sticks``, the force is the one that keeps the point in place, without Coulomb's limit.
    """
    b, m = points.field[i], points.field[i + 1] - points.field[i]
    u, w, a, f, slide = np.zeros(m), np.zeros(m), np.zeros(3), np.zeros(m), np.zeros(m)
    H, C, g = np.zeros((m, m)), np.zeros((m, m)), np.zeros(m)
    fields_of_item(points, i, d, u)
    rates_of_item(points, i, v, w)
    amplitude_of(points, i, amps, u, w, a)
    kept, along, square, rate, power = points.mem[i, SLIP_STATUS], 0.0, 0.0, 0.0, 0.0
    if sticks:
        # normal force 0 and STICKS: only the sticking force remains
        u[m - 1], points.mem[i, SLIP_STATUS] = 0.0, STICKS
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], f, H, C))
    points.mem[i, SLIP_STATUS] = CLOSES
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], g, H, C))
    points.mem[i, SLIP_STATUS] = kept
    _slip_gradient(points, i, u, w, a, slide)
    for q in range(m - 1):
        along -= (f[q] - g[q]) * slide[q]
        power -= (f[q] - g[q]) * w[q]
        square += slide[q] * slide[q]
        rate += slide[q] * w[q]
    out[0] = along / square if square > 0.0 else 0.0
    out[1] = power / out[0] if out[0] != 0.0 else rate


@addressed_with_memory
@seldom
def start_friction(points, d, amps):  # type: ignore[no-untyped-def]
    """Start friction of all items from the force stored after an impact (AFTER_IMPACT) at d (n_full,)."""
    for i in range(len(points.mem)):
        if points.restitution[i] >= 0.0 and points.par[i, FRICTION] > 0.0 and points.mem[i, AFTER_IMPACT] != NO_IMPACT:
            b, e = points.field[i], points.field[i + 1]
            u, w, a = np.zeros(e - b), np.zeros(e - b), np.zeros(3)
            fields_of_item(points, i, d, u)
            amplitude_of(points, i, amps, u, w, a)
            call_accept(points.accept[i], (points.p0[b:e], u, points.par[i], points.mem[i]))
