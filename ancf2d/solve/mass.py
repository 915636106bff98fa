"""The mass matrix of the unknowns, stored as the tangent is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..elements.shape import Array
from ..kernels.mass import scatter_classes
from ..model.mesh import Index, mass_matrix
from ..model.model import Model
from ..model.rotation import Rotation
from .linear import TangentMatrix


def point_masses(model: Model, d: Array) -> Iterator[tuple[Index, Array]]:
    """Yield (coordinates (n,), matrix (n, n)) of each point mass: m at r, and its inertia at theta as it is at d."""
    e = model.e0 + d[:model.n_q]
    for item in model.case.masses:
        point = model.point(item.at)
        rows = [(item.mass, *columns) for columns in point.position()]
        if item.inertia:
            rotation = Rotation(point)
            rows.append((item.inertia, rotation.dofs, rotation.gradient(e)))
        coords = np.unique(np.concatenate([c for _, c, _ in rows]))
        M = np.zeros((len(coords), len(coords)))
        for m, c, w in rows:
            k = np.searchsorted(coords, c)
            M[np.ix_(k, k)] += m * np.outer(w, w)
        yield coords, M


def assemble_mass(model: Model, d: Array, matrix: TangentMatrix) -> None:
    """Fill ``matrix`` with T^T M T, M = int rho S^T S dV and the point masses; multipliers have none.

    Scalar shape functions: an element's M is the same in every frame, so each class has one.
    """
    num = model.numbering
    tables = (num.place, num.indptr, num.index, num.value)
    matrix.clear()
    for mesh in model.meshes.values():
        Ms = np.array([mass_matrix(c.sampler) for c in mesh.classes])
        scatter_classes(matrix.target, Ms, np.ascontiguousarray(mesh.cls, dtype=np.int64),
                        np.ascontiguousarray(mesh.dofs), *tables)
    for coords, M in point_masses(model, d):
        scatter_classes(matrix.target, M[None], np.zeros(1, dtype=np.int64), coords[None, :].astype(np.int64), *tables)
