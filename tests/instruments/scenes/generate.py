"""Random scenes that a user could have written: every kind of body, joint, support, load and solver."""

from __future__ import annotations

import json
import math
import random
from typing import Any

from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.solvers.motion.integrators import INTEGRATORS, SCIPY_METHODS

from .amplitudes import random_amplitude
from .bodies import SOMEWHERE, type_of
from .laws import give_laws
from .shapes import Data, at, extent, is_rigid, length, mass_per_length, point, stiffness
from .similar import INNER, ODD
from .supports import Supported

# shares of the solvers: linear ones are cheap and many, motions cost thirty times as much
SOLVERS = {"linear_static": 64, "eigen": 15, "buckling": 11, "static": 6, "path": 2, "dynamic": 2}
# those of scenes whose materials remember; half of the static ones go over time
REMEMBERING = {"static": 50, "path": 10, "dynamic": 30, "eigen": 10}
# SciPy's integrators call Python at every stage, and explicit ones take steps as short as the fastest vibration: theirs
# are a smaller share of the motions, and these are shorter
METHODS = tuple(name for name in INTEGRATORS if name not in SCIPY_METHODS)
SHORT = 0.01
NAMES = ("a", "b", "c", "d")


def scene(seed: int, number: int, solver: str | None = None, laws: bool = False) -> Data:
    """Return the scene of a number as the data of a case; the same in every process.

    ``laws``: its materials remember.
    """
    rng = random.Random(f"scene {seed} {number}")
    shares = REMEMBERING if laws else SOLVERS
    kind = solver or rng.choices(list(shares), list(shares.values()))[0]
    # plain numbers, as files have them
    maker = Maker(rng, kind)
    made: Data = json.loads(json.dumps(maker.made()))
    if laws:
        give_laws(made, rng, maker.period)
    return made


class Maker(Supported):
    """A scene under construction."""

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
        self.switch()
        self.vary()
        return {key: value for key, value in self.case.items() if value not in ([], {})}

    # ------------------------------------------------------------------ springs, masses, loads

    def anywhere(self) -> str:
        """Return some point of some body, mostly an end."""
        return at(self.rng.choice(list(self.case["bodies"])),
                  self.rng.choice((0.0, 1.0, 1.0, self.rng.choice(SOMEWHERE))))

    def add_springs(self) -> None:
        """Add springs, to the ground and between points, sometimes prestressed."""
        while self.chance(0.2):
            one, other = self.anywhere(), self.anywhere()
            damping = {"damping": self.near(0.01 * self.load_size)} if self.moves and self.chance(0.5) else {}
            if self.chance(0.5):
                k = self.near(0.3 * self.load_size * self.size, 3)
                ends: list[Any] = [[0.0, 0.0], one] if self.chance(0.5) or one == other else [one, other]
                rest = {"angle": self.rng.uniform(-0.1, 0.1)} if self.chance(0.3) else {}
                rest.update(self.one_sided(0.02))
                self.case["springs"].append({"type": "rotational", "between": ends, "stiffness": k, **damping, **rest})
                continue
            ends = [one, [self.size * self.rng.uniform(-2, 2), self.size * self.rng.uniform(-2, 2)]]
            if self.chance(0.5):
                ends[1] = other
            gap = math.dist(*(point(self.case, p) if isinstance(p, str) else p for p in ends))
            if gap > 0.3 * self.size:
                k = self.near(0.3 * self.load_size / self.size, 3)
                rest = {"length": gap * self.rng.uniform(0.8, 1.2)} if self.chance(0.3) else {}
                rest.update(self.one_sided(0.02 * self.size))
                self.case["springs"].append({"type": "translational", "between": ends, "stiffness": k, **damping,
                                             **rest})

    def one_sided(self, gap: float) -> Data:
        """Return the range of elongations in which a spring acts: all in linear solvers, and mostly in others."""
        if self.kind not in ("static", "path", "dynamic") or not self.chance(0.3):
            return {}
        stop = {"gap": gap * self.rng.uniform(0.1, 1.0)}
        side = {"only": self.rng.choice(("tension", "compression"))}
        return self.rng.choice((stop, side, {**stop, **side}))

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
        """Add loads of a size that bends the softest body as far as the solver allows."""
        strength = {"linear_static": 1.0, "static": 10 ** self.rng.uniform(-2, 0.3), "path": 0.5, "eigen": 0.1,
                    "buckling": 1.0, "dynamic": 10 ** self.rng.uniform(-2, 0.3)}[self.kind]
        for _ in range(self.rng.choice((0, 1, 1, 2, 3)) if self.moves else self.rng.choice((1, 1, 2, 3))):
            load = self.load(strength * self.load_size)
            if self.kind in ("static", "linear_static", "dynamic", "path") and self.chance(0.25):
                load["amplitude"] = random_amplitude(self.rng, self.end, self.moves)
            self.case["loads"].append(load)
        if self.kind == "path" and all("amplitude" in load for load in self.case["loads"]):
            # paths scale what has none
            del self.case["loads"][0]["amplitude"]

    def load(self, P: float) -> Data:
        """Return a load of about the size of a force P."""
        rng, where = self.rng, self.anywhere()
        name = where.split("@")[0]
        l, angle = length(self.case["bodies"][name]["geometry"]), rng.uniform(-math.pi, math.pi)
        force = [self.near(P) * math.cos(angle), self.near(P) * math.sin(angle)]
        follows = 0 if self.kind in ("buckling", "eigen") else 1
        kind = rng.choices(("force", "follower_force", "moment", "gravity", "distributed", "torque", "within"),
                           (4, follows, 2, 1.5, 2, 1, 2))[0]
        if kind == "within":
            return self.load_within(name, P)
        if kind == "torque":
            other = self.anywhere()
            ends = [where, other if other != where and self.chance(0.6) else [0.0, 0.0]]
            rng.shuffle(ends)
            return {"type": kind, "between": ends, "value": rng.choice((-1, 1)) * self.near(0.3 * P * l)}
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

    def load_within(self, name: str, P: float) -> Data:
        """Return a tendon, natural strains or heat of a body, about as large as a force P; a moment on a rigid one."""
        rng, body = self.rng, self.case["bodies"][name]
        l, (EA, EI) = length(body["geometry"]), stiffness(body)
        if is_rigid(body):
            return {"type": "moment", "at": at(name, 1.0), "value": rng.choice((-1, 1)) * self.near(0.3 * P * l)}
        part = {"from": rng.choice((0.0, 0.25, 0.3)), "to": rng.choice((0.5, 0.8, 1.0))} if self.chance(0.4) else {}
        element = body["element"]
        knows = FORMULATIONS[element.get("formulation", type_of(element).formulation)].natural is not None
        kind = rng.choice(("tendon", "eigenstrain", "temperature"))
        eyelets = [] if kind != "tendon" or self.chance(0.5) else self.eyelets()
        if eyelets:
            return {"type": "tendon", "through": eyelets, "tension": self.near(0.3 * P)}
        if kind == "tendon" or not knows:
            return {"type": "tendon", "on": name, "y": 0.02 * self.size * rng.uniform(-1, 1),
                    "tension": self.near(0.3 * P), **part}
        axial, curvature = rng.uniform(-1, 1) * 0.3 * P / EA, rng.uniform(-1, 1) * 0.3 * P * l / EI
        if kind == "eigenstrain" or "EA" in body["section"]:
            return {"type": "eigenstrain", "on": name, "axial": axial, "curvature": curvature, **part}
        parts = [x["material"] for x in body["section"].get("layers", ())] or [body["material"]]
        alpha = parts[0].get("alpha", self.near(1e-5))
        for material in parts:
            material["alpha"] = alpha
        return {"type": kind, "on": name, "value": axial / alpha, "gradient": curvature / alpha, **part}

    def vary(self) -> None:
        """Vary natural strains and guides along their bodies, make tendons elastic and place nodes anywhere."""
        for load in self.case["loads"]:
            body = self.case["bodies"].get(load.get("on"))
            if load["type"] == "tendon" and self.kind != "linear_static" and self.chance(0.35):
                self.make_elastic(load)
            for key in ODD if load["type"] in INNER and body is not None and self.chance(0.3) else ():
                if key in load and not (key == "y" and type_of(body["element"]).section_kind == "tangent"):
                    load[key] = self.table(load[key])
        for name, body in self.case["bodies"].items():
            # joints and supports that need a node, or none
            special = any(joint.get("on") == name for joint in self.case["joints"]) or any(
                x["type"] == "fix" and x["at"].split("@")[0] == name for x in self.case["boundary_conditions"])
            plain = not is_rigid(body) and "preset" not in body["element"] and body["geometry"]["type"] in (
                "line", "arc", "curve")
            if plain and not special and self.chance(0.15):
                body["element"]["nodes"] = "regular"

    def table(self, value: float) -> Data:
        """Return a table along a body about a number, of straight lines with a kink sometimes."""
        a, b, c = (value * self.rng.uniform(0.3, 1.7) for _ in range(3))
        return self.rng.choice(({"s": [0.0, 1.0], "value": [a, b]}, {"s": [0.0, 0.5, 1.0], "value": [a, c, b]}))

    def make_elastic(self, tendon: Data) -> None:
        """Give a tendon a stiffness in place of its tension, with about the same tension if it is wound up."""
        on = self.case["bodies"].get(tendon.get("on"))
        if on is not None and type_of(on["element"]).section_kind == "tangent" and tendon["y"]:
            return
        share = tendon.get("to", 1.0) - tendon.get("from", 0.0)
        l = share * length(on["geometry"]) if on is not None else self.size
        tension = tendon.pop("tension")
        tendon |= {"stiffness": self.near(50.0 * tension), "slack": -0.02 * l * self.rng.uniform(-0.3, 1.0)}

    def eyelets(self) -> list[Any]:
        """Return two or three separate points of bodies, sometimes off their axes; none if there are not enough."""
        found: list[Any] = []
        places: list[Any] = []
        for _ in range(12):
            where = self.anywhere()
            there = point(self.case, where)
            if all(math.dist(there, p) > 0.2 * self.size for p in places):
                places.append(there)
                y = 0.02 * self.size * self.rng.uniform(-1, 1)
                found.append({"at": where, "y": y} if self.chance(0.5) else where)
        return found[:self.rng.choice((2, 2, 3))] if len(found) > 1 else []

    # ------------------------------------------------------------------ motions, solvers, output

    def start(self) -> None:
        """Give the motion a start, and sometimes damping."""
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

    def switch(self) -> None:
        """Let some loads and springs of a motion begin and end."""
        for item in (*self.case["loads"], *self.case["springs"]) if self.moves else ():
            if self.chance(0.15):
                begin, end = sorted(self.case["solver"]["t_end"] * self.rng.uniform(0.05, 0.95) for _ in range(2))
                item["active"] = self.rng.choice(({"from": begin}, {"to": end}, {"from": begin, "to": end}))

    def turn_steadily(self) -> None:
        """Let the frame turn, without gravity and prescribed motion."""
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
        method = rng.choice((None, *METHODS, rng.choice(tuple(SCIPY_METHODS))))
        t_end = T * rng.uniform(0.2, 1.0) * (SHORT if method in SCIPY_METHODS else 1.0)
        out: Data = {"type": "dynamic", "t_end": t_end, "estimate": False,
                     **({} if method is None else {"method": method})}
        if method in SCIPY_METHODS or (method is None and self.chance(0.4)):
            return {**out, "tolerance": 1e-5}
        return {**out, "dt": t_end / rng.choice((10, 25, 40))}

    def ask(self) -> None:
        """Put probes on every body, sometimes off the axis, and sometimes request section forces."""
        probes: Data = {}
        for name, body in self.case["bodies"].items():
            for s in (0.0, 1.0, self.rng.choice(SOMEWHERE)):
                probes[f"p{len(probes)}"] = at(name, s)
            if not is_rigid(body) and self.chance(0.2):
                probes[f"p{len(probes)}"] = {"at": at(name, 0.37), "y": 0.01 * extent(self.case)}
        self.case["output"] = {"probes": probes}
        if self.kind in ("linear_static", "static") and self.chance(0.2):
            self.case["output"]["fields"] = ["N", "Q", "M"]
