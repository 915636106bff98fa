"""How long steps are, by their errors, by what cut them and by where they end; how small increments are in them."""

from __future__ import annotations

from ..lowlevel.jit import inner
from .dynamics import norm
from .state import (
    DONE,
    EULER,
    FASTEST,
    GRID,
    LAST,
    LIMIT,
    NEXT,
    OLD_ERROR,
    OLD_STEP,
    REJECTED,
    SIZE,
    STEP_SIZE,
    STRUCK,
    SWITCHED,
    SWITCHES,
    TIME,
    TRIES,
    UNCUT,
)
from .work import SECOND

# what dies out at once, as behind an impact, moves too little for errors to be seen: steps of second order methods grow
# no faster there, so that each is short beside all before
DAMPED = 1.4
# of the usual length: steps shorter than this are not made for a state alone
SHORT = 1e-2
# steps in which a motion goes as far as its size, where it moves as usual
SO_MANY = 1e4
# of positions, beside the size of a motion
ROUND = 1e-15
# of the error of a backward Euler step in its length
SECOND_ORDER = 2
# backward Euler steps within a fixed step: each is so many times as long as the one before
GROWS = 8.0


@inner
def usual(s):  # type: ignore[no-untyped-def]
    """Return the length of the next step, wherever it has to end."""
    return s.numbers[NEXT] if s.numbers[NEXT] > 0.0 else s.numbers[STEP_SIZE]


@inner
def set_length(s, h):  # type: ignore[no-untyped-def]
    """Set the length of the next try of the same kind."""
    s.numbers[NEXT if s.numbers[NEXT] > 0.0 else STEP_SIZE] = h


@inner
def length(s, last, target, sooner):  # type: ignore[no-untyped-def]
    """Return the length of the next step: to ``target`` at most, which is before ``last`` for a stored state.

    ``sooner`` : whether it is to end where an impact is expected.
    """
    left = target - s.numbers[TIME]
    h = min(usual(s), left)
    if left < 1.1 * h and not sooner:
        return left
    # the method is less accurate where steps are unlike one another
    return 0.5 * left if target < last and left < 2.0 * h and not sooner and s.numbers[NEXT] == 0.0 else h


@inner
def next_size(m, p, s, h, ratio, contraction, lost, cut):  # type: ignore[no-untyped-def]
    """Return how long the step behind one of length h is, by its error (Gustafsson 1994); not much longer where Newton
    was slow. What is ``cut`` for a stored state is no reason for a shorter one.
    """
    low, order = max(ratio, 1e-10), m.order
    factor = 0.9 * low ** (-1.0 / order)
    old = s.numbers[OLD_ERROR]
    if old > 0.0 and s.numbers[OLD_STEP] > 0.0:
        trend = h / s.numbers[OLD_STEP] * (old / (low * low)) ** (1.0 / order) * 0.9
        factor = min(factor, trend)
    largest = 4.0 if contraction < 0.3 else 1.2
    if (lost > 0.0 or p.sided) and not m.exact and order <= SECOND:
        largest = min(largest, DAMPED)
    before = s.numbers[STEP_SIZE] if cut else h
    return max(min(max(factor, 0.2) * h, largest * before), before if cut else 0.0)


@inner
def shorten(m, s, plan, outcome, h, relative):  # type: ignore[no-untyped-def]
    """Set the length of the next try after a step of length h that could not be made, or was not good enough."""
    s.numbers[TRIES] += 1.0
    if outcome == SWITCHES:
        # the method has set it
        return
    s.numbers[REJECTED] += 1.0
    euler = s.numbers[NEXT] > 0.0
    if outcome == DONE:
        shrink = max(0.2, 0.8 * (plan.tolerance / relative) ** (1.0 / (SECOND_ORDER if euler else m.order)))
    else:
        shrink = 0.5
        if not euler:
            s.numbers[LIMIT] = 0.8 * h
    set_length(s, shrink * h)
    if euler:
        s.numbers[EULER] = shrink * h


@inner
def _go_on(s, plan, h, relative):  # type: ignore[no-untyped-def]
    """Set the lengths of steps behind one by the backward Euler method, of a method that switches to it."""
    if plan.dt > 0.0:
        if h >= 0.5 * s.numbers[EULER]:
            s.numbers[EULER] = min(plan.dt, GROWS * h)
    elif h >= 0.5 * s.numbers[EULER]:
        s.numbers[EULER] = h * min(2.0, 0.9 * max(relative / plan.tolerance, 1e-10) ** (-1.0 / SECOND_ORDER))
    s.numbers[STEP_SIZE] = max(s.numbers[STEP_SIZE], s.numbers[UNCUT])
    s.numbers[LAST], s.numbers[NEXT], s.numbers[UNCUT], s.numbers[OLD_ERROR] = h, 0.0, 0.0, 0.0
    s.numbers[SWITCHED] += 1.0


@inner
def set_size(s, plan, h, relative, size):  # type: ignore[no-untyped-def]
    """Set the length of the next step, behind one of length h with that error."""
    if s.numbers[NEXT] > 0.0:
        _go_on(s, plan, h, relative)
        return
    if h > s.numbers[LAST]:
        s.numbers[LAST] = 0.0
    if plan.dt > 0.0:
        s.numbers[STEP_SIZE] = min(plan.dt, 2.0 * s.numbers[STEP_SIZE])
        if h >= 0.5 * plan.dt:
            s.numbers[EULER] = 0.0
        return
    s.numbers[OLD_ERROR] = max(relative / plan.tolerance, 1e-2)
    s.numbers[STEP_SIZE] = min(plan.largest, size)
    if s.numbers[LIMIT] > 0.0:
        # what Newton's method could not take is tried again, but not at once
        s.numbers[STEP_SIZE] = min(s.numbers[STEP_SIZE], s.numbers[LIMIT])
        s.numbers[LIMIT] *= 1.05


@inner
def late(plan, size):  # type: ignore[no-untyped-def]
    """Return how far [m] a place may be off where a step ends behind an impact, else it is made again; 0 for any."""
    return plan.tolerance * size if plan.dt == 0.0 else 0.0


@inner
def targets(s, plan, rows, k):  # type: ignore[no-untyped-def]
    """Return where a step ends at the latest: where the motion breaks, or a fixed one at the next time of the grid.

    And where it ends for a stored state, from the k-th one on: no later, and there if plan.lands. Where such a step
    would be far too short, the state is interpolated all the same.
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
def passed(rows, first, end, near):  # type: ignore[no-untyped-def]
    """Return how many wanted times from the given one on lie inside a step, and whether one is its end."""
    last = first
    while rows.every == 0 and last < len(rows.wanted) and rows.wanted[last] <= end + near:
        last += 1
    at_end = last > first and rows.wanted[last - 1] >= end - near
    return (last - first - 1, True) if at_end else (last - first, False)


@inner
def rounding(p, s):  # type: ignore[no-untyped-def]
    """Return how large [m] increments are that round-off alone may make."""
    return ROUND * max(s.numbers[SIZE], p.extent)


@inner
def scale_of(s, size, fastest, h):  # type: ignore[no-untyped-def]
    """Return what errors of displacements in a step of length h are relative to: the size of the motion.

    Where they count as errors of rates (STRUCK), it is the way of the fastest so far in the step.
    """
    if s.numbers[STRUCK] == 0.0:
        return size
    # what a stop sets in motion has no rate yet
    return min(size, max(s.numbers[FASTEST], fastest, size / max(s.numbers[TIME], h)) * h)


@inner
def error_beside(s, error, size, fastest, h):  # type: ignore[no-untyped-def]
    """Return an error of displacements beside what it is relative to, 0 where that is nothing."""
    scale = scale_of(s, size, fastest, h)
    return error / scale if scale > 0.0 else 0.0


@inner
def enough(p, s, h, tolerance):  # type: ignore[no-untyped-def]
    """Return how small [m] increments are to be in a step of length h from the motion s, by their relative tolerance.

    They are small beside the size of the motion; in steps that move far less than that, beside what SO_MANY of them
    move, since errors of rates are those of positions over h; but no smaller than round-off lets them be.
    """
    size = scale_of(s, max(s.numbers[SIZE], 1e-3 * p.extent), 0.0, h)
    if s.numbers[TIME] <= 0.0:
        return tolerance * size
    moved = SO_MANY * h * max(norm(p, s.v), size / s.numbers[TIME])
    return min(tolerance * size, max(tolerance * moved, rounding(p, s)))
