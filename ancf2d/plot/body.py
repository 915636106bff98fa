"""Drawing of bodies, symbols and obstacles: outlines in any state, thinned if there are very many elements."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Polygon
from matplotlib.path import Path
from matplotlib.transforms import Affine2D, ScaledTranslation, Transform

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.picture import Source
from ancf2d.results import BodyRecord, Results, symbols
from ancf2d.results.obstacles import Obstacle
from ancf2d.results.symbols import Symbol, outlines

MAX_SAMPLED = 400  # largest number of elements of which all samples are drawn
MAX_POINTS = 4000  # along the axis of a body with more elements
INVISIBLE = 0.01  # relative to the model's extent: smaller deflections are magnified ...
WANTED = 0.1  # ... to at most this size
SOLID, SURFACE = "0.9", "0.4"
NEAR = 0.75  # relative to the extent of the bodies: parts of obstacles farther away are not in the picture


@dataclass
class Outline:
    """One body in one state: points along axis, top and bottom (n, 2), nodes (k, 2), lines between layers (i, n, 2)."""

    axis: np.ndarray
    top: np.ndarray
    bottom: np.ndarray
    nodes: np.ndarray
    lines: np.ndarray

    @property
    def boundary(self) -> np.ndarray:
        """The closed outline: along the bottom, back along the top."""
        return np.vstack([self.bottom, self.top[::-1]])


def outline(results: Results, body: BodyRecord, i: int | None, scale: float) -> Outline:
    """Return the outline of a body in state i (None: reference), thinned if it has very many elements."""
    ne = len(body.dofs)
    if ne <= MAX_SAMPLED:
        levels = results.levels(body.name, i, scale=scale)
        parts = levels.reshape(len(levels), -1, 2)
    else:
        some = np.unique(np.linspace(0, ne - 1, min(ne, MAX_POINTS)).astype(int))
        levels = results.levels(body.name, i, scale=scale, elements=some)
        parts = np.concatenate([levels[:, :, 0], levels[:, -1:, -1]], axis=1)
    nodes = results.nodes(body.name, i, scale=scale) if ne <= MAX_SAMPLED else np.empty((0, 2))
    return Outline(parts[1], parts[2], parts[0], nodes, parts[3:])


def bounds(outlines: Sequence[np.ndarray]) -> np.ndarray:
    """Return the lower left and upper right corner (2, 2) of point sets (n, 2), ignoring points that are not finite."""
    points = [p[np.isfinite(p).all(axis=1)] for p in outlines]
    points = [p for p in points if len(p)] or [np.zeros((1, 2))]
    stacked = np.array([[p.min(axis=0), p.max(axis=0)] for p in points])
    return np.array([stacked[:, 0].min(axis=0), stacked[:, 1].max(axis=0)])


def nice(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above ``value``."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (5, 2, 1) if m * power <= value * (1 + 1e-12))


def automatic_scale(sources: Sequence[Source], state: int) -> float:
    """Return the magnification that makes an invisible deflection visible, or 1 if it is visible."""
    extent, moved = 0.0, 0.0
    for source in sources:
        for body in source.results.bodies.values():
            start = outline(source.results, body, None, 1.0).axis
            end = outline(source.results, body, state, 1.0).axis
            extent = max(extent, float(np.hypot(*np.ptp(start, axis=0))))
            moved = max(moved, float(np.linalg.norm(end - start, axis=1).max(initial=0.0)))
    return visible_scale(extent, moved)


def visible_scale(extent: float, moved: float) -> float:
    """Return the magnification that makes a largest displacement ``moved`` visible relative to ``extent``, else 1."""
    # displacements at the level of round-off are not magnified
    if not 1e-13 * extent < moved < INVISIBLE * extent:
        return 1.0
    return nice(WANTED * extent / moved)


def chosen_scale(sources: Sequence[Source], state: int, scale: float | str) -> float:
    """Return the requested magnification, ``auto`` or a positive number. Raises ResultsError for other values."""
    if scale == "auto":
        return automatic_scale(sources, state)
    try:
        value = float(scale)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise ResultsError(f"the magnification must be a positive number or 'auto', not '{scale}'")
    return value


def check_state(results: Results, state: int) -> None:
    """Raise ResultsError if a file does not have a state."""
    if not -results.nt <= state < results.nt:
        raise ResultsError(f"{results.called} has no state {state}: it holds {results.nt}")


ABOUT = ("eigen", "frequency_response", "state_space")  # small motions about the only state, the reference at factor 0


def when(results: Results, state: int) -> str:
    """Return the time or load factor of a state in words."""
    t = results.t[state]
    if results.solver in ABOUT and t == 0.0:
        return "about the reference"
    return f"t = {t:.6g} {results.units.time}" if results.over_time else f"load factor {t:.6g}"


def magnified(factor: float) -> str:
    """Return the note on magnified displacements, empty if they are not magnified."""
    return "" if factor == 1.0 else f", displacements magnified {factor:.6g} times"


def even_states(t: np.ndarray, count: int) -> Sequence[int]:
    """Return at most ``count`` states, evenly spaced in t if it only increases, else in their number."""
    if len(t) <= count:
        return range(len(t))
    if np.any(np.diff(t) <= 0):
        return np.unique(np.linspace(0, len(t) - 1, count).round().astype(int)).tolist()
    nearest = np.abs(np.linspace(t[0], t[-1], count)[:, None] - t).argmin(axis=1)
    return np.unique(nearest).tolist()


def no_bodies(results: Results) -> str:
    """Return the data that a file without bodies lacks, else an empty text."""
    return "" if results.bodies else "it holds no bodies"


def no_states(results: Results) -> str:
    """Return the data that a file without bodies or states lacks, else an empty text."""
    return no_bodies(results) or ("" if results.nt else "it holds no states")


def how_to_store(results: Results, *fields: str) -> str:
    """Return the key of the case that stores fields over the height, or why they cannot be stored."""
    refused = next((why for why in map(results.refused, fields) if why), "")
    if refused:
        return f"{refused}; output: fields: [N, Q, M] stores what section_forces draws, history draws probes"
    return f"output: fields: [{', '.join(fields)}] in the case stores {'it' if len(fields) == 1 else 'them'}"


def frame_plane(axes: Axes, corners: np.ndarray, units: str) -> None:
    """Set axes to the plane between two corners (2, 2), with equal scales, a margin, and labels with units."""
    pad = 0.04 * float(np.ptp(corners, axis=0).max()) or 1.0
    axes.update_datalim([corners[0] - pad, corners[1] + pad])
    axes.margins(0)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    style.verbatim(axes.set_xlabel(style.label("x", units)))
    style.verbatim(axes.set_ylabel(style.label("y", units)))


INK, LOAD = "0.15", "#a01414"
GRAVITY = 20.0  # length of its arrow in points
TURNS = 7  # number of turns of the line of a spring


def _path(outline: symbols.Outline) -> Path:
    """Return the open lines of a symbol as one path."""
    codes = [code for line in outline.lines for code in (Path.MOVETO, *[Path.LINETO] * (len(line) - 1))]
    return Path([p for line in outline.lines for p in line], codes)


def _zigzag(points: np.ndarray) -> np.ndarray:
    """Return the line of a spring between two points."""
    a, b = points
    along = b - a
    across = 0.06 * np.array([-along[1], along[0]])
    s = np.concatenate([[0.0], np.linspace(0.2, 0.8, 2 * TURNS + 1), [1.0]])
    side = np.concatenate([[0.0, 0.0], [(-1.0) ** k for k in range(2 * TURNS - 1)], [0.0, 0.0]])
    return a + s[:, None] * along + side[:, None] * across


def _mark(axes: Axes, symbol: Symbol, points: np.ndarray, transform: Transform) -> None:
    outline = outlines()[symbol.kind]
    path, ink = _path(outline), LOAD if outline.load else INK
    # the size of a marker is that of the square around its point that contains the outline
    size = 2.0 * outline.unit * float(np.abs(path.vertices).max())
    axes.plot(*points.T, linestyle="", marker=MarkerStyle(path, transform=Affine2D().rotate(symbol.angle)),
              markersize=size, markerfacecolor={"back": "white", "ink": ink}.get(outline.filled, "none"),
              markeredgecolor=ink, markeredgewidth=1.1, zorder=3.5, clip_on=False, transform=transform)


def _gravity(axes: Axes, symbol: Symbol, place: int) -> None:
    """Draw the arrow of gravity and its letter beside the axes, outside of the bodies; several are below each other."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    way = 0.5 * GRAVITY * np.array([math.cos(symbol.angle), math.sin(symbol.angle)])
    middle = np.array([0.5 * GRAVITY + 4.0, -0.5 * GRAVITY - 1.8 * GRAVITY * place])
    tip = middle + way
    moved = ScaledTranslation(tip[0] / 72, tip[1] / 72, figure.dpi_scale_trans)
    _mark(axes, symbol, np.ones((1, 2)), axes.transAxes + moved)
    axes.annotate("g", (1.0, 1.0), (middle[0], middle[1] - 0.5 * GRAVITY - 3.0), xycoords="axes fraction",
                  textcoords="offset points", ha="center", va="top", color=LOAD, style="italic", annotation_clip=False)


def draw_symbols(axes: Axes, symbols: list[Symbol]) -> None:
    """Draw symbols over the bodies of axes, and gravity beside the axes."""
    down = [s for s in symbols if s.kind == "gravity"]
    for place, symbol in enumerate(down):
        _gravity(axes, symbol, place)
    for symbol in symbols:
        if symbol.kind == "spring":
            axes.plot(*_zigzag(symbol.points).T, color=INK, linewidth=1.0, zorder=3.4)
        elif symbol.kind == "tendon":
            axes.plot(*symbol.points.T, color=LOAD, linewidth=1.0, zorder=3.4)
        elif symbol.kind != "gravity":
            _mark(axes, symbol, symbol.points, axes.transData)


def with_obstacles(box: np.ndarray, obstacles: Sequence[Obstacle]) -> np.ndarray:
    """Return the corners (2, 2) of a picture of bodies in ``box``, extended by the nearby parts of the obstacles."""
    room = NEAR * (float(np.ptp(box, axis=0).max()) or 1.0)
    low, high = box[0] - room, box[1] + room
    parts = [box]
    for obstacle in obstacles:
        points = np.concatenate(obstacle.lines)
        if obstacle.endless:
            # the part of a straight surface opposite to the bodies
            start, way = points[0], points[1] - points[0]
            s = ((box - start) @ way / (way @ way))[:, None]
            points = start + s * way
        near = points[((points >= low) & (points <= high)).all(axis=1)]
        if len(near):
            parts.append(near)
    return bounds(parts)


def distinct(obstacles: Iterable[Obstacle]) -> list[Obstacle]:
    """Return obstacles without those at the same place as an earlier one."""
    out: list[Obstacle] = []
    for obstacle in obstacles:
        if not any(o.name == obstacle.name and np.array_equal(o.lines[0], obstacle.lines[0]) for o in out):
            out.append(obstacle)
    return out


def draw_obstacles(axes: Axes, obstacles: Sequence[Obstacle]) -> None:
    """Draw obstacles behind all bodies, without changing the limits of the axes."""
    for obstacle in obstacles:
        axes.add_artist(Polygon(obstacle.solid, facecolor=SOLID, edgecolor="none", zorder=1.0))
        for line in obstacle.lines:
            axes.add_artist(Polygon(line, closed=False, facecolor="none", edgecolor=SURFACE, linewidth=1.0,
                                    joinstyle="round", zorder=1.1))
