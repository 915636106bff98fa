"""K + s C + s^2 M of small motions, and its projection on a space of few vectors."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...elements.shape import Array
from ...errors import ComputationError
from ...model.mesh import Index
from ..linear import make_matrix
from .factors import Factors, SymmetricFactors
from .inputs_and_outputs import Input
from .linearised import Linearised

if TYPE_CHECKING:
    from scipy.sparse import csc_array

Complex = NDArray[np.complex128]
# number of vectors projected at a time
BLOCK = 16
# relative M/K below which a motion counts as massless, and the largest number of shifts tried
MASSLESS, MOST_SHIFTS = 1e-12, 60


class Quadratic:
    """K + s C + s^2 M of small motions, with or without dissipation.

    ``relaxes`` adds the contribution of relaxing materials to K, which is not a polynomial in s; ``load`` (n, n) is
    added to K, ``rates`` (n, n) to C.
    """

    def __init__(self, small: Linearised, damped: bool = True, load: csc_array | None = None,
                 rates: csc_array | None = None, relaxes: bool = False) -> None:
        C, self.load = small.C if damped else small.coriolis, load
        C = C if rates is None else (C + rates).tocsc()
        K = small.K if load is None else (small.K + load).tocsc()
        self.small, self.K, self.C, self.M, self.damped = small, K, C, small.M, damped
        self.relaxing = small.relaxing if relaxes else []
        self.n = small.n
        num, weights = small.model.numbering, small.pencil.system.weights
        self.weights, self.is_coordinate = weights, num.free < num.n_q
        self.K_skew = None if small.model.symmetric and load is None else (self.K - self.K.T).tocsc()
        self.C_skew = (C - C.T).tocsc() if small.rates.gyrates else None
        self._assembled_damping = small.external_damping + small.coriolis if damped else small.coriolis
        if rates is not None:
            self._assembled_damping = (self._assembled_damping + rates).tocsc()

    def matrix(self, s: complex) -> csc_array:
        """Return K + s C + s^2 M."""
        out = self.K + s * self.C + (s * s) * self.M
        for one in self.relaxing:
            out = out + one.factor(s) * one.V
        return out.tocsc()

    def slope(self, s: complex, x: Complex) -> Complex:
        """Return the derivative of ``matrix`` by s, times x (n,)."""
        out = self.C @ x + 2.0 * s * (self.M @ x)
        for one in self.relaxing:
            out = out + one.slope(s) * (one.V @ x)
        return np.asarray(out)

    def relaxed(self, s: complex, x: Complex) -> Complex:
        """Return the contribution of relaxing materials to K x (n,), computed through the strains."""
        out = np.zeros(len(x), dtype=complex)
        for one in self.relaxing:
            real, imag = (one.stiffness(np.ascontiguousarray(part)) for part in (x.real, x.imag))
            out += one.factor(s) * (real + 1j * imag)
        return out

    def action(self, s: complex, x: Complex) -> Complex:
        """Return the matrix at s times x (n,), computed through the strains."""
        real, imag = np.ascontiguousarray(x.real), np.ascontiguousarray(x.imag)
        K, C, M = (act(real) + 1j * act(imag) for act in (self.stiffness, self.damping, self.mass))
        return np.asarray(K + s * C + s * s * M + self.relaxed(s, x))

    def force(self, one: Input, s: complex) -> Complex:
        """Return the forces of a unit of an input at s (n,)."""
        out = np.asarray(one.f[0] + s * one.f[1] + s * s * one.f[2], dtype=complex)
        for material, force in zip(self.relaxing, one.relaxing if self.relaxing else (), strict=True):
            out += material.factor(s) * force
        return out

    def factors(self, s: float) -> Factors | SymmetricFactors:
        """Return the factors of K + s C + s^2 M, symmetric ones if possible."""
        A = self.matrix(s)
        if self.K_skew is None and self.C_skew is None:
            found = SymmetricFactors(A, make_matrix(self.small.model))
            if not found.singular:
                return found
        return Factors(A)

    def stiffness(self, x: Array) -> Array:
        """Return K x, computed through the strains."""
        out = self.small.stiffness(x)
        return out if self.load is None else out + self.load @ x

    def damping(self, x: Array) -> Array:
        """Return C x, with Kelvin-Voigt damping computed through the strains."""
        out = self._assembled_damping @ x
        return out + self.small.viscous_forces(x) if self.damped else out

    def mass(self, x: Array) -> Array:
        """Return M x."""
        return np.asarray(self.M @ x)

    def phases(self, x: Complex) -> tuple[Array, Array]:
        """Return the real shapes (n,) of x at the phase of largest kinetic energy and a quarter of a period later.

        x^T M x of the first is 1.
        """
        a, b, c = (float(u @ self.mass(v)) for u, v in ((x.real, x.real), (x.imag, x.imag), (x.real, x.imag)))
        turned = x * np.exp(0.5j * math.atan2(-2 * c, a - b))
        size = math.sqrt(float(turned.real @ self.mass(turned.real))) or 1.0
        return turned.real / size, -turned.imag / size

    def size(self, x: Array) -> float:
        """Return the size of a vector as a displacement."""
        return float(np.linalg.norm(self.weights * x))


class Space:
    """Vectors (k, n), orthonormal as displacements, with K, C and M projected on them.

    ``within`` may project new vectors on a subspace, in which they then stay to round-off.
    """

    def __init__(self, problem: Quadratic, within: Callable[[Array], Array] | None = None) -> None:
        self.problem, self.count, self.within = problem, 0, within
        self._rows = np.empty((16, problem.n))
        self._projected = np.zeros((3, 0, 0))

    @property
    def V(self) -> Array:
        """The vectors (k, n)."""
        return self._rows[:self.count]

    def add(self, x: Array) -> tuple[Array, float]:
        """Add the new part of x; return its components (k,) along the existing vectors and the size of the new part."""
        w2, size, V = self.problem.weights**2, self.problem.size(x), self.V
        along = np.zeros(len(V))
        for _ in range(2):
            part = V @ (w2 * x)
            x = x - part @ V
            along += part
            if self.within is not None:
                x = self.within(x)
        new = self.problem.size(x)
        if not new > 1e-12 * size:
            return along, 0.0
        if self.count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self.count] = x / new
        self.count += 1
        return along, new

    def combined(self, y: Complex) -> Complex:
        """Return the combination (n,) of the first vectors with complex factors (k,)."""
        V = self.V[:len(y)]
        return np.asarray(y.real @ V + 1j * (y.imag @ V))

    def diagonalise(self) -> None:
        """Rotate the vectors among themselves until K is diagonal.

        This keeps the round-off of stretching a slender body out of the stiffness against bending.
        """
        K = self.project()[0]
        self._rows[:self.count] = np.linalg.eigh(0.5 * (K + K.T))[1].T @ self.V
        self._projected = np.zeros((3, 0, 0))

    def project(self) -> Array:
        """Return V K V^T, V C V^T and V M V^T (3, k, k)."""
        old, k, p = self._projected.shape[1], self.count, self.problem
        out = np.zeros((3, k, k))
        out[:, :old, :old] = self._projected
        for m, (act, skew) in enumerate(((p.stiffness, p.K_skew), (p.damping, p.C_skew), (p.mass, None))):
            for first in range(old, k, BLOCK):
                some = slice(first, min(first + BLOCK, k))
                images = np.array([act(x) for x in self.V[some]])
                out[m, :, some] = self.V @ images.T
                if skew is not None:
                    images -= (skew @ self.V[some].T).T
                out[m, some, :some.stop] = (self.V[:some.stop] @ images.T).T
        self._projected = out
        return out


def within_constraints(problem: Quadratic) -> Callable[[Array], Array]:
    """Return a projector of vectors (n,) on the motions that satisfy the constraints, orthogonal as displacements.

    The components of multipliers become 0.
    """
    moved = problem.is_coordinate
    if moved.all():
        return lambda x: x
    from scipy.sparse import diags_array

    w = problem.weights[moved]
    G = (problem.K.tocsr()[~moved][:, moved] @ diags_array(1.0 / w)).tocsc()
    factors = Factors((G @ G.T).tocsc())

    def within(x: Array) -> Array:
        y, out = w * x[moved], np.zeros(len(x))
        out[moved] = (y - G.T @ factors.solve(G @ y)) / w
        return out
    return within


def projected_pairs(matrices: Array, s0: float) -> tuple[Complex, Complex]:
    """Return every finite eigenvalue (m,) of dense K, C and M (3, k, k), nearest to s0 first, and vectors (m, k)."""
    mu, Z = np.linalg.eig(_companion(matrices, s0))
    mu, k = mu.astype(complex), matrices.shape[1]
    order = _finite(mu)
    mu, X = mu[order], Z[:, order]
    # of [mu x, x], use the half that is not small
    X = np.where(np.abs(mu) >= 1.0, X[:k] / mu, X[k:]).T
    return np.asarray(s0 * (1.0 + 1.0 / mu), dtype=complex), X.astype(complex)


def projected_values(matrices: Array, s0: float) -> Complex:
    """Return only the eigenvalues of ``projected_pairs``, in a third of its time."""
    mu = np.linalg.eigvals(_companion(matrices, s0)).astype(complex)
    return np.asarray(s0 * (1.0 + 1.0 / mu[_finite(mu)]), dtype=complex)


def undamped_values(matrices: Array, s0: float) -> Complex:
    """Return the eigenvalues of ``projected_values`` for C = 0, in an eighth of its time."""
    K, _, M = matrices
    theta = np.linalg.eigvals(np.linalg.solve(K + s0 * s0 * M, M)).astype(complex)
    s = np.sqrt(s0 * s0 - 1.0 / theta[_finite(theta)])
    return np.concatenate([s, -s])


def _companion(matrices: Array, s0: float) -> Array:
    """Return the matrix (2 k, 2 k) with eigenvalues mu = s0/(s - s0)."""
    K, C, M = matrices
    k = len(K)
    Q0 = K + s0 * C + s0 * s0 * M
    A = np.linalg.solve(Q0, np.hstack([s0 * (C + 2 * s0 * M), s0 * s0 * M]))
    return np.vstack([-A, np.hstack([np.eye(k), np.zeros((k, k))])])


def _finite(mu: Complex) -> Index:
    """Return the indices of eigenvalues that belong to finite s, the largest first."""
    order = np.argsort(-np.abs(mu), kind="stable")
    return order[np.abs(mu[order]) > 1e-13 * np.abs(mu).max(initial=0.0)]


def symmetric_modes(K: Array, M: Array, shift: float) -> tuple[Array, Array]:
    """Return the values K/M (r,), ascending, and modes of unit mass (k, r) of symmetric K and M (k, k).

    They are computed from the inverse about -``shift``: motions with hardly any mass, such as sections without rotary
    inertia, have a huge K/M, whose round-off would drown the lowest modes. Massless motions are omitted. Raises
    ComputationError if a massless motion has no stiffness.
    """
    from scipy.linalg import LinAlgError, eigh

    for _ in range(MOST_SHIFTS):
        try:
            theta, X = eigh(M, K + shift * M)
            break
        except LinAlgError:
            # some K/M is below -shift
            shift *= 4.0
    else:
        raise ComputationError("something without mass has no stiffness either",
                               advice="a mass or a stiffness for everything that can move")
    some = np.flatnonzero(theta > MASSLESS * theta[-1])[::-1]
    return 1.0 / theta[some] - shift, X[:, some] / np.sqrt(theta[some])
