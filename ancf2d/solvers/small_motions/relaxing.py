"""Small motions of relaxing materials in a space of few vectors: a linear system with states of dashpots.

Each Maxwell term is a spring and a dashpot in series. With q the motion and z the displacement of the dashpot,

    M q'' + C q' + K q + sum_i g_i V (q - z_i) = f,    z_i' = (q - z_i)/tau_i,

V is the stiffness of the material at its long-time modulus; rates of the loads are not needed. V = L L^T has the rank
of the strains that the motions cause in that material, and each term has as many states of dashpots, L^T z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...elements.shape import Array
from ..resolution import VIBRATES
from .factors import Factors
from .projected import Complex, Quadratic, Space, within_constraints

# share of the largest eigenvalue of M below which a motion is massless; of the largest strain energy below which a
# vector is not strained, and of that of similarly strained vectors below which a combination of them is not
MASSLESS, UNSTRAINED, APART = 1e-13, 1e-15, 1e-12
# Newton's method for one eigenvalue: most iterations, last change, and change above which it has not converged
MAX_ITERATIONS, SAME, ROUGH = 30, 1e-12, 1e-8
# smaller changes that stop decreasing are round-off of the stiffness, which is large in slender bodies
STALLED = 1e-6
# share of an eigenvalue below which its imaginary part is round-off
REAL = 1e-9
# relative difference of equal eigenvalues, and deviation of their vectors from being parallel
ALIKE, PARALLEL = 1e-9, 1e-6


@dataclass
class Term:
    """One Maxwell term in a space: modulus and time [s], L (k, rank), and the number of its material."""

    modulus: float
    time: float
    L: Array
    material: int


def terms_of(material: int, terms: tuple[tuple[float, float], ...], V: Array) -> list[Term]:
    """Return the terms of a material whose stiffness in a space is V (k, k).

    The vectors are scaled first, because their strains may differ very much, as in bending and stretching a slender
    body.
    """
    size = np.diag(V)
    size = np.sqrt(np.where(size > UNSTRAINED * size.max(initial=0.0), size, 0.0))
    scale = 1.0 / np.where(size > 0.0, size, np.inf)
    w, U = np.linalg.eigh(scale[:, None] * 0.5 * (V + V.T) * scale)
    some = w > APART * w.max(initial=0.0)
    L = size[:, None] * U[:, some] * np.sqrt(w[some])
    return [Term(g, tau, L, material) for g, tau in terms]


def system_matrix(K: Array, C: Array, terms: Sequence[Term]) -> Array:
    """Return the matrix (states, states) of x' = A x: x is q (m,) of unit mass, q', and the dashpots of each term."""
    m, size = len(K), 2 * len(K) + sum(term.L.shape[1] for term in terms)
    A, at = np.zeros((size, size)), 2 * m
    A[:m, m:2 * m], A[m:2 * m, :m], A[m:2 * m, m:2 * m] = np.eye(m), -K, -C
    for term in terms:
        own = slice(at, at + term.L.shape[1])
        A[m:2 * m, :m] -= term.modulus * (term.L @ term.L.T)
        A[m:2 * m, own] = term.modulus * term.L
        A[own, :m], A[own, own] = term.L.T / term.time, -np.eye(term.L.shape[1]) / term.time
        at = own.stop
    return A


def with_dashpots(matrices: Array, terms: Sequence[Term]) -> Array:
    """Return K, C and M (3, k + dashpots, k + dashpots) of q and the dashpots of each term, which have no mass."""
    k = matrices.shape[1]
    at, size = k, k + sum(term.L.shape[1] for term in terms)
    out = np.zeros((3, size, size))
    out[:, :k, :k] = matrices
    for term in terms:
        own, one = slice(at, at + term.L.shape[1]), np.eye(term.L.shape[1])
        out[0, :k, :k] += term.modulus * (term.L @ term.L.T)
        out[0, :k, own], out[0, own, :k] = -term.modulus * term.L, -term.modulus * term.L.T
        out[0, own, own], out[1, own, own] = term.modulus * one, term.modulus * term.time * one
        at = own.stop
    return out


class Projected:
    """Small motions q in the space of vectors W (k, n), of unit mass: q'' + C q' + K q and the dashpots.

    A vector is left out if less than ``share`` of it is new. The states are q, q', and the dashpots of each term.
    """

    def __init__(self, problem: Quadratic, vectors: Sequence[Array], share: float = 0.0) -> None:
        self.problem, self.space = problem, Space(problem, within_constraints(problem))
        for x in vectors:
            count = self.space.count
            if self.space.add(x)[1] < share * problem.size(x):
                self.space.count = count
        K, C, M = self.space.project()
        T = self._unit_mass(K, M)
        self.W = T.T @ self.space.V
        self.K, self.C = T.T @ K @ T, T.T @ C @ T
        self.terms = []
        for k, one in enumerate(problem.small.relaxing):
            VW = np.array([one.stiffness(x) for x in self.W]).reshape(-1, problem.n)
            self.terms += terms_of(k, one.terms, self.W @ VW.T)

    @staticmethod
    def _unit_mass(K: Array, M: Array) -> Array:
        """Return combinations (k, m) of unit mass of the motions with mass: modes if K is symmetric."""
        scale = 1.0 / np.sqrt(np.maximum(np.diag(M), MASSLESS * np.diag(M).max(initial=0.0)))
        w, U = np.linalg.eigh(scale[:, None] * 0.5 * (M + M.T) * scale)
        heavy = w > MASSLESS * w.max(initial=0.0)
        T = scale[:, None] * U[:, heavy] / np.sqrt(w[heavy])
        found = T.T @ K @ T
        return np.asarray(T @ np.linalg.eigh(0.5 * (found + found.T))[1])

    @cached_property
    def A(self) -> Array:
        """The matrix (states, states) of x' = A x."""
        return system_matrix(self.K, self.C, self.terms)

    @property
    def states(self) -> list[str]:
        """The names of the states: q, q', and d of the dashpots, with terms numbered over all materials."""
        m = len(self.W)
        return [f"q{k}{rate}" for rate in ("", "'") for k in range(1, m + 1)] + [
            f"d{i}.{k}" for i, term in enumerate(self.terms, start=1) for k in range(1, term.L.shape[1] + 1)]

    def pairs(self) -> tuple[Complex, Complex]:
        """Return the eigenvalues s (m,) with Im s >= 0, lowest abs(s) first, and their vectors (m, n)."""
        s, X = np.linalg.eig(self.A)
        upper = np.flatnonzero(s.imag >= 0.0)
        upper = upper[np.argsort(np.abs(s[upper]), kind="stable")]
        return s[upper].astype(complex), (X[:len(self.W), upper].T @ self.W).astype(complex)


def corrected(problem: Quadratic, s: complex, x: Complex) -> tuple[complex, Complex, float]:
    """Return an eigenvalue and its vector by Newton's method, and its last relative change.

    T(s) x = 0 is not a polynomial in s. Each iteration replaces x by T(s)^-1 T'(s) x, and s by s less the ratio of
    their sizes (Ruhe 1973). A real eigenvalue stays real.
    """
    weights, gap = problem.weights**2, 1.0
    for _ in range(MAX_ITERATIONS):
        try:
            factors = Factors(problem.matrix(s if s.imag else s.real))
        except ZeroDivisionError:
            # s is -1/tau of a term, where the stiffness is infinite
            return s, x, 1.0
        u = factors.solve(problem.slope(s, x) if s.imag else problem.slope(s, x).real)
        if factors.singular or not np.isfinite(u).all() or not u.any():
            break
        step = complex(x.conj() @ (weights * x)) / complex(x.conj() @ (weights * u))
        x = np.asarray(u / problem.size(np.abs(u)), dtype=complex)
        last, s, gap = gap, s - step, abs(step) / abs(s - step)
        if gap <= SAME or last <= gap <= STALLED:
            return s, x, gap
    return s, x, gap if gap <= ROUGH else 1.0


@dataclass
class RelaxingPairs:
    """Eigenvalues s (m,) with Im s >= 0, vectors (m, n), last relative changes (m,), and the number not found."""

    s: Complex
    vectors: Complex
    gaps: Array
    lost: int


def relaxing_pairs(problem: Quadratic, vectors: Sequence[Array], number: int) -> RelaxingPairs:
    """Return ``number`` vibrations, and all other eigenvalues for which the space of ``vectors`` (k, n) has starts.

    The others are real, or pairs that hardly vibrate: relaxations of slender bodies lie so close together that loads
    without a potential, and round-off in the starts, turn some into pairs.
    """
    s, X = Projected(problem, vectors).pairs()
    vibrates = s.imag > VIBRATES * np.abs(s)
    kept: list[tuple[complex, Complex, float]] = []
    tried = 0
    for k in [*np.flatnonzero(vibrates), *np.flatnonzero(~vibrates)]:
        if vibrates[k] and len(kept) == number:
            continue
        tried += 1
        one, x, gap = corrected(problem, s[k] if s[k].imag > REAL * abs(s[k]) else complex(s[k].real), X[k])
        if 0.0 < abs(one.imag) <= REAL * abs(one):
            one, x, gap = corrected(problem, complex(one.real), x.real.astype(complex))
        sound = gap <= STALLED and one.imag >= 0.0 and (one.imag > VIBRATES * abs(one)) == vibrates[k]
        if sound and not any(_same(problem, (one, x), other) for other in kept):
            kept.append((one, x, gap))
    return RelaxingPairs(np.array([one for one, _, _ in kept], dtype=complex),
                         np.array([x for _, x, _ in kept], dtype=complex).reshape(-1, problem.n),
                         np.array([gap for _, _, gap in kept]), tried - len(kept))


def _same(problem: Quadratic, one: tuple[complex, Complex], other: tuple[complex, Complex, float]) -> bool:
    """Return whether two eigenvalues with their vectors of unit size are the same."""
    w = problem.weights**2
    along = abs(complex(one[1].conj() @ (w * other[1])))
    return abs(one[0] - other[0]) <= ALIKE * abs(one[0]) and abs(along - 1.0) <= PARALLEL
