"""Limits of elements: locking in bending, transverse load, large turns along their length, inversion."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..elements.formulations import FORMULATIONS, Formulation
from ..elements.formulations.base import Rule, Sampler, rule_points, strains_at
from ..elements.section import NO_CONSTANTS, Section
from ..elements.shape import Array, ShapeFunctions, shape_functions
from ..errors import ComputationError, many, percent
from .body_groups import Pool
from .classes import ElementClass
from .mesh import STATIONS, BodyMesh, Index, straight
from .model import Model
from .plan import default_rule

# share of the bending stiffness below which no warning is given
WARN_ABOVE = 0.05
# the same for the transverse strain, for a body of no length; for others the strain itself depends on Poisson's ratio
WARN_ABOVE_ACROSS = 0.02
# share of the default quadrature's energy below which a quadrature misses a motion
UNSEEN = 0.02
# Types that lock when slender are too stiff by about 0.011 (turn l/h)^2, measured with omar and patel: 4 % at a
# twentieth of the slenderness 40 that is safe for small turns.
SAFE = 0.05


def thickness_excess(mesh: BodyMesh) -> float:
    """Return the share of EI by which Poisson's ratio stiffens a straight element in bending; 0 if it can thin.

    A section that stays straight, bent by (-x y, 0), has no transverse strain; a law that couples it with the axial
    strain then resists by E/(1 - nu^2) instead of E. For a section of one elastic material the share depends on nu
    alone, and is computed for an element as long as high, of unit width and E.
    """
    plan = mesh.plan
    if plan.rigid or plan.element.section_kind != "interpolated" or plan.element.degree_y > 1:
        return 0.0
    section = plan.section
    if any(getattr(section, name) for name in NO_CONSTANTS):
        return _excess(mesh.classes[0].shape, plan.formulation, plan.rule, section)
    unit = shape_functions(plan.element, 1.0, 1.0, section.nu)
    return _unit_excess(unit, plan.formulation, plan.rule, section.nu, section.k_s, section.mu_k / section.E)


@lru_cache
def _unit_excess(shape: ShapeFunctions, formulation: Formulation, rule: Rule, nu: float, k_s: float, G: float) -> float:
    """Return the result of ``thickness_excess`` for unit height, width and E, and the shear stiffness G."""
    return _excess(shape, formulation, rule, Section(1.0, 1.0, 1.0, nu, k_s, EA=1.0, kGA=G, EI=1.0 / 12.0))


@lru_cache
def _excess(shape: ShapeFunctions, formulation: Formulation, rule: Rule, section: Section) -> float:
    """Return the result of ``thickness_excess`` for an element with these shape functions."""
    sampler = straight(shape, section)
    gain = _energy(sampler, formulation, rule) - _energy(replace(sampler, section=replace(section, nu=0.0)),
                                                         formulation, rule)
    return 2.0 * gain / (section.EI * shape.l)


def _energy(sampler: Sampler, formulation: Formulation, rule: Rule) -> float:
    """Return the strain energy of an element of this section that is bent by (-x y, 0) with unit curvature."""
    element, l = sampler.shape.element, sampler.shape.l
    bent = {"r_y": lambda x: -x, "r_xy": lambda x: -1.0}
    e = np.array([[bent[name](element.nodes[i].at * l) if name in bent else 0.0, 0.0]
                  for i, name in element.functionals]).ravel()
    B, ref, D = formulation.sample(sampler, rule)
    # small enough for linear strains
    small, energy = 1e-9 / (l + sampler.section.height), 0.0
    for s in range(len(B)):
        eps, _ = strains_at(formulation, ref[s], B[s] @ (small * e))
        energy += 0.5 * float(eps @ D[s] @ eps)
    return energy / small**2


def arc_excess(mesh: BodyMesh) -> tuple[float, ElementClass | None]:
    """Return how much stiffer in bending the worst curved element is than a straight one, and its class.

    End moments change only the curvature of an arc. A section whose direction is interpolated linearly cannot follow a
    curved axis without being stretched: for omar and patel the share is about 0.07 (turn l/h)^2.
    """
    worst = max(mesh.classes, key=lambda one: abs(one.turn) * one.shape.l)
    if mesh.plan.rigid or mesh.plan.element.section_kind != "interpolated" or worst.turn == 0.0:
        return 0.0, None
    return _bent(mesh, mesh.straight(worst)) / _bent(mesh, mesh.uniform(worst)) - 1.0, worst


def _bent(mesh: BodyMesh, sampler: Sampler) -> float:
    """Return the relative rotation of an element's ends under opposite unit end moments."""
    rows = sampler.derivative(np.array([0.0, 1.0]), np.zeros(2), 0, 1)
    r_y = rows @ sampler.e0
    load = np.zeros((2, len(sampler.e0), 2))
    load[:, :, 0], load[:, :, 1] = -r_y[:, 1:] * rows, r_y[:, :1] * rows
    turn = load / (r_y**2).sum(axis=1)[:, None, None]
    moments = (turn[1] - turn[0]).ravel()
    return float(moments @ _response(mesh, sampler, moments))


def _response(mesh: BodyMesh, sampler: Sampler, loads: Array) -> Array:
    """Return the displacements (n_dof, ...) of a free element under self-equilibrated loads."""
    K = _stiffness(mesh, sampler, mesh.plan.rule)
    # the units of coordinates differ by powers of the height
    size = 1.0 / np.sqrt(np.diag(K))
    return np.asarray((size * np.linalg.lstsq(size[:, None] * K * size, (size * loads.T).T, rcond=1e-13)[0].T).T)


def _stiffness(mesh: BodyMesh, sampler: Sampler, rule: Rule) -> Array:
    """Return the stiffness (n_dof, n_dof) of an element in its reference."""
    B, ref, D = mesh.plan.formulation.sample(sampler, rule)
    K = np.zeros((B.shape[2], B.shape[2]))
    for s in range(len(B)):
        _, J = strains_at(mesh.plan.formulation, ref[s], np.zeros(B.shape[1]))
        K += B[s].T @ J.T @ D[s] @ J @ B[s]
    return K


def hidden_motions(mesh: BodyMesh) -> int:
    """Return the number of motions of an element that its quadrature misses but the type's default one does not.

    The element is as long as high, so that a quadrature that omits shear against locking is judged fairly.
    """
    plan = mesh.plan
    usual = default_rule(plan.element, plan.formulation)
    if plan.rigid or plan.rule == usual:
        return 0
    sampler = mesh.straight(mesh.classes[0], plan.section.height)
    K, K_usual = _stiffness(mesh, sampler, plan.rule), _stiffness(mesh, sampler, usual)
    # the units of coordinates differ by powers of the height
    size = 1.0 / np.sqrt(np.diag(K_usual))
    energies, motions = np.linalg.eigh(size[:, None] * K_usual * size)
    # all but the rigid motions, scaled to unit energy
    motions = size[:, None] * motions[:, 3:] / np.sqrt(energies[3:])
    return int((np.linalg.eigvalsh(motions.T @ K @ motions) < UNSEEN).sum())


def error_across(mesh: BodyMesh) -> float:
    """Return the relative error of the strains of a short body (length <= height) under transverse load.

    A load proportional to y, as in rotation, with a mean stress of h^2/12, strains an element across by b, independent
    of Poisson's ratio, and along by -nu h^2/(12 E). The larger of both relative errors is returned. A section whose
    axial strain varies with y^2 escapes a Poisson coupling on the axis alone; in longer bodies, shear prevents this.
    """
    plan = mesh.plan
    if plan.rigid or plan.element.section_kind != "interpolated" or plan.element.degree_y < 2 \
            or plan.length > plan.section.height:
        return 0.0
    sampler = mesh.uniform(mesh.classes[0])
    along, across = _stretched(mesh, sampler, plan.section)
    _, right = _stretched(mesh, sampler, replace(plan.section, nu=0.0))
    h, volume = plan.section.height, sampler.shape.l * plan.section.height * plan.section.width
    mean = h * h / (12.0 * plan.section.E * volume)
    return max(abs(across - right) / right, abs(along + plan.section.nu * mean) / mean)


def _stretched(mesh: BodyMesh, sampler: Sampler, section: Section) -> tuple[float, float]:
    """Return the mean strains along and across of an element of this section under a load proportional to y."""
    plan, shape = mesh.plan, sampler.shape
    xi, eta, w = rule_points((plan.element.degree_x + 1, plan.element.degree_y + 1))
    S = shape(xi, eta, 0, 0)
    x, y = (xi - xi.mean()) * shape.l, eta * section.height / 2
    loads = [(w * z) @ sampler.spread(S, k) for k, z in ((0, x), (1, y))]
    u = _response(mesh, replace(sampler, section=section), loads[1])
    along, across = (float(load @ u) / float(w @ z**2) for load, z in zip(loads, (x, y), strict=True))
    return along, across


def hidden_warning(mesh: BodyMesh) -> str | None:
    """Return a warning for a body whose quadrature has too few points, or None."""
    plan, hidden = mesh.plan, hidden_motions(mesh)
    if not hidden:
        return None
    usual = default_rule(plan.element, plan.formulation).normal
    motions = f"{many(hidden, 'motion')} of each {plan.element.name} element"
    return (f"bodies.{plan.name}: {plan.rule} leave {motions} with little or no stiffness at nu = {plan.section.nu:g}, "
            f"so static solutions can be singular and modes spurious. Use quadrature [{usual[0]}, {usual[1]}]")


def locking_warning(mesh: BodyMesh) -> str | None:
    """Return a warning for a body that Poisson's ratio or curvature makes too stiff or inaccurate, or None."""
    excess, across, plan = thickness_excess(mesh), error_across(mesh), mesh.plan
    if across > WARN_ABOVE_ACROSS * (1.0 + (plan.length / plan.section.height) ** 2):
        return (f"bodies.{plan.name}: {plan.element.name} in formulation {plan.formulation.name} is {percent(across)} "
                f"in error under transverse load on a body as short as this, at nu = {plan.section.nu:g}. Use "
                "formulation continuum")
    more, curved = arc_excess(mesh)
    who = f"bodies.{plan.name}: {plan.element.name} in formulation {plan.formulation.name}"
    if curved is not None and more >= max(WARN_ABOVE, excess):
        l = curved.shape.l
        return (f"{who} is too stiff in bending by {percent(more)}, because one element rotates by "
                f"{abs(curved.turn):.2g} rad, {l / plan.section.height:.3g} heights long. Use more elements, or "
                "reissner3")
    if excess < WARN_ABOVE:
        return None
    better = [name for name in ("enhanced", "structural")
              if name != plan.formulation.name and FORMULATIONS[name].refuse(plan.element) is None]
    advice = f"formulation {' or '.join(better)}" if better else "patel in formulation continuum"
    return (f"{who} cannot contract across the section in bending and is too stiff by {percent(excess)} at nu = "
            f"{plan.section.nu:g}. Use {advice}")


def hinge_warning(mesh: BodyMesh) -> str | None:
    """Return a warning for a body whose plastic hinges cannot form where the moment peaks, or None.

    Hinges form at stations: in the middle of an element with one station, or inside where the ends have little weight.
    """
    plan = mesh.plan
    one = plan.rule.normal[0] == 1
    if not any(law.flows for law in plan.section.laws) or not (one or plan.rule.lobatto):
        return None
    # share of the distance between two hinges, one at each end
    lost = 1.0 if one else 2 / 3
    much = f"by {percent(lost / (plan.count - lost))}" if plan.count > 1 else "by far"
    place = "half" if one else "a third of"
    return (f"bodies.{plan.name}: plastic hinges of {plan.element.name} are {place} an element away from the peak of "
            f"the moment: collapse loads are too large, {much} if each end of the body has one. Use reissner3 or "
            "vallejo, whose hinges are at the nodes")


def coarse_warnings(model: Model, d: Array) -> list[str]:
    """Return warnings about bodies that in the state d (n_full,) bend more than their elements can follow."""
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
    return (f"bodies.{plan.name}: {plan.element.name} is too stiff for elements bent as far as this: one rotates by "
            f"{turn[k]:.2g} rad over a length of {length[k] / height:.3g} heights (product {slender:.2g}; up to "
            f"{SAFE * plan.element.slender:g} is safe). Use more elements, or vallejo or reissner3")


def _bend(mesh: BodyMesh, e: Array) -> Array:
    """Return the angles from the first to the last section of each element (n,)."""
    names = list(mesh.plan.element.functionals)
    angles = []
    for node in (0, len(mesh.plan.element.nodes) - 1):
        first = 2 * names.index((node, "r_y"))
        r_y = e[mesh.dofs[:, first:first + 2]]
        angles.append(np.arctan2(r_y[:, 1], r_y[:, 0]))
    return angles[1] - angles[0]


# number of elements per block, which fits the caches
BLOCK = 2048


def _orientation(pool: Pool, some: slice | Index, e: Array, before: Array | None) -> Array:
    """Return a measure that must stay positive along the axis of elements (elements, stations), at coordinates e.

    This is the area dr/dx x dr/dy for interpolated sections, the stretch along the section's normal for sections with
    theta, and for sections normal to the axis the scalar product of its tangent with that of ``before`` (1 if None).
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
    """Return the fields ``wanted`` (elements, stations) each, named as in ``Pool.along_axis``.

    All are computed as one matrix product with the coordinates q (elements, n_dof).
    """
    rows, stations = pool.along_axis(wanted), len(STATIONS)
    values = q @ rows[0].T if len(rows) == 1 else np.einsum("esk,ek->es", rows[pool.cls[some]], q)
    return [values[:, k * stations:(k + 1) * stations] for k in range(len(wanted))]


def inverted(model: Model, d: Array, before: Array | None = None) -> str | None:
    """Return a message about an inverted element at d (n_full,), or None if there is none.

    ``before`` is the state one step earlier, from which no axis may turn by more than a right angle.
    """
    for pool in model.pools:
        for first in range(0, len(pool.dofs), BLOCK):
            some = slice(first, first + BLOCK)
            dofs = pool.dofs[some]
            at = model.e0[dofs]
            sign = _orientation(pool, some, at + d[dofs], None if before is None else at + before[dofs])
            if not (sign > 0.0).all():
                ie, s = np.argwhere(~(sign > 0.0))[0] + [first, 0]
                return _where_inverted(pool, int(ie), float(STATIONS[s]))
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


def _where_inverted(pool: Pool, ie: int, station: float) -> str:
    """Return a message that says where an element is inverted."""
    k = int(np.searchsorted(pool.first, ie, side="right")) - 1
    mesh, ie = pool.meshes[k], ie - int(pool.first[k])
    s = (mesh.starts[ie] + station * mesh.lengths[ie]) / mesh.plan.length
    return f"an element is inverted: '{mesh.plan.name}' at S = {s:.4g}"


def check_inverted(model: Model, d: Array, before: Array | None, t: float) -> None:
    """Raise ComputationError if an element is inverted."""
    found = inverted(model, d, before)
    if found is not None:
        raise ComputationError(found, at={"factor": float(f"{t:.6g}")},
                               advice="a smaller load or motion; no body can be compressed to zero size")
