"""Contact spots of bodies, and their curves there as polynomials of each element."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..elements import contact_gaps as facing
from ..elements import contact_geometry as geometry
from ..elements.shape import Array, gauss, radau
from ..model.mesh import BodyMesh, Index

# points of a compliant contact along an element, over the end of a body, and beside this end, along a share END of the
# element; powers of a cubic curve
ALONG, ACROSS, BESIDE_END, END, CUBIC = 4, 3, 3, 0.125, 4


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

    A compliant contact is integrated over points of the faces (``layer_rule``) and ends. A hard contact has spots at
    the ends of elements and, in motion, at inner positions (``pieces_along``), and free ones in each interval,
    ``between`` in number; in statics (``places_move``) an element is one interval.
    """
    out, count = [], len(mesh.dofs)
    if compliant:
        out = [Spot(ie, float(2.0 * a - 1.0), eta, float(b * mesh.lengths[ie])) for eta in levels_of(mesh, side)
               for ie in range(count) for a, b in zip(*layer_rule(mesh, ie), strict=True)]
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


def layer_rule(mesh: BodyMesh, ie: int) -> tuple[Array, Array]:
    """Return places in [0, 1] along an element, and weights, of the points of a layer.

    They are closer at the ends of a body, the last of them there: a corner touches with little of a face, and a body
    that bends around the end of another one with no more than that.
    """
    first, last = (not mesh.plan.closed and ie == end for end in (0, len(mesh.dofs) - 1))
    (x, w), (z, v) = gauss(ALONG), radau(BESIDE_END)
    start, room = first * END, 1.0 - (first + last) * END
    places = [END * z[:first * len(z)], start + room * x, 1.0 - END * z[::-1][:last * len(z)]]
    return np.concatenate(places), np.concatenate([END * v[:first * len(v)], room * w, END * v[::-1][:last * len(v)]])


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


def face_of(mesh: BodyMesh, spot: Spot, side: str) -> float:
    """Return 1 for a spot on the upper face, -1 for one on the lower face, 0 on the axis or between the faces."""
    if side == "axis":
        return 0.0
    low, high = levels_of(mesh, side)
    return -1.0 if spot.eta == low else 1.0 if spot.eta == high else 0.0


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


class Curve(NamedTuple):
    """A curve of a body that may be touched: constants of its law (``contact_gaps``), and fields of its element."""

    constants: Array
    G: Array
    p0: Array
    dofs: Index


def curves_of(mesh: BodyMesh, side: str, follows: Mapping[int, Any], corners: Sequence[int] = (), fades: bool = False
              ) -> list[list[Curve]]:
    """Return the curves of a body that may be touched: its faces and ends, or its axis; ``follows`` as in ``moves``.

    Surfaces have other numbers after each of the ``corners``, given by the first element after it. If the pressure
    ``fades``, they end there, and each arm has curves of its own.
    """
    out, lengths = [], mesh.lengths
    for k, arm in enumerate(_arms(mesh, corners)):
        beyond = lengths[:arm[0]].sum(), lengths[arm[-1] + 1:].sum()
        if fades and corners:
            beyond = 0.0, 0.0
        elif mesh.plan.closed:
            beyond = math.inf, math.inf
        curves = [curve for j, eta in enumerate(levels_of(mesh, side), 1)
                  for curve in _face(mesh, arm, eta, side, follows, beyond, 4.0 * k + j)]
        for j, (ie, z) in enumerate(((arm[0], -1.0), (arm[-1], 1.0))):
            if side == "surface" and beyond[j] == 0.0:
                curves.append(_end(mesh, ie, z, follows, 4.0 * k + 3.0 + j))
        out.append(curves)
    return out if fades else [list(itertools.chain(*out))]


def corners_of(mesh: BodyMesh, turn: float, step: float = math.inf) -> list[int]:
    """Return the first element after each place where a body turns [rad], or its height changes, by more than this.

    The change of the height is relative to it.
    """
    out = []
    for after, _ in mesh.seams:
        before, k = mesh.piece_of((after - 1) % mesh.plan.count)
        angle = float(before.position(before.l * (k + 1))[1]) - float(mesh.angles[after])
        if abs(math.remainder(angle, 2.0 * math.pi)) > turn:
            out.append(after)
    if step < math.inf and mesh.plan.varying is not None:
        heights = np.array([height_along(mesh, ie) for ie in range(len(mesh.dofs))])
        changes = np.abs(heights @ (1.0, -1.0, 1.0) - np.roll(heights.sum(axis=1), 1))
        out += [k for k in np.flatnonzero(changes > step).tolist() if k > 0 or mesh.plan.closed]
    return sorted(set(out))


def _arms(mesh: BodyMesh, corners: Sequence[int]) -> list[list[int]]:
    """Return the elements of each part of a body between corners and ends."""
    count = len(mesh.dofs)
    cuts = [*corners, corners[0] + count] if corners and mesh.plan.closed else [0, *corners, count]
    return [[ie % count for ie in range(*cut)] for cut in itertools.pairwise(cuts)]


def _curve(mesh: BodyMesh, ie: int, rows: Array, kind: int, offset: Array, **constants: float) -> Curve:
    """Return a curve of an element with the constants that are named as in ``contact_gaps``."""
    par = np.zeros(facing.CURVE_SIZE)
    par[[geometry.SECTION, geometry.TERMS]] = kind, _terms(mesh)
    par[[geometry.OFFSET, geometry.SLOPE, geometry.BULGE]] = offset
    for name, value in constants.items():
        par[getattr(facing, name)] = value
    return Curve(par, rows, rows @ mesh.e0[mesh.dofs[ie] - mesh.first_dof], mesh.dofs[ie])


def _face(mesh: BodyMesh, arm: list[int], eta: float, side: str, follows: Mapping[int, Any],
          beyond: tuple[float, float], number: float) -> list[Curve]:
    """Return the curves of one face of an arm, or of its axis; the surface has lengths [m] ``beyond`` its ends."""
    lower = side == "surface" and eta == levels_of(mesh, side)[0]
    lengths, out = mesh.lengths[arm], list[Curve]()
    for k, ie in enumerate(arm):
        rows, own, kind = curve_rows(mesh, ie, eta)
        held = 0.0
        if follows:
            held = sum(part for part, z in ((1.0, -1.0), (2.0, 1.0)) if not moves(mesh, Spot(ie, z, eta, 0.0), follows))
        out.append(_curve(mesh, ie, padded(rows, own, _terms(mesh)), kind, offset_of(mesh, ie, eta),
                          BEFORE=beyond[0] + lengths[:k].sum(), AFTER=beyond[1] + lengths[k + 1:].sum(),
                          HALF=0.5 * lengths[k], SIGN=-1.0 if lower else 1.0, START=mesh.starts[ie],
                          SPAN=lengths[k], SUPPORTED_PART=held, NUMBER=number))
    return out


def _end(mesh: BodyMesh, ie: int, z: float, follows: Mapping[int, Any], number: float) -> Curve:
    """Return the straight curve across the end z of an element."""
    levels, height = levels_of(mesh, "surface"), mesh.plan.section.height
    low, high = np.array(levels) * (height_along(mesh, ie) @ (1.0, z, 1.0))
    rests = follows and not any(moves(mesh, Spot(ie, z, eta, 0.0), follows) for eta in levels)
    place = {"SIGN": -z, "START": mesh.starts[ie] + (mesh.lengths[ie] if z > 0.0 else 0.0), "NUMBER": number,
             "SUPPORTED_PART": 4.0 if rests else 0.0, "HALF": 0.25 * (high - low) * height}
    rows, own, kind = curve_rows(mesh, ie, 0.0)
    if kind == geometry.CURVE:
        return _curve(mesh, ie, _across(mesh, ie, z, low, high), kind, np.zeros(3), **place)
    below, above = 0.5 * low * height, 0.5 * high * height
    return _curve(mesh, ie, padded(rows, own, _terms(mesh)), kind, np.zeros(3), **place, END=z,
                  END_MIDDLE=0.5 * (below + above), END_HALF=0.5 * (above - below))


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
