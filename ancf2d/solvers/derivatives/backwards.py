"""The discrete adjoint of a motion: its steps are kept, then followed backwards for a few goals.

The linearised equations of a step (``solvers.derivatives.motion_states``), transposed, turn the derivative of the goals
with respect to the end of the step into those with respect to its residuals and its start (the discrete adjoint).
Stages are kept while there is room. Later ones are computed again from checkpoints, window by window (Griewank &
Walther, Evaluating Derivatives, SIAM 2008, chapter 12), so memory does not grow with the number of steps.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import islice
from typing import Protocol

import numpy as np
from numpy.polynomial import polynomial

from ...case import Dynamic
from ...elements.shape import Array
from ...kernels.lowlevel.records import Record
from ...kernels.motion import along
from ...kernels.motion.advance import INSIDE
from ...model.model import Model
from ..linear import unknowns_to_coordinates
from ..motion.breaks import pass_break
from ..motion.dynamic import Run
from ..motion.failures import check_joints
from ..motion.stepping import CHUNK_SECONDS, Stepper
from ..state import Row, State
from .differences import UnsuitedError
from .linear_steps import Change, Equations, Stages
from .many_states import in_full, left_out
from .motion_states import CORRECTIONS, LOOSE, TRIED, Once, Step
from .varied_motions import carried

# numbers that stages and virtual displacements of all steps, checkpoints, and the matrices of one window of steps are
# kept in, at most
KEPT, CHECKPOINTS, WINDOW = 1 << 24, 1 << 22, 1 << 22
# corrections of virtual displacements, beside the largest, that are none: goals may hardly depend on a number
NEGLIGIBLE = 1e-12
# parts that are left where checkpoints are dropped, at least
LEAST = 8
# changes before breaks of models with multipliers that are carried behind them, at most
COLUMNS = 4000
# of what a step begins with
PARTS = ("z", "v", "a", "own")


class Numbers(Protocol):
    """What is told of a motion on the way back, and adds up what numbers do to goals (k,)."""

    def note(self, at: Record, window: Array, lam: Array) -> None:
        """Take states, the times (2,) of signals there, and virtual displacements lam (m, n, k).

        Goals change by -lam . dR where the residuals of the states do by dR.
        """
        ...

    def pass_break(self, stepper: Stepper, piece: int, end: Change, at: Record | None, mu: Array) -> None:
        """Take a motion before a break, the piece behind it, and what changes behind it do to goals.

        Where rates do not jump, and numbers change accelerations there alone, by way of the residuals of a state, its
        virtual displacements mu (n, k) are given.
        """
        ...


@dataclass
class Part:
    """Some steps, from a checkpoint on, and the stored states of each; or a break, behind which piece ``behind`` is.

    ``at`` are the stages and ``lam`` (m, n, k) virtual displacements there, where they are kept; ``end`` is what
    changes behind a break do to goals.
    """

    kept: dict[str, Array]
    count: int = 0
    steps: list[Step] | None = field(default_factory=list)
    rows: list[tuple[int, int]] = field(default_factory=list)
    behind: int = -1
    at: Record | None = None
    lam: Array | None = None
    end: Change | None = None


class UnlikeError(UnsuitedError):
    """A fixed step is not as long as in a run, as it is with another tolerance of Newton's method."""


class Backwards(Once):
    """A motion whose steps are kept, so that it can go backwards. Raises UnsuitedError."""

    def __init__(self, model: Model, whole: bool, tolerance: float, lengths: list[float] | None) -> None:
        spec = model.case.solver
        assert isinstance(spec, Dynamic)
        super().__init__(model, spec, tolerance, lengths)
        self.whole, self.rows, self.parts, self.off = whole, list[Row](), list[Part](), 0.0
        # the times of signals in which each row was stored
        self.windows: list[Array] = []
        if self.stepper.moving or self.stepper.events or len(self.stepper.p.facing.item):
            raise UnsuitedError("points move along bodies, or things begin to act")

    def states(self) -> Iterator[State]:
        """Make the motion and yield its states. Raises ComputationError, and UnsuitedError where it cannot go back.

        ``rows`` are then its first and its last state, and those between if ``whole``; ``parts`` are its steps. Raises
        UnlikeError where a fixed step is not as long as a run makes it.
        """
        return self.run.states(advance=partial(self._some, self._record()))

    def _some(self, steps: Iterator[list[Row]]) -> list[Row]:
        """Make steps for a short while, one at least; return the states that were stored."""
        found, began = list[Row](), time.perf_counter()
        for rows in steps:
            found += rows
            # behind the last step it is noted that the motion ends
            if time.perf_counter() - began > CHUNK_SECONDS and not self.stepper.done:
                break
        return found

    def _record(self) -> Iterator[list[Row]]:
        """Make the motion, which has begun; yield the states stored in each step."""
        stepper = self.stepper
        self.begun, self.window, self.rows = self.now(), stepper.p.programs.window.copy(), [stepper.last()]
        self.windows = [self.window]
        part, room, columns = Part(self._checkpoint()), KEPT, 0
        for step in self.steps():
            if step is not None and self.unlike():
                raise UnlikeError
            if step is None:
                self._add(part)
                self.parts.append(Part(self._checkpoint(), behind=stepper.piece + 1))
                columns += 0 if self.free.all() else 2 * self.entries.n
                if columns > COLUMNS:
                    raise UnsuitedError("constraints begin anew too often")
                pass_break(stepper, stepper.piece + 1)
                part = Part(self._checkpoint())
                continue
            if self.whole:
                if not self.free.all() and any(row.kind == INSIDE for row in step.rows):
                    raise UnsuitedError("states within steps are put onto constraints")
                part.rows += [(part.count, len(self.rows) + k) for k in range(len(step.rows))]
                self.rows += step.rows
                self.windows += [stepper.p.programs.window.copy()] * len(step.rows)
            room -= 3 * step.stages.z.size
            if room > 0 and part.steps is not None:
                part.steps.append(step)
            else:
                part.steps = None
            part.count += 1
            if part.count >= self.size:
                self._add(part)
                part = Part(self._checkpoint())
            for row in [*step.rows, stepper.here()] if len(stepper.p.sliding.multiplier) else ():
                check_joints(stepper, row)
            yield step.rows
        self._add(part)
        self.rows.append(stepper.last())
        self.windows.append(stepper.p.programs.window.copy())

    @cached_property
    def size(self) -> int:
        """The steps of a window."""
        s, n = self.method.stages, self.entries.n
        return max(WINDOW // (s * max(n, 1) * (6 + 3 * s * max(self.stepper.p.width, 1))), 8)

    def keeps(self, goals: int) -> bool:
        """Whether there is room for the virtual displacements of so many goals at all stages."""
        if any(part.count and part.steps is None for part in self.parts):
            return False
        size = sum(part.count for part in self.parts) * self.method.stages * self.entries.n
        # in full coordinates, too, as what numbers do is found (``many_states``)
        return (5 + 2 * goals) * size <= KEPT

    def _checkpoint(self) -> dict[str, Array]:
        """Return where the motion is, without what it tells of its steps."""
        self.stepper.pending = self.stepper.pending[:0]
        found = self.stepper.checkpoint()
        assert found is not None
        return found

    def _add(self, part: Part) -> None:
        """Add a part; where checkpoints fill their room, every second one is dropped."""
        if not part.count:
            return
        self.parts.append(part)
        each = sum(x.size for x in part.kept.values())
        if each * len(self.parts) > CHECKPOINTS and len(self.parts) > LEAST:
            self.parts = list(_joined(self.parts))

    def back(self, bars: Sequence[Change], numbers: Numbers) -> Change:
        """Return what changes of the start do to goals; each of ``bars`` (n, k) is what those of a stored state do."""
        end = bars[-1]
        for part in reversed(self.parts):
            end = self._before(part, end, bars, numbers)
        return end.plus(bars[0]) if self.whole else end

    def tell(self, numbers: Numbers) -> None:
        """Tell numbers once more what was told on the way back: all virtual displacements have been kept."""
        for part in reversed(self.parts):
            self.stepper.resume(part.kept)
            if part.end is not None:
                self._break(part, part.end, numbers)
            elif part.at is not None and part.lam is not None:
                numbers.note(part.at, self.stepper.p.programs.window.copy(), part.lam)

    def _before(self, part: Part, end: Change, bars: Sequence[Change], numbers: Numbers) -> Change:
        """Return what changes before a part do to goals, from what those behind it do."""
        self.stepper.resume(part.kept)
        if part.behind >= 0:
            part.end = end
            return self._passed(part, end, self._break(part, end, numbers))
        if part.count <= self.size:
            return self._through(part, end, bars, numbers)
        # a long part: checkpoints within it first
        room = max(CHECKPOINTS // sum(x.size for x in part.kept.values()), LEAST)
        size, inside = max(self.size, -(-part.count // room)), list[Part]()
        for begin in range(0, part.count, size):
            count = min(size, part.count - begin)
            mine = [(k - begin, row) for k, row in part.rows if begin <= k < begin + count]
            inside.append(Part(self._checkpoint(), count, None, mine))
            for _ in self._again(count):
                pass
        for one in reversed(inside):
            end = self._before(one, end, bars, numbers)
        return end

    def _again(self, count: int) -> Iterator[Step]:
        """Make steps again."""
        return islice((step for step in self.steps() if step is not None), count)

    def _through(self, part: Part, end: Change, bars: Sequence[Change], numbers: Numbers) -> Change:
        """Return what changes of the start of some steps do to goals, from what those of their end do."""
        window = self.stepper.p.programs.window.copy()
        steps = list(self._again(part.count)) if part.steps is None else part.steps
        at = self.moments(steps)
        equations = self.equations(steps, at)
        n, k, m = self.entries.n, end.z.shape[1], len(at.t)
        stages = Stages(np.zeros(0), *(np.zeros((m, n, k)) for _ in range(3)))
        starts = np.zeros((len(steps), 4, n, k))
        for number, row in part.rows:
            self._stored(steps[number], self.rows[row], number, bars[row], stages, starts)
        lam, start = equations.back(stages, starts, end)
        self._correct(equations, at, lam, start)
        self.run.seen.clear()
        if self.keeps(k):
            part.at, part.lam, part.steps = at, lam, []
        numbers.note(at, window, lam)
        return start

    def _stored(self, step: Step, row: Row, number: int, bar: Change, stages: Stages, starts: Array) -> None:
        """Add what a state that is stored in a step does to the goals to stages and starts."""
        s = self.method.stages
        mine = slice(s * number, s * number + s)
        if row.kind != INSIDE:
            for name in ("z", "v", "a"):
                getattr(stages, name)[s * number + s - 1] += getattr(bar, name)
            return
        assert self.stepper.m is not None
        basis, x = self.stepper.m.record.basis.T, (row.t - step.t) / step.h
        f = [polynomial.polyval(x, polynomial.polyder(basis, order)) for order in range(3)]
        free = self.free[:, None]
        made = sum(np.multiply.outer(one, by) for one, by in zip(f, (
            bar.z, free * bar.v / step.h, free * bar.a / step.h**2), strict=True))
        start, found = self.method.dense_back(np.asarray(made), step.h, self.free)
        starts[number] += [start.z + bar.z, start.v, start.a, start.own]
        for name in ("z", "v", "a"):
            getattr(stages, name)[mine] += getattr(found, name)

    def _left_out(self, at: Record, lam: Array) -> tuple[Array, Array]:
        """Return what changes of positions and rates do to the work on lam (m, n, k) beyond what tangents tell."""
        p, w, many = self.stepper.p, self.stepper.w, not self.run.model.loads.natural
        by_z, by_v = np.zeros((2, *lam.shape))
        if not self.damped:
            return by_z, by_v
        # signals do not act on elements, which are evaluated at many states at once; else rates of natural strains add
        # the same for any lam to viscous forces, and half of a difference is without it
        alone = Record(p.values._replace(groups=p.groups[:0].copy(), tau=np.zeros(0))) if many else p
        signs = (1.0, -1.0) if not many else (1.0,) if len(p.points.forces) else ()
        none, room = np.zeros_like(w.amps), np.zeros((3, len(p.place)))
        one, two = np.zeros((2, *lam.shape[:2]))
        for q in range(lam.shape[2]):
            for sign in signs:
                along.left_out(alone, w, at, sign * lam[:, :, q], none, room, one, two)
                by_z[:, :, q] += sign / len(signs) * one
                by_v[:, :, q] += sign / len(signs) * two
            if many:
                one, two = self._left_out_of_elements(at, lam[:, :, q])
                by_z[:, :, q] += one
                by_v[:, :, q] += two
        return by_z, by_v

    def _left_out_of_elements(self, at: Record, lam: Array) -> tuple[Array, Array]:
        """Return what ``_left_out`` does, of elements and one goal: lam (m, n)."""
        p, T = self.stepper.p, unknowns_to_coordinates(self.run.model)
        full = in_full(self.run, at, p.programs.window)
        by_z, by_v = np.zeros((2, *lam.shape))
        # as large as the rates
        sizes, rates = ((p.weights * np.abs(x)).max(axis=1, initial=0.0) for x in (lam, at.v))
        some = sizes > along.NONE
        scale = np.where(some, np.maximum(rates, 1e-3 * p.extent) / np.where(some, sizes, 1.0), 1.0)
        virtual = (T @ (scale[:, None] * lam).T).T
        for group, tau in zip(self.run.model.groups, p.tau.tolist(), strict=True):
            if tau > 0.0:
                parts = left_out(group, tau, full.d, full.v, virtual)
                own = T[group.dofs.ravel()].T
                for out, found in zip((by_z, by_v), parts, strict=True):
                    out += (own @ found.reshape(len(found), -1).T).T / scale[:, None]
        return by_z, p.coordinate * by_v

    def _correct(self, equations: Equations, at: Record, lam: Array, start: Change) -> None:
        """Correct lam and what the start does by what tangents leave out: they are Newton's, not all exact."""
        weights, more, before, left = self.stepper.p.weights[None, :, None], lam, 1.0, 0.0
        size = float((weights * np.abs(lam)).max(initial=0.0))
        for _ in range(CORRECTIONS):
            by_z, by_v = self._left_out(at, more)
            if not (by_z.any() or by_v.any()):
                return
            n, k = lam.shape[1:]
            stages = Stages(np.zeros(0), -by_z, -by_v, np.zeros(lam.shape))
            more, change = equations.back(stages, np.zeros((len(equations.rates), 4, n, k)), Change.none(n, k))
            lam += more
            for name in ("z", "v", "a", "own"):
                getattr(start, name)[:] += getattr(change, name)
            share = float((weights * np.abs(more)).max(initial=0.0)) / (size or 1.0)
            # what the next correction would be: tangents are as good as they were
            left, worse, before = share * share / before, share >= before, share
            if left <= NEGLIGIBLE or worse:
                break
        self.off = max(self.off, left)
        if left > LOOSE:
            raise UnsuitedError("the tangents of the steps do not determine their derivatives")

    def _break(self, part: Part, end: Change, numbers: Numbers) -> tuple[Record, Array]:
        """Tell numbers of a break; return the state behind it, and virtual displacements (n, k) there."""
        stepper = self.stepper
        if not self.free.all():
            numbers.pass_break(stepper, part.behind, end, None, end.a)
            return self.now(), end.a
        before = stepper.s.v.copy()
        pass_break(stepper, part.behind)
        # accelerations behind it follow from positions and rates
        at, mu = self.now(), self.by_mass.solve(end.a + end.own)
        if (stepper.s.v == before).all():
            numbers.pass_break(stepper, part.behind, end, at, mu)
        else:
            stepper.resume(part.kept)
            numbers.pass_break(stepper, part.behind, end, None, mu)
        return at, mu

    def _passed(self, part: Part, end: Change, behind: tuple[Record, Array]) -> Change:
        """Return what changes before a break do to goals."""
        if self.free.all():
            self.stepper.enter(part.behind)
            return self.consistent(*behind, end)
        return self._carried_back(part, end)

    def consistent(self, at: Record, mu: Array, end: Change) -> Change:
        """Return what changes of positions and rates do to goals in a state whose accelerations follow from them."""
        p, w = self.stepper.p, self.stepper.w
        by_z, by_v = self._left_out(at, mu[None])
        A, B = np.zeros((2, 1, len(p.mass)))
        along.tangents(p, w, at, 0.0, A)
        along.tangents(p, w, at, 1.0, B)
        K, C = self.entries.matrix(self.entries.read(A)[0]), self.entries.matrix(self.entries.read(B - A)[0])
        M, none = self.entries.matrix(self.mass), np.zeros_like(mu)
        return Change(end.z - K @ mu - by_z[0], end.v - C @ mu - p.alpha * (M @ mu) - by_v[0], none, none.copy())

    def _carried_back(self, part: Part, end: Change) -> Change:
        """Return what changes before a break do to goals, by all of them, one by one."""
        other, n, out = Run(self.run.model, self.run.spec).stepper, self.entries.n, Change.none(*end.z.shape)
        for name in ("z", "v"):
            for i in np.flatnonzero(self.free).tolist():
                change = Change.none(n, 1)
                getattr(change, name)[i] = 1.0
                found = carried(other, self.stepper, change, part.behind, TRIED * self.stepper.p.extent)
                getattr(out, name)[i] = sum(getattr(found, of)[:, 0] @ getattr(end, of) for of in PARTS)
        return out


def _joined(parts: Sequence[Part]) -> Iterator[Part]:
    """Yield parts, of each two that follow each other one."""
    last: Part | None = None
    for part in parts:
        if last is None or part.behind >= 0:
            if last is not None:
                yield last
            last = None if part.behind >= 0 else part
            if part.behind >= 0:
                yield part
            continue
        rows = last.rows + [(last.count + k, row) for k, row in part.rows]
        yield Part(last.kept, last.count + part.count, None, rows)
        last = None
    if last is not None:
        yield last
