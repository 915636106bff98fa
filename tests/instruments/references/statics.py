"""Exact solutions that ``cases/`` expects, computed here without finite elements.

The planar geometrically exact beam (Reissner 1972; Simo & Vu-Quoc 1986) is an ordinary differential equation along
its arc length s. With the force F that the part beyond s exerts on the part before it, the section's angle theta and
its moment M,

    N = F . t,  Q = F . n,  x' = (1 + N/EA) t + Q/kGA n,  theta' = kappa_0 + M/EI,  M' = -(x' x F),

t = (cos theta, sin theta), n = (-sin theta, cos theta). Unknown end values are found by shooting.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

Array = np.ndarray


@dataclass(frozen=True)
class Beam:
    """Section stiffnesses; infinite ones are left out of the strain."""

    EA: float
    kGA: float
    EI: float


def timoshenko(nu: float) -> float:
    """Return the shear factor 10 (1 + nu)/(12 + 11 nu) of a rectangle (Cowper 1966)."""
    return 10 * (1 + nu) / (12 + 11 * nu)


def rectangle(E: float, nu: float, height: float, width: float, k: float | None = None) -> Beam:
    """Return the stiffnesses of a rectangular section."""
    A, G = height * width, E / (2 * (1 + nu))
    return Beam(E * A, (timoshenko(nu) if k is None else k) * G * A, E * width * height**3 / 12)


def march(beam: Beam, z: Sequence[float], F: Array, length: float, kappa_0: float = 0.0) -> Array:
    """Return (x, y, theta, M) after ``length`` from ``z`` at its start under the constant force F (2,)."""

    def rate(s: float, z: Array) -> list[float]:
        c, n = math.cos(z[2]), math.sin(z[2])
        N, Q = c * F[0] + n * F[1], -n * F[0] + c * F[1]
        a, b = 1 + N / beam.EA, Q / beam.kGA
        x, y = a * c - b * n, a * n + b * c
        return [x, y, kappa_0 + z[3] / beam.EI, y * F[0] - x * F[1]]

    return solve_ivp(rate, (0.0, length), z, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]


def shoot(residual: Callable[[Array], Array], guess: Sequence[float]) -> Array:
    """Return the unknown end values for which the residual vanishes. Raises ValueError if none are found."""
    found = root(residual, guess, tol=1e-13)
    if np.max(np.abs(residual(found.x))) > 1e-9:
        raise ValueError(f"shooting did not converge: {found.message}")
    return found.x


def cantilever(beam: Beam, length: float, force: Sequence[float], moment: float = 0.0, steps: int = 10) -> Array:
    """Return (ux, uy, theta) of the tip of a cantilever along x under a dead tip force and moment."""
    m0, scale = 0.0, beam.EI / length
    for factor in np.linspace(0, 1, steps + 1)[1:]:
        F, M = factor * np.asarray(force, dtype=float), factor * moment
        m0 = shoot(lambda m, F=F, M=M: (march(beam, [0, 0, 0, m[0] * scale], F, length)[3:] - M) / scale, [m0])[0]
    x, y, theta, _ = march(beam, [0, 0, 0, m0 * scale], np.asarray(force, dtype=float), length)
    return np.array([x - length, y, theta])


def follower_cantilever(beam: Beam, length: float, force: Sequence[float]) -> Array:
    """Return (ux, uy, theta) of the tip under a tip force (tangential, normal) that turns with the tip's section.

    In the frame of the tip everything is known there: it is an initial value problem, marched back to the wall.
    """
    x, y, theta, _ = march(beam, [0, 0, 0, 0], np.asarray(force, dtype=float), -length)
    # so far the wall as seen from the tip; turned until the wall's section is upright
    c, s = math.cos(theta), math.sin(theta)
    return np.array([-(c * x + s * y) - length, -(-s * x + c * y), -theta])


def lee_frame(P: float, steps: int = 20) -> Array:
    """Return (ux, uy, theta) under the load of Lee's hinged frame (legs 120, load 24 from the corner; Lee 1968)."""
    beam = Beam(7.2e6 * 6, 5 / 6 * 7.2e6 / 2.6 * 6, 7.2e6 * 2)

    def states(q: Array, P: float) -> tuple[Array, Array]:
        F = np.array(q[:2]) * P
        column = march(beam, [0, 0, math.pi / 2 + q[2], 0], F, 120)
        load = march(beam, [*column[:2], column[2] - math.pi / 2, column[3]], F, 24)
        return load, march(beam, load, F + np.array([0, P]), 96)

    def residual(q: Array, P: float) -> Array:
        _, end = states(q, P)
        return np.array([(end[0] - 120) / 120, (end[1] - 120) / 120, end[3] / beam.EI])

    q = np.array([0.1, -0.8, 0.0])
    for p in np.linspace(0, P, steps + 1)[1:]:
        q = shoot(lambda q, p=p: residual(q, p), q)
    load, _ = states(q, P)
    return np.array([load[0] - 24, load[1] - 120, load[2]])


def deep_arch(P: float, steps: int = 20) -> Array:
    """Return (ux, uy, theta) of the apex of the clamped-hinged arch of 215 degrees (DaDeppo & Schmidt 1975)."""
    beam, R, half = Beam(1e8, 1e8, 1e6), 100.0, math.radians(107.5)

    def states(q: Array, P: float) -> tuple[Array, Array]:
        F = np.array(q[:2]) * P
        start = [-R * math.sin(half), R * math.cos(half), half, q[2] * P * R]
        apex = march(beam, start, F, R * half, -1 / R)
        return apex, march(beam, apex, F + np.array([0, P]), R * half, -1 / R)

    def residual(q: Array, P: float) -> Array:
        _, end = states(q, P)
        return np.array([end[0] / R - math.sin(half), end[1] / R - math.cos(half), end[3] * R / beam.EI])

    q = np.array([0.0, -0.5, 0.0])
    for p in np.linspace(0, P, steps + 1)[1:]:
        q = shoot(lambda q, p=p: residual(q, p), q)
    apex, _ = states(q, P)
    return np.array([apex[0], apex[1] - R, apex[2]])
