"""Springs between points: elastic patches with their analytic tangent."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..case import GroundPoint, RotationalSpring, TranslationalSpring
from ..elements.shape import Array
from .points import PointRef
from .rotation import Rotation


class TranslationalPatch:
    """A spring along the line between two points: U = k (L - L0)^2/2."""

    symmetric = True

    def __init__(self, ends: list[PointRef | GroundPoint], stiffness: float, length: float | None, e0: Array) -> None:
        self.k = stiffness
        dofs, rows, fixed = [], [], np.zeros(2)
        for sign, end in zip((-1.0, 1.0), ends, strict=True):
            if isinstance(end, GroundPoint):
                fixed += sign * np.array([end.x, end.y])
                continue
            for axis, (coords, weights) in enumerate(end.position()):
                dofs.append(coords)
                rows.append((axis, sign * weights))
        self.dofs = np.concatenate(dofs)[None, :]
        self.G = np.zeros((2, len(self.dofs[0])))
        at = 0
        for axis, weights in rows:
            self.G[axis, at:at + len(weights)] = weights
            at += len(weights)
        self.fixed = fixed
        self.p0 = self.G @ e0[self.dofs[0]] + fixed
        self.start = math.hypot(*self.p0)
        self.rest = self.start if length is None else length

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return energy, Q and K; the stretch is formed from displacements."""
        u = self.G @ d[self.dofs[0]]
        p = self.p0 + u
        L = math.hypot(*p)
        if L == 0.0:
            return 0.5 * self.k * self.rest**2, np.zeros(self.dofs.shape), (self.k * self.G.T @ self.G)[None]
        stretch = (2 * self.p0 @ u + u @ u) / (L + self.start) + (self.start - self.rest)
        n = p / L
        K = self.k * (np.outer(n, n) + stretch / L * (np.eye(2) - np.outer(n, n)))
        Q = self.G.T @ (self.k * stretch * n)
        return 0.5 * self.k * stretch**2, Q[None], (self.G.T @ K @ self.G)[None]


class RotationalPatch:
    """A torsion spring between sections (or to the ground): U = k (theta_b - theta_a - angle)^2/2."""

    symmetric = True

    def __init__(self, ends: list[PointRef | GroundPoint], stiffness: float, angle: float | None) -> None:
        self.k, self.rest = stiffness, angle or 0.0
        self.parts = [(s, Rotation(end)) for s, end in zip((-1.0, 1.0), ends, strict=True) if isinstance(end, PointRef)]
        self.dofs = np.concatenate([r.dofs for _, r in self.parts])[None, :]
        self.last = [0.0] * len(self.parts)

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return energy, Q and K; turns are counted from the last evaluation."""
        angles = [r.value(e, d, near) for (_, r), near in zip(self.parts, self.last, strict=True)]
        self.last = angles
        twist = sum(s * a for (s, _), a in zip(self.parts, angles, strict=True)) - self.rest
        g = np.concatenate([s * r.gradient(e) for s, r in self.parts])
        K = self.k * np.outer(g, g)
        at = 0
        for s, r in self.parts:
            n = len(r.dofs)
            K[at:at + n, at:at + n] += self.k * twist * s * r.hessian(e)
            at += n
        return 0.5 * self.k * twist**2, (self.k * twist * g)[None], K[None]


def _translational(spring: TranslationalSpring, ends: list[Any], e0: Array) -> TranslationalPatch:
    return TranslationalPatch(ends, spring.stiffness, spring.length, e0)


def _rotational(spring: RotationalSpring, ends: list[Any], e0: Array) -> RotationalPatch:
    return RotationalPatch(ends, spring.stiffness, spring.angle)


SPRINGS: dict[type, Callable[[Any, list[Any], Array], Any]] = {
    TranslationalSpring: _translational, RotationalSpring: _rotational,
}
