"""``sweep.h5``: all rows of a sweep, and what was computed before, in one file.

Rows are added to a list beside it, ``sweep.rows``, as they come: a line of JSON each, so that whatever ends the sweep
costs no row that was finished. The sweep's end puts them into ``sweep.h5`` and removes the list.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..case.units import QUANTITY_UNITS, unit_label
from ..errors import ResultsError
from ..results import Column, ResultWriter, check_output, open_results, part_path
from ..results.target import MARK, is_own, locked
from ..results.writer import plain
from .digests import program
from .sweep_rows import NAME, Sweep, shown, value_names

LIST = "sweep.rows"
# tables of the file: the rows, and everything that was computed, by the name of its case
ROWS, COMPUTED = "sweep", "computed"
# between two looks at a folder that another sweep writes to
TURN_SECONDS = 0.1
_OWN = {"status": "converged, failed or refused", "output": "the result file of the row",
        "reason": "why it failed or was refused", "name": "digest of case, files and program"}


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
        self._stream.write(json.dumps(line, default=plain).encode() + b"\n")

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
                "row": [json.dumps({k: v for k, v in row.items() if k != "wall_s"}, default=plain)
                        for row in known.values()]}
    # what an interrupted writer left is nobody's: the folder is held
    part_path(sweep.file).unlink(missing_ok=True)
    with ResultWriter(sweep.file, {**(sweep.header or {}), "command_line": sweep.command}, [], np.zeros(0),
                      columns=_columns(sweep, names), force=sweep.force) as writer:
        writer.table(ROWS, table, {"paths": json.dumps([axis.path for axis in sweep.axes]),
                                   "values": json.dumps(names), "sampled": sweep.samples is not None})
        writer.table(COMPUTED, computed, {"program": program()})
        writer.finish({k: v for k, v in sweep.as_json().items() if k != "rows"}, "converged")


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
