"""Elements that turn too far along their length: what the mesh of a state that was reached costs."""

from __future__ import annotations

import math

import numpy as np

from ..elements.shape import Array
from .mesh import BodyMesh
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
