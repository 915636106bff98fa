"""Numerical comparison of two result files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.quantities import KIND_OF
from ancf2d.results.reader import Results, open_results

# quantities that share a scale: a displacement of 1e-17 next to one of 1e-3 is round-off
_FAMILIES = {
    **{name: kind for name, kind in KIND_OF.items() if name not in ("theta", "omega")},
    "strain": "energy", "kinetic": "energy", "potential": "energy", "dissipated": "energy", "work": "energy",
}
# "checks" and the table "computed" of a sweep repeat values that are compared elsewhere: round-off, and times
_NOT_COMPARED = {"wall_s", "output", "case", "reason", "at", "time_s", "checks", "computed"}
# how a result was computed, as opposed to the result
_COUNTERS = {"iterations", "steps", "rejected", "dt"}
_TEXTS = {"status", "solver", "kind", "element", "formulation"}
_MEASURES = {"estimate", "energy_drift"}  # relative measures: their scale is 1


@dataclass(frozen=True)
class Difference:
    """The worst difference in one dataset.

    ``index`` is its place, ``t`` its load factor or time (None if there is none), ``scale`` the value that it is
    relative to, ``count`` the number of the ``total`` entries that differ. For a missing dataset, a different shape or
    a different text, ``what`` describes it and the numbers are NaN.
    """

    dataset: str
    what: str
    a: Any = None
    b: Any = None
    index: tuple[int, ...] = ()
    t: float | None = None
    absolute: float = float("nan")
    relative: float = float("nan")
    scale: float = float("nan")
    count: int = 1
    total: int = 1

    def __str__(self) -> str:
        """Return the difference as one line of text."""
        if self.what != "value":
            return f"{self.dataset}: {self.what}"
        place = f"[{', '.join(map(str, self.index))}]" if self.index else ""
        when = "" if self.t is None else f" at t = {self.t:.6g}"
        some = f"; {self.count} of {self.total} entries differ" if self.total > 1 else ""
        return (f"{self.dataset}{place}{when}: {self.a:.17g} and {self.b:.17g}, deviation "
                f"{self.absolute:.2e}, {self.relative:.2e} of {self.scale:.3g}{some}")


@dataclass(frozen=True)
class _Tolerance:
    rtol: float
    atol: float
    everything: bool = False  # also compare counters and steps

    def deviation(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return |a - b|: 0 for two NaNs or equal infinities, infinite if only one is NaN."""
        with np.errstate(invalid="ignore"):
            gap = np.abs(a - b)
        gap[(a == b) | (np.isnan(a) & np.isnan(b))] = 0.0
        gap[np.isnan(gap)] = np.inf
        return gap

    def judge(self, dataset: str, a: np.ndarray, b: np.ndarray, scale: Any) -> Difference | None:
        """Return the worst of the entries that deviate by more than atol + rtol * scale, or None."""
        gap = self.deviation(a, b)
        scale = np.broadcast_to(scale, gap.shape)
        over = gap > self.atol + self.rtol * scale
        if not over.any():
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            excess = np.where(over, gap / np.where(scale > 0, scale, np.finfo(float).tiny), -1.0)
        at = np.unravel_index(int(np.argmax(excess)), gap.shape)
        index = tuple(int(i) for i in at)
        return Difference(dataset, "value", float(a[at]), float(b[at]), index, None, float(gap[at]),
                          float(gap[at] / scale[at]) if scale[at] else float("inf"), float(scale[at]),
                          int(over.sum()), gap.size)


def _largest(*arrays: np.ndarray) -> float:
    return max((float(np.abs(a[np.isfinite(a)]).max(initial=0.0)) for a in arrays), default=0.0)


def compare_results(a: str | os.PathLike[str] | Results, b: str | os.PathLike[str] | Results,
                    rtol: float = 1e-9, atol: float = 0.0, everything: bool = False) -> list[Difference]:
    """Return the differences of two result files, at most one (the worst) per dataset.

    Compared are mesh, states, fields, energies, probes, tables, further arrays and the numbers of the summary. Wall
    times, versions, dates, names and residuals per step are not compared. Unless ``everything`` is set, numbers of
    steps and iterations are not compared either, and if the files have different numbers of states, only those at
    common times are compared (``left_out`` says so), or for paths the first and the last.
    An entry differs if |a - b| > atol + rtol * scale. The scale is the largest absolute value, in either file, among
    all entries of its kind: positions, slopes and angles of a state over all states; displacements, positions, angles,
    velocities, forces, moments of all probes (of all reactions, of all energies); a table's column or a further array.
    So round-off in an entry that should be zero is not a difference, but any change visible on the scale of its kind
    is. Frequencies, load factors, counts and other single numbers are compared relative to themselves; texts (status,
    solver, kind) must be equal. NaN equals NaN.
    """
    if not (rtol >= 0 and atol >= 0):
        raise ResultsError(f"tolerances must not be negative: rtol {rtol}, atol {atol}")
    tolerance = _Tolerance(rtol, atol, everything)
    with ExitStack() as stack:
        one, two = (f if isinstance(f, Results) else stack.enter_context(open_results(f)) for f in (a, b))
        return [d for part in (_mesh, _states, _fields, _energies, _probes, _tables, _arrays, _summary)
                for d in part(one, two, tolerance) if d is not None]


def comparison_text(differences: Sequence[Difference], a: object, b: object) -> str:
    """Return the text that ``ancf2d compare`` prints."""
    return "\n".join([f"{a} and {b} {'differ:' if differences else 'agree'}", *(f"  {d}" for d in differences)])


def differences_json(differences: Sequence[Difference]) -> list[dict[str, Any]]:
    """Return the differences as JSON-able objects."""
    return [asdict(d) for d in differences]


Found = Iterator[Difference | None]
Rows = tuple[np.ndarray, np.ndarray]
Pairs = Iterator[tuple[np.ndarray, np.ndarray]]


def _shapes(dataset: str, a: tuple[int, ...], b: tuple[int, ...]) -> Difference | None:
    return None if a == b else Difference(dataset, f"shapes {a} and {b} differ")


def _names(place: str, a: Any, b: Any) -> Found:
    for name in (n for n in [*a, *b] if (n in a) != (n in b)):
        yield Difference(f"{place}/{name}", f"only in the {'first' if name in a else 'second'}")


def _rows(a: np.ndarray, b: np.ndarray, tol: _Tolerance) -> Rows | None:
    """Return the indices of the times that are compared in two files: all, or the common ones; None if there are none.

    Load factors may return along a path; then only the first and last states are known to correspond.
    """
    if len(a) == len(b) or tol.everything:
        return (np.arange(len(a)), np.arange(len(b))) if len(a) == len(b) else None
    if not (len(a) and len(b)):
        return None
    if not all((np.diff(t) > 0).all() for t in (a, b)):
        return np.array([0, len(a) - 1]), np.array([0, len(b) - 1])
    # equal to nine digits; the offset 0.3 keeps multiples of simple fractions away from the bounds of the bins
    x, y = (np.floor(t / (1e-9 * max(_largest(a, b), 1e-290)) + 0.3) for t in (a, b))
    _, one, two = np.intersect1d(x, y, return_indices=True)
    return (one, two) if len(one) else None


def left_out(a: Results, b: Results) -> str:
    """Return a note on the states that ``compare_results`` leaves out if the numbers of states differ; else empty."""
    if a.nt == b.nt or (rows := _rows(a.t, b.t, _Tolerance(0.0, 0.0))) is None:
        return ""
    return f"{len(rows[0])} of {a.nt} and {b.nt} states are compared, those at common load factors or times"


def _kinds(r: Results) -> np.ndarray:
    """Return the kind of each coordinate (nq,): 0 position, 1 slope, 2 angle, 3 r_yy and higher derivatives."""
    kinds = np.ones(r.nq, np.int8)
    for body in r.bodies.values():
        nc = body.components
        for column in range(body.dofs.shape[1]):
            name = body.coordinate_names[column] if body.coordinate_names else ""
            kind = 2 if column % nc == 2 else (3 if name.startswith("ryy") else 1)
            kinds[body.dofs[:, column]] = kind
        for k in body.node_shape:
            kinds[body.dofs[:, k * nc:k * nc + 2]] = 0
    return kinds


def _mesh(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/mesh/bodies", a.bodies, b.bodies)
    yield (shape := _shapes("/mesh/e0", a.e0.shape, b.e0.shape))
    if shape is None:
        kinds = _kinds(a)
        yield tol.judge("/mesh/e0", a.e0, b.e0, _by_kind(kinds, _largest_in_columns(a.e0[None], b.e0[None]))[kinds])
    for name in a.bodies.keys() & b.bodies.keys():
        one, two = a.bodies[name], b.bodies[name]
        for key in ("element_type", "formulation", "section_kind"):
            x, y = getattr(one, key), getattr(two, key)
            if x != y:
                yield Difference(f"/mesh/bodies/{name}", f"{key} '{x}' and '{y}' differ")
        for key in ("dofs", "nodes", "lengths", "arclength", "height", "width", "heights", "levels"):
            place = f"/mesh/bodies/{name}/{key}"
            x, y = (np.atleast_1d(getattr(body, key)) for body in (one, two))
            shape = _shapes(place, x.shape, y.shape)
            if shape or not np.array_equal(x, y):
                x, y = x.astype(float), y.astype(float)
                yield shape or tol.judge(place, x, y, _largest(x, y))


def _largest_in_columns(*blocks: np.ndarray) -> np.ndarray:
    """Return the largest finite absolute value in each column (nq,) of blocks of rows (n, nq)."""
    return np.max([np.where(np.isfinite(rows), np.abs(rows), 0).max(axis=0, initial=0) for rows in blocks],
                  axis=0).astype(float)


def _by_kind(kinds: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """Return the maximum over the coordinates of each kind; ``largest`` (nq,) has one value for each coordinate."""
    np.maximum.at(scale := np.zeros(int(kinds.max(initial=0)) + 1), kinds, largest)
    return scale


def _states(a: Results, b: Results, tol: _Tolerance) -> Found:
    rows = _rows(a.t, b.t, tol)
    if rows is None or a.nq != b.nq or not a.nt:
        yield _shapes("/states/d", (a.nt, a.nq), (b.nt, b.nq))
        return
    yield tol.judge("/states/t", a.t[rows[0]], b.t[rows[1]], _largest(a.t, b.t))
    kinds = _kinds(a)
    for name in ("d", "v", "a"):
        held = [r.holds(name) for r in (a, b)]
        if held[0] != held[1]:
            yield Difference(f"/states/{name}", f"only in the {'first' if held[0] else 'second'}")
        if not all(held):
            continue
        largest = np.zeros(a.nq)
        for x, y in _state_blocks(a, b, rows, name):
            largest = np.maximum(largest, _largest_in_columns(x, y))
        yield _worst_state(f"/states/{name}", _state_blocks(a, b, rows, name), a, rows[0],
                           _by_kind(kinds, largest)[kinds], tol)


def _blocks(a: Results, b: Results, rows: Rows, whole: Callable[[Results], Iterator[np.ndarray]],
            one: Callable[[Results, int], np.ndarray]) -> Pairs:
    """Yield pairs of the compared states: ``whole`` blocks if all are compared, else ``one`` state at a time."""
    if a.nt == b.nt:
        yield from zip(whole(a), whole(b), strict=True)
    else:
        yield from ((one(a, int(i))[None], one(b, int(j))[None]) for i, j in zip(*rows, strict=True))


def _state_blocks(a: Results, b: Results, rows: Rows, name: str) -> Pairs:
    return _blocks(a, b, rows, lambda r: r.blocks(name), lambda r, i: np.asarray(getattr(r, name)(i)))


def _worst_state(place: str, blocks: Pairs, a: Results, rows: np.ndarray,
                 scale: np.ndarray, tol: _Tolerance) -> Difference | None:
    """Return the worst entry of the compared states, from pairs of blocks; ``rows`` are the states' numbers in a."""
    worst, count, first, total = None, 0, 0, 0
    for x, y in blocks:
        found = tol.judge(place, x, y, scale)
        if found is not None:
            count += found.count
            if worst is None or found.relative > worst.relative:
                state, *entry = found.index
                number = int(rows[first + state])
                worst = replace(found, index=(number, *entry), t=float(a.t[number]))
        first += len(x)
        total += x.size
    return replace(worst, count=count, total=total) if worst else None


def _fields(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/fields", a.fields, b.fields)
    rows = _rows(a.t, b.t, tol)
    if rows is None:
        return
    for body in [n for n in a.fields if n in b.fields]:
        place = f"/fields/{body}"
        yield from _names(place, a.fields[body], b.fields[body])
        for name in [n for n in a.fields[body] if n in b.fields[body]]:
            shape = _shapes(f"{place}/{name}", *(r.field(body, name).shape for r in (a, b))) if a.nt else None
            if shape is not None:
                yield shape
                continue
            largest = max((_largest(x, y) for x, y in _field_blocks(a, b, rows, body, name)), default=0.0)
            yield _worst_state(f"{place}/{name}", _field_blocks(a, b, rows, body, name), a, rows[0],
                               np.asarray(largest), tol)


def _field_blocks(a: Results, b: Results, rows: Rows, body: str, name: str) -> Pairs:
    return _blocks(a, b, rows, lambda r: r.field_blocks(body, name), lambda r, i: r.field(body, name, i))


def _probes(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/probes", a.probes, b.probes)
    rows = _rows(a.probe_t, b.probe_t, tol)
    if rows is None:
        yield _shapes("/probes", a.probe_t.shape, b.probe_t.shape)
        return
    scales: dict[str, float] = {}
    for r in (a, b):
        for columns in r.probes.values():
            for quantity, values in columns.items():
                family = _FAMILIES.get(quantity, quantity)
                scales[family] = max(scales.get(family, 0.0), _largest(values))
    for name in [n for n in a.probes if n in b.probes]:
        yield from _names(f"/probes/{name}", a.probes[name], b.probes[name])
        for quantity in [q for q in a.probes[name] if q in b.probes[name]]:
            yield _series(f"/probes/{name}/{quantity}", a.probes[name][quantity], b.probes[name][quantity], rows,
                          scales[_FAMILIES.get(quantity, quantity)], a.probe_t, tol)


def _energies(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/energies", a.energies, b.energies)
    rows = _rows(a.t, b.t, tol)
    if rows is not None:
        scale = _largest(*a.energies.values(), *b.energies.values())
        for name in [n for n in a.energies if n in b.energies]:
            yield _series(f"/energies/{name}", a.energies[name], b.energies[name], rows, scale, a.t, tol)


def _series(place: str, a: np.ndarray, b: np.ndarray, rows: Rows, scale: float, t: np.ndarray,
            tol: _Tolerance) -> Difference | None:
    """Return the worst difference of two series, with its index in the first one and the time there."""
    found = tol.judge(place, a[rows[0]], b[rows[1]], scale)
    number = int(rows[0][found.index[0]]) if found else 0
    return found and replace(found, index=(number,), t=float(t[number]))


def _tables(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/tables", a.tables, b.tables)
    for name in [n for n in a.tables if n in b.tables and n not in _NOT_COMPARED]:
        one, two = a.tables[name], b.tables[name]
        yield from _names(f"/tables/{name}", one, two)
        shape = _shapes(f"/tables/{name}", (one.rows,), (two.rows,))
        if shape:
            yield shape
            continue
        for key in [k for k in one if k in two and k not in _NOT_COMPARED]:
            place = f"/tables/{name}/{key}"
            if isinstance(one[key], list) or isinstance(two[key], list):
                if list(one[key]) != list(two[key]):
                    yield Difference(place, "texts differ")
                continue
            x, y = (np.asarray(v, float) for v in (one[key], two[key]))
            yield tol.judge(place, x, y, _largest(x, y))


def _arrays(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/arrays", a.arrays, b.arrays)
    for name in [n for n in a.arrays if n in b.arrays]:
        place = f"/arrays/{name}"
        shape = _shapes(place, a.arrays[name].shape, b.arrays[name].shape)
        if shape:
            yield shape
            continue
        x, y = a.array(name), b.array(name)
        if x.ndim == 2 and bool(a.arrays[name].attrs.get("up_to_sign", False)):
            y = np.where(np.einsum("ij,ij->i", x, y) < 0, -1.0, 1.0)[:, None] * y
        yield tol.judge(place, x, y, _largest(x, y))


def _leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, entry in items:
        if key in _NOT_COMPARED:
            continue
        if isinstance(entry, (dict, list)):
            yield from _leaves(entry, (*path, key))
        else:
            yield (*path, key), entry


def _family(path: tuple[Any, ...]) -> str:
    """Return the kind of a number in the summary; empty if it is compared relative to itself."""
    return "momentum" if path[:2] == ("momentum", "linear") else _FAMILIES.get(path[-1], "")


def _summary_scales(summaries: Sequence[dict[tuple[Any, ...], Any]]) -> dict[Any, float]:
    scales: dict[Any, float] = {}
    for found in summaries:
        for path, value in found.items():
            if type(value) in (int, float) and _family(path):
                family = (path[0], _family(path))
                scales[family] = max(scales.get(family, 0.0), _largest(np.array([float(value)])))
    return scales


def _summary(a: Results, b: Results, tol: _Tolerance) -> Found:
    one, two = (dict(_leaves(r.summary)) for r in (a, b))
    scales = _summary_scales([one, two])
    skipped = set() if tol.everything else _COUNTERS
    for path in [p for p in (*one, *(p for p in two if p not in one)) if not skipped.intersection(p)]:
        place = "summary." + ".".join(map(str, path))
        if (path in one) != (path in two):
            yield Difference(place, f"only in the {'first' if path in one else 'second'}")
            continue
        x, y = one[path], two[path]
        if not {type(x), type(y)} <= {int, float}:
            if x != y and (path[-1] in _TEXTS or type(x) is not type(y) or isinstance(x, bool)):
                yield Difference(place, f"{x!r} and {y!r} differ", x, y)
            continue
        u, v = np.array([float(x)]), np.array([float(y)])
        own = scales.get((path[0], _family(path)), _largest(u, v))
        found = tol.judge(place, u, v, 1.0 if path[-1] in _MEASURES else own)
        yield replace(found, index=()) if found else None
