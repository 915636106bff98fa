"""Compressible neo-Hookean material in plane stress, for formulations with Green's strain at single points.

W = mu/2 (I_C - 3 - 2 ln J) + lambda/2 (ln J)^2 (Simo & Pister 1984; Bonet & Wood 2008, section 6.4.3). The stretch
lambda_3 of the thickness follows from sigma_33 = 0: with c = lambda_3^2 and the in-plane C,

    mu (c - 1) + lambda/2 (ln det C + ln c) = 0,    S = mu (I - c C^-1),

and dS/dE = mu (2 c lambda/(2 mu c + lambda) C^-1 C^-1 + 2 c M), where M dE = C^-1 dE C^-1. For the kernels the stress
is D (eps - eps_i) with the internal strains eps_i = eps - D^-1 S, which depend on the strains alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from .formulations.base import Formulation, Rule, Sampler, StrainLaw, rule_points
from .shape import Array

# Newton's method for the thickness: the function is convex and increasing, so it converges from one side
ITERATIONS, CLOSE = 60, 1e-15


def _thickness(mu, lam, log_det):  # type: ignore[no-untyped-def]
    """Return ln c, the root of mu (c - 1) + lam/2 (log_det + ln c) = 0."""
    x = 0.0
    for _ in range(ITERATIONS):
        step = (mu * np.expm1(x) + 0.5 * lam * (log_det + x)) / (mu * np.exp(x) + 0.5 * lam)
        x -= step
        if not abs(step) > CLOSE * abs(x):
            break
    return x


def internal(ref, eps, old, new, slope, lanes):  # type: ignore[no-untyped-def]
    """Fill the internal strains eps - D^-1 S and their slope I - D^-1 dS/dE.

    The last reference values of a point are mu, lambda, E, nu and the shear modulus of D. Inverted points get NaN.
    """
    last = len(ref) - 5
    for l in range(lanes):
        mu, lam, E, nu, G = ref[last, l], ref[last + 1, l], ref[last + 2, l], ref[last + 3, l], ref[last + 4, l]
        e, f, g = eps[0, l], eps[1, l], eps[2, l]
        c1, c2 = 1.0 + 2.0 * e, 1.0 + 2.0 * f
        beyond = 2.0 * (e + f) + 4.0 * e * f - g * g
        det = 1.0 + beyond
        x = _thickness(mu, lam, np.log1p(beyond)) if det > 0.0 and c1 > 0.0 else np.nan
        c, m = np.exp(x), np.expm1(x)
        # S, in a form that keeps the digits of small strains
        s1 = mu * (2.0 * e * c2 - g * g - m * c2) / det
        s2 = mu * (2.0 * f * c1 - g * g - m * c1) / det
        s3 = mu * c * g / det
        new[0, l], new[1, l], new[2, l] = e - (s1 - nu * s2) / E, f - (s2 - nu * s1) / E, g - s3 / G
        p, q, r = c2 / det, c1 / det, -g / det
        k, h = mu * 2.0 * c * lam / (2.0 * mu * c + lam), 2.0 * mu * c
        t11, t22, t12 = (k + h) * p * p, (k + h) * q * q, k * p * q + h * r * r
        t13, t23, t33 = (k + h) * p * r, (k + h) * q * r, k * r * r + 0.5 * h * (p * q + r * r)
        slope[0, 0, l], slope[0, 1, l] = 1.0 - (t11 - nu * t12) / E, -(t12 - nu * t22) / E
        slope[1, 0, l], slope[1, 1, l] = -(t12 - nu * t11) / E, 1.0 - (t22 - nu * t12) / E
        slope[0, 2, l], slope[1, 2, l] = -(t13 - nu * t23) / E, -(t23 - nu * t13) / E
        slope[2, 0, l], slope[2, 1, l], slope[2, 2, l] = -t13 / G, -t23 / G, 1.0 - t33 / G


def extra_energy(ref: Array, D: Array, eps: Array, state: Array) -> Array:
    """Return the energy W minus the energy of the same stress with the small-strain stiffness; see ``StrainLaw``.

    The stress S = D eps determines the state: C = c (I - S/mu)^-1, with c from sigma_33 = 0.
    """
    mu, lam, _, _, G = (ref[:, 0, k] for k in range(-5, 0))
    weight = D[:, 2, 2] / G
    s = np.einsum("sij,esj->esi", D, eps) / (weight * mu)[:, None]
    trace, det = s[..., 0] + s[..., 1], s[..., 0] * s[..., 1] - s[..., 2] ** 2
    log, left = np.log1p(det - trace), 1.0 - trace + det
    x = np.zeros_like(log)
    for _ in range(ITERATIONS):
        # mu (c - 1) + lam/2 (3 ln c - ln det (I - S/mu)) = 0
        step = (mu * np.expm1(x) + 0.5 * lam * (3.0 * x - log)) / (mu * np.exp(x) + 1.5 * lam)
        x -= step
        if not np.any(np.abs(step) > CLOSE * np.abs(x)):
            break
    m, twice_log = np.expm1(x), 3.0 * x - log
    # tr C - 2, in a form that keeps the digits of small strains
    first = (2.0 * m + trace * (1.0 - m) - 2.0 * det) / left
    own = 0.5 * mu * (first + m - twice_log) + 0.125 * lam * twice_log**2
    return np.asarray(weight * own - 0.5 * np.einsum("esi,sij,esj->es", eps, D, eps))


@dataclass(frozen=True)
class _Sample:
    """Sampling of a formulation whose material is neo-Hookean."""

    base: Formulation

    def __call__(self, sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
        """Return (B, ref, D) as in ``Formulation.sample``."""
        section = sampler.at(rule_points(rule.normal)[0])
        B, ref, D = self.base.sample(sampler, rule)
        E, nu = np.asarray(section.E), np.asarray(section.nu)
        mu, lam = E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
        own = [np.broadcast_to(v, len(ref))[:, None] for v in (mu, lam, E, nu, section.mu_k)]
        return B, np.hstack([ref, *own]), D


@cache
def neo_hookean(base: Formulation) -> Formulation:
    """Return a formulation whose material is neo-Hookean."""
    law = base.law
    own = StrainLaw(law.fields, law.strains, law.references + 5, law.strain, law.geometric, quadratic=law.quadratic,
                   state=law.strains, internal=internal, elastic=True, extra_energy=extra_energy)
    return replace(base, law=own, sample=_Sample(base), stress=None)
