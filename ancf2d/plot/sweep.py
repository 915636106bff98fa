"""The rows of a sweep over what it varied; histograms of samples, and shares of the variance."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results, Table

# lines, and values in panels, of one figure; what is more is hard to read
MAX_CURVES, MAX_PANELS = 12, 6
# ends of an axis whose ratio is more than this, with values in equal ratios, are drawn on a logarithmic one
DECADES = 30.0
POINTS = {"linestyle": "none", "marker": "o", "markersize": 3.0, "alpha": 0.7, "markevery": 1}
OUTLINE = {"drawstyle": "steps-post", "marker": "", "linewidth": 1.6}


def _listed(table: Table, name: str) -> list[str]:
    """Return the names of columns that an attribute of the table lists."""
    return [str(v) for v in json.loads(str(table.attrs.get(name, "[]"))) if v in table]


def _table(source: Source) -> Table:
    return source.results.tables["sweep"]


def _values(sources: Sequence[Source], wanted: Sequence[str]) -> list[str]:
    """Return the computed values to draw, those wanted or all. Raises ResultsError for one that is not there."""
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
    """Return the path on the horizontal axis: the one asked for, or the one with most values."""
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
    """Build computed values over one varied number, a line for each combination of all others, or a point each.

    ``over`` is the path, or the end of one; ``quantity`` the values as their columns are called.
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
    """Return the rows of each line with the name of it, which tells what else is varied."""
    others = [p for p in _listed(table, "paths") if p != path]
    # where no value repeats, lists ran together
    if sampled or not others or len(np.unique(table[path])) == table.rows:
        return [("", np.arange(table.rows))]
    shown = [[f"{v:g}" if isinstance(v, float | np.floating) else str(v) for v in table[p]] for p in others]
    ends = [p.rpartition(".")[2] for p in others]
    ends = ends if len(set(ends)) == len(ends) else others
    names = [", ".join(f"{end} = {v}" for end, v in zip(ends, row, strict=True)) for row in zip(*shown, strict=True)]
    return [(name, np.flatnonzero([n == name for n in names])) for name in dict.fromkeys(names)]


def histogram(sources: Sequence[Source], *, quantity: Sequence[str] = ()) -> Curves:
    """Build how often samples have a value: counts in bins of one width, by the rule of Freedman and Diaconis."""
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
    """Bars: ``rows`` are (value, path, share, standard error)."""

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


def _missing(results: Results) -> str:
    table = results.tables.get("sweep")
    if table is None or not table.rows:
        return "it holds no sweep ('ancf2d sweep' writes sweep.h5)"
    return "" if _listed(table, "values") else "no row of the sweep has a value"


def _no_samples(results: Results) -> str:
    return _missing(results) or ("" if results.summary.get("statistics") else "its sweep has no samples (--sample)")


def _no_shares(results: Results) -> str:
    found = _no_samples(results)
    if found or any(one.get("shares") for one in results.summary["statistics"].values()):
        return found
    return "its sweep has too few samples, or values that do not vary, to tell shares of the variance"


SWEEP = Kind("sweep", "computed values of a sweep over one of the numbers that it varies", _missing, sweep)
HISTOGRAM = Kind("histogram", "how often the samples of a sweep have a value", _no_samples, histogram)
SHARES = Kind("shares", "shares of the variance of a value that sampled numbers have", _no_shares, shares)
