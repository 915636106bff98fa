"""Layers of a page: points of bodies, symbols of supports and loads that move with them, fields as colours."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.results import BodyRecord, Results
from ancf2d.results.geometry import (
    POSITIVE,
    Formula,
    axis_shapes,
    body_faces,
    body_nodes,
    formulas_of,
    label_of,
    linear_weights,
    station_weights,
    weights_along,
)
from ancf2d.results.symbols import STEP, Symbol, outlines, symbols_of, tracks_of, within

WANTED_POINTS = 600  # points along each face of a body
STRIDES = (1, 2, 4, 5, 10, 20)  # intervals between drawn samples, out of the 21 samples of an element
MAX_NODES = 100  # nodes are shown only for bodies with at most this number, since more would merge into a line


@dataclass(frozen=True)
class Drawn:
    """Sampling of one body: some elements, and every ``stride``-th sample along them."""

    record: BodyRecord
    elements: np.ndarray
    stride: int

    def points(self, e: np.ndarray) -> np.ndarray:
        """Return the points (n, 2): bottom and top of the elements one after the other, then the nodes."""
        faces = body_faces(self.record, e, self.elements)
        sides = [faces[k][:, ::self.stride] for k in ("bottom", "top")]
        nodes = body_nodes(self.record, e) if self.has_nodes else np.empty((0, 2))
        return np.concatenate([*(s.reshape(-1, 2) for s in sides), nodes])

    @property
    def has_nodes(self) -> bool:
        """Return whether nodes are shown."""
        return len(self.record.dofs) <= MAX_NODES

    @property
    def samples(self) -> int:
        """The number of points along a face of one element."""
        return len(self.record.sample_xi[::self.stride])


def drawn_body(body: BodyRecord) -> Drawn:
    """Choose the elements and samples of a body that are drawn."""
    ne, ns = len(body.dofs), len(body.sample_xi)
    some = np.unique(np.linspace(0, ne - 1, min(ne, WANTED_POINTS // 2)).astype(int))
    fits = [s for s in STRIDES if (ns - 1) % s == 0 and len(some) * ((ns - 1) // s + 1) <= WANTED_POINTS]
    return Drawn(body, some, fits[0] if fits else ns - 1)


def listed(drawn: Iterable[Drawn]) -> tuple[list[dict[str, Any]], int]:
    """Return the bodies in the page's format, and the number of their points."""
    out, first = [], 0
    for d in drawn:
        elements = len(d.elements)
        nodes = len(np.unique(d.record.nodes)) if d.has_nodes else 0
        out.append({"name": d.record.name, "element": d.record.element_type, "count": len(d.record.dofs),
                    "first": first, "elements": elements, "samples": d.samples, "nodes": nodes,
                    "pieces": len(d.elements) == len(d.record.dofs)})
        first += 2 * elements * d.samples + nodes
    return out, first


def packed(values: np.ndarray, kind: str) -> str:
    """Return numbers as base 64 of little-endian ``kind`` (f4, f8, i2, u1)."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()).decode("ascii")


MAX_SYMBOLS = 400
ARM = 0.1  # of the extent: distance of a second point that shows the rotation of a symbol
LARGEST_CODE = 255  # largest code of a field's value; 0 marks values that are not numbers
ACROSS = np.array([0.0, 0.5, 1.0])  # fractions of the section's height at which a field is shown
FEWEST_FRAMES = 30  # least number of frames of a field before its points are thinned
FIRST = ("stress", "strain", "energy", "N", "Q", "M")  # order in which fields are listed


class SymbolPoints:
    """The points of symbols, which move with the bodies, with a second point for each symbol that rotates."""

    def __init__(self, results: Results, extent: float) -> None:
        found = (s for s in symbols_of(results, None, 1.0) if s.active_times[0] < math.inf)
        self.symbols: list[Symbol] = [*islice(found, MAX_SYMBOLS)]
        self.arm = ARM * extent
        self.ground = np.array([p for s in self.symbols for p in s.points]).reshape(-1, 2)
        places = [place for s in self.symbols for place in s.on]
        self.rows: list[tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]] = []
        self.results, self.tracks = results, tracks_of(results)
        self.moving = [(k, place[0], self.tracks[track]) for k, (place, track) in enumerate(
            (p, t) for s in self.symbols for p, t in zip(s.on, s.tracks, strict=True)) if place and track]
        self.turning = np.array([k for k, s in zip(self._first(), self.symbols, strict=True) if s.turns], int)
        self.arms: list[tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]] = []
        # distances of points from the axes of their bodies, and axis points before and after them
        off = np.array([y for s in self.symbols for y in s.off or (0.0,) * len(s.points)])
        self.off_axis: list[tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray],
                                tuple[np.ndarray, np.ndarray]]] = []
        for name, body in results.bodies.items():
            mine = np.array([k for k, p in enumerate(places) if p and p[0] == name], int)
            if mine.size:
                self.rows.append((mine, axis_shapes(body, _at(places, mine))))
                if (some := mine[off[mine] != 0.0]).size:
                    self.off_axis.append((some, off[some, None], *_about(body, _at(places, some))))
            held = np.flatnonzero(np.isin(self.turning, mine))
            if held.size:
                self.arms.append((held, *_about(body, _at(places, self.turning[held]))))

    def _first(self) -> list[int]:
        """Return the number of each symbol's first point."""
        counts = [len(s.points) for s in self.symbols]
        return (np.cumsum(counts) - counts).astype(int).tolist() if counts else []

    def points(self, e: np.ndarray, state: int | None = None) -> np.ndarray:
        """Return the points (n, 2) of all symbols, then the second points of those that rotate.

        Symbols that move along bodies are displaced like the bodies at their places in a state; ``ways`` gives these
        places.
        """
        out, arms = self.ground.copy(), np.zeros((len(self.turning), 2))
        for mine, row in self.rows:
            out[mine] = _values(row, e)
        for k, name, track in self.moving:
            if state is None:
                break
            row = axis_shapes(self.results.bodies[name], np.clip(track[state:state + 1], 0.0, 1.0))
            out[k] = self.ground[k] + (_values(row, e) - _values(row, self.results.e0))[0]
        for some, off, before, after in self.off_axis:
            out[some] += off * _direction(before, after, e)[:, ::-1] * [-1.0, 1.0]
        for held, before, after in self.arms:
            arms[held] = self.arm * _direction(before, after, e)
        return np.concatenate([out, out[self.turning] + arms])

    def ways(self, first: int, states: np.ndarray) -> list[dict[str, Any]]:
        """Return the path along its body of each moving point over some states, NaN where it is off the body."""
        out = []
        for k, name, track in self.moving:
            s = track[states]
            way = self.results.reference(name, np.clip(s, 0.0, 1.0)) - self.ground[k]
            way[~within(s)] = np.nan
            out.append({"point": first + k, "way": packed(way, "f4")})
        return out

    def listed(self, first: int) -> dict[str, Any]:
        """Return symbols and outlines in the page's format; ``first`` is the number of the first point."""
        arms = first + len(self.ground)
        out = []
        for k, symbol in zip(self._first(), self.symbols, strict=True):
            out.append({"kind": symbol.kind, "angle": symbol.angle, "first": first + k,
                        "arm": arms if symbol.turns else None,
                        "acts": [t if math.isfinite(t) else None for t in symbol.active_times]})
            arms += symbol.turns
        kinds = {s.kind for s in self.symbols}
        return {"symbols": out, "outlines": {name: {"lines": mark.lines, "unit": mark.unit, "filled": mark.filled,
                                                    "load": mark.load}
                                             for name, mark in outlines().items() if name in kinds}}


def _about(body: BodyRecord, s: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return the axis a little before and a little after places S (n,)."""
    return axis_shapes(body, np.maximum(s - STEP, 0.0)), axis_shapes(body, np.minimum(s + STEP, 1.0))


def _direction(before: tuple[np.ndarray, np.ndarray], after: tuple[np.ndarray, np.ndarray], e: np.ndarray
               ) -> np.ndarray:
    along = _values(after, e) - _values(before, e)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return np.asarray(along / np.where(length > 0, length, 1.0))


def _at(places: Sequence[tuple[str, float] | None], some: np.ndarray) -> np.ndarray:
    return np.array([place[1] for k in some if (place := places[k])])


def _values(row: tuple[np.ndarray, np.ndarray], e: np.ndarray) -> np.ndarray:
    dofs, shapes = row
    return np.einsum("mk,mkc->mc", shapes, e[dofs])


# ---------------------------------------------------------------------- fields


def fields(results: Results, drawn: Sequence[Drawn], chosen: Sequence[int | None], budget: int,
           wanted: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return fields in some states (None: rest), each component with its values as codes of 8 bits.

    ``frames`` are the positions in ``chosen`` at which values are given, in the order (frame, body, element, station,
    across). Without names in ``wanted``, all fields of the results. Raises ResultsError for an unknown field.
    """
    known = _names(results)
    for name in wanted:
        if name not in known:
            raise ResultsError(f"{results.called} has no field '{name}' (it has {', '.join(known) or 'none'})")
    shown = [(name, part) for name in (wanted or known) for part in _parts(results, name)]
    if not shown:
        return []
    names = [name for name, _ in shown]
    every, size = _thinned(results, drawn, names, budget // min(len(chosen), FEWEST_FRAMES))
    most = max(2, min(len(chosen), budget // max(size, 1)))
    frames = np.unique(np.linspace(0, len(chosen) - 1, most).round().astype(int))
    states = [chosen[k] for k in frames]
    return [{"name": label_of(name, part), "frames": frames.tolist(),
             **_coded(results, drawn, name, part, states, every)} for name, part in shown]


def _names(results: Results) -> list[str]:
    found = dict.fromkeys(name for fields in results.fields.values() for name in fields)
    return sorted(found, key=lambda n: FIRST.index(n) if n in FIRST else len(FIRST))


def _parts(results: Results, name: str) -> Iterator[str]:
    record = next(found[name] for found in results.fields.values() if name in found)
    yield from formulas_of(record)


def _count(results: Results, d: Drawn, name: str, every: int) -> int:
    """Return the number of values of a field on one body in one state."""
    record = results.fields.get(d.record.name, {}).get(name)
    if record is None:
        return 0
    return len(d.elements) * ((d.samples - 1) // every + 1) * (len(ACROSS) if len(record.eta) > 1 else 1)


def _thinned(results: Results, drawn: Sequence[Drawn], names: Sequence[str], most: int) -> tuple[dict[str, int], int]:
    """Return at which samples of each body fields are shown (every first, second, ...), and the number of values.

    There are at most ``most`` values per state, unless only the ends of all elements remain.
    """
    for step in range(1, max(d.samples for d in drawn) + 1):
        every = {d.record.name: max(k for k in range(1, step + 1) if (d.samples - 1) % k == 0) for d in drawn}
        size = sum(_count(results, d, name, every[d.record.name]) for name in names for d in drawn)
        if size <= most:
            break
    return every, size


def _coded(results: Results, drawn: Sequence[Drawn], name: str, part: str, states: Sequence[int | None],
           every: dict[str, int]) -> dict[str, Any]:
    """Return one component of a field over the bodies that have it: codes, and their smallest and largest values."""
    bodies, values, units = [], [], ""
    for k, d in enumerate(drawn):
        record = results.fields.get(d.record.name, {}).get(name)
        if record is None:
            continue
        formula = formulas_of(record)[part]
        units, across = record.units, ACROSS if len(record.eta) > 1 else ACROSS[1:2]
        stations = d.record.sample_xi[::d.stride][::every[d.record.name]]
        weights = weights_along(record, stations, d.elements), _across(d.record.levels, record.eta, across)
        bodies.append({"body": k, "every": every[d.record.name], "across": len(across)})
        values.append(np.array([_sampled(results, d, name, state, formula, weights) for state in states]))
    codes, low, high = _codes(np.concatenate([v.reshape(len(states), -1) for v in values], axis=1),
                              part not in POSITIVE)
    return {"units": units, "bodies": bodies, "low": low, "high": high, "signed": part not in POSITIVE,
            "values": packed(codes, "u1")}


def _across(levels: np.ndarray | None, eta: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return weights (len(at), len(eta)) of a field at fractions of the height; linear within layers."""
    if levels is None or len(eta) == 1:
        return station_weights(0.5 * (1.0 + eta), at)
    return linear_weights(eta, eta[0] + (eta[-1] - eta[0]) * at)


def _sampled(results: Results, d: Drawn, name: str, state: int | None, formula: Formula,
             weights: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the values (elements, stations, across) of a component on one body in one state; zeros at rest."""
    if state is None:
        return np.zeros((len(d.elements), weights[0].shape[-2], len(weights[1])))
    stored = formula(results.field(d.record.name, name, state)[d.elements])
    # polynomials overshoot: an energy could become negative
    return np.clip(np.einsum("...xi,yj,...ij->...xy", *weights, stored), stored.min(), stored.max())


def _codes(values: np.ndarray, signed: bool) -> tuple[np.ndarray, float, float]:
    """Return codes from 1 to LARGEST_CODE and the values at both ends, symmetric about zero for signed fields."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if signed:
        high = max(-low, high)
        low = -high
    share = (values - low) / ((high - low) or 1.0)
    codes = np.where(np.isfinite(share), 1 + np.rint(share * (LARGEST_CODE - 1)), 0)
    return codes, low, high
