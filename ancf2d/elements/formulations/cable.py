"""Euler-Bernoulli formulations of the gradient-deficient cable: engineering and Green axial strain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..definition import ElementType
from ..shape import Array
from .base import Formulation, Rule, Sampler, rule_points


class Cable(NamedTuple):
    """Law with engineering axial strain. Fields: u_,s, u_,ss (x, y each); ref: r_s, r_ss of the reference."""

    B: Array
    ref: Array
    D: Array


class GreenCable(NamedTuple):
    """Law with Green axial strain and spatial curvature; fields and ref as in Cable."""

    B: Array
    ref: Array
    D: Array


def strain(law, c, s, u, eps, J):  # type: ignore[no-untyped-def]
    """Strains |r_s| and dtheta/ds = r_s x r_ss/|r_s|^2, less those of the reference (Gerstmayr & Irschik 2008)."""
    px, py, qx, qy = law.ref[c, s, 0], law.ref[c, s, 1], law.ref[c, s, 2], law.ref[c, s, 3]
    ax, ay, bx, by = u[0], u[1], u[2], u[3]
    fx, fy, gx, gy = px + ax, py + ay, qx + bx, qy + by
    LL0, LL = px * px + py * py, fx * fx + fy * fy
    L = np.sqrt(LL)
    dLL = 2.0 * (px * ax + py * ay) + ax * ax + ay * ay
    k0 = (px * qy - py * qx) / LL0
    eps[0] = dLL / (L + np.sqrt(LL0))
    eps[1] = ((ax * gy - ay * gx) + (px * by - py * bx) - k0 * dLL) / LL
    k = k0 + eps[1]
    J[0, 0], J[0, 1] = fx / L, fy / L
    J[1, 0], J[1, 1] = (gy - 2.0 * k * fx) / LL, (-gx - 2.0 * k * fy) / LL
    J[1, 2], J[1, 3] = -fy / LL, fx / LL


def geometric(law, c, s, u, sigma, H):  # type: ignore[no-untyped-def]
    """Add sum_i sigma_i d2 eps_i/du2."""
    fx, fy = law.ref[c, s, 0] + u[0], law.ref[c, s, 1] + u[1]
    gx, gy = law.ref[c, s, 2] + u[2], law.ref[c, s, 3] + u[3]
    LL = fx * fx + fy * fy
    N, M = sigma[0] / np.sqrt(LL), sigma[1] / LL
    k = (fx * gy - fy * gx) / LL
    ex, ey = fx / LL, fy / LL
    H[0, 0] += N * (1.0 - fx * ex) + M * (-4.0 * gy * ex - k * (2.0 - 8.0 * fx * ex))
    H[1, 1] += N * (1.0 - fy * ey) + M * (4.0 * gx * ey - k * (2.0 - 8.0 * fy * ey))
    H[0, 1] += -N * fx * ey + M * (2.0 * gx * ex - 2.0 * gy * ey + 8.0 * k * fx * ey)
    H[0, 2] += M * 2.0 * fy * ex
    H[0, 3] += M * (1.0 - 2.0 * fx * ex)
    H[1, 2] += -M * (1.0 - 2.0 * fy * ey)
    H[1, 3] += -M * 2.0 * fx * ey
    for i in range(4):
        for j in range(i):
            H[i, j] = H[j, i]


def mean(law, c, s, u0, u1, eps0, eps1, J):  # type: ignore[no-untyped-def]
    """Discrete Jacobian between two states, by differences of A = r_s.r_s and C = r_s x r_ss at the mid-configuration.

    |r_s|^2 = A gives d|r_s| = dA/(|r_s|_0 + |r_s|_1); kappa A = C gives dkappa = (dC - kappa_m dA)/A_m, m the mean.
    """
    px, py, qx, qy = law.ref[c, s, 0], law.ref[c, s, 1], law.ref[c, s, 2], law.ref[c, s, 3]
    x0, y0, x1, y1 = px + u0[0], py + u0[1], px + u1[0], py + u1[1]
    A0, A1 = x0 * x0 + y0 * y0, x1 * x1 + y1 * y1
    L, A = 0.5 * (np.sqrt(A0) + np.sqrt(A1)), 0.5 * (A0 + A1)
    fx, fy = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    gx, gy = qx + 0.5 * (u0[2] + u1[2]), qy + 0.5 * (u0[3] + u1[3])
    k = (px * qy - py * qx) / (px * px + py * py) + 0.5 * (eps0[1] + eps1[1])
    J[0, 0], J[0, 1] = fx / L, fy / L
    J[1, 0], J[1, 1] = (gy - 2.0 * k * fx) / A, (-gx - 2.0 * k * fy) / A
    J[1, 2], J[1, 3] = -fy / A, fx / A


def green_strain(law, c, s, u, eps, J):  # type: ignore[no-untyped-def]
    """Strains r_s.r_s/2 and r_s x r_ss/|r_s|^3, less those of the reference (Berzeri & Shabana 2000)."""
    px, py, qx, qy = law.ref[c, s, 0], law.ref[c, s, 1], law.ref[c, s, 2], law.ref[c, s, 3]
    ax, ay, bx, by = u[0], u[1], u[2], u[3]
    fx, fy, gx, gy = px + ax, py + ay, qx + bx, qy + by
    LL0, LL = px * px + py * py, fx * fx + fy * fy
    L, L0 = np.sqrt(LL), np.sqrt(LL0)
    dLL = 2.0 * (px * ax + py * ay) + ax * ax + ay * ay
    c0 = px * qy - py * qx
    dL = dLL / (L + L0)
    L3, L30 = LL * L, LL0 * L0
    eps[0] = 0.5 * dLL
    dL3 = dL * (LL + L * L0 + LL0)
    eps[1] = ((ax * gy - ay * gx) + (px * by - py * bx) - c0 / L30 * dL3) / L3
    k = c0 / L30 + eps[1]
    J[0, 0], J[0, 1] = fx, fy
    J[1, 0], J[1, 1] = gy / L3 - 3.0 * k * fx / LL, -gx / L3 - 3.0 * k * fy / LL
    J[1, 2], J[1, 3] = -fy / L3, fx / L3


def green_geometric(law, c, s, u, sigma, H):  # type: ignore[no-untyped-def]
    """Add sum_i sigma_i d2 eps_i/du2."""
    fx, fy = law.ref[c, s, 0] + u[0], law.ref[c, s, 1] + u[1]
    gx, gy = law.ref[c, s, 2] + u[2], law.ref[c, s, 3] + u[3]
    LL = fx * fx + fy * fy
    M = sigma[1] / (LL * np.sqrt(LL))
    w = fx * gy - fy * gx
    ex, ey = fx / LL, fy / LL
    H[0, 0] += sigma[0] + M * (-6.0 * gy * ex - 3.0 * w / LL * (1.0 - 5.0 * fx * ex))
    H[1, 1] += sigma[0] + M * (6.0 * gx * ey - 3.0 * w / LL * (1.0 - 5.0 * fy * ey))
    H[0, 1] += M * (3.0 * gx * ex - 3.0 * gy * ey + 15.0 * w / LL * fx * ey)
    H[0, 2] += M * 3.0 * fy * ex
    H[0, 3] += M * (1.0 - 3.0 * fx * ex)
    H[1, 2] += -M * (1.0 - 3.0 * fy * ey)
    H[1, 3] += -M * 3.0 * fx * ey
    for i in range(4):
        for j in range(i):
            H[i, j] = H[j, i]


def green_mean(law, c, s, u0, u1, eps0, eps1, J):  # type: ignore[no-untyped-def]
    """Discrete Jacobian between two states: as ``mean``, with kappa |r_s|^3 = C."""
    px, py, qx, qy = law.ref[c, s, 0], law.ref[c, s, 1], law.ref[c, s, 2], law.ref[c, s, 3]
    x0, y0, x1, y1 = px + u0[0], py + u0[1], px + u1[0], py + u1[1]
    A0, A1, LL = x0 * x0 + y0 * y0, x1 * x1 + y1 * y1, px * px + py * py
    L0, L1 = np.sqrt(A0), np.sqrt(A1)
    L3 = 0.5 * (A0 * L0 + A1 * L1)
    fx, fy = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    gx, gy = qx + 0.5 * (u0[2] + u1[2]), qy + 0.5 * (u0[3] + u1[3])
    k = (px * qy - py * qx) / (LL * np.sqrt(LL)) + 0.5 * (eps0[1] + eps1[1])
    m = 2.0 * k * (A0 + L0 * L1 + A1) / (L0 + L1)
    J[0, 0], J[0, 1] = fx, fy
    J[1, 0], J[1, 1] = (gy - m * fx) / L3, (-gx - m * fy) / L3
    J[1, 2], J[1, 3] = -fy / L3, fx / L3


def _stations(sampler: Sampler, n: int, weights: tuple[float, float]) -> tuple[Array, Array, Array]:
    xi, _, w = rule_points((n, 1))
    zero = np.zeros_like(xi)
    Sx, Sxx = sampler.derivative(xi, zero, 1, 0), sampler.derivative(xi, zero, 2, 0)
    rx, rxx = Sx @ sampler.e0, Sxx @ sampler.e0
    j0 = np.hypot(rx[:, 0], rx[:, 1])[:, None]
    # d/ds = (1/j0) d/dx along a reference whose interpolated |r_x| is not quite 1
    dj0 = np.sum(rx * rxx, axis=1, keepdims=True) / j0
    fields = (Sx / j0, Sxx / j0**2 - Sx * dj0 / j0**3)
    B = np.stack([sampler.spread(S, k) for S in fields for k in (0, 1)], axis=1)
    ref = np.hstack([S @ sampler.e0 for S in fields])
    ds = w * j0[:, 0] * sampler.shape.l
    return B, ref, ds[:, None, None] * np.diag(weights)


def sample(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample EA and EI with one rule."""
    return _stations(sampler, rule.normal[0], (sampler.section.EA, sampler.section.EI))


def _refuse(element: ElementType) -> str | None:
    if element.has_theta or element.degree_y > 0:
        return f"{element.name} can shear: this form is for elements whose section stays normal to r_x"
    if not any("r_x" in n.coordinates for n in element.nodes):
        return f"{element.name} has no r_x at its nodes: its slope would jump between elements"
    return None


FORMULATIONS = (
    Formulation("cable", Cable, _refuse, lambda e: (e.degree_x, 1), lambda e: None, sample, strain, geometric,
                "Gerstmayr & Irschik 2008", "engineering axial strain |r_x| - 1 and curvature dtheta/ds, no shear",
                selective=False, mean=mean),
    Formulation("green", GreenCable, _refuse, lambda e: (e.degree_x, 1), lambda e: None, sample, green_strain,
                green_geometric, "Berzeri & Shabana 2000",
                "Green axial strain (r_x.r_x - 1)/2 and spatial curvature, no shear", selective=False,
                mean=green_mean),
)
