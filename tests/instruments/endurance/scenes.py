"""Small cases of every solver, runs of them in separate processes, and digests of their results."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py

from scripts.pages import ROOT

# what differs between runs of the same case: when, how long, where
PASSING = ("wall", "time", "date", "command", "output", "case_name", "host", "resumed", "summary")

_BODY: dict[str, Any] = {
    "geometry": {"type": "line", "start": [0, 0], "end": [2, 0]}, "section": {"height": 0.1, "width": 0.1},
    "material": {"E": 2.07e9, "nu": 0.3, "rho": 7850}, "element": {"type": "vallejo", "count": 8}}
_CLAMP = [{"name": "wall", "type": "clamp", "at": "beam@0"}]
_LOADS = [{"type": "force", "at": "beam@1", "value": [0, -2000]}]


def case(solver: dict[str, Any], count: int = 8, **more: Any) -> dict[str, Any]:
    """Return a cantilever with a force at its tip, with ``count`` elements and a given solver."""
    body = {**_BODY, "element": {"type": "vallejo", "count": count}}
    return {"bodies": {"beam": body}, "boundary_conditions": _CLAMP, "loads": _LOADS, "solver": solver,
            "goal": {"probe": "tip", "quantity": "uy"}, "output": {"probes": {"tip": "beam@1"}}, **more}


def scenes(count: int = 8) -> dict[str, dict[str, Any]]:
    """Return a case of each solver."""
    modes = {k: v for k, v in case({"type": "eigen", "modes": 6}, count).items() if k != "goal"}
    column = {**case({"type": "buckling", "modes": 3}, count),
              "loads": [{"type": "force", "at": "beam@1", "value": [-1000, 0]}]}
    column.pop("goal")
    return {"linear_static": case({"type": "linear_static"}, count), "static": case({"type": "static"}, count),
            "path": case({"type": "static", "method": "arc_length", "steps": 200}, count), "eigen": modes,
            "buckling": column, "dynamic": case({"type": "dynamic", "t_end": 0.02, "dt": 0.001}, count)}


# a motion that goes on for minutes, storing as it goes
LONG = {**case({"type": "dynamic", "t_end": 60, "dt": 1e-3}), "output": {"every": 1, "probes": {"tip": "beam@1"}}}


def write(folder: Path, name: str, data: Mapping[str, Any]) -> Path:
    """Write a case; return its path."""
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def start(folder: Path, *arguments: str, prefix: Sequence[str] = (), **environment: str) -> subprocess.Popen[str]:
    """Start the command line in its own process and session."""
    return subprocess.Popen([*prefix, sys.executable, "-m", "ancf2d", *arguments], text=True, cwd=folder,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
                            env={**os.environ, "PYTHONPATH": str(ROOT), **environment})


def finished(process: subprocess.Popen[str], seconds: float = 600.0) -> tuple[int, str]:
    """Return exit code and stderr of a process."""
    _, err = process.communicate(timeout=seconds)
    return process.returncode, err


def bits(path: Path) -> str:
    """Return a digest of all numbers of a result file, bit for bit, except times and paths."""
    digest = hashlib.sha256()

    def take(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and not any(word in name for word in PASSING):
            digest.update(name.encode() + str(node.shape).encode() + node[()].tobytes())

    with h5py.File(path) as file:
        file.visititems(take)
    return digest.hexdigest()
