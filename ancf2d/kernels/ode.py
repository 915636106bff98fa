"""The equations of motion solved for accelerations: y' = f(t, y) with y = (z, z') of the coordinates alone."""

from __future__ import annotations

import numpy as np

from .amplitudes import evaluate
from .arrays import copy
from .consistent import _by_motion, _rates_of_constraints, constraint_matrix, onto_constraints
from .dynamics import forces, forces_tangent, lost_to_mass_damping, power_of_loads, residual, to_full, violation
from .jit import inner, kernel, kernel_with_memory
from .lanes import array_at
from .points import point_accept
from .sliding import sliding_accept
from .symmetric import factored, solve


@kernel
def mass_factors(p, w, factors):  # type: ignore[no-untyped-def]
    """Factor the mass matrix that ``factors`` holds, where there are no multipliers."""
    factored(p.fronts, factors, 1e-16, w.y)


@kernel_with_memory
def accelerations(p, w, factors, s, t):  # type: ignore[no-untyped-def]
    """Fill s.a, and the multipliers in s.z, at coordinates s.z with rates s.v; return whether they are determined.

    ``factors``: LDL^T of the mass matrix, which serves where there are no multipliers.
    """
    n = len(s.z)
    rhs = np.zeros(n)
    constrained = False
    evaluate(p.programs, t, w.amps)
    for i in range(n):
        if p.coordinate[i] == 0.0:
            s.z[i] = 0.0
            constrained = True
    s.a[:] = 0.0
    forces(p, w, s.z, s.v)
    residual(p, w, s.v, s.a)
    if not constrained:
        s.a[:] = -w.R
        solve(p.fronts, factors, s.a)
        return True
    velocity, acceleration, by_motion = np.zeros(len(w.d)), np.zeros(len(w.d)), np.zeros(n)
    rhs[:] = -w.R
    constraint_matrix(p, w)
    _rates_of_constraints(p.points, p.sliding, w.d, w.v, w.amps, velocity, acceleration)
    _by_motion(p, w, 2, by_motion)
    for i in range(n):
        if p.coordinate[i] == 0.0:
            rhs[i] = -acceleration[p.full[i]] - by_motion[i]
    if not factored(p.fronts, w.A, 1e-16, w.y):
        return False
    solve(p.fronts, w.A, rhs)
    for i in range(n):
        if p.coordinate[i] == 0.0:
            s.z[i] = rhs[i]
        else:
            s.a[i] = rhs[i]
    return True


@kernel
def place(s, free, y):  # type: ignore[no-untyped-def]
    """Put y = (z, z') of the coordinates ``free`` into the motion s."""
    m = len(free)
    for k in range(m):
        s.z[free[k]] = y[k]
        s.v[free[k]] = y[m + k]


@kernel
def rates(p, w, factors, s, free, t, y, out):  # type: ignore[no-untyped-def]
    """Fill y' (2 m,); not a number where it is not determined."""
    m = len(free)
    place(s, free, y)
    found = accelerations(p, w, factors, s, t)
    for k in range(m):
        out[k] = y[m + k]
        out[m + k] = s.a[free[k]] if found else np.nan


@inner
def _copy(A, out):  # type: ignore[no-untyped-def]
    copy(array_at(A, 0, (A.size,)), array_at(out, 0, (A.size,)))


@kernel
def tangents(p, w, s, t, K, C, KKT):  # type: ignore[no-untyped-def]
    """Fill dQ/dz, dQ/dz' and the matrix of [M G^T; G 0], stored as all are, at s with its multipliers."""
    evaluate(p.programs, t, w.amps)
    forces_tangent(p, w, s.z, s.v, 1.0)
    _copy(w.A, C)
    forces_tangent(p, w, s.z, s.v, 0.0)
    _copy(w.A, K)
    c, k = array_at(C, 0, (C.size,)), array_at(K, 0, (C.size,))
    for i in range(len(c)):
        c[i] -= k[i]
    to_full(p, s.z, w.amps, 0, w.d)
    to_full(p, s.v, w.amps, 1, w.v)
    constraint_matrix(p, w)
    _copy(w.A, KKT)


@kernel
def powers(p, w, factors, s, free, t, y):  # type: ignore[no-untyped-def]
    """Return (power of varying loads, motion and point laws, power lost) at y."""
    place(s, free, y)
    accelerations(p, w, factors, s, t)
    evaluate(p.programs, t, w.amps)
    _, lost = forces(p, w, s.z, s.v)
    return power_of_loads(p, w, s.v, s.a), lost + lost_to_mass_damping(p, w, s.v)


@inner
def _accept(points, sliding, d):  # type: ignore[no-untyped-def]
    if points is not None:
        point_accept(points, d)
    if sliding is not None:
        sliding_accept(sliding, d)


@kernel
def settle(p, w, s, t):  # type: ignore[no-untyped-def]
    """Take the motion s at t as the end of a step, put onto the constraints; return their violation."""
    if p.points is None and p.sliding is None:
        return 0.0
    onto_constraints(p, w, s.z, s.v, t)
    to_full(p, s.z, w.amps, 0, w.d)
    _accept(p.points, p.sliding, w.d)
    return violation(p.points, p.sliding, w.d, w.amps)
