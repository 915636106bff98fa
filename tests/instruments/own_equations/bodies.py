"""Bodies of a case: lines and arcs with a section."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from instruments.references.spectral_bars import Bar, Section

from .points import Array

__all__ = ["NEAR", "RIGID", "SHEARLESS", "Bar", "Body", "Leg", "Section", "legs", "section"]

NEAR = 1e-9
SHEARLESS = "cable"
RIGID = {"type": "rigid"}


@dataclass
class Leg:
    """A line or arc of a body: it begins at ``start`` in direction ``angle`` and turns by ``bend`` over ``length``."""

    start: Array
    angle: float
    length: float
    bend: float = 0.0

    def at(self, s: float) -> Array:
        """Return the position at s in [0, 1]."""
        along = self.angle + self.bend * s / 2
        chord = self.length * s * np.sinc(self.bend * s / (2 * math.pi))
        return self.start + chord * np.array([math.cos(along), math.sin(along)])


def legs(geometry: dict[str, Any]) -> list[Leg]:
    """Return the lines and arcs of a geometry."""
    if geometry["type"] == "arc":
        a, b, r = geometry["from"], geometry["to"], geometry["radius"]
        start = np.array(geometry["center"], float) + r * np.array([math.cos(a), math.sin(a)])
        return [Leg(start, a + math.copysign(math.pi / 2, b - a), r * abs(b - a), b - a)]
    corners = geometry["points"] if geometry["type"] == "polyline" else [geometry["start"], geometry["end"]]
    found = []
    for a, b in pairwise(corners):
        d = np.subtract(b, a).astype(float)
        found.append(Leg(np.array(a, float), math.atan2(d[1], d[0]), float(np.hypot(*d))))
    return found


def section(body: dict[str, Any], shearless: float) -> Section:
    """Return stiffnesses and masses per length; without shear, ``shearless`` times EA is kGA and rhoI is 0."""
    given = body["section"]
    if "EA" in given:
        values = [given.get(k, 0.0) for k in ("EA", "kGA", "EI", "rhoA", "rhoI")]
    else:
        material = body["material"]
        A = given["A"] if "A" in given else given["height"] * given["width"]
        I = given["I"] if "I" in given else given["width"] * given["height"]**3 / 12
        E, nu, rho = material["E"], material.get("nu", 0.0), material.get("rho", 0.0)
        k = 10 * (1 + nu) / (12 + 11 * nu)
        values = [E * A, k * E / (2 * (1 + nu)) * A, E * I, rho * A, rho * I]
    if body["element"]["type"] == SHEARLESS:
        values[1], values[4] = shearless * values[0], 0.0
    return Section(*values)


@dataclass
class Body:
    """A body: its legs, and (from, to, piece) in arc length for bars, or the coordinates of a rigid one."""

    legs: list[Leg]
    pieces: list[tuple[float, float, int]] = field(default_factory=list)
    rigid: int | None = None
    centre: Array = field(default_factory=lambda: np.zeros(2))

    @property
    def length(self) -> float:
        """Return the arc length."""
        return sum(leg.length for leg in self.legs)

    def where(self, s: float) -> tuple[Leg, float]:
        """Return the leg at arc length s, and the position along it in [0, 1]."""
        for leg in self.legs:
            if s <= leg.length * (1 + NEAR):
                return leg, min(s / leg.length, 1.0)
            s -= leg.length
        return self.legs[-1], 1.0
