"""What a section or a fibre goes through over all states: moment against curvature, stress against strain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.body import no_states
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import FieldRecord, Results
from ancf2d.results.geometry import station_weights


def _place(results: Results, point: str | None, field: str, *needed: str) -> tuple[str, float, int, float]:
    """Return body and S of ``point``, the element there and the place xi in it; by default where a field is largest."""
    having = [name for name, found in results.fields.items() if {field, *needed} <= set(found)]
    body, _, text = (point or having[0]).partition("@")
    if body not in having:
        raise ResultsError(f"'{results.path}' holds no {' and '.join((field, *needed))} of a body '{body}' (it does of "
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
    """Return a number from ``low`` to 1; ResultsError with what is expected where it is none."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not low <= value <= 1.0:
        raise ResultsError(f"{expected}, got {text}")
    return value


def _series(results: Results, body: str, name: str, ie: int, xi: float) -> tuple[FieldRecord, np.ndarray]:
    """Return a field's first component at a place over all states (states, ny)."""
    record = results.fields[body][name]
    along = station_weights(record.xi_of(ie), np.array([xi]))[0]
    return record, np.array([along @ results.field(body, name, i)[ie, :, :, 0] for i in range(results.nt)])


def stress_strain(sources: Sequence[Source], *, point: str | None = None, height: float | None = None) -> Curves:
    """Build stress over strain along the axis at a point of a body.

    ``point``: BODY@S, or BODY alone for where its strain is largest (default: of the first body that has one);
    ``height``: share of half the height, from -1 to 1 (default: the outermost station above the axis).
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

    The curvature is the slope of the strains across. ``point``: BODY@S, or BODY alone for where its moment is largest
    (default: of the first body that has one).
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
            return f"it holds no {' and '.join(needed)} (output: fields: [{', '.join(needed)}] in the case stores them)"
        return "" if results.nt > 1 else "it holds only one state"
    return missing


STRESS_STRAIN = Kind("stress_strain", "stress over strain at a point of a body, over all states",
                     _lacks("strain", "stress"), stress_strain)
MOMENT_CURVATURE = Kind("moment_curvature", "bending moment over curvature of a section, over all states",
                        _lacks("strain", "M"), moment_curvature)
