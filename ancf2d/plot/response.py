"""Frequency responses over the frequency and in the complex plane; eigenvalues over load or speed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import yaml

from ancf2d.plot.curves import FAMILIES, NEGLIGIBLE, chosen_names, names_of, quantities_of
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results
from ancf2d.results.responses import smooth, spacing

# default quantities, and the ratio of highest to lowest frequency from which axes are logarithmic
DISPLACEMENTS, FORCES, DECADE = ("ux", "uy"), ("N", "Q", "M"), 10.0
# name, family, units, frequencies and complex amplitudes
Found = tuple[str, str, str, np.ndarray, np.ndarray]


def _responses(source: Source, inputs: list[str], probes: list[str], quantities: list[str]) -> Iterator[Found]:
    """Yield the requested responses, by default the displacements that are not negligible.

    If no probe moves, as at a clamp, the default is section forces.
    """
    table, file = source.results.tables["response"], source.results.called
    names = [tuple(column[:-len(".re")].rsplit(".", 2)) for column in table if column.endswith(".re")]
    for asked, k, what in ((inputs, 0, "input"), (probes, 1, "probe"), (quantities, 2, "probe quantity")):
        chosen_names(asked, list(dict.fromkeys(name[k] for name in names)), what, file)
    hz, scale, found = np.asarray(table["hz"], float), spacing(source.results), []
    for one, probe, q in names:
        if one in (inputs or [one]) and probe in (probes or [probe]) and q in (quantities or DISPLACEMENTS):
            column = f"{one}.{probe}.{q}"
            H = np.asarray(table[f"{column}.re"], float) + 1j * np.asarray(table[f"{column}.im"], float)
            label = f"{one}: {probe} {q}" if len({name[0] for name in names}) > 1 else f"{probe} {q}"
            found.append((source.name(label), FAMILIES.get(q, q), table.units[f"{column}.re"], *smooth(hz, H, scale)))
    top = max((float(np.abs(H).max(initial=0.0)) for *_, H in found), default=0.0)
    others = [q for q in FORCES if any(q == name[2] for name in names)]
    if not top and not quantities and others:
        yield from (f for f in _responses(source, inputs, probes, others) if np.abs(f[-1]).any())
        return
    yield from (f for f in found if quantities or np.abs(f[-1]).max(initial=0.0) > NEGLIGIBLE * top or not top)


def bode(sources: Sequence[Source], *, input: str | Sequence[str] | None = None,
         probe: str | Sequence[str] | None = None, quantity: str | Sequence[str] | None = None) -> Curves:
    """Build amplitudes and phases over the frequency (default: displacements)."""
    panels: dict[str, Panel] = {}
    time = sources[0].results.units.time
    x = ("frequency", "Hz" if time == "s" else f"1/{time}")
    phase, lowest, highest = Panel(x, ("phase", "degrees"), zero=True), np.inf, 0.0
    for source in sources:
        for name, family, units, hz, H in _responses(source, names_of(input), names_of(probe), quantities_of(quantity)):
            panel = panels.setdefault(family, Panel(x, (f"amplitude of {family}", units)))
            # zero cannot be drawn on a logarithmic axis
            panel.log |= bool(np.abs(H).any())
            panel.curves.append(Curve(name, hz, np.abs(H)))
            phase.curves.append(Curve(name, hz, np.degrees(np.unwrap(np.angle(H)))))
            lowest, highest = min(lowest, float(hz.min())), max(highest, float(hz.max()))
    log = 0.0 < lowest <= highest / DECADE
    return Curves(common_title(sources), "", [*panels.values(), phase], share="x", log_base=10 if log else 0)


def nyquist(sources: Sequence[Source], *, input: str | Sequence[str] | None = None,
            probe: str | Sequence[str] | None = None, quantity: str | Sequence[str] | None = None) -> Curves:
    """Build the complex amplitudes in the plane, along the frequency (default: displacements)."""
    panels: dict[str, Panel] = {}
    for source in sources:
        for name, family, units, _, H in _responses(source, names_of(input), names_of(probe), quantities_of(quantity)):
            axes = ((f"real part of {family}", units), ("imaginary part", units))
            panels.setdefault(family, Panel(*axes, equal=True)).curves.append(Curve(name, H.real, H.imag))
    return Curves(common_title(sources), "", list(panels.values()), share="")


def _missing(results: Results) -> str:
    return "" if "response" in results.tables else "it holds no response over the frequency (frequency_response)"


BODE = Kind("bode", "amplitude and phase of probes over the frequency", _missing, bode)
NYQUIST = Kind("nyquist", "response of probes in the complex plane", _missing, nyquist)


# excitation once, twice and three times per revolution
ORDERS = (1, 2, 3)
EXCITATION = {"color": "0.55", "linewidth": 0.9, "marker": ""}
DASHES = ("--", ":", "-.")  # of the orders; numbers at their ends would overlap
POINTS = {"linestyle": "none", "marker": ".", "markersize": 3, "markevery": 1}
# frequencies above this multiple of the highest critical one are not drawn
HIGHEST = 6.0
CRITICAL = {"linestyle": "none", "marker": "o", "markersize": 6, "markerfacecolor": "none", "markevery": 1}


def speed(results: Results) -> float:
    """Return the angular velocity of the steady rotation of a file's case, 0 without one [rad/time]."""
    turning = yaml.safe_load(results.case_completed).get("steady_rotation")
    return float(turning["omega"]) if turning else 0.0


def campbell(sources: Sequence[Source]) -> Curves:
    """Build a line for each mode, identified by kind and number, over the speeds of the files."""
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
                                  look={**EXCITATION, "linestyle": DASHES[order - 1]}))
    return Curves(common_title(sources), "", [panel])


def _no_speed(results: Results) -> str:
    if "modes" not in results.tables or "omega" not in results.tables["modes"]:
        return "it has no frequencies (solver eigen)"
    return "" if speed(results) else "it has no steady_rotation (ancf2d sweep writes a file for each speed)"


CAMPBELL = Kind("campbell", "frequencies over the speed of rotation, a file for each speed", _no_speed, campbell)


def root_locus(sources: Sequence[Source]) -> Curves:
    """Build the imaginary and real parts of the eigenvalues over the load factor; rings mark the onset of growth."""
    time = sources[0].results.units.time
    omega = Panel(("load factor", "1"), ("frequency omega", f"rad/{time}"))
    growth = Panel(("load factor", "1"), ("growth rate", f"1/{time}"), zero=True)
    for source in sources:
        table, modes = source.results.tables["locus"], source.results.tables["modes"]
        frequencies = np.asarray(table["omega"], float)
        top = HIGHEST * float(np.max(modes["omega"], initial=0.0))
        near = frequencies <= (top or np.inf)
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
