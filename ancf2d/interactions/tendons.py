"""Tendons: strings under tension, guided along a body or through eyelets without friction.

The potential of a tendon depends on its length only (``tendon_laws``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import add
from typing import Any, NamedTuple

import numpy as np

from ..case.binder import Issue, reversed_range
from ..case.declare import key, record
from ..case.kinds import NAME, ListOf, Name, Number, Vector
from ..case.records import ByShape, Record
from ..case.schema.active import ACTIVE, ACTIVE_DOC, Active
from ..case.schema.amplitudes import Amplitude
from ..case.schema.points import POINT, POSITION, GroundPoint, Point, Probe
from ..case.schema.profiles import Profile, ProfileOf
from ..elements.point_laws import DIRECTION, THETA
from ..elements.shape import Array
from ..errors import PartError
from ..model.mesh import BodyMesh, Index
from ..model.point_patch import NOTHING, Field, PointPatch, constant_field, position_fields
from ..model.points import PointRef, point_ref
from ..model.profiles import SIDE, breaks, values
from .body_loads import VARYING, covered
from .forces import AMPLITUDE, AMPLITUDE_DOC, LoadContext, LoadSet, load, moment_at
from .tendon_laws import ELASTIC, TENSION, piece, slopes, taut

# greatest number of fields of an elastic tendon, which has one stiffness matrix for all of them
MOST = 504
# points along an element in addition to those of line loads; elastic tendons have fewer
FEW = -2
# step for the slope of a profile, relative to the length of the body
STEP = 1e-6
# number of points of a drawn guide along the whole body
DRAWN = 40


class ElasticTendon(PointPatch):
    """A tendon with stiffness, treated as a spring; ``slack`` is the length at which it does not pull."""

    damped, angle, breaks = False, False, (0,)

    def __init__(self, fields: Sequence[Field], size: int, stiffness: float, slack: float, signal: Any) -> None:
        super().__init__(ELASTIC, fields, [stiffness, 1.0, slack, size], signal)
        zero = np.zeros(len(self.p0))
        self.rest = sum(float(np.hypot(*piece(self.p0, zero, zero, at, size))) for at in range(0, len(zero), size))
        self.par[1] = self.slack = self.rest

    @property
    def winds(self) -> bool:
        """Whether its unstretched length changes."""
        return self.signal is not None and self.par[2] != 0.0

    @property
    def winding_strain(self) -> float:
        """The strain that winding from load factor 0 to 1 would cause in a rigid model."""
        amount = 0.0 if self.signal is None else self.signal(1.0) - self.signal(0.0)
        return float(abs(amount * self.par[2]) / self.rest)

    def tension(self, d: Array, t: float) -> float:
        """Return the tension [N] at displacements d (n_q,)."""
        if self.active is not None and not self.active.at(t):
            return 0.0
        length = 1.0 if self.signal is None else self.signal(t)
        return float(taut(self.p0, self.G @ d[self.dofs[0]], length, self.par, int(self.par[3]))[1])

    def tension_slope(self, d: Array) -> float:
        """Return the derivative of the tension [N] by the amplitude, at displacements d (n_q,) and amplitude 0."""
        _, T, k = taut(self.p0, self.G @ d[self.dofs[0]], 0.0, self.par, int(self.par[3]))
        return float(-k * self.par[2] * (1.0 + T / self.par[0]))

    def linear_tension(self, d: Array, t: float) -> float:
        """Return the tension [N] to first order in displacements d (n_q,) about the reference; it may be negative."""
        length, zero = 1.0 if self.signal is None else self.signal(t), np.zeros_like(d)
        _, T, k = taut(self.p0, np.zeros(len(self.p0)), length, self.par, int(self.par[3]))
        return float(T + k * (self._slopes(zero) @ d[self.dofs[0]]))

    def winding_forces(self, d: Array) -> Array:
        """Return the forces (n,) on its coordinates per unit of the amplitude, at displacements d and amplitude 0."""
        return np.asarray(-self.tension_slope(d) * self._slopes(d))

    def _slopes(self, d: Array) -> Array:
        """Return the derivatives (n,) of its length by its coordinates at displacements d."""
        u, f, size = self.G @ d[self.dofs[0]], np.zeros(len(self.p0)), int(self.par[3])
        for at in range(0, len(f), size):
            x, y = piece(self.p0, u, u, at, size)
            if L := float(np.hypot(x, y)):
                slopes(self.p0, u, u, at, size, x / L, y / L, f)
        return np.asarray(self.G.T @ f)

    def stop_winding(self) -> None:
        """Set the amplitude to 0, because winding is an input of small motions."""
        self.signal = lambda t: 0.0

    def tighten(self, share: float) -> None:
        """Do nothing: without slack it does not pull in the reference."""


_NO_ARM = [NOTHING] * 5


def _derivative(point: PointRef, i: int, j: int, components: Sequence[int]) -> list[Field]:
    """Return components (2 is theta) of d^(i+j) r/dx^i dy^j at a point as fields."""
    row, e0 = point.shape_row(i, j), point.mesh.e0
    found = (point.columns(row, k) for k in components)
    return [Field(c, w, float(w @ e0[c - point.mesh.first_dof])) for c, w in found]


def _arm(point: PointRef, y: float) -> list[Field]:
    """Return the arm to a place y off the axis at a point, for types whose sections follow from the axis."""
    if point.turns_by_theta:
        # the section's own angle, which at mid-nodes of an arc differs a little from that of the interpolated axis
        return [*_derivative(point, 0, 0, [2]), NOTHING, NOTHING, constant_field(y), constant_field(THETA)]
    return [*_derivative(point, 1, 0, [0, 1]), NOTHING, constant_field(y), constant_field(DIRECTION)]


def _eyelet(point: PointRef | GroundPoint, y: float, sign: float) -> tuple[list[Field], list[Field]]:
    """Return the position of an eyelet times a sign: the part linear in the coordinates, and the arm off the axis."""
    if isinstance(point, GroundPoint):
        return [constant_field(sign * point.x), constant_field(sign * point.y)], _NO_ARM
    if y == 0.0 or point.mesh.plan.element.section_kind == "interpolated":
        at = point_ref(point.mesh, point.s, y)
        return [f.scaled(sign) for f in position_fields(at)], _NO_ARM
    return [f.scaled(sign) for f in position_fields(point)], _arm(point, sign * y)


class TendonPiece(NamedTuple):
    """The fields of a piece of a tendon, and the part of them that belongs to each eyelet on a body."""

    fields: list[Field]
    ends: list[tuple[PointRef, list[Field]]]

    def among(self, before: int, size: int, after: int) -> TendonPiece:
        """Return the piece extended to ``size`` fields, its ends with empty fields for the pieces before and after."""
        fields = [*self.fields, *[NOTHING] * (size - len(self.fields))]
        ends = [(p, [*[NOTHING] * before, *own, *[NOTHING] * (size - len(own) + after)]) for p, own in self.ends]
        return TendonPiece(fields, ends)


def spans(eyelets: Sequence[tuple[PointRef | GroundPoint, float]]) -> list[TendonPiece]:
    """Return the pieces of a tendon from eyelet to eyelet."""
    out = []
    for (a, ya), (b, yb) in pairwise(eyelets):
        (la, arm_a), (lb, arm_b) = _eyelet(a, ya, -1.0), _eyelet(b, yb, 1.0)
        arms = [] if arm_a is _NO_ARM and arm_b is _NO_ARM else [*arm_a, *arm_b]
        shares = ((a, [*la, *arm_a]), (b, [*lb, *_NO_ARM, *arm_b])) if arms else ((a, la), (b, lb))
        ends = [(point_ref(p.mesh, p.s, y), own) for (p, own), y in zip(shares, (ya, yb), strict=True)
                if isinstance(p, PointRef)]
        out.append(TendonPiece([*map(add, la, lb), *arms], ends))
    return out


def guided(mesh: BodyMesh, s0: float, s1: float, y: float | Profile, more: int) -> list[TendonPiece]:
    """Return the pieces of a tendon guided at y off the axis of a body: one short stretch per quadrature point.

    Its direction there is d(r + y n)/dx; ``more`` is the number of points along each element in addition to those of
    line loads.
    """
    length, kind, out = mesh.plan.length, mesh.plan.element.section_kind, []
    for a, b in pairwise([s0, *(s for s, _ in _breaks(y) if s0 < s < s1), s1]):
        for elements, xi, w in covered(mesh, a, b, more):
            for ie in elements.tolist():
                begin, l = float(mesh.starts[ie]), float(mesh.lengths[ie])
                for x, weight in zip(xi.tolist(), w.tolist(), strict=True):
                    s = (begin + x * l) / length
                    off, rise = _offset(y, s, a, b)
                    at = PointRef(mesh, s, ie, x, 0.0, None, 2.0 * off / mesh.classes[mesh.cls[ie]].shape.h)
                    along = _derivative(at, 1, 0, [0, 1])
                    slope = rise / length
                    if kind == "interpolated":
                        up = [f.scaled(slope) for f in _derivative(at, 0, 1, [0, 1])]
                        own = [f.scaled(weight) for f in map(add, along, up)]
                    elif kind == "theta":
                        arm = [] if not y else [*_derivative(at, 0, 0, [2]),
                                                *(f.scaled(-weight * off) for f in _derivative(at, 1, 0, [2]))]
                        rises = [] if isinstance(y, float) else [constant_field(weight * slope)]
                        own = [*(f.scaled(weight) for f in along), *arm, *rises]
                    else:
                        own = [f.scaled(weight) for f in along]
                    out.append(TendonPiece(own, []))
    return out


@dataclass(frozen=True)
class Guide:
    """A tendon guided along a body from S = ``first`` to ``last`` at ``y`` off its axis.

    ``cover`` integrates along it: (elements, points xi, weights in m). ``tension(d, t)`` is its tension [N], and
    ``tension_slope(d)`` its derivative by the amplitude. ``depends`` are the coordinates that the tension depends on,
    none if it is prescribed.
    """

    mesh: BodyMesh
    first: float
    last: float
    y: float | Profile
    cover: list[tuple[Index, Array, Array]]
    tension: Callable[[Array, float], float]
    tension_slope: Callable[[Array], float]
    depends: Index

    def offsets(self, s: Array) -> tuple[Array, Array]:
        """Return y and dy/dx at S (n,); y is 0 for curves, whose tendon is on the axis with moments at its ends."""
        if isinstance(self.y, float):
            on_axis = self.mesh.plan.element.section_kind == "tangent"
            return np.full(len(s), 0.0 if on_axis else self.y), np.zeros(len(s))
        ends = [self.first, *(x for x, _ in breaks(self.y) if self.first < x < self.last), self.last]
        k = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(ends) - 2)
        found = [_offset(self.y, x, ends[i], ends[i + 1]) for x, i in zip(s.tolist(), k.tolist(), strict=True)]
        y, slope = np.array(found).T
        return y, slope / self.mesh.plan.length


def _cover(mesh: BodyMesh, s0: float, s1: float, y: float | Profile, more: int) -> list[tuple[Index, Array, Array]]:
    ends = [s0, *(s for s, _ in _breaks(y) if s0 < s < s1), s1]
    return [part for a, b in pairwise(ends) for part in covered(mesh, a, b, more)]


def _breaks(y: float | Profile) -> tuple[tuple[float, int], ...]:
    return () if isinstance(y, float) else breaks(y)


def _offset(y: float | Profile, s: float, a: float, b: float) -> tuple[float, float]:
    """Return y and dy/dS at s, from values between a and b, where the profile has no kink."""
    if isinstance(y, float):
        return y, 0.0
    h = min(STEP, 0.25 * (b - a))
    middle = min(max(s, a + 1.5 * h), b - 1.5 * h)
    v = values(y, np.array([s, middle - h, middle + h]))
    return float(v[0]), float(v[2] - v[1]) / (2.0 * h)


EYELET = ByShape(text=POINT, map=Record(Probe), list=Vector(POSITION, "x, y", GroundPoint))


@load
@record(kw_only=True)
class Tendon:
    """A frictionless tendon, guided along a body or through eyelets; elastic if it has a stiffness."""

    tag = "tendon"
    on: str | None = key(Name("the name of a body"), "Body along which it is guided", refers="bodies", default=None,
                         example="arm")
    y: float | Profile = key(ProfileOf("m"), "Distance of the guide from the axis, along the section's y axis",
                             default=0.0, example=0.01)
    from_: float = key(Number("", ge=0, le=1), "S where it begins on the body", default=0.0)
    to: float = key(Number("", ge=0, le=1), "S where it ends on the body", default=1.0)
    through: tuple[Point | Probe | GroundPoint, ...] = key(
        ListOf(EYELET, "eyelets, each BODY@S, {at, y} or [x, y]"), "Eyelets in order, in place of on", default=(),
        example=["a@0.1", {"at": "a@0.5", "y": 0.01}, [1, 0]])
    tension: float | None = key(Number("N", ge=0), "Tension", default=None, example=10)
    stiffness: float | None = key(Number("N", gt=0), "EA of an elastic tendon: tension EA (l - l0)/l0, never a push",
                                  default=None, example=1e5)
    slack: float = key(Number("m"), "Unstretched length minus length in the reference; negative pretensions it. The "
                       "amplitude multiplies it", default=0.0)
    friction: float = key(Number("", ge=0), "Coefficient of friction at the guides; only 0 is supported", default=0.0)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def places(self) -> tuple[str, list[float]] | None:
        """The body along which it is guided, and the positions S of kinks of the guide."""
        return None if self.on is None else (self.on, [s for s, _ in _breaks(self.y) if self.from_ < s < self.to])

    @property
    def switches(self) -> bool:
        """Whether ``active`` switches it like a spring; the amplitude of an elastic tendon winds it instead."""
        return self.stiffness is not None

    @property
    def drawn(self) -> Array | None:
        """S and y (n, 2) of points of a guide with varying distance from the axis; jumps have points on both sides."""
        if self.on is None or isinstance(self.y, float):
            return None
        ends = [self.from_, *(s for s in self.places[1] if s > self.from_), self.to] if self.places else []
        s = np.concatenate([np.linspace(a + SIDE, b - SIDE, max(2, round(DRAWN * (b - a)))) for a, b in pairwise(ends)])
        return np.stack([s, values(self.y, s)], axis=1)

    def check(self) -> Iterator[Issue]:
        """Yield issues for an impossible tendon."""
        if (self.on is None) == (not self.through):
            yield Issue((), "{}: a tendon is either guided along a body or runs through eyelets", "either on or "
                        "through")
        elif self.on is None and len(self.through) < 2:
            yield Issue(("through",), "{}.through: a tendon needs at least two eyelets")
        if (self.tension is None) == (self.stiffness is None):
            yield Issue((), "{}: a tendon has either a given tension or a stiffness", "either tension or stiffness")
        elif self.tension is not None and self.slack:
            yield Issue(("slack",), "{}.slack: a tendon of given tension has no unstretched length",
                        "stiffness in place of tension, or no slack")
        yield from reversed_range(self.from_, self.to)
        if self.friction:
            yield Issue(("friction",), f"{{}}.friction is {self.friction:g}: tendons slide without friction",
                        "friction: 0, or none")
        for i, (a, b) in enumerate(pairwise(self.through)):
            if a == b:
                yield Issue(("through", i + 1), f"{{}}.through: eyelets {i} and {i + 1} are the same")

    @property
    def points(self) -> tuple[Point, ...]:
        """The points of bodies that it acts at, except for eyelets that are given as points."""
        ends = () if self.on is None else (Point(self.on, self.from_), Point(self.on, self.to))
        return ends + tuple(e.at for e in self.through if isinstance(e, Probe))

    def _pieces(self, context: LoadContext) -> list[TendonPiece]:
        if self.on is None:
            return spans([(e, 0.0) if isinstance(e, GroundPoint) else (context.point(e.at), e.y)
                          if isinstance(e, Probe) else (context.point(e), 0.0) for e in self.through])
        plan = context.meshes[self.on].plan
        if plan.rigid:
            raise PartError(("on",), f"{self.on} is rigid: a tendon along it has no effect",
                            "a body that deforms, or through")
        if plan.element.section_kind == "tangent" and self.y != 0.0 and (
                not isinstance(self.y, float) or self.stiffness is not None):
            raise PartError(("y",), f"{plan.element.name} can guide a tendon off its axis only with given tension and "
                            "constant distance", "reissner3, an ANCF type, or through")
        return guided(context.meshes[self.on], self.from_, self.to, self.y, self._more)

    @property
    def _more(self) -> int:
        """Number of points along each element in addition to those of line loads."""
        return FEW if self.stiffness is not None else 0 if isinstance(self.y, float) else VARYING

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add the tendon: one patch per piece if its tension is given, one for all pieces if it is elastic.

        Raises PartError if the tendon is impossible on its body.
        """
        pieces = self._pieces(context)
        elastic, given = self._put(context, out, pieces), self.tension or 0.0
        if self.on is not None:
            mesh = context.meshes[self.on]
            cover = _cover(mesh, self.from_, self.to, self.y, self._more)
            own = (elastic.tension, elastic.tension_slope, elastic.coordinates) if elastic is not None else (
                lambda d, t: given * context.amplitude(t), lambda d: given, np.zeros(0, dtype=np.intp))
            out.guides.append(Guide(mesh, self.from_, self.to, self.y, cover, *own))

    def _put(self, context: LoadContext, out: LoadSet, pieces: list[TendonPiece]) -> ElasticTendon | None:
        """Add the pieces; return the elastic tendon that they form, or None if the tension is given."""
        size = max(len(p.fields) for p in pieces)
        if self.stiffness is not None:
            whole = size * len(pieces)
            if whole > MOST:
                each = 1 if self.on is None else context.meshes[self.on].plan.element.degree_x + 3 + self._more
                what = "stretches" if self.on is None else "elements"
                raise PartError(("stiffness",), f"an elastic tendon couples everything along it: {len(pieces) // each} "
                                f"{what} are too many", f"at most {MOST // size // each}")
            pieces = [p.among(k * size, size, whole - (k + 1) * size) for k, p in enumerate(pieces)]
            fields = [f for p in pieces for f in p.fields]
            tendon = ElasticTendon(fields, size, self.stiffness, self.slack, context.amplitude)
            tendon.ends, tendon.active = [end for p in pieces for end in p.ends], context.active
            out.springs.append(tendon)
            return tendon
        given = self.tension
        assert given is not None
        for part in pieces:
            fields, ends = part.among(0, size, 0)
            patch = PointPatch(TENSION, fields, [given, size], context.amplitude)
            patch.ends = ends
            out.patches.append(patch)
        if (self.on is not None and isinstance(self.y, float)
                and context.meshes[self.on].plan.element.section_kind == "tangent"):
            # a line y off the axis of an unsheared beam is shorter than the axis by y times the change of rotation
            # between its ends
            for end, sign in ((self.to, 1.0), (self.from_, -1.0)):
                point = context.point(Point(self.on, end))
                out.patches.append(moment_at(point, sign * given * self.y, context.amplitude))
        return None
