"""Axes of bodies as curves by arc length: arcs and lines, splines through points, and curves given by expressions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..case import CurveGeometry, Spline
from ..case.series import Series, derivative, power, product, series
from ..case.syntax import Tree, syntax
from ..elements.shape import Array, gauss
from ..errors import PartError
from .breakpoints import Break, switches

# Gauss points of a panel; accuracy of its length relative to the whole curve
POINTS, EXACT = 16, 2e-15
# largest turn of a panel [rad], and largest ratio of the speeds on it
TURN, SPEED = 1.0, 2.0
PANELS, HALVINGS = 20_000, 36
# where panels are divided, and first edges for expressions: places where a case is unlikely to have a corner
DIVIDED, FIRST = 0.5278640450004206, (0.0, 0.2763932022500211, 0.4836, 0.7639320225002102, 1.0)
# number of derivatives compared where a condition switches, and their tolerance; smallest distance of switches
JUMPS, SAME, TOUCH = 4, 1e-9, 1e-9
# tolerance of ends [relative to the length] and directions [rad] that must coincide
CLOSED = 1e-6


class AxisError(PartError):
    """A geometry that is not a smooth curve."""


class Axis(Protocol):
    """A smooth curve by arc length s [m] from its start."""

    def position(self, s: Array) -> tuple[Array, Array]:
        """Return points (...) as complex numbers x + iy, and tangent angles (...) counted through full turns."""
        ...

    def derivatives(self, s: Array, n: int) -> NDArray[np.complex128]:
        """Return d^k r/ds^k for k = 1 ... n as complex numbers (n, ...)."""
        ...

    def nearest(self, r: complex, a: float, b: float) -> float:
        """Return the s in [a, b] of the point nearest to r."""
        ...


@dataclass(frozen=True)
class ArcAxis:
    """A curve of constant curvature ``kappa`` = dtheta/ds [1/m], 0 for a line, from a point in a direction."""

    start: tuple[float, float]
    angle: float
    kappa: float

    def position(self, s: Array) -> tuple[Array, Array]:
        """Return points as complex numbers, and tangent angles."""
        chord = s * np.sinc(0.5 * self.kappa * s / np.pi) if self.kappa else s
        middle = self.angle + 0.5 * self.kappa * s
        return (self.start[0] + chord * np.cos(middle)) + 1j * (self.start[1] + chord * np.sin(middle)), (
            self.angle + self.kappa * s)

    def derivatives(self, s: Array, n: int) -> NDArray[np.complex128]:
        """Return d^k r/ds^k for k = 1 ... n."""
        tangent = np.exp(1j * (self.angle + self.kappa * np.asarray(s, dtype=float)))
        return np.stack([(1j * self.kappa) ** (k - 1) * tangent for k in range(1, n + 1)])

    def nearest(self, r: complex, a: float, b: float) -> float:
        """Return the s in [a, b] of the point nearest to r."""
        z, angle = self.position(np.asarray(a))
        local = (r - complex(z)) * complex(np.exp(-1j * angle))
        if self.kappa == 0.0:
            return min(max(a + local.real, a), b)
        turned = math.atan2(self.kappa * local.real, 1.0 - self.kappa * local.imag)
        s = a + abs((turned % (2 * math.pi) if self.kappa > 0 else -turned % (2 * math.pi)) / self.kappa)
        if s <= b:
            return s
        return min((a, b), key=lambda end: abs(complex(self.position(np.asarray(end))[0]) - r))


class ParametricAxis:
    """A curve z(u) = x + iy of a parameter u, by arc length accurate to round-off.

    ``taylor(u, n)`` returns its Taylor coefficients (n + 1, places); ``edges`` are increasing values of u, from one end
    to the other, between which z is smooth. The curve is divided into panels until Gauss points give the length of each
    exactly; places are then found by Newton's method. The tangent angle at the start is counted to be nearest to
    ``angle``. Raises AxisError where the curve jumps, has a corner or zero velocity.
    """

    def __init__(self, taylor: Callable[[Array, int], Series], edges: Array, variable: str = "s",
                 angle: float | None = None) -> None:
        self._taylor, self._variable = taylor, variable
        self._x, self._w = gauss(POINTS)
        self._u = self._panels(np.asarray(edges, dtype=float))
        lengths = self._length(self._u[:-1], self._u[1:])
        self._s = np.concatenate([[0.0], np.cumsum(lengths)])
        self.length = float(self._s[-1])
        rates = self._rate(self._u)
        turns = np.angle(rates[1:] / rates[:-1])
        self._direction = rates
        start = float(np.angle(rates[0]))
        start += 0.0 if angle is None else 2 * math.pi * round((angle - start) / (2 * math.pi))
        self._angle = start + np.concatenate([[0.0], np.cumsum(turns)])
        self.turning = float(np.abs(turns).sum())

    def _rate(self, u: Array) -> NDArray[np.complex128]:
        """Return dz/du."""
        rate: NDArray[np.complex128] = self._taylor(u.ravel(), 1)[1].reshape(u.shape)
        return rate

    def _length(self, a: Array, b: Array) -> Array:
        """Return the lengths from a (...) to b (...), each by one set of Gauss points."""
        u = a[..., None] + (b - a)[..., None] * self._x
        length: Array = (b - a) * (np.abs(self._rate(u)) @ self._w)
        return length

    def _panels(self, edges: Array) -> Array:
        """Return panel edges: each panel has an exact length, a small turn and little change of speed."""
        a, b, done = edges[:-1], edges[1:], [edges]
        whole = size = 0.0
        for _ in range(HALVINGS):
            m = a + DIVIDED * (b - a)
            z = [self._taylor(u, 1) for u in (a, m, b)]
            if not all(np.isfinite(part).all() for part in z):
                bad = next(u[~np.isfinite(part).all(axis=0)][0] for u, part in zip((a, m, b), z, strict=True)
                           if not np.isfinite(part).all())
                raise AxisError((), f"the curve has no position or no direction at {self._variable} = {bad:.6g}")
            rate = self._rate(a[:, None] + (b - a)[:, None] * self._x)
            coarse, fine = (b - a) * (np.abs(rate) @ self._w), self._length(a, m) + self._length(m, b)
            whole, size = max(whole, float(fine.sum())), max(size, float(np.abs(z[0][0]).max()))
            if whole == 0.0:
                raise AxisError((), "the curve has no length: all its points coincide")
            tolerance = EXACT * whole
            speed = np.abs(np.concatenate([z[0][1:], z[1][1:], z[2][1:], rate.T]))
            along = np.concatenate([z[0][1:], rate.T, z[2][1:]])
            with np.errstate(all="ignore"):
                turned = np.abs(np.angle(along[1:] / along[:-1])).sum(axis=0)
                good = ((np.abs(coarse - fine) <= tolerance) & (turned <= TURN)
                        & (speed.max(axis=0) <= SPEED * speed.min(axis=0))
                        & (np.abs((b - a) * (rate @ self._w) - (z[2][0] - z[0][0])) <= tolerance + 4e-15 * size))
            if good.all():
                return np.unique(np.concatenate(done))
            a, b, m = a[~good], b[~good], m[~good]
            done.append(m)
            a, b = np.concatenate([a, m]), np.concatenate([m, b])
            if len(a) > PANELS:
                break
        raise AxisError((), f"the curve jumps, has a corner or has zero velocity near {self._variable} = "
                        f"{float(np.median(a)):.6g}", "a smooth curve; use a polyline for corners")

    def _at(self, s: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return the parameters u (n,) at s (n,), and their panels."""
        k = np.clip(np.searchsorted(self._s, s, side="right") - 1, 0, len(self._s) - 2)
        a, b, rest = self._u[k], self._u[k + 1], s - self._s[k]
        u = a + (b - a) * rest / (self._s[k + 1] - self._s[k])
        for _ in range(8):
            step = (self._length(a, u) - rest) / np.abs(self._rate(u))
            u = u - step
            if np.all(np.abs(step) <= 2e-16 * np.abs(self._u).max()):
                break
        u = np.clip(u, a, b)
        u[s >= self.length] = self._u[-1]
        return u, k

    def position(self, s: Array) -> tuple[Array, Array]:
        """Return points as complex numbers, and tangent angles."""
        way = np.asarray(s, dtype=float)
        u, k = self._at(way.ravel())
        z = self._taylor(u, 1)
        theta = self._angle[k] + np.angle(z[1] / self._direction[k])
        return z[0].reshape(way.shape), theta.reshape(way.shape)

    def derivatives(self, s: Array, n: int) -> NDArray[np.complex128]:
        """Return d^k r/ds^k for k = 1 ... n, with d/ds = 1/|dz/du| d/du."""
        way = np.asarray(s, dtype=float)
        z = self._taylor(self._at(way.ravel())[0], n)
        rate = derivative(z)
        slowness = power(product(rate, rate.conj()), -0.5)
        found, part = [], z
        for _ in range(n):
            part = derivative(part)
            part = product(part, slowness[:len(part)])
            found.append(part[0].reshape(way.shape))
        return np.stack(found)

    def nearest(self, r: complex, a: float, b: float) -> float:
        """Return the s in [a, b] of the point nearest to r."""
        inside = self._s[(self._s > a) & (self._s < b)]
        edges = np.concatenate([[a], inside, [b]])
        s = np.unique(np.concatenate([edges[:-1] + f * np.diff(edges) for f in (0.0, 0.25, 0.5, 0.75)] + [[b]]))
        distance = np.abs(self.position(s)[0] - r)
        best = float(s[np.argmin(distance)])
        for _ in range(30):
            at = np.array([best])
            gap = complex(self.position(at)[0][0]) - r
            t, bend = (complex(x[0]) for x in self.derivatives(at, 2))
            slope = 1.0 + (gap.conjugate() * bend).real
            step = (gap.conjugate() * t).real / (slope if slope > 0.1 else 1.0)
            best, before = min(max(best - step, a), b), best
            if abs(best - before) <= 1e-15 * self.length:
                break
        return best

    @cached_property
    def ends(self) -> tuple[complex, complex, float]:
        """The first and the last point, and the direction at the first point."""
        z, theta = self.position(np.array([0.0, self.length]))
        return complex(z[0]), complex(z[1]), float(theta[0])

    @cached_property
    def last_angle(self) -> float:
        """The direction at the end."""
        return float(self.position(np.array([self.length]))[1][0])


def check_closed(start: complex, end: complex, turned: float, length: float) -> None:
    """Raise AxisError unless a closed curve ends where it starts and in the direction in which it starts."""
    if abs(end - start) > CLOSED * length:
        raise AxisError(("closed",), f"the curve is closed, but it ends at ({end.real:.6g}, {end.imag:.6g}), "
                        f"{abs(end - start):.3g} away from its start ({start.real:.6g}, {start.imag:.6g})",
                        "a curve that ends where it starts")
    if abs(turned) > CLOSED:
        raise AxisError(("closed",), f"the curve is closed, but at its end it points {turned:.3g} rad away from the "
                        "direction in which it starts", "a curve that ends in the direction in which it starts")


def spline(geometry: Spline) -> tuple[list[ParametricAxis], list[float]]:
    """Return the curve through the points of a spline, and the arc lengths of its inner points."""
    # imported only for splines
    from scipy.interpolate import CubicSpline

    points = [complex(*p) for p in geometry.points]
    if geometry.closed:
        points.append(points[0])
    z = np.array(points)
    with np.errstate(over="ignore"):
        u = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(z)))])
    if not np.isfinite(u[-1]):
        raise AxisError(("points",), "the curve is longer than floating-point numbers can tell",
                        "points closer together")
    for k in np.flatnonzero(np.diff(u) <= 0.0).tolist():
        other = (k + 1) % len(geometry.points)
        raise AxisError(("points", other), f"points {k} and {other} are as good as one, beside a curve of length "
                        f"{u[-1]:.3g}", "points farther apart")
    coefficients: Any = CubicSpline(u, z, bc_type="periodic" if geometry.closed else "not-a-knot").c[::-1]

    def taylor(at: Array, n: int) -> Series:
        k = np.clip(np.searchsorted(u, at, side="right") - 1, 0, len(u) - 2)
        t, c = at - u[k], coefficients[:, k]
        out = np.zeros((n + 1, len(at)), dtype=complex)
        for i in range(min(n, 3) + 1):
            out[i] = sum(math.comb(j, i) * c[j] * t ** (j - i) for j in range(i, len(c)))
        return out

    curve = ParametricAxis(taylor, u, "the length of its chords")
    return [curve], [float(curve._s[np.searchsorted(curve._u, knot)]) for knot in u[1:-1]]


def curve(geometry: CurveGeometry) -> list[ParametricAxis]:
    """Return the curve given by a body's expressions in s, divided where its derivatives jump.

    Raises AxisError where the curve itself jumps or has a corner.
    """
    x, y = syntax(geometry.x, "s"), syntax(geometry.y, "s")

    def taylor(s: Array, n: int) -> Series:
        return series(x, s, n) + 1j * series(y, s, n)

    found: list[ParametricAxis] = []
    for first, last in pairwise(_smooth_stretches([x, y], taylor)):
        # on a stretch, conditions keep their values up to its end
        edges = first.t + np.array(FIRST) * (last.before - first.t)
        part = ParametricAxis(lambda s, n, a=first.t, b=last.before: taylor(np.clip(s, a, b), n),  # type: ignore[misc]
                      edges, angle=found[-1].last_angle if found else None)
        if found:
            _check_continuous(found[-1], part, first.t)
        found.append(part)
    if geometry.closed:
        length = sum(part.length for part in found)
        turned = math.remainder(found[-1].last_angle - found[0].ends[2], 2 * math.pi)
        check_closed(found[0].ends[0], found[-1].ends[1], turned, length)
    return found


def _smooth_stretches(trees: list[Tree], taylor: Callable[[Array, int], Series]) -> list[Break]:
    """Return the starts of the smooth stretches of a curve, and its end; a condition switches at each of them."""
    places = [b for tree in trees for b in switches(tree, 0.0, 1.0) if b.t < 1.0]
    out = [Break(0.0, 0, 0.0)]
    for b in sorted(places, key=lambda b: b.t):
        before, after = taylor(np.array([b.before, b.t]), JUMPS).T
        size = np.maximum(np.abs(before), np.abs(after)) + np.abs(after[1])
        if b.t > out[-1].t + TOUCH and not np.all(np.abs(after - before) <= SAME * size):
            out.append(b)
    return [*out, Break(1.0, 0, 1.0)]


def _check_continuous(before: ParametricAxis, after: ParametricAxis, s: float) -> None:
    """Raise AxisError unless a stretch of a curve starts at the end of the one before, in the same direction."""
    gap, corner = abs(after.ends[0] - before.ends[1]), abs(after.ends[2] - before.last_angle)
    if gap > CLOSED * (before.length + after.length) or corner > CLOSED:
        raise AxisError((), f"the curve jumps, has a corner or has zero velocity near s = {s:.6g}",
                        "a smooth curve; use a polyline for corners")
