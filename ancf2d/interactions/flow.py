"""Material that moves along a body: a fluid that it carries, or its own material, moving through its supports.

Mass that moves with v along the axis has the velocity r_t + v r_x and the acceleration r_tt + 2 v r_tx + v' r_x +
v^2 r_xx. Integration by parts over x turns the last term into -v^2 r_x on dr_x in the body, plus v^2 r_x on dr at the
end where material leaves, minus the same where it enters (Hamilton's principle for changing mass: McIver 1973).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..case.declare import key, record
from ..case.kinds import Name, Number
from ..case.records import ByShape, OneOf
from ..case.schema.amplitudes import Amplitude
from ..case.schema.case import register
from ..elements.formulations import Sampler
from ..elements.formulations.base import across_mass, cross, product_points
from ..elements.point_laws import MAX_MEM, PointLaw
from ..elements.shape import Array, gauss
from ..model.classes import along_mass
from ..model.mesh import BodyMesh, Index
from ..model.point_patch import Items


def flow(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Inertia forces of mass that passes a point, without those at v = 0; fields: r, r_x.

    par: mass, mass per length at an end; a: velocity and its rate.
    """
    v, square = a[0], a[0] * a[0]
    for c in range(2):
        tangent = p0[2 + c] + u[2 + c]
        f[c] = par[0] * (2.0 * v * w[2 + c] + a[1] * tangent) + par[1] * square * tangent
        f[2 + c] = -par[0] * square * tangent
        H[c, 2 + c], H[2 + c, 2 + c] = par[0] * a[1] + par[1] * square, -par[0] * square
        C[c, 2 + c] = 2.0 * par[0] * v
    return 0.0, 0.0


def flow_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """The same at mid-step."""
    v, rate = 0.5 * (a0[0] + a1[0]), 0.5 * (a0[1] + a1[1])
    for c in range(2):
        tangent = p0[2 + c] + 0.5 * (u0[2 + c] + u1[2 + c])
        f[c] = par[0] * (2.0 * v * w[2 + c] + rate * tangent) + par[1] * v * v * tangent
        f[2 + c] = -par[0] * v * v * tangent
    return 0.0, 0.0


def flow_of_turning(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Rotary inertia of sections with theta that pass a point; fields: theta, theta_x; par and a as in ``flow``."""
    v, square, slope = a[0], a[0] * a[0], p0[1] + u[1]
    f[0] = par[0] * (2.0 * v * w[1] + a[1] * slope) + par[1] * square * slope
    f[1] = -par[0] * square * slope
    H[0, 1], H[1, 1], C[0, 1] = par[0] * a[1] + par[1] * square, -par[0] * square, 2.0 * par[0] * v
    return 0.0, 0.0


def flow_of_turning_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """The same at mid-step."""
    v, rate, slope = 0.5 * (a0[0] + a1[0]), 0.5 * (a0[1] + a1[1]), p0[1] + 0.5 * (u0[1] + u1[1])
    f[0] = par[0] * (2.0 * v * w[1] + rate * slope) + par[1] * v * v * slope
    f[1] = -par[0] * v * v * slope
    return 0.0, 0.0


FLOW = PointLaw("flow", flow, flow_mean, symmetric=False)
TURNING = PointLaw("flow_of_turning", flow_of_turning, flow_of_turning_mean, symmetric=False)


class Velocity:
    """The constant velocity in small motions and statics: ``factor`` times the value of the case."""

    def __init__(self, value: float) -> None:
        self.value, self.factor = value, 1.0

    def __call__(self, t: float) -> float:
        """Return the velocity; t has no effect."""
        return self.factor * self.value


class FlowPatch:
    """One law of the material that moves along a body, at points with masses (``parts``).

    ``dofs`` (elements, n) are its coordinates; ``velocity`` is along the body, and its rate enters the forces.
    """

    symmetric, by_rate = False, True

    def __init__(self, mesh: BodyMesh, law: PointLaw, parts: Iterable[tuple[Index, Array, Array, Array]],
                 velocity: Callable[[float], float]) -> None:
        self.mesh, self.law, self.velocity, self.dofs = mesh, law, velocity, mesh.dofs
        self._parts = list(parts)

    def items(self) -> Items:
        """Return the law at its points as point items."""
        return self._items

    @cached_property
    def _items(self) -> Items:
        mesh, fields = self.mesh, 4 if self.law is FLOW else 2
        nc = mesh.plan.element.components
        G, p0, par, dofs = [], [], [], []
        for elements, S, slope, masses in self._parts:
            own, n = mesh.dofs[elements], mesh.dofs.shape[1]
            rows = np.zeros((len(S), fields, n))
            if fields == 2:
                rows[:, 0, 2::nc], rows[:, 1, 2::nc] = S, slope
            else:
                rows[:, 0, 0::nc], rows[:, 1, 1::nc], rows[:, 2, 0::nc], rows[:, 3, 1::nc] = S, S, slope, slope
            local = mesh.e0[own - mesh.first_dof]
            G.append(np.tile(rows, (len(elements), 1, 1)))
            p0.append(np.einsum("pfn,en->epf", rows, local).reshape(-1, fields))
            par.append(np.tile(masses, (len(elements), 1)))
            dofs.append(np.repeat(own, len(S), axis=0))
        m = sum(map(len, par))
        return Items(self.law, np.concatenate(dofs), np.concatenate(G), np.concatenate(p0), np.concatenate(par),
                     np.zeros((m, MAX_MEM)), self.velocity)


class MassPoints(NamedTuple):
    """Points of an element's mass: S and S_x (points, n_shape), and mass ``dm`` and rotary inertia ``dI`` of each
    (or both per length)."""

    S: Array
    slope: Array
    dm: Array
    dI: Array


def mass_points(sampler: Sampler, end: float | None = None) -> MassPoints:
    """Return points that integrate over the mass of an element, or per length over its section at xi = ``end``."""
    along = along_mass(sampler, 1.0) if end is None else (np.array([end]), np.ones(1))
    xi, eta, w = product_points(along, across_mass(sampler))
    rx = sampler.derivative(xi, eta, 1, 0) @ sampler.e0
    density = np.hypot(rx[:, 0], rx[:, 1]) if sampler.shape.element.degree_y == 0 else cross(
        rx, sampler.derivative(xi, eta, 0, 1) @ sampler.e0)
    dv, section = w * density * (sampler.shape.l if end is None else 1.0), sampler.at(xi)
    return MassPoints(sampler.derivative(xi, eta, 0, 0), sampler.derivative(xi, eta, 1, 0), dv * section.rhoA,
                      dv * section.rhoI)


def _ends(mesh: BodyMesh) -> list[tuple[Index, float, float]]:
    """Return element, xi and sign of the entry and the exit of the material; a closed body has none."""
    if mesh.plan.closed:
        return []
    return [(np.array([0]), 0.0, -1.0), (np.array([len(mesh.dofs) - 1]), 1.0, 1.0)]


def _of_fluid(mesh: BodyMesh, density: float) -> Iterator[tuple[Index, Array, Array, Array]]:
    """Yield elements, S, S_x (points, n_shape) and masses (points, 2) of a fluid on the axis."""
    xi, w = gauss(mesh.plan.element.degree_x + 1)
    for k, cls in enumerate(mesh.classes):
        S, slope = (cls.shape(xi, np.zeros_like(xi), i, 0) for i in (0, 1))
        masses = np.stack([density * w * cls.shape.l, np.zeros_like(w)], axis=1)
        yield np.flatnonzero(mesh.cls == k), S, slope, masses
    for elements, x, sign in _ends(mesh):
        S, slope = (mesh.classes[mesh.cls[elements[0]]].shape(np.array([x]), np.zeros(1), i, 0) for i in (0, 1))
        yield elements, S, slope, np.array([[0.0, sign * density]])


def _of_body(mesh: BodyMesh, turning: bool) -> Iterator[tuple[Index, Array, Array, Array]]:
    """Yield the same as ``_of_fluid`` for the body's own material, or with ``turning`` for its rotary inertia."""
    for k, cls in enumerate(mesh.classes):
        at = mass_points(cls.sampler)
        mass = at.dI if turning else at.dm
        yield (np.flatnonzero(mesh.cls == k), at.S, at.slope, np.stack([mass, np.zeros_like(mass)], axis=1))
    for elements, x, sign in _ends(mesh):
        at = mass_points(mesh.classes[mesh.cls[elements[0]]].sampler, x)
        mass = at.dI if turning else at.dm
        yield elements, at.S, at.slope, np.stack([np.zeros_like(mass), sign * mass], axis=1)


VELOCITY = ByShape(number=Number("m/s"), map=OneOf(Amplitude))
VELOCITY_DOC = "Velocity along the axis, over time in motions"


@record
class Transport:
    """A body whose material moves along its axis, through its supports, from S = 0 to S = 1."""

    on: str = key(Name("the name of a body"), "Body whose material moves", refers="bodies", example="belt")
    velocity: float | Amplitude = key(VELOCITY, VELOCITY_DOC, example=20)

    def patches(self, mesh: BodyMesh, velocity: Callable[[float], float]) -> list[FlowPatch]:
        """Return the forces of the moving material."""
        out = [FlowPatch(mesh, FLOW, _of_body(mesh, False), velocity)]
        if mesh.plan.element.has_theta:
            out.append(FlowPatch(mesh, TURNING, _of_body(mesh, True), velocity))
        return out

    def masses(self, mesh: BodyMesh) -> Iterator[tuple[Index, Array]]:
        """Yield nothing: the mass belongs to the body."""
        yield from ()

    def weights(self, mesh: BodyMesh) -> Iterator[tuple[Index, Array]]:
        """Yield nothing: the weight belongs to the body."""
        yield from ()


@record
class Fluid:
    """A fluid that a body carries along its axis, from S = 0 to S = 1."""

    on: str = key(Name("the name of a body"), "Body that carries the fluid", refers="bodies", example="pipe")
    rhoA: float = key(Number("kg/m", gt=0), "Mass of the fluid per length", example=2)
    velocity: float | Amplitude = key(VELOCITY, VELOCITY_DOC, example=20)

    def patches(self, mesh: BodyMesh, velocity: Callable[[float], float]) -> list[FlowPatch]:
        """Return the forces of the moving fluid."""
        return [FlowPatch(mesh, FLOW, _of_fluid(mesh, self.rhoA), velocity)]

    def masses(self, mesh: BodyMesh) -> Iterator[tuple[Index, Array]]:
        """Yield coordinates (m, n) and the mass matrix (n, n) that the fluid adds to the elements of each class."""
        nc = mesh.plan.element.components
        for elements, S, _, masses in _of_fluid(mesh, self.rhoA):
            m = masses[:, 0]
            if m.any():
                M = np.zeros((mesh.dofs.shape[1],) * 2)
                M[0::nc, 0::nc] = M[1::nc, 1::nc] = (S * m[:, None]).T @ S
                yield mesh.dofs[elements], M

    def weights(self, mesh: BodyMesh) -> Iterator[tuple[Index, Array]]:
        """Yield elements and int rhoA s_k dx (n_shape,) of the fluid in the elements of each class."""
        for elements, S, _, masses in _of_fluid(mesh, self.rhoA):
            if masses[:, 0].any():
                yield elements, masses[:, 0] @ S


register("transport", Transport, ("on", "velocity"), ("patches", "masses", "weights"))
register("fluid", Fluid, ("on", "velocity"), ("patches", "masses", "weights"))
