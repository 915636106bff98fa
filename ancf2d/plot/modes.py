"""Modes of vibration or buckling: a grid of shapes with their cross-sections, each with its kind and number."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.body import draw_obstacles, with_obstacles
from ancf2d.plot.picture import Kind, Source
from ancf2d.results import BodyRecord, Results
from ancf2d.results.geometry import body_faces
from ancf2d.results.obstacles import Obstacle, obstacles_of

SHAPES = "modes/shapes"
SHOWN = 12  # number of modes that are drawn by default
LARGEST = 0.12  # relative to the model's extent: displacement to which a mode is magnified ...
TURN = 0.6  # ... unless its sections would turn or stretch by more than this
NO_BREAK = "\u00a0"
PROBE = 1e-6  # size of the motion from which the rates of the sections are computed
MAX_SECTIONS = 60  # cross-sections drawn per body
MAX_POINTS = 2000  # elements drawn per body
# one colour per kind, the same in every figure
COLORS = {"bending": 0, "axial": 1, "shear": 2, "thickness": 3, "mixed": 4, "rigid": 5, "spurious": 6}


@dataclass
class BodyShape:
    """One body: axis, top and bottom points (n, 2) in the reference and in the mode; drawn sections (k, 3, 2).

    ``pieces``: outlines to fill, one for each element, as the end faces of neighbours may separate; one for the whole
    body if only some of its elements are drawn.
    """

    name: str
    reference: dict[str, np.ndarray]
    moved: dict[str, np.ndarray]
    sections: np.ndarray
    pieces: list[np.ndarray]


@dataclass
class Mode:
    """One mode: its number in the file, its label, kind and bodies."""

    number: int
    label: str
    kind: str
    bodies: list[BodyShape]


def _boundary(faces: dict[str, np.ndarray]) -> np.ndarray:
    return np.vstack([faces["bottom"], faces["axis"][-1:], faces["top"][::-1], faces["axis"][:1]])


@dataclass
class Modes:
    """The picture of the modes of one file."""

    title: str
    units: str
    modes: list[Mode]
    box: np.ndarray | None = None
    obstacles: list[Obstacle] = field(default_factory=list)

    def extent(self) -> np.ndarray:
        """Return the lower left and upper right corner of all modes, or ``box`` if it is given."""
        if self.box is not None:
            return self.box
        points = np.vstack([p for m in self.modes for b in m.bodies
                            for p in (_boundary(b.moved), _boundary(b.reference))])
        return with_obstacles(np.array([points.min(axis=0), points.max(axis=0)]), self.obstacles)

    @property
    def _grid(self) -> tuple[int, int]:
        width, height = np.ptp(self.extent(), axis=0)
        columns = min(len(self.modes), 2 if height < 0.25 * width else 3 if height < width else 4)
        return -(-len(self.modes) // columns), columns

    @property
    def size(self) -> tuple[float, float]:
        rows, columns = self._grid
        width, height = np.ptp(self.extent(), axis=0)
        each = 9.0 / max(columns, 2)
        lines = max((self._title(mode).count("\n") for mode in self.modes), default=0)
        tall = float(np.clip(each * height / width if width else 3.0, 0.5, 3.0))
        return each * columns, 0.6 + rows * (0.45 + 0.17 * lines + tall)

    def _title(self, mode: Mode) -> str:
        """Return the label of a mode, broken into lines that fit into its column."""
        parts = mode.label.replace(" ", NO_BREAK).replace(f",{NO_BREAK}", ", ").replace(f"{NO_BREAK}(", " (")
        width = int(13 * 9.0 / max(self._grid[1], 2))
        return textwrap.fill(parts, width, break_long_words=False).replace(NO_BREAK, " ")

    def render(self, figure: Figure) -> None:
        grid = figure.subplots(*self._grid, squeeze=False)
        low, high = self.extent()
        pad = 0.03 * float((high - low).max())
        for axes, mode in zip(grid.ravel(), self.modes, strict=False):
            draw_obstacles(axes, self.obstacles)
            self._draw(axes, mode)
            axes.set_xlim(low[0] - pad, high[0] + pad)
            axes.set_ylim(low[1] - pad, high[1] + pad)
        for axes in grid.ravel()[len(self.modes):]:
            axes.set_axis_off()
        style.heading(figure, self.title)

    def _draw(self, axes: Axes, mode: Mode) -> None:
        color = style.PALETTE[COLORS.get(mode.kind, 0)]
        for body in mode.bodies:
            axes.add_artist(Polygon(_boundary(body.reference), facecolor="none", edgecolor=style.REFERENCE,
                                    linestyle="--", linewidth=0.7))
            axes.add_collection(PolyCollection(body.pieces, facecolors=[(color, 0.25)], edgecolors="none"))
            # each piece: bottom, axis at the end, top, axis at the start
            half = [len(p) // 2 - 1 for p in body.pieces]
            faces = [part for p, k in zip(body.pieces, half, strict=True) for part in (p[:k], p[k + 1:-1])]
            axes.add_collection(LineCollection(faces, colors=color, linewidths=1.1))
            axes.add_collection(LineCollection(list(body.sections), colors=color, linewidths=0.7))
            axes.plot(*body.moved["axis"].T, color=color, linewidth=0.7, linestyle=(0, (4, 2)))
        axes.set_aspect("equal", adjustable="box")
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set_visible(False)
        style.verbatim(axes.set_title(self._title(mode), fontsize="small"))

    def header(self) -> list[str]:
        unit = f" [{self.units}]"
        columns = (f"{axis}_{face}{unit}" for face in ("axis", "top", "bottom") for axis in "xy")
        return ["mode", "label", "body", *columns]

    def rows(self) -> Iterator[Sequence[Any]]:
        for mode in self.modes:
            for body in mode.bodies:
                table = np.hstack([body.moved[face] for face in ("axis", "top", "bottom")])
                for row in table.tolist():
                    yield mode.number, mode.label, body.name, *row


def _chosen(body: BodyRecord) -> np.ndarray:
    ne = len(body.dofs)
    return np.unique(np.linspace(0, ne - 1, min(ne, MAX_POINTS)).astype(int))


def _flat(faces: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {k: v.reshape(-1, 2) for k, v in faces.items()}


def _sections(body: BodyRecord, faces: dict[str, np.ndarray]) -> np.ndarray:
    """Return bottom, axis and top (k, 3, 2) of sections at the ends of elements, and in the middle of few."""
    ne, ns = faces["top"].shape[:2]
    columns = [0, ns // 2] if 2 * ne <= MAX_SECTIONS else [0]
    step = max(1, ne // MAX_SECTIONS)
    points = np.stack([faces["bottom"], faces["axis"], faces["top"]], axis=2)
    picked = points[::step, columns].reshape(-1, 3, 2)
    ends = points[::step, -1] if step == 1 else points[-1:, -1]
    return np.concatenate([picked, ends])


def magnification(results: Results, base: np.ndarray, shape: np.ndarray, extent: float) -> float:
    """Return the factor that scales a mode's largest displacement to LARGEST of the extent, or less for rotations."""
    size = PROBE * extent / (float(np.abs(shape).max()) or 1.0)
    moved = turned = 0.0
    for body in results.bodies.values():
        some = _chosen(body)
        start, end = (body_faces(body, base + s * shape, some) for s in (0.0, size))
        change = {k: (end[k] - start[k]) / size for k in end}
        moved = max(moved, *(float(np.linalg.norm(c, axis=-1).max()) for c in change.values()))
        spread = np.linalg.norm(change["top"] - change["bottom"], axis=-1).max()
        turned = max(turned, float(spread) / body.height if body.height > 0 else 0.0)
    limits = [LARGEST * extent / moved if moved else math.inf, TURN / turned if turned else math.inf]
    return min(limits) if math.isfinite(min(limits)) else 0.0


def _mode(results: Results, number: int, base: np.ndarray, shape: np.ndarray, factor: float, label: str, kind: str
          ) -> Mode:
    bodies = []
    for name, body in results.bodies.items():
        some = _chosen(body)
        faces = body_faces(body, base + factor * shape, some)
        whole = len(some) < len(body.dofs)
        pieces = ([_boundary(_flat(faces))] if whole else
                  [_boundary({k: v[ie] for k, v in faces.items()}) for ie in range(len(some))])
        bodies.append(BodyShape(name, _flat(body_faces(body, base, some)), _flat(faces), _sections(body, faces),
                                pieces))
    return Mode(number, label, kind, bodies)


def _label(results: Results, k: int) -> tuple[str, str]:
    """Return the label of mode k, and its kind."""
    table: Mapping[str, Any] = results.tables.get("modes", {})
    if "load_factor" in table:
        factor = f"load factor {table['load_factor'][k]:.6g}"
        return ", ".join([factor, *_onset(table, k, results.units.time)]), "bending"
    if "kind" not in table:
        return f"mode {k + 1}", ""
    kind, growth = table["kind"][k], float(table["growth"][k]) if "growth" in table else 0.0
    time = results.units.time
    omega = float(table["omega"][k])
    hertz = f"{omega / (2 * math.pi):.5g} {'Hz' if time == 's' else f'1/{time}'}"
    frequency = [f"{hertz} ({omega:.6g} rad/{time})"] if omega or not growth else []
    return f"{kind} {int(table['number'][k])}: {', '.join([*frequency, *growing(table, k, time)])}", kind


def _onset(table: Mapping[str, Any], k: int, time: str) -> list[str]:
    """Return in words how the motion at load factor k becomes unstable; empty for conservative loads."""
    if "instability" not in table:
        return []
    omega = float(table["omega"][k])
    return [str(table["instability"][k]) + (f" at {omega:.6g} rad/{time}" if omega else "")]


def growing(table: Mapping[str, Any], k: int, time: str) -> list[str]:
    """Return in words how mode k grows or decays; empty if it does neither."""
    growth = float(table["growth"][k]) if "growth" in table else 0.0
    if not growth:
        return []
    ratio = f", ratio {table['damping'][k]:.4g}" if growth < 0.0 and table["omega"][k] and "damping" in table else ""
    return [f"{'grows' if growth > 0.0 else 'decays'} with {abs(growth):.5g} 1/{time}{ratio}"]


def moving(sources: Sequence[Source], frames: int, *, first: int = 1, count: int = SHOWN) -> Iterator[Modes]:
    """Yield the pictures of one cycle of the modes, all in phase."""
    both = np.concatenate([_scaled_modes(sources, first, count, s).extent() for s in (-1.0, 1.0)])
    box = np.array([both.min(axis=0), both.max(axis=0)])
    for k in range(frames):
        picture = _scaled_modes(sources, first, count, math.cos(2 * math.pi * k / frames))
        picture.box = box
        yield picture


def modes(sources: Sequence[Source], *, first: int = 1, count: int = SHOWN) -> Modes:
    """Build the grid of modes ``first``, ``first + 1``, ... of a file, at most ``count`` of them."""
    return _scaled_modes(sources, first, count, 1.0)


def _scaled_modes(sources: Sequence[Source], first: int, count: int, swing: float) -> Modes:
    """Return the grid of modes with displacements times ``swing`` (-1 to 1). Raises ResultsError for other modes."""
    results = sources[0].results
    shapes = results.array(SHAPES)
    if not 1 <= int(first) <= len(shapes) or int(count) < 1:
        raise ResultsError(f"{results.called} holds modes 1 to {len(shapes)}")
    base = results.e(-1) if results.solver == "eigen" and results.nt else results.e0
    points = np.vstack([_boundary(_flat(body_faces(b, base, _chosen(b)))) for b in results.bodies.values()])
    extent = float(np.hypot(*np.ptp(points, axis=0)))
    found = []
    for k in range(int(first) - 1, min(len(shapes), int(first) - 1 + int(count))):
        factor = magnification(results, base, shapes[k], extent)
        found.append(_mode(results, k + 1, base, shapes[k], swing * factor, *_label(results, k)))
    state = -1 if results.solver == "eigen" and results.nt else None
    return Modes(results.title, results.units.length, found, obstacles=obstacles_of(results, state, 1.0))


def _missing(results: Results) -> str:
    shapes = results.arrays.get(SHAPES)
    # buckling may find none
    some = shapes is not None and shapes.size > 0
    return "" if some and results.bodies else "it holds no modes (solver eigen or buckling)"


MODES = Kind("modes", "mode shapes with their cross-sections, named by kind", _missing, modes, moving, single=True)
