"""Impulses of friction at an impact: Coulomb's law between rates and impulses, beside those across the surfaces.

Where the impulse p_n of a closed point acts for no time, that of friction p_t is at most ``friction`` times it:

    |p_t| <= mu p_n,    p_t = -mu p_n sign(s') where the place on what it touches has the rate s' behind the impact

(Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988, sections 10 to 13). With the gradients N
and S of gaps and places, rates of places s' = s'_0 + W p_t and impulses p_n = p_0 + P p_t answer linearly to p_t, by
the matrix [M N^T; N 0], so that N v' stays as the impact without friction has it. Points are solved for exactly one
after another until none changes. Forces behind it, and where a motion begins, are those of the same problem with second
rates in the place of rates.
"""

from __future__ import annotations

import numpy as np

from ...elements.contact_geometry import BEHIND, CLOSED, CLOSES, FRICTION, HELD, NONE, OPEN, SLIDES, STICKS
from .. import calls
from ..compiled_laws import call_accept, call_forces
from ..lowlevel.arrays import copy, copy_rows
from ..lowlevel.jit import addressed_with_memory, inner, inner_with_memory, seldom
from ..points import add_to, amplitude_of, fields_of_item, rates_of_item
from .consistent import allowed_rates, constraint_matrix, factored_constraints, gap_rates
from .dynamics import to_full, to_unknowns

# of the largest rate: places that pass slower than this are at rest; of the extent: way that rates are compared along
PARTING, ALONG = 1e-9, 1e-5
# rounds over all points, and changes beside the largest impulse that are none
_ROUNDS, SAME = 1000, 1e-14
# times the largest normal force: friction that grows beyond this has no balance
LOCKED = 1e6
# fields of a contact at most
_FIELDS = 100


@inner_with_memory
def _way_of(points, i, u, w, a, out):  # type: ignore[no-untyped-def]
    """Fill the gradient (fields,) of the place of item i on what it touches; the multiplier in u is overwritten.

    It is what forces of friction to either side, of a unit force across the surface, differ by.
    """
    b, m = points.field[i], points.field[i + 1] - points.field[i]
    back, H, C, kept = np.zeros(m), np.zeros((m, m)), np.zeros((m, m)), points.mem[i, SLIDES]
    u[m - 1] = -1.0
    points.mem[i, SLIDES] = 1.0
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], out, H, C))
    H[:] = 0.0
    points.mem[i, SLIDES] = -1.0
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], back, H, C))
    points.mem[i, SLIDES] = kept
    for q in range(m - 1):
        out[q] = (back[q] - out[q]) / (2.0 * points.par[i, FRICTION])
    out[m - 1] = 0.0


@addressed_with_memory
def point_slip(points, i, d, v, amps, out):  # type: ignore[no-untyped-def]
    """Add the gradient of the place of item i on what it touches to out (n_full,); return the rate of that place."""
    m, rate = points.field[i + 1] - points.field[i], 0.0
    u, w, a, slide = np.zeros(m), np.zeros(m), np.zeros(3), np.zeros(m)
    fields_of_item(points, i, d, u)
    rates_of_item(points, i, v, w)
    amplitude_of(points, i, amps, u, w, a)
    _way_of(points, i, u, w, a, slide)
    for q in range(m - 1):
        rate += slide[q] * w[q]
    add_to(points, i, slide, out)
    return rate


@inner_with_memory
def _of_point(mu, rate, pressed, W, P, way):  # type: ignore[no-untyped-def]
    """Return the friction of a point with this rate and normal force without it, and how they answer.

    Where it slides already (``way`` 1 or -1) that is Coulomb's limit against this; where it has a way of 0, what stops
    it, or the limit.
    """
    if way == 0.0:
        if W <= 0.0:
            return 0.0
        stick = -rate / W
        if abs(stick) <= mu * (pressed + P * stick):
            return stick
        sign = 1.0 if stick > 0.0 else -1.0
    else:
        stick, sign = 0.0, -way
    answer = 1.0 - sign * mu * P
    # where friction presses the point on as fast as it grows, it locks
    return stick if answer <= 0.0 else sign * mu * max(pressed, 0.0) / answer


@inner
def rubs(p):  # type: ignore[no-untyped-def]
    """Return whether contacts without a law have friction."""
    found = False
    for i in range(len(p.points.mem)):
        found |= p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0
    return found


@inner_with_memory
def _of_points(p, items, rate, pressed, W, P, way, given, found):  # type: ignore[no-untyped-def]
    """Find the friction (k,) of points with these rates and normal forces without it, but for what is ``given``."""
    count, most = len(rate), 0.0
    for j in range(count):
        most = max(most, LOCKED * abs(pressed[j]))
    for _ in range(_ROUNDS):
        largest, change = 0.0, 0.0
        for j in range(count):
            if given[j]:
                continue
            r, pn = rate[j], pressed[j]
            for k in range(count):
                if k != j:
                    r += W[j, k] * found[k]
                    pn += P[j, k] * found[k]
            new = _of_point(p.points.par[items[j], FRICTION], r, pn, W[j, j], P[j, j], way[j])
            change, largest = max(change, abs(new - found[j])), max(largest, abs(new))
            found[j] = new
        if change <= SAME * largest:
            return
        if not largest <= most:
            # points that press one another on as fast as their friction grows lock, as one does
            for j in range(count):
                if not given[j]:
                    found[j] = 0.0
            return


@inner_with_memory
def _closed(p, how, items):  # type: ignore[no-untyped-def]
    """Fill ``items`` with those that are CLOSED in how (items,) and have friction; return how many."""
    count = 0
    for i in range(len(how)):
        if how[i] == CLOSED and p.points.par[i, FRICTION] > 0.0:
            items[count] = i
            count += 1
    return count


@inner_with_memory
def _answer(p, w, factors, items, rate, slips, answers, W, P):  # type: ignore[no-untyped-def]
    """Fill rates of places (k,) at w.d and w.v, their gradients (k, n), and how all answers to friction there."""
    count, n = len(rate), slips.shape[1]
    for j in range(count):
        w.other[:] = 0.0
        rate[j] = calls.point_slip(p.calls, (p.points, items[j], w.d, w.v, w.amps, w.other))
        to_unknowns(p, w.other, slips[j], False)
        copy(slips[j], answers[j])
        calls.solve(p.calls, (p, factors, answers[j]))
    for j in range(count):
        at = p.place[p.points.multiplier[items[j]]]
        for k in range(count):
            P[j, k] = -answers[k, at]
            for q in range(n):
                W[j, k] += p.coordinate[q] * slips[j, q] * answers[k, q]


@addressed_with_memory
@seldom
def rub(p, w, z, v, impulse, approach, how):  # type: ignore[no-untyped-def]
    """Change the rates v at z by the impulses of friction of those items that are CLOSED in how (items,).

    ``impulse`` (n,) is that of ``consistent``, which then makes rates what constraints allow; ``approach`` (n,) the
    rates of gaps before the impact at their multipliers, of which v may keep a part. Signals are in w.amps.
    """
    n, items = len(z), np.zeros(len(how), dtype=np.int64)
    count = _closed(p, how, items)
    if count == 0:
        return
    rhs = np.zeros(n)
    regular, factors = allowed_rates(p, w, z, v, impulse, rhs)
    if not regular:
        return
    whole_impulse, rates = impulse - approach, np.zeros(n)
    calls.solve(p.calls, (p, factors, whole_impulse))
    for k in range(n):
        rates[k] = (v[k] + rhs[k]) * p.coordinate[k]
    to_full(p, rates, w.amps, 1, w.v)
    slips, answers, rate = np.zeros((count, n)), np.zeros((count, n)), np.zeros(count)
    W, P, pressed, found = np.zeros((count, count)), np.zeros((count, count)), np.zeros(count), np.zeros(count)
    _answer(p, w, factors, items, rate, slips, answers, W, P)
    for j in range(count):
        pressed[j] = -whole_impulse[p.place[p.points.multiplier[items[j]]]]
    _of_points(p, items, rate, pressed, W, P, np.zeros(count), np.zeros(count, dtype=np.bool_), found)
    for j in range(count):
        for k in range(n):
            v[k] += found[j] * answers[j, k] * p.coordinate[k]


@inner_with_memory
def approach_freely(p, w, s, end, how, share, approach):  # type: ignore[no-untyped-def]
    """Set the rates of gaps before an impact (n,), at their multipliers, to those at the end of the step from s where
    items that closed in it, CLOSED in how (items,), had not pressed.

    Their forces at the end act for the time ``share``. So friction has all of what presses in the step: the impact,
    and what holds the body behind it. Nothing is done where nothing rubs. Signals are in w.amps.
    """
    if not rubs(p):
        return
    n, forces, acts, free = len(end.z), np.zeros(len(end.z)), np.zeros(len(end.z)), end.v.copy()
    new, g, rate, second = np.zeros(len(how)), np.zeros(len(how)), np.zeros(len(how)), np.zeros(len(how))
    for i in range(len(how)):
        if how[i] == CLOSED and not s.z[p.place[p.points.multiplier[i]]] < 0.0:
            new[i], forces[p.place[p.points.multiplier[i]]] = 1.0, end.z[p.place[p.points.multiplier[i]]]
    to_full(p, end.z, w.amps, 0, w.d)
    to_full(p, end.v, w.amps, 1, w.v)
    constraint_matrix(p, w)
    calls.product(p.calls, (p, w.A, forces, acts))
    for i in range(len(how)):
        if new[i] != 0.0:
            p.points.mem[i, HELD] = OPEN
    constraint_matrix(p, w)
    for k in range(n):
        acts[k] *= share * p.coordinate[k]
    if factored_constraints(p, w, w.A):
        calls.solve(p.calls, (p, w.A, acts))
        for k in range(n):
            free[k] = (end.v[k] + acts[k]) * p.coordinate[k]
    for i in range(len(how)):
        if new[i] != 0.0:
            p.points.mem[i, HELD] = CLOSED
    gap_rates(p, w, end.z, free, end.a, g, rate, second)
    for i in range(len(how)):
        if new[i] != 0.0:
            approach[p.place[p.points.multiplier[i]]] = rate[i]


@inner_with_memory
def _second_rates(p, w, z, v, a, items, out):  # type: ignore[no-untyped-def]
    """Fill the second rates (k,) of places, by a difference of their rates along the motion."""
    n, amps, fastest = len(z), w.amps.copy(), 0.0
    for i in range(n):
        fastest = max(fastest, p.weights[i] * abs(v[i]))
    time = ALONG * p.extent / fastest if fastest > 0.0 else 1.0
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
def drag(p, w, z, v, a, how):  # type: ignore[no-untyped-def]
    """Add friction to accelerations a and multipliers in z, which have none, of items that are CLOSED in how.

    What slides bears Coulomb's limit against its rate; what rests the force that keeps it where it is, or the limit
    (the same problem as of impulses, with second rates). What stuck before keeps the force that it had. Accepting the
    state takes these forces (BEHIND) as what friction goes on from. Signals are in w.amps.
    """
    n, items = len(z), np.zeros(len(how), dtype=np.int64)
    for i in range(len(how)):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            p.points.mem[i, BEHIND] = NONE
    count = _closed(p, how, items)
    if count == 0:
        return
    slips, answers, rate, second = (np.zeros((count, n)), np.zeros((count, n)), np.zeros(count), np.zeros(count))
    W, P, pressed, found = np.zeros((count, count)), np.zeros((count, count)), np.zeros(count), np.zeros(count)
    way, given, hold = np.zeros(count), np.zeros(count, dtype=np.bool_), np.zeros(2)
    _second_rates(p, w, z, v, a, items, second)
    constraint_matrix(p, w)
    factors = w.A.copy()
    if not factored_constraints(p, w, factors):
        return
    _answer(p, w, factors, items, rate, slips, answers, W, P)
    fastest = 0.0
    for i in range(n):
        fastest = max(fastest, p.weights[i] * abs(v[i]))
    for j in range(count):
        pressed[j] = -z[p.place[p.points.multiplier[items[j]]]]
        if abs(rate[j]) > PARTING * fastest:
            way[j] = 1.0 if rate[j] > 0.0 else -1.0
        if p.points.mem[items[j], SLIDES] == 0.0:
            calls.point_friction(p.calls, (p.points, items[j], w.d, w.v, w.amps, True, hold))
            if abs(hold[0]) < p.points.par[items[j], FRICTION] * pressed[j]:
                found[j], given[j] = hold[0], True
    _of_points(p, items, second, pressed, W, P, way, given, found)
    for j in range(count):
        p.points.mem[items[j], BEHIND] = found[j]
        for k in range(n):
            if p.coordinate[k] != 0.0:
                a[k] += found[j] * answers[j, k]
            else:
                z[k] += found[j] * answers[j, k]


@addressed_with_memory
def point_friction(points, i, d, v, amps, holds, out):  # type: ignore[no-untyped-def]
    """Fill out (2,) with the force of friction of item i along the place, and the rate by which it takes power.

    Where it ``holds``, the force is what keeps it where it is, unlimited.
    """
    b, m = points.field[i], points.field[i + 1] - points.field[i]
    u, w, a, f, slide = np.zeros(m), np.zeros(m), np.zeros(3), np.zeros(m), np.zeros(m)
    H, C, g = np.zeros((m, m)), np.zeros((m, m)), np.zeros(m)
    fields_of_item(points, i, d, u)
    rates_of_item(points, i, v, w)
    amplitude_of(points, i, amps, u, w, a)
    kept, along, square, rate, power = points.mem[i, SLIDES], 0.0, 0.0, 0.0, 0.0
    if holds:
        # without a force across it sticks alone
        u[m - 1], points.mem[i, SLIDES] = 0.0, STICKS
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], f, H, C))
    points.mem[i, SLIDES] = CLOSES
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], g, H, C))
    points.mem[i, SLIDES] = kept
    _way_of(points, i, u, w, a, slide)
    for q in range(m - 1):
        along -= (f[q] - g[q]) * slide[q]
        power -= (f[q] - g[q]) * w[q]
        square += slide[q] * slide[q]
        rate += slide[q] * w[q]
    out[0] = along / square if square > 0.0 else 0.0
    out[1] = power / out[0] if out[0] != 0.0 else rate


@addressed_with_memory
@seldom
def take_hold(points, d, amps):  # type: ignore[no-untyped-def]
    """Let items begin with the friction that they have BEHIND an impact at d (n_full,)."""
    for i in range(len(points.mem)):
        if points.restitution[i] >= 0.0 and points.par[i, FRICTION] > 0.0 and points.mem[i, BEHIND] != NONE:
            b, e = points.field[i], points.field[i + 1]
            u, w, a = np.zeros(e - b), np.zeros(e - b), np.zeros(3)
            fields_of_item(points, i, d, u)
            amplitude_of(points, i, amps, u, w, a)
            call_accept(points.accept[i], (points.p0[b:e], u, points.par[i], points.mem[i]))
