"""Element types that users describe in files, and the check that their coordinates determine their basis."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..case import DefinitionNode, ElementDefinition
from ..case.binder import INVALID, Issue
from ..case.definition import valid_node
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


def element_issues(draft: ElementDefinition) -> Iterator[Issue]:
    """Yield the problems of a definition; values that are INVALID are skipped.

    Whether the coordinates determine the basis is not checked here.
    """
    polynomials = list[Polynomial]()
    for i, text in enumerate(draft.basis or ()):
        try:
            polynomials += [parse(text)] if text is not INVALID else []
        except ValueError as error:
            yield Issue(("basis", i), f"basis: {error}", "a polynomial in x, y and nu, such as x^2 + nu*y^2")
    nodes = [n for n in draft.nodes or () if valid_node(n)]
    for i, node in enumerate(draft.nodes or ()):
        for j, name in enumerate(node.coordinates if node in nodes else ()):
            try:
                if name != "theta":
                    derivative_order(name)
            except ValueError as error:
                yield Issue(("nodes", i, "coordinates", j), str(error))
    if nodes and len(nodes) == len(draft.nodes):
        yield from _of_nodes(nodes)
        count = sum(name != "theta" for node in nodes for name in node.coordinates)
        if draft.basis and len(draft.basis) != count:
            yield Issue(("basis",), f"{len(draft.basis)} basis functions for {count} nodal coordinates",
                        "as many functions as coordinates of all nodes")
    degree = max((p.degree_x for p in polynomials), default=2)
    if draft.lobatto and degree < 2 and len(polynomials) == len(draft.basis):
        yield Issue(("lobatto",), "two Gauss-Lobatto points overestimate the rotary inertia of a bar, got lobatto "
                    f"{draft.lobatto:g} for a basis of degree {degree} in x", "no lobatto, or a basis of higher degree")


def _of_nodes(nodes: list[DefinitionNode]) -> Iterator[Issue]:
    """Yield the problems of the nodes of an element together."""
    if any("theta" in n.coordinates and set(n.coordinates) != {"r", "theta"} for n in nodes) or len(
            {"theta" in n.coordinates for n in nodes}) > 1:
        yield Issue(("nodes",), "theta needs r at the same node, at every node or at none", "[r, theta] at each node")
    first, last = nodes[0], nodes[-1]
    if first.at != 0.0 or last.at != 1.0:
        yield Issue(("nodes",), f"the nodes are at {first.at:g} to {last.at:g} along the element",
                    "the first node at 0 and the last at 1")
    if first.coordinates != last.coordinates:
        yield Issue(("nodes",), f"the first node has [{', '.join(first.coordinates)}], the last "
                    f"[{', '.join(last.coordinates)}]", "the same coordinates, which neighbours share")
    if "r" not in first.coordinates:
        yield Issue(("nodes", 0, "coordinates"), "the end nodes need the coordinate r")


def own_element(definition: ElementDefinition, source: str = "") -> ElementType:
    """Return the element type of a definition without ``element_issues``; ``source`` is the file that contains it."""
    polynomials = [parse(text) for text in definition.basis]
    theta = "theta" in definition.nodes[0].coordinates
    curve = all(p.degree_y == 0 for p in polynomials)
    default = definition.formulation or ("geometrically_exact" if theta else "cable" if curve else "continuum")
    nodes = tuple(NodeSpec(float(n.at), tuple(n.coordinates)) for n in definition.nodes)
    return ElementType(definition.name, tuple(str(b) for b in definition.basis), nodes, default, source=source,
                       shear_factor=definition.shear_factor or "timoshenko", lobatto=definition.lobatto)


def undetermined(element: ElementType) -> str | None:
    """Return the reason why the nodal coordinates do not determine the basis, or None if they do."""
    try:
        ShapeFunctions(element, *TRIAL)
    except UnsolvableBasisError as error:
        return str(error)
    if not condition(element, *TRIAL[::2]) < SINGULAR:
        return "some combination of the basis vanishes in every nodal coordinate"
    return None
