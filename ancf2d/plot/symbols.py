"""The usual symbols of supports, loads, joints, springs and masses, at the points of the case where they act."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from ancf2d.errors import ResultsError
from ancf2d.results import Results

INK = "0.15"
ALONG_LOAD = 9  # arrows of a distributed load
STEP = 1e-3  # of the arc length: what the direction of an axis is read from


@dataclass(frozen=True)
class Symbol:
    """What is drawn: ``kind`` in MARKS at points (n, 2), turned by ``angle``; a spring joins its two points."""

    kind: str
    points: np.ndarray
    angle: float = 0.0


def _with_numbers(value: Any) -> Any:
    """Return what was read of a case with numbers in the place of their texts."""
    if isinstance(value, dict):
        return {key: _with_numbers(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_with_numbers(v) for v in value]
    with suppress(ValueError):
        return float(value) if isinstance(value, str) else value
    return value


class _Scene:
    """Points and directions of one state, magnified as the bodies are; the case as completed."""

    def __init__(self, results: Results, state: int | None, scale: float) -> None:
        self.results, self.state, self.scale = results, state, scale
        try:
            # as texts: to YAML 1.1, on and off are no names, and 3e7 is no number
            case = yaml.load(results.case_completed, yaml.BaseLoader)
        except (yaml.YAMLError, ResultsError):
            case = None
        self.case: dict[str, Any] = _with_numbers(case) if isinstance(case, dict) else {}

    def entries(self, key: str) -> list[dict[str, Any]]:
        found = self.case.get(key)
        return [e for e in found if isinstance(e, dict)] if isinstance(found, list) else []

    def on(self, body: str, s: np.ndarray) -> np.ndarray:
        """Return the points (n, 2) of an axis."""
        place = self.results.reference(body, s)
        return place if self.state is None else place + self.scale * self.results.displacement(body, s, self.state)

    def point(self, at: Any) -> np.ndarray | None:
        """Return where a point of the case is, None where that cannot be told."""
        if isinstance(at, list) and len(at) == 2:
            return np.array(at, float)
        body, mark, s = str(at).partition("@")
        if not mark or body not in self.results.bodies:
            return None
        try:
            return self.on(body, np.array([float(s)]))[0]
        except ValueError:
            return None

    def direction(self, at: Any) -> tuple[float, float]:
        """Return the angle of the axis at a point, and on which side of it the body goes on: 1, -1, or 0 within."""
        body, mark, s = str(at).partition("@")
        if not mark or body not in self.results.bodies:
            return 0.0, 0.0
        at_s = float(s)
        a, b = self.on(body, np.clip([at_s - STEP, at_s + STEP], 0.0, 1.0))
        return math.atan2(*(b - a)[::-1]), 1.0 if at_s < STEP else -1.0 if at_s > 1.0 - STEP else 0.0


def _support(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    at = scene.point(entry.get("at"))
    if at is None:
        return
    kind, angle = entry.get("type"), 0.0
    if kind == "clamp":
        turn, side = scene.direction(entry["at"])
        # the wall stands behind the end of the body
        yield Symbol("clamp", at[None], turn + (math.pi if side < 0 else 0.0))
        return
    if kind == "roller":
        normal = entry.get("normal") or ([1, 0] if entry.get("fixed") == "x" else [0, 1])
        angle = math.atan2(normal[1], normal[0]) - math.pi / 2
    yield Symbol(kind if kind in ("pin", "roller") else "held", at[None], angle)


def _joint(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    kind = entry.get("type")
    points = entry.get("between") or [entry.get("at") or entry.get("point")]
    at = scene.point(points[0])
    if at is None:
        return
    if kind in ("slider", "prismatic"):
        along = entry.get("along")
        angle = math.atan2(along[1], along[0]) if along else scene.direction(points[0])[0]
        yield Symbol("slider", at[None], angle)
    elif kind != "weld":  # what is welded is drawn as one body
        yield Symbol("hinge", at[None])


def _spring(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    ends = [scene.point(p) for p in entry.get("between") or []]
    if len(ends) != 2 or any(e is None for e in ends):
        return
    if entry.get("type") == "rotational":
        yield Symbol("coil", np.array(ends[:1]))
    else:
        yield Symbol("spring", np.array(ends, float))


def _mass(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    at = scene.point(entry.get("at"))
    if at is not None:
        yield Symbol("mass", at[None])


def _constant(value: Any) -> list[float] | None:
    """Return a vector of the case, None where it is not made of numbers."""
    if isinstance(value, list) and len(value) == 2 and all(isinstance(v, int | float) for v in value):
        return [float(v) for v in value]
    return None


def _load(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    kind, value = entry.get("type"), entry.get("value")
    vector = _constant(value)
    if kind == "distributed" and vector and any(vector) and entry.get("on") in scene.results.bodies:
        ends = (entry.get("from") or 0.0, 1.0 if entry.get("to") is None else entry["to"])
        s = np.linspace(*ends, ALONG_LOAD)
        turns = [scene.direction(f"{entry['on']}@{v}")[0] if entry.get("follower") == "true" else 0.0 for v in s]
        for place, turn in zip(scene.on(entry["on"], s), turns, strict=True):
            yield Symbol("small force", place[None], math.atan2(vector[1], vector[0]) + turn)
        return
    at = scene.point(entry.get("at"))
    if at is None:
        return
    if kind in ("force", "follower_force") and vector and any(vector):
        turn = scene.direction(entry["at"])[0] if kind == "follower_force" else 0.0
        yield Symbol("force", at[None], math.atan2(vector[1], vector[0]) + turn)
    elif kind == "moment" and isinstance(value, int | float) and value:
        yield Symbol("moment" if value > 0 else "moment back", at[None])


# the one place where something of a case gets its symbol
_DRAWN: dict[str, Callable[[_Scene, dict[str, Any]], Iterator[Symbol]]] = {
    "boundary_conditions": _support, "springs": _spring, "joints": _joint, "masses": _mass, "loads": _load}


def symbols_of(results: Results, state: int | None, scale: float) -> list[Symbol]:
    """Return the symbols of a file's case in a state (None: reference), displacements magnified by ``scale``.

    What a case says in a way that needs more than its text, such as expressions as values, has no symbol.
    """
    scene = _Scene(results, state, scale)
    return [symbol for key, drawn in _DRAWN.items() for entry in scene.entries(key) for symbol in drawn(scene, entry)]


def _lines(*lines: list[tuple[float, float]]) -> Path:
    """Return a path of open lines."""
    codes = [code for line in lines for code in (Path.MOVETO, *[Path.LINETO] * (len(line) - 1))]
    return Path([p for line in lines for p in line], codes)


def _hatched(y: float, width: float = 1.0) -> list[list[tuple[float, float]]]:
    """Return a line at height y, with the hatching of what stands still below it."""
    strokes = [[(x, y), (x - 0.35, y - 0.4)] for x in np.linspace(-width + 0.35, width, 5)]
    return [[(-width, y), (width, y)], *strokes]


def _circle(x: float, y: float, radius: float, first: float = 0.0, last: float = 2 * math.pi
            ) -> list[tuple[float, float]]:
    return [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in np.linspace(first, last, 25)]


def _arrow(length: float) -> Path:
    """Return an arrow to the right whose tip is at the origin."""
    return _lines([(-length, 0), (0, 0)], [(-0.55, 0.32), (0, 0), (-0.55, -0.32)])


@cache
def _marks() -> dict[str, tuple[Path, float, str]]:
    """Return the outline of each symbol, its size in points, and how it is filled."""
    triangle = [(0.0, 0.0), (0.75, -1.2), (-0.75, -1.2), (0.0, 0.0)]
    wall = [[(-y, x) for x, y in line] for line in _hatched(0.0, 1.2)]
    round_about = _circle(0, 0, 1.1, -0.75 * math.pi, 0.75 * math.pi)
    tip = [(-1.25, 0.4), round_about[-1], (-0.35, 1.25)]
    spiral = [(0.25 * a / math.pi * math.cos(a), 0.25 * a / math.pi * math.sin(a)) for a in np.linspace(0, 14, 60)]
    back = [[(x, -y) for x, y in line] for line in (round_about, tip)]
    return {
        # the wall of a clamp is left of what goes on to the right
        "clamp": (_lines(*[[(-x, y) for x, y in line] for line in wall]), 26, "none"),
        "pin": (_lines(triangle, *_hatched(-1.2)), 14, "white"),
        "roller": (_lines(triangle, _circle(-0.4, -1.45, 0.25), _circle(0.4, -1.45, 0.25), *_hatched(-1.75)), 16,
                   "white"),
        "held": (_lines([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)]), 9, "none"),
        "hinge": (_lines(_circle(0, 0, 0.5)), 6, "white"),
        "slider": (_lines([(-1, -0.55), (1, -0.55), (1, 0.55), (-1, 0.55), (-1, -0.55)], [(-1.6, -0.75), (1.6, -0.75)],
                          [(-1.6, 0.75), (1.6, 0.75)]), 18, "none"),
        "coil": (_lines(spiral), 12, "none"),
        "mass": (_lines(_circle(0, 0, 0.5)), 9, INK),
        "force": (_arrow(2.4), 50, "none"), "small force": (_arrow(1.8), 26, "none"),
        "moment": (_lines(round_about, tip), 24, "none"), "moment back": (_lines(*back), 24, "none"),
    }


def _zigzag(points: np.ndarray, turns: int = 7) -> np.ndarray:
    """Return the line of a spring between two points."""
    a, b = points
    along = b - a
    across = 0.06 * np.array([-along[1], along[0]])
    s = np.concatenate([[0.0], np.linspace(0.2, 0.8, 2 * turns + 1), [1.0]])
    side = np.concatenate([[0.0, 0.0], [(-1.0) ** k for k in range(2 * turns - 1)], [0.0, 0.0]])
    return a + s[:, None] * along + side[:, None] * across


def draw_symbols(axes: Axes, symbols: list[Symbol]) -> None:
    """Draw symbols of a size that does not depend on that of the model."""
    for symbol in symbols:
        if symbol.kind == "spring":
            axes.plot(*_zigzag(symbol.points).T, color=INK, linewidth=1.0, zorder=3.4)
            continue
        path, size, fill = _marks()[symbol.kind]
        # a marker is as large as its outline reaches from its point
        reach = float(np.abs(path.vertices).max())
        load = "force" in symbol.kind or "moment" in symbol.kind
        style = MarkerStyle(path, transform=Affine2D().rotate(symbol.angle))
        axes.plot(*symbol.points.T, linestyle="", marker=style, markersize=size * reach / 1.2 if not load else size,
                  markerfacecolor=fill, markeredgecolor="#a01414" if load else INK, markeredgewidth=1.1, zorder=3.5,
                  clip_on=False)
