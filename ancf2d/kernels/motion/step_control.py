"""Step sizes, from errors, failures and times where steps must end, and the tolerance of Newton's increments."""

from __future__ import annotations

from ..lowlevel.jit import inner
from .dynamics import norm
from .state import (
    BACKWARD,
    DONE,
    FASTEST,
    GOOD_EULER,
    GRID,
    LAST_EULER,
    LIMIT,
    NEXT_EULER,
    OLD_ERROR,
    OLD_STEP,
    RATE_ERRORS,
    REJECTED,
    SIZE,
    STEP_SIZE,
    SWITCHED,
    SWITCHES,
    TIME,
    TRIES,
    UNCUT_RADAU,
)
from .work import SECOND_ORDER_ERROR

# largest growth of steps of second order methods with losses or hard contacts: motions that die out quickly, as after
# an impact, move too little to show in the errors, so each step stays short compared with the time since then
DAMPED_GROWTH = 1.4
# fraction of the step size: shorter steps are not made only to store a state
SHORT = 1e-2
# most steps in which a motion at its usual speed moves as far as its size
MOST_STEPS = 1e4
# round-off of positions, relative to the size of the motion
ROUND = 1e-15
# error of rates that is allowed in steps in which a contact opens, relative to that of others: damping removes it
OPENING = 30.0
# order of the local error of a backward Euler step
EULER_ERROR = 2
# growth of successive backward Euler steps within a fixed step
EULER_GROWTH = 8.0


@inner
def wanted_size(s):  # type: ignore[no-untyped-def]
    """Return the size of the next step as set by errors and failures, before any target limits it."""
    return s.numbers[NEXT_EULER] if s.numbers[NEXT_EULER] > 0.0 else s.numbers[STEP_SIZE]


@inner
def set_wanted_size(s, h):  # type: ignore[no-untyped-def]
    """Set the size of the next try (Radau or backward Euler, as the last one)."""
    s.numbers[NEXT_EULER if s.numbers[NEXT_EULER] > 0.0 else STEP_SIZE] = h


@inner
def size_to_target(s, last, target, sooner):  # type: ignore[no-untyped-def]
    """Return the size of the next step, which ends at ``target`` at the latest (before ``last`` if for a stored state).

    ``sooner`` : whether it should end where an impact is expected.
    """
    left = target - s.numbers[TIME]
    h = min(wanted_size(s), left)
    if left < 1.1 * h and not sooner:
        return left
    # unequal successive steps reduce accuracy: halve the rest instead of leaving a short step
    return 0.5 * left if target < last and left < 2.0 * h and not sooner and s.numbers[NEXT_EULER] == 0.0 else h


@inner
def next_size(m, p, s, h, ratio, contraction, lost, cut):  # type: ignore[no-untyped-def]
    """Return the size of the step after one of size h, from its error ``ratio`` to the tolerance (Gustafsson 1994).

    It grows only a little if Newton's method converged slowly. A step that was ``cut`` to store a state or to hit an
    event does not shorten the next one.
    """
    low, order = max(ratio, 1e-10), m.order
    factor = 0.9 * low ** (-1.0 / order)
    old = s.numbers[OLD_ERROR]
    if old > 0.0 and s.numbers[OLD_STEP] > 0.0:
        trend = h / s.numbers[OLD_STEP] * (old / (low * low)) ** (1.0 / order) * 0.9
        factor = min(factor, trend)
    largest = 4.0 if contraction < 0.3 else 1.2
    if (lost > 0.0 or p.sided) and not m.exact and order <= SECOND_ORDER_ERROR:
        largest = min(largest, DAMPED_GROWTH)
    before = s.numbers[STEP_SIZE] if cut else h
    return max(min(max(factor, 0.2) * h, largest * before), before if cut else 0.0)


@inner
def shorten(m, s, plan, outcome, h, relative):  # type: ignore[no-untyped-def]
    """Set the size of the next try after a step of size h that failed or exceeded the tolerance."""
    s.numbers[TRIES] += 1.0
    if outcome == SWITCHES:
        # the method has set the size
        return
    s.numbers[REJECTED] += 1.0
    euler = s.numbers[NEXT_EULER] > 0.0
    if outcome == DONE:
        shrink = max(0.2, 0.8 * (plan.tolerance / relative) ** (1.0 / (EULER_ERROR if euler else m.order)))
    else:
        shrink = 0.5
        if not euler:
            s.numbers[LIMIT] = 0.8 * h
    set_wanted_size(s, shrink * h)
    if euler:
        s.numbers[GOOD_EULER] = shrink * h


@inner
def _after_euler(s, plan, h, relative):  # type: ignore[no-untyped-def]
    """Set step sizes after a backward Euler step of a method that switches to it; the next one is Radau's again."""
    if plan.dt > 0.0:
        if h >= 0.5 * s.numbers[GOOD_EULER]:
            s.numbers[GOOD_EULER] = min(plan.dt, EULER_GROWTH * h)
    elif h >= 0.5 * s.numbers[GOOD_EULER]:
        s.numbers[GOOD_EULER] = h * min(2.0, 0.9 * max(relative / plan.tolerance, 1e-10) ** (-1.0 / EULER_ERROR))
    s.numbers[STEP_SIZE] = max(s.numbers[STEP_SIZE], s.numbers[UNCUT_RADAU])
    s.numbers[LAST_EULER], s.numbers[NEXT_EULER], s.numbers[UNCUT_RADAU], s.numbers[OLD_ERROR] = h, 0.0, 0.0, 0.0
    s.numbers[SWITCHED] += 1.0


@inner
def set_size(s, plan, h, relative, size):  # type: ignore[no-untyped-def]
    """Set the size of the next step to ``size`` within its limits, after one of size h with that relative error."""
    if s.numbers[NEXT_EULER] > 0.0:
        _after_euler(s, plan, h, relative)
        return
    if h > s.numbers[LAST_EULER]:
        s.numbers[LAST_EULER] = 0.0
    if plan.dt > 0.0:
        s.numbers[STEP_SIZE] = min(plan.dt, 2.0 * s.numbers[STEP_SIZE])
        if h >= 0.5 * plan.dt:
            s.numbers[GOOD_EULER] = 0.0
        return
    s.numbers[OLD_ERROR] = max(relative / plan.tolerance, 1e-2)
    s.numbers[STEP_SIZE] = min(plan.largest, size)
    if s.numbers[LIMIT] > 0.0:
        # sizes at which Newton's method failed are approached again slowly
        s.numbers[STEP_SIZE] = min(s.numbers[STEP_SIZE], s.numbers[LIMIT])
        s.numbers[LIMIT] *= 1.05


@inner
def impact_tolerance(plan, size):  # type: ignore[no-untyped-def]
    """Return the largest position error [m] at the end of a step with an impact, beyond which the step is repeated.

    0 with fixed steps: no limit.
    """
    return plan.tolerance * size if plan.dt == 0.0 else 0.0


@inner
def targets(s, plan, rows, k):  # type: ignore[no-untyped-def]
    """Return (last, target): the latest end of the next step, and the end that storing state k or later asks for.

    ``last`` is t_stop or, for fixed steps, the next time of the grid. ``target`` is the wanted time of state k if steps
    land on these (plan.lands) and neither part would be far too short; else ``last``, and the state is interpolated.
    """
    last = plan.t_stop
    if plan.dt > 0.0:
        grid = plan.t0 + (s.numbers[GRID] + 1.0) * plan.dt
        last = plan.t_stop if grid > plan.t_stop - 1e-9 * plan.dt else grid
    if not plan.lands or rows.every > 0 or k >= len(rows.wanted):
        return last, last
    near = SHORT * s.numbers[STEP_SIZE]
    apart = rows.wanted[k] - s.numbers[TIME] > near and last - rows.wanted[k] > near
    return last, rows.wanted[k] if apart else last


@inner
def wanted_inside(rows, first, end, near):  # type: ignore[no-untyped-def]
    """Return how many wanted times, from the given one on, lie inside a step up to ``end``, and whether one is its end.
    """
    last = first
    while rows.every == 0 and last < len(rows.wanted) and rows.wanted[last] <= end + near:
        last += 1
    at_end = last > first and rows.wanted[last - 1] >= end - near
    return (last - first - 1, True) if at_end else (last - first, False)


@inner
def round_off(p, s):  # type: ignore[no-untyped-def]
    """Return the size [m] of increments that round-off alone may cause."""
    return ROUND * max(s.numbers[SIZE], p.extent)


@inner
def error_scale(s, size, fastest, h):  # type: ignore[no-untyped-def]
    """Return the scale of displacement errors in a step of size h: the size of the motion.

    If they count as errors of rates (RATE_ERRORS), it is the distance moved in the step at the largest rate so far.
    """
    if s.numbers[RATE_ERRORS] == 0.0:
        return size
    # a body at rest that a stop sets in motion has no rate yet: use the mean rate of the motion
    share = OPENING if s.numbers[BACKWARD] > 0.0 else 1.0
    return min(size, share * max(s.numbers[FASTEST], fastest, size / max(s.numbers[TIME], h)) * h)


@inner
def share_of_states(s, h):  # type: ignore[no-untyped-def]
    """Return the factor by which errors of controllers' states count in a norm that ``error_scale`` is to divide.

    They are relative to the states even if errors of displacements count as those of rates: rates of states may jump,
    and leave errors in proportion to the step however small it is.
    """
    size = s.numbers[SIZE]
    return error_scale(s, size, 0.0, h) / size if size > 0.0 else 1.0


@inner
def relative_error(s, error, size, fastest, h):  # type: ignore[no-untyped-def]
    """Return an error of displacements relative to its scale (``error_scale``), or 0 if the scale is 0."""
    scale = error_scale(s, size, fastest, h)
    return error / scale if scale > 0.0 else 0.0


@inner
def increment_tolerance(p, s, h, tolerance):  # type: ignore[no-untyped-def]
    """Return the tolerance [m] of Newton's increments in a step of size h from s, from their relative ``tolerance``.

    It is relative to the size of the motion. Since errors of rates are those of positions over h, steps that move far
    less use the distance moved in SO_MANY such steps instead. It is never below round-off.
    """
    size = error_scale(s, max(s.numbers[SIZE], 1e-3 * p.extent), 0.0, h)
    if s.numbers[TIME] <= 0.0:
        return tolerance * size
    moved = MOST_STEPS * h * max(norm(p, s.v), size / s.numbers[TIME])
    return max(tolerance * min(size, moved), round_off(p, s))
