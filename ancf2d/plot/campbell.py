"""Frequencies over the speed of a steady rotation (Campbell's diagram), one result file for each speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import yaml

from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results

# excitation once, twice and three times a turn
ORDERS = (1, 2, 3)
EXCITATION = {"color": "0.55", "linestyle": "--", "linewidth": 0.9, "marker": ""}


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


def _missing(results: Results) -> str:
    if "modes" not in results.tables or "omega" not in results.tables["modes"]:
        return "it has no frequencies (solver eigen)"
    return "" if speed(results) else "it has no steady_rotation (ancf2d sweep writes a file for each speed)"


CAMPBELL = Kind("campbell", "frequencies over the speed of rotation, a file for each speed", _missing, campbell)
