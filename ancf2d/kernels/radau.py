"""One step of Radau IIA with s stages, order 2 s - 1, on positions, rates and multipliers (index 3).

Stage values solve M A_i + Q(z_i, V_i) = F(t_i), g(z_i) = 0 with V = W (z - z_0)/h, A = W (V - v_0)/h, W the inverse
of the coefficients (Hairer, Lubich & Roche 1989). Newton's systems of s n unknowns fall apart into one real and
(s - 1)/2 complex bands by the eigenvectors of W (Hairer & Wanner 1996, IV.8). They share one tangent, which is turned
with the sections from stage to stage: a slender element is so much stiffer along than across that the tangent of
another stage, a hundredth of a turn away, would be none.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .amplitudes import evaluate
from .arrays import copy, copy_rows
from .band import ldl_solve
from .dynamics import at_floor, factor, forces, forces_tangent, norm, remember, residual, to_full, turned, violation
from .jit import inlined, inner
from .mass import mass_product
from .motion import CONTRACTION, DONE, NOT_CONVERGED, NOT_FINITE, OLD_STEP, SINGULAR, SIZE


class Radau(NamedTuple):
    """Coefficients and arrays of Radau IIA with s stages (s odd).

    c (s,) nodes; W (s, s); real mu, left (s,), right (s,); complex mus (k,), lefts (k, s), rights (k, s);
    embedded (s,) and gamma of the error estimate; weights (s,); tolerance of Newton's increments; order of the error
    in h; basis of the interpolation; end : a Step; X, V, A, R (s, n) stages; kept (s, n) residuals of the stages;
    B (n, bw + 1), C (k, n, bw + 1) factors; y (n,), u (k, n); amps (s, signals, 3);
    cosine, sine (s, pairs): how vectors have turned at a stage since the one that the tangent is of.
    """

    c: Any
    W: Any
    mu: float
    left: Any
    right: Any
    mus: Any
    lefts: Any
    rights: Any
    embedded: Any
    gamma: float
    weights: Any
    tolerance: float
    max_iterations: int
    damped: bool
    order: int
    basis: Any
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


@inlined
def _predict(m, p, s, h):  # type: ignore[no-untyped-def]
    """Fill the stages by what the last step's polynomials go on to, or by the series in h after a restart."""
    stages, n = m.X.shape
    old = s.numbers[OLD_STEP]
    if old <= 0.0:
        for i in range(stages):
            ch = m.c[i] * h
            for k in range(n):
                m.X[i, k] = ch * (s.v[k] + 0.5 * ch * s.a[k]) if p.coordinate[k] != 0.0 else s.z[k]
        return
    for i in range(stages):
        x = 1.0 + m.c[i] * h / old
        for k in range(n):
            m.X[i, k] = -s.extra[stages - 1, k] * p.coordinate[k]
        for j in range(stages):
            # Lagrange polynomials: positions on 0 and all nodes, multipliers on the nodes
            f = 1.0
            for q in range(stages):
                if q != j:
                    f *= (x - m.c[q]) / (m.c[j] - m.c[q])
            g = f * x / m.c[j]
            for k in range(n):
                m.X[i, k] += (g if p.coordinate[k] != 0.0 else f) * s.extra[j, k]


@inner
def _rates(m, p, s, h):  # type: ignore[no-untyped-def]
    """Fill the rates and second rates of the stages."""
    stages, n = m.X.shape
    for i in range(stages):
        m.V[i] = 0.0
        m.A[i] = 0.0
    for i in range(stages):
        for j in range(stages):
            f = m.W[i, j] / h
            for k in range(n):
                m.V[i, k] += f * m.X[j, k] * p.coordinate[k]
    for i in range(stages):
        for j in range(stages):
            f = m.W[i, j] / h
            for k in range(n):
                m.A[i, k] += f * (m.V[j, k] - s.v[k]) * p.coordinate[k]


@inner
def _place(m, p, w, s, i):  # type: ignore[no-untyped-def]
    """Fill m.y with the unknowns at stage i, and the signals there."""
    for k in range(len(m.y)):
        m.y[k] = s.z[k] * p.coordinate[k] + m.X[i, k]
    copy_rows(m.amps[i], w.amps)


@inlined
def _turns(m, p, w, s):  # type: ignore[no-untyped-def]
    """Fill how the vectors of all pairs stand at the stages, beside the middle one."""
    stages, middle = len(m.c), len(m.c) // 2
    for i in range(stages):
        _place(m, p, w, s, i)
        to_full(p, m.y, w.amps, 0, w.d)
        turned(p, w.d, m.sine[i])
    for k in range(m.sine.shape[1]):
        start = m.sine[middle, k]
        for i in range(stages):
            angle = m.sine[i, k] - start
            m.cosine[i, k], m.sine[i, k] = np.cos(angle), np.sin(angle)


@inner
def _turn(m, p, i, sense, x):  # type: ignore[no-untyped-def]
    """Turn the vectors in x (n,) from the middle stage to stage i (sense 1) or back (-1)."""
    for k in range(len(p.pairs)):
        a, b = p.pairs[k, 0], p.pairs[k, 1]
        c, s = m.cosine[i, k], sense * m.sine[i, k]
        x[a], x[b] = c * x[a] - s * x[b], s * x[a] + c * x[b]


@inlined
def _factor(m, p, w, s, h):  # type: ignore[no-untyped-def]
    """Factor the real and the complex bands with the tangent at the middle stage; return whether they could be."""
    n, width = w.A.shape
    middle = len(m.c) // 2
    _place(m, p, w, s, middle)
    if m.damped:
        forces_tangent(p, w, m.y, m.V[middle], 1.0)
        copy_rows(w.A, m.B)
    forces_tangent(p, w, m.y, m.V[middle], 0.0)
    real, mass = m.mu / h, (m.mu / h) * (m.mu / h + p.alpha)
    for k in range(len(m.mus)):
        f = m.mus[k] / h
        g = f * (f + p.alpha)
        for i in range(n):
            for j in range(width):
                v = w.A[i, j] + g * p.mass[i, j]
                if m.damped:
                    v += f * (m.B[i, j] - w.A[i, j])
                m.C[k, i, j] = v
        if not factor(w, m.C[k]):
            return False
    for i in range(n):
        for j in range(width):
            v = w.A[i, j] + mass * p.mass[i, j]
            if m.damped:
                v += real * (m.B[i, j] - w.A[i, j])
            m.B[i, j] = v
    return factor(w, m.B)


@inlined
def _solve(m, p):  # type: ignore[no-untyped-def]
    """Turn the residuals into increments of the stages, in m.R; return the size of the largest [m]."""
    stages, n = m.R.shape
    m.y[:] = 0.0
    for i in range(stages):
        _turn(m, p, i, -1.0, m.R[i])
        for k in range(n):
            m.y[k] -= m.left[i] * m.R[i, k]
    ldl_solve(m.B, m.y)
    for q in range(len(m.mus)):
        m.u[q] = 0.0
        for i in range(stages):
            for k in range(n):
                m.u[q, k] -= m.lefts[q, i] * m.R[i, k]
        ldl_solve(m.C[q], m.u[q])
    size = 0.0
    for i in range(stages):
        for k in range(n):
            x = m.right[i] * m.y[k]
            for q in range(len(m.mus)):
                x += 2.0 * (m.rights[q, i] * m.u[q, k]).real
            m.R[i, k] = x
        _turn(m, p, i, 1.0, m.R[i])
        largest = norm(p, m.R[i])
        if not largest <= size:
            size = largest
    return size


@inlined
def _error(m, p, w, s, h):  # type: ignore[no-untyped-def]
    """Return the local error [m] against the embedded formula of order s, stiff parts filtered."""
    stages, n = m.X.shape
    g = m.gamma * h
    for k in range(n):
        q, v = g * s.v[k], g * s.a[k]
        for i in range(stages):
            q += m.embedded[i] * m.X[i, k]
            v += m.embedded[i] * (m.V[i, k] - s.v[k])
        w.x[k] = (q + g * v) * p.coordinate[k]
    mass_product(p, w.x, w.y)
    f = (m.mu / h) ** 2
    for k in range(n):
        w.y[k] *= f
    ldl_solve(m.B, w.y)
    return norm(p, w.y)


@inlined
def _met(m, p, w, s):  # type: ignore[no-untyped-def]
    """Return whether the constraints hold to round-off at the end of the step."""
    if p.points is None and p.sliding is None:
        return True
    last = len(m.c) - 1
    _place(m, p, w, s, last)
    to_full(p, m.y, w.amps, 0, w.d)
    return violation(p.points, p.sliding, w.d, w.amps) <= 1e-13


@inlined
def _finish(m, p, s, h):  # type: ignore[no-untyped-def]
    """Fill the end of the step and what its interpolation needs."""
    stages, n = m.X.shape
    end, last = m.end, stages - 1
    for k in range(n):
        end.z[k] = s.z[k] * p.coordinate[k] + m.X[last, k]
        end.v[k], end.a[k] = m.V[last, k], m.A[last, k]
        end.dense[0, k] = h * s.v[k]
        for i in range(stages):
            end.dense[1 + i, k] = h * m.V[i, k]
    # multipliers by the polynomial through the start and all stages, as its rates there
    for j in range(stages):
        f = 1.0 / m.c[j]
        for q in range(stages):
            if q != j:
                f *= m.c[q] / (m.c[q] - m.c[j])
        for k in range(n):
            if p.coordinate[k] == 0.0:
                if j == 0:
                    end.dense[:, k] = 0.0
                x = m.X[j, k] - s.z[k]
                end.dense[0, k] += f * x
                for i in range(stages):
                    end.dense[1 + i, k] += m.W[i, j] * x


@inner
def _at_floor(m, p, w, s):  # type: ignore[no-untyped-def]
    """Return whether no residual of the stages, as they were kept, exceeds what round-off can leave of its terms."""
    for i in range(len(m.c)):
        _place(m, p, w, s, i)
        to_full(p, m.y, w.amps, 0, w.d)
        copy(m.kept[i], w.R)
        if not at_floor(p, w, m.V[i], m.A[i]):
            return False
    return True


@inner
def radau_step(m, p, w, s, t, h):  # type: ignore[no-untyped-def]
    """Step from the motion s at t to m.end; return (outcome, iterations, error [m], contraction)."""
    stages, n = m.X.shape
    for i in range(stages):
        evaluate(p.programs, t + m.c[i] * h, m.amps[i])
    _predict(m, p, s, h)
    _rates(m, p, s, h)
    rate, last, iteration = s.numbers[CONTRACTION], 0.0, 0
    _turns(m, p, w, s)
    if not _factor(m, p, w, s, h):
        return SINGULAR, 1, 0.0, rate
    wanted = m.tolerance * max(s.numbers[SIZE], 1e-3 * p.extent)
    while True:
        for i in range(stages):
            _place(m, p, w, s, i)
            forces(p, w, m.y, m.V[i])
            residual(p, w, m.V[i], m.A[i])
            copy(w.R, m.R[i])
            copy(w.R, m.kept[i])
        step = _solve(m, p)
        remember(w, iteration, step)
        if not np.isfinite(step):
            return NOT_FINITE, iteration + 1, 0.0, rate
        if iteration > 0:
            rate = step / last
            if rate > 0.5 and iteration > 2 and _at_floor(m, p, w, s):
                break
        for i in range(stages):
            for k in range(n):
                m.X[i, k] += m.R[i, k]
        _rates(m, p, s, h)
        last, iteration = step, iteration + 1
        expected = rate if iteration > 1 else min(max(rate, 1e-2), 0.5)
        if (step == 0.0 or (expected < 1.0 and step * expected <= wanted * (1.0 - expected))) and _met(m, p, w, s):
            break
        # what is left at this rate after all iterations that are allowed
        ahead = step * rate ** (m.max_iterations - iteration) if iteration > 3 else 0.0
        if iteration >= m.max_iterations or (rate > 2.0 and iteration > 2) or ahead > wanted:
            return NOT_CONVERGED, iteration, 0.0, rate
    error = _error(m, p, w, s, h)
    _finish(m, p, s, h)
    return DONE, iteration, error, max(rate, 1e-3)


@inner
def radau_accept(m, s):  # type: ignore[no-untyped-def]
    """Keep the stages, which the next step goes on from."""
    copy_rows(m.X, s.extra)


def radau_restart(m: Any, s: Any) -> None:
    """Begin anew: the series in h predicts the first step."""
    s.numbers[OLD_STEP] = 0.0
