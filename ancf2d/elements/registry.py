"""The list of all element types, each given by a few lines of data; rigid bodies are included."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from .definition import ElementType, NodeSpec
from .formulations.base import Formulation, StrainLaw


def _nodes(places: tuple[float, ...], *coordinates: str) -> tuple[NodeSpec, ...]:
    return tuple(NodeSpec(at, coordinates) for at in places)


ENDS = (0.0, 1.0)
THREE = (0.0, 0.5, 1.0)
_R_RX_RY = _nodes(ENDS, "r", "r_x", "r_y")
_PAPER = {"formulation": "continuum", "shear_factor": 0.5, "quadrature": (2, 2)}
_TWO = {"continuum": (2, 2)}
_SEED = "two-dimensional shear deformable ANCF elements by common coefficients"

_TYPES = (
    ElementType("omar", ("1", "x", "y", "x*y", "x^2", "x^3"), _R_RX_RY,
                formulation="enhanced", preset=_PAPER, slender=40.0,
                source="Omar & Shabana 2001"),
    ElementType("kerkkanen", ("1", "x", "y", "x*y"), _nodes(ENDS, "r", "r_y"),
                formulation="structural", source="Kerkkanen, Sopanen & Mikkola 2005"),
    ElementType("vallejo", ("1", "x", "y", "x*y", "x^2", "x^2*y"), _nodes(THREE, "r", "r_y"),
                formulation="enhanced", source="Garcia-Vallejo, Mikkola & Escalona 2007"),
    ElementType("li", ("1", "x", "x^2", "x^3", "y", "x*y", "x^2*y", "x^3*y"),
                _nodes(ENDS, "r", "r_x", "r_y", "r_xy"),
                formulation="enhanced", slender=40.0, source="Li, Gantoi & Shabana 2011",
                note="x^2 y^2 vanishes in r, r_x, r_y, r_xy on y = 0, so these coordinates cannot carry "
                     "it; the basis is what they determine"),
    ElementType("patel", ("1", "x", "y", "x*y", "x^2", "x^3", "y^2", "x*y^2"),
                _nodes(ENDS, "r", "r_x", "r_y", "r_yy"),
                formulation="continuum", slender=40.0, source="Patel & Shabana 2018"),
    ElementType("2d2n", ("1", "x", "y", "x*y", "x^2 + y^2", "x^3"), _R_RX_RY,
                formulation="continuum", quadrature=_TWO, preset=_PAPER, slender=5.0,
                source=f"{_SEED}, Eqs. (24)-(25)",
                note="not symmetric under reversal of x; on an arc it curves the reference sections"),
    ElementType("2d3n", ("1", "x", "y", "x*y", "x^2 + y^2", "x^2*y"), _nodes(THREE, "r", "r_y"),
                formulation="continuum", quadrature=_TWO, preset=_PAPER, slender=0.5,
                source=f"{_SEED}, Eqs. (26)-(28)",
                note="on an arc it curves the reference sections"),
    # with two points along, a combination of x^2 + nu*y^2 and x^3 is detected only through nu
    ElementType("2d2n-nu", ("1", "x", "y", "x*y", "x^2 + nu*y^2", "x^3"), _R_RX_RY,
                formulation="continuum", quadrature={"continuum": (3, 2)}, slender=40.0,
                source="2d2n with the Poisson-consistent coefficient",
                note="on an arc it curves the reference sections"),
    ElementType("2d3n-nu", ("1", "x", "y", "x*y", "x^2 + nu*y^2", "x^2*y"), _nodes(THREE, "r", "r_y"),
                formulation="continuum", quadrature=_TWO, slender=5.0,
                source="2d3n with the Poisson-consistent coefficient",
                note="on an arc it curves the reference sections"),
    ElementType("cable", ("1", "x", "x^2", "x^3"), _nodes(ENDS, "r", "r_x"),
                formulation="cable", source="Berzeri & Shabana 2000; Gerstmayr & Irschik 2008"),
    ElementType("reissner2", ("1", "x"), _nodes(ENDS, "r", "theta"),
                formulation="geometrically_exact", source="Simo & Vu-Quoc 1986"),
    ElementType("reissner3", ("1", "x", "x^2"), _nodes(THREE, "r", "theta"),
                formulation="geometrically_exact", source="Simo & Vu-Quoc 1986"),
)
ELEMENTS: dict[str, ElementType] = {t.name: t for t in _TYPES}
FAMILY = "ancf"
MAX_ORDER = (8, 5)


@cache
def ancf(p: int, q: int) -> ElementType:
    """Return member [p, q] of the family: basis x^i y^j (i <= p, j <= q) and r, r_y, ... at each of p + 1 nodes.

    The nodes are the Gauss-Lobatto points (equidistant for p <= 2). [1, 1] is kerkkanen, [2, 1] vallejo.
    Raises ValueError outside 1 <= p <= 8, 1 <= q <= 5.
    """
    if not (1 <= p <= MAX_ORDER[0] and 1 <= q <= MAX_ORDER[1]):
        raise ValueError(f"order [{p}, {q}] is outside [1, 1] to [{MAX_ORDER[0]}, {MAX_ORDER[1]}]")
    from .shape import lobatto

    basis = tuple(f"x^{i}*y^{j}" for j in range(q + 1) for i in range(p + 1))
    coordinates = ("r", *("r_" + "y" * j for j in range(1, q + 1)))
    return ElementType(
        f"{FAMILY}[{p},{q}]", basis, _nodes(tuple(lobatto(p + 1)[0].tolist()), *coordinates),
        formulation="enhanced" if q == 1 else "continuum",
        shear_factor="timoshenko" if q <= 2 else "none",
        slender=0.5 if p == 1 and q > 1 else math.inf,
        source="the family of Garcia-Vallejo et al. 2007 with orders p along and q across")


def element_type(name: str, order: tuple[int, int] | None = None) -> ElementType:
    """Return the element type of a case file's ``type`` (and ``order`` for the family ``ancf``).

    Raises KeyError for an unknown name, ValueError for an order out of range.
    """
    if name == FAMILY:
        p, q = order or (2, 1)
        return ancf(int(p), int(q))
    return ELEMENTS[name]


def names() -> tuple[str, ...]:
    """Return every name that a case file may use as a flexible ``element.type``."""
    return (*ELEMENTS, FAMILY)


RIGID_TYPE = ElementType("rigid", ("1", "x"), (NodeSpec(0.0, ("r",)), NodeSpec(1.0, ("r",))), formulation="rigid",
                         source="natural coordinates of Garcia de Jalon & Bayo 1994")
# all elements of a body share its one node, the frame at the body's start; it is not an end of an element
RIGID_FRAME = ElementType("rigid", ("1", "x", "y"), (NodeSpec(-1.0, ("r", "r_x", "r_y")),), formulation="rigid",
                          source=RIGID_TYPE.source)


def _no_law(*_: Any) -> Any:
    raise NotImplementedError("a rigid body has no strain")


RIGID = Formulation("rigid", StrainLaw(0, 0, 0, _no_law, _no_law),
                    lambda e: None if e in (RIGID_TYPE, RIGID_FRAME) else f"{e.name} deforms", lambda e: (1, 1),
                    lambda e: (1, 1), _no_law, RIGID_TYPE.source, "no strain: lengths are kept")
