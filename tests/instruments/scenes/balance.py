"""External forces on a scene, added up without the code under test: they must balance the reactions."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from ancf2d.model.model import Model
from ancf2d.model.points import dot, point_ref

from .amplitudes import value
from .answer import Answer
from .bodies import type_of
from .shapes import Array, Data, is_rigid, is_straight, length, mass_per_length, split_point, varies
from .similar import INNER, UnfitError

# Gauss points per element: the axis is a polynomial of degree 8 at most there
GAUSS = np.polynomial.legendre.leggauss(6)


def with_acting_points(case: Data) -> Data:
    """Return a case with a probe at every support, load, spring and slider."""
    probes = dict(case["output"]["probes"])
    for p in acting_points(case):
        probes[probe_of(p)] = p
    return {**case, "output": {**case["output"], "probes": probes}}


def acting_points(case: Data) -> list[str]:
    """Return the points at which external forces act."""
    found = [item["at"] for key in ("boundary_conditions", "loads", "joints", "masses") for item in case.get(key, ())
             if "at" in item]
    return found + [p for s in case.get("springs", ()) for p in s["between"] if isinstance(p, str)]


def probe_of(p: str) -> str:
    """Return the name of the probe at a point."""
    return "q " + p.replace("@", " at ").replace(".", "_")


class Resultant:
    """External forces and moments about the origin on a solved static scene."""

    def __init__(self, found: Answer) -> None:
        self.case, self.found = found.case, found
        assert found.state is not None
        self.linear = found.state.linear
        self.force, self.moment = np.zeros(2), 0.0
        # what round-off of a sum is measured by: the sizes of its terms
        self.size = 0.0
        self.knows_moment = True
        if "steady_rotation" in self.case:
            raise UnfitError("a turning frame has forces of its own")
        self.reactions()
        for load in self.case.get("loads", ()):
            self.load(load)
        if not self.linear and any("spread" in x for key in ("loads", "boundary_conditions") for x in
                                   self.case.get(key, ())):
            # it acts at the mean of a section, which leaves the axis as the section warps
            self.knows_moment = False
        for spring in self.case.get("springs", ()):
            self.spring(spring)

    def add(self, force: Any, place: Any, moment: float = 0.0) -> None:
        """Add a force at a place, and a moment."""
        self.force = self.force + force
        self.moment += float(place[0] * force[1] - place[1] * force[0]) + moment
        self.size += float(np.hypot(*force)) + abs(moment) / self.extent

    @property
    def extent(self) -> float:
        """Return the size of the scene."""
        assert self.found.model is not None
        return float(self.found.model.extent)

    def probe(self, p: str) -> Data:
        """Return the values of the probe at a point."""
        found: Data = self.found.summary["probes"][probe_of(p)]
        return found

    def place(self, p: str) -> Array:
        """Return the position of a point: in linear theory, in the reference."""
        q = self.probe(p)
        return np.array([q["x"], q["y"]]) - (np.array([q["ux"], q["uy"]]) if self.linear else 0.0)

    def reactions(self) -> None:
        """Add the forces of supports."""
        for support in self.case.get("boundary_conditions", ()):
            r = self.found.summary["reactions"][support["name"]]
            self.add(np.array([r["fx"], r["fy"]]), self.place(support["at"]), r["m"])

    # ------------------------------------------------------------------ loads

    def load(self, load: Data) -> None:
        """Add a load at its full size."""
        if load["type"] in INNER:
            return
        factor = value(load.get("amplitude"), 1.0, True)
        given = factor * np.array(load["value"])
        if load["type"] == "force":
            self.add(given, self.place(load["at"]))
        elif load["type"] == "moment":
            self.add(np.zeros(2), np.zeros(2), float(given))
        elif load["type"] == "torque":
            for p, sign in zip(load["between"], (-1.0, 1.0), strict=True):
                if isinstance(p, str):
                    self.add(np.zeros(2), np.zeros(2), sign * float(given))
        elif load["type"] == "follower_force":
            self.add(self.turned(given, load["at"]), self.place(load["at"]))
        elif load["type"] == "distributed":
            if load.get("follower"):
                raise UnfitError("a distributed load that turns is known to the elements alone")
            name = load["on"]
            l = length(self.case["bodies"][name]["geometry"])
            for place, share in self.along(name, load.get("from", 0.0), load.get("to", 1.0)):
                self.add(share * l * given, place)
        else:
            self.gravity(given)

    def turned(self, v: Array, p: str) -> Array:
        """Return a vector given in the axes of a section."""
        model = self.model
        name, s = split_point(p)
        angle = point_ref(model.meshes[name], s).angle + (0.0 if self.linear else self.probe(p)["theta"])
        c, n = math.cos(angle), math.sin(angle)
        return np.array([c * v[0] - n * v[1], n * v[0] + c * v[1]])

    @property
    def model(self) -> Model:
        """Return the model."""
        assert self.found.model is not None
        return self.found.model

    def gravity(self, g: Array) -> None:
        """Add the weight of everything."""
        for name, body in self.case["bodies"].items():
            if not is_straight(body) or varies(body):
                raise UnfitError("the mass of a curved axis is that of its mesh, that of a varying one not even")
            if "layers" in body.get("section", {}) or (not is_rigid(body) and type_of(body["element"]).degree_y > 1):
                self.knows_moment = False
            weight = mass_per_length(body) * length(body["geometry"]) * g
            for place, share in self.along(name, 0.0, 1.0):
                self.add(share * weight, place)
        for mass in self.case.get("masses", ()):
            self.add(mass["mass"] * g, self.place(mass["at"]))

    def along(self, name: str, a: float, b: float) -> Any:
        """Yield positions along a body from S = a to b, with their shares of S."""
        mesh, state = self.model.meshes[name], self.found.state
        assert state is not None
        plan = mesh.plan
        ends = np.concatenate([p.s0 + p.l * np.arange(p.count + 1) for p in plan.pieces]) / plan.length
        breaks = np.unique(np.clip(np.append(ends, (a, b)), a, b))
        e = self.model.e0 + (0.0 if self.linear else state.d[:self.model.n_q])
        for low, high in pairwise(breaks.tolist()):
            if high - low < 1e-12:
                continue
            for x, w in zip(*GAUSS, strict=True):
                s = 0.5 * (low + high) + 0.5 * (high - low) * x
                yield np.array([dot(c, e) for c in point_ref(mesh, s).position()]), 0.5 * (high - low) * w

    # ------------------------------------------------------------------ springs

    def spring(self, spring: Data) -> None:
        """Add the force of a spring from the ground."""
        ends = spring["between"]
        if self.linear and self.pulls(spring):
            # its stiffness turns a force, or moves a moment, that is there before: about the reference, moments then
            # balance to first order of the displacements alone
            self.knows_moment = False
        ground = [p for p in ends if not isinstance(p, str)]
        if not ground:
            return
        p = next(p for p in ends if isinstance(p, str))
        if spring["type"] == "rotational":
            sign = 1.0 if isinstance(ends[1], str) else -1.0
            turn = acting(spring, sign * self.probe(p)["theta"] - spring.get("angle", 0.0))
            self.add(np.zeros(2), np.zeros(2), -sign * spring["stiffness"] * turn)
            return
        q = self.probe(p)
        u = np.array([q["ux"], q["uy"]])
        before = np.array([q["x"], q["y"]]) - u - ground[0]
        l = float(np.hypot(*before))
        rest = spring.get("length", l)
        if not self.linear:
            now = before + u
            self.add(-spring["stiffness"] * acting(spring, np.hypot(*now) - rest) * now / np.hypot(*now), self.place(p))
            return
        n, pull = before / l, spring["stiffness"] * (l - rest)
        across = u - n * (n @ u)
        self.add(-(pull + spring["stiffness"] * float(n @ u)) * n - pull / l * across, self.place(p))

    def pulls(self, spring: Data) -> bool:
        """Return whether a spring acts before anything moves."""
        return spring.get("angle", 0.0) != 0.0 or "length" in spring

    # ------------------------------------------------------------------ what is left

    def left(self) -> Array:
        """Return the remaining force and, if known, moment over the scene's size, without sliders."""
        sliders = [j for j in self.case.get("joints", ()) if j["type"] == "slider"]
        columns = []
        for joint in sliders:
            along = np.array(joint["along"]) / np.hypot(*joint["along"])
            n, place = np.array([-along[1], along[0]]), self.place(joint["at"])
            columns.append([n[0], n[1], (place[0] * n[1] - place[1] * n[0]) / self.extent])
        b = np.array([*self.force, self.moment / self.extent])
        A = np.array(columns).T.reshape(3, -1)
        if not self.knows_moment:
            A, b = A[:2], b[:2]
        if sliders:
            b = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
        return b


def acting(spring: Data, elongation: float) -> float:
    """Return the part of an elongation, or angle, in which a spring acts."""
    gap, only = spring.get("gap", 0.0), spring.get("only")
    above = 0.0 if only == "compression" else max(elongation - gap, 0.0)
    below = 0.0 if only == "tension" else min(elongation + gap, 0.0)
    return above + below
