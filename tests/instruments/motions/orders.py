"""Order in time of every integrator of ancf2d's own: smooth motions, with constraints and driven ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import ancf2d
from ancf2d.elements.shape import Array
from ancf2d.kernels.motion.advance import INSIDE
from ancf2d.model.build import build_model
from ancf2d.solvers.motion.initial import initial_motion
from ancf2d.solvers.motion.own_integrators import Method
from ancf2d.solvers.motion.problem import make_problem
from ancf2d.solvers.motion.stepping import Stepper
from scripts.pages import small, table

ORDER = {"newmark": 2, "hht": 2, "generalized_alpha": 2, "energy_momentum": 2, "radau5": 5, "radau9": 9}
# how many steps the two runs take; order 9 is soon at round-off, sooner in the smoothest scenes
STEPS = {2: (64, 256), 5: (32, 64), 9: (16, 24)}
SMOOTHEST, FEW = ("slider-crank", "driven arm"), (6, 12)
# of Newton's increments, relative to the size: a little above round-off, below which no iteration is sure to get
TIGHT = 2e-15


def bar(start: list[float], end: list[float], mass: float, inertia: float) -> dict[str, Any]:
    """Return a rigid body."""
    return {"geometry": {"type": "line", "start": start, "end": end},
            "element": {"type": "rigid", "mass": mass, "inertia": inertia}}


def told(value: str) -> dict[str, str]:
    """Return a motion as an expression of t."""
    return {"type": "expression", "value": value}


# so soft that the steps resolve all that it does
SOFT = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, "section": {"height": 0.1, "width": 0.05},
        "material": {"E": 1e5, "nu": 0.3, "rho": 1000.0}, "element": {"type": "cable", "count": 1, "nodes": "regular"}}
PIN, KNEE = [{"type": "pin", "at": "a@0"}], {"type": "pin", "between": ["a@1", "b@0"]}
GRAVITY = [{"type": "gravity", "value": [0, -9.81]}]
# a case without its solver, and the end of its motion [s]
SCENES: dict[str, tuple[dict[str, Any], float]] = {
    "pendulum": ({"bodies": {"a": SOFT}, "boundary_conditions": PIN, "loads": GRAVITY}, 0.32),
    "shaken": ({"bodies": {"a": SOFT}, "boundary_conditions": [{
        "type": "prescribed", "at": "a@0", "ux": told("0.03*sin(6*t)^3"), "uy": told("0.05*(1-cos(7*t))^2")}]}, 0.32),
    "double pendulum": ({"bodies": {"a": bar([0, 0], [1, 0], 1.3, 0.2), "b": bar([1, 0], [1.6, -0.7], 0.9, 0.11)},
                         "boundary_conditions": PIN, "joints": [KNEE], "loads": GRAVITY}, 0.64),
    "slider-crank": ({
        "bodies": {"a": bar([0, 0], [0.2, 0.22], 1.3, 0.2), "b": bar([0.2, 0.22], [1, 0], 0.9, 0.11)},
        "boundary_conditions": PIN, "loads": GRAVITY,
        "joints": [KNEE, {"type": "slider", "at": "b@1", "through": [0, 0], "along": [1, 0]}]}, 0.64),
    "driven arm": ({"bodies": {"a": bar([0, 0], [0.3, 0], 1.3, 0.2), "b": bar([0.3, 0], [0.6, -0.7], 0.9, 0.11)},
                    "boundary_conditions": [{"type": "prescribed", "at": "a@0", "ux": 0, "uy": 0,
                                             "angle": told("0.8*(1-cos(6*t))")}],
                    "joints": [KNEE], "loads": GRAVITY}, 0.64),
}
# newmark is refused where there are multipliers: without damping their forces swing up
PAIRS = [(s, m) for s in SCENES for m in ORDER if m != "newmark" or s in ("pendulum", "shaken")]


def end(scene: str, method: str, steps: int) -> Array:
    """Return displacements and rates at the end of a motion in so many steps (2, n_q), each as a displacement [m]."""
    data, t_end = SCENES[scene]
    dt = t_end / steps
    model = build_model(ancf2d.load({**data, "solver": {"type": "dynamic", "t_end": t_end, "method": method, "dt": dt,
                                                        "max_iterations": 40}}))
    problem, signals = make_problem(model)
    stepper = Stepper(model, problem, signals, model.case.solver, dt, np.zeros(0), 0)
    stepper.m = Method(stepper.method.name, model.case.solver, stepper.p, TIGHT, model.relaxing, stepper.tracks_work)
    stepper.start(*initial_motion(model))
    while not stepper.done:
        for _ in stepper.run():
            pass
    d, v, _ = stepper.full(replace(stepper.last(), kind=INSIDE))
    return np.array([d[:model.n_q], v[:model.n_q]]) * model.weights


def observed(scene: str, method: str, reference: Array) -> tuple[float, float, tuple[int, int], float]:
    """Return the orders of places and of rates, the numbers of steps and the smaller error of places [m]."""
    order = ORDER[method]
    steps = FEW if order == 9 and scene in SMOOTHEST else STEPS[order]
    errors = [np.abs(end(scene, method, n) - reference).max(axis=1) for n in steps]
    seen = np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0])
    return float(seen[0]), float(seen[1]), steps, float(errors[1][0])


def report() -> str:
    """Return the table of orders."""
    rows = []
    references = {scene: end(scene, "radau9", 96) for scene in SCENES}
    for scene, method in PAIRS:
        places, rates, steps, error = observed(scene, method, references[scene])
        rows.append([scene, method, ORDER[method], f"{places:.2f}", f"{rates:.2f}", f"{steps[0]}, {steps[1]}",
                     small(error)])
    return table(["scene", "method", "order", "observed in positions", "in velocities", "steps",
                  "error of positions [m]"], rows)
