"""The check of damping: decay of modes under Rayleigh and Kelvin-Voigt damping, and spinning without resistance."""

from __future__ import annotations

import numpy as np

from ...elements.shape import Array
from ...model.model import Model
from .fields import beam, stiffness, turned
from .finding import FAIL, PASS, ROUND_OFF, Finding
from .subject import Subject

# Rayleigh's alpha [1/s] and beta [s], and the retardation time tau [s]: damping ratios of some percent
ALPHA, BETA, TAU = 1e-3, 0.04, 0.06
MODES = 4
# relative error of a damping ratio that is still round-off of the eigenvalues
EXACT = 1e-7
ANGLES = (0.0, 0.9, -2.4)


def damping(s: Subject) -> Finding:
    """Examine damping ratios of a cantilever beside alpha/(2 omega) + (beta + tau) omega/2, and forces of spinning."""
    off, resists = _ratios_off(s), _resists_spinning(s)
    if not off <= EXACT:
        return Finding(off, FAIL, "damping ratios differ from alpha/(2 omega) + (beta + tau) omega/2, so the damping "
                       "matrix is not alpha M + (beta + tau) K")
    if not resists <= ROUND_OFF:
        return Finding(resists, FAIL, "Kelvin-Voigt damping resists rigid motion (force per viscosity and velocity)")
    return Finding(max(off, resists), PASS, "damping ratios are alpha/(2 omega) + (beta + tau) omega/2; rigid motion "
                   "is not resisted")


def _ratios_off(s: Subject) -> float:
    """Return the largest relative error of the damping ratios of the lowest pairs, and of the formed matrix C.

    Pairs are computed through the strains; factorisations and reduced models use the formed matrix.
    """
    from ...solvers.eigen import pairs_of
    from ...solvers.linearised import small_motions

    model = s.model(10.0, 2, {"type": "eigen", "modes": MODES}, tau=TAU,
                    boundary_conditions=[{"type": "clamp", "at": "beam@0", "hold": "all"}],
                    damping={"rayleigh": {"alpha": ALPHA, "beta": BETA}})
    small = small_motions(model, "reference", "eigen")
    plain, damped = (pairs_of(small, MODES, acts)[1].s for acts in (False, True))
    omega = np.sort(np.abs(plain[plain.imag > 0.0]))
    damped = damped[np.argsort(np.abs(damped))]
    if len(omega) != len(damped) or not len(omega):
        return float("inf")
    ratio = ALPHA / (2 * omega) + (BETA + TAU) * omega / 2
    moved, w = model.numbering.free < model.n_q, model.weights[model.numbering.free]
    C, due = (A.toarray()[np.ix_(moved, moved)] / np.outer(w[moved], w[moved])
              for A in (small.C, ALPHA * small.M + (BETA + TAU) * small.K))
    return max(float(np.abs(-damped.real / np.abs(damped) / ratio - 1).max()),
               float(np.abs(C - due).max() / np.abs(due).max()))


def _resists_spinning(s: Subject) -> float:
    """Return the largest viscous force of rigid velocities of a deformed, turned body, beside that of strain rates."""
    from ...solvers.linearised import RateForces

    model = s.model(3.0, 2, {"type": "eigen", "modes": 1}, tau=TAU)
    rates, w = RateForces(model), model.weights
    scale = TAU * float(np.abs(stiffness(model) / np.outer(w, w)).max())
    bent = 0.1 * np.random.default_rng(1).uniform(-1, 1, model.n_q) / w
    worst = 0.0
    for angle in ANGLES:
        d = turned(model, bent, angle)
        for v in _rigid_velocities(model, d):
            Q = rates.viscous_forces(d, v)[:model.n_q]
            worst = max(worst, float(np.abs(Q / w).max() / (scale * np.abs(w * v).max())))
    return worst


def _rigid_velocities(model: Model, d: Array) -> Array:
    """Return the rates (3, n_q) of the coordinates in two translations and a rotation about the origin, at d (n_q,)."""
    kinds, e, still = beam(model).kinds, model.e0 + d, np.zeros(model.n_q)
    first = np.flatnonzero((kinds == 0) | (kinds == 3))
    spin = np.where(kinds == 2, 1.0, 0.0)
    spin[first], spin[first + 1] = -e[first + 1], e[first]
    return np.stack([turned(model, still, 0.0, (1.0, 0.0)), turned(model, still, 0.0, (0.0, 1.0)), spin])
