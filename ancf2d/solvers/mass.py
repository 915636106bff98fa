"""The mass matrix: of the unknowns, stored as the tangent is, and of all coordinates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..elements.shape import Array
from ..interactions.inertia import mass_block, mass_terms
from ..kernels.mass import scatter_classes
from ..model.mesh import Index, mass_matrix
from ..model.model import Model
from .linear import TangentMatrix
from .state import State

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


def point_masses(model: Model, e: Array | None = None) -> Iterator[tuple[Index, Array]]:
    """Yield (coordinates (n,), matrix (n, n)) of each point mass; see ``mass_terms`` for ``e``."""
    for item in model.case.masses:
        yield mass_block(mass_terms(item, model.point(item.at), e))


def assemble_mass(model: Model, matrix: TangentMatrix, e: Array | None = None) -> None:
    """Fill ``matrix`` with T^T M T, M = int rho S^T S dV and the point masses; multipliers have none.

    With ``e`` (n_q,) it is that of small motion about these coordinates.

    Scalar shape functions: an element's M is the same in every frame, so each class has one.
    """
    num = model.numbering
    tables = (num.place, num.indptr, num.index, num.value)
    matrix.clear()
    for mesh in model.meshes.values():
        Ms = np.array([mass_matrix(c.sampler) for c in mesh.classes])
        scatter_classes(matrix.target, Ms, np.ascontiguousarray(mesh.cls, dtype=np.int64),
                        np.ascontiguousarray(mesh.dofs), *tables)
    for coords, M in point_masses(model, e):
        scatter_classes(matrix.target, M[None], np.zeros(1, dtype=np.int64), coords[None, :].astype(np.int64), *tables)


def full_mass(model: Model, e: Array | None = None) -> csr_matrix:
    """Return the constant mass matrix M (n_q, n_q) of all nodal coordinates, point masses included.

    With ``e`` (n_q,) it is that of small motion about these coordinates.
    """
    masses = ((coords[None, :], M) for coords, M in point_masses(model, e))
    return scattered([*_element_masses(model), *masses], model.n_q)


def coriolis_matrix(model: Model, omega: float) -> csr_matrix:
    """Return 2 omega G (n_q, n_q), G = int rho S^T J S dV with J the quarter turn: the Coriolis forces of a frame that
    turns with ``omega``.

    Sections turn in the frame as they do outside: theta has no part in it.
    """
    blocks = []
    for mesh in model.meshes.values():
        nc = mesh.plan.element.components
        for k, cls in enumerate(mesh.classes):
            M = mass_matrix(cls.sampler)
            G = np.zeros_like(M)
            G[:, 0::nc], G[:, 1::nc] = M[:, 1::nc], -M[:, 0::nc]
            blocks.append((mesh.dofs[mesh.cls == k], 2.0 * omega * G))
    terms = [term for m in model.case.masses for term in mass_terms(m, model.point(m.at)) if len(term.columns) == 2]
    for term in terms:
        (cx, wx), (cy, wy) = term.columns
        block = 2.0 * omega * term.inertia * np.outer(np.append(0.0 * wx, wy), np.append(wx, 0.0 * wy))
        blocks.append((np.append(cx, cy)[None, :], block - block.T))
    return scattered(blocks, model.n_q)


def _element_masses(model: Model) -> Iterator[tuple[Index, Array]]:
    for mesh in model.meshes.values():
        for k, cls in enumerate(mesh.classes):
            yield mesh.dofs[mesh.cls == k], mass_matrix(cls.sampler)


def scattered(blocks: Iterable[tuple[Index, Array]], n: int) -> csr_matrix:
    """Return the matrix (n, n) that is the sum of blocks: coordinates (m, k) and matrices (m, k, k), or one for all."""
    from scipy.sparse import coo_matrix

    rows, columns, values = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for dofs, M in blocks:
        m, k = dofs.shape
        rows.append(np.repeat(dofs, k, axis=1).ravel())
        columns.append(np.tile(dofs, (1, k)).ravel())
        values.append(np.broadcast_to(M, (m, k, k)).ravel())
    place = (np.concatenate(rows), np.concatenate(columns))
    out = coo_matrix((np.concatenate(values), place), shape=(n, n)).tocsr()
    out.eliminate_zeros()
    return out


def unknowns_to_coordinates(model: Model) -> csr_matrix:
    """Return T (n_q, n): nodal coordinates from unknowns, without what is prescribed."""
    from scipy.sparse import csr_matrix

    num = model.numbering
    own = num.free < num.n_q
    rows = np.concatenate([num.free[own], np.repeat(num.dependent, np.diff(num.indptr))])
    columns = np.concatenate([np.flatnonzero(own), num.index])
    values = np.concatenate([np.ones(own.sum()), num.value])
    return csr_matrix((values, (rows, columns)), shape=(num.n_q, num.n_unknowns))


def inertia_rates(model: Model, state: State) -> Array | None:
    """Return a + alpha v (n_q,), so that M times it are the forces of inertia and of Rayleigh's alpha; None at rest."""
    if state.a is None:
        return None
    a, damping = state.a[:model.n_q], model.case.damping
    if damping is None or state.v is None:
        return a
    return a + damping.rayleigh.alpha * state.v[:model.n_q]
