"""The unknowns of a model, d = T z + P b after elimination of the linear equations, and their places in the matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..elements.definition import derivative_order
from ..elements.shape import Array
from ..interactions.forces import Patch
from ..kernels.matrices.layout import Places
from .breakpoints import comparison_times
from .constraints import Constraint, Row
from .couplings import MARGIN, Couplings, after_coordinates, contact_of, coupled, padded, unknowns, with_multipliers
from .fronts import Fronts, band_cost, fronts_cost, least_degree, make_fronts, meeting
from .mesh import BodyMesh, Index

# fronts are tried for at least this many unknowns and a band wider than this many element widths; they are used if the
# band costs this many times as much, in statics and in motion, where other kernels must be compiled for them
FEW, LOOSE, WORTH = 200, 1.5, (1.2, 3.0)
# a hundred times the remaining Newton increments, relative to the scene's extent
LEFT = 1e-8


class Source:
    """The data behind a numbering: dependent coordinates, and the couplings of elements, forces and constraints."""

    def __init__(self, dependents: list[Any], coupled: list[Index]) -> None:
        self.dependents, self.coupled = dependents, coupled

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, Source) and self.dependents == other.dependents
                and len(self.coupled) == len(other.coupled)
                and all(a is b or np.array_equal(a, b) for a, b in zip(self.coupled, other.coupled, strict=True)))


@dataclass(frozen=True)
class Numbering:
    """The full coordinates that are unknown, held or dependent, and the places of the unknowns in the matrix.

    Full coordinates are the nodal coordinates (n_q) followed by one multiplier per nonlinear constraint. ``place``
    (n_full,): position of an unknown; -1 if held; -2 - k for dependent k, which depends on the unknowns
    ``index[indptr[k]:indptr[k+1]]`` with factors ``value``. ``free`` (n_unknowns,): the full coordinate at each
    position. ``acts_on``: the unknowns on which each constraint acts; ``fronts``: the elimination order of the unknowns
    if it costs less than a band, else None.

    In large models with contact between bodies, which elements couple changes; they have ``couplings`` and get their
    fronts from ``near`` or ``complete``.
    """

    n_q: int
    n_multipliers: int
    place: Index
    indptr: Index
    index: Index
    value: Array
    free: Index
    dependent: Index
    half_bandwidth: int
    largest_element: int
    acts_on: list[Index]
    fronts: Fronts | None = None
    source: Source | None = None
    couplings: Couplings | None = None

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns, multipliers included."""
        return len(self.free)

    @cached_property
    def places(self) -> Places:
        """The places of coordinates among the unknowns, in the form that kernels need."""
        return Places(self.place, self.indptr, self.index, self.value)

    @cached_property
    def rows(self) -> Places:
        """The places of coordinates among the rows of a matrix, which fronts may have in another order."""
        if self.fronts is None:
            return self.places
        row, free = self.fronts.row, self.place >= 0
        place = self.place.copy()
        place[free] = row[place[free]]
        return Places(place, self.indptr, row[self.index], self.value)

    @property
    def nested(self) -> bool:
        """Return whether matrices are stored as fronts."""
        return self.fronts is not None or self.couplings is not None

    @cached_property
    def complete(self) -> Numbering:
        """The numbering with fronts in which all elements of bodies that may touch each other couple."""
        return self if self.couplings is None else self.near(None, np.inf)

    @cached_property
    def in_reference(self) -> Numbering:
        """The numbering with fronts in which elements that are near each other in the reference couple."""
        return self if self.couplings is None else self.near(None)

    def near(self, d: Array | None, margin: float = MARGIN, more: Iterable[Index] = ()) -> Numbering:
        """Return the numbering with fronts in which elements near each other at d couple (``Couplings.fronts``)."""
        assert self.couplings is not None
        fronts, acts_on = self.couplings.fronts(d, margin, more)
        return replace(self, fronts=fronts, acts_on=acts_on)

    @cached_property
    def where(self) -> slice | Index:
        """``free``, as a slice if it is contiguous, which reads without a copy."""
        first, count = int(self.free[0]) if len(self.free) else 0, len(self.free)
        return slice(first, first + count) if np.array_equal(self.free, np.arange(first, first + count)) else self.free

    def of_unknowns(self, values: Array) -> Array:
        """Return the values (n_q,) of nodal coordinates that are unknowns, and 0 for multipliers (n_unknowns,).

        May be a part of ``values`` itself.
        """
        return (np.append(values, np.zeros(self.n_multipliers)) if self.n_multipliers else values)[self.where]

    @cached_property
    def owner(self) -> Index:
        """For each entry of ``index``, the number of its dependent coordinate."""
        return np.repeat(np.arange(len(self.dependent)), np.diff(self.indptr))

    def reduce(self, full: Array, less: Array | None = None, out: Array | None = None) -> Array:
        """Return T^T full, or T^T (full - less) (n_unknowns,), in ``out`` if given."""
        out = np.empty(self.n_unknowns) if out is None else out
        if less is None:
            out[:] = full[self.where]
        else:
            np.subtract(full[self.where], less[self.where], out=out)
        # held coordinates depend on no unknown
        if len(self.index):
            dependent = full[self.dependent] if less is None else full[self.dependent] - less[self.dependent]
            np.add.at(out, self.index, self.value * dependent[self.owner])
        return out

    def reduce_sizes(self, full: Array) -> Array:
        """Return |T|^T full, for upper bounds ``full`` (n_full,) of forces: upper bounds of the result of ``reduce``.

        May overwrite ``full``.
        """
        out = full[self.where]
        if len(self.index):
            np.add.at(out, self.index, np.abs(self.value) * full[self.dependent[self.owner]])
        return out

    def expand(self, z: Array, out: Array) -> None:
        """Write T z to the free and dependent full coordinates of ``out``, without the right-hand sides."""
        out[self.where] = z
        if len(self.dependent):
            sums = np.zeros(len(self.dependent))
            if len(self.index):
                np.add.at(sums, self.owner, self.value * z[self.index])
            out[self.dependent] = sums

    def expanded(self, z: Array) -> Array:
        """Return T z as full coordinates (n_full,), without the right-hand sides."""
        out = np.zeros(len(self.place))
        self.expand(z, out)
        return out


@dataclass
class Dependent:
    """A dependent coordinate: sum of factors * unknown coordinates + sum of factors * right-hand sides."""

    terms: dict[int, float]
    rhs: dict[int, float]


@dataclass
class Elimination:
    """Reduced row echelon form of the linear rows.

    ``dependents`` maps a coordinate to its expression; ``redundant`` lists the rows that depend on others, with the
    combination of right-hand sides that must vanish.
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
    """Solve each row for the coordinate with the largest displacement; keep all rows fully reduced.

    ``size(coordinate)`` is the magnitude of a coordinate for a unit displacement, which makes the choice independent of
    units.
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
    """Return the redundant rows whose right-hand sides contradict others somewhere between t0 and t1.

    They are compared as functions, at ``comparison_times`` of their signals.
    """
    bad = []
    for number, rhs in elimination.redundant:
        signals = [(factor, s) for r, factor in rhs.items() if (s := rows[r].signal) is not None]
        times = comparison_times([s for _, s in signals], t0, t1)
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


def half_bandwidth(position: Index, sets: list[Index]) -> int:
    """Return the largest distance between unknowns that share a row of a set (m, n); -1 marks no unknown."""
    width = 0
    for rows in sets:
        if rows.size == 0 or position.size == 0:
            continue
        places = np.where(rows >= 0, position[rows], -1)
        high = places.max(axis=1)
        low = np.where(places >= 0, places, np.iinfo(np.int64).max).min(axis=1)
        used = high >= 0
        if used.any():
            width = max(width, int((high[used] - low[used]).max()))
    return width


def _cuthill_mckee(n: int, sets: list[Index]) -> Index:
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    return np.asarray(reverse_cuthill_mckee(csr_matrix(meeting(n, sets)), symmetric_mode=True), dtype=np.int64)


def order_unknowns(n: int, sets: list[Index], narrow: int) -> tuple[Index, int]:
    """Return the position of each unknown and the half-bandwidth.

    ``sets`` are arrays (m, k) of coupled unknowns, one set per row, -1 for none. If the natural order is as narrow as
    ``narrow``, the bandwidth of a single chain, nothing is reordered.
    """
    natural = np.arange(n, dtype=np.int64)
    width = half_bandwidth(natural, sets)
    if width <= narrow or n <= 1:
        return natural, width
    position = np.empty(n, dtype=np.int64)
    position[_cuthill_mckee(n, sets)] = natural
    better = half_bandwidth(position, sets)
    return (position, better) if better < width else (natural, width)


def _fixed_couplings(meshes: list[BodyMesh], constraints: list[Constraint], patches: list[Patch], between: bool
                     ) -> tuple[list[tuple[Any, int] | None], list[Any], list[Index], list[Index]]:
    """Return the contacts between bodies among constraints, their pairs, and the coordinates that always couple.

    The last two are those of elements and patches, and those of each constraint. Unless ``between``, contact between
    bodies couples all elements.
    """
    contacts = [contact_of(c) if between else None for c in constraints]
    springs = [contact_of(p) if between else None for p in patches]
    own = [*(m.dofs for m in meshes), *(p.dofs for p, one in zip(patches, springs, strict=True) if one is None)]
    bound = [c.dofs if one is None else one[0].own_dofs(one[1]) for c, one in zip(constraints, contacts, strict=True)]
    pairs = {id(one[0]): one[0] for one in (*contacts, *springs) if one is not None}
    return contacts, list(pairs.values()), own, bound


def number(meshes: list[BodyMesh], elimination: Elimination, constraints: list[Constraint], patches: list[Patch],
           n_q: int, moving: bool = False, nested: bool = True, like: Numbering | None = None) -> Numbering:
    """Return the numbering of a model; reorder the unknowns only if the natural order is not the narrowest.

    Fronts are used instead of a band if ``nested`` allows them and they cost less; in motion (``moving``) they must
    save more. The places of ``like`` are reused if its ``source`` is equal.
    """
    dependents = sorted(elimination.dependents)
    between = nested and n_q - len(dependents) >= FEW
    contacts, pairs, own, bound = _fixed_couplings(meshes, constraints, patches, between)
    follow = ((c, *elimination.dependents[c].terms) for c in dependents)
    source = Source([moving, nested, len(meshes), len(constraints), *follow],
                    [*own, *bound, *(pair.dofs for pair in pairs)])
    if like is not None and source == like.source:
        couplings = None if like.couplings is None else replace(like.couplings, pairs=pairs, contacts=contacts)
        return replace(like, source=source, value=as_columns(elimination, like.place)[2], couplings=couplings)
    natural = np.zeros(n_q, dtype=np.int64)
    held = [c for c in dependents if not elimination.dependents[c].terms]
    natural[dependents] = -2
    natural[held] = -1
    free = np.flatnonzero(natural == 0)
    natural[free] = np.arange(len(free))
    terms = {c: [int(natural[k]) for k in elimination.dependents[c].terms] for c in dependents}
    # contact points on one curve have the same coordinates
    touched = [*own[:len(meshes)], *(np.unique(dofs, axis=0) for dofs in own[len(meshes):])]
    sets = [s for dofs in touched for s in coupled(dofs, natural, terms)]
    acts_on = padded([unknowns(dofs, natural, terms) for dofs in bound])
    sets += [acts_on] if acts_on.size else []
    largest = max(m.plan.element.n_dof for m in meshes)
    position, _ = order_unknowns(len(free), sets, largest - 1)
    final = after_coordinates(position, acts_on) if constraints else position
    together = with_multipliers(sets, acts_on, len(free))
    width, fronts = half_bandwidth(final, together), None
    if nested and not pairs and len(final) >= FEW and width > LOOSE * largest:
        tree = make_fronts(after_coordinates(least_degree(len(free), sets), acts_on), together)
        if WORTH[moving] * fronts_cost(tree) < band_cost(len(final), width):
            # the unknowns are numbered in the order of elimination
            final, every = tree.row, np.arange(len(final))
            fronts, width = tree._replace(row=every, unknown=every), half_bandwidth(final, together)
    place = np.full(n_q + len(constraints), -1, dtype=np.int64)
    place[free] = final[:len(free)]
    place[n_q:] = final[len(free):]
    everything = np.concatenate([free, n_q + np.arange(len(constraints))])
    at = everything[np.argsort(final)]
    place[dependents] = -2 - np.arange(len(dependents))
    place[held] = -1
    indptr, index, value = as_columns(elimination, place)
    couplings = Couplings(natural, terms, sets, acts_on, contacts, pairs, final) if pairs else None
    return Numbering(n_q, len(constraints), place, indptr, index, value, at, np.array(dependents, dtype=np.int64),
                     width, largest, [final[reached[reached >= 0]] for reached in acts_on], fronts, source, couplings)


def straining_weights(mesh: BodyMesh, extent: float) -> Array:
    """Return weights (n_dofs,) by which Newton's increments are judged, in a scene of the given extent [m].

    A section that turns or stretches strains by w/(h/2), with w its weight; over an element of length l so does a
    displacement of w l/(h/2), which is therefore its weight in slender elements: EA times the remaining strains must be
    small compared with the bending stiffness EI/l^2 = EA (h/l)^2/12.
    """
    half, l = mesh.plan.section.height / 2, max(p.l for p in mesh.plan.pieces)
    longer = max(1.0, min(l, LEFT * extent * 3.0 * (l / half) ** 2) / half) if half > 0.0 else 1.0
    pattern: list[float] = []
    for _, j in (derivative_order(name) for _, name in mesh.plan.element.functionals):
        share = longer if j > 0 else 1.0
        pattern += [share, share] if mesh.plan.element.components == 2 else [share, share, longer]
    return mesh.weights * mesh.tile(pattern)
