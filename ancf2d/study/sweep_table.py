"""The rows of a sweep: values and outcome of each variant, tables of them, and the file ``sweep.h5`` for all of them.

Finished rows are first appended to a list beside the file, ``sweep.rows``, one line of JSON each, so that no finished
row is lost when the sweep is ended. At its end, the sweep writes them to ``sweep.h5`` and removes the list.
"""

from __future__ import annotations

import csv
import json
import math
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from ..case import Goal
from ..case.axes import Axis
from ..case.emit import flow
from ..case.units import QUANTITY_UNITS, SI, unit_label
from ..errors import ResultsError, WriteError, write_error
from ..json_values import plain
from ..results import Column, check_output, open_results, part_path, write_tables
from ..results.target import MARK, SWEEP_COLUMNS, is_own, locked, replacing
from .digests import program
from .run import describe_goal, quantity
from .samples import Design, statistics
from .sweep_runs import Job, fell_short

# created once, since creating it takes longer than writing a row
_JSON = json.JSONEncoder(default=plain)
# the file with all rows of a sweep, and the folder of result files that are kept
NAME, RUNS = "sweep.h5", "runs"
# modes and buckling loads in a row if the case has no goal
FIRST = 3
LIST = "sweep.rows"
_KEPT = "the rows computed before are kept, and the same command continues from them"
# tables of the file: the rows, and all computed results by the name of their case
ROWS, COMPUTED = "sweep", "computed"
# interval of checking a folder to which another sweep writes
TURN_SECONDS = 0.1
_OWN = {"status": "converged, failed or refused", "output": "the result file of the row",
        "reason": "why it failed or was refused", "name": "digest of case, files and program"}


@dataclass
class Row:
    """One variant: its values ``set``, and its outcome.

    ``status`` is converged, failed (by the computation) or refused (as a case), the latter two with a ``reason``; empty
    until it is known. ``output`` is the file that contains its result. ``values`` are the goal or, if the case has
    none, probes, modes or load factors; ``estimate`` is that of the relative error. ``reused``: an earlier run computed
    it.
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
        """The estimate of the relative error, or None if the run gives none."""
        return (self.accuracy or {}).get("estimate")

    def store(self, found: dict[str, Any], reused: bool = False) -> None:
        """Store the result of ``outcome_of`` for a run."""
        for name, value in found.items():
            setattr(self, name, value)
        self.reused = reused

    def as_json(self) -> dict[str, Any]:
        """Return the ``--json`` form of the row."""
        out = {k: v for k, v in vars(self).items() if k not in ("reason", "warnings") or v}
        return {**out, "status": self.status or "waiting"}


@dataclass
class Sweep:
    """Variants of a case: the row of each and its job, None if it is refused.

    ``samples``: the design from which the values of the axes were drawn, if any. ``keep``: each variant also has a
    result file of its own. ``header``: the description of the case in ``sweep.h5``.
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

    @cached_property
    def file(self) -> Path:
        """The file with all rows."""
        return self.folder / NAME

    def statistics(self) -> dict[str, Any]:
        """Return the statistics over the samples for each computed value; that of the goal is called ``goal``."""
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
    """Return the fields of a row that follow from the summary of a run."""
    out: dict[str, Any] = {"status": summary["status"], "reason": summary.get("reason", ""), "goal": None, "values": {}}
    out |= {name: summary.get(name) for name in ("elements", "dofs", "wall_s", "accuracy", "output")}
    out["warnings"] = list(summary.get("warnings", ()))
    if summary["status"] == "converged" or fell_short(summary):
        out["goal"] = None if goal is None else quantity(goal, summary)
        out["values"] = {describe_goal(goal): out["goal"]} if goal is not None else main_values(summary)
    return out


def main_values(summary: dict[str, Any]) -> dict[str, float | None]:
    """Return the main numbers of a run without a goal: modes, load factors or displacements of probes."""
    found: dict[str, float | None] = {f"{name}.{q}": values.get(q) for name, values in summary["probes"].items()
                                      for q in ("ux", "uy")}
    if summary.get("frequencies"):
        return {f"omega {k}": f["omega"] for k, f in enumerate(summary["frequencies"][:FIRST], start=1)}
    if summary.get("load_factors"):
        return {f"load factor {k}": f for k, f in enumerate(summary["load_factors"][:FIRST], start=1)}
    return found


def value_names(sweep: Sweep) -> list[str]:
    """Return the names of the computed values of all rows."""
    return list(dict.fromkeys(name for row in sweep.rows for name in row.values))


def shown(value: Any) -> str:
    """Return a value as shown in a table: texts unchanged, others as in YAML."""
    return value if isinstance(value, str) else flow(value)


def write_csv(sweep: Sweep, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write the finished rows: full paths of the varied values, then the computed ones, at full precision.

    Raises ResultsError if the file cannot be written, or was not made by ancf2d, unless ``force``.
    """
    paths, names = [axis.path for axis in sweep.axes], value_names(sweep)
    with (replacing(path, force) as private,
          private.open("w", newline="", encoding="utf-8", errors="backslashreplace") as stream):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*paths, "status", *names, *SWEEP_COLUMNS])
        for row in sweep.finished:
            writer.writerow([*(shown(row.set[p]) for p in paths), row.status, *(row.values.get(n) for n in names),
                             row.elements, row.dofs, row.wall_s, row.estimate, row.output, row.reason])


class Ledger:
    """The rows known in the folder of a sweep, which is locked while the sweep runs.

    ``known``: the fields of ``Row`` by the name of the case. ``tell`` is called if another sweep has to end first.
    Raises ResultsError if files not made by ancf2d have the same names, unless ``force``.
    """

    def __init__(self, folder: Path, force: bool = False, tell: Callable[[str], None] = lambda text: None) -> None:
        self.file, self.list = folder / NAME, folder / LIST
        check_output(self.file, force)
        self.known = self._stored()
        self._stream = self._claimed(tell)
        try:
            self._read(force)
        except BaseException:
            self._release()
            raise

    def _claimed(self, tell: Callable[[str], None]) -> Any:
        """Return the open list when no other sweep has locked it."""
        while True:
            try:
                stream = self.list.open("a+b")
            except OSError as error:
                raise write_error(self.list, error) from error
            if locked(stream.fileno()) and self.list.exists() and os.path.samestat(
                    self.list.stat(), os.fstat(stream.fileno())):
                self.known = self._stored()
                return stream
            stream.close()
            tell(f"another sweep writes to '{self.list.parent}'; waiting for it to end")
            time.sleep(TURN_SECONDS)

    def _read(self, force: bool) -> None:
        """Read the rows of a sweep that was ended early, without an incomplete last line."""
        self._stream.seek(0)
        content = self._stream.read()
        lines = content.split(b"\n")
        if lines != [b""] and not is_own(self.list) and not force:
            raise ResultsError(f"'{self.list}' exists and was not made by ancf2d; choose another folder, or replace it "
                               "with --force")
        if _parsed(lines[0]).get(MARK) == program():
            found = (_parsed(line) for line in lines[1:])
            self.known |= {line["name"]: line["row"] for line in found if "name" in line}
            # nothing may be appended to an incomplete line; the other lines are the only copy of their rows
            self._stream.truncate(content.rfind(b"\n") + 1)
        else:
            self._stream.truncate(0)
            self._add({MARK: program()})

    def _stored(self) -> dict[str, Any]:
        """Return the rows of an earlier sweep, or none if its file is unreadable or written by another version."""
        if not self.file.exists():
            return {}
        try:
            with open_results(self.file) as found:
                table = found.tables.get(COMPUTED)
                if table is None or table.attrs.get("program") != program():
                    return {}
                rows = zip(table["name"], table["row"], table["wall_s"], strict=True)
                return {str(name): {**json.loads(row), "wall_s": None if math.isnan(wall) else float(wall)}
                        for name, row, wall in rows}
        except (ResultsError, ValueError, KeyError):
            return {}

    def _add(self, line: dict[str, Any]) -> None:
        """Append a line; it survives the end of this process."""
        try:
            self._stream.write(_JSON.encode(line).encode() + b"\n")
            self._stream.flush()
        except OSError as error:
            raise write_error(self.list, error, _KEPT) from error

    def store(self, name: str, row: dict[str, Any]) -> None:
        """Store the outcome of a case; it survives the end of this process."""
        self.known[name] = row
        self._add({"name": name, "row": row})

    def close(self, sweep: Sweep) -> None:
        """Write the file and unlock the folder. Raises ResultsError; the list of rows then remains."""
        try:
            if sweep.header is not None:
                _write(sweep, self.known)
                self.list.unlink()
        except WriteError as error:
            raise WriteError(f"{error}; {_KEPT}") from error
        finally:
            self._release()

    def _release(self) -> None:
        """Unlock the folder, and remove a list that the disk had no room for."""
        with suppress(OSError):
            if os.fstat(self._stream.fileno()).st_size == 0:
                self.list.unlink()
        with suppress(OSError):  # part of a line may still wait to be written
            self._stream.close()


def _parsed(line: bytes) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _write(sweep: Sweep, known: dict[str, Any]) -> None:
    rows, names = sweep.finished, value_names(sweep)
    table: dict[str, Sequence[Any]] = {}
    for axis in sweep.axes:
        values = [row.set[axis.path] for row in rows]
        numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
        table[axis.path] = values if numbers else [shown(v) for v in values]
    table["status"] = [row.status for row in rows]
    table |= {name: [row.values.get(name) for row in rows] for name in names}
    table |= {name: [getattr(row, name) for row in rows] for name in ("elements", "dofs", "wall_s")}
    table |= {"error": [row.estimate for row in rows], "output": [row.output or "" for row in rows],
              "reason": [row.reason for row in rows]}
    computed = {"name": list(known), "wall_s": [row["wall_s"] for row in known.values()],
                "row": [_JSON.encode({k: v for k, v in row.items() if k != "wall_s"}) for row in known.values()]}
    # the folder is locked, so a part file is left over from an interrupted writer
    part_path(sweep.file).unlink(missing_ok=True)
    attrs = {"paths": json.dumps([axis.path for axis in sweep.axes]), "values": json.dumps(names),
             "sampled": sweep.samples is not None}
    write_tables(sweep.file, {**(sweep.header or {}), "command_line": sweep.command},
                 {ROWS: (table, attrs), COMPUTED: (computed, {"program": program()})}, _columns(sweep, names),
                 {k: v for k, v in sweep.as_json().items() if k != "rows"}, force=sweep.force)


def _columns(sweep: Sweep, names: Sequence[str]) -> list[Column]:
    varied = [Column(axis.path, "as in the case", f"{axis.path} of the case, as the row sets it")
              for axis in sweep.axes]
    return [*varied, *(Column(name, _units(name, sweep.labels), f"computed: {name}") for name in names),
            *(Column(name, "none", text) for name, text in _OWN.items()),
            Column("row", "none", "data of a computed case, as JSON text"),
            Column("error", "1", "estimate of the relative error")]


def _units(name: str, labels: tuple[str, str, str]) -> str:
    """Return the units of a computed value."""
    if name.startswith("omega "):
        return unit_label("rad/s", labels)
    last = name.replace(".", " ").split()[-1] if name.split() else ""
    words = name.split()
    if words and words[0] in ("bending", "axial", "shear", "thickness", "mixed") and words[-1].isdigit():
        return unit_label("rad/s", labels)
    return unit_label(QUANTITY_UNITS.get(last, "1"), labels)
