"""Elements that have turned inside out: states that equations admit and bodies do not."""

from __future__ import annotations

import numpy as np

from ..elements.formulations.base import cross
from ..elements.shape import Array
from ..errors import ComputationError
from .mesh import STATIONS, BodyMesh
from .model import Model


def _orientation(mesh: BodyMesh, e: Array, before: Array | None) -> Array:
    """Return what must stay positive along the axis (elements, stations).

    The area dr/dx x dr/dy where sections are interpolated, the stretch along the section's normal where theta turns
    them, and for sections normal to the axis its direction beside that of the state ``before`` (coordinates, or None).
    """
    out = np.ones((len(mesh.dofs), len(STATIONS)))
    nc, kind = mesh.plan.element.components, mesh.plan.element.section_kind
    for k in range(len(mesh.classes)):
        rows = mesh.cls == k
        local = e[mesh.dofs[rows]].reshape(rows.sum(), -1, nc)
        S_x, S_y, S = mesh.axis_rows[k]
        along = np.einsum("sk,ekc->esc", S_x, local)
        if kind == "interpolated":
            out[rows] = cross(along, np.einsum("sk,ekc->esc", S_y, local))
        elif kind == "theta":
            theta = np.einsum("sk,ek->es", S, local[..., 2])
            out[rows] = along[..., 0] * np.cos(theta) + along[..., 1] * np.sin(theta)
        elif before is not None:
            old = before[mesh.dofs[rows]].reshape(rows.sum(), -1, nc)
            was = np.einsum("sk,ekc->esc", S_x, old)
            out[rows] = (along * was).sum(axis=2)
    return out


def inverted(model: Model, d: Array, before: Array | None = None) -> str | None:
    """Return which element has turned inside out at d (n_full,), in words; None where none has.

    ``before`` is the state one step before, from which no axis turns by more than a right angle.
    """
    e = model.e0 + d[:model.n_q]
    old = None if before is None else model.e0 + before[:model.n_q]
    for name, mesh in model.meshes.items():
        if mesh.plan.rigid:
            continue
        sign = _orientation(mesh, e, old)
        if not (sign > 0.0).all():
            ie, s = np.argwhere(~(sign > 0.0))[0]
            ends = np.concatenate([p.s0 + p.l * np.arange(p.count) for p in mesh.plan.pieces])
            length = np.repeat([p.l for p in mesh.plan.pieces], [p.count for p in mesh.plan.pieces])
            at = (ends[ie] + STATIONS[s] * length[ie]) / mesh.plan.length
            return f"{name} has turned inside out at S = {at:.4g}"
    return None


def check_inverted(model: Model, d: Array, before: Array | None, t: float) -> None:
    """Raise ComputationError where an element has turned inside out."""
    found = inverted(model, d, before)
    if found is not None:
        raise ComputationError(found, at={"factor": float(f"{t:.6g}")},
                               advice="a smaller load or motion: no body can be pressed to nothing and beyond")
