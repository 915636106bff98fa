"""Scenes as plain data, and their subjects: every element type in every formulation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import ancf2d
from ancf2d.elements.definition import ElementType
from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.elements.registry import ELEMENTS, ancf

ORDERS = ((3, 1), (1, 2), (2, 2), (3, 3))
Body = dict[str, Any]


@dataclass(frozen=True)
class Subject:
    """An element type in a formulation, as a case names it."""

    label: str
    type: ElementType
    formulation: str
    order: tuple[int, int] | None = None

    def element(self, count: int) -> dict[str, Any]:
        """Return the ``element`` of a body."""
        out: dict[str, Any] = {"type": self.type.name, "count": count, "formulation": self.formulation}
        if self.order is not None:
            out.update(type="ancf", order=list(self.order))
        return out

    @property
    def shears(self) -> bool:
        """Whether its section can rotate relative to the axis."""
        return self.type.section_kind != "tangent"

    @property
    def thins(self) -> bool:
        """Whether its section contracts under tension."""
        return self.type.section_kind == "interpolated" and self.formulation != "structural"


def _subjects() -> list[Subject]:
    types: list[tuple[ElementType, tuple[int, int] | None]] = [(t, None) for t in ELEMENTS.values()]
    types += [(ancf(*order), order) for order in ORDERS]
    out = []
    for element, order in types:
        for formulation in FORMULATIONS.values():
            if formulation.refuse(element) is None:
                own = formulation.name == element.formulation
                label = element.name if own else f"{element.name}:{formulation.name}"
                out.append(Subject(label, element, formulation.name, order))
    return out


SUBJECTS = _subjects()
DEFAULTS = [s for s in SUBJECTS if s.formulation == s.type.formulation]
BY_LABEL = {s.label: s for s in SUBJECTS}
# one of each kind of coordinates: the tool's usual choices
USUAL = [BY_LABEL[name] for name in ("vallejo", "cable", "reissner3")]


@dataclass(frozen=True)
class Beam:
    """A straight beam of a rectangular section along x, from the origin."""

    L: float = 1.0
    h: float = 0.1
    b: float = 0.1
    E: float = 1e7
    nu: float = 0.3
    rho: float = 1000.0

    @property
    def A(self) -> float:
        """Area of the section."""
        return self.b * self.h

    @property
    def EA(self) -> float:
        """Axial stiffness."""
        return self.E * self.A

    @property
    def EI(self) -> float:
        """Bending stiffness."""
        return self.E * self.b * self.h**3 / 12

    @property
    def kGA(self) -> float:
        """Shear stiffness, with Cowper's factor of the rectangle."""
        return 10 * (1 + self.nu) / (12 + 11 * self.nu) * self.E / (2 * (1 + self.nu)) * self.A

    def body(self, subject: Subject, count: int, start: tuple[float, float] = (0.0, 0.0), angle: float = 0.0) -> Body:
        """Return the beam as a body of a case."""
        end = [start[0] + self.L * math.cos(angle), start[1] + self.L * math.sin(angle)]
        return {"geometry": {"type": "line", "start": list(start), "end": end},
                "section": {"height": self.h, "width": self.b},
                "material": {"E": self.E, "nu": self.nu, "rho": self.rho}, "element": subject.element(count)}

    def tip(self, P: float, shears: bool = True) -> float:
        """Return the linear tip deflection of a cantilever under a transverse force."""
        return P * self.L**3 / (3 * self.EI) + (P * self.L / self.kGA if shears else 0.0)


def free(subject: Subject) -> str:
    """Return the clamp that leaves a section free to contract if it can."""
    return "breathe" if subject.thins else "section"


def cantilever(subject: Subject, beam: Beam, count: int, loads: list[Any], solver: dict[str, Any] | None = None,
               hold: str | None = None) -> dict[str, Any]:
    """Return a case: a beam clamped at its start, probed at its tip."""
    return {"bodies": {"beam": beam.body(subject, count)},
            "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "beam@0", "hold": hold or free(subject)}],
            "loads": loads, "solver": solver or {"type": "static"}, "output": {"probes": {"tip": "beam@1"}}}


def force(value: list[float], subject: Subject | None = None, at: str = "beam@1", **more: Any) -> dict[str, Any]:
    """Return a force, spread over the section if the section warps."""
    out = {"type": "force", "at": at, "value": value, **more}
    if subject is not None and subject.type.degree_y > 1:
        out["spread"] = "parabolic"
    return out


def solve(case: dict[str, Any], **options: Any) -> ancf2d.Solution:
    """Solve a case without keeping states."""
    return ancf2d.solve(case, states=options.pop("states", False), **options)


def apart(found: float, expected: float) -> float:
    """Return the relative error."""
    return abs(found - expected) / abs(expected)
