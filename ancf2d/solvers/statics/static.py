"""Static equilibrium by Newton's method with adaptive load steps."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...case.schema.solvers import LOAD_STEPS
from ...elements.shape import Array
from ...errors import ComputationError, SingularTangentError
from ...model.breakpoints import case_stops
from ...model.build import can_hang
from ...model.constraints import motions
from ...model.model import Model
from ...model.timing import PathTiming
from ..contact import memory, restore_memory
from ..long_vectors import largest
from ..state import State
from ..system import System, Turned
from .hanging import FALLS, FELL, free_without, hanging, slack, tethered
from .newton import (
    MAX_ITERATIONS,
    TOLERANCE,
    NewtonResult,
    Start,
    at_floor,
    check_sound,
    equilibrium_near,
    moved_balance,
    negative_pivots,
    newton,
    state_of,
)
from .step_control import Jumps, Path, StepSizes

# a singular tangent within this share of the load factor after an equilibrium indicates a critical load
NEXT = 1e-3
# share of a step whose loads predict the change over all of it, if tendons would be slack under those at its end
NEARBY = 1e-3
# places within this share of the way are the same
ROUND = 1e-9
# advice if no equilibrium over time is found
BEYOND = ("a limit load is likely, beyond which only solver dynamic can continue; else supports that leave no "
          "mechanism")


def solve_static(model: Model, steps: int | None = None, tolerance: float | None = None,
                 max_iterations: int | None = None, end: float = 1.0, start: Start | None = None,
                 factors: Sequence[float] = ()) -> Iterator[State]:
    """Yield a state per load step, from the reference (factor 0) to the factor ``end``, which may be negative or 0.

    The factor changes by at most ``end/steps`` at a time; failed steps are cut, and grow again after easy ones. Steps
    also end at ``factors``. Forces that act at factor 0 (springs that pull, amplitudes that do not start at 0) are
    applied first, which yields a state only if ``end`` or one of ``factors`` is 0. If the equilibrium is found directly
    from ``start``, only that state is yielded. Raises ComputationError if the path cannot be followed.
    """
    system = System(model)
    tolerance, max_iterations = tolerance or TOLERANCE, max_iterations or MAX_ITERATIONS
    # with history variables, the path to the state matters
    whole = start is None or model.remembers or len(factors) > 0
    near = None if start is None or whole else equilibrium_near(system, start, end, tolerance, max_iterations)
    if near is not None:
        yield state_of(system, near, end, 1, 0, [])
        return
    load_steps = LoadSteps(system, 1.0 / (steps or LOAD_STEPS), tolerance, max_iterations)
    soft = end != 0.0 and slack(model)
    failed: ComputationError | None = None
    try:
        if model.hangs:
            raise ComputationError("only gravity holds the model", at={"factor": 0.0})
        if (yield from _steps(load_steps, end, factors, soft)):
            return
    except ComputationError as error:
        # contacts may hold the model once it has fallen on them, and tendons once they are tight
        if end != 0.0 and tethered(model):
            load_steps.begin()
            failed = error
        elif load_steps.load.factor == 0.0 != end and model.contacts and can_hang(model.case):
            failed = error
        elif not (model.hangs or soft):
            raise
    load_steps.apply(Load(end, 1.0))
    why = [FALLS] if failed else [] if model.hangs else [FELL]
    try:
        yield hanging(system, load_steps.d, (load_steps.load.factor, end), tolerance, max_iterations, why)
    except ComputationError as error:
        # it does not come to rest on them either
        raise failed or error from None


def _steps(load_steps: LoadSteps, end: float, factors: Sequence[float], soft: bool) -> Generator[State, None, bool]:
    """Yield a state per step; return False if the steps stopped because a ``soft`` model became unstable."""
    model = load_steps.model
    corners = _stops(model, end) if model.remembers and end > 0.0 else []
    stops = sorted(f / end for f in factors if f != 0.0)
    iterations, warnings = load_steps.settle()
    if end != 0.0 and 0.0 in factors:
        yield load_steps.state()
    rest = [load_steps.state()] if end == 0.0 else load_steps.states(Load(0.0, 1.0), Load(end, 1.0), corners, stops)
    for state in rest:
        if soft and state.history["negative_pivots"] > 0 and load_steps.system.knows_inertia:
            return False
        state.history["iterations"] += iterations
        state.warnings = warnings + state.warnings
        iterations, warnings = 0, []
        yield state
    return True


def _stops(model: Model, end: float) -> list[float]:
    """Return the shares of the way at which loads may turn back: histories are exact only if steps end there."""
    out: list[float] = []
    for share in [b.t / end for b in case_stops(model.case, 0.0, end)]:
        if share > ROUND and share < 1.0 - ROUND and (not out or share - out[-1] > ROUND):
            out.append(share)
    return out


def unscaled(model: Model, tolerance: float | None = None, max_iterations: int | None = None) -> Iterator[State]:
    """Yield the states to the equilibrium at load factor 0 of a path, under constant loads and springs that pull.

    Yield nothing if that is the reference. Raises ComputationError if it is not found.
    """
    timing, system = model.timing, System(model)
    if isinstance(timing, PathTiming) and timing.constant:
        with timing.preload():
            yield from solve_static(model, None, tolerance, max_iterations)
        return
    d = model.displacements(np.zeros(model.numbering.n_unknowns), 0.0)
    R = system.forces(d, 0.0).R
    if R.any() and not at_floor(R, system.noise(d, 0.0)):
        yield from solve_static(model, None, tolerance, max_iterations, 0.0)


@dataclass(frozen=True)
class Load:
    """The loads that a state balances: those at a factor, and a share of the forces present at factor 0."""

    factor: float
    share: float

    def towards(self, other: Load, s: float) -> Load:
        """Return the interpolation towards another load, at s from 0 to 1."""
        return Load(self.factor + s * (other.factor - self.factor), self.share + s * (other.share - self.share))


class LoadSteps:
    """Goes from equilibrium to equilibrium by steps of at most ``longest`` of the way; ``d`` is the last one."""

    def __init__(self, system: System, longest: float, tolerance: float, max_iterations: int) -> None:
        self.system, self.model, self.longest = system, system.model, longest
        self.tolerance, self.max_iterations = tolerance, max_iterations
        self.negative = 0
        # forces (n_unknowns,) that balance the reference at factor 0, with springs not yet tightened
        self.held: Array | None = None
        self.tightens = True
        self.begin()
        self.jumps = Jumps(self.model)
        if self.model.contacts:
            self.model.interactions.set_friction_anchors(self.d, 0.0)

    def begin(self) -> None:
        """Start from the reference, without loads."""
        self.d = self.model.displacements(np.zeros(self.model.numbering.n_unknowns), 0.0)
        self.load = Load(0.0, 0.0)
        self.system.count_from((np.zeros_like(self.d), np.zeros(len(self.model.meshes))))
        self.system.count(self.d, 0.0)
        self.turns = self.system.turns()

    def settle(self) -> tuple[int, list[str]]:
        """Go to the equilibrium at factor 0; return the number of iterations and warnings.

        Springs are tightened and natural strains grow step by step, while the forces that hold the reference are
        released.
        """
        R = self.system.forces(self.d, 0.0).R
        if not R.any() or at_floor(R, self.system.noise(self.d, 0.0)):
            # natural strains can stress sections that hold still
            if self.model.remembers and self.model.loads.natural:
                self.system.accept(self.d, 0.0)
            return 0, []
        for spring in self.model.springs:
            spring.tighten(0.0)
        self._strain(0.0)
        self._hold(0.0)
        return self._all(Load(0.0, 0.0), Load(0.0, 1.0))

    def _hold(self, t: float) -> None:
        """Store the unbalanced forces at factor t as holding forces, except contact gaps, which change at once."""
        self.held, num = self.system.forces(self.d, t).R, self.model.numbering
        for table in self.model.contact_tables:
            self.held[num.place[[p.multiplier for p in table.points]]] = 0.0

    def jump(self, before: float, t: float) -> tuple[int, list[str]]:
        """Go to the equilibrium after a jump of loads or motions at t; return the number of iterations and warnings.

        ``before`` is the time just before the jump.
        """
        self.d = self.model.displacements(self.d[self.model.numbering.where], t)
        for strain in self.model.loads.natural:
            strain.before = strain.amplitude(before)
        self._strain(0.0)
        self.tightens = False
        self._hold(t)
        return self._all(Load(t, 0.0), Load(t, 1.0))

    def _all(self, begin: Load, end: Load) -> tuple[int, list[str]]:
        """Go from one load to another; return the iterations and the warnings of all steps."""
        states = list(self.states(begin, end))
        return sum(int(s.history["iterations"]) for s in states), [w for s in states for w in s.warnings]

    def continue_from(self, d: Array) -> None:
        """Continue from an equilibrium (n_full,) that was found elsewhere."""
        self.d, self.turns, self.held = d, self.system.turns(), None

    def state(self, t: float = 0.0) -> State:
        """Return the state of the current equilibrium, at a factor or time t."""
        balance = self.system.assemble(self.d, t)
        R = balance.R
        negative = self.system.factor({"factor": t}).negative - self.model.numbering.n_multipliers
        result = NewtonResult(self.d, balance.Q, balance.F, balance.energy, largest(R), 0, [], R, negative, 0.0)
        return state_of(self.system, result, t, 1, 0, [])

    def apply(self, load: Load) -> None:
        """Apply a load to the current equilibrium."""
        self._set(load, self.turns)

    def _set(self, load: Load, turns: Turned) -> None:
        """Apply a load, and count turns from the given state."""
        self.system.count_from(turns)
        if self.held is not None:
            self.system.balancing_forces = (1.0 - load.share) * self.held
            self._strain(load.share)
            for spring in self.model.springs if self.tightens else ():
                spring.tighten(load.share)

    def _strain(self, share: float) -> None:
        """Set natural strains to a share of the way from their previous values."""
        for strain in self.model.loads.natural:
            strain.share = share

    def states(self, begin: Load, end: Load, corners: Sequence[float] = (), stops: Sequence[float] = ()
               ) -> Iterator[State]:
        """Yield a state per step from one load to another; steps end at shares ``stops`` and ``corners`` of the way.

        After a corner, no extrapolation uses the states before.
        """
        path, sizes, number, old = Path([0.0], [self.d]), StepSizes(self.longest, [*corners, *stops]), 0, begin
        while sizes.s < 1.0:
            target = sizes.target()
            new = end if target == 1.0 else begin.towards(end, target)
            touched = memory(self.model)
            try:
                result = self._step(path, target, old, new)
                turns = self.system.turns()
                changed = result.negative_pivots != self.negative and self.system.knows_inertia
                if changed:
                    result.negative_pivots = negative_pivots(self.system, result.d, new.factor)
            except ComputationError as error:
                restore_memory(self.model, touched)
                if not sizes.cut(target, isinstance(error, SingularTangentError)) and not self.jumps.accept(error):
                    raise self._stuck(error, old.factor, number) from error
                continue
            if changed and self._bends_away(path, result, old.factor) and sizes.corner(target):
                restore_memory(self.model, touched)
                continue
            number += 1
            self.system.count_from(turns)
            snap = self.jumps.warning(new.factor)
            stability = snap + self.stability(result, new.factor)
            state = state_of(self.system, result, new.factor, number, sizes.cutbacks, stability)
            self.system.accept(result.d, new.factor)
            self.turns = self.system.turns()
            yield state
            self.d, self.negative, self.load, old = result.d, result.negative_pivots, new, new
            if target in corners or snap:
                path = Path([], [])
            path.push(target, result.d)
            sizes.accept(target)
            # long vectors that the next step does not need
            del result, state

    def _step(self, path: Path, target: float, old: Load, new: Load) -> NewtonResult:
        """Return the equilibrium at s = ``target``. Raises ComputationError if none follows from the last one."""
        model, last, first, t = self.model, path.d[-1], len(path.t) == 1, new.factor
        self._set(new, self.turns)
        result = newton(self.system, path.extrapolate(target), old.factor if first else None, t, self.tolerance,
                        self.max_iterations, None if first else last)
        check_sound(model, result.d, (last, old.factor), t)
        # no jump if Newton's method has changed little of the extrapolation; with history variables, the tangents may
        # be those of unloading, which do not predict the path
        if not model.remembers and sum(result.increments) > 0.5 * self.system.distance(result.d, last):
            turns = result.d, self.system.count(result.d, t)
            predicted = self._predicted(self.turns, old, new) if not first or result.first is None else result.first
            self.jumps.check(self.system, last, result.d, predicted, t)
            self.jumps.check(self.system, result.d, last, self._predicted(turns, new, old), t)
            self._set(new, turns)
        return result

    def _predicted(self, state: Turned, here: Load, there: Load) -> Array:
        """Return the change of the unknowns (n_unknowns,) for a change of load, by the tangent at an equilibrium.

        Tendons that are wound up may be slack under the other load, which says nothing of the path to it.
        """
        share = NEARBY if any(spring.winds for spring in self.model.loads.springs) else 1.0
        there = here.towards(there, share)
        system, t, d = self.system, there.factor, state[0]
        self._set(there, state)
        R = moved_balance(system, d, here.factor, t).R
        system.factor({"factor": float(f"{t:.6g}")})
        return -system.matrix.solve(R) / share

    def _bends_away(self, path: Path, result: NewtonResult, t_old: float) -> bool:
        """Return whether a stable path may bend away before an unstable state, which a shorter step would show."""
        if self.negative > 0 or result.negative_pivots <= 0:
            return False
        return len(path.t) > 1 or negative_pivots(self.system, path.d[-1], t_old) <= 0

    def stability(self, result: NewtonResult, t: float) -> list[str]:
        """Return a warning if the stability of a state differs from that of the last one."""
        if (result.negative_pivots > 0) == (self.negative > 0) or not self.system.knows_inertia:
            return []
        timed = self.model.case.solver.timed
        when, paths = (f"t = {t:.6g}", "") if timed else (
            f"load factor {t:.6g}", "; to pass limit points, use method: arc_length")
        if self.negative > 0:
            return [f"the equilibrium is stable again from {when} on"]
        apart = [f", or short elements separate in {m.plan.name}" for m in self.model.meshes.values() if m.can_part]
        return [f"unstable equilibrium from {when} on: the structure buckles or snaps there{''.join(apart)} "
                f"({result.negative_pivots} negative pivots). To follow the buckled branch, add a small imperfection "
                f"of shape or load{paths}"]

    def _stuck(self, error: ComputationError, t: float, number: int) -> ComputationError:
        met = (f := error.failure).at.get("factor", t)
        if isinstance(error, SingularTangentError) and 0.0 < abs(met - t) <= NEXT * abs(t):
            return ComputationError(
                f"load factor {met:.6g} is critical: the tangent stiffness is singular there",
                at={"step": number + 1, **f.at},
                advice="a load factor on either side of it. The structure buckles or snaps there. To follow the "
                "buckled branch, add a small imperfection of shape or load; to pass limit points, use method: "
                "arc_length")
        if self.model.case.solver.timed:
            return ComputationError(f"no equilibrium was found at t = {t:.6g}: {f.reason}", at={"t": t},
                                    history=f.history, advice=(_jumps_at_start(self.model) if t == 0.0 else "")
                                    or f.advice or BEYOND)
        sided = _springs_that_alone_hold(self.model) if t == 0.0 else []
        if sided:
            f.advice = (f"loads in the direction in which {', '.join(sided)} resist{'s' * (len(sided) == 1)}, since "
                        "nothing else holds the model; or a weak spring that always acts")
        return ComputationError(
            f"no equilibrium was found beyond load factor {t:.6g}: {f.reason}", at={"step": number + 1, **f.at},
            history=f.history,
            advice=f.advice or "method: arc_length if this is a limit point; else more steps, or supports that leave "
            "no mechanism")


def _jumps_at_start(model: Model) -> str:
    """Return the advice to let prescribed motions begin at the reference, with those that do not, or nothing."""
    found = [problem[0] for motion in motions(model.rows, model.constraints) if motion.starts
             and (problem := motion.start_problem(model.extent))]
    return f"prescribed motions that begin at the reference. {'; '.join(found)}" if found else ""


def _springs_that_alone_hold(model: Model) -> list[str]:
    """Return the paths of one-sided springs and tendons, if bodies could move freely without them."""
    sided = [spring for spring in model.springs if spring.breaks]
    return [spring.path for spring in sided] if sided and not model.contacts and free_without(model, sided) else []
