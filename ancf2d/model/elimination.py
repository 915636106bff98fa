"""Linear equations between coordinates solved for some of them: d = T z + P b."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..elements.shape import Array
from .breakpoints import telling_times
from .constraints import Row
from .mesh import Index


@dataclass
class Dependent:
    """A coordinate that follows: sum of factors * unknown coordinates + sum of factors * right-hand sides."""

    terms: dict[int, float]
    rhs: dict[int, float]


@dataclass
class Elimination:
    """Reduced row echelon form of the linear rows.

    ``dependents`` maps a coordinate to what it follows; ``redundant`` lists rows that repeat others, with
    the combination of right-hand sides that must vanish.
    """

    dependents: dict[int, Dependent] = field(default_factory=dict)
    redundant: list[tuple[int, dict[int, float]]] = field(default_factory=list)


def _substitute(terms: dict[int, float], rhs: dict[int, float], done: dict[int, Dependent]) -> None:
    for coord in [c for c in terms if c in done]:
        factor = terms.pop(coord)
        other = done[coord]
        for c, v in other.terms.items():
            terms[c] = terms.get(c, 0.0) + factor * v
        for r, v in other.rhs.items():
            rhs[r] = rhs.get(r, 0.0) - factor * v


def eliminate(rows: list[Row], size: Callable[[int], float]) -> Elimination:
    """Solve the rows one by one for the coordinate that moves most; keep everything reduced.

    ``size(coordinate)`` is the natural magnitude of a coordinate for a unit displacement, which makes the
    choice independent of units.
    """
    out = Elimination()
    done = out.dependents
    used_by: dict[int, set[int]] = {}
    for number, row in enumerate(rows):
        terms = dict(zip(row.coords.tolist(), row.coefs.tolist(), strict=True))
        rhs = {number: 1.0}
        scale = max((abs(v) * size(c) for c, v in terms.items()), default=1.0)
        _substitute(terms, rhs, done)
        terms = {c: v for c, v in terms.items() if abs(v) * size(c) > 1e-12 * scale}
        if not terms:
            out.redundant.append((number, rhs))
            continue
        pivot = max(terms, key=lambda c: (round(abs(terms[c]) * size(c) / scale, 9), c))
        p = terms.pop(pivot)
        new = Dependent({c: -v / p for c, v in terms.items()}, {r: v / p for r, v in rhs.items()})
        for other in used_by.pop(pivot, set()):
            target = done[other]
            factor = target.terms.pop(pivot)
            for c, v in new.terms.items():
                target.terms[c] = target.terms.get(c, 0.0) + factor * v
                used_by.setdefault(c, set()).add(other)
            for r, v in new.rhs.items():
                target.rhs[r] = target.rhs.get(r, 0.0) + factor * v
        done[pivot] = new
        for c in new.terms:
            used_by.setdefault(c, set()).add(pivot)
    return out


def inconsistent(elimination: Elimination, rows: list[Row], t0: float, t1: float) -> list[int]:
    """Return the redundant rows whose right-hand sides contradict the others somewhere from t0 to t1.

    They are compared as functions, at ``telling_times`` of what they follow.
    """
    bad = []
    for number, rhs in elimination.redundant:
        signals = [(factor, s) for r, factor in rhs.items() if (s := rows[r].signal) is not None]
        times = telling_times([s for _, s in signals], t0, t1)
        values = np.array([[factor * s(t) for t in times] for factor, s in signals])
        if np.any(np.abs(values.sum(axis=0)) > 1e-9 * np.abs(values).max(initial=0.0)):
            bad.append(number)
    return bad


def as_columns(elimination: Elimination, index: np.ndarray) -> tuple[Index, Index, Array]:
    """Return (indptr, index, value) of the dependents, in sorted order, with unknown numbers from ``index``."""
    indptr, columns, values = [0], [], []
    for coord in sorted(elimination.dependents):
        for c, v in elimination.dependents[coord].terms.items():
            columns.append(index[c])
            values.append(v)
        indptr.append(len(columns))
    return np.array(indptr, dtype=np.int64), np.array(columns, dtype=np.int64), np.array(values, dtype=np.float64)
