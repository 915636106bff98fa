"""The curve of a beam between the ends of an element, where points of hard contact touch in statics.

In statics a hard contact point may be anywhere between the ends of an element. It touches with the curve that a beam
has between them: the cubic through both ends, with the section directions there minus the mean shear of the element.
With chord C = r_1 - r_0, directions T of the axis given by the sections and their mean T_m over the element,

    r(x) = r_0 + x C + l (x (1 - x)^2 (T_0 - T_m) - x^2 (1 - x) (T_1 - T_m)),  x = 0..1.

Under a force at x, the beam deflects by l^3 (x (1 - x))^3/3 EI + l x (1 - x)/kGA more (``elements.contact_sliding``),
and the displacements of the ends agree with beam theory to the order of the element. A force on the element's own
polynomial, with other third derivatives, would displace them with errors of order l^3.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..elements import contact_geometry as geometry
from ..elements.shape import Array, gauss
from ..model.mesh import BodyMesh, Index
from .contact_curves import CUBIC, Spot, touching_rows

# Gauss points for the mean direction
MEAN = 6
# powers of z of x (1 - x)^2 and -x^2 (1 - x) at x = (1 + z)/2
FIRST, LAST = np.array([1.0, -1.0, -1.0, 1.0]) / 8.0, np.array([-1.0, -1.0, 1.0, 1.0]) / 8.0


class BeamCurve:
    """The curve of a beam between the ends of an element, where it differs from the curve of the element.

    For sections with a rotation, x and y contain -C_y h and C_x h in addition to a part that is linear in the
    coordinates, ``linear`` (fields, n_dof). ``chord`` (2, n_dof) gives the chord C and ``bends`` (powers, n_dof) the
    polynomial h of rotations; ``start``, ``c0`` and ``h0`` are their values in the reference.
    """

    def __init__(self, mesh: BodyMesh, ie: int, eta: float, side: str) -> None:
        e, nc = mesh.e0[mesh.dofs[ie] - mesh.first_dof], mesh.plan.element.components
        rows, wanted, _ = touching_rows(mesh, ie, eta, side, True)
        axis, _, _ = touching_rows(mesh, ie, 0.0, "axis", True)
        straight, bends = _chord(mesh, ie, wanted), np.zeros((wanted, mesh.plan.element.n_dof))
        self.linear = rows.copy()
        self.linear[:2 * wanted] += straight - axis
        if mesh.plan.element.section_kind == "interpolated":
            turned = _bends(mesh, ie, 1, wanted) * mesh.classes[mesh.cls[ie]].shape.l
            # the direction along the axis is (r_y,y; -r_y,x)
            self.linear[:wanted, 1::nc] += turned
            self.linear[wanted:2 * wanted, 0::nc] -= turned
        else:
            bends[:, 2::nc] = _bends(mesh, ie, 0, wanted)
        self.bends, self.chord = bends, 2.0 * straight[[1, wanted + 1]]
        self.start, self.c0, self.h0 = self.linear @ e, self.chord @ e, bends @ e


def beam_curve(mesh: BodyMesh, spot: Spot, side: str, places_move: bool) -> BeamCurve | None:
    """Return the beam's curve for a free spot in statics, or None if it touches with the element's own curve."""
    if not (places_move and spot.free) or mesh.plan.rigid or mesh.plan.element.section_kind == "tangent":
        return None
    return BeamCurve(mesh, spot.ie, spot.eta, side)


def _chord(mesh: BodyMesh, ie: int, wanted: int) -> Array:
    """Return the rows (2 wanted, n_dof) of a straight line between the ends of an element."""
    element, shape, nc = mesh.plan.element, mesh.classes[mesh.cls[ie]].shape, mesh.plan.element.components
    (first, last), out = shape(np.array([0.0, 1.0]), np.zeros(2), 0, 0), np.zeros((2 * wanted, element.n_dof))
    for c in range(2):
        out[c * wanted, c::nc], out[c * wanted + 1, c::nc] = 0.5 * (first + last), 0.5 * (last - first)
    return out


def _bends(mesh: BodyMesh, ie: int, across: int, wanted: int) -> Array:
    """Return x (1 - x)^2 (f_0 - f_m) - x^2 (1 - x) (f_1 - f_m) as rows (wanted, shape functions) of powers of z.

    f is an interpolated field, or its derivative across the section.
    """
    shape, (x, w) = mesh.classes[mesh.cls[ie]].shape, gauss(MEAN)
    first, last = shape(np.array([0.0, 1.0]), np.zeros(2), 0, across)
    mean = w @ shape(x, np.zeros(len(x)), 0, across)
    out = np.zeros((wanted, len(mean)))
    out[:CUBIC] = np.outer(FIRST, first - mean) + np.outer(LAST, last - mean)
    return out


class _StackedCurves:
    """Points of a table whose curves have the same numbers of fields and coordinates, stacked for ``BeamCurves``."""

    def __init__(self, items: list[int], patches: list[Any]) -> None:
        curves = [patch.beam for patch in patches]
        self.items = np.array(items)
        wide, own = curves[0].linear.shape
        given = [patch.items() for patch in patches]
        self.dofs: Index = np.array([one.dofs[0][:own] for one in given])
        self.own = np.array([one.G[0][:wide, :own] for one in given]), np.array([one.p0[0][:wide] for one in given])
        self.linear, self.start, self.chord, self.bends, self.c0, self.h0 = (
            np.array([getattr(curve, name) for curve in curves])
            for name in ("linear", "start", "chord", "bends", "c0", "h0"))

    def at(self, which: Index, own: Any, d: Array) -> tuple[Array, Array]:
        """Return the rows (k, fields, n) and reference fields (k, fields) of points ``which`` at d (n_full,).

        They are those of the element's curve for ``own`` points (k,), else of the beam's curve, linearised about d.
        """
        u, rows, start = d[self.dofs[which]], self.linear[which].copy(), self.start[which].copy()
        chord, bends = self.chord[which], self.bends[which]
        c, h = self.c0[which] + np.einsum("kcn,kn->kc", chord, u), self.h0[which] + np.einsum("kpn,kn->kp", bends, u)
        count = h.shape[1]
        for first, i, sign in ((0, 1, -1.0), (count, 0, 1.0)):
            part, by_c = slice(first, first + count), sign * c[:, i, None]
            of_bends, of_chord = by_c[..., None] * bends, sign * h[..., None] * chord[:, i, None]
            rows[:, part] += of_bends + of_chord
            start[:, part] += by_c * h - np.einsum("kpn,kn->kp", of_bends + of_chord, u)
        return np.where(own[:, None, None], self.own[0][which], rows), np.where(own[:, None], self.own[1][which], start)


class BeamCurves:
    """The points of a table of point laws that touch with the curve of the beam or with that of the element."""

    def __init__(self, patches: Sequence[Any]) -> None:
        groups: dict[tuple[int, ...], tuple[list[int], list[Any]]] = {}
        at = 0
        for patch in patches:
            curve = getattr(patch, "beam", None)
            if curve is not None:
                items, found = groups.setdefault(curve.linear.shape, ([], []))
                items.append(at)
                found.append(patch)
            at += len(patch.items().p0)
        self.groups = [_StackedCurves(*group) for group in groups.values()]

    def write(self, points: Any, d: Array, unused: bool) -> None:
        """Write the curves of points at displacements d (n_full,) to the table (``kernels.points.Points``); those of
        ``unused`` points too, if asked for."""
        for group in self.groups:
            free = points.mem[group.items, geometry.PLACEMENT]
            which: Index = np.flatnonzero(unused | (free > 0.0))
            if not len(which):
                continue
            own = (free[which] == geometry.ON_ELEMENT) | (free[which] == geometry.UNUSED_ON_ELEMENT)
            rows, start = group.at(which, own, d)
            items, (wide, n) = group.items[which], rows.shape[1:]
            fields = points.field[items + 1] - points.field[items]
            points.p0[points.field[items][:, None] + np.arange(wide)] = start
            points.G[points.entry[items][:, None, None] + np.arange(n) * fields[:, None, None]
                     + np.arange(wide)[:, None]] = rows
