"""Settings of accuracy control: elements of each body, element types, tolerance of time steps, load steps."""

from __future__ import annotations

import json
import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ...case import Body, Case, Dynamic, LoadedCase, with_overrides
from ...case.emit import written
from ...model.curve import share_count, stretches, turning
from ...model.grading import grading_of
from ...model.plan import acting_points
from ..goal import GoalValue
from ..run import vocabulary
from ..variants import Variant, element_data, flexible

AS_GIVEN = Variant()
# the coarsest mesh has one element for each such angle of an arc
ARC = math.pi / 4
# largest coarsest mesh, in multiples of the fewest elements, and its largest element length relative to the mean
NESTED, UNEVEN = 4, 1.25


@dataclass(frozen=True)
class Setting:
    """Elements of each body that deforms, element types that replace those of the case, and tolerance of motions.

    ``steps``: solver keys for the steps to an equilibrium that depends on them, if not those of the case.
    ``nodes``: places S from 0 to 1 for bodies with unequal elements; each interval has an equal share of the elements.
    ``method``: the integrator, if not that of the case. ``fibres``: their number in bodies where the case gives none,
    if not the default.
    """

    counts: dict[str, int]
    types: dict[str, Variant] = field(default_factory=dict)
    tolerance: float | None = None
    nodes: dict[str, tuple[float, ...]] = field(default_factory=dict)
    steps: dict[str, Any] = field(default_factory=dict)
    method: str | None = None
    fibres: int | None = None

    @property
    def kinds(self) -> tuple[tuple[str, Variant], ...]:
        """The element types in a form that can be compared."""
        return tuple(self.types.items())

    @property
    def name(self) -> Hashable:
        """The key by which equal settings are found."""
        return (tuple(self.counts.items()), self.kinds, self.tolerance, tuple(self.nodes.items()),
                tuple(self.steps.items()), self.method, self.fibres)

    @property
    def named_steps(self) -> str:
        """The solver keys for steps as text, empty if they are those of the case."""
        return ", ".join(f"{name} {value:.3g}" for name, value in self.steps.items())

    def node_positions(self) -> dict[str, list[float]] | None:
        """Return the places S of all nodes of bodies with unequal elements, or None if there are none."""
        out = {name: np.interp(np.linspace(0.0, 1.0, self.counts[name] + 1), np.linspace(0.0, 1.0, len(given)),
                               given).tolist() for name, given in self.nodes.items()}
        return out or None

    @property
    def elements(self) -> int:
        """The number of all elements."""
        return sum(self.counts.values())


class Mesh(NamedTuple):
    """The elements of a body's coarsest mesh, and the number of its stretches.

    The meshes of a body with several stretches are refinements of the coarsest one, so that all have the same
    proportions.
    """

    least: int
    stretches: int

    def count(self, wanted: float) -> int:
        """Return the elements of the coarsest mesh that has at least the wanted number."""
        unit = self.least if self.stretches > 1 else 1
        return max(self.least, unit * math.ceil(wanted / unit - 1e-9))


@dataclass
class Level:
    """A solved setting: its answer (None if it failed, with the reason), its cost, and why it was tried.

    ``kinks``: a point slides along a body, so its kink is at a different place within an element in each mesh.
    ``zones``: fibres yield or follow a curve, or bodies touch, in zones that end at a different place within an element
    in each mesh. ``step_count``: number of steps of the solver. ``missed_by``: relative distance by which a body misses
    an obstacle between contact points, if known.
    """

    setting: Setting
    why: str
    answer: GoalValue | None = None
    estimate: float | None = None
    wall_s: float = 0.0
    dofs: int | None = None
    iterations: int = 0
    step_count: int = 0
    reason: str = ""
    kinks: bool = False
    zones: bool = False
    missed_by: float = 0.0

    def store(self, answer: GoalValue, summary: dict[str, Any]) -> None:
        """Store the answer of a solve, and add its cost."""
        self.answer = answer
        self.wall_s += summary["wall_s"]
        self.iterations += summary["iterations"]
        self.step_count = summary["steps"]
        self.missed_by = summary.get("contact_error", 0.0)

    @property
    def work(self) -> int:
        """Elements times iterations over all steps, at least one: the cost of a solve on any machine."""
        return self.setting.elements * max(self.iterations, 1)

    def as_json(self) -> dict[str, Any]:
        """Return the ``--json`` form of the level."""
        out: dict[str, Any] = {"elements": self.setting.elements, "why": self.why,
                               "value": None if self.answer is None else self.answer.value,
                               "estimate": self.estimate, "wall_s": self.wall_s, "dofs": self.dofs,
                               "iterations": self.iterations}
        if len(self.setting.counts) > 1:
            out["bodies"] = dict(self.setting.counts)
        if self.setting.tolerance is not None:
            out["tolerance"] = self.setting.tolerance
        out |= self.setting.steps
        for name in ("method", "fibres"):
            if getattr(self.setting, name) is not None:
                out[name] = getattr(self.setting, name)
        if self.setting.types:
            out["types"] = {name: v.element for name, v in self.setting.types.items()}
        return out | ({"reason": self.reason} if self.reason else {})


def least(body: Body, acting: Sequence[float] = ()) -> int:
    """Return the elements of a body's coarsest mesh: at least one per stretch, and one per 45 degrees of turning.

    ``acting`` are the places S where loads, supports or joints act. More elements are used if that makes their lengths
    equal, or nearly so.
    """
    lengths = stretches(body.geometry, acting, grading_of(body.element))
    fewest = len(lengths)
    fewest = max(fewest, math.ceil(turning(body.geometry) / ARC - 1e-9))

    def longest(n: int) -> float:
        """Return the length of the longest of n elements relative to the mean."""
        return max(length / share for length, share in zip(lengths, share_count(lengths, n), strict=True)) * n / sum(
            lengths)

    tried = range(fewest, NESTED * fewest + 1)
    return next((n for most in (1.0 + 1e-9, UNEVEN) for n in tried if longest(n) <= most), min(tried, key=longest))


def meshed(case: Case, types: dict[str, Variant]) -> dict[str, Mesh]:
    """Return the coarsest mesh of each body that deforms, with ``types`` instead of those of the case."""
    acting = acting_points(case)
    return {name: Mesh(least(body, acting[name]), len(stretches(body.geometry, acting[name], grading_of(body.element))))
            for name, body in bodies_with_meshes(case, types).items()}


def bodies_with_meshes(case: Case, types: dict[str, Variant]) -> dict[str, Body]:
    """Return the bodies that have a mesh, with ``types`` instead of those of the case."""
    return {name: b for name, b in flexible(case).items() if types.get(name, AS_GIVEN).type != "rigid"}


def gives_fibres(body: Body) -> bool:
    """Return whether a case gives the number of fibres of a body, or the body has none."""
    own = body.element
    return not any(m.fibres for m in body.materials) or own.fibres is not None or own.quadrature not in (None, "exact")


def overrides(case: Case, setting: Setting) -> list[str]:
    """Return the ``PATH=VALUE`` overrides that apply a setting to a case."""
    out, meshes = [], meshed(case, setting.types)
    for name, body in flexible(case).items():
        variant = setting.types.get(name, AS_GIVEN)
        data: Any = "rigid"
        if name in meshes:
            count, mesh = setting.counts[name], meshes[name]
            data = element_data(body, variant, count, mesh.least if mesh.stretches > 1 else count)
            # an order is visible only if no kink moves through the elements
            if name in setting.nodes:
                given = setting.nodes[name]
                data = {k: v for k, v in data.items() if k not in ("count", "grading")}
                data |= {"nodes": list(given), "refine": count // (len(given) - 1)}
            elif not isinstance(body.element.nodes, tuple):
                data.pop("nodes", None) if body.element.preset is None else data.update(nodes="acting")
            if setting.fibres is not None and not gives_fibres(body):
                data["fibres"] = setting.fibres
        out.append(f"bodies.{name}.element={json.dumps(data)}")
    if setting.tolerance is not None and isinstance(case.solver, Dynamic):
        solver = replace(case.solver, dt=None, tolerance=setting.tolerance, estimate=False,
                         method=setting.method or case.solver.method)
        out.append(f"solver={json.dumps(written(solver))}")
    return out + [f"solver.{name}={value!r}" for name, value in setting.steps.items()]


def with_setting(loaded: LoadedCase, setting: Setting) -> LoadedCase:
    """Return a case with a setting, as if the case had been written with it. Raises CaseError."""
    return with_overrides(loaded, overrides(loaded.case, setting), vocabulary())
