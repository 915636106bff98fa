"""The tool's own time integrators: their coefficients and arrays for the kernels."""

from __future__ import annotations

from collections.abc import Callable
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
from ..kernels.stage_sums import TILE
from .schemes import Integrator, spectral_radius

MAX_ITERATIONS = 12
# of Newton's increments, relative to the size of the motion
TIGHT = 1e-10
CONSERVING = 1e-18


Maker = Callable[[Dynamic, Problem, float], Any]


def cubic() -> Array:
    """Return the polynomials (3, 4) of x in [0, 1] that belong to h z'(0), z(1) - z(0) and h z'(1) (Hermite)."""
    return np.array([[0.0, 1.0, -2.0, 1.0], [0.0, 0.0, 3.0, -2.0], [0.0, 0.0, -1.0, 1.0]])


def by_rates(c: Array) -> Array:
    """Return the polynomials (s + 1, s + 2) of x that belong to h z'(0) and h z'(c_i).

    The rates of the stages and of the start determine the end: the quadrature of the stages is exact for them.
    """
    at = np.append(0.0, c)
    powers = np.arange(1, len(at) + 1)
    out = np.zeros((len(at), len(at) + 1))
    out[:, 1:] = np.linalg.inv(powers * at[:, None] ** (powers - 1.0)).T
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
    rho = spectral_radius(spec)
    return _newmark_family(p, tolerance, spec, 0.0, (1.0 - rho) / (1.0 + rho))


def _generalized_alpha(spec: Dynamic, p: Problem, tolerance: float) -> Newmark:
    rho = spectral_radius(spec)
    return _newmark_family(p, tolerance, spec, (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0))


def _energy_momentum(spec: Dynamic, p: Problem, tolerance: float) -> Conserving:
    n = len(p.weights)
    return Conserving(tolerance, spec.max_iterations or 4 * MAX_ITERATIONS, spec.newton == "full", 3,
                      cubic(), _end(n, 3), np.zeros(len(p.place)), np.zeros(n), np.zeros(n),
                      np.zeros(n), np.zeros((3, len(p.programs.first) - 1, 3)))


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


def radau(stages: int) -> Maker:
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
        n, matrix = len(p.coordinate), p.mass.shape
        rows, columns = [left[k].real], [right[:, k].real]
        for q in upper:
            rows += [left[q].real, left[q].imag]
            columns += [2.0 * right[:, q].real, -2.0 * right[:, q].imag]
        X, V, accelerations, R, kept = (np.zeros((stages, n)) for _ in range(5))
        cosine, sine, F, row = (np.zeros((stages, m)) for m in (len(p.pairs), len(p.pairs), stages, TILE))
        return Radau(c, W, float(values[k].real), values[upper], -np.array(rows), np.array(columns).T.copy(),
                     (W.T @ (embedded - A[-1]))[None], gamma, tolerance, spec.max_iterations or MAX_ITERATIONS,
                     spec.newton == "full", bool(p.tau.any()) or p.points is not None, stages + 1, by_rates(c),
                     np.flatnonzero(p.coordinate == 0.0), _end(n, stages + 1),
                     X, V, accelerations, R, kept, np.zeros(matrix),
                     np.zeros((len(upper), *matrix), dtype=complex), np.zeros(n),
                     np.zeros((len(upper), n), dtype=complex), np.zeros((stages, len(p.programs.first) - 1, 3)),
                     cosine, sine, np.zeros(3), np.zeros((2, len(p.pairs))), F, row)
    return make


# for every integrator that is not SciPy's: what makes its kernel tuple from the case, the problem and a tolerance
MAKERS: dict[str, Maker] = {
    "radau5": radau(3), "radau9": radau(5), "generalized_alpha": _generalized_alpha, "hht": _hht, "newmark": _newmark,
    "energy_momentum": _energy_momentum,
}


def make_method(name: str, spec: Dynamic, p: Problem, tolerance: float) -> Any:
    """Return the kernel tuple of an integrator; None where SciPy steps it."""
    return MAKERS[name](spec, p, tolerance) if name in MAKERS else None


def newton_tolerance(method: Integrator, tolerance: float) -> float:
    """Return how far Newton's increments are brought down, relative to the size of the motion."""
    if method.conserves:
        return CONSERVING
    return max(min(TIGHT, 1e-2 * tolerance), 1e-14) if tolerance else TIGHT
