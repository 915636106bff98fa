"""The rotation of the section at a point and its derivatives by the coordinates."""

from __future__ import annotations

import math

import numpy as np

from ..elements.shape import Array
from .points import PointRef


class Rotation:
    """theta of a point: of r_y, of r_x for the cable, or the coordinate itself; 0 in the reference.

    ``dofs`` (n,) are the coordinates it depends on.
    """

    def __init__(self, point: PointRef) -> None:
        self.point = point
        if point.turns_by_theta:
            self.dofs, self.weights = point.theta()
            return
        (cx, wx), (cy, wy) = point.director()[0]
        self.dofs = np.concatenate([cx, cy])
        self.V = np.zeros((2, len(self.dofs)))
        self.V[0, :len(cx)], self.V[1, len(cx):] = wx, wy

    def value(self, e: Array, d: Array, near: float = 0.0) -> float:
        """Return theta on the turn nearest to ``near``, from displacements, so that small angles keep their digits."""
        if self.point.turns_by_theta:
            return float(self.weights @ d[self.dofs])
        v, dv = self.V @ e[self.dofs], self.V @ d[self.dofs]
        v0 = v - dv
        angle = math.atan2(v0[0] * dv[1] - v0[1] * dv[0], v0 @ v0 + v0 @ dv)
        return angle + 2 * math.pi * round((near - angle) / (2 * math.pi))

    def linear(self, e0: Array, d: Array) -> float:
        """Return theta of the linear theory: dtheta/de at the reference times d."""
        return float(self.gradient(e0) @ d[self.dofs])

    def gradient(self, e: Array) -> Array:
        """Return dtheta/de (n,)."""
        if self.point.turns_by_theta:
            return self.weights
        v = self.V @ e[self.dofs]
        return (v[0] * self.V[1] - v[1] * self.V[0]) / (v @ v)

    def hessian(self, e: Array) -> Array:
        """Return d2theta/de2 (n, n)."""
        if self.point.turns_by_theta:
            return np.zeros((len(self.dofs), len(self.dofs)))
        x, y = self.V @ e[self.dofs]
        A = np.array([[2 * x * y, y * y - x * x], [y * y - x * x, -2 * x * y]]) / (x * x + y * y) ** 2
        return self.V.T @ A @ self.V

    def axes(self, e: Array, d: Array) -> Array:
        """Return the section's axes as columns (2, 2): along the body and across it."""
        angle = self.point.angle + self.value(e, d)
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s], [s, c]])
