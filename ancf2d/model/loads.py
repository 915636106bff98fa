"""Each kind of load as generalised forces. A further kind is one function and one entry in ``LOADS``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ..case import Distributed, FollowerForce, Force, Gravity, Moment
from ..elements.point_laws import DIRECTION, LAWS, MAX_MEM, THETA
from ..elements.shape import Array, gauss
from .mesh import BodyMesh, Index, volume_weights
from .point_patch import Items, PointPatch, position_fields, turn_fields
from .points import PointRef

Amplitude = Callable[[float], float]
# the derivative of r (or theta itself) that a section turns with
_TURNS_WITH = {"interpolated": (0, 1), "tangent": (1, 0), "theta": (0, 0)}


@dataclass
class DeadLoad:
    """A generalised force that depends on load factor or time alone: Q_k = amplitude(t) * values at dofs."""

    dofs: Index
    values: Array
    amplitude: Amplitude
    scaled: bool
    gravity: bool = False


class Patch(Protocol):
    """Forces that depend on the configuration, along coordinates ``dofs`` (m, n): point laws, centrifugal forces.

    ``symmetric`` tells whether their stiffness is.
    """

    dofs: Index
    symmetric: bool


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
    """A line load (tangential, normal) per reference length: a force that turns at each of its quadrature points.

    ``dofs`` (elements, n) are its coordinates.
    """

    symmetric = False

    def __init__(self, mesh: BodyMesh, cover: list[tuple[Index, Array, Array]], value: Array,
                 amplitude: Amplitude) -> None:
        self.mesh, self.cover, self.value, self.amplitude = mesh, cover, value, amplitude
        self.dofs = np.concatenate([mesh.dofs[elements] for elements, _, _ in cover])

    def items(self) -> Items:
        """Return the forces at the quadrature points, element by element, as tables have them."""
        return self._items

    @cached_property
    def _items(self) -> Items:
        parts = [self._of(*part) for part in self.cover]
        dofs, G, p0, par = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Items(LAWS["follower"], dofs, G, p0, par, np.zeros((len(p0), MAX_MEM)), self.amplitude)

    def _of(self, elements: Index, xi: Array, w: Array) -> tuple[Index, Array, Array, Array]:
        """Return dofs, G, p0 and par of the points xi of some elements of one class."""
        mesh, element = self.mesh, self.mesh.plan.element
        nc, dofs = element.components, mesh.dofs[elements]
        shape, zero = mesh.classes[mesh.cls[elements[0]]].shape, np.zeros_like(xi)
        S, D = shape(xi, zero), shape(xi, zero, *_TURNS_WITH[element.section_kind])
        local, theta = mesh.e0[dofs - mesh.first_dof], nc == 3
        m, p, n = len(elements), len(xi), dofs.shape[1]
        G, p0 = np.zeros((m, p, 3 if theta else 4, n)), np.zeros((m, p, 3 if theta else 4))
        G[:, :, 0, 0::nc], G[:, :, 1, 1::nc] = S, S
        if theta:
            angle = local[:, 2::3] @ D.T
            G[:, :, 2, 2::3] = D
        else:
            x, y = local[:, 0::2] @ D.T, local[:, 1::2] @ D.T
            p0[:, :, 2] = length = np.hypot(x, y)
            c, s = x / length, y / length
            G[:, :, 2, 0::2], G[:, :, 2, 1::2] = c[..., None] * D, s[..., None] * D
            G[:, :, 3, 0::2], G[:, :, 3, 1::2] = -s[..., None] * D, c[..., None] * D
            angle = np.arctan2(y, x) - (0.5 * math.pi if element.section_kind == "interpolated" else 0.0)
        (ft, fn), c, s = self.value, np.cos(angle), np.sin(angle)
        kind = np.full((m, p), THETA if theta else DIRECTION)
        par = np.stack([w * (c * ft - s * fn), w * (s * ft + c * fn), kind], axis=-1)
        return np.repeat(dofs, p, axis=0), G.reshape(m * p, -1, n), p0.reshape(m * p, -1), par.reshape(m * p, 3)


def _force(load: Force, context: LoadContext, out: LoadSet) -> None:
    columns = context.point(load.at).position(load.spread)
    for (coords, weights), f in zip(columns, load.value, strict=True):
        out.dead.append(DeadLoad(coords, weights * f, context.amplitude, context.scaled))


def follower_force(point: PointRef, value: tuple[float, float], amplitude: Amplitude,
                   spread: str | None = None) -> PointPatch:
    """Return a force (tangential, normal) along the axes of its section as it turns."""
    kind, fields = turn_fields(point)
    c, s = math.cos(point.angle), math.sin(point.angle)
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
