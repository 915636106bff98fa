"""Contact of bodies with one another and of a body with itself: points of one body, curves of the other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import chain, combinations, product
from typing import Any

import numpy as np

from ..elements import contact_gaps as facing
from ..elements import contact_geometry as geometry
from ..elements.contact_bodies import COMPLIANT_BODIES, HARD_BODIES, ROUGH_BODIES
from ..elements.contact_gaps import Facing
from ..elements.formulations.base import cross
from ..elements.shape import Array
from ..model.mesh import BodyMesh, Index
from .body_overlap import greatest_depth, greatest_height, nearest_on_segments
from .contact import STICK, TOUCH, Contact
from .contact_curves import (
    Spot,
    corners_of,
    curve_rows,
    curves_of,
    face_of,
    levels_of,
    moves,
    offset_of,
    pieces_along,
    place_along,
    spots,
)

# relative to a height (``_limits``): a point that is deeper is not in contact, because the far side is nearer
DEEPEST = 0.75
# relative to the height of a body: greater depths are reported as a failure (more than half is impossible)
TOO_DEEP = 0.4
# relative to a height: parts of a body whose distance along it is less do not touch one another
SELF_DISTANCE = 1.0
# relative to a height: step along the bodies when searching overlaps near a joint
SEARCH_STEP = 0.05
# length along which pressure fades at ends in motion, relative to that of a point, and to the size of the other body
FADE, FADE_BESIDE = 1.0 / 3.0, 0.25
# least turn [rad] and change of the height, relative to it, at which pressure fades in motion like at an end
TURN, STEP = 0.1, 0.02
# number of places along each curve for the geometry check in the reference
STATIONS = 9


def _excluded_length(one: BodyMesh, s: float, two: BodyMesh, t: float) -> float:
    """Return the distance [m] along two bodies, from joined places s and t [m], within which their points never touch.

    The bodies overlap there: their axes are less than a height apart in the reference, or will be when they fold.
    At a corner of one body, this applies to its two arms.
    """
    height = _mean_height(one, two)
    far, step = 0.5 * SELF_DISTANCE * height, SEARCH_STEP * height
    ways = _paths(one, s, step)
    for way, other in combinations(ways, 2) if one is two and s == t else product(ways, _paths(two, t, step)):
        most = min(len(way), len(other))
        near = np.hypot(*(way[:most] - other[:most]).T) < height
        far = max(far, step * float(most if near.all() else np.argmin(near)))
    return far


def _paths(mesh: BodyMesh, s: float, step: float) -> list[Array]:
    """Return points (k, 2) of a body in the reference, at distances ``step``, in both directions from s [m]."""
    length = mesh.plan.length
    return [np.array([mesh.plan.position((s + way * step * k) / length)[0] for k in range(int(room / step) + 1)])
            for way, room in ((1.0, length - s), (-1.0, s)) if room > step]


def _mean_height(one: BodyMesh, two: BodyMesh) -> float:
    return 0.5 * float(one.plan.section.height + two.plan.section.height)


def _alike(rows: Array) -> list[Index]:
    """Return the groups of equal rows as arrays of their indices."""
    inverse = np.unique(rows, axis=0, return_inverse=True)[1].ravel()
    return [np.flatnonzero(inverse == k) for k in range(inverse.max() + 1)]


def _corners(mesh: BodyMesh) -> list[Spot]:
    """Return the corner spots at the ends of a body."""
    if mesh.plan.closed:
        return []
    return [Spot(ie, z, eta, float(mesh.lengths[ie])) for eta in levels_of(mesh, "surface")
            for ie, z in ((0, -1.0), (len(mesh.dofs) - 1, 1.0))]


def _rank(mesh: BodyMesh) -> tuple[Any, ...]:
    """Return the sort key of two bodies; the first has the points of a hard contact: elastic, then shorter elements.

    The result does not depend on which body is listed first.
    """
    return mesh.plan.rigid, float(mesh.lengths.max()), mesh.plan.name


def body_pairs(item: Contact, name: str, one: BodyMesh, two: BodyMesh, extent: float, rapid: float,
               follows: Mapping[int, Any], joined: Sequence[tuple[float, float]], between: int) -> list[BodyPair]:
    """Return a pair with the points of each of two bodies that may touch the other (the same body: touching itself).

    With a law, each body bears half the pressure. In hard contact, one body has points everywhere, and the other only
    at its corners. ``joined`` are the places along each [m] that joints connect, ``between`` is the number of movable
    points of each interval.
    """
    soft, itself = item.law is not None, one is two
    # a body overlaps itself at a corner sharper than a right angle
    places = [*joined, *((one.starts[k], one.starts[k]) for k in corners_of(one, 0.5 * math.pi) if itself)]
    reach, out = [_excluded_length(one, s, two, t) for s, t in places], []
    for k, (mesh, other) in enumerate([(one, two)] if itself else [(one, two), (two, one)]):
        whole = soft or itself or _rank(mesh) < _rank(other)
        excluded = [(at[k], near) for at, near in zip(places, reach, strict=True)]
        # a point that may move along an interval counts with all of it
        half = 0.5 * mesh.lengths / pieces_along(mesh)
        chosen = [p for p in _spots(item, mesh, whole, between)
                  if all(abs(place_along(mesh, p) - s) >= near + (half[p.ie] if p.free else 0.0)
                         for s, near in excluded)]
        if chosen:
            out.append(BodyPair(item, name, mesh, other, extent, chosen, whole, rapid, follows, excluded))
    return out


def _spots(item: Contact, mesh: BodyMesh, whole: bool, between: int) -> list[Spot]:
    """Return the spots of a body that may touch another one: on all of it, or only at its ends."""
    if whole:
        return spots(mesh, item.side, item.law is not None, False, between)
    return _corners(mesh) if item.side == "surface" else [
        p for p in spots(mesh, "axis", False, False) if _is_end(mesh, p)]


class BodyPair:
    """Points of a body that may touch another one, or itself, as point laws: see ``contact.ContactPair``.

    ``whole``: whether it has points everywhere or only at corners. The coordinates and fields of an item are those of
    its point, followed by those of the curve opposite to it, which changes (``kernels.facing``). ``curves`` are those
    of the other body, ``arms`` how many of them each part of it has between corners where pressure fades, and
    ``all_coordinates`` (k, n) all coordinates that an item can ever act on.
    """

    frame, fed, signal, size = None, -1, None, facing.BODY_MEMORY
    # its points touch bodies,
    on_bodies = True
    # stay at their places on their own curve,
    places_move = False
    # and share no fields, because the curve opposite to each changes
    runs = None
    # no spots are left out because of supports
    driven = None

    def __init__(self, item: Contact, name: str, mesh: BodyMesh, other: BodyMesh, extent: float, chosen: list[Spot],
                 whole: bool = True, rapid: float = 0.0, follows: Mapping[int, Any] | None = None,
                 excluded: Sequence[tuple[float, float]] = ()) -> None:
        self.item, self.name, self.mesh, self.against = item, name, mesh, other
        self.hard, self.body, self.other, self.scale = item.law is None, mesh.plan.name, other.plan.name, extent
        self.spots, self.whole, self.rapid, self.follows = chosen, whole, rapid, follows or {}
        self.excluded = list(excluded)
        self.law = COMPLIANT_BODIES if not self.hard else ROUGH_BODIES if item.friction else HARD_BODIES
        # the reported force is that on the first body named; a body that touches itself has none
        self.sign = 0.0 if item.between is None else 1.0 if item.between[0] == self.body else -1.0
        self.s: Array = np.array([place_along(mesh, p) / mesh.plan.length for p in self.spots])
        # in statics equilibria need no continuous energy
        self.fades = not self.hard and rapid > 0.0
        corners = [] if self.hard or item.side == "axis" else corners_of(other, TURN, STEP)
        arms = curves_of(other, item.side, self.follows, corners, self.fades)
        self.curves, self.arms = list(chain(*arms)), [len(arm) for arm in arms]
        self._items()

    def with_points(self, item: Contact, mesh: BodyMesh, chosen: list[Spot]) -> BodyPair:
        """Return chosen points of one of the two bodies as a pair with the other, under a contact of the same kind."""
        other = self.against if mesh is self.mesh else self.mesh
        return BodyPair(item, self.name, mesh, other, self.scale, chosen, rapid=self.rapid)

    def _items(self) -> None:
        """Create the items, each opposite to the first curve."""
        mesh, opposite = self.mesh, self.curves[0]
        G, start, par = [], [], []
        for p in self.spots:
            rows, terms, kind = curve_rows(mesh, p.ie, p.eta)
            both = np.zeros((len(rows) + len(opposite.G), rows.shape[1] + opposite.G.shape[1]))
            both[:len(rows), :rows.shape[1]], both[len(rows):, rows.shape[1]:] = rows, opposite.G
            G.append(both)
            start.append(np.concatenate([rows @ mesh.e0[mesh.dofs[p.ie] - mesh.first_dof], opposite.p0]))
            face = face_of(mesh, p, self.item.side)
            par.append([kind, terms, *offset_of(mesh, p.ie, p.eta), p.z, *self._law(p), TOUCH * self.scale,
                        geometry.STILL, 0.0, 0.0, 1.0, face, 0.0, 0.0, 0.0, geometry.BODY, *opposite.constants,
                        *self._limits(p, face)])
        own = np.array([mesh.dofs[p.ie] for p in self.spots]).reshape(len(self.spots), -1)
        self.dofs: Index = np.hstack([own, np.broadcast_to(opposite.dofs, (len(own), len(opposite.dofs)))])
        self.G, self.p0, self.par = np.array(G), np.array(start), np.array(par)
        same = [geometry.SECTION, geometry.TERMS, geometry.OFFSET, geometry.SLOPE, geometry.BULGE]
        self.alike = _alike(self.par[:, same])
        self.alike_curves = _alike(np.array([c.constants for c in self.curves])[
            :, [*same, facing.END, facing.END_MIDDLE, facing.END_HALF]])
        self.mem: Array = np.zeros((len(self.spots), facing.BODY_MEMORY))
        self.mem[:, geometry.PLACE] = [p.z for p in self.spots]
        self.mem[:, geometry.STATUS], self.mem[:, geometry.AFTER_IMPACT] = -1.0, geometry.NO_IMPACT
        self.mem[:, geometry.SLIP_STATUS] = geometry.CLOSES if self.hard else 0.0
        self.mem[:, geometry.PLACEMENT] = [-1.0 if p.free else 0.0 for p in self.spots]
        self.own = len(self.p0[0]) - len(opposite.p0), own.shape[1]
        if self.item.side == "axis":
            self.mem[:, facing.SIDE] = self._sides()

    def places(self, d: Array | None = None) -> Array:
        """Return the positions (k, 2) of the points in the reference, or at displacements d (n_full,)."""
        out, u = np.zeros((len(self.spots), 2)), np.zeros_like(self.p0)
        fields, coords = self.own
        if d is not None:
            u[:, :fields] = np.einsum("kfc,kc->kf", self.G[:, :fields, :coords], d[self.dofs[:, :coords]])
        for rows in self.alike:
            # points on curves with the same constants are evaluated together
            work = np.zeros((geometry.WORK, len(rows)))
            geometry.position_at(self.par[rows[0]], self.p0[rows].T, u[rows].T, self.par[rows, geometry.HOME], work)
            out[rows] = work[[geometry.RHO, geometry.RHO + 1]].T
        return out

    def _sides(self) -> Array:
        """Return the side of the other axis on which each point is in the reference, 0 beyond its ends."""
        (a, b), out = self.segments(), np.zeros(len(self.spots))
        for k, p in enumerate(self.places()):
            distance, z = nearest_on_segments(p, a, b)
            n = int(np.argmin(distance))
            beyond = not self.against.plan.closed and ((n == 0 and z[n] == 0.0) or (n == len(z) - 1 and z[n] == 1.0))
            out[k] = 0.0 if beyond else np.sign(cross(b[n] - a[n], p - a[n]))
        return out

    @cached_property
    def places_along(self) -> Array:
        """The distance along the other body of the middle of each curve [m]."""
        return np.array([c.constants[facing.START] + 0.5 * c.constants[facing.SPAN] for c in self.curves])

    def segments(self, d: Array | None = None) -> tuple[Array, Array]:
        """Return the ends (n, 2) of straight segments of the other body's curves in the reference or at d (n_full,)."""
        z, found = np.linspace(-1.0, 1.0, STATIONS), np.zeros((len(self.curves), STATIONS, 2))
        for rows in self.alike_curves:
            some = [self.curves[k] for k in rows]
            par, p0 = some[0].constants.copy(), np.array([c.p0 for c in some])
            u = np.zeros_like(p0)
            if d is not None:
                u = np.einsum("kfc,kc->kf", np.array([c.G for c in some]), d[np.array([c.dofs for c in some])])
            # the end of a body is straight between its corners
            straight = par[facing.END] != 0.0
            for k in (0, -1) if straight else (slice(None),):
                work, across = np.zeros((2, geometry.WORK, len(rows), 1 if straight else STATIONS))
                facing.curve_at(par, p0.T[:, :, None], u.T[:, :, None], z[k], work, across)
                line = np.moveaxis(work[[geometry.RHO, geometry.RHO + 1]], 0, -1)
                found[rows, k] = line[:, 0] if straight else line
            if straight:
                found[rows] = np.linspace(found[rows, 0], found[rows, -1], STATIONS, axis=1)
        return found[:, :-1].reshape(-1, 2), found[:, 1:].reshape(-1, 2)

    def overlap(self, d: Array | None = None) -> tuple[float, float]:
        """Return the greatest depth of a point in the other body, and S of this point; see ``body_overlap``."""
        return greatest_depth(self, d, 0.0, self.item.side)

    @property
    def too_deep(self) -> float:
        """The depth [m] above which a point may pass through the other body."""
        return TOO_DEEP * float(self.against.plan.section.height)

    @cached_property
    def height(self) -> float:
        """The largest height of the other body [m]."""
        return greatest_height(self.against)

    def pressed_through(self, d: Array) -> str:
        """Return a message if a point is so deep in the other body at d (n_full,) that it may pass through it, else "".

        The limit is just below half the height: a deeper point is nearer to the far side.
        """
        depth, s = greatest_depth(self, d, self.too_deep, self.item.side)
        if depth <= self.too_deep:
            return ""
        return f"{self.name}: {self.body} is pressed {depth:.4g} into {self.other} at S = {s:.4g}"

    def _law(self, p: Spot) -> tuple[float, float, float, float, float]:
        """Return length, stiffness, damping (hard contact: range of z), friction and stick stiffness of a spot."""
        law, section = self.item.law, self.mesh.plan.section
        if law is not None:
            # the other half of the pressure comes from the points of the other body, or of the other part
            weight = 0.5 * p.weight
            return weight, law.stiffness, law.damping, self.item.friction, weight * law.stiffness
        l, reach, mu = float(self.mesh.lengths[p.ie]), 1.0 / pieces_along(self.mesh), self.item.friction
        if self.mesh.plan.rigid:
            # in statics, the stiffness follows the forces of the scene (model/contacts.py)
            return p.weight, 1.0, reach, mu, float(section.rhoA) * self.mesh.plan.length * self.rapid**2
        return p.weight, section.EI / l**3, reach, mu, STICK * section.EA / l

    def _limits(self, p: Spot, face: float) -> list[float]:
        """Return the constants that limit where a point may touch (``contact_gaps``)."""
        itself, other = self.against is self.mesh, self.against.plan
        loop = other.length if other.closed else 0.0
        height, opposite = _mean_height(self.mesh, self.against), float(other.section.height)
        # a layer has points of the faces beside those of the end
        corner = p.z if _is_end(self.mesh, p) and (self.hard or face == 0.0) else 0.0
        yields = float(pieces_along(self.against)) if self.hard and (
            corner == 1.0 if itself else not self.whole) else 0.0
        beside = FADE_BESIDE * min(opposite, other.length)
        fade = min(FADE * p.weight, beside) if self.fades else 0.0
        return [DEEPEST * (opposite if fade else min(height, opposite)), place_along(self.mesh, p),
                float(self.mesh.lengths[p.ie]), SELF_DISTANCE * height if itself else 0.0, loop if itself else 0.0,
                corner, float(itself and self.hard and corner == 0.0), float(self.item.side == "axis"), yields, loop,
                float(bool(self.follows) and not moves(self.mesh, p, self.follows)), fade]

    def own_dofs(self, i: int) -> Index:
        """Return the coordinates of the element of point i."""
        return self.dofs[i, :self.own[1]]

    @cached_property
    def all_coordinates(self) -> Index:
        """All coordinates that each item can act on (k, n); points refer to rows of it."""
        other = np.unique(self.against.dofs)
        own = self.dofs[:, :self.own[1]]
        return np.hstack([own, np.broadcast_to(other, (len(own), len(other)))])

    @property
    def coordinate_sets(self) -> Index:
        """All sets of coordinates on which an item can act together (k, n): one element of each body."""
        own, other = np.unique(self.dofs[:, :self.own[1]], axis=0), self.against.dofs
        return np.hstack([np.repeat(own, len(other), axis=0), np.tile(other, (len(own), 1))])


def _is_end(mesh: BodyMesh, p: Spot) -> bool:
    """Return whether a spot is at an end of its body."""
    return not mesh.plan.closed and not p.free and (p.ie, p.z) in ((0, -1.0), (len(mesh.dofs) - 1, 1.0))


def _curves_beside(pairs: Sequence[BodyPair]) -> Index:
    """Return the curves (n, 2) before and after each curve on its face, or itself where there is none."""
    out, first = [], 0
    for pair in pairs:
        constants = np.array([c.constants for c in pair.curves])
        beside = np.repeat(np.arange(len(constants))[:, None], 2, axis=1)
        for number in (1.0, 2.0):
            face = np.flatnonzero(constants[:, facing.NUMBER] % 4.0 == number)
            face = face[np.argsort(constants[face, facing.START])]
            beside[face[1:], 0], beside[face[:-1], 1] = face[:-1], face[1:]
            if pair.against.plan.closed and len(face):
                beside[face[0], 0], beside[face[-1], 1] = face[-1], face[0]
        out.append(first + beside)
        first += len(constants)
    return np.concatenate([np.zeros((0, 2), dtype=np.int64), *out])


def facing_table(patches: Sequence[Any]) -> Facing:
    """Return the table of the point laws that touch bodies among the patches of a model, in their order."""
    ways: list[BodyPair] = []
    item: list[int] = []
    way: list[int] = []
    own: list[tuple[int, int]] = []
    at = 0
    for patch in patches:
        count = len(patch.items().p0)
        pair = getattr(patch, "pair", None)
        if pair is not None and pair.on_bodies:
            if not any(pair is known for known in ways):
                ways.append(pair)
            item += range(at, at + count)
            way += [next(k for k, known in enumerate(ways) if known is pair)] * count
            own += [pair.own] * count
        at += count
    curves = [c for pair in ways for c in pair.curves]
    counts = [n for pair in ways for n in pair.arms]
    trees = [2 * n - 1 for n in counts]

    def whole(values: Any, shape: tuple[int, ...] = ()) -> Index:
        return np.array(values, dtype=np.int64).reshape(-1, *shape)

    def joined(parts: list[Any], dtype: Any = np.float64) -> Any:
        return np.concatenate([np.zeros(0), *(p.ravel() for p in parts)]).astype(dtype)
    before = np.cumsum([[0, 0, 0], *([len(c.dofs), c.G.size, len(c.p0)] for c in curves)], axis=0)[:-1]
    p0 = joined([c.p0 for c in curves])
    return Facing(whole(item), whole(way), whole(own, (2,)), whole(np.cumsum([0, *(len(pair.arms) for pair in ways)])),
                  whole(np.cumsum([0, *counts])),
                  whole(np.cumsum([0, *trees])), np.array([c.constants for c in curves]).reshape(-1, facing.CURVE_SIZE),
                  whole(_curves_beside(ways), (2,)), whole([(len(c.p0), len(c.dofs)) for c in curves], (2,)),
                  whole(before, (3,)), joined([c.dofs for c in curves], np.int64), joined([c.G for c in curves]), p0,
                  np.zeros_like(p0), np.zeros((len(curves), 5)), np.zeros((sum(trees), 8)))
