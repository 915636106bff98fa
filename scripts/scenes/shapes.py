"""What a body of a case is as numbers: its axis, stiffnesses and mass, from the case alone."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

Array = np.ndarray
Data = dict[str, Any]


def at(name: str, s: float) -> str:
    """Return BODY@S."""
    return f"{name}@{s!r}" if 0.0 < s < 1.0 else f"{name}@{round(s)}"


def split_point(text: str) -> tuple[str, float]:
    """Return the body and S of BODY@S."""
    name, s = text.split("@")
    return name, float(s)


def length(geometry: Data) -> float:
    """Return the arc length of an axis."""
    if geometry["type"] == "arc":
        return float(geometry["radius"] * abs(geometry["to"] - geometry["from"]))
    return float(sum(math.dist(a, b) for a, b in pairwise(corners(geometry))))


def corners(geometry: Data) -> list[list[float]]:
    """Return the corners of a line or polyline, ends included."""
    return geometry["points"] if geometry["type"] == "polyline" else [geometry["start"], geometry["end"]]


def position(geometry: Data, s: float) -> Array:
    """Return the point (2,) at fraction s of the arc length."""
    if geometry["type"] == "arc":
        angle = geometry["from"] + s * (geometry["to"] - geometry["from"])
        return np.array(geometry["center"]) + geometry["radius"] * np.array([math.cos(angle), math.sin(angle)])
    sigma, points = s * length(geometry), np.array(corners(geometry))
    for a, b in pairwise(points):
        size = float(np.hypot(*(b - a)))
        if sigma <= size * (1 + 1e-12):
            return a + (b - a) * min(sigma / size, 1.0)
        sigma -= size
    return points[-1]


def point(case: Data, text: str) -> Array:
    """Return where BODY@S is in the reference (2,)."""
    name, s = split_point(text)
    return position(case["bodies"][name]["geometry"], s)


def pieces(geometry: Data) -> int:
    """Return the number of smooth pieces of an axis."""
    return len(geometry["points"]) - 1 if geometry["type"] == "polyline" else 1


def stiffness(body: Data) -> tuple[float, float]:
    """Return EA and EI of a body; those of the section beside a material of its own where it is rigid."""
    section, material = body.get("section"), body.get("material") or {}
    if section is None:
        return 1.0, 1.0
    if "EA" in section:
        return section["EA"], section["EI"]
    A, I = area(section)
    return material["E"] * A, material["E"] * I


def area(section: Data) -> tuple[float, float]:
    """Return A and I of a section with dimensions."""
    if "A" in section:
        return section["A"], section["I"]
    return section["height"] * section["width"], section["width"] * section["height"] ** 3 / 12.0


def mass_per_length(body: Data) -> float:
    """Return the mass per length of a body."""
    if "mass" in body["element"]:
        return float(body["element"]["mass"] / length(body["geometry"]))
    section = body["section"]
    return float(section["rhoA"] if "EA" in section else area(section)[0] * body["material"]["rho"])


def has_mass(body: Data) -> bool:
    """Return whether a body says what it weighs."""
    known = {"rho", "rhoA", "mass"}
    return any(known & set(body.get(part, ())) for part in ("section", "material", "element"))


def is_rigid(body: Data) -> bool:
    """Whether a body is a rigid bar."""
    return bool(body["element"]["type"] == "rigid")


def extent(case: Data) -> float:
    """Return the size of a scene."""
    found = [b["geometry"] for b in case["bodies"].values()]
    points = np.array([position(g, s) for g in found for s in (0.0, 0.25, 0.5, 0.75, 1.0)])
    return float(max(np.ptp(points, axis=0).max(), *(length(g) for g in found)))
