"""Element types that users describe in files, and the check that their coordinates determine their basis."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..case import ElementDefinition
from ..elements.definition import ElementType, NodeSpec, Polynomial, derivative_order, parse
from ..elements.shape import Array, ShapeFunctions, UnsolvableBasisError, gauss

# condition number beyond which a matrix in double precision is singular
SINGULAR = 1e13
MOST = 2.0**52
TINY = 1e-300


def basis_values(element: ElementType, length: float, nu: float, xi: Array, eta: Array, i: int = 0,
                 j: int = 0) -> Array:
    """Return d^(i+j) p/dxi^i deta^j of the basis (points, functions), for lengths in half an element of height 1."""
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
    """Return the condition number of the nodal coordinates on an orthonormal basis of the same space."""
    R = _orthonormal(element, length, nu)
    independent = np.linalg.cond(R / np.linalg.norm(R, axis=0).clip(TINY))
    if not independent < SINGULAR:
        return MOST
    A = np.linalg.solve(R.T, interpolation_matrix(element, length, nu).T).T
    return float(min(np.linalg.cond(A / np.linalg.norm(A, axis=1, keepdims=True).clip(TINY)), MOST))


def interpolation_matrix(element: ElementType, length: float, nu: float) -> Array:
    """Return A_ij = L_i(p_j), nodal coordinate i of basis function j, for half an element as unit, rows normalised."""
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


# length, height and nu for a trial of the basis: generic values
TRIAL = (1.0, 0.5, 0.3)


class DefinitionError(ValueError):
    """A description that is not a valid element; ``problems`` are (path in the file, message, what was expected)."""

    def __init__(self, problems: list[tuple[tuple[Any, ...], str, str]]) -> None:
        super().__init__("; ".join(message for _, message, _ in problems))
        self.problems = problems


def own_element(definition: ElementDefinition, source: str = "") -> ElementType:
    """Return the element type of a definition; ``source`` is the file that contains it.

    Raises DefinitionError with all problems. Whether the coordinates determine the basis is not checked here.
    """
    problems: list[tuple[tuple[Any, ...], str, str]] = []
    polynomials = _polynomials(definition, problems)
    problems += _coordinates(definition)
    if problems:
        raise DefinitionError(problems)
    theta = "theta" in definition.nodes[0].coordinates
    curve = all(p.degree_y == 0 for p in polynomials)
    default = definition.formulation or ("geometrically_exact" if theta else "cable" if curve else "continuum")
    nodes = tuple(NodeSpec(float(n.at), tuple(n.coordinates)) for n in definition.nodes)
    element = ElementType(definition.name, tuple(str(b) for b in definition.basis), nodes, default, source=source,
                          shear_factor=definition.shear_factor or "timoshenko", lobatto=definition.lobatto)
    if len(polynomials) != element.n_shape:
        raise DefinitionError([(("basis",), f"{len(polynomials)} basis functions for {element.n_shape} nodal "
                                "coordinates", "as many functions as coordinates of all nodes")])
    if element.lobatto and element.degree_x < 2:
        raise DefinitionError([(("lobatto",), "two Gauss-Lobatto points overestimate the rotary inertia of a bar, got "
                                f"lobatto {element.lobatto:g} for a basis of degree {element.degree_x} in x",
                                "no lobatto, or a basis of higher degree")])
    return element


def undetermined(element: ElementType) -> str | None:
    """Return the reason why the nodal coordinates do not determine the basis, or None if they do."""
    try:
        ShapeFunctions(element, *TRIAL)
    except UnsolvableBasisError as error:
        return str(error)
    if not condition(element, *TRIAL[::2]) < SINGULAR:
        return "some combination of the basis vanishes in every nodal coordinate"
    return None


def _polynomials(definition: ElementDefinition, problems: list[tuple[tuple[Any, ...], str, str]]) -> list[Polynomial]:
    out = []
    for i, text in enumerate(definition.basis):
        try:
            out.append(parse(text))
        except ValueError as error:
            problems.append((("basis", i), f"basis: {error}", "a polynomial in x, y and nu, such as x^2 + nu*y^2"))
    return out


def _coordinates(definition: ElementDefinition) -> Iterator[tuple[tuple[Any, ...], str, str]]:
    """Yield the problems of the nodes."""
    nodes = definition.nodes
    for i, node in enumerate(nodes):
        for j, name in enumerate(node.coordinates):
            try:
                if name != "theta":
                    derivative_order(name)
            except ValueError as error:
                yield ("nodes", i, "coordinates", j), str(error), ""
    if any("theta" in n.coordinates and set(n.coordinates) != {"r", "theta"} for n in nodes) or len(
            {"theta" in n.coordinates for n in nodes}) > 1:
        yield ("nodes",), "theta needs r at the same node, at every node or at none", "[r, theta] at each node"
    first, last = nodes[0], nodes[-1]
    if first.at != 0.0 or last.at != 1.0 or first.coordinates != last.coordinates:
        yield ("nodes",), ("the first and last node must be at 0 and 1 and have the same coordinates, which neighbours "
                           "share"), "the same coordinates at 0 and 1"
    if "r" not in first.coordinates:
        yield ("nodes", 0, "coordinates"), "the end nodes need the coordinate r", ""
