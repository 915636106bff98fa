"""Contact zones: the pressure on the faces of bodies over arc length and time or load factor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml
from matplotlib.figure import Figure

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.body import no_states
from ancf2d.plot.curves import t_axis
from ancf2d.plot.picture import Kind, Source
from ancf2d.results import Results

# names of both sides of a body, by the part of it that its contacts use
FACES = {"surface": ("lower face", "upper face"), "axis": ("axis, from below", "axis, from above"),
         "both": ("lower face and axis", "upper face and axis")}
COLOURS = "magma_r"
# of more faces, only those with the highest pressure are drawn
MOST = 6
# relative to the highest pressure: smaller values count as zero
NEGLIGIBLE = 1e-9


@dataclass
class Zone:
    """One face of a body: arc length s (n,) and pressure (states, n)."""

    name: str
    s: np.ndarray
    pressure: np.ndarray


@dataclass
class Zones:
    """The picture of all faces in contact, over t (states,)."""

    title: str
    over: tuple[str, str]
    length: str
    units: str
    t: np.ndarray
    zones: list[Zone]
    left_out: int = 0

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in inches."""
        return 6.4, 1.9 + 2.3 * len(self.zones)

    def render(self, figure: Figure) -> None:
        """Draw a map of the pressure for each face."""
        grid = figure.subplots(len(self.zones), 1, squeeze=False)[:, 0]
        top = max(float(z.pressure.max()) for z in self.zones) or 1.0
        edges = np.concatenate([self.t[:1], 0.5 * (self.t[1:] + self.t[:-1]), self.t[-1:]])
        for axes, zone in zip(grid, self.zones, strict=True):
            # elements share stations at their ends; each value stands for the strip around its station
            s = np.concatenate([zone.s[:1], 0.5 * (zone.s[1:] + zone.s[:-1]), zone.s[-1:]])
            values = np.where(zone.pressure > NEGLIGIBLE * top, zone.pressure, np.nan)
            drawn = axes.pcolormesh(s, edges, values, cmap=COLOURS, vmin=0.0, vmax=top, rasterized=True)
            axes.set_xlim(s[0], s[-1])
            axes.grid(False)
            style.verbatim(axes.set_ylabel(style.label(*self.over)))
            style.verbatim(axes.set_xlabel(style.label(f"{zone.name}: arc length", self.length)))
        bar = figure.colorbar(drawn, ax=list(grid), location="bottom", aspect=40, fraction=0.06, pad=0.04)
        style.verbatim(bar.ax.set_xlabel(style.label("pressure per length", self.units)))
        note = f"{self.left_out} faces that are pressed less are left out" if self.left_out else ""
        if not any(z.pressure.any() for z in self.zones):
            note = "no contact in any stored state"
        style.title(figure, self.title, note)

    def header(self) -> list[str]:
        """Return the names of the columns of the data."""
        return ["face", f"{self.over[0]} [{self.over[1]}]", f"s [{self.length}]", f"pressure [{self.units}]"]

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield the rows of the drawn data."""
        for zone in self.zones:
            for t, values in zip(self.t.tolist(), zone.pressure.tolist(), strict=True):
                for s, p in zip(zone.s.tolist(), values, strict=True):
                    yield zone.name, t, s, p


def _records(results: Results) -> dict[str, Any]:
    return {body: found["pressure"] for body, found in results.fields.items() if "pressure" in found}


def _faces(results: Results, body: str) -> tuple[str, str]:
    """Return the names of the lower and the upper side of a body; its contacts use its faces, its axis or both."""
    contacts = yaml.safe_load(results.case_completed).get("contacts") or []
    sides = {c.get("side", "surface") for c in contacts if body in (c.get("self"), *(c.get("between") or ()))}
    return FACES[sides.pop() if len(sides) == 1 else "both" if sides else "surface"]


def zones(sources: Sequence[Source], *, body: str | None = None) -> Zones:
    """Build the maps of one file: of one ``body``, or of all in contact. Raises ResultsError without pressure."""
    results = sources[0].results
    records = _records(results)
    if body is not None and body not in records:
        raise ResultsError(f"there is no pressure on '{body}' (there is on {', '.join(records)})")
    found = []
    for name, record in records.items():
        if body in (None, name):
            lengths = results.body(name).lengths[results.body(name).classes]
            s = ((np.cumsum(lengths) - lengths)[:, None] + lengths[:, None] * record.xi).ravel()
            every = np.array([results.field(name, "pressure", i)[..., 0] for i in range(results.nt)])
            found += [Zone(f"{name}, {face}", s, every[..., k].reshape(results.nt, -1))
                      for k, face in enumerate(_faces(results, name))]
    touched = sorted((z for z in found if z.pressure.max() > 0.0), key=lambda z: -float(z.pressure.max())) or found[:1]
    kept = [z for z in found if any(z is one for one in touched[:MOST])]
    units = next(iter(records.values())).units
    return Zones(results.title, t_axis(results), results.units.length, units, results.t, kept,
                 max(0, len(touched) - MOST))


def _missing(results: Results) -> str:
    if no_states(results):
        return no_states(results)
    if not _records(results):
        return "it holds no pressure of contact (output: fields: [pressure] in the case stores it)"
    return "" if results.nt > 1 else "it has one state: a contact zone is drawn over several"


CONTACT = Kind("contact", "contact zones: pressure on the faces of bodies over arc length and time or load factor",
               _missing, zones, single=True)
