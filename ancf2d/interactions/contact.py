"""Contact of bodies with obstacles: the record of the case, and the points at which bodies touch."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, cached_property
from typing import Any, cast

import numpy as np

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import Choice, ListOf, Name, Number
from ..case.records import Record
from ..case.schema.case import register
from ..elements import contact_geometry as geometry
from ..elements.contact import COMPLIANT, HARD
from ..elements.shape import Array
from ..model.mesh import BodyMesh, Index
from ..model.point_patch import Items, PointConstraint
from ..model.points import PointRef
from .beam_curves import BeamCurve, beam_curve
from .contact_curves import (
    Spot,
    compliances_of,
    face_of,
    is_cubic,
    movable,
    offset_of,
    pieces_along,
    place_along,
    touching_rows,
)
from .obstacles import Frame

NAME = Name()
# stiffness of friction before sliding, relative to the axial stiffness of an element
STICK = 100.0
# largest gap that counts as closed, relative to the extent of the scene
TOUCH = 1e-12
# largest cosine between face normal and gap gradient at which a face may touch without a law: a thin body has a back.
# With one, the end of a body bears alone if it is nearly parallel to the obstacle (FACE_COSINE)
BACK = 0.7


@record
class ContactLaw:
    """Compliant contact: the pressure grows with the penetration and its rate."""

    stiffness: float = key(Number("N/m^2", gt=0), "Force per length of the body and per penetration", example=1e6)
    damping: float = key(Number("N s/m^2", ge=0), "Force per length and per rate of penetration; the pressure is never "
                         "negative",
                         default=0.0)


@record
class Contact:
    """Contact of a body with an obstacle, with another body or with itself."""

    tag = ""
    between: tuple[str, ...] | None = key(ListOf(Name("the name of a body or obstacle"), "names", 2, 2),
                                          "A body, and an obstacle or another body", default=None,
                                          example=["beam", "drum"])
    self_: str | None = key(Name("the name of a body"), "Body that may touch itself", default=None, refers="bodies")
    side: str = key(Choice("surface", "axis"), "What touches: the faces at y = +-height/2 and the ends, or the axis",
                    default="surface")
    law: ContactLaw | None = key(Record(ContactLaw), "Compliant contact (default: nothing penetrates)", default=None)
    friction: float = key(Number("", ge=0), "Coulomb's coefficient of friction", default=0.0)
    restitution: float | None = key(Number("", ge=0, le=1), "Coefficient of restitution: share of the normal velocity "
                                    "after an impact (dynamic, without law; default: 0, plastic)", default=None)
    name: str | None = key(NAME, "Name", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield issues for partners that are missing or the same, and for a restitution with a law."""
        if (self.between is None) == (self.self_ is None):
            yield Issue((), "{}: a contact needs two partners, or a body that touches itself", "between or self")
        if self.between is not None and self.between[0] == self.between[1]:
            yield Issue(("between",), "{}.between: the same name is given twice", "self, for a body that touches "
                        "itself")
        if self.law is not None and self.restitution is not None:
            yield Issue(("restitution",), "{}: with a law, its damping determines the rebound", "law or restitution")


register("contacts", Contact)


def movable_by_element(spots: Sequence[Spot]) -> dict[tuple[int, float], list[int]]:
    """Return the numbers of the spots that may move, by element and ``eta``."""
    out: dict[tuple[int, float], list[int]] = {}
    for k, p in enumerate(spots):
        if p.free:
            out.setdefault((p.ie, p.eta), []).append(k)
    return out


class ContactPair:
    """Contact of a body with an obstacle: its spots as point laws, all with the same number of coordinates.

    ``dofs`` (m, n), ``G`` (m, fields, n), ``p0`` (m, fields), ``par`` and ``mem`` (m, .): see ``point_patch.Items``;
    ``spots`` (m) and their ``s`` (m,) along the body; ``hard``: whether each has a multiplier after its fields.
    ``places_move``: its points may move along elements to where a body lifts off (``contact_curves``). ``follows`` are
    the coordinates that are not unknowns; ``rapid`` [1/s] is a rate far above those of a motion, which gives the stick
    stiffness of a rigid body.
    """

    # whether its points touch bodies
    on_bodies = False
    # distance of the surface from its given place; see ``set_back``
    setback = 0.0
    # for hard contact in statics: the spots that only supports move, without contact points, and their reference gaps
    # (m,)
    driven: tuple[ContactPair, Array] | None = None

    @cached_property
    def runs(self) -> Index:
        """How many spots, counted from each one (m,), are on the same curve of an element and so share fields."""
        out = np.ones(len(self.spots), dtype=np.int64)
        for i in range(len(self.spots) - 2, -1, -1):
            if self.on_curve[i] == self.on_curve[i + 1]:
                out[i] += out[i + 1]
        return out

    def __init__(self, item: Contact, name: str, mesh: BodyMesh, obstacle: Any, frame: Frame, extent: float,
                 follows: Mapping[int, Any] | None = None, rapid: float = 0.0, chosen: list[Spot] | None = None,
                 places_move: bool = False) -> None:
        self.obstacle = obstacle
        self.item, self.name, self.mesh, self.frame, self.hard = item, name, mesh, frame, item.law is None
        self.body, self.other, self.law, self.sign = mesh.plan.name, "", COMPLIANT if item.law else HARD, 1.0
        self.places_move = places_move and self.hard
        self.spots = chosen or movable(mesh, item.side, not self.hard, follows or {}, self.places_move)
        self.s: Array = np.array([place_along(mesh, p) / mesh.plan.length for p in self.spots])
        self.rapid, self.cubic = rapid, is_cubic(mesh)
        coords, rows, p0 = _pose_rows(frame)
        dofs, G, start, par = [], [], [], []
        seen = cache(lambda cls, eta: touching_rows(mesh, int(np.flatnonzero(mesh.cls == cls)[0]), eta, item.side,
                                                    self.places_move))
        # element and height of the curve of each spot
        self.on_curve = [(p.ie, p.eta) for p in self.spots]
        for p in self.spots:
            own, terms, kind = seen(int(mesh.cls[p.ie]), p.eta)
            both = np.zeros((len(own) + len(rows), own.shape[1] + len(coords)))
            both[:len(own), :own.shape[1]], both[len(own):, own.shape[1]:] = own, rows
            G.append(both)
            start.append(np.concatenate([own @ mesh.e0[mesh.dofs[p.ie] - mesh.first_dof], p0]))
            dofs.append(np.concatenate([mesh.dofs[p.ie], coords]))
            par.append([kind, terms, *offset_of(mesh, p.ie, p.eta), p.z, p.weight, *self._law(p), TOUCH * extent,
                        frame.kind, *frame.origin, frame.length, face_of(mesh, p, item.side),
                        BACK if self.hard else geometry.FACE_COSINE, *compliances_of(mesh, p, self.places_move),
                        *obstacle.shape()])
        self.dofs: Index = np.array(dofs)
        self.G, self.p0, self.par = np.array(G), np.array(start), np.array(par)
        self.mem: Array = np.zeros((len(self.spots), geometry.MEMORY))
        self.mem[:, geometry.PLACE] = self.par[:, geometry.HOME]
        self.mem[:, geometry.STATUS], self.mem[:, geometry.AFTER_IMPACT] = -1.0, geometry.NO_IMPACT
        self.mem[:, geometry.START_GAP] = geometry.OUTSIDE
        self.mem[:, geometry.SLIP_STATUS] = geometry.CLOSES if self.hard else 0.0
        self.mem[:, geometry.PLACEMENT] = [-1.0 if p.free else 0.0 for p in self.spots]
        # with a law, friction holds a point to its place in the first state
        self.mem[:, geometry.ANCHOR] = 0.0 if self.hard else np.nan
        self.fed = tuple(self.G.shape[1] - 3 + k for k in range(3)) if frame.kind == geometry.BY_ANGLE else -1
        self.signal = frame.signals or None
        self.scale, self.size = extent, geometry.MEMORY

    def with_points(self, item: Contact, mesh: BodyMesh, chosen: list[Spot]) -> ContactPair:
        """Return chosen points of the body as a pair with the same obstacle, under a contact of the same kind."""
        out = ContactPair(item, self.name, mesh, self.obstacle, self.frame, self.scale, chosen=chosen)
        if self.setback > 0.0:
            out.set_back(self.setback)
        return out

    def overlap(self, d: Array) -> tuple[float, float]:
        """Return the greatest depth of a spot in the obstacle at displacements d (n_full,) and t = 0, and its S."""
        gaps = self.gaps(d, 0.0)
        k = int(np.argmin(gaps))
        return -float(gaps[k]), float(self.s[k])

    def set_back(self, setback: float) -> None:
        """Move the surface of a smooth obstacle this distance [m] away from the bodies."""
        shape = self.obstacle.shape(setback)
        self.par[:, -len(shape):], self.setback = shape, setback

    def beam_at(self, k: int) -> BeamCurve | None:
        """Return the curve of the beam at spot k, or None if it is the curve of the element itself."""
        return beam_curve(self.mesh, self.spots[k], self.item.side, self.places_move)

    def _law(self, p: Spot) -> tuple[float, float, float, float]:
        """Return stiffness, damping (hard contact: range of z), friction and stick stiffness of a spot."""
        mu, law = self.item.friction, self.item.law
        if law is not None:
            return law.stiffness, law.damping, mu, law.stiffness * p.weight
        # in place of damping: how far in z a movable point searches its place
        reach = 1.0 if self.places_move else 1.0 / pieces_along(self.mesh)
        section, l = self.mesh.plan.section, float(self.mesh.lengths[p.ie])
        if self.mesh.plan.rigid:
            mass = float(section.rhoA) * self.mesh.plan.length
            # in statics, the stiffness follows the forces of the scene (model/contacts.py)
            return 1.0, reach, mu, mass * self.rapid**2
        return section.EI / l**3, reach, mu, STICK * section.EA / l

    @property
    def coordinate_sets(self) -> Index:
        """All coordinates on which an item acts together (m, n)."""
        return self.dofs

    all_coordinates = coordinate_sets

    def gaps(self, d: Array, t: float) -> Array:
        """Return the gap (m,) of each spot at its home place at displacements d (n_full,) and t."""
        out, work = np.zeros(len(self.spots)), np.zeros(geometry.WORK)
        given = [signal(t) for signal in self.frame.signals] if self.frame.kind == geometry.BY_ANGLE else []
        for i, par in enumerate(self.par):
            u = self.G[i] @ d[self.dofs[i]]
            if given:
                u[-3:] = given
            geometry.position_at(par, self.p0[i], u, par[geometry.HOME], work)
            out[i] = geometry.gap_at(par, work[geometry.RHO], work[geometry.RHO + 1], -1.0)[0]
        return out


def _pose_rows(frame: Frame) -> tuple[Index, Array, Array]:
    """Return the coordinates (n,) of an obstacle's pose, the matrix from them to its fields, and p0 of these fields."""
    coords = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(f.coords for f in frame.fields)]))
    rows = np.zeros((len(frame.fields), len(coords)))
    for row, f in zip(rows, frame.fields, strict=True):
        np.add.at(row, np.searchsorted(coords, f.coords), f.weights)
    return coords.astype(np.int64), rows, np.array([f.p0 for f in frame.fields])


class CompliantContact:
    """The spots of a compliant contact as one spring: a law with potential, damping and friction."""

    rest = slack = 0.0
    angle = False
    # no spring of the case
    path = ""
    # when it acts: always
    active = None
    sections: tuple[PointRef | None, ...] = ()
    # a load along a body has no end points
    ends: tuple[()] = ()

    def __init__(self, pair: Any) -> None:
        self.pair, self.law, self.signal = pair, pair.law, pair.signal
        self.symmetric = pair.item.friction == 0.0
        self.damped = bool(pair.item.law and pair.item.law.damping) or not self.symmetric
        # all points of an elastic body together: see ``point_patch.PointPatch``
        self.breaks: Sequence[int] = range(len(pair.spots)) if pair.mesh.plan.rigid else (0,)

    @cached_property
    def dofs(self) -> Index:
        """All sets of coordinates on which a spot acts together (m, n)."""
        return cast("Index", self.pair.coordinate_sets)

    def items(self) -> Items:
        """Return the law at all spots as point items."""
        p = self.pair
        return Items(self.law, p.dofs, p.G, p.p0, p.par, p.mem, p.signal, p.fed, restitution=math.nan, runs=p.runs,
                     stays=not p.on_bodies)

    def keep_in(self, par: Array, mem: Array, at: int) -> None:
        """Use rows of tables, from ``at`` on, as constants and memory."""
        rows = slice(at, at + len(self.pair.mem))
        self.pair.par, self.pair.mem = par[rows], mem[rows]

    def tighten(self, share: float) -> None:
        """Do nothing: bodies that overlap in the reference press with their full force at once."""


class ContactPoint(PointConstraint):
    """One spot of a hard contact; its multiplier is minus the contact force."""

    def __init__(self, pair: Any, i: int) -> None:
        self.law, self.pair, self.number = pair.law, pair, i
        self.beam = pair.beam_at(i) if pair.places_move else None
        self.G = np.vstack([pair.G[i], np.zeros(pair.G.shape[2])])
        self.p0 = np.append(pair.p0[i], 0.0)
        self.keep_in(pair.par, pair.mem, i)
        self.dofs = pair.all_coordinates[i]
        self.signal, self.fed, self.sections, self.facing = pair.signal, pair.fed, (), None  # type: ignore[assignment]
        self.symmetric = pair.item.friction == 0.0
        self.owner, self.holds, self.scale = pair.name, f"contact at S = {pair.s[i]:.4g}", pair.scale

    @property
    def coordinates(self) -> Index:
        """The coordinates that it acts on in the reference, the multiplier last."""
        return np.append(self.pair.dofs[self.number], self.multiplier)

    def turns_by(self, t: float) -> list[tuple[PointRef, float]]:
        """Return an empty list: no rotation is prescribed."""
        return []

    def opposed(self, d: Array, t: float) -> bool:
        """Return False: no directions have to agree."""
        return False

    def items(self) -> Items:
        """Return the law as point items."""
        return super().items()._replace(restitution=self.pair.item.restitution or 0.0,
                                        stays=not self.pair.on_bodies and self.beam is None)

    def keep_in(self, par: Array, mem: Array, at: int) -> None:
        """Use row ``at`` of tables as constants and memory."""
        super().keep_in(par, mem, at)
        self.table, self.row = mem, at


def memory_of(points: Sequence[ContactPoint]) -> Array:
    """Return the history variables of points (m, .): rows of the table that contains them, or a copy of these."""
    first, last = points[0], points[-1]
    if first.table is last.table and last.row - first.row == len(points) - 1:
        return first.table[first.row:last.row + 1]
    return np.array([p.mem for p in points])
