"""Point masses, the vectors and rotations that their inertia acts on, and centrifugal forces of a steady rotation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import NAME, Number
from ..case.schema.case import SteadyRotation, register
from ..case.schema.points import PLACE, MovingPoint, Point
from ..elements.shape import Array
from ..model.classes import mass_matrix
from ..model.mesh import BodyMesh, Index
from ..model.points import PointRef
from ..model.rotation import Rotation


@record
class Mass:
    """A point mass, with an optional moment of inertia."""

    at: Point | MovingPoint = key(PLACE, "Point at which the mass is attached; it may move along a body (dynamic)",
                                  example="rod@1")
    mass: float = key(Number("kg", ge=0), "Mass", example=1)
    inertia: float = key(Number("kg m^2", ge=0), "Moment of inertia about the point", default=0.0)
    name: str | None = key(NAME, "Name", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield an issue for a moving mass with a moment of inertia."""
        if isinstance(self.at, MovingPoint) and self.inertia:
            yield Issue(("inertia",), "{}.inertia: a mass that moves along a body cannot have a moment of inertia",
                        "no inertia")


register("masses", Mass)


@dataclass(frozen=True)
class MassTerm:
    """Kinetic energy ``inertia`` |sum of weights * rates|^2/2 of one vector (two columns) or one rotation (one).

    ``place``: whether the vector is the position of the mass.
    """

    inertia: float
    columns: tuple[tuple[Index, Array], ...]
    place: bool = False


def mass_terms(mass: Mass, point: PointRef, e: Array | None = None) -> list[MassTerm]:
    """Return the mass terms of a point mass: mass on the position, inertia on the direction of the section.

    The inertia acts on theta if that is a coordinate. Otherwise it acts on the vector that rotates with the section, of
    unit length in the reference, like the inertia of the beam's own sections: J |d'|^2/2 is J theta'^2/2 while
    the vector keeps its length, and the mass matrix is constant. For small motions about ``e`` it acts on the rotation
    only: the stretch of the vector has the stiffness of the adjacent elements only, and would add a frequency that
    falls with the element length.
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


class CentrifugalPatch:
    """Q_k = t omega^2 M (q - about) of many elements that share M; the load factor t scales omega^2.

    In the plane, a section has the same rotation relative to the rotating frame: rotary inertia about the centre of the
    section causes no centrifugal moment, and theta is left out of M.
    """

    symmetric = True

    def __init__(self, dofs: Index, M: Array, centre: Array, omega: float) -> None:
        self.dofs, self.M, self.centre, self.omega2 = dofs, M, centre, omega * omega

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return the elastic energy (0), -Q_k and its derivative."""
        factor = t * self.omega2
        p = e[self.dofs] - self.centre
        Q = -factor * p @ self.M
        return 0.0, Q, np.broadcast_to(-factor * self.M, (len(p), *self.M.shape))


def _without_theta(M: Array, components: int) -> Array:
    M = M.copy()
    if components == 3:
        M[2::3] = 0.0
        M[:, 2::3] = 0.0
    return M


def centrifugal(meshes: dict[str, BodyMesh], masses: list[tuple[Mass, PointRef]],
                spin: SteadyRotation) -> list[CentrifugalPatch]:
    """Return the centrifugal forces on all bodies and point masses of a scene that rotates about ``spin.about``."""
    patches = []
    for mesh in meshes.values():
        element = mesh.plan.element
        centre = np.zeros(element.n_dof)
        for k, (_, name) in enumerate(element.functionals):
            if name == "r":
                centre[k * element.components:k * element.components + 2] = spin.about
        for k, cls in enumerate(mesh.classes):
            M = _without_theta(mass_matrix(cls.sampler), element.components)
            patches.append(CentrifugalPatch(mesh.dofs[mesh.cls == k], M, centre, spin.omega))
    for term in (term for mass, point in masses for term in mass_terms(mass, point) if len(term.columns) == 2):
        for (coords, weights), about in zip(term.columns, spin.about, strict=True):
            # weights . (e - centre) = r - about; directions do not depend on the centre
            centre = about * weights / (weights @ weights) if term.place else np.zeros(len(weights))
            patches.append(CentrifugalPatch(coords[None, :], term.inertia * np.outer(weights, weights), centre,
                                            spin.omega))
    return patches
