"""Section and material of a case -> the constants that a formulation needs, or the reasons why not."""

from __future__ import annotations

import math

import numpy as np

from ..case import Body, Rectangle, Stiffness
from ..elements.definition import ElementType
from ..elements.formulations import Formulation
from ..elements.section import Section, timoshenko
from .curve import Piece

# height over length that a rigid body without a section is drawn with
DRAWN = 0.05
# of the constants of a section: products of several of them stay within what floating-point numbers hold
LEAST, MOST = 1e-100, 1e100


class SectionError(ValueError):
    """A section that an element cannot have; ``key`` names what is wrong below the body."""

    def __init__(self, key: tuple[str, ...], message: str, expected: str = "") -> None:
        super().__init__(message)
        self.key, self.expected = key, expected


def shear_factor(value: str | float | None, element: ElementType, nu: float) -> float:
    """Return k_s: a number, ``timoshenko``, ``none`` (1), or the type's own default."""
    chosen = element.shear_factor if value is None else value
    if isinstance(chosen, str):
        return timoshenko(nu) if chosen == "timoshenko" else 1.0
    return float(chosen)


def is_axis_type(element: ElementType) -> bool:
    """Whether the type takes stiffnesses as given: cable and the geometrically exact beams."""
    return element.section_kind in ("tangent", "theta")


def resolve_section(body: Body, element: ElementType, formulation: Formulation, k: str | float | None) -> Section:
    """Return the section constants of a body. Raises SectionError for what the element or arithmetic cannot have."""
    section = _resolved(body, element, formulation, k)
    constants = {"A": section.height * section.width, "EA": section.EA, "kGA": section.kGA, "EI": section.EI,
                 "rhoA": section.rhoA or 1.0}
    for name, value in constants.items():
        if not LEAST <= value <= MOST:
            raise SectionError(("section",), f"the section has {name} = {value:g}, whose products leave the range of "
                               "floating-point numbers", f"{LEAST:g} to {MOST:g}, in other units perhaps")
    return section


def _resolved(body: Body, element: ElementType, formulation: Formulation, k: str | float | None) -> Section:
    if isinstance(body.section, Stiffness):
        return _from_stiffness(body.section, element, formulation)
    material = body.material
    # a case without them is refused
    assert material is not None
    assert material.E is not None
    assert body.section is not None
    E, nu = material.E, material.nu or 0.0
    k_s = shear_factor(k, element, nu)
    if isinstance(body.section, Rectangle):
        h, b = body.section.height, body.section.width
        A, I = h * b, b * h**3 / 12.0
    else:
        A, I = body.section.A, body.section.I
        h = math.sqrt(12.0 * I / A)
        b = A / h
        if is_axis_type(element) and body.section.height is not None:
            h, b = body.section.height, A / body.section.height
    rho = material.rho or 0.0
    G = E / (2.0 * (1.0 + nu))
    return Section(h, b, E, nu, k_s, EA=E * A, kGA=k_s * G * A, EI=E * I, rhoA=rho * A, rhoI=rho * I)


def _from_stiffness(s: Stiffness, element: ElementType, formulation: Formulation) -> Section:
    if element.section_kind != "tangent" and s.kGA is None:
        raise SectionError(("section",), f"{element.name} shears: section needs kGA")
    h = math.sqrt(12.0 * s.EI / s.EA)
    A = h * h
    E = s.EA / A
    rhoA = s.rhoA or 0.0
    rhoI = s.rhoI if s.rhoI is not None else rhoA * s.EI / s.EA
    kGA = s.kGA if s.kGA is not None else 0.5 * s.EA
    if not is_axis_type(element):
        if rhoA and not math.isclose(rhoI * s.EA, rhoA * s.EI, rel_tol=1e-6):
            raise SectionError(
                ("section", "rhoI"), f"{element.name} has the inertia of a rectangle: section.rhoI is {rhoI:g}",
                f"rhoA EI/EA = {rhoA * s.EI / s.EA:g}, or a type of cable, reissner2, reissner3")
        if formulation.name != "structural" and not 0.0 < kGA <= 0.5 * s.EA * (1 + 1e-12):
            raise SectionError(
                ("section", "kGA"), f"{element.name} with formulation {formulation.name} integrates the shear of a "
                f"rectangle with nu = 0: section.kGA is {kGA:g}",
                f"0 < kGA <= GA = EA/2 = {0.5 * s.EA:g}, formulation structural, or reissner2, reissner3")
    k_s = kGA / (0.5 * s.EA)
    return Section(h, h, E, 0.0, k_s, EA=s.EA, kGA=kGA, EI=s.EI, rhoA=rhoA, rhoI=rhoI)


def rigid_section(body: Body, pieces: tuple[Piece, ...]) -> Section:
    """Return the section of a rigid body, its mass and inertia spread so that they are what the case says.

    An inertia below that of a mass that is spread along the body makes rhoI negative.
    """
    length = pieces[-1].s0 + pieces[-1].length
    h = b = DRAWN * length
    rhoA = rhoI = 0.0
    rho = (body.material.rho if body.material else None) or 0.0
    if isinstance(body.section, Stiffness):
        s = body.section
        h = b = math.sqrt(12.0 * s.EI / s.EA)
        rhoA = s.rhoA or 0.0
        rhoI = s.rhoI if s.rhoI is not None else rhoA * s.EI / s.EA
    elif isinstance(body.section, Rectangle):
        h, b = body.section.height, body.section.width
        rhoA, rhoI = rho * h * b, rho * b * h**3 / 12.0
    elif body.section is not None:
        h, b = body.section.height, body.section.A / body.section.height
        rhoA, rhoI = rho * body.section.A, rho * body.section.I
    if body.element.mass is not None:
        rhoA = body.element.mass / length
    if body.element.inertia is not None:
        rhoI = (body.element.inertia - rhoA * _spread(pieces)) / length
    return Section(h, b, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, rhoA, rhoI)


def _spread(pieces: tuple[Piece, ...]) -> float:
    """Return the moment of inertia of straight pieces about their common centre, per mass per length [m^3]."""
    lengths = np.array([p.length for p in pieces])
    centres = np.array([p.position(0.5 * p.length)[0] for p in pieces])
    off = centres - lengths @ centres / lengths.sum()
    return float((lengths**3 / 12.0 + lengths * (off**2).sum(axis=1)).sum())
