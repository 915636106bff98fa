"""Bodies as kernel groups: sampled laws with element classes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..elements.shape import Array
from ..kernels.elements import Group
from .mesh import BodyMesh
from .model import Model


def make_group(mesh: BodyMesh) -> Group:
    """Return the kernel group of one body."""
    plan = mesh.plan
    samples = [plan.formulation.sample(c.sampler, plan.rule) for c in mesh.classes]
    B, ref, D = (np.ascontiguousarray(np.stack(part)) for part in zip(*samples, strict=True))
    return Group(plan.formulation.law(B, ref, D), np.ascontiguousarray(mesh.cls, dtype=np.int64),
                 np.ascontiguousarray(mesh.turn), np.ascontiguousarray(mesh.dofs, dtype=np.int64),
                 plan.element.components)


def make_groups(meshes: dict[str, BodyMesh]) -> list[Any]:
    """Return the groups of all bodies that deform."""
    return [make_group(m) for m in meshes.values() if not m.plan.rigid]


def damping_times(model: Model) -> Array:
    """Return tau [s] of each group in stress D (eps + tau d eps/dt): the material's own and Rayleigh's beta."""
    damping = model.case.damping
    beta = damping.rayleigh.beta if damping else 0.0
    materials = [model.case.bodies[name].material for name, mesh in model.meshes.items() if not mesh.plan.rigid]
    return np.array([beta + (m.damping.kelvin_voigt if m and m.damping else 0.0) for m in materials])
