"""Pictures as plain values: the same data are drawn and exported."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from ancf2d.plot import style
from ancf2d.results import Results

MAX_MARKERS = 60  # longest line with a marker at each point; more would merge
FEW_MARKERS = 12  # markers on a longer line, so that lines differ also in grey
FLAT = 1e-9  # relative to the largest value: a smaller range is round-off


@dataclass(frozen=True)
class Source:
    """One result file in a figure and its label there (empty if it is alone)."""

    label: str
    results: Results

    def name(self, text: str) -> str:
        """Return a name for an item of this file, with the file's label."""
        return f"{self.label}: {text}" if self.label and text else self.label or text


def common_title(sources: Sequence[Source]) -> str:
    """Return the title of all files, or if they differ their common beginning, up to a comma or colon."""
    parts = [re.split(r"(?<=[,:;])\s+", s.results.title) for s in sources]
    same = list(itertools.takewhile(lambda column: len(set(column)) == 1, zip(*parts, strict=False)))
    whole = all(len(p) == len(same) for p in parts)
    # 'beam,' and 'beam' have the same beginning
    ends = {p[len(same)].rstrip(",:;") if len(p) > len(same) else "" for p in parts}
    text = " ".join([column[0] for column in same] + (list(ends) if len(ends) == 1 else []))
    return text if whole else text.rstrip(" ,:;")


class Picture(Protocol):
    """Something that draws itself into a figure and lists its data."""

    title: str

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in inches."""

    def render(self, figure: Figure) -> None:
        """Draw into an empty figure."""

    def header(self) -> list[str]:
        """Return the names of the data's columns, with units."""

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield the rows of the drawn data."""


@dataclass(frozen=True)
class Kind:
    """A kind of figure.

    ``missing(results)`` says in words what a file lacks for it (empty: nothing);
    ``build(sources, **options)`` makes the picture; its keyword arguments are the kind's options.
    ``frames(sources, count, **options)`` yields the pictures of an animation, None if the kind cannot be animated.
    ``single``: it is drawn from one file at a time; ``least``: the smallest number of files.
    """

    name: str
    doc: str
    missing: Callable[[Results], str]
    build: Callable[..., Picture]
    frames: Callable[..., Iterator[Picture]] | None = None
    single: bool = False
    least: int = 1


def lacking(table: str, columns: Sequence[str], said: str) -> Callable[[Results], str]:
    """Return a ``Kind.missing`` that returns ``said`` for files without a table, some of its columns, or rows."""
    def missing(results: Results) -> str:
        found = results.tables.get(table)
        return "" if found is not None and set(columns) <= set(found) and found.rows else said
    return missing


@dataclass
class Curve:
    """One line: its name, and x and y (n,); ``look`` changes its style, ``texts`` are written next to its points."""

    name: str
    x: np.ndarray
    y: np.ndarray
    note: str = ""
    look: dict[str, Any] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Triangle:
    """The slope of an order on logarithmic axes: from ``x[0]`` to ``x[1]``, a little below ``y`` at the first."""

    x: tuple[float, float]
    y: float
    order: int

    def draw(self, axes: Axes) -> None:
        """Draw the triangle with its order next to it."""
        top = 0.45 * self.y
        bottom = top * (self.x[1] / self.x[0]) ** -self.order
        axes.fill((self.x[0], self.x[1], self.x[0]), (top, bottom, bottom), facecolor="0.93", edgecolor="0.45",
                  linewidth=0.8, zorder=1.6)
        axes.annotate(str(self.order), (self.x[0], math.sqrt(top * bottom)), (-4, 0), textcoords="offset points",
                      ha="right", va="center", fontsize="small", color="0.3")


@dataclass
class Panel:
    """One axes with its curves.

    ``log``: logarithmic y axis; ``whole``: whole numbers on y; ``equal``: one scale for x and y; ``zero``: draw the
    line y = 0; ``bars``: x of vertical lines; ``triangles`` show orders of convergence.
    """

    x: tuple[str, str]
    y: tuple[str, str]
    curves: list[Curve] = field(default_factory=list)
    log: bool = False
    whole: bool = False
    equal: bool = False
    zero: bool = False
    bars: list[float] = field(default_factory=list)
    triangles: list[Triangle] = field(default_factory=list)


def _column(axis: tuple[str, str]) -> str:
    """Return the name of the quantity on an axis as a column of a table."""
    name, units = axis
    return f"{name} [{units}]" if units not in ("", "1") else name


@dataclass
class Curves:
    """A picture of lines, in panels one above the other or, if they share y or nothing, side by side.

    ``log_base``: base of a logarithmic x axis, else 0; ``log_y``: all y axes are logarithmic. Values below ``floor``
    are not drawn on a logarithmic axis.
    """

    title: str
    note: str
    panels: list[Panel]
    share: str = "x"
    log_base: int = 0
    log_y: bool = False
    floor: float = 0.0

    @property
    def size(self) -> tuple[float, float]:
        n = len(self.panels)
        names = list({c.name: None for p in self.panels for c in p.curves}) or [""]
        room = max(0.1 * min(len(names), 12), 0.19 * style.legend_rows(6.4, names))
        if n == 1 and self.panels[0].equal:
            return 6.4, self._equal_height() + room
        if self.share != "x":
            return (6.4 if n == 1 else min(3.6 * n + 0.6, 12.0), 4.2 + room)
        return (6.4, (4.2 if n == 1 else 2.4 * n + 0.6) + room)

    def _equal_height(self) -> float:
        x, y = (np.concatenate([getattr(c, k) for c in self.panels[0].curves]) for k in ("x", "y"))
        width, height = (float(np.ptp(v[np.isfinite(v)])) for v in (x, y))
        return float(np.clip(5.4 * height / width if width else 5.0, 1.6, 5.4)) + 1.3

    def render(self, figure: Figure) -> None:
        n = len(self.panels)
        shape = (n, 1) if self.share == "x" else (1, n)
        grid = figure.subplots(*shape, squeeze=False, sharex=self.share == "x",
                               sharey=self.share == "y")
        names = list(dict.fromkeys(c.name for p in self.panels for c in p.curves))
        handles: dict[tuple[str, bool], Any] = {}
        for axes, panel in zip(grid.ravel(), self.panels, strict=True):
            for curve in panel.curves:
                self._curve(axes, curve, names, self.log_y or panel.log, handles)
            self._scales(axes, panel)
            self._labels(axes, panel)
            for triangle in panel.triangles:
                triangle.draw(axes)
            for x in panel.bars:
                axes.axvline(x, color=style.REFERENCE, linewidth=0.7, linestyle=":", zorder=1.4)
            if panel.zero:
                axes.axhline(0.0, color=style.REFERENCE, linewidth=0.9, zorder=1.5)
            if panel.equal:
                axes.set_aspect("equal", adjustable="datalim")
            if self.share:
                axes.label_outer()
        style.title(figure, self.title, self.note)
        style.legend(figure, list(handles.values()), [text for text, _ in handles])

    def _curve(self, axes: Axes, curve: Curve, names: list[str], log: bool,
               handles: dict[tuple[str, bool], Any]) -> None:
        """Draw one line, and add its legend entry to ``handles``, by its text and whether several lines share it."""
        number = names.index(curve.name)
        looks = style.line_style(number)
        if len(curve.x) > MAX_MARKERS:
            # each line has its markers at other points, so that those of equal lines do not hide each other
            each = len(curve.x) // FEW_MARKERS
            looks["markevery"] = (number * each // 3 % each, each)
            looks["marker"] = looks["marker"] if len(names) > 1 else ""
        looks.update(curve.look)
        name = f"{curve.name}{curve.note}"
        marks = looks.pop("label", None)
        y = np.where(curve.y > self.floor, curve.y, np.nan) if log else curve.y
        (line,) = axes.plot(curve.x, y, label=marks or name, **looks)
        if marks is None:
            handles[name, False] = line
        elif not marks.startswith("_"):
            # one entry for all lines, in a neutral colour
            handles.setdefault((marks, True), Line2D([], [], **{**looks, "color": "0.25"}))
        for x, height, text in zip(curve.x, y, curve.texts, strict=False):
            axes.annotate(text, (x, height), (5, 5), textcoords="offset points", fontsize="small", zorder=6,
                          bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6})

    def _scales(self, axes: Axes, panel: Panel) -> None:
        if self.log_base:
            axes.set_xscale("log", base=self.log_base)
            axes.xaxis.set_major_formatter("{x:g}")
            if self.log_base == 10:  # labels at 2 and 5 too; more would overlap
                axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
                axes.xaxis.set_minor_formatter("{x:g}")
        if self.log_y or panel.log:
            axes.set_yscale("log")
        elif not panel.equal:
            self._room(axes, panel)
        if panel.whole:
            axes.locator_params(axis="y", integer=True)
        if panel.x[0] == "step":
            axes.locator_params(axis="x", integer=True)

    @staticmethod
    def _room(axes: Axes, panel: Panel) -> None:
        """Widen the range of y if its values agree to round-off, since all ticks would show the same number."""
        values = np.concatenate([c.y[np.isfinite(c.y)] for c in panel.curves] or [np.empty(0)])
        if values.size and np.ptp(values) <= FLAT * np.abs(values).max():
            half = 1.0 if panel.whole else 0.05 * float(np.abs(values).max()) or 1.0
            axes.set_ylim(values.mean() - half, values.mean() + half)

    @staticmethod
    def _labels(axes: Axes, panel: Panel) -> None:
        """Label both axes; short times are shown in ms, µs or ns."""
        for k, axis, (name, units), show in (("x", axes.xaxis, panel.x, axes.set_xlabel),
                                             ("y", axes.yaxis, panel.y, axes.set_ylabel)):
            values = [np.abs(v[np.isfinite(v)]).max(initial=0.0) for v in (getattr(c, k) for c in panel.curves)]
            shown, factor = style.time_unit(units, max(values, default=0.0))
            if factor != 1.0:
                style.in_unit(axis, factor)
                if k == "x" and axis.get_scale() == "log":  # the only axis whose minor ticks have numbers
                    style.in_unit(axis, factor, minor=True)
            style.verbatim(show(style.label(name, shown)))

    def header(self) -> list[str]:
        """Return the names of the columns: one for each quantity on an axis."""
        return ["curve", *self._columns()]

    def _columns(self) -> list[str]:
        return list(dict.fromkeys(_column(axis) for panel in self.panels for axis in (panel.x, panel.y)))

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield the points of all curves, except the marks of their ends, which repeat points."""
        columns = self._columns()
        for panel in self.panels:
            x_at, y_at = (columns.index(_column(axis)) for axis in (panel.x, panel.y))
            for curve in panel.curves:
                if "label" in curve.look:
                    continue
                for x, y in zip(curve.x.tolist(), curve.y.tolist(), strict=True):
                    values: list[Any] = [""] * len(columns)
                    values[x_at], values[y_at] = x, y
                    yield curve.name, *values
