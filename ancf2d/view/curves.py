"""What a page plots: probes, energies and traces, and which of them the goal of the case is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ancf2d.results import Results, Table
from ancf2d.results.symbols import completed_case
from ancf2d.view.layers import packed

MAX_ROWS = 4000  # of each curve
BUDGET = 600_000  # bytes of all curves together
WHERE = ("x", "y", "ux", "uy")


def curves(results: Results, t: np.ndarray) -> dict[str, Any]:
    """Return the curves of a file whose states at times (or load factors) ``t`` are shown.

    ``series`` are times with the row of each shown state; each of ``probes`` belongs to one of them. ``traces`` are the
    ways of probes; ``goal`` is the number of the curve that the goal of the case asks for, None where there is none.
    """
    goal = completed_case(results).get("goal")
    goal = goal if isinstance(goal, dict) else {}
    wanted = _wanted(goal, results)
    tables = [(results.probe_t, results.probes), (results.t, {"energy": _energies(results)})]
    count = sum(len(columns) for _, found in tables for columns in found.values())
    most = max(2, min(MAX_ROWS, BUDGET // (8 * max(count, 1))))
    series: list[dict[str, Any]] = []
    listed: list[dict[str, Any]] = []
    traces: list[dict[str, Any]] = []
    for times, found in tables:
        if not len(times) or not any(found.values()):
            continue
        kept, rows = _kept(times, t, most)
        for curve in _varying(found, kept, wanted):
            listed.append({**curve, "series": len(series)})
        traces += [{**trace, "series": len(series)} for trace in _traces(found, kept)]
        series.append({"t": packed(times[kept], "f8"), "rows": packed(rows, "f4")})
    number = next((k for k, c in enumerate(listed) if (c["probe"], c["quantity"]) == wanted), None)
    return {"series": series, "probes": listed, "traces": traces, "goal": number}


def _wanted(goal: dict[str, Any], results: Results) -> tuple[str, str]:
    """Return the names under which a file has what the goal asks for: of a point and a quantity."""
    quantity = str(goal.get("quantity", "")).removesuffix("_energy")
    if "reaction" in goal:
        beside = f"reaction {goal['reaction']}"  # where a probe has the name of the support
        return beside if beside in results.probes else str(goal["reaction"]), quantity
    return str(goal.get("probe", "energy")), quantity


def _energies(results: Results) -> Table:
    """Return the energies at each stored state; those of statics are written with the steps."""
    if results.energies:
        return results.energies
    found, strain = Table(), np.asarray(results.history.get("energy", ()), float)
    if 0 < len(strain) >= results.nt - 1:
        # a path begins at rest, before its first step
        found["strain"] = np.concatenate([np.zeros(results.nt), strain])[-results.nt:]
        found.units = {"strain": results.history.units.get("energy", "")}
    return found


def _kept(times: np.ndarray, t: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows that are shown, and where among them each state is: between two where its own is left out."""
    rows = _rows_of(times, t)
    if len(times) <= most:
        return np.arange(len(times)), rows
    even = np.linspace(0, len(times) - 1, most).astype(int)
    kept = np.unique(np.concatenate([rows, even]) if len(rows) < most else even)
    return kept, np.interp(rows, kept, np.arange(len(kept)))


def _varying(found: dict[str, Table], kept: np.ndarray, wanted: tuple[str, str]) -> Iterator[dict[str, Any]]:
    for name, columns in found.items():
        for quantity, values in columns.items():
            shown = np.asarray(values, float)[kept]
            finite = shown[np.isfinite(shown)]
            if len(finite) > 1 and (np.ptp(finite) > 0 or (name, quantity) == wanted):
                yield {"probe": name, "quantity": quantity, "units": columns.units.get(quantity, ""),
                       "values": packed(shown, "f8")}


def _traces(found: dict[str, Table], kept: np.ndarray) -> Iterator[dict[str, Any]]:
    """Yield the way of each probe: where it begins, and its displacements."""
    for name, columns in found.items():
        if all(q in columns for q in WHERE):
            x, y, ux, uy = (np.asarray(columns[q], float)[kept] for q in WHERE)
            yield {"probe": name, "start": [float(x[0] - ux[0]), float(y[0] - uy[0])],
                   "ux": packed(ux, "f4"), "uy": packed(uy, "f4")}


def _rows_of(times: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the row of each state's values: the first of its time behind that of the state before."""
    out, row = np.zeros(len(t), int), 0
    for k, value in enumerate(t):
        later = np.flatnonzero(times[row:] == value)
        row = row + int(later[0]) if len(later) else min(row, len(times) - 1)
        out[k] = row
    return out
