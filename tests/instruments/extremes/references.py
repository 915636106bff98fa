"""References of the scenes: beam theory in closed form or by quadrature, without ancf2d."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from .scenes import Beam


@cache
def bent(alpha: float, axial: float, shear: float) -> tuple[float, float]:
    """Return (ux, uy)/L of a cantilever's tip under a transverse dead force -P, by Reissner's beam.

    ``alpha`` = P L^2/EI, ``axial`` = P/EA, ``shear`` = P/kGA. Shooting for the moment at the wall.
    """
    def slopes(s: float, u: np.ndarray) -> list[float]:
        theta, kappa = u[0], u[1]
        sin, cos = math.sin(theta), math.cos(theta)
        # the force (0, -P) acts on what is left of every section: N = -P sin, Q = -P cos
        stretch, slide = 1.0 - axial * sin, -shear * cos
        x, y = stretch * cos - slide * sin, stretch * sin + slide * cos
        return [kappa, alpha * x, x, y]

    def end(kappa: float) -> np.ndarray:
        return solve_ivp(slopes, (0.0, 1.0), [0.0, kappa, 0.0, 0.0], rtol=1e-11, atol=1e-13, method="DOP853").y[:, -1]

    kappa = brentq(lambda k: end(k)[1], -alpha, 0.0, xtol=1e-14)
    u = end(kappa)
    return float(u[2] - 1.0), float(u[3])


def bent_tip(beam: Beam, alpha: float, shears: bool) -> tuple[float, float]:
    """Return (ux, uy) of the tip for P L^2/EI = alpha."""
    P = alpha * beam.EI / beam.L**2
    ux, uy = bent(alpha, P / beam.EA, P / beam.kGA if shears else 0.0)
    return beam.L * ux, beam.L * uy


def pinned_omega(beam: Beam, mode: int = 1) -> float:
    """Return the bending frequency of a pinned Timoshenko beam, in closed form."""
    k = mode * math.pi / beam.L
    m, j = beam.rho * beam.A, beam.rho * beam.A * beam.h**2 / 12
    a, b, c = m * j, -(m * (beam.EI * k**2 + beam.kGA) + j * beam.kGA * k**2), beam.EI * beam.kGA * k**4
    return math.sqrt(2.0 * c / (-b + math.sqrt(b * b - 4.0 * a * c)))


def pinned_load(beam: Beam, shears: bool) -> float:
    """Return the buckling load of a pinned column with optional shear and shortening (Reissner), in closed form."""
    euler = beam.EI * (math.pi / beam.L) ** 2
    # P (1 + P (1/kGA - 1/EA)) = euler, from Reissner's linearised equations
    a = (1.0 / beam.kGA if shears else 0.0) - 1.0 / beam.EA
    return 2.0 * euler / (1.0 + math.sqrt(1.0 + 4.0 * a * euler))


def stretch_force(green: bool, stretch: float) -> float:
    """Return N/EA of a bar at a given stretch: Hooke's law, or St Venant-Kirchhoff's."""
    return 0.5 * (stretch**3 - stretch) if green else stretch - 1.0


def series_tip(parts: list[tuple[float, float, float]], P: float) -> float:
    """Return the tip deflection of a cantilever of pieces (length, EI, kGA) from wall to tip under a tip force."""
    out, rest = 0.0, sum(p[0] for p in parts)
    for length, EI, kGA in parts:
        # the moment falls from P rest to P (rest - length) along the piece
        after = rest - length
        out += P * (rest**3 - after**3) / (3.0 * EI) + P * length / kGA
        rest = after
    return out
