"""The data of a page: bodies in many states or modes, symbols and fields over them, and curves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.results import Results, Table
from ancf2d.results.obstacles import Obstacle, obstacles_of
from ancf2d.results.symbols import completed_case
from ancf2d.view.layers import Drawn, SymbolPoints, drawn_body, fields, listed, packed

BUDGET = 2_800_000  # bytes of states and fields: in base 64 and with all else, a page stays below 5 MB
FIELDS = 0.35  # share of the budget, if there are fields
MAX_STATES = 1500
LARGEST_CODE = 32767
SHOWN_MODES = 24
MODE_SIZE = 0.12  # of the extent: largest displacement of a drawn mode
SMALL = 1e-6  # of the extent: motion from which rates of points are found by differences
INVISIBLE, VISIBLE = 0.01, 0.1  # of the extent: smaller displacements are magnified towards that share
QUARTER = "modes/quarter"
NO_CURVES: dict[str, Any] = {"series": [], "probes": [], "traces": [], "goal": None}


def _quantised(moves: np.ndarray) -> tuple[str, float]:
    """Return displacements as 16-bit codes, and the value of one code."""
    step = float(np.abs(moves).max(initial=0.0)) / LARGEST_CODE
    codes = np.rint(moves / step) if step > 0.0 else np.zeros_like(moves)
    return packed(codes, "i2"), step


def scene(results: Results, wanted: Sequence[str] = ()) -> dict[str, Any]:
    """Return everything that a page shows, ready for JSON; of the fields those that are ``wanted``, or all.

    ``reference`` (points, 2) are points of all bodies (f4); ``moves`` (frames, points, 2) their displacements in
    multiples of ``step`` (i2). Raises ResultsError for a file without bodies or states.
    """
    if not results.bodies:
        raise ResultsError(f"{results.called} holds no bodies to show")
    drawn = [drawn_body(body) for body in results.bodies.values()]
    shapes = results.arrays.get("modes/shapes")
    # buckling may find none
    modes = shapes is not None and shapes.size > 0
    if not modes and not results.nt:
        raise ResultsError(f"{results.called} holds no states to show")
    base = results.e(-1) if modes and results.solver == "eigen" and results.nt else results.e0
    bodies, count = listed(drawn)
    extent = float(np.hypot(*np.ptp(_points(drawn, base), axis=0))) or 1.0
    stage = Stage(results, drawn, SymbolPoints(results, extent), base, count)
    part = _modes(results, stage, extent) if modes else _states(results, stage, extent, wanted)
    units = results.units
    return {"title": results.title or results.path.name, "file": results.path.name, "solver": results.solver,
            "status": results.status, "units": {"length": units.length, "time": units.time, "force": units.force},
            "bodies": bodies, "reference": packed(stage.start, "f4"), "extent": extent,
            "solid": count, **stage.listed(), **part}


def _points(drawn: Sequence[Drawn], e: np.ndarray) -> np.ndarray:
    return np.concatenate([d.points(e) for d in drawn])


def outlined(solids: Sequence[Obstacle]) -> list[np.ndarray]:
    """Return the points of obstacles: for each its filled area, then the lines of its surface."""
    return [points for solid in solids for points in (solid.solid, *solid.lines)]


class Stage:
    """All points of a page: ``count`` of the bodies, then those of symbols and of obstacles.

    ``start`` (points, 2): their initial positions.
    """

    def __init__(self, results: Results, drawn: Sequence[Drawn], attached: SymbolPoints, base: np.ndarray,
                 count: int) -> None:
        self.results, self.drawn, self.attached, self.base, self.count = results, drawn, attached, base, count
        self.start = self.points(base)

    def points(self, e: np.ndarray, state: int | None = None) -> np.ndarray:
        """Return all points (n, 2) at nodal coordinates e (nq,), with obstacles at their places in a state."""
        solids = obstacles_of(self.results, state, 1.0)
        return np.concatenate([_points(self.drawn, e), self.attached.points(e, state), *outlined(solids)])

    def listed(self) -> dict[str, Any]:
        """Return symbols and obstacles in the page's format: the number of their first point, and how many."""
        solids, out = obstacles_of(self.results, None, 1.0), []
        first = len(self.start) - sum(len(points) for points in outlined(solids))
        for solid in solids:
            counts = [len(solid.solid), *map(len, solid.lines)]
            out.append({"name": solid.name, "first": first, "counts": counts})
            first += sum(counts)
        return {**self.attached.listed(self.count), "obstacles": out}

    def rate(self, shape: np.ndarray, extent: float) -> np.ndarray:
        """Return the rates (points, 2) of all points for rates ``shape`` (nq,) of the nodal coordinates."""
        size = SMALL * extent / (float(np.abs(shape).max()) or 1.0)
        return (self.points(self.base + size * shape) - self.start) / size

    def largest(self, moves: np.ndarray) -> float:
        """Return the largest displacement of a body among those of all points (..., points, 2)."""
        return float(np.linalg.norm(moves[..., :self.count, :], axis=-1).max(initial=0.0))

    def max_states(self, budget: int) -> int:
        """Return how many states fit into ``budget`` bytes."""
        size = self.start.nbytes // 4  # two numbers of 16 bits instead of two of 64
        return max(2, min(budget // max(size, 1), MAX_STATES))


# ---------------------------------------------------------------------- states


def _even(t: np.ndarray, most: int) -> np.ndarray:
    """Return at most ``most`` states, evenly spaced in t if it always increases, else in number."""
    if len(t) <= most:
        return np.arange(len(t))
    if np.any(np.diff(t) <= 0):
        return np.unique(np.linspace(0, len(t) - 1, most).round().astype(int))
    return np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], most)).clip(0, len(t) - 1))


def _states(results: Results, stage: Stage, extent: float, wanted: Sequence[str]) -> dict[str, Any]:
    colours = int(FIELDS * BUDGET) if wanted or any(results.fields.values()) else 0
    chosen = _even(results.t, stage.max_states(BUDGET - colours))
    moves = np.array([stage.points(results.e(int(i)), int(i)) - stage.start for i in chosen])
    t = results.t[chosen]
    shown: list[int | None] = [int(i) for i in chosen]
    dynamic = results.over_time
    if results.solver == "linear_static" and len(t) == 1:  # states in between follow by scaling
        t, moves = np.array([0.0, t[0]]), np.concatenate([np.zeros_like(moves), moves])
        shown = [None, *shown]
    codes, step = _quantised(moves)
    return {"kind": "time" if dynamic else "load", "t": t.tolist(), "stored": max(results.nt, len(t)),
            "moves": codes, "step": step, "magnify": _magnification(stage.largest(moves), extent),
            "ways": stage.attached.ways(stage.count, chosen) if len(t) == len(chosen) else [],
            "fields": fields(results, stage.drawn, shown, colours, wanted) if colours else [],
            **(curves(results, t) if len(t) == len(chosen) else NO_CURVES)}


def _magnification(largest: float, extent: float) -> float:
    """Return the power of ten that makes an invisible motion visible, or 1 if it is visible or zero."""
    if not 1e-12 * extent < largest < INVISIBLE * extent:
        return 1.0
    return float(10.0 ** np.floor(np.log10(VISIBLE * extent / largest)))


# ---------------------------------------------------------------------- modes


def _modes(results: Results, stage: Stage, extent: float) -> dict[str, Any]:
    shapes = results.array("modes/shapes")[:min(stage.max_states(BUDGET), SHOWN_MODES)]
    # for modes whose points do not pass through rest together: the shape a quarter of a period later
    later = results.array(QUARTER)[:len(shapes)] if QUARTER in results.arrays else np.zeros_like(shapes)
    moves = []
    for parts in zip(shapes, later, strict=True):
        rates = np.array([stage.rate(shape, extent) for shape in parts])
        largest = stage.largest(rates)
        moves.append(rates * (MODE_SIZE * extent / largest if largest else 0.0))
    codes, step = _quantised(np.array(moves).swapaxes(0, 1) if later.any() else np.array(moves)[:, 0])
    return {"kind": "modes", "t": list(range(1, len(shapes) + 1)), "stored": len(results.array("modes/shapes")),
            "moves": codes, "step": step, "magnify": 1.0, "fields": [], **NO_CURVES, "turning": bool(later.any()),
            "modes": [_mode_label(results, k) for k in range(len(shapes))]}


def _mode_label(results: Results, k: int) -> str:
    table: Mapping[str, Any] = results.tables.get("modes", {})
    if "load_factor" in table:
        return f"buckling {k + 1}: load factor {table['load_factor'][k]:.6g}"
    if not {"kind", "number", "omega"} <= set(table):
        return f"mode {k + 1}"
    unit, omega = results.units.time, float(table["omega"][k])
    growth = float(table["growth"][k]) if "growth" in table else 0.0
    hertz = f" ({omega / (2 * np.pi):.5g} Hz)" if unit == "s" else ""
    parts = [f"{omega:.6g} rad/{unit}{hertz}"] if omega or not growth else []
    parts += [f"{'grows' if growth > 0 else 'decays'} with {abs(growth):.5g} 1/{unit}"] if growth else []
    return f"{table['kind'][k]} {int(table['number'][k])}: {', '.join(parts)}"


MAX_ROWS = 4000  # most rows of each curve
CURVE_BYTES = 600_000  # bytes of all curves together
WHERE = ("x", "y", "ux", "uy")


def curves(results: Results, t: np.ndarray) -> dict[str, Any]:
    """Return the curves of a file whose states at times (or load factors) ``t`` are shown.

    ``series`` are times with the row of each shown state; each of ``probes`` belongs to one of them. ``traces`` are the
    paths of probes; ``goal`` is the number of the curve of the case's goal, or None if there is none.
    """
    goal = completed_case(results).get("goal")
    goal = goal if isinstance(goal, dict) else {}
    wanted = _wanted(goal, results)
    tables = [(results.probe_t, results.probes), (results.t, {"energy": _energies(results)})]
    count = sum(len(columns) for _, found in tables for columns in found.values())
    most = max(2, min(MAX_ROWS, CURVE_BYTES // (8 * max(count, 1))))
    series: list[dict[str, Any]] = []
    listed: list[dict[str, Any]] = []
    traces: list[dict[str, Any]] = []
    for times, found in tables:
        if not len(times) or not any(found.values()):
            continue
        kept, rows = _chosen_rows(times, t, most)
        for curve in _varying(found, kept, wanted):
            listed.append({**curve, "series": len(series)})
        traces += [{**trace, "series": len(series)} for trace in _traces(found, kept)]
        series.append({"t": packed(times[kept], "f8"), "rows": packed(rows, "f4")})
    number = next((k for k, c in enumerate(listed) if (c["probe"], c["quantity"]) == wanted), None)
    return {"series": series, "probes": listed, "traces": traces, "goal": number}


def _wanted(goal: dict[str, Any], results: Results) -> tuple[str, str]:
    """Return the names of the point and the quantity under which a file stores the goal."""
    quantity = str(goal.get("quantity", "")).removesuffix("_energy")
    if "reaction" in goal:
        beside = f"reaction {goal['reaction']}"  # used if a probe has the name of the support
        return beside if beside in results.probes else str(goal["reaction"]), quantity
    return str(goal.get("probe", "energy")), quantity


def _energies(results: Results) -> Table:
    """Return the energies at each stored state; for statics they are read from the steps."""
    if results.energies:
        return results.energies
    found, strain = Table(), np.asarray(results.history.get("energy", ()), float)
    if 0 < len(strain) >= results.nt - 1:
        # a path starts at rest, before its first step
        found["strain"] = np.concatenate([np.zeros(results.nt), strain])[-results.nt:]
        found.units = {"strain": results.history.units.get("energy", "")}
    return found


def _chosen_rows(times: np.ndarray, t: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows to show, and the (fractional) position among them of each state."""
    rows = _rows_of(times, t)
    if len(times) <= most:
        return np.arange(len(times)), rows
    even = np.linspace(0, len(times) - 1, most).astype(int)
    kept = np.unique(np.concatenate([rows, even]) if len(rows) < most else even)
    return kept, np.interp(rows, kept, np.arange(len(kept)))


def _varying(found: dict[str, Table], kept: np.ndarray, wanted: tuple[str, str]) -> Iterator[dict[str, Any]]:
    for name, columns in found.items():
        for quantity, values in columns.items():
            shown = np.asarray(values, float)[kept]
            finite = shown[np.isfinite(shown)]
            if len(finite) > 1 and (np.ptp(finite) > 0 or (name, quantity) == wanted):
                yield {"probe": name, "quantity": quantity, "units": columns.units.get(quantity, ""),
                       "values": packed(shown, "f8")}


def _traces(found: dict[str, Table], kept: np.ndarray) -> Iterator[dict[str, Any]]:
    """Yield the path of each probe: its start, and its displacements."""
    for name, columns in found.items():
        if all(q in columns for q in WHERE):
            x, y, ux, uy = (np.asarray(columns[q], float)[kept] for q in WHERE)
            yield {"probe": name, "start": [float(x[0] - ux[0]), float(y[0] - uy[0])],
                   "ux": packed(ux, "f4"), "uy": packed(uy, "f4")}


def _rows_of(times: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the row of each state: the first one with its time after the row of the state before."""
    out, row = np.zeros(len(t), int), 0
    for k, value in enumerate(t):
        later = np.flatnonzero(times[row:] == value)
        row = row + int(later[0]) if len(later) else min(row, len(times) - 1)
        out[k] = row
    return out
