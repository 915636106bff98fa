"""The same scene in other units, stiffer or heavier: the same numbers by every solver."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from .cell import Cell, Found
from .scenes import BY_LABEL, DEFAULTS, Beam, Subject, cantilever, force, solve

# relative: what the same scene in other units may differ by
SAME = 1e-9
PLAIN = Beam(L=1.0, h=0.05, b=0.05, E=1e7, nu=0.3, rho=1000.0)


@dataclass(frozen=True)
class Units:
    """One metre, pascal and kilogram per cubic metre in these units."""

    length: float = 1.0
    stress: float = 1.0
    density: float = 1.0

    def beam(self) -> Beam:
        """Return the plain beam in these units."""
        x = self.length
        return Beam(PLAIN.L * x, PLAIN.h * x, PLAIN.b * x, PLAIN.E * self.stress, PLAIN.nu, PLAIN.rho * self.density)

    @property
    def force(self) -> float:
        """One newton."""
        return self.stress * self.length**2

    @property
    def time(self) -> float:
        """One second."""
        return self.length * math.sqrt(self.density / self.stress)


def bent(subject: Subject, u: Units) -> list[float]:
    """Return the dimensionless tip displacement of a cantilever in large bending."""
    P = 2.0 * PLAIN.EI * u.force
    run = solve(cantilever(subject, u.beam(), 6, [force([0, -P])]))
    tip, wall = run.probes["tip"], run.reactions["wall"]
    return [tip["ux"] / u.length, tip["uy"] / u.length, tip["theta"], wall["fy"] / u.force,
            wall["m"] / (u.force * u.length), run.summary["energy"]["strain"] / (u.force * u.length)]


def small(subject: Subject, u: Units) -> list[float]:
    """Return the dimensionless tip displacement of a cantilever in small bending."""
    run = solve(cantilever(subject, u.beam(), 6, [force([0, -1e-3 * u.force])], {"type": "linear_static"}))
    return [run.probes["tip"]["uy"] / u.length, run.probes["tip"]["theta"], run.reactions["wall"]["fy"] / u.force]


def modes(subject: Subject, u: Units) -> list[float]:
    """Return the lowest frequencies of a clamped beam, dimensionless."""
    run = solve(cantilever(subject, u.beam(), 6, [], {"type": "eigen", "modes": 4}))
    return [f["omega"] * u.time for f in run.summary["frequencies"]]


def buckling(subject: Subject, u: Units) -> list[float]:
    """Return the buckling load of a clamped column, dimensionless."""
    run = solve(cantilever(subject, u.beam(), 6, [force([-u.force, 0])], {"type": "buckling", "modes": 1}))
    return [run.summary["load_factors"][0]]


def path(subject: Subject, u: Units) -> list[float]:
    """Return a column followed by arc length, dimensionless."""
    P = 2.0 * PLAIN.EI * (math.pi / 2) ** 2 * u.force
    aside = {**force([0, 1e-2 * PLAIN.EI * u.force]), "amplitude": {"type": "constant"}}
    run = solve(cantilever(subject, u.beam(), 6, [force([-P, 0]), aside], {"type": "static", "method": "arc_length"}))
    return [run.probes["tip"]["ux"] / u.length, run.probes["tip"]["uy"] / u.length]


def swing(subject: Subject, u: Units, **solver: Any) -> list[float]:
    """Return a falling pendulum, dimensionless."""
    beam = u.beam()
    g = 9.81 * u.length / u.time**2
    case = {"bodies": {"beam": beam.body(subject, 4)}, "boundary_conditions": [{"type": "pin", "at": "beam@0"}],
            "loads": [{"type": "gravity", "value": [0, -g]}],
            "solver": {"type": "dynamic", "t_end": 0.3 * u.time, "estimate": False, **solver},
            "output": {"probes": {"tip": "beam@1"}}}
    case["solver"].update({"dt": solver["dt"] * u.time} if "dt" in solver else {"tolerance": 1e-6, **solver})
    run = solve(case)
    tip = run.probes["tip"]
    return [tip["x"] / u.length, tip["y"] / u.length, tip["vx"] * u.time / u.length,
            run.summary["energy"]["kinetic"] / (u.force * u.length)]


# a coarser tolerance leaves steps of SciPy's integrators at the limit of stability of the axial vibrations, where which
# steps are rejected depends on round-off
FINE = 1e-9

SCENES: dict[str, Callable[..., list[float]]] = {
    "linear statics": small, "statics": bent, "arc length": path, "modes": modes, "buckling": buckling,
    "motion, radau5": swing, "motion, generalized_alpha": partial(swing, method="generalized_alpha", dt=1e-3),
    "motion, energy_momentum": partial(swing, method="energy_momentum", dt=1e-3),
    "motion, newmark": partial(swing, method="newmark", dt=1e-3), "motion, hht": partial(swing, method="hht", dt=1e-3),
    "motion, radau9": partial(swing, method="radau9"), "motion, RK45": partial(swing, method="RK45", tolerance=FINE),
    "motion, BDF": partial(swing, method="BDF", tolerance=FINE),
}


@cache
def _plain(scene: str, label: str) -> tuple[float, ...]:
    return tuple(SCENES[scene](BY_LABEL[label], Units()))


def compared(scene: str, label: str, units: Units) -> Found:
    """Compare a scene in other units with the plain one."""
    found, plain = np.array(SCENES[scene](BY_LABEL[label], units)), np.array(_plain(scene, label))
    return Found(float(np.max(np.abs(found - plain)) / np.max(np.abs(plain))))


AXES = {
    "Young's modulus": [(f"{E:g}", Units(stress=E / PLAIN.E)) for E in (1.0, 1e3, 2.07e11, 1e13, 1e15)],
    "lengths": [(name, Units(length=x)) for name, x in (("um", 1e-6), ("mm", 1e-3), ("3.7 m", 3.7), ("km", 1e3))],
    "density": [(f"{rho:g}", Units(density=rho / PLAIN.rho)) for rho in (1e-3, 1.0, 1e5)],
    "all units": [("mm, N/mm^2, t/mm^3", Units(1e3, 1e-6, 1e-12)),
                  ("um, E = 1e15, rho = 1e-3", Units(1e-6, 1e8, 1e-6)),
                  ("km, E = 1, rho = 1e5", Units(1e3, 1e-7, 1e2))],
}
STATIC = ("linear statics", "statics", "arc length", "buckling")
FEW = ("vallejo", "cable", "reissner3", "2d2n")


def rows() -> Iterator[Cell]:
    """Yield every scene in every unit; motions by SciPy for one type only, as they take many steps."""
    for axis, values in AXES.items():
        for value, units in values:
            for scene in SCENES:
                if axis == "density" and scene in STATIC:
                    continue
                labels = ["cable"] if scene in ("motion, RK45", "motion, BDF") else \
                    [s.label for s in DEFAULTS] if not scene.startswith("motion") else list(FEW)
                if scene == "motion, energy_momentum":
                    labels.remove("reissner3")
                for label in labels:
                    yield Cell(f"{axis}: the same scene", value, label, scene, SAME,
                               partial(compared, scene, label, units), quick=label == "vallejo" and axis == "all units")
