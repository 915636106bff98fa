"""Table 2's cantilever in ten load steps: ancf2d beside other tools, and its cost from 8 to a million elements.

Time is the processor's, of the solve alone, after imports, mesh and (for ancf2d) compiled kernels; memory is the
process's peak less what it had after its imports. The tools alternate.
"""

from __future__ import annotations

import os
import statistics
import time
from typing import Any

import numpy as np

from .apart import apart, peak_mb
from .peers import tools
from .scenes import STEPS

CASE = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [2, 0]}}
    section: {{height: {height}, width: 0.1}}
    material: {{E: 2.07e11, nu: 0.3, rho: 7850}}
    element: {{type: {element}, count: {count}{rule}}}
boundary_conditions: [{{type: clamp, at: beam@0}}]
loads: [{{type: force, at: beam@1, value: [0, {load}]}}]
solver: {{type: static}}
output: {{probes: {{tip: beam@1}}}}
"""
TYPES = ["reissner2", "reissner3", "kerkkanen", "vallejo"]
COMPARED = [1000, 10_000]
PEERS = {("exudyn", "geometrically exact"): "peers.static_exudyn", ("opensees", "force-based"): "peers.static_opensees"}
SCALED = ["reissner2", "vallejo"]
SIZES = [8, 100, 1000, 10_000, 100_000, 1_000_000]
# the exponent is fitted from so many elements on; as many are solved once alone
FROM, ONCE = 1000, 1_000_000


def model_of(element: str, count: int, rule: list[int] | None = None, height: float = 0.1,
             load: float = -500e3) -> Any:
    """Return a model of a cantilever; without a rule it has the type's own points, which need not be Gauss points."""
    from ancf2d.case import load_case_text
    from ancf2d.model.build import build_model

    return build_model(load_case_text(CASE.format(height=height, load=load, element=element, count=count,
                                                  rule="" if rule is None else f", quadrature: {rule}")))


def bend(element: str, count: int) -> dict[str, Any]:
    """Solve with ancf2d; return tip, seconds, iterations and memory [MB]."""
    from ancf2d.solvers.state_results import Observer
    from ancf2d.solvers.statics.static import solve_static
    from ancf2d.study.warmup import warm_up

    warm_up(model_of(element, 2))
    base, start = peak_mb(), time.process_time()
    model = model_of(element, count)
    built = time.process_time()
    state, iterations, began = None, 0, time.perf_counter()
    for state in solve_static(model, STEPS):
        iterations += int(state.history["iterations"])
    seconds, wall = time.process_time() - built, time.perf_counter() - began
    assert state is not None
    tip = Observer(model).observe(state)["tip"]
    return {"u": [tip["ux"], tip["uy"]], "build_s": built - start, "solve_s": seconds, "wall_s": wall,
            "iterations": iterations, "memory_mb": peak_mb() - base, "peak_mb": peak_mb()}


def medians(found: list[dict[str, Any]], *keys: str) -> dict[str, Any]:
    """Return the medians of what runs report, or the error where all failed."""
    good = [r for r in found if "error" not in r]
    return {k: statistics.median(r[k] for r in good) for k in keys} if good else {"error": found[0]["error"]}


def compare(elements: int, repeat: int) -> list[dict[str, Any]]:
    """Return the medians of each tool and type, measured in turn; ``ratio`` is to Exudyn's solve where it ran."""
    installed = tools()
    runs = {key: function for key, function in PEERS.items() if key[0] in installed}
    runs |= {("ancf2d", element): "statics.bend" for element in TYPES}
    found: dict[tuple[str, str], list[dict[str, Any]]] = {key: [] for key in runs}
    for _ in range(repeat):
        for key, function in runs.items():
            found[key].append(apart(function, key[1], elements))
    rows, peer = [], None
    for (tool, element), results in found.items():
        row = {"tool": tool, "element": element, **medians(results, "build_s", "solve_s", "memory_mb")}
        if "error" not in row:
            peer = row["solve_s"] if tool == "exudyn" else peer
            one = next(r for r in results if "error" not in r)
            row |= {"ratio": row["solve_s"] / peer if peer else None, "u": one["u"], "iterations": one["iterations"]}
        rows.append(row)
    return rows


def exponent(rows: list[dict[str, Any]]) -> float | None:
    """Return the power of the number of elements that the processor's time grows with, on one core."""
    points = [(r["elements"], r["solve_s"]) for r in rows
              if "solve_s" in r and r["cores"] == "1" and r["elements"] >= FROM]
    if len(points) < 2:
        return None
    n, t = np.log(np.array(points, dtype=float)).T
    return float(np.polyfit(n, t, 1)[0])


def scale(repeat: int) -> dict[str, Any]:
    """Return rows by type, size and cores, and exponents."""
    cores, rows = os.cpu_count() or 1, []
    for element in SCALED:
        for count in SIZES:
            for name, threads in {"1": 1, **({"all": cores} if cores > 1 else {})}.items():
                found = [apart("statics.bend", element, count, threads=threads)
                         for _ in range(1 if count >= ONCE else repeat)]
                rows.append({"element": element, "elements": count, "cores": name, **medians(
                    found, "build_s", "solve_s", "wall_s", "iterations", "memory_mb", "peak_mb")})
    return {"cores": cores, "rows": rows,
            "exponents": [{"element": e, "exponent": exponent([r for r in rows if r["element"] == e])}
                          for e in SCALED]}
