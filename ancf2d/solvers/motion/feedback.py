"""Feedback while a motion is stepped: states of controllers, counted angles, values of loads that depend on it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.shape import Array
from ...kernels.lowlevel.records import Record
from ...kernels.motion.dynamics import signals_at
from ...kernels.motion.feedback import LEAST_SIZE
from ...kernels.motion.state import SIZE, fill_full
from ...model.feedback import ANGLE
from ...model.point_patch import check_formulas
from ..state import Row

# relative change of rates at a failure to those for which an expression that has no value is taken for its cause
NEAR = 1e-6


class MotionFeedback:
    """The feedback of a motion (``stepping.Stepper``)."""

    def __init__(self, motion: Any) -> None:
        self.motion, self.of_model = motion, motion.model.feedback

    def count_angles(self, p: Record, d: Array, turned: Array) -> None:
        """Set the counted angles that feedback depends on to those at d (n_full,)."""
        model = self.motion.model
        d = d[:model.n_q]
        # a controller that nothing uses reads no angles
        for k, q in enumerate(self.of_model.quantities[:len(p.feedback.last_angle)]):
            if q.rotation is not None and q.kind == ANGLE:
                p.feedback.last_angle[k] = model.turns.theta(q.rotation, model.e0 + d, d, turned)

    @property
    def counts_angles(self) -> bool:
        """Return whether feedback depends on angles, which are counted from state to state."""
        return ANGLE in self.motion.p.feedback.kind

    def recall_angles(self, p: Record, row: Row) -> None:
        """Set the counted angles to those of a stored state."""
        if not self.counts_angles:
            return
        motion, d = self.motion, np.zeros(len(p.place))
        signals_at(p, row.side, motion.w.amps)
        fill_full(p, row.z, motion.w.amps, 0, d)
        self.count_angles(p, d, motion.model.turns.at(d, row.turned))

    def begin(self) -> None:
        """Set the initial values of controllers' states, from the initial motion that supports and joints allow."""
        if not self.of_model.states:
            return
        motion = self.motion
        s, inner, row = motion.s, motion.p.inner, motion.current_row()
        d, v, _ = motion.full(row)
        s.z[inner:] = self.of_model.initial(d, v, motion.model.turns.at(d, row.turned))
        self.sample(0.0)
        motion.consistent(0.0, np.zeros(len(s.z)))
        # states that start at zero are scaled by the value that they reach soon
        sizes = np.maximum(np.abs(s.z[inner:]), motion.p.feedback.time_scale * np.abs(s.v[inner:]))
        motion.p.feedback.scale[:] = np.where(sizes < LEAST_SIZE, 0.0, sizes)
        self.set_weights()

    def set_weights(self) -> None:
        """Weigh increments and errors of controllers' states by the largest size of these states."""
        p, inner = self.motion.p, self.motion.p.inner
        one = np.divide(1.0, p.feedback.scale, out=np.zeros(len(p.feedback.scale)), where=p.feedback.scale > 0.0)
        p.straining[inner:], p.weights[inner:] = p.extent * one, self.motion.s.numbers[SIZE] * one

    def sample(self, t: float) -> bool:
        """Update the sampled controllers that are due at t; return whether there are any."""
        due = self.of_model.due(t)
        if due:
            motion = self.motion
            motion.s.z[motion.p.inner:] = self.of_model.sample(t, due, self.values_at(motion.current_row()))
        return bool(due)

    def values_at(self, row: Row) -> Array:
        """Return the quantities that feedback depends on and the controllers' states, at a state."""
        motion = self.motion
        d, v, _ = motion.full(row)
        return np.asarray(self.of_model.values(d, v, motion.model.turns.at(d, row.turned), row.z[motion.p.inner:]))

    def update_model(self, row: Row) -> dict[str, dict[str, float]]:
        """Set the model's latches and feedback loads to a state; return outputs and states of controllers there."""
        self.motion.events.update_model(row.turns)
        if not self.of_model.signals and not self.of_model.controllers:
            return {}
        values = self.values_at(row)
        self.of_model.evaluate_signals(row.side, values)
        return dict(self.of_model.outputs(row.side, values))

    def check(self, h: float) -> None:
        """Raise a ComputationError if an expression has no value here, nearby, or at the state extrapolated over h.

        Steps become ever shorter before rates at which a formula ends, and accelerations there have no meaning.
        """
        motion, model, row = self.motion, self.motion.model, self.motion.current_row()
        if not np.isfinite([row.z, row.v, row.a]).all():
            # nothing has a value here
            return
        d, v, a = motion.full(row)
        # accelerations that balance the forces have no value where rates are at a formula's limit, to round-off
        own = np.zeros(len(motion.p.place))
        signals_at(motion.p, row.side, motion.w.amps)
        fill_full(motion.p, row.a, motion.w.amps, 2, own)
        a = np.where(np.isfinite(a), a, own[:len(a)])
        turned, inner = model.turns.at(d, row.turned), motion.p.inner
        for x, more in ((0.0, 0.0), (h, 0.0), (0.0, NEAR), (0.0, -NEAR)):
            # coordinates whose extrapolation is not finite stay as they are
            ahead, rates = (np.where(np.isfinite(step), q + step, q) for q, step in (
                (d, x * v + 0.5 * x * x * a), (v, x * a + more * v)))
            states = row.z[inner:] + x * row.v[inner:]
            self.of_model.check(motion.t + x, self.of_model.values(ahead, rates, turned, states))
            check_formulas(model.interactions.points, ahead, rates, motion.t + x)

    def resume(self, sizes: Array) -> None:
        """Restore the feedback from a checkpoint."""
        motion = self.motion
        motion.p.feedback.scale[:] = sizes
        self.recall_angles(motion.p, motion.current_row())
        self.set_weights()
