"""A study of work and precision as a result file: the table that ``plot`` draws, and the summary."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...case import LoadedCase
from ...results import Column, ResultWriter
from ..convergence import goal_units
from ..run import result_header
from .result import WHAT, Row, Study

TABLE = "tradeoff"


def write_tradeoff(study: Study, loaded: LoadedCase, path: str, command: str = "", *, force: bool = False) -> Path:
    """Write the rows that were solved as table ``tradeoff``; return where. Raises ResultsError."""
    columns = (Column("value", goal_units(loaded), f"the goal: {study.goal}"),
               Column("error_below", "1", WHAT["error_below"]), Column("model_error", "1", WHAT["model_error"]),
               Column("judged", "1", WHAT["judged"]),
               Column("pareto", "1", "1 where no other row is both faster and more accurate", integer=True),
               Column("memory_bytes", "1", WHAT["memory_bytes"], integer=True),
               Column("runs", "1", "number of timed runs", integer=True),
               Column("method", "none", "integrator, empty for the case's"),
               Column("step", "1", "time step, or tolerance"), Column("status", "none", "converged or failed"))
    rows = [_entry(row) for row in study.rows if row.measured.status == "converged"]
    table = {name: [row[name] for row in rows] for name in rows[0]} if rows else {}
    key = next((row.task.setting.key for row in study.rows if row.task.setting.key), "")
    attrs = {"goal": study.goal, "against": study.against, "step": key}
    with ResultWriter(path, result_header(loaded, command), [], np.zeros(0), columns=columns, force=force) as writer:
        if table:
            writer.table(TABLE, table, attrs)
        summary = {k: v for k, v in study.as_json().items() if k not in ("rows", "meaning")}
        return writer.finish(summary, "converged" if study.converged else "failed")


def _entry(row: Row) -> dict[str, Any]:
    m, setting = row.measured, row.task.setting

    def number(value: float | None) -> float:
        return math.nan if value is None else value

    return {"element": m.element, "formulation": m.formulation, "elements": m.elements, "dofs": m.dofs or 0,
            "value": number(None if m.answer is None else m.answer.value), "error": number(row.error),
            "error_below": number(row.error_below), "model_error": number(row.model_error),
            "judged": row.judged if math.isfinite(row.judged) else math.nan, "wall_s": number(m.wall_s),
            "memory_bytes": m.memory or 0, "runs": m.runs, "pareto": int(row.pareto), "method": setting.method or "",
            "step": number(setting.step), "status": m.status}
