"""Radau's method with hard contacts: steps with a fixed active set, and backward Euler steps where the set changes.

In a Radau step, points that press at its start are closed at all stages and all others are open, so the step keeps its
order. Its interpolation then shows where an open point would penetrate or a closed one would pull. The step is repeated
to end just before that, and followed by a short backward Euler step, in which Newton's method finds the active set at
its end and impacts occur (``impact``). Radau's method then restarts. If the next change is closer than the size of a
backward Euler step within the tolerance, that step is made at once, so that contacts which open and close all the time
take no more steps than the tolerance requires. With fixed steps, backward Euler steps grow until a longer Radau step
succeeds, so that each fixed step has few parts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...elements.contact_geometry import CLOSED, OPEN, PLACEMENT, STATUS
from .. import calls
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed, inner, seldom
from ..patches import patch_forces
from .contact_steps import interpolate_linearly, unfix_active_set
from .dynamics import norm, signals_at, to_full
from .events import NOWHERE, interpolate
from .newmark import newmark_inside
from .radau import radau_restart
from .state import (
    DONE,
    GOOD_EULER,
    INTO_SUPPORTS,
    LAST_EULER,
    NEXT_EULER,
    OLD_STEP,
    PREDICTION,
    SIZE,
    STARTS_CONSISTENT,
    STEP_SIZE,
    SWITCHES,
    TANGENT_STEP,
    TRIES,
    UNCUT_RADAU,
)

# samples of a step, and halvings of the interval in which a point opens or closes
SAMPLES, HALVINGS = 8, 40
# fraction of the extent: smaller penetrations are ignored; of the largest contact force: smaller pulls are ignored
IGNORED_PENETRATION, IGNORED_PULL = 1e-11, 1e-9
# largest gap at the end of a step before a point closes: this fraction of the tolerance, and at least of the extent
GAP_SHARE, LEAST_GAP = 0.1, 1e-10
# fixed steps: fraction of the step for the first backward Euler step, and largest gap before it [size of the motion]
FIRST_EULER, FIXED_STEP_GAP = 1e-2, 1e-9
# fraction of a step for the difference quotient of a gap
DIFFERENCE = 1e-3


class Switched(NamedTuple):
    """Radau's method and the backward Euler method, with the data to switch between them.

    radau, euler : addresses of the records of the two methods, which share one Step as end; calls : table of their
    functions (``kernels.calls``); tolerance : of adaptive steps, 0 for fixed ones; basis : as in ``Method``; end, at :
    Steps, ``at`` for interpolated states; held (items,) : CLOSED or OPEN, state of the points in the step; looks
    (3, items) : distance of the points to a change, at three samples; made (1,) : size NEXT_EULER of the current step
    if it is a backward Euler step, else 0.
    """

    radau: int
    euler: int
    calls: Any
    tolerance: float
    basis: Any
    end: Any
    at: Any
    held: Any
    looks: Any
    made: Any


@inner
def _fix_active_set(p, s, held):  # type: ignore[no-untyped-def]
    """Fix the active set of a step: points that press at s are closed, the others open; return whether any is closed.
    """
    closes = False
    for i in range(len(held)):
        if p.points.restitution[i] >= 0.0:
            held[i] = CLOSED if s.z[p.place[p.points.multiplier[i]]] < 0.0 else OPEN
            p.points.mem[i, STATUS] = held[i]
            closes |= held[i] == CLOSED
    return closes


@inner
def _distances_to_change(p, w, s, own, t, h, x, out):  # type: ignore[no-untyped-def]
    """Fill out (items,) with the distance of points to a change at the fraction x of the step: force of closed points,
    gap of open ones, inf for others; return whether one is below 0, so that the point must change.
    """
    at, largest, changes = own.at, 0.0, False
    interpolate(own, p, s, h, x, at.z, at.v, at.a)
    signals_at(p, t + x * h, w.amps)
    to_full(p, at.z, w.amps, 0, w.d)
    to_full(p, at.v, w.amps, 1, w.v)
    for i in range(len(out)):
        if p.points.restitution[i] >= 0.0:
            p.points.mem[i, STATUS] = CLOSED
            largest = max(largest, abs(at.z[p.place[p.points.multiplier[i]]]))
    w.other[:] = 0.0
    patch_forces(p, w.d, w.v, w.amps, w.other)
    for i in range(len(out)):
        out[i] = np.inf
        if p.points.restitution[i] >= 0.0 and p.points.mem[i, PLACEMENT] >= 0.0:
            k = p.points.multiplier[i]
            if own.held[i] == CLOSED:
                out[i] = IGNORED_PULL * largest - at.z[p.place[k]]
            elif w.other[k] != 0.0:
                # a gap of exactly 0 means that the point faces nothing
                out[i] = w.other[k] + IGNORED_PENETRATION * p.extent
            changes |= out[i] < 0.0
    if not changes:
        return False
    # a negative gap counts only if the point closes there by its own choice, e.g. not at the back of an obstacle
    unfix_active_set(p)
    w.other[:] = 0.0
    calls.mark_closed_points(p.calls, (p.points, w.d, w.v, w.amps, w.other))
    changes = False
    for i in range(len(out)):
        if out[i] < 0.0:
            if own.held[i] == OPEN and w.other[p.points.multiplier[i]] == 0.0:
                out[i] = np.inf
            changes |= out[i] < 0.0
    return changes


@inner
def _negative_minimum(own, x):  # type: ignore[no-untyped-def]
    """Return where the parabola through a point's last three samples, the last at x, has a negative minimum.

    NOWHERE if there is none.
    """
    for i in range(len(own.held)):
        a, b, c = own.looks[0, i], own.looks[1, i], own.looks[2, i]
        if b <= a and b <= c and c < np.inf and a < np.inf and a + c > 2.0 * b:
            slope, bend = 0.5 * (c - a), a - 2.0 * b + c
            if b - 0.5 * slope * slope / bend < 0.0:
                return x - (1.0 + slope / bend) / SAMPLES
    return NOWHERE


@inner
def _first_change(p, w, s, own, t, h):  # type: ignore[no-untyped-def]
    """Return the fraction of the step at which the first point changes, to round-off, or NOWHERE.

    looks[2] is the sample there.
    """
    low, high = 0.0, NOWHERE
    own.looks[:] = np.inf
    for n in range(SAMPLES + 1):
        copy(own.looks[1], own.looks[0])
        copy(own.looks[2], own.looks[1])
        if _distances_to_change(p, w, s, own, t, h, n / SAMPLES, own.looks[2]) and n > 0:
            high = n / SAMPLES
            break
        lowest = _negative_minimum(own, n / SAMPLES) if n > 1 else NOWHERE
        if lowest != NOWHERE and _distances_to_change(p, w, s, own, t, h, lowest, own.looks[0]):
            high, low = lowest, (n - 2) / SAMPLES
            break
        if n > 0:
            low = (n - 1) / SAMPLES
    if high == NOWHERE:
        return NOWHERE
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _distances_to_change(p, w, s, own, t, h, middle, own.looks[2]):
            high = middle
        else:
            low = middle
    _distances_to_change(p, w, s, own, t, h, high, own.looks[2])
    return high


@inner
def _euler_step_size(p, s, own, h):  # type: ignore[no-untyped-def]
    """Return the size of a backward Euler step that meets the tolerance, estimated from its error h^2 a/2 at first."""
    if own.tolerance == 0.0:
        return max(s.numbers[GOOD_EULER], FIRST_EULER * max(s.numbers[STEP_SIZE], s.numbers[UNCUT_RADAU]))
    if s.numbers[GOOD_EULER] > 0.0:
        return s.numbers[GOOD_EULER]
    pull = norm(p, s.a)
    return min(np.sqrt(2.0 * own.tolerance * s.numbers[SIZE] / pull), h) if pull > 0.0 else h


@inner
def _closing_time(p, w, s, own, t, h, x):  # type: ignore[no-untyped-def]
    """Return the time in which points that close at the fraction x of the step move by the gap allowed before closing.
    """
    size = max(s.numbers[SIZE], 1e-3 * p.extent)
    allowed = max((GAP_SHARE * own.tolerance if own.tolerance > 0.0 else FIXED_STEP_GAP) * size, LEAST_GAP * p.extent)
    before, time = max(0.0, x - DIFFERENCE), np.inf
    _distances_to_change(p, w, s, own, t, h, before, own.looks[1])
    for i in range(len(own.held)):
        if own.held[i] == OPEN and own.looks[2, i] < 0.0:
            fallen = own.looks[1, i] - own.looks[2, i]
            if fallen > 0.0:
                time = min(time, allowed * (x - before) * h / fallen)
    return time


@inner
def _must_switch(p, w, s, own, t, h):  # type: ignore[no-untyped-def]
    """Return whether a point changes in the step; it must then be repeated with the new STEP_SIZE or NEXT_EULER."""
    x = _first_change(p, w, s, own, t, h)
    if x == NOWHERE:
        return False
    euler = _euler_step_size(p, s, own, h)
    near = min(_closing_time(p, w, s, own, t, h, x), euler)
    # end further before the change after every failed try
    sooner = x * h - 0.5 * near * 2.0 ** s.numbers[TRIES]
    if x * h > euler and sooner > 0.5 * euler:
        s.numbers[STEP_SIZE], s.numbers[UNCUT_RADAU] = sooner, max(s.numbers[UNCUT_RADAU], s.numbers[STEP_SIZE])
    else:
        s.numbers[NEXT_EULER] = max(x * h + 0.5 * near, euler if s.numbers[LAST_EULER] > 0.0 else 0.0)
        s.numbers[GOOD_EULER] = euler
    return True


@addressed
@seldom
def switched_step(p, w, s, own, t, h):  # type: ignore[no-untyped-def]
    """Step from the motion s at t to own.end; return (outcome, iterations, error [m], contraction)."""
    own.made[0] = s.numbers[NEXT_EULER]
    if s.numbers[NEXT_EULER] > 0.0:
        s.numbers[STARTS_CONSISTENT] = 1.0
        outcome, iterations, error, rate = calls.euler_step(own.calls, (p, w, s, own.euler, t, h))
        interpolate_linearly(own.end, s)
        return outcome, iterations, error, rate
    signals_at(p, t, w.amps)
    calls.deactivate_supported(p.calls, (p, w, s.z))
    closes = _fix_active_set(p, s, own.held)
    outcome, iterations, error, rate = calls.radau_step(own.calls, (p, w, s, own.radau, t, h))
    if outcome != DONE:
        # if no point is closed, contact is not the cause: a shorter step helps
        if closes and not h > 2.0 * _euler_step_size(p, s, own, h):
            s.numbers[NEXT_EULER], outcome = h, SWITCHES
    else:
        # a step that exceeds the tolerance is repeated anyway
        fine = own.tolerance == 0.0 or error <= own.tolerance * max(s.numbers[SIZE], norm(p, own.end.z))
        if fine and _must_switch(p, w, s, own, t, h):
            outcome = SWITCHES
        elif calls.deactivated_penetrates(p.calls, (p, w, own.end.z)):
            outcome = INTO_SUPPORTS
    unfix_active_set(p)
    return outcome, iterations, error, rate


@addressed
def switched_accept(s, own):  # type: ignore[no-untyped-def]
    """Store the data of an accepted step for the next one (Radau steps only)."""
    if not own.made[0] > 0.0:
        calls.radau_accept(own.calls, (s, own.radau))


@addressed
def switched_go_on(s, own):  # type: ignore[no-untyped-def]
    """Restart Radau's method after a backward Euler step."""
    s.numbers[OLD_STEP], s.numbers[TANGENT_STEP], s.numbers[PREDICTION] = 0.0, 0.0, 2.0


@addressed
def switched_inside(p, own, h, x):  # type: ignore[no-untyped-def]
    """Set the history variables of relaxing materials to the fraction x of the step."""
    if own.made[0] > 0.0:
        newmark_inside(p, own.euler, h, x)
    else:
        calls.radau_inside(own.calls, (p, own.radau, h, x))


@addressed
def switched_taken(p, w, own, x):  # type: ignore[no-untyped-def]
    """Return the power that internal strains take at the fraction x of a step, times the step size.

    0 for backward Euler steps, where the laws themselves compute it.
    """
    return 0.0 if own.made[0] > 0.0 else calls.radau_taken(own.calls, (p, w, own.radau, x))


def switched_restart(m: Any, s: Any) -> None:
    """Restart with steps of Radau's method."""
    radau_restart(m, s)
    s.numbers[[NEXT_EULER, GOOD_EULER, LAST_EULER, UNCUT_RADAU]] = 0.0
