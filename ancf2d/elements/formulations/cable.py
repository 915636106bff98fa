"""Euler-Bernoulli formulations of the gradient-deficient cable, with engineering or Green axial strain."""

from __future__ import annotations

import numpy as np

from ..definition import ElementType
from ..shape import Array, gauss, lobatto
from .base import Formulation, Free, Rule, Sampler, StrainLaw, coupled, cross, diagonal, join, of_section


def strain(ref, u, eps, J, lanes):  # type: ignore[no-untyped-def]
    """Strains |r_s| and dtheta/ds = r_s x r_ss/|r_s|^2, less those of the reference (Gerstmayr & Irschik 2008)."""
    for l in range(lanes):
        px, py, qx, qy = ref[0, l], ref[1, l], ref[2, l], ref[3, l]
        ax, ay, bx, by = u[0, l], u[1, l], u[2, l], u[3, l]
        fx, fy, gx, gy = px + ax, py + ay, qx + bx, qy + by
        LL0, LL = px * px + py * py, fx * fx + fy * fy
        L = np.sqrt(LL)
        dLL = 2.0 * (px * ax + py * ay) + ax * ax + ay * ay
        k0 = (px * qy - py * qx) / LL0
        eps[0, l] = dLL / (L + np.sqrt(LL0))
        eps[1, l] = ((ax * gy - ay * gx) + (px * by - py * bx) - k0 * dLL) / LL
        k = k0 + eps[1, l]
        J[0, 0, l], J[0, 1, l] = fx / L, fy / L
        J[1, 0, l], J[1, 1, l] = (gy - 2.0 * k * fx) / LL, (-gx - 2.0 * k * fy) / LL
        J[1, 2, l], J[1, 3, l] = -fy / LL, fx / LL


def geometric(ref, u, sigma, J, H, lanes):  # type: ignore[no-untyped-def]
    """Add sum_i sigma_i d2 eps_i/du2."""
    for l in range(lanes):
        fx, fy = ref[0, l] + u[0, l], ref[1, l] + u[1, l]
        gx, gy = ref[2, l] + u[2, l], ref[3, l] + u[3, l]
        LL = fx * fx + fy * fy
        N, M = sigma[0, l] / np.sqrt(LL), sigma[1, l] / LL
        k = (fx * gy - fy * gx) / LL
        ex, ey = fx / LL, fy / LL
        H[0, 0, l] += N * (1.0 - fx * ex) + M * (-4.0 * gy * ex - k * (2.0 - 8.0 * fx * ex))
        H[1, 1, l] += N * (1.0 - fy * ey) + M * (4.0 * gx * ey - k * (2.0 - 8.0 * fy * ey))
        H[0, 1, l] += -N * fx * ey + M * (2.0 * gx * ex - 2.0 * gy * ey + 8.0 * k * fx * ey)
        H[0, 2, l] += M * 2.0 * fy * ex
        H[0, 3, l] += M * (1.0 - 2.0 * fx * ex)
        H[1, 2, l] += -M * (1.0 - 2.0 * fy * ey)
        H[1, 3, l] += -M * 2.0 * fx * ey


def mean(ref, u0, u1, eps0, eps1, J, lanes):  # type: ignore[no-untyped-def]
    """Fill the discrete Jacobian between two states, from changes of A = r_s.r_s and C = r_s x r_ss at the middle.

    A = |r_s|^2 gives d|r_s| = dA/(|r_s|_0 + |r_s|_1); kappa A = C gives dkappa = (dC - kappa_m dA)/A_m, m the mean.
    """
    for l in range(lanes):
        px, py, qx, qy = ref[0, l], ref[1, l], ref[2, l], ref[3, l]
        x0, y0, x1, y1 = px + u0[0, l], py + u0[1, l], px + u1[0, l], py + u1[1, l]
        A0, A1 = x0 * x0 + y0 * y0, x1 * x1 + y1 * y1
        L, A = 0.5 * (np.sqrt(A0) + np.sqrt(A1)), 0.5 * (A0 + A1)
        fx, fy = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        gx, gy = qx + 0.5 * (u0[2, l] + u1[2, l]), qy + 0.5 * (u0[3, l] + u1[3, l])
        k = (px * qy - py * qx) / (px * px + py * py) + 0.5 * (eps0[1, l] + eps1[1, l])
        J[0, 0, l], J[0, 1, l] = fx / L, fy / L
        J[1, 0, l], J[1, 1, l] = (gy - 2.0 * k * fx) / A, (-gx - 2.0 * k * fy) / A
        J[1, 2, l], J[1, 3, l] = -fy / A, fx / A


def green_strain(ref, u, eps, J, lanes):  # type: ignore[no-untyped-def]
    """Strains r_s.r_s/2 and r_s x r_ss/|r_s|^3, less those of the reference (Berzeri & Shabana 2000)."""
    for l in range(lanes):
        px, py, qx, qy = ref[0, l], ref[1, l], ref[2, l], ref[3, l]
        ax, ay, bx, by = u[0, l], u[1, l], u[2, l], u[3, l]
        fx, fy, gx, gy = px + ax, py + ay, qx + bx, qy + by
        LL0, LL = px * px + py * py, fx * fx + fy * fy
        L, L0 = np.sqrt(LL), np.sqrt(LL0)
        dLL = 2.0 * (px * ax + py * ay) + ax * ax + ay * ay
        c0 = px * qy - py * qx
        dL = dLL / (L + L0)
        L3, L30 = LL * L, LL0 * L0
        eps[0, l] = 0.5 * dLL
        dL3 = dL * (LL + L * L0 + LL0)
        eps[1, l] = ((ax * gy - ay * gx) + (px * by - py * bx) - c0 / L30 * dL3) / L3
        k = c0 / L30 + eps[1, l]
        J[0, 0, l], J[0, 1, l] = fx, fy
        J[1, 0, l], J[1, 1, l] = gy / L3 - 3.0 * k * fx / LL, -gx / L3 - 3.0 * k * fy / LL
        J[1, 2, l], J[1, 3, l] = -fy / L3, fx / L3


def green_geometric(ref, u, sigma, J, H, lanes):  # type: ignore[no-untyped-def]
    """Add sum_i sigma_i d2 eps_i/du2."""
    for l in range(lanes):
        fx, fy = ref[0, l] + u[0, l], ref[1, l] + u[1, l]
        gx, gy = ref[2, l] + u[2, l], ref[3, l] + u[3, l]
        LL = fx * fx + fy * fy
        M = sigma[1, l] / (LL * np.sqrt(LL))
        w = fx * gy - fy * gx
        ex, ey = fx / LL, fy / LL
        H[0, 0, l] += sigma[0, l] + M * (-6.0 * gy * ex - 3.0 * w / LL * (1.0 - 5.0 * fx * ex))
        H[1, 1, l] += sigma[0, l] + M * (6.0 * gx * ey - 3.0 * w / LL * (1.0 - 5.0 * fy * ey))
        H[0, 1, l] += M * (3.0 * gx * ex - 3.0 * gy * ey + 15.0 * w / LL * fx * ey)
        H[0, 2, l] += M * 3.0 * fy * ex
        H[0, 3, l] += M * (1.0 - 3.0 * fx * ex)
        H[1, 2, l] += -M * (1.0 - 3.0 * fy * ey)
        H[1, 3, l] += -M * 3.0 * fx * ey


def green_mean(ref, u0, u1, eps0, eps1, J, lanes):  # type: ignore[no-untyped-def]
    """Fill the discrete Jacobian between two states; same as ``mean``, with kappa |r_s|^3 = C."""
    for l in range(lanes):
        px, py, qx, qy = ref[0, l], ref[1, l], ref[2, l], ref[3, l]
        x0, y0, x1, y1 = px + u0[0, l], py + u0[1, l], px + u1[0, l], py + u1[1, l]
        A0, A1, LL = x0 * x0 + y0 * y0, x1 * x1 + y1 * y1, px * px + py * py
        L0, L1 = np.sqrt(A0), np.sqrt(A1)
        L3 = 0.5 * (A0 * L0 + A1 * L1)
        fx, fy = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        gx, gy = qx + 0.5 * (u0[2, l] + u1[2, l]), qy + 0.5 * (u0[3, l] + u1[3, l])
        k = (px * qy - py * qx) / (LL * np.sqrt(LL)) + 0.5 * (eps0[1, l] + eps1[1, l])
        w = 2.0 * k * (A0 + L0 * L1 + A1) / (L0 + L1)
        J[0, 0, l], J[0, 1, l] = fx, fy
        J[1, 0, l], J[1, 1, l] = (gy - w * fx) / L3, (-gx - w * fy) / L3
        J[1, 2, l], J[1, 3, l] = -fy / L3, fx / L3


def _stations(sampler: Sampler, points: tuple[Array, Array], parts: tuple[float, float],
              ) -> tuple[Array, Array, Array]:
    """Sample the given parts (of EA and EI) of the stiffness at points (xi, weights)."""
    xi, w = points
    zero = np.zeros_like(xi)
    Sx, Sxx = sampler.derivative(xi, zero, 1, 0), sampler.derivative(xi, zero, 2, 0)
    rx, rxx = Sx @ sampler.e0, Sxx @ sampler.e0
    j0 = np.hypot(rx[:, 0], rx[:, 1])[:, None]
    # d/ds = (1/j0) d/dx, because the interpolated |r_x| of the reference is not exactly 1
    dj0 = np.sum(rx * rxx, axis=1, keepdims=True) / j0
    fields = (Sx / j0, Sxx / j0**2 - Sx * dj0 / j0**3)
    B = sampler.vectors(*fields)
    ref = np.hstack([S @ sampler.e0 for S in fields])
    ds = w * j0[:, 0] * sampler.shape.l
    s = sampler.at(xi)
    # the stretch part has EA (eps - e kappa)^2 with e = ES/EA, the curvature part the rest of EI
    EI = parts[1] * s.EI + (parts[0] - parts[1]) * s.ES**2 / s.EA
    return B, ref, coupled(diagonal(ds, parts[0] * s.EA, EI), ds, parts[0] * s.ES, 0, 1)


def sample(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample stretch and curvature at Gauss points, or only the curvature there and the stretch at Lobatto points.

    Neighbours share the Lobatto points at their nodes: n elements of degree 3 have 2 n + 1 stretches, which their
    4 n + 4 coordinates can keep at zero in bending, and no motion is without strain. With Gauss points, three per
    element lock, and two miss one stretch.
    """
    n = rule.normal[0]
    if not rule.lobatto:
        return _stations(sampler, gauss(n), (1.0, 1.0))
    return join(_stations(sampler, lobatto(n), (1.0, 0.0)), _stations(sampler, gauss(n), (0.0, 1.0)))


def fibres(sampler: Sampler, rule: Rule) -> tuple[Array, tuple[Array, Array, Array]]:
    """Sample stretch and curvature, which fibres couple, at the same points: Lobatto points if the stretch uses them.

    The curvature energy of cubic elements is integrated exactly there too.
    """
    points = (lobatto if rule.lobatto else gauss)(rule.normal[0])
    return points[0], _stations(sampler, points, (1.0, 1.0))


def natural(sampler: Sampler, rule: Rule, free: Free) -> Array:
    """Return the natural axial strain and curvature dtheta/ds at the stations of ``sample``."""
    n = rule.normal[0]
    parts = []
    for xi, _ in (lobatto(n), gauss(n)) if rule.lobatto else (gauss(n),):
        axial, curvature, _ = of_section(sampler, free, xi)
        parts.append(np.stack([axial, curvature], axis=1))
    return np.concatenate(parts)


def green_natural(sampler: Sampler, rule: Rule, free: Free) -> Array:
    """Return the natural stretch and spatial curvature, to first order: stretch reduces the reference curvature."""
    n = rule.normal[0]
    xi = np.concatenate([lobatto(n)[0], gauss(n)[0]]) if rule.lobatto else gauss(n)[0]
    rx, rxx = (sampler.derivative(xi, np.zeros_like(xi), k, 0) @ sampler.e0 for k in (1, 2))
    out = natural(sampler, rule, free)
    out[:, 1] -= cross(rx, rxx) / np.hypot(rx[:, 0], rx[:, 1]) ** 3 * out[:, 0]
    return out


def _refuse(element: ElementType) -> str | None:
    if element.has_theta or element.degree_y > 0:
        return f"{element.name} can shear: this formulation is for elements whose section stays normal to r_x"
    if not any("r_x" in n.coordinates for n in element.nodes):
        return f"{element.name} has no r_x at its nodes: its slope would jump between elements"
    return None


# fields: u_,s and u_,ss, x and y each; reference values: r_s and r_ss
ENGINEERING = StrainLaw(4, 2, 4, strain, geometric, mean)
GREEN = StrainLaw(4, 2, 4, green_strain, green_geometric, green_mean, (0,))

FORMULATIONS = (
    Formulation("cable", ENGINEERING, _refuse, lambda e: (e.degree_x, 1), lambda e: None, sample,
                "Gerstmayr & Irschik 2008", "engineering axial strain |r_x| - 1 and curvature dtheta/ds, no shear",
                selective=False, lobatto=True, natural=natural, fibres=fibres),
    Formulation("green", GREEN, _refuse, lambda e: (e.degree_x, 1), lambda e: None, sample, "Berzeri & Shabana 2000",
                "Green axial strain (r_x.r_x - 1)/2 and spatial curvature, no shear", selective=False,
                lobatto=True, natural=green_natural, green=True),
)
