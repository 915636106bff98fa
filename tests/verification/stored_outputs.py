"""Outputs of cases as small readable JSON files, and comparison with them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

STORED = Path(__file__).parent / "stored"
RTOL = 1e-9
KINDS = {"x": "length", "y": "length", "ux": "displacement", "uy": "displacement", "theta": "angle",
         "fx": "force", "fy": "force", "N": "force", "Q": "force", "m": "moment", "M": "moment",
         "strain": "energy", "potential": "energy", "kinetic": "energy", "omega": "frequency", "factor": "load factor",
         "response": "response"}


def outputs(summary: dict[str, Any]) -> dict[str, Any]:
    """Return the stored values of a run, with modes by kind and number, so that another name is a deviation too.

    Of a motion only places and energies: rates and reactions follow steps, which round-off decides.
    """
    if summary["solver"] == "dynamic":
        places = {p: {k: values[k] for k in ("x", "y", "ux", "uy", "theta")} for p, values in summary["probes"].items()}
        return {"dofs": summary["dofs"], "elements": summary["elements"], "probes": places,
                "energy": {k: summary["energy"][k] for k in ("kinetic", "strain", "potential")}}
    out = {"dofs": summary["dofs"], "elements": summary["elements"], "probes": summary["probes"],
           "reactions": summary["reactions"], "energy": summary["energy"]}
    if "frequencies" in summary:
        out["modes"] = {f"{f['kind']} {f['number']}": {"omega": f["omega"]} for f in summary["frequencies"]}
    if "load_factors" in summary:
        out["buckling"] = {str(i): {"factor": f} for i, f in enumerate(summary["load_factors"], 1)}
    if "response" in summary:
        out["responses"] = {c["what"]: {"response": c["value"]} for c in summary["checks"]}
    return out


def flatten(stored: dict[str, Any]) -> dict[str, float]:
    """Return {'probes.tip.ux': value, ...}."""
    out: dict[str, float] = {}
    for key, value in stored.items():
        if isinstance(value, dict):
            out.update({f"{key}.{k}": v for k, v in flatten(value).items()})
        else:
            out[key] = value
    return out


def scales(values: dict[str, float]) -> dict[str, float]:
    """Return the size of each kind of value, which judges values that vanish by symmetry.

    A rotation counts as displacement over length, a moment as force times length or as energy.
    """
    size = dict.fromkeys(set(KINDS.values()), 0.0)
    for key, value in values.items():
        kind = KINDS.get(key.rsplit(".", 1)[-1])
        if kind:
            size[kind] = max(size[kind], abs(value))
    length = max(size["length"], size["displacement"]) or 1.0
    size["angle"] = max(size["angle"], size["displacement"] / length)
    size["force"] = max(size["force"], max(size["moment"], size["energy"]) / length)
    size["moment"] = max(size["moment"], size["force"] * length)
    return size


def differences(new: dict[str, Any], old: dict[str, Any], rtol: float = RTOL, unbalanced: float = 0.0) -> list[str]:
    """Return one line per value that deviates by more than ``rtol`` of itself or of its kind, the worst first.

    Forces below those that the solution leaves ``unbalanced`` are round-off, and so are moments and energies below
    what these do over the length of the scene.
    """
    a, b = flatten(new), flatten(old)
    found = [(float("inf"), f"{k} is {'new' if k in a else 'gone'}") for k in a.keys() ^ b.keys()]
    size = scales(b)
    arm = size["length"] or 1.0
    known = {"force": unbalanced, "moment": unbalanced * arm, "energy": unbalanced * arm}
    for key in a.keys() & b.keys():
        kind = KINDS.get(key.rsplit(".", 1)[-1])
        allowed = rtol * max(abs(b[key]), size[kind]) if kind else 0.0
        error = abs(a[key] - b[key])
        if kind in known and max(abs(a[key]), abs(b[key])) <= known[kind]:
            continue
        if not error <= allowed:
            share = error / allowed if allowed else float("inf")
            apart = f"{error:.3g} apart (allowed {allowed:.3g})"
            found.append((share, f"{key}: stored {b[key]!r}, now {a[key]!r}, {apart}"))
    return [text for _, text in sorted(found, reverse=True)]


def path(case: Path, root: Path) -> Path:
    """Return the file that holds the outputs of a case."""
    return STORED / case.relative_to(root).with_suffix(".json")


def write(file: Path, stored: dict[str, Any]) -> None:
    """Write outputs as JSON, with every digit."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")


def read(file: Path) -> dict[str, Any]:
    """Return stored outputs."""
    return json.loads(file.read_text(encoding="utf-8"))
