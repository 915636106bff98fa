"""Joints between bodies as equations: pins, welds, and sliders on a line of the ground."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import NAME, ListOf, Number, Vector
from ..case.schema.active import ACTIVE, ACTIVE_DOC, Active
from ..case.schema.case import register
from ..case.schema.points import POINT, Point, named_twice
from ..elements.definition import derivative_order
from ..elements.section import CONSTANTS
from ..elements.shape import Array
from ..model.constraints import Equations, Row, align, along, combine, share_direction
from ..model.mesh import BodyMesh
from ..model.plan import knows_curvature
from ..model.points import PointRef

R = TypeVar("R", bound=type)
BETWEEN = ListOf(POINT, "points BODY@S", 2)

# taken as round-off of the case's numbers: a gap in the reference, relative to the shortest body joined, or an angle
# between bodies that continue each other smoothly
GAP = 1e-6
# round-off of the coordinates themselves
ROUND_OFF = 1e-15
# relative difference of section constants that count as equal
ALIKE = 1e-9


class JointError(ValueError):
    """A joint that is impossible at its points; each of ``problems`` is (key of the entry, message, expected value)."""

    def __init__(self, problems: list[tuple[tuple[str | int, ...], str, str]]) -> None:
        super().__init__("; ".join(message for _, message, _ in problems))
        self.problems = problems


@dataclass(frozen=True)
class JointContext:
    """Data for a joint: points, meshes, its name in messages, and the number of items that act at each point.

    A joint that ``begins`` during a motion may join points that do not coincide in the reference.
    """

    point: Callable[[Point], PointRef]
    meshes: dict[str, BodyMesh]
    label: str
    acting: Counter[Point] = field(default_factory=Counter)
    begins: bool = False

    def together(self, between: tuple[Point, ...]) -> list[PointRef]:
        """Return the points of a joint. Raises JointError if they must coincide in the reference and do not."""
        points = [self.point(p) for p in between]
        x, *others = (reference_position(p) for p in points)
        problems: list[tuple[tuple[str | int, ...], str, str]] = []
        for k, r in enumerate(others, start=1):
            gap, others_s = float(np.hypot(*(r - x))), [p.s for p in points[:k] if p.mesh is points[k].mesh]
            if any(abs(points[k].s - s) <= GAP for s in others_s):
                problems.append((("between", k), f"{self.label}: {points[k].label} coincides with another point of the "
                                 "same body", "points of different bodies, or different points of one body"))
            elif not self.begins and gap > closable(x, points[0].mesh, points[k].mesh):
                problems.append((("between", k),
                                 f"{self.label}: {points[k].label} is at ({r[0]:.6g}, {r[1]:.6g}), {gap:.3g} away from "
                                 f"{points[0].label} at ({x[0]:.6g}, {x[1]:.6g})",
                                 "points that coincide in the reference"))
        if problems:
            raise JointError(problems)
        return points


def reference_position(point: PointRef) -> Array:
    """Return the position of a point in the reference (2,)."""
    return np.asarray(point.mesh.plan.position(point.s)[0])


def joint(cls: R) -> R:
    """Register a record as a kind of joint; its method ``add(context, owner, out)`` adds the equations to ``out``."""
    return register("joints", cls)


def closable(r: Array, *joined: BodyMesh) -> float:
    """Return the largest gap at r [m] that a joint may close: small compared with each of the joined bodies."""
    return GAP * min(m.plan.length for m in joined) + ROUND_OFF * float(np.abs(r).max())


def _share_position(a: PointRef, b: PointRef, owner: str, out: Equations, begins: bool = False) -> None:
    apart = reference_position(a) - reference_position(b) if begins else np.zeros(2)
    for ca, cb, axis, off in zip(a.position(), b.position(), "xy", apart.tolist(), strict=True):
        out.rows.append(Row(*combine((1.0, ca), (-1.0, cb)), owner, axis, initial_gap=off))


def same_kind(a: PointRef, b: PointRef) -> bool:
    """Return whether two bodies can share all nodal coordinates: same type, formulation, section and material."""
    pa, pb = a.mesh.plan, b.mesh.plan
    return (not pa.rigid and pa.element == pb.element and pa.formulation is pb.formulation
            and (pa.section.laws, pa.section.maxwell) == (pb.section.laws, pb.section.maxwell)
            and len(_stiffness(a)) == len(_stiffness(b))
            and all(math.isclose(va, vb, rel_tol=ALIKE) for va, vb in zip(_stiffness(a), _stiffness(b), strict=True)))


def _stiffness(point: PointRef) -> list[float]:
    """Return the stiffness constants of the section at a point, taken from the point's own element."""
    section = point.mesh.classes[point.mesh.cls[point.ie]].sampler.at(np.array([point.xi]))
    found = [float(np.atleast_1d(getattr(section, k))[0]) for k in CONSTANTS if k not in ("rhoA", "rhoI", "rhoS")]
    return found + [v for l in section.layers for v in (l.bottom, l.top, l.E, l.nu, l.alpha)]


@dataclass(frozen=True)
class _End:
    """An end of a body or piece, on a path that runs in the direction of its axis (``way`` 1) or against it (-1)."""

    point: PointRef
    way: int

    @property
    def angle(self) -> float:
        """Direction angle of the path."""
        return self.point.angle + (0.0 if self.way > 0 else math.pi)

    @property
    def curvature(self) -> float:
        """Curvature of the reference along the path [1/m]."""
        piece, k = self.point.mesh.piece_of(self.point.ie)
        return self.way * float(piece.curvature(piece.l * (k + self.point.xi)))


def _end(point: PointRef, into: bool) -> _End | None:
    """Return the end of a body at a point, on a path into or out of the body, or None if the point is not an end."""
    last = point.mesh.plan.count - 1
    if point.ie == last and point.xi == 1.0:
        return _End(point, -1 if into else 1)
    return _End(point, 1 if into else -1) if point.ie == 0 and point.xi == 0.0 else None


def _has_corner(a: PointRef | _End, b: PointRef | _End) -> bool:
    """Return whether there is a corner between two points that coincide."""
    return abs(math.remainder(a.angle - b.angle, 2 * math.pi)) > GAP


def _continues(a: _End, b: _End) -> bool:
    """Return whether one body continues the other as the same beam: same kind, same direction."""
    return same_kind(a.point, b.point) and not _has_corner(a, b)


def _curvature_jumps(a: _End, b: _End) -> bool:
    """Return whether the curvature jumps between two ends with nodal coordinates that depend on it."""
    length = max(a.point.mesh.plan.length, b.point.mesh.plan.length)
    return (knows_curvature(a.point.mesh.plan.element) and abs(a.curvature - b.curvature) * length > GAP)


def _share_nodes(a: _End, b: _End, kink: bool, owner: str, out: Equations) -> None:
    """Share the nodal coordinates of two ends that continue each other; odd derivatives change sign with the axis.

    At a kink, where something acts, the sections are shared but axial strains are not: each side has its own
    derivatives along the axis, and types whose sections are normal to it share the direction of the axis instead. The
    same holds if the curvature jumps and nodal coordinates depend on it.
    """
    kink = kink or _curvature_jumps(a, b)
    element = a.point.mesh.plan.element
    _share_coordinates(a, b, lambda i, j: not (kink and i > 0), owner, out)
    if kink and element.section_kind == "tangent":
        align(a.point, b.point, owner, out)


def _share_coordinates(a: _End, b: _End, chosen: Callable[[int, int], bool], owner: str, out: Equations) -> None:
    """Share those coordinates d^(i+j) r/dx^i dy^j of two nodes for which ``chosen(i, j)`` is true."""
    element = a.point.mesh.plan.element
    nc, beta = element.components, math.remainder(a.angle - b.angle, 2 * math.pi)
    c, s = (0.0 if abs(v) < 1e-15 else v for v in (math.cos(beta), math.sin(beta)))
    da, db = a.point.dofs(), b.point.dofs()
    assert a.point.node is not None
    names = [n for n in element.nodes[a.point.node].coordinates if n != "theta"]
    for k, name in enumerate(names):
        if not chosen(*derivative_order(name)):
            continue
        x, y = db[nc * k], db[nc * k + 1]
        sense = float(a.way * b.way) ** sum(derivative_order(name))
        rows = ((1.0, 0.0), (0.0, 1.0)) if name == "r" else ((sense * c, -sense * s), (sense * s, sense * c))
        for m, (cx, cy) in enumerate(rows):
            one = (np.array([da[nc * k + m]]), np.ones(1))
            coords, coefs = combine((1.0, one), (-cx, (np.array([x]), np.ones(1))), (-cy, (np.array([y]), np.ones(1))))
            out.rows.append(Row(coords, coefs, owner, "xy"[m] if name == "r" else f"{name.replace('_', '')}_{'xy'[m]}"))
        if nc == 3:
            out.rows.append(Row(np.array([da[nc * k + 2], db[nc * k + 2]]), np.array([1.0, -1.0]), owner, "theta"))


def _weld_points(a: PointRef, b: PointRef, owner: str, out: Equations) -> None:
    """Share position and section rotation; each body keeps its own axial strain and thickness."""
    _share_position(a, b, owner, out)
    if a.mesh.plan.rigid and b.mesh.plan.rigid:
        share_direction(a, b, owner, out)
    else:
        align(a, b, owner, out)


def _weld_in_line(a: _End, b: _End, owner: str, out: Equations) -> None:
    """Weld two different ends; if they have one element type and are in line, they also share the warping of sections.

    With free warping, a section would rotate in the mean relative to its direction on the axis, as if at a hinge.
    """
    _weld_points(a.point, b.point, owner, out)
    if a.point.mesh.plan.element == b.point.mesh.plan.element and not (a.point.mesh.plan.rigid or _has_corner(a, b)):
        _share_coordinates(a, b, lambda i, j: i == 0 and j > 1, owner, out)


def weld_pieces(mesh: BodyMesh, out: Equations) -> None:
    """Weld the pieces of a body at corners and kinks, and the ends of a closed body.

    Where the axis continues smoothly, the pieces share all nodal coordinates.
    """
    last, corners = len(mesh.plan.element.nodes) - 1, 0
    for after, kink in mesh.seams:
        s = float(mesh.starts[after]) / mesh.plan.length
        before, k = mesh.piece_of((after - 1) % mesh.plan.count)
        end = float(before.position(before.l * (k + 1))[1])
        a = PointRef(mesh, s or 1.0, (after - 1) % mesh.plan.count, 1.0, end, last)
        b = PointRef(mesh, s, after, 0.0, float(mesh.angles[after]), 0)
        if _continues(_End(a, 1), _End(b, 1)):
            _share_nodes(_End(a, 1), _End(b, 1), kink, f"the axis of {a.label}", out)
        elif _has_corner(a, b):
            corners += 1
            _weld_points(a, b, f"corner {corners} of {mesh.plan.name}", out)
        else:
            _weld_in_line(_End(a, 1), _End(b, 1), f"the step of the section at {a.label}", out)


@joint
@record
class PinJoint:
    """Keeps points together; the bodies can rotate freely."""

    tag = "pin"
    between: tuple[Point, ...] = key(BETWEEN, "Two or more points", example=["crank@1", "rod@0"])
    name: str | None = key(NAME, "Name", default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)

    def check(self) -> Iterator[Issue]:
        """Yield points that are named twice."""
        return named_twice(self.between)

    def add(self, context: JointContext, owner: str, out: Equations) -> None:
        """Add equations that keep all points at the position of the first."""
        a, *others = context.together(self.between)
        for b in others:
            _share_position(a, b, owner, out, context.begins)


@joint
@record
class WeldJoint:
    """Keeps points together and the angle between the bodies fixed; two equal beams in line become one."""

    tag = "weld"
    between: tuple[Point, ...] = key(BETWEEN, "Two or more points", example=["column@1", "beam@0"])
    name: str | None = key(NAME, "Name", default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)

    def check(self) -> Iterator[Issue]:
        """Yield points that are named twice."""
        return named_twice(self.between)

    def add(self, context: JointContext, owner: str, out: Equations) -> None:
        """Add equations that give all points the position and rotation of the first, or share the nodes of two ends.

        A weld that starts during a motion shares only position and rotation, and leaves the strains on its sides alone.
        """
        points = context.together(self.between)
        if context.begins:
            for point in points[1:]:
                _share_position(points[0], point, owner, out, begins=True)
                align(points[0], point, owner, out)
            return
        a, b = (_end(points[0], False), _end(points[1], True)) if len(points) == 2 else (None, None)
        if a is not None and b is not None:
            if _continues(a, b):
                _share_nodes(a, b, any(context.acting[p] > 1 for p in self.between), owner, out)
            else:
                _weld_in_line(a, b, owner, out)
            return
        for point in points[1:]:
            _weld_points(points[0], point, owner, out)


@joint
@record
class SliderJoint:
    """Keeps a point on a straight line of the ground."""

    tag = "slider"
    at: Point = key(POINT, "Point that slides", example="rod@1")
    through: tuple[float, float] = key(Vector(Number("m")), "A point of the line", example=[0, 0])
    along: tuple[float, float] = key(Vector(Number(), nonzero=True),
                                     "Direction of the line, of any length", example=[1, 0])
    name: str | None = key(NAME, "Name", default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)

    def add(self, context: JointContext, owner: str, out: Equations) -> None:
        """Add the equation that keeps the distance of the point from the line."""
        point = context.point(self.at)
        c, s = np.array(self.along) / math.hypot(*self.along)
        x, y = reference_position(point)
        gap = (x - self.through[0]) * -s + (y - self.through[1]) * c
        if not context.begins and abs(gap) > closable(np.array([x, y, *self.through]), point.mesh):
            raise JointError([(("through",), f"{context.label}: {point.label} is at ({x:.6g}, {y:.6g}), "
                               f"{abs(gap):.3g} away from the line",
                               "a line through the reference position of the point")])
        out.rows.append(Row(*along(point.position(), -s, c), owner, "position across the line",
                            initial_gap=gap if context.begins else 0.0))
