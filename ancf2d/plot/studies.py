"""Figures of studies: sweeps and their samples, influence of numbers, optimisations, and fits with their data."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title, lacking
from ancf2d.results import Results, Table
from ancf2d.results.records import short_names

# relative change of each number that the bars show
CHANGE = 0.01
FIRST = ("evaluation", "minimised", "missed")
FITTED_OVER = {"t": "time", "factor": "load factor", "hz": "frequency"}
POINTS = {"linestyle": "none", "marker": "o", "markersize": 3.0, "markevery": 1, "alpha": 0.7}
MODEL = {"linestyle": "-", "marker": ""}
# measured columns of one figure; each has two panels
MAX_COLUMNS = 4


@dataclass
class Tornado:
    """A bar chart: for each number its path, its value and the change of the goal (n,) if it grows by 1 %.

    A number that is 0 grows by 1 % of the largest in its list, or of the size of the model.
    """

    title: str
    goal: str
    units: str
    paths: list[str]
    values: np.ndarray
    changes: np.ndarray
    left_out: int

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in inches."""
        return 7.0, 1.3 + 0.27 * len(self.paths)

    def render(self, figure: Figure) -> None:
        """Draw a bar for each number, the longest on top."""
        axes = figure.add_subplot()
        places = np.arange(len(self.paths))
        colours = np.where(self.changes < 0, "#c1503a", "#1f5fa8")
        axes.barh(places, self.changes, color=colours.tolist(), height=0.7)
        axes.axvline(0.0, color="0.3", linewidth=0.8)
        axes.set_yticks(places, [f"{p} = {v:.6g}" for p, v in zip(self.paths, self.values.tolist(), strict=True)])
        axes.set_ylim(len(self.paths) - 0.4, -0.6)
        axes.grid(axis="y", visible=False)
        unit = "" if self.units in ("1", "") else f" [{self.units}]"
        # the power of ten of the ticks is to the right
        axes.set_xlabel(f"change of {self.goal}{unit} by +{CHANGE:.0%} of a number", loc="left")
        note = f"{self.left_out} less influential numbers are left out" if self.left_out else ""
        zero = "" if self.values.all() else (
            f"where it is 0: +{CHANGE:.0%} of the largest\nin its list, or of the model's size")
        axes.set_title("\n".join(t for t in (self.title, note, zero) if t))

    def header(self) -> list[str]:
        """Return the names of the data's columns."""
        return ["path", "value", f"change of {self.goal} [{self.units}]"]

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield the rows of the drawn data."""
        yield from zip(self.paths, self.values.tolist(), self.changes.tolist(), strict=True)


def tornado(sources: Sequence[Source], *, count: int = 20) -> Tornado:
    """Build the bars of the ``count`` most influential numbers of one file."""
    table = sources[0].results.tables["sensitivity"]
    influence = np.asarray(table["influence"], float)
    slope, moving = np.asarray(table["derivative"], float), int((influence > 0).sum())
    order = np.argsort(-influence, kind="stable")[:max(1, min(count, moving))]
    changes = CHANGE * np.sign(slope) * influence
    return Tornado(common_title(sources), str(table.attrs.get("goal", "the goal")), table.units.get("influence", "1"),
                   [str(table["path"][k]) for k in order], np.asarray(table["value"], float)[order], changes[order],
                   max(0, moving - len(order)))


TORNADO = Kind("tornado", "how much the goal changes with each number of the case, the most influential ones first",
               lacking("sensitivity", ("path", "value", "derivative", "influence"),
                       "it holds no table of sensitivities ('ancf2d sensitivity CASE -o FILE.h5' writes one)"),
               tornado, single=True)


LONGEST = 30  # letters of an axis label


def optimisation(sources: Sequence[Source]) -> Curves:
    """Build the minimised quantity, the excess of constraints if there are some, and each number over its start."""
    table = sources[0].results.tables["optimisation"]
    n = np.asarray(table["evaluation"], float)
    what = str(table.attrs.get("minimise", "objective"))
    # an axis has no room for a long expression, which is then in the legend only
    axis = what if len(what) <= LONGEST else "minimised"
    panels = [Panel(("evaluation", "1"), (axis, "1"), [Curve(what, n, np.asarray(table["minimised"], float))])]
    if table.attrs.get("constrained"):
        missed = Curve("excess", n, np.asarray(table["missed"], float))
        panels.append(Panel(("evaluation", "1"), ("largest excess of a constraint", "1"), [missed]))
    numbers = [Curve(name, n, _relative(np.asarray(values, float))) for name, values in table.items()
               if name not in FIRST]
    panels.append(Panel(("evaluation", "1"), ("numbers beside their start", "1"), numbers))
    return Curves(common_title(sources), "", panels)


def _relative(values: np.ndarray) -> np.ndarray:
    """Return values divided by the first one, or by the largest magnitude if that is 0."""
    return values / (values[0] or np.abs(values).max() or 1.0)


OPTIMISATION = Kind("optimisation", "objective, constraints and numbers over all evaluations",
                    lacking("optimisation", FIRST,
                            "it holds no optimisation ('ancf2d optimise CASE ... --history FILE.h5' writes one)"),
                    optimisation, single=True)


def _columns(table: Table) -> list[str]:
    return [name.removeprefix("data ") for name in table if name.startswith("data ")]


def fit(sources: Sequence[Source], *, quantity: Sequence[str] = ()) -> Curves:
    """Build data and model of each measured column, with the differences of the two below.

    ``quantity`` are the columns to draw, by their names in the data. Raises ResultsError.
    """
    first = sources[0].results.tables["fitted"]
    axis = next(name for name in FITTED_OVER if name in first)
    known = _columns(first)
    for name in quantity:
        if name not in known:
            raise ResultsError(f"no column '{name}' was fitted (there are {', '.join(known)})")
    panels: list[Panel] = []
    for name in (list(quantity) or known)[:MAX_COLUMNS]:
        units = first.units.get(f"data {name}", "1")
        pair = (Panel((FITTED_OVER[axis], first.units.get(axis, "1")), (name, units)),
                Panel((FITTED_OVER[axis], first.units.get(axis, "1")), ("data - model", units), zero=True))
        for source in sources:
            table = source.results.tables["fitted"]
            if not {axis, f"data {name}"} <= set(table):
                raise ResultsError(f"{source.results.called} has no column '{name}' over {axis}")
            x, data, model = (np.asarray(table[key], float) for key in (axis, f"data {name}", f"model {name}"))
            here = np.isfinite(data)
            pair[0].curves += [Curve(source.name("data"), x[here], data[here], look=dict(POINTS)),
                               Curve(source.name("model"), x[here], model[here], look=dict(MODEL))]
            pair[1].curves.append(Curve(source.name("data"), x[here], (data - model)[here], look=dict(POINTS)))
        panels += pair
    return Curves(common_title(sources), _note(sources[0].results), panels)


def _note(results: Results) -> str:
    """Return the fitted numbers in a line, each with its standard error."""
    table = results.tables["fit"]
    ends = short_names([str(path) for path in table["path"]])
    return ", ".join(f"{end} = {value:.5g}" + (f" +- {error:.1g}" if np.isfinite(error) else "") for end, value, error
                     in zip(ends, table["value"], table["standard_error"], strict=True))


def _no_fit(results: Results) -> str:
    held = {"fit", "fitted"} <= set(results.tables)
    return "" if held else "it holds no fit ('ancf2d fit CASE --data FILE.csv' writes one)"


FIT = Kind("fit", "measured data and the case fitted to them, with the differences", _no_fit, fit, single=True)


# largest number of lines and of panels of one figure; more are hard to read
MAX_CURVES, MAX_PANELS = 12, 6
# ratio of the ends of an axis above which it is logarithmic, unless the values are sampled
DECADES = 30.0
OUTLINE = {"drawstyle": "steps-post", "marker": "", "linewidth": 1.6}


def _listed(table: Table, name: str) -> list[str]:
    """Return the names of columns that an attribute of the table lists."""
    return [str(v) for v in json.loads(str(table.attrs.get(name, "[]"))) if v in table]


def _table(source: Source) -> Table:
    return source.results.tables["sweep"]


def _values(sources: Sequence[Source], wanted: Sequence[str]) -> list[str]:
    """Return the computed values to draw, those wanted or all. Raises ResultsError if one is missing."""
    known = [name for name in dict.fromkeys(n for s in sources for n in _listed(_table(s), "values"))
             if all(name in _table(s) for s in sources)]
    for name in wanted:
        if name not in known:
            raise ResultsError(f"the sweep has no value '{name}' (it has {', '.join(known)})")
    return (list(wanted) or known)[:MAX_PANELS]


def _numeric(table: Table) -> list[str]:
    """Return the varied paths that are numbers."""
    return [p for p in _listed(table, "paths") if not isinstance(table[p], list)]


def _path(sources: Sequence[Source], over: str | None) -> str:
    """Return the path on the horizontal axis: the requested one, or the one with most values. Raises ResultsError."""
    known = [p for p in _numeric(_table(sources[0])) if all(p in _numeric(_table(s)) for s in sources)]
    if not known:
        raise ResultsError("no number is varied in this sweep, so there is nothing to draw its values over")
    if over is None:
        return max(known, key=lambda p: len(np.unique(_table(sources[0])[p])))
    ends = [p for p in known if p == over or p.endswith(f".{over}")]
    if len(ends) != 1:
        raise ResultsError(f"the sweep does not vary the number '{over}' (it varies {', '.join(known)})")
    return ends[0]


def sweep(sources: Sequence[Source], *, over: str | None = None, quantity: Sequence[str] = ()) -> Curves:
    """Build computed values over one varied number: a line for each combination of the others, or points for samples.

    ``over`` is the path or its end; ``quantity`` are the values, by the names of their columns. Raises ResultsError.
    """
    path, panels = _path(sources, over), []
    sampled = any(bool(_table(s).attrs.get("sampled")) for s in sources)
    groups = [(s, name, rows) for s in sources for name, rows in _lines(_table(s), path, sampled)]
    for value in _values(sources, quantity):
        curves = []
        for source, name, rows in groups[:MAX_CURVES]:
            x, y = (np.asarray(_table(source)[k], float)[rows] for k in (path, value))
            order = np.argsort(x, kind="stable")
            order = order[np.isfinite(y[order])]
            label = source.label if source.label and not name else source.name(name)
            curves.append(Curve(label or value, x[order], y[order], look=dict(POINTS) if sampled else {}))
        units = _table(sources[0]).units.get(value, "1")
        panels.append(Panel((path, "1"), (value, units), [c for c in curves if len(c.x)]))
    if not any(panel.curves for panel in panels):
        raise ResultsError("no row of the sweep has a value to draw")
    left = len(groups) - MAX_CURVES
    x = np.concatenate([c.x for p in panels for c in p.curves])
    log = not sampled and bool(x.min() > 0.0 and x.max() > DECADES * x.min())
    note = f"{left} more combinations are not drawn" if left > 0 else ""
    return Curves(common_title(sources), note, panels, log_base=10 if log else 0)


def _lines(table: Table, path: str, sampled: bool) -> list[tuple[str, np.ndarray]]:
    """Return the name and rows of each line; the name has the values of the other varied paths."""
    paths = _listed(table, "paths")
    others = [p for p in paths if p != path]
    # no value repeats if lists were paired
    if sampled or not others or len(np.unique(table[path])) == table.rows:
        return [("", np.arange(table.rows))]
    shown = [[f"{v:g}" if isinstance(v, float | np.floating) else str(v) for v in table[p]] for p in others]
    named = dict(zip(paths, short_names(paths), strict=True))
    ends = [named[p] for p in others]
    names = [", ".join(f"{end} = {v}" for end, v in zip(ends, row, strict=True)) for row in zip(*shown, strict=True)]
    return [(name, np.flatnonzero([n == name for n in names])) for name in dict.fromkeys(names)]


def histogram(sources: Sequence[Source], *, quantity: Sequence[str] = ()) -> Curves:
    """Build histograms of samples: counts in bins of equal width by the rule of Freedman and Diaconis."""
    panels = []
    for value in _values(sources, quantity):
        found = {s: y[np.isfinite(y)] for s in sources if len(y := np.asarray(_table(s)[value], float))}
        data = np.concatenate(list(found.values()))
        if not len(data):
            raise ResultsError(f"no row of the sweep has a value of {value}")
        edges = np.histogram_bin_edges(data, "fd" if np.ptp(data) else 1)
        curves = [Curve(s.label or "samples", np.append(edges[0], edges), np.r_[0, np.histogram(y, edges)[0], 0],
                        look=dict(OUTLINE)) for s, y in found.items()]
        panels.append(Panel((value, _table(sources[0]).units.get(value, "1")), ("samples", "1"), curves, zero=True))
    return Curves(common_title(sources), "", panels, share="")


@dataclass
class Shares:
    """A bar chart: ``bars`` are (value, path, share, standard error)."""

    title: str
    bars: list[tuple[str, str, float, float]]

    @property
    def size(self) -> tuple[float, float]:
        return 6.4, 1.6 + 0.32 * len(self.bars)

    def render(self, figure: Figure) -> None:
        axes = figure.subplots()
        values = list(dict.fromkeys(bar[0] for bar in self.bars))
        place = np.arange(len(self.bars)) + 0.6 * np.array([values.index(bar[0]) for bar in self.bars])
        for k, value in enumerate(values):
            rows = [i for i, bar in enumerate(self.bars) if bar[0] == value]
            axes.barh(place[rows], [self.bars[i][2] for i in rows], xerr=[self.bars[i][3] for i in rows], height=0.7,
                      color=style.PALETTE[k % len(style.PALETTE)], capsize=3, label=value, ecolor="0.25")
        for text in axes.set_yticks(place, [bar[1] for bar in self.bars]):
            style.verbatim(text.label1)
        axes.invert_yaxis()
        axes.set_xlim(0.0, max(1.0, 1.02 * max(bar[2] + bar[3] for bar in self.bars)))
        axes.set_xlabel("first-order share of the variance")
        style.title(figure, self.title, "lines: standard errors" + ("" if len(values) > 1 else f"; of {values[0]}"))
        if len(values) > 1:
            handles, labels = axes.get_legend_handles_labels()
            style.legend(figure, handles, labels)

    def header(self) -> list[str]:
        return ["curve", "path", "share", "standard error"]

    def rows(self) -> Iterator[Sequence[Any]]:
        yield from self.bars


def shares(sources: Sequence[Source], *, quantity: Sequence[str] = ()) -> Shares:
    """Build the first-order shares of the variance of computed values, a bar for each sampled path."""
    bars = []
    for source in sources:
        names = _listed(_table(source), "values")
        said = source.results.summary["statistics"].values()
        for name, one in zip(names, said, strict=False):
            if one["shares"] and (not quantity or name in quantity):
                bars += [(source.name(name), path, share, one["share_errors"][path])
                         for path, share in sorted(one["shares"].items(), key=lambda item: -item[1])]
    if not bars:
        raise ResultsError("there is no such share of the variance to draw")
    return Shares(common_title(sources), bars)


def _no_sweep(results: Results) -> str:
    missing = lacking("sweep", (), "it holds no sweep ('ancf2d sweep' writes sweep.h5)")(results)
    return missing or ("" if _listed(results.tables["sweep"], "values") else "no row of the sweep has a value")


def _no_samples(results: Results) -> str:
    return _no_sweep(results) or ("" if results.summary.get("statistics") else "its sweep has no samples (--sample)")


def _no_shares(results: Results) -> str:
    found = _no_samples(results)
    if found or any(one.get("shares") for one in results.summary["statistics"].values()):
        return found
    return "its sweep has too few samples, or values that do not vary, to tell shares of the variance"


SWEEP = Kind("sweep", "computed values of a sweep over one of the numbers that it varies", _no_sweep, sweep)
HISTOGRAM = Kind("histogram", "how often the samples of a sweep have a value", _no_samples, histogram)
SHARES = Kind("shares", "shares of the variance of a value that sampled numbers have", _no_shares, shares)
