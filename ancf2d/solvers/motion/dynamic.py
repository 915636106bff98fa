"""Motion over time: stored states, energies, momentum and an error estimate."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ...case import Dynamic
from ...elements.shape import Array
from ...errors import ComputationError, percent
from ...kernels.lowlevel.records import Record
from ...kernels.motion.advance import CHECK, INSIDE
from ...kernels.motion.state import COUNT, REJECTED
from ...model.breakpoints import instants
from ...model.element_limits import any_inverted, inverted
from ...model.model import Model
from ...pace import Pace
from ..contact import check_pressed_through, set_memory
from ..energy import Energies, constant_loads, extra_energy, is_constant
from ..least_motion import least_motion
from ..long_vectors import largest_share
from ..state import State, check_checkpoint
from .estimate import Estimate, step_ends
from .initial import initial_motion, layers_warnings
from .integrators import SCIPY_METHODS
from .ode import OdeStepper
from .problem import make_problem
from .stepping import LOG, Row, Stepper
from .warnings import drift_warning, fibres_warning, gain_warning, wound_warning

# number of stored states if the case does not say
STATES = 200
# local errors are relative to the largest displacement so far: initially this share of the scene's size, or less if a
# trial run over this share of the motion finds less
FIRST_SIZE, TRIAL_SHARE = 1e-3, 0.02
# interval at which the remaining time is estimated anew [s]
ESTIMATE_INTERVAL = 0.05
# share of the kinetic energy of initial velocities that supports and joints may change without a warning
INITIAL_LOSS_ALLOWED = 1e-6


def stored_times(model: Model, spec: Dynamic) -> Array:
    """Return the times of the states to be stored between the start and the end.

    Every ``interval`` or every so many fixed steps; by default about 200 states, at the ends of fixed steps, if any.
    """
    output = model.case.output
    if output.interval is not None:
        return instants(output.interval, spec.t_end)
    if spec.dt is not None:
        return instants(spec.dt, spec.t_end, output.every or max(1, round(spec.t_end / spec.dt / STATES)))
    return instants(spec.t_end / STATES, spec.t_end)


class Balance:
    """The energies of a motion and the balance of work, stored and lost energy."""

    def __init__(self, model: Model, stepper: Stepper) -> None:
        self.model, self.stepper, self.energies = model, stepper, Energies(model)
        steady = [load for load in model.loads.dead if is_constant(load.amplitude)]
        self.dead, self.varies = constant_loads(model, steady), len(steady) < len(model.loads.dead)
        self.floor = self._floor(self.dead)
        # whether laws store energy that their stress does not show
        self.stores_energy = any(pool.plan.formulation.law.extra_energy is not None for pool in model.pools)
        # [0] total at the start, [1] its largest change, [2] largest kinetic plus strain energy with the loss since the
        # state before, [3] energy of springs and moving masses at the start, [4] largest gain, [5] energy kept by
        # materials and [6] their overcounted loss at the start, [7] the loss up to the last state
        self.numbers = np.array([np.nan, 0.0, 0.0, np.nan, 0.0, 0.0, np.nan, 0.0])

    def external(self, t: float) -> Array:
        """Return the dead loads (n_full,) at t."""
        return self.model.external(t) if self.varies else self.dead

    def _floor(self, forces: Array) -> float:
        """Return the work of forces (n_full,) on the round-off of positions: smaller energies count as zero."""
        return least_motion(self.model) * largest_share(forces[:self.model.n_q], self.model.weights)

    def evaluate(self, row: Row) -> dict[str, float]:
        """Return the energies of a state, and update the error of the balance if the state is the end of a step."""
        model, (strain, kinetic), springs = self.model, self.stepper.completed(row).energy, 0.0
        d, v, *_ = row.full
        model.states[:] = row.states
        model.set_natural(row.side)
        if model.contacts:
            set_memory(model, row.turns)
        if model.springs:
            d_q = d[:model.n_q]
            model.turns.set_spring_angles(model.springs, model.e0 + d_q, d_q, model.turns.at(d, row.turned))
            of_all, worked = model.interactions.energies(d, row.side)
            strain, springs = strain + of_all, of_all if self.stepper.method.conserves else worked
        # energy kept by materials with memory, which counts as lost in the steps, and energy kept by other materials
        kept, more, over = extra_energy(model, d, row.side) if self.stores_energy else (0.0, 0.0, 0.0)
        strain += more
        dead, potential = float(self.dead @ d), self.energies.potential(d)
        own = strain - springs if self.stepper.tracks_work else strain
        if np.isnan(self.numbers[6]):
            self.numbers[6] = over
        lost = row.lost - (over - float(self.numbers[6]))
        total = kinetic + own - dead - row.work + lost
        # the drive of a mass along a body does work on it, which equals the mass's gain of energy
        carried, lifted = self.energies.carried(d, v, row.side)[0], self.energies.lifted(d, row.side)
        given = (springs if self.stepper.tracks_work else 0.0) + carried + lifted
        if np.isnan(self.numbers[0]):
            self.numbers[0], self.numbers[3], self.numbers[5] = total, given, kept
        if row.kind != INSIDE:
            floor = self._floor(self.external(row.side)) if self.varies else self.floor
            self.numbers[2] = max(self.numbers[2], floor)
            change = total - self.numbers[0]
            # energies of displacements that are round-off have no balance
            if abs(change) > floor and np.abs(model.weights * d[:model.n_q]).max(initial=0.0) > least_motion(model):
                self.numbers[1] = max(self.numbers[1], abs(change))
                self.numbers[4] = max(self.numbers[4], change)
            # what an impact has taken since the last state was there before it
            self.numbers[2] = max(self.numbers[2], kinetic + strain + max(lost - float(self.numbers[7]), 0.0))
            self.numbers[7] = lost
        work = row.work + given - float(self.numbers[3]) + dead + potential
        return {"kinetic": kinetic + carried, "strain": strain + kept, "potential": potential + lifted,
                "dissipated": lost - (kept - float(self.numbers[5])), "work": work}

    @property
    def drift(self) -> float:
        """Return the largest change of total energy less work, over the largest energy.

        The largest energy is kinetic, strain and what the last impacts took, together.
        """
        return float(self.numbers[1] / self.numbers[2]) if self.numbers[2] > 0.0 else 0.0

    @property
    def gain(self) -> float:
        """Return the largest growth of total energy less work, over the same energy as ``drift``."""
        return float(self.numbers[4] / self.numbers[2]) if self.numbers[2] > 0.0 else 0.0


class Run:
    """A dynamic solve: the motion itself and, if wanted, coarser motions for the error estimate."""

    def __init__(self, model: Model, spec: Dynamic, follows: bool = False) -> None:
        """``follows``: the entries of matrices change when bodies come near each other."""
        if spec.dt is None and spec.tolerance is None:
            spec = replace(spec, tolerance=spec.local_error)
        self.model, self.spec = model, spec
        kind = OdeStepper if spec.method in SCIPY_METHODS else Stepper
        follows = follows and kind is Stepper
        self.problem, self.signals = make_problem(model, model.numbering.in_reference if follows else None)
        fixed = spec.dt is not None and kind is Stepper
        every = 0 if fixed else model.case.output.every or 0
        self.times = np.zeros(0) if every else stored_times(model, spec)
        self.stepper = kind(model, self.problem, self.signals, spec, spec.dt or 0.0, self.times, every, follows)
        self.inverted: str | None = None
        self.intact = False
        self.balance = Balance(model, self.stepper)
        # SciPy's methods have no coarser motions; states stored every so many adaptive steps have no common times
        beside = kind is Stepper and not every
        self.estimate = Estimate(self.stepper) if beside and spec.estimate else None
        self.step_pace = Pace()
        self.state_pace: Pace | None = None
        # states in full coordinates, as the derivatives need them
        self.seen: WeakKeyDictionary[Record, Any] = WeakKeyDictionary()
        # the remaining time, and when it was estimated
        self.time_left: tuple[float | None, float] = None, -np.inf

    def states(self, checkpoint: dict[str, Array] | None = None, advance: Callable[[], list[Row]] | None = None
               ) -> Iterator[State]:
        """Yield the states, from the start or from a checkpoint; ``advance`` replaces ``Stepper.run``."""
        if checkpoint is None:
            d, v, turned = self.begin()
            if self.estimate is not None:
                self.estimate.start(d, v, turned)
            first = self.state(self.stepper.last())
            first.warnings += layers_warnings(self.model, first.d)
            self._report_initial_loss(v, first)
            yield first
        else:
            self._resume(checkpoint)
        self._start_timing()
        while not self.stepper.done:
            since = self.stepper.t
            with self.step_pace.running():
                found = (advance or self.stepper.run)()
            self.step_pace.mark(self.stepper.t, within=step_ends(self.stepper, since, found))
            for row in found:
                if row.kind == CHECK:
                    self.stepper.feedback.update_model(row)
                    self.balance.evaluate(row)
            ends = self.stepper.done
            # the last state follows with the report
            rows = [row for row in found if row.kind != CHECK and not (ends and row.t >= self.stepper.t)]
            self._look_at(rows)
            for k, row in enumerate(rows):
                began = time.monotonic()
                # after a failure the last state may be amid an event: a resumed run repeats it from an earlier one
                yield self.state(row, keep=k == len(rows) - 1 and not ends and self.stepper.failed is None)
                self._time_state(row.t, time.monotonic() - began)
        yield self._end()

    def begin(self) -> tuple[Array, Array, Array]:
        """Start the motion; return displacements, rates and turns as ``initial_motion`` does."""
        d, v, turned = initial_motion(self.model)
        self.stepper.start(d, v, turned)
        if self.spec.tolerance is not None and self.stepper.looks_ahead:
            self.stepper.set_size(self._look_ahead(d, v, turned))
        return d, v, turned

    def _start_timing(self) -> None:
        """Start measuring the time that steps, coarser motions and states take."""
        t = self.stepper.t
        self.step_pace, self.state_pace = Pace(t), None
        if self.estimate is not None:
            self.estimate.paces = [Pace(t) for _ in self.estimate.coarse]

    def _time_state(self, t: float, seconds: float) -> None:
        """Add the time spent on a state; ignore the first one, which takes longer than the rest."""
        if self.state_pace is None:
            self.state_pace = Pace(t, eases=False)
        else:
            self.state_pace.mark(t, self.state_pace.seconds + seconds)

    def _look_at(self, rows: list[Row]) -> None:
        """Compare states with those of coarser motions, and see whether elements are intact in all of them."""
        if not rows:
            return
        d = np.array([self.stepper.full(row, 1)[0] for row in rows])
        # if any element is inverted, the states are searched one by one
        self.intact = self.inverted is None and not any_inverted(self.model, d)
        if self.estimate is not None:
            steps = [row.log[-1, 0] if len(row.log) else 0.0 for row in rows]
            self.estimate.take(np.array([row.t for row in rows]), d, np.array(steps))

    def _seconds_left(self) -> float | None:
        """Return the remaining seconds, with each part continuing at its own pace, or None if unknown."""
        if self.state_pace is None:
            return None
        paces = [self.step_pace, self.state_pace]
        if self.estimate is not None and not self.estimate.failed:
            paces += self.estimate.paces[:self.estimate.levels]
        times = [pace.left(self.spec.t_end) for pace in paces]
        return None if None in times else float(sum(x for x in times if x is not None))

    def _report_initial_loss(self, v: Array, first: State) -> None:
        """Report with the first state how supports and joints changed the kinetic energy of the rates v (n_full,)."""
        energies = self.balance.energies
        given, kinetic = energies.kinetic(v) + energies.carried(first.d, v, first.side)[0], first.history["kinetic"]
        if given == 0.0:
            return
        lost = given - kinetic
        first.report["initial"] = {"given": given, "kinetic": kinetic, "lost": lost}
        if abs(lost) > INITIAL_LOSS_ALLOWED * given:
            how = "lost at t = 0, as in a plastic impact" if lost > 0.0 else "added at t = 0 by supports that move"
            first.warnings.append(f"the initial velocities violate supports, joints or contacts: {abs(lost):.6g} of "
                                  f"{given:.6g} of kinetic energy ({percent(lost / given)}) is {how}")

    def _look_ahead(self, d: Array, v: Array, turned: Array) -> float:
        """Return a displacement [m] that the motion reaches early, at most a share of the scene's size."""
        size = FIRST_SIZE * self.problem.extent
        spec = replace(self.spec, t_end=TRIAL_SHARE * self.spec.t_end)
        scout = type(self.stepper)(self.model, self.problem, self.signals, spec, 0.0, np.zeros(0),
                                   follows=self.stepper.layout is not None)
        try:
            scout.start(d, v, turned)
            scout.set_size(size)
            while not scout.done:
                scout.run()
        except ComputationError:
            return 0.0
        return min(size, scout.largest_displacement)

    def state(self, row: Row, keep: bool = False) -> State:
        """Return the full state of a row, with energies and the time left, and with a checkpoint if ``keep``."""
        d, v, a = self.stepper.full(row)
        # first, so that springs have the state of this motion: coarser motions and resumed runs share the model
        controllers = self.stepper.feedback.update_model(row)
        energies = self.balance.evaluate(row)
        if self.model.contacts:
            check_pressed_through(self.model, d, {"t": float(f"{row.t:.6g}")})
        F = self.balance.external(row.side)
        Q = self.stepper.forces(row) + F
        blocks = {name: row.log[:, k] for k, name in enumerate(LOG)}
        if self.inverted is None and not self.intact and (found := inverted(self.model, d)) is not None:
            self.inverted = f"{found} at t = {row.t:.6g}: the motion is not physical from then on"
        turned = self.model.turns.at(d, row.turned)
        state = State(row.t, d, Q, F, energies["strain"], turned, history=energies, v=v, a=a, blocks=blocks,
                      side=row.side, controllers=controllers)
        if keep:
            state.checkpoint = self.checkpoint()
        if time.monotonic() > self.time_left[1] + ESTIMATE_INTERVAL:
            self.time_left = self._seconds_left(), time.monotonic()
        state.left = self.time_left[0]
        return state

    def _end(self) -> State:
        """Return the last state, with the report and the warnings about the whole motion."""
        row = self.stepper.last()
        self._look_at([row])
        state = self.state(row)
        state.last = True
        numbers = self.stepper.s.numbers
        assert state.v is not None
        energies = self.balance.energies
        momentum = energies.momentum(state.d, state.v) + energies.carried(state.d, state.v, state.side)[1]
        px, py, h = momentum.tolist()
        state.report = {
            "method": self.stepper.method.name, "steps": int(numbers[COUNT]), "rejected": int(numbers[REJECTED]),
            "energy_drift": self.balance.drift, "momentum": {"linear": [px, py], "angular": h}}
        found = self.stepper.events.report()
        if found is not None:
            state.report["events"] = found
        self.stepper.impacts.tell(state)
        if self.inverted is not None:
            state.warnings.append(self.inverted)
        state.warnings += gain_warning(self.model, self.balance.gain)
        state.warnings += fibres_warning(self.model, self.balance.drift)
        if self.spec.dt is None:
            state.warnings += wound_warning(self.model, state.d)
        if self.estimate is not None:
            state.report["accuracy"] = self.estimate.report()
            state.warnings += self.estimate.warnings()
            state.warnings += drift_warning(self.balance.drift, state.report["accuracy"]["estimate"],
                                            "impacts" in state.report)
        return state

    def checkpoint(self) -> dict[str, Array] | None:
        """Return everything that the run needs to go on, or None for methods whose state cannot be stored."""
        out = self.stepper.checkpoint()
        if out is None:
            return None
        out["balance"] = self.balance.numbers.copy()
        out["inverted"] = np.frombuffer((self.inverted or "").encode(), dtype=np.uint8)
        if self.estimate is not None:
            out.update(self.estimate.checkpoint())
        return out

    def _resume(self, checkpoint: dict[str, Array]) -> None:
        self.stepper.resume(checkpoint)
        self.balance.numbers[:] = checkpoint["balance"]
        self.inverted = checkpoint["inverted"].tobytes().decode() or None
        if self.estimate is not None:
            self.estimate.resume(checkpoint)


def solve_dynamic(model: Model, spec: Dynamic, checkpoint: dict[str, Array] | None = None) -> Iterator[State]:
    """Yield the states of a motion, from the start or from a checkpoint.

    Raises ComputationError where it fails, and CheckpointError at once if the checkpoint is from another motion.
    """
    run = Run(model, spec, follows=True)
    if checkpoint is not None:
        check_checkpoint(checkpoint, run.checkpoint())
    return run.states(checkpoint)

