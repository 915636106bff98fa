"""Consistent states: rates that satisfy the constraints, and the accelerations and multipliers that follow."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import calls
from ..curves import CONSTRAINTS
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed_with_memory, inner, inner_with_memory, kernel, kernel_with_memory, seldom
from ..moving import place_moving
from ..patches import face_bodies, patch_forces, rates_of_constraints
from .dynamics import FORCES, add_mass, patches_tangent, residual, signals_at, to_full, twice_kinetic


@kernel
@seldom
def place_moving_at(p, w, z, v, t):  # type: ignore[no-untyped-def]
    """Place the points that move along bodies at their positions at time t (``moving.place_moving``)."""
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    place_moving(p, w.d, w.amps)


@inner
def constraint_matrix(p, w):  # type: ignore[no-untyped-def]
    """Fill w.A with M and the gradients of the constraints at w.d, as the matrix of [M G^T; G 0].

    The entries of w.other at multipliers are the constraints.
    """
    w.A[:] = 0.0
    if p.patched:
        patches_tangent(p, w, CONSTRAINTS)
        calls.clear_same_kind(p.calls, (p, w.A, p.coordinate))
    add_mass(p, 1.0, w.A)


@inner
def factored_constraints(p, w, factors):  # type: ignore[no-untyped-def]
    """Factor a copy of ``constraint_matrix``, or w.A itself, in place; return whether it is regular.

    Contact points whose gaps depend on other constraints are deactivated, and the matrix (w.A too) is formed again.
    """
    while not calls.factor(p.calls, (p, factors, w.y)):
        if not p.sided or not calls.deactivate_dependent(p.calls, (p, w)):
            return False
        constraint_matrix(p, w)
        copy(w.A, factors)
    return True


@addressed_with_memory
@seldom
def by_motion(p, w, order, out):  # type: ignore[no-untyped-def]
    """Fill out (n,), at multipliers, with what prescribed motion adds to rates (order 1) or accelerations (2) of
    constraints.
    """
    out[:] = 0.0
    if len(p.motion_coord) == 0:
        return
    moved, one, none = np.zeros(len(w.d)), np.zeros(len(w.d)), np.zeros(len(w.d))
    to_full(p, np.zeros(len(p.coordinate)), w.amps, order, moved)
    rest, acts = w.d.copy(), p.points.on.copy()
    for i in range(len(acts)):
        # constraints alone
        p.points.on[i] = acts[i] and p.points.multiplier[i] >= 0
    for i in range(len(p.coordinate)):
        if p.coordinate[i] == 0.0:
            rest[p.full[i]] = 0.0
    patch_forces(p, rest, w.v, w.amps, none)
    for i in range(len(p.coordinate)):
        if p.coordinate[i] == 0.0:
            rest[p.full[i]] = 1.0
            one[:] = 0.0
            patch_forces(p, rest, w.v, w.amps, one)
            for k in range(len(one)):
                out[i] += (one[k] - none[k]) * moved[k]
            rest[p.full[i]] = 0.0
    copy(acts, p.points.on)


@kernel
def kinetic(p, w, s, t):  # type: ignore[no-untyped-def]
    """Return the kinetic energy of the motion s at t, prescribed motion included."""
    signals_at(p, t, w.amps)
    return 0.5 * twice_kinetic(p, w, s.v)


@inner_with_memory
def allowed_rates(p, w, z, v, impulse, rhs):  # type: ignore[no-untyped-def]
    """Fill rhs (n,) with the change of rates v (n,) at z that satisfies the constraints, and their multipliers.

    ``impulse`` (n,) is an additional right-hand side; signals are in w.amps. Returns whether ``constraint_matrix`` is
    regular, and its factors.
    """
    velocity, acceleration = np.zeros(len(w.d)), np.zeros(len(w.d))
    motion = np.zeros(len(rhs))
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    if p.sided:
        calls.deactivate_supported(p.calls, (p, w, z))
    constraint_matrix(p, w)
    factors = w.A.copy()
    regular = factored_constraints(p, w, factors)
    rhs[:] = 0.0
    if p.patched:
        rates_of_constraints(p, w.d, w.v, w.amps, velocity, acceleration)
        calls.product(p.calls, (p, w.A, v, w.y))
        calls.by_motion(p.calls, (p, w, 1, motion))
        for i in range(len(rhs)):
            if p.coordinate[i] == 0.0:
                rhs[i] = -velocity[p.full[i]] - w.y[i] - motion[i]
    for i in range(len(rhs)):
        rhs[i] += impulse[i]
    if regular:
        calls.solve(p.calls, (p, factors, rhs))
    return regular, factors


@kernel_with_memory
@seldom
def consistent(p, w, z, v, a, t, impulse):  # type: ignore[no-untyped-def]
    """Make rates v, accelerations a and the multipliers in z consistent at t; return whether this is possible.

    ``impulse`` (n,) acts on the unknowns (e.g. when prescribed rates jump), and its entries at multipliers are wanted
    rates of constraints. Beyond that, rates change by the least kinetic energy that satisfies the constraints.
    """
    n = len(z)
    signals_at(p, t, w.amps)
    velocity, acceleration = np.zeros(len(w.d)), np.zeros(len(w.d))
    motion = np.zeros(n)
    rhs = np.zeros(n)
    regular, factors = allowed_rates(p, w, z, v, impulse, rhs)
    if not regular:
        return False
    for i in range(n):
        v[i] = (v[i] + rhs[i]) * p.coordinate[i]
        z[i] *= p.coordinate[i]
    a[:] = 0.0
    calls.forces(p.calls, (p, w, z, v))
    residual(p, w, v, a)
    for i in range(p.inner, n):
        # rates of controllers' states follow from z' = g
        v[i] -= w.R[i]
        w.R[i] = 0.0
    for i in range(n):
        rhs[i] = -w.R[i]
    if p.patched:
        rates_of_constraints(p, w.d, w.v, w.amps, velocity, acceleration)
        calls.by_motion(p.calls, (p, w, 2, motion))
        for i in range(n):
            if p.coordinate[i] == 0.0:
                rhs[i] = -acceleration[p.full[i]] - motion[i]
    calls.solve(p.calls, (p, factors, rhs))
    for i in range(n):
        if p.coordinate[i] == 0.0:
            z[i] = rhs[i]
        else:
            a[i] = rhs[i]
    return True


@inner_with_memory
def gap_rates(p, w, z, v, a, g, rate, second):  # type: ignore[no-untyped-def]
    """Fill gaps, their rates and second rates (items,) of items that are held closed at z, with signals in w.amps."""
    velocity, acceleration, y = np.zeros(len(w.d)), np.zeros(len(w.d)), np.zeros(len(z))
    calls.deactivate_supported(p.calls, (p, w, z))
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    w.other[:] = 0.0
    patch_forces(p, w.d, w.v, w.amps, w.other)
    gaps = w.other.copy()
    constraint_matrix(p, w)
    rates_of_constraints(p, w.d, w.v, w.amps, velocity, acceleration)
    calls.product(p.calls, (p, w.A, v, w.y))
    calls.product(p.calls, (p, w.A, a, y))
    for i in range(len(g)):
        if p.points.restitution[i] >= 0.0:
            k = p.points.multiplier[i]
            g[i] = gaps[k]
            rate[i] = velocity[k] + w.y[p.place[k]]
            second[i] = acceleration[k] + y[p.place[k]]


@inner
def _touches(p, w, z, v):  # type: ignore[no-untyped-def]
    """Return whether a hard contact is closed at z with rates v and the signals in w.amps."""
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    w.other[:] = 0.0
    face_bodies(p, w.d)
    calls.mark_closed_points(p.calls, (p.points, w.d, w.v, w.amps, w.other))
    for i in range(len(p.points.restitution)):
        if p.points.restitution[i] >= 0.0 and w.other[p.points.multiplier[i]] != 0.0:
            return True
    return False


@inner_with_memory
def onto_positions(p, w, z, most):  # type: ignore[no-untyped-def]
    """Project z onto the constraints by the least change in the metric of the mass, in at most so many iterations;
    multipliers stay.
    """
    n = len(z)
    rhs = np.zeros(n)
    for _ in range(most):
        to_full(p, z, w.amps, 0, w.d)
        constraint_matrix(p, w)
        rhs[:] = 0.0
        largest = 0.0
        for i in range(n):
            if p.coordinate[i] == 0.0:
                rhs[i] = -w.other[p.full[i]]
                largest = max(largest, abs(rhs[i]))
        if largest == 0.0 or not calls.factor(p.calls, (p, w.A, w.y)):
            break
        calls.solve(p.calls, (p, w.A, rhs))
        for i in range(n):
            z[i] += rhs[i] * p.coordinate[i]


@kernel_with_memory
@seldom
def onto_constraints(p, w, z, v, a, t, inside):  # type: ignore[no-untyped-def]
    """Project v, a and the multipliers in z onto the constraints at t, and z itself if the state is ``inside`` a step.

    Changes are the least in the metric of the mass, and residuals of the equations of motion stay the same. This is
    needed because steps satisfy constraints in positions only, and rates and multipliers are of lower order. While a
    hard contact is closed, so that rates jump, ends of steps are not changed, and states inside keep a and multipliers.
    """
    n = len(z)
    signals_at(p, t, w.amps)
    touches = p.sided and _touches(p, w, z, v)
    if touches and not inside:
        return
    if inside:
        onto_positions(p, w, z, 5)
    rhs, none = np.zeros(n), np.zeros(n)
    calls.forces(p.calls, (p, w, z, v))
    residual(p, w, v, a)
    # only evaluations of steps are counted
    w.counts[FORCES] -= 1
    before = w.R.copy()
    regular, factors = allowed_rates(p, w, z, v, none, rhs)
    if not regular:
        return
    for i in range(n):
        v[i] += rhs[i] * p.coordinate[i]
    if touches:
        return
    calls.forces(p.calls, (p, w, z, v))
    residual(p, w, v, a)
    w.counts[FORCES] -= 1
    for i in range(n):
        rhs[i] = before[i] - w.R[i] if i < p.inner else 0.0
    velocity, acceleration, motion = np.zeros(len(w.d)), np.zeros(len(w.d)), np.zeros(n)
    rates_of_constraints(p, w.d, w.v, w.amps, velocity, acceleration)
    calls.product(p.calls, (p, w.A, a, w.y))
    calls.by_motion(p.calls, (p, w, 2, motion))
    for i in range(n):
        if p.coordinate[i] == 0.0:
            rhs[i] = -acceleration[p.full[i]] - w.y[i] - motion[i]
    calls.solve(p.calls, (p, factors, rhs))
    for i in range(n):
        if p.coordinate[i] == 0.0:
            z[i] += rhs[i]
        else:
            a[i] += rhs[i]


def constraint_functions(problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries of the table of a model with constraints (``kernels.calls.table``)."""
    return {calls.by_motion: (by_motion, problem), calls.onto_constraints: (onto_constraints, problem)}
