"""Pictures as plain values: what is drawn is also what is exported."""

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

MAX_MARKERS = 60  # points of a line that are all marked; more would merge
FEW_MARKERS = 12  # of such a line, so that it can be told from others in grey
FLAT = 1e-9  # of the largest value: a range below it is round-off


@dataclass(frozen=True)
class Source:
    """One result file in a figure and the name that it goes by there (empty if it is alone)."""

    label: str
    results: Results

    def name(self, text: str) -> str:
        """Return the name of something of this file."""
        return f"{self.label}: {text}" if self.label and text else self.label or text


def common_title(sources: Sequence[Source]) -> str:
    """Return the title of all files: where they differ, what they begin with in common, up to a comma or colon."""
    parts = [re.split(r"(?<=[,:;])\s+", s.results.title) for s in sources]
    same = list(itertools.takewhile(lambda column: len(set(column)) == 1, zip(*parts, strict=False)))
    whole = all(len(p) == len(same) for p in parts)
    # 'beam,' and 'beam' begin alike
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
        """Yield the rows of the data that are drawn."""


@dataclass(frozen=True)
class Kind:
    """A kind of figure.

    ``missing(results)`` says in words what a file lacks for it (empty: nothing);
    ``build(sources, **options)`` makes the picture; its keyword arguments are the kind's options.
    ``frames(sources, count, **options)`` yields the pictures of an animation, None where the kind stands still.
    ``single``: it is drawn from one file at a time; ``least``: from so many together.
    """

    name: str
    doc: str
    missing: Callable[[Results], str]
    build: Callable[..., Picture]
    frames: Callable[..., Iterator[Picture]] | None = None
    single: bool = False
    least: int = 1


def lacking(table: str, columns: Sequence[str], said: str) -> Callable[[Results], str]:
    """Return what says ``said`` of files that lack a table, some of its columns, or rows; see ``Kind.missing``."""
    def missing(results: Results) -> str:
        found = results.tables.get(table)
        return "" if found is not None and set(columns) <= set(found) and found.rows else said
    return missing


@dataclass
class Curve:
    """One line: its name, and x and y (n,); ``look`` is how it is drawn where that is not as usual.

    ``texts`` stand beside its points.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    note: str = ""
    look: dict[str, Any] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Triangle:
    """What an order looks like on logarithmic axes: from ``x[0]`` to ``x[1]``, a little below ``y`` at the first."""

    x: tuple[float, float]
    y: float
    order: int

    def draw(self, axes: Axes) -> None:
        """Draw the triangle with its order beside it."""
        top = 0.45 * self.y
        bottom = top * (self.x[1] / self.x[0]) ** -self.order
        axes.fill((self.x[0], self.x[1], self.x[0]), (top, bottom, bottom), facecolor="0.93", edgecolor="0.45",
                  linewidth=0.8, zorder=1.6)
        axes.annotate(str(self.order), (self.x[0], math.sqrt(top * bottom)), (-4, 0), textcoords="offset points",
                      ha="right", va="center", fontsize="small", color="0.3")


@dataclass
class Panel:
    """One axes with its curves; ``log``: its y axis is logarithmic; ``whole``: it counts something; ``equal``: x and y
    have one scale; ``zero``: where y is zero is drawn too; ``bars`` are the x of vertical lines; ``triangles`` show
    orders of convergence."""

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
    """Return how a table names the quantity on an axis."""
    name, units = axis
    return f"{name} [{units}]" if units not in ("", "1") else name


@dataclass
class Curves:
    """A picture of lines, in panels one above the other or, sharing y or nothing, side by side.

    ``log_base``: of the x axis where it is logarithmic, else 0; ``log_y``: whether all y axes are. Values below
    ``floor`` are not drawn on a logarithmic axis.
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
        """Draw one line, and put its entry of the legend into ``handles``: by its text, and whether many share it."""
        number = names.index(curve.name)
        looks = style.line_style(number)
        if len(curve.x) > MAX_MARKERS:
            # each line begins elsewhere, so that markers of two that agree do not hide each other
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
            # one entry for all lines, in a colour that none of them has
            handles.setdefault((marks, True), Line2D([], [], **{**looks, "color": "0.25"}))
        for x, height, text in zip(curve.x, y, curve.texts, strict=False):
            axes.annotate(text, (x, height), (5, 5), textcoords="offset points", fontsize="small", zorder=6,
                          bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6})

    def _scales(self, axes: Axes, panel: Panel) -> None:
        if self.log_base:
            axes.set_xscale("log", base=self.log_base)
            axes.xaxis.set_major_formatter("{x:g}")
            if self.log_base == 10:  # labels at 2 and 5 too, and at no others: they would run into each other
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
        """Give y a range where its values are the same but for round-off: ticks would all show one number."""
        values = np.concatenate([c.y[np.isfinite(c.y)] for c in panel.curves] or [np.empty(0)])
        if values.size and np.ptp(values) <= FLAT * np.abs(values).max():
            half = 1.0 if panel.whole else 0.05 * float(np.abs(values).max()) or 1.0
            axes.set_ylim(values.mean() - half, values.mean() + half)

    @staticmethod
    def _labels(axes: Axes, panel: Panel) -> None:
        """Label both axes; those of short times count in ms or µs."""
        for k, axis, (name, units), show in (("x", axes.xaxis, panel.x, axes.set_xlabel),
                                             ("y", axes.yaxis, panel.y, axes.set_ylabel)):
            values = [np.abs(v[np.isfinite(v)]).max(initial=0.0) for v in (getattr(c, k) for c in panel.curves)]
            shown, factor = style.time_unit(units, max(values, default=0.0))
            if factor != 1.0:
                style.in_unit(axis, factor)
                if k == "x" and axis.get_scale() == "log":  # the only one whose minor ticks have numbers
                    style.in_unit(axis, factor, minor=True)
            style.verbatim(show(style.label(name, shown)))

    def header(self) -> list[str]:
        """Return the names of the columns: one for each quantity on an axis."""
        return ["curve", *self._columns()]

    def _columns(self) -> list[str]:
        return list(dict.fromkeys(_column(axis) for panel in self.panels for axis in (panel.x, panel.y)))

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield the points of all curves; marks of their ends, which are points of theirs, are left out."""
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
