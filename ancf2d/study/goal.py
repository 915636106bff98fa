"""What errors of a goal are relative to."""

from __future__ import annotations

from typing import Any

from ..case import Goal
from ..model.model import Model

_KINDS = {"ux": "displacement", "uy": "displacement", "x": "position", "y": "position", "theta": "rotation",
          "vx": "velocity", "vy": "velocity", "N": "force", "Q": "force", "fx": "force", "fy": "force",
          "M": "moment", "m": "moment"}
SHARE = 1e-3
TINY = 2.0**-1022


def goal_kind(goal: Goal) -> str:
    """Return the kind of quantity that a goal is: displacement, force, ..., energy."""
    return _KINDS.get(goal.quantity or "", "energy")


def smallest_scale(goal: Goal, summary: dict[str, Any], model: Model, d: Any) -> float:
    """Return 1e-3 of the largest of the goal's kind in the model.

    Of all probes and reactions; of displacements also those of all nodal coordinates d (n_q,), of positions
    the extent of the model.
    """
    kind = goal_kind(goal)
    rows = [*summary["probes"].values(), *summary.get("reactions", {}).values()]
    largest = [abs(v) for row in rows for q, v in row.items() if _KINDS.get(q) == kind]
    if kind == "displacement":
        largest.append(float(abs(model.weights * d).max(initial=0.0)))
    if kind == "position":
        largest.append(model.extent)
    return SHARE * max(largest, default=0.0)


def error_scale(value: float, smallest: float) -> float:
    """Return what an error of a value is divided by: the value, or the smallest scale where it is smaller."""
    return max(abs(value), smallest, TINY)
