"""The rows of a sweep: what each variant sets, what came of it, and tables of them."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..case import Goal
from ..case.axes import Axis
from ..case.emit import flow
from ..case.units import SI
from ..results.target import SWEEP_COLUMNS, replacing
from .run import describe_goal, quantity
from .samples import Design, statistics
from .variant_runs import Job, fell_short

# what all rows of a sweep are in, and the folder of the result files that are kept
NAME, RUNS = "sweep.h5", "runs"
# modes and buckling loads that a row tells where the case has no goal
FIRST = 3


@dataclass
class Row:
    """One variant: the values ``set``, and what came of it.

    ``status`` is converged, failed (by the computation) or refused (as a case), the latter two with a ``reason``;
    empty until it is known. ``output`` is the file that has its result. ``values`` are the goal or, where the case
    has none, probes, modes or load factors; ``estimate`` is that of the relative error. ``reused`` where an earlier run
    had computed it.
    """

    set: dict[str, Any]
    status: str = ""
    reason: str = ""
    goal: float | None = None
    values: dict[str, float | None] = field(default_factory=dict)
    output: str | None = None
    elements: int | None = None
    dofs: int | None = None
    wall_s: float | None = None
    accuracy: dict[str, Any] | None = None
    warnings: list[str] = field(default_factory=list)
    reused: bool = False

    @property
    def estimate(self) -> float | None:
        """The estimate of the relative error, where the run gives one."""
        return (self.accuracy or {}).get("estimate")

    def take(self, found: dict[str, Any], reused: bool = False) -> None:
        """Take what ``outcome_of`` tells of a run."""
        for name, value in found.items():
            setattr(self, name, value)
        self.reused = reused

    def as_json(self) -> dict[str, Any]:
        """Return what ``--json`` prints of the row."""
        out = {k: v for k, v in vars(self).items() if k not in ("reason", "warnings") or v}
        return {**out, "status": self.status or "waiting"}


@dataclass
class Sweep:
    """Variants of a case: a row of each and the job that it needs, None where it is refused.

    ``paired``: the values of all axes are run through together. ``samples``: what these were drawn from, if they were.
    ``keep``: each variant has a result file of its own too. ``header``: what ``sweep.h5`` says of the case.
    """

    case: str
    title: str
    axes: list[Axis]
    folder: Path
    rows: list[Row]
    jobs: list[Job | None]
    labels: tuple[str, str, str] = SI
    samples: Design | None = None
    keep: bool = False
    force: bool = False
    command: str = ""
    header: dict[str, Any] | None = None

    @property
    def finished(self) -> list[Row]:
        """The rows whose outcome is known."""
        return [row for row in self.rows if row.status]

    @property
    def file(self) -> Path:
        """The file of all rows."""
        return self.folder / NAME

    def statistics(self) -> dict[str, Any]:
        """Return what samples say of each computed value, that of the goal as ``goal``."""
        if self.samples is None:
            return {}
        goal = any(job is not None and job.goal is not None for job in self.jobs)
        return {"goal" if goal else name: statistics([row.values.get(name) for row in self.rows], self.samples)
                for name in value_names(self)}

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``--json`` prints."""
        done = all(row.status == "converged" for row in self.rows)
        out: dict[str, Any] = {
            "case": self.case, "title": self.title, "status": "converged" if done else "failed",
            "folder": str(self.folder), "output": str(self.file), "rows": [row.as_json() for row in self.rows]}
        if self.samples is not None:
            out["samples"] = {"design": self.samples.kind, "seed": self.samples.seed, "count": len(self.rows)}
            out["statistics"] = self.statistics()
        return out


def outcome_of(goal: Goal | None, summary: dict[str, Any]) -> dict[str, Any]:
    """Return what a row tells of a run."""
    out: dict[str, Any] = {"status": summary["status"], "reason": summary.get("reason", ""), "goal": None, "values": {}}
    out |= {name: summary.get(name) for name in ("elements", "dofs", "wall_s", "accuracy", "output")}
    out["warnings"] = list(summary.get("warnings", ()))
    if summary["status"] == "converged" or fell_short(summary):
        out["goal"] = None if goal is None else quantity(goal, summary)
        out["values"] = {describe_goal(goal): out["goal"]} if goal is not None else told(summary)
    return out


def told(summary: dict[str, Any]) -> dict[str, float | None]:
    """Return the numbers that tell most of a run without a goal: modes, load factors or displacements of probes."""
    found: dict[str, float | None] = {f"{name}.{q}": values.get(q) for name, values in summary["probes"].items()
                                      for q in ("ux", "uy")}
    if summary.get("frequencies"):
        return {f"omega {k}": f["omega"] for k, f in enumerate(summary["frequencies"][:FIRST], start=1)}
    if summary.get("load_factors"):
        return {f"load factor {k}": f for k, f in enumerate(summary["load_factors"][:FIRST], start=1)}
    return found


def value_names(sweep: Sweep) -> list[str]:
    """Return the names of the computed values of any row."""
    return list(dict.fromkeys(name for row in sweep.rows for name in row.values))


def shown(value: Any) -> str:
    """Return a value as it is read in a table: texts as they are, all else as YAML has it."""
    return value if isinstance(value, str) else flow(value)


def short_names(paths: Sequence[str]) -> list[str]:
    """Return the shortest ends of dotted paths that tell them apart."""
    def end(path: str, parts: int) -> str:
        return ".".join(path.split(".")[-parts:])

    out = []
    for path in paths:
        whole = path.count(".") + 1
        out.append(next((end(path, k) for k in range(1, whole)
                         if sum(end(p, k) == end(path, k) for p in paths) == 1), path))
    return out


def write_csv(sweep: Sweep, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write the finished rows: full paths of the varied values, then what was computed, at full precision.

    Raises ResultsError where the file cannot be written, or was not made by ancf2d, unless ``force``.
    """
    paths, names = [axis.path for axis in sweep.axes], value_names(sweep)
    with (replacing(path, force) as private,
          private.open("w", newline="", encoding="utf-8", errors="backslashreplace") as stream):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*paths, "status", *names, *SWEEP_COLUMNS])
        for row in sweep.finished:
            writer.writerow([*(shown(row.set[p]) for p in paths), row.status, *(row.values.get(n) for n in names),
                             row.elements, row.dofs, row.wall_s, row.estimate, row.output, row.reason])
