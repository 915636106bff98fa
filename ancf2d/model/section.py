"""Section constants that a formulation needs, from section and material of the case; or why a section is refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..case import Body, Case, Layers, Material, Rectangle, Stiffness
from ..elements.definition import ElementType
from ..elements.fibres import FIBRES, Uniaxial, curve, fibres_of, hardening, linear
from ..elements.formulations import FORMULATIONS, Formulation, Rule
from ..elements.maxwell import relaxing
from ..elements.neo_hooke import neo_hookean
from ..elements.section import Layer, Section, laminate, timoshenko
from ..elements.shape import Array, gauss
from ..errors import PartError
from .curve import Piece
from .profiles import VaryingSection, profile_breaks, profiles_of

# height over length in figures, for a rigid body without a section
DRAWN = 0.05
# range of section constants within which products of several of them are floating-point numbers
LEAST, MOST = 1e-100, 1e100
# points of a rigid body between two cuts
POINTS = 20


def shear_factor(value: str | float | None, element: ElementType, nu: float) -> float:
    """Return k_s from a number, ``timoshenko``, ``none`` (1) or, if None, the type's default."""
    chosen = element.shear_factor if value is None else value
    if isinstance(chosen, str):
        return timoshenko(nu) if chosen == "timoshenko" else 1.0
    return float(chosen)


def is_axis_type(element: ElementType) -> bool:
    """Return whether the type uses given stiffnesses directly: cable and the geometrically exact beams."""
    return element.section_kind in ("tangent", "theta")


def remembers_way(case: Case) -> bool:
    """Return whether equilibria depend on the load path: a material yields or relaxes, or a formulation has memory."""
    materials = (material for body in case.bodies.values() for material in body.materials)
    own = (FORMULATIONS.get(body.element.formulation or "") for body in case.bodies.values())
    return (any(material.yields or (case.solver.timed and bool(material.viscoelastic)) for material in materials)
            or any(made is not None and made.law.remembers for made in own))


def resolve_section(body: Body, element: ElementType, formulation: Formulation, k: str | float | None,
                    ) -> tuple[Section, VaryingSection | None]:
    """Return the section constants of a body, and the section as a function of place if it varies (else None).

    The constants of a varying section are its means. Raises PartError for what the element or arithmetic cannot
    have.
    """
    laws = _laws_of(body, element, formulation)

    def resolve(given: Any) -> Section:
        return replace(_resolved(given, element, formulation, k), laws=laws, maxwell=_terms_of(body),
                       neo_hooke=body.material is not None and body.material.law == "neo_hooke")

    varying = VaryingSection(body, resolve) if _varies(body) else None
    section = resolve(body) if varying is None else varying.mean
    for checked in [section] if varying is None else [section, varying.checked]:
        _check_range(checked)
    return section, varying


def _laws_of(body: Body, element: ElementType, formulation: Formulation) -> tuple[Uniaxial, ...]:
    """Return the fibre law of each layer of a section; empty if all are linear. Raises PartError."""
    layers = isinstance(body.section, Layers)
    materials = [l.material for l in body.section.layers] if isinstance(body.section, Layers) else [body.material]
    found = [k for k, m in enumerate(materials) if m is not None and m.fibres]
    if not found:
        return ()
    at: tuple[str | int, ...] = ("section", "layers", found[0], "material") if layers else ("material",)
    if formulation.fibres is None:
        known = [f.name for f in FORMULATIONS.values() if f.fibres is not None and f.refuse(element) is None]
        raise PartError(at, f"formulation {formulation.name} has no fibres that can yield or follow a curve",
                        f"formulation {' or '.join(known)}" if known else "a type of cable, reissner2, reissner3")
    if not isinstance(body.section, Layers | Rectangle):
        raise PartError(("section",), "an area and its second moment do not define the fibres", "{height, width} or "
                        "{width, layers}")
    return tuple(_law(m) for m in materials if m is not None)


def _terms_of(body: Body) -> tuple[tuple[float, float], ...]:
    """Return modulus and time of each Maxwell term of a body's material; all layers have the same terms."""
    material = body.section.layers[0].material if isinstance(body.section, Layers) else body.material
    return tuple((term.modulus, term.time) for term in (material.viscoelastic or ())) if material is not None else ()


def _law(material: Material) -> Uniaxial:
    E: Any = material.E
    if material.stress_strain is not None:
        return curve(E, material.stress_strain.points, material.stress_strain.unloading == "curve")
    if material.yield_ is None:
        return linear(E)
    hard = material.hardening
    return hardening(E, material.yield_, hard.isotropic if hard else 0.0, hard.kinematic if hard else 0.0)


def _neo_hookean(spec: Any, formulation: Formulation, rule: Rule) -> Formulation:
    """Return the formulation for a neo-Hookean material. Raises PartError if the element cannot have it."""
    at, known = ("material", "law"), [f.name for f in FORMULATIONS.values() if f.points]
    if not formulation.points:
        raise PartError(at, f"formulation {formulation.name} does not support the law neo_hooke, which needs "
                        "stresses at points of the section", f"a type with formulation {' or '.join(known)}")
    if not rule.uniform:
        raise PartError(("element", "quadrature"), "the law neo_hooke uses one quadrature for all strains",
                        "[nx, ny]")
    for name in ("shear_factor", "preset"):
        if getattr(spec, name) is not None:
            raise PartError(("element", name), f"the law neo_hooke has no shear factor, so {name} cannot be given",
                            f"no {name}")
    return neo_hookean(formulation)


def with_memory(spec: Any, formulation: Formulation, section: Section, rule: Rule) -> tuple[Formulation, Rule]:
    """Return formulation and rule for a material with fibre, Maxwell or neo-Hookean law; the given ones if linear.

    ``spec`` is the element of the case. There is one fibre at each point across a layer. Raises PartError if these
    are too few to bend.
    """
    if spec.fibres is not None and not section.laws:
        raise PartError(("element", "fibres"), "no material yields or follows a curve, so fibres has no effect",
                        "no fibres")
    if section.neo_hooke:
        return _neo_hookean(spec, formulation, rule), rule
    if not section.laws:
        return relaxing(formulation, len(section.maxwell)), rule
    if spec.fibres is not None or spec.quadrature in (None, "exact"):
        count = spec.fibres or FIBRES
        rule = Rule((rule.normal[0], count), (rule.shear[0], count if rule.uniform else 1), rule.lobatto)
    if rule.normal[1] < 2:
        raise PartError(("element", "quadrature"), "a single fibre through each layer has no bending stiffness",
                        f"[nx, ny] with ny fibres through each layer, {FIBRES} by default")
    return fibres_of(formulation, section, rule.normal[1]), rule


def _varies(body: Body) -> bool:
    return bool(profiles_of(body.section) or profiles_of(body.material))


def _check_range(section: Section) -> None:
    """Raise PartError if a section constant is too small or too large for floating-point arithmetic."""
    constants = {"A": section.height * section.width, "EA": section.EA, "kGA": section.kGA, "EI": section.EI}
    if np.any(section.rhoA):
        constants["rhoA"] = section.rhoA
    for name, found in constants.items():
        for value in (found,) if isinstance(found, float) else np.ravel(found).tolist():
            if not LEAST <= value <= MOST:
                raise PartError(("section",), f"the section has {name} = {value:g}, whose products exceed the range "
                                "of floating-point numbers", f"{LEAST:g} to {MOST:g}, perhaps in other units")


def _resolved(body: Any, element: ElementType, formulation: Formulation, k: str | float | None) -> Section:
    if isinstance(body.section, Stiffness):
        alpha = (body.material.alpha if body.material else None) or 0.0
        return _from_stiffness(body.section, element, formulation, alpha)
    if isinstance(body.section, Layers):
        return _from_layers(body.section, k)
    material = body.material
    # the case checks refuse bodies without them
    assert material is not None
    assert material.E is not None
    E, nu = material.E, material.nu or 0.0
    k_s = shear_factor(k, element, nu)
    given, kind = body.section, type(body.section)
    if kind is Rectangle:
        h, b = given.height, given.width
        A, I = h * b, b * h**3 / 12.0
    else:
        A, I = given.A, given.I
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            h = np.sqrt(12.0 * I / A)
            b = A / h
        if is_axis_type(element) and given.height is not None:
            h, b = given.height, A / given.height
    rho = 0.0 if material.rho is None else material.rho
    G = E / (2.0 * (1.0 + nu))
    return Section(h, b, E, nu, k_s, EA=E * A, kGA=k_s * G * A, EI=E * I, rhoA=rho * A, rhoI=rho * I,
                   alpha=material.alpha or 0.0)


def _from_layers(given: Layers, k: str | float | None) -> Section:
    heights = [layer.height for layer in given.layers]
    E, total = [float(layer.material.E) for layer in given.layers], sum(heights)  # type: ignore[arg-type]
    ends = np.concatenate([[0.0], np.cumsum(heights)])
    middles = 0.5 * (ends[1:] + ends[:-1])
    stiff = np.array(E) * heights
    axis = {"middle": 0.5 * total, "centroid": float(stiff @ middles) / float(stiff.sum())}.get(
        str(given.axis), given.axis)
    layers = []
    for layer, (low, high), e in zip(given.layers, pairwise((ends - axis).tolist()), E, strict=True):
        m = layer.material
        layers.append(Layer(low, high, e, m.nu or 0.0, float(m.rho or 0.0), m.alpha or 0.0))  # type: ignore[arg-type]
    section = laminate(given.width, tuple(layers), k if isinstance(k, float) else 1.0)
    return replace(section, ES=0.0) if given.axis == "centroid" else section


def _from_stiffness(s: Any, element: ElementType, formulation: Formulation, alpha: float) -> Section:
    if element.section_kind != "tangent" and s.kGA is None:
        raise PartError(("section",), f"{element.name} has shear: section needs kGA")
    h = np.sqrt(12.0 * s.EI / s.EA)
    A = h * h
    E = s.EA / A
    rhoA, rhoI = _inertias(s)
    kGA = s.kGA if s.kGA is not None else 0.5 * s.EA
    if not is_axis_type(element):
        theirs = rhoA * s.EI / s.EA
        other = _first((rhoA != 0.0) & ~np.isclose(rhoI, theirs, rtol=1e-6, atol=0.0), rhoI, theirs)
        if other is not None:
            raise PartError(
                ("section", "rhoI"), f"{element.name} needs the inertia of a rectangle: section.rhoI is {other[0]:g}",
                f"rhoA EI/EA = {other[1]:g}, or a type of cable, reissner2, reissner3")
        beyond = _first((kGA <= 0.0) | (kGA > 0.5 * s.EA * (1 + 1e-12)), kGA, 0.5 * s.EA)
        if formulation.name != "structural" and beyond is not None:
            raise PartError(
                ("section", "kGA"), f"{element.name} with formulation {formulation.name} integrates the shear of a "
                f"rectangle with nu = 0, but section.kGA is {beyond[0]:g}",
                f"0 < kGA <= GA = EA/2 = {beyond[1]:g}, formulation structural, or reissner2, reissner3")
    k_s = kGA / (0.5 * s.EA)
    return Section(h, h, E, 0.0, k_s, EA=s.EA, kGA=kGA, EI=s.EI, rhoA=rhoA, rhoI=rhoI, alpha=alpha)


def _inertias(s: Any) -> tuple[Any, Any]:
    """Return rhoA and rhoI of a section given by stiffnesses; 0 if it has no mass."""
    rhoA = 0.0 if s.rhoA is None else s.rhoA
    return rhoA, s.rhoI if s.rhoI is not None else rhoA * s.EI / s.EA


def _first(wrong: Any, *values: Any) -> tuple[float, ...] | None:
    """Return the values at the first place where ``wrong`` is true, or None if there is none; numbers or arrays."""
    found = np.flatnonzero(np.atleast_1d(wrong))
    return tuple(float(np.broadcast_to(v, np.shape(np.atleast_1d(wrong)))[found[0]]) for v in values) if len(
        found) else None


def rigid_section(body: Body, pieces: tuple[Piece, ...]) -> tuple[Section, VaryingSection | None]:
    """Return the section of a rigid body, and the section as a function of place if it varies (else None).

    Mass and inertia of the body are those of the case. A given mass is distributed as the density of the section, or as
    its area if it has none; a given inertia fixes a constant rhoI, negative if it is below that of the distributed
    mass.
    """
    length = pieces[-1].s0 + pieces[-1].length
    own = VaryingSection(body, lambda b: _rigid(b, length))
    s, w, r = _along(pieces, [at for at, _ in profile_breaks(body)])
    at, wanted = own.at(s), body.element
    heavy = wanted.mass is None or bool(np.any(at.rhoA))
    density = np.broadcast_to(at.rhoA if heavy else at.height * at.width, s.shape)
    factor = 1.0 if wanted.mass is None else wanted.mass / float(w @ density)
    m = factor * w * density
    if wanted.inertia is not None:
        off = r - m @ r / m.sum()
        rhoI = (wanted.inertia - float(m @ (off**2).sum(axis=1))) / length

    def resolve(b: Body) -> Section:
        section = _rigid(b, length)
        return replace(section, rhoA=factor * (section.rhoA if heavy else section.height * section.width),
                       rhoI=section.rhoI if wanted.inertia is None else rhoI)

    varying = VaryingSection(body, resolve)
    return (varying.mean, varying) if _varies(body) else (resolve(body), None)


def _rigid(body: Any, length: float) -> Section:
    """Return the section of a rigid body from its geometry and density alone."""
    given, kind = body.section, type(body.section)
    h: Any = DRAWN * length
    b, rhoA, rhoI = h, 0.0, 0.0
    rho = 0.0 if body.material is None or body.material.rho is None else body.material.rho
    if kind is Stiffness:
        h = b = np.sqrt(12.0 * given.EI / given.EA)
        rhoA, rhoI = _inertias(given)
    elif kind is Rectangle:
        h, b = given.height, given.width
        rhoA, rhoI = rho * h * b, rho * b * h**3 / 12.0
    elif given is not None:
        h, b = given.height, given.A / given.height
        rhoA, rhoI = rho * given.A, rho * given.I
    return Section(h, b, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, rhoA, rhoI)


def _along(pieces: tuple[Piece, ...], cuts: list[float]) -> tuple[Array, Array, Array]:
    """Return places S (n,), weights in m (n,) and positions (n, 2) that integrate along a body between its cuts."""
    length, (x, w) = pieces[-1].s0 + pieces[-1].length, gauss(POINTS)
    found: list[tuple[Array, Array, Array]] = []
    for p in pieces:
        ends = [0.0, *(c * length - p.s0 for c in cuts if 0.0 < c * length - p.s0 < p.length), p.length]
        for a, b in pairwise(ends):
            s = a + (b - a) * x
            found.append(((p.s0 + s) / length, (b - a) * w, p.position(s)[0]))
    s, weights, r = (np.concatenate(column) for column in zip(*found, strict=True))
    return s, weights, r
