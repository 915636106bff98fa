"""Normal impulses of an impact, and the work that moving obstacles do by them."""

from __future__ import annotations

import numpy as np

from ...elements.contact_geometry import CLOSED, FRICTION
from .. import calls
from ..lowlevel.arrays import copy_rows
from ..lowlevel.jit import inner_with_memory
from .consistent import factored_constraints, gap_rates
from .contact_steps import closed_in_step, fix_active_set
from .dynamics import signals_at
from .state import IMPACT_ITEM, IMPACT_POINTS, IMPULSE


@inner_with_memory
def approach_rate(g, rate, second, h):  # type: ignore[no-untyped-def]
    """Return the rate at which a gap closes, from its value g, rate and second rate at most a time h earlier."""
    if g <= 0.0:
        return min(rate, 0.0)
    square = rate * rate - 2.0 * second * g
    if square <= 0.0:
        return 0.0
    return -min(np.sqrt(square), abs(rate) + abs(second) * h)


@inner_with_memory
def _gap_rates_with(p, w, s, t, touched, g, rate, second):  # type: ignore[no-untyped-def]
    """Fill gaps (items,) and their first and second rates at state s and time t, with the active set ``touched``."""
    fix_active_set(p, touched)
    signals_at(p, t, w.amps)
    gap_rates(p, w, s.z, s.v, s.a, g, rate, second)


@inner_with_memory
def _impulses(p, w, end, t, touched, approach, out):  # type: ignore[no-untyped-def]
    """Fill out (items,) with the impulses that change gap rates from ``approach`` (n,) to those at ``end``.

    They belong to items that are CLOSED in ``touched``. Returns whether they are determined.
    """
    n = len(touched)
    g, rate, second, rhs = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(len(end.z))
    _gap_rates_with(p, w, end, t, touched, g, rate, second)
    for i in range(n):
        if touched[i] == CLOSED:
            k = p.place[p.points.multiplier[i]]
            rhs[k] = rate[i] - approach[k]
    if not factored_constraints(p, w, w.A):
        return False
    calls.solve(p.calls, (p, w.A, rhs))
    for i in range(n):
        out[i] = -rhs[p.place[p.points.multiplier[i]]] if touched[i] == CLOSED else 0.0
    return True


@inner_with_memory
def record_impulses(p, w, s, end, t, h, touched):  # type: ignore[no-untyped-def]
    """Store in s.numbers the sum and number of the impulses at the end of the step from s at t, and the largest's item.

    The history variables of the items are restored.
    """
    n, kept = len(touched), np.zeros(p.points.mem.shape)
    copy_rows(p.points.mem, kept)
    g, rate, second, force, approach = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(len(end.z))
    _gap_rates_with(p, w, s, t, touched, g, rate, second)
    for i in range(n):
        if closed_in_step(p, s, touched, i):
            approach[p.place[p.points.multiplier[i]]] = approach_rate(g[i], rate[i], second[i], h)
    s.numbers[IMPACT_POINTS], s.numbers[IMPULSE], most = 0.0, 0.0, 0.0
    if _impulses(p, w, end, t + h, touched, approach, force):
        for i in range(n):
            if force[i] > 0.0:
                s.numbers[IMPACT_POINTS] += 1.0
                s.numbers[IMPULSE] += force[i]
            if force[i] > most:
                s.numbers[IMPACT_ITEM], most = 1.0 + i, force[i]
    copy_rows(kept, p.points.mem)


@inner_with_memory
def work_of_obstacles(p, w, end, t, touched, approach, obstacle_speed):  # type: ignore[no-untyped-def]
    """Return an upper bound of the work of moving obstacles in an impact on items that are CLOSED in ``touched``.

    It is the work of the impulses that change gap rates from ``approach`` (n,) to those at ``end``, and of the largest
    friction. ``obstacle_speed`` (items,) : speeds of the obstacles. inf if the impulses are not determined.
    """
    work, force, rest = 0.0, np.zeros(len(touched)), np.zeros(len(w.d))
    if not _impulses(p, w, end, t, touched, approach, force):
        return np.inf
    for i in range(len(touched)):
        if force[i] > 0.0:
            work += force[i] * obstacle_speed[i]
            if p.points.par[i, FRICTION] > 0.0:
                w.other[:] = 0.0
                along = calls.point_slip(p.calls, (p.points, i, w.d, rest, w.amps, w.other))
                work += p.points.par[i, FRICTION] * force[i] * abs(along)
    return work
