"""Frames of fibres that yield, pushed through a cycle: error against time beside OpenSees (``pip install .[peers]``).

The error is the largest difference of the displacement pushed at, through the cycle, from the tool's own finest mesh,
over the largest displacement. Both have the same fibres, hardening and 40 load steps. Times are the processor's, of
the load steps alone, after imports, mesh and compiling; medians of runs in turn, each in a process of its own.

    python -m scripts.bench.fibres            prints the table
    python -m scripts.bench.fibres --page     writes it into docs/materials.md
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np

from scripts.pages import DOCS, small, stamp, table, write

from .apart import apart
from .peers import tools
from .scenes import CYCLE, DEEP, STEEL, WIDE, YIELDING
from .statics import medians

PAGE, REPEAT = DOCS / "materials.md", 5
# elements in each member; the last are the finest
COUNTS = {("cantilever", "opensees"): (1, 4, 8, 16, 32, 64, 256), ("cantilever", "ancf2d"): (8, 16, 32, 64, 128, 512),
          ("portal", "opensees"): (4, 8, 16, 32, 64, 256), ("portal", "ancf2d"): (8, 16, 32, 64, 128, 512)}
FUNCTIONS = {"opensees": "peers.yielding_opensees", "ancf2d": "fibres.push"}


def case(scene: str, count: int) -> dict[str, Any]:
    """Return a frame as a case: members of ``reissner3`` that are welded, and a force in steps."""
    frame, force = YIELDING[scene], [0.0, 0.0]
    force[frame.along] = frame.push
    ends = list(zip(frame.corners[:-1], frame.corners[1:], strict=True))
    body = {"section": {"height": DEEP, "width": WIDE},
            "element": {"type": "reissner3", "count": count, "shear_factor": STEEL["shear"]},
            "material": {**{k: STEEL[k] for k in ("E", "nu", "yield")}, "hardening": {"kinematic": STEEL["kinematic"]}}}
    bodies = {f"m{k}": {**body, "geometry": {"type": "line", "start": list(a), "end": list(b)}}
              for k, (a, b) in enumerate(ends)}
    held = ["m0@0"] if len(ends) == 1 else ["m0@0", f"m{len(ends) - 1}@1"]
    return {"bodies": bodies, "boundary_conditions": [{"type": "clamp", "at": p} for p in held],
            "joints": [{"type": "weld", "between": [f"m{k}@1", f"m{k + 1}@0"]} for k in range(len(ends) - 1)],
            "loads": [{"type": "force", "at": "m0@1", "value": force,
                       "amplitude": {"type": "table", "t": list(CYCLE[0]), "value": list(CYCLE[1])}}],
            "solver": {"type": "static", "steps": frame.steps}, "output": {"probes": {"point": "m0@1"}}}


def push(scene: str, count: int) -> dict[str, Any]:
    """Solve with ancf2d; return the displacement (steps,) at the end of each load step, and seconds."""
    import ancf2d
    from ancf2d.model.build import build_model
    from ancf2d.solvers.state_results import Observer
    from ancf2d.solvers.statics.static import solve_static

    frame = YIELDING[scene]
    # compiled on first use
    list(solve_static(build_model(ancf2d.load(case(scene, 2))), frame.steps))
    data, began = ancf2d.load(case(scene, count)), time.process_time()
    model = build_model(data)
    built = time.process_time()
    states = list(solve_static(model, frame.steps))
    seconds, observer = time.process_time() - built, Observer(model)
    wanted = np.arange(1, frame.steps + 1) / frame.steps
    ends = [states[int(np.argmin([abs(s.t - t) for s in states]))] for t in wanted]
    return {"u": [observer.observe(s)["point"][("ux", "uy")[frame.along]] for s in ends], "build_s": built - began,
            "solve_s": seconds}


def measure(scene: str, repeat: int = REPEAT) -> list[dict[str, Any]]:
    """Return error and seconds of each tool and mesh, and of the finest ones the largest difference."""
    installed = tools()
    runs = [(tool, n) for (name, tool), counts in COUNTS.items() if name == scene and tool in installed for n in counts]
    found: dict[tuple[str, int], list[dict[str, Any]]] = {run: [] for run in runs}
    for k in range(repeat):
        for tool, n in runs:
            # the finest are run once
            if k == 0 or n != COUNTS[scene, tool][-1]:
                found[tool, n].append(apart(FUNCTIONS[tool], scene, n))
    finest = {tool: np.array(found[tool, COUNTS[scene, tool][-1]][0]["u"]) for tool, _ in runs}
    rows = []
    for (tool, n), results in found.items():
        u, fine = np.array(results[0]["u"]), finest[tool]
        apart_by = max(float(np.abs(fine - other).max()) for other in finest.values())
        rows.append({"scene": scene, "tool": tool, "elements": n, **medians(results, "build_s", "solve_s"),
                     "error": float(np.abs(u - fine).max() / np.abs(fine).max()),
                     "apart": apart_by / float(np.abs(fine).max())})
    return rows


def text(rows: list[dict[str, Any]]) -> str:
    """Return the table."""
    members = {name: len(frame.corners) - 1 for name, frame in YIELDING.items()}
    return table(["frame", "tool", "elements", "error", "load steps [ms]", "and what builds the model [ms]"], [
        [r["scene"], r["tool"], members[r["scene"]] * r["elements"],
         small(r["error"]) if r["error"] else f"finest, {small(r['apart'])} from the other",
         f"{1e3 * r['solve_s']:.1f}", f"{1e3 * (r['solve_s'] + r['build_s']):.1f}"] for r in rows])


if __name__ == "__main__":
    found = text([row for scene in YIELDING for row in measure(scene)])
    print(found)
    if "--page" in sys.argv:
        write(PAGE, "fibres", f"{found}\n\n{stamp('scripts.bench.fibres --page', 'openseespy')}")
