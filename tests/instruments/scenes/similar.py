"""A transformed scene: turned, mirrored, shifted and in other units, and its expected answer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .amplitudes import scaled, stretched
from .shapes import Array, Data

# powers of length, force and time in what a case holds as numbers, by key; what is not here has no dimension, or is a
# place or vector that is treated by name
DIMENSIONS = {
    "height": (1, 0, 0), "width": (1, 0, 0), "A": (2, 0, 0), "I": (4, 0, 0), "EA": (0, 1, 0), "kGA": (0, 1, 0),
    "EI": (2, 1, 0), "rhoA": (-2, 1, 2), "rhoI": (0, 1, 2), "E": (-2, 1, 0), "rho": (-4, 1, 2), "radius": (1, 0, 0),
    "axis": (1, 0, 0), "kelvin_voigt": (0, 0, 1), "mass": (-1, 1, 2), "inertia": (1, 1, 2), "length": (1, 0, 0),
    "alpha": (0, 0, -1), "yield": (-2, 1, 0), "isotropic": (-2, 1, 0), "kinematic": (-2, 1, 0), "stress": (-2, 1, 0),
    "time": (0, 0, 1),
    "beta": (0, 0, 1), "omega": (0, 0, -1), "t_end": (0, 0, 1), "dt": (0, 0, 1), "interval": (0, 0, 1)}
# of springs, by type
SPRINGS = {"translational": {"stiffness": (-1, 1, 0), "damping": (-1, 1, 1)},
           "rotational": {"stiffness": (1, 1, 0), "damping": (1, 1, 1)}}
# of loads, by type: dimension of the value
LOADS = {"force": (0, 1, 0), "follower_force": (0, 1, 0), "moment": (1, 1, 0), "torque": (1, 1, 0),
         "gravity": (1, 0, -2), "distributed": (-1, 1, 0)}
# of loads within a body, which balance themselves: dimensions of their numbers that have any
INNER: dict[str, dict[str, tuple[int, int, int]]] = {
    "tendon": {"tension": (0, 1, 0), "y": (1, 0, 0), "stiffness": (0, 1, 0), "slack": (1, 0, 0)},
    "eigenstrain": {"curvature": (-1, 0, 0)},
    "temperature": {"gradient": (-1, 0, 0)}}
# those of their numbers that change sign as the section's y axis does
ODD = ("y", "curvature", "gradient")
# of the pieces of a path
PIECES = {"line": (1, 0, 0), "arc": (1, 0, 0)}
PLACES = ("start", "end", "center", "through", "about")
DIRECTIONS = ("normal", "along")


class UnfitError(ValueError):
    """A scene that cannot be transformed in this way."""


@dataclass(frozen=True)
class Similarity:
    """x -> length (turned and mirrored x) + shift, force and time in other units.

    ``angle`` turns counter-clockwise [rad]; ``mirrored`` changes the sign of y first.
    """

    angle: float = 0.0
    mirrored: bool = False
    shift: tuple[float, float] = (0.0, 0.0)
    length: float = 1.0
    force: float = 1.0
    time: float = 1.0

    # ------------------------------------------------------------------ numbers

    @property
    def sense(self) -> float:
        """Return -1 where rotations change their sense."""
        return -1.0 if self.mirrored else 1.0

    @property
    def R(self) -> Array:
        """Return the orthogonal matrix (2, 2); quarter turns are exact."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        if self.quarters is not None:
            c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[self.quarters % 4]
        return np.array([[c, -s], [s, c]]) @ np.diag([1.0, self.sense])

    @property
    def quarters(self) -> int | None:
        """Return the number of quarter turns, None if the angle is no multiple of one."""
        turns = self.angle / (0.5 * math.pi)
        return round(turns) if abs(turns - round(turns)) < 1e-12 else None

    def unit(self, dimension: tuple[int, int, int]) -> float:
        """Return the factor of a number with given powers of length, force and time."""
        a, b, c = dimension
        return self.length**a * self.force**b * self.time**c

    def place(self, p: Any) -> list[float]:
        """Return the image of a position."""
        return [float(v) for v in self.length * (self.R @ np.array(p)) + np.array(self.shift)]

    def vector(self, v: Any, dimension: tuple[int, int, int] = (0, 0, 0)) -> list[float]:
        """Return the image of a vector."""
        return [float(x) for x in self.unit(dimension) * (self.R @ np.array(v))]

    # ------------------------------------------------------------------ cases

    def case(self, case: Data) -> Data:
        """Return the transformed scene. Raises UnfitError if the format cannot express it."""
        return _Case(self, case["solver"]["type"] in ("dynamic", "quasi_static")).everything(case)


class _Case:
    """A case under transformation."""

    def __init__(self, to: Similarity, moves: bool) -> None:
        self.to, self.moves = to, moves

    def everything(self, case: Data) -> Data:
        out = {key: self.general(value) for key, value in case.items() if key not in (
            "boundary_conditions", "loads", "springs")}
        out["bodies"] = {name: self.body(body) for name, body in case["bodies"].items()}
        for key, one in (("boundary_conditions", self.support), ("loads", self.load), ("springs", self.spring)):
            if key in case:
                out[key] = [one(item) for item in case[key]]
        return {key: out[key] for key in case}

    def general(self, value: Any, key: str = "") -> Any:
        """Return anything whose keys determine its kind."""
        to = self.to
        if key in DIMENSIONS and isinstance(value, list):
            return [v * to.unit(DIMENSIONS[key]) for v in value]
        if key in DIMENSIONS and isinstance(value, dict):
            return {**value, "value": [v * to.unit(DIMENSIONS[key]) for v in value["value"]]}
        if key == "material":
            # its alpha is of temperature, and has no dimension; that of the case's damping has
            own = {k: v for k, v in value.items() if k != "alpha"}
            return {k: self.general(own[k], k) if k in own else v for k, v in value.items()}
        if isinstance(value, dict):
            return {k: self.general(v, k) for k, v in value.items()}
        if key in PLACES and isinstance(value, list):
            return to.place(value)
        if key in DIRECTIONS:
            return to.vector(value)
        if key == "velocity":
            return to.vector(value, (1, 0, -1))
        if key == "points":
            return [to.place(p) for p in value]
        if isinstance(value, list):
            return [self.general(v) if isinstance(v, dict) else v for v in value]
        if key == "y" and not isinstance(value, str):
            return to.sense * to.length * value
        if key == "omega":
            return to.sense * to.unit((0, 0, -1)) * value
        return value * to.unit(DIMENSIONS[key]) if key in DIMENSIONS and not isinstance(value, str) else value

    def body(self, body: Data) -> Data:
        out = {key: value if key == "element" else self.general(value, key) for key, value in body.items()}
        # of an element, a rigid body's mass and inertia alone have dimensions
        out["element"] = {k: v * self.to.unit(DIMENSIONS[k]) if k in ("mass", "inertia") else v
                          for k, v in body["element"].items()}
        geometry = out["geometry"]
        if geometry["type"] == "arc":
            for key in ("from", "to"):
                geometry[key] = self.to.sense * geometry[key] + self.to.angle
        if geometry["type"] == "path":
            geometry["heading"] = self.to.sense * geometry.get("heading", 0.0) + self.to.angle
            geometry["pieces"] = [{k: v * (self.to.unit(PIECES[k]) if k in PIECES else self.to.sense)
                                   for k, v in piece.items()} for piece in geometry["pieces"]]
        if geometry["type"] == "curve":
            rows, (x, y) = self.to.length * self.to.R, (geometry["x"], geometry["y"])
            for key, (a, b), c in zip("xy", rows.tolist(), self.to.shift, strict=True):
                geometry[key] = f"({a!r})*({x}) + ({b!r})*({y}) + ({float(c)!r})"
        if self.to.mirrored:
            turn_layers(out)
        return out

    def amplitude(self, amplitude: Any, by: float = 1.0) -> Any:
        """Return an amplitude times a number, in other units of time if it depends on time."""
        if isinstance(amplitude, dict) and self.moves:
            amplitude = stretched(amplitude, self.to.time)
        return scaled(amplitude, by)

    def over_time(self, item: Data) -> Data:
        """Return an item with its amplitude and switching times in other units of time."""
        out = {**item, "amplitude": self.amplitude(item["amplitude"])} if "amplitude" in item else dict(item)
        if "active" in item:
            out["active"] = {key: self.to.time * t for key, t in item["active"].items()}
        return out

    def load(self, load: Data) -> Data:
        to = self.to
        if load["type"] in INNER:
            new: Any = {k: times(load[k], to.unit(d) * (to.sense if k in ODD else 1.0))
                        for k, d in INNER[load["type"]].items() if k in load}
            if "through" in load:
                new["through"] = [p if isinstance(p, str) else {**p, "y": to.sense * to.length * p["y"]}
                                  for p in load["through"]]
            return self.over_time({**load, **new})
        unit, value = LOADS[load["type"]], load["value"]
        if load["type"] == "torque":
            ends = [p if isinstance(p, str) else to.place(p) for p in load["between"]]
            return self.over_time({**load, "between": ends, "value": to.sense * to.unit(unit) * value})
        if load["type"] == "moment":
            new = to.sense * to.unit(unit) * value
        elif load["type"] == "follower_force" or load.get("follower"):
            new = [to.unit(unit) * value[0], to.sense * to.unit(unit) * value[1]]
        else:
            new = to.vector(value, unit)
        return self.over_time({**load, "value": new})

    def spring(self, spring: Data) -> Data:
        out = self.over_time(spring)
        out |= {k: self.to.unit(unit) * spring[k] for k, unit in SPRINGS[spring["type"]].items() if k in spring}
        out["between"] = [p if isinstance(p, str) else self.to.place(p) for p in spring["between"]]
        if "angle" in out:
            out["angle"] = self.to.sense * out["angle"]
        if "length" in out:
            out["length"] = self.to.length * out["length"]
        if "gap" in out and spring["type"] == "translational":
            out["gap"] = self.to.length * out["gap"]
        return swapped(out) if self.to.mirrored and spring["type"] == "rotational" else out

    def support(self, support: Data) -> Data:
        out, to = dict(support), self.to
        if "normal" in out:
            out["normal"] = to.vector(out["normal"])
        if support.get("fixed") is not None:
            axis = {"x": [1.0, 0.0], "y": [0.0, 1.0]}[out["fixed"]]
            new = to.vector(axis)
            if to.quarters is None:
                del out["fixed"]
                out["normal"] = new
            else:
                out["fixed"] = "x" if abs(new[0]) > 0.5 else "y"
        if support["type"] == "prescribed":
            out.update(self.motion(support))
        return out

    def motion(self, support: Data) -> Data:
        """Return prescribed motion, with both displacements in the same form."""
        out, (ux, uy) = {}, (support["ux"], support["uy"])
        new = self.to.vector([ux["scale"], uy["scale"]], (1, 0, 0))
        for key, was, scale in (("ux", ux, new[0]), ("uy", uy, new[1])):
            out[key] = {**self.amplitude(was), "scale": scale}
        out["angle"] = self.amplitude(support["angle"], self.to.sense)
        return out


def times(value: Any, factor: float) -> Any:
    """Return a number, or a table over s, times a factor."""
    return {**value, "value": [factor * v for v in value["value"]]} if isinstance(value, dict) else factor * value


def swapped(spring: Data) -> Data:
    """Return a one-sided spring with the other side; any other unchanged."""
    other = {"tension": "compression", "compression": "tension"}
    return {**spring, "only": other[spring["only"]]} if "only" in spring else spring


def turn_layers(body: Data) -> None:
    """Turn the layers of a section upside down, as its y axis is."""
    section = body.get("section", {})
    if "layers" in section:
        section["layers"] = section["layers"][::-1]
        if isinstance(section.get("axis"), float):
            section["axis"] = sum(layer["height"] for layer in section["layers"]) - section["axis"]
