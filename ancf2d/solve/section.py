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
from ..model.mechanism import rigid_motion
from ..model.mesh import BodyMesh, mass_matrix
from ..model.model import Model
from ..model.points import PointRef, dot
from ..model.rotation import Rotation
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
    """The line and body loads on one element, sampled: what they sum to, up to a point or shape by shape."""

    model: Model
    point: PointRef
    e: Array
    d: Array
    t: float

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
        return total

    def consistent(self) -> Array:
        """Return the generalised forces (n_dof,) of the loads on the element's own coordinates."""
        mesh, element = self.point.mesh, self.point.mesh.plan.element
        nc = element.components
        out = np.zeros(element.n_dof)
        for there, f in self._samples(1.0, _line_loads(self.model, mesh, self.e, self.d, self.t)):
            row = there.shape_row()
            out[0::nc] += row * f[0]
            out[1::nc] += row * f[1]
        local = self.e[mesh.dofs[self.point.ie]]
        fields = list(_accelerations(self.model, self.t))
        if fields:
            M = mass_matrix(mesh.classes[mesh.cls[self.point.ie]].sampler)
            out += M @ sum(_coordinates_of(field, element, local) for field in fields)
        return out


def _coordinates_of(field: Density, element: ElementType, local: Array) -> Array:
    """Return the nodal coordinates of a field of acceleration that is linear in r."""
    nc, zero = element.components, np.zeros(2)
    out = np.zeros(element.n_dof)
    for k, (_, name) in enumerate(element.functionals):
        r = local[nc * k:nc * k + 2]
        out[nc * k:nc * k + 2] = field(r) if name == "r" else field(r) - field(zero)
    return out


def section_forces(model: Model, state: State, point: PointRef) -> tuple[float, float, float]:
    """Return N, Q, M at a point.

    The element's nodal forces, less what the loads on it contribute to them, are the forces at its ends: in
    balance with the loads whatever the formulation's stresses are worth. N along the section's x axis
    (tension), Q along its y axis, M counter-clockwise.
    """
    mesh, d = point.mesh, state.d[:model.n_q]
    e = model.e0 if state.linear else model.e0 + d
    at = np.zeros_like(d) if state.linear else d
    n = mesh.plan.element.n_dof
    Q, K = np.zeros((1, n)), np.zeros((1, n, n))
    element_matrices(model.groups[list(model.meshes).index(mesh.plan.name)], at, point.ie, Q, K)
    nodal = K[0] @ d[mesh.dofs[point.ie]] if state.linear else Q[0]
    loads = _OnElement(model, point, e, at, state.t)
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
