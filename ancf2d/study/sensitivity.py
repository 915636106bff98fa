"""Sensitivity of the goal of a case to its numbers: a table sorted by influence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..case import Goal, LoadedCase
from ..case.numbers import CaseNumber, numbers_at, numbers_of
from ..errors import UNSOLVED, CaseError, Problem, verdict
from ..model.model import Model
from ..results import Column, write_tables
from .accuracy.control import is_pursued, solve_to_accuracy
from .convergence import goal_units
from .expressions import GoalValues
from .forecast import Done
from .goal import goal_kind, goal_of
from .gradient import DifferentiableRun, Quotient, size_of
from .record import Progress
from .run import describe_goal, result_header

TABLE = "sensitivity"
# shares of the largest value of its kind in the model: a goal or influence below the first is round-off; an influence
# below the second may be only the derivative's error
ROUND_OFF, NONE = 1e-10, 1e-6


@dataclass(frozen=True)
class Row:
    """A number of the case, the derivative of the goal by it, and the estimated error of the derivative.

    ``elasticity``: relative change of the goal over that of the number, None if either is 0 or the goal is round-off.
    ``influence``: change of the goal if the number changes by its own size; if it is 0, by the size of its list or of
    the model. ``method``: how the derivative was found.
    """

    path: str
    value: float
    derivative: float
    elasticity: float | None
    error: float
    influence: float
    method: str


@dataclass
class Sensitivity:
    """The derivatives of a case's goal, the most influential first; ``skipped``: numbers without one, and why.

    ``size``: the largest value of the goal's kind in the model, 0 if unknown.
    """

    case: str
    title: str
    described: str
    goal: float
    rows: list[Row]
    labels: tuple[str, str, str]
    skipped: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    size: float = 0.0

    @property
    def idle(self) -> list[Row]:
        """The rows of numbers whose influence is round-off, or very small and less than its own error."""
        return [row for row in self.rows if row.influence <= self.size * (
            NONE if abs(row.derivative) <= row.error else ROUND_OFF)]

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``--json`` prints."""
        return {"case": self.case, "title": self.title, "status": "converged", "of": self.described, "goal": self.goal,
                "rows": [dict(vars(row)) for row in self.rows], "skipped": self.skipped, "warnings": self.warnings}


def sensitivity(loaded: LoadedCase, paths: Sequence[str] = (), progress: Progress | None = None,
                done: Done = lambda share, left: None) -> Sensitivity:
    """Return the derivatives of a case's goal by the numbers at ``paths``, by default by all that can vary.

    A case without a fixed mesh is solved to its accuracy first, and differentiated on the resulting mesh. Raises
    CaseError if the case has no goal, or if a path leads to no number that can vary; ComputationError.
    """
    goal = goal_of(loaded, "nothing to differentiate")
    variables = numbers_at(loaded, paths) or numbers_of(loaded)
    progress = progress or Progress()
    warnings: list[str] = []
    run = DifferentiableRun(on_its_mesh(loaded, progress), GoalValues((goal,)), progress, warnings.append,
                            len(variables))
    run.compute_together(variables)
    value, rows, skipped = float(run.values[0]), [], dict[str, str]()
    size = _largest(goal, run.model, run.states)
    vanishes = abs(value) <= ROUND_OFF * size
    if vanishes and value:
        warnings.append(f"{describe_goal(goal)} = {value:.1e} is round-off: it vanishes by symmetry or because nothing "
                        "acts on it, so relative changes (elasticity) mean nothing")
    for k, variable in enumerate(variables):
        done(k / len(variables), None)
        try:
            found, method = run.differentiate(variable)
        except UNSOLVED as error:
            if paths and isinstance(error, CaseError):
                raise CaseError([Problem(f"{variable.path} cannot vary about {variable.value:g}: {one.message}",
                                         file=f"--to {variable.path}", expected=one.expected, near=one.near)
                                 for one in error.problems]) from error
            if paths:
                raise
            skipped[variable.path] = verdict(error)[1]
            continue
        # a peak is between the frequencies of a run
        own = value if run.middle is None else float(run.middle[0])
        rows.append(_row(variable, 0.0 if vanishes else own, found, method, run.model.extent))
    rows.sort(key=lambda row: -row.influence)
    return Sensitivity(loaded.source.file, loaded.case.title, describe_goal(goal), value, rows,
                       loaded.case.units.labels, skipped, warnings, size)


def on_its_mesh(loaded: LoadedCase, progress: Progress) -> LoadedCase:
    """Return a case with the mesh that its accuracy requires, or the case itself if it has a mesh."""
    if not is_pursued(loaded):
        return loaded
    found = solve_to_accuracy(loaded, progress=progress).outcome.model.loaded
    return loaded if found is None else found


def _largest(goal: Goal, model: Model, states: Sequence[Any]) -> float:
    """Return the largest value of a goal's kind in the states of a run, 0 if unknown.

    Rotations count as displacements over the size of the model, moments as forces times this size, energies as forces
    times displacements.
    """
    kind, weights = goal_kind(goal), model.weights
    states = [state for state in states if np.shape(getattr(state, "Q", ())) == weights.shape]
    if not states or goal.quantity is None or goal.input is not None:
        return 0.0
    arms, moves = weights[weights > 0.0], max(float(np.abs(weights * s.d[:len(weights)]).max()) for s in states)
    force = max(float(np.abs(s.Q[weights > 0.0] / arms).max(initial=0.0)) for s in states)
    return {"displacement": moves, "position": model.extent, "rotation": moves / model.extent, "force": force,
            "moment": force * model.extent, "energy": force * moves}.get(kind, 0.0)


def _row(variable: CaseNumber, goal: float, found: Quotient, method: str, extent: float) -> Row:
    slope = float(found.value[0])
    # adding 0 avoids a negative zero
    elasticity = slope * variable.value / goal + 0.0 if variable.value and goal else None
    return Row(variable.path, variable.value, slope, elasticity, float(found.error[0]),
               abs(slope) * size_of(variable, extent), method)


def write_sensitivity(study: Sensitivity, loaded: LoadedCase, path: str, command: str = "", *,
                      force: bool = False) -> Path:
    """Write the rows as table ``sensitivity``; return the path. Raises ResultsError."""
    names = ("path", "value", "derivative", "elasticity", "error", "influence", "method")
    columns = (Column("value", "1", "the number, in units of the case"), Column("path", "none", "place in the case"),
               Column("derivative", "1", f"of {study.described} by the number, in units of the case"),
               Column("elasticity", "1", "relative change of the goal by a relative change of the number"),
               Column("error", "1", "estimate of the error of the derivative"),
               Column("influence", goal_units(loaded), "change of the goal where the number changes by its own size, "
                      "that of its list or of the model where it is 0"),
               Column("method", "none", "how the derivative was found"))
    table = {name: [getattr(row, name) for row in study.rows] for name in names}
    attrs = {"goal": study.described, "goal_value": study.goal}
    summary = {k: v for k, v in study.as_json().items() if k != "rows"}
    return write_tables(path, result_header(loaded, command), {TABLE: (table, attrs)}, columns, summary, force=force)
