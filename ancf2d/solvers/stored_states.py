"""States as solvers have yielded them, from what result files hold: with forces, multipliers and accelerations."""

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


class Moments(Stepper):
    """A motion that is not stepped through: states at any time, from their displacements and rates."""

    def __init__(self, model: Model, spec: Dynamic) -> None:
        super().__init__(model, *make_problem(model), spec, 0.0, np.zeros(0))

    def at(self, t: float, d: Array, v: Array, turned: Array) -> State:
        """Return the state with displacements d and rates v (n_full,), accelerations and multipliers by the equations.

        Raises ComputationError where these have no solution.
        """
        self.enter(next(k for k, piece in enumerate(self.pieces) if t <= piece.stop or piece is self.pieces[-1]))
        self._place(d, v, turned)
        self.s.numbers[TIME] = t
        self.consistent(t, np.zeros(len(self.s.z)))
        row = self.last()
        d, v, a = self.full(row)
        self.answers.look(row)
        F = self.model.external(row.side)
        return State(t, d, self.forces(row) + F, F, 0.0, turned, v=v, a=a, side=row.side)


def equilibrium_at(system: System, t: float, d: Array, turned: Array, linear: bool) -> State:
    """Return the equilibrium with displacements d (n_full,) at load factor t; its multipliers balance the forces.

    ``linear``: in linear theory about the reference.
    """
    model, d = system.model, d.copy()
    n_q, at = model.n_q, np.zeros_like(d)
    if not linear:
        at[:n_q] = d[:n_q]
    model.turns.recall(model.springs, model.e0 + at[:n_q], at[:n_q], turned)

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
    """Return the multipliers with which the constraints at d (n_full,) leave least of the forces R (n_full,).

    What supports and joints hold by linear equations does not count: only forces on the unknowns do.
    """
    model = system.model
    num, columns = model.numbering, []
    for _, coords, gradient in model.interactions.gradients(d, t):
        column = np.zeros(len(d))
        np.add.at(column, coords, gradient)
        columns.append(num.reduce(column))
    G, r = np.array(columns).T, num.reduce(R)
    # coordinates of different kinds have different units: their forces are compared as what acts on a displacement
    weights = np.divide(1.0, system.weights, out=np.zeros_like(r), where=system.weights > 0.0)
    touched = np.flatnonzero(np.abs(G).max(axis=1) * weights > 0.0)
    w = weights[touched]
    size = np.linalg.norm(w[:, None] * G[touched], axis=0)
    return -np.linalg.lstsq(w[:, None] * G[touched] / size, w * r[touched], rcond=None)[0] / size
