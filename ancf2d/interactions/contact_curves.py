"""Contact spots of bodies, and their curves there as polynomials of each element.

In statics a hard contact point may be anywhere between the ends of an element. It touches with the curve that a beam
has between them: the cubic through both ends, with the section directions there minus the mean shear of the element.
With chord C = r_1 - r_0, directions T of the axis given by the sections and their mean T_m over the element,

    r(x) = r_0 + x C + l (x (1 - x)^2 (T_0 - T_m) - x^2 (1 - x) (T_1 - T_m)),  x = 0..1.

Under a force at x, the beam deflects by l^3 (x (1 - x))^3/3 EI + l x (1 - x)/kGA more (``elements.contact_sliding``),
and the displacements of the ends agree with beam theory to the order of the element. A force on the element's own
polynomial, with other third derivatives, would displace them with errors of order l^3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..elements import contact_gaps as facing
from ..elements import contact_geometry as geometry
from ..elements.shape import Array, gauss
from ..model.mesh import BodyMesh, Index

# Gauss points of a compliant contact along an element and over the end of a body, and those for the mean direction
ALONG, ACROSS, MEAN = 4, 3, 6
# powers of z of x (1 - x)^2 and -x^2 (1 - x) at x = (1 + z)/2
FIRST, LAST = np.array([1.0, -1.0, -1.0, 1.0]) / 8.0, np.array([-1.0, -1.0, 1.0, 1.0]) / 8.0
CUBIC = 4


@dataclass(frozen=True)
class Spot:
    """A place on a body that may touch: element, z from -1 to 1 along it, eta = 2 y/h off the axis.

    ``weight`` [m] is the length that it represents; ``free``: it may move along its element.
    """

    ie: int
    z: float
    eta: float
    weight: float
    free: bool = False


def pieces_along(mesh: BodyMesh) -> int:
    """Return the number of contact intervals of an element: its nodal vectors r, r_x, ... but for the last node."""
    own = [node for node, name in mesh.plan.element.functionals if "y" not in name.partition("_")[2]]
    shared = sum(node == len(mesh.plan.element.nodes) - 1 for node in own)
    return max(len(own) - shared, 1)


def place_along(mesh: BodyMesh, spot: Spot) -> float:
    """Return the position of a spot along its body [m]."""
    return float(mesh.starts[spot.ie] + 0.5 * (spot.z + 1.0) * mesh.lengths[spot.ie])


def levels_of(mesh: BodyMesh, side: str) -> list[float]:
    """Return eta of the curves that may touch: the lower and upper face, or the axis."""
    if side == "axis":
        return [0.0]
    low = -2.0 * mesh.plan.section.height_of_axis / mesh.plan.section.height
    return [low, 2.0 + low]


def spots(mesh: BodyMesh, side: str, compliant: bool, places_move: bool, between: int = 1) -> list[Spot]:
    """Return the spots of a body that may touch.

    A compliant contact is integrated over Gauss points of the faces and ends. A hard contact has spots at the ends of
    elements and, in motion, at inner positions (``pieces_along``), and free ones in each interval, ``between`` in
    number; in statics (``places_move``) an element is one interval.
    """
    out, count = [], len(mesh.dofs)
    if compliant:
        x, w = gauss(ALONG)
        out = [Spot(ie, 2.0 * a - 1.0, eta, b * float(mesh.lengths[ie])) for eta in levels_of(mesh, side)
               for ie in range(count) for a, b in zip(x.tolist(), w.tolist(), strict=True)]
        if side == "surface" and not mesh.plan.closed:
            low, high = levels_of(mesh, side)
            y, w = gauss(ACROSS)
            out += [Spot(ie, z, low + (high - low) * a, b * mesh.plan.section.height)
                    for ie, z in ((0, -1.0), (count - 1, 1.0)) for a, b in zip(y.tolist(), w.tolist(), strict=True)]
        return out
    parts = 1 if places_move else pieces_along(mesh)
    for eta in levels_of(mesh, side):
        for ie in range(count):
            for i in range(parts):
                z = -1.0 + 2.0 * i / parts
                # at a corner, the adjacent pieces share the point of the axis
                if i > 0 or ie == 0 or side == "surface" or mesh.shares_start[ie]:
                    out.append(Spot(ie, z, eta, float(mesh.lengths[ie]) / parts))
                out += between * [Spot(ie, z + 1.0 / parts, eta, float(mesh.lengths[ie]) / parts, free=True)]
        if not mesh.plan.closed:
            out.append(Spot(count - 1, 1.0, eta, float(mesh.lengths[-1]) / parts))
    return out


def movable(mesh: BodyMesh, side: str, compliant: bool, follows: Mapping[int, Any], places_move: bool) -> list[Spot]:
    """Return the spots of a body that may touch, without those that supports keep in place (see ``moves``)."""
    return _chosen(mesh, spots(mesh, side, compliant, places_move), follows, True)


def driven(mesh: BodyMesh, side: str, follows: Mapping[int, Any]) -> list[Spot]:
    """Return the spots of a body in hard contact whose position only supports determine.

    If faces touch, this includes spots on the axis held by supports, about which a section may rotate.
    """
    sides = dict.fromkeys((side, "axis"))
    home = [p for each in sides for p in spots(mesh, each, False, True) if not p.free]
    return _chosen(mesh, home, follows, False)


def _chosen(mesh: BodyMesh, some: list[Spot], follows: Mapping[int, Any], moved: bool) -> list[Spot]:
    concerned: Any = np.isin(mesh.dofs, list(follows)).any(axis=1)
    return [p for p in some if (not concerned[p.ie] or moves(mesh, p, follows)) == moved]


def moves(mesh: BodyMesh, spot: Spot, follows: Mapping[int, Any]) -> bool:
    """Return whether unknowns move a spot in the reference; ``follows`` has the terms of all other coordinates."""
    dofs = mesh.dofs[spot.ie]
    rows, terms, kind = curve_rows(mesh, spot.ie, spot.eta)
    parts = rows.reshape(-1, terms, rows.shape[1])
    ways: Array = spot.z ** np.arange(terms) @ parts
    if kind == geometry.OF_TANGENT and spot.eta != 0.0:
        # a change of length of the tangent causes no rotation
        slope = (np.arange(terms) * spot.z ** np.maximum(np.arange(terms) - 1, 0)) @ parts
        tangent = slope @ mesh.e0[dofs - mesh.first_dof]
        ways = np.vstack([ways, (tangent[0] * slope[1] - tangent[1] * slope[0]) / np.hypot(*tangent)])
    if kind == geometry.OF_THETA and spot.eta == 0.0:
        # rotation does not move points on the axis
        ways = ways[:2]
    least, total = 1e-12 * np.abs(ways).max(), dict[int, Array]()
    for c, way in zip(dofs.tolist(), ways.T, strict=True):
        for k, factor in (follows[c].terms if c in follows else {c: 1.0}).items():
            total[k] = total.get(k, 0.0) + factor * way
    return any(np.abs(way).max() > least for way in total.values())


def height_along(mesh: BodyMesh, ie: int) -> Array:
    """Return coefficients (3,) of the height along an element as a parabola, relative to that in shape functions."""
    if mesh.plan.varying is None:
        return np.array([1.0, 0.0, 0.0])
    found = mesh.classes[mesh.cls[ie]].sampler.at(np.array([0.0, 0.5, 1.0])).height
    first, middle, last = np.broadcast_to(found, 3) / mesh.plan.section.height
    return np.array([middle, 0.5 * (last - first), 0.5 * (first + last) - middle]).round(14)


def face_of(spot: Spot, side: str) -> float:
    """Return 1 for a spot above the axis (upper face), -1 for one below (lower face), 0 on the axis."""
    return 0.0 if side == "axis" or abs(spot.eta) < 1e-12 else math.copysign(1.0, spot.eta)


def offset_of(mesh: BodyMesh, ie: int, eta: float) -> Array:
    """Return the distance of a curve from the axis for sections that stay straight, else 0, as coefficients (3,)."""
    if mesh.plan.element.section_kind == "interpolated":
        return np.zeros(3)
    return 0.5 * eta * mesh.plan.section.height * height_along(mesh, ie)


def is_cubic(mesh: BodyMesh) -> bool:
    """Return whether sections rotate along an element as in a beam under forces at its ends."""
    return mesh.plan.element.degree_of_turn > 1


def compliances_of(mesh: BodyMesh, spot: Spot, places_move: bool) -> tuple[float, float]:
    """Return l^3/3 EI and l/kGA of the interval of a free spot in statics, else zeros; see ``contact_sliding``."""
    if not (places_move and spot.free) or mesh.plan.rigid:
        return 0.0, 0.0
    l, middle = spot.weight, mesh.classes[mesh.cls[spot.ie]].sampler.at(np.array([0.5]))
    shear = 0.0 if mesh.plan.element.section_kind == "tangent" else l / float(np.mean(middle.kGA))
    return l**3 / (3.0 * float(np.mean(middle.EI))), shear


def curve_rows(mesh: BodyMesh, ie: int, eta: float) -> tuple[Array, int, int]:
    """Return the matrix (fields, n_dof) from coordinates to coefficients of a curve, its number of powers, its kind."""
    element, shape = mesh.plan.element, mesh.classes[mesh.cls[ie]].shape
    kinds = {"interpolated": geometry.CURVE, "theta": geometry.OF_THETA, "tangent": geometry.OF_TANGENT}
    kind = kinds[element.section_kind]
    half, nc, terms = shape.l / 2, element.components, _degree_along(mesh) + 1
    middle, slope, bulge = eta * height_along(mesh, ie) if kind == geometry.CURVE else np.zeros(3)
    powers, part = np.zeros((terms, element.n_dof // nc)), np.ones(1)
    # sum of y^k/k! times derivatives across the axis, with the distance y(z) from the height in the middle
    y = 0.5 * mesh.plan.section.height * np.array([0.0, slope, bulge])
    for k in range(element.degree_y + 1 if y.any() else 1):
        part = np.convolve(part, y) / k if k else part
        for j in range(element.degree_x + 1):
            row = shape(np.array([0.5]), np.array([middle]), j, k)[0] * half**j / math.factorial(j)
            powers[j:j + len(part)] += np.outer(part, row)
    sets = 3 if kind == geometry.OF_THETA else 2
    rows = np.zeros((sets * terms, element.n_dof))
    for c in range(sets):
        rows[c * terms:(c + 1) * terms, c::nc] = powers
    return rows, terms, kind


def _degree_along(mesh: BodyMesh) -> int:
    """Return the degree of the curves along the elements of a body; y is a parabola if its height varies."""
    element = mesh.plan.element
    return element.degree_x + (0 if mesh.plan.varying is None else 2 * element.degree_y)


def padded(rows: Array, terms: int, wanted: int) -> Array:
    """Return rows extended by zeros to more powers."""
    out = np.zeros((len(rows) // terms, wanted, rows.shape[1]))
    out[:, :terms] = rows.reshape(-1, terms, rows.shape[1])
    return out.reshape(-1, rows.shape[1])


def touching_rows(mesh: BodyMesh, ie: int, eta: float, side: str, places_move: bool) -> tuple[Array, int, int]:
    """Return the same as ``curve_rows`` for the touching curve; with ``places_move``, at least up to cubic powers."""
    rows, terms, kind = curve_rows(mesh, ie, eta)
    if places_move and not mesh.plan.rigid:
        wanted = max(terms, CUBIC)
        rows, terms = padded(rows, terms, wanted), wanted
    # with side axis, the rotation of sections does not matter
    return (rows[:2 * terms], terms, geometry.CURVE) if side == "axis" else (rows, terms, kind)


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


class Curve(NamedTuple):
    """A curve of a body that may be touched: constants of its law (``contact_gaps``), and fields of its element."""

    constants: Array
    G: Array
    p0: Array
    dofs: Index


def _across(mesh: BodyMesh, ie: int, z: float, low: float, high: float) -> Array:
    """Return the matrix (fields, n_dof) from coordinates to coefficients of the curve across an end of an element."""
    element, shape = mesh.plan.element, mesh.classes[mesh.cls[ie]].shape
    terms, half, nc = _terms(mesh), 0.25 * (high - low) * mesh.plan.section.height, element.components
    at = (np.array([0.5 * (z + 1.0)]), np.array([0.5 * (low + high)]))
    rows = np.zeros((2 * terms, element.n_dof))
    for j in range(element.degree_y + 1):
        for c in range(2):
            rows[c * terms + j, c::nc] = shape(*at, 0, j)[0] * half**j / math.factorial(j)
    return rows


def _terms(mesh: BodyMesh) -> int:
    """Return the number of powers of the curves of a body."""
    return 1 + max(_degree_along(mesh), mesh.plan.element.degree_y)


def curves_of(mesh: BodyMesh, side: str, follows: Mapping[int, Any]) -> list[Curve]:
    """Return the curves of a body that may be touched: its faces and ends, or its axis; ``follows`` as in ``moves``."""
    out, count, levels, terms = [], len(mesh.dofs), levels_of(mesh, side), _terms(mesh)

    def add(ie: int, rows: Array, kind: int, offset: Array, **constants: float) -> None:
        par = np.zeros(facing.CURVE_SIZE)
        par[[geometry.SECTION, geometry.TERMS, geometry.OFFSET, geometry.SLOPE, geometry.BULGE]] = kind, terms, *offset
        for name, value in constants.items():
            par[getattr(facing, name)] = value
        out.append(Curve(par, rows, rows @ mesh.e0[mesh.dofs[ie] - mesh.first_dof], mesh.dofs[ie]))

    for eta in levels:
        for ie in range(count):
            rows, own, kind = curve_rows(mesh, ie, eta)
            start, span = float(mesh.starts[ie]), float(mesh.lengths[ie])
            before, after = (math.inf, math.inf) if mesh.plan.closed else (
                start, mesh.plan.length - start - span if ie < count - 1 else 0.0)
            add(ie, padded(rows, own, terms), kind, offset_of(mesh, ie, eta), BEFORE=before,
                AFTER=after, HALF=0.5 * span, SIGN=-1.0 if eta == levels[0] and side == "surface" else 1.0,
                START=start, SPAN=span, SUPPORTED_PART=sum(
                    k for k, z in ((1, -1.0), (2, 1.0)) if follows and not moves(mesh, Spot(ie, z, eta, 0.0), follows)))
    if side == "surface" and not mesh.plan.closed:
        for ie, z in ((0, -1.0), (count - 1, 1.0)):
            low, high = np.array(levels) * (height_along(mesh, ie) @ (1.0, z, 1.0))
            rests = follows and not any(moves(mesh, Spot(ie, z, eta, 0.0), follows) for eta in levels)
            place = {"SIGN": -z, "START": 0.0 if z < 0.0 else mesh.plan.length, "SUPPORTED_PART": 4.0 if rests else 0.0,
                     "HALF": 0.25 * (high - low) * mesh.plan.section.height}
            rows, own, kind = curve_rows(mesh, ie, 0.0)
            if kind == geometry.CURVE:
                add(ie, _across(mesh, ie, z, low, high), kind, np.zeros(3), **place)
            else:
                below, above = 0.5 * low * mesh.plan.section.height, 0.5 * high * mesh.plan.section.height
                add(ie, padded(rows, own, terms), kind, np.zeros(3), **place, END=z, END_MIDDLE=0.5 * (below + above),
                    END_HALF=0.5 * (above - below))
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
