"""Each body of a case resolved: element type, formulation, quadrature, section and pieces (no arrays yet)."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..case import (
    Body,
    Case,
    Element,
    ElementDefinition,
    Layers,
    Line,
    LoadedCase,
    Point,
    Polyline,
    Selective,
)
from ..case.binder import dotted
from ..case.schema.points import named_points
from ..elements import registry
from ..elements.definition import ElementType, derivative_order
from ..elements.formulations import FORMULATIONS, Formulation, Rule
from ..elements.registry import RIGID, RIGID_FRAME, RIGID_TYPE
from ..elements.section import Section
from ..errors import CaseError, PartError, Problem
from .axis import AxisError
from .curve import AT_NODE, TOGETHER, Array, Piece, is_closed, jumps, knots, pieces_of, short_pieces
from .grading import grading_of, too_short
from .own_element import own_element, undetermined
from .profiles import VaryingSection, load_breaks, profile_breaks
from .section import is_axis_type, resolve_section, rigid_section, with_memory

MAX_BODIES = 1000  # finding the free motions of this many takes a minute
SHORT = 0.1  # approximate turn of one element of a rigid curved body [rad]
WIDE = 1.0  # angle of an arc [rad] that is too wide for one element
MAX_COORDINATES = 32_000_000  # of all bodies together: a million elements of most types fit

@dataclass(frozen=True)
class BodyPlan:
    """A body with all choices made that a mesh needs.

    ``given_count`` is the number of elements in the case, ``acting`` the places S where something acts on the body or
    varies with a kink or jump. If the section varies, ``section`` has its mean values, ``varying`` the section at each
    place and ``cuts`` the places S of its kinks and jumps. ``closed``: whether the end is welded to the start.
    ``source`` contains all inputs of the plan.
    """

    name: str
    element: ElementType
    formulation: Formulation
    rule: Rule
    section: Section
    pieces: tuple[Piece, ...]
    given_count: int = 0
    acting: tuple[float, ...] = ()
    preset: str | None = None
    varying: VaryingSection | None = None
    cuts: tuple[float, ...] = ()
    closed: bool = False
    source: Any = None

    @property
    def length(self) -> float:
        """Total arc length."""
        return self.pieces[-1].s0 + self.pieces[-1].length

    @property
    def rigid(self) -> bool:
        """Return whether the body is rigid, without strain energy."""
        return self.formulation is RIGID

    @property
    def count(self) -> int:
        """Number of elements."""
        return sum(p.count for p in self.pieces)

    @property
    def coordinates(self) -> int:
        """Number of nodal coordinates, without the last node of each piece."""
        sizes = [sum(self.element.components for c in n.coordinates if c != "theta") for n in self.element.nodes]
        return self.count * sum(sizes[:-1])

    @property
    def split(self) -> list[float]:
        """Places S where something acts between elements of unequal length or with separate strains."""
        ends = (p.s0 / self.length for p in self.pieces if p.continues)
        return [s for s in ends if any(abs(s - at) <= TOGETHER for at in self.acting)]

    def locate(self, s: float) -> tuple[int, float]:
        """Return (piece, arc length within it) of the point at fraction s of the body's arc length.

        Where two pieces meet, return the second if it continues the first, else (at a corner) the first.
        """
        sigma, limit = s * self.length, 1e-12 * self.length
        k = bisect_right(self.pieces, sigma + limit, lo=1, key=lambda p: p.s0) - 1
        if k > 0 and not self.pieces[k].continues and sigma - self.pieces[k].s0 <= limit:
            k -= 1
        return k, min(max(sigma - self.pieces[k].s0, 0.0), self.pieces[k].length)

    def inside(self) -> list[float]:
        """Return the places S where something acts inside an element, mid-nodes included."""
        out = []
        for s in self.acting:
            k, sigma = self.locate(s)
            x, piece = sigma / self.pieces[k].l, self.pieces[k]
            off = abs(x - round(x))
            if off > AT_NODE and off * piece.l > TOGETHER * self.length:
                out.append(s)
        return out

    def position(self, s: float) -> tuple[Array, float]:
        """Return the reference point (2,) and tangent angle at fraction s of the arc length."""
        k, sigma = self.locate(s)
        r, theta = self.pieces[k].position(sigma)
        return r, float(theta)


def _user_element(spec: Element, definition: ElementDefinition) -> ElementType:
    if (reason := undetermined(element := own_element(definition, str(spec.definition)))) is not None:
        raise PartError(("element", "definition"), f"element {definition.name} in {spec.definition}: {reason}")
    return element


def _element_type(spec: Element, definition: ElementDefinition | None) -> ElementType:
    if definition is not None:
        return _user_element(spec, definition)
    if spec.type == "auto":
        raise PartError(("element", "type"), "element auto works only with 'ancf2d run' and 'ancf2d sweep'",
                        "one of " + ", ".join(registry.names()))
    return registry.element_type(spec.type, spec.order)


def _formulation(spec: Element, element: ElementType, name: str) -> Formulation:
    formulation = FORMULATIONS[name]
    reason = formulation.refuse(element)
    if reason is not None:
        offered = [f.name for f in FORMULATIONS.values() if f.refuse(element) is None]
        raise PartError(("element", "formulation"), f"{element.name} has no formulation {name}: {reason}",
                        "one of " + ", ".join(offered))
    return formulation


def _rule(chosen: Any, element: ElementType, formulation: Formulation, curved: bool) -> Rule:
    if isinstance(chosen, Selective):
        if not formulation.selective:
            raise PartError(("element", "quadrature"),
                            f"formulation {formulation.name} uses one quadrature for all strains", "[nx, ny]")
        return Rule(chosen.normal, chosen.shear)
    if chosen == "exact":
        rule = formulation.exact(element)
        if rule is None or curved:
            why = "on a curved axis" if curved else f"for formulation {formulation.name}"
            raise PartError(("element", "quadrature"), f"no finite quadrature is exact {why}", "[nx, ny]")
        return Rule(rule, rule)
    return Rule(tuple(chosen), tuple(chosen)) if chosen else default_rule(element, formulation)


def default_rule(element: ElementType, formulation: Formulation) -> Rule:
    """Return the default quadrature of a type in a formulation."""
    points = element.quadrature.get(formulation.name, formulation.rule(element))
    return Rule(points, points, formulation.lobatto)


def acting_at(case: Case) -> Counter[Point]:
    """Return how often supports, joints, springs, masses and loads name each point."""
    found: Counter[Point] = Counter()
    for thing in (*case.boundary_conditions, *case.joints, *case.springs, *case.masses, *case.loads):
        found.update(named_points(thing))
    return found


def acting_points(case: Case, named: Iterable[Point] | None = None) -> dict[str, list[float]]:
    """Return the places S of each body where something acts, in order.

    These are all points that supports, joints, springs, masses and loads name, the ends of line loads, the kinks and
    jumps of what varies along the body, and the points of splines; not the points of probes, nor places where a point
    slides. ``named`` are the points of ``acting_at``, if known.
    """
    found: dict[str, set[float]] = {name: {s for s, _ in profile_breaks(body)} for name, body in case.bodies.items()}
    for point in acting_at(case) if named is None else named:
        found[point.body].add(point.s)
    for load in case.loads:
        if load.line is not None:
            found[load.line.body].update(load_breaks(load.line))
        if load.places is not None:
            on, places = load.places
            found[on].update(places)
    for name, body in case.bodies.items():
        found[name].update(knots(body.geometry))
    return {name: sorted(places) for name, places in found.items()}


def has_regular_nodes(spec: Element) -> bool:
    """Return whether elements are equally long regardless of where something acts, as in the paper."""
    return spec.nodes == "regular" if spec.nodes is not None else spec.preset == "paper"


def _with_kinks(element: ElementType, moving: bool) -> bool:
    """Return whether strains along the axis can jump at a node only if each side has its own coordinates.

    For curves, such nodes need a multiplier that aligns their directions, which makes motions expensive; then False.
    """
    shared = any(derivative_order(name)[0] > 0 for _, name in element.functionals)
    return shared and not (moving and element.section_kind == "tangent")


def _of_layers(element: ElementType) -> str:
    """Return the default formulation of a type for layers: its own if it integrates over them or on the axis."""
    if is_axis_type(element) or element.formulation in ("continuum", "structural"):
        return element.formulation
    return "structural" if FORMULATIONS["structural"].refuse(element) is None else "continuum"


def knows_curvature(element: ElementType) -> bool:
    """Return whether nodal coordinates depend on the curvature of the axis, so that they jump where it does."""
    return any(i > 0 and i + j > 1 for i, j in (derivative_order(name) for _, name in element.functionals))


def plan_body(name: str, body: Body, definition: ElementDefinition | None = None,
              acting: Sequence[float] = (), points: Sequence[float] = (), moving: bool = False) -> BodyPlan:
    """Resolve one body; ``acting`` are the places S where something acts, ``points`` those of concentrated actions.

    Raises PartError or CaseError with the reason.
    """
    spec = body.element
    if spec.type == RIGID_TYPE.name:
        return _plan_rigid(name, body)
    element = _element_type(spec, definition)
    preset = element.preset if spec.preset == "paper" else {}
    if spec.preset == "paper" and not preset:
        offered = ", ".join(t.name for t in registry.ELEMENTS.values() if t.preset)
        raise PartError(("element", "preset"), f"the paper does not use {element.name}", f"preset on {offered}")
    usual = _of_layers(element) if isinstance(body.section, Layers) else element.formulation
    formulation = _formulation(spec, element, spec.formulation or str(preset.get("formulation", usual)))
    assert spec.number is not None  # a flexible body without one is refused
    refine, grading = spec.refine or 1, grading_of(spec)
    free, breaks = not has_regular_nodes(spec), profile_breaks(body)
    # where the section jumps, each side has its own strains; types with theta have no strains as nodal coordinates
    own = [] if element.has_theta else [s for s, jump in breaks if jump]
    kinks = [*own, *(points if _with_kinks(element, moving) else ())] if free else []
    kinks += jumps(body.geometry) if knows_curvature(element) else []
    pieces = pieces_of(body.geometry, spec.number, acting if free else (), refine, kinks, grading)
    if unequal := too_short(spec, [p.l for p in pieces], TOGETHER):
        raise PartError(*unequal)
    theirs = definition.quadrature if definition is not None and formulation.name == element.formulation else None
    rule = _rule(spec.quadrature or preset.get("quadrature") or theirs, element, formulation,
                 any(p.kappa != 0.0 for p in pieces))
    if isinstance(body.section, Layers) and formulation.name == "continuum" and not rule.uniform:
        raise PartError(("element", "quadrature"), "layers in formulation continuum use one quadrature for "
                        "all strains", "[nx, ny], where ny is the number of points across each layer")
    k: Any = spec.shear_factor if spec.shear_factor is not None else preset.get("shear_factor")
    if spec.shear_factor is not None and element.section_kind == "tangent":
        raise PartError(("element", "shear_factor"), f"{element.name} has no shear, so shear_factor has no effect",
                        "no shear_factor")
    section, varying = resolve_section(body, element, formulation, k)
    formulation, rule = with_memory(spec, formulation, section, rule)
    smooth = knots(body.geometry)
    return BodyPlan(name, element, formulation, rule, section, pieces, refine * spec.number,
                    tuple(s for s in acting if s not in smooth), spec.preset, varying, tuple(s for s, _ in breaks),
                    is_closed(body.geometry))


def _plan_rigid(name: str, body: Body) -> BodyPlan:
    """Resolve a rigid body, ignoring its count: a bar per straight piece, or short stretches of a curve in a frame."""
    for key in ("formulation", "quadrature", "fibres", "shear_factor", "preset", "nodes", "grading", "refine"):
        if getattr(body.element, key) is not None:
            raise PartError(("element", key), f"bodies.{name}: a rigid body does not deform, so {key} has no effect",
                            f"no {key}")
    bars = isinstance(body.geometry, Line | Polyline)
    pieces = pieces_of(body.geometry, body.geometry.least) if bars else short_pieces(body.geometry, SHORT)
    section, varying = rigid_section(body, pieces)
    return BodyPlan(name, RIGID_TYPE if bars else RIGID_FRAME, RIGID, Rule((1, 1), (1, 1)), section, pieces,
                    varying=varying, cuts=tuple(s for s, _ in profile_breaks(body)))


def plan_bodies(loaded: LoadedCase, moving: bool = False, known: Mapping[str, BodyPlan] | None = None
                ) -> tuple[dict[str, BodyPlan], list[Problem]]:
    """Resolve every body of a case; return the successful plans and all problems.

    ``moving`` requests meshes for a motion even if the solver is static. Plans of ``known`` with equal input are
    reused.
    """
    plans, problems = {}, []
    points, solver = acting_at(loaded.case), loaded.case.solver
    acting = acting_points(loaded.case, points)
    moving = moving or solver.moves
    if (many := len(loaded.case.bodies)) > MAX_BODIES:
        return {}, [loaded.source.problem(("bodies",), f"there are {many} bodies", f"at most {MAX_BODIES}")]
    weighed = solver.moves or solver.vibrates or loaded.case.steady_rotation is not None or any(
        load.acceleration is not None for load in loaded.case.loads)
    for name, body in loaded.case.bodies.items():
        source = (body, loaded.definitions.get(name), acting[name], [p.s for p in points if p.body == name], moving)
        if known is not None and name in known and known[name].source == source:
            plans[name] = known[name]
            continue
        try:
            plans[name] = replace(_computable(plan_body(name, *source)), source=source)
            if weighed and isinstance(body.section, Layers):
                _check_mass(plans[name])
            if loaded.case.solver.moves:
                _check_inertia(plans[name])
        except ArithmeticError:
            problems.append(loaded.source.problem(("bodies", name), _incomputable(name)))
        except AxisError as error:
            problems.append(loaded.source.problem(("bodies", name, "geometry", *error.key),
                                                  f"bodies.{name}.geometry: {error}", expected=error.expected or None))
        except PartError as error:
            found = loaded.source.problem(("bodies", name, *error.key), str(error), expected=error.expected or None)
            named = not found.line or f"bodies.{name}" in found.message  # an option shows its own path
            problems.append(found if named else replace(found, message=f"{dotted(found.path)}: {found.message}"))
        except CaseError as error:
            problems.extend(error.problems)
    count = sum(p.coordinates for p in plans.values())
    if count > MAX_COORDINATES:
        largest = max(plans, key=lambda name: plans[name].coordinates)
        problems.append(loaded.source.problem(
            ("bodies", largest, "element", "count"), f"bodies.{largest}.element.count: all bodies together have "
            f"{count} nodal coordinates", f"at most {MAX_COORDINATES}"))
    return plans, problems


def _check_mass(plan: BodyPlan) -> None:
    """Raise PartError if the centre of mass is off the axis but the element type has its mass on the axis."""
    section = plan.section
    if is_axis_type(plan.element) and abs(section.rhoS) > 1e-9 * section.rhoA * section.height:
        off = section.rhoS / section.rhoA
        raise PartError(("section", "axis"), f"bodies.{plan.name}: the centre of mass is {off:g} away from the "
                        f"axis, but {plan.element.name} has its mass on the axis",
                        f"axis: {section.height_of_axis + off:.9g}, or a type of vallejo, ancf")


def _check_inertia(plan: BodyPlan) -> None:
    """Raise PartError if rotations of sections are coordinates without rotary inertia, which no motion determines."""
    section = plan.section
    if plan.element.has_theta and not plan.rigid and section.rhoI == 0.0 < section.rhoA:
        raise PartError(("section", "rhoI"), f"bodies.{plan.name}.section.rhoI is 0, so the rotations of sections, "
                        f"which are coordinates of {plan.element.name}, have no inertia in motion",
                        f"rhoI > 0, such as rhoA EI/EA = {section.rhoA * section.EI / section.EA:.6g}, or type cable")


def _computable(plan: BodyPlan) -> BodyPlan:
    """Return a plan unchanged; raise PartError if its length or section exceeds the floating-point range."""
    section, power = plan.section, plan.length**4
    # the third is the square of the scale of its frequencies
    sizes = (power, 1.0 / power, section.EI / (section.rhoA * power) if section.rhoA else 0.0,
             *(1.0 / p.l for p in plan.pieces), *(p.kappa or 0.0 for p in plan.pieces), section.height,
             section.width, section.EA, section.kGA, section.EI, section.rhoA, section.rhoI)
    if not all(map(math.isfinite, sizes)):
        raise PartError((), _incomputable(plan.name))
    return plan


def _incomputable(name: str) -> str:
    return f"bodies.{name}: its length, section or stiffnesses are too large or too small for floating-point numbers"


def warnings_of(plan: BodyPlan) -> list[str]:
    """Return warnings about a body's mesh, which a user need not act on."""
    out = []
    if plan.count > plan.given_count > 0:
        out.append(f"bodies.{plan.name}: element.count {plan.given_count} is less than the number of stretches between "
                   f"corners and points where something acts: {plan.count} elements are used")
    if inside := plan.inside():
        places = ", ".join(f"{s:.6g}" for s in inside[:5]) + (", ..." if len(inside) > 5 else "")
        out.append(f"bodies.{plan.name}: a support, joint, spring, mass or load acts inside an element (S = {places}), "
                   f"where {plan.element.name} cannot have a kink: use nodes: acting, or refinement converges slowly")
    on_axis = is_axis_type(plan.element) or plan.formulation.name == "structural"
    if on_axis and not plan.section.laws and {plan.rule.normal[1], plan.rule.shear[1]} != {1}:
        out.append(f"bodies.{plan.name}: formulation {plan.formulation.name} integrates on the axis; "
                   "the points across have no effect")
    longest = max(p.l for p in plan.pieces) / (plan.section.height if plan.varying is None else plan.varying.lowest)
    if longest > plan.element.slender:
        out.append(f"bodies.{plan.name}: {plan.element.name} is too stiff in bending with elements as slender as these "
                   f"({longest:.3g} times as long as high; up to {plan.element.slender:g} is safe). Use more elements, "
                   "or vallejo or reissner3, which have no such limit")
    if plan.element.common_coefficients and plan.length <= plan.section.height and plan.count > 1:
        out.append(f"bodies.{plan.name}: neighbours of type {plan.element.name} share only the axis and the directions "
                   "of their sections, so results are off by 50 % and more under transverse load on a short body. "
                   "Use patel in formulation continuum")
    turn = max(float(np.abs(p.turning_angles).max()) for p in plan.pieces)
    if turn > WIDE:
        out.append(f"bodies.{plan.name}: an element rotates by {turn:.2g} rad, which can cost some per cent of "
                   f"accuracy. Use more elements, so that each rotates by less than {WIDE:g} rad")
    if plan.element.common_coefficients and any(p.kappa != 0.0 for p in plan.pieces):
        out.append(f"bodies.{plan.name}: on a curved axis {plan.element.name} curves the reference sections")
    return out


def reference_extent(plans: dict[str, BodyPlan]) -> float:
    """Return the size of the scene: the largest body length or distance between points."""
    points = np.array([p.position(s)[0] for p in plans.values() for s in (0.0, 0.25, 0.5, 0.75, 1.0)])
    return float(max(np.ptp(points, axis=0).max(), max(p.length for p in plans.values())))
