"""Limit points and post-buckling shapes of the geometrically exact beam by shooting, without finite elements.

At a limit point the shooting equations f(q, P) = 0 for the unknown end values q have a singular Jacobian. Both are
solved together for (q, P, v): f = 0, f_q v = 0, |v| = 1 (Moore & Spence 1980). The guesses are rough.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import root
from scipy.special import ellipe, ellipk

from instruments.references.statics import Array, Beam, march, rectangle


def fold(f: Callable[[Array, float], Array], q: Sequence[float], P: float) -> tuple[Array, float]:
    """Return (q, P) where f(q, P) = 0 turns back in P. Raises ValueError if none is found near the guess.

    q and P must be scaled to the order of 1.
    """
    n, h = len(q), 1e-4

    def along(z: Array, P: float, v: Array) -> Array:
        # fourth-order central difference of f in the direction v
        a, b, c, d = (f(z + k * h * v, P) for k in (-2, -1, 1, 2))
        return (a - 8 * b + 8 * c - d) / (12 * h)

    def equations(x: Array) -> Array:
        z, P, v = x[:n], x[n], x[n + 1:]
        return np.concatenate([f(z, P), along(z, P, v), [v @ v - 1]])

    J = np.stack([along(np.array(q, float), P, e) for e in np.eye(n)], axis=1)
    v = np.linalg.svd(J)[2][-1]
    found = root(equations, [*q, P, *v], tol=1e-13)
    if np.max(np.abs(equations(found.x))) > 1e-8:
        raise ValueError(f"no limit point was found: {found.message}")
    return found.x[:n], float(found.x[n])


def lee_frame_limit(q: Sequence[float], P: float) -> tuple[float, Array]:
    """Return (P, (ux, uy, theta) of the load) at a limit point of Lee's frame near the guess.

    q: force at the lower foot (x, y) over 1e4 and its rotation; P over 1e4.
    """
    beam = Beam(7.2e6 * 6, 5 / 6 * 7.2e6 / 2.6 * 6, 7.2e6 * 2)

    def states(q: Array, P: float) -> tuple[Array, Array]:
        F = 1e4 * q[:2]
        column = march(beam, [0, 0, math.pi / 2 + q[2], 0], F, 120)
        load = march(beam, [*column[:2], column[2] - math.pi / 2, column[3]], F, 24)
        return load, march(beam, load, F + np.array([0, 1e4 * P]), 96)

    def residual(q: Array, P: float) -> Array:
        _, end = states(q, P)
        return np.array([(end[0] - 120) / 120, (end[1] - 120) / 120, 120 * end[3] / beam.EI])

    q, P = fold(residual, q, P)
    load, _ = states(q, P)
    return 1e4 * P, load[:3] - [24, 120, 0]


def deep_arch_limit(q: Sequence[float], P: float) -> tuple[float, Array]:
    """Return (P, (ux, uy, theta) of the apex) at the limit point of the clamped-hinged arch of 215 degrees.

    q: force (x, y) at the clamp over 1e3 and moment over 1e5; P over 1e3.
    """
    beam, R, half = Beam(1e8, 1e8, 1e6), 100.0, math.radians(107.5)

    def states(q: Array, P: float) -> tuple[Array, Array]:
        F = 1e3 * q[:2]
        apex = march(beam, [-R * math.sin(half), R * math.cos(half), half, 1e5 * q[2]], F, R * half, -1 / R)
        return apex, march(beam, apex, F + np.array([0, 1e3 * P]), R * half, -1 / R)

    def residual(q: Array, P: float) -> Array:
        _, end = states(q, P)
        return np.array([end[0] / R - math.sin(half), end[1] / R - math.cos(half), end[3] * R / beam.EI])

    q, P = fold(residual, q, P)
    apex, _ = states(q, P)
    return 1e3 * P, apex[:3] - [0, R, 0]


def half_arch(q: Array, P: float) -> tuple[Array, Array]:
    """Return (end state, residual) of half the hinged shallow arch of ``cases/paths/shallow_arch.yaml``.

    R = 100, opening 0.5 rad, section 1 x 1, E = 1e6, nu = 0.3, load P at the apex; symmetric about the apex.
    q: horizontal force over 1e4 and rotation at the hinge; P over 1e3.
    """
    beam, R, a = rectangle(1e6, 0.3, 1.0, 1.0), 100.0, 0.25
    start = [-R * math.sin(a), R * math.cos(a), a + q[1], 0.0]
    end = march(beam, start, np.array([1e4 * q[0], -0.5e3 * P]), R * a, -1 / R)
    return end, np.array([end[0] / R, end[2]])


def shallow_arch_limit(q: Sequence[float], P: float) -> tuple[float, float]:
    """Return (P, uy of the apex) at a limit point of the shallow arch near the guess."""
    q, P = fold(lambda q, P: half_arch(q, P)[1], q, P)
    return 1e3 * P, float(half_arch(q, P)[0][1]) - 100.0


def buckled_cantilever(angle: float) -> tuple[float, float, float]:
    """Return (P L^2/EI, x/L, y/L) of the top of an inextensible column that has turned by ``angle`` (elastica)."""
    k = math.sin(angle / 2)
    K, E = ellipk(k * k), ellipe(k * k)
    return K * K, 2 * k / K, 2 * E / K - 1
