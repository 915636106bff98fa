"""Derivatives of what a run finds with respect to numbers of its case."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..case import Dynamic, Goal, LoadedCase, Static, load_case_text
from ..case.numbers import Variable, variable_at
from ..elements.shape import Array
from ..errors import ComputationError
from ..model.model import Model
from .differences import Quotient, derivative
from .goal import for_study
from .record import Progress
from .run import describe_goal, quantity, run_case, vocabulary

# step of a number beside its size
STEP = 2e-3
# equilibria of states that are compared with each other, relative to the displacements
TIGHT = 1e-12

# what is differentiated: numbers (m,) of the states that a model goes through
Watch = Callable[[Model, Sequence[Any]], Array]


@dataclass
class Derivatives:
    """Numbers (m,) that runs find, and their derivatives (m, n) to n numbers of a case.

    ``errors`` (m, n) estimate how far the derivatives are off; ``methods`` (n,) tell how each was found.
    """

    variables: list[Variable]
    values: Array
    jacobian: Array
    errors: Array
    methods: list[str]


def gradient(loaded: LoadedCase, goals: Iterable[Goal] | Watch, paths: Sequence[str],
             progress: Progress | None = None) -> tuple[Array, Array]:
    """Return the values (m,) of goals, and their derivatives (m, n) to the numbers of a case at some paths.

    ``goals`` are goals as a case has them, or a function of a model and the states of its run that returns the values.
    Raises CaseError where a path leads to no number that can vary, ComputationError where a run fails.
    """
    found = derivatives(loaded, goals, [variable_at(loaded, path) for path in paths], progress)
    return found.values, found.jacobian


def derivatives(loaded: LoadedCase, goals: Iterable[Goal] | Watch, variables: Sequence[Variable],
                progress: Progress | None = None) -> Derivatives:
    """Return what ``gradient`` does with what is known of it."""
    watch = goals if callable(goals) else goal_values(list(goals))
    runs = _Runs(loaded, watch, progress or Progress())
    values = runs.at(None, 0.0)
    found = [runs.differences(variable) for variable in variables]
    shape = len(variables), len(values)
    columns, errors = (np.array(rows).reshape(shape).T for rows in ([q.value for q in found], [q.error for q in found]))
    return Derivatives(list(variables), values, columns, errors, ["differences of runs"] * len(variables))


def goal_values(goals: Sequence[Goal]) -> Watch:
    """Return the values of goals, of the last state of a run, as a function of model and states."""
    def watch(model: Model, states: Sequence[Any]) -> Array:
        summary = last_summary(model, states, any(g.reaction is not None for g in goals))
        found = [quantity(goal, summary) for goal in goals]
        for goal, value in zip(goals, found, strict=True):
            if value is None:
                raise ComputationError(f"the solver does not compute {describe_goal(goal)}")
        return np.array(found, dtype=float)
    return watch


def last_summary(model: Model, states: Sequence[Any], reacts: bool = True) -> dict[str, Any]:
    """Return what goals are of, at the last state of a run."""
    from ..solvers.post import Observer, energies, reactions

    state = states[-1]
    out: dict[str, Any] = {"probes": Observer(model).observe(state)}
    out["energy"] = dict(state.history) if isinstance(model.case.solver, Dynamic) else energies(model, state)
    if reacts:
        out["reactions"] = reactions(model, state)
    for one in states:
        out.update(one.report)
    return out


class _Runs:
    """What a case's run finds where one of its numbers is another."""

    def __init__(self, loaded: LoadedCase, watch: Watch, progress: Progress) -> None:
        self.loaded, self.watch, self.progress = _tight(for_study(loaded)), watch, progress
        self.model: Model | None = None

    def at(self, variable: Variable | None, h: float) -> Array:
        """Return what is watched with a number changed by h. Raises CaseError and ComputationError."""
        loaded = self.loaded if variable is None else varied(self.loaded, variable, h)
        states: list[Any] = []
        outcome = run_case(_tight(for_study(loaded)), progress=replace(self.progress, state=states.append))
        if outcome.failure is not None:
            raise outcome.failure
        self.model = outcome.model
        return self.watch(outcome.model, states)

    def differences(self, variable: Variable) -> Quotient:
        """Return the derivative to a number by runs beside it. Raises ComputationError where their meshes differ."""
        assert self.model is not None
        size = _size(variable, self.model.extent)
        meshes: dict[Any, float] = {}

        def run(h: float) -> Array:
            found = self.at(variable, h)
            assert self.model is not None
            meshes[mesh_of(self.model)] = h
            if len(meshes) > 1 and h != 0.0:
                raise ComputationError(f"the mesh changes with {variable.path}: there is no derivative at "
                                       f"{variable.value:.9g}", advice="another value, or element: {nodes: regular}")
            return found
        return derivative(run, STEP * size)


def _tight(loaded: LoadedCase) -> LoadedCase:
    """Return a case whose equilibria are found to the last digits."""
    solver = loaded.case.solver
    if not isinstance(solver, Static):
        return loaded
    tolerance = min(solver.tolerance or TIGHT, TIGHT)
    return replace(loaded, case=replace(loaded.case, solver=replace(solver, tolerance=tolerance)))


def varied(loaded: LoadedCase, variable: Variable, h: float) -> LoadedCase:
    """Return a case with one of its numbers changed by h. Raises CaseError where that is no case."""
    options = (*loaded.overrides, variable.override(variable.value + h))
    return load_case_text(loaded.text, loaded.source.file, options, vocabulary(), os.path.dirname(loaded.source.file))


def _size(variable: Variable, extent: float) -> float:
    """Return what changes of a number are small beside: its value, that of its list, the model's size."""
    return abs(variable.value) or variable.beside or extent


def mesh_of(model: Model) -> tuple[Any, ...]:
    """Return what two models have in common whose unknowns stand for the same."""
    bodies = tuple((name, m.plan.element.name, m.plan.formulation.name, tuple(p.count for p in m.plan.pieces), m.n_dofs)
                   for name, m in model.meshes.items())
    return bodies, model.numbering.free.tobytes(), model.numbering.dependent.tobytes()


def relative(derivative: float, value: float, goal: float) -> float | None:
    """Return the elasticity: the relative change of a goal by a relative change of a number, None where either is 0."""
    return derivative * value / goal if value and goal and math.isfinite(goal) else None
