"""Each time integrator by name: its coefficients and arrays for the kernels. A further one is one entry here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from ..case import Dynamic
from ..elements.shape import Array
from ..kernels.conserving import Conserving
from ..kernels.dynamics import Problem
from ..kernels.motion import Step
from ..kernels.newmark import Newmark
from ..kernels.radau import Radau

MAX_ITERATIONS = 12


@dataclass(frozen=True)
class Method:
    """An integrator: ``make(spec, problem, tolerance)`` returns its kernel tuple.

    ``order`` of its error at the end of a motion; ``rows`` that it keeps of earlier steps; ``source`` and ``doc``.
    """

    name: str
    make: Callable[[Dynamic, Problem, float], Any]
    order: int
    rows: int
    source: str
    doc: str
    damps: bool = True


def cubic() -> Array:
    """Return the polynomials (3, 4) of x in [0, 1] that belong to h z'(0), z(1) - z(0) and h z'(1) (Hermite)."""
    return np.array([[0.0, 1.0, -2.0, 1.0], [0.0, 0.0, 3.0, -2.0], [0.0, 0.0, -1.0, 1.0]])


def by_rates(c: Array) -> Array:
    """Return the polynomials (s + 2, s + 2) of x that belong to h z'(0), h z'(c_i), and, linear, to multipliers.

    The rates of the stages and of the start determine the end: the quadrature of the stages is exact for them.
    """
    at = np.append(0.0, c)
    powers = np.arange(1, len(at) + 1)
    coefficients = np.linalg.inv(powers * at[:, None] ** (powers - 1.0)).T
    out = np.zeros((len(at) + 1, len(at) + 1))
    out[:-1, 1:] = coefficients
    out[-1, 1] = 1.0
    return out


def _end(n: int, rows: int) -> Step:
    return Step(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((rows, n)))


def _newmark_family(p: Problem, tolerance: float, spec: Dynamic, am: float, af: float) -> Newmark:
    n, gamma = len(p.weights), 0.5 + af - am
    return Newmark(am, af, 0.25 * (gamma + 0.5) ** 2, gamma, tolerance, spec.max_iterations or MAX_ITERATIONS,
                   spec.newton == "full", 3, cubic(), _end(n, 3), np.zeros(n))


def _newmark(spec: Dynamic, p: Problem, tolerance: float) -> Newmark:
    return _newmark_family(p, tolerance, spec, 0.0, 0.0)


def _hht(spec: Dynamic, p: Problem, tolerance: float) -> Newmark:
    # spectral radius at infinity (1 - af)/(1 + af): 1/2 at the bound af = 1/3
    rho = 0.8 if spec.spectral_radius is None else spec.spectral_radius
    return _newmark_family(p, tolerance, spec, 0.0, (1.0 - rho) / (1.0 + rho))


def _generalized_alpha(spec: Dynamic, p: Problem, tolerance: float) -> Newmark:
    rho = 0.8 if spec.spectral_radius is None else spec.spectral_radius
    return _newmark_family(p, tolerance, spec, (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0))


def _energy_momentum(spec: Dynamic, p: Problem, tolerance: float) -> Conserving:
    n = len(p.weights)
    return Conserving(tolerance, spec.max_iterations or 4 * MAX_ITERATIONS, spec.newton == "full", 3,
                      cubic(), _end(n, 3), np.zeros(len(p.place)), np.zeros(n), np.zeros(n),
                      np.zeros(n), np.zeros((2, len(p.programs.first) - 1, 3)))


def radau_nodes(stages: int) -> Array:
    """Return the nodes c of Radau IIA: roots of P_s - P_(s-1) on [0, 1], the last one 1."""
    from numpy.polynomial import legendre

    roots = np.sort(legendre.legroots([0.0] * (stages - 1) + [-1.0, 1.0]).real)
    return np.append(0.5 * (roots[:-1] + 1.0), 1.0)


def collocation(c: Array) -> Array:
    """Return A (s, s): A[i, j] = int_0^c_i of the Lagrange polynomial j on the nodes c."""
    out = np.zeros((len(c), len(c)))
    for j in range(len(c)):
        others = np.delete(c, j)
        lagrange = polynomial.polyfromroots(others) / np.prod(c[j] - others)
        out[:, j] = polynomial.polyval(c, polynomial.polyint(lagrange))
    return out


def radau(stages: int) -> Callable[[Dynamic, Problem, float], Radau]:
    """Return what makes Radau IIA with an odd number of stages."""
    def make(spec: Dynamic, p: Problem, tolerance: float) -> Radau:
        c = radau_nodes(stages)
        A = collocation(c)
        W = np.linalg.inv(A)
        values, right = np.linalg.eig(W)
        left = np.linalg.inv(right)
        k = int(np.argmin(np.abs(values.imag)))
        upper = np.flatnonzero(values.imag > 1e-9)
        gamma = 1.0 / float(values[k].real)
        # weights b of the embedded formula: order s with gamma f(y_0) among them
        powers = np.arange(stages)
        embedded = np.linalg.solve(c[None, :] ** powers[:, None], 1.0 / (powers + 1.0) - gamma * (powers == 0))
        n, width = p.mass.shape
        scale = right[0, k].real
        return Radau(c, W, float(values[k].real), np.ascontiguousarray(left[k].real * scale),
                     np.ascontiguousarray(right[:, k].real / scale), values[upper], np.ascontiguousarray(left[upper]),
                     np.ascontiguousarray(right[:, upper].T), W.T @ (embedded - A[-1]), gamma, A[-1].copy(), tolerance,
                     spec.max_iterations or MAX_ITERATIONS, bool(p.tau.any()) or p.points is not None, stages + 1,
                     by_rates(c), _end(n, stages + 2), *(np.zeros((stages, n)) for _ in range(4)),
                     np.zeros((n, width)), np.zeros((len(upper), n, width), dtype=complex), np.zeros(n),
                     np.zeros((len(upper), n), dtype=complex), np.zeros((stages, len(p.programs.first) - 1, 3)),
                     np.zeros((stages, len(p.pairs))), np.zeros((stages, len(p.pairs))))
    return make


def _by_scipy(spec: Dynamic, p: Problem, tolerance: float) -> None:
    """Return nothing: solve.ode steps these."""


_LIST = (
    Method("radau5", radau(3), 5, 3, "Hairer, Lubich & Roche 1989",
           "Radau IIA, three stages: order 5, damps what steps cannot resolve"),
    Method("radau9", radau(5), 9, 5, "Hairer, Lubich & Roche 1989",
           "Radau IIA, five stages: order 9, for smooth motion to tight tolerances"),
    Method("generalized_alpha", _generalized_alpha, 2, 1, "Chung & Hulbert 1993; Arnold & Bruls 2007",
           "second order, damping at infinity chosen by spectral_radius (default 0.8)"),
    Method("hht", _hht, 2, 1, "Hilber, Hughes & Taylor 1977",
           "second order, damping at infinity chosen by spectral_radius from 0.5 to 1 (default 0.8)"),
    Method("newmark", _newmark, 2, 1, "Newmark 1959", "average acceleration: second order, no damping", damps=False),
    Method("energy_momentum", _energy_momentum, 2, 0, "Simo & Tarnow 1992; Gonzalez 2000",
           "second order, keeps energy and momentum exactly", damps=False),
    Method("RK45", _by_scipy, 5, 0, "Dormand & Prince 1980", "SciPy's explicit pair 5(4), known as ode45"),
    Method("DOP853", _by_scipy, 8, 0, "Hairer, Norsett & Wanner 1993", "SciPy's explicit method of order 8"),
    Method("Radau", _by_scipy, 5, 0, "Hairer & Wanner 1996", "SciPy's Radau IIA of order 5, with dense matrices"),
    Method("BDF", _by_scipy, 5, 0, "Shampine & Reichelt 1997", "SciPy's BDF of orders 1 to 5, without multipliers"),
    Method("LSODA", _by_scipy, 5, 0, "Petzold 1983", "SciPy's switch between Adams and BDF, without multipliers"),
)
METHODS: dict[str, Method] = {m.name: m for m in _LIST}
DEFAULT = "radau5"
