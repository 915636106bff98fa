"""Hard contact points between the nodes of a body: the compliance of the beam there, and where the points slide to.

Under a force p at z between the ends of an element, a beam bends more than the element can. The additional deflection
is c(z) p, c = l^3 x^3 (1 - x)^3/3 EI + l x (1 - x)/kGA at x = 0..1 along the element, as in a beam clamped at both
ends, so the gap is g(q, z) + c(z) p. With the multiplier lambda = -p, everything follows from

    L = lambda g(q, z) - c(z) lambda^2/2.

A sliding point is where L is stationary, g_z + c_z p/2 = 0, e.g. where a body lifts off an obstacle. With
G = g_zz + c_zz p/2 and v = g_qz/G, elimination of z leaves

    L_qq = lambda (g_qq - g_qz v),  L_q,lambda = g_q - c_z p v/2,  L_lambda,lambda = -c + c_z^2 p/4 G.

With A = t.rho_q, B = nu.rho_qz, T = t.rho_z and the curvature k = 1/D of the gap, g_qz = k T A + B; the terms have
finite limits at a corner (D = 0) and on a plane (D = inf).

Functions of arrays and numbers alone, which the kernels compile unchanged.
"""

from __future__ import annotations

import numpy as np

from .contact_derivatives import add_second_derivative, derivative_along, slope_derivative_along
from .contact_geometry import (
    AT_1,
    AT_2,
    BENDING,
    FEATURE,
    HALF_INTERVAL,
    HOME,
    OPPOSITE,
    OTHER,
    PLACE,
    POLYLINE,
    RHO,
    ROW,
    SHAPE,
    SHEAR,
    curve_derivative,
    gap_at,
    position_at,
)

TRIES = 30
# greatest remaining change of z due to round-off; curvature of the gap if the curve passes through a corner
SETTLED, AT_CORNER = 1e-9, 1e300
# largest |z| to which a point may slide beyond the ends of its element before it changes to another element
BEYOND = 1.5


def compliance(par, z):  # type: ignore[no-untyped-def]
    """Return c at z and its first two derivatives by z; 0 outside the interval of the point."""
    if par[BENDING] == 0.0 or abs(z - par[HOME]) >= par[HALF_INTERVAL]:
        return 0.0, 0.0, 0.0
    half = par[HALF_INTERVAL]
    x = 0.5 + 0.5 * (z - par[HOME]) / half
    v, d = x * (1.0 - x), 0.5 * (1.0 - 2.0 * x) / half
    by_v, twice = 3.0 * par[BENDING] * v * v + par[SHEAR], 6.0 * par[BENDING] * v
    return (par[BENDING] * v * v + par[SHEAR]) * v, by_v * d, twice * d * d - 0.5 * by_v / half**2


def compliance_between(par, z, at):  # type: ignore[no-untyped-def]
    """Return the additional deflection at z under a unit force at another place ``at`` of the interval."""
    if par[BENDING] == 0.0 or max(abs(z - par[HOME]), abs(at - par[HOME])) >= par[HALF_INTERVAL]:
        return 0.0
    x, a = 0.5 + 0.5 * (z - par[HOME]) / par[HALF_INTERVAL], 0.5 + 0.5 * (at - par[HOME]) / par[HALF_INTERVAL]
    if x > a:
        x, a = 1.0 - x, 1.0 - a
    bent = 0.5 * par[BENDING] * x * (1.0 - a) * (3.0 * a - x * (1.0 + 2.0 * a))
    return (bent + par[SHEAR]) * x * (1.0 - a)


def at_corner(par, feature):  # type: ignore[no-untyped-def]
    """Return whether points are opposite to a corner of a polyline."""
    return (par[..., SHAPE] == POLYLINE) & (feature % 2 == 1)


def slopes(par, z, force, nx, ny, k, work):  # type: ignore[no-untyped-def]
    """Return (g_z + c_z p/2, G, T, bend) at z, for the normal nu of the gap; bend is G without the term in k."""
    _, c1, c2 = compliance(par, z)
    x1, y1 = curve_derivative(par, work, AT_1, 1)
    x2, y2 = curve_derivative(par, work, AT_2, 2)
    T, bend = -ny * x1 + nx * y1, nx * x2 + ny * y2 + 0.5 * c2 * force
    return nx * x1 + ny * y1 + 0.5 * c1 * force, k * T * T + bend, T, bend


def sliding_place(par, p0, u, mem, force, work):  # type: ignore[no-untyped-def]
    """Return z near mem[PLACE] to which a point slides under a force, or NaN if there is none on its element."""
    z, feature, moved = mem[PLACE], mem[FEATURE], 0.0
    corner = at_corner(par, feature)
    for _ in range(TRIES):
        position_at(par, p0, u, z, work)
        _, nx, ny, k, _, _ = gap_at(par, work[RHO], work[RHO + 1], feature)
        slope, G, _, bend = slopes(par, z, force, nx, ny, k, work)
        if corner and k == 0.0:
            # the curve passes through the corner: no place is nearer
            moved = 0.0
            break
        if corner:
            # D g_z, and the second derivative of D^2/2, which stays positive far from the solution
            x1, y1 = curve_derivative(par, work, AT_1, 1)
            slope, G = slope / k, max(x1 * x1 + y1 * y1 + bend / k, 0.1 * (x1 * x1 + y1 * y1))
        elif G <= 0.0:
            return np.nan
        new = min(max(z - slope / G, z - 0.5), z + 0.5)
        moved, z = abs(new - z), new
        if not abs(z) < BEYOND:
            return np.nan
        if moved < 1e-13:
            break
    position_at(par, p0, u, z, work)
    return z if moved < SETTLED else np.nan


def foot_of_centre(par, p0, u, z, work):  # type: ignore[no-untyped-def]
    """Return the place near z that is nearest to the centre of a circle, or NaN if it is not on the element.

    D^2/2 is stationary there. Its second derivative leads there from far away too; that of the gap does so only from
    places no further along the curve than the distance of the centre.
    """
    for _ in range(TRIES):
        position_at(par, p0, u, z, work)
        x, y = work[RHO] - par[OPPOSITE], work[RHO + 1] - par[OPPOSITE + 1]
        x1, y1 = curve_derivative(par, work, AT_1, 1)
        x2, y2 = curve_derivative(par, work, AT_2, 2)
        square = x1 * x1 + y1 * y1
        moved = (x * x1 + y * y1) / max(square + x * x2 + y * y2, 0.1 * square)
        z -= min(max(moved, -0.5), 0.5)
        if not abs(z) < BEYOND:
            return np.nan
        if abs(moved) < 1e-13:
            break
    position_at(par, p0, u, z, work)
    return z if abs(moved) < SETTLED else np.nan


def gap_at_place(par, mem, z, force, work):  # type: ignore[no-untyped-def]
    """Return (g, nu, k, s, ds) at z; at a corner, where g may be 0, nu follows from the tangent of the curve."""
    g, nx, ny, k, s, ds = gap_at(par, work[RHO], work[RHO + 1], mem[FEATURE])
    if at_corner(par, mem[FEATURE]):
        k = k if k != 0.0 else AT_CORNER
        _, c1, _ = compliance(par, z)
        tx, ty = curve_derivative(par, work, AT_1, 1)
        L = np.sqrt(tx * tx + ty * ty)
        lean = min(max(0.5 * c1 * force / L, -0.5), 0.5)
        up = np.sqrt(1.0 - lean * lean) * (1.0 if -ty * nx + tx * ny > 0.0 else -1.0)
        nx, ny = (-up * ty - lean * tx) / L, (up * tx - lean * ty) / L
    return g, nx, ny, k, s, ds


def add_sliding_hessian(par, z, nx, ny, k, force, work, H, m):  # type: ignore[no-untyped-def]
    """Add g_qq - g_qz v to H (m fields); leave v in work (OTHER) and return 1/G."""
    add_second_derivative(par, z, nx, ny, work, H, 0)
    _, _, T, bend = slopes(par, z, force, nx, ny, k, work)
    slope_derivative_along(par, z, nx, ny, work, work, OTHER)
    derivative_along(par, z, -ny, nx, work, work, ROW)
    # for k = 0, all terms are divided by D
    D, one = (1.0 / k, 1.0) if k != 0.0 else (1.0, 0.0)
    below = one * T * T + bend * D
    for p in range(m):
        A, B = work[ROW + p], work[OTHER + p]
        for q in range(m):
            H[p, q] += (one * (bend * A * work[ROW + q] - T * (A * work[OTHER + q] + B * work[ROW + q]))
                        - D * B * work[OTHER + q]) / below
    for p in range(m):
        work[OTHER + p] = (one * T * work[ROW + p] + D * work[OTHER + p]) / below
    return D / below
