"""Deformed bodies with their true sections, at one time or several."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.body import (
    Outline,
    bounds,
    check_state,
    chosen_scale,
    distinct,
    draw_obstacles,
    draw_symbols,
    even_states,
    frame_plane,
    magnified,
    no_bodies,
    outline,
    when,
    with_obstacles,
)
from ancf2d.plot.curves import t_axis
from ancf2d.plot.picture import Kind, Source, common_title
from ancf2d.results import Results
from ancf2d.results.obstacles import Obstacle, obstacles_of
from ancf2d.results.symbols import Symbol, symbols_of

MAX_NODES = 80  # largest number of marked nodes per body; more would merge into a line
MAX_ENTRIES = 16  # bodies of a file named in the legend; the colours of more repeat, with one entry for all
HATCHES = (None, "////", "....", "xxxx")  # for the second seven bodies, the third, ...


@dataclass
class Part:
    """One body of one file (numbered from 0) in the picture; ``entry`` is its name in the legend."""

    name: str
    file: int
    reference: Outline
    deformed: Outline | None
    entry: str


@dataclass
class Shape:
    """The picture of all bodies of all files in one state."""

    title: str
    note: str
    units: str
    parts: list[Part]
    symbols: list[Symbol] = field(default_factory=list)
    box: np.ndarray | None = None
    obstacles: list[Obstacle] = field(default_factory=list)

    def _bounds(self) -> np.ndarray:
        """Return the lower left and upper right corner of ``box`` if it is given, else of the drawing."""
        if self.box is not None:
            return self.box
        return with_obstacles(bounds([o.boundary for p in self.parts for o in (p.reference, p.deformed) if o]),
                              self.obstacles)

    @property
    def size(self) -> tuple[float, float]:
        width, height = np.ptp(self._bounds(), axis=0)
        ratio = height / width if width > 0 else 10.0
        rows = style.legend_rows(6.4, [*dict.fromkeys(p.entry for p in self.parts if p.deformed), "nodes", "reference"])
        return (6.4, float(np.clip(5.6 * ratio, 1.6, 5.4)) + 1.4 + 0.2 * rows)

    def render(self, figure: Figure) -> None:
        axes = figure.subplots()
        handles: dict[str, Any] = {}
        last = self.parts[-1].file
        # files that nearly agree would hide each other, so the first ones have wider lines
        fill, step = (0.1, min(0.7, 1.5 / last)) if last else (0.35, 0.0)
        for i, part in enumerate(self.parts):
            self._reference(axes, part)
            if part.deformed is not None:
                look = i if part.entry == part.name or not last else part.file
                handles[part.entry] = self._deformed(axes, part, look, fill, 1.3 + step * (last - part.file))
        draw_obstacles(axes, self.obstacles)
        draw_symbols(axes, self.symbols)
        if any(_marked(p).size for p in self.parts):
            handles["nodes"] = Line2D([], [], color="0.25", marker="o", markersize=4, linestyle="")
        handles["reference"] = Patch(facecolor="none", edgecolor=style.REFERENCE, linestyle="--")
        frame_plane(axes, self._bounds(), self.units)
        style.title(figure, self.title, self.note)
        style.legend(figure, list(handles.values()), list(handles))

    @staticmethod
    def _reference(axes: Axes, part: Part) -> None:
        axes.add_artist(Polygon(part.reference.boundary, facecolor="none", linestyle="--",
                                edgecolor=style.REFERENCE, linewidth=0.9, zorder=1.5,
                                joinstyle="round"))

    @staticmethod
    def _deformed(axes: Axes, part: Part, i: int, fill: float, width: float) -> Polygon:
        color = style.PALETTE[i % len(style.PALETTE)]
        round_again = i // len(style.PALETTE) if part.entry == part.name else 0
        shape = part.deformed
        assert shape is not None
        # the edge keeps a section visible that is thinner than a line at this scale
        patch = Polygon(shape.boundary, facecolor=(color, fill), edgecolor=color, linewidth=width,
                        linestyle=style.DASHES[(part.file + round_again) % len(style.DASHES)], joinstyle="round",
                        hatch=HATCHES[round_again % len(HATCHES)],
                        zorder=2.5, label=part.name)
        axes.add_artist(patch)
        for line in shape.lines:
            axes.plot(*line.T, color=color, linewidth=0.6, zorder=2.6)
        nodes = _marked(part)
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


def _marked(part: Part) -> np.ndarray:
    """Return the nodes to mark, none if they would hide the body."""
    shape = part.deformed
    few = shape is not None and len(shape.nodes) <= MAX_NODES and part.entry == part.name
    return shape.nodes if shape is not None and few else np.empty((0, 2))


def shape(sources: Sequence[Source], *, scale: float | str = "auto", state: int = -1, symbols: bool = True) -> Shape:
    """Build the deformed bodies over their reference.

    ``scale`` magnifies displacements (auto: only if they would be invisible), ``state`` counts the stored states,
    negative from the end. ``symbols`` of supports, loads, joints, springs and masses are those of the first file; False
    leaves them out.
    """
    with_states = [s for s in sources if s.results.nt]
    for source in with_states:
        check_state(source.results, state)
    factor = chosen_scale(with_states, state, scale)
    parts = []
    for file, source in enumerate(sources):
        results = source.results
        for name, body in results.bodies.items():
            deformed = outline(results, body, state, factor) if results.nt else None
            parts.append(_part(source, file, name, outline(results, body, None, 1.0), deformed))
    first = sources[0].results
    marks = symbols_of(first, state if first.nt else None, factor) if symbols else []
    solids = obstacles_of(first, state if first.nt else None, factor)
    return Shape(common_title(sources), _note(with_states, state, factor), first.units.length, parts, marks,
                 obstacles=solids)


def _part(source: Source, file: int, name: str, reference: Outline, deformed: Outline | None) -> Part:
    count = len(source.results.bodies)
    label = source.name(name if count > 1 or not source.label else "")
    return Part(label, file, reference, deformed, label if count <= MAX_ENTRIES else source.name(f"{count} bodies"))


def _note(sources: Sequence[Source], state: int, factor: float) -> str:
    if not sources:
        return "reference (the file holds no states)"
    return when(sources[0].results, state) + magnified(factor)


def moving(sources: Sequence[Source], count: int, *, scale: float | str = "auto", symbols: bool = True,
           ) -> Iterator[Shape]:
    """Yield the bodies in at most ``count`` states of the first file, other files at the nearest times."""
    for source in sources:
        if not source.results.nt:
            raise ResultsError(f"{source.results.called} holds no states")
    first = sources[0].results
    states = even_states(first.t, count)
    factor = chosen_scale(sources, -1, scale)
    boxes = [bounds([outline(s.results, b, i, factor).boundary for b in s.results.bodies.values()
                     for i in (None, *even_states(s.results.t, count))]) for s in sources]
    solids = [obstacles_of(first, i, factor) for i in states]
    box = with_obstacles(bounds(boxes), [o for found in solids for o in found])
    for i, found in zip(states, solids, strict=True):
        parts = []
        for file, source in enumerate(sources):
            results = source.results
            k = i if results is first else int(np.abs(results.t - first.t[i]).argmin())
            for name, body in results.bodies.items():
                parts.append(_part(source, file, name, outline(results, body, None, 1.0),
                                   outline(results, body, k, factor)))
        marks = symbols_of(first, i, factor) if symbols else []
        yield Shape(common_title(sources), when(first, i) + magnified(factor), first.units.length, parts, marks, box,
                    found)


SHAPE = Kind("shape", "deformed bodies with their sections, over the reference", no_bodies, shape, moving)


MAX_TICKS = 10  # largest number of times labelled below the colour bar
COUNT = 8  # default number of moments
DARK, LIGHT = 0.0, 0.86  # part of the colour map that is used: paler colours would be lost on white


@dataclass
class Moment:
    """All bodies of one file at one time or load factor; ``symbols`` of items that move along them."""

    label: str
    t: float
    file: int
    bodies: dict[str, Outline]
    obstacles: list[Obstacle]
    symbols: list[Symbol]


@dataclass
class Snapshots:
    """The picture of the moments of all files, from light (early) to dark (late)."""

    title: str
    note: str
    units: str
    moments: list[Moment]
    files: list[str]
    axis: tuple[str, str]

    def _bounds(self) -> np.ndarray:
        return with_obstacles(bounds([b.boundary for m in self.moments for b in m.bodies.values()]),
                              [o for m in self.moments for o in m.obstacles])

    @property
    def size(self) -> tuple[float, float]:
        width, height = np.ptp(self._bounds(), axis=0)
        rows = style.legend_rows(6.4, self.files) if len(self.files) > 1 else 0
        return 6.4, float(np.clip(5.6 * height / width if width else 5.4, 1.6, 5.4)) + 2.0 + 0.2 * rows

    def render(self, figure: Figure) -> None:
        axes = figure.subplots()
        labels = list(dict.fromkeys(m.label for m in self.moments))
        shades = matplotlib.colormaps["cividis"](np.linspace(LIGHT, DARK, max(len(labels), 2)))
        handles: dict[str, Any] = {}
        draw_obstacles(axes, distinct(o for m in self.moments for o in m.obstacles))
        for moment in self.moments:
            color = tuple(shades[labels.index(moment.label)])
            dash = style.DASHES[moment.file % len(style.DASHES)]
            for body in moment.bodies.values():
                axes.add_artist(Polygon(body.boundary, facecolor=(*color[:3], 0.35), edgecolor=color, linewidth=1.4,
                                        linestyle=dash, joinstyle="round", zorder=2 + labels.index(moment.label) / 100))
        draw_symbols(axes, [s for m in self.moments for s in m.symbols])
        for k, name in enumerate(self.files if len(self.files) > 1 else ()):
            handles[name] = Line2D([], [], color="0.3", linestyle=style.DASHES[k % len(style.DASHES)])
        frame_plane(axes, self._bounds(), self.units)
        style.title(figure, self.title, self.note)
        self._bar(figure, axes, shades, labels)
        if handles:
            style.legend(figure, list(handles.values()), list(handles))

    def _bar(self, figure: Figure, axes: Axes, shades: np.ndarray, labels: list[str]) -> None:
        """Add a colour bar below the axes, with the colour and the time of each moment."""
        colors = ScalarMappable(BoundaryNorm(np.arange(len(labels) + 1) - 0.5, len(labels)),
                                ListedColormap(shades[:len(labels)]))
        bar = figure.colorbar(colors, ax=axes, location="bottom", aspect=40, fraction=0.06, pad=0.04)
        shown = range(0, len(labels), -(-len(labels) // MAX_TICKS))
        name, units = self.axis
        times = {m.label: m.t for m in self.moments}
        units, factor = style.time_unit(units, max(map(abs, times.values())))
        bar.set_ticks(list(shown), labels=[f"{factor * times[labels[k]]:.4g}" for k in shown])
        bar.ax.minorticks_off()
        style.verbatim(bar.ax.set_xlabel(style.label(name, units)))

    def header(self) -> list[str]:
        unit, over = f" [{self.units}]", f"{self.axis[0]} [{self.axis[1]}]"
        return ["file", over, "body", *(f"{axis}_{face}{unit}" for face in ("axis", "top", "bottom") for axis in "xy")]

    def rows(self) -> Iterator[Sequence[Any]]:
        for moment in self.moments:
            for name, body in moment.bodies.items():
                for row in np.hstack([body.axis, body.top, body.bottom]).tolist():
                    yield self.files[moment.file], moment.t, name, *row


def _times(text: str) -> list[float]:
    try:
        return [float(part) for part in text.replace(",", " ").split()]
    except ValueError:
        raise ResultsError(f"times must be numbers separated by commas, not '{text}'") from None


def _states(results: Results, at: str | None, count: int) -> list[int]:
    """Return the states nearest to the times ``at``, or ``count`` evenly spaced ones. Raises ResultsError."""
    t = results.t
    wanted = np.linspace(t[0], t[-1], count) if at is None else np.array(_times(at))
    span = float(np.ptp(t)) or 1.0
    for value in wanted:
        if not t.min() - 1e-6 * span <= value <= t.max() + 1e-6 * span:
            raise ResultsError(f"{results.called} holds states from {t.min():.6g} to {t.max():.6g}, "
                               f"none at {value:.6g}")
    if at is None and np.any(np.diff(t) <= 0):  # a path that turns back: evenly spaced by number instead
        return list(dict.fromkeys(np.linspace(0, len(t) - 1, count).round().astype(int).tolist()))
    return list(dict.fromkeys(int(np.argmin(np.abs(t - value))) for value in wanted))


def snapshots(sources: Sequence[Source], *, at: str | None = None, count: int = COUNT,
              scale: float | str = "auto") -> Snapshots:
    """Build the bodies at several moments.

    ``at``: times or load factors with commas between them (the nearest stored states are drawn); without it, ``count``
    evenly spaced states. Raises ResultsError.
    """
    if int(count) < 1:
        raise ResultsError(f"at least one instant must be drawn, not {count}")
    factor, moments = chosen_scale(sources, -1, scale), []
    for file, source in enumerate(sources):
        results = source.results
        for i in _states(results, at, int(count)):
            bodies = {name: outline(results, body, i, factor) for name, body in results.bodies.items()}
            moments.append(Moment(when(results, i), float(results.t[i]), file, bodies,
                                  obstacles_of(results, i, factor),
                                  [s for s in symbols_of(results, i, factor) if any(s.tracks)]))
    files = [s.label or s.results.path.name for s in sources]
    first = sources[0].results
    return Snapshots(common_title(sources), magnified(factor).lstrip(", "), first.units.length, moments, files,
                     t_axis(first))


def _few(results: Results) -> str:
    return no_bodies(results) or ("" if results.nt > 1 else "it holds fewer than two states")


SNAPSHOTS = Kind("snapshots", "bodies at several times, or load factors, in one picture", _few, snapshots)
