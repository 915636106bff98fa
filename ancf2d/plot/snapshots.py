"""Bodies at several moments in one picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.body import Outline, bounds, chosen_scale, magnified, no_bodies, outline, when
from ancf2d.plot.picture import Kind, Source, common_title
from ancf2d.results import Results

MAX_TICKS = 10  # moments that are named below the bar of colours
COUNT = 8  # moments that are drawn unless more are asked for
DARK, LIGHT = 0.0, 0.86  # part of the colour map that is used: paler would be lost on white


@dataclass
class Moment:
    """All bodies of one file at one time or load factor."""

    label: str
    t: float
    file: int
    bodies: dict[str, Outline]


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
        return bounds([b.boundary for m in self.moments for b in m.bodies.values()])

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
        for moment in self.moments:
            color = tuple(shades[labels.index(moment.label)])
            dash = style.DASHES[moment.file % len(style.DASHES)]
            for body in moment.bodies.values():
                axes.add_patch(Polygon(body.boundary, facecolor=(*color[:3], 0.35), edgecolor=color, linewidth=1.4,
                                       linestyle=dash, joinstyle="round", zorder=2 + labels.index(moment.label) / 100))
        for k, name in enumerate(self.files if len(self.files) > 1 else ()):
            handles[name] = Line2D([], [], color="0.3", linestyle=style.DASHES[k % len(style.DASHES)])
        low, high = self._bounds()
        pad = 0.04 * float((high - low).max()) or 1.0
        axes.update_datalim([low - pad, high + pad])
        axes.margins(0)
        axes.autoscale_view()
        axes.set_aspect("equal", adjustable="datalim")
        style.verbatim(axes.set_xlabel(style.label("x", self.units)))
        style.verbatim(axes.set_ylabel(style.label("y", self.units)))
        style.title(figure, self.title, self.note)
        self._bar(figure, axes, shades, labels)
        if handles:
            style.legend(figure, list(handles.values()), list(handles))

    def _bar(self, figure: Figure, axes: Axes, shades: np.ndarray, labels: list[str]) -> None:
        """Put a bar below the axes with the colour and the time of each moment."""
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
        unit = f" [{self.units}]"
        return ["file", "t", "body", *(f"{axis}_{face}{unit}" for face in ("axis", "top", "bottom") for axis in "xy")]

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
    """Return the states that are nearest to the times, or ``count`` evenly spaced in time."""
    t = results.t
    wanted = np.linspace(t[0], t[-1], count) if at is None else np.array(_times(at))
    span = float(np.ptp(t)) or 1.0
    for value in wanted:
        if not t.min() - 1e-6 * span <= value <= t.max() + 1e-6 * span:
            raise ResultsError(f"'{results.path}' holds states from {t.min():.6g} to {t.max():.6g}, "
                               f"none at {value:.6g}")
    if at is None and np.any(np.diff(t) <= 0):  # a path that turns back: count states instead
        return list(dict.fromkeys(np.linspace(0, len(t) - 1, count).round().astype(int).tolist()))
    return list(dict.fromkeys(int(np.argmin(np.abs(t - value))) for value in wanted))


def snapshots(sources: Sequence[Source], *, at: str | None = None, count: int = COUNT,
              scale: float | str = "auto") -> Snapshots:
    """Build the bodies at several moments.

    ``at``: times or load factors with commas between them (the nearest stored states are drawn), else ``count`` evenly
    spaced ones.
    """
    if int(count) < 1:
        raise ResultsError(f"at least one instant must be drawn, not {count}")
    factor, moments = chosen_scale(sources, -1, scale), []
    for file, source in enumerate(sources):
        results = source.results
        for i in _states(results, at, int(count)):
            bodies = {name: outline(results, body, i, factor) for name, body in results.bodies.items()}
            moments.append(Moment(when(results, i), float(results.t[i]), file, bodies))
    files = [s.label or s.results.path.name for s in sources]
    first = sources[0].results
    axis = ("time", first.units.time) if first.solver == "dynamic" else ("load factor", "1")
    return Snapshots(common_title(sources), magnified(factor).lstrip(", "), first.units.length, moments, files, axis)


def _few(results: Results) -> str:
    return no_bodies(results) or ("" if results.nt > 1 else "it holds fewer than two states")


SNAPSHOTS = Kind("snapshots", "bodies at several times, or load factors, in one picture", _few, snapshots)
