"""A body of a case as numbers: its axis, stiffnesses and mass, from the case alone."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

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
    if geometry["type"] == "path":
        return sum(map(piece_length, geometry["pieces"]))
    if geometry["type"] in ("spline", "curve"):
        return curve_of(geometry).length
    return float(sum(math.dist(a, b) for a, b in pairwise(corners(geometry))))


def corners(geometry: Data) -> list[list[float]]:
    """Return the corners of a line or polyline, ends included."""
    return geometry["points"] if geometry["type"] == "polyline" else [geometry["start"], geometry["end"]]


def position(geometry: Data, s: float) -> Array:
    """Return the point (2,) at fraction s of the arc length."""
    if geometry["type"] == "arc":
        angle = geometry["from"] + s * (geometry["to"] - geometry["from"])
        return np.array(geometry["center"]) + geometry["radius"] * np.array([math.cos(angle), math.sin(angle)])
    if geometry["type"] == "path":
        return path_position(geometry, s)
    if geometry["type"] in ("spline", "curve"):
        curve = curve_of(geometry)
        return curve.place(np.array([curve.parameter(s)]))[0]
    sigma, points = s * length(geometry), np.array(corners(geometry))
    for a, b in pairwise(points):
        size = float(np.hypot(*(b - a)))
        if sigma <= size * (1 + 1e-12):
            return a + (b - a) * min(sigma / size, 1.0)
        sigma -= size
    return points[-1]


def point(case: Data, text: str) -> Array:
    """Return the position of BODY@S in the reference (2,)."""
    name, s = split_point(text)
    return position(case["bodies"][name]["geometry"], s)


def pieces(geometry: Data) -> int:
    """Return the number of smooth pieces of an axis."""
    return {"polyline": len(geometry.get("points", ())) - 1, "path": len(geometry.get("pieces", ()))}.get(
        geometry["type"], 1)


# ---------------------------------------------------------------------- curved axes


def piece_length(piece: Data) -> float:
    """Return the length of a piece of a path."""
    return float(piece["line"] if "line" in piece else piece["arc"] * abs(piece["angle"]))


def path_ends(geometry: Data) -> list[float]:
    """Return S of the ends of the pieces of a path."""
    return [float(s) / length(geometry) for s in np.cumsum([0.0, *map(piece_length, geometry["pieces"])])]


def path_position(geometry: Data, s: float) -> Array:
    """Return the point (2,) at fraction s of a path."""
    p, heading, left = np.array(geometry["start"], dtype=float), geometry.get("heading", 0.0), s * length(geometry)
    for piece in geometry["pieces"]:
        l = min(piece_length(piece), left)
        if "line" in piece:
            p = p + l * np.array([math.cos(heading), math.sin(heading)])
        else:
            sense = math.copysign(1.0, piece["angle"])
            turned = heading + sense * l / piece["arc"]
            p = p + sense * piece["arc"] * np.array([math.sin(turned) - math.sin(heading),
                                                     math.cos(heading) - math.cos(turned)])
            heading = turned
        left -= l
    return p


class Curve:
    """A curve x(u), y(u) for u from 0 to 1, and its arc length by quadrature; ``place`` and ``slope`` take arrays."""

    POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)

    def __init__(self, place: Callable[[Array], Array], slope: Callable[[Array], Array], breaks: Array) -> None:
        self.place, self.slope = place, slope
        self.u = np.unique(np.concatenate([np.linspace(a, b, 33) for a, b in pairwise(breaks)]))
        self.sigma = np.append(0.0, np.cumsum([self.between(a, b) for a, b in pairwise(self.u)]))
        self.length = float(self.sigma[-1])

    def between(self, a: float, b: float) -> float:
        """Return the arc length between two parameters."""
        u = 0.5 * (a + b) + 0.5 * (b - a) * self.POINTS
        return float(0.5 * (b - a) * self.WEIGHTS @ np.hypot(*self.slope(u).T))

    def parameter(self, s: float) -> float:
        """Return the parameter at fraction s of the arc length, by Newton's method."""
        if s in (0.0, 1.0):
            return s
        wanted = s * self.length
        k = min(int(np.searchsorted(self.sigma, wanted, "right")) - 1, len(self.u) - 2)
        low, u = float(self.u[k]), float(np.interp(wanted, self.sigma, self.u))
        for _ in range(8):
            u -= float((self.sigma[k] + self.between(low, u) - wanted) / np.hypot(*self.slope(np.array([u]))[0]))
        return u


def curve_of(geometry: Data) -> Curve:
    """Return a spline, or a curve given by expressions, with its arc length."""
    return _curve(json.dumps(geometry))


@lru_cache(maxsize=256)
def _curve(text: str) -> Curve:
    geometry = json.loads(text)
    if geometry["type"] == "spline":
        points = np.array(geometry["points"])
        closed = geometry.get("closed", False)
        points = np.concatenate([points, points[:1]]) if closed else points
        chords = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
        spline = CubicSpline(chords / chords[-1], points, bc_type="periodic" if closed else "not-a-knot")
        return Curve(spline, spline.derivative(), chords / chords[-1])
    names = {k: getattr(np, k) for k in ("sin", "cos", "exp", "sqrt", "pi")}
    codes = [compile(geometry[k].replace("^", "**"), k, "eval") for k in ("x", "y")]

    def place(u: Array) -> Array:
        return np.stack([eval(code, {"__builtins__": {}}, {**names, "s": u}) + 0.0 * u for code in codes], axis=-1)

    # by complex steps, exact to round-off
    return Curve(place, lambda u: place(u + 1e-30j).imag / 1e-30, np.array([0.0, 1.0]))


def stiffness(body: Data) -> tuple[float, float]:
    """Return EA and EI of a body, also of a rigid one with section and material."""
    section, material = body.get("section"), body.get("material") or {}
    if section is None:
        return 1.0, 1.0
    if "EA" in section:
        return number(section["EA"]), number(section["EI"])
    if "layers" in section:
        h = sum(layer["height"] for layer in section["layers"])
        EA = section["width"] * sum(layer["height"] * layer["material"]["E"] for layer in section["layers"])
        return EA, EA * h**2 / 12.0
    A, I = area(section)
    return number(material["E"]) * A, number(material["E"]) * I


def number(value: Any) -> float:
    """Return a number, or the mean of a piecewise linear table over s."""
    if not isinstance(value, dict):
        return float(value)
    return float(np.trapezoid(value["value"], value["s"]))


def turned_round(value: Any) -> Any:
    """Return a number, or a table over s seen from the other end."""
    if not isinstance(value, dict):
        return value
    return {**value, "s": [1.0 - s for s in value["s"][::-1]], "value": value["value"][::-1]}


def part_of(value: Any, a: float, b: float) -> Any:
    """Return a number, or the part from s = a to b of a piecewise linear table over s, as a table from 0 to 1."""
    if not isinstance(value, dict):
        return value
    s, v = np.array(value["s"]), np.array(value["value"])
    inside = (s > a) & (s < b)
    side = 1e-13
    ends = np.interp([a + side, b - side], s, v)
    return {**value, "s": [0.0, *((s[inside] - a) / (b - a)).tolist(), 1.0],
            "value": [float(ends[0]), *v[inside].tolist(), float(ends[1])]}


def area(section: Data) -> tuple[float, float]:
    """Return A and I of a section with dimensions, of their means if they vary."""
    if "A" in section:
        return number(section["A"]), number(section["I"])
    h, w = number(section["height"]), number(section["width"])
    return h * w, w * h**3 / 12.0


def mass_per_length(body: Data) -> float:
    """Return the mass per length of a body."""
    if "mass" in body["element"]:
        return float(body["element"]["mass"] / length(body["geometry"]))
    section = body["section"]
    if "layers" in section:
        return float(section["width"] * sum(x["height"] * x["material"]["rho"] for x in section["layers"]))
    return number(section["rhoA"]) if "EA" in section else area(section)[0] * number(body["material"]["rho"])


def has_mass(body: Data) -> bool:
    """Return whether a body has a mass."""
    known = {"rho", "rhoA", "mass", "layers"}
    return any(known & set(body.get(part, ())) for part in ("section", "material", "element"))


def is_straight(body: Data) -> bool:
    """Whether the axis is straight between its corners: the mass of a curved body is that of its mesh."""
    return bool(body["geometry"]["type"] in ("line", "polyline"))


def varies(body: Data) -> bool:
    """Whether section or material vary along a body."""
    return any(isinstance(v, dict) and "s" in v for k in ("section", "material") for v in body.get(k, {}).values())


def is_rigid(body: Data) -> bool:
    """Whether a body is a rigid bar."""
    return bool(body["element"]["type"] == "rigid")


def extent(case: Data) -> float:
    """Return the size of a scene."""
    found = [b["geometry"] for b in case["bodies"].values()]
    points = np.array([position(g, s) for g in found for s in (0.0, 0.25, 0.5, 0.75, 1.0)])
    return float(max(np.ptp(points, axis=0).max(), *(length(g) for g in found)))


def has_laws(case: Data, fibres: bool = False) -> bool:
    """Return whether a material of a scene has memory, or fibres."""
    keys = {"yield", "stress_strain"} | (set() if fibres else {"viscoelastic"})
    return any(keys & set(material) for body in case["bodies"].values() for material in (
        body.get("material", {}), *(layer["material"] for layer in body.get("section", {}).get("layers", ()))))
