"""Bodies as they stand: the deformed shape with its true section over the reference."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.picture import Kind, Source, common_title
from ancf2d.results import BodyRecord, Results

MAX_SAMPLED = 400  # elements up to which all their samples are drawn
MAX_POINTS = 4000  # along the axis of a body with more elements
MAX_NODES = 80  # marked nodes per body; more would merge into a line
INVISIBLE = 0.01  # of the model's extent: smaller deflections are magnified ...
WANTED = 0.1  # ... to at most this share


@dataclass
class Outline:
    """One body in one state: points along axis, top and bottom (n, 2), and its nodes (k, 2)."""

    axis: np.ndarray
    top: np.ndarray
    bottom: np.ndarray
    nodes: np.ndarray

    @property
    def boundary(self) -> np.ndarray:
        """The closed outline: along the bottom, back along the top."""
        return np.vstack([self.bottom, self.top[::-1]])


def outline(results: Results, body: BodyRecord, i: int | None, scale: float) -> Outline:
    """Return the outline of a body in state i (None: reference), thinned where it has very many
    elements."""
    ne = len(body.dofs)
    if ne <= MAX_SAMPLED:
        faces = results.faces(body.name, i, scale=scale)
        parts = {k: v.reshape(-1, 2) for k, v in faces.items()}
    else:
        some = np.unique(np.linspace(0, ne - 1, min(ne, MAX_POINTS)).astype(int))
        faces = results.faces(body.name, i, scale=scale, elements=some)
        parts = {k: np.vstack([v[:, 0], v[-1:, -1]]) for k, v in faces.items()}
    nodes = results.nodes(body.name, i, scale=scale) if ne <= MAX_SAMPLED else np.empty((0, 2))
    return Outline(parts["axis"], parts["top"], parts["bottom"], nodes)


def nice(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above ``value``."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (5, 2, 1) if m * power <= value * (1 + 1e-12))


def automatic_scale(sources: Sequence[Source], state: int) -> float:
    """Return the magnification that makes an invisible deflection visible, 1 where it is."""
    extent, moved = 0.0, 0.0
    for source in sources:
        for body in source.results.bodies.values():
            start = outline(source.results, body, None, 1.0).axis
            end = outline(source.results, body, state, 1.0).axis
            extent = max(extent, float(np.hypot(*np.ptp(start, axis=0))))
            moved = max(moved, float(np.linalg.norm(end - start, axis=1).max(initial=0.0)))
    # a motion at the level of round-off stays unseen
    if not 1e-13 * extent < moved < INVISIBLE * extent:
        return 1.0
    return nice(WANTED * extent / moved)


@dataclass
class Part:
    """One body of one file (numbered from 0) in the picture."""

    name: str
    file: int
    reference: Outline
    deformed: Outline | None


@dataclass
class Shape:
    """The picture of all bodies of all files in one state."""

    title: str
    note: str
    units: str
    parts: list[Part]

    def _bounds(self) -> np.ndarray:
        points = [o.boundary for p in self.parts for o in (p.reference, p.deformed) if o]
        points = [p[np.isfinite(p).all(axis=1)] for p in points]
        points = [p for p in points if len(p)] or [np.zeros((1, 2))]
        stacked = np.array([[p.min(axis=0), p.max(axis=0)] for p in points])
        return np.array([stacked[:, 0].min(axis=0), stacked[:, 1].max(axis=0)])

    @property
    def size(self) -> tuple[float, float]:
        width, height = np.ptp(self._bounds(), axis=0)
        ratio = height / width if width > 0 else 10.0
        rows = style.legend_rows(6.4, [*(p.name for p in self.parts if p.deformed), "nodes", "reference"])
        return (6.4, float(np.clip(5.6 * ratio, 1.6, 5.4)) + 1.4 + 0.2 * rows)

    def render(self, figure: Figure) -> None:
        axes = figure.subplots()
        handles: dict[str, Any] = {}
        last = self.parts[-1].file
        # files that nearly agree would hide each other: the first ones have wider lines
        fill, step = (0.1, min(0.7, 1.5 / last)) if last else (0.35, 0.0)
        for i, part in enumerate(self.parts):
            self._reference(axes, part)
            if part.deformed is not None:
                handles[part.name] = self._deformed(axes, part, i, fill, 1.3 + step * (last - part.file))
        if any(p.deformed is not None and _marked(p.deformed).size for p in self.parts):
            handles["nodes"] = Line2D([], [], color="0.25", marker="o", markersize=4, linestyle="")
        handles["reference"] = Patch(facecolor="none", edgecolor=style.REFERENCE, linestyle="--")
        bounds = self._bounds()
        pad = 0.04 * float(np.ptp(bounds, axis=0).max()) or 1.0
        axes.update_datalim([bounds[0] - pad, bounds[1] + pad])
        axes.margins(0)
        axes.autoscale_view()
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(style.label("x", self.units))
        axes.set_ylabel(style.label("y", self.units))
        style.title(figure, self.title, self.note)
        style.legend(figure, list(handles.values()), list(handles))

    @staticmethod
    def _reference(axes: Axes, part: Part) -> None:
        axes.add_patch(Polygon(part.reference.boundary, facecolor="none", linestyle="--",
                               edgecolor=style.REFERENCE, linewidth=0.9, zorder=1.5,
                               joinstyle="round"))

    @staticmethod
    def _deformed(axes: Axes, part: Part, i: int, fill: float, width: float) -> Polygon:
        color = style.PALETTE[i % len(style.PALETTE)]
        shape = part.deformed
        assert shape is not None
        # the edge keeps a section visible that is thinner than a line at this scale
        patch = Polygon(shape.boundary, facecolor=(color, fill), edgecolor=color, linewidth=width,
                        linestyle=style.DASHES[part.file % len(style.DASHES)], joinstyle="round",
                        zorder=2.5, label=part.name)
        axes.add_patch(patch)
        nodes = _marked(shape)
        if nodes.size:
            axes.plot(*nodes.T, linestyle="", color=color, zorder=3, markersize=4,
                      marker=style.MARKERS[i % len(style.MARKERS)], markeredgecolor="white",
                      markeredgewidth=0.5)
        return patch

    def header(self) -> list[str]:
        unit = f" [{self.units}]"
        return ["body", "state", *(f"{axis}_{face}{unit}" for face in ("axis", "top", "bottom")
                                   for axis in "xy")]

    def rows(self) -> Iterator[Sequence[Any]]:
        for part in self.parts:
            for state, shape in (("reference", part.reference), ("deformed", part.deformed)):
                if shape is not None:
                    table = np.hstack([shape.axis, shape.top, shape.bottom])
                    for row in table.tolist():
                        yield part.name, state, *row


def _marked(shape: Outline) -> np.ndarray:
    return shape.nodes if len(shape.nodes) <= MAX_NODES else np.empty((0, 2))


def shape(sources: Sequence[Source], *, scale: float | str = "auto", state: int = -1) -> Shape:
    """Build the deformed bodies over their reference.

    ``scale`` magnifies displacements (auto: only where they would be invisible), ``state`` counts
    the stored states, negative from the end.
    """
    with_states = [s for s in sources if s.results.nt]
    for source in with_states:
        if not -source.results.nt <= state < source.results.nt:
            raise ResultsError(f"'{source.results.path}' has no state {state}: "
                               f"it holds {source.results.nt}")
    factor = automatic_scale(with_states, state) if scale == "auto" else _factor(scale)
    parts = []
    for file, source in enumerate(sources):
        results = source.results
        for name, body in results.bodies.items():
            label = source.name(name if len(results.bodies) > 1 or not source.label else "")
            deformed = outline(results, body, state, factor) if results.nt else None
            parts.append(Part(label, file, outline(results, body, None, 1.0), deformed))
    first = sources[0].results
    return Shape(common_title(sources), _note(with_states, state, factor), first.units.length, parts)


def _factor(scale: float | str) -> float:
    try:
        value = float(scale)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise ResultsError(f"the magnification must be a positive number or 'auto', not '{scale}'")
    return value


def _note(sources: Sequence[Source], state: int, factor: float) -> str:
    if not sources:
        return "reference; the file holds no states"
    results = sources[0].results
    t = results.t[state]
    when = (f"t = {t:.6g} {results.units.time}" if results.solver == "dynamic"
            else f"load factor {t:.6g}")
    return when + ("" if factor == 1.0 else f", displacements magnified {factor:.6g} times")


def _no_bodies(results: Results) -> str:
    return "" if results.bodies else "it holds no bodies"


SHAPE = Kind("shape", "deformed bodies with their sections over the reference", _no_bodies, shape)
