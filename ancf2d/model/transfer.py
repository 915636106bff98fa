"""Displacements of one mesh on another one of the same bodies."""

from __future__ import annotations

from itertools import pairwise

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
    return old.plan.element == new.plan.element and len(old.corners) == len(new.corners)


def _transfer(d: Array, old: BodyMesh, new: BodyMesh, out: Array) -> None:
    """Fill in the coordinates of a body, corner by corner: displacements and their derivatives at its nodes."""
    element = new.plan.element
    nc = element.components
    for before, after in zip(_between_corners(old), _between_corners(new), strict=True):
        rows = np.arange(after.start, after.stop)
        for c, (node, name) in enumerate(element.functionals):
            s = new.starts[rows] + element.nodes[node].at * new.lengths[rows]
            # the small share keeps a node from the element before the one that it begins
            ie = np.searchsorted(old.starts, s + 1e-12 * old.plan.length, side="right") - 1
            ie = np.clip(ie, before.start, before.stop - 1)
            xi = np.clip((s - old.starts[ie]) / old.lengths[ie], 0.0, 1.0)
            nodal = d[old.dofs[ie]].reshape(len(ie), -1, nc)
            for k in np.unique(old.cls[ie]):
                here = old.cls[ie] == k
                S = old.classes[k].shape(xi[here], np.zeros(here.sum()), *derivative_order(name))
                out[new.dofs[rows[here], nc * c:nc * (c + 1)]] = np.einsum("ns,nsc->nc", S, nodal[here])


def _between_corners(mesh: BodyMesh) -> list[slice]:
    """Return the elements between the corners of a body."""
    ends = [0, *mesh.corners, mesh.plan.count]
    return [slice(a, b) for a, b in pairwise(ends)]
