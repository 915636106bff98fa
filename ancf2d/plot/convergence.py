"""A goal or its error against the number of elements, with the observed order, and against measured cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, Triangle, common_title, lacking
from ancf2d.results import Results, Table

ROUND_OFF = 1e-16  # an error of exactly zero is drawn at this value
SUSPECT = 1e-7  # an error below this that no longer falls is round-off
LEVEL = 0.05  # an order below this counts as none: the error does not fall
COUNTS = {"elements": "number of elements", "dofs": "nodal coordinates", "wall_s": "wall time"}
COSTS = {"wall_s": ("solve time", "s"), "dofs": ("nodal coordinates", "1"),
         "memory_bytes": ("memory of model and solution", "B")}
FRONT = {"color": "0.55", "linewidth": 6, "alpha": 0.4, "linestyle": "-", "marker": "", "drawstyle": "steps-post",
         "zorder": 1.5}
POINTS = {"linestyle": "none", "markersize": 3.5, "alpha": 0.55}
BOUNDS = {"linestyle": "none", "markerfacecolor": "none"}


def observed_order(n: np.ndarray, error: np.ndarray) -> float:
    """Return -d log(error) / d log(n) of the last refinement before round-off stops it; else NaN.

    Refinements count from the largest error on, while the error does not grow and stays above 1e-13. NaN also if the
    error stagnates at a size above round-off.
    """
    order = np.nan
    start = int(np.argmax(error)) if len(error) else 0
    for k in range(start + 1, len(n)):
        if not (error[k - 1] >= error[k] > 1e-13):
            break
        found = np.log(error[k - 1] / error[k]) / np.log(n[k] / n[k - 1])
        if found < LEVEL and error[k] < SUSPECT:
            break
        order = found
    return float(order) if order >= LEVEL else np.nan


def pareto(work: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return the Pareto-optimal points (n,), which no other beats in both work and error, in order of work."""
    order = np.lexsort((error, work))
    best = np.minimum.accumulate(error[order])
    first = np.append(True, best[1:] < best[:-1])
    return order[first]


def groups_of(table: Table) -> dict[str, np.ndarray]:
    """Return the rows of each element type, or of each formulation of a type if there are several."""
    elements = [str(e) for e in table["element"]]
    formulations = [str(f) for f in table.get("formulation", [""] * len(elements))]
    several = {e for e in elements
               if len({f for e2, f in zip(elements, formulations, strict=True) if e2 == e}) > 1}
    names = [f"{e} ({f})" if e in several else e
             for e, f in zip(elements, formulations, strict=True)]
    return {name: np.flatnonzero([n == name for n in names]) for name in dict.fromkeys(names)}


def convergence(sources: Sequence[Source], *, against: str = "elements", values: bool = False) -> Curves:
    """Build the error against ``elements``, ``dofs`` or ``wall_s``, with a line for each element type.

    ``values`` draws the goal itself instead of its error.
    """
    if against not in COUNTS:
        raise ResultsError(f"cannot draw {'the goal' if values else 'the error'} against '{against}' "
                           f"(known: {', '.join(COUNTS)})")
    column = "value" if values else "error"
    curves, zeros = [], False
    orders: dict[int, Triangle] = {}
    for source in sources:
        table = source.results.tables["convergence"]
        for needed in (against, column):
            if needed not in table:
                raise ResultsError(f"the table of {source.results.called} has no column '{needed}'")
        groups = groups_of(table)
        for name, rows in groups.items():
            x, y = _points(table, rows, against, column)
            zeros |= not values and bool((y == 0).any())
            note, order = "", observed_order(x, y)
            if not values and against != "wall_s":
                judged = _asymptotic(source, table, rows)
                note = _order_note(order) + (", not asymptotic" if judged is False and not np.isnan(order) else "")
                if judged is not False and order >= 0.5 and against == "elements" and round(order) not in orders:
                    # one after the other from the finest mesh on, so that they do not cover each other
                    k = max(len(x) - 2 - len(orders), 0)
                    orders[round(order)] = Triangle((float(x[k]), float(x[k + 1])), float(y[k]), round(order))
            # the line is named after its file alone if the file has only this one
            label = source.label if source.label and len(groups) == 1 else source.name(name)
            curves.append(Curve(label, x, y if values else np.maximum(y, ROUND_OFF), note))
    if not any(len(c.x) for c in curves):
        raise ResultsError(f"the convergence table holds no finite {column} to draw")
    panel = Panel((COUNTS[against], "s" if against == "wall_s" else "1"), _y_axis(sources, column), curves,
                  triangles=list(orders.values())[:3])
    notes = [] if values else [_against(sources)]
    notes += [f"errors of zero are drawn at {ROUND_OFF:g}"] if zeros else []
    return Curves(common_title(sources), "; ".join(n for n in notes if n), [panel],
                  log_base=2 if against == "elements" else 10, log_y=not values)


def work_precision(sources: Sequence[Source]) -> Curves:
    """Build the error against the measured time, with a line for each element type and the Pareto front."""
    curves = []
    for source in sources:
        table = source.results.tables["convergence"]
        for name, rows in groups_of(table).items():
            x, y = _points(table, rows, "wall_s", "error")
            curves.append(Curve(source.name(name), x, y))
    curves = [Curve(c.name, c.x, np.maximum(c.y, ROUND_OFF), c.note) for c in curves if len(c.x)]
    if not curves:
        raise ResultsError("the convergence table holds no finite error to draw")
    x, y = (np.concatenate([getattr(c, k) for c in curves]) for k in ("x", "y"))
    front = pareto(x, y)
    curves.append(Curve("best for their time", x[front], y[front],
                        look={**FRONT, "linewidth": 5, "alpha": 0.45}))
    panel = Panel(("wall time", "s"), _y_axis(sources, "error"), curves)
    return Curves(common_title(sources), _against(sources), [panel], log_base=10, log_y=True)


def _points(table: Table, rows: np.ndarray, against: str, column: str, *more: str) -> list[np.ndarray]:
    """Return x, y and more columns of one line in the order of refinement, without the meshes that failed."""
    rows = rows[np.argsort(np.asarray(table["elements"], float)[rows], kind="stable")]
    found = [np.asarray(table[name], float)[rows] for name in (against, column, *more)]
    known = np.isfinite(found[1]) & (found[0] > 0)
    return [values[known] if column == "value" else np.abs(values[known]) for values in found]


def _common_attribute(sources: Sequence[Source], name: str) -> str:
    """Return an attribute of the tables if all files have the same value, else an empty text."""
    found = {str(s.results.tables["convergence"].attrs.get(name, "")) for s in sources}
    return found.pop() if len(found) == 1 else ""


def _y_axis(sources: Sequence[Source], column: str) -> tuple[str, str]:
    goal = _common_attribute(sources, "goal")
    if column == "error":
        return (f"relative error of {goal}" if goal else "relative error"), "1"
    units = {s.results.tables["convergence"].units.get("value", "1") for s in sources}
    if len(units) > 1:
        raise ResultsError(f"the goals of the files have different units: {', '.join(sorted(units))}")
    return goal or "goal", units.pop()


def _against(sources: Sequence[Source]) -> str:
    """Return the reference of the errors in words."""
    reference = _common_attribute(sources, "reference")
    if not reference:
        return ""
    return "errors against each type's own limit" if reference == "auto" else f"errors against {reference}"


def _asymptotic(source: Source, table: Table, rows: np.ndarray) -> bool | None:
    """Return whether the study found a type's errors to fall at the theoretical order; None if it does not say."""
    for found in source.results.summary.get("elements") or ():
        if isinstance(found, dict) and all(str(found.get(key)) == str(table[key][rows[0]])
                                           for key in ("element", "formulation") if key in table):
            return found.get("asymptotic")
    return None


def _order_note(order: float) -> str:
    return ", order undefined" if np.isnan(order) else f", order {order:.1f}"


_no_table = lacking("convergence", ("element", "elements", "error"),
                    "it holds no convergence table ('ancf2d convergence CASE -o FILE.h5' writes one)")


def _no_times(results: Results) -> str:
    missing = _no_table(results)
    return missing or ("" if "wall_s" in results.tables["convergence"] else "its table holds no measured times")


WORK_PRECISION = Kind("work_precision", "error of the goal against the measured time, with the best of all marked",
                      _no_times, work_precision)
CONVERGENCE = Kind("convergence", "error of the goal, or its values, against the number of elements",
                   _no_table, convergence)


def tradeoff(sources: Sequence[Source], *, against: str = "wall_s") -> Curves:
    """Build the error against ``wall_s``, ``dofs`` or ``memory_bytes``: a line for each element type, and the front.

    The line of a motion connects the best settings of a type; the other settings are small points. Errors of which only
    a bound is known are open symbols.
    """
    if against not in COSTS:
        raise ResultsError(f"cannot draw the error against '{against}' (known: {', '.join(COSTS)})")
    curves, bounds = [], False
    costs, errors = [], []
    for source in sources:
        table = source.results.tables["tradeoff"]
        for name, rows in groups_of(table).items():
            x, y, error = _points(table, rows, against, "judged", "error")
            y, exact = np.maximum(y, ROUND_OFF), np.isfinite(error)
            curves += _lines(source.name(name), x, y, exact, several=np.ptp(_steps(table)) > 0)
            bounds |= not exact.all()
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


def _lines(name: str, x: np.ndarray, y: np.ndarray, exact: np.ndarray, several: bool) -> list[Curve]:
    """Return the curves of one type: other settings, bounds, and last the line, which gives the legend its look."""
    if not len(x):
        return []
    line = pareto(x, y) if several else np.arange(len(x))
    out = [Curve(name, x, y, look=dict(POINTS))] if several else []
    if not exact.all():
        out.append(Curve(name, x[~exact], y[~exact], look=dict(BOUNDS)))
    line = line[exact[line]]
    return [*out, Curve(name, x[line], y[line])] if len(line) else out


def _note(table: Table, bounds: bool) -> str:
    against = {"limit": "errors against each type's own limit",
               "continuum": "errors against each type's own limit, and its distance from the continuum",
               "reference": "errors against a given number"}
    words = [against.get(str(table.attrs.get("against")), "")]
    words += ["open symbols: upper bound of the error"] if bounds else []
    return "; ".join(word for word in words if word)


TRADEOFF = Kind("tradeoff", "error of the goal against measured time, memory or size, with the best settings marked",
                lacking("tradeoff", ("element", "elements", "error", "judged", "wall_s"),
                        "it holds no work-precision study ('ancf2d tradeoff CASE -o FILE.h5' writes one)"),
                tradeoff, single=True)
