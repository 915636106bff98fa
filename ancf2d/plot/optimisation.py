"""How an optimisation went: what is minimised, how far constraints are missed, and the numbers, over all tries."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results

FIRST = ("evaluation", "minimised", "missed")


def optimisation(sources: Sequence[Source]) -> Curves:
    """Build what is minimised, the excess of constraints where there are some, and each number beside its start."""
    if len(sources) > 1:
        raise ResultsError("a figure of an optimisation is of one file")
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


def _missing(results: Results) -> str:
    table = results.tables.get("optimisation")
    if table is None or not set(FIRST) <= set(table) or not table.rows:
        return "it holds no optimisation ('ancf2d optimise CASE ... --history FILE.h5' writes one)"
    return ""


OPTIMISATION = Kind("optimisation", "what is minimised, constraints and numbers over all tries", _missing, optimisation)
