"""The discrete adjoint of a motion: its steps are stored, then followed backwards for a few goals.

The linearised equations of a step (``solvers.derivatives.motion_states``), transposed, turn the derivatives of the
goals by the end of the step into those by its residuals and its start. Stages are stored while there is room. Later
ones are computed again from checkpoints, window by window (Griewank & Walther, Evaluating Derivatives, SIAM 2008,
chapter 12), so memory does not grow with the number of steps.
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
from ...kernels.motion import many_states
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
from .motion_states import CORRECTIONS, LOOSE, TRIED, RepeatedMotion, Step
from .varied_motions import carried

# largest numbers of floats in stages and virtual displacements of all steps, in checkpoints, and in the matrices of one
# window of steps
KEPT, CHECKPOINTS, WINDOW = 1 << 24, 1 << 22, 1 << 22
# relative correction of virtual displacements that is negligible, as goals may hardly depend on a number
NEGLIGIBLE = 1e-12
# at least so many parts are left when checkpoints are dropped
LEAST = 8
# largest number of changes carried across breaks in models with multipliers
COLUMNS = 4000
# fields of the change of a step's start
PARTS = ("z", "v", "a", "own")


class AdjointReceiver(Protocol):
    """Numbers of a case that receive the adjoint states of a motion and sum up their derivatives of the goals (k,)."""

    def add_states(self, at: Record, window: Array, lam: Array) -> None:
        """Receive states, the window (2,) of times of their signals, and virtual displacements lam (m, n, k).

        Goals change by -lam . dR if the residuals at these states change by dR.
        """
        ...

    def add_break(self, stepper: Stepper, piece: int, end: Change, at: Record | None, mu: Array) -> None:
        """Receive a motion before a break, the next piece, and the derivatives ``end`` of goals by the state after it.

        If rates do not jump, and numbers change only accelerations there, through the residuals of the state ``at``,
        its virtual displacements mu (n, k) are given.
        """
        ...


@dataclass
class Part:
    """Some steps from a checkpoint, and the stored states in each; or a break, followed by the piece ``behind``.

    ``at`` are the stages and ``lam`` (m, n, k) the virtual displacements there, if they are stored; ``end`` are the
    derivatives of the goals by the state after a break.
    """

    checkpoint: dict[str, Array]
    count: int = 0
    steps: list[Step] | None = field(default_factory=list)
    rows: list[tuple[int, int]] = field(default_factory=list)
    behind: int = -1
    at: Record | None = None
    lam: Array | None = None
    end: Change | None = None


class StepLengthError(UnsuitedError):
    """A fixed step has another length than in the run, because of another tolerance of Newton's method."""


class RecordedMotion(RepeatedMotion):
    """A motion whose steps are stored, so that it can be followed backwards. Raises UnsuitedError."""

    def __init__(self, model: Model, all_states: bool, tolerance: float, lengths: list[float] | None) -> None:
        spec = model.case.solver
        assert isinstance(spec, Dynamic)
        super().__init__(model, spec, tolerance, lengths)
        self.all_states, self.rows, self.parts, self.equation_error = all_states, list[Row](), list[Part](), 0.0
        # the window of signals for each row
        self.windows: list[Array] = []
        if self.stepper.moving or self.stepper.events or len(self.stepper.p.facing.item):
            raise UnsuitedError("points move along bodies, or items begin to act")

    def states(self) -> Iterator[State]:
        """Make the motion and yield its states. Raises ComputationError, and UnsuitedError if it has no adjoint.

        ``rows`` are then its first and its last state, and those between if ``all_states``; ``parts`` are its steps.
        Raises StepLengthError if a fixed step has another length than in the run.
        """
        return self.run.states(advance=partial(self._some, self._record()))

    def _some(self, steps: Iterator[list[Row]]) -> list[Row]:
        """Make steps for a short while, at least one; return the states that were stored."""
        found, began = list[Row](), time.perf_counter()
        for rows in steps:
            found += rows
            # continue after the last step, so that the end of the motion is recorded
            if time.perf_counter() - began > CHUNK_SECONDS and not self.stepper.done:
                break
        return found

    def _record(self) -> Iterator[list[Row]]:
        """Make the started motion; yield the states stored in each step."""
        stepper = self.stepper
        self.begun, self.window, self.rows = self.now(), stepper.p.programs.window.copy(), [stepper.last()]
        self.windows = [self.window]
        part, room, columns = Part(self._checkpoint()), KEPT, 0
        for step in self.steps():
            if step is not None and self.differs_from_run():
                raise StepLengthError
            if step is None:
                self._add(part)
                self.parts.append(Part(self._checkpoint(), behind=stepper.piece + 1))
                columns += 0 if self.free.all() else 2 * self.entries.n
                if columns > COLUMNS:
                    raise UnsuitedError("constraints change too often")
                pass_break(stepper, stepper.piece + 1)
                part = Part(self._checkpoint())
                continue
            if self.all_states:
                if not self.free.all() and any(row.kind == INSIDE for row in step.rows):
                    raise UnsuitedError("states within steps are projected onto constraints")
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
            for row in [*step.rows, stepper.current_row()] if len(stepper.p.sliding.multiplier) else ():
                check_joints(stepper, row)
            yield step.rows
        self._add(part)
        self.rows.append(stepper.last())
        self.windows.append(stepper.p.programs.window.copy())

    @cached_property
    def size(self) -> int:
        """Return the number of steps of a window."""
        s, n = self.method.stages, self.entries.n
        return max(WINDOW // (s * max(n, 1) * (6 + 3 * s * max(self.stepper.p.width, 1))), 8)

    def has_room(self, goals: int) -> bool:
        """Return whether there is room for the virtual displacements of so many goals at all stages."""
        if any(part.count and part.steps is None for part in self.parts):
            return False
        size = sum(part.count for part in self.parts) * self.method.stages * self.entries.n
        # also in full coordinates, for the derivatives by numbers (``many_states``)
        return (5 + 2 * goals) * size <= KEPT

    def _checkpoint(self) -> dict[str, Array]:
        """Return a checkpoint of the current state, without the log of steps."""
        self.stepper.pending = self.stepper.pending[:0]
        found = self.stepper.checkpoint()
        assert found is not None
        return found

    def _add(self, part: Part) -> None:
        """Add a part; if checkpoints fill their room, drop every second one."""
        if not part.count:
            return
        self.parts.append(part)
        each = sum(x.size for x in part.checkpoint.values())
        if each * len(self.parts) > CHECKPOINTS and len(self.parts) > LEAST:
            self.parts = list(_joined(self.parts))

    def derivatives_by_start(self, bars: Sequence[Change], receiver: AdjointReceiver) -> Change:
        """Return the derivatives of goals by the start; ``bars`` (n, k) are those by each stored state."""
        end = bars[-1]
        for part in reversed(self.parts):
            end = self._before(part, end, bars, receiver)
        return end.plus(bars[0]) if self.all_states else end

    def report_stored(self, receiver: AdjointReceiver) -> None:
        """Report the stored virtual displacements once more, without following the motion backwards."""
        for part in reversed(self.parts):
            self.stepper.resume(part.checkpoint)
            if part.end is not None:
                self._break(part, part.end, receiver)
            elif part.at is not None and part.lam is not None:
                receiver.add_states(part.at, self.stepper.p.programs.window.copy(), part.lam)

    def _before(self, part: Part, end: Change, bars: Sequence[Change], receiver: AdjointReceiver) -> Change:
        """Return the derivatives of goals by the start of a part, from those by its end."""
        self.stepper.resume(part.checkpoint)
        if part.behind >= 0:
            part.end = end
            return self._passed(part, end, self._break(part, end, receiver))
        if part.count <= self.size:
            return self._through(part, end, bars, receiver)
        # a long part first gets checkpoints of its own
        room = max(CHECKPOINTS // sum(x.size for x in part.checkpoint.values()), LEAST)
        size, inside = max(self.size, -(-part.count // room)), list[Part]()
        for begin in range(0, part.count, size):
            count = min(size, part.count - begin)
            mine = [(k - begin, row) for k, row in part.rows if begin <= k < begin + count]
            inside.append(Part(self._checkpoint(), count, None, mine))
            for _ in self._again(count):
                pass
        for one in reversed(inside):
            end = self._before(one, end, bars, receiver)
        return end

    def _again(self, count: int) -> Iterator[Step]:
        """Repeat steps from the current state."""
        return islice((step for step in self.steps() if step is not None), count)

    def _through(self, part: Part, end: Change, bars: Sequence[Change], receiver: AdjointReceiver) -> Change:
        """Return the derivatives of goals by the start of some steps, from those by their end."""
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
        if self.has_room(k):
            part.at, part.lam, part.steps = at, lam, []
        receiver.add_states(at, window, lam)
        return start

    def _stored(self, step: Step, row: Row, number: int, bar: Change, stages: Stages, starts: Array) -> None:
        """Add the direct derivatives of goals by a state stored in a step to those by stages and starts."""
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
        """Return the derivatives of the work on lam (m, n, k) by positions and rates that tangents leave out."""
        p, w, many = self.stepper.p, self.stepper.w, not self.run.model.loads.natural
        by_z, by_v = np.zeros((2, *lam.shape))
        if not self.damped:
            return by_z, by_v
        # without natural strains, signals do not act on elements, which can be evaluated at many states at once; with
        # them, rates of natural strains add a term to viscous forces that does not depend on lam: half a difference is
        # free of it
        alone = Record(p.values._replace(groups=p.groups[:0].copy(), tau=np.zeros(0))) if many else p
        signs = (1.0, -1.0) if not many else (1.0,) if len(p.points.forces) else ()
        none, room = np.zeros_like(w.amps), np.zeros((3, len(p.place)))
        one, two = np.zeros((2, *lam.shape[:2]))
        for q in range(lam.shape[2]):
            for sign in signs:
                many_states.derivatives_left_out(alone, w, at, sign * lam[:, :, q], none, room, one, two)
                by_z[:, :, q] += sign / len(signs) * one
                by_v[:, :, q] += sign / len(signs) * two
            if many:
                one, two = self._left_out_of_elements(at, lam[:, :, q])
                by_z[:, :, q] += one
                by_v[:, :, q] += two
        return by_z, by_v

    def _left_out_of_elements(self, at: Record, lam: Array) -> tuple[Array, Array]:
        """Return the part of ``_left_out`` from elements for one goal, lam (m, n)."""
        p, T = self.stepper.p, unknowns_to_coordinates(self.run.model)
        full = in_full(self.run, at, p.programs.window)
        by_z, by_v = np.zeros((2, *lam.shape))
        # scale lam to the size of the rates
        sizes, rates = ((p.weights * np.abs(x)).max(axis=1, initial=0.0) for x in (lam, at.v))
        some = sizes > many_states.NEGLIGIBLE
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
        """Correct lam and the derivatives by the start for the terms that Newton's tangents leave out."""
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
            # estimate the next correction, which converges like this one
            left, worse, before = share * share / before, share >= before, share
            if left <= NEGLIGIBLE or worse:
                break
        self.equation_error = max(self.equation_error, left)
        if left > LOOSE:
            raise UnsuitedError("the tangents of the steps do not determine their derivatives")

    def _break(self, part: Part, end: Change, receiver: AdjointReceiver) -> tuple[Record, Array]:
        """Report a break to numbers; return the state after it, and its virtual displacements (n, k)."""
        stepper = self.stepper
        if not self.free.all():
            receiver.add_break(stepper, part.behind, end, None, end.a)
            return self.now(), end.a
        before = stepper.s.v.copy()
        pass_break(stepper, part.behind)
        # accelerations after the break follow from positions and rates
        at, mu = self.now(), self.by_mass.solve(end.a + end.own)
        if (stepper.s.v == before).all():
            receiver.add_break(stepper, part.behind, end, at, mu)
        else:
            stepper.resume(part.checkpoint)
            receiver.add_break(stepper, part.behind, end, None, mu)
        return at, mu

    def _passed(self, part: Part, end: Change, behind: tuple[Record, Array]) -> Change:
        """Return the derivatives of goals by the state before a break."""
        if self.free.all():
            self.stepper.enter(part.behind)
            return self.consistent(*behind, end)
        return self._carried_back(part, end)

    def consistent(self, at: Record, mu: Array, end: Change) -> Change:
        """Return the derivatives of goals by positions and rates in a state whose accelerations follow from them."""
        p, w = self.stepper.p, self.stepper.w
        by_z, by_v = self._left_out(at, mu[None])
        A, B = np.zeros((2, 1, len(p.mass)))
        many_states.tangents(p, w, at, 0.0, A)
        many_states.tangents(p, w, at, 1.0, B)
        K, C = self.entries.matrix(self.entries.read(A)[0]), self.entries.matrix(self.entries.read(B - A)[0])
        M, none = self.entries.matrix(self.mass), np.zeros_like(mu)
        return Change(end.z - K @ mu - by_z[0], end.v - C @ mu - p.alpha * (M @ mu) - by_v[0], none, none.copy())

    def _carried_back(self, part: Part, end: Change) -> Change:
        """Return the derivatives of goals by the state before a break, by carrying each unit change across it."""
        other, n, out = Run(self.run.model, self.run.spec).stepper, self.entries.n, Change.none(*end.z.shape)
        for name in ("z", "v"):
            for i in np.flatnonzero(self.free).tolist():
                change = Change.none(n, 1)
                getattr(change, name)[i] = 1.0
                found = carried(other, self.stepper, change, part.behind, TRIED * self.stepper.p.extent)
                getattr(out, name)[i] = sum(getattr(found, of)[:, 0] @ getattr(end, of) for of in PARTS)
        return out


def _joined(parts: Sequence[Part]) -> Iterator[Part]:
    """Yield parts, with each two successive ones joined."""
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
        yield Part(last.checkpoint, last.count + part.count, None, rows)
        last = None
    if last is not None:
        yield last
