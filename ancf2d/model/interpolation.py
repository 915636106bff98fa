"""How well the nodal coordinates of an element determine the polynomials of its basis."""

from __future__ import annotations

import math

import numpy as np

from ..elements.definition import ElementType, derivative_order
from ..elements.shape import Array, gauss

# condition number beyond which a matrix in double precision is singular
SINGULAR = 1e13
MOST = 2.0**52
TINY = 1e-300


def basis_values(element: ElementType, length: float, nu: float, xi: Array, eta: Array, i: int = 0,
                 j: int = 0) -> Array:
    """Return d^(i+j) p/dxi^i deta^j of the basis (points, functions), lengths in half an element of height 1."""
    terms = [p.coefficients(nu, length, 0.5) for p in element.polynomials]
    out = np.zeros((len(xi), len(terms)))
    for k, polynomial in enumerate(terms):
        for (a, b), c in polynomial.items():
            if a >= i and b >= j:
                factor = math.perm(a, i) * math.perm(b, j) * float(c)
                out[:, k] += factor * xi ** (a - i) * eta ** (b - j)
    size = max(math.sqrt(float(sum(c * c for p in terms for c in p.values()))), TINY)
    return out / size


def _orthonormal(element: ElementType, length: float, nu: float) -> Array:
    """Return R, so that basis R^-1 is orthonormal over the element."""
    x, wx = gauss(element.degree_x + 2)
    y, wy = gauss(element.degree_y + 2)
    xi, eta = np.repeat(2 * x - 1, len(y)), np.tile(2 * y - 1, len(x))
    root = np.sqrt(np.outer(wx, wy).ravel())[:, None]
    values = basis_values(element, length, nu, xi, eta)
    scale = np.linalg.norm(root * values, axis=0)
    scale[scale == 0.0] = 1.0
    return np.asarray(np.linalg.qr(root * values / scale, mode="r") * scale)


def condition(element: ElementType, length: float, nu: float) -> float:
    """Return the condition number of the nodal coordinates applied to an orthonormal basis of the same span."""
    R = _orthonormal(element, length, nu)
    independent = np.linalg.cond(R / np.linalg.norm(R, axis=0).clip(TINY))
    if not independent < SINGULAR:
        return MOST
    A = np.linalg.solve(R.T, interpolation_matrix(element, length, nu).T).T
    return float(min(np.linalg.cond(A / np.linalg.norm(A, axis=1, keepdims=True).clip(TINY)), MOST))


def interpolation_matrix(element: ElementType, length: float, nu: float) -> Array:
    """Return A_ij = L_i(p_j), nodal coordinates times basis, in half an element's length and height, rows of size 1."""
    rows = []
    for node, name in element.functionals:
        i, j = derivative_order(name)
        at = np.array([2.0 * element.nodes[node].at - 1.0])
        rows.append(basis_values(element, length, nu, at, np.zeros(1), i, j)[0])
    A = np.array(rows)
    return np.asarray(A / np.linalg.norm(A, axis=1, keepdims=True).clip(TINY))


def rank(element: ElementType, length: float, nu: float) -> int:
    """Return the rank of the interpolation matrix."""
    return int(np.linalg.matrix_rank(interpolation_matrix(element, length, nu), tol=1e-10))
