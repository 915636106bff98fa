"""The error of time steps, extrapolated from the differences to motions with longer steps."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError
from ...kernels.motion.advance import CHECK
from ...kernels.motion.state import COUNT, SWITCHED
from ...kernels.motion.switching import FIXED_STEP_GAP
from ...model.mesh import Index
from ...model.model import Model
from ...model.rotation import CoordinateKinds
from ...model.timing import rates_of
from ...pace import Pace
from ...processors import threads
from ..state import Row
from ..system import least_motion, least_size, sticks
from .schemes import INTEGRATORS, default_method
from .stepping import Stepper

LEVELS = 2
# factor between levels: of fixed steps, or of the tolerance of adaptive steps
DOUBLE, TENFOLD = 2.0, 10.0
# safety factor on the extrapolated error (Roache's grid convergence index for three levels)
SAFETY = 1.25
# differences that shrink by less than this between levels, as with unresolved vibrations, show no order: assume 1
FALLS = 3.0
# bound on the error, as a multiple of the difference, if steps are hardly longer, as where Newton's method limits them;
# smaller for fixed steps, because each level cuts these at other places, so that errors of levels differ more
LARGEST = {DOUBLE: 2.0, TENFOLD: 4.0}
# if ten times the tolerance changes the error by less than this factor, the error does not depend on it
ASYMPTOTIC = 2.0**0.5
# two levels have the same steps if those of the finer one are longer than this share of the coarser one's; differences
# between such levels mean nothing if they are below this share of the displacements
ALIKE, TELLING = 0.8, 1e-9
# steps of the second level after which it is abandoned if they are no longer than those of the first
SEEN = 40
# a level of fixed steps is abandoned with more steps than this, and than this multiple of the next finer level's
MANY, DIVIDED = 500, 4.0
# multiple of the tolerance above which errors cause a warning
MISSED = 10.0
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
        self.levels, self.made, self.own = LEVELS, np.zeros((LEVELS, 2)), 0
        # states of coarser motions not compared yet: time, number of steps, displacements of probes; their step counts
        self.queues: list[list[tuple[float, int, Array]]] = [[] for _ in range(LEVELS)]
        self.counts = [0] * LEVELS
        self.coarse = [self._level(self.factor ** (k + 1)) for k in range(LEVELS)]
        self.paces = [Pace() for _ in self.coarse]
        self.pool: ThreadPoolExecutor | None = None
        self.ahead: dict[int, tuple[Future[list[Row]], float]] = {}

    def _level(self, factor: float) -> Stepper:
        """Return the stepper of a coarser motion, with steps or tolerance ``factor`` times as large."""
        fine = self.stepper
        spec = fine.spec if fine.dt > 0.0 else replace(fine.spec, tolerance=factor * fine.tolerance)
        out = Stepper(fine.model, fine.problem, fine.signals, spec, factor * fine.dt, fine.wanted)
        # storing states must not shorten the steps
        out.ends_at_states = False
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
                self.ahead[level] = self.pool.submit(stepper.run), stepper.t

    def take(self, t: float, d: Array, steps: int) -> None:
        """Compare with a state of the motion at t; skip the start and times that coarser motions do not store.

        ``steps``: those of the motion up to t, or 0 if none was made since the last state.
        """
        self.own = max(self.own, steps)
        if t == 0.0 or self.failed:
            return
        here = self._places(d)
        self.moved = np.maximum(self.moved, np.hypot(*here))
        for k in range(self.levels):
            there = self._coarse_places(k, t)
            if there is None:
                return
            self.largest[k] = np.maximum(self.largest[k], np.hypot(*(there - here)))
            here = there
        self._give_up()

    def _give_up(self) -> None:
        """Abandon the second level if its steps are no longer and its differences no larger than those of the first.

        Abandon levels of fixed steps that are divided so often that there are many more of them than of finer ones.
        """
        if self.factor == DOUBLE:
            steps = [self.own, *self.made[:self.levels, 1]]
            divided = [k for k in range(self.levels) if steps[k + 1] > max(MANY, DIVIDED * steps[k])]
            self.levels = min(divided, default=self.levels)
            self._check_left()
            return
        if self.levels < LEVELS:
            return
        longer, longest = self._lengths()
        fine, rough = self._differences()
        if self.made[-1, 1] >= SEEN and longer > ALIKE * longest and rough < FALLS * fine:
            self.levels = 1

    def _check_left(self) -> None:
        """Fail if no level is left."""
        if self.levels == 0:
            self.failed = (f"steps of {self.coarse[0].dt:g} s had to be divided into many more steps than those of "
                           f"{self.stepper.dt:g} s")

    def _lengths(self) -> list[float]:
        """Return the mean step length of each level."""
        return [float(t / max(steps, 1.0)) for t, steps in self.made]

    def _places(self, d: Array) -> Array:
        """Return the displacements (2, probes) of the probes."""
        found: Array = np.add.reduceat(self.weights * d[self.coords], self.starts)
        return found.reshape(-1, 2).T

    def _coarse_places(self, level: int, t: float) -> Array | None:
        stepper, queue = self.coarse[level], self.queues[level]
        near = 1e-9 * self.stepper.dt or 1e-12 * self.stepper.spec.t_end
        while not queue or queue[-1][0] < t - near:
            if level not in self.ahead and stepper.done and queue and queue[-1][0] >= stepper.t:
                # a coarser motion may end before this one
                return None
            if not self._go_on(level):
                return None
            self._go_ahead()
        while queue and queue[0][0] < t - near:
            queue.pop(0)
        if not queue or queue[0][0] > t + near:
            return None
        self.made[level] = queue[0][:2]
        return queue[0][2]

    def _go_on(self, level: int) -> bool:
        """Append the states of the next run of a coarser motion; return False if it failed."""
        stepper, queue = self.coarse[level], self.queues[level]
        run, since = self.ahead.pop(level, (None, stepper.t))
        try:
            with self.paces[level].running():
                rows = run.result() if run else [stepper.last()] if stepper.done else stepper.run()
        except ComputationError as error:
            how = f"steps of {stepper.dt:g} s" if stepper.dt > 0.0 else f"a tolerance of {stepper.tolerance:g}"
            self.failed = f"with {how} the motion could not be computed ({error.failure.reason})"
            return False
        self.paces[level].mark(stepper.t, within=step_ends(stepper, since, rows))
        for row in rows:
            self.counts[level] += len(row.log)
            if row.kind != CHECK:
                queue.append((row.t, self.counts[level], self._places(stepper.full(row, 1)[0])))
        return True

    def report(self) -> dict[str, Any]:
        """Return the relative error estimate, the observed order (fixed steps only), and how they were found."""
        estimate, order = self._richardson()
        return {"estimate": estimate, "order": order if self.factor == DOUBLE else None, "of": "time steps",
                "steps": int(self.made[:, 1].sum())}

    def _differences(self) -> tuple[float, float]:
        """Return the largest difference of each level, relative to the displacements."""
        size = np.where(self.moved > least_motion(self.stepper.model), self.moved, np.inf)
        if self.factor != DOUBLE and sticks(self.stepper.model):
            # vibrations of the springs that hold sticking points weigh no more here than in the step size control
            size = np.maximum(size, least_size(self.stepper.model, self.stepper.tolerance))
        fine, rough = (float(np.max(row / size, initial=0.0)) for row in self.largest)
        return fine, rough

    def _richardson(self) -> tuple[float | None, float | None]:
        """Return the error extrapolated from three levels, and the observed power of the factor between them."""
        if self.failed or self._alike():
            return None, None
        fine, rough = self._differences()
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
            return [f"no error estimate: {self.failed}. Use {self._finer}"]
        estimate, order = self._richardson()
        if self.factor == DOUBLE and estimate and estimate > 1e-3:
            why = "longer steps had to be divided" if self.levels < LEVELS else ""
            if order is not None and order < 0.5 * self.order:
                why = f"differences from runs with longer steps show order {order:.1f} instead of {self.order}"
            return [f"the steps are too large for this motion: {why}; the error may be as large as "
                    f"{100 * estimate:.2g} %"] if why else []
        return [] if self.factor == DOUBLE or not estimate else self._missed(estimate, order or 0.0)

    def _missed(self, estimate: float, order: float) -> list[str]:
        """Return a warning that the error is far above the tolerance, and whether steps or motion cause it.

        ``order``: the observed power of the tolerance with which errors grow.
        """
        case, tolerance, count = self.stepper.model.case, self.stepper.tolerance, int(self.stepper.s.numbers[COUNT])
        # no warning for the default tolerance, nor where the accuracy control judges the runs itself
        asked = getattr(case.solver, "tolerance", None) is not None and case.accuracy is None
        if estimate <= MISSED * tolerance or not asked:
            return []
        said = (f"the tolerance is missed: the estimated error is {estimate:.2g} of the largest displacements, "
                f"{estimate / tolerance:.0f} times the tolerance {tolerance:g}. ")
        if estimate <= count * tolerance and self.factor ** order < ASYMPTOTIC:
            return [said + "Ten times the tolerance gives about the same error: the steps skip fast vibrations, which "
                    "only a much smaller tolerance resolves. If these vibrations do not matter, use a larger tolerance"
                    + self._better() + self._jump()]
        if estimate <= count * tolerance:
            # a tolerance between half and the range of the levels, over which the power was observed
            share = (MISSED * tolerance / estimate) ** (1.0 / min(order, self.order))
            share = max(min(share, 0.5), self.factor ** -LEVELS)
            return [said + "Each step meets the tolerance, but the errors add up. Use a tolerance of about "
                    f"{share * tolerance:.1g}" + self._better() + self._jump()]
        # errors that do not grow add up to at most the number of steps times the tolerance
        return [said + "The errors grow, because the motion is sensitive to its initial state, like chaotic motions. A "
                "smaller tolerance only postpones the time from which the motion is unreliable; its statistics may "
                "still be right"]

    def _better(self) -> str:
        """Return advice to use the recommended method if its order is higher: it errs less with fewer steps."""
        best = INTEGRATORS[default_method(self.stepper.model)]
        better = best.order > self.stepper.method.order
        return f". Method {best.name} has a smaller error with fewer steps" if better else ""

    def _jump(self) -> str:
        """Return a hint if a prescribed motion starts a model at rest with a jump of velocity, like an impact."""
        model = self.stepper.model
        # moving obstacles move nothing before they touch
        obstacles = [s for pair in model.contacts for s in pair.signal or ()]
        signals = [self.stepper.signals[k] for k in self.stepper.driving]
        if model.case.initial is not None or not any(rates_of(s, 0.0)[0] for s in signals if s not in obstacles):
            return ""
        return (". A prescribed motion begins at full speed, which excites vibrations like an impact. Let it begin "
                "gradually, or give initial velocities")

    @property
    def _finer(self) -> str:
        return "smaller steps" if self.factor == DOUBLE else "a smaller tolerance"

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
            out[f"coarse{k}_queue"] = np.array([[*made, *places.ravel()] for *made, places in self.queues[k]]).reshape(
                -1, 2 + 2 * len(self.moved))
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
            self.queues[k] = [(float(r[0]), int(r[1]), r[2:].reshape(2, -1)) for r in kept[head + "queue"]]


def _order(ratio: float, first: float, second: float, highest: int) -> float:
    """Return the order p, from 1 to the highest, that explains the ratio of two differences.

    The errors are like l^p for steps of length 1, ``first`` and ``second``.
    """
    p = np.linspace(1.0, highest, 64 * highest)
    return float(np.interp(ratio, (second ** p - first ** p) / (first ** p - 1.0), p))


def _apart(stepper: Stepper) -> bool:
    """Return whether steps neither read nor write changing parts of the model, so that motions can run in parallel."""
    model, answers = stepper.model, stepper.model.feedback
    return not (model.contacts or answers.rank or answers.conditions or stepper.events or stepper.moving
                or stepper.facing)


def step_ends(stepper: Stepper, since: float, found: list[Row]) -> list[float]:
    """Return the ends of the steps after time ``since``, from the logs of ``found`` and the pending log."""
    ends = np.concatenate([*(row.log[:, 1] for row in found), stepper.pending[:, 1]])
    return ends[ends > since].tolist()


def _nodes(model: Model) -> list[tuple[Index, Array]]:
    """Return x and y of every node as (indices, weights) columns."""
    one = np.ones(1)
    return [(np.array([i + k]), one) for i in CoordinateKinds(model.meshes.values()).positions for k in range(2)]
