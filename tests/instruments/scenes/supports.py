"""Random supports: clamps, pins, rollers, sliders, springs from the ground, prescribed motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .amplitudes import random_amplitude
from .bodies import SOMEWHERE, Assembly, type_of
from .shapes import Data, at, length, point, position


class Supported(Assembly):
    """Bodies while supports are added."""

    def support(self) -> None:
        """Support the scene: fully if the solver needs it, at random if it moves or vibrates."""
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
        """Prevent every rigid motion of a body that is free, or on a pin."""
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
        """Return S of an unconnected end of a body, if there is one."""
        joined = {p for j in self.case["joints"] for p in j.get("between", ())}
        joined |= {j["point"] for j in self.case["joints"] if "point" in j}
        free = [s for s in (0.0, 1.0) if at(name, s) not in joined]
        return self.rng.choice(free or [0.0, 1.0])

    def hold(self, name: str, how: Callable[[str, float], None]) -> None:
        """Support some point of a body in some way."""
        how(name, self.rng.choice((0.0, 1.0, self.rng.choice(SOMEWHERE))))

    def _support(self, kind: str, name: str, s: float, **more: Any) -> None:
        supports = self.case["boundary_conditions"]
        supports.append({"name": f"support{len(supports)}", "type": kind, "at": at(name, s), **more})

    def kind_of(self, name: str) -> str:
        """Return how a body defines the directions of its sections: interpolated, tangent, theta, or rigid."""
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
        """Support a point transversely to the line to the other end, so that the body cannot turn about that end."""
        self._support("roller", name, s, normal=[float(v) for v in self.across(name)])

    def guide(self, name: str, s: float) -> None:
        """Let a point slide along the line to the other end."""
        p, n = point(self.case, at(name, s)), self.across(name)
        along = np.array([n[1], -n[0]])
        self.case["joints"].append({"type": "slider", "at": at(name, s), "along": [float(v) for v in along],
                                    "through": [float(v) for v in p + self.rng.uniform(-1, 1) * along * self.size]})

    def brace(self, name: str, s: float) -> None:
        """Support a point by a spring from the ground, transversely to the line to the other end."""
        ground = point(self.case, at(name, s)) + self.size * self.rng.uniform(0.5, 1.5) * self.across(name)
        self.case["springs"].append({"type": "translational", "between": [at(name, s), [float(v) for v in ground]],
                                     "stiffness": self.near(self.load_size / self.size, 10)})

    def torsion(self, name: str, s: float) -> None:
        """Support a section by a torsion spring from the ground."""
        self.case["springs"].append({"type": "rotational", "between": [[0.0, 0.0], at(name, s)],
                                     "stiffness": self.near(self.load_size * self.size, 10)})

    def fix(self, name: str, s: float) -> None:
        """Fix both components of single nodal coordinates of an end."""
        names = ["x", "y"]
        if self.kind_of(name) == "interpolated" and self.chance(0.5):
            names += ["ry_x", "ry_y"]
        self._support("fix", name, float(round(s)), coordinates=names)

    def move(self, name: str, s: float) -> None:
        """Prescribe the displacement of a section, and its rotation."""
        d = 0.05 * length(self.case["bodies"][name]["geometry"])
        amplitude = random_amplitude(self.rng, self.end, self.moves)
        if self.kind not in ("linear_static", "static", "dynamic"):
            amplitude = {"type": "constant"}
            d = 0.0
        self._support("prescribed", name, s, ux={**amplitude, "scale": d * self.rng.uniform(-1, 1)},
                      uy={**amplitude, "scale": d * self.rng.uniform(-1, 1)},
                      angle={**amplitude, "scale": 0.1 * self.rng.uniform(-1, 1) if d else 0.0})

    def across(self, name: str) -> Any:
        """Return the unit vector (2,) transverse to the line through both ends of a body, or its halves if closed."""
        g = self.case["bodies"][name]["geometry"]
        d = position(g, 0.5 if g.get("closed") else 1.0) - position(g, 0.0)
        return np.array([-d[1], d[0]]) / np.hypot(*d)

    def spread(self, name: str) -> Data:
        """Return how a support or force spreads over the section, for types with deformable sections."""
        order = self.case["bodies"][name]["element"].get("order", (1, 1))
        return {"spread": self.rng.choice(("uniform", "parabolic"))} if order[1] > 1 and self.chance(0.3) else {}
