"""Influence of numbers on the goal, the course of an optimisation, and measured data beside the fitted case."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ancf2d.errors import ResultsError
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results, Table

NEEDED = {"path", "value", "derivative", "influence"}
# of its size: the change of each number that the bars show
CHANGE = 0.01
FIRST = ("evaluation", "minimised", "missed")
FITTED_OVER = {"t": "time", "factor": "load factor", "hz": "frequency"}
POINTS = {"linestyle": "none", "marker": "o", "markersize": 3.0, "markevery": 1, "alpha": 0.7}
MODEL = {"linestyle": "-", "marker": ""}
# columns of one figure: each has two panels
MAX_COLUMNS = 4


@dataclass
class Tornado:
    """The picture: for each number its path, its value and the change of the goal (n,) where it grows by 1 %."""

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
        """Draw a bar for each number, the longest above."""
        axes = figure.add_subplot()
        places = np.arange(len(self.paths))
        colours = np.where(self.changes < 0, "#c1503a", "#1f5fa8")
        axes.barh(places, self.changes, color=colours.tolist(), height=0.7)
        axes.axvline(0.0, color="0.3", linewidth=0.8)
        axes.set_yticks(places, [f"{p} = {v:.6g}" for p, v in zip(self.paths, self.values.tolist(), strict=True)])
        axes.set_ylim(len(self.paths) - 0.4, -0.6)
        axes.grid(axis="y", visible=False)
        unit = "" if self.units in ("1", "") else f" [{self.units}]"
        # the power of ten of the ticks stands to the right
        axes.set_xlabel(f"change of {self.goal}{unit} by +{CHANGE:.0%} of a number", loc="left")
        note = f"{self.left_out} less influential numbers are left out" if self.left_out else ""
        axes.set_title("\n".join(t for t in (self.title, note) if t))

    def header(self) -> list[str]:
        """Return the names of the data's columns."""
        return ["path", "value", f"change of {self.goal} [{self.units}]"]

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield the rows of the data that are drawn."""
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


def _no_tornado(results: Results) -> str:
    table = results.tables.get("sensitivity")
    if table is None or not set(table) >= NEEDED or not table.rows:
        return "it holds no table of sensitivities ('ancf2d sensitivity CASE -o FILE.h5' writes one)"
    return ""


TORNADO = Kind("tornado", "how much the goal changes with each number of the case, the most influential ones first",
               _no_tornado, tornado, single=True)


def optimisation(sources: Sequence[Source]) -> Curves:
    """Build what is minimised, the excess of constraints where there are some, and each number beside its start."""
    table = sources[0].results.tables["optimisation"]
    n = np.asarray(table["evaluation"], float)
    what = str(table.attrs.get("minimise", "what is minimised"))
    panels = [Panel(("evaluation", "1"), (what, "1"), [Curve(what, n, np.asarray(table["minimised"], float))])]
    if table.attrs.get("constrained"):
        missed = Curve("excess", n, np.asarray(table["missed"], float))
        panels.append(Panel(("evaluation", "1"), ("largest excess of a constraint", "1"), [missed]))
    numbers = [Curve(name, n, _beside(np.asarray(values, float))) for name, values in table.items()
               if name not in FIRST]
    panels.append(Panel(("evaluation", "1"), ("numbers beside their start", "1"), numbers))
    return Curves(common_title(sources), "", panels)


def _beside(values: np.ndarray) -> np.ndarray:
    """Return values divided by the first one, by the largest where that is 0."""
    return values / (values[0] or np.abs(values).max() or 1.0)


def _no_optimisation(results: Results) -> str:
    table = results.tables.get("optimisation")
    if table is None or not set(FIRST) <= set(table) or not table.rows:
        return "it holds no optimisation ('ancf2d optimise CASE ... --history FILE.h5' writes one)"
    return ""


OPTIMISATION = Kind("optimisation", "what is minimised, constraints and numbers over all tries", _no_optimisation,
                    optimisation, single=True)


def _columns(table: Table) -> list[str]:
    return [name.removeprefix("data ") for name in table if name.startswith("data ")]


def fit(sources: Sequence[Source], *, quantity: Sequence[str] = ()) -> Curves:
    """Build data and model of each measured column, with the differences of the two below.

    ``quantity`` are the columns to draw, as the data name them.
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
                raise ResultsError(f"'{source.results.path}' has no column '{name}' over {axis}")
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
    ends = [str(path).rpartition(".")[2] for path in table["path"]]
    return ", ".join(f"{end} = {value:.5g}" + (f" +- {error:.1g}" if np.isfinite(error) else "") for end, value, error
                     in zip(ends, table["value"], table["standard_error"], strict=True))


def _no_fit(results: Results) -> str:
    held = {"fit", "fitted"} <= set(results.tables)
    return "" if held else "it holds no fit ('ancf2d fit CASE --data FILE.csv' writes one)"


FIT = Kind("fit", "measured data and the case fitted to them, with the differences", _no_fit, fit, single=True)
