"""Motions of models with a number of the case changed, with starts and breaks like those of the original motion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ...case import Dynamic, Initial
from ...elements.shape import Array
from ...errors import CaseError
from ...model.model import Model
from ..motion.breaks import pass_break
from ..motion.dynamic import Run
from ..motion.integrators import INTEGRATORS, default_method
from ..motion.own_integrators import MAKERS
from ..motion.stepping import Stepper
from .differences import FORWARD, LOWER, Quotient, UnsuitedError
from .linear_steps import Change
from .varied_equations import Differing

CENTRAL, NEAR = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0, np.array([0.0, -0.5, 0.0, 0.5, 0.0])
# models of a number for differences about it, or to one side of it; the same with two models and that of the case
SIDES = {0: (-2, -1, 0, 1, 2), 1: (0, 1, 2, 3, 4), -1: (0, -1, -2, -3, -4)}
FEW = {0: (-1, 0, 1), 1: (0, 1, 2), -1: (0, -1, -2)}
# differences of second order by two models, and half of the second difference relative to the step
TWO = {0: np.array([[-0.5, 0.0, 0.5], [0.5, -1.0, 0.5]]), 1: np.array([[-1.5, 2.0, -0.5], [-0.5, 1.0, -0.5]])}

# returns the model with the number changed by h
ModelAt = Callable[[float], Model]


def why_unsuited(model: Model) -> str:
    """Return why the steps of a motion have no derivative, empty if they have one."""
    spec = model.case.solver
    if not isinstance(spec, Dynamic):
        return "the solver has no time steps"
    method = INTEGRATORS[spec.method or default_method(model)]
    if method.name not in MAKERS or method.conserves:
        return f"the steps of {method.name} are not differentiated"
    if model.remembers:
        return "materials depend on the load history"
    if model.contacts:
        return "the times of contact depend on the case"
    if model.feedback.rank or model.feedback.conditions:
        return "signals or events depend on the motion"
    if any(getattr(patch, "breaks", ()) for patch in model.interactions.points):
        return "the times at which one-sided springs and tendons act depend on the case"
    held = (item.active for item in (*model.case.boundary_conditions, *model.case.joints))
    if any(active is not None and active.times[0] > 0.0 for active in held):
        return "a support or joint begins at the current position of the motion"
    if model.case.initial is not None and model.case.initial.from_ not in ("rest", "static"):
        return "the motion continues from a file"
    return ""


class Together(ABC):
    """Derivatives by several numbers that are found at once and stored."""

    found: dict[ModelAt, Quotient | Exception]

    @abstractmethod
    def find(self, numbers: Sequence[tuple[ModelAt, float]]) -> None:
        """Find the derivatives by numbers with their steps, or why there are none."""

    def prepare(self, numbers: Sequence[tuple[ModelAt, float]]) -> None:
        """Find the derivatives in advance."""
        self.find(numbers)

    def slope(self, at: ModelAt, h: float) -> Quotient:
        """Return the derivatives by a number. Raises UnsuitedError, CaseError, ComputationError."""
        if at not in self.found:
            self.find([(at, h)])
        found = self.found[at]
        if isinstance(found, Exception):
            raise found
        return found


class VariedNumber:
    """A number of the case: models with the number varied in steps of h, and their motions.

    ``weights`` (2, sides) give differences of fourth and of lower order of the models' values; with ``few`` sides, of
    second order and how much they change over h.
    """

    def __init__(self, at: ModelAt, h: float, run: Run, few: bool = False) -> None:
        self.at, self.h, self.spec, self.pieces = at, h, run.spec, run.stepper.pieces
        sides: dict[int, tuple[int, ...]] = dict(FEW if few else SIDES)
        side = self._side(at, h, sides)
        table = TWO[abs(side)] if few else np.array([FORWARD, LOWER] if side else [CENTRAL, NEAR])
        used = np.flatnonzero(table.any(axis=0))
        self.weights, self.steps = table[:, used] / (h * (side or 1)), [sides[side][k] * h for k in used.tolist()]
        models = [run.model if few and step == 0.0 else at(step) for step in self.steps]
        self.differing = Differing(run, models, self.weights)
        self._start: Change | None = None
        if run.stepper.events or run.stepper.moving:
            # the times of events, or of points passing nodes, may depend on this number: check the motions now
            self.runs  # noqa: B018

    @cached_property
    def runs(self) -> list[Run]:
        """Motions of the models."""
        runs = [Run(model, self.spec) for model in self.differing.models]
        if any(list(run.stepper.pieces) != list(self.pieces) for run in runs):
            raise UnsuitedError("the times of corners of signals depend on the number")
        return runs

    @staticmethod
    def _side(at: ModelAt, h: float, sides: dict[int, tuple[int, ...]]) -> int:
        """Return the side on which models can be built: 0 for both, else the sign."""
        for side in (0, 1):
            try:
                for k in sides[side]:
                    # the model of the number itself is not needed, or known
                    if k or (side and len(sides[0]) > 3):
                        at(k * h)
                return side
            except CaseError:
                continue
        for k in sides[-1]:
            at(k * h)
        return -1

    def begin(self) -> Change:
        """Return the derivative of the start of the motion (n, 2), and reset the signals of the motions to it."""
        for run in self.runs:
            run.stepper.enter(0)
        if self._start is None:
            self._start = self._differences([_begun(run) for run in self.runs])
        return self._start

    def pass_break(self, base: Stepper, piece: int) -> Change:
        """Return the direct effect (n, 2) of the number on the state after a break, for the same state before it."""
        return self._differences([_behind_break(run.stepper, base, piece, None, 0.0) for run in self.runs])

    def _differences(self, found: Sequence[tuple[Array, Array, Array]]) -> Change:
        """Return the derivatives of z, v and a (n, 2) from the values of the models."""
        z, v, a = (np.tensordot(self.weights, np.array(one), 1).T for one in zip(*found, strict=True))
        return Change(z, v, a, a)


def _begun(run: Run) -> tuple[Array, Array, Array]:
    run.begin()
    return _state(run.stepper.s)


def _state(s: Any) -> tuple[Array, Array, Array]:
    return s.z.copy(), s.v.copy(), s.a.copy()


def _behind_break(stepper: Stepper, base: Stepper, piece: int, change: Change | None, step: float
                  ) -> tuple[Array, Array, Array]:
    """Return z, v and a after a break of ``base``, for its state before it plus ``step`` times ``change``."""
    s = stepper.s
    stepper.enter(piece - 1)
    for name in ("z", "v", "a"):
        own, of = getattr(s, name), getattr(base.s, name)
        own[:] = of if change is None else of + step * getattr(change, name)[:, 0]
    s.numbers[:], s.turned[:] = base.s.numbers, base.s.turned
    stepper.p.points.mem[:], stepper.p.sliding.memory[:] = base.p.points.mem, base.p.sliding.memory
    pass_break(stepper, piece)
    return _state(s)


def carried(stepper: Stepper, base: Stepper, change: Change, piece: int, step: float) -> Change:
    """Return the change (n, k) of a motion after a break from that before it; ``stepper`` is of the same model.

    By differences over ``step`` [m] of the largest displacement in the change.
    """
    columns = []
    for k in range(change.z.shape[1]):
        one = change.only(slice(k, k + 1))
        size = max(float(np.max(base.p.weights * np.abs(one.z[:, 0]), initial=0.0)),
                   float(np.max(base.p.weights * np.abs(one.v[:, 0]), initial=0.0)) * base.spec.t_end)
        h = step / size if size > 0.0 else 1.0
        found = [_behind_break(stepper, base, piece, one, q * h) for q in SIDES[0] if q]
        weights = CENTRAL[[0, 1, 3, 4]] / h
        z, v, a = (np.tensordot(weights, np.array(x), 1)[:, None] for x in zip(*found, strict=True))
        columns.append(Change(z, v, a, a))
    return joined(columns)


def joined(parts: Sequence[Change]) -> Change:
    """Return the changes of several numbers side by side."""
    return Change(*(np.concatenate([getattr(part, name) for part in parts], axis=1)
                    for name in ("z", "v", "a", "own")))


def rests(run: Run) -> bool:
    """Return whether a motion, and those of varied models, start at rest in the reference without prescribed motion."""
    initial = run.model.case.initial or Initial()
    said: list[Any] = [initial, *initial.bodies.values()]
    moved = any(one.velocity is not None or one.rotation_rate is not None for one in said)
    return initial.from_ == "rest" and not moved and not len(run.problem.motion_coord)
