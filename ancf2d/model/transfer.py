"""Displacements of one mesh on another one of the same bodies."""

from __future__ import annotations

import numpy as np

from ..elements.definition import derivative_order
from ..elements.shape import Array
from .mesh import BodyMesh
from .model import Model


def transferred(d: Array, old: Model, new: Model) -> Array | None:
    """Return full coordinates (n_full,) of a model that has the displacements d of another one, None where it cannot.

    Nodal coordinates are read from the shape functions of the old mesh; multipliers are kept where there are as many.
    None where bodies have other element types.
    """
    if list(old.meshes) != list(new.meshes):
        return None
    out = np.zeros(len(new.numbering.place))
    for name, mesh in new.meshes.items():
        if not _alike(old.meshes[name], mesh):
            return None
        _transfer(d, old.meshes[name], mesh, out)
    if old.numbering.n_multipliers == new.numbering.n_multipliers:
        out[new.n_q:] = d[old.n_q:]
    return out


def _alike(old: BodyMesh, new: BodyMesh) -> bool:
    return old.plan.element == new.plan.element and len(old.plan.pieces) == len(new.plan.pieces)


def _transfer(d: Array, old: BodyMesh, new: BodyMesh, out: Array) -> None:
    """Fill in the coordinates of a body, piece by piece: displacements and their derivatives at its nodes."""
    element = new.plan.element
    nc = element.components
    for k, (coarse, fine) in enumerate(zip(old.plan.pieces, new.plan.pieces, strict=True)):
        rows = new.piece_first[k] + np.arange(fine.count)
        shape = old.classes[old.cls[old.piece_first[k]]].shape
        for c, (node, name) in enumerate(element.functionals):
            along = (np.arange(fine.count) + element.nodes[node].at) * (coarse.count / fine.count)
            ie = np.minimum((along * (1 + 1e-12)).astype(int), coarse.count - 1)
            xi = np.clip(along - ie, 0.0, 1.0)
            S = shape(xi, np.zeros(len(xi)), *derivative_order(name))
            nodal = d[old.dofs[old.piece_first[k] + ie]].reshape(len(xi), -1, nc)
            out[new.dofs[rows, nc * c:nc * (c + 1)]] = np.einsum("ns,nsc->nc", S, nodal)
