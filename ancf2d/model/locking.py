"""Sections that cannot thin where they bend, or not as they should where they are loaded across."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..elements.formulations.base import Sampler, rule_points, strains_at
from ..elements.section import Section
from .mesh import BodyMesh

# of the bending stiffness: below it, the excess is left to the documents
TOLD = 0.05
# of the strain across, where a body has no length; with it, the strain does depend on Poisson's ratio a little
TOLD_ACROSS = 0.02


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


def error_across(mesh: BodyMesh) -> float:
    """Return how far a body shorter than it is high strays from Hooke's law where it is loaded across.

    A load in proportion to y, as that of turning, with a mean stress of h^2/12, stretches an element across by b,
    which does not depend on Poisson's ratio, and along by -nu h^2/(12 E). The error is the larger one of the two, as a
    share of what stretches across. A section whose stretch
    along varies with y^2 escapes a coupling with the strain of the axis alone; in longer bodies, shear keeps it from
    that.
    """
    plan = mesh.plan
    if plan.rigid or plan.element.section_kind != "interpolated" or plan.element.degree_y < 2 \
            or plan.length > plan.section.height:
        return 0.0
    sampler = mesh.classes[0].sampler
    along, across = _stretched(mesh, sampler, plan.section)
    _, right = _stretched(mesh, sampler, replace(plan.section, nu=0.0))
    h, volume = plan.section.height, sampler.shape.l * plan.section.height * plan.section.width
    mean = h * h / (12.0 * plan.section.E * volume)
    return max(abs(across - right) / right, abs(along + plan.section.nu * mean) / mean)


def _stretched(mesh: BodyMesh, sampler: Sampler, section: Section) -> tuple[float, float]:
    """Return the mean strains along and across of an element of this section under a load in proportion to y."""
    plan, shape = mesh.plan, sampler.shape
    B, ref, D = plan.formulation.sample(replace(sampler, section=section), plan.rule)
    K = np.zeros((B.shape[2], B.shape[2]))
    for s in range(len(B)):
        _, J = strains_at(plan.formulation, ref[s], np.zeros(B.shape[1]))
        K += B[s].T @ J.T @ D[s] @ J @ B[s]
    xi, eta, w = rule_points((plan.element.degree_x + 1, plan.element.degree_y + 1))
    S = shape(xi, eta, 0, 0)
    x, y = (xi - xi.mean()) * shape.l, eta * section.height / 2
    loads = [(w * z) @ sampler.spread(S, k) for k, z in ((0, x), (1, y))]
    # coordinates differ in units by powers of the height
    size = 1.0 / np.sqrt(np.diag(K))
    u = size * np.linalg.lstsq(size[:, None] * K * size, size * loads[1], rcond=1e-13)[0]
    along, across = (float(load @ u) / float(w @ z**2) for load, z in zip(loads, (x, y), strict=True))
    return along, across


def locking_warning(mesh: BodyMesh) -> str | None:
    """Return what to say of a body that Poisson's ratio makes wrong across or in bending, None where it does not."""
    excess, across, plan = thickness_excess(mesh), error_across(mesh), mesh.plan
    if across > TOLD_ACROSS * (1.0 + (plan.length / plan.section.height) ** 2):
        return (f"bodies.{plan.name}: {plan.element.name} in formulation {plan.formulation.name} is off by "
                f"{100 * across:.3g} % where so short a body is loaded across, at nu = {plan.section.nu:g}; "
                "formulation continuum is not")
    if excess < TOLD:
        return None
    return (f"bodies.{plan.name}: {plan.element.name} in formulation {plan.formulation.name} cannot thin "
            f"where it bends and is too stiff by {100 * excess:.3g} % at nu = {plan.section.nu:g}; formulation "
            "enhanced or structural is not")
