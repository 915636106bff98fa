"""Axial force, shear force and bending moment: drawn on the bodies, or over their arc length."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.body import bounds, check_state, draw_obstacles, draw_symbols, no_states, outline, when, with_obstacles
from ancf2d.plot.curves import quantities_of
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results
from ancf2d.results.obstacles import Obstacle, obstacles_of
from ancf2d.results.symbols import Symbol, symbols_of

FORCES = ("N", "Q", "M")
NAMES = {"N": "axial force N", "Q": "shear force Q", "M": "bending moment M"}
LARGEST = 0.2  # relative to the extent of the bodies: distance from the axis at which the largest value is drawn
STRAIGHT = 1e-9  # relative to the extent: an axis that deviates from its chord by less is straight
LINES = 40  # number of lines across the diagrams of all bodies, as in textbooks


@dataclass
class Diagram:
    """One quantity on one body: arc length and values (n,), the axis (n, 2) and its normals (n, 2).

    ``known`` (n,) is true for values of the file; the others are interpolated at the ends of elements, where the axis
    may have a corner. ``whole`` (k, 2) is the axis from end to end.
    """

    body: str
    s: np.ndarray
    values: np.ndarray
    axis: np.ndarray
    normals: np.ndarray
    known: np.ndarray
    whole: np.ndarray

    def line(self, scale: float) -> np.ndarray:
        """Return the line (n, 2) of the values, at their distances from the axis."""
        return self.axis + scale * self.values[:, None] * self.normals


@dataclass
class Diagrams:
    """The picture of N, Q and M on the bodies of one file, each in its own axes."""

    title: str
    note: str
    units: str
    found: dict[tuple[str, str], list[Diagram]]
    symbols: list[Symbol]
    obstacles: list[Obstacle]

    def _scale(self, name: str, diagrams: list[Diagram]) -> float:
        """Return the distance from the axis per unit of a value: towards y, but for M towards the side in tension."""
        extent = float(np.hypot(*np.ptp(bounds([d.whole for d in diagrams]), axis=0)))
        top = max(float(np.abs(d.values).max(initial=0.0)) for d in diagrams)
        return (-1.0 if name == "M" else 1.0) * LARGEST * extent / top if top else 0.0

    @property
    def _stacked(self) -> bool:
        width, height = np.ptp(self._bounds(), axis=0)
        return bool(height < 0.6 * width)

    def _bounds(self) -> np.ndarray:
        lines = [d.line(self._scale(name, ds)) for (name, _), ds in self.found.items() for d in ds]
        bodies = bounds([*lines, *(d.whole for ds in self.found.values() for d in ds)])
        return with_obstacles(bodies, self.obstacles)

    @property
    def size(self) -> tuple[float, float]:
        width, height = np.ptp(self._bounds(), axis=0)
        n, ratio = len(self.found), height / width if width else 3.0
        if self._stacked:
            return 6.4, n * (0.7 + float(np.clip(5.4 * ratio, 0.9, 3.0))) + 0.6
        each = 3.4 if n > 1 else 5.4
        return each * n + 0.6, float(np.clip(each * ratio, 2.0, 5.4)) + 1.3

    def render(self, figure: Figure) -> None:
        n = len(self.found)
        grid = figure.subplots(*((n, 1) if self._stacked else (1, n)), squeeze=False, sharex=True, sharey=True).ravel()
        low, high = self._bounds()
        pad = 0.06 * float((high - low).max()) or 1.0
        for k, (axes, ((name, units), diagrams)) in enumerate(zip(grid, self.found.items(), strict=True)):
            self._draw(axes, name, diagrams, style.PALETTE[k])
            axes.set_xlim(low[0] - pad, high[0] + pad)
            axes.set_ylim(low[1] - pad, high[1] + pad)
            axes.set_aspect("equal", adjustable="box")
            axes.grid(False)
            style.verbatim(axes.set_xlabel(style.label("x", self.units)))
            style.verbatim(axes.set_ylabel(style.label("y", self.units)))
            axes.label_outer()
            style.verbatim(axes.set_title(style.label(NAMES[name], units), fontsize="medium"))
        style.heading(figure, self.title, self.note)

    def _draw(self, axes: Axes, name: str, diagrams: list[Diagram], color: str) -> None:
        scale = self._scale(name, diagrams)
        for d in diagrams:
            axes.plot(*d.whole.T, color="0.2", linewidth=2.2, zorder=2, solid_capstyle="round")
            line = d.line(scale)
            axes.fill(*np.vstack([line, d.axis[::-1]]).T, color=color, alpha=0.22, linewidth=0, zorder=1.8)
            axes.plot(*np.vstack([d.axis[:1], line, d.axis[-1:]]).T, color=color, linewidth=1.2, zorder=2.2)
            rows = np.unique(np.linspace(0, len(line) - 1, max(LINES // len(diagrams), 2)).astype(int))
            for a, b in zip(d.axis[rows], line[rows], strict=True):
                axes.plot(*np.array([a, b]).T, color=color, linewidth=0.5, alpha=0.7, zorder=1.9)
        draw_obstacles(axes, self.obstacles)
        draw_symbols(axes, self.symbols)
        self._extremes(axes, diagrams, scale)

    @staticmethod
    def _extremes(axes: Axes, diagrams: list[Diagram], scale: float) -> None:
        """Write the largest and the smallest value next to the diagram."""
        everything = [(float(d.values[i]), d.line(scale)[i]) for d in diagrams
                      for i in (int(d.values.argmax()), int(d.values.argmin()))]
        top = max(abs(v) for v, _ in everything)
        middle = float(np.mean([place[0] for d in diagrams for place in (d.axis.min(axis=0), d.axis.max(axis=0))]))
        ends = {v: place for v, place in (max(everything, key=lambda e: e[0]), min(everything, key=lambda e: e[0]))}
        for value, place in ends.items():
            if abs(value) > 1e-3 * top:
                # towards the middle, since there are other things beyond the axes
                side = 1 if place[0] <= middle else -1
                axes.annotate(f"{value:.4g}", place, (3 * side, 3), textcoords="offset points", fontsize="small",
                              ha="left" if side > 0 else "right", zorder=5,
                              bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6})

    def header(self) -> list[str]:
        unit = f" [{self.units}]"
        return ["quantity", "body", f"s{unit}", f"x{unit}", f"y{unit}", "value"]

    def rows(self) -> Iterator[Sequence[Any]]:
        for (name, units), diagrams in self.found.items():
            for d in diagrams:
                columns = (a[d.known].tolist() for a in (d.s, d.axis, d.values))
                for s, (x, y), value in zip(*columns, strict=True):
                    yield f"{name} [{units}]", d.body, s, x, y, value


def _diagram(results: Results, body: str, name: str, state: int) -> Diagram:
    """Return one quantity along one body, with its axis in the reference."""
    record, at = results.fields[body][name], results.body(body)
    lengths = at.lengths[at.classes][:, None]
    starts = np.cumsum(lengths)[:, None] - lengths
    xi = np.broadcast_to(record.xi, (len(lengths), record.xi.shape[-1]))
    # if the stations are within the elements, also the ends of elements, since a corner may be there
    ends = xi[:, :1] > 0.0
    xi = np.hstack([np.zeros_like(ends, float), xi, np.ones_like(ends, float)])
    known = np.hstack([np.zeros_like(ends), np.ones_like(xi[:, 1:-1], bool), np.zeros_like(ends)])
    s, stored = starts + lengths * xi, results.field(body, name, state)[..., 0, 0].ravel()
    kept = known | ends
    kept[0, 0] = kept[-1, -1] = False
    # slightly inside each element: at a corner, each side has its own normal
    inner = [(starts + lengths * np.clip(xi + step, 0.0, 1.0))[kept] for step in (-0.01, 0.01)]
    a, b = (results.reference(body, np.clip(v / lengths.sum(), 0.0, 1.0)) for v in inner)
    tangents = (b - a) / np.maximum(np.linalg.norm(b - a, axis=1), 1e-300)[:, None]
    normals = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    values = np.interp(s, s[known], stored)
    values[known] = stored
    return Diagram(body, s[kept], values[kept], results.reference(body, s[kept] / lengths.sum()), normals, known[kept],
                   outline(results, at, None, 1.0).axis)


def section_forces(sources: Sequence[Source], *, quantity: str | Sequence[str] | None = None, state: int = -1,
                   unrolled: bool | None = None, symbols: bool = True) -> Curves | Diagrams:
    """Build N, Q and M of the bodies.

    ``unrolled``: over the arc length in the reference, bodies one after the other, instead of on the bodies (default:
    for one straight body, and for several files). Without ``symbols``, supports and loads are not drawn on the bodies.
    Raises ResultsError.
    """
    asked = quantities_of(quantity) or list(FORCES)
    for name in asked:
        if name not in FORCES:
            raise ResultsError(f"section_forces draws {', '.join(FORCES)}, not '{name}'")
    found: dict[str, list[tuple[Source, Diagram, str]]] = {name: [] for name in asked}
    for source in sources:
        results = source.results
        check_state(results, state)
        for body, fields in results.fields.items():
            for name in asked:
                if name in fields:
                    found[name].append((source, _diagram(results, body, name, state), fields[name].units))
    drawn = {name: entries for name, entries in found.items() if entries}
    if not drawn:
        raise ResultsError(f"{sources[0].results.called} does not hold {' or '.join(asked)}")
    _zero_negligible(drawn)
    first, note = sources[0].results, when(sources[0].results, state)
    one = [d for _, d, _ in next(iter(drawn.values()))]
    if unrolled is None:
        unrolled = len(sources) > 1 or (len(one) == 1 and _straight(one[0].whole))
    if unrolled:
        return Curves(common_title(sources), note, _over_length(drawn, first), share="x")
    if len(sources) > 1:
        raise ResultsError("section forces are drawn on the bodies of one file at a time; several are drawn unrolled")
    marks = symbols_of(first, None, 1.0, state) if symbols else []
    note += "; M is drawn on the side in tension" if "M" in drawn else ""
    return Diagrams(first.title, note, first.units.length,
                    {(name, e[0][2]): [d for _, d, _ in e] for name, e in drawn.items()}, marks,
                    obstacles_of(first, None, 1.0))


def _straight(axis: np.ndarray) -> bool:
    chord = axis[-1] - axis[0]
    off = (axis - axis[0]) @ np.array([-chord[1], chord[0]])
    return bool(np.abs(off).max() <= STRAIGHT * float(chord @ chord))


def _over_length(drawn: dict[str, list[tuple[Source, Diagram, str]]], first: Results) -> list[Panel]:
    """Return a panel of each quantity over the arc length; each body begins where the previous one ends."""
    begins: dict[str, float] = {}
    end = 0.0
    for entries in drawn.values():
        for _, d, _ in entries:
            if d.body not in begins:
                begins[d.body] = end
                end += float(d.s.max())
    axis = ("arc length" if len(begins) == 1 else "arc length, body after body", first.units.length)
    panels = []
    for name, entries in drawn.items():
        panel = Panel(axis, (NAMES[name], entries[0][2]), zero=True, bars=list(begins.values())[1:])
        for source, d, _ in entries:
            label = source.name(d.body if len(begins) > 1 or not source.label else "")
            panel.curves.append(Curve(label, begins[d.body] + d.s[d.known], d.values[d.known], look={"marker": ""}))
        panels.append(panel)
    return panels


def _zero_negligible(drawn: dict[str, list[tuple[Source, Diagram, str]]]) -> None:
    """Set quantities to zero that are round-off relative to the others, since their axes would show noise."""
    length = max(float(d.s.max()) for entries in drawn.values() for _, d, _ in entries)
    sizes = {name: max(float(np.abs(d.values).max()) for _, d, _ in entries) / (length if name == "M" else 1.0)
             for name, entries in drawn.items()}
    for name, entries in drawn.items():
        if sizes[name] < 1e-6 * max(sizes.values()):
            for _, d, _ in entries:
                d.values = np.zeros_like(d.values)


def _no_forces(results: Results) -> str:
    if no_states(results):
        return no_states(results)
    known = any(name in FORCES for found in results.fields.values() for name in found)
    return "" if known else "it holds no section forces (output: fields: [N, Q, M] in the case stores them)"


SECTION_FORCES = Kind("section_forces", "N, Q and M on the bodies, or along them", _no_forces, section_forces)
