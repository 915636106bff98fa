"""Motions of flexible mechanisms by spectral elements of the geometrically exact beam, independent of ancf2d.

A bar has its axis r(s) and its section's angle theta(s) (Reissner 1972; Simo & Vu-Quoc 1986), interpolated by Lagrange
polynomials of a high degree through Gauss-Lobatto points; strains are integrated with one Gauss point less than
nodes. Joints are eliminated: bars share coordinates, a sliding end has none across, an end that a rigid crank leads
is a function of the crank's angle. With all coordinates x = X(q), x' = B q', x'' = B q'' + b:

    B^T M B q'' = B^T (F - Q(x) - M b),

integrated with fixed steps by Radau IIA of three stages (order 5; Hairer & Wanner, Solving ODEs II, IV.5).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import legendre

Array = np.ndarray
GRAVITY = 9.81
COORDINATES = ("x", "y", "theta")
ROOT = math.sqrt(6)
STAGES = np.array([(4 - ROOT) / 10, (4 + ROOT) / 10, 1])
RADAU = np.array([[(88 - 7 * ROOT) / 360, (296 - 169 * ROOT) / 1800, (-2 + 3 * ROOT) / 225],
                  [(296 + 169 * ROOT) / 1800, (88 + 7 * ROOT) / 360, (-2 - 3 * ROOT) / 225],
                  [(16 - ROOT) / 36, (16 + ROOT) / 36, 1 / 9]])


def lobatto(p: int) -> Array:
    """Return the p + 1 Gauss-Lobatto points in [-1, 1]."""
    inner = legendre.Legendre.basis(p).deriv().roots()
    return np.concatenate([[-1.0], np.sort(inner.real), [1.0]])


def lagrange(nodes: Array, x: Array) -> tuple[Array, Array]:
    """Return values and derivatives (len(x), len(nodes)) of the Lagrange polynomials through the nodes."""
    n = len(nodes) - 1
    inverse = np.linalg.inv(legendre.legvander(nodes, n))
    slopes = np.stack([legendre.legval(x, legendre.legder(row)) for row in np.eye(n + 1)], axis=1)
    return legendre.legvander(x, n) @ inverse, slopes @ inverse


@dataclass(frozen=True)
class Section:
    """Stiffnesses and masses per length."""

    EA: float
    kGA: float
    EI: float
    rhoA: float
    rhoI: float


def rectangle(E: float, nu: float, rho: float, height: float, width: float, k: float | None = None) -> Section:
    """Return the section of a rectangle; ``k`` is the shear factor, 10 (1 + nu)/(12 + 11 nu) unless given."""
    A, I = height * width, width * height**3 / 12
    k = 10 * (1 + nu) / (12 + 11 * nu) if k is None else k
    return Section(E * A, k * E / (2 * (1 + nu)) * A, E * I, rho * A, rho * I)


class Bar:
    """A bar from ``start`` to ``end``: ``count`` elements of degree ``p``; coordinates are all x, all y, all theta.

    Without stress it is straight, or an arc whose tangent turns by ``bend`` from start to end.
    """

    def __init__(self, section: Section, start: Sequence[float], end: Sequence[float], count: int, p: int,
                 bend: float = 0.0) -> None:
        a, b = np.array(start, float), np.array(end, float)
        self.section, self.n = section, count * p + 1
        self.length = math.dist(a, b) / float(np.sinc(bend / (2 * math.pi)))
        self.angle, self.curvature = math.atan2(b[1] - a[1], b[0] - a[0]) - bend / 2, bend / self.length
        nodes, h = lobatto(p), self.length / count
        self.P, self.D, self.w = self._rule(nodes, *legendre.leggauss(p), count, h)
        P, _, w = self._rule(nodes, *legendre.leggauss(p + 1), count, h)
        self.N = P.T @ (w[:, None] * P)
        at = np.unique(np.round(np.concatenate([(k + (nodes + 1) / 2) / count for k in range(count)]), 12))
        chord, along = self.length * at * np.sinc(bend * at / (2 * math.pi)), self.angle + bend * at / 2
        self.x0 = np.concatenate([a[0] + chord * np.cos(along), a[1] + chord * np.sin(along), self.angle + bend * at])
        self.at = at

    def _rule(self, nodes: Array, points: Array, weights: Array, count: int, h: float) -> tuple[Array, Array, Array]:
        value, slope = lagrange(nodes, points)
        P, D = np.zeros((2, count * len(points), self.n))
        for k in range(count):
            rows = slice(k * len(points), (k + 1) * len(points))
            columns = slice(k * (len(nodes) - 1), (k + 1) * (len(nodes) - 1) + 1)
            P[rows, columns], D[rows, columns] = value, slope * 2 / h
        return P, D, np.tile(weights * h / 2, count)

    def mass(self) -> Array:
        """Return the mass matrix."""
        M, n = np.zeros((3 * self.n, 3 * self.n)), self.n
        for k, rho in enumerate((self.section.rhoA, self.section.rhoA, self.section.rhoI)):
            M[k * n:(k + 1) * n, k * n:(k + 1) * n] = rho * self.N
        return M

    def weight(self, g: float) -> Array:
        """Return the forces of gravity -g in y."""
        n = self.n
        return np.concatenate([np.zeros(n), -g * self.section.rhoA * self.N @ np.ones(n), np.zeros(n)])

    def strains(self, x: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return cosine and sine of theta, strains along and across the section's normal, and curvature."""
        n, P, D = self.n, self.P, self.D
        rx, ry, theta, kappa = D @ x[:n], D @ x[n:2 * n], P @ x[2 * n:], D @ x[2 * n:] - self.curvature
        c, z = np.cos(theta), np.sin(theta)
        return c, z, rx * c + ry * z, ry * c - rx * z, kappa

    def forces(self, x: Array) -> Array:
        """Return the elastic forces."""
        P, D, w, s = self.P, self.D, self.w, self.section
        c, z, e, g, kappa = self.strains(x)
        N, Q = s.EA * (e - 1), s.kGA * g
        fx, fy, m = N * c - Q * z, N * z + Q * c, N * g - Q * e
        return np.concatenate([D.T @ (w * fx), D.T @ (w * fy), D.T @ (w * s.EI * kappa) + P.T @ (w * m)])

    def elastic(self, x: Array) -> tuple[Array, Array, float]:
        """Return elastic forces, their tangent and the strain energy."""
        n, P, D, w, s = self.n, self.P, self.D, self.w, self.section
        c, z, e, g, kappa = self.strains(x)
        N, Q = s.EA * (e - 1), s.kGA * g
        f = self.forces(x)
        # derivatives of (fx, fy, m) by (rx, ry, theta)
        A, G = s.EA, s.kGA
        xx, xy, yy = A * c * c + G * z * z, (A - G) * c * z, A * z * z + G * c * c
        xt, yt = A * g * c - N * z + G * e * z - Q * c, A * g * z + N * c - G * e * c - Q * z
        tt = A * g * g - N * e + G * e * e - Q * g
        K = np.zeros((3, n, 3, n))
        for i, j, left, value, right in ((0, 0, D, xx, D), (0, 1, D, xy, D), (1, 1, D, yy, D), (0, 2, D, xt, P),
                                         (1, 2, D, yt, P), (2, 2, P, tt, P)):
            block = left.T @ ((w * value)[:, None] * right)
            K[i, :, j, :] += block
            if i != j:
                K[j, :, i, :] += block.T
        K[2, :, 2, :] += D.T @ ((w * s.EI)[:, None] * D)
        energy = 0.5 * w @ (s.EA * (e - 1)**2 + s.kGA * g**2 + s.EI * kappa**2)
        return f, K.reshape(3 * n, 3 * n), float(energy)


@dataclass
class Crank:
    """A rigid bar about a fixed pivot whose tip drives a node: inertia about the pivot, static moment m c."""

    pivot: Sequence[float]
    length: float
    angle: float
    inertia: float
    moment: float = 0.0


@dataclass
class Mechanism:
    """Bars, cranks and the constraints between their coordinates.

    ``ties``: pairs of coordinates that are one; ``held``: coordinates that stay; ``led``: (coordinate of x, coordinate
    of y, crank); ``turned``: (coordinate theta, crank) that turn together. A coordinate is (bar, "x" | "y" | "theta",
    node) with node -1 the last. ``force(x, angles, t)`` returns generalized forces in all coordinates and on the
    cranks; ``drive``: t -> (angle, rate, acceleration) of the first crank, which is then no unknown.
    """

    bars: list[Bar]
    cranks: list[Crank] = field(default_factory=list)
    ties: list[tuple] = field(default_factory=list)
    held: list[tuple] = field(default_factory=list)
    led: list[tuple] = field(default_factory=list)
    turned: list[tuple] = field(default_factory=list)
    gravity: float = GRAVITY
    force: Callable[[Array, Array, float], tuple[Array, Array]] | None = None
    drive: Callable[[float], tuple[float, float, float]] | None = None

    def __post_init__(self) -> None:
        self.offset = np.concatenate([[0], np.cumsum([3 * b.n for b in self.bars])])
        n = self.offset[-1]
        self.x0 = np.concatenate([b.x0 for b in self.bars])
        self.M = np.zeros((n, n))
        for bar, a in zip(self.bars, self.offset, strict=False):
            self.M[a:a + 3 * bar.n, a:a + 3 * bar.n] = bar.mass()
        self.F = np.concatenate([b.weight(self.gravity) for b in self.bars])
        into = {self.index(b): self.index(a) for a, b in self.ties}
        gone = {self.index(c) for c in self.held} | {self.index(c) for row in self.led for c in row[:2]}
        gone |= {self.index(row[0]) for row in self.turned}
        free = [i for i in range(n) if i not in into and i not in gone]
        self.T = np.zeros((n, len(free)))
        for column, i in enumerate(free):
            self.T[i, column] = 1
        for i, j in into.items():
            self.T[i] = self.T[j]
        self.tips = [(self.index(a), self.index(b), k) for a, b, k in self.led]
        self.turns = [(self.index(a), k) for a, k in self.turned]
        self.moving = [k for k in range(len(self.cranks)) if self.drive is None or k > 0]

    def index(self, coordinate: tuple) -> int:
        """Return the number of a coordinate."""
        bar, what, node = coordinate
        n = self.bars[bar].n
        return int(self.offset[bar]) + COORDINATES.index(what) * n + node % n

    def place(self, q: Array, v: Array, t: float) -> tuple[Array, Array, Array, Array, Array]:
        """Return x, B, b, and angles and rates of all cranks; b is complete if the acceleration is prescribed."""
        k = len(self.moving)
        angle, rate, acceleration = np.array([[c.angle, 0.0, 0.0] for c in self.cranks]).reshape(-1, 3).T.copy()
        if self.drive is not None:
            angle[0], rate[0], acceleration[0] = self.drive(t)
        angle[self.moving], rate[self.moving] = q[:k], v[:k]
        x, b = self.x0 + self.T @ q[k:], np.zeros(len(self.x0))
        B = np.concatenate([np.zeros((len(x), k)), self.T], axis=1)
        for i, j, c in self.tips:
            crank, z, s = self.cranks[c], math.cos(angle[c]), math.sin(angle[c])
            L = crank.length
            x[i], x[j] = crank.pivot[0] + L * z, crank.pivot[1] + L * s
            b[i] = -L * z * rate[c]**2 - L * s * acceleration[c]
            b[j] = -L * s * rate[c]**2 + L * z * acceleration[c]
            if c in self.moving:
                B[i, self.moving.index(c)], B[j, self.moving.index(c)] = -L * s, L * z
        for i, c in self.turns:
            x[i], b[i] = self.x0[i] + angle[c] - self.cranks[c].angle, acceleration[c]
            if c in self.moving:
                B[i, self.moving.index(c)] = 1
        return x, B, b, angle, rate

    def balance(self, q: Array, v: Array, t: float) -> tuple[Array, Array, Array]:
        """Return forces f and mass H of H q'' = f, and the elastic tangent."""
        x, B, b, angle, _ = self.place(q, v, t)
        elastic, K = self.elastic(x)
        f, tip = self.F - elastic - self.M @ b, np.zeros(len(self.cranks))
        if self.force is not None:
            more, tip = self.force(x, angle, t)
            f = f + more
        right, H = B.T @ f, B.T @ self.M @ B
        for row, c in enumerate(self.moving):
            crank = self.cranks[c]
            H[row, row] += crank.inertia
            right[row] += tip[c] - crank.moment * self.gravity * math.cos(angle[c])
        return right, H, B.T @ K @ B

    def elastic(self, x: Array) -> tuple[Array, Array]:
        """Return elastic forces and tangent of all bars."""
        f, K = np.zeros(len(x)), np.zeros((len(x), len(x)))
        for bar, a in zip(self.bars, self.offset, strict=False):
            part = slice(a, a + 3 * bar.n)
            f[part], K[part, part], _ = bar.elastic(x[part])
        return f, K

    def step(self, q: Array, v: Array, a: Array, t: float, h: float) -> tuple[Array, Array, Array]:
        """Return (q, v, accelerations of the stages) after h; ``a`` (3, n) is the guess of them.

        Newton's matrix leaves out what turning cranks add, which costs iterations but no accuracy.
        """
        n, square = len(q), h * h * RADAU @ RADAU
        for _ in range(40):
            Q, V = q + h * STAGES[:, None] * v + square @ a, v + h * RADAU @ a
            r, J = np.zeros((3, n)), np.zeros((3, n, 3, n))
            for k in range(3):
                f, H, K = self.balance(Q[k], V[k], t + STAGES[k] * h)
                r[k] = f - H @ a[k]
                J[k] = square[k][None, :, None] * K[:, None, :]
                J[k, :, k] += H
            change = np.linalg.solve(J.reshape(3 * n, 3 * n), r.reshape(-1)).reshape(3, n)
            a = a + change
            if h * h * np.max(np.abs(change)) < 1e-11:
                return q + h * v + square[2] @ a, v + h * RADAU[2] @ a, a
        raise ValueError(f"Newton's method did not converge at t = {t:g}")

    def move(self, times: Sequence[float], h: float) -> Array:
        """Return all coordinates (times, coordinates) of the motion from rest; every time is a multiple of ``h``."""
        k = len(self.moving)
        q = np.zeros(k + self.T.shape[1])
        q[:k] = [self.cranks[c].angle for c in self.moving]
        v, a, found = np.zeros(len(q)), np.zeros((3, len(q))), []
        for i in range(1, round(times[-1] / h) + 1):
            q, v, a = self.step(q, v, a, (i - 1) * h, h)
            if np.min(np.abs(np.asarray(times) - i * h)) < 1e-6 * h:
                found.append(self.place(q, v, i * h)[0])
        return np.array(found)

    def point(self, x: Array, bar: int, at: float) -> Array:
        """Return (x, y) of a bar at ``at`` in [0, 1], which must be a node, over time."""
        node = int(np.argmin(np.abs(self.bars[bar].at - at)))
        if abs(self.bars[bar].at[node] - at) > 1e-9:
            raise ValueError(f"{at} is no node")
        return np.stack([x[:, self.index((bar, c, node))] for c in "xy"], axis=1)


def pin(a: tuple[int, int], b: tuple[int, int]) -> list[tuple]:
    """Return the ties of two nodes (bar, node) that stay together."""
    return [((a[0], c, a[1]), (b[0], c, b[1])) for c in "xy"]


def hold(bar: int, node: int, what: str = "xy") -> list[tuple]:
    """Return the fixed coordinates."""
    return [(bar, c, node) for c in what]
