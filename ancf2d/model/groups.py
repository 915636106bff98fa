"""Bodies as kernel groups: sampled laws with element classes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels.elements import Group
from .mesh import BodyMesh

# larger elements share one kernel with sizes known at run time, so that each order does not compile anew
STATIC_SIZES = 16
STATIC_STRAINS = 4


def make_group(mesh: BodyMesh) -> Group:
    """Return the kernel group of one body; sizes up to 16 are known to the compiler."""
    plan = mesh.plan
    samples = [plan.formulation.sample(c.sampler, plan.rule) for c in mesh.classes]
    B, ref, D = (np.ascontiguousarray(np.stack(part)) for part in zip(*samples, strict=True))
    n = plan.element.n_dof
    static = n <= STATIC_SIZES and D.shape[-1] <= STATIC_STRAINS
    size = tuple((0,) * k if static else () for k in (n, B.shape[2], D.shape[-1]))
    return Group(plan.formulation.law(B, ref, D), np.ascontiguousarray(mesh.cls, dtype=np.int64),
                 np.ascontiguousarray(mesh.turn), np.ascontiguousarray(mesh.dofs, dtype=np.int64),
                 plan.element.components, size)


def make_groups(meshes: dict[str, BodyMesh]) -> list[Any]:
    """Return the groups of all bodies."""
    return [make_group(m) for m in meshes.values()]
