"""Onsets of growing small motions, located to round-off: eigenvalue, factor, and both null vectors.

T(s, mu) = K + dK(mu) + s (C + mu dC) + s^2 M is singular there. With borders b and c, [T, b; c^T, 0] [x; f] = [0; 1]
and its transpose define a function f(s, mu) that is 0 where T is singular, with f' = -y^T T' x (Griewank & Reddien,
SIAM Journal on Numerical Analysis 21, 1984).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..small_motions.changes import Change
from ..small_motions.factors import Factors
from ..small_motions.projected import Complex, Quadratic
from .differences import UnsuitedError
from .small_motions import BESIDE, ITERATIONS

if TYPE_CHECKING:
    from scipy.sparse import csc_array

# Newton's method for a critical factor: most iterations, last relative change, change below which round-off (large in
# slender bodies) may stop the decrease, and largest relative distance
NEWTON, SETTLED, STALLED, NEAR = 20, 1e-11, 1e-6, 1e-4
# if the second of two near null vectors is at least this large relative to the first, there are two
TWO = 0.1
OTHERWISE = "several motions begin to grow at the factor, or not from s = 0, a frequency, or two that meet"


def times(change: Change, s: complex, mu: float, x: Complex) -> Complex:
    """Return the contribution of a factor mu to T at s, times x (n,)."""
    out, load = np.zeros(len(x), dtype=complex), change.stiffness(mu)
    if load is not None:
        out += load @ x
    return out if change.gyration is None else out + s * mu * (change.gyration @ x)


@dataclass(frozen=True)
class Onset:
    """A factor at which motions begin to grow, s [1/s] there, vectors with T x = 0 and y^T T = 0 (n,).

    ``by`` (2,) are y^T dT/ds x and y^T dT/dmu x; the first is 0 where two eigenvalues meet (``meets``).
    """

    factor: float
    s: complex
    x: Complex
    y: Complex
    by: Complex
    meets: bool

    def rate(self, by_p: complex) -> float:
        """Return dmu/dp from y^T dT/dp x.

        s stays 0 in divergence, and imaginary in flutter unless two eigenvalues meet.
        """
        by_s, by_mu = self.by
        if self.meets or not self.s:
            return float((-by_p / by_mu).real)
        return float(-(by_p / by_s).real / (by_mu / by_s).real)


class Singular:
    """Finds where T(s, mu), of a problem and the contribution of a factor, is singular near a critical factor."""

    def __init__(self, problem: Quadratic, adds: Change) -> None:
        self.problem, self.adds = problem, adds
        rates = problem.small.rates
        # without dissipation or supply of energy, motions begin to grow where two frequencies meet
        self.damped = bool(rates.damps or adds.damps or problem.relaxing)

    def matrix(self, s: complex, mu: float) -> csc_array:
        """Return T (n, n), real for real s."""
        T = self.problem.matrix(s if s.imag else s.real)
        load = self.adds.stiffness(mu)
        T = T if load is None else T + load
        return (T if self.adds.gyration is None or not s else T + s * mu * self.adds.gyration).tocsc()

    def by_s(self, s: complex, mu: float, x: Complex) -> Complex:
        """Return dT/ds x (n,)."""
        out = self.problem.slope(s, x)
        return out if self.adds.gyration is None else out + mu * (self.adds.gyration @ x)

    def by_mu(self, s: complex, mu: float, x: Complex) -> Complex:
        """Return dT/dmu x (n,)."""
        out = np.zeros(len(x), dtype=complex)
        for factor, A in ((1.0, self.adds.rate), (2.0 * mu, self.adds.square), (s, self.adds.gyration)):
            if A is not None:
                out += factor * (A @ x)
        return out

    def near(self, factor: float, omega: float) -> Onset:
        """Return the onset near a critical factor whose motion has the frequency omega [rad/s], 0 in divergence.

        Raises UnsuitedError if there is none of this kind, or several at once.
        """
        s, mu, meets = 1j * omega, factor, bool(omega) and not self.damped
        (c, b), gap = self._vectors(s, mu), np.inf
        for _ in range(NEWTON):
            at = _Bordered(self, s, mu, b, c)
            ds, dmu = at.to_meeting() if meets else at.to_axis()
            s, mu = 1j * (s + ds).imag, float((mu + dmu).real)
            if not np.isfinite([abs(s), mu]).all() or abs(mu - factor) > NEAR * abs(factor):
                break
            last, gap = gap, abs(dmu / mu) + (abs(ds / s) if s else 0.0)
            if gap <= SETTLED or last <= gap <= STALLED:
                at = _Bordered(self, s, mu, b, c)
                return Onset(mu, s, at.x, at.y, np.array([at.y @ at.T_s, at.y @ at.T_mu]), meets)
        raise UnsuitedError(OTHERWISE)

    def _vectors(self, s: complex, mu: float) -> tuple[Complex, Complex]:
        """Return start values for the conjugates of the right and the left null vector (n,)."""
        A = self.matrix(s * (1.0 + BESIDE), mu if s else mu * (1.0 + BESIDE))
        return self._vector(A).conj(), self._vector(A.T.tocsc()).conj()

    def _vector(self, A: csc_array) -> Complex:
        """Return the vector (n,) that a matrix nearly maps to 0. Raises UnsuitedError if there are two."""
        factors, moved = Factors(A), self.problem.is_coordinate
        weights = np.where(moved, self.problem.weights, 0.0)[:, None]
        X, sizes = np.random.default_rng(0).standard_normal((len(moved), 2)).astype(A.dtype), np.eye(2)
        for _ in range(ITERATIONS + 1):
            X = factors.solve(X)
            sizes = np.linalg.qr(weights * X)[1]
            X = np.linalg.solve(sizes.T, X.T).T
        if not np.isfinite(X).all() or abs(sizes[1, 1]) > TWO * abs(sizes[0, 0]):
            raise UnsuitedError(OTHERWISE)
        return np.asarray(X[:, 0], dtype=complex)


class _Bordered:
    """f, both vectors, and the derivatives of T along x at one s and mu."""

    def __init__(self, of: Singular, s: complex, mu: float, b: Complex, c: Complex) -> None:
        from scipy.sparse import block_array

        self.of, self.s, self.mu, T = of, s, mu, of.matrix(s, mu)
        size = float(abs(T).max())
        b, c = (size * (v if s else v.real) / np.linalg.norm(v) for v in (b, c))
        B = block_array([[T, b[:, None]], [c[None], None]], format="csc")
        self.factors, last = Factors(B), np.append(np.zeros(len(b)), size).astype(B.dtype)
        right, left = self.factors.solve(last), Factors(B.T.tocsc()).solve(last)
        self.x, self.f, self.y = right[:-1], complex(right[-1]) * size, left[:-1]
        self.T_s, self.T_mu = of.by_s(s, mu, self.x), of.by_mu(s, mu, self.x)
        self.f_s, self.f_mu = -complex(self.y @ self.T_s), -complex(self.y @ self.T_mu)

    def to_axis(self) -> tuple[complex, float]:
        """Return the Newton changes of s and mu towards f = 0 with an imaginary s; s = 0 stays 0."""
        if not self.s:
            return 0j, -(self.f / self.f_mu).real
        A = np.array([1j * self.f_s, self.f_mu])
        omega, mu = np.linalg.solve(np.array([A.real, A.imag]), [-self.f.real, -self.f.imag])
        return 1j * omega, float(mu)

    def to_meeting(self) -> tuple[complex, complex]:
        """Return the Newton changes of s and mu towards f = df/ds = 0, with x' = -[T'; 0] x by the bordered matrix."""
        of, gyration = self.of, self.of.adds.gyration
        x_s, x_mu = (self.factors.solve(np.append(-v, 0.0))[:-1] for v in (self.T_s, self.T_mu))
        f_ss = -complex(self.y @ (2.0 * (of.problem.M @ self.x) + 2.0 * of.by_s(self.s, self.mu, x_s)))
        both = of.by_mu(self.s, self.mu, x_s) + of.by_s(self.s, self.mu, x_mu)
        if gyration is not None:
            both = both + gyration @ self.x
        s, mu = np.linalg.solve([[self.f_s, self.f_mu], [f_ss, -complex(self.y @ both)]], [-self.f, -self.f_s])
        return complex(s), complex(mu)
