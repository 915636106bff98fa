"""Random frames: members between random nodes, welded or pinned, supported, loaded; closed loops, arcs, polylines."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.random import Generator

from .bodies import RIGID
from .statics import CriticalError, State, large, linear, modes

# lengths in a frame are about 1 times a random unit; heights are a fiftieth to a twelfth of that
HEIGHTS = (0.02, 0.08)
# rotations by loads of the size of forces that bend, below which they act on what is held: all is round-off there
STILL = 1e-9


class Frame:
    """A frame under construction; ``case`` has everything except elements and solver."""

    def __init__(self, rng: Generator) -> None:
        self.rng = rng
        self.unit = 10 ** rng.uniform(-2, 2)
        self.E, self.nu = 10 ** rng.uniform(5, 11.3), float(rng.choice([0.0, 0.3, 0.45]))
        self.bodies: dict[str, Any] = {}
        self.ends: list[list[str]] = []
        self.joints: list[dict[str, Any]] = []
        self.supports: list[dict[str, Any]] = []
        self.loads: list[dict[str, Any]] = []
        self.springs: list[dict[str, Any]] = []
        self.masses: list[dict[str, Any]] = []

    @property
    def case(self) -> dict[str, Any]:
        """Return the mapping."""
        return {"bodies": self.bodies, "joints": self.joints, "boundary_conditions": self.supports,
                "loads": self.loads, "springs": self.springs, "masses": self.masses}

    @property
    def stiffness(self) -> float:
        """Return EI/L^2 of a medium member, the size of forces in bending."""
        return self.E * (0.04 * self.unit) ** 4 / 12 / self.unit**2

    def chance(self, p: float) -> bool:
        """Return True with probability p."""
        return bool(self.rng.random() < p)

    def section(self) -> dict[str, Any]:
        """Return a section in one of its spellings, with the material where it has one."""
        h, b = self.unit * self.rng.uniform(*HEIGHTS), 0.04 * self.unit * self.rng.uniform(0.5, 2)
        A, I, nu = h * b, b * h**3 / 12, self.nu
        material = {"E": self.E, "nu": nu, "rho": 1000.0}
        k = 10 * (1 + nu) / (12 + 11 * nu)
        return [{"section": {"height": h, "width": b}, "material": material},
                {"section": {"A": A, "I": I, "height": h}, "material": material},
                {"section": {"EA": self.E * A, "kGA": k * self.E / (2 * (1 + nu)) * A, "EI": self.E * I,
                             "rhoA": 1000.0 * A, "rhoI": 1000.0 * I}}][self.rng.integers(3)]

    def grow(self, form: str) -> None:
        """Place nodes and members between them."""
        rng, nodes = self.rng, [np.zeros(2)]
        count = int(rng.integers(2, 6))
        while len(nodes) < count:
            place = nodes[rng.integers(len(nodes))] + np.array([math.cos(a := rng.uniform(-math.pi, math.pi)),
                                                                math.sin(a)]) * rng.uniform(0.6, 1.3)
            if min(math.dist(place, other) for other in nodes) > 0.4:
                nodes.append(place)
        pairs = [(int(rng.integers(k)), k) for k in range(1, count)]
        pairs += [(i, j) for i in range(count) for j in range(i) if {(i, j), (j, i)}.isdisjoint(pairs)
                  and self.chance(0.25)]
        self.ends = [[] for _ in nodes]
        for k, pair in enumerate(pairs):
            i, j = pair if self.chance(0.5) else pair[::-1]
            self.bodies[f"m{k}"] = {"geometry": self._geometry(nodes[i], nodes[j], form), **self.section()}
            self.ends[i].append(f"m{k}@0")
            self.ends[j].append(f"m{k}@1")

    def _geometry(self, a: np.ndarray, b: np.ndarray, form: str) -> dict[str, Any]:
        a, b, d = a * self.unit, b * self.unit, (b - a) * self.unit
        if form == "arc":
            bend = self.rng.uniform(0.5, 2.0) * self.rng.choice([-1, 1])
            radius, toward = np.hypot(*d) / (2 * math.sin(abs(bend) / 2)), math.atan2(d[1], d[0]) - bend / 2
            start = toward - math.copysign(math.pi / 2, bend)
            center = a - radius * np.array([math.cos(start), math.sin(start)])
            return {"type": "arc", "center": center.tolist(), "radius": float(radius), "from": float(start),
                    "to": float(start + bend)}
        if form == "polyline":
            corner = a + self.rng.uniform(0.35, 0.65) * d + self.rng.uniform(-0.4, 0.4) * np.array([-d[1], d[0]])
            return {"type": "polyline", "points": [a.tolist(), corner.tolist(), b.tolist()]}
        return {"type": "line", "start": a.tolist(), "end": b.tolist()}

    def hold(self) -> None:
        """Join members at their common nodes, and support the frame."""
        for ends in self.ends:
            if len(ends) > 1 and self.chance(0.25):
                self.joints.append({"type": "pin", "between": [ends[0], ends[-1]]})
                ends = ends[:-1]
            if len(ends) > 1:
                self.joints.append({"type": "weld", "between": list(ends)})
        self.supports.append({"name": "wall", "type": "clamp", "at": self.ends[0][0]})
        for k, ends in enumerate(self.ends[1:]):
            if self.chance(0.4):
                kind = str(self.rng.choice(["pin", "roller", "normal", "clamp", "moved"]))
                special: dict[str, dict[str, Any]] = {
                    "roller": {"type": "roller", "fixed": str(self.rng.choice(["x", "y"]))},
                    "normal": {"type": "roller", "normal": self.rng.normal(size=2).tolist()},
                    "moved": {"type": "prescribed", "uy": 0.02 * self.unit}}
                more = special.get(kind, {"type": kind})
                self.supports.append({"name": f"s{k}", "at": ends[0], **more})

    def place(self) -> str:
        """Return a random point of a body, sometimes an end."""
        name = str(self.rng.choice(list(self.bodies)))
        return f"{name}@{self.rng.choice([0.0, 0.5, 1.0, round(self.rng.uniform(0.1, 0.9), 2)]):g}"

    def load(self) -> None:
        """Load the frame; add springs and point masses."""
        rng, F, L = self.rng, self.stiffness, self.unit
        for _ in range(rng.integers(1, 4)):
            kind = str(rng.choice(["force", "moment", "distributed", "gravity", "follower_force"]))
            v = rng.normal(size=2)
            more: dict[str, Any] = {"value": (F * v).tolist(), "at": self.place()}
            if kind == "moment":
                more["value"] = float(F * L * v[0])
            elif kind == "gravity":
                more = {"value": (F * v / (1000.0 * (0.04 * L) ** 2 * L)).tolist()}
            elif kind == "distributed":
                low, high = np.sort(rng.uniform(0, 1, 2).round(2))
                more = {"value": (F / L * v).tolist(), "on": str(rng.choice(list(self.bodies)))}
                if high - low > 0.2 and self.chance(0.5):
                    more.update({"from": float(low), "to": float(high)})
            self.loads.append({"type": kind, **more})
        if self.chance(0.3):
            away = (L * rng.uniform(2, 3, 2)).tolist()
            self.springs.append({"type": "translational", "between": [self.place(), away], "stiffness": 20 * F / L})
        if self.chance(0.3):
            self.springs.append({"type": "rotational", "between": [self.place(), [0, 0]], "stiffness": F * L})
        if self.chance(0.4):
            self.masses.append({"at": self.place(), "mass": 1000 * (0.04 * L) ** 2 * L * rng.uniform(0.2, 2),
                                "inertia": 1000 * (0.04 * L) ** 2 * L**3 * rng.uniform(0.01, 0.1)})


def probes(case: dict[str, Any]) -> dict[str, str]:
    """Return as probes the ends of all bodies, and every point with a load or constraint, which are nodes of meshes."""
    found = [f"{name}@{s}" for name in case["bodies"] for s in (0, 1)]
    found += [item["at"] for key in ("loads", "masses") for item in case[key] if "at" in item]
    return {f"p{k}": at for k, at in enumerate(dict.fromkeys(found))}


def frame(number: int, elements: tuple[dict[str, Any], ...]) -> tuple[dict[str, Any], State, State | None]:
    """Return a stable frame whose bodies have one of ``elements`` each, for linear and large displacements.

    Loads are such that the frame turns by 0.1 to 0.8 rad at most, and no critical point lies before them.
    """
    for again in range(100):
        rng = np.random.default_rng([number, again])
        case = _drawn(rng, elements)
        case["output"] = {"probes": probes(case), "fields": ["N", "Q", "M"]}
        try:
            return case, *_loaded(case, rng.uniform(0.1, 0.8))
        except (CriticalError, np.linalg.LinAlgError):
            continue
    raise ValueError(f"frame {number} has no load that it can take")


def _drawn(rng: Generator, elements: tuple[dict[str, Any], ...]) -> dict[str, Any]:
    made = Frame(rng)
    made.grow("line" if RIGID in elements else str(rng.choice(["line", "line", "line", "arc", "polyline"])))
    made.hold()
    made.load()
    for k, body in enumerate(made.bodies.values()):
        body["element"] = {**elements[0 if k == 0 else rng.integers(len(elements))]}
    return made.case


def _loaded(case: dict[str, Any], turn: float) -> tuple[State, State]:
    """Scale all loads so that the frame turns by the given angle or less; raise CriticalError if none does."""
    found = linear(case)
    bar = found.scene.bars[0][0]
    if modes(case, 1, degree=4)[0] * bar.length < 1e-4 * math.sqrt(bar.section.EA / bar.section.rhoA):
        raise CriticalError("the frame is loose")
    most = max(abs(found.scene.probe(at, found.x)["theta"]) for at in case["output"]["probes"].values())
    if most < STILL:
        raise CriticalError("the loads move nothing")
    for _ in range(4):
        _scale(case, turn / most)
        try:
            return linear(case), large(case, degree=7)
        except CriticalError:
            turn, most = 0.5 * turn, turn
    raise CriticalError("no load was found that the frame takes")


def _scale(case: dict[str, Any], factor: float) -> None:
    for load in case["loads"]:
        load["value"] = (factor * np.array(load["value"])).tolist()
