"""The usual symbols of supports, loads, joints, springs and masses: their places and outlines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import yaml

from ancf2d.errors import ResultsError
from ancf2d.results.reader import Results
from ancf2d.results.records import EVENT_WORDS

ALONG_LOAD = 9  # number of arrows of a distributed load
NEAR = 1e-9  # relative to the arc length: tolerance for points at the ends of a body
STEP = 1e-3  # relative to the arc length: distance for the direction of an axis
ALWAYS = -math.inf, math.inf


@dataclass(frozen=True)
class Symbol:
    """A symbol: the outline ``kind`` at points (n, 2), turned by ``angle``.

    A spring or a segment of a tendon connects its two points, which have distances ``off`` from the axes of their
    bodies. ``on`` has the body and S of each point, None for a point of the ground; ``tracks`` the names in
    ``tracks_of`` of points that move along their bodies. A symbol that ``turns`` keeps its angle to the axis at its
    first point. ``gravity`` has no points, as it acts everywhere. ``active_times`` are the times at which it starts and
    stops acting.
    """

    kind: str
    points: np.ndarray
    angle: float = 0.0
    on: tuple[tuple[str, float] | None, ...] = ()
    turns: bool = False
    tracks: tuple[str | None, ...] = ()
    active_times: tuple[float, float] = ALWAYS
    off: tuple[float, ...] = ()


def _with_numbers(value: Any) -> Any:
    """Return data read from a case, with texts of numbers converted to numbers."""
    if isinstance(value, dict):
        return {key: _with_numbers(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_with_numbers(v) for v in value]
    with suppress(ValueError):
        return float(value) if isinstance(value, str) else value
    return value


def completed_case(results: Results) -> dict[str, Any]:
    """Return the case with defaults, read from YAML as numbers and texts only; empty if it is not a case.

    It must not be changed, since all callers share it.
    """
    try:
        return _read(results.case_completed)
    except (yaml.YAMLError, ResultsError):
        return {}


@lru_cache(maxsize=4)
def _read(text: str) -> dict[str, Any]:
    # as texts: in YAML 1.1, on and off are not names, and 3e7 is not a number
    case = yaml.load(text, yaml.BaseLoader)
    return _with_numbers(case) if isinstance(case, dict) else {}


def row_of(results: Results, state: int) -> int:
    """Return the row of a state among the readings of the probes, of which there may be more than states."""
    t = results.probe_t
    return state if len(t) == results.nt else int(np.argmin(np.abs(t - results.t[state])))


def within(s: Any) -> Any:
    """Return whether S is on a body, up to round-off."""
    return abs(s - 0.5) <= 0.5 + NEAR


def tracks_of(results: Results) -> dict[str, np.ndarray]:
    """Return S at every state (nt,) of the points that move along bodies, by their place in the case."""
    # no probe has a name with dots
    found = {name: columns["s"] for name, columns in results.probes.items() if "." in name and "s" in columns}
    rows = np.array([row_of(results, k) for k in range(results.nt if found else 0)], int)
    return {name: np.asarray(values)[rows] for name, values in found.items()}


class _Scene:
    """Points and directions of one state, with displacements magnified by ``scale``, and the case with defaults.

    Points that move along bodies are taken from the state ``at``; if it is None, from their start, limited to the body.
    """

    def __init__(self, results: Results, state: int | None, scale: float, at: int | None) -> None:
        self.results, self.state, self.scale, self.at = results, state, scale, at
        self.case, self.tracks = completed_case(results), tracks_of(results)

    def entries(self, key: str) -> list[dict[str, Any]]:
        found = self.case.get(key)
        return [self._named(e, f"{key}.{k}") for k, e in enumerate(found) if isinstance(e, dict)
                ] if isinstance(found, list) else []

    def window(self, entry: dict[str, Any], path: str) -> tuple[float, float]:
        """Return the times at which an item starts and stops acting: from the case, or from events for conditions."""
        active = entry.get("active")
        if not isinstance(active, dict):
            return ALWAYS
        name, found = entry.get("name", path), self.results.summary.get("events") or []
        happened = {event["what"]: float(event["t"]) for event in found}
        begins, ends = (happened.get(f"{name} {word}", math.inf) for word in EVENT_WORDS)
        return (begins if "after" in active else active.get("from", -math.inf),
                ends if "until" in active else active.get("to", math.inf))

    def _named(self, entry: dict[str, Any], path: str) -> dict[str, Any]:
        """Return an entry of the case with the names in ``tracks_of`` added to its moving points."""
        out, ends = {**entry, "path": path}, entry.get("between")
        if isinstance(entry.get("at"), dict):
            out["at"] = {**entry["at"], "track": f"{path}.at"}
        if isinstance(ends, list):
            out["between"] = [{**end, "track": f"{path}.between.{j}"} if isinstance(end, dict) else end
                              for j, end in enumerate(ends)]
        return out

    def on(self, body: str, s: np.ndarray) -> np.ndarray:
        """Return points (n, 2) of an axis."""
        place = self.results.reference(body, s)
        return place if self.state is None else place + self.scale * self.results.displacement(body, s, self.state)

    def place(self, at: Any) -> tuple[str, float] | None:
        """Return body and S of a point of the case, or None if it is not on a body or has left it."""
        if isinstance(at, dict):
            track, body = self.tracks.get(at.get("track", "")), str(at.get("on"))
            if track is None or body not in self.results.bodies:
                return None
            place = float(track[self.at]) if self.at is not None else min(max(float(track[0]), 0.0), 1.0)
            return (body, min(max(place, 0.0), 1.0)) if within(place) else None
        body, mark, s = str(at).partition("@")
        with suppress(ValueError):
            return (body, float(s)) if mark and body in self.results.bodies else None
        return None

    def direction(self, at: Any) -> tuple[float, float]:
        """Return the angle of the axis at a point, and 1 at the start of the body, -1 at its end, 0 between."""
        place = self.place(at)
        if place is None:
            return 0.0, 0.0
        body, s = place
        a, b = self.on(body, np.clip([s - STEP, s + STEP], 0.0, 1.0))
        return math.atan2(*(b - a)[::-1]), 1.0 if s < STEP else -1.0 if s > 1.0 - STEP else 0.0

    def symbol(self, kind: str, ats: list[Any], angle: float = 0.0, turns: bool = False) -> Iterator[Symbol]:
        """Yield a symbol at points of the case, or nothing if one of them is unknown."""
        places = tuple(self.place(at) for at in ats)
        grounded = [p is None and _constant(at) is not None for p, at in zip(places, ats, strict=True)]
        if all(p or g for p, g in zip(places, grounded, strict=True)):
            points = [self.on(p[0], np.array([p[1]]))[0] if p else at for p, at in zip(places, ats, strict=True)]
            tracks = tuple(at.get("track") if isinstance(at, dict) else None for at in ats)
            yield Symbol(kind, np.array(points, float), angle, places, turns and places[0] is not None, tracks)


def _support(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    at, kind = entry.get("at"), entry.get("type")
    if kind == "clamp":
        turn, side = scene.direction(at)
        # the wall is behind the end of the body
        yield from scene.symbol("clamp", [at], turn + (math.pi if side < 0 else 0.0), turns=True)
        return
    angle = 0.0
    if kind == "roller":
        normal = entry.get("normal") or ([1, 0] if entry.get("fixed") == "x" else [0, 1])
        angle = math.atan2(normal[1], normal[0]) - math.pi / 2
    yield from scene.symbol(kind if kind in ("pin", "roller") else "held", [at], angle)


def _joint(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    kind = entry.get("type")
    at = (entry.get("between") or [entry.get("at") or entry.get("point")])[0]
    if kind in ("slider", "prismatic"):
        along = entry.get("along")
        angle = math.atan2(along[1], along[0]) if along else scene.direction(at)[0]
        yield from scene.symbol("slider", [at], angle, turns=not along)
    elif kind != "weld":  # bodies joined by a weld are drawn as one
        yield from scene.symbol("hinge", [at])


def _spring(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    ends = list(entry.get("between") or [])
    if len(ends) == 2:
        rotational = entry.get("type") == "rotational"
        yield from scene.symbol(*(("coil", ends[:1]) if rotational else ("spring", ends)))


def _mass(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    yield from scene.symbol("mass", [entry.get("at")])


def _constant(value: Any) -> list[float] | None:
    """Return a vector of the case, or None if it is not made of numbers."""
    if isinstance(value, list) and len(value) == 2 and all(isinstance(v, int | float) for v in value):
        return [float(v) for v in value]
    return None


def _load(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    kind, value, at = entry.get("type"), entry.get("value"), entry.get("at")
    vector = _constant(value)
    angle = math.atan2(vector[1], vector[0]) if vector else 0.0
    if kind == "moment" and isinstance(value, int | float) and value:
        yield from scene.symbol("moment" if value > 0 else "moment back", [at])
    elif kind == "torque" and isinstance(value, int | float) and value:
        for end, sign in zip(entry.get("between") or [], (-1.0, 1.0), strict=False):
            if isinstance(end, str):
                yield from scene.symbol("moment" if sign * value > 0 else "moment back", [end])
    elif kind == "tendon":
        yield from _tendon(scene, entry)
    elif not vector or not any(vector):
        return
    elif kind == "gravity":
        yield Symbol("gravity", np.empty((0, 2)), angle)
    elif kind == "distributed" and entry.get("on") in scene.results.bodies:
        yield from _distributed(scene, entry, angle)
    elif kind in ("force", "follower_force"):
        follower = kind == "follower_force"
        yield from scene.symbol("force", [at], angle + (scene.direction(at)[0] if follower else 0.0), follower)


def _tendon(scene: _Scene, entry: dict[str, Any]) -> Iterator[Symbol]:
    """Yield the straight segments from eyelet to eyelet, or along the guide of a body, whose distance may vary."""
    eyelets = [(e.get("at"), e.get("y") or 0.0) if isinstance(e, dict) else (e, 0.0)
               for e in entry.get("through") or []]
    if entry.get("on") in scene.results.bodies:
        start, end = entry.get("from") or 0.0, 1.0 if entry.get("to") is None else entry["to"]
        way = [(s, entry.get("y") or 0.0) for s in np.linspace(start, end, 2 * ALONG_LOAD)]
        if (varies := f"guides/{entry['path']}") in scene.results.arrays:
            way = scene.results.array(varies).tolist()
        eyelets = [(f"{entry['on']}@{s}", y) for s, y in way]
    if not all(isinstance(y, int | float) for _, y in eyelets):
        return
    for ends in pairwise(eyelets):
        for symbol in scene.symbol("tendon", [at for at, _ in ends]):
            turns = [scene.direction(at)[0] for at, _ in ends]
            off = [[-y * math.sin(turn), y * math.cos(turn)] for (_, y), turn in zip(ends, turns, strict=True)]
            yield replace(symbol, points=symbol.points + off, off=tuple(y for _, y in ends))


def _distributed(scene: _Scene, entry: dict[str, Any], angle: float) -> Iterator[Symbol]:
    follower = entry.get("follower") == "true"
    for s in np.linspace(entry.get("from") or 0.0, 1.0 if entry.get("to") is None else entry["to"], ALONG_LOAD):
        at = f"{entry['on']}@{s}"
        turn = scene.direction(at)[0] if follower else 0.0
        yield from scene.symbol("small force", [at], angle + turn, follower)


# the only place where an item of a case gets its symbol
_DRAWN: dict[str, Callable[[_Scene, dict[str, Any]], Iterator[Symbol]]] = {
    "boundary_conditions": _support, "springs": _spring, "joints": _joint, "masses": _mass, "loads": _load}


def symbols_of(results: Results, state: int | None, scale: float, at: int | None = None) -> list[Symbol]:
    """Return the symbols of a file's case in a state (None: reference), displacements magnified by ``scale``.

    Points that move along bodies are taken from the state ``at`` (None: the same state, or their start). Items that
    begin and end are shown only while they act; without a state all are shown. Items whose text in the case is not
    enough to place them, such as values given by expressions, have no symbol.
    """
    scene = _Scene(results, state, scale, state if at is None else at)
    found = [replace(symbol, active_times=scene.window(entry, f"{key}.{k}")) for key, drawn in _DRAWN.items()
             for k, entry in enumerate(scene.entries(key)) for symbol in drawn(scene, entry)]
    if scene.at is None:
        return found
    t = float(results.t[scene.at])
    return [symbol for symbol in found if symbol.active_times[0] <= t < symbol.active_times[1]]


def tendons_of(results: Results, state: int | None) -> list[np.ndarray]:
    """Return the points (n, 2) through which each tendon of a file's case runs in a state (None: reference)."""
    scene = _Scene(results, state, 1.0, state)
    found = ([s.points for s in _load(scene, entry)] for entry in scene.entries("loads")
             if entry.get("type") == "tendon")
    return [np.vstack([ways[0][:1], *(way[1:] for way in ways)]) for ways in found if ways]


# ---------------------------------------------------------------------- outlines

Line = list[tuple[float, float]]


@dataclass(frozen=True)
class Outline:
    """The shape of a symbol: open lines around its point, in a ``unit`` given in points (1/72 inch).

    ``filled`` is none, the colour of the background (``back``), or its own colour (``ink``); a ``load`` has a separate
    colour.
    """

    lines: tuple[Line, ...]
    unit: float
    filled: str = "none"
    load: bool = False


def _hatched(y: float, width: float = 1.0) -> list[Line]:
    """Return a line at height y, with the hatching of the ground below it."""
    strokes = [[(x, y), (x - 0.35, y - 0.4)] for x in np.linspace(-width + 0.35, width, 5).tolist()]
    return [[(-width, y), (width, y)], *strokes]


def _circle(x: float, y: float, radius: float, first: float = 0.0, last: float = 2 * math.pi) -> Line:
    return [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in np.linspace(first, last, 25).tolist()]


def _arrow(length: float) -> tuple[Line, ...]:
    """Return an arrow to the right with its tip at the origin."""
    return [(-length, 0.0), (0.0, 0.0)], [(-0.55, 0.32), (0.0, 0.0), (-0.55, -0.32)]


def _box(x: float, y: float) -> Line:
    return [(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)]


@cache
def outlines() -> dict[str, Outline]:
    """Return the outline of each kind of symbol except springs and tendons, which extend from point to point."""
    triangle = [(0.0, 0.0), (0.75, -1.2), (-0.75, -1.2), (0.0, 0.0)]
    # the wall of a clamp is to the left of a body that continues to the right
    wall = tuple([(y, x) for x, y in line] for line in _hatched(0.0, 1.2))
    round_about = _circle(0, 0, 1.1, -0.75 * math.pi, 0.75 * math.pi)
    moment = (round_about, [(-1.25, 0.4), round_about[-1], (-0.35, 1.25)])
    spiral = [(0.25 * a / math.pi * math.cos(a), 0.25 * a / math.pi * math.sin(a))
              for a in np.linspace(0, 14, 60).tolist()]
    back = tuple([(x, -y) for x, y in line] for line in moment)
    wheels = _circle(-0.4, -1.45, 0.25), _circle(0.4, -1.45, 0.25)
    return {
        "clamp": Outline(wall, 11),
        "pin": Outline((triangle, *_hatched(-1.2)), 6, "back"),
        "roller": Outline((triangle, *wheels, *_hatched(-1.75)), 6.5, "back"),
        "held": Outline((_box(0.5, 0.5),), 4),
        "hinge": Outline((_circle(0, 0, 0.5),), 2.5, "back"),
        "slider": Outline((_box(1, 0.55), [(-1.6, -0.75), (1.6, -0.75)], [(-1.6, 0.75), (1.6, 0.75)]), 7.5),
        "coil": Outline((spiral,), 5),
        "mass": Outline((_circle(0, 0, 0.5),), 3.7, "ink"),
        "force": Outline(_arrow(2.4), 10.5, load=True), "small force": Outline(_arrow(1.8), 7.2, load=True),
        "moment": Outline(moment, 9.6, load=True), "moment back": Outline(back, 9.6, load=True),
        "gravity": Outline(_arrow(2.0), 10, load=True),
    }
