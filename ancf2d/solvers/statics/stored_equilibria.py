"""Equilibria from the displacements in result files, with the multipliers and laws that files do not hold."""

from __future__ import annotations

import numpy as np

from ...case import LoadedCase
from ...elements.shape import Array
from ...model.build import build_model
from ...model.model import Model
from ..contact import layer_memory
from ..state import State
from ..system import System
from .newton import MAX_ITERATIONS, TOLERANCE, Start, equilibrium_near, negative_pivots


def equilibrium_at(system: System, t: float, d: Array, turned: Array, linear: bool) -> State:
    """Return the equilibrium with displacements d (n_full,) at load factor t, with multipliers that balance the forces.

    ``linear``: in linear theory about the reference.
    """
    model, d = system.model, d.copy()
    n_q, at = model.n_q, np.zeros_like(d)
    if not linear:
        at[:n_q] = d[:n_q]
    model.turns.set_spring_angles(model.springs, model.e0 + at[:n_q], at[:n_q], turned)

    def forces() -> tuple[Array, Array]:
        if not linear:
            at[n_q:] = d[n_q:]
        balance = system.forces(at, t, linear=linear)
        Q = balance.Q + system.action(at, d, t, linear=True) if linear else balance.Q.copy()
        return Q, np.array(balance.F)

    Q, F = forces()
    if model.constraints:
        d[n_q:] = _multipliers(system, at, Q - F, t)
        Q, F = forces()
    return State(t, d, Q, F, 0.0, turned, linear=linear)


def _multipliers(system: System, d: Array, R: Array, t: float) -> Array:
    """Return the multipliers of the constraints at d (n_full,) that balance the forces R (n_full,) best.

    Only forces on the unknowns count, not those on coordinates that linear rows eliminate.
    """
    model = system.model
    num, columns = model.numbering, []
    for _, coords, gradient in model.interactions.gradients(d, t):
        column = np.zeros(len(d))
        np.add.at(column, coords, gradient)
        columns.append(num.reduce(column))
    G, r = np.array(columns).T, num.reduce(R)
    # coordinates have different units: compare forces as acting on displacements
    weights = np.divide(1.0, system.weights, out=np.zeros_like(r), where=system.weights > 0.0)
    touched = np.flatnonzero(np.abs(G).max(axis=1) * weights > 0.0)
    w = weights[touched]
    size = np.linalg.norm(w[:, None] * G[touched], axis=0)
    return -np.linalg.lstsq(w[:, None] * G[touched] / size, w * r[touched], rcond=None)[0] / size


def equilibrium_with_motion_layers(model: Model, static: LoadedCase, d: Array, turned: Array | None) -> Array:
    """Return the displacements (n_q,) of the equilibrium beside d with layers as in motion, else d.

    ``model`` is that of the motion, ``static`` its case in statics. The forces that d does not balance with layers as
    in statics, as loads may change at t = 0, act on. Equilibria are not sought without a law, nor under loads that
    depend on the motion, and bodies may have lost their supports. Raises CaseError and ComputationError.
    """
    soft = not any(pair.hard for pair in model.contacts) and any(pair.on_bodies for pair in model.contacts)
    if not soft or getattr(model.timing, "feedback", None):
        return d
    whole, fading = System(build_model(static)), System(build_model(static, moving=True))
    if not np.array_equal(whole.model.e0, model.e0):
        return d
    for system in (whole, fading):
        for name, rows in layer_memory(system.model).items():
            rows[:] = layer_memory(model)[name]
    full = np.zeros(len(whole.model.numbering.place))
    full[:model.n_q] = d
    turned = whole.model.turns.from_reference(full) if turned is None else turned
    at = equilibrium_at(whole, 1.0, full, turned, False).d
    fading.balancing_forces = whole.forces(at, 1.0).R
    start = Start(at, negative_pivots(fading, at, 1.0), turned)
    near = equilibrium_near(fading, start, 1.0, TOLERANCE, MAX_ITERATIONS)
    return d if near is None else near.d[:model.n_q]
