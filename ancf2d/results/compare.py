"""Two result files compared as numbers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.results.reader import Results, open_results

# quantities that share a scale: a displacement of 1e-17 beside one of 1e-3 is round-off
_FAMILIES = {
    "ux": "displacement", "uy": "displacement", "x": "position", "y": "position",
    "vx": "velocity", "vy": "velocity", "ax": "acceleration", "ay": "acceleration",
    "N": "force", "Q": "force", "fx": "force", "fy": "force", "M": "moment", "m": "moment",
    "strain": "energy", "kinetic": "energy", "potential": "energy", "dissipated": "energy", "work": "energy",
}
# "checks" repeat values that are compared anyway, with differences that are round-off where all is well
_NOT_COMPARED = {"wall_s", "output", "case", "reason", "at", "time_s", "checks"}
_TEXTS = {"status", "solver", "kind", "element", "formulation"}
_MEASURES = {"estimate", "energy_drift"}  # relative measures: their scale is 1


@dataclass(frozen=True)
class Difference:
    """The worst difference in one dataset.

    ``index`` is where it is, ``t`` its load factor or time (None where there is none), ``scale``
    what the deviation is judged against, ``count`` how many of ``total`` entries differ. For a
    missing dataset, a different shape or a different text, ``what`` says so and the numbers are
    NaN.
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
        """Return the difference as one line."""
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

    def deviation(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """|a - b|, with NaN equal to NaN, infinities to themselves, and all else infinitely far."""
        with np.errstate(invalid="ignore"):
            gap = np.abs(a - b)
        gap[(a == b) | (np.isnan(a) & np.isnan(b))] = 0.0
        gap[np.isnan(gap)] = np.inf
        return gap

    def judge(self, dataset: str, a: np.ndarray, b: np.ndarray, scale: Any,
              t: Callable[[int], float] | None = None) -> Difference | None:
        """Return the worst entry that deviates by more than atol + rtol * scale."""
        gap = self.deviation(a, b)
        scale = np.broadcast_to(scale, gap.shape)
        over = gap > self.atol + self.rtol * scale
        if not over.any():
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            excess = np.where(over, gap / np.where(scale > 0, scale, np.finfo(float).tiny), -1.0)
        at = np.unravel_index(int(np.argmax(excess)), gap.shape)
        index = tuple(int(i) for i in at)
        return Difference(dataset, "value", float(a[at]), float(b[at]), index,
                          t(index[0]) if t and index else None, float(gap[at]),
                          float(gap[at] / scale[at]) if scale[at] else float("inf"),
                          float(scale[at]), int(over.sum()), gap.size)


def _largest(*arrays: np.ndarray) -> float:
    found = 0.0
    for array in arrays:
        finite = np.abs(array[np.isfinite(array)])
        found = max(found, float(finite.max(initial=0.0)))
    return found


def compare_results(a: str | os.PathLike[str] | Results, b: str | os.PathLike[str] | Results,
                    rtol: float = 1e-9, atol: float = 0.0) -> list[Difference]:
    """Return the differences of two result files, at most one (the worst) per dataset.

    Compared are mesh, states, fields, energies, probes, tables, further arrays and the summary's numbers; not
    compared is what says how and when: wall times, versions, dates, names, residuals per step.
    An entry differs where |a - b| > atol + rtol * scale. The scale is the largest absolute value,
    in either file, among all entries of its kind: positions, slopes and angles of a state over all
    states; displacements, positions, angles, velocities, forces, moments of all probes (of all
    reactions, of all energies); a table's column or a further array. So round-off in an entry that
    ought to be zero is no difference, while any change that is visible beside its like is one.
    Frequencies, load factors, counts and other single numbers are judged against themselves; texts
    (status, solver, kind) must be equal. NaN equals NaN.
    """
    if not (rtol >= 0 and atol >= 0):
        raise ResultsError(f"tolerances must not be negative: rtol {rtol}, atol {atol}")
    tolerance = _Tolerance(rtol, atol)
    with ExitStack() as stack:
        one, two = (f if isinstance(f, Results) else stack.enter_context(open_results(f))
                    for f in (a, b))
        return [d for part in (_mesh, _states, _fields, _energies, _probes, _tables, _arrays, _summary)
                for d in part(one, two, tolerance) if d is not None]


def comparison_text(differences: Sequence[Difference], a: object, b: object) -> str:
    """Return what ``ancf2d compare`` prints."""
    if not differences:
        return f"{a} and {b} agree"
    return "\n".join([f"{a} and {b} differ:", *(f"  {d}" for d in differences)])


def differences_json(differences: Sequence[Difference]) -> list[dict[str, Any]]:
    """Return the differences as JSON-able objects."""
    return [asdict(d) for d in differences]


Found = Iterator[Difference | None]


def _shapes(dataset: str, a: tuple[int, ...], b: tuple[int, ...]) -> Difference | None:
    return None if a == b else Difference(dataset, f"shapes {a} and {b} differ")


def _names(place: str, a: Any, b: Any) -> Found:
    for name in [*a, *(n for n in b if n not in a)]:
        if (name in a) != (name in b):
            yield Difference(f"{place}/{name}", f"only in the {'first' if name in a else 'second'}")


def _kinds(r: Results) -> np.ndarray:
    """Return the kind of each coordinate (nq,): 0 position, 1 slope, 2 angle, 3 r_yy and on."""
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
    shape = _shapes("/mesh/e0", a.e0.shape, b.e0.shape)
    yield shape
    if shape is None:
        kinds = _kinds(a)
        yield tol.judge("/mesh/e0", a.e0, b.e0, _by_kind(kinds, _largest_in_columns(a.e0[None], b.e0[None]))[kinds])
    for name in a.bodies.keys() & b.bodies.keys():
        one, two = a.bodies[name], b.bodies[name]
        for key in ("element_type", "formulation", "section_kind"):
            if getattr(one, key) != getattr(two, key):
                yield Difference(f"/mesh/bodies/{name}", f"{key} '{getattr(one, key)}' and "
                                                         f"'{getattr(two, key)}' differ")
        for key in ("dofs", "nodes", "lengths", "arclength", "height", "width"):
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
    """Return the largest value of the coordinates (nq,) of each kind."""
    scale = np.zeros(int(kinds.max(initial=0)) + 1)
    np.maximum.at(scale, kinds, largest)
    return scale


def _states(a: Results, b: Results, tol: _Tolerance) -> Found:
    shape = _shapes("/states/d", (a.nt, a.nq), (b.nt, b.nq))
    if shape or not a.nt:
        yield shape
        return
    yield tol.judge("/states/t", a.t, b.t, _largest(a.t, b.t))
    kinds = _kinds(a)
    for name in ("d", "v", "a"):
        held = [r.holds(name) for r in (a, b)]
        if held[0] != held[1]:
            yield Difference(f"/states/{name}", f"only in the {'first' if held[0] else 'second'}")
        if not all(held):
            continue
        largest = np.zeros(a.nq)
        for x, y in zip(a.blocks(name), b.blocks(name), strict=True):
            largest = np.maximum(largest, _largest_in_columns(x, y))
        blocks = zip(a.blocks(name), b.blocks(name), strict=True)
        yield _worst_state(f"/states/{name}", blocks, a, _by_kind(kinds, largest)[kinds], tol)


def _worst_state(place: str, blocks: Iterable[tuple[np.ndarray, np.ndarray]], a: Results,
                 scale: np.ndarray, tol: _Tolerance) -> Difference | None:
    """Return the worst entry of all states, given some of both files at a time."""
    worst, count, first, total = None, 0, 0, 0
    for x, y in blocks:
        found = tol.judge(place, x, y, scale)
        if found is not None:
            count += found.count
            if worst is None or found.relative > worst.relative:
                state, *entry = found.index
                worst = replace(found, index=(first + state, *entry), t=float(a.t[first + state]))
        first += len(x)
        total += x.size
    return replace(worst, count=count, total=total) if worst else None


def _fields(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/fields", a.fields, b.fields)
    for body in [n for n in a.fields if n in b.fields]:
        place = f"/fields/{body}"
        yield from _names(place, a.fields[body], b.fields[body])
        for name in [n for n in a.fields[body] if n in b.fields[body]] if a.nt == b.nt else ():
            shape = _shapes(f"{place}/{name}", *(r.field(body, name).shape for r in (a, b))) if a.nt else None
            if shape is not None:
                yield shape
                continue
            largest = max((_largest(x, y) for x, y in _field_blocks(a, b, body, name)), default=0.0)
            yield _worst_state(f"{place}/{name}", _field_blocks(a, b, body, name), a, np.asarray(largest), tol)


def _field_blocks(a: Results, b: Results, body: str, name: str) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    return zip(a.field_blocks(body, name), b.field_blocks(body, name), strict=True)


def _probes(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/probes", a.probes, b.probes)
    shape = _shapes("/probes", a.probe_t.shape, b.probe_t.shape)
    if shape:
        yield shape
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
            yield tol.judge(f"/probes/{name}/{quantity}", a.probes[name][quantity],
                            b.probes[name][quantity], scales[_FAMILIES.get(quantity, quantity)],
                            lambda i: float(a.probe_t[i]))


def _energies(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/energies", a.energies, b.energies)
    if a.nt == b.nt:
        scale = _largest(*a.energies.values(), *b.energies.values())
        for name in [n for n in a.energies if n in b.energies]:
            yield tol.judge(f"/energies/{name}", a.energies[name], b.energies[name], scale, lambda i: float(a.t[i]))


def _tables(a: Results, b: Results, tol: _Tolerance) -> Found:
    yield from _names("/tables", a.tables, b.tables)
    for name in [n for n in a.tables if n in b.tables]:
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


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _family(path: tuple[Any, ...]) -> str:
    """Return the kind of a number in the summary, empty where it is judged against itself."""
    return "momentum" if path[:2] == ("momentum", "linear") else _FAMILIES.get(path[-1], "")


def _summary_scales(summaries: Sequence[dict[tuple[Any, ...], Any]]) -> dict[Any, float]:
    scales: dict[Any, float] = {}
    for found in summaries:
        for path, value in found.items():
            if _number(value) and _family(path):
                family = (path[0], _family(path))
                scales[family] = max(scales.get(family, 0.0), _largest(np.array([float(value)])))
    return scales


def _summary(a: Results, b: Results, tol: _Tolerance) -> Found:
    one, two = (dict(_leaves(r.summary)) for r in (a, b))
    scales = _summary_scales([one, two])
    for path in [*one, *(p for p in two if p not in one)]:
        place = "summary." + ".".join(map(str, path))
        if (path in one) != (path in two):
            yield Difference(place, f"only in the {'first' if path in one else 'second'}")
            continue
        x, y = one[path], two[path]
        if not (_number(x) and _number(y)):
            if x != y and (path[-1] in _TEXTS or type(x) is not type(y) or isinstance(x, bool)):
                yield Difference(place, f"{x!r} and {y!r} differ", x, y)
            continue
        u, v = np.array([float(x)]), np.array([float(y)])
        own = scales.get((path[0], _family(path)), _largest(u, v))
        found = tol.judge(place, u, v, 1.0 if path[-1] in _MEASURES else own)
        yield replace(found, index=()) if found else None
