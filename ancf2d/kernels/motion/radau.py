"""One step of Radau IIA with s stages, order 2 s - 1, on positions, rates and multipliers (index 3).

Stage values solve M A_i + Q(z_i, V_i) = F(t_i), g(z_i) = 0 with V = W (z - z_0)/h, A = W (V - v_0)/h, W the inverse
of the coefficients (Hairer, Lubich & Roche 1989). The eigenvectors of W split Newton's system of s n unknowns into one
real and (s - 1)/2 complex bands (Hairer & Wanner 1996, IV.8). These share one tangent, which is rotated with the
sections from stage to stage: a slender element is so much stiffer along than across that the tangent of another stage,
a hundredth of a turn away, would be useless.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import calls
from ..lowlevel.arrays import copy, copy_rows
from ..lowlevel.jit import addressed, inner
from ..lowlevel.records import array_at
from ..moving import add_moving_product
from ..patches import violation
from .dynamics import SATISFIED, norm, record_increment, residual, signals_at, solve_with, to_full, weighted_norm
from .feedback import bound_integrals, weigh_state
from .prediction import best_prediction_of_stages, predict_stages
from .reused_tangent import count, tangent, turn, turns
from .stages import TILE, combine, give, let_relax, place, ungive
from .state import (
    CONTRACTION,
    DONE,
    LOST,
    NEXT_PREDICTION,
    NOT_CONVERGED,
    NOT_FINITE,
    OLD_STEP,
    PREDICTION,
    SINGULAR,
    START_WAIT,
    TANGENT_STEP,
    TANGENT_TIME,
)
from .step_control import increment_tolerance, round_off, share_of_states

# failures of Newton's method after one also from z for which it is not tried there: in stiff motions it hardly helps
WAIT = 4.0


@inner
def separate(F, R, y, u, rows):  # type: ignore[no-untyped-def]
    """Fill y (n,) and u (k, n) with F R: its first row, then real and imaginary parts; rows (s, TILE) is work space."""
    n = len(y)
    for first in range(0, n, TILE):
        count = min(TILE, n - first)
        combine(F, 0, R, first, y, first, count)
        for q in range(len(u)):
            for j in (1 + 2 * q, 2 + 2 * q):
                combine(F, j, R, first, rows, j * TILE, count)
            out = u[q]
            for k in range(count):
                out[first + k] = complex(rows[1 + 2 * q, k], rows[2 + 2 * q, k])


@inner
def unite(F, y, u, R, rows):  # type: ignore[no-untyped-def]
    """Fill R (s, n) with F (y, Re u_1, Im u_1, ...); rows (s, TILE) is work space."""
    n = len(y)
    for first in range(0, n, TILE):
        count = min(TILE, n - first)
        for k in range(count):
            rows[0, k] = y[first + k]
        for q in range(len(u)):
            x = u[q]
            for k in range(count):
                rows[1 + 2 * q, k], rows[2 + 2 * q, k] = x[first + k].real, x[first + k].imag
        for i in range(len(R)):
            combine(F, i, rows, 0, R, i * n + first, count)


class Radau(NamedTuple):
    """Coefficients and arrays of Radau IIA with s stages (s odd), of a problem with n unknowns.

    c (s,) nodes; W (s, s); real mu, complex mus (k,) its eigenvalues; apart (s, s) : minus its left eigenvectors, the
    real one, then real and imaginary parts; together (s, s) : right eigenvectors, which combine these parts to stages;
    embedded (1, s) and gamma of the error estimate; tolerance of Newton's increments; full : whether every step gets a
    new tangent, as for materials that yield; fixed : whether steps have a fixed size; damped : whether tangents depend
    on rates; multipliers : indices of the multipliers among the unknowns; end : a Step; X (less the start, except for
    multipliers), V, A, R (s, n) stages; kept (s, n) residuals of the stages; B, C (k, ...) factors; y (n,), u (k, n);
    amps (s, signals, 3); cosine, sine (s, pairs): rotation of vectors at a stage relative to the tangent's state;
    held (4,) : time and step size of the factors, iterations of this step, and energy lost in relaxation; facing
    (2, pairs) : directions of the vectors at the tangent's state; F (s, s), rows (s, TILE) : work space; relaxing :
    history variables of relaxing materials at the stages.
    """

    c: Any
    W: Any
    mu: float
    mus: Any
    apart: Any
    together: Any
    embedded: Any
    gamma: float
    tolerance: float
    max_iterations: int
    full: bool
    fixed: bool
    damped: bool
    multipliers: Any
    end: Any
    X: Any
    V: Any
    A: Any
    R: Any
    kept: Any
    B: Any
    C: Any
    y: Any
    u: Any
    amps: Any
    cosine: Any
    sine: Any
    held: Any
    facing: Any
    F: Any
    rows: Any
    relaxing: Any


@inner
def _rates(m, s, h, further):  # type: ignore[no-untyped-def]
    """Compute V and A of the stages from X, after adding the increments R to X if ``further``; R becomes V - v."""
    stages, n = m.X.shape
    for i in range(stages):
        for j in range(stages):
            m.F[i, j] = m.W[i, j] / h
    for first in range(0, n, TILE):
        count = min(TILE, n - first)
        v = array_at(s.v, first, (count,))
        for i in range(stages if further else 0):
            x, r = array_at(m.X, i * n + first, (count,)), array_at(m.R, i * n + first, (count,))
            for k in range(count):
                x[k] += r[k]
        for i in range(stages):
            combine(m.F, i, m.X, first, m.V, i * n + first, count)
            x, r = array_at(m.V, i * n + first, (count,)), array_at(m.R, i * n + first, (count,))
            for k in range(count):
                r[k] = x[k] - v[k]
        for i in range(stages):
            combine(m.F, i, m.R, first, m.A, i * n + first, count)
    for k in m.multipliers:
        for i in range(stages):
            m.V[i, k] = m.A[i, k] = 0.0


@inner
def _solve(m, p):  # type: ignore[no-untyped-def]
    """Replace the residuals in m.R by the increments of the stages; return the largest, weighted by straining [m]."""
    stages = len(m.c)
    for i in range(stages):
        turn(m, p, i, -1.0, m.R[i])
    separate(m.apart, m.R, m.y, m.u, m.rows)
    solve_with(p, m.B, m.y)
    for q in range(len(m.mus)):
        calls.solve_complex(p.calls, (p, m.C[q], m.u[q]))
    unite(m.together, m.y, m.u, m.R, m.rows)
    size = 0.0
    for i in range(stages):
        turn(m, p, i, 1.0, m.R[i])
        largest = weighted_norm(p.straining, m.R[i])
        if size == size and not largest <= size:
            size = largest
    return size


@inner
def _error(m, p, w, s, h, kept):  # type: ignore[no-untyped-def]
    """Return the local error [m]: the difference from the embedded formula of order s, stiff components filtered.

    ``kept`` : whether the factors are those of an earlier step, so that vectors must be rotated.
    """
    n = len(m.y)
    g, f = m.gamma * h, (m.mu / h) ** 2
    for first in range(0, n, TILE):
        combine(m.embedded, 0, m.X, first, w.x, first, min(TILE, n - first))
        combine(m.embedded, 0, m.R, first, w.y, first, min(TILE, n - first))
    # states of controllers have no mass: their error is the unfiltered difference
    states, share = p.feedback.rates, share_of_states(s, h)
    for j in range(n - p.inner):
        states[j] = share * (w.x[p.inner + j] + g * s.v[p.inner + j])
    for k in range(n):
        w.x[k] = (w.x[k] + g * (s.v[k] + (g * s.a[k] + w.y[k]))) * p.coordinate[k] * f
    calls.mass_product(p.calls, (p, w.x, w.y))
    add_moving_product(p, w.x, w.y)
    if kept:
        turn(m, p, 0, -1.0, w.y)
    solve_with(p, m.B, w.y)
    if kept:
        turn(m, p, 0, 1.0, w.y)
    for j in range(n - p.inner):
        w.y[p.inner + j] = states[j]
        rate = abs(s.v[p.inner + j])
        for i in range(len(m.c)):
            rate = max(rate, abs(m.V[i, p.inner + j]))
        weigh_state(p, s, j, rate)
    return norm(p, w.y)


@inner
def _met(m, p, w, s):  # type: ignore[no-untyped-def]
    """Return whether the constraints hold to round-off at the end of the step."""
    if not p.patched:
        return True
    last = len(m.c) - 1
    place(m, p, w, s, last)
    to_full(p, m.y, w.amps, 0, w.d)
    return violation(p, w.d, w.amps) <= SATISFIED


@inner
def _finish(m, p, s, h):  # type: ignore[no-untyped-def]
    """Fill the end of the step and the coefficients of its interpolation."""
    stages, n = m.X.shape
    end, last = m.end, stages - 1
    for k in range(n):
        end.z[k] = s.z[k] * p.coordinate[k] + m.X[last, k]
        end.v[k], end.a[k] = m.V[last, k], m.A[last, k]
        end.dense[0, k] = h * s.v[k]
    for i in range(stages):
        for k in range(n):
            end.dense[1 + i, k] = h * m.V[i, k]
    # multipliers: polynomial through the start and all stages, given by its rates there
    for k in m.multipliers:
        for i in range(stages + 1):
            end.dense[i, k] = 0.0
        for j in range(stages):
            f = 1.0 / m.c[j]
            for q in range(stages):
                if q != j:
                    f *= m.c[q] / (m.c[q] - m.c[j])
            x = m.X[j, k] - s.z[k]
            end.dense[0, k] += f * x
            for i in range(stages):
                end.dense[1 + i, k] += m.W[i, j] * x


@inner
def _at_floor(m, p, w, s, h):  # type: ignore[no-untyped-def]
    """Return whether all residuals of the stages (m.kept) are within the round-off of their terms."""
    stages = len(m.c)
    for i in range(stages):
        place(m, p, w, s, i)
        give(m.relaxing, m.relaxing.inner[i])
        to_full(p, m.y, w.amps, 0, w.d)
        copy(m.kept[i], w.R)
        # size of the terms whose differences are the second rates
        for k in range(len(w.x)):
            size = 0.0
            for j in range(stages):
                size += abs(m.W[i, j]) * (abs(m.V[j, k]) + abs(s.v[k]))
            w.x[k] = size / h
        if not calls.at_floor(p.calls, (p, w, m.V[i], w.x)):
            return False
    return True


@inner
def _iterate(m, p, w, s, h):  # type: ignore[no-untyped-def]
    """Solve for the stages by Newton's method from the prediction; return (outcome, iterations, contraction)."""
    rate, last, iteration = s.numbers[CONTRACTION], 0.0, 0
    wanted, least = increment_tolerance(p, s, h, m.tolerance), round_off(p, s)
    while True:
        for i in range(len(m.c)):
            place(m, p, w, s, i)
            give(m.relaxing, m.relaxing.inner[i])
            calls.forces(p.calls, (p, w, m.y, m.V[i]))
            residual(p, w, m.V[i], m.A[i])
            copy(w.R, m.R[i])
            copy(w.R, m.kept[i])
        step = _solve(m, p)
        record_increment(w, iteration, step)
        if not np.isfinite(step):
            return NOT_FINITE, iteration + 1, rate
        if iteration > 0:
            rate = step / last
        # predicted size of the increment after the last iteration allowed
        ahead = step * rate ** (m.max_iterations - iteration - 1) if iteration > 2 else 0.0
        in_vain = iteration + 1 >= m.max_iterations or (rate > 2.0 and iteration > 1) or ahead > wanted
        # increments do not show convergence if they are round-off
        if iteration > 1 and (rate > 0.5 or in_vain) and _at_floor(m, p, w, s, h):
            _rates(m, s, h, False)
            return DONE, iteration, rate
        _rates(m, s, h, True)
        let_relax(m, p, w, s)
        last, iteration = step, iteration + 1
        expected = rate if iteration > 1 else min(max(rate, 1e-2), 0.5)
        small = step == 0.0 or (expected < 1.0 and step * expected <= wanted * (1.0 - expected))
        if m.fixed and iteration == 1:
            # one increment gives no contraction rate, and its error adds up over many short steps
            small = step <= least
        if small and iteration >= p.least_iterations and _met(m, p, w, s):
            return DONE, iteration, rate
        if in_vain:
            return NOT_CONVERGED, iteration, rate


@addressed
def radau_step(p, w, s, m, t, h):  # type: ignore[no-untyped-def]
    """Step from the motion s at t to m.end; return (outcome, iterations, error [m], contraction)."""
    for i in range(len(m.c)):
        signals_at(p, t + m.c[i] * h, m.amps[i])
    relaxes, prediction = len(m.relaxing.runs) > 0, s.numbers[PREDICTION]
    if relaxes:
        calls.begin_stages(m.relaxing.calls, (m, h))
    exact = p.feedback.bounded
    bound_integrals(p, m.mu / h)
    while True:
        predict_stages(m, p, s, h, prediction)
        _rates(m, s, h, False)
        let_relax(m, p, w, s)
        if not tangent(m, p, w, s, t, h):
            s.numbers[TANGENT_STEP] = 0.0
            ungive(m.relaxing)
            bound_integrals(p, 0.0)
            return SINGULAR, 1, 0.0, s.numbers[CONTRACTION]
        kept = s.numbers[TANGENT_TIME] < t
        turns(m, p, w, s)
        outcome, iterations, rate = _iterate(m, p, w, s, h)
        ungive(m.relaxing)
        if outcome == DONE:
            break
        s.numbers[TANGENT_STEP] = 0.0
        if not kept:
            if exact:
                # stages on different sides of a switch share a tangent that fits one side: a band makes it smooth
                exact = False
                bound_integrals(p, 0.0)
                continue
            # where forces have no value, a start at z would only lead there in ever shorter steps
            waits = s.numbers[START_WAIT] > 0.0
            hopeless = s.numbers[OLD_STEP] > 0.0 and (outcome != NOT_CONVERGED or waits)
            if prediction == 0.0 or p.least_iterations > 1 or hopeless:
                if waits:
                    s.numbers[START_WAIT] -= 1.0
                elif prediction == 0.0:
                    s.numbers[START_WAIT] = WAIT
                return outcome, iterations, 0.0, rate
            # prediction errors in displacements do not show strains, which may be too large for Newton's method
            prediction = 0.0
    bound_integrals(p, 0.0)
    m.held[2] = iterations
    m.held[3] = calls.lost_in_relaxing(m.relaxing.calls, (p, w, s, m)) if relaxes else 0.0
    error = _error(m, p, w, s, h, kept)
    s.numbers[NEXT_PREDICTION] = best_prediction_of_stages(m, p, w, s, h)
    _finish(m, p, s, h)
    return DONE, iterations, error, max(rate, 1e-3)


@addressed
def radau_accept(s, m):  # type: ignore[no-untyped-def]
    """Store the stages of an accepted step for the next prediction, and count the cost of the tangent."""
    s.numbers[PREDICTION] = s.numbers[NEXT_PREDICTION]
    s.numbers[LOST] += m.held[3]
    copy_rows(m.X, array_at(s.extra, 0, m.X.shape))
    count(s, m.held[2])


def radau_restart(m: Any, s: Any) -> None:
    """Restart: the series in h predicts the next step, which gets a new tangent."""
    s.numbers[OLD_STEP], s.numbers[TANGENT_STEP], s.numbers[PREDICTION] = 0.0, 0.0, 2.0
