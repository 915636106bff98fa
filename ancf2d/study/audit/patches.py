"""Checks of forces and energies: rigid motion, patch tests on unequal elements, zero-energy modes."""

from __future__ import annotations

import numpy as np

from ...elements.shape import Array
from ...errors import many, percent
from ...model.model import Model
from .fields import (
    ZERO,
    beam,
    boundary_forces,
    compliance,
    elastic,
    element_stiffness,
    linear_field,
    rigidly_moved,
    rotated,
    stiffness,
    tip_deflection,
    uniform,
)
from .subject import FAIL, NOTE, NU, PASS, ROUND_OFF, Finding, Subject, judged

ANGLES = (0.3, 1.6, -2.9)
# ends of three pieces of unequal length, as shares
UNEQUAL = (0.0, 0.2, 0.65, 1.0)
# allowed relative residual of states of constant stress
EXACT = 1e-8
# bending error of a fine mesh that is attributed to the beam, not to the element
FINE = 1e-2
# rigid motions of a free beam
RIGID = 3
STRAINS = {"xx": (0, 0), "yy": (1, 1), "xy": (1, 0)}


def rigid_motion(s: Subject) -> Finding:
    """Examine the elastic forces of finite rigid motions, relative to those of a unit displacement that strains."""
    model = s.free(3.0, 2)
    still, w = np.zeros(model.n_q), model.weights
    scale = float(np.abs(stiffness(model) / np.outer(w, w)).max())
    worst = 0.0
    for angle in (0.0, *ANGLES):
        energy, Q = elastic(model, rigidly_moved(model, still, angle, (0.7, -0.4)))
        worst = max(worst, float(np.abs(Q / w).max()) / scale, abs(energy) / scale)
    return judged(worst, ROUND_OFF, "translations and finite rotations cause no forces and no energy",
                  "rigid motions cause forces (per stiffness and unit displacement)")


def objectivity(s: Subject) -> Finding:
    """Examine energy and forces of a deformed state under superposed finite rotations."""
    model = s.free(3.0, 2)
    rng = np.random.default_rng(1)
    d = 0.1 * rng.uniform(-1, 1, model.n_q) / model.weights
    energy, Q = elastic(model, d)
    worst = 0.0
    for angle in ANGLES:
        other, P = elastic(model, rigidly_moved(model, d, angle, (0.7, -0.4)))
        back = rotated(model, Q, angle)
        worst = max(worst, abs(other / energy - 1), float(np.abs(P - back).max() / np.abs(Q).max()))
    return judged(worst, ROUND_OFF, "a superposed rotation keeps the energy and rotates the forces with it",
                  "energy or forces of a deformed element depend on its rotation")


def isotropy(s: Subject) -> Finding:
    """Examine whether a cantilever bends alike in all directions of the plane."""
    straight = tip_deflection(s, 10.0, 4)
    worst = max(abs(tip_deflection(s, 10.0, 4, angle=a) / straight - 1) for a in ANGLES)
    return judged(worst, EXACT, "the response does not depend on the direction of the beam",
                  "the response depends on the direction of the beam in the plane")


def constitutive(model: Model, K: Array, length: float) -> tuple[Array, dict[str, Array]]:
    """Return C (3, 3) of stress = C strain (xx, yy, xy) from energies of uniform fields, and these fields (n_q,)."""
    fields = {}
    for name, (a, b) in STRAINS.items():
        G = np.zeros((2, 2))
        G[a, b] = 1.0
        fields[name] = linear_field(model, G)
    D = np.array(list(fields.values()))
    return D @ K @ D.T / length, fields


def _patch(s: Subject, name: str) -> tuple[float, float] | None:
    """Return (residual, modulus) of a uniform state of one stress alone, or None if the element has no such strain.

    At every node, the nodal forces of the state must equal those that its stress exerts on ends and faces.
    """
    model = s.free(3.0, 3, breaks=UNEQUAL)
    K = stiffness(model)
    C, fields = constitutive(model, K, 3.0)
    k = list(STRAINS).index(name)
    if C[k, k] <= ZERO * np.abs(C).max():
        return None
    strain = np.linalg.pinv(C, rcond=1e-10)[:, k]
    d = sum(e * f for e, f in zip(strain, fields.values(), strict=True))
    xx, yy, xy = C @ strain
    Q = boundary_forces(model, uniform(xx, xy, yy))
    w, num = model.weights, model.numbering
    rest = num.reduce(K @ d - Q) / w[num.free]
    return float(np.abs(rest).max() / np.abs(Q / w).max()), float(1.0 / strain[k])


def _patch_finding(s: Subject, name: str, what: str, modulus: float, none: str) -> Finding:
    found = _patch(s, name)
    if found is None:
        return Finding(None, NOTE, none)
    residual, computed = found
    if not residual <= EXACT:
        return Finding(residual, FAIL, f"{what} is not exact on unequal elements: nodal forces remain")
    if abs(computed / modulus - 1) > EXACT:
        return Finding(residual, FAIL, f"{what} is in equilibrium, but the modulus is {computed / modulus:.4g} times "
                       "the correct one")
    return Finding(residual, PASS, f"{what} is exact on unequal elements")


def patch_axial(s: Subject) -> Finding:
    """Examine uniform tension with sections free to contract."""
    return _patch_finding(s, "xx", "uniform tension", 1.0, "the element has no axial strain")


def patch_transverse(s: Subject) -> Finding:
    """Examine uniform transverse tension with the element free to contract along its axis."""
    return _patch_finding(s, "yy", "uniform transverse tension", 1.0, "the section keeps its height, so it has no such "
                          "strain")


def patch_shear(s: Subject) -> Finding:
    """Examine uniform shear; the shear factor is checked separately."""
    return _patch_finding(s, "xy", "uniform shear", s.chosen.section.mu_k, "the element does not shear")


def bending_compliance(s: Subject, length: float, count: int, nu: float = NU,
                       breaks: tuple[float, ...] = (0.0, 1.0)) -> float:
    """Return the work of a linear normal stress on both ends of a free beam, relative to that of a beam with EI."""
    model = s.free(length, count, nu=nu, breaks=breaks)
    section = beam(model).plan.section
    work = compliance(model, boundary_forces(model, lambda x, y: (-y, 0 * x, 0 * x)))
    return work / (section.EI * length / section.E**2)


def patch_bending(s: Subject) -> Finding:
    """Examine pure bending of unequal elements, and whether the error vanishes with refinement."""
    coarse = bending_compliance(s, 10.0, 3, breaks=UNEQUAL) - 1
    fine = bending_compliance(s, 10.0, s.affordable(24, 800), breaks=UNEQUAL) - 1
    if abs(coarse) <= EXACT:
        return Finding(coarse, PASS, "pure bending is exact on unequal elements")
    too = "stiff" if coarse < 0 else "soft"
    if abs(fine) > max(FINE, EXACT) or abs(fine) > 0.5 * abs(coarse):
        return Finding(coarse, FAIL, f"too {too} in pure bending by {percent(coarse)}, and still by {percent(fine)} on "
                       "elements shorter than their height")
    return Finding(coarse, NOTE, f"pure bending is exact only in the limit: three elements are {percent(coarse)} "
                   f"too {too}, short ones still have an error of {percent(fine)}")


def hidden_modes(model: Model, K: Array) -> int:
    """Return the number of motions without strain energy for K (n_q, n_q), beyond the rigid ones."""
    w = model.weights
    values = np.linalg.eigvalsh(K / np.outer(w, w))
    return int((values < 100 * ZERO * values[-1]).sum()) - RIGID


def zero_energy_modes(s: Subject) -> Finding:
    """Examine the null space of the stiffness beyond rigid motion: of one element, and of four."""
    worst, at = 0, NU
    for nu in (NU, 0.0):
        model = s.free(1.0, 1, nu=nu)
        K = element_stiffness(model)[0]
        # not finite where the shape functions do not exist at this nu, which another check reports
        hidden = hidden_modes(model, K) if np.isfinite(K).all() else 0
        if hidden > worst:
            worst, at = hidden, nu
    nx, ny = s.rule.normal
    points = f"{nx} x {ny} points" if s.rule.uniform else "this quadrature"
    if worst <= 0:
        return judged(float(worst), 0.0, f"only rigid motions have no strain energy with {points}",
                      "rigid motions have strain energy")
    mesh = s.free(4.0, 4, nu=at)
    left = hidden_modes(mesh, stiffness(mesh))
    where = "" if at == NU else f" at nu = {at:g}"
    return Finding(float(worst), FAIL, f"{many(worst, 'motion')} of an element without strain energy{where} with "
                   f"{points}; {left} remain in a free mesh of four")
