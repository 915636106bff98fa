"""Many time steps in one call: step control, stored states, work and losses."""

from __future__ import annotations

from typing import Any, NamedTuple

from .. import calls
from ..bodies import accept_elements
from ..lowlevel.arrays import copy, copy_rows
from ..lowlevel.jit import inner, seldom, shared
from ..lowlevel.records import array_at
from ..patches import accept_patches, violation
from .contact_steps import disable_friction, enable_friction, opened_in_step
from .dynamics import norm, signals_at, to_full
from .events import NONE, aim_at_event, interpolate
from .impact import HIT
from .state import (
    BACKWARD,
    CONTRACTION,
    COUNT,
    DONE,
    FASTEST,
    FRICTION_LOSS,
    GRID,
    IMPACT_ITEM,
    IMPACT_LOSS,
    IMPACT_POINTS,
    IMPULSE,
    INELASTIC_WORK,
    LOST,
    NEXT_EULER,
    NOT_CONVERGED,
    NOT_FINITE,
    OLD_STEP,
    RATE_ERRORS,
    SIZE,
    STARTS_CONSISTENT,
    STEP_SIZE,
    SWITCHES,
    TIME,
    TRIES,
    UNBOUNDED,
    WORK,
    count_turns,
)
from .step_control import (
    impact_tolerance,
    next_size,
    relative_error,
    set_size,
    set_wanted_size,
    shorten,
    size_to_target,
    targets,
    wanted_inside,
    wanted_size,
)
from .step_energy import count_impact, gains_energy
from .stops import UNCHANGED, aim_at_change, restart_after_change, size_after_engagement
from .work import inelastic_work_within, set_history

# rotation in a step [rad] beyond which the turn of its stages is ambiguous
AMBIGUOUS_TURN = 2.5
# why ``advance`` returns; MISSED: the next step needs other entries of matrices
REACHED, FULL, FAILED, EVENT, MISSED = range(5)
# kind of a stored state: inside a step, at its end, or the end of a step with states inside, for the energy balance
INSIDE, END, CHECK = range(3)
# fraction of a step: times this close to its end count as its end
NEAR = 1e-9


class StepPlan(NamedTuple):
    """Time span and step control: fixed steps dt on the grid t0 + k dt, or adaptive ones (dt = 0) with ``tolerance``.

    smallest, largest : step sizes; fastest : rate [m/s] above which the motion counts as failed; tracks : whether
    loads, prescribed motion or dampers do work that must be summed; lands : whether steps end at the times of stored
    states; checks : whether ends of steps with states inside are stored, too.
    """

    t0: float
    t_stop: float
    dt: float
    tolerance: float
    smallest: float
    largest: float
    fastest: float
    tracks: bool
    lands: bool
    checks: bool


class Rows(NamedTuple):
    """Storage for states and the step log.

    wanted : times of states to store, ascending; every : steps between stored states (0: store the wanted times).
    t, number, kind (m,), z, v, a (m, n), work (m, 2) : stored states: time, step number, INSIDE, END or CHECK,
    unknowns, work and loss; turns (m, items, memory), feet (m, joints, 2), states (m, numbers) : history variables of
    point laws, prismatic joints and elements; turned (m, sections) : rotations with full turns; log (k, 11) : number,
    t, dt, iterations, rejected tries, error and violation of every step, and of an impact at its end 1 + the item with
    the largest impulse, the number of impulses, their sum and the energy lost.
    """

    wanted: Any
    every: int
    t: Any
    number: Any
    kind: Any
    z: Any
    v: Any
    a: Any
    work: Any
    turns: Any
    feet: Any
    states: Any
    turned: Any
    log: Any


@inner
def _work_of_step(m, p, w, s, at, t, h):  # type: ignore[no-untyped-def]
    """Return (work, loss) of the step just computed."""
    if m.exact:
        return calls.work_of_step(m.calls, (p, w, s, m.own, t, h))
    return _work_within(m, p, w, s, at, t, h, 1.0)


@inner
def _work_within(m, p, w, s, at, t, h, x):  # type: ignore[no-untyped-def]
    """Return (work, loss) up to the fraction x of a step, friction of hard contacts included."""
    if p.sided:
        disable_friction(p)
    work, lost = calls.work(m.calls, (p, w, s, m, at, t, h, x))
    if p.sided:
        enable_friction(p, s.z)
    return work, lost + x * s.numbers[FRICTION_LOSS]


@inner
def _store(p, rows, r, t, number, kind, at, work, lost):  # type: ignore[no-untyped-def]
    rows.t[r], rows.number[r], rows.kind[r] = t, number, kind
    copy_rows(p.points.mem, rows.turns[r])
    copy_rows(p.sliding.memory, rows.feet[r])
    copy(p.states, rows.states[r])
    copy(at.turned[0], rows.turned[r])
    copy(at.z, rows.z[r])
    copy(at.v, rows.v[r])
    copy(at.a, rows.a[r])
    rows.work[r, 0], rows.work[r, 1] = work, lost


@inner
def _turn(p, w, s, z, v, t, h, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` with the counted rotations of s after a time h, at z with rates v at time t.

    Sets w.d, and w.v where turns are counted, to the full coordinates and rates.
    """
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    if len(p.turning.length) > 0:
        to_full(p, v, w.amps, 1, w.v)
        copy(s.turned[0], out[0])
        copy(s.turned[1], out[1])
        count_turns(p.turning, w.d, w.v, h, out[0], out[1])


@inner
def _log(s, log, t, h, iterations, relative, worst):  # type: ignore[no-untyped-def]
    """Fill a row (11,) of the step log, and reset the counters of tries and impacts."""
    log[0], log[1], log[2], log[3] = s.numbers[COUNT], t, h, iterations
    log[4], log[5], log[6] = s.numbers[TRIES], relative, worst
    s.numbers[TRIES] = 0.0
    log[7], log[8] = s.numbers[IMPACT_ITEM], s.numbers[IMPACT_POINTS]
    log[9], log[10] = s.numbers[IMPULSE], s.numbers[IMPACT_LOSS]
    s.numbers[IMPACT_ITEM] = 0.0


@inner
def _store_inside(m, p, w, s, at, plan, rows, r, time, t, h, number):  # type: ignore[no-untyped-def]
    """Store the state at ``time`` inside the step of size h from t as row r."""
    x, work, lost = (time - t) / h, 0.0, 0.0
    if plan.tracks:
        work, lost = _work_within(m, p, w, s, at, t, h, x)
    interpolate(m, p, s, h, x, at.z, at.v, at.a)
    _turn(p, w, s, at.z, at.v, t + x * h, x * h, at.turned)
    set_history(m, p, h, x)
    _store(p, rows, r, time, number, INSIDE, at, s.numbers[WORK] + work, s.numbers[LOST] + lost)
    if len(p.states) > 0:
        # energy dissipated by materials since the start of the step
        rows.work[r, 1] += accept_elements(p, w.d, w.amps, True)
        rows.work[r, 1] += inelastic_work_within(m, p, w, s, at, t, h, x)
        copy(rows.states[r], p.states)


@inner
def _try_step(m, p, w, s, at, t, h, adaptive):  # type: ignore[no-untyped-def]
    """Try a step of size h; return (outcome, iterations, error [m], contraction).

    The outcome is also NOT_CONVERGED if a section rotated so far that its turn is ambiguous, or if a contact point
    passed through an obstacle.
    """
    for k in p.clocks:
        p.states[k] = h
    s.numbers[BACKWARD] = 1.0 if s.numbers[NEXT_EULER] > 0.0 else 0.0
    outcome, iterations, error, contraction = calls.step(m.calls, (p, w, s, m.own, t, h))
    looks = outcome == DONE and p.sided and not m.switches
    if (adaptive and looks and s.numbers[STARTS_CONSISTENT] == 0.0 and opened_in_step(p, s.z, m.end.z)
            and calls.make_consistent(p.calls, (p, w, s, t))):
        # rates violate constraints by O(h^2), which would act as forces in a much shorter step
        calls.restart(m.calls, (s, m.own))
        outcome, more, error, contraction = calls.step(m.calls, (p, w, s, m.own, t, h))
        iterations += more
    if outcome == DONE and p.sided and not m.switches and opened_in_step(p, s.z, m.end.z):
        # contact forces at the start of the step would still press on points that have opened
        s.numbers[BACKWARD] = 1.0
        outcome, more, error, contraction = calls.step(m.calls, (p, w, s, m.own, t, h))
        iterations += more
    if outcome == DONE and p.touches and calls.tunnels(p.calls, (p, w, s, m, t, h)):
        return NOT_CONVERGED, iterations, error, contraction
    if outcome != DONE or not p.winds:
        return outcome, iterations, error, contraction
    _turn(p, w, s, m.end.z, m.end.v, t + h, h, at.turned)
    largest = 0.0
    for i in range(at.turned.shape[1]):
        largest = max(largest, abs(at.turned[0, i] - s.turned[0, i]))
    return (NOT_CONVERGED if largest > AMBIGUOUS_TURN else DONE), iterations, error, contraction


@inner
def _following_size(m, p, s, plan, h, relative, contraction, lost, stops, cut):  # type: ignore[no-untyped-def]
    """Return the size of the next step after one of size h, which was ``cut`` or not."""
    if plan.dt > 0.0:
        return h
    following = next_size(m, p, s, h, relative / plan.tolerance, contraction, lost, cut)
    return size_after_engagement(s, plan, h, stops, following)


@inner
def _misses_entries(p, outcome):  # type: ignore[no-untyped-def]
    """Return whether a step needs entries that matrices lack, which a failed one does not if they are for its start.
    """
    found = p.fronts.missed[0] != 0 and (outcome == DONE or p.fronts.missed[1] == 0)
    p.fronts.missed[0] = 1 if found else 0
    return found


@inner
def _largest(p, z):  # type: ignore[no-untyped-def]
    """Return the largest displacement [m] (or rate [m/s]) in z (or v), without the states of controllers."""
    return norm(p, array_at(z, 0, (p.inner,)))


@inner
def _accept(p, w, m, s, t, h, tracks, fed_in, happened):  # type: ignore[no-untyped-def]
    """Accept the step: copy its end to the motion s and update all history; return the violation of the constraints.

    ``happened`` : result of ``impact``; after an impact (below 0) the method restarts.
    """
    if happened == HIT:
        count_impact(m, p, w, s, s.numbers[TIME], h, tracks, fed_in)
    calls.accept(m.calls, (s, m.own))
    copy(m.end.z, s.z)
    copy(m.end.v, s.v)
    copy(m.end.a, s.a)
    s.numbers[TIME], s.numbers[OLD_STEP] = t, h
    p.fronts.missed[1] = 0
    if happened < 0.0:
        for tau in p.tau:
            if tau > 0.0 and not m.switches:
                # errors of rates after an impact cause viscous forces, which lose or create energy
                s.numbers[RATE_ERRORS] = 1.0
        calls.restart(m.calls, (s, m.own))
    s.numbers[COUNT] += 1.0
    s.numbers[SIZE] = max(s.numbers[SIZE], _largest(p, s.z))
    s.numbers[FASTEST] = max(s.numbers[FASTEST], _largest(p, s.v))
    if not p.patched and len(p.turning.length) == 0 and len(p.states) == 0 and len(p.feedback.kind) == 0:
        return 0.0
    _turn(p, w, s, s.z, s.v, t, h, s.turned)
    if len(p.feedback.kind) > 0:
        calls.feedback_accept(p.calls, (p, w))
        for i in range(p.inner, len(s.z)):
            # so that errors are relative to the largest state, as displacement errors are to the largest displacement
            scale = p.feedback.scale[i - p.inner]
            p.weights[i] = s.numbers[SIZE] / scale if scale > 0.0 else 0.0
    if len(p.states) > 0:
        set_history(m, p, h, 1.0)
        # methods that solve for history variables at stages have updated them already: their clock is 0
        timed = len(p.clocks) > 0 and p.states[p.clocks[0]] > 0.0
        s.numbers[LOST] += accept_elements(p, w.d, w.amps, timed)
        for k in p.clocks:
            p.states[k] = 0.0
    if not p.patched:
        return 0.0
    accept_patches(p, w.d, w.amps)
    return violation(p, w.d, w.amps)


@inner
def _end(m, p, w, s, at, plan, t, h, room, aims):  # type: ignore[no-untyped-def]
    """Return whether a step may end where it does, and if not, the size to try instead, at most ``room``.

    Steps end at events and where unilateral springs and contacts engage or release. Returns (accepted, step size,
    whether it ends at an event, change of the stops at its end, number of tries so far: positive for an event,
    negative for a stop). Size 0 means that the event is at the start of the step, below 0 that a condition has no
    value.
    """
    stops = UNCHANGED
    if len(p.stops) > 0:
        good, aimed, stops = aim_at_change(m, p, w, s, at, plan, t, h, room, max(-aims, 0))
        if not good:
            return False, aimed, False, stops, min(aims, 0) - 1
    if len(p.feedback.watched) > 0:
        good, aimed, event = aim_at_event(m, p, w, s, at, t, h, room, max(aims, 0))
        return good, aimed, event, stops, 0 if good else max(aims, 0) + 1
    return True, h, False, stops, 0


@shared
@seldom
def advance(m, p, w, s, at, plan, rows, wanted_from, steps):  # type: ignore[no-untyped-def]
    """Advance the motion s until t_stop, until ``rows`` are full, or for at most ``steps`` steps.

    Wanted times are stored from index ``wanted_from`` on. Returns why it stops (REACHED to MISSED), the number of
    states stored, steps logged, outcome and iterations of the last try.
    """
    stored, logged, next_wanted = 0, 0, wanted_from
    outcome, iterations, aims, aimed, event, sooner = DONE, 0, 0, 0.0, False, 0.0
    while True:
        t = s.numbers[TIME]
        if event or (aims == 0 and len(p.feedback.watched) > 0
                     and calls.check_conditions(p.calls, (p, w, s.z, s.v, t)) != NONE):
            return EVENT, stored, logged, outcome, iterations
        if t >= plan.t_stop:
            return REACHED, stored, logged, outcome, iterations
        if logged >= min(steps, len(rows.log)) or (rows.every > 0 and stored >= len(rows.t)):
            return FULL, stored, logged, outcome, iterations
        last, target = targets(s, plan, rows, next_wanted)
        h = aimed if aims != 0 else size_to_target(s, last, target, sooner > 0.0)
        outcome, iterations, error, contraction = _try_step(m, p, w, s, at, t, h, plan.dt == 0.0)
        if _misses_entries(p, outcome):
            return MISSED, stored, logged, outcome, iterations
        size, fastest = max(s.numbers[SIZE], _largest(p, m.end.z)), _largest(p, m.end.v)
        relative = relative_error(s, error, size, fastest, h)
        fine = outcome == DONE and (plan.dt > 0.0 or relative <= plan.tolerance)
        if not fine:
            aims = 0
            shorten(m, s, plan, outcome, h, relative)
            if outcome != SWITCHES and not wanted_size(s) >= plan.smallest:
                return FAILED, stored, logged, outcome, iterations
            continue
        if not fastest <= plan.fastest:
            return FAILED, stored, logged, UNBOUNDED, iterations
        good, aimed, event, stops, aims = _end(m, p, w, s, at, plan, t, h, target - t, aims)
        if aimed < 0.0:
            return FAILED, stored, logged, NOT_FINITE, iterations
        if not good:
            event = aimed == 0.0
            continue
        end = target if h >= target - t else t + h
        if p.sided and len(p.states) > 0:
            s.numbers[INELASTIC_WORK] = calls.inelastic_work_of_step(p.calls, (p, w, s, m, at, t, h))
        sooner = calls.impact(p.calls, (p, w, s, m, t, h, impact_tolerance(plan, size))) if p.sided else 0.0
        if sooner > 0.0:
            set_wanted_size(s, sooner)
            s.numbers[TRIES] += 1.0
            continue
        work, lost = _work_of_step(m, p, w, s, at, t, h) if plan.tracks else (0.0, 0.0)
        if p.sided and gains_energy(m, p, w, s, plan, t, h, work - lost, sooner == HIT):
            shorten(m, s, plan, NOT_CONVERGED, h, relative)
            continue
        if _misses_entries(p, outcome):
            return MISSED, stored, logged, outcome, iterations
        inside, at_end = wanted_inside(rows, next_wanted, end, NEAR * h)
        ends, left = at_end or (inside > 0 and plan.checks), len(rows.t) - stored
        if inside + ends > left and stored > 0:
            # the next call repeats this step, with room for its (further) states
            return FULL, stored, logged, outcome, iterations
        for _ in range(min(inside, left)):
            _store_inside(m, p, w, s, at, plan, rows, stored, rows.wanted[next_wanted], t, h, logged)
            stored, next_wanted = stored + 1, next_wanted + 1
        set_history(m, p, h, 0.0)
        if inside + ends > left:
            return FULL, stored, logged, outcome, iterations
        s.numbers[WORK], s.numbers[LOST] = s.numbers[WORK] + work, s.numbers[LOST] + lost
        following = _following_size(m, p, s, plan, h, relative, contraction, lost, stops,
                                    event or (target < last and h < s.numbers[STEP_SIZE]))
        if end >= last and plan.dt > 0.0 and last < plan.t_stop:
            s.numbers[GRID] += 1.0
        worst = _accept(p, w, m, s, end, h, plan.tracks, work - lost, sooner)
        restart_after_change(m, p, w, s, end, stops)
        s.numbers[CONTRACTION] = contraction
        set_size(s, plan, h, relative, following)
        _log(s, rows.log[logged], end, h, iterations, relative, worst)
        logged += 1
        if ends or (rows.every > 0 and s.numbers[COUNT] % rows.every == 0):
            kind, time = CHECK if ends and not at_end else END, rows.wanted[next_wanted] if at_end else end
            _store(p, rows, stored, time, logged - 1, kind, s, s.numbers[WORK], s.numbers[LOST])
            stored, next_wanted = stored + 1, next_wanted + (1 if at_end else 0)
