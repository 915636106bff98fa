"""Steady rotation: the centrifugal forces of the turning frame, and their (softening) stiffness."""

from __future__ import annotations

import numpy as np

from ..case import Mass, SteadyRotation
from ..elements.shape import Array
from .masses import mass_terms
from .mesh import BodyMesh, Index, mass_matrix
from .points import PointRef


class CentrifugalPatch:
    """Q_k = t omega^2 M (q - about) of many elements that share M: t is the load factor, so omega^2 follows it.

    In the plane the rotation of a section is seen from the turning frame without change: rotary inertia about
    the section's own centre exerts no centrifugal moment, and theta has no part in this M.
    """

    symmetric = True

    def __init__(self, dofs: Index, M: Array, centre: Array, omega: float) -> None:
        self.dofs, self.M, self.centre, self.omega2 = dofs, M, centre, omega * omega

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return no elastic energy, -Q_k and its derivative."""
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
    """Return the centrifugal forces on all bodies and point masses of a scene that turns about ``spin.about``."""
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
            # weights . (e - centre) = r - about; directions do not know where the centre is
            centre = about * weights / (weights @ weights) if term.place else np.zeros(len(weights))
            patches.append(CentrifugalPatch(coords[None, :], term.inertia * np.outer(weights, weights), centre,
                                            spin.omega))
    return patches
