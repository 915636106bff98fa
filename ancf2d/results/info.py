"""Descriptions of the contents and origin of result files."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ancf2d.errors import many
from ancf2d.results.reader import open_results
from ancf2d.results.records import OVER_TIME

MOST_EVENTS = 10  # largest number of events listed
_UNFINISHED = {
    "running": "unfinished: the run is still going or was killed",
    "interrupted": "interrupted: it holds the results so far",
    "failed": "failed: it holds the results up to the failure",
}


def describe(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the data that ``ancf2d info --json`` prints about a result file."""
    with open_results(path) as r:
        return {
            "file": str(r.path), "bytes": r.path.stat().st_size, "title": r.title,
            "case": r.attrs.get("case_name", ""), "solver": r.solver, "status": r.status,
            "made": {
                "created": r.attrs.get("created", ""),
                "command_line": r.attrs.get("command_line", ""),
                "wall_time_s": r.attrs.get("wall_time_s"),
                "platform": r.attrs.get("platform", ""),
                "versions": {k.removeprefix("version_"): v for k, v in sorted(r.attrs.items())
                             if k.startswith("version_")},
                "resumed": r.attrs.get("resumed", 0),
                "case_sha256": r.attrs.get("case_sha256", ""), "overrides": r.overrides,
            },
            "units": {"length": r.units.length, "force": r.units.force, "time": r.units.time},
            "bodies": {name: {"element": b.element_type, "formulation": b.formulation,
                              "elements": len(b.dofs), "nodes": len(np.unique(b.nodes)),
                              "length": float(b.lengths[b.classes].sum()),
                              "heights": None if b.heights is None else [float(f(b.heights)) for f in (np.min, np.max)]}
                       for name, b in r.bodies.items()},
            "checkpoint": None if r.checkpoint is None else r.checkpoint.t,
            "dofs": r.nq, "states": r.nt, "steps": r.history.rows,
            "range": [float(r.t[0]), float(r.t[-1])] if r.nt else [],
            "probes": {name: {q: {"value": float(v[-1]), "units": columns.units[q]}
                              for q, v in columns.items() if len(v)}
                       for name, columns in r.probes.items()},
            "fields": {body: {name: {"components": list(f.components), "units": f.units,
                                     "stations": list(f.stations)} for name, f in found.items()}
                       for body, found in r.fields.items()},
            "tables": {name: {"rows": t.rows, "columns": list(t)} for name, t in r.tables.items()},
            "arrays": {name: list(a.shape) for name, a in r.arrays.items()},
            "summary": r.summary,
        }


def describe_text(found: dict[str, Any]) -> str:
    """Return the text that ``ancf2d info`` prints, from the result of ``describe``."""
    made, units, lines = found["made"], found["units"], [found["title"] or found["case"]]
    status = _UNFINISHED.get(found["status"], found["status"])
    rows = [
        ("file", f"{found['file']} ({_size(found['bytes'])})"),
        ("solver", f"{found['solver']}, {status}"),
        ("reason", str(found["summary"].get("reason", ""))),
        ("made", f"{made['created']} on {made['platform']}{_resumed(made['resumed'])}"),
        ("command", made["command_line"]),
        ("overrides", ", ".join(made["overrides"])),
        ("versions", ", ".join(f"{k} {v}" for k, v in made["versions"].items())),
        ("units", ", ".join(units.values())),
        ("size", f"{many(found['dofs'], 'nodal coordinate')}, "
                 f"{many(found['states'], 'state')}, {many(found['steps'], 'step')}" if found["bodies"] else ""),
    ]
    if found["range"]:
        moves = found["solver"] in OVER_TIME
        ends = " to ".join(f"{t:.6g}" for t in dict.fromkeys(found["range"]))
        rows.append(("time" if moves else "load factor", ends + f" {units['time']}" * moves))
    if found["checkpoint"] is not None:
        rows.append(("resumable", f"from t = {found['checkpoint']:.6g}, by 'ancf2d run CASE --resume'"))
    if "iterations" in found["summary"]:
        rows.append(("iterations", f"{found['summary']['iterations']}"))
    if isinstance(found["summary"].get("wall_s"), (int, float)):
        rows.append(("solve time", f"{found['summary']['wall_s']:.3g} s"))
    rows.append(("accuracy", _accuracy(found["summary"].get("accuracy"))))
    rows += _passed(found["summary"], units)
    rows += _sections(found)
    lines += [f"  {name:<11} {value}" for name, value in rows if value]
    return "\n".join(lines)


def _passed(summary: dict[str, Any], units: dict[str, str]) -> list[tuple[str, str]]:
    """Return the events along a path or a motion: limit points, bifurcations, the first events, and impacts."""
    rows = [(what, f"{number} at load factor {point['factor']:.8g}")
            for key, what in (("limit_points", "limit point"), ("bifurcations", "bifurcation"))
            for number, point in enumerate(summary.get(key, []), start=1)]
    events = summary.get("events", [])
    rows += [("event", f"{event['what']} at {event['t']:.6g} {units['time']}") for event in events[:MOST_EVENTS]]
    left = len(events) - MOST_EVENTS
    rows += [("event", f"and {left} more")] if left > 0 else []
    return rows + _impacts(summary.get("impacts"), units)


def _impacts(impacts: dict[str, Any] | None, units: dict[str, str]) -> list[tuple[str, str]]:
    """Return the number of impacts, the first and the strongest one."""
    if impacts is None:
        return []
    first, strongest = (impact_text(impacts[which], units["force"], units["time"]) for which in ("first", "strongest"))
    return [("impacts", str(impacts["count"])), ("first", first), ("strongest", strongest)]


def impact_text(one: dict[str, Any], force: str, time: str) -> str:
    """Return a description of an impact: bodies, time, place and impulse, with labels as units."""
    return (f"{one['body']} on {one['touched']} at {one['t']:.6g} {time}, S = {one['S']:.4g}: "
            f"{one['impulse']:.6g} {force} {time}")


def _accuracy(accuracy: Any) -> str:
    """Return the estimated error of a run in words, and whether a wanted accuracy was reached; empty without either."""
    if not isinstance(accuracy, dict):
        return ""
    estimate, wanted = accuracy.get("estimate"), accuracy.get("wanted")
    about = "" if estimate is None else f"estimated error {estimate:.1e}"
    if estimate is not None and accuracy.get("scale") is not None:
        about += f" of {accuracy['scale']:.4g}"
    if wanted is None:
        return about
    return f"{about or 'no estimate of the error'}, wanted {wanted:.1e}: " \
           f"{'reached' if accuracy.get('achieved') else 'not reached'}"


def _sections(found: dict[str, Any]) -> list[tuple[str, str]]:
    rows = []
    for name, body in found["bodies"].items():
        rows.append(("body", f"{name}: {many(body['elements'], 'element')} {body['element']}, "
                             f"{body['formulation']}, {many(body['nodes'], 'node')}, "
                             f"length {body['length']:.12g} {found['units']['length']}"
                             + (", height {:.6g} to {:.6g} {}".format(*body["heights"], found["units"]["length"])
                                if body["heights"] else "")))
    for name, columns in found["probes"].items():
        values = ", ".join(f"{q} = {v['value']:.9g}{_unit(v['units'])}" for q, v in columns.items())
        rows.append(("probe", f"{name}: {values}"))
    for contact in found["summary"].get("contacts", []):
        rows.append(("contact", f"{contact['name']}: {_touch(contact, found['units'])}"))
    for body, fields in found["fields"].items():
        parts = [name if f["units"] == "1" else f"{name} [{f['units']}]" for name, f in fields.items()]
        rows.append(("fields", f"{body}: {', '.join(parts)}"))
    energy = found["summary"].get("energy")
    if isinstance(energy, dict):
        unit = f" {found['units']['force']} {found['units']['length']}"
        values = ", ".join(f"{k} = {v:.9g}{unit}" for k, v in energy.items()
                           if isinstance(v, (int, float)))
        rows.append(("energy", values))
    for name, table in found["tables"].items():
        rows.append(("table", f"{name}: {many(table['rows'], 'row')} of "
                              f"{', '.join(table['columns'])}"))
    for name, shape in found["arrays"].items():
        rows.append(("array", f"{name}: {' x '.join(map(str, shape))}"))
    return rows


def _touch(contact: dict[str, Any], units: dict[str, str]) -> str:
    """Return the contact in the last state: the force on the body named first, and its range along that body."""
    if contact["from"] is None:
        return "no contact at the end"
    at, force = f"S = {contact['from']:.4g}", "force = ({:.9g}, {:.9g})".format(*contact["force"])
    if not any(contact["force"]) and contact.get("normal"):
        # forces of a body on itself cancel
        force = f"pressing force = {contact['normal']:.9g}"
    if contact["to"] > contact["from"]:
        at += f" to {contact['to']:.4g}"
    return f"{force} {units['force']}, at {at}"


def _resumed(times: int) -> str:
    return "" if not times else ", resumed once" if times == 1 else f", resumed {times} times"


def _unit(units: str) -> str:
    return "" if units == "1" else f" {units.replace('*', ' ')}"


def _size(count: float) -> str:
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} GB"
