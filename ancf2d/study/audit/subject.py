"""The element under examination, models made of it, and the results of checks.

The test beams are straight; height, width, E and density are 1.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ...case import LoadedCase, Source, load_case_text
from ...elements import registry
from ...elements.definition import ElementType
from ...elements.formulations import Formulation, Rule
from ...elements.registry import RIGID_TYPE
from ...elements.shape import ShapeFunctions
from ...errors import CaseError, Problem
from ...model.build import build_model
from ...model.model import Model
from ...model.own_element import undetermined
from ...model.plan import BodyPlan, plan_bodies
from ..run import vocabulary
from ..variants import described, element_named, is_file

# with unit data, all numbers of the examination characterise the element
HEIGHT = 1.0
NU = 0.3


def beam_case(name: str, element: dict[str, Any], length: float, solver: Any, *, nu: float = NU, tau: float = 0.0,
              angle: float = 0.0, breaks: Sequence[float] = (0.0, 1.0), material: dict[str, Any] | None = None,
              **scene: Any) -> LoadedCase:
    """Return the case of a body ``beam`` from the origin; ``scene`` holds other top-level keys of the case.

    ``breaks`` are shares of the length that bound pieces with elements of different lengths, ``tau`` [s] is the
    retardation time of the material, ``material`` holds its other keys. Raises CaseError.
    """
    points = [[length * s * math.cos(angle), length * s * math.sin(angle)] for s in breaks]
    geometry = ({"type": "line", "start": points[0], "end": points[1]} if len(points) == 2
                else {"type": "polyline", "points": points})
    beam = {"geometry": geometry, "section": {"height": HEIGHT, "width": 1.0},
            "material": {"E": 1.0, "nu": nu, "rho": 1.0, "damping": {"kelvin_voigt": tau}, **(material or {})},
            "element": element}
    case = {"bodies": {"beam": beam}, "solver": {"type": solver} if isinstance(solver, str) else solver, **scene}
    return load_case_text(json.dumps(case), name, vocabulary=vocabulary())


@dataclass(frozen=True)
class Subject:
    """An element type with formulation and quadrature; ``spec`` is the value of ``element`` in its body.

    ``plan`` is None if the nodal coordinates do not determine the basis; ``flaw`` says why.
    """

    name: str
    element: ElementType
    spec: dict[str, Any]
    plan: BodyPlan | None
    flaw: str | None = None

    @property
    def chosen(self) -> BodyPlan:
        """Return formulation, quadrature and section. Raises ValueError for an element without shape functions."""
        if self.plan is None:
            raise ValueError(self.flaw)
        return self.plan

    @property
    def formulation(self) -> Formulation:
        """The formulation that is examined."""
        return self.chosen.formulation

    @property
    def rule(self) -> Rule:
        """The quadrature that is examined."""
        return self.chosen.rule

    def shape(self, length: float, nu: float = NU) -> ShapeFunctions:
        """Return the shape functions of an element of this length and height 1."""
        return ShapeFunctions(self.element, length, HEIGHT, nu)

    def model(self, length: float, count: int, solver: Any = "linear_static", **scene: Any) -> Model:
        """Return the model of a straight beam of ``count`` elements; ``scene`` as in beam_case."""
        return build_model(beam_case(self.name, {**self.spec, "count": count}, length, solver, **scene))

    def free(self, length: float, count: int, **scene: Any) -> Model:
        """Return the model of such a beam without supports."""
        return self.model(length, count, {"type": "eigen", "modes": 1}, **scene)

    def affordable(self, most: int, coordinates: int) -> int:
        """Return ``most`` elements, or fewer (at least 2) if they would exceed this number of nodal coordinates."""
        shared = self.element.components * sum(c != "theta" for c in self.element.nodes[0].coordinates)
        return max(2, min(most, coordinates // max(self.element.n_dof - shared, 1)))

    @property
    def wall(self) -> dict[str, Any]:
        """The clamp that holds a section but lets it contract."""
        hold = "breathe" if self.element.section_kind == "interpolated" else "section"
        return {"name": "wall", "type": "clamp", "at": "beam@0", "hold": hold}

    def with_formulation(self, name: str) -> Subject | None:
        """Return the element with another formulation and its default quadrature, or None if it is refused."""
        spec = {k: v for k, v in self.spec.items() if k != "quadrature"} | {"formulation": name}
        try:
            return Subject(self.name, self.element, spec, _plan(self.name, spec, None))
        except CaseError:
            return None


def subject(name: str, preset: str | None = None, formulation: str | None = None, quadrature: Any = None) -> Subject:
    """Return the element that ``ancf2d audit NAME`` examines: a listed type, a member ``ancf[p,q]`` or one in a file.

    Raises CaseError for invalid names, files and options.
    """
    options = {"preset": preset, "formulation": formulation, "quadrature": quadrature}
    chosen = {k: v for k, v in options.items() if v is not None}
    if is_file(name):
        return _described(name, chosen)
    if name == RIGID_TYPE.name:
        raise CaseError(Problem(f"{name} has no strain: there is nothing to examine", expected="a type that deforms"))
    try:
        element = element_named(name)
    except ValueError as error:
        raise CaseError(Problem(str(error), expected="a listed type, or the file of an element of your own")) from None
    spec: dict[str, Any] = {"type": element.name, **chosen}
    if element.name not in registry.ELEMENTS:
        order = element.name.removeprefix(registry.FAMILY).strip("[]").split(",")
        spec.update(type=registry.FAMILY, order=[int(v) for v in order])
    return Subject(element.name, element, spec, _plan(element.name, spec, None))


def _described(path: str, chosen: dict[str, Any]) -> Subject:
    """Return the element that a file describes."""
    element, source = described(path)
    spec = {"definition": os.path.abspath(path), **chosen}
    flaw = undetermined(element)
    return Subject(element.name, element, spec, None if flaw else _plan(element.name, spec, source), flaw)


def _plan(name: str, spec: dict[str, Any], source: Source | None) -> BodyPlan:
    """Return the plan of a body of the element. Raises CaseError in terms of the element's file or of the options."""
    try:
        plans, problems = plan_bodies(beam_case(name, {**spec, "count": 1}, 1.0, {"type": "eigen", "modes": 1}))
    except CaseError as error:
        plans, problems = {}, error.problems
    if problems:
        raise CaseError([_about(p, spec, source) for p in problems])
    return plans["beam"]


def _about(problem: Problem, spec: dict[str, Any], source: Source | None) -> Problem:
    """Return a problem of the test body in terms of the place where the user described the element."""
    key = problem.path[3] if len(problem.path) > 3 else ""
    message = problem.message.removeprefix(f"bodies.beam.element.{key}: ")
    message = message.replace("bodies.beam.element.", "").replace("bodies.beam.element: ", "")
    if key in spec:
        return Problem(message, file=f"--{key}", expected=problem.expected, near=problem.near)
    if source is not None:
        return source.problem((key,), message, problem.expected, problem.near)
    return Problem(message, expected=problem.expected, near=problem.near)


PASS, FAIL, NOTE = "pass", "fail", "note"
# numbers below this share of their scale are round-off
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Finding:
    """A number (None if there is none), a verdict (pass, fail, note), and its meaning in one line."""

    value: float | None
    verdict: str
    meaning: str


@dataclass(frozen=True)
class Check:
    """One question about an element: its name, the question, and the computation that answers it.

    ``work`` is roughly the time it takes, relative to the other checks.
    """

    name: str
    question: str
    examine: Callable[[Subject], Finding]
    work: float = 1.0


@dataclass(frozen=True)
class CheckResult:
    """A check with its finding."""

    check: Check
    finding: Finding

    def as_json(self) -> dict[str, Any]:
        """Return the ``--json`` form of a check."""
        f = self.finding
        return {"name": self.check.name, "value": f.value, "verdict": f.verdict, "meaning": f.meaning,
                "question": self.check.question}


def judged(value: float, allowed: float, good: str, bad: str) -> Finding:
    """Return a finding that passes if the value is finite and of at most the allowed size."""
    if math.isfinite(value) and abs(value) <= allowed:
        return Finding(value, PASS, good)
    return Finding(value, FAIL, bad)
