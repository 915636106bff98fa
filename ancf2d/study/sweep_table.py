"""The rows of a sweep: what each variant sets, what came of it, tables of them, and ``sweep.h5``, which holds them all.

Rows are added to a list beside the file, ``sweep.rows``, as they come: a line of JSON each, so that whatever ends the
sweep costs no row that was finished. The sweep's end puts them into ``sweep.h5`` and removes the list.
"""

from __future__ import annotations

import csv
import json
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from ..case import Goal
from ..case.axes import Axis
from ..case.emit import flow
from ..case.units import QUANTITY_UNITS, SI, unit_label
from ..errors import ResultsError
from ..json_values import plain
from ..results import Column, check_output, open_results, part_path, write_tables
from ..results.target import MARK, SWEEP_COLUMNS, is_own, locked, replacing
from .digests import program
from .run import describe_goal, quantity
from .samples import Design, statistics
from .sweep_runs import Job, fell_short

# made once: it takes longer than to write a row
_JSON = json.JSONEncoder(default=plain)
# what all rows of a sweep are in, and the folder of the result files that are kept
NAME, RUNS = "sweep.h5", "runs"
# modes and buckling loads that a row tells where the case has no goal
FIRST = 3
LIST = "sweep.rows"
# tables of the file: the rows, and everything that was computed, by the name of its case
ROWS, COMPUTED = "sweep", "computed"
# between two looks at a folder that another sweep writes to
TURN_SECONDS = 0.1
_OWN = {"status": "converged, failed or refused", "output": "the result file of the row",
        "reason": "why it failed or was refused", "name": "digest of case, files and program"}


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

    @cached_property
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


class Ledger:
    """The rows that are known in the folder of a sweep, which it holds alone while it runs.

    ``known``: by the name of the case, what ``Row`` holds of its result. ``told`` is called where another sweep has to
    end first. Raises ResultsError where files are in the way that ancf2d did not make, unless ``force``.
    """

    def __init__(self, folder: Path, force: bool = False, told: Callable[[str], None] = lambda text: None) -> None:
        self.file, self.list = folder / NAME, folder / LIST
        check_output(self.file, force)
        self.known = self._stored()
        self._stream = self._claimed(told)
        try:
            self._read(force)
        except BaseException:
            self._stream.close()
            raise

    def _claimed(self, told: Callable[[str], None]) -> Any:
        """Return the open list once no other sweep has it."""
        while True:
            try:
                stream = self.list.open("a+b")
            except OSError as error:
                raise ResultsError(f"cannot write '{self.list}': {error.strerror}") from error
            if locked(stream.fileno()) and self.list.exists() and os.path.samestat(
                    self.list.stat(), os.fstat(stream.fileno())):
                self.known = self._stored()
                return stream
            stream.close()
            told(f"another sweep writes to '{self.list.parent}'; waiting for it to end")
            time.sleep(TURN_SECONDS)

    def _read(self, force: bool) -> None:
        """Take up the rows of a sweep that was ended; a line that was cut off is left out."""
        self._stream.seek(0)
        lines = self._stream.read().split(b"\n")
        if lines != [b""] and not is_own(self.list) and not force:
            raise ResultsError(f"'{self.list}' exists and was not made by ancf2d; choose another folder, or replace it "
                               "with --force")
        if _parsed(lines[0]).get(MARK) == program():
            found = (_parsed(line) for line in lines[1:])
            self.known |= {line["name"]: line["row"] for line in found if "name" in line}
        # a cut line must not be continued
        self._stream.truncate(0)
        self._add({MARK: program()})
        for name, row in self.known.items():
            self._add({"name": name, "row": row})

    def _stored(self) -> dict[str, Any]:
        """Return the rows of an earlier sweep, none where its file cannot be read or is that of another program."""
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
        self._stream.write(_JSON.encode(line).encode() + b"\n")

    def take(self, name: str, row: dict[str, Any]) -> None:
        """Note what came of a case; it survives the end of this process."""
        self.known[name] = row
        self._add({"name": name, "row": row})
        self._stream.flush()

    def close(self, sweep: Sweep) -> None:
        """Write the file and give up the folder. Raises ResultsError; the list of rows then stays."""
        try:
            self._stream.flush()
            if sweep.header is not None:
                _write(sweep, self.known)
                self.list.unlink()
        finally:
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
    # what an interrupted writer left is nobody's: the folder is held
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
            Column("row", "none", "what is known of a case that was computed, as JSON text"),
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
