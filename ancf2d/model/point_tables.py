"""Tables of the springs, turning and moving loads and constraints of a model, which the kernels evaluate."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..elements.point_laws import MAX_MEM, MAX_PAR, MAX_SIGNALS
from ..elements.shape import Array
from ..interactions.beam_curves import BeamCurves
from ..interactions.body_contact import facing_table
from ..interactions.contact import CompliantContact
from ..interactions.forces import Patch
from ..interactions.prismatic import OnAxis, sliding_table
from ..kernels.compiled_laws import point_law_addresses, point_law_compilations
from ..kernels.curves import point_accept
from ..kernels.facing import EVERY, IN_RANGE_OR_BESIDE, face
from ..kernels.lowlevel.records import Record
from ..kernels.motion.state import Turning
from ..kernels.points import Assembly, Points, point_constraint_rates, point_matrices
from ..kernels.sliding import sliding_constraint_rates, sliding_matrix
from .constraints import Constraint
from .mesh import Index
from .point_patch import Items, PointConstraint, PointPatch
from .rotation import Turns
from .timing import Clocked, rates_of

# energy, forces (m, n), stiffness (m, n, n) and coordinates (m, n) of m items with n coordinates each
Evaluated = tuple[float, Array, Array, Index]


@runtime_checkable
class HasItems(Protocol):
    """A point law, or many of one kind, in the layout of tables."""

    def items(self) -> Items:
        """Return the law and the items that it acts on."""
        ...


def _joined(parts: list[Any], dtype: type) -> tuple[Index, Array]:
    """Return the start of each part (n + 1,) and the concatenated parts."""
    starts = np.zeros(len(parts) + 1, dtype=np.int64)
    starts[1:] = np.cumsum([p.size for p in parts])
    return starts, np.concatenate([np.zeros(0), *(p.ravel() for p in parts)]).astype(dtype)


def point_table(patches: Sequence[HasItems], signals: list[Any] | None = None,
                steps: bool = False) -> Points:
    """Return the table of point laws; with ``steps`` it includes their forces over a step.

    Signals that are new are appended to ``signals``; the table refers to them by number.
    """
    signals = [] if signals is None else signals
    known = {id(s): k for k, s in enumerate(signals)}
    items = [p.items() for p in patches]
    each = [len(p.p0) for p in items]
    dof, dofs = _joined([row for p in items for row in p.dofs], np.int64)
    entry, G = _joined([row.T for p in items for row in p.G], np.float64)
    field, p0 = _joined([row for p in items for row in p.p0], np.float64)
    n, rows, fed = sum(each), [], []
    par = np.zeros((n, max([MAX_PAR, *(p.par.shape[1] for p in items)])))
    mem = np.zeros((n, max([MAX_MEM, *(p.mem.shape[1] for p in items)])))
    at = 0
    for p, count in zip(items, each, strict=True):
        par[at:at + count, :p.par.shape[1]], mem[at:at + count, :p.mem.shape[1]] = p.par, p.mem
        at += count
        own = p.signal if isinstance(p.signal, tuple) else () if p.signal is None else (p.signal,)
        for signal in own:
            if id(signal) not in known:
                known[id(signal)] = len(signals)
                signals.append(signal)
        rows.append([*(known[id(signal)] for signal in own), *[-1] * (MAX_SIGNALS - len(own))])
        given = p.fed if isinstance(p.fed, tuple) else (p.fed,)
        fed.append([*given, *[-1] * (MAX_SIGNALS - len(given))])
    addresses = np.array([point_law_addresses(p.law, steps) for p in items], dtype=np.int64).reshape(-1, 5)

    def column(values: list[Any], dtype: type) -> Any:
        return np.repeat(np.array(values, dtype=dtype), each, axis=0)
    forces, mean, accept, forces_of_run, accept_run = column(list(addresses), np.int64).reshape(-1, 5).T.copy()
    signal, prescribed = (column(table, np.int64).reshape(-1, MAX_SIGNALS) for table in (rows, fed))
    run = np.concatenate([np.zeros(0, dtype=np.int64), *(
        np.ones(count, dtype=np.int64) if p.runs is None else p.runs for p, count in zip(items, each, strict=True))])
    lever = np.concatenate([np.zeros(0), *(np.abs(p.G).sum(axis=1).ravel() for p in items)])
    return Points(forces, mean, accept, forces_of_run, accept_run, field, dof, entry, dofs, G, _spans(items), p0, par,
                  mem, signal, prescribed, column([p.multiplier for p in items], np.int64),
                  column([p.scale for p in items], np.float64), column([p.on for p in items], np.bool_),
                  np.zeros_like(p0), column([p.restitution for p in items], np.float64), run, np.zeros(n), lever,
                  np.zeros(len(dofs)), no_assembly())


def _spans(items: Sequence[Items]) -> Index:
    """Return for each coordinate of all items the range of fields [first, end) that it affects (coordinates, 2).

    The range is all fields if G changes.
    """
    found = [np.zeros((0, 2), dtype=np.int64)]
    for p in items:
        count, m, n = p.G.shape
        found.append(span(np.swapaxes(p.G, 1, 2)).reshape(-1, 2) if p.stays else np.tile([0, m], (count * n, 1)))
    return np.concatenate(found)


def span(rows: Array) -> Index:
    """Return the range [first, end) of nonzero entries of each row (..., m), all entries if there is none."""
    used = rows != 0.0
    return np.stack([used.argmax(axis=-1), rows.shape[-1] - used[..., ::-1].argmax(axis=-1)], axis=-1)


def no_assembly() -> Assembly:
    """Return an empty ``Assembly`` table, with the same types as a full one."""
    none, index = np.zeros(0), np.zeros(0, dtype=np.int64)
    return Assembly(np.zeros((0, 3), dtype=np.int64), index, none, np.zeros((0, 2), dtype=np.int64), index, none,
                np.zeros(0, dtype=bool), 0)


def turning_table(turns: Turns) -> Turning:
    """Return the table of the sections whose turns are counted."""
    return Turning(turns.begin, turns.dofs, turns.along, turns.across, turns.length)


class Batch:
    """Point laws with equally many coordinates each, evaluated together; ``dofs`` (m, n).

    ``par`` and ``mem`` of the laws become views of the table.
    """

    def __init__(self, patches: Sequence[HasItems]) -> None:
        self.signals: list[Any] = []
        self.patches = patches
        self.constrains = any(patch.items().multiplier >= 0 for patch in patches)
        self.by_rate = any(getattr(patch, "by_rate", False) for patch in patches)
        self.table = Record(point_table(patches, self.signals))
        self.facing, self.curves = Record(facing_table(patches)), BeamCurves(patches)
        m = len(self.table.forces)
        # in contacts between bodies, these change
        self.dofs: Index = self.table.dofs.reshape(m, -1)
        at = 0
        self.timed: list[tuple[int, Any]] = []
        for patch in patches:
            count = len(patch.items().p0)
            if isinstance(patch, PointPatch):
                self.timed += [(at, patch.active)] if patch.active is not None else []
            if isinstance(patch, PointPatch | CompliantContact):
                patch.keep_in(self.table.par, self.table.mem, at)
            at += count
        n = self.dofs.shape[1]
        self._energy, self._shape = np.zeros(m), (m, n, n)

    def amplitudes(self, t: float, rates: bool = False) -> Array:
        """Return the signals (k, 3) at t; time derivatives are 0 without ``rates``, but clocked signals give t."""
        return np.array([(s(t), *(rates_of(s, t) if rates or isinstance(s, Clocked) else (0.0, 0.0)))
                         for s in self.signals]).reshape(-1, 3)

    def turn_to(self, d: Array, within: float = np.inf) -> None:
        """Update the curves of contact points, and the elements opposite to them, to d (n_full,).

        Points that face nothing ``within`` this distance (``kernels.facing.face``) become inactive.
        """
        self.curves.write(self.table, d, False)
        if len(self.facing.item):
            face(self.facing, self.table, d, within, EVERY)

    @property
    def active(self) -> Index | slice:
        """The items that may have forces at the state evaluated last."""
        return np.flatnonzero(self.table.apart < np.inf) if len(self.facing.item) else slice(None)

    def accept(self, d: Array, t: float) -> None:
        """Update the history variables of the laws with the accepted state d (n_full,) at t."""
        self.turn_to(d)
        point_accept(self.table, d, self.amplitudes(t))

    @property
    def rubs(self) -> bool:
        """Return whether there is a contact with a law and friction."""
        return any(isinstance(p, CompliantContact) and p.pair.item.friction > 0.0 for p in self.patches)

    def matrices(self, d: Array, t: float, linear: bool = False, v: Array | None = None
                 ) -> tuple[float, Array, Array, Array]:
        """Return energy, forces (m, n), stiffness and damping (m, n, n) at d with rates v (n_full,), 0 if None.

        ``linear``: constraints are linearised about the reference.
        """
        C = np.empty(self._shape)
        Q, K = self._fill(d, t, linear, v, C)
        return float(self._energy.sum()), Q, K, C

    def _fill(self, d: Array, t: float, linear: bool, v: Array | None, C: Array, stiff: bool = True
              ) -> tuple[Array, Array]:
        """Fill the energies and C, and return the forces and stiffnesses of ``matrices``; an empty C is left out, and
        all matrices unless ``stiff``.
        """
        Q, K = np.empty(self._shape[:2]), np.empty(self._shape) if stiff else C
        for k, active in self.timed:
            self.table.on[k] = active.at(t)
        # the equations of inactive multipliers have another sign, which would change the inertia of tangents
        self.turn_to(d, np.inf if self.constrains else IN_RANGE_OR_BESIDE)
        point_matrices(self.table, d, np.zeros_like(d) if v is None else v, self.amplitudes(t, self.by_rate), linear,
                       self._energy, Q, K, C)
        return Q, K

    @property
    def _nothing(self) -> Array:
        return np.empty((0, *self._shape[1:]))

    def energies(self, d: Array, t: float) -> tuple[float, float]:
        """Return the energies at d (n_full,) without rates; see ``Interactions.energies``."""
        self._fill(d, t, False, None, self._nothing, stiff=False)
        contact = (self.table.restitution != -1.0) & (self.table.fed[:, 0] < 0)
        return float(self._energy.sum()), float(self._energy[~contact].sum())

    def evaluate(self, e: Array, d: Array, t: float, linear: bool = False) -> tuple[float, Array, Array]:
        """Return energy, forces (m, n) and stiffness (m, n, n) at d (n_full,) without rates, as ``matrices`` does."""
        Q, K = self._fill(d, t, linear, None, self._nothing)
        return float(self._energy.sum()), Q, K


def batches(patches: Iterable[Any]) -> list[Any]:
    """Return point laws with equally many coordinates in batches, and all other patches unchanged."""
    alike: dict[int, list[Any]] = {}
    others = []
    for p in patches:
        if isinstance(p, HasItems):
            alike.setdefault(p.items().dofs.shape[1], []).append(p)
        else:
            others.append(p)
    return [*map(Batch, alike.values()), *others]


def _damped(parts: Iterable[Any]) -> list[Batch]:
    return [part for part in parts
            if isinstance(part, Batch) and any(getattr(patch, "damped", False) for patch in part.patches)]


class Interactions:
    """Everything in a model that exerts forces, except its elements and dead loads.

    ``points`` are its point laws in the order springs, loads, flows, constraints; ``e0`` (n_q,) reference coordinates.
    """

    def __init__(self, springs: Sequence[PointPatch], loads: Sequence[Patch], constraints: Sequence[Constraint],
                 e0: Array, flows: Sequence[Any] = ()) -> None:
        self.e0, self.number = e0, len(constraints)
        self.points = [p for p in (*springs, *loads, *flows, *constraints) if isinstance(p, HasItems)]
        self._parts = springs, loads, constraints, flows
        self.joints = [c for c in constraints if isinstance(c, OnAxis)]
        self.sliding = Record(sliding_table(self.joints, e0))

    # batches load the compiled laws, so they are made only on demand; other kernels can be compiled meanwhile
    @cached_property
    def springs(self) -> list[Batch]:
        """The springs."""
        return batches(self._parts[0])

    @cached_property
    def loads(self) -> list[Any]:
        """The loads that turn or move."""
        return batches(self._parts[1])

    @cached_property
    def point_constraints(self) -> list[Batch]:
        """The constraints at points."""
        return batches(c for c in self._parts[2] if isinstance(c, PointConstraint))

    @cached_property
    def flows(self) -> list[Batch]:
        """The flows in bodies."""
        return batches(self._parts[3])

    @cached_property
    def rows(self) -> list[slice]:
        """The rows of each of ``points`` in their common table."""
        counts = [len(p.items().mem) for p in self.points]
        return [slice(end - count, end) for end, count in zip(np.cumsum(counts).tolist(), counts, strict=True)]

    @property
    def memory(self) -> list[tuple[slice, Array]]:
        """The rows of each of ``points``, with its history variables (items, numbers)."""
        return [(rows, p.items().mem) for rows, p in zip(self.rows, self.points, strict=True)]

    def patches(self, d: Array, t: float, elastic: bool = False, linear: bool = False) -> Iterator[Evaluated]:
        """Yield energy, Q, K and coordinates of springs, flows, constraints and, unless ``elastic``, of loads.

        At d (n_full,) without rates. ``linear``: constraints are linearised about the reference. Raises
        ComputationError if a point has left the body on which it slides.
        """
        e = self.e0 + d[:len(self.e0)]
        for batch in self.springs:
            energy, Q, K = batch.evaluate(e, d, t)
            some = batch.active
            yield energy, Q[some], K[some], batch.dofs[some]
        for batch in [*self.flows, *([] if elastic else self.loads)]:
            yield (*batch.evaluate(e, d, t), batch.dofs)
        yield from self.constraints(d, t, linear)

    def constraints(self, d: Array, t: float, linear: bool = False) -> Iterator[Evaluated]:
        """Yield energy (0), Q, K and coordinates of constraints, the multiplier last; arguments as of ``patches``."""
        for batch in self.point_constraints:
            yield 0.0, *batch.evaluate(self.e0, d, t, linear)[1:], batch.dofs
        for i, joint in enumerate(self.joints):
            n = joint.touched + 1
            self.sliding.on[i] = joint.active is None or joint.active.at(t)
            dofs, Q, K = np.empty(n, dtype=np.int64), np.empty(n), np.empty((n, n))
            if not sliding_matrix(self.sliding, i, d, dofs, Q, K):
                raise joint.lost()
            yield 0.0, Q[None], K[None], dofs[None]

    def gradients(self, d: Array, t: float) -> list[tuple[float, Index, Array]]:
        """Return g, coordinates and dg/dd of each constraint of the model at d (n_full,)."""
        n_q, out, found = len(self.e0), d.copy(), {}
        out[n_q:] = 1.0
        for _, Q, _, dofs in self.constraints(out, t):
            for q, coords in zip(Q, dofs, strict=True):
                found[int(coords[-1]) - n_q] = float(q[-1]), coords[:-1], q[:-1]
        return [found[k] for k in range(self.number)]

    def constraint_rates(self, d: Array, v: Array, t: float) -> Array:
        """Return g_t and v^T g_qq v + 2 g_qt v + g_tt (2, m) of the constraints at d with rates v (n_full,)."""
        out = np.zeros((2, len(d)))
        for batch in self.point_constraints:
            batch.turn_to(d)
            point_constraint_rates(batch.table, d, v, batch.amplitudes(t, rates=True), out[0], out[1])
        sliding_constraint_rates(self.sliding, d, v, np.zeros((0, 3)), out[0], out[1])
        return out[:, len(self.e0):]

    def set_friction_anchors(self, d: Array, t: float) -> None:
        """Set missing friction anchors of contacts with a law to the initial state d (n_full,) at t."""
        for batch in self.springs:
            if batch.rubs:
                batch.accept(d, t)

    def energies(self, d: Array, t: float) -> tuple[float, float]:
        """Return the energy of the springs at d (n_full,) or (n_q,), and that of all but the contacts that no signal
        moves, whose energy is evaluated from states and not from work.
        """
        found = [batch.energies(d, t) for batch in self.springs]
        return sum(one for one, _ in found), sum(one for _, one in found)

    @cached_property
    def drags(self) -> list[Batch]:
        """Batches of loads among which some depend on rates."""
        return _damped(self.loads)

    @cached_property
    def dampers(self) -> list[Batch]:
        """Batches of springs and loads among which some depend on rates."""
        return [*_damped(self.springs), *self.drags]

    def rate_forces(self, d: Array, v: Array, t: float, linear: bool = False) -> Iterator[tuple[Array, Index]]:
        """Yield the forces (m, n) that rates v (n_full,) cause at d and t, and their coordinates (m, n).

        ``linear``: to first order in v.
        """
        for batch in self.flows:
            yield np.einsum("mij,mj->mi", batch.matrices(d, t)[3], v[batch.dofs]), batch.dofs
        for batch in self.dampers:
            _, still, _, C = batch.matrices(d, t)
            yield (np.einsum("mij,mj->mi", C, v[batch.dofs]) if linear
                   else batch.matrices(d, t, v=v)[1] - still), batch.dofs


def interaction_compilations(model: Any, steps: bool, problem: Any) -> list[Callable[[], object]]:
    """Return functions that compile the laws of springs, loads, constraints and contacts, and the contact search.

    Forces come first, and functions that share parts with them last: parallel processes would compile these parts
    twice. ``steps`` : whether forces over a step are needed, too; ``problem`` : type of the records that kernels take.
    """
    patches = (*model.springs, *model.loads.patches, *model.loads.flows, *model.constraints)
    laws = {p.items().law: None for p in patches if isinstance(p, HasItems)}
    each = [point_law_compilations(law, steps) for law in laws]
    others = [one for some in each for one in some[1:]]
    if model.contacts:
        from ..kernels.contact import contact_compilations

        bodies = [pair.on_bodies for pair in model.contacts]
        others = contact_compilations(problem, not all(bodies), any(bodies), model.sided,
                                      any(not pair.hard for pair in model.contacts), model.case.solver.moves) + others
    return [*(some[0] for some in each), *others]
