"""Supports: the equations for the coordinates that each of them holds or moves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TypeVar

import numpy as np

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import NAME, Choice, Known, ListOf, Number, Vector
from ..case.records import ByShape, OneOf
from ..case.schema.active import ACTIVE, ACTIVE_DOC, Active
from ..case.schema.amplitudes import Amplitude
from ..case.schema.case import register
from ..case.schema.points import POINT, Point
from ..elements.definition import derivative_order
from ..elements.shape import Array
from ..errors import PartError
from ..model.constraints import Equations, Row, along, combine, hold_along, hold_rotation, prescribe_rotation
from ..model.mesh import Index
from ..model.points import PointRef
from ..model.timing import Timing
from .forces import SPREAD

R = TypeVar("R", bound=type)
SPREAD_DOC = "Hold the mean of the section with this weight instead of the axis (relevant for q >= 2)"


def support(cls: R) -> R:
    """Register a record as a kind of support; its method ``add(point, owner, timing, out)`` adds its equations."""
    return register("boundary_conditions", cls, ("at", "name"))


def motion(unit: str) -> ByShape:
    """Return the kind of a prescribed motion: a number, or an amplitude."""
    return ByShape(number=Number(unit), map=OneOf(Amplitude))


def _position_rows(point: PointRef, owner: str, spread: str | None = None) -> list[Row]:
    return [Row(*combine((1.0, c)), owner, axis)
            for c, axis in zip(point.position(spread), "xy", strict=True)]


def _hold_strain_free(point: PointRef, owner: str, out: Equations) -> None:
    """Hold the coordinates that a clamp fixes in a beam: position, the section vector r_y, and the warping.

    Derivatives along the axis (r_x, r_xy) are strains and curvatures, which stay free at a clamp. So do the
    components of r_yy, r_yyy, ... across the axis, by which a section thins and swells in bending.
    """
    out.rows += _position_rows(point, owner)
    columns, _ = point.director()
    out.rows += [Row(*combine((1.0, c)), owner, n) for c, n in zip(columns, ("ry_x", "ry_y"), strict=True)]
    for name in dict.fromkeys(name for _, name in point.mesh.plan.element.functionals):
        i, j = derivative_order(name)
        if i == 0 and j > 1:
            row = point.shape_row(0, j)
            columns = [point.columns(row, 0), point.columns(row, 1)]
            out.rows.append(hold_along(columns, point.angle, owner, "section warping"))


def _coordinates(point: PointRef) -> list[tuple[int, str]]:
    """Return the coordinates of the node at a point with their names; for a double node, those of both sides."""
    out: list[tuple[int, str]] = []
    for side in (point, point.before()):
        if side is not None and side.node is not None:
            names = side.mesh.coordinate_names[side.node]
            # both sides share the coordinates of the section
            out += [(dof, name) for dof, name in zip(side.dofs().tolist(), names, strict=True)
                    if side is point or name.startswith("rx")]
    return out


def _single(dof: int) -> tuple[Index, Array]:
    return np.array([dof], dtype=np.int64), np.ones(1)


def _breathe(point: PointRef, owner: str, out: Equations) -> None:
    """Hold the mean position and keep the section straight and its direction fixed; it may stretch."""
    element = point.mesh.plan.element
    if element.section_kind != "interpolated":
        raise PartError(("hold",), f"sections of type {element.name} are rigid and cannot breathe", "section or all")
    across = point.director()[1]
    angle = across - 0.5 * math.pi
    out.rows.append(hold_along(point.position(), angle, owner, "axial position"))
    out.rows.append(hold_along(point.position("uniform"), across, owner, "mean transverse position"))
    for j in range(1, element.degree_y + 1):
        row = point.shape_row(0, j)
        columns = [point.columns(row, 0), point.columns(row, 1)]
        held = hold_along(columns, angle, owner, "section direction" if j == 1 else "section warping")
        if len(held.coords):
            out.rows.append(held)


@support
@record
class Pin:
    """Holds the position of a point."""

    tag = "pin"
    at: Point = key(POINT, "Point that is held", example="beam@0")
    spread: str | None = key(SPREAD, SPREAD_DOC, default=None)
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)

    def add(self, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
        """Hold both components of the position."""
        out.rows += _position_rows(point, owner, self.spread)


@support
@record
class Roller:
    """Holds one direction of a point's position."""

    tag = "roller"
    at: Point = key(POINT, "Point that is held", example="beam@1")
    fixed: str | None = key(Choice("x", "y"), "Direction that is held", default=None, example="y")
    normal: tuple[float, float] | None = key(
        Vector(Number(), "nx, ny", nonzero=True),
        "Direction that is held if it is neither x nor y; of any length", default=None)
    spread: str | None = key(SPREAD, SPREAD_DOC, default=None)
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)

    def check(self) -> Iterator[Issue]:
        """Yield an issue unless exactly one of fixed and normal is given."""
        if (self.fixed is None) == (self.normal is None):
            given = "fixed and normal are both given" if self.fixed else (
                "the direction is missing")
            yield Issue(("normal",) if self.fixed else (), f"{{}}: {given}",
                        "one of fixed: x, fixed: y, or normal: [nx, ny]")

    def add(self, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
        """Hold one component of the position."""
        columns = point.position(self.spread)
        if self.normal is not None:
            nx, ny = self.normal
            length = math.hypot(nx, ny)
            coords, coefs = along(columns, nx / length, ny / length)
            out.rows.append(Row(coords, coefs, owner, f"position along ({nx:g}, {ny:g})"))
        elif self.fixed is not None:
            out.rows.append(Row(*combine((1.0, columns["xy".index(self.fixed)])), owner, self.fixed))


@support
@record
class Clamp:
    """Holds position and rotation of a section."""

    tag = "clamp"
    at: Point = key(POINT, "Point that is held", example="beam@0")
    hold: str | None = key(
        Choice("all", "section", "breathe"),
        "all: every nodal coordinate; section: position and section rotation; breathe: mean position and direction of "
        "the section, which stays straight but may stretch (default: for types with r_y, position, r_y and warping, "
        "with strains left free; for other types, section; with preset paper, all)",
        default=None)
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)

    def add(self, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
        """Hold the coordinates chosen by ``hold``, or the default of the element type."""
        hold = self.hold or ("all" if point.mesh.plan.preset == "paper" else None)
        element = point.mesh.plan.element
        if hold == "breathe":
            _breathe(point, owner, out)
        elif point.mesh.plan.rigid:
            # both components of the direction are held, hence the length too: no multiplier is needed
            out.rows += _position_rows(point, owner)
            columns, _ = point.director()
            out.rows += [Row(*combine((1.0, c)), owner, n) for c, n in zip(columns, ("rx_x", "rx_y"), strict=True)]
        elif hold == "section" or element.section_kind != "interpolated":
            out.rows += _position_rows(point, owner)
            hold_rotation(point, owner, out)
            if element.degree_y > 1 and not element.common_coefficients:
                out.warnings.append(f"{owner}: hold: section leaves the warping coordinates of {element.name} free "
                                    "there, which can soften the clamp; hold: breathe or all holds them")
        elif hold == "all" and point.node is not None:
            for dof, name in _coordinates(point):
                out.rows.append(Row(*_single(dof), owner, name))
        else:
            _hold_strain_free(point, owner, out)


@support
@record
class Fix:
    """Holds individual nodal coordinates of a node."""

    tag = "fix"
    at: Point = key(POINT, "Point that is held; must be a node", example="beam@0")
    coordinates: tuple[str, ...] = key(
        ListOf(Known("nodal_coordinates"), "nodal coordinates", 1),
        "Nodal coordinates that are held", example=["x", "y", "ry_x"])
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)

    def check(self) -> Iterator[Issue]:
        """Yield issues for coordinates that are named twice."""
        for i, name in enumerate(self.coordinates):
            if name in self.coordinates[:i]:
                yield Issue(("coordinates", i), f"{{}}.coordinates: {name} is named twice")

    def add(self, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
        """Hold the named coordinates of the node."""
        if point.node is None:
            raise PartError(("at",), f"fix holds coordinates of a node, and there is no node at {point.label}",
                            "a node, or a support of type pin, roller or clamp")
        coordinates = _coordinates(point)
        names = list(dict.fromkeys(name for _, name in coordinates))
        for k, name in enumerate(self.coordinates):
            if name not in names:
                raise PartError(("coordinates", k), f"{point.mesh.plan.element.name} has no coordinate '{name}' at "
                                f"{point.label}", "one of " + ", ".join(names))
            out.rows += [Row(*_single(dof), owner, name) for dof, other in coordinates if other == name]


@support
@record
class Prescribed:
    """Prescribes the motion of a point or the rotation of its section."""

    tag = "prescribed"
    at: Point = key(POINT, "Point that is moved", example="beam@1")
    x: float | Amplitude | None = key(motion("m"), "Position x", default=None)
    y: float | Amplitude | None = key(motion("m"), "Position y", default=None)
    ux: float | Amplitude | None = key(motion("m"), "Displacement in x", default=None)
    uy: float | Amplitude | None = key(motion("m"), "Displacement in y", default=None)
    angle: float | Amplitude | None = key(motion("rad"), "Rotation of the section from the "
                                          "reference", default=None)
    name: str | None = key(NAME, "Name of its reaction in the results", default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)

    def check(self) -> Iterator[Issue]:
        """Yield issues if nothing is prescribed, or the same motion twice."""
        given = self.motions
        if not given:
            yield Issue((), "{}: nothing is prescribed", "one or more of x, y, ux, uy, angle")
        for a, b in (("x", "ux"), ("y", "uy")):
            if a in given and b in given:
                yield Issue((b,), f"{{}}: {a} (position) and {b} (displacement) prescribe "
                            "the same motion", f"one of {a} and {b}")

    @property
    def motions(self) -> dict[str, float | Amplitude]:
        """The prescribed motions by key."""
        return {k: v for k in ("x", "y", "ux", "uy", "angle") if (v := getattr(self, k)) is not None}

    def add(self, point: PointRef, owner: str, timing: Timing, out: Equations) -> None:
        """Prescribe the motion of the point and the rotation of its section."""
        columns = point.position()
        reference = point.mesh.plan.position(point.s)[0]
        for k, axis in enumerate("xy"):
            position, displacement = getattr(self, axis), getattr(self, "u" + axis)
            if position is not None:
                moved = timing.motion(position, float(reference[k]))
                out.rows.append(Row(*combine((1.0, columns[k])), owner, axis, moved))
            if displacement is not None:
                out.rows.append(Row(*combine((1.0, columns[k])), owner, "u" + axis, timing.motion(displacement, 0.0)))
        if self.angle is not None:
            prescribe_rotation(point, timing.motion(self.angle, 0.0), owner, out)
