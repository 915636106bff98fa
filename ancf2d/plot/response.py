"""Frequency responses: amplitude and phase over the frequency, and the curve in the complex plane."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ancf2d.plot.curves import FAMILIES, NEGLIGIBLE, chosen_names, names_of, quantities_of
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import Results

# default of what is drawn, and frequencies from which axes are logarithmic: highest beside lowest
DISPLACEMENTS, DECADE = ("ux", "uy"), 10.0
# name, family, units, frequencies and complex amplitudes
Found = tuple[str, str, str, np.ndarray, np.ndarray]


def _responses(source: Source, inputs: list[str], probes: list[str], quantities: list[str]) -> Iterator[Found]:
    """Yield the responses that were asked for, by default displacements that are not negligible."""
    table, file = source.results.tables["response"], source.results.path
    names = [tuple(column[:-len(".re")].rsplit(".", 2)) for column in table if column.endswith(".re")]
    for asked, k, what in ((inputs, 0, "input"), (probes, 1, "probe"), (quantities, 2, "probe quantity")):
        chosen_names(asked, list(dict.fromkeys(name[k] for name in names)), what, file)
    hz, found = np.asarray(table["hz"], float), []
    for one, probe, q in names:
        if one in (inputs or [one]) and probe in (probes or [probe]) and q in (quantities or DISPLACEMENTS):
            column = f"{one}.{probe}.{q}"
            H = np.asarray(table[f"{column}.re"], float) + 1j * np.asarray(table[f"{column}.im"], float)
            label = f"{one}: {probe} {q}" if len({name[0] for name in names}) > 1 else f"{probe} {q}"
            found.append((source.name(label), FAMILIES.get(q, q), table.units[f"{column}.re"], hz, H))
    top = max((float(np.abs(H).max(initial=0.0)) for *_, H in found), default=0.0)
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
            panel = panels.setdefault(family, Panel(x, (f"amplitude of {family}", units), log=True))
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
