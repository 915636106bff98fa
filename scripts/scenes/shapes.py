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
        return number(section["EA"]), number(section["EI"])
    A, I = area(section)
    return number(material["E"]) * A, number(material["E"]) * I


def number(value: Any) -> float:
    """Return a number, or the mean of a table of straight lines over s."""
    if not isinstance(value, dict):
        return float(value)
    return float(np.trapezoid(value["value"], value["s"]))


def turned_round(value: Any) -> Any:
    """Return a number, or a table over s as it is seen from the other end."""
    if not isinstance(value, dict):
        return value
    return {**value, "s": [1.0 - s for s in value["s"][::-1]], "value": value["value"][::-1]}


def part_of(value: Any, a: float, b: float) -> Any:
    """Return a number, or the stretch from s = a to b of a table of straight lines over s, as one from 0 to 1."""
    if not isinstance(value, dict):
        return value
    s, v = np.array(value["s"]), np.array(value["value"])
    inside = (s > a) & (s < b)
    side = 1e-13
    ends = np.interp([a + side, b - side], s, v)
    return {**value, "s": [0.0, *((s[inside] - a) / (b - a)).tolist(), 1.0],
            "value": [float(ends[0]), *v[inside].tolist(), float(ends[1])]}


def area(section: Data) -> tuple[float, float]:
    """Return A and I of a section with dimensions, of mean ones where they vary."""
    if "A" in section:
        return number(section["A"]), number(section["I"])
    h, w = number(section["height"]), number(section["width"])
    return h * w, w * h**3 / 12.0


def mass_per_length(body: Data) -> float:
    """Return the mass per length of a body."""
    if "mass" in body["element"]:
        return float(body["element"]["mass"] / length(body["geometry"]))
    section = body["section"]
    return number(section["rhoA"]) if "EA" in section else area(section)[0] * number(body["material"]["rho"])


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
