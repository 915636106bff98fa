"""Work of loads and prescribed motion, and losses in dampers, over a step."""

from __future__ import annotations

from .. import calls
from ..bodies import elastic_where_driven, power_of_natural, set_natural, viscous
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed, inner, seldom
from ..moving import moving_inertia, place_moving
from ..patches import forces_but_contacts, patch_forces
from .dynamics import add_loads, apply_feedback, lost_to_mass_damping, signals_at, to_full
from .events import interpolate

# order of the local error of second order methods
SECOND_ORDER_ERROR = 3
# Lobatto's points in [0, 1], and their weights
POINTS = (0.0, 0.27639320225002106, 0.7236067977499789, 1.0)
WEIGHTS = (1.0 / 12.0, 5.0 / 12.0, 5.0 / 12.0, 1.0 / 12.0)


@inner
def losing_forces(p, w, z, v, drives):  # type: ignore[no-untyped-def]
    """Same as ``forces`` with only the elastic forces that drive prescribed motion, or none; return the power lost.

    All other elastic forces neither dissipate energy nor show in ``power_of_loads``.
    """
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    w.Q[:] = 0.0
    apply_feedback(p, w)
    set_natural(p, w.amps, w.amps)
    place_moving(p, w.d, w.amps)
    if drives:
        elastic_where_driven(p, w.d, w.Q)
    power = viscous(p, w.d, w.v, w.Q)
    _, lost = patch_forces(p, w.d, w.v, w.amps, w.Q)
    add_loads(p, w.amps, -1.0, w.Q)
    return power + lost


@inner
def power_of_loads(p, w, v, a):  # type: ignore[no-untyped-def]
    """Return the power fed in by loads that vary or turn, by natural strains and by prescribed motion.

    The power that springs store and that moving masses take is subtracted; what dampers and contacts with obstacles at
    rest take is not. Call it after ``losing_forces`` at the same state.
    """
    total = power_of_natural(p, w.d, w.v)
    for m in range(len(p.load_coord)):
        if p.load_varies[m]:
            c = p.load_coord[m]
            total += p.load_value[m] * w.amps[p.load_signal[m], 0] * w.v[c]
    # constraints without a signal do no work, even where interpolated states violate them
    for i in range(len(p.points.multiplier)):
        if p.points.multiplier[i] >= 0 and p.points.fed[i, 0] < 0:
            w.d[p.points.multiplier[i]] = 0.0
    w.other[:] = 0.0
    total += forces_but_contacts(p, w.d, w.v, w.amps, w.other)[1]
    # moving masses act like loads: the power of their inertia counts as work
    moving_inertia(p, w.amps, a, w.other)
    moving_inertia(p, w.amps, a, w.Q)
    for i in range(len(w.other)):
        total -= w.other[i] * w.v[i]
    # forces M a + Q - F at the prescribed coordinates, times their rates
    for m in range(len(p.motion_coord)):
        total += w.Q[p.motion_coord[m]] * p.motion_factor[m] * w.amps[p.motion_signal[m], 1]
    for k in range(len(p.motion_mass_signal)):
        rate = w.amps[p.motion_mass_signal[k], 1]
        for i in range(len(a)):
            total += rate * p.motion_mass[k, i] * (a[i] + p.alpha * v[i]) * p.coordinate[i]
        for m in range(len(p.motion_mass_signal)):
            s = p.motion_mass_signal[m]
            total += rate * p.motion_mutual[k, m] * (w.amps[s, 2] + p.alpha * w.amps[s, 1])
    return total


@inner
def power(p, w, z, v, a, t):  # type: ignore[no-untyped-def]
    """Return (power of varying loads, prescribed motion and point laws; power dissipated) of a state."""
    signals_at(p, t, w.amps)
    lost = losing_forces(p, w, z, v, True)
    return power_of_loads(p, w, v, a), lost + lost_to_mass_damping(p, w, v)


@inner
def set_history(m, p, h, x):  # type: ignore[no-untyped-def]
    """Set the history variables of relaxing materials to the fraction x of the step (0: its start)."""
    if len(p.clocks) > 0:
        calls.inside(m.calls, (p, m.own, h, x))


@inner
def _lost_on_the_way(m, p, w, s, at, t, h, end):  # type: ignore[no-untyped-def]
    """Return the mean power dissipated up to the fraction ``end`` of a step of a second order method.

    A dashpot loses its mean force times the distance moved, c (v_0 + v_1)/2 dz, found from differences of the power
    about the mean rate dz/h. Motions that die out within the step, as after an impact, start fast but move little. (The
    difference of two powers would do for dashpots, but not for layers, which release at some rates.)
    """
    interpolate(m, p, s, h, end, at.z, at.v, at.a)
    for i in range(len(s.z)):
        w.R[i] = p.coordinate[i] * (at.z[i] - s.z[i]) / (end * h)
        w.y[i] = 0.5 * (0.5 * (s.v[i] + at.v[i]) - w.R[i]) * p.coordinate[i]
    interpolate(m, p, s, h, 0.5 * end, at.z, at.v, at.a)
    copy(w.y, at.a)
    set_history(m, p, h, 0.5 * end)
    signals_at(p, t + 0.5 * end * h, w.amps)
    lost = 0.0
    for k in range(3):
        side, share = (0.0, 1.0, -1.0)[k], (1.0, 0.5, -0.5)[k]
        for i in range(len(s.z)):
            at.v[i] = w.R[i] + side * at.a[i]
        lost += share * (losing_forces(p, w, at.z, at.v, False) + lost_to_mass_damping(p, w, at.v))
    return lost


@inner
def inelastic_work_within(m, p, w, s, at, t, h, end):  # type: ignore[no-untyped-def]
    """Return the work on internal strains solved at stages, up to the fraction ``end`` of the step, else 0."""
    lost = 0.0
    if len(p.clocks) > 0 and m.order > SECOND_ORDER_ERROR:
        for k in range(4):
            interpolate(m, p, s, h, end * POINTS[k], at.z, at.v, at.a)
            signals_at(p, t + end * POINTS[k] * h, w.amps)
            to_full(p, at.z, w.amps, 0, w.d)
            set_natural(p, w.amps, w.amps)
            lost += end * WEIGHTS[k] * calls.taken(m.calls, (p, w, m.own, end * POINTS[k]))
    return lost


@addressed
@seldom
def work(p, w, s, m, at, t, h, end):  # type: ignore[no-untyped-def]
    """Return (work, loss) up to the fraction ``end`` of the step, integrated over its interpolation.

    Second order methods use two Gauss points, others four Lobatto points. Losses of second order methods are the mean
    force of dampers times the distance moved.
    """
    done, lost, low = 0.0, 0.0, m.order <= SECOND_ORDER_ERROR
    for k in range(2 if low else 4):
        x = end * ((0.21132486540518713, 0.7886751345948129, 0.0, 0.0) if low else POINTS)[k]
        f = 0.5 if low else WEIGHTS[k]
        interpolate(m, p, s, h, x, at.z, at.v, at.a)
        set_history(m, p, h, x)
        one, two = power(p, w, at.z, at.v, at.a, t + x * h)
        done += f * one
        lost += f * two
    if low and lost != 0.0:
        lost = _lost_on_the_way(m, p, w, s, at, t, h, end)
    set_history(m, p, h, 0.0)
    return end * h * done, end * h * lost
