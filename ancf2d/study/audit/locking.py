"""Checks for shear and locking: deflection that a bending beam loses to spurious strains."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...elements.formulations.base import product_points
from ...elements.section import timoshenko
from ...elements.shape import Array, gauss, lobatto
from ...errors import ComputationError, percent
from ...model.model import Model
from .fields import (
    FAR,
    LARGE,
    SMALL,
    ZERO,
    beam,
    boundary_forces,
    deflected,
    deflection,
    response,
    stiffness,
    timoshenko_deflection,
    tip_deflection,
    work_inside,
)
from .patches import bending_compliance, constitutive
from .subject import FAIL, NOTE, NU, PASS, Finding, Subject, subject

# allowed relative difference of a shear factor from the rectangle's: in uniform shear, and in bending
UNIFORM, BENT = 0.05, 0.06
# share of the work below which there is no shear
NO_SHEAR = 1e-6
SLENDER = (10.0, 100.0, 1000.0)
# share of stiffness beyond which an element locks
LOCKS = 0.01
# a loss is due to the mesh if at most this share of it remains in the limit of fine meshes
REMAINS = 0.2
RATIOS = (-0.5, 0.0, 0.3, 0.45, 0.499)
REFERENCE = "reissner3"
# strains that take up energy in bending
AXIS, ACROSS, SHEAR = "axial strain", "thickness strain", "shear strain"


def shear_factor(s: Subject) -> Finding:
    """Examine the energy of uniform shear relative to that of the shear modulus, G A gamma^2/2."""
    model = s.free(3.0, 3)
    C, _ = constitutive(model, stiffness(model), 3.0)
    G, right = 0.5 / (1.0 + NU), timoshenko(NU)
    value = float(C[2, 2]) / G
    if value <= ZERO:
        return Finding(None, NOTE, "the element does not shear")
    if abs(value / right - 1) <= UNIFORM:
        return Finding(value, PASS, f"includes the shear factor of the rectangle ({right:.4f} at nu = {NU:g})")
    bent = factor_in_bending(s)
    if abs(bent / right - 1) <= BENT:
        return Finding(value, PASS, f"{value:.4g} in uniform shear, and {bent:.4f} in bending, where the section can "
                       "warp")
    return Finding(value, FAIL, f"the effective shear factor is {value:.4g} instead of {right:.4f}: "
                   f"{percent(value / right)} of the correct shear stiffness")


def factor_in_bending(s: Subject) -> float:
    """Return the shear factor k inside a free beam that end forces bend to an S: work = int M^2/(EI) + Q^2/(k G A) dx.

    The tractions are those of Saint-Venant's bending with Q = 1 and M = L/2 - x, L = 4 h; only the middle half counts,
    from -h to h. EI is that of the same elements in pure bending with M = 1. Infinite if there is no shear.
    """
    model = s.free(4.0, 4 * max(2, s.affordable(32, 800) // 4))
    bent = response(model, boundary_forces(model, lambda x, y: (-12 * y, 0 * x, 0 * x)))
    sheared = response(model, boundary_forces(model, lambda x, y: (12 * (x - 2) * y, 1.5 * (1 - 4 * y * y), 0 * x)))
    total = work_inside(model, sheared)
    # int M^2 dx from -h to h is 2/3, and 2 for the pure moment
    shear = total - work_inside(model, bent) / 3.0
    return 4.0 * (1.0 + NU) / shear if shear > NO_SHEAR * total else math.inf


def shear_in_bending(s: Subject) -> Finding:
    """Examine the effective shear factor in bending."""
    value, right = factor_in_bending(s), timoshenko(NU)
    if not math.isfinite(value):
        return Finding(None, NOTE, "the element does not shear")
    near = abs(value / right - 1) <= BENT
    return Finding(value, PASS if near else FAIL, f"{'close to' if near else 'differs from'} the rectangle's "
                   f"{right:.4f} (5/6 by energy)")


def shear_locking(s: Subject) -> Finding:
    """Examine cantilevers of four elements of growing slenderness: they must keep Timoshenko's deflection."""
    ratios = []
    for slenderness in SLENDER:
        section = s.chosen.section
        exact = timoshenko_deflection(section, slenderness, section.kGA)
        ratios.append(tip_deflection(s, slenderness, 4) / exact)
    lost = 1.0 - ratios[-1] / ratios[0]
    if lost <= LOCKS:
        return Finding(max(lost, 0.0), PASS, f"slender beams bend like thick ones (L/h from {SLENDER[0]:g} to "
                       f"{SLENDER[-1]:g} with 4 elements)")
    cause = _cause(s, *deflected(s, SLENDER[-1], 4, SMALL), large=0.0)
    return Finding(lost, NOTE if cause == ACROSS else FAIL, f"from L/h = {SLENDER[0]:g} to {SLENDER[-1]:g}, 4 "
                   f"elements, {percent(lost)} of the deflection is lost to {cause}")


def _cause(s: Subject, model: Model, d: Array, large: float) -> str:
    """Return the strain with the most energy besides bending: axial, thickness or shear strain.

    ``large`` is 1 for large displacements, 0 for linearised strains. Evaluated at the element's own integration points,
    on straight elements along x.
    """
    mesh, shape = beam(model), beam(model).classes[0].shape
    section, kind = mesh.plan.section, s.element.section_kind
    along = lobatto(s.rule.normal[0]) if s.rule.lobatto else gauss(s.rule.normal[0])
    xi, eta, w = product_points(along, gauss(s.rule.normal[1] if kind == "interpolated" else 1))
    u = d[mesh.dofs].reshape(len(mesh.dofs), s.element.n_shape, -1)

    def at(height: Array, i: int, j: int) -> Array:
        return np.einsum("pk,ekc->cep", shape(xi, height, i, j), u)

    ax, ay = at(0 * eta, 1, 0)[:2]
    shares = {AXIS: section.EA * (ax + 0.5 * large * (ax**2 + ay**2)) ** 2}
    if kind == "theta":
        theta = at(0 * eta, 0, 0)[2]
        c, t = 1.0 + large * (np.cos(theta) - 1.0), large * (np.sin(theta) - theta) + theta
        shares[AXIS] = section.EA * (c * (1.0 + ax) + large * t * ay - 1.0) ** 2
        shares[SHEAR] = section.kGA * (c * ay - t * (1.0 + large * ax)) ** 2
    elif kind == "interpolated":
        (fx, fy), (gx, gy) = at(eta, 1, 0), at(eta, 0, 1)
        shares[ACROSS] = section.EA * (gy + 0.5 * large * (gx**2 + gy**2)) ** 2
        shares[SHEAR] = section.kGA * (gx + fy + large * (fx * gx + fy * gy)) ** 2
    return max(shares, key=lambda k: float((shares[k] @ w).sum()))


@dataclass(frozen=True)
class ComplianceLoss:
    """Bending compliance lost to nu: the largest loss and its nu, the loss at 0.3, and the rest on fine meshes."""

    most: float
    at: float
    usual: float
    remaining: float

    def finding(self, good: str, bad: str, remedy: str = "") -> Finding:
        """Return the finding; a loss that vanishes with refinement is left to another check."""
        if self.most <= LOCKS:
            return Finding(max(self.most, 0.0), PASS, good)
        if self.remaining <= max(LOCKS, REMAINS * self.most):
            return Finding(self.most, NOTE, f"{percent(self.most)} of the bending compliance is lost at nu = "
                           f"{self.at:g}, but this vanishes with refinement")
        usual = f"{percent(self.usual)} at {NU:g}" if self.usual > LOCKS else f"nothing at {NU:g}"
        return Finding(self.most, FAIL, f"{bad}: {percent(self.most)} of the bending compliance is lost at nu = "
                       f"{self.at:g}, {usual}{remedy}")


def _lost_to_nu(s: Subject) -> ComplianceLoss:
    """Return the loss of bending compliance relative to nu = 0."""
    count = s.affordable(24, 400)
    found = {nu: bending_compliance(s, 10.0, count, nu) for nu in RATIOS}
    lost = {nu: found[0.0] - found[nu] for nu in RATIOS}
    at = max(lost, key=lambda nu: lost[nu])
    remaining = lost[at]
    if remaining > LOCKS:
        fine = bending_compliance(s, 10.0, 2 * count, 0.0) - bending_compliance(s, 10.0, 2 * count, at)
        # extrapolated: a loss due to the mesh is of second order in the element length
        remaining = fine - (lost[at] - fine) / 3.0
    return ComplianceLoss(lost[at], at, lost[NU], remaining)


def poisson_locking(s: Subject) -> Finding:
    """Examine pure bending over nu: plane stress must not make it stiffer."""
    return _lost_to_nu(s).finding(f"pure bending does not depend on nu (from {RATIOS[0]:g} to {RATIOS[-1]:g})",
                                  "Poisson locking")


def poisson_locking_of_basis(s: Subject) -> Finding:
    """Examine Poisson locking with the elastic forces of the full continuum, independent of the formulation."""
    full = s.with_formulation("continuum")
    if full is None:
        return Finding(None, NOTE, "the element has no thickness strain")
    remedy = "" if s.formulation.name == "continuum" else f"; formulation {s.formulation.name} avoids it"
    return _lost_to_nu(full).finding("the basis allows the lateral contraction of bending",
                                     "Poisson locking of the basis in full continuum form", remedy)


def thickness_locking(s: Subject) -> Finding:
    """Examine cantilevers of growing slenderness in large bending, compared with the geometrically exact beam."""
    reference, ratios = subject(REFERENCE), []
    for slenderness in SLENDER:
        F = FAR / 12.0 / slenderness**2
        exact = deflection(*deflected(reference, slenderness, 16, F, LARGE))
        try:
            ratios.append(deflection(*deflected(s, slenderness, 8, F, LARGE)) / exact)
        except ComputationError as error:
            return Finding(None, FAIL, f"no equilibrium at L/h = {slenderness:g} with 8 elements: "
                           f"{error.failure.reason}")
    lost = 1.0 - ratios[-1] / ratios[0]
    if lost <= LOCKS:
        return Finding(max(lost, 0.0), PASS, "in large bending, slender beams bend like thick ones (8 elements, L/h "
                       f"up to {SLENDER[-1]:g})")
    cause = _cause(s, *deflected(s, SLENDER[-1], 8, F, LARGE), large=1.0)
    return Finding(lost, FAIL if cause == ACROSS else NOTE, f"in large bending at L/h = {SLENDER[-1]:g}, 8 elements, "
                   f"{percent(lost)} of the deflection is lost to {cause}")
