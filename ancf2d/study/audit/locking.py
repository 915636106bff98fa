"""Shear and locking: what a bending beam loses to strains that it should not have."""

from __future__ import annotations

import math

import numpy as np

from ...elements.formulations.base import rule_points
from ...elements.section import timoshenko
from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from .beams import NU
from .deflections import FAR, LARGE, SMALL, deflected, deflection, timoshenko_deflection, tip_deflection
from .fields import ZERO, beam, boundary_forces, response, stiffness, work_inside
from .finding import FAIL, NOTE, PASS, Finding, percent
from .patches import bending_compliance, constitutive
from .subject import Subject, subject

# how far a shear factor may be from the rectangle's: as a constant, and as bending sees it
UNIFORM, BENT = 0.05, 0.06
# share of the work below which there is no shear
NOTHING = 1e-6
SLENDER = (10.0, 100.0, 1000.0)
# share of stiffness beyond which an element locks
LOCKS = 0.01
RATIOS = (-0.5, 0.0, 0.3, 0.45, 0.499)
REFERENCE = "reissner3"
# what bending can be lost to
AXIS, ACROSS = "strain of the axis", "strain across (thickness)"


def shear_factor(s: Subject) -> Finding:
    """Examine the energy of uniform shear over that of the shear modulus, G A gamma^2/2."""
    model = s.free(3.0, 3)
    C, _ = constitutive(model, stiffness(model), 3.0)
    G, right = 0.5 / (1.0 + NU), timoshenko(NU)
    value = float(C[2, 2]) / G
    if value <= ZERO:
        return Finding(None, NOTE, "the element does not shear")
    if abs(value / right - 1) <= UNIFORM:
        return Finding(value, PASS, f"the rectangle's factor ({right:.4f} at nu = {NU:g}) is in it")
    bent = factor_in_bending(s)
    if abs(bent / right - 1) <= BENT:
        return Finding(value, PASS, f"{value:.4g} of G A in uniform shear; in bending the section warps by itself: "
                       f"{bent:.4f}")
    return Finding(value, FAIL, f"the effective shear factor is {value:.4g}, where the rectangle's is {right:.4f}: "
                   f"{percent(value / right)} of the right shear stiffness")


def factor_in_bending(s: Subject) -> float:
    """Return k inside a free beam bent to an S by end forces: work = int M^2/(EI) + Q^2/(k G A) dx.

    The tractions are those of Saint-Venant's bending with Q = 1 and M = L/2 - x, L = 4 h; only the middle half counts,
    from -h to h. EI is that of the same elements in pure bending with M = 1. Infinite where nothing shears.
    """
    model = s.free(4.0, 4 * max(2, s.affordable(32, 800) // 4))
    bent = response(model, boundary_forces(model, lambda x, y: (-12 * y, 0 * x, 0 * x)))
    sheared = response(model, boundary_forces(model, lambda x, y: (12 * (x - 2) * y, 1.5 * (1 - 4 * y * y), 0 * x)))
    total = work_inside(model, sheared)
    # int M^2 dx is 2/3 from -h to h, where that of the pure moment is 2
    shear = total - work_inside(model, bent) / 3.0
    return 4.0 * (1.0 + NU) / shear if shear > NOTHING * total else math.inf


def shear_in_bending(s: Subject) -> Finding:
    """Examine the shear factor that bending sees."""
    value, right = factor_in_bending(s), timoshenko(NU)
    if not math.isfinite(value):
        return Finding(None, NOTE, "the element does not shear")
    near = abs(value / right - 1) <= BENT
    return Finding(value, PASS if near else FAIL, f"{'near' if near else 'off'} the rectangle's {right:.4f} (5/6 by "
                   "energy)")


def shear_locking(s: Subject) -> Finding:
    """Examine cantilevers of four elements, ever more slender: Timoshenko's deflection must stay."""
    ratios = []
    for slenderness in SLENDER:
        section = s.chosen.section
        exact = timoshenko_deflection(section, slenderness, section.kGA)
        ratios.append(tip_deflection(s, slenderness, 4) / exact)
    lost = 1.0 - ratios[-1] / ratios[0]
    if lost <= LOCKS:
        return Finding(max(lost, 0.0), PASS, f"slender beams bend like thick ones (L/h from {SLENDER[0]:g} to "
                       f"{SLENDER[-1]:g} with 4 elements)")
    cause = _cause(s, *deflected(s, SLENDER[-1], 4, SMALL / SLENDER[-1]))
    return Finding(lost, NOTE if cause == ACROSS else FAIL, f"from L/h = {SLENDER[0]:g} to {SLENDER[-1]:g}, 4 "
                   f"elements, {percent(lost)} of the deflection are lost, to {cause}")


def _cause(s: Subject, model: Model, d: Array) -> str:
    """Return the strain that takes most of the energy beside bending: of the axis, across, or shear.

    From the displacement gradients at the element's own points of quadrature, on straight elements along x.
    """
    mesh, shape = beam(model), beam(model).classes[0].shape
    xi, eta, w = rule_points(s.rule.normal)
    if s.element.section_kind != "interpolated":
        return AXIS
    e = (model.e0 + d)[mesh.dofs].reshape(len(mesh.dofs), s.element.n_shape, 2)

    def strains(at: Array) -> tuple[Array, Array, Array]:
        rx, ry = (np.einsum("pk,ekc->epc", shape(xi, at, i, j), e) for i, j in ((1, 0), (0, 1)))
        return ((rx**2).sum(-1) - 1) / 2, ((ry**2).sum(-1) - 1) / 2, (rx * ry).sum(-1)

    _, yy, xy = strains(eta)
    section = mesh.plan.section
    shares = {AXIS: section.E * (strains(0 * eta)[0] ** 2 @ w).sum(),
              ACROSS: section.E * (yy**2 @ w).sum(), "shear": section.mu_k * (xy**2 @ w).sum()}
    return max(shares, key=lambda k: shares[k])


def _lost_to_nu(s: Subject) -> tuple[float, float, float]:
    """Return (most compliance in bending lost on the way from nu = 0, at nu, what is lost at 0.3)."""
    count = s.affordable(24, 400)
    found = {nu: bending_compliance(s, 10.0, count, nu) for nu in RATIOS}
    lost = {nu: found[0.0] - found[nu] for nu in RATIOS}
    worst = max(lost, key=lambda nu: lost[nu])
    return lost[worst], worst, lost[NU]


def poisson_locking(s: Subject) -> Finding:
    """Examine pure bending over nu: plane stress must not make it stiffer."""
    lost, at, usual = _lost_to_nu(s)
    if lost <= LOCKS:
        return Finding(max(lost, 0.0), PASS, f"pure bending does not depend on nu (from {RATIOS[0]:g} to "
                       f"{RATIOS[-1]:g})")
    return Finding(lost, FAIL, f"locks by nu: of the bending compliance {_lost(lost, at, usual)}")


def poisson_locking_of_basis(s: Subject) -> Finding:
    """Examine the same with the elastic forces of the whole continuum, whatever the formulation."""
    full = s.with_formulation("continuum")
    if full is None:
        return Finding(None, NOTE, "the element has no body: nothing contracts across")
    lost, at, usual = _lost_to_nu(full)
    if lost <= LOCKS:
        return Finding(max(lost, 0.0), PASS, "the basis itself can contract where it is bent")
    remedy = "" if s.formulation.name == "continuum" else f"; formulation {s.formulation.name} is there for that"
    return Finding(lost, FAIL, f"the basis locks by nu in the full continuum: {_lost(lost, at, usual)}{remedy}")


def _lost(lost: float, at: float, usual: float) -> str:
    at_usual = f"{percent(usual)} at {NU:g}" if usual > LOCKS else f"nothing at {NU:g}"
    return f"{percent(lost)} are lost at nu = {at:g}, {at_usual}"


def thickness_locking(s: Subject) -> Finding:
    """Examine cantilevers bent far, ever more slender, beside the geometrically exact beam."""
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
        return Finding(max(lost, 0.0), PASS, f"bent far, slender beams bend like thick ones (8 elements, L/h up to "
                       f"{SLENDER[-1]:g})")
    cause = _cause(s, *deflected(s, SLENDER[-1], 8, F, LARGE))
    return Finding(lost, FAIL if cause == ACROSS else NOTE, f"bent far at L/h = {SLENDER[-1]:g}, 8 elements, "
                   f"{percent(lost)} of the deflection are lost, to {cause}")
