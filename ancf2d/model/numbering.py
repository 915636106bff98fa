"""Unknowns, dependents and multipliers: which coordinate stands where in the matrix."""

from __future__ import annotations

import numpy as np

from ..interactions.forces import Patch
from .constraints import Constraint
from .elimination import Elimination, as_columns
from .fronts import band_cost, fronts_cost, least_degree, make_fronts
from .mesh import BodyMesh, Index
from .model import Numbering
from .order import half_bandwidth, order_unknowns

# fronts are tried where there are so many unknowns and a band is wider than so many times an element's; they are taken
# where the band costs so much more, in statics and in motion, whose kernels are compiled anew for them
FEW, LOOSE, WORTH = 200, 1.5, (1.2, 3.0)


def _meeting(dofs: Index, natural: Index, terms: dict[int, list[int]]) -> list[Index]:
    """Return which unknowns meet in the rows of ``dofs`` (m, n), dependents expanded."""
    rows = natural[dofs]
    sets = [np.where(rows >= 0, rows, -1)]
    for m in np.flatnonzero((rows <= -2).any(axis=1)):
        reached = _expand(dofs[m], natural, terms)
        if reached:
            sets.append(np.array([reached], dtype=np.int64))
    return sets


def _expand(coords: Index, natural: Index, terms: dict[int, list[int]]) -> list[int]:
    out: set[int] = set()
    for c in coords.tolist():
        if natural[c] >= 0:
            out.add(int(natural[c]))
        elif natural[c] <= -2:
            out.update(terms[c])
    return sorted(out)


def _after_coordinates(position: Index, multipliers: list[list[int]], n: int) -> Index:
    """Return the positions of unknowns and multipliers, each multiplier right behind the last of its coordinates.

    Of a positive definite matrix that is bordered by constraints no leading block is singular then, and LDL^T needs
    no pivoting.
    """
    keys = position.astype(float)
    extra = []
    for reached in multipliers:
        extra.append(max((int(position[i]) for i in reached), default=n) + 0.5)
    order = np.argsort(np.concatenate([keys, extra]), kind="stable")
    final = np.empty(len(order), dtype=np.int64)
    final[order] = np.arange(len(order))
    return final


def number(meshes: list[BodyMesh], elimination: Elimination, constraints: list[Constraint], patches: list[Patch],
           n_q: int, moving: bool = False, nested: bool = True) -> Numbering:
    """Return the numbering of a model; reorders only where the natural order is not already the narrowest.

    Fronts take the place of a band where they cost less, if ``nested`` allows them; in motion (``moving``) they have to
    save more.
    """
    dependents = sorted(elimination.dependents)
    natural = np.zeros(n_q, dtype=np.int64)
    held = [c for c in dependents if not elimination.dependents[c].terms]
    natural[dependents] = -2
    natural[held] = -1
    free = np.flatnonzero(natural == 0)
    natural[free] = np.arange(len(free))
    terms = {c: [int(natural[k]) for k in elimination.dependents[c].terms] for c in dependents}
    touched = [*(m.dofs for m in meshes), *(p.dofs for p in patches)]
    sets = [s for dofs in touched for s in _meeting(dofs, natural, terms)]
    multipliers = [_expand(c.dofs, natural, terms) for c in constraints]
    sets += [np.array([reached], dtype=np.int64) for reached in multipliers if reached]
    largest = max(m.plan.element.n_dof for m in meshes)
    position, _ = order_unknowns(len(free), sets, largest - 1)
    final = _after_coordinates(position, multipliers, len(free)) if constraints else position
    together = sets + [np.array([[*reached, len(free) + k]], dtype=np.int64) for k, reached in enumerate(multipliers)]
    width, fronts = half_bandwidth(final, together), None
    if nested and len(final) >= FEW and width > LOOSE * largest:
        order = _after_coordinates(least_degree(len(free), sets), multipliers, len(free))
        tree, positions = make_fronts(order, together)
        if WORTH[moving] * fronts_cost(tree) < band_cost(len(final), width):
            final, fronts, width = positions, tree, half_bandwidth(positions, together)
    place = np.full(n_q + len(constraints), -1, dtype=np.int64)
    place[free] = final[:len(free)]
    place[n_q:] = final[len(free):]
    everything = np.concatenate([free, n_q + np.arange(len(constraints))])
    at = np.empty(len(everything), dtype=np.int64)
    at[final] = everything
    place[dependents] = -2 - np.arange(len(dependents))
    place[held] = -1
    indptr, index, value = as_columns(elimination, place)
    return Numbering(n_q, len(constraints), place, indptr, index, value, at, np.array(dependents, dtype=np.int64),
                     width, largest, fronts)
