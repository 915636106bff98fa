"""Each kind of load as generalised forces. A further kind is one function and one entry in ``LOADS``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..case import Distributed, FollowerForce, Force, Gravity, Moment
from ..elements.shape import Array, gauss
from .mesh import BodyMesh, Index, volume_weights
from .point_patch import PointPatch, position_fields, turn_fields
from .points import PointRef

Amplitude = Callable[[float], float]


@dataclass
class DeadLoad:
    """A generalised force that depends on load factor or time alone: Q_k = amplitude(t) * values at dofs."""

    dofs: Index
    values: Array
    amplitude: Amplitude
    scaled: bool
    gravity: bool = False


class Patch(Protocol):
    """Forces that depend on the configuration: (m, n) coordinates with (m, n) forces and (m, n, n) stiffness.

    The elastic sign: ``evaluate`` returns (energy, Q, K) as if the patch were an element, so a load returns
    -Q_k. ``symmetric`` tells whether K is.
    """

    dofs: Index
    symmetric: bool

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return energy, Q and K."""
        ...


@dataclass
class LoadSet:
    """Everything that acts on the model."""

    dead: list[DeadLoad] = field(default_factory=list)
    patches: list[Patch] = field(default_factory=list)


@dataclass(frozen=True)
class LoadContext:
    """What a load needs to find its place: meshes, points, and its amplitude."""

    meshes: dict[str, BodyMesh]
    point: Callable[[Any], PointRef]
    amplitude: Amplitude
    scaled: bool


class FollowerLine:
    """A line load (tangential, normal) per reference length along the turning sections of many elements."""

    symmetric = False

    def __init__(self, mesh: BodyMesh, cover: list[tuple[Index, Array, Array]], value: Array,
                 amplitude: Amplitude) -> None:
        self.mesh, self.cover, self.value, self.amplitude = mesh, cover, value, amplitude
        self.dofs = np.concatenate([mesh.dofs[elements] for elements, _, _ in cover])
        element = mesh.plan.element
        self.nc = element.components
        self.tables = []
        for elements, xi, w in cover:
            shape = mesh.classes[mesh.cls[elements[0]]].shape
            zero = np.zeros_like(xi)
            order = {"interpolated": (0, 1), "tangent": (1, 0), "theta": (0, 0)}[element.section_kind]
            self.tables.append((elements, shape(xi, zero), shape(xi, zero, *order), w))

    def points(self) -> list[PointPatch]:
        """Return the load as forces at its quadrature points, which moving models take."""
        mesh, out = self.mesh, []
        for elements, xi, w in self.cover:
            for ie in elements.tolist():
                start, l, angle, kappa = (float(a[ie]) for a in
                                          (mesh.starts, mesh.lengths, mesh.angles, mesh.curvatures))
                for x, weight in zip(xi.tolist(), w.tolist(), strict=True):
                    point = PointRef(mesh, (start + l * x) / mesh.plan.length, ie, x, angle + kappa * l * x, None)
                    ft, fn = weight * self.value
                    out.append(follower_force(point, (ft, fn), self.amplitude, angle=self._angle(point)))
        return out

    def _angle(self, point: PointRef) -> float:
        """Return the angle of the interpolated section's tangent in the reference."""
        if self.nc == 3:
            coords, weights = point.theta()
            return float(weights @ self.mesh.e0[coords - self.mesh.first_dof])
        across = self.mesh.plan.element.section_kind == "interpolated"
        return point.director()[1] - (0.5 * math.pi if across else 0.0)

    def _axes(self, D: Array, local: Array) -> tuple[Array, Array]:
        """Return the unit tangents (m, p, 2) of the sections and dtheta/de (m, p, n)."""
        nc, (m, n) = self.nc, local.shape
        g = np.zeros((m, len(D), n))
        if nc == 3:
            angle = local[:, 2::3] @ D.T
            g[:, :, 2::3] = D
            return np.stack([np.cos(angle), np.sin(angle)], axis=-1), g
        vx, vy = local[:, 0::2] @ D.T, local[:, 1::2] @ D.T
        LL = vx**2 + vy**2
        g[:, :, 0::2] = -(vy / LL)[:, :, None] * D
        g[:, :, 1::2] = (vx / LL)[:, :, None] * D
        L = np.sqrt(LL)
        across = self.mesh.plan.element.section_kind == "interpolated"
        t = (vy / L, -vx / L) if across else (vx / L, vy / L)
        return np.stack(t, axis=-1), g

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return -Q_k and its derivative, element by element."""
        ft, fn = self.value * self.amplitude(t)
        Qs, Ks = [], []
        for elements, S, D, w in self.tables:
            dofs = self.mesh.dofs[elements]
            tangent, g = self._axes(D, e[dofs])
            fx = ft * tangent[..., 0] - fn * tangent[..., 1]
            fy = ft * tangent[..., 1] + fn * tangent[..., 0]
            Q, K = np.zeros(dofs.shape), np.zeros((*dofs.shape, dofs.shape[1]))
            for c, (f, slope) in enumerate(((fx, -fy), (fy, fx))):
                Q[:, c::self.nc] = -(f * w) @ S
                K[:, c::self.nc, :] = -np.einsum("mp,pk,mpn->mkn", slope * w, S, g)
            Qs.append(Q)
            Ks.append(K)
        return 0.0, np.concatenate(Qs), np.concatenate(Ks)


def _force(load: Force, context: LoadContext, out: LoadSet) -> None:
    columns = context.point(load.at).position(load.spread)
    for (coords, weights), f in zip(columns, load.value, strict=True):
        out.dead.append(DeadLoad(coords, weights * f, context.amplitude, context.scaled))


def follower_force(point: PointRef, value: tuple[float, float], amplitude: Amplitude,
                   spread: str | None = None, angle: float | None = None) -> PointPatch:
    """Return a force (tangential, normal) along the axes of its section as it turns.

    ``angle`` is that of the section's tangent in the reference: the body's own unless given.
    """
    kind, fields = turn_fields(point)
    angle = point.angle if angle is None else angle
    c, s = math.cos(angle), math.sin(angle)
    reference = (c * value[0] - s * value[1], s * value[0] + c * value[1])
    return PointPatch("follower", [*position_fields(point, spread), *fields], [*reference, kind], amplitude)


def _follower(load: FollowerForce, context: LoadContext, out: LoadSet) -> None:
    out.patches.append(follower_force(context.point(load.at), load.value, context.amplitude, load.spread))


def _moment(load: Moment, context: LoadContext, out: LoadSet) -> None:
    """Conjugate to theta: Q_k = M dtheta/de."""
    kind, fields = turn_fields(context.point(load.at))
    out.patches.append(PointPatch("moment", fields, [float(load.value), kind], context.amplitude))


def _element_loads(mesh: BodyMesh, elements: Index, weights: Array, value: Any) -> tuple[Index, Array]:
    nc = mesh.plan.element.components
    dofs = np.concatenate([mesh.dofs[elements, c::nc].ravel() for c in (0, 1)])
    values = np.concatenate([np.tile(weights * f, len(elements)) for f in value])
    return dofs, values


def _gravity(load: Gravity, context: LoadContext, out: LoadSet) -> None:
    for mesh in context.meshes.values():
        for k, cls in enumerate(mesh.classes):
            weights = mesh.plan.section.rhoA * volume_weights(cls.sampler)
            dofs, values = _element_loads(mesh, np.flatnonzero(mesh.cls == k), weights, load.value)
            out.dead.append(DeadLoad(dofs, values, context.amplitude, context.scaled, gravity=True))


def covered(mesh: BodyMesh, s0: float, s1: float) -> list[tuple[Index, Array, Array]]:
    """Return (elements, points xi, weights in m) that integrate over [s0, s1] of a body's arclength."""
    x, w = gauss(mesh.plan.element.degree_x + 3)
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


def _distributed(load: Distributed, context: LoadContext, out: LoadSet) -> None:
    mesh = context.meshes[load.on]
    s0 = 0.0 if load.from_ is None else load.from_
    s1 = 1.0 if load.to is None else load.to
    cover = covered(mesh, s0, s1)
    if load.follower:
        out.patches.append(FollowerLine(mesh, cover, np.array(load.value, dtype=float), context.amplitude))
        return
    for elements, xi, w in cover:
        S = mesh.classes[mesh.cls[elements[0]]].shape(xi, np.zeros_like(xi))
        dofs, values = _element_loads(mesh, elements, w @ S, load.value)
        out.dead.append(DeadLoad(dofs, values, context.amplitude, context.scaled))


LOADS: dict[type, Callable[[Any, LoadContext, LoadSet], None]] = {
    Force: _force, FollowerForce: _follower, Moment: _moment, Gravity: _gravity, Distributed: _distributed,
}
