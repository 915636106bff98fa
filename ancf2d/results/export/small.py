"""Everything small as JSON: all but the states, the mesh, and series too long to be read as text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ancf2d.json_values import json_text
from ancf2d.results.export import Done
from ancf2d.results.export.probes import time_name
from ancf2d.results.info import describe
from ancf2d.results.reader import Results
from ancf2d.results.target import MARK

MOST = 10_000  # values of a series


def write(results: Results, path: Path, done: Done) -> None:
    """Write what ``ancf2d info`` tells, the case as completed, and the series; ``left_out`` names those too long."""
    left_out: list[str] = []

    def short(name: str, columns: dict[str, Any]) -> dict[str, Any]:
        if max((len(values) for values in columns.values()), default=0) <= MOST:
            return columns
        left_out.append(name)
        return {}

    found = {"made_by": MARK, **describe(results.path)}
    when = time_name(results)
    found.update(
        states=short("states", {when: results.t}),
        probes={**short("probes", {when: results.probe_t}),
                **{name: short(f"probe {name}", table) for name, table in results.probes.items()}},
        energies=short("energies", results.energies), history=short("history", results.history),
        tables={name: {"rows": short(f"table {name}", table), "attributes": table.attrs}
                for name, table in results.tables.items()},
        case_completed=results.case_completed, left_out=left_out)
    path.write_text(json_text(found) + "\n", encoding="utf-8")
    done(1.0)
