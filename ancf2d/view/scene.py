"""What a page shows, as plain numbers: bodies in many states or modes, and the probes."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.results import BodyRecord, Results
from ancf2d.results.geometry import body_faces, body_nodes

BUDGET = 3_000_000  # bytes of states: in base 64, with all else, a page stays below 5 MB
MAX_STATES = 1500
MAX_ROWS = 4000  # of each probe
WANTED_POINTS = 600  # along each face of a body
STRIDES = (1, 2, 4, 5, 10, 20)  # of the 21 samples of an element
LARGEST_CODE = 32767
SHOWN_MODES = 24
MODE_SIZE = 0.12  # of the extent: displacement that a mode is drawn with
SMALL = 1e-6  # of the extent: motion that the rates of a section are read from
INVISIBLE, VISIBLE = 0.01, 0.1  # of the extent: smaller displacements are magnified to that share


@dataclass(frozen=True)
class Drawn:
    """How one body is sampled: some elements, every so manyeth sample along them."""

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
        """Whether nodes are shown: not so many that they merge into a line."""
        return len(self.record.dofs) <= 100

    @property
    def samples(self) -> int:
        """Points along a face of one element."""
        return len(self.record.sample_xi[::self.stride])


def _drawn(body: BodyRecord) -> Drawn:
    ne, ns = len(body.dofs), len(body.sample_xi)
    some = np.unique(np.linspace(0, ne - 1, min(ne, WANTED_POINTS // 2)).astype(int))
    fits = [s for s in STRIDES if (ns - 1) % s == 0 and len(some) * ((ns - 1) // s + 1) <= WANTED_POINTS]
    return Drawn(body, some, fits[0] if fits else ns - 1)


def _packed(values: np.ndarray, kind: str) -> str:
    """Return numbers as base 64 of little-endian ``kind`` (f4, f8, i2)."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()).decode("ascii")


def _quantised(moves: np.ndarray) -> tuple[str, float]:
    """Return displacements as 16-bit codes, and what one code stands for."""
    step = float(np.abs(moves).max(initial=0.0)) / LARGEST_CODE
    codes = np.rint(moves / step) if step > 0.0 else np.zeros_like(moves)
    return _packed(codes, "i2"), step


def scene(results: Results, budget: int = BUDGET) -> dict[str, Any]:
    """Return everything that a page shows as a JSON-able object.

    ``reference`` (points, 2) are points of all bodies (f4); ``moves`` (frames, points, 2) their displacements in
    ``step`` (i2). Raises ResultsError for a file without bodies or states.
    """
    if not results.bodies:
        raise ResultsError(f"'{results.path}' holds no bodies to show")
    drawn = [_drawn(body) for body in results.bodies.values()]
    modes = "modes/shapes" in results.arrays
    if not modes and not results.nt:
        raise ResultsError(f"'{results.path}' holds no states to show")
    base = results.e(-1) if modes and results.solver == "eigen" and results.nt else results.e0
    start = _all_points(drawn, base)
    size = start.nbytes // 4  # two numbers of 16 bits for two of 64
    most = max(2, min(budget // max(size, 1), MAX_STATES))
    extent = float(np.hypot(*np.ptp(start, axis=0))) or 1.0
    part = _modes(results, drawn, base, start, extent, most) if modes else _states(results, drawn, start, extent, most)
    units = results.units
    return {"title": results.title or results.path.name, "file": results.path.name, "solver": results.solver,
            "status": results.status, "units": {"length": units.length, "time": units.time, "force": units.force},
            "bodies": _bodies(drawn), "reference": _packed(start, "f4"), "extent": extent, **part}


def _bodies(drawn: list[Drawn]) -> list[dict[str, Any]]:
    out, first = [], 0
    for d in drawn:
        elements = len(d.elements)
        nodes = len(np.unique(d.record.nodes)) if d.has_nodes else 0
        out.append({"name": d.record.name, "element": d.record.element_type, "count": len(d.record.dofs),
                    "first": first, "elements": elements, "samples": d.samples, "nodes": nodes,
                    "pieces": len(d.elements) == len(d.record.dofs)})
        first += 2 * elements * d.samples + nodes
    return out


def _all_points(drawn: list[Drawn], e: np.ndarray) -> np.ndarray:
    return np.concatenate([d.points(e) for d in drawn])


# ---------------------------------------------------------------------- states


def _even(t: np.ndarray, most: int) -> np.ndarray:
    """Return at most ``most`` states, evenly spaced in t where it only grows, else in their number."""
    if len(t) <= most:
        return np.arange(len(t))
    if np.any(np.diff(t) <= 0):
        return np.unique(np.linspace(0, len(t) - 1, most).round().astype(int))
    return np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], most)).clip(0, len(t) - 1))


def _states(results: Results, drawn: list[Drawn], start: np.ndarray, extent: float, most: int) -> dict[str, Any]:
    chosen = _even(results.t, most)
    moves = np.array([_all_points(drawn, results.e(int(i))) - start for i in chosen])
    t = results.t[chosen]
    dynamic = results.solver == "dynamic"
    if results.solver == "linear_static" and len(t) == 1:  # what lies between rest and a linear answer is known
        t, moves = np.array([0.0, t[0]]), np.concatenate([np.zeros_like(moves), moves])
    codes, step = _quantised(moves)
    largest = float(np.linalg.norm(moves, axis=-1).max(initial=0.0))
    return {"kind": "time" if dynamic else "load", "t": t.tolist(), "stored": max(results.nt, len(t)),
            "moves": codes, "step": step, "magnify": _magnification(largest, extent),
            "probes": list(_probes(results, t)) if len(t) == len(chosen) else []}


def _magnification(largest: float, extent: float) -> float:
    """Return the power of ten that makes an invisible motion visible, 1 where it is or where there is none."""
    if not 1e-12 * extent < largest < INVISIBLE * extent:
        return 1.0
    return float(10.0 ** np.floor(np.log10(VISIBLE * extent / largest)))


def _probes(results: Results, t: np.ndarray) -> Iterator[dict[str, Any]]:
    rows = _rows_of(results.probe_t, t)
    kept = np.unique(np.concatenate([rows, np.linspace(0, len(results.probe_t) - 1, MAX_ROWS).astype(int)])) \
        if len(results.probe_t) > MAX_ROWS else np.arange(len(results.probe_t))
    where = np.searchsorted(kept, rows)
    for name, columns in results.probes.items():
        for quantity, values in columns.items():
            found = np.asarray(values, float)[kept]
            finite = found[np.isfinite(found)]
            if len(finite) > 1 and np.ptp(finite) > 0:
                yield {"probe": name, "quantity": quantity, "units": columns.units.get(quantity, ""),
                       "t": _packed(results.probe_t[kept], "f8"), "values": _packed(found, "f8"),
                       "rows": _packed(where, "f4")}


def _rows_of(probe_t: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the row of each state's probe values: the first of its time behind that of the state before."""
    out, row = np.zeros(len(t), int), 0
    for k, value in enumerate(t):
        later = np.flatnonzero(probe_t[row:] == value)
        row = row + int(later[0]) if len(later) else min(row, len(probe_t) - 1)
        out[k] = row
    return out


# ---------------------------------------------------------------------- modes


def _modes(results: Results, drawn: list[Drawn], base: np.ndarray, start: np.ndarray, extent: float, most: int,
           ) -> dict[str, Any]:
    shapes = results.array("modes/shapes")[:min(most, SHOWN_MODES)]
    moves = []
    for shape in shapes:
        size = SMALL * extent / (float(np.abs(shape).max()) or 1.0)
        rate = (_all_points(drawn, base + size * shape) - start) / size
        largest = float(np.linalg.norm(rate, axis=-1).max(initial=0.0))
        moves.append(rate * (MODE_SIZE * extent / largest if largest else 0.0))
    codes, step = _quantised(np.array(moves))
    return {"kind": "modes", "t": list(range(1, len(shapes) + 1)), "stored": len(results.array("modes/shapes")),
            "moves": codes, "step": step, "magnify": 1.0, "probes": [],
            "modes": [_mode_label(results, k) for k in range(len(shapes))]}


def _mode_label(results: Results, k: int) -> str:
    table: Mapping[str, Any] = results.tables.get("modes", {})
    if "load_factor" in table:
        return f"buckling {k + 1}: load factor {table['load_factor'][k]:.6g}"
    if not {"kind", "number", "omega"} <= set(table):
        return f"mode {k + 1}"
    unit, omega = results.units.time, float(table["omega"][k])
    growth = float(table["growth"][k]) if "growth" in table else 0.0
    if growth:
        return f"{table['kind'][k]} {int(table['number'][k])}: grows with {growth:.5g} 1/{unit}"
    hertz = f" ({omega / (2 * np.pi):.5g} Hz)" if unit == "s" else ""
    return f"{table['kind'][k]} {int(table['number'][k])}: {omega:.6g} rad/{unit}{hertz}"
