"""Distances between the axes of the same bodies in different files, along their length."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.plot.body import check_state, no_states, when
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Source, common_title
from ancf2d.results import BodyRecord, Results

LEAST_STATIONS = 100  # along a body: fewer element ends get points between them
MOST_STATIONS = 4000
SAME = 1e-9  # relative to a body's length: smaller distances are the same place
ROUND_OFF = 1e-15  # relative to the largest coordinate: smaller distances are zero


def stations(bodies: Sequence[BodyRecord]) -> np.ndarray:
    """Return the fractions of the arc length at which one body of several files is compared.

    They are the element ends of all files, with points between them if there are few, thinned if there are very many.
    """
    ends = reduce(np.union1d, (b.arclength for b in bodies))
    ends = ends[np.append(True, np.diff(ends) > 1e-12)]
    if len(ends) > MOST_STATIONS:
        return ends[np.unique(np.linspace(0, len(ends) - 1, MOST_STATIONS).astype(int))]
    parts = -(-LEAST_STATIONS // (len(ends) - 1))
    steps = np.arange(len(ends) * parts - parts + 1) / parts
    return np.interp(steps, np.arange(len(ends)), ends)


def difference(sources: Sequence[Source], *, reference: str | None = None, state: int = -1) -> Curves:
    """Build the distance of the axes of all bodies from those of one file, over the fraction S of their arc length.

    ``reference`` names that file (default: the last); ``state`` counts the stored states, negative from the end.
    """
    if len(sources) < 2:
        raise ResultsError("a difference needs two result files or more; the last one named is the reference")
    against = _reference(sources, reference)
    others = [s for s in sources if s is not against]
    for source in others:
        _comparable(source.results, against.results, state)
    units, names = against.results.units.length, list(against.results.bodies)
    panel = Panel(("S, fraction of the arc length", "1"), ("distance between the axes", units))
    floor = 0.0
    for name in names:
        s = stations([x.results.body(name) for x in sources])
        place = against.results.displacement(name, s, state)
        floor = max(floor, ROUND_OFF * float(np.abs(against.results.reference(name, s) + place).max()))
        for source in others:
            _same_reference(source.results, against.results, name, s)
            distance = np.linalg.norm(source.results.displacement(name, s, state) - place, axis=1)
            panel.curves.append(Curve(source.name(name if len(names) > 1 else ""), s, distance))
    for curve in panel.curves:
        curve.note = "" if (curve.y > floor).any() else ", agrees to round-off"
    apart = not all(curve.note for curve in panel.curves)  # a logarithmic axis would stay empty
    note = f"{when(against.results, state)}, against {against.label}"
    return Curves(common_title(sources), note, [panel], log_y=apart, floor=floor)


def _reference(sources: Sequence[Source], wanted: str | None) -> Source:
    if wanted is None:
        return sources[-1]
    found = [s for s in sources if wanted in (s.label, str(s.results.path), s.results.path.name, s.results.path.stem)]
    if len(found) != 1:
        why = "several of the files are known" if found else "none of the files is known"
        paths = ", ".join(str(s.results.path) for s in sources)
        raise ResultsError(f"{why} by the name '{wanted}' (the files: {paths})")
    return found[0]


def _comparable(a: Results, b: Results, state: int) -> None:
    """Raise ResultsError for files whose bodies, units, or times or load factors differ."""
    for results in (a, b):
        check_state(results, state)
    pair = f"{a.called} and {b.called}"
    if set(a.bodies) != set(b.bodies):
        raise ResultsError(f"{pair} have different bodies: {', '.join(a.bodies)} and {', '.join(b.bodies)}")
    if a.units.length != b.units.length:
        raise ResultsError(f"{pair} have different units of length: {a.units.length} and {b.units.length}")
    if a.over_time != b.over_time:
        raise ResultsError(f"{pair} cannot be compared: one holds states over time, one over the load factor")
    t, u = float(a.t[state]), float(b.t[state])
    if abs(t - u) > SAME * max(abs(t), abs(u)):
        what = "time" if a.over_time else "load factor"
        raise ResultsError(f"{pair} are not at the same {what} in state {state}: {t:.6g} and {u:.6g}")


def _same_reference(a: Results, b: Results, name: str, s: np.ndarray) -> None:
    """Raise ResultsError for a body whose reference differs, with a tolerance between the ends of curved elements."""
    one, two = a.body(name), b.body(name)
    lengths = [float(x.lengths[x.classes].sum()) for x in (one, two)]
    text = f"the reference geometry of '{name}' differs between {a.called} and {b.called}: "
    if abs(lengths[0] - lengths[1]) > SAME * max(lengths):
        raise ResultsError(f"{text}it is {lengths[0]:.6g} and {lengths[1]:.6g} {a.units.length} long")
    apart = np.linalg.norm(a.reference(name, s) - b.reference(name, s), axis=1)
    shared = _among(s, one.arclength) & _among(s, two.arclength)
    allowed = SAME * max(lengths) + np.where(shared, 0.0, max(_bulge(a, one), _bulge(b, two)))
    worst = int(np.argmax(apart - allowed))
    if apart[worst] > allowed[worst]:
        raise ResultsError(f"{text}by {apart[worst]:.3g} {a.units.length} at S = {s[worst]:.4g}")


def _among(s: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return whether each s (n,) is one of the element ends."""
    right = np.clip(np.searchsorted(ends, s), 1, len(ends) - 1)
    return np.minimum(np.abs(ends[right] - s), np.abs(ends[right - 1] - s)) < 1e-9


def _bulge(results: Results, body: BodyRecord) -> float:
    """Return the largest distance of an element from the curve between its ends: half its length times its turn."""
    lengths = body.lengths[body.classes]
    chords = np.diff(results.reference(body.name, body.arclength), axis=0)
    if len(chords) == 1:  # no neighbour, so no angle; ends and length suffice for a straight body
        return 0.5 * float(lengths[0])
    angles = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    return 0.5 * float(lengths.max() * np.abs(np.diff(angles)).max())


DIFFERENCE = Kind("difference", "distance of the axes in two or more files from those in the last one", no_states,
                  difference, least=2)
