"""A motion repeated together with the derivatives of its states, along the steps as they were made.

The equations R_i = 0 of the stages of each step are differentiated like those of equilibria (``statics``): dR/dp by
differences of varied models at the same stages, K, C and M by the tangents. A step's matrix is factored once for all
numbers. Only the change of the state is passed from step to step, so memory does not grow with the number of steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from ...case import Dynamic
from ...elements.shape import Array
from ...kernels.lowlevel.records import Record
from ...kernels.motion import many_states
from ...kernels.motion.advance import EVENT, INSIDE
from ...kernels.motion.state import Motion
from ...model.model import Model
from ..motion.breaks import pass_break
from ..motion.dynamic import Run
from ..motion.stepping import LOG, Stepper
from ..state import Row, State
from .differences import UnsuitedError
from .linear_steps import Change, Entries, Equations, Stages, method_of
from .varied_motions import VariedNumber, carried, joined, rests

# tolerances of Newton's increments; the first at which fixed steps are as long as in the run is used
NEWTON = (1e-13, 1e-12, 1e-11, 1e-10)
# iterations up to which a step would converge with a larger tolerance, too
EASY = 5
# relative difference of equal step lengths
SAME = 1e-6
# largest number of floats stored for the stages of a window of steps
WINDOW = 1 << 21
# relative to the scene: displacement over which tangents are checked along a change
TRIED = 5e-6
# largest number of corrections of changes
CORRECTIONS = 12
# relative correction above which they have not converged
LOOSE = 1e-6
# changes over a number's step that are round-off, relative to the scene, and to accelerations and multipliers
UNMOVED, NOISE = 1e-12, 1e-10
# weight of relative errors of accelerations and multipliers, which are differences of positions
OF_FORCES = 1e-2
# error allowed for the sum of the changes by all numbers, and the golden section, for unequal shares in it
ENOUGH, GOLDEN = 5e-9, 0.6180339887498949


@dataclass
class Step:
    """A step: time, length and stages, history variables before it, and the states stored in it."""

    t: float
    h: float
    stages: Stages
    turns: Array
    feet: Array
    rows: list[Row]


@dataclass
class Course:
    """Changes along some steps: of stages (m, n, k), and of the starts and the last end (steps + 1, 4, n, k)."""

    stages: Stages
    ends: Array

    def at(self, k: int) -> Change:
        """Return the change of the start of step k, or with -1 of the last end."""
        return Change(*self.ends[k])

    def add(self, other: Course, columns: Any) -> None:
        """Add other changes to the given columns."""
        self.ends[..., columns] += other.ends
        for name in ("z", "v", "a"):
            getattr(self.stages, name)[:, :, columns] += getattr(other.stages, name)


class RepeatedMotion:
    """A motion repeated step by step, with the linear equations of its steps.

    ``lengths`` are those of fixed steps in a run; if empty, they are found when needed; None if they may differ.
    """

    def __init__(self, model: Model, spec: Dynamic, tolerance: float, lengths: list[float] | None) -> None:
        # without coarser motions for an error estimate
        self.run = Run(model, replace(spec, estimate=False))
        self.stepper = self.run.stepper
        self.stepper.tighten(tolerance)
        self.stepper.keeps_checks = False
        p, m = self.stepper.p, self.stepper.m
        assert m is not None
        self.own, self.method = m.own, method_of(m.own)
        self.entries = Entries(model, p, self.method.stages)
        self.mass, self.free = self.entries.read(p.mass), self.entries.free
        self.damped = bool(p.tau.any()) or len(p.points.mem) > 0
        # state before the last step, and number of steps made
        self.before: dict[str, Array] = {}
        self.lengths, self.step_count = lengths, 0

    def steps(self) -> Iterator[Step | None]:
        """Make the motion; yield its steps, and None when it has reached a break."""
        stepper, rows = self.stepper, list[Row]()
        while not stepper.done:
            s, p = stepper.s, stepper.p
            t, turns, feet = stepper.t, p.points.mem.copy(), p.sliding.memory.copy()
            self.before = {name: value.copy() for name, value in zip(Motion._fields, s.values, strict=True)}
            why, logged = stepper.advance(rows, 1)
            if why == EVENT:
                raise UnsuitedError("events depend on the motion")
            if logged:
                self.step_count += 1
                h = float(stepper.rows.log[0, 2])
                stages = self.method.stages_of_step(self.own.values, self.before["z"], t, h)
                yield Step(t, h, stages, turns, feet, rows)
                rows = []
            if stepper.at_break(why):
                yield None

    def differs_from_run(self) -> bool:
        """Return whether the last step is a fixed one with another length than in the run.

        With smaller increments, Newton's method may form a tangent earlier and converge where it does not in the run,
        or fail where that converges. As long as all steps are easy, no run is made for comparison.
        """
        stepper, lengths = self.stepper, self.lengths
        if lengths is None or stepper.dt == 0.0:
            return False
        if not lengths:
            iterations, cut = (stepper.rows.log[0, LOG.index(name)] for name in ("iterations", "rejected"))
            if not cut and (self.method.stages > 1 or iterations <= EASY):
                return False
            lengths += lengths_of(Run(self.run.model, self.run.spec).states())
        h, k = float(stepper.rows.log[0, LOG.index("dt")]), self.step_count - 1
        return k >= len(lengths) or not math.isclose(h, lengths[k], rel_tol=SAME)

    def moments(self, window: Sequence[Step]) -> Record:
        def joined(name: str) -> Array:
            return np.concatenate([getattr(step.stages, name) for step in window])

        s = self.method.stages
        turns, feet = (np.repeat(np.array([getattr(step, name) for step in window]), s, axis=0)
                       for name in ("turns", "feet"))
        return Record(many_states.States(joined("t"), joined("z"), joined("v"), joined("a"), turns, feet))

    def equations(self, window: Sequence[Step], at: Record) -> Equations:
        """Return the factored equations of some steps."""
        p, w = self.stepper.p, self.stepper.w
        A = np.zeros((len(at.t), len(p.mass)))
        many_states.tangents(p, w, at, 0.0, A)
        K = self.entries.read(A)
        C = np.broadcast_to(p.alpha * self.mass, K.shape)
        if self.damped:
            many_states.tangents(p, w, at, 1.0, A)
            C = C + self.entries.read(A) - K
        lengths = np.array([step.h for step in window])
        try:
            return Equations(self.entries, self.method, lengths, K, C, self.mass, self.damped or p.alpha != 0.0)
        except ArithmeticError as found:
            t = window[found.args[0]].t
            raise UnsuitedError(f"the equations of the step at t = {t:.6g} are singular") from None

    @cached_property
    def by_mass(self) -> Any:
        """The factors of the mass matrix."""
        from scipy.sparse.linalg import splu

        return splu(self.entries.matrix(self.mass).tocsc())

    def now(self) -> Record:
        """Return the current state of the motion, with its accelerations."""
        s, p = self.stepper.s, self.stepper.p
        return Record(many_states.States(np.array([self.stepper.t]), *(np.array(x)[None] for x in (
            s.z, s.v, s.a, p.points.mem, p.sliding.memory))))


def lengths_of(states: Iterable[State]) -> list[float]:
    """Return the lengths of all steps of a motion."""
    return [h for state in states for h in state.blocks["dt"].tolist()]


class MotionWithDerivatives(RepeatedMotion):
    """A motion repeated with the derivatives of its states, up to ``negligible`` relative errors.

    Raises UnsuitedError.
    """

    def __init__(self, model: Model, spec: Dynamic, all_states: bool, tolerance: float,
                 lengths: list[float] | None, negligible: float) -> None:
        super().__init__(model, spec, tolerance, lengths)
        self.all_states, self.negligible = all_states, negligible
        # a second motion of the same model, for differences across breaks
        self.other: Stepper | None = None
        self.rows: list[Row] = []
        self.changes: list[Array] = []
        # whether all tangents have been exact so far
        self.precise = True
        # for each number: error of the linear equations, and of differences of lower order over the first steps
        self.equation_error, self.rough = np.zeros(0), np.zeros(0)

    def make(self, numbers: Sequence[VariedNumber], steps: int | None = None) -> bool:
        """Make the motion, or so many steps; return whether these are as long as in the run.

        ``rows`` and ``changes`` (3, n, 2 numbers) are then those of the stored states.
        """
        stepper, self.numbers = self.stepper, numbers
        self.run.begin()
        self.equation_error = np.zeros(len(numbers))
        change = self._begin()
        self._store(stepper.last(), change)
        size, window = min(self._size(), steps or self._size()), list[Step]()
        for step in self.steps():
            if step is not None and self.differs_from_run():
                return False
            if step is not None:
                window.append(step)
            if len(window) == size or step is None:
                change, window = self._through(window, change), []
                if steps is not None:
                    return True
            if step is None:
                change = self._behind_break(change)
        change = self._through(window, change)
        self._store(stepper.last(), change)
        return True

    def _begin(self) -> Change:
        """Return the change of the start."""
        if not (self.free.all() and rests(self.run)):
            return joined([one.begin() for one in self.numbers])
        none = np.zeros((self.entries.n, 2 * len(self.numbers)))
        a = self._accelerations()
        return Change(none, none.copy(), a, a)

    def _accelerations(self) -> Array:
        """Return the derivatives of accelerations (n, 2 numbers) by the numbers, if the motion restarts from here."""
        at = self.now()
        dR = [one.differing.residuals(at, self.stepper.p)[:, 0] for one in self.numbers]
        return np.asarray(-self.by_mass.solve(np.concatenate(dR).T))

    def _behind_break(self, change: Change) -> Change:
        """Return the change after a break, and move the motion across it."""
        stepper, piece = self.stepper, self.stepper.piece + 1
        if self.other is None:
            self.other = Run(self.run.model, self.run.spec).stepper
        change = carried(self.other, stepper, change, piece, TRIED * stepper.p.extent)
        if self.free.all() and not len(stepper.p.motion_coord):
            pass_break(stepper, piece)
            none, a = np.zeros_like(change.z), self._accelerations()
            return change.plus(Change(none, none, a, a))
        change = change.plus(joined([one.pass_break(stepper, piece) for one in self.numbers]))
        pass_break(stepper, piece)
        return change

    def _size(self) -> int:
        """Return the number of steps of a window."""
        n, s, k = self.entries.n, self.method.stages, 2 * len(self.numbers)
        each = s * n * (10 * k + 10) + s * len(self.mass) * (2 + s) + s * n * (3 * s * self.stepper.p.width + 1)
        return int(min(max(WINDOW // max(each, 1), 1), 256))

    def _store(self, row: Row, change: Change) -> None:
        """Store a state and its change."""
        if not self.all_states:
            self.rows, self.changes = [], []
        self.rows.append(row)
        self.changes.append(np.array([change.z, change.v, change.a]))

    # ------------------------------------------------------------------ windows of steps

    def _through(self, window: Sequence[Step], change: Change) -> Change:
        """Return the change after some steps from the change before them."""
        if not window:
            return change
        n, m = self.entries.n, len(window) * self.method.stages
        at = self.moments(window)
        dR = np.zeros((m, n, 2 * len(self.numbers)))
        for k, one in enumerate(self.numbers):
            dR[:, :, 2 * k:2 * k + 2] = np.moveaxis(one.differing.residuals(at, self.stepper.p), 0, 2)
        equations = self.equations(window, at)
        course = Course(*equations.follow(dR, change))
        self.precise = self.precise and self._exact(equations, at, dR, course)
        if not self.precise:
            self._correct(equations, at, dR, course)
        if not len(self.rough):
            self.rough = np.array([lower_order_error(self.stepper.p.weights, course.stages.z[:, :, 2 * k:2 * k + 2])
                                   for k in range(len(self.numbers))])
        for k, step in enumerate(window if self.all_states else ()):
            for row in step.rows:
                if row.t < self.run.spec.t_end:
                    self._store(row, self._within(step, row, course, k))
        return course.at(-1)

    def _exact(self, equations: Equations, at: Record, dR: Array, course: Course) -> bool:
        """Return whether the residuals are stationary along the changes, checked once along a weighted sum of all.

        The sum contains each number's change scaled to equal size, with factors that prevent cancellation.
        """
        weights, stages, own = self.stepper.p.weights[None, :, None], course.stages, slice(None, None, 2)
        sizes = np.maximum((weights * np.abs(stages.z[:, :, own])).max(axis=(0, 1), initial=0.0),
                           UNMOVED * self.stepper.p.extent * self._per_step)
        factors = (0.5 + np.arange(len(sizes)) * GOLDEN % 1.0) / sizes
        z, v, a = (np.ascontiguousarray(x[:, :, own] @ factors) for x in (stages.z, stages.v, stages.a))
        size = max(float((weights[:, :, 0] * np.abs(z)).max(initial=0.0)), 1.0)
        J = np.zeros(z.shape)
        many_states.derivatives_along(self.stepper.p, self.stepper.w, at, z, v, a,
                                      TRIED * self.stepper.p.extent / size, J)
        defect = (dR[:, :, own] @ factors + J)[:, :, None]
        more, _ = equations.follow(defect, Change.none(self.entries.n, 1))
        left = self._share(at, Stages(stages.t, z, v, a), more, 0, size, float(factors @ self._per_step))
        enough = left <= max(ENOUGH, self.negligible)
        if enough:
            self.equation_error = np.maximum(self.equation_error, left)
        return enough

    def _correct(self, equations: Equations, at: Record, dR: Array, course: Course) -> None:
        """Correct changes until the residuals are stationary along them, as Newton's tangents are not all exact."""
        weights, stepper = self.stepper.p.weights[None, :], self.stepper
        some = np.arange(len(self.numbers))
        before, worst, J = np.ones(len(some)), np.full(len(some), np.inf), np.zeros(dR.shape[:2])
        last = np.zeros(len(some))
        for _ in range(CORRECTIONS):
            defects, sizes = np.zeros((*dR.shape[:2], len(some))), UNMOVED * stepper.p.extent * self._per_step[some]
            for k, number in enumerate(some.tolist()):
                z, v, a = (np.ascontiguousarray(x[:, :, 2 * number]) for x in
                           (course.stages.z, course.stages.v, course.stages.a))
                sizes[k] = max(float((weights * np.abs(z)).max(initial=0.0)), sizes[k])
                many_states.derivatives_along(stepper.p, stepper.w, at, z, v, a,
                                              TRIED * stepper.p.extent / sizes[k], J)
                defects[:, :, k] = dR[:, :, 2 * number] + J
            more = Course(*equations.follow(defects, Change.none(self.entries.n, len(some))))
            stages = course.stages
            shares = np.array([
                self._share(at, Stages(stages.t, *(x[:, :, 2 * number] for x in (stages.z, stages.v, stages.a))),
                            more.stages, k, float(sizes[k]), float(self._per_step[number]))
                for k, number in enumerate(some.tolist())])
            for columns in (2 * some, 2 * some + 1):
                course.add(more, columns)
            # assume that each correction reduces the error by the same ratio
            left = shares * shares / before[some]
            before[some], last[some] = shares, left
            going = (left > self.negligible) & (shares < worst[some])
            worst[some] = 0.5 * shares
            some = some[going]
            if not len(some):
                break
        self.equation_error = np.maximum(self.equation_error, last)
        if (last > max(LOOSE, self.negligible)).any():
            raise UnsuitedError("the tangents of the steps do not determine their derivatives")

    @property
    def _per_step(self) -> Array:
        """Return 1/h of each number (numbers,)."""
        return 1.0 / np.array([abs(number.h) for number in self.numbers])

    def _share(self, at: Record, stages: Stages, more: Stages, k: int, size: float, per_step: float) -> float:
        """Return the size of ``more`` changes (m, n, numbers) of number k relative to those of ``stages`` (m, n).

        It is the larger of that of positions, which change by ``size``, and OF_FORCES times that of accelerations and
        multipliers.
        """
        weights, held = self.stepper.p.weights, 1.0 - self.free
        shares = [float((weights * np.abs(more.z[:, :, k])).max(initial=0.0)) / size]
        for base, x, new, by in ((at.a, stages.a, more.a, weights), (at.z, stages.z, more.z, held)):
            own, changed, off = (float((by * np.abs(y)).max(initial=0.0)) for y in (base, x, new[:, :, k]))
            shares.append(OF_FORCES * max(off - NOISE * own * per_step, 0.0) / (changed or 1.0))
        return max(shares)

    def _within(self, step: Step, row: Row, course: Course, k: int) -> Change:
        """Return the change of a state stored in a step."""
        s = self.method.stages
        if row.kind != INSIDE:
            return course.at(k + 1)
        mine = slice(s * k, s * k + s)
        start = course.at(k)
        found = Stages(step.stages.t, course.stages.z[mine], course.stages.v[mine], course.stages.a[mine])
        dense, x = self.method.dense(start, found, step.h, self.free), (row.t - step.t) / step.h
        assert self.stepper.m is not None
        basis = self.stepper.m.record.basis.T
        f = [polynomial.polyval(x, polynomial.polyder(basis, order)) for order in range(3)]
        z, v, a = (np.tensordot(one, dense, 1) for one in f)
        free = self.free[:, None]
        return Change(start.z + z, free * v / step.h, free * a / step.h**2, start.own)


def lower_order_error(weights: Array, both: Array) -> float:
    """Return the error of differences of lower order relative to the largest change: ``both`` (m, n, 2) of a number."""
    size, far = (float((weights * np.abs(x)).max(initial=0.0)) for x in (both[..., 0], both[..., 0] - both[..., 1]))
    return far / size if size > 0.0 else 0.0
