"""Motions beside one: those of models with a number of the case changed, which begin and restart as that one does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..case import Dynamic
from ..elements.shape import Array
from ..errors import CaseError
from ..kernels import along
from ..kernels.bodies import addresses
from ..kernels.lowlevel.records import Record
from ..model.breakpoints import Piece
from ..model.groups import of_elements, unlike
from ..model.model import Model
from .breaks import pass_break
from .differences import FORWARD, LOWER, UnsuitedError
from .dynamic import Run
from .linear_steps import Change
from .methods import MAKERS
from .schemes import INTEGRATORS, default_method
from .stepping import Stepper

CENTRAL, NEAR = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0, np.array([0.0, -0.5, 0.0, 0.5, 0.0])
# a number's models: those of differences about it, or to one side of it
SIDES = {0: (-2, -1, 0, 1, 2), 1: (0, 1, 2, 3, 4), -1: (0, -1, -2, -3, -4)}

# the model where the number is changed by h
Varied = Callable[[float], Model]


def unsuited(model: Model) -> str:
    """Return why the steps of a motion have no derivative, empty where they have one."""
    spec = model.case.solver
    if not isinstance(spec, Dynamic):
        return "the solver has no time steps"
    scheme = INTEGRATORS[spec.method or default_method(model)]
    if scheme.name not in MAKERS or scheme.conserves:
        return f"the steps of {scheme.name} are not differentiated"
    if model.remembers:
        return "materials remember the way to a state"
    if model.contacts:
        return "contact begins and ends at times that depend on the case"
    if model.feedback.rank or model.feedback.conditions:
        return "signals or events answer the motion"
    if model.case.initial is not None and model.case.initial.from_ not in ("rest", "static"):
        return "the motion goes on from a file"
    return ""


class Beside:
    """A number of the case: models beside it, h apart, and motions of these that start as the first one does.

    ``weights`` (2, sides) give differences of fourth and of lower order of what the sides have.
    """

    def __init__(self, at: Varied, h: float, spec: Dynamic, pieces: Sequence[Piece]) -> None:
        self.at, self.h = at, h
        side = self._side(at, h)
        table = np.array([CENTRAL, NEAR]) / h if side == 0 else np.array([FORWARD, LOWER]) / (h * side)
        used = np.flatnonzero(table.any(axis=0))
        self.weights, self.steps = table[:, used], [SIDES[side][k] * h for k in used.tolist()]
        self.runs = [Run(at(step), spec) for step in self.steps]
        if any(list(run.stepper.pieces) != list(pieces) for run in self.runs):
            raise UnsuitedError("the times at which signals have corners change with the number")
        self.problems = _acting(self.runs)
        self._start: Change | None = None

    @staticmethod
    def _side(at: Varied, h: float) -> int:
        """Return to which side models can be had: 0 of both, else the sign."""
        for side in (0, 1):
            try:
                for k in SIDES[side]:
                    # differences about the number do not need its own model
                    if k or side:
                        at(k * h)
                return side
            except CaseError:
                continue
        for k in SIDES[-1]:
            at(k * h)
        return -1

    def begin(self) -> Change:
        """Return the change of the start of the motion (n, 2); motions are taken back to it."""
        for run in self.runs:
            run.stepper.enter(0)
        if self._start is None:
            self._start = self._differences([_begun(run) for run in self.runs])
        return self._start

    def pass_break(self, base: Stepper, piece: int) -> Change:
        """Return the change (n, 2) that the number makes behind a break of a motion that is the same before it."""
        return self._differences([_behind_break(run.stepper, base, piece, None, 0.0) for run in self.runs])

    def _differences(self, found: Sequence[tuple[Array, Array, Array]]) -> Change:
        """Return the derivatives of z, v and a (n, 2) from what the sides have."""
        z, v, a = (np.tensordot(self.weights, np.array(one), 1).T for one in zip(*found, strict=True))
        return Change(z, v, a, a)

    def residuals(self, at: Record, shape: tuple[int, int]) -> Array:
        """Return dR/dp (2, m, n) at the states of the first motion."""
        out, R = np.zeros((2, *shape)), np.zeros(shape)
        for run, p, weights in zip(self.runs, self.problems, self.weights.T, strict=True):
            along.residuals(p, run.stepper.w, at, R)
            out += weights[:, None, None] * R
        return out


def _acting(runs: Sequence[Run]) -> list[Record]:
    """Return the problems of runs, without the elements whose forces are the same in all: differences have none."""
    problems, groups = [run.stepper.p for run in runs], [run.model.groups for run in runs]
    first = problems[0].values
    for p, own in zip(problems[1:], groups[1:], strict=True):
        # elements are the same, and move alike
        names = ["dependents", "indptr", "index", "value", "motion_coord", "motion_factor", "motion_signal", "tau"]
        names += ["programs"] if len(first.motion_coord) else []
        if not all(_same(getattr(first, name), getattr(p.values, name)) for name in names):
            return problems
        if not all(_same(a.values.dofs, b.values.dofs) for a, b in zip(groups[0], own, strict=True)):
            return problems
    found: list[list[Record]] = [[] for _ in runs]
    tau = []
    for k, alike in enumerate(zip(*groups, strict=True)):
        which = unlike(alike)
        if len(which):
            tau.append(float(first.tau[k]))
            for own, group in zip(found, alike, strict=True):
                own.append(of_elements(group, which))
    return [Record(p.values._replace(groups=addresses(own), tau=np.array(tau)), own)
            for p, own in zip(problems, found, strict=True)]


def _same(a: Any, b: Any) -> bool:
    """Whether two fields of a problem are equal."""
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return np.array_equal(a, b)


def _begun(run: Run) -> tuple[Array, Array, Array]:
    run.begin()
    return _state(run.stepper.s)


def _state(s: Any) -> tuple[Array, Array, Array]:
    return s.z.copy(), s.v.copy(), s.a.copy()


def _behind_break(stepper: Stepper, base: Stepper, piece: int, change: Change | None, step: float
                  ) -> tuple[Array, Array, Array]:
    """Return z, v and a behind a break of ``base``, of a motion that is there before it, or ``change`` away."""
    s = stepper.s
    for name in ("z", "v", "a"):
        own, of = getattr(s, name), getattr(base.s, name)
        own[:] = of if change is None else of + step * getattr(change, name)[:, 0]
    s.numbers[:], s.turned[:] = base.s.numbers, base.s.turned
    stepper.p.points.mem[:], stepper.p.sliding.memory[:] = base.p.points.mem, base.p.sliding.memory
    pass_break(stepper, piece)
    return _state(s)


def carried(stepper: Stepper, base: Stepper, change: Change, piece: int, step: float) -> Change:
    """Return what a change (n, k) of a motion before a break is behind it; ``stepper`` is of the same model.

    By differences over ``step`` [m] of the largest displacement that changes.
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
