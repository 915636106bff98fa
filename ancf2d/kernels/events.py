"""Conditions that something waits for: when in a step they come to hold, by the step's interpolation."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import calls
from .dynamics import to_full
from .feedback import tell
from .lowlevel.arrays import copy
from .lowlevel.jit import addressed, inner, kernel
from .motion import evaluate, evaluate_with_gradient

# of a condition: nothing waits for it; it is waited for; it holds where the motion has come to an event
PASSED, WAITING, HOLDS = range(3)
# what an answer says: no condition holds, one does, one has no value
NONE, SOME, NO_VALUE = 0, 1, -1
# a step is looked at in so many places
LOOKS = 8
# of the time: two of so many floats are one, and all that comes to hold between is one event
FLOAT, FLOATS = 2.220446049250313e-16, 4.0
# of a step that is to end at an event: how far behind its end that is looked for, and how often it is aimed at
BEYOND, TRIES = 0.05, 8
# where in a step: nowhere
NOWHERE = 2.0


@kernel
def holding(p, w, z, v, t):  # type: ignore[no-untyped-def]
    """Mark the conditions that hold at unknowns z with rates v at t; return NONE, SOME or NO_VALUE."""
    f = p.feedback
    evaluate(p.programs, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    tell(f, w.d, w.v)
    first, found = len(f.row) + f.states, NONE
    for k in range(len(f.watched)):
        if f.watched[k] == PASSED:
            continue
        evaluate_with_gradient(f.programs, first + k, t, f.values, f.slopes)
        if np.isnan(f.slopes[0]):
            return NO_VALUE
        f.watched[k] = WAITING
        if f.slopes[0] != 0.0:
            f.watched[k] = HOLDS
            found = SOME
    return found


@inner
def interpolate(m, p, s, h, x, z, v, a):  # type: ignore[no-untyped-def]
    """Fill z, v, a at the fraction x of the step from s to m.end."""
    basis, dense = m.basis, m.end.dense
    copy(s.z, z)
    v[:] = 0.0
    a[:] = 0.0
    for k in range(len(basis)):
        f0, f1, f2 = 0.0, 0.0, 0.0
        for j in range(basis.shape[1] - 1, -1, -1):
            f2 = f2 * x + 2.0 * f1
            f1 = f1 * x + f0
            f0 = f0 * x + basis[k, j]
        for i in range(len(z)):
            z[i] += f0 * dense[k, i]
            v[i] += f1 / h * dense[k, i] * p.coordinate[i]
            a[i] += f2 / (h * h) * dense[k, i] * p.coordinate[i]


@inner
def _within(p, w, s, m, at, t, h, x):  # type: ignore[no-untyped-def]
    """Do as ``holding`` at the fraction x of the step from s at t."""
    interpolate(m, p, s, h, x, at.z, at.v, at.a)
    return holding(p, w, at.z, at.v, t + x * h)


@addressed
def crossing(p, w, s, m, at, t, h, beyond):  # type: ignore[no-untyped-def]
    """Return the fraction of the step from s at t at which a condition comes to hold, up to 1 + ``beyond``.

    NOWHERE where none does, NO_VALUE where one has none. What holds there, to round-off, is marked.
    """
    low, high, found = 0.0, 0.0, NONE
    for k in range(1, LOOKS + 2):
        if k > LOOKS and beyond == 0.0:
            break
        high = k / LOOKS if k <= LOOKS else 1.0 + beyond
        found = _within(p, w, s, m, at, t, h, high)
        if found != NONE:
            break
        low = high
    if found != SOME:
        return NOWHERE if found == NONE else -1.0
    while True:
        middle = 0.5 * (low + high)
        if not t + low * h < t + middle * h < t + high * h:
            break
        found = _within(p, w, s, m, at, t, h, middle)
        if found == NO_VALUE:
            return -1.0
        if found == SOME:
            high = middle
        else:
            low = middle
    _within(p, w, s, m, at, t, h, high + 2.0 * FLOATS * FLOAT * (t + h) / h)
    return high


@inner
def aim(m, p, w, s, at, t, h, room, aims):  # type: ignore[no-untyped-def]
    """Return whether a step from t ends at an event or has none in it, and else how long it has to be.

    Steps are aimed at an event until they end there, so that the state there is one of the integrator; ``room`` is
    how long they may be, ``aims`` how often that was tried. A length below 0 means that a condition has no value, and
    0 that the event is where the step begins.
    """
    x = calls.crossing(p.calls, (p, w, s, m, at, t, h, BEYOND if aims > 0 else 0.0))
    if x < 0.0:
        return False, -1.0, False
    near = FLOATS * FLOAT * (t + h)
    if x == NOWHERE or (aims >= TRIES and x > 1.0) or (x > 1.0 and h >= room):
        return True, h, False
    if abs(x - 1.0) * h <= near or aims >= TRIES:
        return True, h, True
    return False, 0.0 if x * h <= near else min(x * h, room), False


def event_functions(problem: Any, accept: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the functions that the table of a model of this type has where something waits for conditions."""
    return {calls.holding: (holding, problem), calls.crossing: (crossing, problem), calls.feedback_accept: accept}
