"""Rigid bodies as equations: every straight piece keeps its length."""

from __future__ import annotations

import numpy as np

from .constraints import Equations
from .elimination import Elimination
from .mesh import BodyMesh
from .point_patch import Field, PointConstraint

LENGTH = "length"


def keep_lengths(mesh: BodyMesh, out: Equations) -> None:
    """Ask that the pieces of a rigid body keep their lengths."""
    for dofs in mesh.dofs if mesh.plan.rigid else ():
        a, b = dofs[:2], dofs[2:]
        p0 = mesh.e0[b - mesh.first_dof] - mesh.e0[a - mesh.first_dof]
        L = float(np.hypot(*p0))
        fields = [Field(np.array([a[k], b[k]]), np.array([-1.0, 1.0]), float(p0[k])) for k in range(2)]
        out.constraints.append(PointConstraint("fixed_length", fields, [L], mesh.plan.name, LENGTH, L))


def drop_held_lengths(elimination: Elimination, out: Equations) -> None:
    """Take off the lengths whose ends supports hold in place already: they would be held twice."""
    def still(coord: int) -> bool:
        follows = elimination.dependents.get(coord)
        return follows is not None and not follows.terms and not any(out.rows[r].signal for r in follows.rhs)

    held = [c for c in out.constraints if c.holds == LENGTH and all(still(int(i)) for i in c.dofs)]
    out.constraints = [c for c in out.constraints if c not in held]
    out.warnings += [f"held twice: the {LENGTH} of {c.owner}, both ends of which are held; what it carries is not known"
                     for c in held]
