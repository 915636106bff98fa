"""Section forces N, Q, M at a point, by equilibrium of its element's part before it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..case import Distributed, Gravity
from ..elements.definition import ElementType
from ..elements.shape import Array, gauss
from ..kernels.elements import element_matrices
from ..kernels.viscous import viscous_force
from ..model.groups import damping_times
from ..model.mechanism import rigid_motion
from ..model.mesh import BodyMesh, mass_matrix, over_body
from ..model.model import Model
from ..model.points import PointRef, dot
from ..model.rotation import Rotation
from .mass import inertia_rates
from .state import State

Density = Callable[[Any], Array]


def _constant(f: Array) -> Density:
    return lambda at: f


def _line_loads(model: Model, mesh: BodyMesh, e: Array, d: Array, t: float) -> Iterator[tuple[Density, float, float]]:
    """Yield the distributed loads on a body [N/m], with the fractions of its arclength between which they act."""
    for load in model.case.loads:
        if isinstance(load, Distributed) and load.on == mesh.plan.name:
            f = _amplitude(model, load, t) * np.array(load.value, dtype=float)
            turned = (lambda point, f=f: Rotation(point).axes(e, d) @ f) if load.follower else _constant(f)
            yield turned, load.from_, load.to


def _accelerations(model: Model, t: float) -> Iterator[Density]:
    """Yield the fields of acceleration that act on all mass: gravity and the turning frame."""
    for load in model.case.loads:
        if isinstance(load, Gravity):
            yield _constant(_amplitude(model, load, t) * np.array(load.value, dtype=float))
    spin = model.case.steady_rotation
    if spin is not None:
        yield lambda r: t * spin.omega**2 * (r - np.array(spin.about))


def _amplitude(model: Model, load: Gravity | Distributed, t: float) -> float:
    return model.timing.follow(load.amplitude)(t)


def _position(point: PointRef, e: Array) -> Array:
    return np.array([dot(c, e) for c in point.position()])


@dataclass(frozen=True)
class _OnElement:
    """The line and body loads on one element, sampled: what they sum to, up to a point or shape by shape.

    ``a`` (n_q,) are accelerations: forces -rho a act like loads.
    """

    model: Model
    point: PointRef
    e: Array
    d: Array
    t: float
    a: Array | None = None

    def _samples(self, upto: float,
                 loads: Iterable[tuple[Density, float, float]]) -> Iterator[tuple[PointRef, Array]]:
        """Yield points on the element from its start to ``upto`` (0 to 1) with the force each stands for."""
        point, mesh = self.point, self.point.mesh
        l = mesh.classes[mesh.cls[point.ie]].shape.l
        k = max(i for i, first in enumerate(mesh.piece_first) if first <= point.ie)
        piece, length = mesh.plan.pieces[k], mesh.plan.length
        start = piece.s0 + (point.ie - mesh.piece_first[k]) * l
        for density, a, b in loads:
            low, high = max(a * length - start, 0.0), min(b * length - start, upto * l)
            for xi, weight in zip(*gauss(6), strict=True) if high > low else ():
                s = low + xi * (high - low)
                angle = piece.angle + piece.kappa * (start + s - piece.s0)
                there = PointRef(mesh, (start + s) / length, point.ie, s / l, angle, None)
                yield there, density(there) * weight * (high - low)

    def resultant(self) -> Array:
        """Return force and moment about the point (3,) of the loads up to it."""
        P = _position(self.point, self.e)
        total = np.zeros(3)
        mesh = self.point.mesh
        rhoA = mesh.plan.section.rhoA
        loads = list(_line_loads(self.model, mesh, self.e, self.d, self.t))
        for field in _accelerations(self.model, self.t):
            loads.append((lambda p, field=field: rhoA * field(_position(p, self.e)), 0.0, 1.0))
        for there, f in self._samples(self.point.xi, loads):
            r = _position(there, self.e) - P
            total += f[0], f[1], r[0] * f[1] - r[1] * f[0]
        return total if self.a is None else total + self._inertia(self.a, P)

    def _inertia(self, a: Array, P: Array) -> Array:
        """Return force and moment about P (3,) of -rho a over the sections up to the point."""
        mesh = self.point.mesh
        nc, section, dofs = mesh.plan.element.components, mesh.plan.section, mesh.dofs[self.point.ie]
        S, dv = over_body(mesh.classes[mesh.cls[self.point.ie]].sampler, self.point.xi)
        r, b = S @ self.e[dofs].reshape(-1, nc), S @ a[dofs].reshape(-1, nc)
        f = -(section.rhoA * dv)[:, None] * b[:, :2]
        moment = float(((r[:, 0] - P[0]) * f[:, 1] - (r[:, 1] - P[1]) * f[:, 0]).sum())
        if nc == 3:
            moment -= section.rhoI * float(dv @ b[:, 2])
        return np.array([*f.sum(axis=0), moment])

    def consistent(self) -> Array:
        """Return the generalised forces (n_dof,) of the loads on the element's own coordinates."""
        mesh, element = self.point.mesh, self.point.mesh.plan.element
        nc = element.components
        out = np.zeros(element.n_dof)
        for there, f in self._samples(1.0, _line_loads(self.model, mesh, self.e, self.d, self.t)):
            row = there.shape_row()
            out[0::nc] += row * f[0]
            out[1::nc] += row * f[1]
        dofs = mesh.dofs[self.point.ie]
        fields = [_coordinates_of(field, element, self.e[dofs]) for field in _accelerations(self.model, self.t)]
        if self.a is not None:
            fields.append(-self.a[dofs])
        if fields:
            out += mass_matrix(mesh.classes[mesh.cls[self.point.ie]].sampler) @ sum(fields)
        return out


def _coordinates_of(field: Density, element: ElementType, local: Array) -> Array:
    """Return the nodal coordinates of a field of acceleration that is linear in r."""
    nc, zero = element.components, np.zeros(2)
    out = np.zeros(element.n_dof)
    for k, (_, name) in enumerate(element.functionals):
        r = local[nc * k:nc * k + 2]
        out[nc * k:nc * k + 2] = field(r) if name == "r" else field(r) - field(zero)
    return out


def has_section_forces(point: PointRef) -> bool:
    """Whether the body has section forces: a rigid one has no law that would tell them."""
    return point.mesh.plan.element.name != "rigid"


def _nodal_forces(model: Model, state: State, point: PointRef, d: Array) -> Array:
    """Return the elastic and viscous forces (n_dof,) of the point's element at displacements d (n_q,)."""
    mesh = point.mesh
    flexible = [name for name, m in model.meshes.items() if m.plan.element.name != "rigid"]
    number = flexible.index(mesh.plan.name)
    group, dofs = model.groups[number], mesh.dofs[point.ie]
    Q, K = np.zeros((1, len(dofs))), np.zeros((1, len(dofs), len(dofs)))
    element_matrices(group, d, point.ie, Q, K)
    if state.linear:
        return K[0] @ state.d[dofs]
    tau = damping_times(model)[number]
    if state.v is None or tau == 0.0:
        return Q[0]
    turn = group.turn[point.ie:point.ie + 1] if len(group.turn) > 1 else group.turn
    alone = group._replace(cls=group.cls[point.ie:point.ie + 1], turn=turn, dofs=group.dofs[point.ie:point.ie + 1])
    viscous = np.zeros(model.n_q)
    viscous_force(alone, tau, d, state.v[:model.n_q], viscous)
    return Q[0] + viscous[dofs]


def section_forces(model: Model, state: State, point: PointRef) -> tuple[float, float, float]:
    """Return N, Q, M at a point.

    The element's nodal forces, less what loads and inertia on it contribute to them, are the forces at its ends: in
    balance with them whatever the formulation's stresses are worth. N along the section's x axis
    (tension), Q along its y axis, M counter-clockwise.
    """
    mesh, d = point.mesh, state.d[:model.n_q]
    e = model.e0 if state.linear else model.e0 + d
    at = np.zeros_like(d) if state.linear else d
    nodal = _nodal_forces(model, state, point, at)
    loads = _OnElement(model, point, e, at, state.t, inertia_rates(model, state))
    nodal = nodal - loads.consistent()
    last = point.xi == 1.0
    coords = mesh.node_dofs(point.ie, len(mesh.node_sizes) - 1 if last else 0)
    part = nodal[-len(coords):] if last else nodal[:len(coords)]
    P = _position(point, e)
    total = part @ rigid_motion(mesh, coords, e, P)
    if not last:
        total = -(total + loads.resultant())
    c, s = Rotation(point).axes(e, at)[:, 0]
    return float(c * total[0] + s * total[1]), float(-s * total[0] + c * total[1]), float(total[2])
