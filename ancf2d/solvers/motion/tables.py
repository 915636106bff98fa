"""The parts of a motion's problem other than elements: signals, mass, dead loads, prescribed motion, point laws."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...case.programs import programs
from ...elements.contact_geometry import BODY, FRICTION, SHAPE
from ...elements.shape import Array
from ...kernels.matrices.layout import entries, no_fronts
from ...kernels.points import Assembly, Points
from ...model.mesh import Index
from ...model.model import Model
from ...model.numbering import Numbering
from ...model.point_tables import point_table, span
from ..energy import is_constant

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


class Signals:
    """The signals of a problem, without duplicates."""

    def __init__(self) -> None:
        self.all: list[Any] = []
        self._rows: dict[Any, int] = {}

    def row(self, signal: Any) -> int:
        """Return the row of a signal, which is added if it is new."""
        if signal not in self._rows:
            self._rows[signal] = len(self.all)
            self.all.append(signal)
        return self._rows[signal]

    def programs(self) -> Any:
        """Return the programs that evaluate the signals."""
        return programs(((None, 0.0, 0.0) if s.feedback else (s.amplitude, s.factor, s.offset)
                         for s in self.all), {k for k, s in enumerate(self.all) if s.clocked})


def natural_signals(model: Model, signals: Signals) -> None:
    """Assign to natural strains the rows of the signals that they follow."""
    # loads get their places among the elements when the groups are made
    _ = model.groups
    for load in model.loads.natural:
        load.signal[0] = signals.row(load.amplitude)


def mass_tables(M: csr_matrix | None, num: Numbering) -> dict[str, Any]:
    """Return a mass matrix (None for zero) stored as in ``kernels.matrices.symmetric``, and the diagonals of a band."""
    from scipy.sparse import coo_matrix, tril

    n = num.n_unknowns
    low = coo_matrix((n, n)) if M is None else tril(M).tocoo()
    width = 0 if num.fronts is not None else _width(num)
    out = np.zeros(n * width if num.fronts is None else int(num.fronts.at[-1]))
    out[_slots(num)(low.row, low.col)] = low.data
    return {"fronts": no_fronts() if num.fronts is None else num.fronts, "width": width, "mass": out,
            **_diagonals(out.reshape(-1, width) if width else np.zeros((0, 0)))}


def _width(num: Numbering) -> int:
    """Return how many entries a band has in each row."""
    return min(num.half_bandwidth, max(num.n_unknowns - 1, 0)) + 1


def _slots(num: Numbering) -> Callable[[Index, Index], Index]:
    """Return a function that finds the storage places of entries (i, j), j <= i, of a matrix of the unknowns."""
    if num.fronts is not None:
        return partial(entries, num.fronts)
    width = _width(num)
    return lambda i, j: np.asarray(i * width + width - 1 + j - i)


def _diagonals(mass: Array) -> dict[str, Array]:
    """Return the numbers of the nonzero diagonals of a band, and their entries, each at its column."""
    n, width = mass.shape
    found = [d for d in range(width) if mass[d:, width - 1 - d].any()]
    diagonals = np.zeros((len(found), n))
    for row, d in zip(diagonals, found, strict=True):
        row[:n - d] = mass[d:, width - 1 - d]
    return {"mass_offsets": np.array(found, dtype=np.int64), "mass_diagonals": diagonals}


def dead_loads(model: Model, signals: Signals) -> dict[str, Array]:
    coord, value, row, varies = [], [], [], []
    for load in model.loads.dead:
        coord.append(load.dofs)
        value.append(load.values)
        row.append(np.full(len(load.dofs), signals.row(load.amplitude)))
        varies.append(np.full(len(load.dofs), not is_constant(load.amplitude)))
    empty = np.zeros(0)

    def joined(parts: list[Any], kind: Any) -> Any:
        return np.concatenate([empty, *parts]).astype(kind)
    return {"load_coord": joined(coord, np.int64), "load_value": joined(value, float),
            "load_signal": joined(row, np.int64), "load_varies": joined(varies, bool)}


def prescribed(model: Model, signals: Signals) -> dict[str, Array]:
    """Return the entries of P, the effect of prescribed motion on coordinates."""
    entries = [(coord, factor, signals.row(model.rows[r].signal))
               for coord, dependent in sorted(model.elimination.dependents.items())
               for r, factor in dependent.rhs.items() if model.rows[r].signal is not None]
    return {"motion_coord": np.array([e[0] for e in entries], dtype=np.int64),
            "motion_factor": np.array([e[1] for e in entries], dtype=float),
            "motion_signal": np.array([e[2] for e in entries], dtype=np.int64)}


def motions(model: Model, M: csr_matrix, T: csr_matrix, signals: Signals) -> dict[str, Array]:
    """Return prescribed motion: entries of P, T^T M P and P^T M P by signal."""
    found = prescribed(model, signals)
    driven = [bool(np.isin(pool.dofs, found["motion_coord"]).any()) for pool in model.pools]
    return {**found, **moved_mass(M, T, **found), "driven": np.array(driven, dtype=bool)}


def moved_mass(M: csr_matrix, T: csr_matrix, motion_coord: Array, motion_factor: Array, motion_signal: Array
               ) -> dict[str, Array]:
    """Return T^T M P and P^T M P by signal."""
    from scipy.sparse import csr_matrix

    used = np.unique(motion_signal)
    if not len(used):
        return {"motion_mass": np.zeros((0, T.shape[1])), "motion_mass_signal": used, "motion_mutual": np.zeros((0, 0))}
    P = csr_matrix((motion_factor, (motion_coord, np.searchsorted(used, motion_signal))), shape=(len(M.indptr) - 1,
                                                                                                 len(used)))
    return {"motion_mass": np.ascontiguousarray((T.T @ M @ P).T.toarray()), "motion_mass_signal": used,
            "motion_mutual": np.ascontiguousarray((P.T @ M @ P).toarray())}


def vectors(model: Model) -> tuple[Index, Index]:
    """Return the unknowns (m, 2) that are x and y of one vector, and the coordinates (m, 4) that give its rotation."""
    pairs: dict[tuple[int, int], Index] = {}
    place = model.numbering.place
    for mesh in model.meshes.values():
        element, nc = mesh.plan.element, mesh.plan.element.components
        functionals = list(element.functionals)
        for k, (node, _) in enumerate(functionals):
            source = np.full((len(mesh.dofs), 4), -1)
            slopes = [i for i, (at, name) in enumerate(functionals) if at == node and name in ("r_y", "r_x")]
            if nc == 3:
                source[:, 0] = mesh.dofs[:, 3 * k + 2]
            elif slopes:
                source[:, :2] = mesh.dofs[:, 2 * slopes[-1]:2 * slopes[-1] + 2]
            else:
                source[:, :2], source[:, 2:] = mesh.dofs[:, :2], mesh.dofs[:, -2:]
            xy = place[mesh.dofs[:, nc * k:nc * k + 2]]
            for m in np.flatnonzero((xy >= 0).all(axis=1)).tolist():
                pairs.setdefault((int(xy[m, 0]), int(xy[m, 1])), source[m])
    return (np.array(list(pairs), dtype=np.int64).reshape(-1, 2),
            np.array(list(pairs.values()), dtype=np.int64).reshape(-1, 4))


def with_assembly(points: Points, T: csr_matrix, slots: Callable[[Index, Index], Index]) -> Points:
    """Return a table with the couplings of curves, and of hard contact points with friction, to the unknowns z.

    ``T`` : (n_full, n) with d = T z; ``slots(i, j)`` : places of entries (i, j), j <= i, in the matrix of the unknowns.
    """
    begin, unknown, rows, spans, slot = np.zeros((len(points.forces) + 1, 3), dtype=np.int64), [], [], [], []
    following, rubs = 0, points.restitution >= 0.0
    rubs &= points.par[:, FRICTION] > 0.0 if rubs.any() else False
    for i in range(len(points.forces)):
        begin[i + 1] = begin[i]
        if i < following or (points.forces_of_run[i] == 0 and not rubs[i]):
            continue
        following, n = i + int(points.run[i]), int(points.dof[i + 1] - points.dof[i])
        if rubs[i] and points.par[i, SHAPE] == BODY:
            # the coordinates of the body that it touches change
            begin[i + 1, 2] += n * (n + 1) // 2
            continue
        parts = [slice(*T.indptr[c:c + 2]) for c in points.dofs[points.dof[i]:points.dof[i + 1]]]
        used, to = np.unique(np.concatenate([T.indices[p] for p in parts]), return_inverse=True)
        own = np.zeros((len(used), len(parts)))
        own[to, np.repeat(np.arange(len(parts)), [p.stop - p.start for p in parts])] = np.concatenate(
            [T.data[p] for p in parts])
        W = own @ points.G[points.entry[i]:points.entry[i + 1]].reshape(len(parts), -1)
        high, low = np.tril_indices(len(used))
        unknown.append(used)
        rows.append(W.ravel())
        spans.append(span(W))
        slot.append(slots(np.maximum(used[low], used[high]), np.minimum(used[low], used[high])))
        begin[i + 1] += [len(used), W.size, len(low)]
    index = np.zeros(0, dtype=np.int64)
    return points._replace(assembly=Assembly(
        begin, np.concatenate([index, *unknown]), np.concatenate([np.zeros(0), *rows]),
        np.concatenate([index.reshape(0, 2), *spans]), np.concatenate([index, *slot]), np.zeros(int(begin[-1, 2])),
        np.zeros(len(points.forces), dtype=bool), max((len(u) for u in unknown), default=0)))


def assembled_laws(model: Model, num: Numbering, T: csr_matrix, signals: Signals, steps: bool) -> Any:
    """Return the table of all point laws with the unknowns z that they act on, by d = T z (n_q,)."""
    from scipy.sparse import csr_matrix, vstack

    multipliers = num.place[num.n_q:]
    used = np.flatnonzero(multipliers >= 0)
    rest = csr_matrix((np.ones(len(used)), (used, multipliers[used])), shape=(len(multipliers), num.n_unknowns))
    return with_assembly(point_laws(model, signals, steps), vstack([T, rest]).tocsr(), _slots(num))


def stops_of(model: Model) -> Index:
    """Return the ranges of items in the table of all point laws that are one-sided or have a gap, as ``Problem.stops``.
    """
    first, found = 0, []
    for p in model.interactions.points:
        last, begin = first + len(p.items().p0), first + np.array(getattr(p, "breaks", ()), dtype=np.int64)
        found.append(np.column_stack([begin, np.append(begin, last)[1:], begin]))
        first = last
    return np.concatenate([np.zeros((0, 3), dtype=np.int64), *found])


def point_laws(model: Model, signals: Signals, steps: bool = False) -> Any:
    """Return the table of all point laws; with ``steps``, also with their forces over a step."""
    own: list[Any] = []
    table = point_table(model.interactions.points, own, steps=steps)
    rows = np.array([-1 if k < 0 else signals.row(own[k]) for k in table.signal.ravel()], dtype=np.int64)
    return table._replace(signal=rows.reshape(table.signal.shape))


def with_own(table: Any, *names: str) -> Any:
    """Return a table with copies of some of its arrays."""
    return table._replace(**{name: getattr(table, name).copy() for name in names})
