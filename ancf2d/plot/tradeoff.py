"""Error against measured cost of many settings, and the front of those that no other beats."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.convergence import ROUND_OFF, groups_of, pareto
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results, Table

COSTS = {"wall_s": ("solve time", "s"), "dofs": ("nodal coordinates", "1"),
         "memory_bytes": ("memory of model and solution", "B")}
FRONT = {"color": "0.55", "linewidth": 6, "alpha": 0.4, "linestyle": "-", "marker": "", "drawstyle": "steps-post",
         "zorder": 1.5}
POINTS = {"linestyle": "none", "markersize": 3.5, "alpha": 0.55}
BOUNDS = {"linestyle": "none", "markerfacecolor": "none"}


def tradeoff(sources: Sequence[Source], *, against: str = "wall_s") -> Curves:
    """Build the error against ``wall_s``, ``dofs`` or ``memory_bytes``, a line per element type, and the front.

    The line of a motion joins what is best of a type; all else that was tried of it is small points. Errors of which
    only a bound is known are open symbols.
    """
    if against not in COSTS:
        raise ResultsError(f"cannot draw the error against '{against}' (known: {', '.join(COSTS)})")
    curves, bounds = [], False
    costs, errors = [], []
    for source in sources:
        table = source.results.tables["tradeoff"]
        for name, rows in groups_of(table).items():
            x, y, told = _points(table, rows, against)
            curves += _lines(source.name(name), x, y, told, several=np.ptp(_steps(table)) > 0)
            bounds |= not told.all()
            costs.append(x)
            errors.append(y)
    x, y = (np.concatenate(found) if found else np.zeros(0) for found in (costs, errors))
    if not len(x):
        raise ResultsError("the table of the study holds no error to draw")
    best = pareto(x, y)
    curves.append(Curve("Pareto front", x[best], y[best], look=dict(FRONT)))
    table = sources[0].results.tables["tradeoff"]
    panel = Panel(COSTS[against], (f"relative error of {table.attrs.get('goal', 'the goal')}", "1"), curves)
    return Curves(common_title(sources), _note(table, bounds), [panel], log_base=10, log_y=True)


def _steps(table: Table) -> np.ndarray:
    """Return a number (n,) for every combination of integrator and step."""
    names = [f"{m} {s}" for m, s in zip(table.get("method", ()), table.get("step", ()), strict=True)]
    return np.unique(names, return_inverse=True)[1] if names else np.zeros(1)


def _points(table: Table, rows: np.ndarray, against: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return cost, error or its bound, and whether it is the error, in the order of refinement."""
    rows = rows[np.argsort(np.asarray(table["elements"], float)[rows], kind="stable")]
    x, y, error = (np.asarray(table[name], float)[rows] for name in (against, "judged", "error"))
    keep = np.isfinite(y) & (x > 0)
    return x[keep], np.maximum(y[keep], ROUND_OFF), np.isfinite(error[keep])


def _lines(name: str, x: np.ndarray, y: np.ndarray, told: np.ndarray, several: bool) -> list[Curve]:
    """Return the curves of one type: what else was tried, bounds, and last, as it names them all, the line."""
    if not len(x):
        return []
    line = pareto(x, y) if several else np.arange(len(x))
    out = [Curve(name, x, y, look=dict(POINTS))] if several else []
    if not told.all():
        out.append(Curve(name, x[~told], y[~told], look=dict(BOUNDS)))
    line = line[told[line]]
    return [*out, Curve(name, x[line], y[line])] if len(line) else out


def _note(table: Table, bounds: bool) -> str:
    against = {"limit": "errors against each type's own limit",
               "continuum": "errors against each type's own limit, and its distance from the continuum",
               "reference": "errors against a given number"}
    words = [against.get(str(table.attrs.get("against")), "")]
    words += ["open symbols: upper bound of the error"] if bounds else []
    return "; ".join(word for word in words if word)


def _missing(results: Results) -> str:
    table = results.tables.get("tradeoff")
    if table is None or not {"element", "elements", "error", "judged", "wall_s"} <= set(table) or not table.rows:
        return "it holds no work-precision study ('ancf2d tradeoff CASE -o FILE.h5' writes one)"
    return ""


TRADEOFF = Kind("tradeoff", "error of the goal against measured time, memory or size, with the best settings marked",
                _missing, tradeoff)
