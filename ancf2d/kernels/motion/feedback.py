"""Feedback: signals and controllers' states that depend on the motion, and their low-rank part of the tangent.

Signals are functions of quantities (probes), which are functions of coordinates and rates. Controllers' states are the
last unknowns and obey first-order equations z' = g. The matrix of a motion is D + P^T R, where D is the symmetric
matrix without feedback: a row of P contains what a signal, or the rate of a state, acts on, the row of R what it
depends on. It is solved by the formula of Sherman, Morrison and Woodbury: X = D^-1 P^T, then (1 + R X) y = R D^-1 b and
x = D^-1 b - X y.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...elements import point_laws
from .. import calls
from ..compiled_laws import part
from ..lowlevel.arrays import numbers
from ..lowlevel.jit import addressed, inlined, inner
from ..lowlevel.records import array_at
from ..matrices.band import ldl_factor, ldl_solve
from ..matrices.fronts import fronts_factor, fronts_solve
from ..matrices.symmetric import TINY, band_of
from ..points import add_to, amplitude_of, fields_of_item, law_of_item, rates_of_item, work_arrays
from .dynamics import to_unknowns
from .state import SIZE, evaluate_with_gradient

# a state that is smaller is zero: weights, relative to its size, would be infinite
LEAST_SIZE = 1e-200

_angle_near = part(point_laws.angle_near)
# kinds of quantities: a position, its rate, the angle of a direction, its rate
POSITION, RATE, ANGLE, SPIN = range(4)


class Feedback(NamedTuple):
    """Quantities (q), signals (k) that are functions of them, and states (m) of controllers.

    kind (q,) : kinds of quantities; quantity i depends on d or d' at ``coords`` with weights ``along`` and ``across``,
    from begin[i] to begin[i + 1], and on start[i], its value in the reference or the length of a direction; last_angle
    (q,) : last accepted angles. row (k,) : rows of the signals in the amplitudes; columns (k, n) : change of the
    residual per unit signal by dead loads that follow it; items : point laws that follow signal j, from first[j] to
    first[j + 1]; programs : of signals, rates of states, conditions, and their margins (``model.feedback.margin``);
    watched (conditions,) : PASSED, WAITING or HOLDS (``events``); clock : row of the signal t; states : m; time_scale :
    a time in which states change [s]; scale (m,) : largest sizes of states so far; bounded : whether integrals stop at
    limits, with the pull of ``controllers._bounded`` as the last of ``start``. Work space: values (q,), slopes (1 + q,
    and three margins of each condition), rates (m,), full (n_full,), column (n,).
    """

    kind: Any
    begin: Any
    coords: Any
    along: Any
    across: Any
    start: Any
    last_angle: Any
    row: Any
    columns: Any
    first: Any
    items: Any
    programs: Any
    watched: Any
    clock: int
    states: int
    time_scale: float
    scale: Any
    bounded: bool
    values: Any
    slopes: Any
    rates: Any
    full: Any
    column: Any


def tail_size(n: int, rank: int, states: int) -> int:
    """Return how many numbers follow D in a matrix: P and R, diagonal of the states, 1 + R X and its pivots."""
    return 2 * rank * n + states + rank * rank + rank


@inlined
def _tail(p, A):  # type: ignore[no-untyped-def]
    """Return views of what follows D in a matrix: P (X once factored), R, diagonal of the states, 1 + R X, pivots."""
    n, rank, states = len(p.coordinate), p.rank, p.feedback.states
    square = len(A) - rank - rank * rank
    rates = square - states
    X, R = array_at(A, rates - 2 * rank * n, (rank, n)), array_at(A, rates - rank * n, (rank, n))
    S, pivots = array_at(A, square, (rank, rank)), array_at(A, square + rank * rank, (rank,))
    return X, R, array_at(A, rates, (states,)), S, pivots


@inner
def _components(f, i, x):  # type: ignore[no-untyped-def]
    """Return the products of the weights ``along`` and ``across`` of quantity i with x (n_full,)."""
    one, two = 0.0, 0.0
    for e in range(f.begin[i], f.begin[i + 1]):
        one += f.along[e] * x[f.coords[e]]
        two += f.across[e] * x[f.coords[e]]
    return one, two


@inner
def fill_quantities(f, d, v):  # type: ignore[no-untyped-def]
    """Fill f.values with all quantities at d with rates v (n_full,)."""
    for i in range(len(f.kind)):
        kind = f.kind[i]
        if kind == POSITION:
            f.values[i] = f.start[i] + _components(f, i, d)[0]
        elif kind == RATE:
            f.values[i] = _components(f, i, v)[0]
        else:
            ux, uy = _components(f, i, d)
            if kind == ANGLE:
                f.values[i] = _angle_near(f.start[i], ux, uy, f.last_angle[i])
            else:
                x, (vx, vy) = f.start[i] + ux, _components(f, i, v)
                f.values[i] = (x * vy - uy * vx) / (x * x + uy * uy)


@inner
def _add_gradient(f, i, d, v, factor, c, out):  # type: ignore[no-untyped-def]
    """Add ``factor`` times (derivative of quantity i by d, plus c times that by v) to out (n_full,)."""
    kind, one, two = f.kind[i], factor, 0.0
    if kind == RATE:
        one = factor * c
    elif kind != POSITION:
        ux, uy = _components(f, i, d)
        x = f.start[i] + ux
        L = x * x + uy * uy
        by_x, by_y = -uy / L, x / L
        one, two = factor * by_x, factor * by_y
        if kind == SPIN:
            vx, vy = _components(f, i, v)
            rate = (x * vy - uy * vx) / L
            one = factor * (c * by_x + (vy - 2.0 * x * rate) / L)
            two = factor * (c * by_y - (vx + 2.0 * uy * rate) / L)
    for e in range(f.begin[i], f.begin[i + 1]):
        out[f.coords[e]] += one * f.along[e] + two * f.across[e]


@addressed
def feedback(p, w):  # type: ignore[no-untyped-def]
    """Set the feedback signals in w.amps and the rates of controllers' states in f.rates, at w.d and w.v."""
    f = p.feedback
    fill_quantities(f, w.d, w.v)
    t, signals = w.amps[f.clock, 0], len(f.row)
    for k in range(signals + f.states):
        evaluate_with_gradient(f.programs, k, t, f.values, f.slopes)
        if k < signals:
            w.amps[f.row[k], 0] = f.slopes[0]
        else:
            f.rates[k - signals] = f.slopes[0]


@inner
def _by_amplitude(points, i, d, v, amps, out):  # type: ignore[no-untyped-def]
    """Add the derivative of the forces of item i by its amplitude, in which they are linear, to out (n_full,)."""
    u, w, a, f, H, C = work_arrays(points)
    fields_of_item(points, i, d, u)
    rates_of_item(points, i, v, w)
    amplitude_of(points, i, amps, u, w, a)
    m = points.field[i + 1] - points.field[i]
    a[0] = 0.0
    law_of_item(points, i, u, w, a, f, H, C, m)
    u[:] = 0.0
    for k in range(m):
        u[k] = -f[k]
    add_to(points, i, u, out)
    fields_of_item(points, i, d, u)
    a[0] = 1.0
    law_of_item(points, i, u, w, a, f, H, C, m)
    add_to(points, i, f, out)


@addressed
def feedback_tangent(p, w, c):  # type: ignore[no-untyped-def]
    """Fill P, R and the diagonal of the states in w.A at w.d, w.v, after ``feedback``."""
    f, n = p.feedback, len(p.coordinate)
    signals, rank = len(f.row), p.rank
    P, R, rates, _, _ = _tail(p, w.A)
    t = w.amps[f.clock, 0]
    for j in range(f.states):
        rates[j] = c
    for k in range(rank):
        evaluate_with_gradient(f.programs, k, t, f.values, f.slopes)
        f.full[:] = 0.0
        for i in range(len(f.kind)):
            if f.slopes[1 + i] != 0.0:
                _add_gradient(f, i, w.d, w.v, f.slopes[1 + i], c, f.full)
        to_unknowns(p, f.full, f.column, False)
        sign = 1.0 if k < signals else -1.0
        for i in range(n):
            R[k, i] = sign * f.column[i]
        if k >= signals:
            P[k, p.inner + k - signals] = 1.0
            continue
        f.full[:] = 0.0
        for j in range(f.first[k], f.first[k + 1]):
            if not p.points.on[f.items[j]]:
                continue
            _by_amplitude(p.points, f.items[j], w.d, w.v, w.amps, f.full)
        to_unknowns(p, f.full, f.column, False)
        for i in range(n):
            P[k, i] = f.columns[k, i] + f.column[i]


@addressed
def feedback_accept(p, w):  # type: ignore[no-untyped-def]
    """Update the last accepted angles and the largest sizes of states at the accepted state w.d."""
    f = p.feedback
    for i in range(len(f.kind)):
        if f.kind[i] == ANGLE:
            ux, uy = _components(f, i, w.d)
            f.last_angle[i] = _angle_near(f.start[i], ux, uy, f.last_angle[i])
    for j in range(f.states):
        size = abs(w.d[p.full[p.inner + j]])
        if size > max(f.scale[j], LEAST_SIZE):
            f.scale[j] = size
        if f.scale[j] > 0.0:
            p.straining[p.inner + j] = p.extent / f.scale[j]


@inner
def bound_integrals(p, rate):  # type: ignore[no-untyped-def]
    """Let integrals stop at limits exactly in a step with this derivative of rates by unknowns [1/s], or in a band (0).

    If distances from limits counted more, Newton's method would alternate between the full rate and none
    (``controllers._bounded``).
    """
    if p.feedback.bounded:
        p.feedback.start[len(p.feedback.start) - 1] = rate


@inner
def weigh_state(p, s, j, rate):  # type: ignore[no-untyped-def]
    """Set the weight of state j in error norms: relative to its largest size, or to ``time_scale`` times its rate."""
    scale = max(p.feedback.scale[j], p.feedback.time_scale * rate)
    if scale < LEAST_SIZE:
        scale = 0.0
    p.feedback.scale[j] = scale
    p.weights[p.inner + j] = s.numbers[SIZE] / scale if scale > 0.0 else 0.0


@inner
def _solve_small(S, pivots, x, n):  # type: ignore[no-untyped-def]
    """Solve S x = b in place with the factors of ``_factor_small``."""
    for k in range(n):
        q = int(pivots[k].real)
        x[k], x[q] = x[q], x[k]
    for k in range(n):
        for i in range(k + 1, n):
            x[i] -= S[i, k] * x[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= S[k, j] * x[j]
        x[k] /= S[k, k]


@inner
def _factor_small(S, pivots, n):  # type: ignore[no-untyped-def]
    """Factor S (n, n) in place by Gaussian elimination with row exchanges; return whether it is regular."""
    for k in range(n):
        q = k
        for i in range(k + 1, n):
            if abs(S[i, k]) > abs(S[q, k]):
                q = i
        pivots[k] = q
        if not abs(S[q, k]) > 0.0:
            return False
        for j in range(n):
            S[k, j], S[q, j] = S[q, j], S[k, j]
        for i in range(k + 1, n):
            S[i, k] /= S[k, k]
            for j in range(k + 1, n):
                S[i, j] -= S[i, k] * S[k, j]
    return True


def _with_border(factor_inner: Any, solve_inner: Any, kind: str) -> tuple[Any, Any]:
    """Return the functions that factor D + P^T R and solve with these factors, for matrices of one kind."""
    factor_own, solve_own = inner(factor_inner), inner(solve_inner)

    def factor(p, A, scale):  # type: ignore[no-untyped-def]
        n, rank, states = len(p.coordinate), p.rank, p.feedback.states
        X, R, rates, S, pivots = _tail(p, A)
        if not factor_own(p, A, scale):
            return False
        for j in range(states):
            # in a matrix without feedback, states are decoupled
            if rates[j] == 0.0:
                rates[j] = 1.0
        for k in range(rank):
            solve_own(p, A, X[k])
            for j in range(states):
                X[k, p.inner + j] /= rates[j]
        for k in range(rank):
            for q in range(rank):
                total = 0.0 * X[q, 0]
                for i in range(n):
                    total += R[k, i] * X[q, i]
                S[k, q] = total
            S[k, k] += 1.0
        return _factor_small(S, pivots, rank)

    def solve(p, A, x):  # type: ignore[no-untyped-def]
        n, rank, states = len(p.coordinate), p.rank, p.feedback.states
        X, R, rates, S, pivots = _tail(p, A)
        y = numbers(A, rank)
        solve_own(p, A, x)
        for j in range(states):
            x[p.inner + j] /= rates[j]
        for k in range(rank):
            total = 0.0 * x[0]
            for i in range(n):
                total += R[k, i] * x[i]
            y[k] = total
        _solve_small(S, pivots, y, rank)
        for k in range(rank):
            for i in range(n):
                x[i] -= X[k, i] * y[k]

    factor.__qualname__, solve.__qualname__ = f"factor_border_{kind}", f"solve_border_{kind}"
    return addressed(factor), addressed(solve)


def _factor_band(p, A, scale):  # type: ignore[no-untyped-def]
    scale[0] = ldl_factor(band_of(p, A), TINY, scale)[0]
    return scale[0].real < 0.0


def _solve_band(p, A, x):  # type: ignore[no-untyped-def]
    ldl_solve(band_of(p, A), x)


def _factor_fronts(p, A, scale):  # type: ignore[no-untyped-def]
    scale[0] = fronts_factor(p.fronts, A, TINY, scale)[0]
    return scale[0].real < 0.0


def _solve_fronts(p, A, x):  # type: ignore[no-untyped-def]
    fronts_solve(p.fronts, A, x)


_BORDERED = _with_border(_factor_band, _solve_band, "band"), _with_border(_factor_fronts, _solve_fronts, "fronts")


def feedback_functions(fronts: bool, problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries of the table of a model with feedback (``kernels.calls.table``)."""
    factor, solve = _BORDERED[fronts]
    return {calls.feedback: (feedback, problem), calls.factor: (factor, problem),
            calls.factor_complex: (factor, problem), calls.solve: (solve, problem),
            calls.solve_complex: (solve, problem), calls.feedback_accept: (feedback_accept, problem),
            calls.feedback_tangent: (feedback_tangent, problem)}


def no_feedback(programs: Any) -> Feedback:
    """Return feedback without quantities, signals and states, which has the type of all."""
    x, n, two = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 0))
    return Feedback(n, n, n, x, x, x, x, n, two, n, n, programs, n, 0, 0, 0.0, x, False, x, x, x, x, x)
