"""Elements that turn too far along their length, and inverted ones: whether a state can be trusted."""

from __future__ import annotations

import math

import numpy as np

from ..elements.shape import Array
from ..errors import ComputationError
from .body_groups import Pool
from .mesh import STATIONS, BodyMesh, Index
from .model import Model

# Types that are too stiff in bending where they are slender are so by about 0.011 (turn l/h)^2 of it, measured with
# omar and patel: a twentieth of the slenderness that is safe where little turns, 40, leaves 4 %.
SAFE = 0.05


def coarse_warnings(model: Model, d: Array) -> list[str]:
    """Return what to say of bodies that in a state d (n_full,) bend further than their elements follow."""
    e = model.e0 + d[:model.n_q]
    return [text for mesh in model.meshes.values() if (text := _warning(mesh, model.e0, e))]


def _warning(mesh: BodyMesh, e0: Array, e: Array) -> str | None:
    plan = mesh.plan
    if plan.rigid or not math.isfinite(plan.element.slender):
        return None
    length = mesh.lengths
    turn = np.abs(np.angle(np.exp(1j * (_bend(mesh, e) - _bend(mesh, e0)))))
    k = int(np.argmax(turn * length))
    height = float(np.broadcast_to(mesh.sections(np.array([0.5])).height, (len(length), 1))[k, 0])
    slender = float(turn[k] * length[k] / height)
    if not slender > SAFE * plan.element.slender:
        return None
    return (f"bodies.{plan.name}: {plan.element.name} is too stiff for elements bent this far: one turns by "
            f"{turn[k]:.2g} rad over a length of {length[k] / height:.3g} heights (product {slender:.2g}; "
            f"up to {SAFE * plan.element.slender:g} is safe). Use more elements, or vallejo or reissner3")


def _bend(mesh: BodyMesh, e: Array) -> Array:
    """Return the angles from the first to the last section of each element (n,)."""
    names = list(mesh.plan.element.functionals)
    angles = []
    for node in (0, len(mesh.plan.element.nodes) - 1):
        first = 2 * names.index((node, "r_y"))
        r_y = e[mesh.dofs[:, first:first + 2]]
        angles.append(np.arctan2(r_y[:, 1], r_y[:, 0]))
    return angles[1] - angles[0]


# elements are looked at in blocks that the caches hold
BLOCK = 2048


def _orientation(pool: Pool, some: slice | Index, e: Array, before: Array | None) -> Array:
    """Return what must stay positive along the axis of some elements (elements, stations), from their coordinates.

    The area dr/dx x dr/dy where sections are interpolated, the stretch along the section's normal where theta turns
    them, and for sections normal to the axis its direction beside that of the state ``before`` (or None).
    """
    kind = pool.plan.element.section_kind
    if kind == "interpolated":
        x, y, nx, ny = _fields(pool, some, e, (*AXIS, (1, 0), (1, 1)))
        return x * ny - y * nx
    if kind == "theta":
        x, y, theta = _fields(pool, some, e, (*AXIS, (2, 2)))
        return x * np.cos(theta) + y * np.sin(theta)
    x, y = _fields(pool, some, e, AXIS)
    if before is not None:
        old_x, old_y = _fields(pool, some, before, AXIS)
        return x * old_x + y * old_y
    return np.ones_like(x)


# x and y of dr/dx
AXIS = ((0, 0), (0, 1))


def _fields(pool: Pool, some: slice | Index, q: Array, wanted: tuple[tuple[int, int], ...]) -> list[Array]:
    """Return fields (elements, stations) each, as ``Pool.along_axis`` names them.

    All of them are one product of matrices with the coordinates q (elements, n_dof).
    """
    rows, stations = pool.along_axis(wanted), len(STATIONS)
    values = q @ rows[0].T if len(rows) == 1 else np.einsum("esk,ek->es", rows[pool.cls[some]], q)
    return [values[:, k * stations:(k + 1) * stations] for k in range(len(wanted))]


def inverted(model: Model, d: Array, before: Array | None = None) -> str | None:
    """Return which element is inverted at d (n_full,), in words; None where none is.

    ``before`` is the state one step before, from which no axis turns by more than a right angle.
    """
    for pool in model.pools:
        for first in range(0, len(pool.dofs), BLOCK):
            some = slice(first, first + BLOCK)
            dofs = pool.dofs[some]
            at = model.e0[dofs]
            sign = _orientation(pool, some, at + d[dofs], None if before is None else at + before[dofs])
            if not (sign > 0.0).all():
                ie, s = np.argwhere(~(sign > 0.0))[0] + [first, 0]
                return _told(pool, int(ie), float(STATIONS[s]))
    return None


def any_inverted(model: Model, states: Array) -> bool:
    """Return whether an element is inverted in any of the states d (m, n_full)."""
    for pool in model.pools:
        together = max(1, BLOCK // len(pool.dofs))
        for first in range(0, len(states), together):
            if together == 1:
                if inverted(model, states[first]) is not None:
                    return True
                continue
            d = states[first:first + together]
            q = model.e0[pool.dofs] + d[:, pool.dofs]
            some = np.tile(np.arange(len(pool.dofs)), len(d))
            if not (_orientation(pool, some, q.reshape(len(some), -1), None) > 0.0).all():
                return True
    return False


def _told(pool: Pool, ie: int, station: float) -> str:
    """Return in words where an element is inverted."""
    k = int(np.searchsorted(pool.first, ie, side="right")) - 1
    mesh, ie = pool.meshes[k], ie - int(pool.first[k])
    s = (mesh.starts[ie] + station * mesh.lengths[ie]) / mesh.plan.length
    return f"an element is inverted: '{mesh.plan.name}' at S = {s:.4g}"


def check_inverted(model: Model, d: Array, before: Array | None, t: float) -> None:
    """Raise ComputationError where an element is inverted."""
    found = inverted(model, d, before)
    if found is not None:
        raise ComputationError(found, at={"factor": float(f"{t:.6g}")},
                               advice="a smaller load or motion: no body can be compressed past zero size")
