"""Each kind of joint as equations. A further kind is one function and one entry in ``JOINTS``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..case import PinJoint, Point, PrismaticJoint, SliderJoint, WeldJoint
from ..elements.shape import Array
from .constraints import Equations, Row, align, along, combine
from .mesh import BodyMesh
from .points import PointRef
from .sliding import OnAxis, foot_point

# a gap in the reference beside the extent of the scene that is taken for round-off of the case's numbers
GAP = 1e-6


class JointError(ValueError):
    """A joint that its points cannot have; each of ``problems`` is (key of the entry, message, what was expected)."""

    def __init__(self, problems: list[tuple[tuple[str | int, ...], str, str]]) -> None:
        super().__init__("; ".join(message for _, message, _ in problems))
        self.problems = problems


@dataclass(frozen=True)
class JointContext:
    """What a joint needs to find its place: points, meshes, the extent of the scene, and how messages name it."""

    point: Callable[[Point], PointRef]
    meshes: dict[str, BodyMesh]
    extent: float
    label: str

    def place(self, point: PointRef) -> Array:
        """Return where a point is in the reference (2,)."""
        return np.asarray(point.mesh.plan.position(point.s)[0])

    def together(self, between: tuple[Point, ...]) -> list[PointRef]:
        """Return points that coincide in the reference. Raises JointError where they do not."""
        points = [self.point(p) for p in between]
        x, *others = (self.place(p) for p in points)
        problems: list[tuple[tuple[str | int, ...], str, str]] = []
        for k, r in enumerate(others, start=1):
            gap = float(np.hypot(*(r - x)))
            if gap > GAP * self.extent:
                problems.append((("between", k),
                                 f"{self.label}: {points[k].label} is at ({r[0]:.6g}, {r[1]:.6g}), {gap:.3g} away from "
                                 f"{points[0].label} at ({x[0]:.6g}, {x[1]:.6g})",
                                 "points that coincide in the reference"))
        if problems:
            raise JointError(problems)
        return points


def _share_position(a: PointRef, b: PointRef, owner: str, out: Equations) -> None:
    for ca, cb, axis in zip(a.position(), b.position(), "xy", strict=True):
        out.rows.append(Row(*combine((1.0, ca), (-1.0, cb)), owner, axis))


def _pin(joint: PinJoint, context: JointContext, owner: str, out: Equations) -> None:
    a, *others = context.together(joint.between)
    for b in others:
        _share_position(a, b, owner, out)


def same_kind(a: BodyMesh, b: BodyMesh) -> bool:
    """Whether two bodies can share all coordinates of a node: same type, form, section and material."""
    pa, pb = a.plan, b.plan
    drop = {"rhoA": 0.0, "rhoI": 0.0}
    return (pa.element == pb.element and pa.formulation is pb.formulation
            and replace(pa.section, **drop) == replace(pb.section, **drop))


def _same_nodes(a: PointRef, b: PointRef) -> bool:
    if a.node is None or b.node is None or not same_kind(a.mesh, b.mesh) or a.mesh.plan.rigid:
        return False
    nodes = a.mesh.plan.element.nodes
    return nodes[a.node].coordinates == nodes[b.node].coordinates


def share_all(a: PointRef, b: PointRef, owner: str, out: Equations) -> None:
    """Share every coordinate of two nodes, gradients turned by the angle between the references."""
    element = a.mesh.plan.element
    nc, beta = element.components, a.angle - b.angle
    c, s = (0.0 if abs(v) < 1e-15 else v for v in (math.cos(beta), math.sin(beta)))
    da, db = a.dofs(), b.dofs()
    assert a.node is not None
    names = [n for n in element.nodes[a.node].coordinates if n != "theta"]
    for k, name in enumerate(names):
        turn = name != "r"
        x, y = db[nc * k], db[nc * k + 1]
        rows = ((c, -s), (s, c)) if turn else ((1.0, 0.0), (0.0, 1.0))
        for m, (cx, cy) in enumerate(rows):
            one = (np.array([da[nc * k + m]]), np.ones(1))
            coords, coefs = combine((1.0, one), (-cx, (np.array([x]), np.ones(1))), (-cy, (np.array([y]), np.ones(1))))
            out.rows.append(Row(coords, coefs, owner, "xy"[m] if not turn else f"{name.replace('_', '')}_{'xy'[m]}"))
        if nc == 3:
            out.rows.append(Row(np.array([da[nc * k + 2], db[nc * k + 2]]), np.array([1.0, -1.0]), owner, "theta"))


def _weld_points(a: PointRef, b: PointRef, owner: str, out: Equations) -> None:
    if _same_nodes(a, b):
        share_all(a, b, owner, out)
    else:
        _share_position(a, b, owner, out)
        align(a, b, owner, out)


def _weld(joint: WeldJoint, context: JointContext, owner: str, out: Equations) -> None:
    a, *others = context.together(joint.between)
    for b in others:
        _weld_points(a, b, owner, out)


def _slider(joint: SliderJoint, context: JointContext, owner: str, out: Equations) -> None:
    point = context.point(joint.at)
    c, s = np.array(joint.along) / math.hypot(*joint.along)
    x, y = context.place(point)
    gap = (x - joint.through[0]) * -s + (y - joint.through[1]) * c
    if abs(gap) > GAP * context.extent:
        raise JointError([(("through",), f"{context.label}: {point.label} is at ({x:.6g}, {y:.6g}), "
                           f"{abs(gap):.3g} away from the line", "a line through where the point is in the reference")])
    out.rows.append(Row(*along(point.position(), -s, c), owner, "position across the line"))


def _prismatic(joint: PrismaticJoint, context: JointContext, owner: str, out: Equations) -> None:
    point, mesh = context.point(joint.point), context.meshes[joint.on]
    x, y = context.place(point)
    s, gap = foot_point(mesh.plan, np.array([x, y]))
    if gap > GAP * context.extent:
        raise JointError([(("point",), f"{context.label}: {point.label} is at ({x:.6g}, {y:.6g}), {gap:.3g} away from "
                           f"the axis of {joint.on}", "a point on the axis in the reference")])
    out.constraints.append(OnAxis(point, mesh, s, owner))


def weld_corners(mesh: BodyMesh, out: Equations) -> None:
    """Weld the pieces of a polyline at its corners."""
    last = len(mesh.plan.element.nodes) - 1
    for k, after in enumerate(mesh.corners):
        s = float(mesh.starts[after]) / mesh.plan.length
        a = PointRef(mesh, s, after - 1, 1.0, float(mesh.end_angles[after - 1]), last)
        b = PointRef(mesh, s, after, 0.0, float(mesh.angles[after]), 0)
        _weld_points(a, b, f"corner {k + 1} of {mesh.plan.name}", out)


JOINTS: dict[type, Callable[[Any, JointContext, str, Equations], None]] = {
    PinJoint: _pin, WeldJoint: _weld, SliderJoint: _slider, PrismaticJoint: _prismatic,
}
