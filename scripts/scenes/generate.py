"""Random scenes that a user could have written: every kind of body, joint, support, load and solver."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from typing import Any

import numpy as np

from ancf2d.elements.definition import ElementType
from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.elements.registry import ELEMENTS, FAMILY, element_type
from ancf2d.solve.schemes import INTEGRATORS, SCHEMES

from .amplitudes import random_amplitude
from .shapes import Data, at, extent, is_rigid, length, mass_per_length, pieces, point, position, stiffness

SOLVERS = {"linear_static": 5, "static": 5, "path": 1, "eigen": 3, "buckling": 2, "dynamic": 5}
# degrees of the family: higher ones cost more and are no other code
ORDERS = ((1, 1), (2, 1), (3, 1), (1, 2), (2, 2), (3, 2), (2, 3), (3, 3))
# SciPy's integrators call Python at every stage, and explicit ones take steps as short as the fastest vibration: theirs
# are a smaller share of the motions, and these are shorter
METHODS = tuple(name for name in INTEGRATORS if name not in SCHEMES)
SHORT = 0.01
NAMES = ("a", "b", "c", "d")
# S of points that something acts on or is joined to
SOMEWHERE = (0.25, 0.3, 0.5, 2.0 / 3.0, 0.8)


def scene(seed: int, number: int, solver: str | None = None) -> Data:
    """Return the scene of a number as the data of a case; the same in every process."""
    rng = random.Random(f"scene {seed} {number}")
    kind = solver or rng.choices(list(SOLVERS), list(SOLVERS.values()))[0]
    # plain numbers, as files have them
    made: Data = json.loads(json.dumps(Maker(rng, kind).made()))
    return made


def type_of(spec: Data) -> ElementType:
    """Return the element type of a flexible body's ``element``."""
    return element_type(spec["type"], tuple(spec["order"]) if "order" in spec else None)


class Maker:
    """A scene while it is made."""

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
        self.allows_rigid = kind not in ("eigen", "buckling")

    def chance(self, share: float) -> bool:
        """Return True with a probability."""
        return self.rng.random() < share

    def near(self, value: float, factor: float = 2.0) -> float:
        """Return a value times a random number from 1/factor to factor."""
        return float(value * factor ** self.rng.uniform(-1, 1))

    # ------------------------------------------------------------------ the whole

    def made(self) -> Data:
        """Return the case."""
        names = list(NAMES)
        self.rng.shuffle(names)
        for name in names[: self.rng.choice((1, 1, 2, 2, 3, 4))]:
            self.add_body(name)
        self.support()
        self.add_springs()
        self.add_masses()
        self.add_loads()
        if self.moves:
            self.start()
        elif self.kind in ("static", "eigen") and self.chance(0.06):
            self.turn_steadily()
        self.case["solver"] = self.solver()
        self.ask()
        return {key: value for key, value in self.case.items() if value not in ([], {})}

    @property
    def load_size(self) -> float:
        """Return the force that bends the softest body by about its length."""
        sizes = [stiffness(b)[1] / length(b["geometry"]) ** 2 for b in self.case["bodies"].values() if not is_rigid(b)]
        return min(sizes) if sizes else self.E * self.size**2 * 1e-6

    @property
    def end(self) -> float:
        """Return the time, or load factor, over which amplitudes rise."""
        return self.period if self.moves else 1.0

    # ------------------------------------------------------------------ bodies and joints

    def add_body(self, name: str) -> None:
        """Add a body, mostly from a point of one that is there."""
        bodies, anchor = self.case["bodies"], None
        self.cluster[name] = name
        if bodies and self.chance(0.9):
            other = self.rng.choice(list(bodies))
            s = self.rng.choice((0.0, 1.0, 1.0, 1.0, self.rng.choice(SOMEWHERE)))
            anchor = at(other, s)
            start = position(bodies[other]["geometry"], s)
        else:
            start = self.size * np.array([self.rng.uniform(-1, 1), self.rng.uniform(-1, 1)])
        rigid = self.allows_rigid and self.chance(0.15)
        bodies[name] = {"geometry": self.geometry(start, rigid)}
        self.close(name, anchor)
        bodies[name].update(self.element(name, rigid))
        if anchor is not None:
            self.join(anchor, at(name, 0.0))

    def geometry(self, start: Any, rigid: bool) -> Data:
        """Return an axis from a point."""
        rng, l, heading = self.rng, self.near(self.size), self.rng.uniform(-math.pi, math.pi)
        kind = rng.choices(("line", "arc", "polyline"), (6, 0 if rigid else 2, 2))[0]
        if self.chance(0.2):
            heading = rng.choice((0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi))
        if kind == "arc":
            sweep = rng.choice((-1, 1)) * rng.uniform(0.3, 2.5)
            radius, normal = l / abs(sweep), heading - math.copysign(0.5 * math.pi, sweep)
            center = [start[0] - radius * math.cos(normal), start[1] - radius * math.sin(normal)]
            return {"type": "arc", "center": center, "radius": radius, "from": normal, "to": normal + sweep}
        points, turns = [[float(v) for v in start]], 1 if kind == "line" else rng.choice((2, 2, 3))
        for _ in range(turns):
            step = l / turns if self.chance(0.3) else l / turns * rng.uniform(0.6, 1.4)
            points.append([points[-1][0] + step * math.cos(heading), points[-1][1] + step * math.sin(heading)])
            heading += rng.choice((-1, 1)) * rng.uniform(0.2, 1.8)
        return {"type": "line", "start": points[0], "end": points[1]} if kind == "line" else {
            "type": "polyline", "points": points}

    def close(self, name: str, anchor: str | None) -> None:
        """Let a straight body end at a point of another one, sometimes."""
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
        """Join two points that are at the same place."""
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
        """Remember that two bodies turn as one."""
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
            straight = self.case["bodies"][name]["geometry"]["type"] != "arc"
            if spec["quadrature"] == "exact" and not (straight and FORMULATIONS[formulation].exact(kinds)):
                del spec["quadrature"]
        stiff = kinds.section_kind != "interpolated" or formulation == "structural"
        return {**self.matter(stiff), "element": spec}

    def rigid(self, name: str) -> Data:
        """Return a rigid body's element, with mass and inertia of its own sometimes."""
        spec: Data = {"type": "rigid"}
        if self.chance(0.5):
            return {**self.matter(), "element": spec}
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
        kind = rng.choices(("rectangle", "area", "stiffness"), (6, 2, 2 if stiff else 0.5))[0]
        if kind == "rectangle":
            return {"section": {"height": h, "width": w}, "material": material}
        A, I = h * w, w * h**3 / 12
        if kind == "area":
            return {"section": {"A": A, "I": self.near(I, 1.5), "height": h}, "material": material}
        return {"section": {"EA": E * A, "kGA": self.near(0.3, 1.4) * E * A, "EI": E * I, "rhoA": rho * A,
                            **({"rhoI": rho * I} if self.chance(0.6) else {})}}

    # ------------------------------------------------------------------ supports

    def support(self) -> None:
        """Hold the scene: fully where a solver needs it, by chance where it moves or vibrates."""
        if self.moves or (self.kind == "eigen" and self.chance(0.3)):
            if self.chance(0.7):
                self.hold(self.rng.choice(list(self.case["bodies"])), self.rng.choice((self.clamp, self.pin)))
            if self.chance(0.2):
                self.hold(self.rng.choice(list(self.case["bodies"])), self.roller)
            return
        for name in self.case["bodies"]:
            group = self.cluster[name]
            if group in self.held:
                continue
            pinned = any(j["type"] == "pin" and {self.cluster[p.split("@")[0]] for p in j["between"]} >= {group}
                         and {self.cluster[p.split("@")[0]] for p in j["between"]} & self.held
                         for j in self.case["joints"])
            self.stand(name, pinned)
            self.held.add(group)
        if self.chance(0.15):
            self.hold(self.rng.choice(list(self.case["bodies"])), self.rng.choice((self.roller, self.pin, self.fix)))

    def stand(self, name: str, pinned: bool) -> None:
        """Hold a body that is free, or held by a pin alone, against every rigid motion."""
        far = self.free_end(name)
        if pinned:
            self.rng.choice((self.roller_across, self.brace, self.guide, self.pin, self.clamp))(name, far)
            return
        ways: list[Callable[[], None]] = [
            lambda: self.clamp(name, far), lambda: self.clamp(name, far), lambda: self.clamp(name, far),
            lambda: (self.pin(name, far), self.roller_across(name, 1.0 - far))[0],
            lambda: (self.pin(name, far), self.brace(name, 1.0 - far))[0],
            lambda: (self.pin(name, far), self.torsion(name, 1.0 - far))[0],
            lambda: self.move(name, far)]
        self.rng.choice(ways)()

    def free_end(self, name: str) -> float:
        """Return S of an end of a body that is joined to nothing, if there is one."""
        joined = {p for j in self.case["joints"] for p in j.get("between", ())}
        joined |= {j["point"] for j in self.case["joints"] if "point" in j}
        free = [s for s in (0.0, 1.0) if at(name, s) not in joined]
        return self.rng.choice(free or [0.0, 1.0])

    def hold(self, name: str, how: Callable[[str, float], None]) -> None:
        """Hold some point of a body in some way."""
        how(name, self.rng.choice((0.0, 1.0, self.rng.choice(SOMEWHERE))))

    def _support(self, kind: str, name: str, s: float, **more: Any) -> None:
        supports = self.case["boundary_conditions"]
        supports.append({"name": f"support{len(supports)}", "type": kind, "at": at(name, s), **more})

    def kind_of(self, name: str) -> str:
        """Return how the sections of a body follow from its coordinates: interpolated, tangent, theta, or rigid."""
        spec = self.case["bodies"][name]["element"]
        return "rigid" if spec["type"] == "rigid" else type_of(spec).section_kind

    def clamp(self, name: str, s: float) -> None:
        """Clamp a section."""
        ways = ("all", "section", "breathe") if self.kind_of(name) == "interpolated" else ("all", "section")
        hold = {} if self.kind_of(name) == "rigid" or self.chance(0.6) else {"hold": self.rng.choice(ways)}
        self._support("clamp", name, s, **hold)

    def pin(self, name: str, s: float) -> None:
        """Hold a point."""
        self._support("pin", name, s, **self.spread(name))

    def roller(self, name: str, s: float) -> None:
        """Hold one direction of a point."""
        way = self.rng.choice(({"fixed": "x"}, {"fixed": "y"},
                               {"normal": [self.rng.uniform(-1, 1), self.rng.uniform(-1, 1)]}))
        self._support("roller", name, s, **way, **self.spread(name))

    def roller_across(self, name: str, s: float) -> None:
        """Hold a point across the line to the other end, so that the body cannot turn about that one."""
        self._support("roller", name, s, normal=[float(v) for v in self.across(name)])

    def guide(self, name: str, s: float) -> None:
        """Let a point slide along the line to the other end."""
        p, n = point(self.case, at(name, s)), self.across(name)
        along = np.array([n[1], -n[0]])
        self.case["joints"].append({"type": "slider", "at": at(name, s), "along": [float(v) for v in along],
                                    "through": [float(v) for v in p + self.rng.uniform(-1, 1) * along * self.size]})

    def brace(self, name: str, s: float) -> None:
        """Hold a point by a spring from the ground, across the line to the other end."""
        ground = point(self.case, at(name, s)) + self.size * self.rng.uniform(0.5, 1.5) * self.across(name)
        self.case["springs"].append({"type": "translational", "between": [at(name, s), [float(v) for v in ground]],
                                     "stiffness": self.near(self.load_size / self.size, 10)})

    def torsion(self, name: str, s: float) -> None:
        """Hold a section by a torsion spring from the ground."""
        self.case["springs"].append({"type": "rotational", "between": [[0.0, 0.0], at(name, s)],
                                     "stiffness": self.near(self.load_size * self.size, 10)})

    def fix(self, name: str, s: float) -> None:
        """Hold both components of single nodal coordinates of an end."""
        names = ["x", "y"]
        if self.kind_of(name) == "interpolated" and self.chance(0.5):
            names += ["ry_x", "ry_y"]
        self._support("fix", name, float(round(s)), coordinates=names)

    def move(self, name: str, s: float) -> None:
        """Prescribe the displacement of a section, and how it turns."""
        d = 0.05 * length(self.case["bodies"][name]["geometry"])
        amplitude = random_amplitude(self.rng, self.end, self.moves)
        if self.kind not in ("linear_static", "static", "dynamic"):
            amplitude = {"type": "constant"}
            d = 0.0
        self._support("prescribed", name, s, ux={**amplitude, "scale": d * self.rng.uniform(-1, 1)},
                      uy={**amplitude, "scale": d * self.rng.uniform(-1, 1)},
                      angle={**amplitude, "scale": 0.1 * self.rng.uniform(-1, 1) if d else 0.0})

    def across(self, name: str) -> Any:
        """Return the unit vector (2,) across the line through both ends of a body."""
        g = self.case["bodies"][name]["geometry"]
        d = position(g, 1.0) - position(g, 0.0)
        return np.array([-d[1], d[0]]) / np.hypot(*d)

    def spread(self, name: str) -> Data:
        """Return how a support or force spreads over the section of a type whose sections deform."""
        order = self.case["bodies"][name]["element"].get("order", (1, 1))
        return {"spread": self.rng.choice(("uniform", "parabolic"))} if order[1] > 1 and self.chance(0.3) else {}

    # ------------------------------------------------------------------ springs, masses, loads

    def anywhere(self) -> str:
        """Return some point of some body, mostly an end."""
        return at(self.rng.choice(list(self.case["bodies"])),
                  self.rng.choice((0.0, 1.0, 1.0, self.rng.choice(SOMEWHERE))))

    def add_springs(self) -> None:
        """Add springs, to the ground and between points, prestressed sometimes."""
        while self.chance(0.2):
            one, other = self.anywhere(), self.anywhere()
            damping = {"damping": self.near(0.01 * self.load_size)} if self.moves and self.chance(0.5) else {}
            if self.chance(0.5):
                k = self.near(0.3 * self.load_size * self.size, 3)
                ends: list[Any] = [[0.0, 0.0], one] if self.chance(0.5) or one == other else [one, other]
                rest = {"angle": self.rng.uniform(-0.1, 0.1)} if self.chance(0.3) else {}
                self.case["springs"].append({"type": "rotational", "between": ends, "stiffness": k, **damping, **rest})
                continue
            ends = [one, [self.size * self.rng.uniform(-2, 2), self.size * self.rng.uniform(-2, 2)]]
            if self.chance(0.5):
                ends[1] = other
            gap = math.dist(*(point(self.case, p) if isinstance(p, str) else p for p in ends))
            if gap > 0.3 * self.size:
                k = self.near(0.3 * self.load_size / self.size, 3)
                rest = {"length": gap * self.rng.uniform(0.8, 1.2)} if self.chance(0.3) else {}
                self.case["springs"].append({"type": "translational", "between": ends, "stiffness": k, **damping,
                                             **rest})

    def add_masses(self) -> None:
        """Add point masses, some with moment of inertia."""
        while self.chance(0.2):
            where = self.anywhere()
            body = self.case["bodies"][where.split("@")[0]]
            l = length(body["geometry"])
            mass = self.near(0.5 * mass_per_length(body) * l)
            inertia = {"inertia": self.near(0.01 * mass * l**2)} if self.chance(0.4) else {}
            self.case["masses"].append({"at": where, "mass": mass, **inertia})

    def add_loads(self) -> None:
        """Add loads of a size that bends the softest body as far as the solver is for."""
        strength = {"linear_static": 1.0, "static": 10 ** self.rng.uniform(-2, 0.3), "path": 0.5, "eigen": 0.1,
                    "buckling": 1.0, "dynamic": 10 ** self.rng.uniform(-2, 0.3)}[self.kind]
        for _ in range(self.rng.choice((0, 1, 1, 2, 3)) if self.moves else self.rng.choice((1, 1, 2, 3))):
            load = self.load(strength * self.load_size)
            if self.kind in ("static", "linear_static", "dynamic", "path") and self.chance(0.25):
                load["amplitude"] = random_amplitude(self.rng, self.end, self.moves)
            self.case["loads"].append(load)

    def load(self, P: float) -> Data:
        """Return a load of about the size of a force P."""
        rng, where = self.rng, self.anywhere()
        name = where.split("@")[0]
        l, angle = length(self.case["bodies"][name]["geometry"]), rng.uniform(-math.pi, math.pi)
        force = [self.near(P) * math.cos(angle), self.near(P) * math.sin(angle)]
        follows = 0 if self.kind in ("buckling", "eigen") else 1
        kind = rng.choices(("force", "follower_force", "moment", "gravity", "distributed"),
                           (4, follows, 2, 1.5, 2))[0]
        if kind in ("force", "follower_force"):
            return {"type": kind, "at": where, "value": force, **self.spread(name)}
        if kind == "moment":
            return {"type": kind, "at": where, "value": rng.choice((-1, 1)) * self.near(0.3 * P * l)}
        if kind == "gravity":
            heaviest = max(mass_per_length(b) * length(b["geometry"]) for b in self.case["bodies"].values())
            return {"type": kind, "value": [f / heaviest for f in force]}
        part = {"from": rng.choice((0.0, 0.25, 0.3)), "to": rng.choice((0.5, 0.8, 1.0))} if self.chance(0.4) else {}
        follower = {"follower": True} if follows and self.chance(0.25) else {}
        return {"type": kind, "on": name, "value": [f / l for f in force], **part, **follower}

    # ------------------------------------------------------------------ motions, solvers, output

    @property
    def period(self) -> float:
        """Return about the longest period of the bodies, held at an end."""
        found = [2 * math.pi / 3.516 * math.sqrt(mass_per_length(b) * length(b["geometry"]) ** 4 / stiffness(b)[1])
                 for b in self.case["bodies"].values() if not is_rigid(b)]
        heaviest = max(mass_per_length(b) * length(b["geometry"]) for b in self.case["bodies"].values())
        return max(found) if found else 4 * math.sqrt(heaviest * self.size / self.load_size)

    def start(self) -> None:
        """Give the motion a start, and damping sometimes."""
        rng, v = self.rng, self.size / self.period
        speed = {"velocity": [v * rng.uniform(-1, 1), v * rng.uniform(-1, 1)]}
        rate = {"rotation_rate": {"omega": v / self.size * rng.uniform(-1, 1),
                                  "about": [self.size * rng.uniform(-1, 1), self.size * rng.uniform(-1, 1)]}}
        if self.chance(0.6):
            start = rng.choice((speed, rate, {**speed, **rate}))
            if self.chance(0.3):
                start = {"bodies": {rng.choice(list(self.case["bodies"])): start}}
            self.case["initial"] = start
        elif self.held and self.chance(0.2):
            self.case["initial"] = {"from": "static"}
        if self.chance(0.15):
            T = self.period
            self.case["damping"] = {"rayleigh": rng.choice(({"alpha": 0.5 / T}, {"beta": 1e-3 * T},
                                                            {"alpha": 0.2 / T, "beta": 1e-3 * T}))}

    def turn_steadily(self) -> None:
        """Let the frame turn, gravity and prescribed motion aside."""
        self.case["loads"] = [x for x in self.case["loads"] if x["type"] != "gravity"]
        if not any(s["type"] == "prescribed" for s in self.case["boundary_conditions"]):
            self.case["steady_rotation"] = {
                "omega": 0.5 / self.period * self.rng.uniform(-1, 1),
                "about": [self.size * self.rng.uniform(-1, 1), self.size * self.rng.uniform(-1, 1)]}

    def solver(self) -> Data:
        """Return the solver."""
        rng, T = self.rng, self.period
        if self.kind == "linear_static":
            return {"type": "linear_static"}
        if self.kind == "static":
            return {"type": "static", **({"steps": rng.choice((1, 5, 20))} if self.chance(0.5) else {})}
        if self.kind == "path":
            return {"type": "static", "method": "arc_length", "until": {"load_factor": 1}}
        if self.kind == "eigen":
            about = {"about": "static"} if self.held and self.chance(0.3) else {}
            return {"type": "eigen", "modes": rng.choice((3, 6)), **about}
        if self.kind == "buckling":
            return {"type": "buckling", "modes": rng.choice((1, 3))}
        method = rng.choice((None, *METHODS, rng.choice(tuple(SCHEMES))))
        t_end = T * rng.uniform(0.2, 1.0) * (SHORT if method in SCHEMES else 1.0)
        out: Data = {"type": "dynamic", "t_end": t_end, "estimate": False,
                     **({} if method is None else {"method": method})}
        if method in SCHEMES or (method is None and self.chance(0.4)):
            return {**out, "tolerance": 1e-5}
        return {**out, "dt": t_end / rng.choice((10, 25, 40))}

    def ask(self) -> None:
        """Put probes on every body, off the axis sometimes, and ask for section forces sometimes."""
        probes: Data = {}
        for name, body in self.case["bodies"].items():
            for s in (0.0, 1.0, self.rng.choice(SOMEWHERE)):
                probes[f"p{len(probes)}"] = at(name, s)
            if not is_rigid(body) and self.chance(0.2):
                probes[f"p{len(probes)}"] = {"at": at(name, 0.37), "y": 0.01 * extent(self.case)}
        self.case["output"] = {"probes": probes}
        if self.kind in ("linear_static", "static") and self.chance(0.2):
            self.case["output"]["fields"] = ["N", "Q", "M"]


