"""Complete states of motions, with forces, multipliers and accelerations, from the data in result files."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..elements.shape import Array
from ..kernels.motion.state import TIME
from .motion.near_elements import Layout
from .motion.problem import make_problem
from .motion.stepping import Stepper
from .state import State

if TYPE_CHECKING:
    from ..case import Dynamic
    from ..model.model import Model


class MotionAtTimes(Stepper):
    """A motion evaluated at given times, without time steps, from displacements and rates."""

    def __init__(self, model: Model, spec: Dynamic) -> None:
        start = make_problem(model, model.numbering.in_reference)
        super().__init__(model, *start, spec, 0.0, np.zeros(0), follows=True)

    def at(self, t: float, d: Array, v: Array, turned: Array) -> State:
        """Return the state for displacements d and rates v (n_full,), with consistent accelerations and multipliers.

        Raises ComputationError if these do not exist.
        """
        self.enter(next(k for k, piece in enumerate(self.pieces) if t <= piece.stop or piece is self.pieces[-1]))
        self._place(d, v, turned)
        if self.layout is not None:
            self.layout = Layout(self)
            self.layout.follow()
        self.s.numbers[TIME] = t
        self.consistent(t, np.zeros(len(self.s.z)))
        row = self.last()
        d, v, a = self.full(row)
        self.feedback.update_model(row)
        F = self.model.external(row.side)
        return State(t, d, self.forces(row) + F, F, 0.0, turned, v=v, a=a, side=row.side)
