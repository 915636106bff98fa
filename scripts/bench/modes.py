"""Modes of long meshes: time, peak memory and digits of the 20 lowest, and damped beside undamped ones.

    python -m scripts.bench.modes [ELEMENTS ...]

prints the second: ten modes or pairs of a cantilever with two dashpots, the solve alone, the best of two runs.
"""

from __future__ import annotations

import resource
import sys
from typing import Any

from .apart import apart, peak_mb

PINNED = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [2, 0]}}
    section: {{height: 0.4, width: 0.4}}
    material: {{E: 1e9, nu: 0.3, rho: 7850}}
    element: {{type: {element}, count: {count}}}
boundary_conditions: [{{type: pin, at: beam@0}}, {{type: roller, at: beam@1, fixed: y}}]
solver: {{type: eigen, modes: 20}}
"""
DASHPOTS = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [1, 0]}}
    section: {{EA: 1.0e7, kGA: 1.0e7, EI: 1, rhoA: 1, rhoI: 1.0e-7}}
    element: {{type: reissner3, count: {count}}}
boundary_conditions: [{{type: clamp, at: beam@0}}]
springs:
  - {{type: translational, between: [beam@1, [1, 1.0e+6]], stiffness: 0, damping: 1}}
  - {{type: translational, between: [beam@0.4, [0.4, 1.0e+6]], stiffness: 0, damping: 0.3}}
solver: {{type: eigen, modes: 10, damped: {damped}}}
"""
TYPES, COUNTS = ["reissner2", "vallejo"], (1000, 100_000)
# Timoshenko's first frequency of the pinned beam [rad/s]
EXACT = 95.63398088


def solved(text: str) -> dict[str, Any]:
    """Return the summary of a case, with the processor's seconds and the peak memory [MB] of the whole process."""
    from ancf2d.case import load_case_text
    from ancf2d.study.run import run_case

    summary = run_case(load_case_text(text)).summary
    used = resource.getrusage(resource.RUSAGE_SELF)
    return {"omega": [f["omega"] for f in summary["frequencies"]], "solve_s": summary["wall_s"],
            "process_s": used.ru_utime + used.ru_stime, "memory_mb": peak_mb()}


def compare() -> list[dict[str, Any]]:
    """Return what each type needs and reaches with few and with many elements."""
    rows = []
    for element in TYPES:
        coarse = None
        for count in COUNTS:
            row = apart("modes.solved", PINNED.format(element=element, count=count))
            coarse = coarse or row["omega"]
            away = max(abs(a / b - 1) for a, b in zip(row["omega"], coarse, strict=True))
            rows.append({"element": element, "elements": count, **row, "to_exact": abs(row["omega"][0] / EXACT - 1),
                         "to_coarse": away})
    return rows


def main() -> None:
    """Print a row for each number of elements."""
    print("elements  undamped [s]  damped [s]  ratio")
    for count in [int(a) for a in sys.argv[1:]] or [1000, 10_000, 100_000]:
        plain, damped = (min(float(apart("modes.solved", DASHPOTS.format(count=count, damped=way))["solve_s"])
                             for _ in range(2)) for way in ("false", "true"))
        print(f"{count:8d}  {plain:12.2f}  {damped:10.2f}  {damped / plain:5.1f}", flush=True)


if __name__ == "__main__":
    main()
