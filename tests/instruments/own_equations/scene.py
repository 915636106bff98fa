"""The equations of a case: bars between points of interest, rigid bodies, and rows that join them.

The case is read by its public contract. Every piece of a beam between two stations is one spectral element of the
geometrically exact beam; pieces, joints and supports are rows of constraints, the ground is a body that is held, a
point mass is a body that is welded on. So the mass matrix is constant and every law is one of ``points``.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from .amplitudes import Course, course
from .bodies import NEAR, Bar, Body, Section, legs, section
from .points import Array, Law, Point, Row, apart, dead, follower, held, sliding, slope, spring, tied, torsion, turned


class Scene:
    """A case as M x'' = forces(x, v, t) + G^T multipliers, rows(x) = drives(t).

    ``degree`` of the polynomials of each piece; ``usual``: constant or ramp, what amplitudes are unless given;
    ``shearless``: see ``section``.
    """

    def __init__(self, case: dict[str, Any], degree: int = 8, usual: str = "constant",
                 shearless: float = 20.0) -> None:
        self.case, self.usual, self.shearless = case, usual, shearless
        self.bars: list[tuple[Bar, int]] = []
        self.rows: list[Row] = []
        self.laws: list[Law] = []
        self.supports: dict[str, list[tuple[int, str, Array]]] = {}
        self.springs: list[Law] = []
        self.dead: list[tuple[Array, Course]] = []
        self.slowing = case.get("damping", {}).get("rayleigh", {}).get("alpha", 0.0)
        self.sections: list[tuple[int, int]] = []  # first coordinate and number of sections of what has mass
        self._x0: list[Array] = []
        self.blocks: list[Array] = []
        self.size = 0
        self.ground = self._rigid(np.zeros(2), 0.0, 1.0, 1.0)
        self.bodies = {name: self._body(name, spec, degree) for name, spec in case["bodies"].items()}
        self.masses: list[tuple[Point, int]] = [(self._point(m["at"]), self._rigid(
            self._where(m["at"]), 0.0, m["mass"], m.get("inertia", 0.0) or 1.0)) for m in case.get("masses", [])]
        self.x0 = np.concatenate(self._x0)
        self.M = block_diag(*self.blocks)
        ends = [leg.at(s) for body in self.bodies.values() for leg in body.legs for s in (0.0, 1.0)]
        self.extent = float(np.max(np.ptp(ends, axis=0)))
        self._join()
        self._support()
        self._load()
        # gradients that do not change with the state are set up once
        self.curved, self.G = list(range(len(self.rows))), np.zeros((len(self.rows), self.size))
        away = np.random.default_rng(0).uniform(1, 2, self.size)
        self.G, other = self.gradients(self.x0), self.gradients(self.x0 + away)
        self.curved = [k for k in self.curved if np.any(other[k] != self.G[k])]

    # ------------------------------------------------------------------ bodies

    def _rigid(self, centre: Array, angle: float, mass: float, inertia: float) -> int:
        self._x0.append(np.array([*centre, angle]))
        self.blocks.append(np.diag([mass, mass, inertia]))
        self.sections.append((self.size, 1))
        self.size += 3
        return self.size - 3

    def _stations(self, name: str, body: Body) -> list[float]:
        """Return the arc lengths of loads and constraints on a body, including ends and corners."""
        found = [0.0, *np.cumsum([leg.length for leg in body.legs])]

        def look(value: Any) -> None:
            if isinstance(value, str) and value.startswith(name + "@"):
                found.append(float(value.split("@")[1]) * body.length)
            for item in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
                look(item)

        look({k: v for k, v in self.case.items() if k != "bodies"})
        for load in self.case.get("loads", []):
            if load.get("on") == name:
                found += [load.get("from", 0.0) * body.length, load.get("to", 1.0) * body.length]
        found.sort()
        return [a for a, b in zip(found, [*found[1:], math.inf], strict=True) if b - a > NEAR * body.length]

    def _body(self, name: str, spec: dict[str, Any], degree: int) -> Body:
        body = Body(legs(spec["geometry"]))
        if spec["element"]["type"] == "rigid":
            return self._rigid_body(body, spec)
        stations, profile = self._stations(name, body), section(spec, self.shearless)
        for a, b in pairwise(stations):
            leg, middle = body.where((a + b) / 2)
            bend = leg.bend * (b - a) / leg.length
            half = (b - a) / (2 * leg.length)
            bar = Bar(profile, leg.at(middle - half), leg.at(middle + half), 1, degree, bend)
            # angles go on along a body where those of bars begin anew
            bar.x0[2 * bar.n:] += leg.angle + leg.bend * (middle - half) - bar.angle
            body.pieces.append((a, b, len(self.bars)))
            self.bars.append((bar, self.size))
            self.sections.append((self.size, bar.n))
            self._x0.append(bar.x0)
            self.blocks.append(bar.mass())
            self.size += len(bar.x0)
        return body

    def _rigid_body(self, body: Body, spec: dict[str, Any]) -> Body:
        element, L = spec["element"], np.array([leg.length for leg in body.legs])
        middles = np.array([leg.at(0.5) for leg in body.legs])
        body.centre = L @ middles / L.sum()
        mass, inertia = element.get("mass"), element.get("inertia")
        if mass is None or inertia is None:
            profile = section(spec, 1.0) if "section" in spec else Section(0, 0, 0, mass / L.sum(), 0)
            own = profile.rhoA * (L**3 / 12 + L * np.sum((middles - body.centre)**2, axis=1)) + profile.rhoI * L
            inertia = own.sum() if inertia is None else inertia
            mass = profile.rhoA * L.sum() if mass is None else mass
        body.rigid = self._rigid(body.centre, 0.0, mass, inertia)
        return body

    # ------------------------------------------------------------------ points

    def _where(self, at: Any) -> Array:
        if not isinstance(at, str):
            return np.array(at, float)
        name, s = at.split("@")
        leg, along = self.bodies[name].where(float(s) * self.bodies[name].length)
        return leg.at(along)

    def _point(self, at: Any) -> Point:
        """Return a point of a body, BODY@S, or of the ground, [x, y]."""
        if not isinstance(at, str):
            return Point(np.arange(3) + self.ground, 0.0, np.array(at, float))
        name, s = at.split("@")
        body = self.bodies[name]
        if body.rigid is not None:
            return Point(np.arange(3) + body.rigid, 0.0, self._where(at) - body.centre)
        place = float(s) * body.length
        for _, b, k in body.pieces:
            if place <= b + NEAR * body.length:
                return self._end(k, 0 if place < b - NEAR * body.length else -1)
        raise ValueError(f"{at} is no place of the body")

    def _end(self, piece: int, end: int) -> Point:
        bar, first = self.bars[piece]
        index = end % bar.n + np.arange(3) * bar.n
        return Point(first + index, float(bar.x0[index[2]]))

    def angle(self, at: str) -> float:
        """Return the direction of the axis at BODY@S in the reference."""
        name, s = at.split("@")
        leg, along = self.bodies[name].where(float(s) * self.bodies[name].length)
        return leg.angle + leg.bend * along

    # ------------------------------------------------------------------ joints and supports

    def _join(self) -> None:
        self.rows += [held(k) for k in range(self.ground, self.ground + 3)]
        for body in self.bodies.values():
            for (_, _, k), (_, _, j) in pairwise(body.pieces):
                a, b = self._end(k, -1), self._end(j, 0)
                self.rows += tied(a, b, self.x0, weld=True)
        for (point, first), mass in zip(self.masses, self.case.get("masses", []), strict=True):
            own = Point(np.arange(3) + first, 0.0)
            self.rows += tied(point, own, self.x0, weld=bool(mass.get("inertia", 0.0)))
        for joint in self.case.get("joints", []):
            if joint["type"] in ("pin", "weld"):
                first, *others = [self._point(at) for at in joint["between"]]
                for other in others:
                    self.rows += tied(first, other, self.x0, weld=joint["type"] == "weld")
            elif joint["type"] == "slider":
                along = np.array(joint["along"], float) / np.hypot(*joint["along"])
                normal = np.array([-along[1], along[0]])
                self.rows.append(apart(self._point(joint["at"]), self._point(joint["through"]), normal, self.x0))
            else:
                angle = self.angle(f"{joint['on']}@0")
                normal = np.array([-math.sin(angle), math.cos(angle)])
                self.rows.append(sliding(self._point(joint["point"]), self._point(f"{joint['on']}@0"), normal))

    def _support(self) -> None:
        for number, support in enumerate(self.case.get("boundary_conditions", [])):
            point, ground = self._point(support["at"]), self._point(self._where(support["at"]))
            found: list[tuple[Row, str, Array]] = []
            x, y = np.eye(2)
            if support["type"] == "prescribed":
                place = self._where(support["at"])
                for key, n, start in (("x", x, place[0]), ("y", y, place[1]), ("ux", x, 0.0), ("uy", y, 0.0)):
                    if key in support:
                        drive = _less(course(support[key], self.usual), start)
                        found.append((apart(point, ground, n, self.x0, drive), "force", n))
                if "angle" in support:
                    found.append((turned(point, ground, course(support["angle"], self.usual)), "moment", x))
            else:
                if support["type"] == "roller":
                    given = support["normal"] if "normal" in support else {"x": x, "y": y}[support["fixed"]]
                    n = np.array(given, float)
                    normals = [n / np.hypot(*n)]
                else:
                    normals = [x, y]
                found += [(apart(point, ground, n, self.x0), "force", n) for n in normals]
                if support["type"] == "clamp":
                    found.append((turned(point, ground), "moment", x))
            name = support.get("name", f"boundary_conditions.{number}")
            self.supports[name] = []
            for row, kind, n in found:
                self.supports[name].append((len(self.rows), kind, n))
                self.rows.append(row)

    # ------------------------------------------------------------------ loads

    def _load(self) -> None:
        for s in self.case.get("springs", []):
            a, b = (self._point(at) for at in s["between"])
            k, c = s.get("stiffness", 0.0), s.get("damping", 0.0)
            if s["type"] == "rotational":
                self.springs.append(torsion(a, b, k, c, s.get("angle", 0.0)))
            else:
                length = s.get("length", float(np.hypot(*(a.place(self.x0) - b.place(self.x0)))))
                self.springs.append(spring(a, b, k, c, length))
        self.laws += self.springs
        for load in self.case.get("loads", []):
            over = course(load.get("amplitude"), self.usual)
            if load["type"] == "gravity":
                self.dead.append((self.M @ self._everywhere(load["value"]), over))
            elif load["type"] == "distributed" and self.bodies[load["on"]].rigid is not None:
                low, high = load.get("from", 0.0), load.get("to", 1.0)
                total = np.array(load["value"]) * (high - low) * self.bodies[load["on"]].length
                self.laws.append(dead(self._point(f"{load['on']}@{(low + high) / 2}"), total, 0.0, over))
            elif load["type"] == "distributed":
                self.dead.append((self._distributed(load), over))
            elif load["type"] == "moment":
                self.laws.append(dead(self._point(load["at"]), np.zeros(2), load["value"], over))
            elif load["type"] == "force":
                self.laws.append(dead(self._point(load["at"]), np.array(load["value"], float), 0.0, over))
            else:
                c, s, (f, g) = math.cos(a := self.angle(load["at"])), math.sin(a), load["value"]
                self.laws.append(follower(self._point(load["at"]), np.array([c * f - s * g, s * f + c * g]), over))

    def _everywhere(self, value: Any) -> Array:
        """Return x'' of a common acceleration; on the fixed ground it changes only the reactions."""
        a = np.zeros(self.size)
        for first, n in self.sections:
            a[first:first + n], a[first + n:first + 2 * n] = value
        return a

    def _distributed(self, load: dict[str, Any]) -> Array:
        f, body = np.zeros(self.size), self.bodies[load["on"]]
        low, high = (load.get(k, d) * body.length for k, d in (("from", 0.0), ("to", 1.0)))
        for a, b, k in body.pieces:
            if low - NEAR * body.length < a and b < high + NEAR * body.length:
                bar, first = self.bars[k]
                for j in range(2):
                    f[first + j * bar.n:first + (j + 1) * bar.n] += load["value"][j] * bar.N.sum(axis=1)
        return f

    # ------------------------------------------------------------------ the equations

    def forces(self, x: Array, v: Array, t: float) -> Array:
        """Return all forces but those of constraints."""
        f = np.zeros(self.size)
        for vector, over in self.dead:
            f += over(t)[0] * vector
        for law in self.laws:
            f[law.index] += law.force(x, v, t)
        return f - self.elastic(x) - self.slowing * (self.M @ v)

    def elastic(self, x: Array) -> Array:
        """Return the elastic forces of bars."""
        f = np.zeros(self.size)
        for bar, first in self.bars:
            part = slice(first, first + 3 * bar.n)
            f[part] = bar.forces(x[part])
        return f

    def tangent(self, x: Array, t: float, multipliers: Array | None = None) -> Array:
        """Return minus the derivatives of forces and of G^T multipliers at rest."""
        K, v = self.stiffness(x), np.zeros(self.size)
        for law in self.laws:
            K[np.ix_(law.index, law.index)] -= slope(lambda z, f=law.force: f(z, v, t), x, law.index)
        if multipliers is not None:
            for k in self.curved:
                row = self.rows[k]
                K[np.ix_(row.index, row.index)] -= multipliers[k] * slope(row.gradient, x, row.index)
        return K

    def stiffness(self, x: Array) -> Array:
        """Return the derivatives of the elastic forces of bars."""
        K = np.zeros((self.size, self.size))
        for bar, first in self.bars:
            part = slice(first, first + 3 * bar.n)
            K[part, part] = bar.elastic(x[part])[1]
        return K

    def gradients(self, x: Array) -> Array:
        """Return G (rows, coordinates)."""
        G = self.G.copy()
        for k in self.curved:
            G[k] = 0.0
            np.add.at(G[k], self.rows[k].index, self.rows[k].gradient(x))
        return G

    def violation(self, x: Array, t: float) -> Array:
        """Return rows(x) - drives(t)."""
        return np.array([row.value(x) - row.drive(t)[0] for row in self.rows])

    # ------------------------------------------------------------------ what is asked of a state

    def probe(self, at: str, x: Array, v: Array | None = None, linear: bool = False) -> dict[str, float]:
        """Return displacement, rotation and, in motion, their rates at BODY@S."""
        p = self._point(at)
        u = p.place(x) - p.place(self.x0)
        if linear:
            u = np.array([p.pull(self.x0, n) @ (x - self.x0)[p.index] for n in np.eye(2)])
        found = {"ux": u[0], "uy": u[1], "theta": p.turn(x)}
        if v is not None:
            found.update(vx=p.pull(x, np.array([1.0, 0.0])) @ v[p.index],
                         vy=p.pull(x, np.array([0.0, 1.0])) @ v[p.index], omega=v[p.index[2]])
        return {k: float(w) for k, w in found.items()}

    def section_forces(self, at: str, x: Array, elastic: Array) -> dict[str, float]:
        """Return N, Q, M of a bar at rest at BODY@S: elastic forces minus loads at the end of a bar."""
        name, s = at.split("@")
        body = self.bodies[name]
        place = float(s) * body.length
        k = next(k for _, b, k in body.pieces if place <= b + NEAR * body.length)
        bar, first = self.bars[k]
        end, sign = (bar.n - 1, 1.0) if place > body.pieces[0][0] + NEAR else (0, -1.0)
        index = np.arange(3) * bar.n + end
        index += first
        f = elastic[index] - sum(over(1.0)[0] * vector[index] for vector, over in self.dead)
        c, z = math.cos(x[index[2]]), math.sin(x[index[2]])
        found = {"N": c * f[0] + z * f[1], "Q": c * f[1] - z * f[0], "M": f[2]}
        return {name: float(sign * value) for name, value in found.items()}

    def reactions(self, multipliers: Array) -> dict[str, dict[str, float]]:
        """Return the forces of supports on the bodies."""
        found = {}
        for name, rows in self.supports.items():
            force, m = np.zeros(2), 0.0
            for k, kind, n in rows:
                if kind == "force":
                    force += multipliers[k] * n
                else:
                    m += multipliers[k]
            found[name] = {"fx": float(force[0]), "fy": float(force[1]), "m": float(m)}
        return found

    def energies(self, x: Array, v: Array) -> dict[str, float]:
        """Return strain and kinetic energy."""
        strain = sum(bar.elastic(x[first:first + 3 * bar.n])[2] for bar, first in self.bars)
        return {"strain": strain + sum(s.energy(x) for s in self.springs), "kinetic": float(0.5 * v @ self.M @ v)}


def _less(over: Course, start: float) -> Course:
    def moved(t: float) -> tuple[float, float, float]:
        value, rate, acceleration = over(t)
        return value - start, rate, acceleration

    return moved
