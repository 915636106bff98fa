"""Conservation over very many steps and turns: energy, momentum, steady rotation, strain of rigid motion."""

from __future__ import annotations

import math

import numpy as np

from ancf2d.elements import registry
from ancf2d.model.build import build_model
from ancf2d.model.rotation import CoordinateKinds
from ancf2d.solvers.system import System
from scripts.pages import small, table

from .runs import Motion, case, follow, follow_from

# a rod of steel that is hit at one end for a hundredth of a second, and then flies, turns and swings
FLYING = """
title: Steel rod in free flight
bodies:
  rod:
    geometry: {{type: line, start: [0, 0], end: [1, 0]}}
    section: {{height: 0.02, width: 0.02}}
    material: {{E: 2.07e11, nu: 0.3, rho: 7850}}
    element: {{type: {element}, count: 4}}
loads:
  - {{type: force, at: rod@1, value: [300, 2000], amplitude: {{type: table, t: [0, 0.005, 0.01], value: [0, 1, 0]}}}}
solver: {{type: dynamic, t_end: {end}, dt: {dt}, method: {method}, estimate: false}}
output: {{every: {every}, probes: {{tip: rod@1}}}}
"""
PUSH, DT = 0.01, 1e-4

# a rod of rubber that turns about its middle: stretched by 1e-3
OMEGA = 20.0
BODY = """
bodies:
  rod:
    geometry: {{type: line, start: [-0.5, 0], end: [0.5, 0]}}
    section: {{height: 0.02, width: 0.02}}
    material: {{E: 2e7, nu: 0.3, rho: 1000}}
    element: {{type: {element}, count: 4}}
"""
STEADY = BODY + """
boundary_conditions: [{{type: clamp, at: rod@0.5, hold: section}}]
steady_rotation: {{omega: {omega}, about: [0, 0]}}
solver: {{type: static, tolerance: 1e-14}}
output: {{probes: {{tip: rod@1}}}}
"""
TURNING = BODY + """
initial: {{from: start.h5, rotation_rate: {{omega: {omega}, about: [0, 0]}}}}
solver: {{type: dynamic, t_end: {end}, {solver}, estimate: false}}
output: {{every: {every}, probes: {{tip: rod@1}}}}
"""
WAYS = (("vallejo", "method: energy_momentum, dt: 3e-4"), ("cable", "method: energy_momentum, dt: 3e-4"),
        ("vallejo", "method: radau9, tolerance: 1e-14"), ("reissner3", "method: radau9, tolerance: 1e-14"),
        ("vallejo", "method: radau9, dt: 5e-3"), ("vallejo", "method: generalized_alpha, dt: 3e-4"))


def drift(element: str, steps: int, method: str = "energy_momentum") -> dict[str, float]:
    """Return the relative drift of energy and momenta of a freely flying steel rod over many steps."""
    loaded = case(FLYING.format(element=element, end=steps * DT, dt=DT, every=max(1, steps // 1000), method=method))
    motion = follow(loaded, momentum=True)
    free = motion.t > PUSH * (1.0 + 1e-9)
    total = np.array([e["kinetic"] + e["strain"] for e in motion.energies])[free]
    strain = np.array([e["strain"] for e in motion.energies])[free]
    momenta = motion.momenta[free]
    speed = float(np.hypot(*momenta[0, :2]))
    return {"energy": float(np.max(np.abs(total / total[0] - 1.0))), "gain": float(np.max(total / total[0] - 1.0)),
            "linear": float(np.hypot(*(momenta[:, :2] - momenta[0, :2]).T).max()) / speed,
            "angular": float(np.max(np.abs(momenta[:, 2] / momenta[0, 2] - 1.0))),
            "strain": float(strain.max() / total[0]), "step_us": 1e6 * motion.summary["wall_s"] / steps,
            "turns": abs(motion.column("tip", "theta")[-1]) / (2.0 * math.pi),
            "way": float(np.hypot(*motion.place("tip")[-1]))}


def drifts(steps: int) -> str:
    """Return the table of quantities that energy_momentum conserves."""
    rows = []
    for element in ("vallejo", "cable"):
        f = drift(element, steps)
        rows.append([element, f"{steps:.0e}", f"{f['turns']:.0f}", f"{f['way']:.0f} m", f"{100 * f['strain']:.1f} %",
                     small(f["energy"]), small(f["linear"]), small(f["angular"]), f"{f['step_us']:.0f} us"])
    return table(["type", "steps", "revolutions", "distance", "largest share of strain energy", "energy",
                  "linear momentum", "angular momentum", "time per step"], rows)


def turning(element: str, solver: str, turns: float, states: int = 200) -> Motion:
    """Return the motion of a rod that begins in steady rotation. Raises ComputationError if it fails."""
    end = 2.0 * math.pi * turns / OMEGA
    dt = float(solver.split("dt:")[1]) if "dt:" in solver else 1e-3
    motion = follow_from(STEADY.format(element=element, omega=OMEGA), TURNING.format(
        element=element, omega=OMEGA, end=repr(end), solver=solver, every=max(1, round(end / dt / states))))
    if motion.outcome.failure is not None:
        raise motion.outcome.failure
    return motion


def steady(element: str, solver: str, turns: float) -> tuple[float, int, float]:
    """Return the largest relative change of the strain energy of a turning rod, steps and seconds."""
    motion = turning(element, solver, turns)
    strain = np.array([e["strain"] for e in motion.energies])
    return float(np.max(np.abs(strain / strain[0] - 1.0))), motion.summary["steps"], motion.summary["wall_s"]


def spun(element: str, solver: str, turns: float) -> tuple[float, list[str]]:
    """Return the largest relative change of energy and angular momentum of a freely rotating rod, and warnings."""
    motion = turning(element, solver, turns)
    total, momentum = np.array([e["kinetic"] + e["strain"] for e in motion.energies]), motion.momenta[:, 2]
    change = max(np.max(np.abs(total / total[0] - 1.0)), np.max(np.abs(momentum / momentum[0] - 1.0)))
    return float(change), motion.outcome.warnings


def steadies(turns: float) -> str:
    """Return the table of rods in steady rotation."""
    rows = []
    for element, solver in WAYS:
        change, steps, seconds = steady(element, solver, turns)
        rows.append([element, f"`{solver}`", f"{turns:g}", str(steps), small(change), f"{seconds:.0f} s"])
    return table(["type", "solver", "revolutions", "steps", "change of strain energy", "time"], rows)


def turned_strain(element: str, turns: float) -> float:
    """Return the tensile strain with the energy of a unit rod of four elements after a rigid rotation.

    Its digits are those of positions and angles: about 2^-53 of them over the length of an element.
    """
    text = BODY.format(element=element) + "solver: {type: eigen, modes: 1}"
    model = build_model(case(text))
    angle, kinds = 2.0 * math.pi * turns, CoordinateKinds(model.meshes.values())
    c, s, e = math.cos(angle), math.sin(angle), model.e0
    d = np.zeros(model.n_q)
    x, y = e[kinds.x], e[kinds.x + 1]
    d[kinds.x], d[kinds.x + 1] = (c - 1.0) * x - s * y, s * x + (c - 1.0) * y
    d[kinds.theta] = angle
    return math.sqrt(2.0 * abs(System(model).forces(d, 0.0).energy) / (2e7 * 0.02**2))


def turned() -> str:
    """Return the table of strains after 1000 turns and a third."""
    names = [*registry.ELEMENTS, "ancf, order: [3, 3]"]
    found = {name: turned_strain(name, 1000.0 + 1.0 / 3.0) for name in names}
    return table(["type", "strain"], [[f"`{name}`", small(value)] for name, value in found.items()])
