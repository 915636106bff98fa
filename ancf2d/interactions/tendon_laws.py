"""Point laws of tendons: the length of a string as a sum of pieces, and the forces of its tension.

A piece is the straight line from eyelet to eyelet, or the part of a guide along a short stretch of a body. Its length
is the norm of a vector l + R(a1) (u1, v1) + R(a2) (u2, v2) of fields, where R rotates by an angle or to a
direction.
"""

from __future__ import annotations

import numpy as np

from ..elements.point_laws import DIRECTION, THETA, PointLaw

# The fields of a piece are l and up to two arms: a direction (or an angle and an unused field), u, v, and the kind of
# rotation. A guide along sections with theta has one short arm: the angle and u, and v if the guide rises. A piece that
# is linear in the coordinates has only l.
ARM, SHORT = 5, 3


def middle(p0, u0, u1, k):  # type: ignore[no-untyped-def]
    """Return the value of a field halfway between two states."""
    return p0[k] + 0.5 * (u0[k] + u1[k])


def arm_of(p0, k, size):  # type: ignore[no-untyped-def]
    """Return the kind of rotation of the arm at field k, and the indices of u and v (-1 if v is 0)."""
    if size <= 2 + SHORT:
        return THETA, k + 1, k + 2 if size == 2 + SHORT else -1
    return p0[k + 4], k + 2, k + 3


def arm(p0, u0, u1, at, size):  # type: ignore[no-untyped-def]
    """Return cosine and sine of the direction of an arm, and (u, v) rotated to it."""
    kind, i, j = arm_of(p0, at, size)
    c, s = 1.0, 0.0
    if kind == THETA:
        angle = middle(p0, u0, u1, at)
        c, s = np.cos(angle), np.sin(angle)
    elif kind == DIRECTION:
        x, y = middle(p0, u0, u1, at), middle(p0, u0, u1, at + 1)
        L = np.sqrt(x * x + y * y)
        c, s = x / L, y / L
    u = middle(p0, u0, u1, i)
    v = middle(p0, u0, u1, j) if j >= 0 else 0.0
    return c, s, c * u - s * v, s * u + c * v


def piece(p0, u0, u1, at, size):  # type: ignore[no-untyped-def]
    """Return the vector of a piece halfway between two states."""
    x, y = middle(p0, u0, u1, at), middle(p0, u0, u1, at + 1)
    for k in range(at + 2, at + size, ARM):
        _, _, wx, wy = arm(p0, u0, u1, k, size)
        x += wx
        y += wy
    return x, y


def slopes(p0, u0, u1, at, size, ex, ey, f):  # type: ignore[no-untyped-def]
    """Add the derivatives of (ex, ey) times the vector of a piece to f."""
    f[at] += ex
    f[at + 1] += ey
    for k in range(at + 2, at + size, ARM):
        kind, i, j = arm_of(p0, k, size)
        c, s, wx, wy = arm(p0, u0, u1, k, size)
        turn = ey * wx - ex * wy
        if kind == THETA:
            f[k] += turn
        elif kind == DIRECTION:
            x, y = middle(p0, u0, u1, k), middle(p0, u0, u1, k + 1)
            f[k] -= turn * y / (x * x + y * y)
            f[k + 1] += turn * x / (x * x + y * y)
        f[i] += ex * c + ey * s
        if j >= 0:
            f[j] += ey * c - ex * s


def curvatures(p0, u, at, size, ex, ey, T, H):  # type: ignore[no-untyped-def]
    """Add the second derivatives of (ex, ey) times the vector of a piece, multiplied by T, to H."""
    for k in range(at + 2, at + size, ARM):
        kind, iu, iv = arm_of(p0, k, size)
        c, s, wx, wy = arm(p0, u, u, k, size)
        bend, by_u, by_v = -T * (ex * wx + ey * wy), T * (ey * c - ex * s), -T * (ex * c + ey * s)
        n, gx, gy = 0, 1.0, 0.0
        if kind == THETA:
            n = 1
        elif kind == DIRECTION:
            n = 2
            x, y = p0[k] + u[k], p0[k + 1] + u[k + 1]
            gx, gy = -y / (x * x + y * y), x / (x * x + y * y)
            q = T * (ey * wx - ex * wy) / (x * x + y * y) ** 2
            H[k, k] += 2.0 * x * y * q
            H[k, k + 1] += (y * y - x * x) * q
            H[k + 1, k] += (y * y - x * x) * q
            H[k + 1, k + 1] -= 2.0 * x * y * q
        for i in range(n):
            g = gx if i == 0 else gy
            for j in range(n):
                H[k + i, k + j] += bend * g * (gx if j == 0 else gy)
            H[k + i, iu] += by_u * g
            H[iu, k + i] += by_u * g
            if iv >= 0:
                H[k + i, iv] += by_v * g
                H[iv, k + i] += by_v * g


def moved_arm(p0, u, at, size):  # type: ignore[no-untyped-def]
    """Return the change of an arm's rotated (u, v) from the reference, computed without loss of digits."""
    kind, i, j = arm_of(p0, at, size)
    c, s, turned, less = 1.0, 0.0, 0.0, 0.0
    if kind == THETA:
        c, s, turned = np.cos(p0[at]), np.sin(p0[at]), np.sin(u[at])
        less = 2.0 * np.sin(0.5 * u[at]) ** 2
    elif kind == DIRECTION:
        x, y = p0[at] + u[at], p0[at + 1] + u[at + 1]
        size0 = np.sqrt(p0[at] * p0[at] + p0[at + 1] * p0[at + 1])
        sizes = size0 * np.sqrt(x * x + y * y)
        c, s = p0[at] / size0, p0[at + 1] / size0
        turned = (p0[at] * u[at + 1] - p0[at + 1] * u[at]) / sizes
        cosine = (p0[at] * x + p0[at + 1] * y) / sizes
        less = turned * turned / (1.0 + cosine) if cosine > 0.0 else 1.0 - cosine
    dc, ds = -c * less - s * turned, -s * less + c * turned
    a, da = p0[i], u[i]
    b, db = (p0[j], u[j]) if j >= 0 else (0.0, 0.0)
    return dc * a - ds * b + (c + dc) * da - (s + ds) * db, ds * a + dc * b + (s + ds) * da + (c + dc) * db


def stretch_of(p0, u, size):  # type: ignore[no-untyped-def]
    """Return the length of all pieces minus that in the reference, as accurate as the displacements."""
    out = 0.0
    for at in range(0, len(p0), size):
        x, y = piece(p0, u, u, at, size)
        dx, dy = u[at], u[at + 1]
        for k in range(at + 2, at + size, ARM):
            wx, wy = moved_arm(p0, u, k, size)
            dx += wx
            dy += wy
        x0, y0 = x - dx, y - dy
        L = np.sqrt(x * x + y * y) + np.sqrt(x0 * x0 + y0 * y0)
        if L > 0.0:
            out += (dx * (x + x0) + dy * (y + y0)) / L
    return out


def pull(p0, u, size, T, k, f, H, row):  # type: ignore[no-untyped-def]
    """Fill f with the forces of a tension T, H with its stiffness; k is dT/dl; ``row`` (m,) is a zeroed work array."""
    for at in range(0, len(p0), size):
        x, y = piece(p0, u, u, at, size)
        L = np.sqrt(x * x + y * y)
        if L > 0.0:
            nx, ny = x / L, y / L
            slopes(p0, u, u, at, size, nx, ny, f)
            curvatures(p0, u, at, size, nx, ny, T, H)
            slopes(p0, u, u, at, size, -ny, nx, row)
            for i in range(at, at + size):
                for j in range(at, at + size):
                    H[i, j] += T / L * row[i] * row[j]
            for i in range(at, at + size):
                row[i] = 0.0
    for i in range(len(p0)):
        for j in range(len(p0)):
            H[i, j] += k * f[i] * f[j]
    for i in range(len(p0)):
        f[i] *= T


def pull_over_step(p0, u0, u1, size, T, f):  # type: ignore[no-untyped-def]
    """Fill f with the forces of a tension T over a step; those of linear pieces do the work T (l1 - l0)."""
    for at in range(0, len(p0), size):
        x0, y0 = piece(p0, u0, u0, at, size)
        x1, y1 = piece(p0, u1, u1, at, size)
        L = np.sqrt(x0 * x0 + y0 * y0) + np.sqrt(x1 * x1 + y1 * y1)
        if L > 0.0:
            slopes(p0, u0, u1, at, size, T * (x0 + x1) / L, T * (y0 + y1) / L, f)


def taut(p0, u, a, par, size):  # type: ignore[no-untyped-def]
    """Return energy, tension and dT/dl of an elastic tendon; par: EA, length in the reference, slack."""
    l0 = par[1] + a * par[2]
    stretch = stretch_of(p0, u, size) - a * par[2]
    if stretch < 0.0:
        return 0.0, 0.0, 0.0
    T = par[0] * stretch / l0
    return 0.5 * T * stretch, T, par[0] / l0


def tension(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Forces of a prescribed tension; par: tension, number of fields of a piece."""
    pull(p0, u, int(par[1]), a[0] * par[0], 0.0, f, H, C[0])
    return 0.0, 0.0


def tension_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Forces of the mean tension of a step."""
    pull_over_step(p0, u0, u1, int(par[1]), 0.5 * (a0[0] + a1[0]) * par[0], f)
    return 0.0, 0.0


def elastic(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """T = EA (l - l0)/l0, or 0 if slack. par: as for ``taut``, number of fields of a piece.

    Winding changes the energy at the same length: it does work, and nothing is lost.
    """
    energy, T, k = taut(p0, u, a[0], par, int(par[3]))
    if k > 0.0:
        pull(p0, u, int(par[3]), T, k, f, H, C[0])
    return energy, 0.0


def elastic_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Forces of the tension whose work in a step is the change of energy at the mean unstretched length."""
    a, size = 0.5 * (a0[0] + a1[0]), int(par[3])
    before, T0, _ = taut(p0, u0, a, par, size)
    after, T1, _ = taut(p0, u1, a, par, size)
    T = 0.5 * (T0 + T1)
    if T > 0.0 and (T0 == 0.0 or T1 == 0.0):
        T = (after - before) / (stretch_of(p0, u1, size) - stretch_of(p0, u0, size))
    if T > 0.0:
        pull_over_step(p0, u0, u1, size, T, f)
    return taut(p0, u1, a1[0], par, size)[0], 0.0


TENSION = PointLaw("tension", tension, tension_mean)
ELASTIC = PointLaw("elastic_tendon", elastic, elastic_mean)
