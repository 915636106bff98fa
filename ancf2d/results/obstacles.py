"""Obstacles for drawing: outlines of circles, half planes and polylines at their places in a state."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf2d.results.reader import Results
from ancf2d.results.symbols import completed_case, row_of

CORNERS = 120  # number of corners of the polygon drawn for a circle
FAR = 20.0  # extent of a half plane in a picture, relative to the extent of the bodies
SHADE = 0.02  # width of the shading on the solid side of an open polyline, relative to the extent of the bodies


@dataclass(frozen=True)
class Obstacle:
    """An obstacle in one state: ``solid`` (n, 2) is the polygon to be filled, ``lines`` are the lines of its surface.

    A half plane is ``endless``: its drawing must not widen a picture.
    """

    name: str
    solid: np.ndarray
    lines: tuple[np.ndarray, ...]
    endless: bool = False

    def moved(self, turn: float, about: np.ndarray, by: np.ndarray) -> Obstacle:
        """Return the obstacle after a rotation about a point and then a displacement."""
        c, s = math.cos(turn), math.sin(turn)
        R = np.array([[c, -s], [s, c]])

        def place(points: np.ndarray) -> np.ndarray:
            return (points - about) @ R.T + about + by

        return Obstacle(self.name, place(self.solid), tuple(map(place, self.lines)), self.endless)


def _pair(value: Any) -> np.ndarray:
    found = np.array(value, dtype=float)
    if found.shape != (2,) or not np.isfinite(found).all():
        raise ValueError
    return found


def _circle(name: str, entry: dict[str, Any]) -> Obstacle:
    center, radius = _pair(entry["center"]), float(entry["radius"])
    a = np.linspace(0.0, 2.0 * math.pi, CORNERS + 1)
    rim = center + radius * np.stack([np.cos(a), np.sin(a)], axis=1)
    # a spoke shows the rotation
    spoke = center + radius * np.array([[0.7, 0.0], [1.0, 0.0]])
    return Obstacle(name, rim, (rim, spoke))


def _half_plane(name: str, entry: dict[str, Any], extent: float) -> Obstacle:
    through, normal = _pair(entry["through"]), _pair(entry["normal"])
    normal /= np.linalg.norm(normal)
    along = FAR * extent * np.array([-normal[1], normal[0]])
    line = np.array([through - along, through + along])
    return Obstacle(name, np.vstack([line, (line - FAR * extent * normal)[::-1]]), (line,), endless=True)


def _polyline(name: str, entry: dict[str, Any], extent: float) -> Obstacle:
    points = np.array([_pair(p) for p in entry["points"]])
    if entry.get("closed") == "true":
        rim = np.vstack([points, points[:1]])
        return Obstacle(name, rim, (rim,))
    along = np.diff(points, axis=0)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    mean = np.vstack([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    size = np.linalg.norm(mean, axis=1, keepdims=True)
    back = points + SHADE * extent * mean / np.where(size > 0.0, size, 1.0)
    return Obstacle(name, np.vstack([points, back[::-1]]), (points,))


def _shapes(results: Results) -> Iterator[tuple[Obstacle, dict[str, Any]]]:
    """Yield the obstacles of a case in the reference configuration, each with its entry in the case."""
    found = completed_case(results).get("obstacles")
    ends = [results.reference(name, np.linspace(0.0, 1.0, 9)) for name in results.bodies]
    extent = float(np.hypot(*np.ptp(np.concatenate(ends), axis=0))) if ends else 1.0
    for name, entry in found.items() if isinstance(found, dict) else ():
        try:
            if entry["type"] == "circle":
                yield _circle(name, entry), entry
            elif entry["type"] == "half_plane":
                yield _half_plane(name, entry, extent or 1.0), entry
            elif entry["type"] == "polyline":
                yield _polyline(name, entry, extent or 1.0), entry
        except (KeyError, TypeError, ValueError):
            continue


def _with_body(results: Results, body: str, state: int, scale: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the rotation of a rigid body, the point about which it turns, and the displacement of that point."""
    s = np.array([0.0, 1.0, 0.5])
    start = results.reference(body, s)
    move = scale * results.displacement(body, s, state)
    # for a body whose ends coincide, the middle gives the direction
    other = 1 if np.linalg.norm(start[1] - start[0]) > 1e-6 * np.linalg.norm(start[2] - start[0]) else 2
    before, after = start[other] - start[0], start[other] + move[other] - start[0] - move[0]
    turn = math.atan2(before[0] * after[1] - before[1] * after[0], float(before @ after))
    return turn, start[0], move[0]


def _centre(entry: dict[str, Any]) -> np.ndarray:
    """Return the point about which the prescribed motion of an obstacle rotates it."""
    motion = entry["motion"]
    if isinstance(motion, dict) and motion.get("about"):
        return _pair(motion["about"])
    place = entry.get("center") or entry.get("through")
    return _pair(place) if place else np.mean([_pair(p) for p in entry["points"]], axis=0)


def _pose(results: Results, name: str, state: int) -> np.ndarray | None:
    """Return displacement and rotation (3,) of an obstacle by its own motion, or None if they were not stored."""
    probes = results.probes
    found: Mapping[str, np.ndarray] = probes.get(f"obstacle {name}", probes.get(name, {}))
    if not {"ux", "uy", "theta"} <= set(found) or not len(results.probe_t):
        return None
    row = row_of(results, state)
    return np.array([found[q][row] for q in ("ux", "uy", "theta")])


def obstacles_of(results: Results, state: int | None, scale: float) -> list[Obstacle]:
    """Return the obstacles of a file's case in a state (None: reference), displacements magnified by ``scale``."""
    out = []
    for obstacle, entry in _shapes(results):
        on = entry.get("on")
        if state is not None and on in results.bodies:
            out.append(obstacle.moved(*_with_body(results, on, state, scale)))
        elif state is not None and entry.get("motion") and (pose := _pose(results, obstacle.name, state)) is not None:
            about = _centre(entry)
            out.append(obstacle.moved(scale * pose[2], about, scale * pose[:2]))
        else:
            out.append(obstacle)
    return out
