"""Probe quantities against each other: phase portraits and trajectories."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.curves import NEGLIGIBLE, chosen_names, names_of, quantities_of
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results

RATES = {"ux": "vx", "uy": "vy", "theta": "omega"}
WORDS = {"ux": "displacement ux", "uy": "displacement uy", "theta": "rotation", "vx": "velocity vx",
         "vy": "velocity vy", "omega": "angular velocity"}


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


def phase(sources: Sequence[Source], *, probe: str | Sequence[str] | None = None,
          quantity: str | Sequence[str] | None = None) -> Curves:
    """Build each displacement or rotation of the probes against its rate; a ring marks the start, a square the end."""
    asked = quantities_of(quantity)
    for name in asked:
        if name not in RATES:
            raise ResultsError(f"phase draws {', '.join(RATES)} against their rates, not '{name}'")
    panels: dict[str, Panel] = {}
    for source in sources:
        probes = source.results.probes
        for name in chosen_names(names_of(probe), list(probes), "probe", source.results.path) or list(probes):
            columns = probes[name]
            top = max((_largest(columns[q]) for q in ("ux", "uy") if q in columns), default=0.0)
            for q in asked or RATES:
                rate = RATES[q]
                if rate not in columns or (not asked and q != "theta" and _largest(columns[q]) <= NEGLIGIBLE * top):
                    continue
                axes = ((WORDS[q], columns.units.get(q, "")), (WORDS[rate], columns.units.get(rate, "")))
                panel = panels.setdefault(q, Panel(*axes))
                panel.curves += _line(source.name(name), columns[q], columns[rate])
    return Curves(common_title(sources), "", list(panels.values()), share="")


def trajectory(sources: Sequence[Source], *, probe: str | Sequence[str] | None = None) -> Curves:
    """Build the paths of the probes in the plane; a ring marks the start, a square the end."""
    length = sources[0].results.units.length
    panel = Panel(("x", length), ("y", length), equal=True)
    for source in sources:
        probes = source.results.probes
        for name in chosen_names(names_of(probe), list(probes), "probe", source.results.path) or list(probes):
            if {"x", "y"} <= set(probes[name]):
                panel.curves += _line(source.name(name), probes[name]["x"], probes[name]["y"])
    return Curves(common_title(sources), "", [panel], share="x")


def _line(name: str, x: np.ndarray, y: np.ndarray) -> list[Curve]:
    """Return a line with a ring at its start and a filled square at its end; both have one entry in the legend."""
    ring = {"marker": "o", "markersize": 7, "markerfacecolor": "none", "markeredgewidth": 1.4, "linestyle": "none"}
    square = {"marker": "s", "markersize": 6, "linestyle": "none"}
    return [Curve(name, x, y, look={"marker": ""}), Curve(name, x[:1], y[:1], look={**ring, "label": "start"}),
            Curve(name, x[-1:], y[-1:], look={**square, "label": "end"})]


def _no_rates(results: Results) -> str:
    if any({q, RATES[q]} <= set(p) for p in results.probes.values() for q in RATES):
        return "" if len(results.probe_t) > 1 else "its probes hold only one value"
    return "it holds no probes with velocities; only dynamic runs store them"


def _no_paths(results: Results) -> str:
    if not any({"x", "y"} <= set(p) for p in results.probes.values()):
        return "it holds no probes (name some under output: probes: in the case)"
    return "" if len(results.probe_t) > 1 else "its probes hold only one value"


PHASE = Kind("phase", "displacements and rotations of probes against their rates (dynamic)", _no_rates, phase)
TRAJECTORY = Kind("trajectory", "paths of the probes in the plane", _no_paths, trajectory)
