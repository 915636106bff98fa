"""The equations of motion as y' = f(t, y) for SciPy's integrators, with y = (z, z') of the coordinates only."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import calls
from ..lowlevel.arrays import copy
from ..lowlevel.jit import kernel, kernel_with_memory, seldom
from ..patches import accept_patches, rates_of_constraints, violation
from .consistent import constraint_matrix
from .dynamics import residual, signals_at, to_full
from .work import power


@kernel
def mass_factors(p, w, factors):  # type: ignore[no-untyped-def]
    """Factor the mass matrix in ``factors`` in place, for models without multipliers."""
    calls.factor(p.calls, (p, factors, w.y))


@kernel_with_memory
@seldom
def accelerations(p, w, factors, s, t):  # type: ignore[no-untyped-def]
    """Fill s.a, and the multipliers in s.z, at coordinates s.z with rates s.v; return whether they are determined.

    ``factors``: LDL^T of the mass matrix, used if there are neither multipliers nor moving masses.
    """
    n = len(s.z)
    rhs = np.zeros(n)
    constrained = False
    signals_at(p, t, w.amps)
    for i in range(n):
        if p.coordinate[i] == 0.0:
            s.z[i] = 0.0
            constrained = True
    s.a[:] = 0.0
    calls.forces(p.calls, (p, w, s.z, s.v))
    residual(p, w, s.v, s.a)
    for i in range(n):
        rhs[i] = -w.R[i]
    if not constrained and len(p.moving.fixed) == 0:
        copy(rhs, s.a)
        calls.solve(p.calls, (p, factors, s.a))
        return True
    velocity, acceleration, motion = np.zeros(len(w.d)), np.zeros(len(w.d)), np.zeros(n)
    constraint_matrix(p, w)
    rates_of_constraints(p, w.d, w.v, w.amps, velocity, acceleration)
    calls.by_motion(p.calls, (p, w, 2, motion))
    for i in range(n):
        if p.coordinate[i] == 0.0:
            rhs[i] = -acceleration[p.full[i]] - motion[i]
    if not calls.factor(p.calls, (p, w.A, w.y)):
        return False
    calls.solve(p.calls, (p, w.A, rhs))
    for i in range(n):
        if p.coordinate[i] == 0.0:
            s.z[i] = rhs[i]
        else:
            s.a[i] = rhs[i]
    return True


@kernel
def place(s, free, y):  # type: ignore[no-untyped-def]
    """Copy y = (z, z') of the coordinates ``free`` into the motion s."""
    m = len(free)
    for k in range(m):
        s.z[free[k]] = y[k]
        s.v[free[k]] = y[m + k]


@kernel
def rates(p, w, factors, s, free, t, y, out):  # type: ignore[no-untyped-def]
    """Fill out with y' (2 m,), with nan for accelerations that are not determined."""
    m = len(free)
    place(s, free, y)
    found = calls.accelerations(p.calls, (p, w, factors, s, t))
    for k in range(m):
        out[k] = y[m + k]
        out[m + k] = s.a[free[k]] if found else np.nan
        if free[k] >= p.inner:
            # states of controllers obey z' = g = v + (g - v); their v stays constant
            out[k] += out[m + k]
            out[m + k] = 0.0


@kernel
@seldom
def tangents(p, w, s, t, K, C, KKT):  # type: ignore[no-untyped-def]
    """Fill K = dQ/dz, C = dQ/dz + dQ/dz' and KKT = [M G^T; G 0], in the model's storage, at s with its multipliers."""
    signals_at(p, t, w.amps)
    calls.forces_tangent(p.calls, (p, w, s.z, s.v, 1.0))
    copy(w.A, C)
    calls.forces_tangent(p.calls, (p, w, s.z, s.v, 0.0))
    copy(w.A, K)
    to_full(p, s.z, w.amps, 0, w.d)
    to_full(p, s.v, w.amps, 1, w.v)
    constraint_matrix(p, w)
    copy(w.A, KKT)


@kernel
@seldom
def powers(p, w, factors, s, free, t, y):  # type: ignore[no-untyped-def]
    """Return (power of varying loads, prescribed motion and point laws; power dissipated) at y."""
    place(s, free, y)
    calls.accelerations(p.calls, (p, w, factors, s, t))
    return power(p, w, s.z, s.v, s.a, t)


@kernel
@seldom
def accept_step(p, w, s, t):  # type: ignore[no-untyped-def]
    """Accept the motion s at t as the end of a step, projected onto the constraints; return their violation."""
    if len(p.feedback.kind) > 0:
        signals_at(p, t, w.amps)
        to_full(p, s.z, w.amps, 0, w.d)
        calls.feedback_accept(p.calls, (p, w))
    if not p.patched:
        return 0.0
    calls.onto_constraints(p.calls, (p, w, s.z, s.v, s.a, t, True))
    to_full(p, s.z, w.amps, 0, w.d)
    accept_patches(p, w.d, w.amps)
    return violation(p, w.d, w.amps)


def ode_functions(problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries for SciPy's integrators of the table of a model (``kernels.calls.table``)."""
    return {calls.accelerations: (accelerations, problem)}
