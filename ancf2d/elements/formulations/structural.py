"""Structural formulation: Reissner's strain measures from ANCF coordinates, on the axis."""

from __future__ import annotations

import numpy as np

from ..definition import ElementType
from ..shape import Array, lobatto
from .base import Formulation, Free, Rule, Sampler, StrainLaw, coupled, diagonal, join, of_section


def strain(ref, u, eps, J, lanes):  # type: ignore[no-untyped-def]
    """Fill the strains (Gamma_1, Gamma_2, kappa, E_yy) less those of the reference.

    With L = |r_y|: Gamma_1 = r_s x r_y/L, Gamma_2 = r_s . r_y/L, kappa = r_y x r_ys/L^2,
    E_yy = L^2/2 (Nachbagauer et al. 2011). Differences are formed from products of displacements to keep digits.
    """
    for l in range(lanes):
        px, py, qx, qy = ref[0, l], ref[1, l], ref[2, l], ref[3, l]
        wx, wy = ref[4, l], ref[5, l]
        ax, ay, bx, by, cx, cy = u[0, l], u[1, l], u[2, l], u[3, l], u[4, l], u[5, l]
        fx, fy, gx, gy, hx, hy = px + ax, py + ay, qx + bx, qy + by, wx + cx, wy + cy
        L0 = np.sqrt(qx * qx + qy * qy)
        L = np.sqrt(gx * gx + gy * gy)
        dLL = 2.0 * (qx * bx + qy * by) + bx * bx + by * by
        dL = dLL / (L + L0)
        G10, G20 = (px * qy - py * qx) / L0, (px * qx + py * qy) / L0
        k0 = (qx * wy - qy * wx) / (L0 * L0)
        eps[0, l] = ((ax * gy - ay * gx) + (px * by - py * bx) - G10 * dL) / L
        eps[1, l] = ((ax * gx + ay * gy) + (px * bx + py * by) - G20 * dL) / L
        eps[2, l] = ((bx * hy - by * hx) + (qx * cy - qy * cx) - k0 * dLL) / (L * L)
        eps[3, l] = 0.5 * dLL
        G1, G2, k = G10 + eps[0, l], G20 + eps[1, l], k0 + eps[2, l]
        LL = L * L
        J[0, 0, l], J[0, 1, l] = gy / L, -gx / L
        J[0, 2, l], J[0, 3, l] = -fy / L - G1 * gx / LL, fx / L - G1 * gy / LL
        J[1, 0, l], J[1, 1, l] = gx / L, gy / L
        J[1, 2, l], J[1, 3, l] = fx / L - G2 * gx / LL, fy / L - G2 * gy / LL
        J[2, 2, l], J[2, 3, l] = (hy - 2.0 * k * gx) / LL, (-hx - 2.0 * k * gy) / LL
        J[2, 4, l], J[2, 5, l] = -gy / LL, gx / LL
        J[3, 2, l], J[3, 3, l] = gx, gy


def geometric(ref, u, sigma, J, H, lanes):  # type: ignore[no-untyped-def]
    """Add sum_i sigma_i d2 eps_i/du2."""
    for l in range(lanes):
        fx, fy = ref[0, l] + u[0, l], ref[1, l] + u[1, l]
        gx, gy = ref[2, l] + u[2, l], ref[3, l] + u[3, l]
        hx, hy = ref[4, l] + u[4, l], ref[5, l] + u[5, l]
        LL = gx * gx + gy * gy
        L = np.sqrt(LL)
        G1, G2, k = (fx * gy - fy * gx) / L, (fx * gx + fy * gy) / L, (gx * hy - gy * hx) / LL
        N, Q, M = sigma[0, l] / L, sigma[1, l] / L, sigma[2, l] / LL
        # derivatives of 1/L and 1/L^2 along r_y give the terms with gx/LL and gy/LL
        ex, ey = gx / LL, gy / LL
        H[0, 2, l] += -N * gy * ex + Q * (1.0 - gx * ex)
        H[0, 3, l] += N * (1.0 - gy * ey) - Q * gx * ey
        H[1, 2, l] += -N * (1.0 - gx * ex) - Q * gy * ex
        H[1, 3, l] += N * gx * ey + Q * (1.0 - gy * ey)
        cx, cy = -N * fy + Q * fx, N * fx + Q * fy
        m = (N * G1 + Q * G2) * L / LL
        H[2, 2, l] += -2.0 * cx * ex - m * (1.0 - 3.0 * gx * ex)
        H[3, 3, l] += -2.0 * cy * ey - m * (1.0 - 3.0 * gy * ey)
        H[2, 3, l] += -cx * ey - cy * ex + 3.0 * m * gx * ey
        H[2, 2, l] += M * (-4.0 * hy * ex - k * (2.0 - 8.0 * gx * ex))
        H[3, 3, l] += M * (4.0 * hx * ey - k * (2.0 - 8.0 * gy * ey))
        H[2, 3, l] += M * (2.0 * hx * ex - 2.0 * hy * ey + 8.0 * k * gx * ey)
        H[2, 4, l] += M * 2.0 * gy * ex
        H[2, 5, l] += M * (1.0 - 2.0 * gx * ex)
        H[3, 4, l] += -M * (1.0 - 2.0 * gy * ey)
        H[3, 5, l] += -M * 2.0 * gx * ey
        H[2, 2, l] += sigma[3, l]
        H[3, 3, l] += sigma[3, l]


def mean(ref, u0, u1, eps0, eps1, J, lanes):  # type: ignore[no-untyped-def]
    """Fill the discrete Jacobian between two states, from changes of invariants at the mid-configuration.

    With A = r_y.r_y, L^2 = A: Gamma L = r_s x r_y or r_s . r_y gives dGamma = (d(Gamma L) - Gamma_m dL)/L_m with
    dL = dA/(L_0 + L_1); kappa A = r_y x r_ys gives dkappa = (d(kappa A) - kappa_m dA)/A_m, m the mean.
    """
    for l in range(lanes):
        px, py, qx, qy = ref[0, l], ref[1, l], ref[2, l], ref[3, l]
        wx, wy = ref[4, l], ref[5, l]
        x0, y0, x1, y1 = qx + u0[2, l], qy + u0[3, l], qx + u1[2, l], qy + u1[3, l]
        LL = qx * qx + qy * qy
        A0, A1, R = x0 * x0 + y0 * y0, x1 * x1 + y1 * y1, np.sqrt(LL)
        L, A = 0.5 * (np.sqrt(A0) + np.sqrt(A1)), 0.5 * (A0 + A1)
        fx, fy = px + 0.5 * (u0[0, l] + u1[0, l]), py + 0.5 * (u0[1, l] + u1[1, l])
        gx, gy = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        hx, hy = wx + 0.5 * (u0[4, l] + u1[4, l]), wy + 0.5 * (u0[5, l] + u1[5, l])
        G1 = (px * qy - py * qx) / R + 0.5 * (eps0[0, l] + eps1[0, l])
        G2 = (px * qx + py * qy) / R + 0.5 * (eps0[1, l] + eps1[1, l])
        k = (qx * wy - qy * wx) / LL + 0.5 * (eps0[2, l] + eps1[2, l])
        J[0, 0, l], J[0, 1, l] = gy / L, -gx / L
        J[0, 2, l], J[0, 3, l] = (-fy - G1 * gx / L) / L, (fx - G1 * gy / L) / L
        J[1, 0, l], J[1, 1, l] = gx / L, gy / L
        J[1, 2, l], J[1, 3, l] = (fx - G2 * gx / L) / L, (fy - G2 * gy / L) / L
        J[2, 2, l], J[2, 3, l] = (hy - 2.0 * k * gx) / A, (-hx - 2.0 * k * gy) / A
        J[2, 4, l], J[2, 5, l] = -gy / A, gx / A
        J[3, 2, l], J[3, 3, l] = gx, gy


def _stations(sampler: Sampler, points: tuple[Array, Array],
              parts: tuple[float, ...]) -> tuple[Array, Array, Array]:
    """Sample the given parts (of EA, kGA, EI and EA across) of the stiffness at points (xi, weights)."""
    xi, w = points
    zero = np.zeros_like(xi)
    Sx, Sy, Sxy = (sampler.derivative(xi, zero, i, j) for i, j in ((1, 0), (0, 1), (1, 1)))
    rx = Sx @ sampler.e0
    j0 = np.hypot(rx[:, 0], rx[:, 1])[:, None]
    fields = (Sx / j0, Sy, Sxy / j0)
    B = sampler.vectors(*fields)
    ref = np.hstack([S @ sampler.e0 for S in fields])
    ds = w * j0[:, 0] * sampler.shape.l
    s = sampler.at(xi)
    D = diagonal(ds, *(p * k for p, k in zip(parts, (s.EA, s.kGA, s.EI, s.EA), strict=True)))
    return B, ref, coupled(D, ds, parts[0] * s.ES, 0, 2)


def _terms(sampler: Sampler) -> int:
    """Return the number of terms of r_y as a polynomial along the axis, at least 2."""
    return 1 + max(1, *(t.i for p in sampler.shape.element.polynomials for t in p.terms if t.j > 0))


def sample(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample EA, kGA, EI with the reduced rule and the section stretch at as many Lobatto points as r_y has terms.

    A straight section stretches with E A (its frequency is sqrt(12 E/rho)/h). At the reduced points, a stretch that
    alternates from node to node would have no stiffness. Between the nodes, the interpolated r_y is shorter than 1
    where it rotates, so Gauss points of full order would lock.
    """
    parts = [_stations(sampler, sampler.points(rule.normal[0]), (1.0, 1.0 if rule.uniform else 0.0, 1.0, 0.0)),
             _stations(sampler, lobatto(_terms(sampler)), (0.0, 0.0, 0.0, 1.0))]
    if not rule.uniform:
        parts.append(_stations(sampler, sampler.points(rule.shear[0]), (0.0, 1.0, 0.0, 0.0)))
    return join(*parts)


def _places(sampler: Sampler, rule: Rule) -> Array:
    """Return the positions xi of the stations of ``sample``."""
    points = [sampler.points(rule.normal[0]), lobatto(_terms(sampler))]
    if not rule.uniform:
        points.append(sampler.points(rule.shear[0]))
    return np.concatenate([xi for xi, _ in points])


def natural(sampler: Sampler, rule: Rule, free: Free) -> Array:
    """Return the natural axial strain, no shear, curvature, and strain across at the stations of ``sample``."""
    xi = _places(sampler, rule)
    axial, curvature, across = of_section(sampler, free, xi)
    return np.stack([axial, np.zeros_like(xi), curvature, across], axis=1)


def fibres(sampler: Sampler, rule: Rule) -> tuple[Array, tuple[Array, Array, Array]]:
    """Return the positions and stations of ``sample``; each of them has axial strain and curvature."""
    return _places(sampler, rule), sample(sampler, rule)


def _refuse(element: ElementType) -> str | None:
    if element.has_theta or element.degree_y == 0:
        return f"{element.name} has no r_y to give its section a direction"
    if element.degree_y > 1:
        return f"its strains do not depend on the y^2 of {element.name}, which would have no stiffness"
    return None


# fields: u_,s, u_,y and u_,ys, x and y each; reference values: r_s, r_y and r_ys
SECTION = StrainLaw(6, 4, 6, strain, geometric, mean, (3,))

FORMULATIONS = (
    Formulation("structural", SECTION, _refuse, lambda e: (e.degree_x, 1), lambda e: None, sample,
                "Gerstmayr, Matikainen & Mikkola 2008; Nachbagauer et al. 2011-13",
                "axial, shear, bending and thickness strain of the section on the axis, without Poisson coupling",
                natural=natural, fibres=fibres),
)
