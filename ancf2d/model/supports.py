"""Each kind of support: what it holds, as equations. A further kind is one function and one entry below."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ..case import Clamp, Fix, Pin, Prescribed, Roller
from ..elements.definition import derivative_order
from ..elements.shape import Array
from .constraints import Equations, Row, along, combine, hold_rotation, prescribe_rotation
from .mesh import Index
from .points import PointRef
from .timing import Timing


class SupportError(ValueError):
    """A support that its point cannot have; ``key`` names the entry."""

    def __init__(self, key: tuple[str | int, ...], message: str, expected: str = "", near: str = "") -> None:
        super().__init__(message)
        self.key, self.expected, self.near = key, expected, near


def _position_rows(point: PointRef, owner: str, spread: str | None = None) -> list[Row]:
    return [Row(*combine((1.0, c)), owner, axis)
            for c, axis in zip(point.position(spread), "xy", strict=True)]


def _pin(support: Pin, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
    out.rows += _position_rows(point, owner, support.spread)


def _roller(support: Roller, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
    columns = point.position(support.spread)
    if support.normal is not None:
        nx, ny = support.normal
        length = math.hypot(nx, ny)
        coords, coefs = along(columns, nx / length, ny / length)
        out.rows.append(Row(coords, coefs, owner, f"position along ({nx:g}, {ny:g})"))
    elif support.fixed is not None:
        out.rows.append(Row(*combine((1.0, columns["xy".index(support.fixed)])), owner, support.fixed))


def _clamp(support: Clamp, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
    hold = support.hold or ("all" if point.mesh.plan.preset == "paper" else None)
    element = point.mesh.plan.element
    if hold == "breathe":
        _breathe(support, point, owner, out)
    elif point.mesh.plan.rigid:
        # its direction is held along and across: the length then is too, and needs no multiplier
        out.rows += _position_rows(point, owner)
        columns, _ = point.director()
        out.rows += [Row(*combine((1.0, c)), owner, n) for c, n in zip(columns, ("rx_x", "rx_y"), strict=True)]
    elif hold == "section" or element.section_kind != "interpolated":
        out.rows += _position_rows(point, owner)
        hold_rotation(point, owner, out)
        if element.degree_y > 1 and not element.common_coefficients:
            out.warnings.append(f"{owner}: hold: section leaves the warping coordinates of {element.name} free there, "
                                "which can soften the clamp; hold: breathe or all holds them")
    elif hold == "all" and point.node is not None:
        for dof, name in _coordinates(point):
            out.rows.append(Row(*_single(dof), owner, name))
    else:
        _hold_strain_free(point, owner, out)


def _hold_strain_free(point: PointRef, owner: str, out: Equations) -> None:
    """Hold what a clamped beam holds: position, the section's vector r_y, and its warping.

    Derivatives along the axis (r_x, r_xy) are strains and curvatures, which a clamp leaves free; so it does the
    components of r_yy, r_yyy, ... across the axis, in which a section thins and swells where it is bent.
    """
    out.rows += _position_rows(point, owner)
    columns, _ = point.director()
    out.rows += [Row(*combine((1.0, c)), owner, n) for c, n in zip(columns, ("ry_x", "ry_y"), strict=True)]
    tx, ty = math.cos(point.angle), math.sin(point.angle)
    for name in dict.fromkeys(name for _, name in point.mesh.plan.element.functionals):
        i, j = derivative_order(name)
        if i == 0 and j > 1:
            row = point.shape_row(0, j)
            columns = [point.columns(row, 0), point.columns(row, 1)]
            out.rows.append(Row(*along(columns, tx, ty), owner, "section warping"))


def _coordinates(point: PointRef) -> list[tuple[int, str]]:
    """Return the coordinates of the node at a point and their names; where it has two sides, those of both."""
    out: list[tuple[int, str]] = []
    for side in (point, point.before()):
        if side is not None and side.node is not None:
            names = side.mesh.coordinate_names[side.node]
            # the sides share their sections
            out += [(dof, name) for dof, name in zip(side.dofs().tolist(), names, strict=True)
                    if side is point or name.startswith("rx")]
    return out


def _single(dof: int) -> tuple[Index, Array]:
    import numpy as np

    return np.array([dof], dtype=np.int64), np.ones(1)


def _breathe(support: Clamp, point: PointRef, owner: str, out: Equations) -> None:
    """Hold the mean position and keep the section straight and in direction, free to stretch."""
    element = point.mesh.plan.element
    if element.section_kind != "interpolated":
        raise SupportError(("hold",), f"the section of {element.name} is rigid: it cannot breathe", "section or all")
    angle = point.director()[1] - 0.5 * math.pi
    tx, ty = math.cos(angle), math.sin(angle)
    axis = point.position()
    out.rows.append(Row(*along(axis, tx, ty), owner, "axial position"))
    out.rows.append(Row(*along(point.position("uniform"), -ty, tx), owner, "mean transverse position"))
    for j in range(1, element.degree_y + 1):
        row = point.shape_row(0, j)
        columns = [point.columns(row, 0), point.columns(row, 1)]
        coords, coefs = along(columns, tx, ty)
        if len(coords):
            out.rows.append(Row(coords, coefs, owner, "section direction" if j == 1 else "section warping"))


def _fix(support: Fix, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
    if point.node is None:
        raise SupportError(("at",), f"fix holds coordinates of a node, and there is no node at {point.label}",
                           "a node, or a support of type pin, roller or clamp")
    coordinates = _coordinates(point)
    names = list(dict.fromkeys(name for _, name in coordinates))
    for k, name in enumerate(support.coordinates):
        if name not in names:
            raise SupportError(("coordinates", k), f"{point.mesh.plan.element.name} has no coordinate '{name}' at "
                               f"{point.label}", "one of " + ", ".join(names))
        out.rows += [Row(*_single(dof), owner, name) for dof, other in coordinates if other == name]


def _prescribed(support: Prescribed, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
    columns = point.position()
    reference = point.mesh.plan.position(point.s)[0]
    for k, axis in enumerate("xy"):
        position, displacement = getattr(support, axis), getattr(support, "u" + axis)
        if position is not None:
            out.rows.append(Row(*combine((1.0, columns[k])), owner, axis, timing.motion(position, float(reference[k]))))
        if displacement is not None:
            out.rows.append(Row(*combine((1.0, columns[k])), owner, "u" + axis, timing.motion(displacement, 0.0)))
    if support.angle is not None:
        prescribe_rotation(point, timing.motion(support.angle, 0.0), owner, out)


SUPPORTS: dict[type, Callable[[Any, PointRef, str, Timing, Equations], None]] = {
    Pin: _pin, Roller: _roller, Clamp: _clamp, Fix: _fix, Prescribed: _prescribed,
}
