"""Random mechanisms: chains, four-bars, slider-cranks, rods on rods, free and sprung rods; rigid or flexible."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.random import Generator

from .bodies import RIGID

# flexible bodies move for so long, and are loaded smoothly: what starts at once makes waves that no mesh resolves
SOFT = 0.25
SMOOTH = {"type": "expression", "value": f"3*(t/{SOFT})^2 - 2*(t/{SOFT})^3"}


class Mechanism:
    """A mechanism under construction, about 1 m large with motions of seconds; ``case`` is its mapping."""

    def __init__(self, rng: Generator, element: dict[str, Any]) -> None:
        self.rng, self.element = rng, element
        self.rigid = element == RIGID
        self.t_end = 1.0 if self.rigid else SOFT
        angle = rng.uniform(-math.pi, math.pi)
        self.R = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        self.case: dict[str, Any] = {
            "bodies": {}, "joints": [], "boundary_conditions": [], "loads": [], "springs": [], "masses": [],
            "solver": {"type": "dynamic", "t_end": self.t_end, "estimate": False},
            "output": {"interval": self.t_end / 20}}

    def chance(self, p: float) -> bool:
        """Return True with probability p."""
        return bool(self.rng.random() < p)

    def turned(self, place: Any) -> list[float]:
        """Return a position as the mechanism is rotated in the plane."""
        return [float(v) for v in self.R @ np.array(place, float)]

    def bar(self, name: str, a: Any, b: Any, element: dict[str, Any] | None = None) -> None:
        """Add a straight body."""
        rng, element = self.rng, element or self.element
        h, width, rho = rng.uniform(0.03, 0.05), rng.uniform(0.02, 0.06), rng.uniform(1000, 3000)
        body = {"geometry": {"type": "line", "start": self.turned(a), "end": self.turned(b)},
                "section": {"height": h, "width": width},
                "material": {"E": 10 ** rng.uniform(6.7, 7.3), "nu": 0.3, "rho": rho},
                "element": {**element}}
        if element == RIGID and self.chance(0.5):
            L = math.dist(a, b)
            body["element"].update(mass=rho * h * width * L, inertia=rho * h * width * L**3 * rng.uniform(0.03, 0.2))
            del body["section"], body["material"]
        self.case["bodies"][name] = body

    def pin(self, *points: str) -> None:
        """Pin bodies to each other, or one to the ground."""
        if len(points) == 1:
            supports = self.case["boundary_conditions"]
            supports.append({"name": f"pin{len(supports)}", "type": "pin", "at": points[0]})
        else:
            self.case["joints"].append({"type": "pin", "between": list(points)})

    def some(self) -> str:
        """Return a point of a body."""
        return f"{self.rng.choice(list(self.case['bodies']))}@{self.rng.choice([0.0, 0.5, 0.75, 1.0]):g}"

    def dress(self) -> None:
        """Add gravity, and sometimes springs, dampers, masses, loads."""
        rng, case = self.rng, self.case
        if self.chance(0.8):
            weight = {"type": "gravity", "value": self.turned((7 if self.rigid else 3) * rng.normal(size=2))}
            case["loads"].append(weight if self.rigid else {**weight, "amplitude": SMOOTH})
        if self.chance(0.4):
            ends = [self.some(), self.turned(rng.uniform(2, 3, 2))]
            case["springs"].append({"type": "translational", "between": ends, "stiffness": 10 ** rng.uniform(0, 2),
                                    "damping": 10 ** rng.uniform(-1, 0.5),
                                    **({"length": rng.uniform(1, 3)} if self.rigid else {})})
        if self.chance(0.4):
            case["springs"].append({"type": "rotational", "between": [self.some(), [0, 0]],
                                    "angle": rng.uniform(-1, 1) if self.rigid else 0.0,
                                    "stiffness": 10 ** rng.uniform(-1, 1), "damping": 10 ** rng.uniform(-2, -1)})
        if self.chance(0.4):
            case["masses"].append({"at": self.some(), "mass": rng.uniform(0.1, 1), "inertia": rng.uniform(0, 0.02)})
        over = [{"type": "sine", "frequency": 1.3, "phase": 0.4 if self.rigid else 0.0}, SMOOTH,
                {"type": "expression", "value": "t*exp(-2*t)"}]
        for kind, size in (("force", 8.0), ("follower_force", 5.0), ("moment", 2.0)):
            if self.chance(0.25):
                size *= 1.0 if self.rigid else 0.1
                value = size * rng.normal() if kind == "moment" else (size * rng.normal(size=2)).tolist()
                case["loads"].append({"type": kind, "at": self.some(), "value": value,
                                      "amplitude": over[rng.integers(len(over))]})
        if self.chance(0.2):
            case["damping"] = {"rayleigh": {"alpha": rng.uniform(0.1, 1)}}


def chain(m: Mechanism) -> None:
    """A pendulum of one to three links."""
    place, before = np.zeros(2), None
    for k in range(m.rng.integers(1, 4)):
        angle = m.rng.uniform(-math.pi, math.pi)
        end = place + m.rng.uniform(0.4, 0.8) * np.array([math.cos(angle), math.sin(angle)])
        m.bar(f"link{k}", place, end)
        m.pin(*([] if before is None else [before]), f"link{k}@0")
        place, before = end, f"link{k}@1"
    if m.chance(0.4):
        m.case["initial"] = {"rotation_rate": {"omega": float(m.rng.uniform(-6, 6)), "about": [0.0, 0.0]}}


def _loop(m: Mechanism) -> list[np.ndarray]:
    """Return the four positions of a four-bar away from its dead points."""
    a, angle = m.rng.uniform(0.2, 0.35), m.rng.uniform(0.6, 2.4)
    return [np.zeros(2), a * np.array([math.cos(angle), math.sin(angle)]), np.array([m.rng.uniform(0.8, 1.0),
            m.rng.uniform(0.5, 0.7)]), np.array([m.rng.uniform(0.9, 1.1), m.rng.uniform(-0.1, 0.1)])]


def four_bar(m: Mechanism) -> None:
    """Crank, coupler and rocker; the crank is rigid and sometimes driven."""
    a, b, c, d = _loop(m)
    m.bar("crank", a, b, RIGID)
    m.bar("coupler", b, c)
    m.bar("rocker", c, d)
    m.pin("crank@0")
    m.pin("crank@1", "coupler@0")
    m.pin("coupler@1", "rocker@0")
    m.pin("rocker@1")
    _drive(m)


def slider_crank(m: Mechanism) -> None:
    """A crank, a rod, and its end on a line, with a mass."""
    a, angle = m.rng.uniform(0.15, 0.3), m.rng.uniform(-math.pi, math.pi)
    b, c = a * np.array([math.cos(angle), math.sin(angle)]), np.array([m.rng.uniform(0.7, 1.0), 0.05])
    m.bar("crank", [0, 0], b, RIGID)
    m.bar("rod", b, c)
    m.pin("crank@0")
    m.pin("crank@1", "rod@0")
    m.case["joints"].append({"type": "slider", "at": "rod@1", "through": m.turned(c), "along": m.turned([1.0, 0.1])})
    m.case["masses"].append({"at": "rod@1", "mass": 0.4})
    _drive(m)


def _drive(m: Mechanism) -> None:
    """Drive the crank by a polynomial, or release it."""
    if m.chance(0.5):
        a, b = m.rng.uniform(-3, 3, 2)
        m.case["boundary_conditions"].append({
            "name": "drive", "type": "prescribed", "at": "crank@0",
            "angle": {"type": "expression", "value": f"{a:.3f}*t^{2 if m.rigid else 3} + {b:.3f}*t^4"}})


def sliding(m: Mechanism) -> None:
    """A rod whose end slides along another rod, which is longer than the end can reach."""
    m.bar("rail", [0, 0], [1.8, 0.15], RIGID)
    m.bar("arm", [0.5, 0.8], [0.6, 0.05])
    m.pin("rail@0")
    m.pin("arm@0")
    m.case["joints"].append({"type": "prismatic", "point": "arm@1", "on": "rail"})
    m.case["springs"].append({"type": "translational", "between": ["arm@1", "rail@0"], "stiffness": 200.0,
                              "damping": 1.0})


def free(m: Mechanism) -> None:
    """Two pinned rods in free flight; rigid ones have initial velocities that violate the pin."""
    m.bar("a", [0, 0], [0.7, 0.2])
    m.bar("b", [0.7, 0.2], [1.2, -0.4])
    m.pin("a@1", "b@0")
    whole = {"velocity": m.rng.normal(size=2).tolist(),
             "rotation_rate": {"omega": float(m.rng.normal()), "about": [0.3, 0.1]}}
    m.case["initial"] = whole
    if m.rigid:
        m.case["initial"] = {"bodies": {"a": whole, "b": {"velocity": m.rng.normal(size=2).tolist()}}}


def sprung(m: Mechanism) -> None:
    """A rod wound up by a moment against a torsion spring, also by whole turns; a force releases it."""
    m.bar("rod", [0, 0], [0.8, 0.1])
    m.pin("rod@0")
    k = m.rng.uniform(4, 6)
    m.case["springs"].append({"type": "rotational", "between": [[0, 0], "rod@0"], "stiffness": k, "damping": 0.05})
    m.case["loads"].append({"type": "moment", "at": "rod@0", "value": float(k * m.rng.uniform(-6, 6))})
    m.case["loads"].append({"type": "force", "at": "rod@1", "value": [1.0, 2.0] if m.rigid else [0.1, 0.2],
                            "amplitude": {"type": "ramp", "t1": 0.5} if m.rigid else SMOOTH})
    m.case["initial"] = {"from": "static"}


FORMS = [chain, four_bar, slider_crank, sliding, free, sprung]


def mechanism(number: int, element: dict[str, Any]) -> dict[str, Any]:
    """Return a mechanism whose links are of one kind of elements."""
    m = Mechanism(np.random.default_rng([number, 1]), element)
    form = FORMS[number % len(FORMS)]
    form(m)
    if form is not sprung:
        m.dress()
    used = [f"{name}@{s}" for name in m.case["bodies"] for s in (0, 1)]
    m.case["output"]["probes"] = {f"p{k}": at for k, at in enumerate(used)}
    return m.case
