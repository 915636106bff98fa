"""How a motion changes with numbers of its case: the derivative of the steps as they were made.

The motion is made once more, step by step. Each step's equations R_i = 0 of its stages are differentiated as those of
equilibria are (``solvers.variation``): dR/dp by differences of models beside the number at the same stages, K, C and M
by the tangents. A step's matrix is factored once for all numbers. What goes from step to step is the change of the
state: memory does not grow with the steps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from ..case import Dynamic
from ..elements.shape import Array
from ..errors import CaseError, ComputationError
from ..kernels import along
from ..kernels.advance import CHECK, EVENT, INSIDE
from ..kernels.lowlevel.records import Record
from ..kernels.motion import REJECTED
from ..model.model import Model
from .beside import Beside, Varied, carried, joined
from .breaks import pass_break
from .differences import SHORTER, SMOOTH, TRIES, Quotient, UnsuitedError
from .dynamic import Run
from .linear_steps import Change, Entries, Stages, StepFactors, method_of
from .state import Row, State
from .stepping import Stepper

# numbers that the stages of a window of steps are kept in, at most
WINDOW = 1 << 21
# of the scene: how far tangents are tried along a change
TRIED = 5e-6
# corrections of a change, relative to the largest, that are none; and most of them
CLOSE, CORRECTIONS = 1e-9, 12
# the same, beyond which they do not come to an end
LOOSE = 1e-6
# of Newton's increments, the first that does not shorten fixed steps: stages are differentiated as they are
NEWTON = (1e-13, 1e-12, 1e-11, 1e-10)


@dataclass
class Step:
    """A step that was made: time, length and stages, what laws remembered before, and states stored within."""

    t: float
    h: float
    stages: Stages
    turns: Array
    feet: Array
    rows: list[Row]


@dataclass
class Course:
    """Changes along some steps: of the start of each, of the stages (m, n, k), of all, and of the end."""

    starts: list[Change]
    stages: Stages
    end: Change

    def add(self, other: Course, columns: Any) -> None:
        """Add other changes to some of the columns, once for each of them."""
        for mine, more in zip([*self.starts, self.end], [*other.starts, other.end], strict=True):
            for name in ("z", "v", "a", "own"):
                getattr(mine, name)[:, columns] += getattr(more, name)
        for name in ("z", "v", "a"):
            getattr(self.stages, name)[:, :, columns] += getattr(other.stages, name)


class Pass:
    """A motion made once more, with the changes of its states beside it. Raises UnsuitedError."""

    def __init__(self, model: Model, spec: Dynamic, whole: bool, tolerance: float, rejected: int) -> None:
        self.run, self.rejected = Run(model, spec), rejected
        self.stepper, self.whole = self.run.stepper, whole
        self.stepper.tighten(tolerance)
        # the same motion once more, for what it does at breaks
        self.other: Stepper | None = None
        p, m = self.stepper.p, self.stepper.m
        assert m is not None
        self.own, self.method = m.own, method_of(m.own)
        self.entries = Entries(model, p, self.method.stages)
        self.mass, self.free = self.entries.read(p.mass), self.entries.free
        self.M = self.entries.matrix(self.mass)
        self.damped = bool(p.tau.any()) or len(p.points.mem) > 0
        self.rows: list[Row] = []
        self.changes: list[Array] = []
        # how far linear equations were off, of each number
        self.off = np.zeros(0)

    def make(self, numbers: Sequence[Beside]) -> bool:
        """Make the motion; return whether its steps are the fixed ones that were asked for.

        ``rows`` and ``changes`` (3, n, 2 numbers) are then those of the stored states.
        """
        stepper, self.numbers = self.stepper, numbers
        self.run.begin()
        self.off = np.zeros(len(numbers))
        change = joined([one.begin() for one in numbers])
        self._take(stepper.last(), change)
        size, window = self._size(), list[Step]()
        for step in self._steps():
            if step is not None:
                window.append(step)
            if len(window) == size or step is None:
                change, window = self._through(window, change), []
            if step is None:
                change = self._behind_break(change)
        change = self._through(window, change)
        self._take(stepper.last(), change)
        return stepper.dt == 0.0 or stepper.s.numbers[REJECTED] <= self.rejected

    def _behind_break(self, change: Change) -> Change:
        """Return the change behind a break, which the motion passes."""
        stepper, piece = self.stepper, self.stepper.piece + 1
        if self.other is None:
            self.other = Run(self.run.model, self.run.spec).stepper
        change = carried(self.other, stepper, change, piece, TRIED * stepper.p.extent)
        change = change.plus(joined([one.pass_break(stepper, piece) for one in self.numbers]))
        pass_break(stepper, piece)
        return change

    def _size(self) -> int:
        """Return how many steps are taken at a time."""
        n, s, k = self.entries.n, self.method.stages, 2 * len(self.numbers)
        each = s * n * (10 * k + 10) + s * len(self.mass) * (2 + s) + s * n * (3 * s * self.stepper.p.width + 1)
        return int(min(max(WINDOW // each, 1), 256))

    def _steps(self) -> Iterator[Step | None]:
        """Make the motion; yield its steps, and None where it has come to a break."""
        stepper, rows = self.stepper, list[Row]()
        while not stepper.done:
            s, p = stepper.s, stepper.p
            t, z = stepper.t, s.z.copy()
            turns, feet = p.points.mem.copy(), p.sliding.memory.copy()
            why, logged = stepper.advance(rows, 1)
            if why == EVENT:
                raise UnsuitedError("events answer the motion")
            if logged:
                h = float(stepper.rows.log[0, 2])
                stages = self.method.taken(self.own.values, z, t, h)
                yield Step(t, h, stages, turns, feet, [row for row in rows if row.kind != CHECK])
                rows = []
            if stepper.breaks(why):
                yield None

    def _take(self, row: Row, change: Change) -> None:
        """Keep a stored state and its change."""
        if not self.whole:
            self.rows, self.changes = [], []
        self.rows.append(row)
        self.changes.append(np.array([change.z, change.v, change.a]))

    # ------------------------------------------------------------------ some steps at a time

    def _through(self, window: Sequence[Step], change: Change) -> Change:
        """Return the change behind some steps, of which ``change`` is that before them."""
        if not window:
            return change
        n, m = self.entries.n, len(window) * self.method.stages
        at = self._moments(window)
        dR = np.zeros((m, n, 2 * len(self.numbers)))
        for k, one in enumerate(self.numbers):
            dR[:, :, 2 * k:2 * k + 2] = np.moveaxis(one.residuals(at, (m, n)), 0, 2)
        equations = self._equations(window, at)
        course = self._follow(window, equations, dR, change)
        self._correct(window, equations, at, dR, course)
        for k, step in enumerate(window if self.whole else ()):
            for row in step.rows:
                if row.t < self.run.spec.t_end:
                    self._take(row, self._within(step, row, course, k))
        return course.end

    def _moments(self, window: Sequence[Step]) -> Record:
        def joined(name: str) -> Array:
            return np.concatenate([getattr(step.stages, name) for step in window])

        s = self.method.stages
        turns, feet = (np.repeat(np.array([getattr(step, name) for step in window]), s, axis=0)
                       for name in ("turns", "feet"))
        return Record(along.Moments(joined("t"), joined("z"), joined("v"), joined("a"), turns, feet))

    def _equations(self, window: Sequence[Step], at: Record) -> list[tuple[StepFactors, list[Any]]]:
        """Return factors of each step, and C + alpha M of its stages where there is any."""
        p, w, s = self.stepper.p, self.stepper.w, self.method.stages
        A = np.zeros((len(at.t), len(p.mass)))
        along.tangents(p, w, at, 0.0, A)
        K = self.entries.read(A)
        C = np.broadcast_to(p.alpha * self.mass, K.shape)
        if self.damped:
            along.tangents(p, w, at, 1.0, A)
            C = C + self.entries.read(A) - K
        out = []
        for k, step in enumerate(window):
            mine = slice(s * k, s * k + s)
            try:
                factors = self.entries.factors(K[mine], C[mine], self.mass, *self.method.rates(step.h))
            except ArithmeticError:
                raise UnsuitedError(f"the equations of the step at t = {step.t:.6g} are singular") from None
            rates = [self.entries.matrix(c) for c in C[mine]] if self.damped or p.alpha else []
            out.append((factors, rates))
        return out

    def _follow(self, window: Sequence[Step], equations: Sequence[tuple[StepFactors, list[Any]]], dR: Array,
                change: Change) -> Course:
        """Return the changes along steps that dR (m, n, k) and a change of the start make."""
        s, n, free = self.method.stages, self.entries.n, self.free[:, None]
        out = Stages(np.zeros(0), *(np.zeros(dR.shape) for _ in range(3)))
        starts = []
        for k, (step, (factors, rates)) in enumerate(zip(window, equations, strict=True)):
            mine = slice(s * k, s * k + s)
            starts.append(change)
            v0, a0 = (free * x for x in self.method.constants(change, step.h))
            b = dR[mine] + (self.M @ a0.transpose(1, 0, 2).reshape(n, -1)).reshape(n, s, -1).transpose(1, 0, 2)
            for i, C in enumerate(rates):
                b[i] += C @ v0[i]
            z = factors.solve(-b)
            V, A = self.method.rates(step.h)
            v, a = ((F @ z.reshape(s, -1)).reshape(z.shape) for F in (V, A))
            found = Stages(step.stages.t, z, v0 + free * v, a0 + free * a)
            out.z[mine], out.v[mine], out.a[mine] = found.z, found.v, found.a
            change = self.method.end(change, found, step.h)
        return Course(starts, out, change)

    def _correct(self, window: Sequence[Step], equations: Sequence[tuple[StepFactors, list[Any]]], at: Record,
                 dR: Array, course: Course) -> None:
        """Correct changes until the residuals change by nothing along them: tangents are Newton's, not all exact."""
        weights, stepper = self.stepper.p.weights[None, :], self.stepper
        some = np.arange(len(self.numbers))
        before, worst, J = np.ones(len(some)), np.full(len(some), np.inf), np.zeros(dR.shape[:2])
        last = np.zeros(len(some))
        for _ in range(CORRECTIONS):
            defects = np.zeros((*dR.shape[:2], len(some)))
            sizes = np.zeros(len(some))
            for k, number in enumerate(some.tolist()):
                z, v, a = (np.ascontiguousarray(x[:, :, 2 * number]) for x in
                           (course.stages.z, course.stages.v, course.stages.a))
                sizes[k] = float((weights * np.abs(z)).max(initial=0.0))
                step = TRIED * stepper.p.extent / sizes[k] if sizes[k] > 0.0 else self.numbers[number].h
                along.actions(stepper.p, stepper.w, at, z, v, a, step, J)
                defects[:, :, k] = dR[:, :, 2 * number] + J
            more = self._follow(window, equations, defects, Change.none(self.entries.n, len(some)))
            shares = np.array([float((weights * np.abs(more.stages.z[:, :, k])).max(initial=0.0)) for k in
                               range(len(some))]) / np.where(sizes > 0.0, sizes, 1.0)
            for columns in (2 * some, 2 * some + 1):
                course.add(more, columns)
            # the first correction is as good as the tangents were
            left = shares * shares / before[some]
            before[some], last[some] = shares, left
            going = (left > CLOSE) & (shares < worst[some])
            worst[some] = 0.5 * shares
            some = some[going]
            if not len(some):
                break
        self.off = np.maximum(self.off, last)
        if (last > LOOSE).any():
            raise UnsuitedError("the tangents of the steps do not tell how they change")

    def _within(self, step: Step, row: Row, course: Course, k: int) -> Change:
        """Return the change of a state that is stored within a step."""
        s, start = self.method.stages, course.starts[k]
        if row.kind != INSIDE:
            return course.starts[k + 1] if k + 1 < len(course.starts) else course.end
        mine = slice(s * k, s * k + s)
        found = Stages(step.stages.t, course.stages.z[mine], course.stages.v[mine], course.stages.a[mine])
        dense, x = self.method.dense(start, found, step.h, self.free), (row.t - step.t) / step.h
        assert self.stepper.m is not None
        basis = self.stepper.m.record.basis.T
        f = [polynomial.polyval(x, polynomial.polyder(basis, order)) for order in range(3)]
        z, v, a = (np.tensordot(one, dense, 1) for one in f)
        free = self.free[:, None]
        return Change(start.z + z, free * v / step.h, free * a / step.h**2, start.own)


class Motion:
    """The change of the states of a motion with numbers of its case, of the last alone unless ``whole``."""

    def __init__(self, model: Model, last: State, whole: bool) -> None:
        spec = model.case.solver
        assert isinstance(spec, Dynamic)
        self.model, self.spec, self.whole, self.rejected = model, spec, whole, int(last.report["rejected"])
        self.found: dict[Varied, Quotient | Exception] = {}
        self.runs: dict[int, Run] = {}
        self.rows: list[Row] = []

    def prepare(self, beside: Sequence[tuple[Varied, float]]) -> None:
        """Find the derivatives to several numbers at once, with shorter steps of those where they are too long."""
        todo = list(beside)
        for _ in range(TRIES):
            if todo:
                todo = [(at, h * SHORTER) for (at, h), share in zip(todo, self._once(todo), strict=True)
                        if share > SMOOTH]

    def slope(self, at: Varied, h: float) -> Quotient:
        """Return the derivatives of z, v and a of all states. Raises UnsuitedError, CaseError, ComputationError."""
        if at not in self.found:
            self.prepare([(at, h)])
        found = self.found[at]
        if isinstance(found, Exception):
            raise found
        return found

    def _once(self, todo: Sequence[tuple[Varied, float]]) -> list[float]:
        """Find derivatives; return how far differences of lower order are from them."""
        for tolerance in NEWTON:
            motion = Pass(self.model, self.spec, self.whole, tolerance, self.rejected)
            numbers, refused = dict[int, Beside](), dict[int, Exception]()
            for k, (at, h) in enumerate(todo):
                try:
                    numbers[k] = Beside(at, h, self.spec, motion.stepper.pieces)
                except (CaseError, ComputationError, UnsuitedError) as found:
                    refused[k] = found
            try:
                if not numbers or motion.make(list(numbers.values())):
                    break
            except UnsuitedError as found:
                refused |= dict.fromkeys(numbers, found)
                break
            except ComputationError as found:
                reason = UnsuitedError(f"its steps cannot be made once more: {found.failure.reason}")
                refused |= dict.fromkeys(numbers, reason)
        shares = [0.0] * len(todo)
        for k, why in refused.items():
            self.found.setdefault(todo[k][0], why)
        self.rows = motion.rows or self.rows
        weights = motion.stepper.p.weights[:, None]
        for column, (k, number) in enumerate(numbers.items()):
            if k in refused:
                continue
            both = np.array(motion.changes)[..., 2 * column:2 * column + 2]
            value, gap = both[..., 0], np.abs(both[..., 0] - both[..., 1])
            size, far = ((weights * np.abs(x[:, 0, :, None])).max(initial=0.0) for x in (value, gap))
            shares[k] = float(far / size) if size > 0.0 else 0.0
            error = gap * min(shares[k], 1.0) + motion.off[column] * np.abs(value)
            best = self.found.get(number.at)
            if not isinstance(best, Quotient) or error.max(initial=0.0) < best.error.max(initial=0.0):
                self.found[number.at] = Quotient(value.ravel(), error.ravel(), number.h)
                self.runs |= {id(run.model): run for run in number.runs}
        return shares

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the states of a model beside the first one, where everything has changed by so much."""
        if id(model) not in self.runs:
            self.runs[id(model)] = Run(model, self.spec)
        run = self.runs[id(model)]
        n = len(run.stepper.p.coordinate)
        out = []
        for row, (z, v, a) in zip(self.rows, change.reshape(-1, 3, n), strict=True):
            moved = replace(row, z=row.z + z, v=row.v + v, a=row.a + a)
            out.append(run.state(moved))
        return out
