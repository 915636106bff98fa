"""A sweep as a table: its columns, and CSV."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from typing import Any

from ..case.emit import flow
from ..results.own import SWEEP_COLUMNS
from ..results.replace import replacing
from .sweep import Sweep


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
