"""Impulses of friction at an impact: Coulomb's law between rates and impulses, beside those across the surfaces.

Where the impulse p_n of a closed point acts for no time, that of friction p_t is at most ``friction`` times it:

    |p_t| <= mu p_n,    p_t = -mu p_n sign(s') where the place on what it touches has the rate s' behind the impact

(Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988, sections 10 to 13). With the gradients N
and S of gaps and places, rates of places s' = s'_0 + W p_t and impulses p_n = p_0 + P p_t answer linearly to p_t, by
the matrix [M N^T; N 0], so that N v' stays as the impact without friction has it. Points are solved for exactly one
after another until none changes.
"""

from __future__ import annotations

import numpy as np

from ..elements.contact_geometry import CLOSED, FRICTION, SLIDES
from . import calls
from .compiled_laws import call_forces
from .consistent import allowed_rates, constraint_matrix
from .dynamics import to_full, to_unknowns
from .lowlevel.jit import addressed_with_memory, inner, inner_with_memory
from .lowlevel.records import whole
from .points import _add, _rates, amplitude_of, fields_of_item

# rounds over all points, and changes beside the largest impulse that are none
_ROUNDS, SAME = 1000, 1e-14
# fields of a contact at most
_FIELDS = 100


@addressed_with_memory
def point_slip(points, i, d, v, amps, out):  # type: ignore[no-untyped-def]
    """Add the gradient of the place of item i on what it touches to out (n_full,); return the rate of that place.

    It is what forces of friction to either side, of a unit force across the surface, differ by.
    """
    b, m = points.field[i], points.field[i + 1] - points.field[i]
    u, w, a, f, back = np.zeros(m), np.zeros(m), np.zeros(3), np.zeros(m), np.zeros(m)
    H, C = np.zeros((m, m)), np.zeros((m, m))
    fields_of_item(points, i, d, u)
    _rates(points, i, v, w)
    amplitude_of(points, i, amps, u, w, a)
    u[m - 1] = -1.0
    kept, rate = points.mem[i, SLIDES], 0.0
    points.mem[i, SLIDES] = 1.0
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], f, H, C))
    H[:] = 0.0
    points.mem[i, SLIDES] = -1.0
    call_forces(points.forces[i], (points.p0[b:b + m], u, w, points.par[i], a, points.mem[i], back, H, C))
    points.mem[i, SLIDES] = kept
    for q in range(m - 1):
        f[q] = (back[q] - f[q]) / (2.0 * points.par[i, FRICTION])
        rate += f[q] * w[q]
    f[m - 1] = 0.0
    _add(points, i, f, out)
    return rate


@inner_with_memory
def _of_point(mu, rate, pressed, W, P):  # type: ignore[no-untyped-def]
    """Return the impulse of friction of a point with this rate and normal impulse without it, and how they answer."""
    if W <= 0.0:
        return 0.0
    stick = -rate / W
    if abs(stick) <= mu * (pressed + P * stick):
        return stick
    sign = 1.0 if stick > 0.0 else -1.0
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
def _impulses(p, items, rate, pressed, W, P):  # type: ignore[no-untyped-def]
    """Return the impulses (k,) of friction at points with these rates and normal impulses without it."""
    count = len(rate)
    found = np.zeros(count)
    for _ in range(_ROUNDS):
        largest, change = 0.0, 0.0
        for j in range(count):
            r, pn = rate[j], pressed[j]
            for k in range(count):
                if k != j:
                    r += W[j, k] * found[k]
                    pn += P[j, k] * found[k]
            new = _of_point(p.points.par[items[j], FRICTION], r, pn, W[j, j], P[j, j])
            change, largest = max(change, abs(new - found[j])), max(largest, abs(new))
            found[j] = new
        if change <= SAME * largest:
            break
    return found


@addressed_with_memory
def rub(p, w, z, v, impulse, approach, how):  # type: ignore[no-untyped-def]
    """Change the rates v at z by the impulses of friction of those items that are CLOSED in how (items,).

    ``impulse`` (n,) is that of ``consistent``, which then makes rates what constraints allow; ``approach`` (n,) the
    rates of gaps before the impact at their multipliers, of which v may keep a part. Signals are in w.amps.
    """
    count, n = 0, len(z)
    items = np.zeros(len(how), dtype=np.int64)
    for i in range(len(how)):
        if how[i] == CLOSED and p.points.par[i, FRICTION] > 0.0:
            items[count] = i
            count += 1
    if count == 0:
        return
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    constraint_matrix(p, w)
    rhs = np.zeros(n)
    allowed_rates(p, w, v, impulse, rhs)
    factors = w.A.copy()
    if not calls.factor(p.calls, (p, factors, w.y)):
        return
    calls.solve(p.calls, (p, factors, rhs))
    whole_impulse, rates = impulse - approach, np.zeros(n)
    calls.solve(p.calls, (p, factors, whole_impulse))
    for k in range(n):
        rates[k] = (v[k] + rhs[k]) * p.coordinate[k]
    to_full(p, rates, w.amps, 1, w.v)
    slips, answers, rate = np.zeros((count, n)), np.zeros((count, n)), np.zeros(count)
    for j in range(count):
        w.other[:] = 0.0
        rate[j] = calls.point_slip(p.calls, (whole(p.points), items[j], w.d, w.v, w.amps, w.other))
        to_unknowns(p, w.other, slips[j], False)
        answers[j] = slips[j]
        calls.solve(p.calls, (p, factors, answers[j]))
    W, P, pressed = np.zeros((count, count)), np.zeros((count, count)), np.zeros(count)
    for j in range(count):
        at = p.place[p.points.multiplier[items[j]]]
        pressed[j] = -whole_impulse[at]
        for k in range(count):
            P[j, k] = -answers[k, at]
            for q in range(n):
                W[j, k] += p.coordinate[q] * slips[j, q] * answers[k, q]
    found = _impulses(p, items, rate, pressed, W, P)
    for j in range(count):
        for k in range(n):
            v[k] += found[j] * answers[j, k] * p.coordinate[k]
