"""Error against the number of elements, with the observed order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source
from ancf2d.results import Results, Table

ROUND_OFF = 1e-16  # where an error of exactly zero is drawn
COUNTS = {"elements": "number of elements", "dofs": "nodal coordinates", "wall_s": "wall time"}


def observed_order(n: np.ndarray, error: np.ndarray) -> float:
    """Return -d log(error) / d log(n) of the last refinement before round-off stops it; else NaN.

    Refinements count from the largest error on, while the error shrinks and stays above 1e-13.
    """
    order = np.nan
    start = int(np.argmax(error)) if len(error) else 0
    for k in range(start + 1, len(n)):
        if not (error[k - 1] > error[k] > 1e-13):
            break
        order = np.log(error[k - 1] / error[k]) / np.log(n[k] / n[k - 1])
    return float(order)


def _groups(table: Table) -> dict[str, np.ndarray]:
    """Return the rows of each element type; formulations tell apart what the type does not."""
    elements = [str(e) for e in table["element"]]
    formulations = [str(f) for f in table.get("formulation", [""] * len(elements))]
    several = {e for e in elements
               if len({f for e2, f in zip(elements, formulations, strict=True) if e2 == e}) > 1}
    names = [f"{e} ({f})" if e in several else e
             for e, f in zip(elements, formulations, strict=True)]
    return {name: np.flatnonzero([n == name for n in names]) for name in dict.fromkeys(names)}


def convergence(sources: Sequence[Source], *, against: str = "elements") -> Curves:
    """Build error against ``elements``, ``dofs`` or ``wall_s``, a line per element type."""
    if against not in COUNTS:
        raise ResultsError(f"cannot draw the error against '{against}' "
                           f"(known: {', '.join(COUNTS)})")
    units = "s" if against == "wall_s" else "1"
    panel, zeros = Panel((COUNTS[against], units), ("relative error", "1")), False
    for source in sources:
        table = source.results.tables["convergence"]
        if against not in table:
            raise ResultsError(f"the table of '{source.results.path}' has no column '{against}'")
        for name, rows in _groups(table).items():
            rows = rows[np.argsort(np.asarray(table[against], float)[rows], kind="stable")]
            x = np.asarray(table[against], float)[rows]
            error = np.abs(np.asarray(table["error"], float)[rows])
            keep = np.isfinite(error) & (x > 0)
            x, error = x[keep], error[keep]
            zeros |= bool((error == 0).any())
            note = "" if against == "wall_s" else _order_note(observed_order(x, error))
            panel.curves.append(Curve(source.name(name), x, np.maximum(error, ROUND_OFF), note))
    if not any(len(c.x) for c in panel.curves):
        raise ResultsError("the convergence table holds no finite error to draw")
    note = f"errors of zero are drawn at {ROUND_OFF:g}" if zeros else ""
    return Curves(sources[0].results.title, note, [panel],
                  log_base=2 if against == "elements" else 10)


def _order_note(order: float) -> str:
    return ", order undefined" if np.isnan(order) else f", order {order:.1f}"


def _no_table(results: Results) -> str:
    table = results.tables.get("convergence")
    if table is None or not {"element", "elements", "error"} <= set(table) or not table.rows:
        return "it holds no convergence table ('ancf2d convergence CASE -o FILE.h5' writes one)"
    return ""


CONVERGENCE = Kind("convergence", "error against the number of elements, with observed orders",
                   _no_table, convergence)
