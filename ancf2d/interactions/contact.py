"""Contact of bodies with obstacles: the record of the case, and the points at which bodies touch."""

from __future__ import annotations

import math
from collections.abc import Iterator, Set
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import Choice, ListOf, Name, Number
from ..case.records import Record
from ..case.schema.case import register
from ..elements import contact_geometry as geometry
from ..elements.contact import COMPLIANT, HARD
from ..elements.shape import Array, gauss
from ..model.mesh import BodyMesh, Index
from ..model.point_patch import Items, PointConstraint
from ..model.points import PointRef
from .obstacles import Frame

NAME = Name()
# Gauss points of a compliant contact along an element and over the end of a body
ALONG, ACROSS = 4, 3
# of friction before it slides, beside the stiffness of an element along its axis
STICK = 100.0
# gaps beside the extent of the scene that count as closed
TOUCH = 1e-12


@record
class ContactLaw:
    """Compliant contact: the pressure grows with the depth of the overlap and its rate."""

    stiffness: float = key(Number("N/m^2", gt=0), "Force per length of the body and per depth", example=1e6)
    damping: float = key(Number("N s/m^2", ge=0), "Force per length and per rate of the depth; the pressure is never "
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
        """Yield what does not say what touches."""
        if (self.between is None) == (self.self_ is None):
            yield Issue((), "{}: a contact needs two partners, or a body that touches itself", "between or self")
        if self.between is not None and self.between[0] == self.between[1]:
            yield Issue(("between",), "{}.between: the same name is given twice", "self, for a body that touches "
                        "itself")
        if self.law is not None and self.restitution is not None:
            yield Issue(("restitution",), "{}: with a law, its damping determines the rebound", "law or restitution")


register("contacts", Contact)


@dataclass(frozen=True)
class Spot:
    """A place of a body that may touch: element, z from -1 to 1 along it, eta = 2 y/h off the axis.

    ``weight`` [m] is the length that it stands for; ``free``: it may move along its element.
    """

    ie: int
    z: float
    eta: float
    weight: float
    free: bool = False


def pieces_along(mesh: BodyMesh) -> int:
    """Return into how many intervals an element is divided: as many as it has positions of the axis of its own."""
    element = mesh.plan.element
    own = [node for node, name in element.functionals if "y" not in name.partition("_")[2]]
    shared = sum(node == len(element.nodes) - 1 for node in own)
    return max(len(own) - shared, 1)


def levels_of(mesh: BodyMesh, side: str) -> list[float]:
    """Return eta of the curves that may touch: the lower and upper face, or the axis."""
    if side == "axis":
        return [0.0]
    below = 2.0 * mesh.plan.section.height_of_axis / mesh.plan.section.height
    return [-below, 2.0 - below]


def spots(mesh: BodyMesh, side: str, compliant: bool) -> list[Spot]:
    """Return where a body may touch.

    A compliant contact is integrated over Gauss points of the faces and ends. One without a law holds the nodes and
    the places between them up to the number of positions that an element has, and one more in each interval is free.
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
    parts = pieces_along(mesh)
    for eta in levels_of(mesh, side):
        for ie in range(count):
            for i in range(parts):
                z = -1.0 + 2.0 * i / parts
                # at a corner between pieces both have the same point of the axis
                if i > 0 or ie == 0 or side == "surface" or mesh.shares_start[ie]:
                    out.append(Spot(ie, z, eta, float(mesh.lengths[ie]) / parts))
                out.append(Spot(ie, z + 1.0 / parts, eta, float(mesh.lengths[ie]) / parts, free=True))
        if not mesh.plan.closed:
            out.append(Spot(count - 1, 1.0, eta, float(mesh.lengths[-1]) / parts))
    return out


def eta_at(mesh: BodyMesh, spot: Spot) -> float:
    """Return eta of a spot in the shape functions' height, where the height varies along the body."""
    if mesh.plan.varying is None:
        return spot.eta
    height = mesh.classes[mesh.cls[spot.ie]].sampler.at(np.array([0.5 * (spot.z + 1.0)])).height
    return spot.eta * float(np.broadcast_to(height, 1)[0]) / mesh.plan.section.height


def curve_rows(mesh: BodyMesh, ie: int, eta: float) -> tuple[Array, int, int]:
    """Return the matrix (fields, n_dof) that gives the coefficients of a curve of an element, its powers, its kind."""
    element, shape = mesh.plan.element, mesh.classes[mesh.cls[ie]].shape
    kinds = {"interpolated": geometry.CURVE, "theta": geometry.OF_THETA, "tangent": geometry.OF_TANGENT}
    kind = kinds[element.section_kind]
    terms, half, nc = element.degree_x + 1, shape.l / 2, element.components
    at = (np.array([0.5]), np.array([eta if kind == geometry.CURVE else 0.0]))
    powers = np.stack([shape(*at, j, 0)[0] * half**j / math.factorial(j) for j in range(terms)])
    sets = 3 if kind == geometry.OF_THETA else 2
    rows = np.zeros((sets * terms, element.n_dof))
    for c in range(sets):
        rows[c * terms:(c + 1) * terms, c::nc] = powers
    return rows, terms, kind


def face_of(spot: Spot, side: str) -> float:
    """Return 1 for the upper face, -1 for the lower one, 0 for the axis and for the end of a body."""
    return 0.0 if side == "axis" or abs(spot.eta) < 1e-12 else math.copysign(1.0, spot.eta)


def offset_of(mesh: BodyMesh, eta: float) -> float:
    """Return how far a curve is off the axis, where sections stay straight."""
    return 0.0 if mesh.plan.element.section_kind == "interpolated" else 0.5 * eta * mesh.plan.section.height


class ContactPair:
    """Contact of a body with an obstacle: its spots as point laws, all of the same number of coordinates.

    ``dofs`` (m, n), ``G`` (m, fields, n), ``p0`` (m, fields), ``par`` and ``mem`` (m, .): see ``point_patch.Items``;
    ``spots`` (m) and their ``s`` (m,) along the body; ``hard``: whether each has a multiplier behind its fields.
    ``held`` are the coordinates that supports hold, ``rapid`` [1/s] is a rate far above those of a motion, with which a
    rigid body that sticks yields.
    """

    # whether its points touch bodies
    on_bodies = False

    @cached_property
    def runs(self) -> Index:
        """How many spots from each on (m,) are of the same curve of an element, so that they share fields."""
        out = np.ones(len(self.spots), dtype=np.int64)
        for i in range(len(self.spots) - 2, -1, -1):
            if self.on_curve[i] == self.on_curve[i + 1]:
                out[i] += out[i + 1]
        return out

    def __init__(self, item: Contact, name: str, mesh: BodyMesh, obstacle: Any, frame: Frame, extent: float,
                 held: Set[int] = frozenset(), rapid: float = 0.0, chosen: list[Spot] | None = None) -> None:
        self.obstacle = obstacle
        self.item, self.name, self.mesh, self.frame, self.hard = item, name, mesh, frame, item.law is None
        self.body, self.other, self.law, self.sign = mesh.plan.name, "", COMPLIANT if item.law else HARD, 1.0
        self.spots = chosen or movable(mesh, item, held)
        self.s: Array = np.array([(mesh.starts[p.ie] + 0.5 * (p.z + 1.0) * mesh.lengths[p.ie]) / mesh.plan.length
                                  for p in self.spots])
        self.rapid = rapid
        coords, rows, p0 = _pose_rows(frame)
        dofs, G, start, par = [], [], [], []
        known: dict[tuple[int, float], tuple[Array, int, int]] = {}
        # the element and the height of the curve that each spot is of
        self.on_curve = [(p.ie, eta_at(mesh, p)) for p in self.spots]
        for p, (_, eta) in zip(self.spots, self.on_curve, strict=True):
            at = int(mesh.cls[p.ie]), eta
            if at not in known:
                known[at] = curve_rows(mesh, p.ie, eta)
            own, terms, kind = known[at]
            if item.side == "axis":
                # whatever the section does
                own, kind = own[:2 * terms], geometry.CURVE
            both = np.zeros((len(own) + len(rows), own.shape[1] + len(coords)))
            both[:len(own), :own.shape[1]], both[len(own):, own.shape[1]:] = own, rows
            G.append(both)
            start.append(np.concatenate([own @ mesh.e0[mesh.dofs[p.ie] - mesh.first_dof], p0]))
            dofs.append(np.concatenate([mesh.dofs[p.ie], coords]))
            par.append([kind, terms, offset_of(mesh, eta), p.z, p.weight, *self._law(p), TOUCH * extent, frame.kind,
                        *frame.origin, frame.length, face_of(p, item.side), *obstacle.shape()])
        self.dofs: Index = np.array(dofs)
        self.G, self.p0, self.par = np.array(G), np.array(start), np.array(par)
        self.mem: Array = np.zeros((len(self.spots), geometry.MEMORY))
        self.mem[:, geometry.PLACE] = self.par[:, geometry.HOME]
        self.mem[:, geometry.HELD], self.mem[:, geometry.BEHIND] = -1.0, geometry.NONE
        self.mem[:, geometry.SLIDES] = geometry.CLOSES if self.hard else 0.0
        self.mem[:, geometry.FREE] = [-1.0 if p.free else 0.0 for p in self.spots]
        # with a law, friction holds to where the first state is
        self.mem[:, geometry.ANCHOR] = 0.0 if self.hard else np.nan
        self.fed = tuple(self.G.shape[1] - 3 + k for k in range(3)) if frame.kind == geometry.BY_ANGLE else -1
        self.signal = frame.signals or None
        self.scale, self.size = extent, geometry.MEMORY

    def at(self, item: Contact, mesh: BodyMesh, chosen: list[Spot]) -> ContactPair:
        """Return chosen points of the body beside the obstacle, under a contact of the same kind."""
        return ContactPair(item, self.name, mesh, self.obstacle, self.frame, self.scale, chosen=chosen)

    def _law(self, p: Spot) -> tuple[float, float, float, float]:
        """Return stiffness, damping, friction and the stiffness of what sticks."""
        mu, law = self.item.friction, self.item.law
        if law is not None:
            return law.stiffness, law.damping, mu, law.stiffness * p.weight
        # a point that may move looks for where it should be within so much of z
        reach = 1.0 / pieces_along(self.mesh)
        section, l = self.mesh.plan.section, float(self.mesh.lengths[p.ie])
        if self.mesh.plan.rigid:
            mass = float(section.rhoA) * self.mesh.plan.length
            # in statics it follows the forces of the scene (model/contacts.py)
            return 1.0, reach, mu, mass * self.rapid**2
        return section.EI / l**3, reach, mu, STICK * section.EA / l

    def pressed_through(self, d: Array) -> str:
        """Return nothing: only bodies are thin."""
        return ""

    @property
    def meetings(self) -> Index:
        """All coordinates that meet in an item (m, n)."""
        return self.dofs

    reach = meetings

    def gaps(self, d: Array, t: float) -> Array:
        """Return the gap (m,) of each spot at home at displacements d (n_full,)."""
        out, work = np.zeros(len(self.spots)), np.zeros(geometry.WORK)
        given = [signal(t) for signal in self.frame.signals] if self.frame.kind == geometry.BY_ANGLE else []
        for i, par in enumerate(self.par):
            u = self.G[i] @ d[self.dofs[i]]
            if given:
                u[-3:] = given
            geometry.stand(par, self.p0[i], u, par[geometry.HOME], work)
            out[i] = geometry.gap_at(par, work[geometry.RHO], work[geometry.RHO + 1], -1.0)[0]
        return out


def movable(mesh: BodyMesh, item: Contact, held: Set[int]) -> list[Spot]:
    """Return where a body may touch but for what coordinates that supports hold leave where it is."""
    concerned = np.isin(mesh.dofs, list(held)).sum(axis=1) > 0
    return [p for p in spots(mesh, item.side, item.law is not None)
            if not (concerned[p.ie] and _moved_by(mesh, p) <= held)]


def _moved_by(mesh: BodyMesh, spot: Spot) -> set[int]:
    """Return the coordinates that move a spot."""
    eta = eta_at(mesh, spot)
    rows, terms, kind = curve_rows(mesh, spot.ie, eta)
    powers = spot.z ** np.arange(terms)
    slopes = np.arange(terms) * spot.z ** np.maximum(np.arange(terms) - 1, 0)
    parts = rows.reshape(-1, terms, rows.shape[1])
    sizes: Array = np.abs(powers @ parts).sum(axis=0)
    if kind == geometry.OF_TANGENT and eta != 0.0:
        sizes = sizes + np.abs(slopes @ parts).sum(axis=0)
    used = sizes > 1e-12 * sizes.max()
    return set(mesh.dofs[spot.ie][used].tolist())


def _pose_rows(frame: Frame) -> tuple[Index, Array, Array]:
    """Return the coordinates (n,) of an obstacle's pose, the matrix that gives its fields, and their reference."""
    coords = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(f.coords for f in frame.fields)]))
    rows = np.zeros((len(frame.fields), len(coords)))
    for row, f in zip(rows, frame.fields, strict=True):
        np.add.at(row, np.searchsorted(coords, f.coords), f.weights)
    return coords.astype(np.int64), rows, np.array([f.p0 for f in frame.fields])


class CompliantContact:
    """The spots of a compliant contact as a spring: a law with potential, damping and friction."""

    rest = slack = 0.0
    angle = False
    # when it acts: always
    active = None
    sections: tuple[PointRef | None, ...] = ()
    # what acts along a body has no ends
    ends: tuple[()] = ()

    def __init__(self, pair: Any) -> None:
        self.pair, self.law, self.dofs, self.signal = pair, pair.law, pair.meetings, pair.signal
        self.symmetric = pair.item.friction == 0.0
        self.damped = bool(pair.item.law and pair.item.law.damping) or not self.symmetric

    def items(self) -> Items:
        """Return the law as tables have it."""
        p = self.pair
        return Items(self.law, p.dofs, p.G, p.p0, p.par, p.mem, p.signal, p.fed, restitution=math.nan, runs=p.runs,
                     stays=not p.on_bodies)

    def keep_in(self, par: Array, mem: Array) -> None:
        """Keep constants and memory in rows of a table."""
        self.pair.par, self.pair.mem = par, mem

    def tighten(self, share: float) -> None:
        """Do nothing: what overlaps in the reference presses at once."""

    def forces(self, u: Array, t: float, rates: Array | None = None) -> tuple[Array, Array, Array]:
        """Return that nothing acts in the reference."""
        m = self.pair.G.shape[1]
        return np.zeros(m), np.zeros((m, m)), np.zeros((m, m))

    @property
    def p0(self) -> Array:
        """The fields of the first spot in the reference."""
        return np.asarray(self.pair.p0[0])


class ContactPoint(PointConstraint):
    """One spot of a contact without a law: its multiplier is minus the force there."""

    def __init__(self, pair: Any, i: int) -> None:
        self.law, self.pair, self.number = pair.law, pair, i
        self.G = np.vstack([pair.G[i], np.zeros(pair.G.shape[2])])
        self.p0 = np.append(pair.p0[i], 0.0)
        self.par, self.mem, self.dofs = pair.par[i], pair.mem[i], pair.reach[i]
        self.signal, self.fed, self.sections, self.facing = pair.signal, pair.fed, (), None  # type: ignore[assignment]
        self.symmetric = pair.item.friction == 0.0
        self.owner, self.holds, self.scale = pair.name, f"contact at S = {pair.s[i]:.4g}", pair.scale

    @property
    def coordinates(self) -> Index:
        """The coordinates that it acts on in the reference, the multiplier last."""
        return np.append(self.pair.dofs[self.number], self.multiplier)

    def turns_by(self, t: float) -> list[tuple[PointRef, float]]:
        """Return that no rotation is prescribed."""
        return []

    def opposed(self, d: Array, t: float) -> bool:
        """Return that no directions have to agree."""
        return False

    def items(self) -> Items:
        """Return the law as tables have it."""
        return super().items()._replace(restitution=self.pair.item.restitution or 0.0, stays=not self.pair.on_bodies)

    def keep_in(self, par: Array, mem: Array) -> None:
        """Keep constants and memory in rows of a table."""
        self.par, self.mem = par, mem


