"""Each kind of joint as equations between points. A further kind is one function and one entry below."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..case import PinJoint, WeldJoint
from .constraints import Equations, Row, align, combine
from .mesh import BodyMesh
from .points import PointRef


def _share_position(a: PointRef, b: PointRef, owner: str, out: Equations) -> None:
    for ca, cb, axis in zip(a.position(), b.position(), "xy", strict=True):
        out.rows.append(Row(*combine((1.0, ca), (-1.0, cb)), owner, axis))


def _pin(points: list[PointRef], owner: str, out: Equations) -> None:
    for other in points[1:]:
        _share_position(points[0], other, owner, out)


def same_kind(a: BodyMesh, b: BodyMesh) -> bool:
    """Whether two bodies can share all coordinates of a node: same type, form, section and material."""
    pa, pb = a.plan, b.plan
    drop = {"rhoA": 0.0, "rhoI": 0.0}
    return (pa.element == pb.element and pa.formulation is pb.formulation
            and replace(pa.section, **drop) == replace(pb.section, **drop))


def _same_nodes(a: PointRef, b: PointRef) -> bool:
    if a.node is None or b.node is None or not same_kind(a.mesh, b.mesh):
        return False
    nodes = a.mesh.plan.element.nodes
    return nodes[a.node].coordinates == nodes[b.node].coordinates


def share_all(a: PointRef, b: PointRef, owner: str, out: Equations) -> None:
    """Share every coordinate of two nodes, gradients turned by the angle between the references."""
    element = a.mesh.plan.element
    nc, beta = element.components, a.angle - b.angle
    c, s = (0.0 if abs(v) < 1e-15 else v for v in (math.cos(beta), math.sin(beta)))
    da, db = a.dofs(), b.dofs()
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


def _weld(points: list[PointRef], owner: str, out: Equations) -> None:
    a = points[0]
    for b in points[1:]:
        if _same_nodes(a, b):
            share_all(a, b, owner, out)
        else:
            _share_position(a, b, owner, out)
            align(a, b, owner, out)


def weld_corners(mesh: BodyMesh, out: Equations) -> None:
    """Weld the pieces of a polyline at its corners."""
    last = len(mesh.plan.element.nodes) - 1
    for k, (before, after, _) in enumerate(mesh.corners):
        pieces = mesh.plan.pieces
        s = pieces[k + 1].s0 / mesh.plan.length
        a = PointRef(mesh, s, before, 1.0, pieces[k].angle, last)
        b = PointRef(mesh, s, after, 0.0, pieces[k + 1].angle, 0)
        share_all(a, b, f"corner {k + 1} of {mesh.plan.name}", out)


JOINTS: dict[type, Callable[[list[PointRef], str, Equations], None]] = {PinJoint: _pin, WeldJoint: _weld}
