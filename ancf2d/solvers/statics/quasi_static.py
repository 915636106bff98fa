"""Equilibrium over time, without inertia: creep, relaxation, slow cycles and thermal histories."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...case import QuasiStatic
from ...case.schema.solvers import LOAD_STEPS, TIME_STEPS
from ...elements.shape import Array
from ...errors import ComputationError
from ...model.breakpoints import SMOOTH, case_stops, instants
from ...model.model import Model
from ..contact import memory, restore_memory
from ..least_motion import UNIT_ROUNDOFF
from ..state import State, check_checkpoint
from ..system import System, Turned
from .newton import MAX_ITERATIONS, TOLERANCE, NewtonResult, check_sound, negative_pivots, newton, state_of
from .static import BEYOND, LoadSteps
from .step_control import Path

# shares of the whole time: first step, and step too short to go on
FIRST, SHORTEST = 1e-6, 1e-12
# tolerance of the equilibrium relative to that of the step
CLOSE = 1e-4
# bounds of the ratio of successive steps, and safety factor on the step that the error allows
LEAST, MOST, SAFE = 0.2, 3.0, 0.9
# the accumulated error is proportional to this power of the step size
ORDER = 2
# number of e-folding times after which errors have faded
FADED = 2.0
# multiple of Newton's residual that is the uncertainty of forces
LEFT = 4.0
# share of the tolerance for the errors of steps while the time since the last break grows e-fold; two such spans count
AGE = 0.5


@dataclass
class _Kept:
    """The data to restore after a step is rejected."""

    states: Array
    contacts: list[Array]
    turns: Turned
    accepted: tuple[Array, float] | None


class Course:
    """Follows equilibria over time; ``d`` (n_full,) is the one at ``t``."""

    def __init__(self, model: Model, spec: QuasiStatic) -> None:
        self.model, self.spec, self.system = model, spec, System(model)
        self.close = min(TOLERANCE, CLOSE * spec.tolerance)
        self.iterations = spec.max_iterations or MAX_ITERATIONS
        self.load_steps = LoadSteps(self.system, 1.0 / LOAD_STEPS, self.close, self.iterations)
        self.longest = spec.t_end / (spec.steps or TIME_STEPS)
        self.t, self.number, self.refused = 0.0, 0, 0
        # next step, number of breaks passed, and time of the last one
        self.h, self.passed, self.begin = FIRST * spec.t_end, 0, 0.0
        # largest displacement so far [m], and largest force on supports [N]
        self.size, self.force = 0.0, 0.0
        self.path = Path([0.0], [self.load_steps.d])
        self.fades = _fading(model)
        # relaxing materials are strained by prescribed coordinates, too: coordinates (k,) that are not unknowns, and
        # the displacement of a unit of each
        weights = model.weights
        moves = np.flatnonzero(weights > 0.0) if model.maxwell else np.zeros(0, dtype=np.int64)
        self.held = np.setdiff1d(moves, model.numbering.free)
        self.arms, self.least = weights[self.held], float(np.min(weights, where=weights > 0.0, initial=np.inf))

    def states(self, kept: dict[str, Array] | None = None) -> Iterator[State]:
        """Yield the instantaneous response at t = 0 and the equilibrium at the end of each step.

        From a checkpoint, yield only the states after it.
        """
        if kept is None:
            self.model.set_step(0.0)
            iterations, warnings = self.load_steps.settle()
            self.system.balancing_forces = None
            yield self._at_rest(iterations, warnings)
        else:
            self._resume(kept)
        # with history variables, steps must end where amplitudes turn back
        turns = bool(self.model.remembers)
        case, end = self.model.case, self.spec.t_end
        wanted = list(self.spec.times or ())
        if case.output.interval is not None:
            wanted += instants(case.output.interval, end).tolist()
        for b in case_stops(case, 0.0, end, turns, wanted)[self.passed:]:
            yield from self._go(b.before if b.order == 0 else b.t)
            state = self._jump(b.t) if b.order == 0 else None
            self.path = Path([self.t], [self.load_steps.d])
            if b.order < SMOOTH:
                self.begin, self.h = self.t, FIRST * self.spec.t_end
            self.passed += 1
            if state is not None:
                yield state
        yield from self._go(self.spec.t_end)

    def checkpoint(self) -> dict[str, Array]:
        """Return everything that the computation needs to go on."""
        accepted = self.system.accepted
        pairs = {"turns": self.system.turns(), "load_steps": self.load_steps.turns}
        turns = {f"{name}/{k}": x for name, pair in pairs.items() for k, x in enumerate(pair)}
        # the path ends at d; rows contain d, or the accepted state, and its time
        before, last = list(zip(self.path.d, self.path.t, strict=True))[:-1], [] if accepted is None else [accepted]
        return {"numbers": np.array([self.t, self.h, self.begin, self.size, self.force]),
                "counts": np.array([self.number, self.refused, self.passed, self.load_steps.negative]),
                "d": self.load_steps.d, "states": self.model.states.copy(), **turns,
                **{name: np.array([np.append(*row) for row in rows]).reshape(-1, len(self.load_steps.d) + 1)
                   for name, rows in (("path", before), ("accepted", last))},
                **{f"contact/{k}": mem for k, mem in enumerate(memory(self.model))}}

    def _resume(self, kept: dict[str, Array]) -> None:
        self.t, self.h, self.begin, self.size, self.force = kept["numbers"].tolist()
        self.number, self.refused, self.passed, self.load_steps.negative = kept["counts"].tolist()
        self.path = Path([*kept["path"][:, -1].tolist(), self.t], [*kept["path"][:, :-1], kept["d"]])
        self.load_steps.d, self.load_steps.turns = kept["d"], (kept["load_steps/0"], kept["load_steps/1"])
        self.system.count_from((kept["turns/0"], kept["turns/1"]))
        self.system.accepted = next(((row[:-1], float(row[-1])) for row in kept["accepted"]), None)
        self.model.states[:] = kept["states"]
        restore_memory(self.model, [kept[f"contact/{k}"] for k in range(len(self.model.contact_tables))])

    def _at_rest(self, iterations: int, warnings: list[str]) -> State:
        """Return the state at the current equilibrium."""
        state = self.load_steps.state(self.t)
        self._count(state.d)
        state.history.update(step=self.number, iterations=iterations)
        state.warnings = warnings + state.warnings
        self.path = Path([self.t], [self.load_steps.d])
        return state

    def _count(self, d: Array) -> None:
        self.number += 1
        self.size = max(self.size, self.system.norm(d[self.model.numbering.where]))

    def _jump(self, t: float) -> State:
        """Return the instantaneous equilibrium after a jump of loads or motions at t."""
        before, self.t = self.t, t
        self.model.set_step(0.0)
        found = self.load_steps.jump(before, t)
        self.system.balancing_forces = None
        return self._at_rest(*found)

    def _go(self, stop: float) -> Iterator[State]:
        """Yield the states of steps up to a time."""
        end = self.spec.t_end
        while self.t < stop:
            left, h = stop - self.t, self.h
            step = min(h, self.longest)
            step = left if left < 1.1 * step else step
            kept = self._keep()
            try:
                result, whole = self._tried(step)
            except ComputationError as failure:
                self._restore(kept)
                self.h, self.refused = 0.5 * step, self.refused + 1
                if self.h < SHORTEST * end:
                    raise self._stuck(failure) from failure
                continue
            # the errors of all steps since the last break add up to the tolerance, equally per decade of time
            share = AGE * step / min(self.t + step - self.begin, self.fades)
            error = 0.0 if whole is None else self._error(whole, result, self.spec.tolerance * share)
            grows = SAFE * error ** (-1.0 / ORDER) if error > 0.0 else MOST
            if error > 1.0 and step > SHORTEST * end:
                self._restore(kept)
                self.h, self.refused = max(LEAST, grows) * step, self.refused + 1
                continue
            # a step that was shortened to end at the stop hardly limits the next
            self.h = max(h if step < h else SHORTEST * end, min(MOST, max(LEAST, grows)) * step)
            yield self._accept(result, stop if step == left else self.t + step)

    def _error(self, whole: NewtonResult, halves: NewtonResult, allowed: float) -> float:
        """Return the error of two half steps relative to the share ``allowed`` of the largest displacement so far.

        If materials relax, also relative to the largest force on supports: where all displacements are prescribed, they
        do not show how stress relaxes.
        """
        size = max(self.size, self.system.norm(halves.d[self.model.numbering.where]))
        # smaller differences are round-off of positions, as when loads have just started
        known = UNIT_ROUNDOFF * self.model.extent
        found = self.system.distance(whole.d, halves.d) / max(allowed * size, known)
        if len(self.held):
            apart = float(np.max(np.abs(whole.Q[self.held] - halves.Q[self.held]) / self.arms))
            share = max(allowed, known / size if size > 0.0 else 0.0)
            least = LEFT * (whole.residual + halves.residual) / self.least
            force = max(share * max(self.force, self._force(halves)), least)
            found = max(found, apart / force if force > 0.0 else 0.0)
        return found / (2.0**ORDER - 1.0)

    def _force(self, result: NewtonResult) -> float:
        """Return the largest force on supports [N]."""
        return float(np.max(np.abs(result.Q[self.held]) / self.arms, initial=0.0))

    def _tried(self, h: float) -> tuple[NewtonResult, NewtonResult | None]:
        """Return the equilibrium after a time h by two half steps, and that by one whole step.

        If the equilibrium does not depend on the path, one step is made, and the second result is None.
        """
        rubs = any(pair.item.friction for pair in self.model.contacts)
        if not self.model.remembers and not rubs:
            return self._solve(self.t, h, self.path), None
        kept = self._keep()
        whole = self._solve(self.t, h, self.path)
        if rubs:
            # the half steps start from the same contact state
            self._restore(kept)
        middle = self.t + 0.5 * h
        half = self._solve(self.t, 0.5 * h, self.path)
        self.system.accept(half.d, middle)
        path = Path([*self.path.t], [*self.path.d])
        path.push(middle, half.d.copy())
        return self._solve(middle, 0.5 * h, path), whole

    def _solve(self, t: float, h: float, path: Path) -> NewtonResult:
        self.model.set_step(h)
        alone = len(path.t) == 1
        result = newton(self.system, path.extrapolate(t + h), t if alone else None, t + h, self.close,
                        self.iterations)
        check_sound(self.model, result.d, (path.d[-1], t), t + h)
        return result

    def _accept(self, result: NewtonResult, t: float) -> State:
        self.t = t
        self._count(result.d)
        self.force = max(self.force, self._force(result))
        if result.negative_pivots != self.load_steps.negative:
            result.negative_pivots = negative_pivots(self.system, result.d, t)
        state = state_of(self.system, result, t, self.number - 1, 0, self.load_steps.stability(result, t))
        self.load_steps.negative = result.negative_pivots
        self.system.accept(result.d, t)
        # quantities evaluated next belong to this time
        self.model.set_step(0.0)
        self.load_steps.continue_from(result.d)
        self.path.push(t, result.d)
        return state

    def _keep(self) -> _Kept:
        return _Kept(self.model.states.copy(), memory(self.model), self.system.turns(), self.system.accepted)

    def _restore(self, kept: _Kept) -> None:
        self.model.states[:] = kept.states
        restore_memory(self.model, kept.contacts)
        self.system.count_from(kept.turns)
        self.system.accepted = kept.accepted

    def _stuck(self, error: ComputationError) -> ComputationError:
        f = error.failure
        return ComputationError(f"no equilibrium was found beyond t = {self.t:.6g}: {f.reason}",
                                at={"step": self.number, "t": float(f"{self.t:.6g}")}, history=f.history,
                                advice=f.advice or BEYOND)


def _fading(model: Model) -> float:
    """Return a time [s] after which errors of relaxing materials have faded, infinite with other history variables.

    They fade e-fold in the relaxation time at given strain, and in up to 1 + sum g times that at given stress.
    """
    rubs = any(pair.item.friction for pair in model.contacts)
    if rubs or any(not model.meshes[name].plan.section.maxwell for name in model.remembers):
        return float("inf")
    return FADED * max(((1.0 + sum(g for g, _ in terms)) * max(tau for _, tau in terms) for terms in model.maxwell),
                       default=float("inf"))


def solve_quasi_static(model: Model, spec: QuasiStatic, kept: dict[str, Array] | None = None) -> Iterator[State]:
    """Yield the equilibrium at t = 0 and at the end of each step up to t_end, or those after a checkpoint.

    Steps adapt to the error of the displacements, by comparison with two half steps. They end at corners of amplitudes
    and, with history variables, where these turn back; a jump is followed by an instantaneous response. Raises
    ComputationError if there is no equilibrium after the last one, and CheckpointError at once if the checkpoint is
    from another case.
    """
    if model.hangs:
        raise ComputationError("only gravity stabilises the model, so there is no equilibrium to start from",
                               at={"solver": "quasi_static"}, advice="supports that leave no mechanism")
    course = Course(model, spec)
    if kept is not None:
        check_checkpoint(kept, course.checkpoint())
    return _timed(course, kept)


def _timed(course: Course, kept: dict[str, Array] | None) -> Iterator[State]:
    """Yield the states of a course with their times, time steps and checkpoints."""
    before = 0.0 if kept is None else float(kept["numbers"][0])
    for state in course.states(kept):
        state.last, state.checkpoint = course.t >= course.spec.t_end, course.checkpoint()
        rest = {name: value for name, value in state.history.items() if name not in ("step", "factor")}
        state.history = {"step": state.history["step"], "t": state.t, "dt": state.t - before, **rest}
        before = state.t
        yield state
