"""Impacts: how one-sided constraints (hard contacts) change rates, and which of them press afterwards.

A step of the Newmark family ends, by Newton's method, where no gap is negative and no force pulls. If a constraint
closes in the step, its positions are right, but the method treats the impact as a force over the whole step, so the
rates at its end depend on when in the step it happened. The rates are therefore set after the step: to those that the
closed constraints allow, by the least change in kinetic energy (plastic impact), or to ``restitution`` times the rate
of approach. Accelerations and multipliers follow from the state. If the obstacle is at rest, energy is lost or kept,
never gained. Friction has impulses, too (``friction``).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.contact_geometry import (
    AFTER_IMPACT,
    BY_FORCE,
    CLOSED,
    CLOSES,
    FRICTION,
    NO_IMPACT,
    OPEN,
    SLIP_STATUS,
    STATUS,
)
from .. import calls
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed_with_memory, inner, inner_with_memory, kernel_with_memory, seldom
from ..passages import tunnels
from ..patches import face_bodies, rates_of_constraints
from .consistent import consistent, gap_rates, onto_positions
from .contact_steps import (
    closed_in_step,
    fix_active_set,
    friction_forces,
    interpolate_linearly,
    interpolate_with_impact,
    mark_closed_points,
    supported_functions,
    unfix_active_set,
)
from .dynamics import norm, signals_at, to_full
from .friction import (
    AT_REST,
    add_friction_forces,
    apply_friction_impulses,
    approach_without_contact,
    has_friction,
    point_friction,
    point_slip,
    start_friction,
)
from .impulses import approach_rate, record_impulses, work_of_obstacles
from .state import BACKWARD, IMPACT_ITEM, NEXT_EULER, OBSTACLE_WORK
from .step_energy import energy_at, energy_at_start, inelastic_work_of_step, lost_in_impact

# most rounds in which constraints that pull are released
_RELEASE_ROUNDS = 20
# end of a step: an impact, or rates made consistent after a backward Euler step, so that the method restarts
HIT, RESTART = -1.0, -2.0
# largest factor of a bounce so that it loses no energy; most tries until it gains none; as fractions of the energy that
# the bounce adds: loss that is accepted, and gain that counts as round-off
MAX_BOUNCE, BOUNCE_TRIES, ACCEPTED_LOSS, ROUND_OFF = 1.1, 12, 1e-9, 1e-12


@inner_with_memory
def _find_active_set(p, w, z, v, status):  # type: ignore[no-untyped-def]
    """Find which items are CLOSED or OPEN at unknowns z, by gap and multiplier; fill status (items,) and fix it."""
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    for i in range(len(status)):
        if p.points.restitution[i] >= 0.0:
            # and discard the friction after the impact of a rejected step
            p.points.mem[i, STATUS], p.points.mem[i, AFTER_IMPACT] = BY_FORCE, NO_IMPACT
    w.other[:] = 0.0
    face_bodies(p, w.d)
    calls.mark_closed_points(p.calls, (p.points, w.d, w.v, w.amps, w.other))
    for i in range(len(status)):
        status[i] = BY_FORCE
        if p.points.restitution[i] >= 0.0:
            status[i] = CLOSED if w.other[p.points.multiplier[i]] != 0.0 else OPEN
            p.points.mem[i, STATUS] = status[i]


@inner_with_memory
def _consistent_without_pull(p, w, z, v, a, t, impulse, status):  # type: ignore[no-untyped-def]
    """Make rates, accelerations and multipliers consistent, releasing items that pull; return whether this is possible.
    """
    for i in range(len(z)):
        z[i] *= p.coordinate[i]
    for _ in range(_RELEASE_ROUNDS):
        if not calls.consistent(p.calls, (p, w, z, v, a, t, impulse)):
            return False
        impulse[:] = 0.0
        if has_friction(p):
            calls.add_friction_forces(p.calls, (p, w, z, v, a, status))
        pulls = False
        for i in range(len(status)):
            if status[i] == CLOSED and z[p.place[p.points.multiplier[i]]] > 0.0:
                status[i] = OPEN
                p.points.mem[i, STATUS] = OPEN
                pulls = True
        if not pulls:
            break
    return True


@kernel_with_memory
@seldom
def consistent_start(p, w, z, v, a, t, impulse):  # type: ignore[no-untyped-def]
    """Same as ``consistent`` with closed hard contacts, at the start of a motion or after a break: those that separate
    are opened, those that approach have an impact.
    """
    n = len(p.points.mem)
    status, g, rate, second = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        if p.points.restitution[i] >= 0.0 and p.points.mem[i, SLIP_STATUS] != CLOSES:
            # discard whether it stuck or slid in an equilibrium
            p.points.mem[i, SLIP_STATUS] = 0.0
    signals_at(p, t, w.amps)
    _find_active_set(p, w, z, v, status)
    gap_rates(p, w, z, v, a, g, rate, second)
    fastest, bounces = norm(p, v), False
    bounce, approach = np.zeros(len(z)), np.zeros(len(z))
    for i in range(n):
        if status[i] == CLOSED and rate[i] > AT_REST * fastest:
            status[i] = OPEN
            p.points.mem[i, STATUS] = OPEN
        elif status[i] == CLOSED and rate[i] < -AT_REST * fastest:
            k = p.place[p.points.multiplier[i]]
            approach[k], bounce[k] = rate[i], -p.points.restitution[i] * rate[i]
            bounces |= bounce[k] > 0.0
    bounce += impulse
    good = calls.after_impact(p.calls, (p, w, z, v, a, t, bounce, approach, status, bounces))
    unfix_active_set(p)
    if has_friction(p):
        to_full(p, z, w.amps, 0, w.d)
        calls.start_friction(p.calls, (p.points, w.d, w.amps))
    for i in range(n):
        if p.points.restitution[i] >= 0.0 and p.points.par[i, FRICTION] > 0.0:
            p.points.mem[i, SLIP_STATUS] = 0.0 if status[i] == CLOSED else CLOSES
    return good


@addressed_with_memory
@seldom
def after_impact(p, w, z, v, a, t, impulse, approach, status, bounces):  # type: ignore[no-untyped-def]
    """Set the rates after an impact, then accelerations and multipliers; items that bounce off are opened.

    ``impulse`` (n,) as for ``consistent``, with rates of bounces at multipliers; ``approach`` (n,) gap rates before
    the impact; ``status`` (items,) CLOSED or OPEN, updated. Returns whether this is possible.
    """
    if has_friction(p):
        calls.apply_friction_impulses(p.calls, (p, w, z, v, impulse, approach, status))
    if not bounces:
        return _consistent_without_pull(p, w, z, v, a, t, impulse, status)
    kept = impulse.copy()
    for i in range(len(z)):
        z[i] *= p.coordinate[i]
    good = calls.consistent(p.calls, (p, w, z, v, a, t, impulse))
    for i in range(len(status)):
        if status[i] == CLOSED and kept[p.place[p.points.multiplier[i]]] > 0.0:
            status[i] = OPEN
            p.points.mem[i, STATUS] = OPEN
    impulse[:] = 0.0
    return good and _consistent_without_pull(p, w, z, v, a, t, impulse, status)


@inner
def _extrapolate_signals_back(p, w, end, h):  # type: ignore[no-untyped-def]
    """Fill w.amps with signals a time h before ``end``, extrapolated with the constant second rates at ``end``."""
    signals_at(p, end, w.amps)
    for k in range(len(w.amps)):
        w.amps[k, 0] -= h * (w.amps[k, 1] - 0.5 * h * w.amps[k, 2])
        w.amps[k, 1] -= h * w.amps[k, 2]


@inner_with_memory
def _after_scaled_bounce(p, w, s, m, t, h, bounce, approach, status, conserves,  # type: ignore[no-untyped-def]
                         obstacle_speed, moves):
    """Same as ``after_impact`` for the step from s at t, with the bounce scaled such that it gains no energy.

    Returns the work of moving obstacles (``work_of_obstacles``). The kinetic energy after an impact is that of the
    plastic impact plus a term with the square of the bounce. A bounce with restitution 1 (``conserves``) does not lose
    energy either, if no obstacle ``moves`` by signals. With friction or moving obstacles the energy is not exactly
    quadratic, and the largest share without a gain is searched.
    """
    end, searches = m.end, moves or has_friction(p)
    z, v, a, status_before, full = end.z.copy(), end.v.copy(), end.a.copy(), status.copy(), bounce.copy()
    before, share, whole, plastic, work = energy_at_start(p, w, s, m, t, h, False), 1.0, 0.0, 0.0, 0.0
    # bracket: share without an energy gain (``below`` <= 0) and share with a gain (``above``)
    low, below, high, above = 0.0, 0.0, MAX_BOUNCE, np.inf
    for attempt in range(BOUNCE_TRIES if searches else 3):
        if attempt > 0:
            copy(z, end.z)
            copy(v, end.v)
            copy(a, end.a)
            copy(status_before, status)
            fix_active_set(p, status)
        for i in range(len(bounce)):
            bounce[i] = share * full[i]
        calls.after_impact(p.calls, (p, w, end.z, end.v, end.a, t + h, bounce, approach, status, share > 0.0))
        if moves:
            work = work_of_obstacles(p, w, end, t + h, status_before, approach, obstacle_speed)
        gain = energy_at(p, w, end.z, end.v, t + h, False) - work - before
        noise = ROUND_OFF * (whole - plastic)
        if gain > noise:
            high, above = share, gain
        elif share >= low:
            low, below = share, gain
        if attempt == 0:
            if gain <= 0.0 and (moves or not conserves):
                break
            whole, share = gain, 0.0
        elif attempt == 1:
            plastic = gain
            if not plastic < min(whole, 0.0):
                break
            share = min(np.sqrt(plastic / (plastic - whole)), MAX_BOUNCE)
        elif gain <= noise and (above == np.inf or gain > -ACCEPTED_LOSS * (whole - plastic)):
            break
        else:
            between = below / (below - above) if attempt % 3 > 0 else 0.5
            share = low + between * (high - low) if attempt < BOUNCE_TRIES - 2 else low
    return work


@inner_with_memory
def _shorter_step(p, s, status, g, rate, second, h, allowed):  # type: ignore[no-untyped-def]
    """Return the step size with which points that close are off by at most ``allowed`` [m], or 0 if h is small enough.
    """
    best = h
    for i in range(len(status)):
        if closed_in_step(p, s, status, i) and g[i] > 0.0:
            speed = -approach_rate(g[i], rate[i], second[i], h)
            if speed > max(rate[i], 0.0):
                # time at which the gap is 0, from its value and rate at the start and its rate there
                closing = 2.0 * g[i] / (speed - rate[i])
                if speed * (h - closing) > allowed:
                    best = min(best, closing + 0.5 * allowed / speed)
    return best if best < h else 0.0


@inner_with_memory
def _rates_of_bounces(p, s, status, g, rate, second, h, approach, bounce):  # type: ignore[no-untyped-def]
    """Fill approach and bounce (n,) with gap rates before and after the impact, at multipliers of items that closed.

    g, rate, second : gaps and their rates at the start s of the step of size h. Returns whether any item bounces, and
    whether all bounces conserve energy.
    """
    bounces, elastic_ones = False, True
    for i in range(len(status)):
        if closed_in_step(p, s, status, i):
            k = p.place[p.points.multiplier[i]]
            approach[k] = approach_rate(g[i], rate[i], second[i], h)
            bounce[k] = -p.points.restitution[i] * approach[k]
            bounces |= bounce[k] > 0.0
            elastic_ones &= p.points.restitution[i] == 1.0 and p.points.par[i, FRICTION] == 0.0
    return bounces, elastic_ones


@inner_with_memory
def _obstacle_speeds(p, w, status, out):  # type: ignore[no-untyped-def]
    """Fill out (items,) with the speed at which signals move obstacles towards CLOSED items.

    Returns whether any such obstacle moves, and whether any support does.
    """
    velocity, acceleration, moves, driven = np.zeros(len(w.d)), np.zeros(len(w.d)), False, False
    rates_of_constraints(p, w.d, w.v, w.amps, velocity, acceleration)
    for i in range(len(status)):
        if status[i] == CLOSED:
            out[i] = -velocity[p.points.multiplier[i]]
            moves |= out[i] != 0.0
    for m in range(len(p.motion_coord)):
        driven |= w.amps[p.motion_signal[m], 1] != 0.0
    return moves, driven


@inner_with_memory
def _onto_closed(p, w, s, end, status):  # type: ignore[no-untyped-def]
    """Put the positions at the end of the step onto its closed constraints if an item closed in the step from s.

    Returns whether one did, and whether one of these bounces.
    """
    any_closes, bounces = False, False
    for i in range(len(status)):
        if closed_in_step(p, s, status, i):
            any_closes = True
            bounces |= p.points.restitution[i] > 0.0
    if any_closes:
        # a gap left by round-off, closed in a much shorter step, would be a velocity
        onto_positions(p, w, end.z, 1)
    return any_closes, bounces


@addressed_with_memory
@seldom
def impact(p, w, s, m, t, h, allowed):  # type: ignore[no-untyped-def]
    """Apply the impacts of constraints that closed in the step from s at t to m.end; set OBSTACLE_WORK.

    Returns HIT after an impact, 0 if nothing closed, or, with rates unchanged, the smaller step size to use if closing
    points would be off by more than ``allowed`` [m] (0: no limit). For methods that switch, Radau steps are left alone,
    and after a backward Euler step without impact rates are made consistent with closed points, returning RESTART.
    """
    if m.switches and s.numbers[NEXT_EULER] == 0.0:
        return 0.0
    n, end = len(p.points.mem), m.end
    status, g, rate, second, obstacle_speed = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    bounce, approach = np.zeros(len(s.z)), np.zeros(len(s.z))
    signals_at(p, t + h, w.amps)
    _find_active_set(p, w, end.z, end.v, status)
    s.numbers[OBSTACLE_WORK], s.numbers[IMPACT_ITEM], elastic_ones = 0.0, 0.0, False
    any_closes, bounces = _onto_closed(p, w, s, end, status)
    if not any_closes:
        if m.switches:
            calls.after_impact(p.calls, (p, w, end.z, end.v, end.a, t + h, bounce, approach, status, False))
            interpolate_linearly(end, s)
        unfix_active_set(p)
        return RESTART if m.switches else 0.0
    touched, (moves, driven) = status.copy(), _obstacle_speeds(p, w, status, obstacle_speed)
    if bounces or allowed > 0.0 or has_friction(p) or moves:
        # moving obstacles are first extrapolated from the start of the step, then back from its end
        for from_end in range(2 if allowed > 0.0 and moves else 1):
            if from_end:
                _extrapolate_signals_back(p, w, t + h, h)
            else:
                signals_at(p, t, w.amps)
            gap_rates(p, w, s.z, s.v, s.a, g, rate, second)
            shorter = _shorter_step(p, s, status, g, rate, second, h, allowed) if allowed > 0.0 else 0.0
            if shorter > 0.0:
                unfix_active_set(p)
                return shorter
        signals_at(p, t + h, w.amps)
        bounces, elastic_ones = _rates_of_bounces(p, s, status, g, rate, second, h, approach, bounce)
        approach_without_contact(p, w, s, end, status, h if s.numbers[BACKWARD] > 0.0 else m.impulse * h, approach)
    if bounces and not driven:
        s.numbers[OBSTACLE_WORK] = _after_scaled_bounce(p, w, s, m, t, h, bounce, approach, status, elastic_ones,
                                                        obstacle_speed, moves)
    else:
        calls.after_impact(p.calls, (p, w, end.z, end.v, end.a, t + h, bounce, approach, status, bounces))
        if moves or driven:
            s.numbers[OBSTACLE_WORK] = (np.inf if driven
                                        else work_of_obstacles(p, w, end, t + h, touched, approach, obstacle_speed))
    record_impulses(p, w, s, end, t, h, touched)
    unfix_active_set(p)
    interpolate_with_impact(p, s, end, h, touched, allowed > 0.0 and not m.switches)
    return HIT


@addressed_with_memory
@seldom
def make_consistent(p, w, s, t):  # type: ignore[no-untyped-def]
    """Make rates, accelerations and multipliers of s consistent at t, for its closed items; return whether it was done.

    It is not done with friction, whose forces come from the steps.
    """
    if has_friction(p):
        return False
    status, z, v, a = np.zeros(len(p.points.mem)), s.z.copy(), s.v.copy(), s.a.copy()
    signals_at(p, t, w.amps)
    _find_active_set(p, w, z, v, status)
    good = _consistent_without_pull(p, w, z, v, a, t, np.zeros(len(z)), status)
    unfix_active_set(p)
    if good:
        copy(z, s.z)
        copy(v, s.v)
        copy(a, s.a)
    return good


def impact_functions(contacts: Any, sided: bool, problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries for impacts of the table of a model with these contacts (``kernels.calls.table``).

    ``sided`` : whether some of them are hard.
    """
    out: dict[Any, tuple[Any, ...]] = {calls.tunnels: (tunnels, problem)} if contacts else {}
    if sided:
        points = problem.place["points"][1]
        out |= supported_functions(problem)
        out |= {calls.mark_closed_points: (mark_closed_points, points), calls.consistent: (consistent, problem),
                calls.after_impact: (after_impact, problem), calls.impact: (impact, problem),
                calls.make_consistent: (make_consistent, problem),
                calls.lost_in_impact: (lost_in_impact, problem),
                calls.inelastic_work_of_step: (inelastic_work_of_step, problem)}
        if any(pair.item.friction for pair in contacts):
            out |= {calls.point_slip: (point_slip, points), calls.point_friction: (point_friction, points),
                    calls.friction_forces: (friction_forces, problem), calls.start_friction: (start_friction, points),
                    calls.apply_friction_impulses: (apply_friction_impulses, problem),
                    calls.add_friction_forces: (add_friction_forces, problem)}
    return out
