"""Shape functions of an element type, computed from its basis and nodal coordinates."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .definition import ElementType, derivative_order

Array = NDArray[np.float64]

# number of sets of points whose values are cached: the points of a rule are asked for again and again
KEPT = 32


class UnsolvableBasisError(ValueError):
    """The nodal coordinates do not determine the polynomial coefficients."""


def _monomials(degree: int, t: NDArray, derivative: int) -> NDArray:
    """Return d^k/dt^k of t^0 .. t^degree: (len(t), degree + 1), in the precision of t."""
    out = np.zeros((t.size, degree + 1), dtype=t.dtype)
    for i in range(derivative, degree + 1):
        out[:, i] = t.dtype.type(factorial(i) // factorial(i - derivative)) * t ** (i - derivative)
    return out


def _solve(A: NDArray, B: NDArray) -> NDArray:
    """Solve A X = B by Gauss elimination with partial pivoting in extended precision, after scaling each row to 1.

    High orders lose too many digits in double precision, and numpy's solver has no extended type.
    """
    scale = 1 / np.abs(A).max(axis=1, keepdims=True)
    A, B = A * scale, B * scale
    n = len(A)
    for k in range(n):
        p = k + int(np.argmax(np.abs(A[k:, k])))
        if abs(A[p, k]) < 1e-13 * n:
            raise UnsolvableBasisError(f"rank {k} of {n}: some combination of the basis vanishes in every "
                                  "nodal coordinate")
        A[[k, p]], B[[k, p]] = A[[p, k]], B[[p, k]]
        f = A[k + 1:, k] / A[k, k]
        A[k + 1:] -= np.outer(f, A[k])
        B[k + 1:] -= np.outer(f, B[k])
    X = np.zeros_like(B)
    for k in range(n - 1, -1, -1):
        X[k] = (B[k] - A[k, k + 1:] @ X[k + 1:]) / A[k, k]
    return X


def _reduced(basis: NDArray) -> NDArray:
    """Return a basis of the same space, reduced by Gauss-Jordan elimination in the monomials of xi and eta.

    Powers of x counted from the first node are nearly parallel on the element; powers of xi are not.
    """
    rows = basis.reshape(len(basis), -1).copy()
    for k in range(len(rows)):
        p, c = map(int, np.unravel_index(np.argmax(np.abs(rows[k:])), rows[k:].shape))
        rows[[k, k + p]] = rows[[k + p, k]]
        if abs(rows[k, c]) < 1e-12:
            raise UnsolvableBasisError("the basis functions are not independent")
        rows[k] /= rows[k, c]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, c], rows[k])
    return rows.reshape(basis.shape)


class ShapeFunctions:
    """The shape functions s_k(x, y) of one element type for one length, height and Poisson ratio.

    s = C^T m with the monomials m in xi = 2 x/l - 1 and eta = 2 y/h; C is the inverse of the matrix of the
    nodal coordinates applied to the basis (seed paper, Sec. 2.1). Everything is computed in extended
    precision and rounded once.

    Raises UnsolvableBasisError if the nodal coordinates do not determine the basis.
    """

    def __init__(self, element: ElementType, l: float, h: float, nu: float) -> None:
        self.element, self.l, self.h = element, float(l), float(h)
        half = np.longdouble(h) / 2
        expanded = [p.coefficients(nu, l, float(half)) for p in element.polynomials]
        self._dx = max(p.degree_x for p in element.polynomials)
        self._dy = max(p.degree_y for p in element.polynomials)
        basis = np.zeros((len(expanded), self._dx + 1, self._dy + 1), dtype=np.longdouble)
        for b, terms in enumerate(expanded):
            for (i, j), c in terms.items():
                basis[b, i, j] = c
            basis[b] /= np.abs(basis[b]).max()
        if len(expanded) != element.n_shape:
            raise UnsolvableBasisError(f"{len(expanded)} basis functions for {element.n_shape} nodal coordinates")
        basis = _reduced(basis)
        rows = []
        for node, name in element.functionals:
            i, j = derivative_order(name)
            xi = np.array([2 * np.longdouble(element.nodes[node].at) - 1])
            rows.append(self._basis_values(basis, xi, np.zeros(1, np.longdouble), i, j)[0])
        A = np.array(rows)
        inverse = _solve(A, np.eye(len(A), dtype=np.longdouble))
        self._coefficients = np.einsum("bk,bij->kij", inverse, basis)
        self._across: dict[Any, NDArray] = {}
        self._exact: dict[Any, NDArray] = {}
        self._values: dict[Any, Array] = {}

    @cached_property
    def orders(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Orders of the derivatives along x and along y of each nodal coordinate (n_shape,)."""
        along, across = zip(*(derivative_order(name) for _, name in self.element.functionals), strict=True)
        return np.array(along), np.array(across)

    def _basis_values(self, basis: NDArray, xi: NDArray, eta: NDArray, i: int, j: int) -> NDArray:
        mx = _monomials(self._dx, xi, i) * (2 / np.longdouble(self.l)) ** i
        my = _monomials(self._dy, eta, j) * (2 / np.longdouble(self.h)) ** j
        return np.einsum("pi,bij,pj->pb", mx, basis, my)

    def __call__(self, xi01: Array, eta: Array, i: int = 0, j: int = 0) -> Array:
        """Return d^(i+j) s_k / dx^i dy^j at points: (points, n_shape), in 1/m^(i+j).

        ``xi01`` runs from 0 to 1 along the element, ``eta = 2 y/h`` from -1 to 1 across.
        """
        at = np.atleast_1d(np.asarray(xi01, dtype=float))
        across = np.asarray(eta, dtype=float)
        if across.shape != at.shape:
            across = np.broadcast_to(across, at.shape)
        across = np.ascontiguousarray(across)
        place = (at.tobytes(), across.tobytes(), i, j)
        return _cached(self._values, place, lambda: self.exact(at, across, i, j).astype(np.float64)).copy()

    def exact(self, xi01: Array, eta: Array, i: int, j: int) -> NDArray:
        """Return the same as a call, but in extended precision and at points given as arrays."""
        place = (xi01.tobytes(), eta.tobytes(), i, j)
        return _cached(self._exact, place, lambda: self._evaluated(xi01, eta, i, j))

    def _evaluated(self, xi01: Array, eta: Array, i: int, j: int) -> NDArray:
        def along() -> NDArray:
            mx = _monomials(self._dx, 2 * xi01.astype(np.longdouble) - 1, i) * (2 / np.longdouble(self.l)) ** i
            return np.einsum("pi,kij->pkj", mx, self._coefficients)

        # where the height varies, the points of neighbouring elements differ in y only
        polynomials = _cached(self._across, (xi01.tobytes(), i), along)
        my = _monomials(self._dy, eta.astype(np.longdouble), j) * (2 / np.longdouble(self.h)) ** j
        return np.einsum("pkj,pj->pk", polynomials, my)


class ScaledShape(ShapeFunctions):
    """The shape functions of a type for any length and height, scaled from those for unit length and height.

    This requires that each basis function is a product of one power of x and one of y: a change of length or height
    then multiplies it by a number and leaves the space of functions the same.
    """

    def __init__(self, unit: ShapeFunctions, l: float, h: float) -> None:
        self.element, self.l, self.h, self._unit = unit.element, float(l), float(h), unit
        self._scales = np.longdouble(l), np.longdouble(h)
        self._sizes = self._scales[0] ** unit.orders[0] * self._scales[1] ** unit.orders[1]
        self._values: dict[Any, Array] = {}

    def exact(self, xi01: Array, eta: Array, i: int, j: int) -> NDArray:
        """Return the same as a call, but in extended precision and at points given as arrays."""
        return self._unit.exact(xi01, eta, i, j) * (self._sizes / (self._scales[0] ** i * self._scales[1] ** j))


@lru_cache(maxsize=KEPT)
def _of_type(key: _SameType, l: float, h: float, nu: float) -> ShapeFunctions:
    if not key.element.scales:
        return ShapeFunctions(key.element, l, h, nu)
    # Poisson's ratio does not enter the basis of these types
    unit = (1.0, 1.0, 0.0)
    return ShapeFunctions(key.element, *unit) if (l, h, nu) == unit else ScaledShape(_of_type(key, *unit), l, h)


class _SameType:
    """Cache key of an element type; it compares by identity."""

    def __init__(self, element: ElementType) -> None:
        self.element = element

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _SameType) and other.element is self.element

    def __hash__(self) -> int:
        return id(self.element)


def shape_functions(element: ElementType, l: float, h: float, nu: float) -> ShapeFunctions:
    """Return the shape functions of a type for a length, height and Poisson ratio; equal arguments share one object.

    Raises UnsolvableBasisError.
    """
    return _of_type(_SameType(element), l, h, nu)


def _cached(cache: dict[Any, NDArray], key: Any, compute: Callable[[], NDArray]) -> NDArray:
    """Return the cached value for a key, computing it if needed; a full cache is cleared first."""
    if key not in cache:
        if len(cache) >= KEPT:
            cache.clear()
        cache[key] = compute()
    return cache[key]


class FrameShape(ShapeFunctions):
    """The shape functions 1, X and Y of a stretch of a rigid curved body; X and Y are coordinates in the body's frame.

    The frame is at the start of the body, with its first axis along the body axis there. ``curve(x, n)`` returns
    X + i Y and its first n derivatives by the arc length x [m] from the start of the stretch, each (places,); ``l`` is
    the length of the stretch.
    """

    def __init__(self, element: ElementType, l: float, h: float, curve: Callable[[Array, int], Any]) -> None:
        self.element, self.l, self.h, self._curve = element, l, h, curve

    def __call__(self, xi01: Array, eta: Array, i: int = 0, j: int = 0) -> Array:
        """Return d^(i+j) s_k/dx^i dy^j at points, as in ``ShapeFunctions``, for r(x, y) = c(x) + y n(x)."""
        xi = np.atleast_1d(np.asarray(xi01, dtype=float))
        z, y = self._curve(self.l * xi, i + 1), 0.5 * self.h * np.broadcast_to(eta, xi.shape)
        w = z[i] + 1j * y * z[i + 1] if j == 0 else 1j * z[i + 1] if j == 1 else 0.0 * z[i]
        return np.stack([np.full(len(xi), float(i == j == 0)), w.real, w.imag], axis=1)


def gauss(n: int) -> tuple[Array, Array]:
    """Return the n Gauss points in [0, 1] and their weights (sum 1)."""
    x, w = _legendre(n)
    return (1 + x) / 2, w / 2


def lobatto(n: int) -> tuple[Array, Array]:
    """Return the n >= 2 Gauss-Lobatto points in [0, 1], ends included, and their weights (sum 1)."""
    x, w = _lobatto(n)
    return (1 + x) / 2, 1.0 * w


def radau(n: int) -> tuple[Array, Array]:
    """Return the n >= 2 Gauss-Radau points in [0, 1], the start included, and their weights (sum 1)."""
    x, w = _radau(n)
    return x.copy(), w.copy()


_legendre = lru_cache(np.polynomial.legendre.leggauss)


@lru_cache
def _radau(n: int) -> tuple[Array, Array]:
    """Return the points of ``radau``; the inner ones are roots of a Jacobi polynomial (Abramowitz & Stegun 25.4.31)."""
    from scipy.special import roots_jacobi

    z, v = roots_jacobi(n - 1, 0, 1)
    return np.append(0.0, (1 + z) / 2), np.append(1.0 / n**2, v / (2 * (1 + z)))


@lru_cache
def _lobatto(n: int) -> tuple[Array, Array]:
    P = np.polynomial.legendre.Legendre.basis(n - 1)
    inner = np.sort(P.deriv().roots().real) if n > 2 else np.zeros(0)
    x = np.concatenate([[-1.0], 0.5 * (inner - inner[::-1]), [1.0]])
    return x, 1.0 / (n * (n - 1) * P(x) ** 2)
