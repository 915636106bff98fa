"""Obstacles behind the bodies of a figure: solids in grey, with their surface as a line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from ancf2d.plot.body import bounds
from ancf2d.results.obstacles import Obstacle

SOLID, SURFACE = "0.9", "0.4"
NEAR = 0.75  # extents of the bodies: what of an obstacle is farther away is not in the picture


def with_obstacles(box: np.ndarray, obstacles: Sequence[Obstacle]) -> np.ndarray:
    """Return the corners (2, 2) of a picture of bodies in ``box``, widened by what of the obstacles is near them."""
    room = NEAR * (float(np.ptp(box, axis=0).max()) or 1.0)
    low, high = box[0] - room, box[1] + room
    parts = [box]
    for obstacle in obstacles:
        points = np.concatenate(obstacle.lines)
        if obstacle.endless:
            # of a straight surface, what is opposite to the bodies
            start, way = points[0], points[1] - points[0]
            s = ((box - start) @ way / (way @ way))[:, None]
            points = start + s * way
        near = points[((points >= low) & (points <= high)).all(axis=1)]
        if len(near):
            parts.append(near)
    return bounds(parts)


def different(obstacles: Iterable[Obstacle]) -> list[Obstacle]:
    """Return obstacles without those that are in the same place as one before."""
    out: list[Obstacle] = []
    for obstacle in obstacles:
        if not any(o.name == obstacle.name and np.array_equal(o.lines[0], obstacle.lines[0]) for o in out):
            out.append(obstacle)
    return out


def draw_obstacles(axes: Axes, obstacles: Sequence[Obstacle]) -> None:
    """Draw obstacles behind all bodies; they do not change what the axes show."""
    for obstacle in obstacles:
        axes.add_artist(Polygon(obstacle.solid, facecolor=SOLID, edgecolor="none", zorder=1.0))
        for line in obstacle.lines:
            axes.add_artist(Polygon(line, closed=False, facecolor="none", edgecolor=SURFACE, linewidth=1.0,
                                    joinstyle="round", zorder=1.1))
