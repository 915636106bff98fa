"""The effect of a number of a case on the equations of motion: varied models, reduced to the parts that differ."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ...elements.shape import Array
from ...interactions.prismatic import sliding_table
from ...kernels.bodies import addresses
from ...kernels.lowlevel.records import Record
from ...kernels.motion import many_states
from ...kernels.motion.state import scratch
from ...kernels.points import Points
from ...model.breakpoints import motion_pieces
from ...model.groups import of_elements, unlike
from ...model.mesh import Index
from ...model.model import Model
from ...model.point_tables import point_table
from ..linear import fluid_masses, full_mass, point_masses, scattered, unknowns_to_coordinates
from ..motion.dynamic import Run
from ..motion.problem import make_problem, with_own_tables
from ..motion.tables import (
    Signals,
    dead_loads,
    mass_tables,
    moved_mass,
    natural_signals,
    point_laws,
    prescribed,
    with_own,
)
from .differences import UnsuitedError
from .many_states import forces, in_full

# every so many states, second differences of the work are taken to check the step
EVERY = 8
# relation of coordinates and unknowns
_FOLLOWING = ("place", "indptr", "index", "value", "full", "dependents", "motion_coord", "motion_factor",
              "motion_signal")
_LOADS = ("load_coord", "load_value", "load_signal", "load_varies")
# arrays with a row for each item of point laws; and arrays along its fields, its coordinates and its entries
_OF_ITEMS = ("forces", "mean", "accept", "par", "signal", "fed", "multiplier", "scale", "on", "restitution")
_ALONG = {"p0": "field", "drift": "field", "dofs": "dof", "span": "dof", "G": "entry"}


class Differing:
    """Problems of models with a number varied, reduced to the parts that the number changes.

    ``weights`` (k, models) give k differences of the models' values. Raises UnsuitedError if the times of corners of
    signals change.
    """

    def __init__(self, run: Run, models: Sequence[Model], weights: Array) -> None:
        self.run, self.models, self.weights = run, models, weights
        stepper, base = run.stepper, run.problem.values
        signals, found = zip(*(_signals_and_tables(run, model) for model in models), strict=True)
        if any(len(one.all) > len(run.signals) and list(motion_pieces(one.all, run.spec.t_end)) != list(stepper.pieces)
               for one in signals):
            raise UnsuitedError("the times of corners of signals depend on the number")
        self.alphas = np.array([tables["alpha"] for tables in found])
        same = all(_same(getattr(base, name), tables[name]) for tables in found for name in _FOLLOWING)
        # prescribed mass is damped, too
        same = same and (not len(base.motion_coord) or bool(np.all(self.alphas == base.alpha)))
        groups = [run.model.groups, *(model.groups for model in models)]
        same = same and not stepper.moving and not stepper.events and not len(base.facing.item) and all(
            len(own) == len(groups[0]) and all(_same(a.values.dofs, b.values.dofs) for a, b in
                                               zip(groups[0], own, strict=True)) for own in groups)
        self.items: Index | slice = slice(None)
        self.joints = True
        self.reduced = same
        # for each model, groups of elements that are not in its problem, with their damping times
        self.elements: list[list[tuple[Record, float]]] = [[] for _ in models]
        if same:
            self._reduce(base, found, signals)
        else:
            self.problems = [with_own_tables(make_problem(model)[0], model) for model in models]
        # scratch arrays, shared by models with as many signals
        n, rooms = len(base.coordinate), dict[int, Record]()
        for p in self.problems:
            m = len(p.programs.first) - 1
            rooms[m] = rooms.get(m) or Record(scratch(n, len(base.place), len(base.mass), m))
        self.w = [rooms[len(p.programs.first) - 1] for p in self.problems]

    def _reduce(self, base: Any, found: Sequence[dict[str, Any]], signals: Sequence[Signals]) -> None:
        """Make problems of the parts that differ between models."""
        laws = [base.points, *(tables["points"] for tables in found)]
        self.items = _unlike_items(laws)
        sliding = [base.sliding, *(tables["sliding"] for tables in found)]
        self.joints = not all(_same(sliding[0], one) for one in sliding[1:])
        loads = _unlike_loads([base._asdict(), *found])
        groups = self._groups(base)
        if not self.run.model.loads.natural:
            # signals do not act on elements, which can be evaluated at many states at once
            self.elements = [list(zip(records, tau.tolist(), strict=True)) for records, tau in groups]
            groups = [([], np.zeros(0)) for _ in groups]
        empty = sliding_table([], base.e0)
        self.problems = []
        for model, tables, own_signals, (records, tau), values in zip(self.models, found, signals, groups, loads,
                                                                      strict=True):
            points = of_items(tables["points"], self.items)
            joined = with_own(tables["sliding"] if self.joints else empty, "memory", "on", "gap")
            programs = base.programs if len(own_signals.all) == len(self.run.signals) else own_signals.programs()
            mass = mass_tables(None, model.numbering.complete)
            self.problems.append(self.run.problem.replaced(
                records, groups=addresses(records), tau=tau, points=points, sliding=joined,
                patched=bool(len(points.mem)), programs=with_own(programs, "window", "data"),
                motion_mass=np.zeros_like(base.motion_mass), **mass, **values))

    @cached_property
    def inertia(self) -> list[Record]:
        """Problems with the weighted sum of the models' masses, one for each row of weights, if not zero."""
        found = [self._mass(row) for row in self.weights] if self.reduced else []
        return [p for p in found if p is not None]

    @cached_property
    def mass(self) -> Any:
        """The sparse sum of the models' masses by the first weights, or None if it is zero."""
        if not (self.reduced and self._blocks):
            return None
        return self._T.T @ scattered(self._blocks, self.run.model.n_q) @ self._T

    @cached_property
    def _blocks(self) -> list[tuple[Index, Array]]:
        """The blocks of ``_mass_blocks`` for the first weights."""
        return list(_mass_blocks(self.run.model, self.models, self.weights[0]))

    def _groups(self, base: Any) -> list[tuple[list[Record], Array]]:
        """Return for each model the groups of elements that differ between models, and their damping times."""
        out: list[tuple[list[Record], list[float]]] = [([], []) for _ in self.models]
        every = [self.run.model, *self.models]
        for k, alike in enumerate(zip(*(model.groups for model in every), strict=True)):
            tau = [model.pools[k].tau for model in every]
            which = unlike(alike) if len(set(tau)) == 1 else np.arange(len(alike[0].values.dofs))
            if len(which):
                for (records, times), group, time in zip(out, alike[1:], tau[1:], strict=True):
                    records.append(of_elements(group, which))
                    times.append(time)
        return [(records, np.array(times)) for records, times in out]

    def _mass(self, weights: Array) -> Record | None:
        """Return the problem whose mass is the weighted sum of the models' masses, or None if that is zero."""
        base, model = self.run.problem.values, self.run.model
        blocks = list(_mass_blocks(model, self.models, weights))
        if not blocks:
            return None
        M, T = scattered(blocks, model.n_q), self._T
        nothing = np.zeros(0, dtype=np.int64)
        loads = {name: getattr(base, name)[:0] for name in _LOADS}
        motion = moved_mass(M, T, *(getattr(base, name) for name in ("motion_coord", "motion_factor", "motion_signal")))
        programs = with_own(base.programs, "window", "data")
        return Record(base._replace(groups=nothing, tau=np.zeros(0), points=point_table([]), patched=False,
                                    sliding=sliding_table([], base.e0), programs=programs, **motion, **loads,
                                    **mass_tables((T.T @ M @ T).tocsr(), model.numbering.complete)))

    @cached_property
    def _T(self) -> Any:
        return unknowns_to_coordinates(self.run.model)

    @property
    def _drag(self) -> Array:
        """The sums (k,) of Rayleigh's alpha of the models by the weights, 0 if it is the same in all."""
        same = not self.reduced or np.all(self.alphas == self.run.problem.alpha)
        return np.zeros(len(self.weights)) if same else self.weights @ self.alphas

    @cached_property
    def _own_mass(self) -> Any:
        """The sparse mass matrix of the unknowns."""
        return self._T.T @ full_mass(self.run.model) @ self._T

    @staticmethod
    def _enter(window: Array, problems: Sequence[Record]) -> None:
        """Set the window (2,) of times of the signals."""
        for p in problems:
            p.programs.window[:] = window

    def _let_act(self, acting: Record) -> None:
        """Copy the activity of laws and the elements of moving points from the problem of the motion."""
        for p in () if self.reduced else self.problems:
            p.points.on[:], p.sliding.on[:], p.moving.element[:] = (
                acting.points.on, acting.sliding.on, acting.moving.element)

    def _moments(self, at: Record) -> Record:
        """Return states of the motion with the history variables of these problems."""
        values = at.values
        if isinstance(self.items, slice) and self.joints:
            return at
        wide = self.problems[0].points.mem.shape[1]
        turns = np.ascontiguousarray(values.turns[:, self.items, :wide])
        return Record(values._replace(turns=turns, feet=values.feet if self.joints else values.feet[:, :0].copy()))

    def residuals(self, at: Record, acting: Record) -> Array:
        """Return differences (k, m, n) of the residuals at m states, with the laws active in ``acting``."""
        window = acting.programs.window
        self._enter(window, [*self.problems, *self.inertia])
        self._let_act(acting)
        shape, mine = at.values.z.shape, self._moments(at)
        out, R = np.zeros((len(self.weights), *shape)), np.zeros(shape)
        for p, w, elements, weights in zip(self.problems, self.w, self.elements, self.weights.T, strict=True):
            many_states.residuals(p, w, mine, R)
            for group, tau in elements:
                full = in_full(self.run, at, window)
                Q = forces(group, tau, full.d, full.v)
                R += (self._T[group.dofs.ravel()].T @ Q.reshape(len(Q), -1).T).T
            out += weights[:, None, None] * R
        if (drag := self._drag).any():
            out += drag[:, None, None] * (self._own_mass @ at.values.v.T).T
        for p, total in zip(self.inertia, out, strict=False):
            many_states.residuals(p, self.w[0], _forgotten(at), R)
            total += R
        return out

    def works(self, at: Record, window: Array, lam: Array) -> Array:
        """Return two differences (2, m, goals) of the work of the residuals on lam (m, n, goals).

        The first uses the first weights. The second, without the mass, is evaluated only at some of the states and
        scaled up.
        """
        m, goals = len(lam), lam.shape[2]
        out, some, mine = np.zeros((2, m, goals)), np.arange(0, m, EVERY), self._moments(at)
        few, on_few = _some(mine, some), np.ascontiguousarray(lam[some])
        self._enter(window, self.problems)
        for p, w, elements, (first, second) in zip(self.problems, self.w, self.elements, self.weights.T.tolist(),
                                                   strict=True):
            work = np.zeros((m, goals) if first else (len(some), goals))
            many_states.residual_products(p, w, *((mine, lam) if first else (few, on_few)), work)
            # the same number of states side by side for all models, so that their round-off is the same
            one = self._element_work(elements, at, window, lam, some)
            if first:
                out[0] += first * (work + self._element_work(elements, at, window, lam, np.arange(m)))
            out[1, some] += second * m / len(some) * ((work[some] if first else work) + one)
        return out + self._inertial_work(at, window, lam)

    def _element_work(self, elements: Sequence[tuple[Record, float]], at: Record, window: Array, lam: Array,
                      which: Index) -> Array:
        """Return the work (m, goals) of elements on lam at some states."""
        out = np.zeros((len(which), lam.shape[2]))
        for group, tau in elements:
            full = in_full(self.run, at, window, lam)
            Q = forces(group, tau, full.d[which], full.v[which])
            out += np.einsum("mkn,mkng->mg", Q, full.lam[which][:, group.dofs])
        return out

    def _inertial_work(self, at: Record, window: Array, lam: Array) -> Array:
        """Return the work (2, m, goals) of the change of the mass by the first weights."""
        out, base = np.zeros((2, len(lam), lam.shape[2])), self.run.problem.values
        if len(base.motion_coord) and self.inertia:
            # prescribed mass acts, too
            self._enter(window, self.inertia)
            many_states.residual_products(self.inertia[0], self.w[0], _forgotten(at), lam, out[0])
        elif not len(base.motion_coord) and self.mass is not None:
            forces = self.mass @ (at.values.a + base.alpha * at.values.v).T
            np.einsum("mik,im->mk", lam, forces, out=out[0])
        if (drag := self._drag).any():
            out += drag[:, None, None] * np.einsum("mik,im->mk", lam, self._own_mass @ at.values.v.T)
        return out

    @property
    def starts_alike(self) -> bool:
        """Return whether all models ask for the same initial rates, which each projects with its own mass."""
        own = self.run.model
        return self.reduced and all(other.case.initial == own.case.initial and np.array_equal(other.e0, own.e0)
                                    for other in self.models)

    def mass_between(self, x: Array, y: Array) -> Array:
        """Return x^T M y (k,) of rates (n_q, k) and (n_q,), with the sum of the models' masses by the first weights."""
        return np.sum([np.einsum("mik,mi->k", x[coords], y[coords] @ M.T) for coords, M in self._blocks] or
                      [np.zeros(x.shape[1])], axis=0)

    @property
    def changes_coordinates(self) -> bool:
        """Return whether the number may change the relation of coordinates and unknowns, or prescribed motion."""
        return not self.reduced


def _some(at: Record, which: Index) -> Record:
    """Return some of the states."""
    return Record(many_states.States(*(np.ascontiguousarray(x[which]) for x in at.values)))


def _forgotten(at: Record) -> Record:
    """Return states without history variables."""
    values = at.values
    return Record(values._replace(turns=values.turns[:, :0].copy(), feet=values.feet[:, :0].copy()))


# results of ``_signals_and_tables`` for the own models of motions
_OWN: WeakKeyDictionary[Run, tuple[Signals, dict[str, Any]]] = WeakKeyDictionary()


def _signals_and_tables(run: Run, model: Model) -> tuple[Signals, dict[str, Any]]:
    """Return the signals of a motion, extended by those of a varied model, and the model's ``_tables``."""
    if model is run.model and run in _OWN:
        return _OWN[run]
    signals = Signals()
    for signal in run.signals:
        signals.row(signal)
    found = signals, _tables(model, signals)
    if model is run.model:
        _OWN[run] = found
    return found


def _tables(model: Model, signals: Signals) -> dict[str, Any]:
    """Return the parts of a model's equations of motion, except elements and mass, by their names in ``Problem``."""
    num, damping = model.numbering, model.case.damping
    natural_signals(model, signals)
    return {"points": point_laws(model, signals), "sliding": sliding_table(model.constraints, model.e0),
            "place": num.place, "indptr": num.indptr, "index": num.index, "value": num.value, "full": num.free,
            "dependents": num.dependent, "alpha": float(damping.rayleigh.alpha) if damping else 0.0,
            **dead_loads(model, signals), **prescribed(model, signals)}


def _same(a: Any, b: Any) -> bool:
    """Return whether two fields of a problem are equal."""
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return np.array_equal(a, b)


def _unlike_items(laws: Sequence[Points]) -> Index | slice:
    """Return the items that differ between tables, all if the tables have different structures."""
    first = laws[0]
    for other in laws[1:]:
        if not all(_same(getattr(first, name), getattr(other, name)) for name in ("field", "dof", "entry", "dofs")):
            return slice(None)
    found = np.zeros(len(first.forces), dtype=bool)
    for other in laws[1:]:
        for name in _OF_ITEMS:
            one, two = getattr(first, name), getattr(other, name)
            # NaN equals NaN
            apart = (one != two) & ((one == one) | (two == two))
            found |= apart.any(axis=tuple(range(1, apart.ndim)))
        for name, along_ in _ALONG.items():
            starts, unlike_ = getattr(first, along_), getattr(first, name) != getattr(other, name)
            rows = np.flatnonzero(unlike_.any(axis=tuple(range(1, unlike_.ndim))))
            found[np.searchsorted(starts, rows, side="right") - 1] = True
    return np.flatnonzero(found)


def of_items(points: Points, which: Index | slice) -> Points:
    """Return a table of some items, with their history variables."""
    if isinstance(which, slice):
        return with_own(points, "mem", "on", "apart", "there")
    parts: dict[str, Any] = {name: np.ascontiguousarray(getattr(points, name)[which]) for name in (*_OF_ITEMS, "mem")}
    for name, along_ in _ALONG.items():
        starts = getattr(points, along_)
        rows = [getattr(points, name)[starts[i]:starts[i + 1]] for i in which]
        parts[along_] = np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64)
        parts[name] = np.concatenate([getattr(points, name)[:0], *rows])
    # evaluated one by one, because other points of their curves may be missing
    return points._replace(run=np.ones(len(which), dtype=np.int64),
                           forces_of_run=np.zeros(len(which), dtype=np.int64), **parts)


def _unlike_loads(tables: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return for each table but the first the entries of dead loads that differ between tables."""
    first, *others = ([table[name] for name in _LOADS] for table in tables)
    which: Any = slice(None)
    if all(_same(first[0], other[0]) for other in others):
        which = np.any([np.not_equal(a, b) for other in others for a, b in zip(first, other, strict=True)], axis=0)
    return [{name: np.ascontiguousarray(values[which]) for name, values in zip(_LOADS, other, strict=True)}
            for other in others]


def _mass_blocks(base: Model, models: Sequence[Model], weights: Array) -> Iterable[tuple[Index, Array]]:
    """Yield coordinates (m, n) and matrices (n, n) of the sum of the models' masses by weights with zero sum.

    Parts that are the same in all models are left out.
    """
    for name, mesh in base.meshes.items():
        others = [model.meshes[name] for model in models]
        if all(other is mesh for other in others):
            continue
        codes, place = np.unique(np.stack([other.cls for other in others]), axis=1, return_inverse=True)
        for k, code in enumerate(codes.T.tolist()):
            classes = [other.classes[c] for other, c in zip(others, code, strict=True)]
            if any(one is not classes[0] for one in classes):
                M = np.asarray(sum(w * one.mass for w, one in zip(weights.tolist(), classes, strict=True)))
                if M.any():
                    yield mesh.dofs[place.ravel() == k], M
    lumps = [list(point_masses(model)) for model in (base, *models)]
    if not all(len(own) == len(lumps[0]) and all(map(_same, lumps[0], own)) for own in lumps[1:]):
        for w, own_ in zip(weights.tolist(), lumps[1:], strict=True):
            yield from ((coords[None, :], w * M) for coords, M in own_)
    for w, model in zip(weights.tolist(), models, strict=True):
        yield from ((dofs, w * M) for dofs, M in fluid_masses(model))
