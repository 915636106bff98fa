"""Which solver a case asks for; a further solver is one entry here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..case import Case, LinearStatic, LoadedCase, LoadFactor, Static
from ..errors import Problem
from ..model.model import Model
from .state import State


def _linear(model: Model, spec: LinearStatic) -> Iterator[State]:
    from .static import solve_linear

    return solve_linear(model)


def _static(model: Model, spec: Static) -> Iterator[State]:
    if spec.method != "newton":
        from .path import solve_path

        return solve_path(model, spec)
    from .static import solve_static

    # newton ends at nothing but a load factor: the schema refuses the rest
    end = spec.until.value if isinstance(spec.until, LoadFactor) else 1.0
    return solve_static(model, spec.steps, spec.tolerance, spec.max_iterations, end)


SOLVERS: dict[type, Callable[[Model, Any], Iterator[State]]] = {LinearStatic: _linear, Static: _static}


def unavailable(loaded: LoadedCase) -> list[Problem]:
    """Return what a case asks of solvers that is not available."""
    case: Case = loaded.case
    if type(case.solver) not in SOLVERS:
        return [loaded.source.problem(("solver", "type"), "this solver is not available yet",
                                      expected="linear_static or static")]
    problems = []
    if case.accuracy is not None:
        problems.append(loaded.source.problem(("accuracy",), "solving to a wanted accuracy is not available yet",
                                              expected="no accuracy ('ancf2d convergence' estimates the error)"))
    if case.steady_rotation is not None and not isinstance(case.solver, Static):
        problems.append(loaded.source.problem(("steady_rotation",), "steady_rotation is not available yet"))
    return problems


def initial_state(model: Model) -> State:
    """Return the reference, from which static paths start."""
    zero = np.zeros(len(model.numbering.place))
    with model.timing.preload():
        d = model.displacements(zero[:model.numbering.n_unknowns], 0.0)
    return State(0.0, d, zero, zero, 0.0)


def solve(model: Model) -> Iterator[State]:
    """Yield the states of a model's solver. Raises ComputationError where the computation fails."""
    return SOLVERS[type(model.case.solver)](model, model.case.solver)


