"""Lines from probes: load against deflection, and quantities over time."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results

FAMILIES = {
    "ux": "displacement", "uy": "displacement", "x": "position", "y": "position",
    "theta": "rotation", "vx": "velocity", "vy": "velocity", "omega": "angular velocity",
    "ax": "acceleration", "ay": "acceleration",
    "N": "axial force", "Q": "shear force", "M": "bending moment",
    "output": "controller output",
}
LIMIT = {"color": "black", "marker": "o", "markersize": 7, "markerfacecolor": "none", "markeredgewidth": 1.3,
         "linestyle": "none", "zorder": 5}
NEGLIGIBLE = 1e-6  # of the largest of its family: less is not drawn unless asked for


def names_of(value: str | Sequence[str] | None) -> list[str]:
    """Return the names that an option lists, as a sequence or with commas between them."""
    if value is None:
        return []
    return value.replace(",", " ").split() if isinstance(value, str) else list(value)


def quantities_of(value: str | Sequence[str] | None) -> list[str]:
    """Return the quantities that an option lists; each entry may list several with commas between them."""
    return [name for entry in names_of(value) for name in names_of(entry)]


def chosen_names(wanted: list[str], known: list[str], what: str, file: object) -> list[str]:
    """Return the wanted names; ResultsError where one is none of the known."""
    for name in wanted:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise ResultsError(f"'{file}' has no {what} '{name}' (it has {', '.join(known)}){hint}")
    return wanted


def _values(source: Source, probes: list[str], quantities: list[str],
            ) -> list[tuple[str, str, str, np.ndarray]]:
    """Return (probe, quantity, units, values), of all quantities that exist."""
    results = source.results
    known = list(dict.fromkeys(q for p in results.probes.values() for q in p))
    chosen_names(quantities, known, "probe quantity", results.path)
    names = chosen_names(probes, list(results.probes), "probe", results.path) or list(results.probes)
    return [(name, q, results.probes[name].units.get(q, "1"), values)
            for name in names for q, values in results.probes[name].items()]


def _families(found: list[tuple[str, str, str, np.ndarray]], quantities: list[str],
              default: Sequence[str], named: bool) -> dict[str, list[tuple[str, str, str, np.ndarray]]]:
    """Sort values by family; by default only those that move, in the families ``default``.

    Probes without any of these, such as reactions, show all they have where they are ``named`` or there are no others.
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
        top = max(_largest(v) for *_, v in entries)
        kept = [e for e in entries if _largest(e[3]) > NEGLIGIBLE * top]
        if kept:
            moving[family] = kept
    return moving or dict(list(families.items())[:1])


def _largest(values: np.ndarray) -> float:
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


def _t_axis(results: Results) -> tuple[str, str]:
    if results.over_time:
        return "time", results.units.time
    return "load factor", "1"


def load_deflection(sources: Sequence[Source], *, probe: str | Sequence[str] | None = None,
                    quantity: str | Sequence[str] | None = None) -> Curves:
    """Build the load factor against probe quantities (default: displacements, else rotations)."""
    panels = _panels(sources, probe, quantity, ("displacement",), ("load factor", "1"), True)
    _mark_limits(sources, panels)
    return Curves(common_title(sources), "", panels, share="y")


def _mark_limits(sources: Sequence[Source], panels: list[Panel]) -> None:
    """Mark the limit points that a path has passed, on every curve."""
    for panel in panels:
        marks: dict[str, tuple[list[float], list[float], list[str]]] = {}
        for source in sources:
            for number, point in enumerate(source.results.summary.get("limit_points", []), start=1):
                for probe, values in point["probes"].items():
                    for quantity, value in values.items():
                        if any(c.name == source.name(f"{probe} {quantity}") for c in panel.curves):
                            x, y, texts = marks.setdefault(source.name("limit points"), ([], [], []))
                            x.append(value)
                            y.append(point["factor"])
                            texts.append(str(number))
        for name, (x, y, texts) in marks.items():
            panel.curves.append(Curve(name, np.array(x), np.array(y), look=dict(LIMIT), texts=texts))


def history(sources: Sequence[Source], *, probe: str | Sequence[str] | None = None,
            quantity: str | Sequence[str] | None = None) -> Curves:
    """Build probe quantities over time (default: displacements, rotations and what controllers put out)."""
    panels = _panels(sources, probe, quantity, ("displacement", "rotation", "controller output"),
                     _t_axis(sources[0].results), False)
    return Curves(common_title(sources), "", panels, share="x")


def _no_probes(results: Results) -> str:
    if not results.probes:
        return "it holds no probes (name some under output: probes: in the case)"
    return "" if len(results.probe_t) > 1 else "its probes hold only one value"


def _no_load(results: Results) -> str:
    if results.over_time:
        return "its states are those of times, without a load factor"
    return _no_probes(results)


LOAD_DEFLECTION = Kind("load_deflection", "load factor against probe quantities", _no_load,
                       load_deflection)
HISTORY = Kind("history", "probe quantities over time, or over the load factor", _no_probes,
               history)
