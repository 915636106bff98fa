"""The result of an optimisation, and the file of its history."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ..case import LoadedCase
from ..elements.shape import Array
from ..results import Column, write_tables
from .run import result_header

TABLE = "optimisation"


@dataclass
class Point:
    """Values of the numbers that have been tried, with the objective and the largest violation of a constraint."""

    x: Array
    value: float
    missed: float


@dataclass(frozen=True)
class Row:
    """A number of the case: its best value, where the search started, the bounds, and whether it is at one (low, high).
    """

    path: str
    value: float
    start: float
    low: float
    high: float
    at_bound: str | None


@dataclass
class Optimum:
    """The best values found: ``rows`` by number, ``constraints``, and the ``history`` of evaluations that succeeded."""

    case: str
    title: str
    measure: str
    rows: list[Row]
    minimum: float
    constraints: list[dict[str, Any]]
    evaluations: int
    failed: int
    gradients: int
    found: bool
    message: str
    history: list[Point]
    warnings: list[str] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``--json`` prints."""
        out: dict[str, Any] = {
            "case": self.case, "title": self.title, "status": "converged" if self.found else "failed",
            "minimise": self.measure, "rows": [asdict(row) for row in self.rows], "minimum": self.minimum,
            "constraints": self.constraints,
            "evaluations": self.evaluations, "failed": self.failed, "gradients": self.gradients,
            "message": self.message, "warnings": self.warnings}
        if not self.found:
            out["reason"] = self.message
        return out


def write_optimisation(found: Optimum, loaded: LoadedCase, path: str, command: str = "", *, force: bool = False
                       ) -> Path:
    """Write the history as table ``optimisation``; return the path. Raises ResultsError."""
    columns = (Column("evaluation", "1", "number of the try", integer=True),
               Column("minimised", "1", found.measure), Column("missed", "1", "largest excess of a constraint"),
               *(Column(row.path, "1", "in units of the case") for row in found.rows))
    table: dict[str, list[Any]] = {
        "evaluation": list(range(1, len(found.history) + 1)), "minimised": [p.value for p in found.history],
        "missed": [p.missed for p in found.history],
        **{row.path: [float(p.x[k]) for p in found.history] for k, row in enumerate(found.rows)}}
    attrs = {"minimise": found.measure, "constrained": bool(found.constraints)}
    return write_tables(path, result_header(loaded, command), {TABLE: (table, attrs)}, columns, found.as_json(),
                        "converged" if found.found else "failed", force)
