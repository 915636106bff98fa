"""Radau's method with contacts without a law: steps in which none opens or closes, and backward Euler steps between.

In a step of Radau's method, points that press at its start are closed at all stages, and all others open: nothing is
lost of its order. Afterwards its interpolation tells where an open point would be in what it touches, or a closed one
pull. The step is then made again so that it ends just before that, and a short step by the backward Euler method
follows, which finds by Newton's method what is closed at its end and has the impacts (``impact``). From there Radau's
method begins anew. Where the next such place is no further away than a backward Euler step within the tolerance is
long, that step is made at once: what opens and closes all the time takes no more steps than the tolerance asks for.
With fixed steps, backward Euler steps grow until a longer step of Radau's method succeeds, so that each has few parts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...elements.contact_geometry import CLOSED, FREE, HELD, OPEN
from .. import calls
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed, inner, seldom
from ..patches import patch_forces
from .contact_steps import go_straight, let_choose
from .dynamics import norm, signals_at, to_full
from .events import NOWHERE, interpolate
from .newmark import newmark_inside
from .radau import radau_restart
from .state import (
    DONE,
    EULER,
    FRESH,
    HELD_STEP,
    INTO_SUPPORTS,
    LAST,
    NEXT,
    OLD_STEP,
    SIZE,
    STEP_SIZE,
    SWITCHES,
    TRIES,
    UNCUT,
)

# a step is looked at in so many places, and the way to where something opens or closes is halved so often
LOOKS, HALVINGS = 8, 40
# of the extent: gaps that are none; of the largest force of a contact: those that do not pull
GRAZES, PULLS = 1e-11, 1e-9
# of the tolerance: how far from a surface a step may end before a point closes; at least this share of the extent
NEAR, NEAREST = 0.1, 1e-10
# of fixed steps: so long is the first backward Euler step, and so far from a surface [size] may the step before it end
PART, FIXED = 1e-2, 1e-9
# of a step: over such a way is the rate of a gap taken
BESIDE = 1e-3


class Switched(NamedTuple):
    """radau, euler : addresses of the records of the two methods, which end in the same Step; calls : table of their
    functions (``kernels.calls``); tolerance : of adaptive steps, 0 of fixed ones.

    basis : as of ``Method``; end, at : Steps, at to interpolate in; held (items,) : whether points are CLOSED in the
    step; looks (3, items) : how far they are from a change, in three places; made (1,) : whether the step at hand is
    one by the backward Euler method.
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
def _hold(p, s, held):  # type: ignore[no-untyped-def]
    """Hold closed what presses, and open what does not; return whether something is closed."""
    closes = False
    for i in range(len(held)):
        if p.points.restitution[i] >= 0.0:
            held[i] = CLOSED if s.z[p.place[p.points.multiplier[i]]] < 0.0 else OPEN
            p.points.mem[i, HELD] = held[i]
            closes |= held[i] == CLOSED
    return closes


@inner
def _look(p, w, s, own, t, h, x, out):  # type: ignore[no-untyped-def]
    """Fill out (items,) with how far points are from a change at the fraction x of the step; return whether one is
    below 0: forces of closed ones, gaps of open ones.
    """
    at, largest, changes = own.at, 0.0, False
    interpolate(own, p, s, h, x, at.z, at.v, at.a)
    signals_at(p, t + x * h, w.amps)
    to_full(p, at.z, w.amps, 0, w.d)
    to_full(p, at.v, w.amps, 1, w.v)
    for i in range(len(out)):
        if p.points.restitution[i] >= 0.0:
            p.points.mem[i, HELD] = CLOSED
            largest = max(largest, abs(at.z[p.place[p.points.multiplier[i]]]))
    w.other[:] = 0.0
    patch_forces(p, w.d, w.v, w.amps, w.other)
    for i in range(len(out)):
        out[i] = np.inf
        if p.points.restitution[i] >= 0.0 and p.points.mem[i, FREE] >= 0.0:
            k = p.points.multiplier[i]
            if own.held[i] == CLOSED:
                out[i] = PULLS * largest - at.z[p.place[k]]
            elif w.other[k] != 0.0:
                # 0 where nothing is opposite
                out[i] = w.other[k] + GRAZES * p.extent
            changes |= out[i] < 0.0
    if not changes:
        return False
    # whether it faces what it is in is not seen by the gap
    let_choose(p)
    w.other[:] = 0.0
    calls.point_sides(p.calls, (p.points, w.d, w.v, w.amps, w.other))
    changes = False
    for i in range(len(out)):
        if out[i] < 0.0:
            if own.held[i] == OPEN and w.other[p.points.multiplier[i]] == 0.0:
                out[i] = np.inf
            changes |= out[i] < 0.0
    return changes


@inner
def _lowest(own, x):  # type: ignore[no-untyped-def]
    """Return where the lowest of three neighbouring looks, the last at x, lets the parabola through them fall below 0.

    NOWHERE where none does.
    """
    for i in range(len(own.held)):
        a, b, c = own.looks[0, i], own.looks[1, i], own.looks[2, i]
        if b <= a and b <= c and c < np.inf and a < np.inf and a + c > 2.0 * b:
            slope, bend = 0.5 * (c - a), a - 2.0 * b + c
            if b - 0.5 * slope * slope / bend < 0.0:
                return x - (1.0 + slope / bend) / LOOKS
    return NOWHERE


@inner
def _first(p, w, s, own, t, h):  # type: ignore[no-untyped-def]
    """Return where in the step a first point changes, to round-off, NOWHERE if none does; looks[2] is what is there."""
    low, high = 0.0, NOWHERE
    own.looks[:] = np.inf
    for n in range(LOOKS + 1):
        copy(own.looks[1], own.looks[0])
        copy(own.looks[2], own.looks[1])
        if _look(p, w, s, own, t, h, n / LOOKS, own.looks[2]) and n > 0:
            high = n / LOOKS
            break
        lowest = _lowest(own, n / LOOKS) if n > 1 else NOWHERE
        if lowest != NOWHERE and _look(p, w, s, own, t, h, lowest, own.looks[0]):
            high, low = lowest, (n - 2) / LOOKS
            break
        if n > 0:
            low = (n - 1) / LOOKS
    if high == NOWHERE:
        return NOWHERE
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _look(p, w, s, own, t, h, middle, own.looks[2]):
            high = middle
        else:
            low = middle
    _look(p, w, s, own, t, h, high, own.looks[2])
    return high


@inner
def _euler_length(p, s, own, h):  # type: ignore[no-untyped-def]
    """Return how long a backward Euler step within the tolerance is, its error h^2 a/2 if none was made before."""
    if own.tolerance == 0.0:
        return max(s.numbers[EULER], PART * max(s.numbers[STEP_SIZE], s.numbers[UNCUT]))
    if s.numbers[EULER] > 0.0:
        return s.numbers[EULER]
    pull = norm(p, s.a)
    return min(np.sqrt(2.0 * own.tolerance * s.numbers[SIZE] / pull), h) if pull > 0.0 else h


@inner
def _closing_time(p, w, s, own, t, h, x):  # type: ignore[no-untyped-def]
    """Return how long the points that close at the fraction x of the step take for the way that they may be off."""
    size = max(s.numbers[SIZE], 1e-3 * p.extent)
    allowed = max((NEAR * own.tolerance if own.tolerance > 0.0 else FIXED) * size, NEAREST * p.extent)
    before, time = max(0.0, x - BESIDE), np.inf
    _look(p, w, s, own, t, h, before, own.looks[1])
    for i in range(len(own.held)):
        if own.held[i] == OPEN and own.looks[2, i] < 0.0:
            fallen = own.looks[1, i] - own.looks[2, i]
            if fallen > 0.0:
                time = min(time, allowed * (x - before) * h / fallen)
    return time


@inner
def _switches(p, w, s, own, t, h):  # type: ignore[no-untyped-def]
    """Return whether a point changes in the step, which then has to be made again as STEP_SIZE or NEXT says."""
    x = _first(p, w, s, own, t, h)
    if x == NOWHERE:
        return False
    euler = _euler_length(p, s, own, h)
    near = min(_closing_time(p, w, s, own, t, h, x), euler)
    # further before it the more often that was tried
    sooner = x * h - 0.5 * near * 2.0 ** s.numbers[TRIES]
    if x * h > euler and sooner > 0.5 * euler:
        s.numbers[STEP_SIZE], s.numbers[UNCUT] = sooner, max(s.numbers[UNCUT], s.numbers[STEP_SIZE])
    else:
        s.numbers[NEXT], s.numbers[EULER] = max(x * h + 0.5 * near, euler if s.numbers[LAST] > 0.0 else 0.0), euler
    return True


@addressed
@seldom
def switched_step(p, w, s, own, t, h):  # type: ignore[no-untyped-def]
    """Step from the motion s at t to own.end; return (outcome, iterations, error [m], contraction)."""
    own.made[0] = s.numbers[NEXT]
    if s.numbers[NEXT] > 0.0:
        s.numbers[FRESH] = 1.0
        outcome, iterations, error, rate = calls.euler_step(own.calls, (p, w, s, own.euler, t, h))
        go_straight(own.end, s)
        return outcome, iterations, error, rate
    signals_at(p, t, w.amps)
    calls.leave_supported(p.calls, (p, w, s.z))
    closes = _hold(p, s, own.held)
    outcome, iterations, error, rate = calls.radau_step(own.calls, (p, w, s, own.radau, t, h))
    if outcome != DONE:
        # where nothing is closed, no contact is the cause: a shorter step helps
        if closes and not h > 2.0 * _euler_length(p, s, own, h):
            s.numbers[NEXT], outcome = h, SWITCHES
    else:
        # a step that is too long for its error is made again anyway
        fine = own.tolerance == 0.0 or error <= own.tolerance * max(s.numbers[SIZE], norm(p, own.end.z))
        if fine and _switches(p, w, s, own, t, h):
            outcome = SWITCHES
        elif calls.into_supports(p.calls, (p, w, own.end.z)):
            outcome = INTO_SUPPORTS
    let_choose(p)
    return outcome, iterations, error, rate


@addressed
def switched_accept(s, own):  # type: ignore[no-untyped-def]
    """Keep what the next step needs."""
    if not own.made[0] > 0.0:
        calls.radau_accept(own.calls, (s, own.radau))


@addressed
def switched_go_on(s, own):  # type: ignore[no-untyped-def]
    """Begin anew behind a backward Euler step."""
    s.numbers[OLD_STEP] = s.numbers[HELD_STEP] = 0.0


@addressed
def switched_inside(p, own, h, x):  # type: ignore[no-untyped-def]
    """Let materials that relax be as they are at the fraction x of the step."""
    if own.made[0] > 0.0:
        newmark_inside(p, own.euler, h, x)
    else:
        calls.radau_inside(own.calls, (p, own.radau, h, x))


@addressed
def switched_taken(p, w, own, x):  # type: ignore[no-untyped-def]
    """Return the energy that internal strains take at the fraction x of a step, in the time of the step.

    0 where those are not solved at stages: the laws know it.
    """
    return 0.0 if own.made[0] > 0.0 else calls.radau_taken(own.calls, (p, w, own.radau, x))


def switched_restart(m: Any, s: Any) -> None:
    """Begin anew, with steps of Radau's method."""
    radau_restart(m, s)
    s.numbers[[NEXT, EULER, LAST, UNCUT]] = 0.0
