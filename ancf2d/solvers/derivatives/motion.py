"""Derivatives of a motion by numbers of its case, with suitable steps of the differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...case import Dynamic
from ...elements.shape import Array
from ...errors import CaseError, ComputationError
from ...model.breakpoints import piece_at
from ...model.model import Model
from ..motion.dynamic import Run
from ..state import Row, State
from .differences import SHORTER, SMOOTH, TRIES, Quotient, UnsuitedError
from .motion_states import NEWTON, OF_FORCES, MotionWithDerivatives, lengths_of, lower_order_error
from .readings import CLOSE, Goals, Readings
from .varied_motions import ModelAt, Together, VariedNumber

# if differences of lower order are this close, relative to the largest change, the motion is not repeated: the error is
# the square
SMOOTH_ENOUGH = 2e-4
# number of steps of the motion used to check the steps of the differences
FIRST_STEPS = 16


class Motion(Together):
    """The derivatives of the ``states`` of a motion by numbers of its case; of ``all_states``, or only of the last one.

    If ``goals`` are given and their derivatives follow from those of the states, there are ``readings``, and ``slope``
    returns the derivatives of the goals.
    """

    def __init__(self, model: Model, states: Sequence[State], all_states: bool, goals: Goals | None = None) -> None:
        spec = model.case.solver
        assert isinstance(spec, Dynamic)
        # without coarser motions for an error estimate
        self.spec = replace(spec, estimate=False)
        self.model, self.all_states = model, all_states
        # fixed steps have the lengths that they had in the run
        self.lengths = lengths_of(states)
        self.found: dict[ModelAt, Quotient | Exception] = {}
        self.runs: dict[int, Run] = {}
        self.rows: list[Row] = []
        # shared by all attempts: tolerances not yet excluded, and varied models by number and step
        self.tolerances, self.varied = list(NEWTON), dict[tuple[ModelAt, float], VariedNumber | Exception]()
        self.run = Run(model, self.spec)
        self.negligible = CLOSE if goals is None else goals.negligible
        self.readings: Readings | None = None
        if goals is not None:
            self.readings = Readings(model, goals, states if all_states else states[-1:],
                                     np.array(self.run.problem.coordinate))

    def find(self, numbers: Sequence[tuple[ModelAt, float]]) -> None:
        """Find the derivatives by several numbers at once, with shorter steps of the differences where necessary.

        The first steps of the motion usually suffice to choose these, and no choice is made if little is needed.
        """
        todo, precise = list(numbers), self.negligible <= CLOSE
        for k in range(0 if precise else TRIES - 1, 2 * TRIES - 1):
            if not todo:
                break
            first = k < TRIES - 1
            enough = SMOOTH if first else max(SMOOTH_ENOUGH, self.negligible**0.5)
            shares = self._shares(todo) if first else self._once(todo)
            shorter = [(at, h * SHORTER) if share > enough else (at, h)
                       for (at, h), share in zip(todo, shares, strict=True)]
            todo = shorter if first else [new for new, old in zip(shorter, todo, strict=True) if new != old]
        self.varied.clear()

    def _numbers(self, todo: Sequence[tuple[ModelAt, float]]) -> tuple[dict[int, VariedNumber], dict[int, Exception]]:
        """Return the numbers that can be varied, and the reasons why others cannot, by their places."""
        numbers, refused = dict[int, VariedNumber](), dict[int, Exception]()
        for k, (at, h) in enumerate(todo):
            if (at, h) not in self.varied:
                try:
                    self.varied[at, h] = VariedNumber(at, h, self.run)
                except (CaseError, ComputationError, UnsuitedError) as found:
                    self.varied[at, h] = found
            one = self.varied[at, h]
            if isinstance(one, VariedNumber):
                numbers[k] = one
            else:
                refused[k] = one
        return numbers, refused

    def _made(self, todo: Sequence[tuple[ModelAt, float]], steps: int | None
              ) -> tuple[MotionWithDerivatives, dict[int, VariedNumber], dict[int, Exception]]:
        """Make the motion, or its first steps, with the tightest possible tolerance; return it, numbers, refusals."""
        while True:
            last = len(self.tolerances) == 1
            motion = MotionWithDerivatives(self.model, self.spec, self.all_states, self.tolerances[0],
                                           None if last else self.lengths, self.negligible)
            numbers, refused = self._numbers(todo)
            try:
                if not numbers or motion.make(list(numbers.values()), steps):
                    return motion, numbers, refused
            except UnsuitedError as found:
                return motion, numbers, refused | dict.fromkeys(numbers, found)
            except ComputationError as found:
                reason = UnsuitedError(f"its steps cannot be repeated: {found.failure.reason}")
                if last:
                    return motion, numbers, refused | dict.fromkeys(numbers, reason)
            del self.tolerances[0]

    def _shares(self, todo: Sequence[tuple[ModelAt, float]]) -> list[float]:
        """Return the relative error of differences of lower order over the first steps."""
        motion, numbers, refused = self._made(todo, FIRST_STEPS)
        shares = [0.0] * len(todo)
        for k, rough in zip(numbers, motion.rough.tolist(), strict=False):
            shares[k] = 0.0 if k in refused else rough
        return shares

    def _once(self, todo: Sequence[tuple[ModelAt, float]]) -> list[float]:
        """Find derivatives; return the relative difference of those of lower order from them."""
        motion, numbers, refused = self._made(todo, None)
        shares = [0.0] * len(todo)
        for k, why in refused.items():
            self.found.setdefault(todo[k][0], why)
        self.rows = motion.rows or self.rows
        if self.readings is not None and not self.readings.linear_in(self.rows):
            self.readings = None
        weights, one, of_forces = motion.stepper.p.weights, np.ones(len(motion.free)), 1.0 / OF_FORCES
        for column, (k, number) in enumerate(numbers.items()):
            if k in refused:
                continue
            both = np.array(motion.changes)[..., 2 * column:2 * column + 2]
            value, gap = both[..., 0], np.abs(both[..., 0] - both[..., 1])
            shares[k] = lower_order_error(weights, both[:, 0])
            # for z, v and a, weighted as in ``MotionWithDerivatives``
            share = motion.equation_error[column]
            off = share * np.array([np.where(motion.free, 1.0, of_forces), one, of_forces * one])
            error = gap * min(shares[k], 1.0) + off * np.abs(value)
            best = self.found.get(number.at)
            found = Quotient(value.ravel(), error.ravel(), number.h) if self.readings is None else (
                self.readings.change(number, motion.rows, self._windows(motion.rows), value, error))
            if not isinstance(best, Quotient) or found.error.max(initial=0.0) < best.error.max(initial=0.0):
                self.found[number.at] = found
                self.runs |= {id(run.model): run for run in number.__dict__.get("runs", ())}
        return shares

    def _windows(self, rows: Sequence[Row]) -> list[Array]:
        """Return the windows between breaks that contain the states."""
        return [np.array(piece_at(self.run.stepper.pieces, row.side)[:2]) for row in rows]

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the states of a varied model, for a change of all unknowns, rates and accelerations."""
        if id(model) not in self.runs:
            self.runs[id(model)] = Run(model, self.spec)
        run = self.runs[id(model)]
        n = len(run.stepper.p.coordinate)
        out = []
        for row, (z, v, a) in zip(self.rows, change.reshape(len(self.rows), 3, n), strict=True):
            moved = replace(row, z=row.z + z, v=row.v + v, a=row.a + a, full=())
            out.append(run.state(moved))
        return out
