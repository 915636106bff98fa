"""One step of the Newmark family: Newmark, HHT and generalized-alpha, with constraints at position level."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import calls
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed, inner, seldom
from ..moving import add_moving_product
from .contact_steps import (
    enable_friction,
    friction_to_limits,
    lost_to_friction,
    open_pulling_points,
    reversal_error,
    unfix_active_set,
)
from .dynamics import add_mass, factor, has_converged, norm, record_increment, residual, signals_at, solve_with
from .feedback import bound_integrals, weigh_state
from .friction import has_friction
from .prediction import best_prediction
from .state import (
    BACKWARD,
    CONTRACTION,
    DONE,
    FRICTION_LOSS,
    INTO_SUPPORTS,
    NEXT_PREDICTION,
    NOT_CONVERGED,
    NOT_FINITE,
    PREDICTION,
    SINGULAR,
    STARTS_CONSISTENT,
)
from .step_control import increment_tolerance, share_of_states

# cost of a new tangent and its factors, in iterations: it is made if the old one would need more iterations than that
MAKING = 3.0
# fraction of the extent: smaller increments count as round-off while contact points alternately open and close (they
# add up from the gap below which a point counts as touching, 1e-12)
TOUCHES = 4e-11
# number of steps that start at z after one of which Newton's method did not converge from another prediction
WAIT = 16.0
# solves with an unsymmetric tangent: most products with its skew part, and the relative residual that is left
KRYLOV, ENOUGH = 8, 1e-4


class Newmark(NamedTuple):
    """(1 - am) alg_1 + am alg_0 = (1 - af) a_1 + af a_0 with Newmark's beta and gamma (Arnold & Bruls 2007).

    starts : 1, or 0 if the method does not use alg at the start of the step (backward Euler); tolerance : of Newton's
    increments, relative to the size of the motion; full : whether every iteration gets a new tangent; end : a Step;
    alg : (n,) algorithmic acceleration at its end; rows (2 KRYLOV + 1, n) : work space; before, after (3, n) : friction
    forces of hard contacts, their sliding rates, and the friction contained in alg, at start and end of the step.
    """

    am: float
    af: float
    beta: float
    gamma: float
    starts: float
    tolerance: float
    max_iterations: int
    full: bool
    end: Any
    alg: Any
    rows: Any
    before: Any
    after: Any


@inner
def _move(m, p, s, h):  # type: ignore[no-untyped-def]
    """Compute z, v and a at the end of the step from the algorithmic acceleration there."""
    end = m.end
    for i in range(len(m.alg)):
        if p.coordinate[i] != 0.0:
            alg0, alg1 = m.starts * s.extra[0, i], m.alg[i]
            end.z[i] = s.z[i] + h * (s.v[i] + h * ((0.5 - m.beta) * alg0 + m.beta * alg1))
            end.v[i] = s.v[i] + h * ((1.0 - m.gamma) * alg0 + m.gamma * alg1)
            end.a[i] = ((1.0 - m.am) * alg1 + m.am * alg0 - m.af * s.a[i]) / (1.0 - m.af)


@inner
def _stands(p, w, end, iteration, step):  # type: ignore[no-untyped-def]
    """Return whether an increment that no longer shrinks is round-off."""
    if calls.at_floor(p.calls, (p, w, end.v, end.a)):
        return True
    # a touching point may open in one iteration and close in the next
    return p.sided and iteration > 2 and step <= TOUCHES * p.extent


@inner
def _left(step, rate, wanted):  # type: ignore[no-untyped-def]
    """Return how many more iterations are needed until increments are below ``wanted``, from the contraction rate."""
    if rate >= 0.5:
        return np.inf
    return np.log(wanted / step) / np.log(max(rate, 1e-3)) if step > wanted else 0.0


@inner
def _along(p, x, y, share):  # type: ignore[no-untyped-def]
    """Return the inner product of two changes of the unknowns: of displacements, plus ``share`` times multipliers."""
    total, others = 0.0, 0.0
    for i in range(len(x)):
        if p.coordinate[i] != 0.0:
            total += p.weights[i] * p.weights[i] * x[i] * y[i]
        else:
            others += x[i] * y[i]
    return total + share * others


@inner
def _share(p, x):  # type: ignore[no-untyped-def]
    """Return the weight of multipliers in ``_along`` that gives them the same share as displacements in x."""
    moves = _along(p, x, x, 0.0)
    forces = _along(p, x, x, 1.0) - moves
    return moves / forces if forces > 0.0 else 0.0


@inner
def _turn(p, w, x, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` with S^-1 N x, where w.A has the factors of S and N is the skew part; return whether N is nonzero.

    If N is zero, ``out`` is set to zero.
    """
    for i in range(len(out)):
        out[i] = 0.0
    if not calls.point_skew(p.calls, (p, x, out)):
        return False
    solve_with(p, w.A, out)
    return True


@inner
def _solve(m, p, w, x):  # type: ignore[no-untyped-def]
    """Solve (S + N) x = b in place, with the factors of S in w.A: x + S^-1 N x = S^-1 b by conjugate residuals.

    The skew part N stems from friction and is small compared with S. The iteration is equivalent to GMRES without
    restarts (Eisenstat, Elman & Schultz 1983).
    """
    solve_with(p, w.A, x)
    n, r = len(x), m.rows[2 * KRYLOV]
    if not p.patched or not _turn(p, w, x, r):
        return
    even = _share(p, x)
    enough = ENOUGH * ENOUGH * _along(p, x, x, even)
    for i in range(n):
        r[i] = -r[i]
    for k in range(KRYLOV):
        if not _along(p, r, r, even) > enough:
            break
        to, of = m.rows[k], m.rows[KRYLOV + k]
        _turn(p, w, r, of)
        for i in range(n):
            to[i] = r[i]
            of[i] += r[i]
        for j in range(k):
            on = m.rows[KRYLOV + j]
            share = _along(p, of, on, even) / _along(p, on, on, even)
            for i in range(n):
                to[i] -= share * m.rows[j, i]
                of[i] -= share * on[i]
        share = _along(p, r, of, even) / _along(p, of, of, even)
        for i in range(n):
            x[i] += share * to[i]
            r[i] -= share * of[i]
    for i in range(n):
        x[i] += r[i]


@inner
def _error(m, p, w, s, h, ca):  # type: ignore[no-untyped-def]
    """Return the local error [m]: the next term of the series in h, with stiff components filtered out."""
    for k in range(len(m.alg)):
        w.x[k] = m.alg[k] - m.starts * s.extra[0, k]
    calls.mass_product(p.calls, (p, w.x, w.y))
    add_moving_product(p, w.x, w.y)
    series = max(abs(m.beta - 1.0 / 6.0), 1.0 / 12.0) if m.starts > 0.0 else 0.5
    factor = series * h * h * ca
    for k in range(len(m.alg)):
        w.y[k] *= factor
    solve_with(p, w.A, w.y)
    for k in range(p.inner, len(m.alg)):
        # states of controllers have no mass: their error is the unfiltered term
        w.y[k] = share_of_states(s, h) * factor / ca * w.x[k]
        weigh_state(p, s, k - p.inner, abs(m.end.v[k]))
    return norm(p, w.y)


@inner
def _go_to(m, p, s, h, prediction):  # type: ignore[no-untyped-def]
    """Set the first iterate of Newton's method to a prediction of the step; the longest keeps alg."""
    for i in range(len(m.alg)):
        if prediction >= 2.0:
            m.alg[i] = s.extra[0, i]
        elif p.coordinate[i] != 0.0:
            rate = s.v[i] / h if prediction < 1.0 else 0.0
            m.alg[i] = -(rate + (0.5 - m.beta) * m.starts * s.extra[0, i]) / m.beta
    copy(s.z, m.end.z)


@inner
def _next_prediction(m, p, w, s, h, failed):  # type: ignore[no-untyped-def]
    """Return the prediction for the next step: z for some steps after a failure, else the one that was best here."""
    if not p.sided and (failed or s.numbers[PREDICTION] < 0.0):
        return -WAIT if failed else s.numbers[PREDICTION] + 1.0
    second = h * h * ((0.5 - m.beta) * m.starts + m.beta)
    for i in range(len(m.alg)):
        w.x[i], w.y[i] = m.end.z[i] - s.z[i], h * s.v[i] + second * s.extra[0, i]
    return best_prediction(p, w, s, h, w.x, w.y)


@inner
def _factored(p, w, end, ca, cv):  # type: ignore[no-untyped-def]
    """Fill w.A with the factors of the tangent at the end of a step; return whether it is regular."""
    if p.sided:
        calls.deactivate_supported(p.calls, (p, w, end.z))
    while True:
        calls.forces_tangent(p.calls, (p, w, end.z, end.v, cv))
        add_mass(p, ca + p.alpha * cv, w.A)
        if factor(p, w, w.A):
            return True
        if not p.sided or not calls.deactivate_dependent(p.calls, (p, w)):
            return False


@inner
def _iterate(m, p, w, s, h, ca):  # type: ignore[no-untyped-def]
    """Solve for the end of the step by Newton's method, starting at m.alg and m.end.

    Returns (outcome, iterations, contraction).
    """
    n, end = len(m.alg), m.end
    cv = m.gamma / (m.beta * h)
    last, rate, pulls = 0.0, s.numbers[CONTRACTION], False
    wanted = increment_tolerance(p, s, h, m.tolerance)
    iteration = 0
    _move(m, p, s, h)
    while True:
        if iteration == 0 or m.full or p.sided or _left(last, rate, wanted) > MAKING:
            if not _factored(p, w, end, ca, cv):
                return SINGULAR, iteration + 1, rate
        else:
            calls.forces(p.calls, (p, w, end.z, end.v))
        residual(p, w, end.v, end.a)
        for i in range(n):
            w.x[i] = -w.R[i]
        _solve(m, p, w, w.x)
        step = norm(p, w.x)
        record_increment(w, iteration, step)
        if not np.isfinite(step):
            return NOT_FINITE, iteration + 1, rate
        if iteration > 0:
            rate = step / last
            if rate > 0.5 and not pulls and _stands(p, w, end, iteration, step):
                break
        for i in range(n):
            if p.coordinate[i] != 0.0:
                m.alg[i] += w.x[i] / (m.beta * h * h)
            else:
                end.z[i] += w.x[i]
        _move(m, p, s, h)
        pulls = p.sided and open_pulling_points(p, end.z)
        last, iteration = step, iteration + 1
        expected = rate if iteration > 1 else min(max(rate, 1e-2), 0.5)
        if iteration >= p.least_iterations and not pulls and has_converged(step, expected, wanted, p, w, end.z, w.amps):
            break
        # the active set changes during the iteration, so the first increments need not shrink
        if iteration >= m.max_iterations or (rate > 2.0 and iteration > 2 and not p.sided):
            return NOT_CONVERGED, iteration, rate
    if p.sided and calls.deactivated_penetrates(p.calls, (p, w, end.z)):
        return INTO_SUPPORTS, iteration, rate
    return DONE, iteration, rate


@inner
def _of_step(m, backward):  # type: ignore[no-untyped-def]
    """Return m or, if ``backward``, the backward Euler method: z_1 = z_0 + h v_1, v_1 = v_0 + h a_1."""
    own = 0.0 if backward else 1.0
    return Newmark(own * m.am, own * m.af, own * m.beta + (1.0 - own), own * m.gamma + (1.0 - own), own, m.tolerance,
                   m.max_iterations, m.full, m.end, m.alg, m.rows, m.before, m.after)


@addressed
@seldom
def newmark_step(p, w, s, own, t, h):  # type: ignore[no-untyped-def]
    """Step from the motion s at t to own.end; return (outcome, iterations, error [m], contraction)."""
    m = _of_step(own, s.numbers[BACKWARD] > 0.0)
    end, ca = m.end, (1.0 - m.am) / ((1.0 - m.af) * m.beta * h * h)
    if p.sided:
        enable_friction(p, s.z)
        m.before[:] = 0.0
        if has_friction(p):
            calls.friction_forces(p.calls, (p, w, s.z, s.v, t, m.before))
            if s.numbers[STARTS_CONSISTENT] > 0.0:
                friction_to_limits(p, s.z, m.before[0])
                copy(m.before[0], m.before[2])
            else:
                copy(s.extra[1], m.before[0])
                copy(s.extra[2], m.before[2])
    signals_at(p, t + h, w.amps)
    prediction = 2.0 - s.numbers[STARTS_CONSISTENT] if p.sided else s.numbers[PREDICTION]
    _go_to(m, p, s, h, prediction)
    # without damping, rates that a limit determines would oscillate more and more, as multipliers do
    bound_integrals(p, m.gamma / (m.beta * h) if m.gamma > 0.5 else 0.0)
    outcome, iterations, rate = _iterate(m, p, w, s, h, ca)
    failed = outcome == NOT_CONVERGED and prediction > 0.0 and (p.sided or p.least_iterations == 1)
    if failed:
        # a fibre may have been predicted to yield, or a sticking point to slide, so that the iteration alternates
        if p.sided:
            unfix_active_set(p)
        _go_to(m, p, s, h, 0.0)
        outcome, more, rate = _iterate(m, p, w, s, h, ca)
        iterations += more
    bound_integrals(p, 0.0)
    if p.sided:
        unfix_active_set(p)
    if outcome != DONE:
        return outcome, iterations, 0.0, rate
    error = _error(m, p, w, s, h, ca)
    if p.sided:
        if has_friction(p):
            calls.friction_forces(p.calls, (p, w, end.z, end.v, t + h, m.after))
            error = max(error, reversal_error(p, m, h))
        s.numbers[FRICTION_LOSS] = h * lost_to_friction(m, p, end.z)
    s.numbers[NEXT_PREDICTION] = _next_prediction(m, p, w, s, h, failed)
    dense = end.dense
    for i in range(len(m.alg)):
        dense[0, i], dense[1, i], dense[2, i] = h * s.v[i], end.z[i] - s.z[i], h * end.v[i]
    return DONE, iterations, error, max(rate, 1e-3)


@addressed
def newmark_accept(s, m):  # type: ignore[no-untyped-def]
    """Store the algorithmic acceleration and friction of an accepted step for the next one."""
    copy(m.alg, s.extra[0])
    copy(m.after[0], s.extra[1])
    copy(m.after[2], s.extra[2])
    s.numbers[STARTS_CONSISTENT], s.numbers[PREDICTION] = 0.0, s.numbers[NEXT_PREDICTION]


@addressed
def newmark_go_on(s, m):  # type: ignore[no-untyped-def]
    """Restart in compiled code after an impact, same as ``newmark_restart``."""
    copy(s.a, s.extra[0])
    s.extra[1:] = 0.0
    s.numbers[STARTS_CONSISTENT], s.numbers[PREDICTION] = 1.0, 2.0


@addressed
def newmark_inside(p, m, h, x):  # type: ignore[no-untyped-def]
    """Set the clocks of relaxing materials to the fraction x of a step h; their laws assume strains linear in time."""
    for k in p.clocks:
        p.states[k] = x * h


def newmark_restart(m: Any, s: Any) -> None:
    """Restart from the accelerations in s, which are consistent."""
    s.extra[:] = 0.0
    s.extra[0], s.numbers[STARTS_CONSISTENT], s.numbers[PREDICTION] = s.a, 1.0, 2.0
