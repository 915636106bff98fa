"""Eigenvalues over a load factor (root locus), and over the speed of a steady rotation (Campbell's diagram)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import yaml

from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results

# excitation once, twice and three times a turn
ORDERS = (1, 2, 3)
EXCITATION = {"color": "0.55", "linestyle": "--", "linewidth": 0.9, "marker": ""}
POINTS = {"linestyle": "none", "marker": ".", "markersize": 3, "markevery": 1}
# frequencies beyond this multiple of the highest critical one are not drawn
HIGHEST = 6.0
CRITICAL = {"linestyle": "none", "marker": "o", "markersize": 6, "markerfacecolor": "none", "markevery": 1}


def speed(results: Results) -> float:
    """Return the angular velocity of the steady rotation of a file's case, 0 without one [rad/time]."""
    turning = yaml.safe_load(results.case_completed).get("steady_rotation")
    return float(turning["omega"]) if turning else 0.0


def campbell(sources: Sequence[Source]) -> Curves:
    """Build a line for each mode, known by its kind and number, over the speeds of the files."""
    time = sources[0].results.units.time
    panel = Panel(("speed of rotation", f"rad/{time}"), ("frequency omega", f"rad/{time}"))
    lines: dict[str, list[tuple[float, float]]] = {}
    for at, results in sorted(((speed(s.results), s.results) for s in sources), key=lambda pair: pair[0]):
        modes = results.tables["modes"]
        for kind, number, omega in zip(modes["kind"], modes["number"], modes["omega"], strict=True):
            lines.setdefault(f"{kind} {number}", []).append((at, float(omega)))
    for name, points in lines.items():
        x, y = np.array(points).T
        panel.curves.append(Curve(name, x, y))
    speeds, top = [x for points in lines.values() for x, _ in points], max(y for p in lines.values() for _, y in p)
    for order in ORDERS:
        end = min(max(map(abs, speeds)), top / order)
        panel.curves.append(Curve(f"{order} per turn", np.array([0.0, end]), np.array([0.0, order * end]),
                                  look=dict(EXCITATION), texts=["", f"{order}x"]))
    return Curves(common_title(sources), "", [panel])


def _no_speed(results: Results) -> str:
    if "modes" not in results.tables or "omega" not in results.tables["modes"]:
        return "it has no frequencies (solver eigen)"
    return "" if speed(results) else "it has no steady_rotation (ancf2d sweep writes a file for each speed)"


CAMPBELL = Kind("campbell", "frequencies over the speed of rotation, a file for each speed", _no_speed, campbell)


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


def _no_locus(results: Results) -> str:
    return "" if "locus" in results.tables else "it follows no eigenvalues over a load (buckling under follower loads)"


ROOT_LOCUS = Kind("root_locus", "eigenvalues over the load factor, with flutter and divergence", _no_locus, root_locus)
