"""Exact frequencies and buckling loads that ``cases/`` expects, from transcendental equations, no finite elements."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import det
from scipy.optimize import brentq


def roots(f: Callable[[float], float], low: float, high: float, count: int, steps: int = 4000) -> list[float]:
    """Return the first sign changes of f between low and high that are not poles."""
    x = np.linspace(low, high, steps)
    y = np.array([f(v) for v in x])
    found = []
    for a, b, fa, fb in zip(x[:-1], x[1:], y[:-1], y[1:], strict=True):
        if fa * fb < 0:
            r = brentq(f, a, b, xtol=1e-13 * high, rtol=1e-14)
            # at a pole f grows towards the root, at a zero it falls
            if abs(f(r)) < min(abs(fa), abs(fb)):
                found.append(r)
    return found[:count]


def free_free(length: float, EI: float, rhoA: float, count: int = 3) -> list[float]:
    """Return the elastic frequencies [rad/s] of a free Euler-Bernoulli beam: cos b cosh b = 1."""
    b = roots(lambda x: math.cos(x) - 1 / math.cosh(x), 1.0, 4.0 * (count + 1), count)
    return [(x / length) ** 2 * math.sqrt(EI / rhoA) for x in b]


def stretched(length: float, EI: float, rhoA: float, N: float, m: int) -> float:
    """Return frequency m [rad/s] of a simply supported Euler-Bernoulli beam under the axial force N."""
    k = m * math.pi / length
    return k * math.sqrt((EI * k * k + N) / rhoA)


def dynamic_stiffness(length: float, EA: float, EI: float, rhoA: float, omega: float) -> np.ndarray:
    """Return the exact (6, 6) stiffness of a harmonic bar and Euler-Bernoulli beam: u, w, theta at both ends."""
    a = omega * math.sqrt(rhoA / EA) * length
    b = math.sqrt(omega) * (rhoA / EI) ** 0.25 * length
    s, c, S, C = math.sin(b), math.cos(b), math.sinh(b), math.cosh(b)
    d = EI / length**3 / (1 - c * C)
    F1, F2 = b**3 * (s * C + c * S) * d, b**3 * (s + S) * d
    F3, F4 = b**2 * s * S * length * d, b**2 * (C - c) * length * d
    F5, F6 = b * (s * C - c * S) * length**2 * d, b * (S - s) * length**2 * d
    A1, A2 = EA / length * a / math.tan(a), EA / length * a / math.sin(a)
    K = np.zeros((6, 6))
    K[0, 0] = K[3, 3] = A1
    K[0, 3] = K[3, 0] = -A2
    K[1, 1] = K[4, 4] = F1
    K[1, 4] = K[4, 1] = -F2
    K[1, 2] = K[2, 1] = F3
    K[4, 5] = K[5, 4] = -F3
    K[1, 5] = K[5, 1] = F4
    K[2, 4] = K[4, 2] = -F4
    K[2, 2] = K[5, 5] = F5
    K[2, 5] = K[5, 2] = F6
    return K


def frame(nodes: Sequence[tuple[float, float]], members: Sequence[tuple[int, int]], clamped: Sequence[int], EA: float,
          EI: float, rhoA: float, low: float, high: float, count: int) -> list[float]:
    """Return frequencies [rad/s] between low and high of a plane frame of Euler-Bernoulli members, welded."""
    free = [3 * n + k for n in range(len(nodes)) if n not in clamped for k in range(3)]

    def determinant(omega: float) -> float:
        K = np.zeros((3 * len(nodes), 3 * len(nodes)))
        for i, j in members:
            d = np.subtract(nodes[j], nodes[i])
            length = float(np.hypot(*d))
            c, s = d / length
            R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            T = np.kron(np.eye(2), R)
            dofs = [*range(3 * i, 3 * i + 3), *range(3 * j, 3 * j + 3)]
            K[np.ix_(dofs, dofs)] += T.T @ dynamic_stiffness(length, EA, EI, rhoA, omega) @ T
        return float(det(K[np.ix_(free, free)] / EI))

    return roots(determinant, low, high, count)


def euler(EI: float, length: float, ends: str) -> float:
    """Return the first buckling load: 'pinned', 'cantilever', 'propped' (clamped and pinned) or 'clamped'."""
    propped = brentq(lambda x: math.tan(x) - x, 4.4, 4.6, xtol=1e-15, rtol=8.9e-16) / math.pi
    factor = {"pinned": 1.0, "cantilever": 0.5, "propped": propped, "clamped": 2.0}[ends]
    return EI * (factor * math.pi / length) ** 2
