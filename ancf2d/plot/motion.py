"""The course of a run: energy, step sizes, and probe quantities against each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot import curves
from ancf2d.plot.curves import chosen_names, largest_magnitude, names_of, quantities_of
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.quantities import DISPLACEMENTS, KIND_OF, RATE_OF
from ancf2d.results import Results

# energies stored, lost and supplied: stored + lost - supplied is constant
STORED, LOST, SUPPLIED = ("kinetic", "strain", "potential"), ("dissipated",), ("work",)
NEGLIGIBLE = 1e-9  # relative to the largest energy: kinds that stay below are not drawn
MANY, THIN = 500, 0.8  # more steps than that are drawn in thin lines
ROUND_OFF = 1e-18  # smaller errors and violations count as zero, and would stretch the axis
BINS = 2000  # a curve with more than twice as many points is drawn by its extremes in this number of parts


def thinned(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a curve of many points reduced to the smallest and largest value in each of ``BINS`` parts, in order."""
    if len(y) <= 2 * BINS:
        return t, y
    edges = np.linspace(0, len(y), BINS + 1).astype(int)[:-1]
    low, high = np.fmin.reduceat(y, edges), np.fmax.reduceat(y, edges)
    last = np.append(edges[1:], len(y))
    rows = []
    for a, b, small, large in zip(edges, last, low, high, strict=True):
        part = y[a:b]
        found = {int(np.argmax(part == small)), int(np.argmax(part == large))} if small == small else {0}
        rows += [a + k for k in sorted(found)]
    chosen = np.unique([0, *rows, len(y) - 1])
    return t[chosen], y[chosen]


def _energies(results: Results) -> dict[str, np.ndarray]:
    return {name: results.energies[name] for name in (*STORED, *LOST, *SUPPLIED) if name in results.energies}


def balance(found: dict[str, np.ndarray]) -> np.ndarray:
    """Return the energy stored plus lost minus supplied, as its change since the start."""
    signs = {**dict.fromkeys((*STORED, *LOST), 1.0), **dict.fromkeys(SUPPLIED, -1.0)}
    total = np.sum([signs[name] * values for name, values in found.items()], axis=0)
    return total - total[0]


def _scale(found: dict[str, np.ndarray]) -> float:
    """Return the largest sum of kinetic and strain energy."""
    held = [found[name] for name in ("kinetic", "strain") if name in found]
    return float(np.max(np.sum(held, axis=0), initial=0.0)) if held else 0.0


def energy(sources: Sequence[Source]) -> Curves:
    """Build the energies over time, and below them the balance relative to the largest kinetic plus strain energy."""
    first = sources[0].results
    axis = ("time", first.units.time)
    kinds = Panel(axis, ("energy", f"{first.units.force}*{first.units.length}"))
    drift = Panel(axis, ("energy balance, relative", "1"))
    for source in sources:
        found = _energies(source.results)
        largest = max(float(np.abs(v).max(initial=0.0)) for v in found.values())
        t = source.results.t
        for name, values in found.items():
            if np.abs(values).max(initial=0.0) > NEGLIGIBLE * largest:
                kinds.curves.append(Curve(source.name(name), *thinned(t, values)))
        held = np.sum([v for name, v in found.items() if name in STORED], axis=0)
        kinds.curves.append(Curve(source.name("total"), *thinned(t, held)))
        share = balance(found) / (_scale(found) or 1.0)
        terms = ["total", *(f"{'+' if name in LOST else '-'} {name}" for name in found if name not in STORED)]
        drift.curves.append(Curve(source.name(" ".join(terms)), *thinned(t, share)))
    return Curves(common_title(sources), "", [kinds, drift], share="x")


def _step_panels(results: Results) -> Iterator[tuple[str, Panel, np.ndarray]]:
    """Yield the panels of load factors, step sizes, iterations, error and violation that have something to show."""
    history = results.history
    axis = ("time", results.units.time) if "t" in history else ("step", "1")
    known = (("factor", "load factor", "1"), ("dt", "step size", results.units.time), ("iterations", "iterations", "1"),
             ("error", "local error", "1"), ("violation", "constraint violation", "1"))
    for name, label, units in known:
        values = history.get(name)
        if values is None:
            continue
        if name in ("error", "violation"):
            values = np.where(values > ROUND_OFF, values, np.nan)
        positive = values[values > 0]
        if not positive.size and name != "factor":
            continue
        log = name in ("error", "violation") or (name == "dt" and positive.max() > 20 * positive.min())
        yield name, Panel(axis, (label, units), log=log, whole=name == "iterations"), values


def steps(sources: Sequence[Source]) -> Curves:
    """Build step sizes, Newton iterations, estimates of the local error and constraint violations over time.

    In statics, load factors and iterations over the number of the step.
    """
    panels: dict[str, Panel] = {}
    for source in sources:
        history = source.results.history
        t = history["t"] if "t" in history else history["step"]
        for name, own, values in _step_panels(source.results):
            panel = panels.setdefault(name, own)
            panel.log = panel.log or own.log
            looks = {"linewidth": THIN} if len(values) > MANY else {}
            panel.curves.append(Curve(source.name("") or "each step", *thinned(t, values.astype(float)), look=looks))
        _mark_rejected(source, panels)
    return Curves(common_title(sources), "", list(panels.values()), share="x")


def _mark_rejected(source: Source, panels: dict[str, Panel]) -> None:
    """Mark the steps that were repeated after a rejection, on the curves of load factors and step sizes."""
    history = source.results.history
    rejected = history.get("rejected")
    cut = history.get("cutbacks")
    if cut is not None and (cut > 0).any() and "factor" in panels:
        at = cut > 0
        mark = Curve(source.name("after a rejected step"), history["step"][at], history["factor"][at],
                     look={"marker": "x", "linestyle": "none"})
        panels["factor"].curves.append(mark)
    if rejected is not None and (rejected > 0).any() and "dt" in panels:
        at = rejected > 0
        mark = Curve(source.name("after a rejected step"), history["t"][at], history["dt"][at],
                     look={"marker": "x", "linestyle": "none"})
        panels["dt"].curves.append(mark)


def _no_energies(results: Results) -> str:
    if not results.energies:
        return "it holds no energies over time; only dynamic runs store them"
    return "" if results.nt > 1 else "it holds only one state"


def _no_steps(results: Results) -> str:
    if not ({"dt", "t"} <= set(results.history) or {"step", "factor"} <= set(results.history)):
        return "it holds no steps; only static and dynamic runs store them"
    return "" if results.history.rows > 1 else "it holds only one step"


ENERGY = Kind("energy", "energies over time, and the error of their balance (dynamic)", _no_energies, energy)
STEPS = Kind("steps", "step sizes, iterations and local errors over time, or load steps", _no_steps, steps)


RATES = {name: RATE_OF[name] for name in DISPLACEMENTS}


def _words(name: str) -> str:
    """Return a quantity in words, with its name if there are two of its kind."""
    return f"{KIND_OF[name]} {name}" if name[-1] in "xy" else KIND_OF[name]


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
        for name in chosen_names(names_of(probe), list(probes), "probe", source.results.called) or list(probes):
            columns = probes[name]
            top = max((largest_magnitude(columns[q]) for q in ("ux", "uy") if q in columns), default=0.0)
            for q in asked or RATES:
                rate = RATES[q]
                small = rate in columns and largest_magnitude(columns[q]) <= curves.NEGLIGIBLE * top
                if rate not in columns or (small and not asked and q != "theta"):
                    continue
                axes = ((_words(q), columns.units.get(q, "")), (_words(rate), columns.units.get(rate, "")))
                panel = panels.setdefault(q, Panel(*axes))
                panel.curves += _line(source.name(name), columns[q], columns[rate])
    return Curves(common_title(sources), "", list(panels.values()), share="")


def trajectory(sources: Sequence[Source], *, probe: str | Sequence[str] | None = None) -> Curves:
    """Build the paths of the probes in the plane; a ring marks the start, a square the end."""
    length = sources[0].results.units.length
    panel = Panel(("x", length), ("y", length), equal=True)
    for source in sources:
        probes = source.results.probes
        for name in chosen_names(names_of(probe), list(probes), "probe", source.results.called) or list(probes):
            if {"x", "y"} <= set(probes[name]):
                panel.curves += _line(source.name(name), probes[name]["x"], probes[name]["y"])
    return Curves(common_title(sources), "", [panel], share="x")


def _line(name: str, x: np.ndarray, y: np.ndarray) -> list[Curve]:
    """Return a line with a ring at its start and a filled square at its end; each has one entry in the legend."""
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
