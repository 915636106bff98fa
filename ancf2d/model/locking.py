"""Sections that cannot thin: what Poisson's ratio adds to the bending stiffness of an element."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..elements.formulations.base import Sampler, strains_at
from ..elements.section import Section
from .mesh import BodyMesh

# of the bending stiffness: below it, the excess is left to the documents
TOLD = 0.05


def thickness_excess(mesh: BodyMesh) -> float:
    """Return how much stiffer in bending an element is for Poisson's ratio, as a share of EI; 0 where it can thin.

    A section that stays straight, bent by (-x y, 0), has no strain across; a law that couples it with the strain along
    then resists by E/(1 - nu^2) in place of E.
    """
    plan = mesh.plan
    if plan.rigid or plan.element.section_kind != "interpolated" or plan.element.degree_y > 1:
        return 0.0
    sampler = mesh.classes[0].sampler
    gain = _energy(mesh, sampler, plan.section) - _energy(mesh, sampler, replace(plan.section, nu=0.0))
    return 2.0 * gain / (plan.section.EI * sampler.shape.l)


def _energy(mesh: BodyMesh, sampler: Sampler, section: Section) -> float:
    """Return the energy of an element of this section, bent by (-x y, 0) with unit curvature."""
    plan = mesh.plan
    nodes, l = plan.element.nodes, sampler.shape.l
    bent = {"r_y": lambda x: -x, "r_xy": lambda x: -1.0}
    e = np.array([[bent[name](nodes[i].at * l) if name in bent else 0.0, 0.0]
                  for i, name in plan.element.functionals]).ravel()
    B, ref, D = plan.formulation.sample(replace(sampler, section=section), plan.rule)
    # so small that strains are linear
    small, energy = 1e-9 / (l + section.height), 0.0
    for s in range(len(B)):
        eps, _ = strains_at(plan.formulation, ref[s], B[s] @ (small * e))
        energy += 0.5 * float(eps @ D[s] @ eps)
    return energy / small**2


def locking_warning(mesh: BodyMesh) -> str | None:
    """Return what to say of a body that Poisson's ratio makes too stiff in bending, None where it does not."""
    excess = thickness_excess(mesh)
    if excess < TOLD:
        return None
    plan = mesh.plan
    return (f"bodies.{plan.name}: {plan.element.name} in formulation {plan.formulation.name} cannot thin "
            f"where it bends and is too stiff by {100 * excess:.3g} % at nu = {plan.section.nu:g}; formulation "
            "enhanced or structural is not")
