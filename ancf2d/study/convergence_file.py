"""A convergence study as a result file: the table that ``plot`` draws, and the summary."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ..case import LoadedCase
from ..results import Column, ResultWriter
from .convergence import Convergence
from .goal import goal_kind
from .run import result_header

_UNITS = {"displacement": "{L}", "position": "{L}", "rotation": "rad", "velocity": "{L}/{T}", "force": "{F}",
          "moment": "{F}*{L}", "energy": "{F}*{L}"}


def goal_units(loaded: LoadedCase) -> str:
    """Return the units of a case's goal, as templates of result files have them."""
    goal = loaded.case.goal
    if goal is None:
        raise ValueError("a study has a goal")
    if goal.kind is not None:
        return "rad/{T}"
    return _UNITS[goal_kind(goal)] if goal.quantity is not None else "1"


def write_convergence(study: Convergence, loaded: LoadedCase, path: str, command: str = "", *,
                      force: bool = False) -> Path:
    """Write the rows as table ``convergence``; return where. Raises ResultsError."""
    names = ("element", "formulation", "elements", "dofs", "value", "error", "order", "wall_s", "status")
    rows = study.rows
    columns = (Column("value", goal_units(loaded), f"the goal: {study.goal}"),
               Column("status", "none", "converged or failed"))
    table = {name: [math.nan if (v := getattr(row, name)) is None else v for row in rows] for name in names}
    attrs = {"goal": study.goal, "reference": "auto" if study.reference is None else study.reference}
    with ResultWriter(path, result_header(loaded, command), [], np.zeros(0), columns=columns, force=force) as writer:
        writer.table("convergence", table, attrs)
        # the rows are in the table already
        return writer.finish({k: v for k, v in study.as_json().items() if k != "rows"}, "converged")
