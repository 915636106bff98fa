"""A computation in which every step depends on the last bit of the one before, for tests of interruption."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from synthetic import HEADER, coordinates, tangent_body

from ancf2d.results import Checkpoint, ResultWriter, part_path
from ancf2d.results.journal import open_hdf5

DYNAMIC = {**HEADER, "solver": "dynamic"}
# what says when and how a file was made, which no two runs share
OWN = ("created", "wall_time_s", "resumed", "command_line")


def begin(path: Path, resume: bool, header: dict[str, Any] = DYNAMIC) -> ResultWriter:
    e0 = coordinates("tangent", np.linspace(0, 1, 3), 0.0)
    if resume:
        return ResultWriter.resume(path, header, e0)
    return ResultWriter(path, header, [tangent_body("beam", 2, 1.0, 0.1)], e0)


def states(w: ResultWriter, until: int, every: int = 1, pause: float = 0.0) -> None:
    """Append states up to number ``until``, with a checkpoint at every ``every``-th."""
    found = w.resumed
    x = np.full(12, 0.3) + 1e-3 * np.arange(12) if found is None else found.values["x"].copy()
    first = 0 if found is None else int(found.values["k"]) + 1
    for k in range(first, until + 1):
        n = k % 3 + 1
        for _ in range(n):
            x[:] = 3.9 * x * (1 - x)
        steps = {"step": np.arange(n), "t": k + np.arange(n) / n, "dt": np.full(n, 1 / n), "error": x[:n]}
        shown = x.copy()
        values = {"x": shown, "k": np.array(k)}
        keep = Checkpoint(float(k), values, {"sum": float(x.sum())}) if k % every == 0 else None
        w.append(float(k), shown, steps=steps, energies={"kinetic": x[0], "strain": x[1]},
                 probes={"tip": {"x": x[2], "y": -x[2]}}, v=x - 1, checkpoint=keep)
        shown[:] = np.nan  # the arrays that were handed over are used again
        if pause:
            time.sleep(pause)


def content(path: Path) -> dict[str, Any]:
    """Every dataset and attribute of a file, bit for bit."""
    found: dict[str, Any] = {}

    def visit(name: str, node: h5py.Group | h5py.Dataset) -> None:
        found.update({f"{name}@{k}": v.tobytes() if isinstance(v, np.ndarray) else v for k, v in node.attrs.items()
                      if k not in OWN})
        if isinstance(node, h5py.Dataset) and name != "summary":
            found[name] = (node.shape, str(node.dtype), np.asarray(node[()]).tobytes())
    with open_hdf5(path) as file:
        visit("/", file)
        file.visititems(visit)
    return found


if __name__ == "__main__":
    import ancf2d.results.writer as writer_module

    writer_module.FLUSH_SECONDS = float(sys.argv[2])
    target = Path(sys.argv[1])
    writer = begin(target, part_path(target).exists())
    print("ready", flush=True)
    states(writer, int(sys.argv[3]), pause=1e-3)
    writer.finish({})
