"""Very many events in one motion: the error at its end compared with a closed form, and memory that remains."""

from __future__ import annotations

import gc
import math
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import ancf2d
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import solve_dynamic
from ancf2d.solvers.state_results import Observer
from ancf2d.study.run import prepare
from scripts.pages import small, table

Data = dict[str, Any]


@dataclass
class Ended:
    """A motion with many events: its errors, and the bytes that remained per event over two fifths of it."""

    events: int
    # errors of the end; NaN where the scheme has another period
    position: float
    rate: float
    energy: float
    left: float


def followed(case: Data, t_end: float, events: int, wanted: tuple[float, float], quantities: tuple[str, str]) -> Ended:
    """Solve a motion of a rigid body ``bar`` to ``t_end``, and compare its end with the expected quantities."""
    model = prepare(ancf2d.load({
        "bodies": {"bar": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, "element": {"type": "rigid"},
                           "section": {"EA": 1, "kGA": 1, "EI": 1, "rhoA": 1, "rhoI": 0}}},
        "boundary_conditions": [{"type": "roller", "at": f"bar@{end}", "fixed": "y"} for end in (0, 1)], **case,
        "solver": {"type": "dynamic", "t_end": t_end, "estimate": False, **case["solver"]},
        "output": {"interval": t_end / 5, "probes": {"end": "bar@1"}}}))
    held: list[int] = []
    tracemalloc.start()
    # calls of the kernels so short that no two states wait for their turn, on any machine
    usual, stepping.CHUNK_SECONDS = stepping.CHUNK_SECONDS, 1e-3
    try:
        for k, state in enumerate(solve_dynamic(model, model.case.solver)):
            # each stored state has the log of as many steps
            if k in (2, 4):
                gc.collect()
                held.append(tracemalloc.get_traced_memory()[0])
            end = state
    finally:
        stepping.CHUNK_SECONDS = usual
        tracemalloc.stop()
    found = Observer(model).observe(end)["end"]
    position, rate = (abs(found[q] - w) for q, w in zip(quantities, wanted, strict=True))
    return Ended(events, position, rate, end.report["energy_drift"], (held[1] - held[0]) / (0.4 * events))


def instants(count: int) -> Ended:
    """A sampled controller makes an arm follow a sine: between its sampling times the motion is a parabola."""
    kp, ki, kd, lag, step, J = 20.0, 30.0, 1.0, 0.01, 1e-3, 1.0 / 3.0
    theta = omega = integral = filtered = 0.0
    for k in range(count):
        e = math.sin(3 * k * step) - theta
        rate = (e - filtered) / (lag + step)
        integral += ki * step * e
        filtered += step * rate
        acceleration = (kp * e + integral + kd * rate) / J
        theta, omega = theta + step * omega + 0.5 * step**2 * acceleration, omega + step * acceleration
    motor = {"type": "pid", "input": "sin(3*t) - end.theta", "kp": kp, "ki": ki, "kd": kd, "filter": lag,
             "sample": step}
    torque = {"type": "moment", "at": "bar@0", "value": 1, "amplitude": {"type": "expression", "value": "motor"}}
    return followed({"boundary_conditions": [{"type": "pin", "at": "bar@0"}], "controllers": {"motor": motor},
                     "loads": [torque], "solver": {"tolerance": 1e-10}},
                    count * step, count, (theta, omega), ("theta", "omega"))


def bounces(count: int, method: str = "radau5", tolerance: float = 1e-10) -> Ended:
    """A mass bounces between two springs with a gap, and ends in the middle of a flight."""
    gap, speed, k = 0.1, 3.0, 400.0
    half = 2 * gap / speed + math.pi / math.sqrt(k)
    spring = {"type": "translational", "between": [[-1, 0], "bar@0"], "stiffness": k, "gap": gap}
    steps = {"dt": half / 50} if method == "energy_momentum" else {"tolerance": tolerance}
    end = (0.0, speed * (-1) ** count) if "tolerance" in steps else (math.nan, math.nan)
    return followed({"springs": [spring], "initial": {"velocity": [speed, 0]}, "solver": {"method": method, **steps}},
                    count * half, count, end, ("ux", "vx"))


def conditions(count: int) -> Ended:
    """A mass passes equidistant places; from one to the next a force pushes it, then not, by turns."""
    force, cell, t, v = 2.0, 0.1, 0.0, 3.0
    pushes = [{"type": "force", "at": "bar@0", "value": [force * (-1) ** (k // 2), 0], "active": {
        "after": f"end.ux > {k * cell!r}", "until": f"end.ux > {(k + 1) * cell!r}"}} for k in range(1, count, 2)]
    for k in range(count + 1):
        faster = math.sqrt(v * v + 2 * force * (-1) ** (k // 2) * cell) if k % 2 else v
        t, v = t + 2 * cell / (v + faster), faster
    return followed({"loads": pushes, "initial": {"velocity": [3.0, 0]}, "solver": {"tolerance": 1e-10}},
                    t, count, ((count + 1) * cell, v), ("ux", "vx"))


def kinks(count: int) -> Ended:
    """A piecewise linear force pushes a mass on a spring."""
    T, w, x, v = 0.25, 3.0, 0.0, 0.0
    force = [4.0 * (-1) ** k for k in range(count + 2)]
    for a, b in pairwise(force):
        # beside a/w^2 + slope s, which satisfies the equation of motion
        slope = (b - a) / T / w**2
        A, B = x - a / w**2, (v - slope) / w
        x, v = (b / w**2 + A * math.cos(w * T) + B * math.sin(w * T),
                slope + w * (B * math.cos(w * T) - A * math.sin(w * T)))
    zigzag = {"type": "table", "t": [k * T for k in range(count + 2)], "value": force}
    return followed({"loads": [{"type": "force", "at": "bar@0", "value": [1, 0], "amplitude": zigzag}],
                     "springs": [{"type": "translational", "between": [[-1, 0], "bar@0"], "stiffness": w**2}],
                     "solver": {"tolerance": 1e-10}}, (count + 1) * T, count, (x, v), ("ux", "vx"))


# by what a row is called: of how many events it takes one, and the motion
MOTIONS: dict[str, tuple[int, Callable[[int], Ended]]] = {
    "instants of a sampled controller": (1, instants),
    "bounces between springs with a gap, `energy_momentum`": (1, lambda count: bounces(count, "energy_momentum")),
    "the same, `radau5`, `tolerance: 1e-8`": (10, lambda count: bounces(count, tolerance=1e-8)),
    "kinks of a table": (10, kinks),
    "loads that begin and end on conditions, each asked in every step": (100, conditions)}


def report(count: int) -> str:
    """Return the table of motions with many events; fewer of expensive events."""
    rows = []
    for name, (share, motion) in MOTIONS.items():
        found = motion(count // share)
        errors = [small(x) if math.isfinite(x) else "" for x in (found.position, found.rate, found.energy)]
        rows.append([name, found.events, *errors, f"{found.left:.0f}"])
    return table(["events", "number", "error of the position at the end", "of its rate", "energy drift",
                  "bytes left by an event"], rows)
