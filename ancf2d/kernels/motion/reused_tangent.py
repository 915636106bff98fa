"""The tangent of Radau's stages: that of an earlier state, rotated with the sections, as long as it pays.

It is formed at the middle stage of one step and rotated to every stage of that step and of the following steps of the
same size, so that only the change of deformation slows Newton's method.
"""

from __future__ import annotations

from .. import calls
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed, inner
from .dynamics import FACTORS, directions, factor, rotation, signals_at, to_full
from .stages import double, give, is_first, modulus, place
from .state import TANGENT_COST, TANGENT_STEP, TANGENT_STEPS, TANGENT_TIME

# cost of a tangent and its factors, in iterations
MAKING = 1.5


@inner
def turns(m, p, w, s):  # type: ignore[no-untyped-def]
    """Fill m.cosine and m.sine with the rotation of all pairs from the tangent's state to each stage."""
    stages = len(m.c)
    for i in range(stages):
        place(m, p, w, s, i)
        to_full(p, m.y, w.amps, 0, w.d)
        directions(p, w.d, m.cosine[i], m.sine[i])
    for k in range(m.sine.shape[1]):
        x, y = m.facing[0, k], m.facing[1, k]
        for i in range(stages):
            m.cosine[i, k], m.sine[i, k] = rotation(p.turns[k, 1] < 0, m.cosine[i, k], m.sine[i, k], x, y)


@inner
def turn(m, p, i, sense, x):  # type: ignore[no-untyped-def]
    """Rotate the vectors in x (n,) from the tangent's state to stage i (sense 1) or back (-1)."""
    for k in range(len(p.pairs)):
        a, b = p.pairs[k, 0], p.pairs[k, 1]
        c, s = m.cosine[i, k], sense * m.sine[i, k]
        x[a], x[b] = c * x[a] - s * x[b], s * x[a] + c * x[b]


@inner
def _factor(m, p, w, s, h):  # type: ignore[no-untyped-def]
    """Factor the real and the complex bands with the tangent at the held state; return whether they are regular."""
    stages, A, B, M = len(m.c), w.A, m.B, p.mass
    z, v = s.extra[stages], s.extra[stages + 1]
    signals_at(p, s.numbers[TANGENT_TIME], w.amps)
    m.held[0], m.held[1] = s.numbers[TANGENT_TIME], h
    relaxes = len(m.relaxing.runs) > 0
    give(m.relaxing, s.remembered)
    if m.damped:
        calls.forces_tangent(p.calls, (p, w, z, v, 1.0))
        copy(A, B)
    calls.forces_tangent(p.calls, (p, w, z, v, 0.0))
    directions(p, w.d, m.facing[0], m.facing[1])
    if len(p.moving.fixed) > 0:
        calls.moving_mass(p.calls, (p, 1.0, M))
    _bands(m, p, w, h)
    if relaxes:
        calls.add_moduli(m.relaxing.calls, (p, w, z, v, m, h))
    if len(p.moving.fixed) > 0:
        copy(p.moving.fixed, M)
    for k in range(len(m.mus)):
        w.counts[FACTORS] += 1
        if not calls.factor_complex(p.calls, (p, m.C[k], w.y)):
            return False
    return factor(p, w, B)


@inner
def _bands(m, p, w, h):  # type: ignore[no-untyped-def]
    """Fill the bands from the tangent w.A = K and, if damped, m.B = K + C, with the mass terms for step size h."""
    size, A, B, M = len(w.A), w.A, m.B, p.mass
    for k in range(len(m.mus)):
        f = m.mus[k] / h
        g = f * (f + p.alpha)
        C, real, imag = m.C[k], g.real, g.imag
        for i in range(size):
            C[i] = complex(A[i] + real * M[i], imag * M[i])
        if m.damped:
            for i in range(size):
                C[i] += f * (B[i] - A[i])
    real, mass = m.mu / h, (m.mu / h) * (m.mu / h + p.alpha)
    for i in range(size):
        B[i] = A[i] + (real * (B[i] - A[i]) if m.damped else 0.0) + mass * M[i]


@addressed
def add_moduli(p, w, z, v, m, h):  # type: ignore[no-untyped-def]
    """Add the Maxwell terms' part of the complex modulus to each band, at the held z and v; w.A is the tangent there.
    """
    q, size, A, B = m.relaxing, len(w.A), w.A, m.B
    # the stiffness of a group is the tangent with that stiffness doubled, less the tangent itself
    for sign in (-1.0, 1.0):
        for r in range(len(q.runs)):
            if not is_first(q, r):
                continue
            if sign > 0.0:
                double(q, r)
                calls.forces_tangent(p.calls, (p, w, z, v, 0.0))
            for k in range(len(m.mus)):
                C, f = m.C[k], sign * modulus(q, r, m.mus[k], h)
                for i in range(size):
                    C[i] += f * A[i]
            f = sign * modulus(q, r, complex(m.mu, 0.0), h).real
            for i in range(size):
                B[i] += f * A[i]


@inner
def _serves(m, p, s, h):  # type: ignore[no-untyped-def]
    """Return whether the tangent of an earlier step is used again.

    With point laws, joints or limited integrals it is not: their tangents depend on history and could not be reproduced
    after a resume.
    """
    if m.full or p.patched or p.feedback.bounded:
        return False
    # equal steps differ by the round-off of their times
    return abs(s.numbers[TANGENT_STEP] - h) <= 1e-9 * h


@inner
def _hold(m, p, w, s, t, h):  # type: ignore[no-untyped-def]
    """Make a new tangent at the middle stage of the step and factor it; return whether it is regular."""
    stages, middle = len(m.c), len(m.c) // 2
    place(m, p, w, s, middle)
    copy(m.y, s.extra[stages])
    copy(m.V[middle], s.extra[stages + 1])
    if len(m.relaxing.runs) > 0:
        copy(m.relaxing.inner[middle], s.remembered)
    s.numbers[TANGENT_TIME], s.numbers[TANGENT_STEP] = t + m.c[middle] * h, h
    s.numbers[TANGENT_STEPS], s.numbers[TANGENT_COST] = 0.0, MAKING
    return _factor(m, p, w, s, h)


@inner
def tangent(m, p, w, s, t, h):  # type: ignore[no-untyped-def]
    """Provide the factored tangent for a step: reused, rebuilt after a resume, or new; return whether it is regular.

    The state of the tangent is stored with the motion, so a resumed motion has bitwise the same factors.
    """
    if not _serves(m, p, s, h):
        return _hold(m, p, w, s, t, h)
    if m.held[0] == s.numbers[TANGENT_TIME] and m.held[1] == s.numbers[TANGENT_STEP]:
        return True
    return _factor(m, p, w, s, s.numbers[TANGENT_STEP])


@inner
def count(s, iterations):  # type: ignore[no-untyped-def]
    """Count the iterations of a step; discard the tangent if they exceed the mean cost per step, which is then least.
    """
    s.numbers[TANGENT_STEPS] += 1.0
    s.numbers[TANGENT_COST] += iterations
    if iterations * s.numbers[TANGENT_STEPS] > s.numbers[TANGENT_COST]:
        s.numbers[TANGENT_STEP] = 0.0
