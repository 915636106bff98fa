"""Points that move with a section, constraints between them, and forces between them.

A section has three coordinates: a place x, y and an angle theta (of a bar's node, or of a rigid body about its centre).
A point is carried at an arm from that place, r = (x, y) + R(theta - theta_0) arm. All functions are analytic in the
coordinates, so that derivatives are taken along the imaginary axis, exact to round-off (Squire & Trapp 1998).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .amplitudes import Course

Array = np.ndarray
TINY = 1e-40


@dataclass(frozen=True)
class Point:
    """A point: ``index`` of its section's coordinates (3,), the initial ``angle`` of the section, ``arm`` (2,)."""

    index: Array
    angle: float
    arm: Array = field(default_factory=lambda: np.zeros(2))

    def turn(self, x: Array) -> Any:
        """Return the rotation from the reference."""
        return x[self.index[2]] - self.angle

    def reach(self, x: Array) -> Array:
        """Return the rotated arm (2,)."""
        c, s, (a, b) = np.cos(self.turn(x)), np.sin(self.turn(x)), self.arm
        return np.array([c * a - s * b, s * a + c * b])

    def place(self, x: Array) -> Array:
        """Return the position (2,)."""
        return x[self.index[:2]] + self.reach(x)

    def pull(self, x: Array, f: Array) -> Array:
        """Return the generalised force (3,) of a force at the point: its power is f . dr/dt."""
        a, b = self.reach(x)
        return np.array([f[0], f[1], a * f[1] - b * f[0]])


@dataclass(frozen=True)
class Row:
    """A constraint g(x) = drive(t): its ``gradient`` (m,) by the coordinates ``index`` (m,)."""

    index: Array
    value: Callable[[Array], Any]
    gradient: Callable[[Array], Array]
    drive: Course


def still(t: float) -> tuple[float, float, float]:
    """Return the drive of a constraint without prescribed motion."""
    return 0.0, 0.0, 0.0


def held(k: int) -> Row:
    """Hold a coordinate at zero."""
    return Row(np.array([k]), lambda x: x[k], lambda x: np.ones(1), still)


def apart(a: Point, b: Point, n: Array, x0: Array, drive: Course = still) -> Row:
    """Keep n . (r_a - r_b) at its value at x0, or drive it from there; n is fixed in space."""
    first = n @ (a.place(x0) - b.place(x0))
    return Row(np.concatenate([a.index, b.index]), lambda x: n @ (a.place(x) - b.place(x)) - first,
               lambda x: np.concatenate([a.pull(x, n), b.pull(x, -n)]), drive)


def turned(a: Point, b: Point, drive: Course = still) -> Row:
    """Keep the difference of the rotations of a and b, or drive it."""
    return Row(np.concatenate([a.index[2:], b.index[2:]]), lambda x: a.turn(x) - b.turn(x),
               lambda x: np.array([1.0, -1.0]), drive)


def tied(a: Point, b: Point, x0: Array, weld: bool) -> list[Row]:
    """Keep two points together as at x0, and for a weld also the angle between their sections."""
    rows = [apart(a, b, n, x0) for n in np.eye(2)]
    return [*rows, turned(a, b)] if weld else rows


def sliding(p: Point, b: Point, n0: Array) -> Row:
    """Keep a point on the line through b with normal n0, which turns with b's section: n . (r_p - r_b) = 0."""
    normal = Point(b.index, b.angle, n0)

    def gradient(x: Array) -> Array:
        n, d = normal.reach(x), p.place(x) - b.place(x)
        on_b = b.pull(x, -n)
        on_b[2] += n[0] * d[1] - n[1] * d[0]
        return np.concatenate([p.pull(x, n), on_b])

    return Row(np.concatenate([p.index, b.index]), lambda x: normal.reach(x) @ (p.place(x) - b.place(x)), gradient,
               still)


@dataclass(frozen=True)
class Law:
    """A force (m,) on the coordinates ``index`` (m,), of all coordinates, rates and time."""

    index: Array
    force: Callable[[Array, Array, float], Array]
    energy: Callable[[Array], float] = lambda x: 0.0


def spring(a: Point, b: Point, k: float, c: float, length: float) -> Law:
    """Pull two points together with k (L - length) + c dL/dt."""

    def stretch(x: Array) -> tuple[Any, Array]:
        d = b.place(x) - a.place(x)
        L = np.sqrt(d @ d)
        return L, d / L

    def force(x: Array, v: Array, t: float) -> Array:
        L, n = stretch(x)
        along = np.concatenate([a.pull(x, n), b.pull(x, -n)])
        rate = -(along[:3] @ v[a.index] + along[3:] @ v[b.index])
        return (k * (L - length) + c * rate) * along

    return Law(np.concatenate([a.index, b.index]), force, lambda x: 0.5 * k * float(stretch(x)[0] - length)**2)


def torsion(a: Point, b: Point, k: float, c: float, angle: float) -> Law:
    """Turn two sections towards each other with k (theta_b - theta_a - angle) + c times its rate."""
    i, j = a.index[2], b.index[2]

    def force(x: Array, v: Array, t: float) -> Array:
        m = k * (b.turn(x) - a.turn(x) - angle) + c * (v[j] - v[i])
        return np.array([m, -m])

    return Law(np.array([i, j]), force, lambda x: 0.5 * k * float(b.turn(x) - a.turn(x) - angle)**2)


def dead(a: Point, f: Array, m: float, over: Course) -> Law:
    """A force of fixed direction, and a moment."""
    return Law(a.index, lambda x, v, t: over(t)[0] * (a.pull(x, f) + np.array([0.0, 0.0, m])))


def follower(a: Point, f: Array, over: Course) -> Law:
    """A force that turns with the section; f is its value in the reference."""
    turning = Point(a.index, a.angle, f)
    return Law(a.index, lambda x, v, t: over(t)[0] * a.pull(x, turning.reach(x)))


def slope(f: Callable[[Array], Array], x: Array, index: Array) -> Array:
    """Return the derivatives (m, len(index)) of f at x by the coordinates ``index``."""
    columns = []
    for i in index:
        z = x.astype(complex)
        z[i] += 1j * TINY
        columns.append(np.imag(f(z)) / TINY)
    return np.array(columns).T
