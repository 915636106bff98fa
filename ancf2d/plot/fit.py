"""Measured data, the case fitted to them, and what is left between the two."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results, Table

AXES = {"t": "time", "factor": "load factor", "hz": "frequency"}
POINTS = {"linestyle": "none", "marker": "o", "markersize": 3.0, "markevery": 1, "alpha": 0.7}
MODEL = {"linestyle": "-", "marker": ""}
# columns of one figure: each has two panels
MAX_COLUMNS = 4


def _columns(table: Table) -> list[str]:
    return [name.removeprefix("data ") for name in table if name.startswith("data ")]


def fit(sources: Sequence[Source], *, quantity: Sequence[str] = ()) -> Curves:
    """Build data and model of each measured column, with the differences of the two below.

    ``quantity`` are the columns to draw, as the data name them.
    """
    first = sources[0].results.tables["fitted"]
    axis = next(name for name in AXES if name in first)
    known = _columns(first)
    for name in quantity:
        if name not in known:
            raise ResultsError(f"no column '{name}' was fitted (there are {', '.join(known)})")
    panels: list[Panel] = []
    for name in (list(quantity) or known)[:MAX_COLUMNS]:
        units = first.units.get(f"data {name}", "1")
        pair = (Panel((AXES[axis], first.units.get(axis, "1")), (name, units)),
                Panel((AXES[axis], first.units.get(axis, "1")), ("data - model", units), zero=True))
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


def _missing(results: Results) -> str:
    held = {"fit", "fitted"} <= set(results.tables)
    return "" if held else "it holds no fit ('ancf2d fit CASE --data FILE.csv' writes one)"


FIT = Kind("fit", "measured data and the case fitted to them, with the differences", _missing, fit)
