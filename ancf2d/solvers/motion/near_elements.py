"""The entries of a motion's matrices where bodies touch each other: those of elements that are near each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...kernels.lowlevel.records import Record
from ...kernels.motion.dynamics import signals_at
from ...kernels.motion.many_states import read_states
from ...kernels.motion.state import COUNT, fill_full
from ...model.couplings import MARGIN
from .problem import make_problem
from .tables import with_own

# elements count as near at twice the distance if the entries last for fewer steps than this
FEW_STEPS = 10


class Layout:
    """The entries of the matrices of a motion (``stepping.Stepper``), which change when bodies come near each other.

    ``d`` (n_full,): the state for which they were made, ``margin``: the distance up to which elements are near,
    relative to their lengths, ``made``: the number of steps until then.
    """

    def __init__(self, motion: Any) -> None:
        self.motion, self.margin, self.made = motion, MARGIN, 0.0
        self.d: Array = np.zeros(len(motion.p.place))

    def follow(self) -> None:
        """Replace the entries by those for the state that the motion has reached."""
        motion = self.motion
        d, steps = np.zeros(len(motion.p.place)), float(motion.s.numbers[COUNT])
        signals_at(motion.p, motion.t, motion.w.amps)
        fill_full(motion.p, motion.s.z, motion.w.amps, 0, d)
        self.margin *= 2.0 if motion.p.fronts.missed[0] and steps - self.made < FEW_STEPS else 1.0
        self.d, self.made = d, steps
        self.apply()

    def apply(self) -> None:
        """Use the entries for ``d`` and ``margin`` in the problems of the motion."""
        motion, found = self.motion, self.problem_near(self.d, self.margin)
        motion.evaluation_problem = with_entries(motion.evaluation_problem, found)
        motion.use_problem(with_entries(motion.p, found))

    def problem_near(self, d: Array, margin: float) -> Record:
        """Return the problem with the entries for elements that are near each other at d (n_full,)."""
        model = self.motion.model
        return make_problem(model, model.numbering.near(d[:len(model.numbering.place)], margin))[0]

    def checkpoint(self) -> Array:
        """Return what the entries depend on."""
        return np.array([self.margin, self.made, *self.d])

    def resume(self, kept: Array) -> None:
        """Restore the entries of a checkpoint."""
        self.margin, self.made, self.d = float(kept[0]), float(kept[1]), kept[2:].copy()
        self.apply()
        self.motion.p.fronts.missed[1] = self.motion.s.numbers[COUNT] == self.made


def with_entries(p: Record, found: Record) -> Record:
    """Return a problem with the matrices of another one, which has other entries."""
    now, then = p.values, found.values
    return p.replaced(
        fronts=then.fronts._replace(missed=np.array([0, 1])), row_place=then.row_place, row_index=then.row_index,
        mass=then.mass.copy(), moving=now.moving._replace(fixed=then.moving.fixed),
        points=now.points._replace(assembly=with_own(then.points.assembly, "skew", "has_skew")))


def repeated(motion: Any, compute: Callable[[], bool]) -> bool:
    """Return the result of a function that changes positions and rates of a motion, repeated if matrices lack entries.
    """
    z, v = motion.s.z.copy(), motion.s.v.copy()
    result = compute()
    while motion.layout is not None and motion.p.fronts.missed[0]:
        motion.s.z[:], motion.s.v[:] = z, v
        motion.layout.follow()
        result = compute()
    return result


def read(motion: Any, every: bool, side: Array, onto: Array, columns: Sequence[Array], to: Sequence[Array]) -> None:
    """Read stored states as ``kernels.motion.many_states.read_states``, each with the entries that it needs."""
    p, given = motion.evaluation_problem, [x.copy() for x in columns[:3]]
    p.fronts.missed[0] = 0
    read_states(p, motion.w, every, side, onto, *columns, *to)
    for k in range(len(side) if p.fronts.missed[0] else 0):
        one, w, part, margin = p, motion.w, slice(k, k + 1), motion.layout.margin
        one.fronts.missed[0] = 1
        while one.fronts.missed[0]:
            for x, start in zip(columns[:3], given, strict=True):
                x[k] = start[k]
            one.fronts.missed[0] = 0
            read_states(one, w, every, side[part], onto[part], *(x[part] for x in columns), *(x[part] for x in to))
            if one.fronts.missed[0]:
                one, margin = with_entries(p, motion.layout.problem_near(to[0][k], margin)), 2.0 * margin
                one.fronts.missed[0], w = 1, w.replaced(A=np.zeros(len(one.mass)))
