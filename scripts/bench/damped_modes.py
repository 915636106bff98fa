"""Time of damped modes beside undamped ones of the same large model.

    python scripts/bench/damped_modes.py [ELEMENTS ...]

A cantilever with two dashpots; ten modes or pairs, the solve alone, the best of two runs.
"""

from __future__ import annotations

import sys

from ancf2d.case import load_case_text
from ancf2d.study.run import run_case

CASE = """
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


def seconds(count: int, damped: bool) -> float:
    """Return the time of the solve [s]."""
    text = CASE.format(count=count, damped=str(damped).lower())
    return min(float(run_case(load_case_text(text)).summary["wall_s"]) for _ in range(2))


def main(arguments: list[str]) -> None:
    """Print a row for each number of elements."""
    print("elements  undamped [s]  damped [s]  ratio")
    for count in [int(a) for a in arguments] or [1000, 10_000, 100_000]:
        plain, damped = seconds(count, False), seconds(count, True)
        print(f"{count:8d}  {plain:12.2f}  {damped:10.2f}  {damped / plain:5.1f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
