"""Displacements of one mesh on another one of the same bodies."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..elements.definition import derivative_order
from ..elements.shape import Array
from .mesh import BodyMesh, Index
from .model import Model

# of an element: how far inside of it its ends are looked up
NODE_MARGIN = 1e-6


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


def renumbered(d: Array, dofs: Iterable[Index], model: Model) -> Array:
    """Return values (n_q,) of nodal coordinates that the same elements had under other numbers ``dofs``, body by body.

    A node that had two sides gets their mean.
    """
    total, count = np.zeros(model.n_q), np.zeros(model.n_q)
    for before, mesh in zip(dofs, model.meshes.values(), strict=True):
        np.add.at(total, mesh.dofs, d[before])
        np.add.at(count, mesh.dofs, 1.0)
    return total / count


def _alike(old: BodyMesh, new: BodyMesh) -> bool:
    return old.plan.element == new.plan.element


def _transfer(d: Array, old: BodyMesh, new: BodyMesh, out: Array) -> None:
    """Fill in the coordinates of a body: displacements and their derivatives at its nodes."""
    element = new.plan.element
    if new.plan.rigid:
        # its mesh is always the same
        out[new.dofs] = d[old.dofs]
        return
    nc = element.components
    for c, (node, name) in enumerate(element.functionals):
        at = element.nodes[node].at
        s = new.starts + at * new.lengths
        # where two elements of the old mesh meet, the one that this element overlaps
        inner = new.starts + (NODE_MARGIN + (1.0 - 2.0 * NODE_MARGIN) * at) * new.lengths
        ie = np.clip(np.searchsorted(old.starts, inner, side="right") - 1, 0, old.plan.count - 1)
        xi = np.clip((s - old.starts[ie]) / old.lengths[ie], 0.0, 1.0)
        nodal = d[old.dofs[ie]].reshape(len(ie), -1, nc)
        for k in np.unique(old.cls[ie]):
            here = old.cls[ie] == k
            S = old.classes[k].shape(xi[here], np.zeros(here.sum()), *derivative_order(name))
            out[new.dofs[here, nc * c:nc * (c + 1)]] = np.einsum("ns,nsc->nc", S, nodal[here])
