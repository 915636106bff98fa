"""Estimated and true errors of time steps, over motions, methods and step lengths."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ancf2d.errors import Ancf2dError
from ancf2d.study.run import load
from scripts.pages import table

from .cases import MOTIONS
from .runs import Motion, distance, follow

# by case: until when its motion is not chaotic
ENDS = {"pendulum1_reissner3": 0.8, "pendulum2_reissner3": 0.5, "pendulum2_cable": 0.5, "free_rod": 3.0,
        "double_pendulum": 0.6, "slider_crank_reissner3": 0.2, "four_bar": 0.2, "spin_up": 4.0, "pid_arm": 2.0}
COUNT, STATES = 8, 20
STEPS = {"radau5": (50, 100, 200, 400, 800), "radau9": (50, 100, 200, 400, 800),
         "generalized_alpha": (200, 400, 800, 1600, 3200), "hht": (200, 400, 800, 1600, 3200)}
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
# errors below this, relative to the displacements, are round-off
FLOOR = 1e-11


def run(name: str, **solver: Any) -> Motion:
    """Return the motion of a case with at most COUNT elements in each body. Raises ComputationError if it fails."""
    bodies, end = load(MOTIONS / f"{name}.yaml").case.bodies, ENDS[name]
    fewer = [f"bodies.{b}.element.count={COUNT}" for b, body in bodies.items()
             if body.element.type != "rigid" and body.element.count > COUNT]
    keys = ", ".join(f"{k}: {str(v).lower()}" for k, v in {"type": "dynamic", "t_end": end, **solver}.items())
    motion = follow(load(MOTIONS / f"{name}.yaml", [
        *fewer, f"solver={{{keys}}}", f"output.interval={end / STATES!r}", "expected=[]"]))
    if motion.outcome.failure is not None:
        raise motion.outcome.failure
    return motion


def ratios(name: str, method: str) -> Iterator[tuple[bool, float]]:
    """Yield, for each run of a case, whether its steps are fixed, and the estimate over the true error."""
    true = run(name, method="radau9", tolerance="1.0e-12", estimate=False)
    for fixed, values in ((True, STEPS[method]), (False, TOLERANCES)):
        for value in values:
            setting = {"dt": repr(ENDS[name] / value)} if fixed else {"tolerance": f"{value:.1e}"}
            try:
                motion = run(name, method=method, **setting)
            except Ancf2dError:
                continue
            error = max(distance(motion.place(p), true.place(p)) / motion.extent(p) for p in true.probes
                        if motion.extent(p) > 0.0)
            estimate = motion.summary["accuracy"]["estimate"]
            if estimate is not None and error > FLOOR:
                yield fixed, estimate / error


def report() -> str:
    """Return the table of shares."""
    rows = []
    for method in STEPS:
        found = [pair for name in ENDS for pair in ratios(name, method)]
        for fixed, how in ((True, "`dt`"), (False, "`tolerance`")):
            x = np.array([ratio for one, ratio in found if one == fixed])
            shares = [np.mean(x < 0.5), np.mean(x < 1), np.mean((x >= 1) & (x <= 5)), np.mean(x > 10)]
            rows.append([method, how, len(x), f"{x.min():.2g}", *(f"{100 * s:.0f} %" for s in shares),
                         f"{np.median(x):.2g}"])
    return table(["method", "steps by", "runs", "lowest estimate/true", "below 0.5", "below 1", "1 to 5", "above 10",
                  "median"], rows)
