"""Structural formulation: Reissner's strains from ANCF coordinates, on the axis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..definition import ElementType
from ..shape import Array, gauss, lobatto
from .base import Formulation, Rule, Sampler, join


class Structural(NamedTuple):
    """Law of the structural form. Fields: u_,s, u_,y, u_,ys (x, y each); ref: r_s, r_y, r_ys of the reference."""

    B: Array
    ref: Array
    D: Array


def strain(law, c, s, u, eps, J):  # type: ignore[no-untyped-def]
    """Strains (Gamma_1, Gamma_2, kappa, E_yy) less those of the reference.

    With L = |r_y|: Gamma_1 = r_s x r_y/L, Gamma_2 = r_s . r_y/L, kappa = r_y x r_ys/L^2,
    E_yy = L^2/2 (Nachbagauer et al. 2011); each difference is formed from products of displacements.
    """
    px, py, qx, qy = law.ref[c, s, 0], law.ref[c, s, 1], law.ref[c, s, 2], law.ref[c, s, 3]
    wx, wy = law.ref[c, s, 4], law.ref[c, s, 5]
    ax, ay, bx, by, cx, cy = u[0], u[1], u[2], u[3], u[4], u[5]
    fx, fy, gx, gy, hx, hy = px + ax, py + ay, qx + bx, qy + by, wx + cx, wy + cy
    L0 = np.sqrt(qx * qx + qy * qy)
    L = np.sqrt(gx * gx + gy * gy)
    dLL = 2.0 * (qx * bx + qy * by) + bx * bx + by * by
    dL = dLL / (L + L0)
    G10, G20 = (px * qy - py * qx) / L0, (px * qx + py * qy) / L0
    k0 = (qx * wy - qy * wx) / (L0 * L0)
    eps[0] = ((ax * gy - ay * gx) + (px * by - py * bx) - G10 * dL) / L
    eps[1] = ((ax * gx + ay * gy) + (px * bx + py * by) - G20 * dL) / L
    eps[2] = ((bx * hy - by * hx) + (qx * cy - qy * cx) - k0 * dLL) / (L * L)
    eps[3] = 0.5 * dLL
    G1, G2, k = G10 + eps[0], G20 + eps[1], k0 + eps[2]
    LL = L * L
    J[0, 0], J[0, 1] = gy / L, -gx / L
    J[0, 2], J[0, 3] = -fy / L - G1 * gx / LL, fx / L - G1 * gy / LL
    J[1, 0], J[1, 1] = gx / L, gy / L
    J[1, 2], J[1, 3] = fx / L - G2 * gx / LL, fy / L - G2 * gy / LL
    J[2, 2], J[2, 3] = (hy - 2.0 * k * gx) / LL, (-hx - 2.0 * k * gy) / LL
    J[2, 4], J[2, 5] = -gy / LL, gx / LL
    J[3, 2], J[3, 3] = gx, gy


def geometric(law, c, s, u, sigma, H):  # type: ignore[no-untyped-def]
    """Add sum_i sigma_i d2 eps_i/du2."""
    fx, fy = law.ref[c, s, 0] + u[0], law.ref[c, s, 1] + u[1]
    gx, gy = law.ref[c, s, 2] + u[2], law.ref[c, s, 3] + u[3]
    hx, hy = law.ref[c, s, 4] + u[4], law.ref[c, s, 5] + u[5]
    LL = gx * gx + gy * gy
    L = np.sqrt(LL)
    G1, G2, k = (fx * gy - fy * gx) / L, (fx * gx + fy * gy) / L, (gx * hy - gy * hx) / LL
    N, Q, M = sigma[0] / L, sigma[1] / L, sigma[2] / LL
    # derivatives of 1/L and 1/L^2 along r_y give the terms with gx/LL and gy/LL
    ex, ey = gx / LL, gy / LL
    H[0, 2] += -N * gy * ex + Q * (1.0 - gx * ex)
    H[0, 3] += N * (1.0 - gy * ey) - Q * gx * ey
    H[1, 2] += -N * (1.0 - gx * ex) - Q * gy * ex
    H[1, 3] += N * gx * ey + Q * (1.0 - gy * ey)
    cx, cy = -N * fy + Q * fx, N * fx + Q * fy
    m = (N * G1 + Q * G2) * L / LL
    H[2, 2] += -2.0 * cx * ex - m * (1.0 - 3.0 * gx * ex)
    H[3, 3] += -2.0 * cy * ey - m * (1.0 - 3.0 * gy * ey)
    H[2, 3] += -cx * ey - cy * ex + 3.0 * m * gx * ey
    H[2, 2] += M * (-4.0 * hy * ex - k * (2.0 - 8.0 * gx * ex))
    H[3, 3] += M * (4.0 * hx * ey - k * (2.0 - 8.0 * gy * ey))
    H[2, 3] += M * (2.0 * hx * ex - 2.0 * hy * ey + 8.0 * k * gx * ey)
    H[2, 4] += M * 2.0 * gy * ex
    H[2, 5] += M * (1.0 - 2.0 * gx * ex)
    H[3, 4] += -M * (1.0 - 2.0 * gy * ey)
    H[3, 5] += -M * 2.0 * gx * ey
    H[2, 2] += sigma[3]
    H[3, 3] += sigma[3]
    for i in range(6):
        for j in range(i):
            H[i, j] = H[j, i]


def mean(law, c, s, u0, u1, eps0, eps1, J):  # type: ignore[no-untyped-def]
    """Discrete Jacobian between two states, by differences of invariants at the mid-configuration.

    With A = r_y.r_y, L^2 = A: Gamma L = r_s x r_y or r_s . r_y gives dGamma = (d(Gamma L) - Gamma_m dL)/L_m with
    dL = dA/(L_0 + L_1); kappa A = r_y x r_ys gives dkappa = (d(kappa A) - kappa_m dA)/A_m, m the mean.
    """
    px, py, qx, qy = law.ref[c, s, 0], law.ref[c, s, 1], law.ref[c, s, 2], law.ref[c, s, 3]
    wx, wy = law.ref[c, s, 4], law.ref[c, s, 5]
    x0, y0, x1, y1 = qx + u0[2], qy + u0[3], qx + u1[2], qy + u1[3]
    LL = qx * qx + qy * qy
    A0, A1, R = x0 * x0 + y0 * y0, x1 * x1 + y1 * y1, np.sqrt(LL)
    L, A = 0.5 * (np.sqrt(A0) + np.sqrt(A1)), 0.5 * (A0 + A1)
    fx, fy = px + 0.5 * (u0[0] + u1[0]), py + 0.5 * (u0[1] + u1[1])
    gx, gy = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    hx, hy = wx + 0.5 * (u0[4] + u1[4]), wy + 0.5 * (u0[5] + u1[5])
    G1 = (px * qy - py * qx) / R + 0.5 * (eps0[0] + eps1[0])
    G2 = (px * qx + py * qy) / R + 0.5 * (eps0[1] + eps1[1])
    k = (qx * wy - qy * wx) / LL + 0.5 * (eps0[2] + eps1[2])
    J[0, 0], J[0, 1] = gy / L, -gx / L
    J[0, 2], J[0, 3] = (-fy - G1 * gx / L) / L, (fx - G1 * gy / L) / L
    J[1, 0], J[1, 1] = gx / L, gy / L
    J[1, 2], J[1, 3] = (fx - G2 * gx / L) / L, (fy - G2 * gy / L) / L
    J[2, 2], J[2, 3] = (hy - 2.0 * k * gx) / A, (-hx - 2.0 * k * gy) / A
    J[2, 4], J[2, 5] = -gy / A, gx / A
    J[3, 2], J[3, 3] = gx, gy


def _stations(sampler: Sampler, points: tuple[Array, Array],
              weights: tuple[float, ...]) -> tuple[Array, Array, Array]:
    xi, w = points
    zero = np.zeros_like(xi)
    Sx, Sy, Sxy = (sampler.derivative(xi, zero, i, j) for i, j in ((1, 0), (0, 1), (1, 1)))
    rx = Sx @ sampler.e0
    j0 = np.hypot(rx[:, 0], rx[:, 1])[:, None]
    fields = (Sx / j0, Sy, Sxy / j0)
    B = np.stack([sampler.spread(S, k) for S in fields for k in (0, 1)], axis=1)
    ref = np.hstack([S @ sampler.e0 for S in fields])
    ds = w * j0[:, 0] * sampler.shape.l
    return B, ref, ds[:, None, None] * np.diag(weights)


def sample(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample EA, kGA, EI at the reduced rule and the section stretch at as many Lobatto points as r_y has terms.

    A straight section stretches with E A (its frequency is sqrt(12 E/rho)/h). At the reduced points a stretch
    that alternates from node to node would have no stiffness; between the nodes the interpolated r_y is shorter
    than 1 wherever it turns, so that Gauss points of full order would lock.
    """
    s = sampler.section
    terms = 1 + max(t.i for p in sampler.shape.element.polynomials for t in p.terms if t.j > 0)
    parts = [_stations(sampler, gauss(rule.normal[0]), (s.EA, s.kGA if rule.uniform else 0.0, s.EI, 0.0)),
             _stations(sampler, lobatto(max(terms, 2)), (0.0, 0.0, 0.0, s.EA))]
    if not rule.uniform:
        parts.append(_stations(sampler, gauss(rule.shear[0]), (0.0, s.kGA, 0.0, 0.0)))
    return join(*parts)


def _refuse(element: ElementType) -> str | None:
    if element.has_theta or element.degree_y == 0:
        return f"{element.name} has no r_y that could turn a section"
    if element.degree_y > 1:
        return f"its strains do not see the y^2 of {element.name}: that coordinate would have no stiffness"
    return None


FORMULATIONS = (
    Formulation("structural", Structural, _refuse, lambda e: (e.degree_x, 1), lambda e: None, sample, strain,
                geometric, "Gerstmayr, Matikainen & Mikkola 2008; Nachbagauer et al. 2011-13",
                "axial, shear, bending and thickness strain of the section on the axis, without Poisson coupling",
                mean=mean),
)
