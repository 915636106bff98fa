"""Energy of steps with hard contacts: losses in impacts, and detection of steps that create energy."""

from __future__ import annotations

import numpy as np

from .. import calls
from ..bodies import elastic, group_at, prescribe_stored, set_natural
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed_with_memory, inner, inner_with_memory, seldom
from ..patches import forces_but_contacts, patch_forces
from ..stress_free import COMPUTED
from .dynamics import signals_at, to_full, twice_kinetic
from .state import CREATED_ENERGY, IMPACT_LOSS, INELASTIC_WORK, LOST, NEXT_EULER, OBSTACLE_WORK, WORK
from .work import inelastic_work_within, set_history

# fractions of the kinetic energy: what fixed steps may create in total, and each of them beyond that; steps shorter
# than the last fraction of dt are accepted anyway
TOTAL_GAIN, STEP_GAIN, SHORTEST_TRY = 5e-3, 1e-5, 1e-3
# fraction of the extent: contact forces times this distance count as energy of a scene at rest
AT_REST = 1e-9
# fraction of the extent: coordinates that change by less in a step rest, and their energy changes by round-off alone
STILL = 1e-13


@inner_with_memory
def energy_at(p, w, z, v, t, tracks):  # type: ignore[no-untyped-def]
    """Return kinetic, strain and contact energy, less the work of constant loads.

    The energy of springs is included unless ``tracks``, where it counts as work.
    """
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    w.other[:] = 0.0
    set_natural(p, w.amps, w.amps)
    energy = elastic(p, w.d, w.other)
    energy += patch_forces(p, w.d, w.v, w.amps, w.other)[0]
    if tracks:
        energy -= forces_but_contacts(p, w.d, w.v, w.amps, w.other)[0]
    for k in range(len(p.load_coord)):
        if not p.load_varies[k]:
            energy -= p.load_value[k] * w.amps[p.load_signal[k], 0] * w.d[p.load_coord[k]]
    return energy + 0.5 * twice_kinetic(p, w, v)


@inner_with_memory
def energy_at_start(p, w, s, m, t, h, tracks):  # type: ignore[no-untyped-def]
    """Return ``energy_at`` at the start of the step from s to m.end, less the energy that materials dissipate in it.

    The history variables are left as at the end of the step.
    """
    set_history(m, p, h, 0.0)
    energy = energy_at(p, w, s.z, s.v, t, tracks) - s.numbers[INELASTIC_WORK]
    set_history(m, p, h, 1.0)
    return energy


@addressed_with_memory
@seldom
def lost_in_impact(p, w, s, m, t, h, tracks):  # type: ignore[no-untyped-def]
    """Return by how much ``energy_at`` falls in the step from s at t to m.end, work and losses not counted."""
    before = energy_at_start(p, w, s, m, t, h, tracks)
    lost = before - energy_at(p, w, m.end.z, m.end.v, t + h, tracks)
    set_history(m, p, h, 0.0)
    return lost


@inner_with_memory
def _relaxing_energy(p, w, z, t):  # type: ignore[no-untyped-def]
    """Return the strain energy of relaxing materials at z and t, with their stored internal strains."""
    prescribe_stored(p)
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    set_natural(p, w.amps, w.amps)
    w.other[:] = 0.0
    energy = 0.0
    for g in range(len(p.groups)):
        if group_at(p.groups[g]).law.timed:
            energy += calls.force(p.calls, (group_at(p.groups[g]), w.d, w.other))
            p.slopes[g] = COMPUTED
    return energy


@addressed_with_memory
@seldom
def inelastic_work_of_step(p, w, s, m, at, t, h):  # type: ignore[no-untyped-def]
    """Return the work on internal strains in the step from s at t to m.end, by the mean of the stresses at its ends.

    Methods that solve for internal strains at stages use their quadrature; plastic flow uses the stress at the end.
    """
    before = p.states.copy()
    work = inelastic_work_within(m, p, w, s, at, t, h, 1.0)
    set_history(m, p, h, 1.0)
    ends = len(p.clocks) > 0 and p.states[p.clocks[0]] > 0.0
    signals_at(p, t + h, w.amps)
    to_full(p, m.end.z, w.amps, 0, w.d)
    set_natural(p, w.amps, w.amps)
    for g in range(len(p.groups)):
        law = group_at(p.groups[g]).law
        if law.state > 0:
            lost = calls.commit(p.calls, (group_at(p.groups[g]), w.d))
            work += lost if not law.timed else 0.0
    if ends:
        # stress D (eps - q): mean of the energies that the change of q alone takes at the strains of either end
        work -= 0.5 * (_relaxing_energy(p, w, s.z, t) + _relaxing_energy(p, w, m.end.z, t + h))
        copy(before, p.states)
        work += 0.5 * (_relaxing_energy(p, w, s.z, t) + _relaxing_energy(p, w, m.end.z, t + h))
    copy(before, p.states)
    return work


@inner
def rests(p, s, m):  # type: ignore[no-untyped-def]
    """Return whether no coordinate changes by more than round-off in the step from s to m.end."""
    for i in range(len(s.z)):  # noqa: SIM110
        if p.weights[i] * abs(m.end.z[i] - s.z[i]) > STILL * p.extent:
            return False
    return True


@inner
def gains_energy(m, p, w, s, plan, t, h, fed_in, hit):  # type: ignore[no-untyped-def]
    """Return whether a step creates energy, beyond ``fed_in``: bodies may spin or vibrate too fast after a bounce.

    Only fixed steps and backward Euler steps with contact changes are checked; the others have error control.
    """
    if plan.dt == 0.0 and s.numbers[NEXT_EULER] == 0.0:
        return False
    if hit and np.isinf(s.numbers[OBSTACLE_WORK]):
        # moved supports do work in an impact
        return False
    if not hit and rests(p, s, m):
        return False
    rise = -calls.lost_in_impact(p.calls, (p, w, s, m, t, h, plan.tracks)) - fed_in
    rise -= s.numbers[OBSTACLE_WORK] if hit else 0.0
    kinetic = 0.5 * max(twice_kinetic(p, w, s.v), twice_kinetic(p, w, m.end.v))
    borne = 0.0
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] >= 0.0:
            borne += abs(m.end.z[p.place[p.points.multiplier[i]]])
    kinetic = max(kinetic, AT_REST * p.extent * borne)
    gained, dt = max(0.0, s.numbers[CREATED_ENERGY] + rise), plan.dt if plan.dt > 0.0 else plan.largest
    if gained > TOTAL_GAIN * kinetic and rise > STEP_GAIN * kinetic * h / dt and h > SHORTEST_TRY * dt:
        return True
    s.numbers[CREATED_ENERGY] = gained
    return False


@inner
def count_impact(m, p, w, s, t, h, tracks, fed_in):  # type: ignore[no-untyped-def]
    """Add the energy lost in an impact to the losses and the work of moving obstacles to the work.

    ``fed_in`` is all other energy fed in during the step. The work of moved supports is unknown: any gain is theirs.
    """
    known = s.numbers[OBSTACLE_WORK] if not np.isinf(s.numbers[OBSTACLE_WORK]) else 0.0
    gone = calls.lost_in_impact(p.calls, (p, w, s, m, t, h, tracks)) + fed_in + known
    s.numbers[WORK] += known
    s.numbers[IMPACT_LOSS] = max(gone, 0.0)
    if gone > 0.0:
        s.numbers[LOST] += gone
    elif tracks and np.isinf(s.numbers[OBSTACLE_WORK]):
        s.numbers[WORK] -= gone
