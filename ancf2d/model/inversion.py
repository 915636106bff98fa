"""Elements that have turned inside out: states that equations admit and bodies do not."""

from __future__ import annotations

import numpy as np

from ..elements.shape import Array
from ..errors import ComputationError
from .mesh import STATIONS, BodyMesh
from .model import Model


def _orientation(mesh: BodyMesh, e: Array, before: Array | None) -> Array:
    """Return what must stay positive along the axis (elements, stations).

    The area dr/dx x dr/dy where sections are interpolated, the stretch along the section's normal where theta turns
    them, and for sections normal to the axis its direction beside that of the state ``before`` (coordinates, or None).
    """
    nc, kind = mesh.plan.element.components, mesh.plan.element.section_kind
    S_x, S_y, S = (rows[0] if len(rows) == 1 else np.stack(rows)[mesh.cls]
                   for rows in zip(*mesh.axis_rows, strict=True))

    def values(rows: Array, q: Array, component: int) -> Array:
        of = q[mesh.dofs[:, component::nc]]
        return of @ rows.T if rows.ndim == 2 else np.einsum("esk,ek->es", rows, of)

    x, y = values(S_x, e, 0), values(S_x, e, 1)
    if kind == "interpolated":
        return x * values(S_y, e, 1) - y * values(S_y, e, 0)
    if kind == "theta":
        theta = values(S, e, 2)
        return x * np.cos(theta) + y * np.sin(theta)
    if before is not None:
        return x * values(S_x, before, 0) + y * values(S_x, before, 1)
    return np.ones_like(x)


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
