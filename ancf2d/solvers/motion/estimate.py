"""The error of time steps, extrapolated from the differences to motions with longer steps."""

from __future__ import annotations

import math
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError, percent
from ...kernels.motion.advance import CHECK
from ...kernels.motion.state import COUNT, SWITCHED
from ...kernels.motion.switching import FIXED_STEP_GAP
from ...model.mesh import Index
from ...model.model import Model
from ...model.rotation import CoordinateKinds
from ...pace import Pace
from ...processors import threads
from ..least_motion import least_motion, least_size, sticks
from ..state import Row
from .stepping import Stepper
from .warnings import missed_tolerance

LEVELS = 2
# factor between levels: of fixed steps, or of the tolerance of adaptive steps
DOUBLE, TENFOLD = 2.0, 10.0
# safety factor on the extrapolated error (Roache's grid convergence index for three levels)
SAFETY = 1.25
# differences that shrink by less than this between levels, as with unresolved vibrations, show no order: assume 1
FALLS = 3.0
# share of the method's order that differences of fixed steps must show: they fall by smaller orders also if none of the
# levels resolves vibrations, and then errors hardly fall
CONFIRMED = 0.8
# bound on the error, as a multiple of the difference, if steps are hardly longer, as where Newton's method limits them;
# smaller for fixed steps, because each level cuts these at other places, so that errors of levels differ more
LARGEST = {DOUBLE: 2.0, TENFOLD: 4.0}
# two levels have the same steps if those of the finer one are longer than this share of the coarser one's; differences
# between such levels mean nothing if they are below this share of the displacements
ALIKE, TELLING = 0.8, 1e-9
# steps of the second level after which it is abandoned if they are no longer than those of the first
SEEN = 40
# a level of fixed steps is abandoned with more steps than this, and than this multiple of the next finer level's
MANY, DIVIDED = 500, 4.0
# with fewer steps than this between two breaks, steps of twice the length are cut to the same length
BROKEN = 4


class Estimate:
    """Differences between a motion and coarser ones at stored times, over all probes (all nodes if there are none).

    The levels have 2 and 4 times the fixed step, or 10 and 100 times the tolerance of adaptive steps; errors are
    extrapolated with the mean length of the steps that were made. ``largest`` (levels, probes): the largest differences
    between neighbouring levels; ``moved`` (probes,): the largest displacements; ``made`` (levels, 2): time and number
    of steps at the last comparison; ``levels``: how many levels are still computed. The result depends neither on how
    far each call of ``Stepper.run`` gets nor on whether coarser motions run in threads (``ahead``: runs not collected
    yet).
    """

    def __init__(self, stepper: Stepper) -> None:
        self.stepper = stepper
        fixed = stepper.dt > 0.0
        self.factor, self.order = (DOUBLE, stepper.method.order) if fixed else (TENFOLD, 1)
        model = stepper.model
        probes = [model.point(p.at) for p in model.case.output.probes.values()]
        columns = [x for p in probes for x in p.position()] or _nodes(model)
        self.coords, self.weights = (np.concatenate([column[k] for column in columns]) for k in range(2))
        self.starts = np.cumsum([0, *(len(coords) for coords, _ in columns[:-1])])
        self.largest = np.zeros((LEVELS, len(columns) // 2))
        self.moved = np.zeros(len(columns) // 2)
        self.failed = ""
        self.levels, self.made, self.own = LEVELS, np.zeros((LEVELS, 2)), 0.0
        # states of coarser motions since the last one compared (m, 2 + 2 probes): time, number of steps, displacements
        # of probes; their step counts
        self.queues = [np.zeros((0, 2 + len(columns))) for _ in range(LEVELS)]
        self.counts = [0] * LEVELS
        self.coarse = [self._level(self.factor ** (k + 1)) for k in range(LEVELS)]
        self.paces = [Pace() for _ in self.coarse]
        self.pool: ThreadPoolExecutor | None = None
        self.ahead: dict[int, tuple[Future[list[Row]], float]] = {}

    def _level(self, factor: float) -> Stepper:
        """Return the stepper of a coarser motion, with steps or tolerance ``factor`` times as large."""
        fine = self.stepper
        spec = fine.spec if fine.dt > 0.0 else replace(fine.spec, tolerance=factor * fine.tolerance)
        out = Stepper(fine.model, fine.problem, fine.signals, spec, factor * fine.dt, fine.wanted,
                      follows=fine.layout is not None)
        # storing states must not shorten the steps
        out.ends_at_states = False
        # the displacements of states are enough
        out.reads_forces = False
        # joints are checked in all states
        out.keeps_checks = bool(fine.facing) or len(fine.p.sliding.multiplier) > 0
        return out

    def start(self, d: Array, v: Array, turned: Array) -> None:
        """Start the coarser motions from the initial state of the motion."""
        for stepper in self.coarse:
            stepper.start(d, v, turned)
            if stepper.dt == 0.0:
                stepper.set_size(self.stepper.size)

    def _go_ahead(self) -> None:
        """Start one run of each coarser motion in a thread, unless the motion is finished or threads are of no use."""
        if self.pool is None:
            if self.stepper.done or not _apart(self.stepper) or threads() == 1:
                return
            self.pool = ThreadPoolExecutor(LEVELS)
        for level, stepper in enumerate(self.coarse[:self.levels]):
            if level not in self.ahead and not stepper.done and stepper.failed is None:
                self.ahead[level] = self.pool.submit(stepper.run, self._most(level)), stepper.t

    def take(self, times: Array, d: Array, steps: Array) -> None:
        """Compare with states of the motion, displacements d (m, n_full) at ``times`` (m,).

        ``steps`` (m,) : those of the motion up to then, or 0 if none was made since the state before. The start is
        skipped, and times that coarser motions do not store.
        """
        own = np.maximum.accumulate(np.maximum(steps, self.own))[times > 0.0]
        d, times = d[times > 0.0], times[times > 0.0]
        here = self._places(d)
        while len(times) and not self.failed:
            for level in range(self.levels):
                self._reach(level, float(times[0]))
            if self.failed:
                return
            # as far as all motions are
            ends = [math.inf if one.done else queue[-1, 0] + self._near(level) for level, (one, queue) in enumerate(
                zip(self.coarse[:self.levels], self.queues, strict=False))]
            count = int(np.searchsorted(times, min(ends), side="right"))
            self._compare(times[:count], here[:count], own[:count])
            times, here, own = times[count:], here[count:], own[count:]

    def _compare(self, times: Array, here: Array, own: Array) -> None:
        """Compare with places (m, 2 probes) at times that all motions have passed, with ``own`` (m,) steps until then.

        A level is abandoned at the first state where it is of no use.
        """
        stored, finer, made = np.ones(len(times), dtype=bool), here, np.zeros((self.levels, len(times), 2))
        gaps = np.zeros((self.levels, len(times), len(self.moved)))
        for level in range(self.levels):
            queue, near = self.queues[level], self._near(level)
            index = np.minimum(np.searchsorted(queue[:, 0], times - near), len(queue) - 1)
            stored &= np.abs(queue[index, 0] - times) <= near
            made[level], there = queue[index, :2], queue[index, 2:]
            gaps[level], finer = _sizes(there - finer), there
            self.queues[level] = queue[index[-1]:]
        gaps[:, ~stored] = 0.0
        moved = np.maximum.accumulate(np.vstack([self.moved, _sizes(here)]))[1:]
        largest = np.maximum.accumulate(np.concatenate([self.largest[:self.levels, None], gaps], axis=1), axis=1)[:, 1:]
        last = [len(times) - 1] * self.levels
        vain = stored & self._is_vain(made, own, moved, largest)
        if vain.any():
            k = int(np.argmax(vain.any(axis=0)))
            self.levels = int(np.argmax(vain[:, k]))
            last[self.levels:] = [k] * (len(last) - self.levels)
            self._check_left()
        self.own = float(own[-1])
        self.moved = moved[-1]
        for level, k in enumerate(last):
            self.largest[level] = largest[level, k]
            if stored[:k + 1].any():
                self.made[level] = made[level, np.flatnonzero(stored[:k + 1])[-1]]

    def _is_vain(self, made: Array, own: Array, moved: Array, largest: Array) -> Array:
        """Return whether levels are of no use (levels, m) after the times and steps ``made`` (levels, m, 2).

        Fixed steps: they are divided so often that there are many more of them than of finer ones. Adaptive steps: SEEN
        of the second level are no longer, and its differences no larger, than those of the first.
        """
        steps, found = made[..., 1], np.zeros(made.shape[:2], dtype=bool)
        if self.factor == DOUBLE:
            return np.asarray(steps > np.maximum(MANY, DIVIDED * np.vstack([own, steps[:-1]])))
        if self.levels == LEVELS:
            longer, longest = made[..., 0] / np.maximum(steps, 1.0)
            fine, rough = self._differences(moved, largest)
            found[-1] = (steps[-1] >= SEEN) & (longer > ALIKE * longest) & (rough < FALLS * fine)
        return found

    def _near(self, level: int) -> float:
        """Return the difference of times [s] that are the same."""
        return 1e-9 * self.coarse[level].dt or 1e-12 * self.stepper.spec.t_end

    def _check_left(self) -> None:
        """Fail if no level is left."""
        if self.levels == 0:
            self.failed = (f"steps of {self.coarse[0].dt:g} s had to be divided into many more steps than those of "
                           f"{self.stepper.dt:g} s")

    def _lengths(self) -> list[float]:
        """Return the mean step length of each level."""
        return [float(t / max(steps, 1.0)) for t, steps in self.made]

    def _places(self, d: Array) -> Array:
        """Return the displacements (m, 2 probes) of the probes, x and y in turn."""
        found: Array = np.add.reduceat(self.weights * d[:, self.coords], self.starts, axis=1)
        return found

    def _reach(self, level: int, t: float) -> None:
        """Let a coarser motion go on until it has passed t, has ended, or has failed."""
        stepper, near = self.coarse[level], self._near(level)
        while not self.failed and not (len(self.queues[level]) and self.queues[level][-1, 0] >= t - near):
            if level not in self.ahead and stepper.done and len(self.queues[level]) and (
                    self.queues[level][-1, 0] >= stepper.t):
                # a coarser motion may end before this one
                return
            self._go_on(level)
            self._go_ahead()

    def _most(self, level: int) -> float:
        """Return the largest number of steps of the next run: the second level may be abandoned after a few steps."""
        undecided = self.factor != DOUBLE and level == LEVELS - 1 and self.made[level, 1] < 2 * SEEN
        return SEEN / 4 if undecided else math.inf

    def _go_on(self, level: int) -> None:
        """Append the states of the next run of a coarser motion, or store why it failed."""
        stepper = self.coarse[level]
        run, since = self.ahead.pop(level, (None, stepper.t))
        try:
            with self.paces[level].running():
                rows = run.result() if run else [stepper.last()] if stepper.done else stepper.run(self._most(level))
        except ComputationError as error:
            how = f"steps of {stepper.dt:g} s" if stepper.dt > 0.0 else f"a tolerance of {stepper.tolerance:g}"
            self.failed = f"with {how} the motion could not be computed ({error.failure.reason})"
            return
        self.paces[level].mark(stepper.t, within=step_ends(stepper, since, rows))
        counts = self.counts[level] + np.cumsum([len(row.log) for row in rows], dtype=int)
        self.counts[level] = int(counts[-1]) if rows else self.counts[level]
        kept = [(row, count) for row, count in zip(rows, counts, strict=True) if row.kind != CHECK]
        if kept:
            made = np.array([(row.t, count) for row, count in kept])
            places = self._places(np.array([stepper.full(row, 1)[0] for row, _ in kept]))
            self.queues[level] = np.concatenate([self.queues[level], np.hstack([made, places])])

    def report(self) -> dict[str, Any]:
        """Return the relative error estimate, the observed order (fixed steps only), and how they were found."""
        estimate, order = self._richardson()
        return {"estimate": estimate, "order": order if self.factor == DOUBLE else None, "of": "time steps",
                "steps": int(self.made[:, 1].sum())}

    def _differences(self, moved: Array, largest: Array) -> Array:
        """Return the largest difference (levels, ...) of each level, relative to the displacements.

        ``moved`` (..., probes) and ``largest`` (levels, ..., probes) are as in the class.
        """
        size = np.where(moved > least_motion(self.stepper.model), moved, np.inf)
        if self.factor != DOUBLE and sticks(self.stepper.model):
            # vibrations of the springs that hold sticking points weigh no more here than in the step size control
            size = np.maximum(size, least_size(self.stepper.model, self.stepper.tolerance))
        found: Array = np.max(largest / size, axis=-1, initial=0.0)
        return found

    def _richardson(self) -> tuple[float | None, float | None]:
        """Return the error extrapolated from three levels, and the observed power of the factor between them."""
        if self.failed or self._alike() or not self.made.any():
            return None, None
        fine, rough = map(float, self._differences(self.moved, self.largest))
        # part of the error in locating contacts that open and close is the same at all levels
        located = float(self.stepper.s.numbers[SWITCHED]) if self.factor == DOUBLE else 0.0
        if fine == 0.0:
            return FIXED_STEP_GAP * located, None
        power: float | None = float(np.log(rough / fine) / np.log(self.factor)) if rough > 0.0 else 0.0
        if self.factor == DOUBLE and self.levels < LEVELS:
            power = None
        own = self.stepper.t / self.stepper.s.numbers[COUNT]
        first, second = (float(length / own) for length in self._lengths())
        largest = LARGEST[self.factor]
        if first - 1.0 < 1.0 / largest:
            return SAFETY * largest * max(fine, rough) + FIXED_STEP_GAP * located, power
        order = 1.0
        if self.levels == LEVELS and rough >= FALLS * fine and second > first and located == 0.0:
            order = _order(rough / fine, first, second, self.stepper.method.order)
            confirmed = self.factor != DOUBLE or order >= CONFIRMED * self.stepper.method.order
            # differences do not show the part of the error that all levels share
            order = 0.5 * (1.0 + order) if confirmed else 1.0
        return SAFETY * fine * min(largest, 1.0 / (first ** order - 1.0)) + FIXED_STEP_GAP * located, power

    def _alike(self) -> bool:
        """Return whether longer fixed steps were cut, or are so few, that they equal those of the motion itself."""
        if self.factor != DOUBLE or not self.moved.any():
            return False
        own = self.stepper.t / max(self.stepper.s.numbers[COUNT], 1)
        alike = any(shorter > ALIKE * longer for shorter, longer in pairwise([own, *self._lengths()]))
        return alike and bool(self.largest.min(axis=0).max() <= TELLING * self.moved.max())

    def warnings(self) -> list[str]:
        """Return warnings about an estimate that is missing, unreliable or far above the tolerance."""
        if not self.failed and self._alike():
            if BROKEN * (len(self.stepper.pieces) - 1) > self.stepper.s.numbers[COUNT]:
                return ["no error estimate: the amplitudes have so many break points that longer steps are divided "
                        "into the same steps"]
            return ["no error estimate: longer steps had to be divided into the same steps, or there are too few "
                    "steps. Use smaller steps"]
        if self.failed:
            finer = "smaller steps" if self.factor == DOUBLE else "a smaller tolerance"
            return [f"no error estimate: {self.failed}. Use {finer}"]
        if not self.made.any():
            return ["no error estimate: the motion ends before the first stored state after its start. Use a smaller "
                    "output.interval"]
        estimate, order = self._richardson()
        if self.factor == DOUBLE and estimate and estimate > 1e-3:
            why = "longer steps had to be divided" if self.levels < LEVELS else ""
            if order is not None and order < 0.5 * self.order:
                why = f"differences from runs with longer steps show order {order:.1f} instead of {self.order}"
            return [f"the steps are too large for this motion: {why}; the error may be as large as "
                    f"{percent(estimate)}"] if why else []
        return [] if self.factor == DOUBLE or not estimate else missed_tolerance(self.stepper, estimate, order or 0.0)

    # ------------------------------------------------------------------ checkpoints

    def checkpoint(self) -> dict[str, Array]:
        """Return everything that the estimate needs to go on."""
        for level, (run, _) in list(self.ahead.items()):
            # a run that failed fails again when it is repeated
            if run.exception() is None:
                self._go_on(level)
        out = {"estimate_largest": self.largest.copy(), "estimate_moved": self.moved.copy(),
               "estimate_made": self.made.copy(), "estimate_counts": np.array([self.levels, *self.counts])}
        for k, stepper in enumerate(self.coarse):
            out.update({f"coarse{k}_{name}": value for name, value in (stepper.checkpoint() or {}).items()})
            out[f"coarse{k}_queue"] = self.queues[k]
        self._go_ahead()
        return out

    def resume(self, kept: dict[str, Array]) -> None:
        """Restore the estimate from a checkpoint."""
        self.largest[:], self.moved[:] = kept["estimate_largest"], kept["estimate_moved"]
        self.made[:] = kept["estimate_made"]
        self.levels, *self.counts = map(int, kept["estimate_counts"])
        self._check_left()
        for k, stepper in enumerate(self.coarse):
            head = f"coarse{k}_"
            stepper.resume({name[len(head):]: v for name, v in kept.items() if name.startswith(head)})
            self.queues[k] = kept[head + "queue"]


def _sizes(places: Array) -> Array:
    """Return the lengths (m, probes) of vectors (m, 2 probes)."""
    return np.hypot(places[:, ::2], places[:, 1::2])


def _order(ratio: float, first: float, second: float, highest: int) -> float:
    """Return the order p, from 1 to the highest, that explains the ratio of two differences.

    The errors are like l^p for steps of length 1, ``first`` and ``second``.
    """
    p = np.linspace(1.0, highest, 64 * highest)
    return float(np.interp(ratio, (second ** p - first ** p) / (first ** p - 1.0), p))


def _apart(stepper: Stepper) -> bool:
    """Return whether steps neither read nor write changing parts of the model, so that motions can run in parallel."""
    model, feedback = stepper.model, stepper.model.feedback
    return not (model.contacts or feedback.rank or feedback.conditions or stepper.events or stepper.moving
                or stepper.facing)


def step_ends(stepper: Stepper, since: float, found: list[Row]) -> list[float]:
    """Return the ends of the steps after time ``since``, from the logs of ``found`` and the pending log."""
    ends = np.concatenate([*(row.log[:, 1] for row in found), stepper.pending[:, 1]])
    return ends[ends > since].tolist()


def _nodes(model: Model) -> list[tuple[Index, Array]]:
    """Return x and y of every node as (indices, weights) columns."""
    one = np.ones(1)
    return [(np.array([i + k]), one) for i in CoordinateKinds(model.meshes.values()).positions for k in range(2)]
