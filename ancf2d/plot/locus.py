"""Eigenvalues of small motions over the load factor: where they grow, by flutter or divergence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results

POINTS = {"linestyle": "none", "marker": ".", "markersize": 3, "markevery": 1}
# frequencies beyond this multiple of the highest critical one are not drawn
HIGHEST = 6.0
CRITICAL = {"linestyle": "none", "marker": "o", "markersize": 6, "markerfacecolor": "none", "markevery": 1}


def root_locus(sources: Sequence[Source]) -> Curves:
    """Build the parts of the eigenvalues over the load factor; rings mark where motions begin to grow."""
    time = sources[0].results.units.time
    omega = Panel(("load factor", "1"), ("frequency omega", f"rad/{time}"))
    growth = Panel(("load factor", "1"), ("growth rate", f"1/{time}"), zero=True)
    for source in sources:
        table, modes = source.results.tables["locus"], source.results.tables["modes"]
        told = np.asarray(table["omega"], float)
        top = HIGHEST * float(np.max(modes["omega"], initial=0.0))
        near = told <= (top or np.inf)
        factor = np.asarray(table["factor"], float)[near]
        for panel, column in ((omega, "omega"), (growth, "growth")):
            panel.curves.append(Curve(source.name("eigenvalues"), factor, np.asarray(table[column], float)[near],
                                      look=dict(POINTS)))
        at = np.asarray(modes["load_factor"], float)
        omega.curves.append(Curve(source.name("critical"), at, np.asarray(modes["omega"], float), look=dict(CRITICAL),
                                  texts=[f"{kind} {f:.5g}" for kind, f in zip(modes["instability"], at, strict=True)]))
        growth.curves.append(Curve(source.name("critical"), at, np.zeros(len(at)), look=dict(CRITICAL)))
    return Curves(common_title(sources), "", [omega, growth])


def _missing(results: Results) -> str:
    return "" if "locus" in results.tables else "it follows no eigenvalues over a load (buckling under follower loads)"


ROOT_LOCUS = Kind("root_locus", "eigenvalues over the load factor, with flutter and divergence", _missing, root_locus)
