"""Lines over time and load: probes, load against deflection, moment against curvature, stress against strain."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.body import how_to_store, no_states
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.quantities import KIND_OF
from ancf2d.results import FieldRecord, Results
from ancf2d.results.geometry import station_weights

FAMILIES = {
    **{name: kind for name, kind in KIND_OF.items() if kind not in ("force", "moment")},
    "N": "axial force", "Q": "shear force", "M": "bending moment",
    "output": "controller output",
}
EVENT_LINES = {"color": "0.5", "marker": "", "linestyle": ":", "linewidth": 1.0, "zorder": 1}
WINDOW = {"color": "black", "marker": "", "linestyle": "-", "linewidth": 1.0}
LIMIT = {"color": "black", "marker": "o", "markersize": 7, "markerfacecolor": "none", "markeredgewidth": 1.3,
         "linestyle": "none", "zorder": 5}
# points passed along a path: their key in the summary, name in the legend, and marker
EVENTS = {"limit_points": ("limit points", LIMIT), "bifurcations": ("bifurcations", {**LIMIT, "marker": "D"})}
MOST_EVENTS = 40  # largest number drawn
NEGLIGIBLE = 1e-6  # relative to the largest of its family: smaller quantities are drawn only on request


def names_of(value: str | Sequence[str] | None) -> list[str]:
    """Return the names in an option, a sequence or a text with commas between them."""
    if value is None:
        return []
    return value.replace(",", " ").split() if isinstance(value, str) else list(value)


def quantities_of(value: str | Sequence[str] | None) -> list[str]:
    """Return the quantities in an option; each entry may have several with commas between them."""
    return [name for entry in names_of(value) for name in names_of(entry)]


def near_hint(name: str, known: Sequence[str]) -> str:
    """Return the question whether the known name most like a wrong one was meant, or an empty text."""
    near = difflib.get_close_matches(name, known, 1)
    return f"; did you mean '{near[0]}'?" if near else ""


def chosen_names(wanted: list[str], known: list[str], what: str, file: str) -> list[str]:
    """Return the wanted names. Raises ResultsError if one is unknown."""
    for name in wanted:
        if name not in known:
            raise ResultsError(f"{file} has no {what} '{name}' (it has {', '.join(known)}){near_hint(name, known)}")
    return wanted


def _values(source: Source, probes: list[str], quantities: list[str],
            ) -> list[tuple[str, str, str, np.ndarray]]:
    """Return (probe, quantity, units, values) of all quantities of the chosen probes. Raises ResultsError."""
    results = source.results
    known = list(dict.fromkeys(q for p in results.probes.values() for q in p))
    chosen_names(quantities, known, "probe quantity", results.called)
    names = chosen_names(probes, list(results.probes), "probe", results.called) or list(results.probes)
    return [(name, q, results.probes[name].units.get(q, "1"), values)
            for name in names for q, values in results.probes[name].items()]


def _families(found: list[tuple[str, str, str, np.ndarray]], quantities: list[str],
              default: Sequence[str], named: bool) -> dict[str, list[tuple[str, str, str, np.ndarray]]]:
    """Sort values by family; by default only the families ``default``, without negligible values.

    Probes without any of these, such as reactions, show all of their quantities if they are ``named`` or no probe has
    them.
    """
    families: dict[str, list[tuple[str, str, str, np.ndarray]]] = {}
    usual = {name for name, q, *_ in found if FAMILIES.get(q, q) in default}
    for entry in found:
        family = FAMILIES.get(entry[1], entry[1])
        shown = family in default or (entry[0] not in usual and (named or not usual))
        if entry[1] in quantities or (not quantities and shown):
            families.setdefault(family, []).append(entry)
    if quantities:
        return families
    moving = {}
    for family, entries in families.items():
        top = max(largest_magnitude(v) for *_, v in entries)
        kept = [e for e in entries if largest_magnitude(e[3]) > NEGLIGIBLE * top]
        if kept:
            moving[family] = kept
    return moving or dict(list(families.items())[:1])


def largest_magnitude(values: np.ndarray) -> float:
    """Return the largest finite magnitude."""
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


def _panels(sources: Sequence[Source], probe: str | Sequence[str] | None,
            quantity: str | Sequence[str] | None, default: Sequence[str], axis: tuple[str, str],
            swap: bool) -> list[Panel]:
    panels: dict[tuple[str, str], Panel] = {}
    probes, quantities = names_of(probe), quantities_of(quantity)
    for source in sources:
        found = _values(source, probes, quantities)
        for family, entries in _families(found, quantities, default, bool(probes)).items():
            for name, q, units, values in entries:
                own = (family, units)
                panel = panels.setdefault(own, Panel(own, axis) if swap else Panel(axis, own))
                t = source.results.probe_t
                x, y = (values, t) if swap else (t, values)
                panel.curves.append(Curve(source.name(f"{name} {q}"), x, y))
    return list(panels.values())


def t_axis(results: Results) -> tuple[str, str]:
    """Return the label and units of time or load factor."""
    if results.over_time:
        return "time", results.units.time
    return "load factor", "1"


def load_deflection(sources: Sequence[Source], *, probe: str | Sequence[str] | None = None,
                    quantity: str | Sequence[str] | None = None) -> Curves:
    """Build the load factor against probe quantities (default: displacements, else all quantities)."""
    panels = _panels(sources, probe, quantity, ("displacement",), ("load factor", "1"), True)
    _mark_events(sources, panels)
    return Curves(common_title(sources), "", panels, share="y")


def _mark_events(sources: Sequence[Source], panels: list[Panel]) -> None:
    """Mark the limit points and bifurcations of a path on every curve."""
    for panel in panels:
        drawn = {c.name for c in panel.curves}
        for key, (words, look) in EVENTS.items():
            for source in sources:
                found = [(values[q], point["factor"], str(number))
                         for number, point in enumerate(source.results.summary.get(key, []), start=1)
                         for probe, values in point.get("probes", {}).items()
                         for q in values if source.name(f"{probe} {q}") in drawn]
                if found:
                    x, y, texts = zip(*found, strict=True)
                    panel.curves.append(Curve(source.name(words), np.array(x), np.array(y), look=dict(look),
                                              texts=list(texts)))


def history(sources: Sequence[Source], *, probe: str | Sequence[str] | None = None,
            quantity: str | Sequence[str] | None = None) -> Curves:
    """Build probe quantities over time (default: displacements, rotations and outputs of controllers)."""
    panels = _panels(sources, probe, quantity, ("displacement", "rotation", "controller output"),
                     t_axis(sources[0].results), False)
    for source in sources:
        _add_windows(source, panels)
        _add_events(source, panels)
    return Curves(common_title(sources), "", panels, share="x")


def _add_windows(source: Source, panels: list[Panel]) -> None:
    """Add means and peaks over windows of time, with error bars, to the panels of their quantities."""
    summary = source.results.summary
    accuracy = summary.get("accuracy") or {}
    for name, window in summary.get("windows", {}).items():
        value = window["value"]
        own = [panel for panel in panels for c in panel.curves if c.name == source.name(window.get("of", ""))]
        if value is None or not own:
            continue
        known = accuracy.get("value") == value and accuracy.get("estimate") is not None
        error = accuracy["estimate"] * abs(value) if known else window["sampling"]
        # three lines: the value, and the two limits of its error
        x = np.tile([window["from"], window["to"], np.nan], 3)
        y = value + np.repeat([0.0, -error, error], 3)
        own[0].curves.append(Curve(f"{name}: {value:.5g} within {error:.2g}", x, y, look=dict(WINDOW)))


def _add_events(source: Source, panels: list[Panel]) -> None:
    """Add vertical lines to all panels at the events of a motion, unless there are too many, and at its impacts.

    Of many impacts only the strongest are shown.
    """
    results, found = source.results, {}
    happened = [event["t"] for event in results.summary.get("events") or []]
    found["events"] = happened if len(happened) <= MOST_EVENTS else []
    impacts = results.tables["impacts"] if results.summary.get("impacts") else {}
    strongest = np.argsort(impacts.get("impulse", []))[::-1][:MOST_EVENTS]
    found["impacts"] = np.sort(np.asarray(impacts.get("t", []), dtype=float)[strongest]).tolist()
    for panel in panels:
        values = np.concatenate([c.y[np.isfinite(c.y)] for c in panel.curves])
        for name, times in found.items():
            if times and len(values):
                panel.curves.append(Curve(source.name(name), np.repeat(times, 3), np.tile(
                    [values.min(), values.max(), np.nan], len(times)), look=dict(EVENT_LINES)))


def _no_probes(results: Results) -> str:
    if not results.probes:
        return "it holds no probes (name some under output: probes: in the case)"
    return "" if len(results.probe_t) > 1 else "its probes hold only one value"


def _no_load(results: Results) -> str:
    if results.over_time:
        return "its states are over time, not over a load factor"
    return _no_probes(results)


LOAD_DEFLECTION = Kind("load_deflection", "load factor against probe quantities", _no_load,
                       load_deflection)
HISTORY = Kind("history", "probe quantities over time, or over the load factor", _no_probes,
               history)


def _place(results: Results, point: str | None, field: str, *needed: str) -> tuple[str, float, int, float]:
    """Return body and S of ``point``, its element and xi in it; by default the place where a field is largest."""
    having = [name for name, found in results.fields.items() if {field, *needed} <= set(found)]
    body, _, text = (point or having[0]).partition("@")
    if body not in having:
        raise ResultsError(f"{results.called} holds no {' and '.join((field, *needed))} of a body '{body}' (it does of "
                           f"{', '.join(having)})")
    lengths = results.body(body).lengths[results.body(body).classes]
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    if point is None or not text:
        record = results.fields[body][field]
        largest = np.max([np.abs(results.field(body, field, i)).max(axis=(2, 3)) for i in range(results.nt)], axis=0)
        ie, k = divmod(int(np.argmax(largest)), record.stations[0])
        xi = float(record.xi_of(ie)[k])
        return body, float((ends[ie] + xi * lengths[ie]) / ends[-1]), ie, xi
    s = _number(text, 0.0, "point must be BODY@S with S from 0 to 1")
    ie = min(int(np.searchsorted(ends, s * ends[-1], side="right")) - 1, len(lengths) - 1)
    return body, s, ie, float((s * ends[-1] - ends[ie]) / lengths[ie])


def _number(text: str | float, low: float, expected: str) -> float:
    """Return a number from ``low`` to 1. Raises ResultsError with the expected values."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not low <= value <= 1.0:
        raise ResultsError(f"{expected}, got {text}")
    return value


def _series(results: Results, body: str, name: str, ie: int, xi: float) -> tuple[FieldRecord, np.ndarray]:
    """Return a field and its first component at a place over all states (states, ny)."""
    record = results.fields[body][name]
    along = station_weights(record.xi_of(ie), np.array([xi]))[0]
    return record, np.array([along @ results.field(body, name, i)[ie, :, :, 0] for i in range(results.nt)])


def stress_strain(sources: Sequence[Source], *, point: str | None = None, height: float | None = None) -> Curves:
    """Build stress over strain along the axis at a point of a body.

    ``point``: BODY@S, or just BODY for the point of largest strain (default: of the first body with both fields);
    ``height``: fraction of half the height, from -1 to 1 (default: the outermost station above the axis).
    """
    panel, notes = Panel(("strain", "1"), ("stress", "")), []
    for source in sources:
        results = source.results
        body, s, ie, xi = _place(results, point, "strain", "stress")
        record, strain = _series(results, body, "strain", ie, xi)
        stressed, stress = _series(results, body, "stress", ie, xi)
        eta = float(record.eta.max()) if height is None else _number(height, -1.0, "height must be from -1 to 1")
        across = station_weights(0.5 * (1.0 + record.eta), np.array([0.5 * (1.0 + eta)]))[0]
        panel.y = "stress", stressed.units
        notes.append(f"{body}@{s:.4g}, y = {eta:.3g} h/2")
        panel.curves.append(Curve(source.name("stress"), strain @ across, stress @ across))
    return Curves(common_title(sources), "; ".join(dict.fromkeys(notes)), [panel])


def moment_curvature(sources: Sequence[Source], *, point: str | None = None) -> Curves:
    """Build the bending moment over the curvature of a section of a body.

    The curvature is the slope of the strains over the height. ``point``: BODY@S, or just BODY for the point of largest
    moment (default: of the first body with both fields).
    """
    panel, notes = Panel(("curvature", ""), ("bending moment M", "")), []
    for source in sources:
        results = source.results
        name, s, ie, xi = _place(results, point, "M", "strain")
        record, strain = _series(results, name, "strain", ie, xi)
        bent, moment = _series(results, name, "M", ie, xi)
        body = results.body(name)
        half = 0.5 * float(np.interp(xi, body.sample_xi, body.heights_of(np.array([ie]))[0]))
        slope = np.polyfit(record.eta * half, strain.T, 1)[0]
        panel.x, panel.y = ("curvature", f"1/{results.units.length}"), ("bending moment M", bent.units)
        notes.append(f"{name}@{s:.4g}")
        panel.curves.append(Curve(source.name("M"), -slope, moment[:, 0]))
    return Curves(common_title(sources), "; ".join(dict.fromkeys(notes)), [panel])


def _lacks(*needed: str) -> Callable[[Results], str]:
    def missing(results: Results) -> str:
        if no_states(results):
            return no_states(results)
        known: Any = results.fields.values()
        if not any(set(needed) <= set(found) for found in known):
            return f"it holds no {' and '.join(needed)} ({how_to_store(results, *needed)})"
        return "" if results.nt > 1 else "it holds only one state"
    return missing


STRESS_STRAIN = Kind("stress_strain", "stress over strain at a point of a body, over all states",
                     _lacks("strain", "stress"), stress_strain)
MOMENT_CURVATURE = Kind("moment_curvature", "bending moment over curvature of a section, over all states",
                        _lacks("strain", "M"), moment_curvature)
