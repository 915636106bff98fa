"""Derivatives of a few goals of a motion by any number of parameters, by following the motion backwards.

For each number, the change of the residuals is multiplied by the virtual displacements of
``solvers.derivatives.transposed_steps``. This needs two models, and only the parts of them that the number changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...case import Initial
from ...elements.shape import Array
from ...errors import CaseError, ComputationError
from ...kernels.lowlevel.records import Record
from ...model.model import Model
from ..linear import unknowns_to_coordinates
from ..motion.dynamic import Run
from ..motion.initial import asked_rates, initial_rates
from ..motion.stepping import Stepper
from ..state import State
from .differences import Quotient, UnsuitedError
from .linear_steps import Change
from .motion_states import NEWTON
from .readings import Goals, Readings
from .transposed_steps import PARTS, RecordedMotion, StepLengthError
from .varied_motions import ModelAt, Together, VariedNumber, rests

# step relative to that of fourth-order differences, and the largest second difference relative to the first (the error
# is its square)
SHORT, STRAIGHT = 0.02, 5e-5
# largest number of attempts with shorter steps
TRIES = 3
# relative round-off of derivatives by differences with the first step
ROUND_OFF = 3e-11
# relative round-off of goals; and the multiple of it that is no change, as each goal results from a few operations
EPSILON, FEW = 2.2e-16, 4.0


def recorded_motion(model: Model, all_states: bool, lengths: list[float]) -> tuple[RecordedMotion, list[State]]:
    """Make a motion with the tightest tolerance of Newton's method at which fixed steps keep their ``lengths``.

    Raises UnsuitedError.
    """
    for tolerance in NEWTON:
        last = tolerance == NEWTON[-1]
        motion = RecordedMotion(model, all_states, tolerance, None if last else lengths)
        try:
            return motion, list(motion.states())
        except StepLengthError:
            continue
        except ComputationError as found:
            if last:
                raise UnsuitedError(f"its steps cannot be repeated: {found.failure.reason}") from None
    raise AssertionError


class GoalDerivatives:
    """Derivatives of goals by several numbers."""

    def __init__(self) -> None:
        self.all: list[GoalDerivative] = []

    def add_states(self, at: Record, window: Array, lam: Array) -> None:
        """Add the contribution of the residuals at states."""
        for one in self.all:
            one.add_states(at, window, lam)

    def add_break(self, stepper: Stepper, piece: int, end: Change, at: Record | None, mu: Array) -> None:
        """Add the contribution of a break."""
        window = stepper.p.programs.window.copy()
        for one in self.all:
            if at is None or one.number.differing.changes_coordinates:
                one.add_change(one.number.pass_break(stepper, piece), end)
            else:
                one.add_states(at, window, mu[None])


class GoalDerivative:
    """The derivative of goals (k,) by a number, and the summed magnitudes of its contributions (2, k)."""

    def __init__(self, number: VariedNumber, k: int) -> None:
        self.number, self.value, self.sizes = number, np.zeros(k), np.zeros((2, k))

    def add_states(self, at: Record, window: Array, lam: Array) -> None:
        """Add the contribution of the residuals at states."""
        self.add(-self.number.differing.works(at, window, lam))

    def add(self, parts: Array) -> None:
        """Add differences (2, m, k); the second show how much the first vary over a step."""
        self.value += parts[0].sum(axis=0)
        self.sizes += np.abs(parts).sum(axis=1)

    def add_change(self, found: Change, bar: Change) -> None:
        """Add the contribution of a change (n, 2) of a state, with derivatives ``bar`` (n, k) of the goals by it."""
        parts = [getattr(found, name).T @ getattr(bar, name) for name in PARTS]
        self.add(np.sum(parts, axis=0)[:, None])

    def nonlinearity(self, round_off: Array) -> float:
        """Return the relative nonlinearity over a step, beyond the round-off (k,) of the goals."""
        shares = np.maximum(self.sizes[1] - round_off, 0.0) / np.where(self.sizes[0] > 0.0, self.sizes[0], 1.0)
        return float(shares.max(initial=0.0))


@dataclass
class Start:
    """The derivatives of the goals by the start (n, k).

    If accelerations follow from a state at rest, or from given rates: by its residuals with virtual displacements
    ``mu``, and by ``rates``. The rates satisfy M v = T^T M V with V those asked for, so that a change M' contributes
    ``lifted``^T M' ``left``: ``left`` (n_q,) is V - T v, ``lifted`` (n_q, k) T M^-1 rates.
    """

    all: Change
    mu: Array | None
    rates: Array | None
    lifted: Array | None = None
    left: Array | None = None


class MotionAdjoint(Together):
    """Derivatives of goals of a motion that has been made, with its states, by numbers. Raises UnsuitedError."""

    def __init__(self, motion: RecordedMotion, states: Sequence[State], goals: Goals) -> None:
        self.motion, self.model = motion, motion.run.model
        self.found: dict[ModelAt, Quotient | Exception] = {}
        self.base, self.first = Run(self.model, motion.run.spec), dict[ModelAt, float]()
        self.states = states if motion.all_states else [states[0], states[-1]]
        self.readings = Readings(self.model, goals, self.states, motion.free)
        self.values, self.bars = self.readings.values, self.readings.bars()
        # if virtual displacements are stored, the start is known, and derivatives can be found number by number
        self.start: Start | None = None
        if self.motion.has_room(self.bars[-1].z.shape[1]):
            self.start = self._start_of(self.motion.derivatives_by_start(self.bars, GoalDerivatives()))

    def prepare(self, numbers: Sequence[tuple[ModelAt, float]]) -> None:
        """Find the derivatives by several numbers at once, if they cannot be found one by one."""
        if self.start is None:
            self.find(numbers)

    def find(self, numbers: Sequence[tuple[ModelAt, float]]) -> None:
        """Find the derivatives, with shorter steps of the differences where necessary."""
        todo = [(at, h * SHORT) for at, h in numbers]
        for k in range(TRIES):
            todo = self._once(todo, last=k == TRIES - 1)
            if not todo:
                break

    def _once(self, todo: Sequence[tuple[ModelAt, float]], last: bool) -> list[tuple[ModelAt, float]]:
        """Find derivatives; return the numbers whose steps are too long, with shorter ones."""
        sums, k = GoalDerivatives(), self.bars[-1].z.shape[1]
        for at, h in todo:
            self.first.setdefault(at, h)
            try:
                sums.all.append(GoalDerivative(VariedNumber(at, h, self.base, few=True), k))
            except (CaseError, ComputationError, UnsuitedError) as found:
                self.found[at] = found
        if not sums.all:
            return []
        start, again = self.start, []
        if start is None:
            start = self._start_of(self.motion.derivatives_by_start(self.bars, sums))
        else:
            self.motion.report_stored(sums)
        for one in sums.all:
            number = one.number
            try:
                self._begin(one, start)
                one.add(self.readings.direct_differences(number, self.motion.rows, self.motion.windows)[:, None])
            except (CaseError, ComputationError, UnsuitedError) as found:
                self.found[number.at] = found
                continue
            noise = ROUND_OFF * self.first[number.at] / number.h
            of_reading = EPSILON / number.h * np.abs(self.values)
            nonlinearity = one.nonlinearity(FEW * of_reading)
            # factor x on the step that minimises (bent x)^2 + noise / x
            shorter = (0.5 * noise / max(nonlinearity, STRAIGHT)**2) ** (1 / 3)
            if nonlinearity > STRAIGHT and shorter < 0.5 and not last:
                again.append((number.at, number.h * shorter))
                continue
            error = one.sizes[0] * (nonlinearity**2 + self.motion.equation_error + noise) + of_reading
            self.found[number.at] = Quotient(one.value, error, number.h)
        return again

    def _start_of(self, start: Change) -> Start:
        """Return the derivatives by the start, given those by its state."""
        motion, initial = self.motion, self.model.case.initial or Initial()
        if not motion.free.all() or len(motion.stepper.p.motion_coord) or initial.from_ != "rest":
            return Start(start, None, None)
        motion.stepper.enter(0)
        mu = motion.by_mass.solve(start.a + start.own)
        if rests(self.base):
            return Start(start, mu, None)
        rates, T = motion.consistent(motion.begun, mu, start).v, unknowns_to_coordinates(self.model)
        left = asked_rates(self.model) - T @ initial_rates(self.model)
        return Start(start, mu, rates, T @ motion.by_mass.solve(rates), left)

    def _begin(self, one: GoalDerivative, start: Start) -> None:
        """Add the contribution of the start of the motion to the derivative by a number."""
        if start.mu is None:
            one.add_change(one.number.begin(), start.all)
            return
        one.add_states(self.motion.begun, self.motion.window, start.mu[None])
        if start.rates is None or start.lifted is None or start.left is None:
            return
        differing = one.number.differing
        if differing.starts_alike:
            by_rates = differing.mass_between(start.lifted, start.left)
        else:
            sides = zip(one.number.weights[0].tolist(), differing.models, strict=True)
            by_rates = sum(weight * initial_rates(model) for weight, model in sides if weight) @ start.rates
        one.add(np.array([by_rates, np.zeros_like(by_rates)])[:, None])
