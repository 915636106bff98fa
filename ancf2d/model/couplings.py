"""Which unknowns couple in the matrix, and the fronts of models with contact between bodies: for elements near each
other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..elements.shape import Array
from ..kernels.matrices.layout import Fronts
from .fronts import least_degree, make_fronts
from .mesh import Index

# elements of bodies are near each other at a distance of this many of their lengths
MARGIN = 1.0
# parts of a body can touch each other soon if their distance is less than this share of that along the body
BENT = 0.5


def contact_of(item: Any) -> tuple[Any, int] | None:
    """Return pair and point of a spring or constraint that is a contact between bodies, else None; -1: all points."""
    pair = getattr(item, "pair", None)
    return (pair, getattr(item, "number", -1)) if pair is not None and pair.on_bodies else None


def padded(rows: Sequence[Any]) -> Index:
    """Return rows of different lengths as one array (m, k), -1 beyond their ends."""
    out = np.full((len(rows), max(map(len, rows), default=0)), -1, dtype=np.int64)
    for row, values in zip(out, rows, strict=True):
        row[:len(values)] = values
    return out


def coupled(dofs: Index, natural: Index, terms: dict[int, list[int]]) -> list[Index]:
    """Return the sets of unknowns that couple in the rows of ``dofs`` (m, n), dependents expanded; -1 for none."""
    rows = natural[dofs]
    mixed = np.flatnonzero((rows <= -2).any(axis=1))
    sets = [np.where(rows >= 0, rows, -1)]
    return [*sets, padded([unknowns(dofs[m], natural, terms) for m in mixed])] if len(mixed) else sets


def unknowns(coords: Index, natural: Index, terms: dict[int, list[int]]) -> list[int]:
    """Return the unknowns on which coordinates depend, sorted."""
    out: set[int] = set()
    for c in coords.tolist():
        if natural[c] >= 0:
            out.add(int(natural[c]))
        elif natural[c] <= -2:
            out.update(terms[c])
    return sorted(out)


def after_coordinates(position: Index, constraints: Index) -> Index:
    """Return the positions of unknowns and multipliers, each multiplier right after the last of its coordinates.

    ``constraints`` (m, k): the unknowns on which each acts, -1 for none. A positive definite matrix that is bordered by
    constraints then has no singular leading block, and LDL^T needs no pivoting.
    """
    n = len(position)
    reached = np.where(constraints >= 0, np.append(position, n)[constraints], -1).max(axis=1, initial=-1)
    order = np.argsort(np.append(position, np.where(reached < 0, n, reached) + 0.5), kind="stable")
    final = np.empty(len(order), dtype=np.int64)
    final[order] = np.arange(len(order))
    return final


def with_multipliers(sets: list[Index], constraints: Index, n: int) -> list[Index]:
    """Return all sets of coupled unknowns, n of them and then the multipliers of ``constraints``."""
    return [*sets, np.column_stack([constraints, n + np.arange(len(constraints))])]


def near(pair: Any, d: Array | None, margin: float) -> tuple[Index, Index]:
    """Return the numbers (k,) of points and of curves opposite to them that are near each other at d (n_full,).

    Their distance is at most ``margin`` lengths of the longer of their elements. Parts of one body also have to be
    nearer than half their distance along it: a body touches itself only where it is bent.
    """
    if margin == np.inf:
        i, curve = np.indices((len(pair.spots), len(pair.curves))).reshape(2, -1)
        return i, curve
    from scipy.spatial import cKDTree

    (a, b), places = pair.segments(d), pair.places(d)
    middle, own = 0.5 * (a + b), pair.mesh.lengths[[p.ie for p in pair.spots]]
    each = len(middle) // len(pair.curves)
    # in the reference: iterates of Newton's method may be stretched to any length
    reach = margin * np.maximum(own, pair.against.lengths.max())
    found = cKDTree(middle).query_ball_point(places, reach)
    count = np.array([len(one) for one in found])
    i, at = np.repeat(np.arange(len(places)), count), np.concatenate([np.zeros(0), *found]).astype(np.int64)
    if pair.against is pair.mesh:
        along = np.abs(pair.places_along[at // each] - pair.s[i] * pair.mesh.plan.length)
        along = np.minimum(along, pair.mesh.plan.length - along) if pair.mesh.plan.closed else along
        bent = np.hypot(*(middle[at] - places[i]).T) < BENT * along
        i, at = i[bent], at[bent]
    both = np.unique(i * len(pair.curves) + at // each)
    return both // len(pair.curves), both % len(pair.curves)


@dataclass(frozen=True)
class Couplings:
    """The couplings of a model with contact between bodies, and its fronts for those that are near each other.

    ``natural`` (n_q,): number of each unknown coordinate, -1 if it is held, -2 if it depends on the unknowns ``terms``;
    ``sets``: arrays (m, k) of unknowns that always couple, one set per row, -1 for none; ``constraints`` (m, k): the
    unknowns on which each constraint always acts; ``contacts``: for those of contact between bodies, their pair and the
    number of their point in it, else None; ``pairs``: all pairs of bodies (``interactions.body_contact.BodyPair``);
    ``final`` (n,): position in the numbering of each unknown, multipliers included, which follow the coordinates.
    """

    natural: Index
    terms: dict[int, list[int]]
    sets: list[Index]
    constraints: Index
    contacts: list[tuple[Any, int] | None]
    pairs: Sequence[Any]
    final: Index

    @cached_property
    def _constraint_of(self) -> list[Index]:
        """For each pair, the constraint of each of its points, -1 if it has none."""
        out = {id(pair): np.full(len(pair.spots), -1) for pair in self.pairs}
        for k, contact in enumerate(self.contacts):
            if contact is not None:
                out[id(contact[0])][contact[1]] = k
        return list(out.values())

    def fronts(self, d: Array | None, margin: float, more: Iterable[Index] = ()) -> tuple[Fronts, list[Index]]:
        """Return the fronts for elements that are near each other at d (n_full,), in the reference if None, and the
        unknowns on which each constraint acts then.

        ``margin``: distance up to which elements are near, relative to their lengths; ``more``: further rows (m, k) of
        coordinates that couple, the multiplier last if there is one.
        """
        m = len(self.constraints)
        n, sets = len(self.final) - m, list(self.sets)
        # number of the constraint times n + unknown
        acts = [np.where(self.constraints >= 0, n * np.arange(m)[:, None] + self.constraints, -1).ravel()]
        for pair, constraint in zip(self.pairs, self._constraint_of, strict=True):
            i, curve = near(pair, d, margin)
            dofs = np.array([c.dofs for c in pair.curves])
            _, first = np.unique(pair.dofs[i, 0] * len(self.natural) + dofs[curve, 0], return_index=True)
            together = np.hstack([pair.dofs[i[first], :pair.own[1]], dofs[curve[first]]])
            sets += coupled(together, self.natural, self.terms)
            held = constraint[i] >= 0
            if held.any():
                opposite = padded([unknowns(row, self.natural, self.terms) for row in dofs])[curve[held]]
                acts.append(np.where(opposite >= 0, n * constraint[i[held], None] + opposite, -1).ravel())
        for rows in more:
            for coords in rows:
                own = coords[coords < len(self.natural)]
                reached = np.array(unknowns(own, self.natural, self.terms), dtype=np.int64)
                sets.append(reached[None])
                acts += [n * k + reached for k in coords[coords >= len(self.natural)] - len(self.natural)]
        both = np.unique(np.concatenate(acts))
        both = both[both >= 0]
        acts_on = np.split(both % n, np.searchsorted(both, n * np.arange(1, m))) if m else []
        constraints = padded(acts_on)
        order = after_coordinates(least_degree(n, sets), constraints)
        tree = make_fronts(order, with_multipliers(sets, constraints, n))
        row = np.empty(len(self.final), dtype=np.int64)
        row[self.final] = tree.row
        return tree._replace(row=row, unknown=self.final[tree.unknown]), [np.sort(self.final[u]) for u in acts_on]
