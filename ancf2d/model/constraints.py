"""Supports and joints as equations between coordinates, and checks of prescribed motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..case import Active, Latch
from ..elements.point_laws import PointLaw, half_sine, with_multiplier
from ..elements.registry import RIGID_FRAME
from ..elements.shape import Array
from ..errors import ComputationError
from .breakpoints import jumps
from .mesh import BodyMesh, Index
from .point_patch import NOTHING, Field, PointConstraint, turn_fields
from .points import PointRef
from .timing import Signal, TimeFunction, rates_of

LENGTH = "length"
TURNED = "relative rotation"


@dataclass(frozen=True)
class Row:
    """A linear equation: sum of coefs * d[coords] = signal(t), or 0 without a signal.

    ``owner`` is the support or joint that it belongs to, ``holds`` says in words what it holds. If it holds a vector
    along an angle, ``vector`` has the columns of x and y of this vector and the angle; the direction turns with the
    section until the support engages. ``initial_gap`` is the violation in the reference of a joint that engages later.
    """

    coords: Index
    coefs: Array
    owner: str
    holds: str
    signal: TimeFunction | None = None
    vector: tuple[list[tuple[Index, Array]], float] | None = None
    initial_gap: float = 0.0

    def value(self, t: float, order: int = 0) -> float:
        """Return the right-hand side at load factor or time t, or its first or second time derivative."""
        if order > 0:
            return rates_of(self.signal, t)[order - 1]
        return 0.0 if self.signal is None else self.signal(t)


class Constraint(Protocol):
    """A nonlinear scalar equation g(d, t) = 0, enforced by a multiplier; ``scale`` is the size of its terms."""

    owner: str
    holds: str
    scale: float
    dofs: Index
    multiplier: int
    active: Active | Latch | None
    facing: Callable[[Array], float] | None

    def reference_gradient(self) -> Array:
        """Return the gradient (n,) in the reference, before any prescribed motion."""
        ...

    def turns_by(self, t: float) -> list[tuple[PointRef, float]]:
        """Return the sections whose rotation is prescribed and their rotations at t, including full turns."""
        ...


@dataclass
class Equations:
    """The equations of supports and joints, and warnings about them."""

    rows: list[Row] = field(default_factory=list)
    constraints: list[Constraint] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def combine(*parts: tuple[float, tuple[Index, Array]]) -> tuple[Index, Array]:
    """Return the sum of factor * columns as one set of (coordinates, weights), without repeats or zeros."""
    total: dict[int, float] = {}
    for factor, (coords, weights) in parts:
        for i, w in zip(coords.tolist(), (factor * weights).tolist(), strict=True):
            total[i] = total.get(i, 0.0) + w
    kept = {i: w for i, w in total.items() if w != 0.0}
    return np.array(list(kept), dtype=np.int64), np.array(list(kept.values()))


def along(columns: list[tuple[Index, Array]], x: float, y: float) -> tuple[Index, Array]:
    """Return the component of a planar vector along (x, y); round-off in the direction counts as 0."""
    x, y = (0.0 if abs(v) < 1e-15 else v for v in (x, y))
    return combine((x, columns[0]), (y, columns[1]))


def at_angle(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Direction that follows the angle of another field plus mem[0]: p x (cos, sin)(theta) = 0."""
    x, y = p0[0] + u[0], p0[1] + u[1]
    c, s = np.cos(p0[2] + u[2] + mem[0]), np.sin(p0[2] + u[2] + mem[0])
    g = x * s - y * c
    f[0], f[1], f[2] = s, -c, x * c + y * s
    H[0, 2], H[2, 0], H[1, 2], H[2, 1], H[2, 2] = c, c, s, s, -g
    with_multiplier(g, u, f, H)
    return 0.0, 0.0


def at_angle_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Discrete gradient of ``at_angle``: means, and the chord slopes of sine and cosine."""
    t0, t1, lam = p0[2] + u0[2] + mem[0], p0[2] + u1[2] + mem[0], u1[3]
    xm, ym = p0[0] + 0.5 * (u0[0] + u1[0]), p0[1] + 0.5 * (u0[1] + u1[1])
    chord = half_sine(t1 - t0)
    half = 0.5 * (t0 + t1)
    f[0], f[1] = 0.5 * lam * (np.sin(t0) + np.sin(t1)), -0.5 * lam * (np.cos(t0) + np.cos(t1))
    f[2] = lam * chord * (xm * np.cos(half) + ym * np.sin(half))
    f[3] = (p0[0] + u1[0]) * np.sin(t1) - (p0[1] + u1[1]) * np.cos(t1)
    return 0.0, 0.0


def aligned(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Two directions that keep their angle: p_a x p_b = 0."""
    ax, ay, bx, by = p0[0] + u[0], p0[1] + u[1], p0[2] + u[2], p0[3] + u[3]
    f[0], f[1], f[2], f[3] = by, -bx, -ay, ax
    H[0, 3], H[3, 0], H[1, 2], H[2, 1] = 1.0, 1.0, -1.0, -1.0
    with_multiplier(ax * by - ay * bx, u, f, H)
    return 0.0, 0.0


def aligned_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Discrete gradient: the gradient at the midpoint, which is exact for a quadratic form."""
    lam = u1[4]
    f[0], f[1] = lam * (p0[3] + 0.5 * (u0[3] + u1[3])), -lam * (p0[2] + 0.5 * (u0[2] + u1[2]))
    f[2], f[3] = -lam * (p0[1] + 0.5 * (u0[1] + u1[1])), lam * (p0[0] + 0.5 * (u0[0] + u1[0]))
    f[4] = (p0[0] + u1[0]) * (p0[3] + u1[3]) - (p0[1] + u1[1]) * (p0[2] + u1[2])
    return 0.0, 0.0


def fixed_length(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Constant distance: (|p|^2 - L^2)/(2 L) = 0, computed from the displacements; par: L."""
    L = par[0]
    f[0], f[1] = (p0[0] + u[0]) / L, (p0[1] + u[1]) / L
    H[0, 0], H[1, 1] = 1.0 / L, 1.0 / L
    with_multiplier(((p0[0] + 0.5 * u[0]) * u[0] + (p0[1] + 0.5 * u[1]) * u[1]) / L, u, f, H)
    return 0.0, 0.0


def fixed_length_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Discrete gradient: the gradient at the midpoint, which is exact for a quadratic form."""
    L, lam = par[0], u1[2]
    for i in range(2):
        f[i] = lam * (p0[i] + 0.5 * (u0[i] + u1[i])) / L
    f[2] = ((p0[0] + 0.5 * u1[0]) * u1[0] + (p0[1] + 0.5 * u1[1]) * u1[1]) / L
    return 0.0, 0.0


AT_ANGLE = PointLaw("at_angle", at_angle, at_angle_mean, constraint=True)
ALIGNED = PointLaw("aligned", aligned, aligned_mean, constraint=True)
FIXED_LENGTH = PointLaw("fixed_length", fixed_length, fixed_length_mean, constraint=True)


def _at_angle(p: Array) -> float:
    return float(p[0] * math.cos(p[2]) + p[1] * math.sin(p[2]))


def _aligned(p: Array) -> float:
    return float(p[0] * p[2] + p[1] * p[3])


def directions_aligned(a: PointRef, b: PointRef, owner: str) -> PointConstraint:
    """Return the constraint that two section directions keep their reference angle."""
    (_, fields_a), (_, fields_b) = turn_fields(a), turn_fields(b)
    scale = fields_a[0].p0 * fields_b[0].p0
    return PointConstraint(ALIGNED, [*fields_a, *fields_b], [], owner, TURNED, scale,
                           facing=_aligned)


def direction_at_theta(a: PointRef, b: PointRef, owner: str) -> PointConstraint:
    """Return the constraint that the section direction of a follows the rotation coordinate of b."""
    _, fields = turn_fields(a)
    _, theta = turn_fields(b)
    return PointConstraint(AT_ANGLE, [*fields, *theta], [], owner, TURNED, fields[0].p0,
                           facing=_at_angle)


def direction_prescribed(point: PointRef, signal: TimeFunction, owner: str) -> PointConstraint:
    """Return the constraint that the section direction of a point is at the angle signal(t) from its reference."""
    _, fields = turn_fields(point)
    return PointConstraint(AT_ANGLE, [*fields, NOTHING], [], owner, "rotation", fields[0].p0, signal, fed=2,
                           facing=_at_angle, sections=[point])


def keep_lengths(mesh: BodyMesh, out: Equations) -> None:
    """Add the equations of a rigid body: constant lengths of pieces; for a frame |r_x| = 1 and r_y = r_x rotated."""
    if not mesh.plan.rigid:
        return
    if mesh.plan.element is RIGID_FRAME:
        _, _, *axes = mesh.dofs[0].tolist()
        fields = [Field(np.array([a]), np.ones(1), float(mesh.e0[a - mesh.first_dof])) for a in axes[:2]]
        for x, y, sign in ((axes[0], axes[3], -1.0), (axes[1], axes[2], 1.0)):
            out.rows.append(Row(np.array([x, y]), np.array([sign, 1.0]), mesh.plan.name, "direction of its frame"))
        out.constraints.append(PointConstraint(FIXED_LENGTH, fields, [1.0], mesh.plan.name, LENGTH, 1.0))
        return
    for dofs in mesh.dofs:
        a, b = dofs[:2], dofs[2:]
        p0 = mesh.e0[b - mesh.first_dof] - mesh.e0[a - mesh.first_dof]
        L = float(np.hypot(*p0))
        fields = [Field(np.array([a[k], b[k]]), np.array([-1.0, 1.0]), float(p0[k])) for k in range(2)]
        out.constraints.append(PointConstraint(FIXED_LENGTH, fields, [L], mesh.plan.name, LENGTH, L))


def share_direction(a: PointRef, b: PointRef, owner: str, out: Equations) -> None:
    """Add the linear equations that two rigid bars keep their angle and the ratio of their lengths."""
    (to_a, at_a), (to_b, at_b) = a.director(), b.director()
    c, s = math.cos(at_a - at_b), math.sin(at_a - at_b)
    for axis, one, (x, y) in zip("xy", to_a, ((c, -s), (s, c)), strict=True):
        x, y = (0.0 if abs(v) < 1e-15 else v for v in (x, y))
        out.rows.append(Row(*combine((1.0, one), (-x, to_b[0]), (-y, to_b[1])), owner, f"direction along {axis}"))


def align(a: PointRef, b: PointRef, owner: str, out: Equations) -> None:
    """Add the equation that the sections at a and b keep their relative angle."""
    if a.turns_by_theta and b.turns_by_theta:
        coords, coefs = combine((1.0, a.theta()), (-1.0, b.theta()))
        out.rows.append(Row(coords, coefs, owner, TURNED))
    elif a.turns_by_theta:
        out.constraints.append(direction_at_theta(b, a, owner))
    elif b.turns_by_theta:
        out.constraints.append(direction_at_theta(a, b, owner))
    else:
        out.constraints.append(directions_aligned(a, b, owner))


def hold_along(columns: list[tuple[Index, Array]], angle: float, owner: str, holds: str) -> Row:
    """Return the row that holds a planar vector of a section along a direction, which turns with the section."""
    return Row(*along(columns, math.cos(angle), math.sin(angle)), owner, holds, None, (columns, angle))


def hold_rotation(point: PointRef, owner: str, out: Equations) -> None:
    """Add the row that the section at a point keeps its reference direction."""
    if point.turns_by_theta:
        coords, coefs = point.theta()
    else:
        columns, angle = point.director()
        coords, coefs = along(columns, -math.sin(angle), math.cos(angle))
    out.rows.append(Row(coords, coefs, owner, "rotation"))


def prescribe_rotation(point: PointRef, signal: TimeFunction, owner: str, out: Equations) -> None:
    """Add the equation that the section at a point rotates by signal(t) from its reference direction."""
    if point.turns_by_theta:
        coords, coefs = point.theta()
        out.rows.append(Row(coords, coefs, owner, "rotation", signal))
    else:
        out.constraints.append(direction_prescribed(point, signal, owner))


# key of a prescribed motion in the case, by ``holds`` of its equation
MOTIONS = {"x": "x", "y": "y", "ux": "ux", "uy": "uy", "rotation": "angle"}
_WORDS = {"x": "prescribed x", "y": "prescribed y", "ux": "prescribed displacement ux",
          "uy": "prescribed displacement uy", "angle": "prescribed angle"}


@dataclass(frozen=True)
class Motion:
    """One prescribed motion: the change of a position or angle from the reference; ``key`` is its entry in the case."""

    owner: str
    key: str
    course: TimeFunction
    # when it acts; None: always
    window: Active | Latch | None = None

    @property
    def starts(self) -> bool:
        """Return whether it acts at t = 0."""
        return self.window is None or self.window.at(0.0)

    @property
    def name(self) -> str:
        """Support and motion, in words."""
        return f"{self.owner}: the {_WORDS[self.key]}"

    def start_problem(self, extent: float) -> tuple[str, str] | None:
        """Return message and expectation if the motion does not start at the reference, or None."""
        try:
            away = self.course(0.0)
        except ComputationError as error:
            return f"{self.name} has no value at t = 0: {error}", "an amplitude that is defined at t = 0"
        if abs(away) <= 1e-9 * (1.0 if self.key == "angle" else extent):
            return None
        if self.key in "xy":
            assert isinstance(self.course, Signal)  # a plain number in statics starts at the reference
            place = -self.course.offset
            return (f"{self.name} is {place + away:.6g} at t = 0, but the point is at {self.key} = {place:.6g}",
                    f"{place:.6g} at t = 0, or u{self.key} in place of {self.key} for a displacement")
        return f"{self.name} is {away:.6g} at t = 0", "0 at t = 0"

    def jump_problem(self, t_end: float) -> tuple[str, str] | None:
        """Return message and expectation if the motion jumps, which would need an infinite velocity, or None."""
        begin, end = (-math.inf, math.inf) if self.window is None else self.window.times
        # a motion that waits for a condition may start at any time
        first = max(begin, 0.0) if begin < math.inf else 0.0
        found = jumps(self.course, first, min(end, t_end)) if isinstance(self.course, Signal) else []
        found = [t for t in found if first < t < end]
        if not found:
            return None
        more = ("", " and once more")[len(found) - 1] if len(found) < 3 else f" and {len(found) - 1} more times"
        return f"{self.name} jumps at t = {found[0]:.6g}{more}", "a continuous motion, for example a smooth table"


def motions(rows: Iterable[Any], constraints: Iterable[Any]) -> Iterator[Motion]:
    """Yield the prescribed motions among the equations of supports."""
    for item in (*rows, *constraints):
        course = getattr(item, "signal", None)
        if course is not None and item.holds in MOTIONS:
            yield Motion(item.owner, MOTIONS[item.holds], course, getattr(item, "active", None))
