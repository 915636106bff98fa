"""Geometrically exact, shear-deformable beam with the section rotation as a coordinate."""

from __future__ import annotations

import numpy as np

from ..definition import ElementType
from ..shape import Array
from .base import Formulation, Free, Rule, Sampler, StrainLaw, coupled, diagonal, join, of_section


def strain(ref, u, eps, J, lanes):  # type: ignore[no-untyped-def]
    """Fill the strains Gamma = R^T r_s, less that of the reference, and theta_,s (Simo & Vu-Quoc 1986).

    R^T - 1 is written with 2 sin^2(theta/2), which keeps the digits of small rotations.
    """
    for l in range(lanes):
        px, py, c0, s0 = ref[0, l], ref[1, l], ref[2, l], ref[3, l]
        p1, p2 = c0 * px + s0 * py, -s0 * px + c0 * py
        w1, w2 = c0 * u[0, l] + s0 * u[1, l], -s0 * u[0, l] + c0 * u[1, l]
        half = np.sin(0.5 * u[2, l])
        si, cm = 2.0 * half * np.cos(0.5 * u[2, l]), -2.0 * half * half
        co = 1.0 + cm
        eps[0, l] = cm * p1 + si * p2 + co * w1 + si * w2
        eps[1, l] = -si * p1 + cm * p2 - si * w1 + co * w2
        eps[2, l] = u[3, l]
        C, S = c0 * co - s0 * si, s0 * co + c0 * si
        fx, fy = px + u[0, l], py + u[1, l]
        J[0, 0, l], J[0, 1, l], J[0, 2, l] = C, S, -S * fx + C * fy
        J[1, 0, l], J[1, 1, l], J[1, 2, l] = -S, C, -C * fx - S * fy
        J[2, 3, l] = 1.0


def geometric(ref, u, sigma, J, H, lanes):  # type: ignore[no-untyped-def]
    """Add sum_i sigma_i d2 eps_i/du2; J holds the cosine and sine of the section's angle."""
    for l in range(lanes):
        C, S = J[0, 0, l], J[0, 1, l]
        hx, hy = -sigma[0, l] * S - sigma[1, l] * C, sigma[0, l] * C - sigma[1, l] * S
        H[0, 2, l] += hx
        H[1, 2, l] += hy
        H[2, 2, l] += -hy * (ref[0, l] + u[0, l]) + hx * (ref[1, l] + u[1, l])


def _stations(sampler: Sampler, n: int, parts: tuple[float, ...]) -> tuple[Array, Array, Array]:
    """Sample the given parts (of EA, kGA and EI) of the stiffness at n points."""
    xi, w = sampler.points(n)
    zero = np.zeros_like(xi)
    S, Sx = sampler.derivative(xi, zero, 0, 0), sampler.derivative(xi, zero, 1, 0)
    rx = Sx @ sampler.e0[:, :2]
    j0 = np.hypot(rx[:, 0], rx[:, 1])[:, None]
    Ss = Sx / j0
    B = np.stack([sampler.spread(Ss, 0), sampler.spread(Ss, 1), sampler.spread(S, 2), sampler.spread(Ss, 2)], axis=1)
    theta = S @ sampler.e0[:, 2:]
    ref = np.hstack([rx / j0, np.cos(theta), np.sin(theta)])
    ds = w * j0[:, 0] * sampler.shape.l
    s = sampler.at(xi)
    D = diagonal(ds, *(p * k for p, k in zip(parts, (s.EA, s.kGA, s.EI), strict=True)))
    return B, ref, coupled(D, ds, parts[0] * s.ES, 0, 2)


def sample(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample EA, kGA, EI with the reduced rule; with a selective rule the shear strain has its own points."""
    if rule.uniform:
        return _stations(sampler, rule.normal[0], (1.0, 1.0, 1.0))
    return join(_stations(sampler, rule.normal[0], (1.0, 0.0, 1.0)),
                _stations(sampler, rule.shear[0], (0.0, 1.0, 0.0)))


def natural(sampler: Sampler, rule: Rule, free: Free) -> Array:
    """Return the natural strains at the stations of ``sample``: axial strain, no shear, and curvature."""
    parts = []
    for n, _ in (rule.normal,) if rule.uniform else (rule.normal, rule.shear):
        axial, curvature, _ = of_section(sampler, free, sampler.points(n)[0])
        parts.append(np.stack([axial, np.zeros(n), curvature], axis=1))
    return np.concatenate(parts)


def fibres(sampler: Sampler, rule: Rule) -> tuple[Array, tuple[Array, Array, Array]]:
    """Return the positions and stations of ``sample``; each of them has axial strain and curvature."""
    rules = (rule.normal,) if rule.uniform else (rule.normal, rule.shear)
    return np.concatenate([sampler.points(n)[0] for n, _ in rules]), sample(sampler, rule)


def _refuse(element: ElementType) -> str | None:
    if not element.has_theta:
        return f"{element.name} has no rotation theta among its nodal coordinates"
    return None


# fields: x and y of u_,s, theta, theta_,s; reference values: x and y of r_s, cosine and sine of theta
EXACT = StrainLaw(4, 3, 4, strain, geometric)

FORMULATIONS = (
    Formulation("geometrically_exact", EXACT, _refuse, lambda e: (e.degree_x, 1), lambda e: None, sample,
                "Simo & Vu-Quoc 1986", "axial and shear strain in the rotated section, curvature theta'",
                natural=natural, fibres=fibres),
)
