"""Events: steps end where a condition that is waited for becomes true, which the step's interpolation locates."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import calls
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed, inner, kernel, seldom
from .dynamics import signals_at, to_full
from .feedback import fill_quantities
from .state import evaluate_with_gradient

# state of a condition: not waited for; waited for and false; true
PASSED, WAITING, HOLDS = range(3)
# results: no condition is true, at least one is, one has no value (nan)
NONE, SOME, NO_VALUE = 0, 1, -1
# samples of a step, and halvings of the interval around a maximum of a margin
SAMPLES, HALVINGS = 8, 20
# relative spacing of floats, and how many of these spacings apart two times count as one event
FLOAT, FLOATS = 2.220446049250313e-16, 4.0
# a step that should end at an event: how far beyond its end the event is searched, and most tries to hit it
BEYOND, TRIES = 0.05, 8
# returned instead of a fraction of a step if there is none
NOWHERE = 2.0


@kernel
@seldom
def check_conditions(p, w, z, v, t):  # type: ignore[no-untyped-def]
    """Mark in p.feedback.watched the conditions that are true at unknowns z, rates v and time t.

    Returns NONE, SOME or NO_VALUE.
    """
    f = p.feedback
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    fill_quantities(f, w.d, w.v)
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
    """Same as ``check_conditions``, at the fraction x of the step from s at t."""
    interpolate(m, p, s, h, x, at.z, at.v, at.a)
    return check_conditions(p, w, at.z, at.v, t + x * h)


@inner
def _fill_quantities_at(p, w, s, m, at, t, h, x):  # type: ignore[no-untyped-def]
    """Evaluate the quantities of conditions at the fraction x of the step from s at t."""
    interpolate(m, p, s, h, x, at.z, at.v, at.a)
    signals_at(p, t + x * h, w.amps)
    to_full(p, at.z, w.amps, 0, w.d)
    to_full(p, at.v, w.amps, 1, w.v)
    fill_quantities(p.feedback, w.d, w.v)


@inner
def _margin(f, k, t):  # type: ignore[no-untyped-def]
    """Return the margin of condition k at t, positive where it is true, with the current quantities."""
    evaluate_with_gradient(f.programs, len(f.row) + f.states + len(f.watched) + k, t, f.values, f.slopes)
    return f.slopes[0]


@inner
def _highest(p, w, s, m, at, t, h, k, x, half):  # type: ignore[no-untyped-def]
    """Return a fraction of the step at which condition k is true near the maximum of its margin, or NOWHERE.

    The stored margins are those at x - half, x and x + half, with the largest in the middle. The interval is halved
    until its curvature rules out that a margin in it reaches 0.
    """
    f = p.feedback
    first = 1 + len(f.values) + 3 * k
    a, b, c = f.slopes[first], f.slopes[first + 1], f.slopes[first + 2]
    for _ in range(HALVINGS):
        if not b + (2.0 * b - a - c) >= 0.0:
            return NOWHERE
        half *= 0.5
        _fill_quantities_at(p, w, s, m, at, t, h, x - half)
        left = _margin(f, k, t + (x - half) * h)
        _fill_quantities_at(p, w, s, m, at, t, h, x + half)
        right = _margin(f, k, t + (x + half) * h)
        if left > b and left >= right:
            a, b, c, x = a, left, b, x - half
        elif right > b:
            a, b, c, x = b, right, c, x + half
        else:
            a, c = left, right
        if b >= 0.0 and 0.0 < x <= 1.0 and _within(p, w, s, m, at, t, h, x) == SOME:
            return x
    return NOWHERE


@inner
def _between(p, w, s, m, at, t, h, n):  # type: ignore[no-untyped-def]
    """Return a fraction of the step between samples n - 2 and n at which a condition is true that is false at both.

    NOWHERE if there is none. Call it with the quantities at sample n; it stores the margins there.
    """
    f, x = p.feedback, n / SAMPLES
    for k in range(len(f.watched)):
        first = 1 + len(f.values) + 3 * k
        f.slopes[first], f.slopes[first + 1] = f.slopes[first + 1], f.slopes[first + 2]
        f.slopes[first + 2] = _margin(f, k, t + x * h)
    for k in range(len(f.watched)):
        first = 1 + len(f.values) + 3 * k
        a, b, c = f.slopes[first], f.slopes[first + 1], f.slopes[first + 2]
        if n > 0 and f.watched[k] != PASSED and b > a and b >= c and b <= 0.0:
            found = _highest(p, w, s, m, at, t, h, k, x - 1.0 / SAMPLES, 1.0 / SAMPLES)
            if found != NOWHERE:
                return found
    return NOWHERE


@addressed
@seldom
def event_crossing(p, w, s, m, at, t, h, beyond):  # type: ignore[no-untyped-def]
    """Return the fraction of the step from s at t, up to 1 + ``beyond``, at which the first condition becomes true.

    NOWHERE if none does, NO_VALUE if one has no value. Conditions that are true there, to round-off, are marked.
    Margins are also sampled one interval before and after the step, to find maxima near its ends.
    """
    low, high, found = 0.0, 0.0, NONE
    for n in range(-1, SAMPLES + 2):
        x, here = n / SAMPLES, NONE
        if 0 < n <= SAMPLES:
            here = _within(p, w, s, m, at, t, h, x)
        else:
            _fill_quantities_at(p, w, s, m, at, t, h, x)
        high = _between(p, w, s, m, at, t, h, n)
        if high != NOWHERE:
            found, low = SOME, max(0.0, (n - 2) / SAMPLES)
            break
        if here != NONE:
            found, high = here, x
            break
        if 0 < n <= SAMPLES:
            low = x
    if found == NONE and beyond > 0.0:
        high = 1.0 + beyond
        found = _within(p, w, s, m, at, t, h, high)
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
    # round-off of interpolated rates may make a condition false again just behind the event
    if _within(p, w, s, m, at, t, h, high + 2.0 * FLOATS * FLOAT * (t + h) / h) != SOME:
        _within(p, w, s, m, at, t, h, high)
    return high


@inner
def aim_at_event(m, p, w, s, at, t, h, room, aims):  # type: ignore[no-untyped-def]
    """Return (accepted, step size, event): whether a step from t has no event inside, and if not, the size to try next.

    ``event`` tells whether the step ends at an event. Steps are repeated until they end at the event, so that the state
    there is one of the integrator. ``room`` is the largest size allowed, ``aims`` the number of tries so far. A size
    below 0 means that a condition has no value, 0 that the event is at the start of the step.
    """
    x = calls.event_crossing(p.calls, (p, w, s, m, at, t, h, BEYOND if aims > 0 else 0.0))
    if x < 0.0:
        return False, -1.0, False
    near = FLOATS * FLOAT * (t + h)
    if x == NOWHERE or (aims >= TRIES and x > 1.0) or (x > 1.0 and h >= room):
        return True, h, False
    if abs(x - 1.0) * h <= near or aims >= TRIES:
        return True, h, True
    return False, 0.0 if x * h <= near else min(x * h, room), False


def event_functions(problem: Any, accept: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries of the table of a model with conditions to wait for (``kernels.calls.table``)."""
    return {calls.check_conditions: (check_conditions, problem), calls.event_crossing: (event_crossing, problem),
            calls.feedback_accept: accept}
