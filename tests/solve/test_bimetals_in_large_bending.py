"""Bimetal strips in large bending: solutions of an exact rod, and of the section of a continuum element."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import newton, root

import ancf2d

L, WIDTH = 0.1, 0.01
# height, E, nu and alpha from below to above
METALS = [(0.5e-3, 7e10, 0.2, 2.5e-5), (1.5e-3, 2.1e11, 0.3, 1e-5)]
Array = Any


def strip(element: dict[str, Any], T: float, axis: float, loads: list[dict[str, Any]]
          ) -> dict[str, Any]:
    """Return the probes of a heated strip that is clamped at its start."""
    layers = [{"height": h, "material": {"E": E, "nu": nu, "alpha": alpha}} for h, E, nu, alpha in METALS]
    return ancf2d.solve({
        "bodies": {"strip": {"geometry": {"type": "line", "start": [0, 0], "end": [L, 0]}, "element": element,
                             "section": {"width": WIDTH, "layers": layers, "axis": axis}}},
        "boundary_conditions": [{"type": "clamp", "at": "strip@0"}],
        "loads": [{"type": "temperature", "on": "strip", "value": T}, *loads],
        "solver": {"type": "static", "steps": 10},
        "output": {"probes": {"tip": "strip@1", "a": "strip@0.4", "b": "strip@0.6"}}}, states=False).summary["probes"]


def of_layers(axis: float, value: Callable[[float, float], float], n: int) -> float:
    """Return int value(E, alpha) y^n dA, y from the axis."""
    faces = np.cumsum([0.0, *(m[0] for m in METALS)]) - axis
    return WIDTH * sum(value(E, alpha) * (b ** (n + 1) - a ** (n + 1)) / (n + 1)
                       for a, b, (_, E, _, alpha) in zip(faces, faces[1:], METALS, strict=False))


def shear_stiffness(axis: float) -> float:
    """Return kGA from the energy of the shear stress that balances how the axial stress grows under Q = 1."""
    EA, ES, EI = (of_layers(axis, lambda E, alpha: E, n) for n in range(3))
    e, k = np.linalg.solve([[EA, -ES], [-ES, EI]], [0.0, -1.0])
    y, flow, compliance = -axis, 0.0, 0.0
    points, weights = np.polynomial.legendre.leggauss(3)
    for h, E, nu, _ in METALS:
        up = 0.5 * h * (1.0 + points)
        tau = flow - E * (e * up - 0.5 * k * ((y + up) ** 2 - y**2))
        compliance += 0.5 * h * WIDTH * float(weights @ tau**2) / (E / (2 + 2 * nu))
        flow -= E * (e * h - 0.5 * k * ((y + h) ** 2 - y**2))
        y += h
    assert abs(flow) < 1e-9 * np.abs(tau).max()
    return 1.0 / compliance


def rod(T: float, axis: float, F: Array, couple: float) -> Array:
    """Return x, y, theta of the tip of a geometrically exact rod (Reissner 1972) by shooting.

    N = EA (e - a) - ES (k - c) and M = EI (k - c) - ES (e - a), with what heat alone would make of e and k.
    """
    EA, ES, EI = (of_layers(axis, lambda E, alpha: E, n) for n in range(3))
    heat = [of_layers(axis, lambda E, alpha: E * alpha * T, n) for n in range(2)]
    C, kGA = np.linalg.inv([[EA, -ES], [-ES, EI]]), shear_stiffness(axis)

    def rates(_: float, z: Array) -> Array:
        t, n = np.array([np.cos(z[2]), np.sin(z[2])]), np.array([-np.sin(z[2]), np.cos(z[2])])
        e, k = C @ [F @ t + heat[0], z[3] - heat[1]]
        dr = (1.0 + e) * t + F @ n / kGA * n
        return [*dr, k, F[0] * dr[1] - F[1] * dr[0]]

    def end(M0: float) -> Array:
        return solve_ivp(rates, (0, L), [0, 0, 0, M0], "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]

    scale = L * float(np.hypot(*F)) + abs(couple)
    M0 = newton(lambda m: (end(m * scale)[3] - couple) / scale, 0.0, x1=0.1, tol=1e-12)
    return end(M0 * scale)[:3]


@pytest.mark.parametrize("axis", [1e-3, 0.0])
def test_a_bimetal_rod_is_that_of_reissner(axis: float) -> None:
    """It bends by 1.6 rad, under an opposing force and couple."""
    T, F, couple = -3000.0, np.array([-4.0, -20.0]), 0.4
    loads = [{"type": "force", "at": "strip@1", "value": F.tolist()}, {"type": "moment", "at": "strip@1",
                                                                      "value": couple}]
    tip, exact = strip({"type": "reissner3", "count": 32}, T, axis, loads)["tip"], rod(T, axis, F, couple)
    np.testing.assert_allclose([tip["x"] / L, tip["y"] / L, tip["theta"]], exact / [L, L, 1], atol=1e-6)


def section(T: float, axis: float) -> float:
    """Return the curvature of a bimetal plane continuum far from the ends, at its least energy.

    All sections are alike there, straight by symmetry: r = c(x) + f(y) n(x) with f a cubic, the axis stretched by 1 + e
    and bent by k. Green's strains are ((1 + e - k f)^2 - 1)/2 and (f'^2 - 1)/2, less those of heat. What each layer
    strains across beyond a quadratic over the whole section is its own, and at no cost to the others (Simo & Rifai).
    """
    faces = np.cumsum([0.0, *(m[0] for m in METALS)]) - axis
    points, weights = np.polynomial.legendre.leggauss(6)
    y = np.concatenate([0.5 * (a + b) + 0.5 * (b - a) * points for a, b in pairwise(faces)])
    w = np.concatenate([0.5 * (b - a) * weights for a, b in pairwise(faces)])
    E, nu, stretch = (np.repeat(v, 6) for v in zip(*((E, nu, alpha * T) for _, E, nu, alpha in METALS), strict=True))
    h, free = float(faces[-1] - faces[0]), stretch + 0.5 * stretch**2
    powers = (y / h)[:, None] ** np.arange(3)
    own = np.concatenate([powers * (np.arange(12) // 6 == k)[:, None] for k in range(2)], axis=1)
    own -= powers @ np.linalg.solve(powers.T @ (w[:, None] * powers), powers.T @ (w[:, None] * own))
    own = own @ np.linalg.svd(np.sqrt(w)[:, None] * own)[2][:3].T
    D = E / (1.0 - nu**2)

    def energy(p: Array) -> Array:
        f, slope = (p[2] * y + p[3] * y**2 / h + p[4] * y**3 / h**2,
                    p[2] + 2 * p[3] * y / h + 3 * p[4] * y**2 / h**2)
        along = 0.5 * ((1.0 + p[0] - p[1] / h * f) ** 2 - 1.0) - free
        across = 0.5 * (slope**2 - 1.0) - free
        across = across - own @ np.linalg.solve(own.T @ ((w * D)[:, None] * own),
                                                own.T @ (w * D * (across + nu * along)))
        return (w * D) @ (along**2 + across**2 + 2 * nu * along * across)

    def slopes(p: Array) -> Array:
        return np.array([energy(p + 1e-30j * e).imag / 1e-30 for e in np.eye(5)]) / (D[0] * h)

    found = root(slopes, [0.0, 0.0, 1.0, 0.0, 0.0], tol=1e-15)
    assert np.abs(slopes(found.x)).max() < 1e-13
    return float(found.x[1] / h)


@pytest.mark.slow
def test_a_bimetal_continuum_bends_as_its_section_far_from_the_ends() -> None:
    T, axis = 1500.0, 0.8e-3
    found = strip({"type": "ancf", "order": [3, 3], "count": 80, "formulation": "continuum"}, T, axis, [])
    bent = (found["b"]["theta"] - found["a"]["theta"]) / (0.2 * L)
    EA, ES, EI = (of_layers(axis, lambda E, alpha: E, n) for n in range(3))
    heat = [of_layers(axis, lambda E, alpha: E * alpha * T, n) for n in range(2)]
    small = np.linalg.solve([[EA, -ES], [-ES, EI]], [heat[0], -heat[1]])[1]
    assert bent == pytest.approx(section(T, axis), rel=1e-6)
    # which a section of small strains does not
    assert abs(bent / small - 1.0) > 5e-4
