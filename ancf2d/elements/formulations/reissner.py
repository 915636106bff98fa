"""Geometrically exact, shear-deformable beam with the section rotation as a coordinate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..definition import ElementType
from ..shape import Array
from .base import Formulation, Rule, Sampler, join, rule_points


class Reissner(NamedTuple):
    """Law of the geometrically exact beam. Fields: u_,s (x, y), theta, theta_,s; ref: r_s (x, y), theta_0."""

    B: Array
    ref: Array
    D: Array


def strain(law, c, s, u, eps, J):  # type: ignore[no-untyped-def]
    """Strains Gamma = R^T r_s less that of the reference, and theta_,s (Simo & Vu-Quoc 1986).

    R^T - 1 is written with 2 sin^2(theta/2), so that small rotations keep their digits.
    """
    px, py = law.ref[c, s, 0], law.ref[c, s, 1]
    c0, s0 = np.cos(law.ref[c, s, 2]), np.sin(law.ref[c, s, 2])
    p1, p2 = c0 * px + s0 * py, -s0 * px + c0 * py
    w1, w2 = c0 * u[0] + s0 * u[1], -s0 * u[0] + c0 * u[1]
    si, half = np.sin(u[2]), np.sin(0.5 * u[2])
    cm = -2.0 * half * half
    co = 1.0 + cm
    eps[0] = cm * p1 + si * p2 + co * w1 + si * w2
    eps[1] = -si * p1 + cm * p2 - si * w1 + co * w2
    eps[2] = u[3]
    C, S = c0 * co - s0 * si, s0 * co + c0 * si
    fx, fy = px + u[0], py + u[1]
    J[0, 0], J[0, 1], J[0, 2] = C, S, -S * fx + C * fy
    J[1, 0], J[1, 1], J[1, 2] = -S, C, -C * fx - S * fy
    J[2, 3] = 1.0


def geometric(law, c, s, u, sigma, H):  # type: ignore[no-untyped-def]
    """Add sum_i sigma_i d2 eps_i/du2."""
    angle = law.ref[c, s, 2] + u[2]
    C, S = np.cos(angle), np.sin(angle)
    fx, fy = law.ref[c, s, 0] + u[0], law.ref[c, s, 1] + u[1]
    hx, hy = -sigma[0] * S - sigma[1] * C, sigma[0] * C - sigma[1] * S
    H[0, 2] += hx
    H[2, 0] += hx
    H[1, 2] += hy
    H[2, 1] += hy
    H[2, 2] += -hy * fx + hx * fy


def _stations(sampler: Sampler, n: int, weights: tuple[float, ...]) -> tuple[Array, Array, Array]:
    xi, _, w = rule_points((n, 1))
    zero = np.zeros_like(xi)
    S, Sx = sampler.derivative(xi, zero, 0, 0), sampler.derivative(xi, zero, 1, 0)
    rx = Sx @ sampler.e0[:, :2]
    j0 = np.hypot(rx[:, 0], rx[:, 1])[:, None]
    Ss = Sx / j0
    B = np.stack([sampler.spread(Ss, 0), sampler.spread(Ss, 1), sampler.spread(S, 2), sampler.spread(Ss, 2)], axis=1)
    ref = np.hstack([rx / j0, S @ sampler.e0[:, 2:]])
    ds = w * j0[:, 0] * sampler.shape.l
    return B, ref, ds[:, None, None] * np.diag(weights)


def sample(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample EA, kGA, EI at the reduced rule; a selective rule gives the shear strain points of its own."""
    s = sampler.section
    if rule.uniform:
        return _stations(sampler, rule.normal[0], (s.EA, s.kGA, s.EI))
    return join(_stations(sampler, rule.normal[0], (s.EA, 0.0, s.EI)),
                _stations(sampler, rule.shear[0], (0.0, s.kGA, 0.0)))


def _refuse(element: ElementType) -> str | None:
    if not element.has_theta:
        return f"{element.name} has no rotation theta among its nodal coordinates"
    return None


FORMULATIONS = (
    Formulation("geometrically_exact", Reissner, _refuse, lambda e: (e.degree_x, 1), lambda e: None, sample, strain,
                geometric, "Simo & Vu-Quoc 1986", "axial and shear strain in the turned section, curvature theta'"),
)
