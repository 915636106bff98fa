"""Loads on whole bodies and along them: gravity, line loads, natural strains and temperature."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..case.binder import Issue, reversed_range
from ..case.declare import key, record
from ..case.kinds import NAME, Flag, Name, Number, Vector
from ..case.schema.active import ACTIVE, ACTIVE_DOC, Active
from ..case.schema.amplitudes import Amplitude
from ..case.schema.points import MovingPoint
from ..case.schema.profiles import PointExpression, Profile, ProfileOf, ProfileTable
from ..elements.formulations import FORMULATIONS
from ..elements.point_laws import DIRECTION, GROUND, MAX_MEM, THETA, PointLaw
from ..elements.shape import Array, gauss
from ..errors import PartError
from ..model.mesh import BodyMesh, Index
from ..model.point_patch import Items
from ..model.profiles import breaks, load_breaks, values
from ..model.timing import Clocked, FeedbackSignal, Signal
from .forces import (
    AMPLITUDE,
    AMPLITUDE_DOC,
    FOLLOWER,
    AlongBody,
    LoadContext,
    LoadSet,
    NaturalStrain,
    load,
)
from .formulas import ALONG_BODY, LOCAL, RATES, density_formula, is_formula, weights_of

Density = tuple[float | Profile, float | Profile]
# Gauss points along the axis for a varying load, in addition to those for a constant one
VARYING = 4
# the same for a load by formula: exact for products of two interpolated quantities, such as drag by |v| v along a line
OF_FORMULA = -1
# orders of the derivative of r (or of theta) that gives the rotation of a section
_TURNS_WITH = {"interpolated": (0, 1), "tangent": (1, 0), "theta": (0, 0)}


class Line(NamedTuple):
    """A force per reference length on a body from S = ``start`` to ``end``; a ``follower`` rotates with the axis."""

    body: str
    start: float
    end: float
    density: Density
    follower: bool


def _element_loads(mesh: BodyMesh, elements: Index, forces: Array) -> tuple[Index, Array]:
    """Return coordinates and values of forces (2, 1 or elements, n_shape) on the shape functions of some elements."""
    nc = mesh.plan.element.components
    dofs = np.concatenate([mesh.dofs[elements, c::nc].ravel() for c in (0, 1)])
    return dofs, np.broadcast_to(forces, (2, len(elements), forces.shape[-1])).ravel()


def per_length(density: Density, mesh: BodyMesh, elements: Index, xi: Array) -> Array:
    """Return both components (2, elements, p) of a load per length at points xi (p,) or (elements, p) of elements.

    The shape is (2, 1, 1) if both are constant.
    """
    if all(isinstance(v, float) for v in density):
        return np.array(density, dtype=float)[:, None, None]
    s = (mesh.starts[elements, None] + np.broadcast_to(xi, (len(elements), np.shape(xi)[-1]))
         * mesh.lengths[elements, None]) / mesh.plan.length
    return np.array([values(v, s.ravel()).reshape(s.shape) for v in density])


@load
@record
class Gravity:
    """Gravity on everything that has mass."""

    tag = "gravity"
    feedback = False
    value: tuple[float, float] = key(Vector(Number("m/s^2"), "gx, gy"), "Acceleration",
                                     example=[0, -9.81])
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def acceleration(self) -> tuple[float, float]:
        """The acceleration of everything that has mass, without the amplitude."""
        return self.value

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add the weight of every body and point mass."""
        for mesh in context.meshes.values():
            weights = np.array([cls.mass_weights for cls in mesh.classes])[mesh.cls]
            forces = np.multiply.outer(np.array(self.value), weights)
            out.dead.append(context.dead(*_element_loads(mesh, np.arange(len(weights)), forces), gravity=True))
        for flow in context.flows:
            mesh = context.meshes[flow.on]
            for elements, weights in flow.weights(mesh):
                forces = np.multiply.outer(np.array(self.value), weights)[:, None]
                out.dead.append(context.dead(*_element_loads(mesh, elements, forces), gravity=True))
        for mass in context.masses:
            if isinstance(mass.at, MovingPoint):
                out.patches.append(context.moving(mass.at, [mass.mass * a for a in self.value], gravity=True))
                continue
            for (coords, weights), a in zip(context.point(mass.at).position(), self.value, strict=True):
                out.dead.append(context.dead(coords, weights * a * mass.mass, gravity=True))


def _position_and_rotation(mesh: BodyMesh, elements: Index, xi: Array) -> tuple[Array, Array, Array]:
    """Return G, p0 and the reference angle for x, y and section rotation at points xi of elements of one class.

    They are (elements, points, fields, n), (elements, points, fields) and (elements, points).
    """
    element, dofs = mesh.plan.element, mesh.dofs[elements]
    nc, shape, zero = element.components, mesh.classes[mesh.cls[elements[0]]].shape, np.zeros_like(xi)
    S, D = shape(xi, zero), shape(xi, zero, *_TURNS_WITH[element.section_kind])
    local, theta = mesh.e0[dofs - mesh.first_dof], nc == 3
    m, p, n = len(elements), len(xi), dofs.shape[1]
    G, p0 = np.zeros((m, p, 3 if theta else 4, n)), np.zeros((m, p, 3 if theta else 4))
    G[:, :, 0, 0::nc], G[:, :, 1, 1::nc] = S, S
    if theta:
        G[:, :, 2, 2::3] = D
        return G, p0, local[:, 2::3] @ D.T
    x, y = local[:, 0::2] @ D.T, local[:, 1::2] @ D.T
    p0[:, :, 2] = length = np.hypot(x, y)
    c, s = x / length, y / length
    G[:, :, 2, 0::2], G[:, :, 2, 1::2] = c[..., None] * D, s[..., None] * D
    G[:, :, 3, 0::2], G[:, :, 3, 1::2] = -s[..., None] * D, c[..., None] * D
    return G, p0, np.arctan2(y, x) - (0.5 * math.pi if element.section_kind == "interpolated" else 0.0)


class LineLoad:
    """A line load as one force per quadrature point, with coordinates ``dofs`` (elements, n)."""

    symmetric = False
    law: PointLaw

    def __init__(self, mesh: BodyMesh, cover: list[tuple[Index, Array, Array]], value: Density,
                 amplitude: Callable[[float], float]) -> None:
        self.mesh, self.cover, self.value, self.amplitude = mesh, cover, value, amplitude
        self.dofs = np.concatenate([mesh.dofs[elements] for elements, _, _ in cover])

    def items(self) -> Items:
        """Return the forces at the quadrature points as point items, element by element."""
        return self._items

    @cached_property
    def _items(self) -> Items:
        parts = [self._of(*part) for part in self.cover]
        dofs, G, p0, par = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Items(self.law, dofs, G, p0, par, np.zeros((len(p0), MAX_MEM)), self.amplitude)

    def _of(self, elements: Index, xi: Array, w: Array) -> tuple[Index, Array, Array, Array]:
        """Return dofs, G, p0 and par of the points xi of some elements of one class."""
        raise NotImplementedError


class FormulaLine(LineLoad):
    """A line load by formula in quantities of the points that it acts on."""

    law = ALONG_BODY

    def __init__(self, mesh: BodyMesh, cover: list[tuple[Index, Array, Array]], value: Density,
                 amplitude: Callable[[float], float]) -> None:
        super().__init__(mesh, cover, value, Clocked(amplitude.amplitude, amplitude.factor, amplitude.offset)
                         if isinstance(amplitude, Signal) else amplitude)
        self.formula, self.uses_theta, self.damped = density_formula(value)

    def _of(self, elements: Index, xi: Array, w: Array) -> tuple[Index, Array, Array, Array]:
        mesh, (G, p0, _) = self.mesh, _position_and_rotation(self.mesh, elements, xi)
        dofs, nc = mesh.dofs[elements], mesh.plan.element.components
        m, p, _, n = G.shape
        local = mesh.e0[dofs - mesh.first_dof]
        for c in (0, 1):
            p0[:, :, c] = np.einsum("mpn,mn->mp", G[:, :, c], local)
        kind = (THETA if nc == 3 else DIRECTION) if self.uses_theta else GROUND
        fields = G.shape[2] if self.uses_theta else 2
        s = (mesh.starts[elements, None] + xi * mesh.lengths[elements, None]) / mesh.plan.length
        par = weights_of(w, s, self.formula.address, kind)
        return (np.repeat(dofs, p, axis=0), np.ascontiguousarray(G[:, :, :fields]).reshape(m * p, fields, n),
                np.ascontiguousarray(p0[:, :, :fields]).reshape(m * p, fields), par.reshape(m * p, 4))


class FollowerLine(LineLoad):
    """A line load (tangential, normal) per reference length, rotating with the section."""

    law = FOLLOWER

    def _of(self, elements: Index, xi: Array, w: Array) -> tuple[Index, Array, Array, Array]:
        mesh, dofs = self.mesh, self.mesh.dofs[elements]
        G, p0, angle = _position_and_rotation(mesh, elements, xi)
        m, p, _, n = G.shape
        (ft, fn), c, s = per_length(self.value, mesh, elements, xi), np.cos(angle), np.sin(angle)
        kind = np.full((m, p), THETA if mesh.plan.element.components == 3 else DIRECTION)
        par = np.stack([w * (c * ft - s * fn), w * (s * ft + c * fn), kind], axis=-1)
        return np.repeat(dofs, p, axis=0), G.reshape(m * p, -1, n), p0.reshape(m * p, -1), par.reshape(m * p, 3)


def covered(mesh: BodyMesh, s0: float, s1: float, more: int = 0) -> list[tuple[Index, Array, Array]]:
    """Return (elements, points xi, weights in m) that integrate over [s0, s1] of a body's arc length.

    ``more`` is the number of points in addition to those for a constant.
    """
    x, w = gauss(mesh.plan.element.degree_x + 3 + more)
    out = []
    for k, piece in enumerate(mesh.plan.pieces):
        a = (s0 * mesh.plan.length - piece.s0) / piece.l
        b = (s1 * mesh.plan.length - piece.s0) / piece.l
        a, b = max(a, 0.0), min(b, float(piece.count))
        if b - a <= 1e-12:
            continue
        first, last = int(np.ceil(a - 1e-12)), int(np.floor(b + 1e-12))
        base = mesh.piece_first[k]
        if last > first:
            out.append((base + np.arange(first, last), x, w * piece.l))
        ends = [(first - 1, a - first + 1, 1.0), (last, 0.0, b - last)]
        if last < first:
            ends = [(last, a - last, b - last)]
        for ie, xi0, xi1 in ends:
            if xi1 - xi0 > 1e-12:
                out.append((np.array([base + ie]), xi0 + (xi1 - xi0) * x, w * piece.l * (xi1 - xi0)))
    return out


@load
@record
class Distributed:
    """A force per unit reference length on a body's axis."""

    tag = "distributed"
    on: str = key(Name("the name of a body"), "Body it acts on", refers="bodies", example="beam")
    value: Density = key(
        Vector(ProfileOf("N/m", local=LOCAL), "fx, fy"),
        "Force per length, each component a number, an expression in s or a table {s, value}; [tangential, normal] "
        "with follower. Expressions may use t, and x, y, vx, vy, theta of the point that the force acts on",
        example=[0, -500])
    from_: float = key(Number("", ge=0, le=1), "S where it begins", default=0.0)
    to: float = key(Number("", ge=0, le=1), "S where it ends", default=1.0)
    follower: bool = key(Flag(), "Whether it turns with the axis", default=False)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def line(self) -> Line | None:
        """Where it acts and its density, without the amplitude; None if the density depends on the motion."""
        return None if is_formula(self.value) else Line(self.on, self.from_, self.to, self.value, self.follower)

    @property
    def damped(self) -> bool:
        """Whether the density depends on rates."""
        return any(not RATES.isdisjoint(value.quantities) for value in self.value if isinstance(value, PointExpression))

    @property
    def places(self) -> tuple[str, tuple[float, ...]] | None:
        """The body, and the positions on it that need nodes in addition to those of ``line``."""
        return (self.on, (self.from_, self.to)) if is_formula(self.value) else None

    def check(self) -> Iterator[Issue]:
        """Yield issues for an extent that is empty or reversed, and for formulas that cannot be used."""
        yield from reversed_range(self.from_, self.to)
        if is_formula(self.value):
            if self.follower:
                yield Issue(("follower",), "{}: a load that depends on the motion of its points cannot follow the body",
                            "components along x and y; use theta for directions of the body")
            for k, value in enumerate(self.value):
                if isinstance(value, ProfileTable):
                    yield Issue(("value", k), f"{{}}.value.{k}: a table cannot be combined with a formula in "
                                "quantities of the point", "an expression in s")

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add the load by quadrature along the elements that it covers."""
        mesh = context.meshes[self.on]
        if is_formula(self.value):
            if isinstance(context.amplitude, FeedbackSignal):
                raise PartError(("amplitude",), "the amplitude of a load by formula is a function of time alone",
                                "a formula in value without probes and controllers")
            cover = covered(mesh, self.from_, self.to, OF_FORMULA)
            out.patches.append(FormulaLine(mesh, cover, self.value, context.amplitude))
            return
        more = 0 if all(isinstance(v, float) for v in self.value) else VARYING
        cover = [part for a, b in pairwise(load_breaks(self.line)) for part in covered(mesh, a, b, more)]
        if self.follower:
            out.patches.append(FollowerLine(mesh, cover, self.value, context.amplitude))
            return
        for elements, xi, w in cover:
            S = mesh.classes[mesh.cls[elements[0]]].shape(xi, np.zeros_like(xi))
            forces = (w * per_length(self.value, mesh, elements, xi)) @ S
            out.dead.append(context.dead(*_element_loads(mesh, elements, forces)))


def _add(load: Eigenstrain | Temperature, values: tuple[AlongBody, AlongBody, AlongBody, AlongBody],
         context: LoadContext, out: LoadSet) -> None:
    mesh = context.meshes[load.on]
    plan = mesh.plan
    if plan.rigid:
        raise PartError(("on",), f"body '{load.on}' is rigid", "a body that deforms")
    if plan.formulation.natural is None:
        known = [f.name for f in FORMULATIONS.values() if f.natural is not None and f.refuse(plan.element) is None]
        raise PartError(("on",), f"formulation {plan.formulation.name} of body '{load.on}' does not support "
                        "eigenstrains", "one of " + ", ".join(known))
    out.natural.append(NaturalStrain(mesh, load.from_, load.to, values, context.amplitude))


def _places(load: Eigenstrain | Temperature, *parts: AlongBody) -> tuple[str, tuple[float, ...]]:
    inner = {s for p in parts if not isinstance(p, float) for s, _ in breaks(p) if load.from_ < s < load.to}
    return load.on, (load.from_, *sorted(inner), load.to)


def _issues(load: Eigenstrain | Temperature, empty: str) -> Iterator[Issue]:
    yield from reversed_range(load.from_, load.to)
    if empty:
        yield Issue((), f"{{}} has no effect: {empty} are both 0", f"{empty.replace(' and ', ', ')} or both")


@load
@record
class Eigenstrain:
    """Strains that a body would take if it were free, caused by actuators, growth or an initial curvature."""

    tag = "eigenstrain"
    feedback = False
    on: str = key(Name("the name of a body"), "Body it acts on", refers="bodies", example="strip")
    axial: float | Profile = key(ProfileOf(), "Strain of the axis", default=0.0, example=1e-3)
    curvature: float | Profile = key(ProfileOf("1/m"), "Curvature: change of the angle per reference length, "
                                     "counter-clockwise", default=0.0, example=0.2)
    from_: float = key(Number("", ge=0, le=1), "S where it begins", default=0.0)
    to: float = key(Number("", ge=0, le=1), "S where it ends", default=1.0)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def places(self) -> tuple[str, tuple[float, ...]]:
        """The body, and the positions on it that need nodes."""
        return _places(self, self.axial, self.curvature)

    def check(self) -> Iterator[Issue]:
        """Yield issues for an extent that is empty or reversed, and for an eigenstrain that is zero."""
        yield from _issues(self, "axial and curvature" if self.axial == 0.0 and self.curvature == 0.0 else "")

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add the eigenstrain to the natural strains of the body."""
        _add(self, (self.axial, self.curvature, 0.0, 0.0), context, out)


@load
@record
class Temperature:
    """A change of temperature, which strains the body by the material's alpha, the same in all directions."""

    tag = "temperature"
    feedback = False
    on: str = key(Name("the name of a body"), "Body it acts on", refers="bodies", example="strip")
    value: float | Profile = key(ProfileOf("K"), "Change of temperature on the axis", default=0.0, example=60)
    gradient: float | Profile = key(ProfileOf("K/m"), "Gradient across the section, along its y axis",
                                    default=0.0)
    from_: float = key(Number("", ge=0, le=1), "S where it begins", default=0.0)
    to: float = key(Number("", ge=0, le=1), "S where it ends", default=1.0)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def places(self) -> tuple[str, tuple[float, ...]]:
        """The body, and the positions on it that need nodes."""
        return _places(self, self.value, self.gradient)

    def check(self) -> Iterator[Issue]:
        """Yield issues for an extent that is empty or reversed, and for a temperature change that is zero."""
        yield from _issues(self, "value and gradient" if self.value == 0.0 and self.gradient == 0.0 else "")

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add the thermal strain of the material to the natural strains of the body."""
        section = context.meshes[self.on].plan.section
        # the mean over the layers may be 0
        if not (section.alpha or any(layer.alpha for layer in section.layers)):
            of = ".section.layers.0" if section.layers else ""
            raise PartError(("on",), f"body '{self.on}' has no thermal expansion",
                            f"bodies.{self.on}{of}.material.alpha, in 1/K")
        _add(self, (0.0, 0.0, self.value, self.gradient), context, out)
