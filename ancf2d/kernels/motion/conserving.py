"""One step of the energy-momentum method: mean stress, discrete gradients, constraints at the end of the step."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import calls
from ..bodies import mean_elastic, mean_elastic_tangent, set_natural, work_of_natural
from ..lowlevel.jit import addressed, inner, seldom
from .dynamics import (
    FORCES,
    TANGENTS,
    add_loads,
    add_mass,
    factor,
    has_converged,
    lost_to_mass_damping,
    norm,
    patches_tangent,
    record_increment,
    signals_at,
    solve_with,
    to_full,
    to_unknowns,
)
from .state import CONTRACTION, DONE, NOT_CONVERGED, NOT_FINITE, SINGULAR, SIZE

# increments that no longer shrink count as round-off below this fraction of the size of the motion
ROUND_OFF = 1e-15

# contraction above which the next iteration gets a new tangent
SLOW = 0.2


class Conserving(NamedTuple):
    """M (v_1 - v_0)/h + Q(z_0, z_1) = F, (z_1 - z_0)/h = (v_0 + v_1)/2 (Simo & Tarnow 1992, Gonzalez 1996).

    tolerance : of Newton's increments, relative to the size of the motion; full : whether every iteration gets a new
    tangent; end : a Step; d0 (n_full,) full coordinates at the start; dz, mid, rate (n,) : increment, work space, mean
    rate; amps (3, signals, 3) : signals at start and end of the step, and their change.
    """

    tolerance: float
    max_iterations: int
    full: bool
    end: Any
    d0: Any
    dz: Any
    mid: Any
    rate: Any
    amps: Any


@inner
def _mean_patches(p, d0, d1, v, amps0, amps1, mid, Q):  # type: ignore[no-untyped-def]
    """Add the forces of point laws and joints over a step to Q; return the power they dissipate."""
    if len(p.sliding.multiplier) > 0:
        calls.sliding_mean(p.calls, (p.sliding, d0, d1, mid, Q))
    if len(p.points.mem) == 0:
        return 0.0
    return calls.point_mean(p.calls, (p.points, d0, d1, v, amps0, amps1, Q))[1]


@inner
def _half_patches(m, p, w, s, h):  # type: ignore[no-untyped-def]
    """Set w.A to half the tangent of point laws and joints at the middle of the step, which halves constraints too."""
    for i in range(len(m.dz)):
        m.mid[i] = s.z[i] + 0.5 * m.dz[i] if p.coordinate[i] != 0.0 else m.end.z[i]
    to_full(p, m.mid, w.amps, 0, w.d)
    patches_tangent(p, w, 2.0 / h)
    for i in range(len(w.A)):
        w.A[i] *= 0.5


@inner
def _balance(m, p, w, s, h, tangent):  # type: ignore[no-untyped-def]
    """Fill w.R with M (v_1 - v_0)/h + T^T (Q - F) and w.Q with Q - F; w.amps has the signals of the middle.

    With ``tangent``, also fill w.A with the symmetric derivative by z_1, where constraints are halved.
    """
    n = len(m.dz)
    to_full(p, m.rate, w.amps, 1, w.v)
    if tangent:
        w.A[:] = 0.0
        if p.patched:
            _half_patches(m, p, w, s, h)
    to_full(p, m.end.z, m.amps[1], 0, w.d)
    w.Q[:] = 0.0
    w.counts[TANGENTS if tangent else FORCES] += 1
    set_natural(p, m.amps[1], m.amps[0])
    if tangent:
        mean_elastic_tangent(p, h, m.d0, w.d, w.Q, w.A)
        add_mass(p, (2.0 / h + p.alpha) / h, w.A)
    else:
        mean_elastic(p, h, m.d0, w.d, w.Q)
    _mean_patches(p, m.d0, w.d, w.v, m.amps[0], m.amps[1], w.other, w.Q)
    add_loads(p, w.amps, -1.0, w.Q)
    to_unknowns(p, w.Q, w.R, False)
    for i in range(n):
        m.mid[i] = p.coordinate[i] * 2.0 * (m.rate[i] - s.v[i]) / h
        w.x[i] = m.mid[i] + p.alpha * m.rate[i] * p.coordinate[i]
    calls.mass_product(p.calls, (p, w.x, w.y))
    for i in range(n):
        w.R[i] += w.y[i]
    for k in range(len(p.motion_mass_signal)):
        q = p.motion_mass_signal[k]
        f = (m.amps[1, q, 1] - m.amps[0, q, 1]) / h + p.alpha * w.amps[q, 1]
        for i in range(n):
            w.R[i] += f * p.motion_mass[k, i]


@inner
def _error(m, p, w, s, h):  # type: ignore[no-untyped-def]
    """Return the local error [m] from the change of acceleration since the last step, stiff components filtered."""
    for k in range(len(m.dz)):
        w.x[k] = (m.end.v[k] - s.v[k]) / h - s.a[k]
    calls.mass_product(p.calls, (p, w.x, w.y))
    for k in range(len(m.dz)):
        w.y[k] *= 1.0 / 6.0
    solve_with(p, w.A, w.y)
    return norm(p, w.y)


@addressed
@seldom
def conserving_step(p, w, s, m, t, h):  # type: ignore[no-untyped-def]
    """Step from the motion s at t to m.end; return (outcome, iterations, error [m], contraction)."""
    n, end = len(m.dz), m.end
    signals_at(p, t, m.amps[0])
    signals_at(p, t + h, m.amps[1])
    signals_at(p, t + 0.5 * h, w.amps)
    to_full(p, s.z, m.amps[0], 0, m.d0)
    last, rate = 0.0, s.numbers[CONTRACTION]
    size = max(s.numbers[SIZE], 1e-3 * p.extent)
    for i in range(n):
        # undamped stiff motions alternate from step to step, so the last acceleration does not predict the next one
        m.dz[i] = p.coordinate[i] * h * s.v[i]
        m.rate[i] = m.dz[i] / h
        end.z[i] = s.z[i] + m.dz[i]
    iteration = 0
    while True:
        # the ratio of increments that are round-off says nothing about the tangent
        anew = iteration == 0 or m.full or (rate > SLOW and (iteration == 1 or last * SLOW > ROUND_OFF * size))
        _balance(m, p, w, s, h, anew)
        if anew and not factor(p, w, w.A):
            return SINGULAR, iteration + 1, 0.0, rate
        for i in range(n):
            w.x[i] = -w.R[i] if p.coordinate[i] != 0.0 else -0.5 * w.R[i]
        solve_with(p, w.A, w.x)
        step = norm(p, w.x)
        record_increment(w, iteration, step)
        if not np.isfinite(step):
            return NOT_FINITE, iteration + 1, 0.0, rate
        if iteration > 0:
            rate = step / last
            # a residual does work in every step, so iterate until increments stop shrinking
            if rate > 0.9:
                # size of the terms whose differences are accelerations
                for i in range(n):
                    m.mid[i] = 2.0 * (abs(m.rate[i]) + abs(s.v[i])) / h
                if step <= ROUND_OFF * size or calls.at_floor(p.calls, (p, w, m.rate, m.mid)):
                    break
        for i in range(n):
            if p.coordinate[i] != 0.0:
                m.dz[i] += w.x[i]
                m.rate[i] = m.dz[i] / h
                end.z[i] = s.z[i] + m.dz[i]
            else:
                end.z[i] += 0.5 * w.x[i]
        last, iteration = step, iteration + 1
        w.other[:] = 0.0
        if has_converged(step, rate if iteration > 1 else 0.5, m.tolerance * size, p, w, end.z, m.amps[1]):
            break
        if iteration >= m.max_iterations or (rate > 2.0 and iteration > 2):
            return NOT_CONVERGED, iteration, 0.0, rate
    dense = end.dense
    for i in range(n):
        end.v[i] = (2.0 * m.rate[i] - s.v[i]) * p.coordinate[i]
        dense[0, i], dense[1, i], dense[2, i] = h * s.v[i], end.z[i] - s.z[i], h * end.v[i]
    error = _error(m, p, w, s, h)
    for i in range(n):
        end.a[i] = (end.v[i] - s.v[i]) / h
    return DONE, iteration, error, max(rate, 1e-3)


@inner
def _dot(x, y):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(len(x)):
        total += x[i] * y[i]
    return total


@inner
def _lost_in_elements(m, p, w, h, change, before):  # type: ignore[no-untyped-def]
    """Add the elements' forces to w.Q; return the loss by their damping and the work of natural strains in the step.

    ``change`` (n_full,) is the change of d; ``before`` the work of w.Q on it before the elements are added.
    """
    set_natural(p, m.amps[1], m.amps[0])
    work, viscous = work_of_natural(p, h, m.d0, w.d)
    mean_elastic(p, h, m.d0, w.d, w.Q)
    damped = False
    for tau in p.tau:
        damped |= tau > 0.0
    if not damped:
        return 0.0, work
    w.other[:] = 0.0
    # an infinite step has zero rates: elastic forces only
    mean_elastic(p, np.inf, m.d0, w.d, w.other)
    return _dot(w.Q, change) - before - _dot(w.other, change) + viscous, work


@inner
def _work_of_inertia(m, p, w, s, h):  # type: ignore[no-untyped-def]
    """Return (work of prescribed motion on masses, loss by mass damping) of a step; w.amps: signals of its middle."""
    work, signals = 0.0, p.motion_mass_signal
    lost = h * lost_to_mass_damping(p, w, m.rate)
    for k in range(len(signals)):
        q = signals[k]
        mean = 0.5 * (m.amps[0, q, 1] + m.amps[1, q, 1])
        gained, damped = 0.0, 0.0
        for i in range(len(m.rate)):
            f = p.motion_mass[k, i] * p.coordinate[i]
            gained += f * 2.0 * (m.rate[i] - s.v[i])
            damped += f * m.rate[i]
        for j in range(len(signals)):
            gained += p.motion_mutual[k, j] * (m.amps[1, signals[j], 1] - m.amps[0, signals[j], 1])
            damped += p.motion_mutual[k, j] * w.amps[signals[j], 1]
        damped *= h * p.alpha
        work += mean * (gained + damped)
        # prescribed rates are damped with their mean over the step, consistent with the kinetic energy
        lost += (mean - w.amps[q, 1]) * damped
    return work, lost


@addressed
@seldom
def conserving_work(p, w, s, m, t, h):  # type: ignore[no-untyped-def]
    """Return (work, loss) of the step just computed, by the forces of its balance, which makes their sum exact.

    Work is that of varying loads, prescribed motion and point laws, as in ``power_of_loads``.
    """
    change = w.v
    signals_at(p, t + 0.5 * h, w.amps)
    to_full(p, m.rate, w.amps, 1, w.v)
    to_full(p, m.end.z, m.amps[1], 0, w.d)
    w.Q[:] = 0.0
    lost = h * _mean_patches(p, m.d0, w.d, w.v, m.amps[0], m.amps[1], w.other, w.Q)
    for q in range(m.amps.shape[1]):
        m.amps[2, q, 0] = m.amps[1, q, 0] - m.amps[0, q, 0]
    to_full(p, m.dz, m.amps[2], 0, change)
    of_patches = _dot(w.Q, change)
    work = lost - of_patches
    damped, of_natural = _lost_in_elements(m, p, w, h, change, of_patches)
    lost, work = lost + damped, work + of_natural
    for k in range(len(p.load_coord)):
        if p.load_varies[k]:
            work += p.load_value[k] * w.amps[p.load_signal[k], 0] * change[p.load_coord[k]]
    add_loads(p, w.amps, -1.0, w.Q)
    for k in range(len(p.motion_coord)):
        work += w.Q[p.motion_coord[k]] * p.motion_factor[k] * m.amps[2, p.motion_signal[k], 0]
    of_drive, of_damping = _work_of_inertia(m, p, w, s, h)
    return work + of_drive, lost + of_damping


@addressed
def conserving_accept(s, m):  # type: ignore[no-untyped-def]
    """Do nothing: only the end of the step is needed."""


def conserving_restart(m: Any, s: Any) -> None:
    """Do nothing: the method has no data of earlier steps."""
