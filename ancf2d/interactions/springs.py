"""Springs and dampers between points: the registration of kinds of springs, and the linear ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from operator import add
from typing import Any, TypeVar

import numpy as np

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import NAME, Choice, Number
from ..case.records import tag_of
from ..case.schema.active import ACTIVE, ACTIVE_DOC, Active
from ..case.schema.amplitudes import ExpressionText
from ..case.schema.case import register
from ..case.schema.points import ENDS, SPRING_ENDS, GroundPoint, MovingPoint, Point, check_ends
from ..elements.point_laws import DIRECTION, PointLaw
from ..elements.shape import Array
from ..errors import PluginError
from ..model.law_constants import Slope, constants_of
from ..model.mesh import BodyMesh
from ..model.point_patch import (
    NOTHING,
    Field,
    PointPatch,
    constant_field,
    position_fields,
    turn_fields_of_ends,
)
from ..model.points import PointRef, point_ref
from ..model.timing import Timing
from .formulas import by_formula, spring_formula, uses_rate
from .moving import MovingPatch
from .spring_laws import spring_law, twist

R = TypeVar("R", bound=type)
ONLY = Choice("tension", "compression")
ONLY_DOC = ("tension: acts only against elongation (for angles, counter-clockwise relative rotation); compression: "
            "acts only against shortening (default: acts both ways)")
PULL_DOC = ("Force as a formula in the elongation u [m] and its rate v, in place of stiffness and damping; positive "
            "pulls the ends together")
TURN_DOC = ("Moment as a formula in u, the relative rotation minus angle [rad], and its rate v, in place of stiffness "
            "and damping; a positive moment turns the second end back")
# values that the force function of a spring returns
RETURNS = {"energy": None, "N": Slope(0, 0, at_rest=True), "dN/du": Slope(1, 0), "dN/d(rate)": Slope(1, 1)}
# difference of lengths, relative to them, that is round-off
ROUND = 4 * np.finfo(float).eps
End = PointRef | GroundPoint


def _position(end: End) -> list[Field]:
    if isinstance(end, GroundPoint):
        return [constant_field(v) for v in (end.x, end.y)]
    return position_fields(end)


class Spring(PointPatch):
    """A spring and damper; ``slack`` is the length or angle in the reference, at which it would not pull.

    ``par`` are the constants of its law, after ``rest``; ``damped``: whether rates cause forces.
    """

    def __init__(self, law: PointLaw, fields: list[Field], rest: float, slack: float, par: Sequence[float],
                 damped: bool, sections: Sequence[PointRef | None] = ()) -> None:
        super().__init__(law, fields, [rest, *par], sections=sections)
        self.rest, self.slack, self.damped = rest, slack, damped
        self.angle = self.law.accept is not None

    def moments_of_angle(self, d: Array) -> Array:
        """Return the sizes (n,) of the forces of the whole angle of a rotational spring at displacements d (n_full,).

        After large rotations, or many turns, the angle is larger than the displacements that it is computed from.
        """
        u, slopes = self.G @ d[self.dofs[0]], np.zeros(len(self.p0))
        angle, _ = twist(self.p0, u, self.par, self.mem, slopes)
        _, H, _ = self.forces(u, 0.0)
        stiffness = abs(slopes @ H @ slopes) / (slopes @ slopes) ** 2
        return np.asarray(stiffness * (abs(angle) + abs(self.par[0]) + np.abs(self.mem).sum())
                          * np.abs(slopes @ self.G))

    def tighten(self, share: float) -> None:
        """Set the free length or angle to a ``share`` of the way from ``slack`` to ``rest``, its own value."""
        self.par[0] = self.rest if share == 1.0 else self.slack + share * (self.rest - self.slack)


def _distance(ends: list[End]) -> list[list[Field]]:
    """Return the part of each end in the fields x and y of the vector from the first end to the second."""
    return [[f.scaled(sign) for f in _position(end)] for sign, end in zip((-1.0, 1.0), ends, strict=True)]


def _rotation(ends: list[End]) -> list[list[Field]]:
    """Return the part of each end in the fields for the rotation of the two sections."""
    own = [turn_fields_of_ends([end if isinstance(end, PointRef) else None])[1] for end in ends]
    return [[*own[0], *(NOTHING for _ in own[1])], [*(NOTHING for _ in own[0]), *own[1]]]


def _of_bodies(ends: list[End], parts: list[list[Field]]) -> list[tuple[PointRef, list[Field]]]:
    return [(end, part) for end, part in zip(ends, parts, strict=True) if isinstance(end, PointRef)]


def along(law: PointLaw, ends: list[End], constants: Sequence[float], damped: bool,
          length: float | None = None) -> Spring:
    """Return a spring along the line between two points; ``length`` is its free length (default: no elongation now)."""
    parts = _distance(ends)
    fields = list(map(add, *parts))
    start = math.hypot(*(f.p0 for f in fields))
    out = Spring(law, fields, start if length is None else length, start, [start, *constants], damped)
    out.ends = _of_bodies(ends, parts)
    return out


def about(law: PointLaw, ends: list[End], constants: Sequence[float], damped: bool,
          angle: float | None = None) -> Spring:
    """Return a spring on the relative rotation of two sections (or the ground), without moment at ``angle``."""
    sections = [end if isinstance(end, PointRef) else None for end in ends]
    kinds, _ = turn_fields_of_ends(sections)
    counted = [end if kind == DIRECTION else None for end, kind in zip(sections, kinds, strict=True)]
    parts = _rotation(ends)
    out = Spring(law, list(map(add, *parts)), angle or 0.0, 0.0, [*kinds, *constants], damped, counted)
    out.ends = _of_bodies(ends, parts)
    return out


def moving_spring(item: Any, meshes: dict[str, BodyMesh], point: Callable[[Point], PointRef],
                  timing: Timing) -> MovingPatch:
    """Return a spring of the case with one end that moves along a body.

    Its default free length is the distance between its ends at t = 0 in the reference.
    """
    k = next(k for k, p in enumerate(item.between) if isinstance(p, MovingPoint))
    end, other = item.between[k], item.between[1 - k]
    mesh, course = meshes[end.on], timing.function_of(end.s)
    place: list[End] = [point_ref(mesh, min(max(course(0.0), 0.0), 1.0))] * 2
    place[1 - k] = other if isinstance(other, GroundPoint) else point(other)
    spring: Spring = item.place(place)
    return MovingPatch(mesh, course, spring.law, spring.par.tolist(), None, sign=(-1.0, 1.0)[k],
                       others=_distance(place)[1 - k], stretches=True)


def spring(force: Callable[..., Any], *, on: str = "elongation", damped: bool = False,
           over_step: Callable[..., Any] | None = None) -> Callable[[R], R]:
    """Register a record as a kind of spring whose force is a function of the elongation, or of the angle.

    ``force(u, rate, par)`` returns the energy, the force N (N, or the moment in N m) and its derivatives dN/du and
    dN/d(rate), where u is the elongation [m], or with ``on="angle"`` the relative rotation [rad]; ``par``
    are the numbers (at most five) that the record's method ``constants()`` returns. ``damped``: whether N depends on
    the rate. ``over_step(u0, u1, rate, par)`` returns the force of a step of energy_momentum and the power that it
    dissipates (default: computed from the energy). The record has ``tag`` (its ``type``) and the keys ``between`` (kind
    ENDS) and ``name``; its method ``rest()`` returns the length or angle at which u is zero, or None for its value in
    the reference (default). Raises PluginError.
    """
    if on not in ("elongation", "angle"):
        raise PluginError(f"a spring acts on its elongation or angle, not '{on}'")

    def with_force(cls: Any) -> Any:
        law = spring_law(tag_of(cls), on == "angle", force, over_step)

        def place(self: Any, ends: list[End]) -> Spring:
            rest = self.rest() if hasattr(self, "rest") else None
            return (about if on == "angle" else along)(law, ends, constants_of(self, force, RETURNS), self.damped, rest)

        if not hasattr(cls, "check"):
            cls.check = _check
        register("springs", cls, ("between", "name"), ("constants",), damped=damped)
        cls.law, cls.place = law, place
        return cls
    return with_force


def _check(self: Any) -> Iterator[Issue]:
    """Yield issues for ends that are impossible for a spring."""
    yield from check_ends(self.between)


# laws of springs whose force is a formula, by whether they act on an angle
FORMULA_LAWS = {angle: spring_law("rotational_formula" if angle else "translational_formula", angle, by_formula)
            for angle in (False, True)}


def by_force(cls: R) -> R:
    """Give a kind of spring the key ``force``, a formula that replaces stiffness and damping."""
    place = cls.place  # type: ignore[attr-defined]

    def with_formula(self: Any, ends: list[End]) -> Spring:
        if self.force is None:
            return _acting_at_start(place(self, ends), slice(-2, None))
        formula, angle = spring_formula(self.force), cls.law.accept is not None  # type: ignore[attr-defined]
        constants = [float(formula.address), *_acting(self.only, self.gap), 0.0 if self.damped else 1.0]
        placed = (about if angle else along)(FORMULA_LAWS[angle], ends, constants, self.damped, self.rest())
        return _acting_at_start(placed, slice(-3, -1))
    cls.place = with_formula  # type: ignore[attr-defined]
    return cls


def _acting_at_start(spring: Spring, bounds: slice) -> Spring:
    """Return a spring that acts in the reference if its bounds (constants) are met there but for round-off."""
    start, size = spring.slack - spring.rest, max(abs(spring.slack), abs(spring.rest))
    gaps = spring.par[bounds]
    gaps[np.abs(gaps - start) <= ROUND * size] = start
    return spring


def linear(s, rate, par):  # type: ignore[no-untyped-def]
    """A spring and damper that act below ``low`` and above ``high``, everywhere if both are 0; par: k, c, low, high.

    The force is k (s - high) + c ds/dt above, k (s - low) + c ds/dt below.
    """
    k, c, low, high = par[0], par[1], par[2], par[3]
    if s >= high:
        x = s - high
    elif s <= low:
        x = s - low
    else:
        return 0.0, 0.0, 0.0, 0.0
    return 0.5 * k * x * x, k * x + c * rate, k, c


def linear_mean(s0, s1, rate, par):  # type: ignore[no-untyped-def]
    """The spring's mean force over a step, whose work is the change of the energy, plus the damper's force."""
    k, c, low, high = par[0], par[1], par[2], par[3]
    if min(s0, s1) >= high:
        return 0.5 * k * (s0 + s1 - 2.0 * high) + c * rate, c * rate * rate
    if max(s0, s1) <= low:
        return 0.5 * k * (s0 + s1 - 2.0 * low) + c * rate, c * rate * rate
    above0, above1 = max(s0 - high, 0.0), max(s1 - high, 0.0)
    below0, below1 = min(s0 - low, 0.0), min(s1 - low, 0.0)
    gained = above1 * above1 - above0 * above0 + below1 * below1 - below0 * below0
    drag = c * rate if not low < 0.5 * (s0 + s1) < high else 0.0
    return (0.5 * k * gained / (s1 - s0) if gained != 0.0 else 0.0) + drag, drag * rate


def _acting(only: str | None, gap: float) -> list[float]:
    """Return the elongation (or angle) below which a spring acts, and the one above which it acts."""
    return [-math.inf if only == "tension" else -gap, math.inf if only == "compression" else gap]


class _SpringOrStop:
    """Common part of springs with stiffness and damping, or a formula."""

    between: tuple[Any, ...]
    stiffness: float
    damping: float
    force: str | None
    only: str | None
    gap: float

    @property
    def damped(self) -> bool:
        """Whether rates cause forces."""
        return bool(self.damping or (self.force and uses_rate(self.force)))

    @property
    def breaks(self) -> bool:
        """Whether the spring acts only in a part of its range of elongation or angle."""
        return self.only is not None or self.gap > 0.0

    def check(self) -> Iterator[Issue]:
        """Yield issues for impossible ends, and for a spring without any effect."""
        yield from check_ends(self.between)
        if self.force is not None:
            for name in ("stiffness", "damping"):
                if getattr(self, name) != 0.0:
                    yield Issue((name,), f"{{}}: {name} and force are both given", "one of them")
        elif self.stiffness == 0 and self.damping == 0:
            yield Issue((), "{}: neither stiffness nor damping is given", "at least one of them > 0, or force")

    def constants(self) -> list[float]:
        """Return the constants of the law: U = k u^2/2 and c du/dt where it acts, with u as in ``rest``."""
        return [self.stiffness, self.damping, *_acting(self.only, self.gap)]


@by_force
@spring(linear, over_step=linear_mean)
@record
class TranslationalSpring(_SpringOrStop):
    """A spring and damper along the line between two points; one-sided with ``only``, a stop with ``gap``."""

    tag = "translational"
    between: tuple[Point | GroundPoint | MovingPoint, ...] = key(
        SPRING_ENDS, "The two ends, one of which may move along a body (dynamic)", example=["a@1", [0, 1]])
    stiffness: float = key(Number("N/m", ge=0), "Stiffness", default=0.0)
    damping: float = key(Number("N s/m", ge=0), "Damping", default=0.0)
    length: float | None = key(Number("m", ge=0), "Length at which the spring is unstressed (default: the distance "
                               "in the reference)", default=None)
    force: str | None = key(ExpressionText("u", ("v",)), PULL_DOC, default=None, example="1e4*u + 1e6*u^3 + 5*v")
    only: str | None = key(ONLY, ONLY_DOC, default=None)
    gap: float = key(Number("m", ge=0), "Elongation or shortening beyond which it acts, as a stop", default=0.0)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    def rest(self) -> float | None:
        """Return the free length L0; u = L - L0."""
        return self.length

    def unreachable(self, length: float) -> str:
        """Return, in words, why the spring never acts if L0 is ``length``, or an empty string if it may act."""
        if self.only != "compression" or self.gap < length:
            return ""
        nearer = f"more than {self.gap:g} nearer than" if self.gap else "nearer than"
        return f"it acts once its ends are {nearer} {length:.6g}, which never happens"


@by_force
@spring(linear, on="angle", over_step=linear_mean)
@record
class RotationalSpring(_SpringOrStop):
    """A spring and damper on the angle between two sections."""

    tag = "rotational"
    between: tuple[Point | GroundPoint, ...] = key(ENDS, "The two ends; [x, y] is the ground",
                                                   example=["a@1", "b@0"])
    stiffness: float = key(Number("N m/rad", ge=0), "Stiffness", default=0.0)
    damping: float = key(Number("N m s/rad", ge=0), "Damping", default=0.0)
    angle: float = key(Number("rad"), "Relative rotation (second minus first) at which the moment is zero",
                       default=0.0)
    force: str | None = key(ExpressionText("u", ("v",)), TURN_DOC, default=None, example="2*sin(u) + 0.1*v")
    only: str | None = key(ONLY, ONLY_DOC, default=None)
    gap: float = key(Number("rad", ge=0), "Relative rotation, either way, beyond which it acts, as a stop", default=0.0)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    def rest(self) -> float:
        """Return the free angle; u = theta_b - theta_a - angle."""
        return self.angle
