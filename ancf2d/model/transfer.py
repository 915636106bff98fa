"""Transfer of displacements from one mesh to another of the same bodies."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..elements.definition import derivative_order
from ..elements.shape import Array
from .mesh import BodyMesh, Index
from .model import Model

# distance from the ends of an element, relative to its length, at which the old element is searched
NODE_MARGIN = 1e-6


def transferred(d: Array, old: Model, new: Model) -> Array | None:
    """Return full coordinates (n_full,) of the model ``new`` with the displacements d of ``old``, or None.

    Nodal coordinates are evaluated by the shape functions of the old mesh; multipliers are kept if there are equally
    many. None if names or element types of bodies differ.
    """
    if list(old.meshes) != list(new.meshes):
        return None
    out = np.zeros(len(new.numbering.place))
    for name, mesh in new.meshes.items():
        if old.meshes[name].plan.element != mesh.plan.element:
            return None
        _transfer(d, old.meshes[name], mesh, out)
    if old.numbering.n_multipliers == new.numbering.n_multipliers:
        out[new.n_q:] = d[old.n_q:]
    return out


def renumbered(d: Array, dofs: Iterable[Index], model: Model) -> Array:
    """Return nodal values (n_q,) given for other numbers ``dofs`` of the same elements, body by body.

    A node that was doubled before gets the mean of both values.
    """
    total, count = np.zeros(model.n_q), np.zeros(model.n_q)
    for before, mesh in zip(dofs, model.meshes.values(), strict=True):
        np.add.at(total, mesh.dofs, d[before])
        np.add.at(count, mesh.dofs, 1.0)
    return total / count


def _transfer(d: Array, old: BodyMesh, new: BodyMesh, out: Array) -> None:
    """Fill in the coordinates of one body: displacements and their derivatives at its nodes."""
    element = new.plan.element
    if new.plan.rigid:
        # its mesh is always the same
        out[new.dofs] = d[old.dofs]
        return
    nc = element.components
    for c, (node, name) in enumerate(element.functionals):
        at = element.nodes[node].at
        s = new.starts + at * new.lengths
        # at a node of the old mesh, take the element that this element overlaps
        inner = new.starts + (NODE_MARGIN + (1.0 - 2.0 * NODE_MARGIN) * at) * new.lengths
        ie = np.clip(np.searchsorted(old.starts, inner, side="right") - 1, 0, old.plan.count - 1)
        xi = np.clip((s - old.starts[ie]) / old.lengths[ie], 0.0, 1.0)
        nodal = d[old.dofs[ie]].reshape(len(ie), -1, nc)
        for k in np.unique(old.cls[ie]):
            here = old.cls[ie] == k
            S = old.classes[k].shape(xi[here], np.zeros(here.sum()), *derivative_order(name))
            out[new.dofs[here, nc * c:nc * (c + 1)]] = np.einsum("ns,nsc->nc", S, nodal[here])
