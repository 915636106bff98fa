"""Far too long steps: the true error of pendulum (1) and the estimate that the run reports."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ancf2d.errors import CaseError
from ancf2d.solvers.motion.integrators import INTEGRATORS
from scripts.pages import small, table

from .runs import Motion, case, distance, follow

PENDULUM = """
title: Pendulum (1)
bodies:
  rod:
    geometry: {{type: line, start: [0, 0], end: [1.8, 0]}}
    section: {{height: 0.008, width: 0.03125}}
    material: {{E: 2.07e11, nu: 0.3, rho: 2766.67}}
    element: {{type: {element}, count: {count}}}
boundary_conditions: [{{type: pin, at: rod@0}}]
loads: [{{type: gravity, value: [0, -9.81]}}]
solver: {{type: dynamic, t_end: 1.5, {solver}}}
output: {{interval: 0.01, probes: {{tip: rod@1}}}}
"""
METHODS = [m.name for m in INTEGRATORS.values() if m.scipy is None]
ELEMENTS = ("reissner3", "cable", "vallejo")
# an estimate holds where the truth is at most so many times as large
COVERS = 10.0
# what warnings say, in short
TOO_LARGE, UNKNOWN = "warns", "no estimate"
TOLD = {"steps are too large": TOO_LARGE, "no error estimate": UNKNOWN}


@dataclass(frozen=True)
class Trap:
    """A run with long steps: its true and its estimated error, relative to the tip's displacement, and its warnings."""

    element: str
    method: str
    code: int
    truth: float | None = None
    estimate: float | None = None
    cut: int = 0
    said: str = ""
    steps: int = 0

    @property
    def honest(self) -> bool:
        """Whether it failed, cut its steps, reported that it has no estimate, or has one that covers the true error."""
        if self.code or self.cut or self.said == UNKNOWN:
            return True
        return self.estimate is not None and self.truth is not None and self.truth <= COVERS * self.estimate


def motion(element: str, count: int, solver: str) -> Motion:
    """Return a motion of pendulum (1)."""
    return follow(case(PENDULUM.format(element=element, count=count, solver=solver)))


def trap(element: str, method: str, solver: str, count: int, fine: Motion) -> Trap:
    """Return the result of a method with given steps or tolerance, compared with the fine motion of the same mesh."""
    try:
        found = motion(element, count, f"method: {method}, {solver}")
    except CaseError as error:
        return Trap(element, method, 2, said=error.problems[0].message.removeprefix("solver.method: "))
    cut = int(found.summary.get("rejected", 0))
    if found.outcome.failure is not None:
        return Trap(element, method, 1, cut=cut, said=found.summary["reason"])
    truth = distance(found.place("tip"), fine.place("tip")) / fine.extent("tip")
    said = next((short for words, short in TOLD.items() if any(words in w for w in found.outcome.warnings)), "")
    steps = int(found.summary["steps"])
    return Trap(element, method, 0, truth, found.summary["accuracy"]["estimate"], cut, said, steps)


def traps(solvers: tuple[str, ...], count: int) -> Iterator[Trap]:
    """Yield the results of all methods and types with too long steps."""
    for element in ELEMENTS:
        fine = motion(element, count, "method: radau9, tolerance: 1e-9")
        for method in METHODS:
            for solver in solvers:
                yield trap(element, method, solver, count, fine)


def report() -> str:
    """Return the table for dt = 0.01, and further steps and meshes."""
    rows, more = [], []
    for t in traps(("dt: 0.01",), 8):
        numbers = [small(x) for x in (t.truth, t.estimate)]
        rows.append([t.element, t.method, *numbers, str(t.cut) if t.code != 2 else "", str(t.code), t.said,
                     "ok" if t.honest else "MISLEADS"])
        more.append(t)
    for count in (4, 16):
        more += list(traps(("dt: 0.02", "dt: 0.01", "dt: 0.005"), count))
    ran = [t for t in more if t.code != 2]
    plain = [t for t in ran if not t.code and not t.cut and t.truth is not None]
    worst = max((t.truth / t.estimate for t in plain if t.truth and t.estimate), default=np.nan)
    text = (f"The table and further runs with dt = 0.005, 0.01 and 0.02 s and 4 and 16 elements are {len(ran)} runs. "
            f"{len(plain)} rejected no step; their true error is at most {worst:.1f} times the estimate. "
            f"{sum(not t.honest for t in ran)} runs mislead.")
    return table(["type", "method", "true error", "estimate", "steps rejected", "exit code", "message", ""],
                 rows) + f"\n\n{text}"


def tolerances() -> str:
    """Return the table of errors by tolerance of adaptive steps."""
    rows, count, wanted = [], 8, ("1e-3", "1e-4", "1e-5", "1e-6", "1e-7")
    fine = {e: motion(e, count, "method: radau9, tolerance: 1e-10") for e in ("reissner3", "vallejo")}
    for method in METHODS:
        element = "vallejo" if INTEGRATORS[method].conserves else "reissner3"
        found = [trap(element, method, f"tolerance: {t}", count, fine[element]) for t in wanted]
        for what, cells in (("true", [t.truth for t in found]), ("estimated", [t.estimate for t in found])):
            rows.append([method if what == "true" else "", what, *map(small, cells)])
        rows.append(["", "steps", *(str(t.steps) for t in found)])
    return table(["method", "error", *(f"tolerance {t}" for t in wanted)], rows)
