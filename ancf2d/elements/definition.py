"""Definition of an element type: a basis of polynomials in (x, y), and nodal coordinates."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from functools import cached_property
from math import comb

import numpy as np

_TERM = re.compile(r"\s*([+-])?\s*([^+-]+)")
_FACTOR = re.compile(r"(?P<name>x|y|nu)(?:\s*(?:\^|\*\*)\s*(?P<power>\d{1,2}))?|(?P<number>\d+(?:\.\d*)?)")
MAX_DEGREE = 12


@dataclass(frozen=True)
class Term:
    """One product ``coefficient * nu^k * x^i * y^j``."""

    coefficient: float
    nu: int
    i: int
    j: int


@dataclass(frozen=True)
class Polynomial:
    """A basis function of an element: a sum of terms in x (from the first node) and y (from the axis)."""

    text: str
    terms: tuple[Term, ...]

    @property
    def degree_x(self) -> int:
        """Highest power of x."""
        return max(t.i for t in self.terms)

    @property
    def degree_y(self) -> int:
        """Highest power of y."""
        return max(t.j for t in self.terms)

    def coefficients(self, nu: float, l: float, half: float) -> dict[tuple[int, int], np.longdouble]:
        """Return the coefficients of xi^i eta^j, with x = l (1 + xi)/2 and y = half * eta.

        The shifted and scaled coordinates keep high orders well conditioned.
        """
        out: dict[tuple[int, int], np.longdouble] = {}
        for t in self.terms:
            scale = np.longdouble(t.coefficient) * np.longdouble(nu) ** t.nu
            scale *= (np.longdouble(l) / 2) ** t.i * np.longdouble(half) ** t.j
            for k in range(t.i + 1):
                out[k, t.j] = out.get((k, t.j), np.longdouble(0)) + scale * comb(t.i, k)
        return out


def _parse_term(text: str, sign: float) -> Term:
    coefficient, powers = sign, {"x": 0, "y": 0, "nu": 0}
    for piece in re.split(r"\*(?!\*)", text.replace("**", "^")):
        match = _FACTOR.fullmatch(piece.strip())
        if match is None:
            raise ValueError(f"'{piece.strip()}' is not a power of x, y or nu, nor a number")
        if match["number"]:
            coefficient *= float(match["number"])
        else:
            powers[match["name"]] += int(match["power"] or 1)
    if max(powers.values()) > MAX_DEGREE:
        raise ValueError(f"powers above {MAX_DEGREE} are not supported")
    return Term(coefficient, powers["nu"], powers["x"], powers["y"])


def parse(text: str) -> Polynomial:
    """Parse a polynomial such as ``x^2 + nu*y^2``; raise ValueError that names the piece it cannot read."""
    text = str(text).strip()
    terms, position = [], 0
    while position < len(text):
        match = _TERM.match(text, position)
        if match is None or (position > 0 and match[1] is None) or len(text) > 200:
            raise ValueError(f"cannot read '{text[position:position + 40]}' as a polynomial in x and y")
        terms.append(_parse_term(match[2], -1.0 if match[1] == "-" else 1.0))
        position = match.end()
    if not terms:
        raise ValueError("an empty basis function")
    return Polynomial(text, tuple(terms))


_GRADIENT = re.compile(r"r(?:_(x*)(y*))?")


def derivative_order(coordinate: str) -> tuple[int, int]:
    """Return (i, j) of the nodal coordinate d^(i+j) r / dx^i dy^j: ``r_xy`` gives (1, 1).

    Raises ValueError for a name that is not a derivative of r.
    """
    match = _GRADIENT.fullmatch(coordinate)
    if match is None or coordinate == "r_":
        raise ValueError(f"'{coordinate}' is not a nodal coordinate; expected r, r_x, r_y, r_xy, r_yy, ... or theta")
    return len(match[1] or ""), len(match[2] or "")


@dataclass(frozen=True)
class NodeSpec:
    """One node of an element: its position in [0, 1] along the element and its nodal coordinates."""

    at: float
    coordinates: tuple[str, ...]


@dataclass(frozen=True)
class ElementType:
    """An element of the family r(x, y) = sum_k s_k(x, y) e_k, given by its basis and nodal coordinates.

    ``quadrature`` maps a formulation to the (nx, ny) Gauss points recommended for this type; it overrides the
    default rule of the formulation. ``shear_factor`` is ``timoshenko`` (10 (1 + nu)/(12 + 11 nu)), ``none`` (1) or
    a number. ``preset`` maps the option ``preset: paper`` to the seed paper's choices; it is empty if the paper does
    not use the type. ``slender`` is the ratio of element length to height up to which bending does not lock (measured:
    docs/accuracy.md). ``lobatto`` is the share of the mass that is integrated with Gauss-Lobatto points along the axis,
    as many as determine the polynomial; the rest is integrated exactly.
    """

    name: str
    basis: tuple[str, ...]
    nodes: tuple[NodeSpec, ...]
    formulation: str
    source: str
    quadrature: dict[str, tuple[int, int]] = field(default_factory=dict)
    shear_factor: str | float = "timoshenko"
    preset: dict[str, object] = field(default_factory=dict)
    note: str = ""
    slender: float = math.inf
    lobatto: float = 0.0

    @cached_property
    def polynomials(self) -> tuple[Polynomial, ...]:
        """The parsed basis; raises ValueError for text that is not a polynomial."""
        return tuple(parse(b) for b in self.basis)

    @cached_property
    def has_theta(self) -> bool:
        """Whether the section rotation is a coordinate of its own (geometrically exact beams)."""
        return any("theta" in n.coordinates for n in self.nodes)

    @property
    def components(self) -> int:
        """Components per shape function: x and y, and theta if it is a coordinate."""
        return 3 if self.has_theta else 2

    @cached_property
    def functionals(self) -> tuple[tuple[int, str], ...]:
        """(node, coordinate) of every shape function, node by node."""
        return tuple((i, c) for i, n in enumerate(self.nodes) for c in n.coordinates if c != "theta")

    @cached_property
    def n_shape(self) -> int:
        """Number of shape functions."""
        return len(self.functionals)

    @cached_property
    def n_dof(self) -> int:
        """Number of element coordinates."""
        return self.n_shape * self.components

    @cached_property
    def degree_x(self) -> int:
        """Highest power of x in the basis."""
        return max(p.degree_x for p in self.polynomials)

    @cached_property
    def degree_y(self) -> int:
        """Highest power of y in the basis: 0 for a curve, 1 for a section that stays straight."""
        return max(p.degree_y for p in self.polynomials)

    @property
    def degree_of_turn(self) -> int:
        """Highest power of x in the rotation of the sections along the axis."""
        if self.section_kind == "interpolated":
            return max(t.i for p in self.polynomials for t in p.terms if t.j == 1)
        return self.degree_x if self.has_theta else self.degree_x - 1

    @cached_property
    def common_coefficients(self) -> bool:
        """Whether a basis function couples powers of y to powers of x by a common coefficient."""
        return any(len({(t.i, t.j) for t in p.terms}) > 1 for p in self.polynomials)

    @property
    def scales(self) -> bool:
        """Whether length and height only scale the shape functions, and Poisson's ratio does not enter."""
        return not self.common_coefficients and all(t.nu == 0 for p in self.polynomials for t in p.terms)

    @cached_property
    def section_kind(self) -> str:
        """How coordinates define a cross-section: interpolated, tangent (normal to r_x) or theta (own rotation)."""
        if self.has_theta:
            return "theta"
        return "interpolated" if self.degree_y > 0 else "tangent"


def coordinate_components(coordinate: str, theta: bool) -> tuple[str, ...]:
    """Return the case-file names of the components of a nodal coordinate: r -> x, y; r_y -> ry_x, ry_y."""
    if coordinate == "r":
        return ("x", "y", "theta") if theta else ("x", "y")
    stem = coordinate.replace("_", "")
    return (f"{stem}_x", f"{stem}_y")
