"""Random bodies, joined: axes, elements, sections and materials."""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np

from ancf2d.elements.definition import ElementType
from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.elements.registry import ELEMENTS, FAMILY, element_type

from .shapes import Data, at, is_rigid, is_straight, length, mass_per_length, pieces, point, position, stiffness

# degrees of the family: higher ones cost more and are no other code
ORDERS = ((1, 1), (2, 1), (3, 1), (1, 2), (2, 2), (3, 2), (2, 3), (3, 3))
# S of points that something acts on or is joined to
SOMEWHERE = (0.25, 0.3, 0.5, 2.0 / 3.0, 0.8)


def type_of(spec: Data) -> ElementType:
    """Return the element type of a flexible body's ``element``."""
    return element_type(spec["type"], tuple(spec["order"]) if "order" in spec else None)


class Assembly:
    """Bodies and their joints under construction; additions are scaled by their stiffness and period."""

    def __init__(self, rng: random.Random, kind: str) -> None:
        self.rng, self.kind = rng, kind
        self.moves = kind == "dynamic"
        self.case: Data = {"bodies": {}, "boundary_conditions": [], "joints": [], "springs": [], "masses": [],
                           "loads": []}
        self.size = 10 ** rng.uniform(-1.0, 1.0)
        self.E = 10 ** rng.uniform(6.0, 11.0)
        # bodies that move as one if they were rigid, and those that nothing moves
        self.cluster: dict[str, str] = {}
        self.held: set[str] = set()

    def chance(self, share: float) -> bool:
        """Return True with a probability."""
        return self.rng.random() < share

    def near(self, value: float, factor: float = 2.0) -> float:
        """Return a value times a random number from 1/factor to factor."""
        return float(value * factor ** self.rng.uniform(-1, 1))

    @property
    def load_size(self) -> float:
        """Return the force that bends the softest body by about its length."""
        sizes = [stiffness(b)[1] / length(b["geometry"]) ** 2 for b in self.case["bodies"].values() if not is_rigid(b)]
        return min(sizes) if sizes else self.E * self.size**2 * 1e-6

    @property
    def end(self) -> float:
        """Return the time, or load factor, over which amplitudes rise."""
        return self.period if self.moves else 1.0

    @property
    def period(self) -> float:
        """Return about the longest period of the bodies, held at an end."""
        found = [2 * math.pi / 3.516 * math.sqrt(mass_per_length(b) * length(b["geometry"]) ** 4 / stiffness(b)[1])
                 for b in self.case["bodies"].values() if not is_rigid(b)]
        heaviest = max(mass_per_length(b) * length(b["geometry"]) for b in self.case["bodies"].values())
        return max(found) if found else 4 * math.sqrt(heaviest * self.size / self.load_size)

    # ------------------------------------------------------------------ bodies and joints

    def add_body(self, name: str) -> None:
        """Add a body, mostly from a point of an existing one."""
        bodies, anchor = self.case["bodies"], None
        self.cluster[name] = name
        if bodies and self.chance(0.9):
            other = self.rng.choice(list(bodies))
            s = self.rng.choice((0.0, 1.0, 1.0, 1.0, self.rng.choice(SOMEWHERE)))
            anchor = at(other, s)
            start = position(bodies[other]["geometry"], s)
        else:
            start = self.size * np.array([self.rng.uniform(-1, 1), self.rng.uniform(-1, 1)])
        rigid = self.kind != "eigen" and self.chance(0.15)
        bodies[name] = {"geometry": self.geometry(start, rigid)}
        self.close(name, anchor)
        bodies[name].update(self.element(name, rigid))
        if anchor is not None:
            self.join(anchor, at(name, 0.0))

    def geometry(self, start: Any, rigid: bool) -> Data:
        """Return an axis from a point."""
        rng, l, heading = self.rng, self.near(self.size), self.rng.uniform(-math.pi, math.pi)
        curved = 0.5 if rigid else 1.0
        kind = rng.choices(("line", "arc", "polyline", "path", "spline", "curve"),
                           (6, 2 * curved, 2, 0.6 * curved, 0.6 * curved, 0.6 * curved))[0]
        if self.chance(0.2):
            heading = rng.choice((0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi))
        if kind == "arc":
            sweep = rng.choice((-1, 1)) * rng.uniform(0.3, 2.5)
            radius, normal = l / abs(sweep), heading - math.copysign(0.5 * math.pi, sweep)
            center = [start[0] - radius * math.cos(normal), start[1] - radius * math.sin(normal)]
            return {"type": "arc", "center": center, "radius": radius, "from": normal, "to": normal + sweep}
        if kind in ("path", "spline", "curve"):
            return {"type": kind, **self.curved(kind, [float(v) for v in start], l, heading)}
        points, turns = [[float(v) for v in start]], 1 if kind == "line" else rng.choice((2, 2, 3))
        for _ in range(turns):
            step = l / turns if self.chance(0.3) else l / turns * rng.uniform(0.6, 1.4)
            points.append([points[-1][0] + step * math.cos(heading), points[-1][1] + step * math.sin(heading)])
            heading += rng.choice((-1, 1)) * rng.uniform(0.2, 1.8)
        return {"type": "line", "start": points[0], "end": points[1]} if kind == "line" else {
            "type": "polyline", "points": points}

    def curved(self, kind: str, start: list[float], l: float, heading: float) -> Data:
        """Return an axis of about a length from a point: lines and arcs, or smooth through points or by expressions."""
        rng = self.rng
        t = np.array([math.cos(heading), math.sin(heading)])
        n = np.array([-t[1], t[0]])
        if kind in ("path", "spline") and self.chance(0.2):
            return self.closed(kind, start, l, heading)
        if kind == "path":
            bends: list[Data] = []
            for _ in range(rng.choice((1, 1, 2))):
                angle = rng.choice((-1, 1)) * rng.uniform(0.3, 2.0)
                bends += [{"line": 0.5 * self.near(l, 1.5)}, {"arc": 0.5 * self.near(l, 1.5) / abs(angle),
                                                              "angle": angle}]
            return {"start": start, "heading": heading, "pieces": bends}
        if kind == "spline":
            count = rng.choice((3, 4))
            places = [np.array(start) + l * (i / (count - 1) * t + rng.uniform(-0.12, 0.12) * n)
                      for i in range(1, count)]
            return {"points": [start, *(p.tolist() for p in places)]}
        bulge = rng.choice((-1, 1)) * rng.uniform(0.1, 0.4)
        return {key: f"({start[i]!r}) + ({float(l * t[i])!r})*s + ({float(bulge * l * n[i])!r})*sin(2*s)"
                for i, key in enumerate("xy")}

    def closed(self, kind: str, start: list[float], l: float, heading: float) -> Data:
        """Return a ring, a racetrack or a smooth loop through points, of about a length, from a point."""
        rng = self.rng
        if kind == "path":
            turn, straight = rng.choice((-1, 1)) * math.pi, rng.choice((0.0, 0.25 * l))
            bend = {"arc": (0.5 * l - straight) / math.pi, "angle": turn}
            half = [{"line": straight}, bend] if straight else [bend]
            return {"start": start, "heading": heading, "pieces": [*half, *(dict(p) for p in half)], "closed": True}
        count, sense = rng.choice((4, 5)), rng.choice((-1, 1))
        loop = [rng.uniform(0.8, 1.2) * l / 6 * np.array([math.cos(a), sense * math.sin(a)])
                for a in heading + 2 * math.pi / count * np.arange(count)]
        return {"points": [(np.array(start) + p - loop[0]).tolist() for p in loop], "closed": True}

    def close(self, name: str, anchor: str | None) -> None:
        """Sometimes let a straight body end at a point of another one."""
        bodies = self.case["bodies"]
        geometry, others = bodies[name]["geometry"], [n for n in bodies if n != name]
        if geometry["type"] != "line" or len(others) < 2 or not self.chance(0.3):
            return
        target = at(self.rng.choice(others), self.rng.choice((0.0, 1.0)))
        end = [float(v) for v in point(self.case, target)]
        if math.dist(end, geometry["start"]) > 0.3 * self.size:
            geometry["end"] = end
            self.join(target, at(name, 1.0))

    def join(self, old: str, new: str) -> None:
        """Join two points at the same position."""
        kind, joints = self.rng.choices(("weld", "pin", "prismatic", None), (6, 4, 2, 0.1))[0], self.case["joints"]
        target = old.split("@")[0]
        if kind == "prismatic":
            # at a node, round-off would choose the element whose direction counts
            if old.split("@")[1] != "0.3" or is_rigid(self.case["bodies"][target]):
                kind = "pin"
            else:
                joints.append({"type": "prismatic", "point": new, "on": target})
        if kind in ("weld", "pin"):
            same = [j for j in joints if j["type"] == kind and old in j["between"]]
            if same and self.chance(0.5):
                same[0]["between"].append(new)
            else:
                joints.append({"type": kind, "between": [old, new]})
        if kind == "weld":
            self.merge(target, new.split("@")[0])
        if kind and self.chance(0.2):
            joints[-1].setdefault("name", f"joint{len(joints)}")

    def merge(self, one: str, other: str) -> None:
        """Record that two bodies turn as one."""
        a, b = self.cluster[one], self.cluster[other]
        self.cluster = {n: a if c == b else c for n, c in self.cluster.items()}

    # ------------------------------------------------------------------ elements, sections, materials

    def element(self, name: str, rigid: bool) -> Data:
        """Return element, section and material of a body."""
        rng = self.rng
        if rigid:
            return self.rigid(name)
        kind = rng.choice((*ELEMENTS, FAMILY, FAMILY))
        spec: Data = {"type": kind}
        if kind == FAMILY:
            spec["order"] = list(rng.choice(ORDERS))
        kinds = type_of(spec)
        least = pieces(self.case["bodies"][name]["geometry"])
        spec["count"] = max(least, rng.choice((1, 2, 2, 3, 4)))
        offered = [f.name for f in FORMULATIONS.values() if f.refuse(kinds) is None]
        formulation = kinds.formulation
        if kinds.preset and self.chance(0.15):
            return {**self.matter(), "element": {**spec, "preset": "paper"}}
        if self.chance(0.4):
            formulation = spec["formulation"] = rng.choice(offered)
        if kinds.section_kind != "tangent" and self.chance(0.15):
            spec["shear_factor"] = rng.choice((0.85, "timoshenko", "none"))
        if self.chance(0.1) and FORMULATIONS[formulation].selective:
            nx, ny = FORMULATIONS[formulation].rule(kinds)
            spec["quadrature"] = {"normal": [nx + 1, ny], "shear": [nx, ny]}
        elif self.chance(0.1):
            nx, ny = FORMULATIONS[formulation].rule(kinds)
            spec["quadrature"] = rng.choice(([nx + 1, ny], [nx + 1, ny + 1], "exact"))
            straight = is_straight(self.case["bodies"][name])
            if spec["quadrature"] == "exact" and not (straight and FORMULATIONS[formulation].exact(kinds)):
                del spec["quadrature"]
        stiff = kinds.section_kind != "interpolated" or formulation == "structural"
        matter = self.matter(stiff)
        if "layers" in matter["section"]:
            # layers in a continuum have one rule, and another formulation is the default of some types
            spec = {k: v for k, v in spec.items() if k != "quadrature"}
        return {**matter, "element": spec}

    def rigid(self, name: str) -> Data:
        """Return a rigid body's element, sometimes with its own mass and inertia."""
        spec: Data = {"type": "rigid"}
        if self.chance(0.5):
            matter = self.matter()
            while "layers" in matter["section"]:
                matter = self.matter()
            return {**matter, "element": spec}
        l = length(self.case["bodies"][name]["geometry"])
        mass = self.near(self.E * 1e-7 * self.size**3)
        return {"element": {**spec, "mass": mass, "inertia": self.near(mass * l**2)}}

    def matter(self, stiff: bool = False) -> Data:
        """Return section and material: a rectangle, an area, or, for types that take them, stiffnesses."""
        rng = self.rng
        h, w = self.size * 10 ** rng.uniform(-1.7, -0.7), self.size * 10 ** rng.uniform(-1.5, -0.7)
        E, nu, rho = self.near(self.E), rng.choice((0.0, 0.3, 0.3, 0.45, -0.2)), self.near(self.E * 1e-6)
        material: Data = {"E": E, "nu": nu, "rho": rho}
        if self.moves and self.chance(0.12):
            material["damping"] = {"kelvin_voigt": 10 ** rng.uniform(-4, -2)}
        shares = (6, 2, 2, 0.6) if stiff else (6, 2, 0.5, 0.4)
        kind = rng.choices(("rectangle", "area", "stiffness", "layers"), shares)[0]
        if kind == "layers" and "damping" not in material:
            axis = rng.choice(("middle", "centroid", h * rng.uniform(0.2, 0.8)))
            layers = [{"height": part * h, "material": {"E": self.near(E, 3), "nu": nu, "rho": self.near(rho)}}
                      for part in rng.choice(((1.0,), (0.3, 0.7), (0.2, 0.5, 0.3)))]
            return {"section": {"width": w, "layers": layers, "axis": axis}}
        if kind in ("rectangle", "layers"):
            varying = self.chance(0.15)
            return {"section": {"height": self.profile(h) if varying else h,
                                "width": self.profile(w) if varying and self.chance(0.5) else w}, "material": material}
        A, I = h * w, w * h**3 / 12
        if kind == "area":
            return {"section": {"A": A, "I": self.near(I, 1.5), "height": h}, "material": material}
        return {"section": {"EA": E * A, "kGA": self.near(0.3, 1.4) * E * A, "EI": E * I, "rhoA": rho * A,
                            **({"rhoI": rho * I} if self.chance(0.6) else {})}}

    def profile(self, value: float) -> Data:
        """Return a table along the body, of straight lines and sometimes a kink or a jump."""
        a, b, c = (value * self.rng.uniform(0.7, 1.3) for _ in range(3))
        return self.rng.choice(({"s": [0.0, 1.0], "value": [a, b]}, {"s": [0.0, 0.5, 1.0], "value": [a, c, b]},
                                {"s": [0.0, 0.5, 0.5, 1.0], "value": [a, a, c, b]}))
