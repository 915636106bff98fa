"""Complete states, with forces, multipliers and accelerations, from the data in result files."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..elements.shape import Array
from ..kernels.motion.state import TIME
from .motion.problem import make_problem
from .motion.stepping import Stepper
from .state import State

if TYPE_CHECKING:
    from ..case import Dynamic
    from ..model.model import Model
    from .system import System


class MotionAtTimes(Stepper):
    """A motion evaluated at given times, without time steps, from displacements and rates."""

    def __init__(self, model: Model, spec: Dynamic) -> None:
        super().__init__(model, *make_problem(model), spec, 0.0, np.zeros(0))

    def at(self, t: float, d: Array, v: Array, turned: Array) -> State:
        """Return the state for displacements d and rates v (n_full,), with consistent accelerations and multipliers.

        Raises ComputationError if these do not exist.
        """
        self.enter(next(k for k, piece in enumerate(self.pieces) if t <= piece.stop or piece is self.pieces[-1]))
        self._place(d, v, turned)
        self.s.numbers[TIME] = t
        self.consistent(t, np.zeros(len(self.s.z)))
        row = self.last()
        d, v, a = self.full(row)
        self.feedback.update_model(row)
        F = self.model.external(row.side)
        return State(t, d, self.forces(row) + F, F, 0.0, turned, v=v, a=a, side=row.side)


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
