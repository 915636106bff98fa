"""What answers a motion while it is stepped: controllers' states, angles that are counted, values that loads have."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.shape import Array
from ...kernels.lowlevel.records import Record
from ...kernels.motion.dynamics import signals_at
from ...kernels.motion.state import SIZE, fill_full
from ...model.feedback import ANGLE
from ...model.point_patch import check_formulas
from ..state import Row


class Answers:
    """The feedback of a motion (``stepping.Stepper``)."""

    def __init__(self, motion: Any) -> None:
        self.motion, self.feedback = motion, motion.model.feedback

    def count_angles(self, p: Record, d: Array, turned: Array) -> None:
        """Let the angles that something answers be counted from those at d (n_full,) on."""
        model = self.motion.model
        d = d[:model.n_q]
        # a controller that nothing uses answers no angles
        for k, q in enumerate(self.feedback.quantities[:len(p.feedback.near)]):
            if q.rotation is not None and q.kind == ANGLE:
                p.feedback.near[k] = model.turns.theta(q.rotation, model.e0 + d, d, turned)

    @property
    def counts(self) -> bool:
        """Whether something answers angles, which are counted from state to state."""
        return ANGLE in self.motion.p.feedback.kind

    def recall(self, p: Record, row: Row) -> None:
        """Let the angles be those of a stored state."""
        if not self.counts:
            return
        motion, d = self.motion, np.zeros(len(p.place))
        signals_at(p, row.side, motion.w.amps)
        fill_full(p, row.z, motion.w.amps, 0, d)
        self.count_angles(p, d, motion.model.turns.at(d, row.turned))

    def begin(self) -> None:
        """Give controllers' states their initial values, at the motion as supports and joints leave it."""
        if not self.feedback.states:
            return
        motion = self.motion
        s, inner, row = motion.s, motion.p.inner, motion.here()
        d, v, _ = motion.full(row)
        s.z[inner:] = self.feedback.initial(d, v, motion.model.turns.at(d, row.turned))
        self.sample(0.0)
        motion.consistent(0.0, np.zeros(len(s.z)))
        # of those that begin at zero, what they reach soon
        motion.p.feedback.scale[:] = np.maximum(np.abs(s.z[inner:]), motion.p.feedback.soon * np.abs(s.v[inner:]))
        self.weigh()

    def weigh(self) -> None:
        """Weigh increments and errors of controllers' states by how large these have been."""
        p, inner = self.motion.p, self.motion.p.inner
        one = np.divide(1.0, p.feedback.scale, out=np.zeros(len(p.feedback.scale)), where=p.feedback.scale > 0.0)
        p.straining[inner:], p.weights[inner:] = p.extent * one, self.motion.s.numbers[SIZE] * one

    def sample(self, t: float) -> bool:
        """Let the controllers act that do so at t; return whether there are any."""
        due = self.feedback.due(t)
        if due:
            motion = self.motion
            motion.s.z[motion.p.inner:] = self.feedback.sample(t, due, self.told(motion.here()))
        return bool(due)

    def told(self, row: Row) -> Array:
        """Return what a state tells of the quantities that something answers, and controllers' states."""
        motion = self.motion
        d, v, _ = motion.full(row)
        return np.asarray(self.feedback.values(d, v, motion.model.turns.at(d, row.turned), row.z[motion.p.inner:]))

    def look(self, row: Row) -> dict[str, dict[str, float]]:
        """Let loads that answer the motion be those of a state; return what controllers put out and remember there."""
        self.motion.events.look(row.turns)
        if not self.feedback.answers and not self.feedback.controllers:
            return {}
        values = self.told(row)
        self.feedback.look(row.side, values)
        return dict(self.feedback.outputs(row.side, values))

    def check(self, h: float) -> None:
        """Raise the ComputationError of what has no value here, or a time h on as the motion goes."""
        motion, model, row = self.motion, self.motion.model, self.motion.here()
        if not np.isfinite([row.z, row.v, row.a]).all():
            # nothing has a value there
            return
        d, v, a = motion.full(row)
        turned, inner = model.turns.at(d, row.turned), motion.p.inner
        for x in (0.0, h):
            # what is not finite stands still
            d, v = (np.where(np.isfinite(step), q + step, q) for q, step in (
                (d, x * v + 0.5 * x * x * a), (v, x * a)))
            states = row.z[inner:] + x * row.v[inner:]
            self.feedback.check(motion.t + x, self.feedback.values(d, v, turned, states))
            check_formulas(model.interactions.points, d, v, motion.t + x)

    def resume(self, sizes: Array) -> None:
        """Go on from a checkpoint."""
        motion = self.motion
        motion.p.feedback.scale[:] = sizes
        self.recall(motion.p, motion.here())
        self.weigh()
