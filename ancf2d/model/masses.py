"""Point masses: the vectors and rotations that carry their inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..case import Mass
from ..elements.shape import Array
from .mesh import Index
from .points import PointRef
from .rotation import Rotation


@dataclass(frozen=True)
class MassTerm:
    """Kinetic energy ``inertia`` |sum of weights * rates|^2/2 of one vector (two columns) or one rotation (one).

    ``place`` tells whether the vector is the position of the mass.
    """

    inertia: float
    columns: tuple[tuple[Index, Array], ...]
    place: bool = False


def mass_terms(mass: Mass, point: PointRef, e: Array | None = None) -> list[MassTerm]:
    """Return what a point mass acts on: mass on the position, inertia on the section's direction.

    The inertia is on theta where that is a coordinate. Elsewhere it is on the vector that turns with the section,
    of unit length in the reference, as the inertia of the beam's own sections is: J |d'|^2/2 is J theta'^2/2 while
    the vector keeps its length, and the mass matrix is constant. For small motion about ``e`` it is on the rotation
    alone: what the vector stretches by has the stiffness of the next elements only, and with J a frequency that falls
    with their length.
    """
    terms = [MassTerm(mass.mass, tuple(point.position()), True)]
    if not mass.inertia:
        return terms
    if point.turns_by_theta:
        return [*terms, MassTerm(mass.inertia, (point.theta(),))]
    if e is not None:
        rotation = Rotation(point)
        return [*terms, MassTerm(mass.inertia, ((rotation.dofs, rotation.gradient(e)),))]
    columns, _ = point.director()
    first = point.mesh.first_dof
    length2 = sum(float(w @ point.mesh.e0[c - first]) ** 2 for c, w in columns)
    return [*terms, MassTerm(mass.inertia / length2, tuple(columns))]


def mass_block(terms: list[MassTerm]) -> tuple[Index, Array]:
    """Return (coordinates (n,), mass matrix (n, n)) of a point mass."""
    columns = [(term.inertia, *c) for term in terms for c in term.columns]
    coords = np.unique(np.concatenate([c for _, c, _ in columns]))
    M = np.zeros((len(coords), len(coords)))
    for inertia, c, w in columns:
        k = np.searchsorted(coords, c)
        M[np.ix_(k, k)] += inertia * np.outer(w, w)
    return coords, M
