"""Forces and moments at points, and the forms of loads in a model: dead, rotating, or natural strains."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import NAME, Choice, Number, Vector
from ..case.records import OneOf, tag_of
from ..case.schema.active import ACTIVE, ACTIVE_DOC, Active, Latch
from ..case.schema.amplitudes import Amplitude
from ..case.schema.case import register
from ..case.schema.points import ENDS, PLACE, POINT, GroundPoint, MovingPoint, Point, check_ends
from ..case.schema.profiles import Profile
from ..elements.point_laws import THETA, PointLaw, turn_hessian
from ..elements.shape import Array
from ..model import profiles
from ..model.law_constants import Slope, constants_of
from ..model.mesh import BodyMesh, Index
from ..model.point_patch import PointPatch, position_fields, turn_fields
from ..model.points import PointRef
from .moving import MovingPatch, moving_force

R = TypeVar("R", bound=type)
AlongBody = float | Profile
AMPLITUDE = OneOf(Amplitude)
AMPLITUDE_DOC = "Factor as a function of load factor or time (default: ramp in static cases, otherwise constant)"
# difference in S of positions of natural strains that count as equal
SAME = 1e-12
SPREAD = Choice("uniform", "parabolic")
SPREAD_DOC = "Spread the force over the section (default: on the axis)"


@dataclass
class DeadLoad:
    """A generalised force that depends only on load factor or time: Q_k = amplitude(t) * values at dofs."""

    dofs: Index
    values: Array
    amplitude: Callable[[float], float]
    gravity: bool = False


@dataclass
class NaturalStrain:
    """The natural strain that one load imposes on a body from S = ``first`` to ``last``, times its amplitude.

    ``values`` are axial strain, curvature [1/m], temperature [K] and its gradient [K/m] along the body. ``amount`` (3,)
    and ``signal`` (1,) are its rows of ``kernels.stress_free.Natural``. On the way to an equilibrium, only a ``share``
    of the change from the amplitude ``before`` acts.
    """

    mesh: BodyMesh
    first: float
    last: float
    values: tuple[AlongBody, AlongBody, AlongBody, AlongBody]
    amplitude: Callable[[float], float]
    amount: Array = field(default_factory=lambda: np.zeros(3))
    signal: Index = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    before: float = 0.0
    share: float = 1.0

    def at(self, t: float) -> float:
        """Return the factor of the natural strain at load factor or time t."""
        now = self.amplitude(t)
        return now if self.share == 1.0 else self.before + self.share * (now - self.before)

    def places(self) -> Index:
        """Return for each element 0 if it is not strained, 1 if it is strained like all others, else 2 + its number."""
        start, whole = self.mesh.starts, self.mesh.plan.length
        a, b = start / whole, (start + self.mesh.lengths) / whole
        number = np.arange(len(a))
        out = np.where((a >= self.first - SAME) & (b <= self.last + SAME), 1, 2 + number)
        if not all(isinstance(v, float) for v in self.values):
            out = 2 + number
        out[(b <= self.first + SAME) | (a >= self.last - SAME)] = 0
        return out

    def along(self, element: int, xi: Array) -> Array:
        """Return the values (4, n) at stations xi (n,) of an element, zero outside [first, last].

        If a profile jumps at an end of the element, the value inside is used.
        """
        mesh = self.mesh
        whole, start = mesh.plan.length, mesh.starts[element]
        s = np.clip((start + xi * mesh.lengths[element]) / whole, start / whole + profiles.SIDE,
                    (start + mesh.lengths[element]) / whole - profiles.SIDE)
        inside = (s >= self.first - SAME) & (s <= self.last + SAME)
        return np.where(inside, np.array([profiles.values(v, s) for v in self.values]), 0.0)


class Patch(Protocol):
    """Forces that depend on the configuration, on coordinates ``dofs`` (m, n): point laws, centrifugal forces.

    ``symmetric``: whether their stiffness is symmetric.
    """

    dofs: Index
    symmetric: bool


@dataclass
class LoadSet:
    """All loads on the model; ``springs`` are those that have stiffness like springs, even when they do not act yet.

    ``guides`` are the tendons along bodies among them; the sections of the body do not bear their tension.
    ``flows`` are forces of material that moves along bodies; they also act in the reference.
    """

    dead: list[DeadLoad] = field(default_factory=list)
    patches: list[Patch] = field(default_factory=list)
    natural: list[NaturalStrain] = field(default_factory=list)
    springs: list[Any] = field(default_factory=list)
    guides: list[Any] = field(default_factory=list)
    flows: list[Any] = field(default_factory=list)


@dataclass(frozen=True)
class LoadContext:
    """Data for a load: meshes, points, its amplitude, and the point masses and flows of the scene.

    ``active`` is when it acts, for the parts that its amplitude does not switch.
    """

    meshes: dict[str, BodyMesh]
    point: Callable[[Any], PointRef]
    amplitude: Callable[[float], float]
    masses: Sequence[Any] = ()
    flows: Sequence[Any] = ()
    # returns the signal of another amplitude
    function_of: Callable[[Amplitude], Callable[[float], float]] | None = None
    active: Active | Latch | None = None

    def moving(self, at: MovingPoint, value: Sequence[float], gravity: bool = False) -> MovingPatch:
        """Return a force of fixed direction that moves along a body and is scaled by the amplitude."""
        assert self.function_of is not None
        patch = moving_force(self.meshes[at.on], self.function_of(at.s), value, self.amplitude)
        patch.gravity = gravity
        return patch

    def dead(self, dofs: Index, values: Array, gravity: bool = False) -> DeadLoad:
        """Return a load of fixed direction that is scaled by the amplitude."""
        return DeadLoad(dofs, values, self.amplitude, gravity)


def load(cls: R) -> R:
    """Register a record as a kind of load; its method ``add(context, out)`` adds its forces to ``out``."""
    return register("loads", cls, ("name", "amplitude"))


# values that the force function of a position load returns
RETURNS = {"fx": None, "fy": None, "dfx/dx": Slope(0, 0), "dfx/dy": Slope(0, 1), "dfy/dx": Slope(1, 0),
           "dfy/dy": Slope(1, 1)}


def position_load(force: Callable[..., Any], *, potential: bool) -> Callable[[R], R]:
    """Register a record as a kind of load: a force on a point that is a function of its position.

    ``force(x, y, par)`` returns fx, fy [N] and dfx/dx, dfx/dy, dfy/dx, dfy/dy; ``par`` are the numbers (at most five)
    that the record's method ``constants()`` returns. The force is multiplied by the record's amplitude. ``potential``:
    whether dfx/dy = dfy/dx; if not, the stiffness is not symmetric and buckling looks for flutter. The record
    has ``tag`` and the keys ``at`` (kind POINT), ``amplitude`` and ``name``. Raises PluginError.
    """
    def with_force(cls: R) -> R:
        law = position_law(tag_of(cls), force, potential)

        def add(self: Any, context: LoadContext, out: LoadSet) -> None:
            fields = position_fields(context.point(self.at))
            out.patches.append(PointPatch(law, fields, constants_of(self, force, RETURNS), context.amplitude))

        register("loads", cls, ("at", "amplitude", "name"), methods=("constants",))
        cls.add = add  # type: ignore[attr-defined]
        return cls
    return with_force


def position_law(name: str, force: Callable[..., Any], potential: bool) -> PointLaw:
    """Return the law of a load whose force is a function of position; see ``position_load``."""
    def forces(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
        fx, fy, xx, xy, yx, yy = force(p0[0] + u[0], p0[1] + u[1], par)
        f[0], f[1] = -a[0] * fx, -a[0] * fy
        H[0, 0], H[0, 1], H[1, 0], H[1, 1] = -a[0] * xx, -a[0] * xy, -a[0] * yx, -a[0] * yy
        return 0.0, 0.0

    def mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
        # the force at mid-step
        a = 0.5 * (a0[0] + a1[0])
        fx, fy, _, _, _, _ = force(p0[0] + 0.5 * (u0[0] + u1[0]), p0[1] + 0.5 * (u0[1] + u1[1]), par)
        f[0], f[1] = -a * fx, -a * fy
        return 0.0, 0.0
    return PointLaw(name, forces, mean, symmetric=potential)


@load
@record
class Force:
    """A force of constant direction."""

    tag = "force"
    at: Point | MovingPoint = key(PLACE, "Point at which it acts; it may move along a body (dynamic)", example="beam@1")
    value: tuple[float, float] = key(Vector(Number("N"), "fx, fy"), "Force", example=[0, -1000])
    spread: str | None = key(SPREAD, SPREAD_DOC, default=None)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield an issue for a force that moves and is spread."""
        if isinstance(self.at, MovingPoint) and self.spread is not None:
            yield Issue(("spread",), "{}.spread: a force that moves along a body acts on its axis", "no spread")

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add the force on the coordinates of its point."""
        if isinstance(self.at, MovingPoint):
            out.patches.append(context.moving(self.at, self.value))
            return
        columns = context.point(self.at).position(self.spread)
        out.dead += [context.dead(coords, weights * f) for (coords, weights), f in
                     zip(columns, self.value, strict=True)]


def follower(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """A force that rotates with a section; fields: position, rotation; par: force in the reference, rotation kind."""
    if par[2] == THETA:
        c, s = np.cos(p0[2] + u[2]), np.sin(p0[2] + u[2])
    else:
        px, py = p0[2] + u[2], p0[3] + u[3]
        L = np.sqrt(px * px + py * py)
        c, s = px / L, py / L
    fx, fy = a[0] * (c * par[0] - s * par[1]), a[0] * (s * par[0] + c * par[1])
    f[0], f[1] = -fx, -fy
    if par[2] == THETA:
        H[0, 2], H[1, 2] = fy, -fx
    else:
        H[0, 2], H[0, 3] = -fy * s / L, fy * c / L
        H[1, 2], H[1, 3] = fx * s / L, -fx * c / L
    return 0.0, 0.0


def follower_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """The force at mid-step."""
    if par[2] == THETA:
        angle = p0[2] + 0.5 * (u0[2] + u1[2])
        c, s = np.cos(angle), np.sin(angle)
    else:
        px, py = p0[2] + 0.5 * (u0[2] + u1[2]), p0[3] + 0.5 * (u0[3] + u1[3])
        L = np.sqrt(px * px + py * py)
        c, s = px / L, py / L
    a = 0.5 * (a0[0] + a1[0])
    f[0], f[1] = -a * (c * par[0] - s * par[1]), -a * (s * par[0] + c * par[1])
    return 0.0, 0.0


FOLLOWER = PointLaw("follower", follower, follower_mean, symmetric=False)


def follower_force(point: PointRef, value: tuple[float, float], amplitude: Callable[[float], float],
                   spread: str | None = None) -> PointPatch:
    """Return a force (tangential, normal) along the axes of its section, which it follows."""
    kind, fields = turn_fields(point)
    c, s = math.cos(point.angle), math.sin(point.angle)
    reference = (c * value[0] - s * value[1], s * value[0] + c * value[1])
    return PointPatch(FOLLOWER, [*position_fields(point, spread), *fields], [*reference, kind], amplitude)


@load
@record
class FollowerForce:
    """A force that turns with the section it acts on."""

    tag = "follower_force"
    at: Point = key(POINT, "Where it acts", example="beam@1")
    value: tuple[float, float] = key(Vector(Number("N"), "tangential, normal"),
                                     "Force along the axes of the section, with which it rotates", example=[0, -1000])
    spread: str | None = key(SPREAD, SPREAD_DOC, default=None)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add the force as a law of the position and direction of its section."""
        out.patches.append(follower_force(context.point(self.at), self.value, context.amplitude, self.spread))


def moment(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """A moment conjugate to the rotation of a direction or to theta; par: moment, rotation kind."""
    M = par[0] * a[0]
    if par[1] == THETA:
        f[0] = -M
        return 0.0, 0.0
    px, py = p0[0] + u[0], p0[1] + u[1]
    f[0], f[1] = M * py / (px * px + py * py), -M * px / (px * px + py * py)
    turn_hessian(px, py, 0, -M, H)
    return 0.0, 0.0


def moment_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """The moment at mid-step."""
    M = 0.5 * (a0[0] + a1[0]) * par[0]
    if par[1] == THETA:
        f[0] = -M
        return 0.0, 0.0
    px, py = p0[0] + 0.5 * (u0[0] + u1[0]), p0[1] + 0.5 * (u0[1] + u1[1])
    f[0], f[1] = M * py / (px * px + py * py), -M * px / (px * px + py * py)
    return 0.0, 0.0


MOMENT = PointLaw("moment", moment, moment_mean)


def moment_at(point: PointRef, value: float, amplitude: Callable[[float], float]) -> PointPatch:
    """Return a moment [N m] on the section at a point."""
    kind, fields = turn_fields(point)
    out = PointPatch(MOMENT, fields, [float(value), kind], amplitude)
    out.ends = [(point, fields)]
    return out


@load
@record
class Moment:
    """A moment, conjugate to the rotation of the section."""

    tag = "moment"
    at: Point = key(POINT, "Where it acts", example="beam@1")
    value: float = key(Number("N m"), "Moment, counter-clockwise", example=100)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add the moment on the coordinates that rotate its section: Q_k = M dtheta/de."""
        out.patches.append(moment_at(context.point(self.at), self.value, context.amplitude))


@load
@record
class Torque:
    """A pair of opposite moments on two sections."""

    tag = "torque"
    between: tuple[Point | GroundPoint, ...] = key(ENDS, "The two sections; [x, y] is the ground",
                                                   example=["a@1", "b@0"])
    value: float = key(Number("N m"), "Moment on the second, counter-clockwise", example=3)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield issues for ends that are impossible for a torque."""
        yield from check_ends(self.between)

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add the moment on each section; an end on the ground gets none."""
        for end, value in zip(self.between, (-self.value, self.value), strict=True):
            if isinstance(end, Point):
                out.patches.append(moment_at(context.point(end), value, context.amplitude))
