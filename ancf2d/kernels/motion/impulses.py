"""Impulses of an impact across what is hit, and the work that obstacles which move do by them."""

from __future__ import annotations

import numpy as np

from ...elements.contact_geometry import CLOSED, FRICTION, HELD
from .. import calls
from ..lowlevel.arrays import copy_rows
from ..lowlevel.jit import inner_with_memory
from .consistent import factored_constraints, gap_rates
from .contact_steps import closes
from .dynamics import signals_at
from .state import HIT_AT, HIT_POINTS, IMPULSE


@inner_with_memory
def approach_from(g, rate, second, h):  # type: ignore[no-untyped-def]
    """Return the rate at which a gap closes that had g, its rate and second rate a time of at most h before."""
    if g <= 0.0:
        return min(rate, 0.0)
    square = rate * rate - 2.0 * second * g
    if square <= 0.0:
        return 0.0
    return -min(np.sqrt(square), abs(rate) + abs(second) * h)


@inner_with_memory
def _rates(p, w, s, t, touched, g, rate, second):  # type: ignore[no-untyped-def]
    """Fill gaps (items,) and their first and second rates at a state s at t, of items as they ``touched``."""
    for i in range(len(touched)):
        if p.points.restitution[i] >= 0.0:
            p.points.mem[i, HELD] = touched[i]
    signals_at(p, t, w.amps)
    gap_rates(p, w, s.z, s.v, s.a, g, rate, second)


@inner_with_memory
def _impulses(p, w, end, t, touched, approach, out):  # type: ignore[no-untyped-def]
    """Fill the impulses (items,) of those that were CLOSED in ``touched``, which change rates of gaps from ``approach``
    (n,) to those at the end; return whether they are known.
    """
    n = len(touched)
    g, rate, second, rhs = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(len(end.z))
    _rates(p, w, end, t, touched, g, rate, second)
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
def note_impulses(p, w, s, end, t, h, touched):  # type: ignore[no-untyped-def]
    """Note how large the impulses of an impact at the end of the step from s at t are, of how many items, and which is
    the largest; what items remember stays.
    """
    n, kept = len(touched), np.zeros(p.points.mem.shape)
    copy_rows(p.points.mem, kept)
    g, rate, second, force, approach = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(len(end.z))
    _rates(p, w, s, t, touched, g, rate, second)
    for i in range(n):
        if closes(p, s, touched, i):
            approach[p.place[p.points.multiplier[i]]] = approach_from(g[i], rate[i], second[i], h)
    s.numbers[HIT_POINTS], s.numbers[IMPULSE], most = 0.0, 0.0, 0.0
    if _impulses(p, w, end, t + h, touched, approach, force):
        for i in range(n):
            if force[i] > 0.0:
                s.numbers[HIT_POINTS] += 1.0
                s.numbers[IMPULSE] += force[i]
            if force[i] > most:
                s.numbers[HIT_AT], most = 1.0 + i, force[i]
    copy_rows(kept, p.points.mem)


@inner_with_memory
def given_in_impact(p, w, end, t, touched, approach, pushed):  # type: ignore[no-untyped-def]
    """Return the work at most that obstacles which move do in an impact on items that were CLOSED in ``touched``: that
    of the impulses which change rates of gaps from ``approach`` (n,) to those at the end, and of the largest friction.
    """
    given, force, rest = 0.0, np.zeros(len(touched)), np.zeros(len(w.d))
    if not _impulses(p, w, end, t, touched, approach, force):
        return np.inf
    for i in range(len(touched)):
        if force[i] > 0.0:
            given += force[i] * pushed[i]
            if p.points.par[i, FRICTION] > 0.0:
                w.other[:] = 0.0
                along = calls.point_slip(p.calls, (p.points, i, w.d, rest, w.amps, w.other))
                given += p.points.par[i, FRICTION] * force[i] * abs(along)
    return given
