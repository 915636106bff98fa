"""What a controller adds to a step: a flexible arm that a PD motor drives, beside a spring and damper in its place.

Both give the same motion in as many iterations, so that the ratio of times is what the controller costs. Processor
times of interleaved runs in one process, per step of 1 ms, without imports, mesh and compiling.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import ancf2d
from ancf2d.solvers.motion.dynamic import solve_dynamic
from ancf2d.study.run import prepare

STEPS, STEP = 4000, 1e-3
METHODS = ("radau5", "radau9", "generalized_alpha")
MOTOR = {"type": "moment", "at": "arm@0", "value": 1, "amplitude": {"type": "expression"}}
SPRING = {"type": "rotational", "between": [[0, 0], "arm@0"], "stiffness": 4, "damping": 0.8}


def motor(text: str, **more: Any) -> dict[str, Any]:
    """Return a motor at the hub with this torque."""
    return {"loads": [{**MOTOR, "amplitude": {"type": "expression", "value": text}}], **more}


WAYS: dict[str, dict[str, Any]] = {
    "spring and damper": {"springs": [SPRING]},
    "PD motor": motor("-4*hub.theta - 0.8*hub.omega"),
    "PD motor, sampled every 0.1 s": motor("pd", controllers={
        "pd": {"type": "pid", "input": "-hub.theta", "kp": 4, "kd": 0.8, "sample": 0.1}}),
    "PID motor with filter": motor("pid", controllers={
        "pid": {"type": "pid", "input": "-hub.theta", "kp": 4, "ki": 1, "kd": 0.8, "filter": 0.01}})}


def model(way: str, method: str) -> Any:
    """Return the model of an arm that is driven this way."""
    return prepare(ancf2d.load({
        "bodies": {"arm": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                           "section": {"height": 0.008, "width": 0.02},
                           "material": {"E": 7e10, "nu": 0.33, "rho": 2700, "damping": {"kelvin_voigt": 1e-4}},
                           "element": {"type": "reissner3", "count": 8}}},
        "boundary_conditions": [{"type": "pin", "at": "arm@0"}], "initial": {"rotation_rate": {"omega": 3}},
        "solver": {"type": "dynamic", "t_end": STEPS * STEP, "dt": STEP, "method": method, "estimate": False},
        "output": {"interval": STEPS * STEP, "probes": {"hub": "arm@0"}}, **WAYS[way]}))


def measure(repeat: int) -> list[dict[str, Any]]:
    """Return the time of a step by method and way, and its ratio to that with spring and damper."""
    out = []
    for method in METHODS:
        times: dict[str, list[float]] = {way: [] for way in WAYS}
        for k in range(repeat + 1):
            for way in WAYS:
                built = model(way, method)
                began = time.process_time()
                *_, end = solve_dynamic(built, built.case.solver)
                # the first run may compile
                if k:
                    times[way].append((time.process_time() - began) / end.report["steps"])
        for way, found in times.items():
            ratio = statistics.median(a / b for a, b in zip(found, times["spring and damper"], strict=True))
            out.append({"method": method, "way": way, "step_us": 1e6 * statistics.median(found), "ratio": ratio})
    return out
