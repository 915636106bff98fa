"""Supports and joints as equations between coordinates: linear rows, and the few that are not linear."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ..elements.shape import Array
from .mesh import Index
from .points import PointRef
from .timing import Course


@dataclass(frozen=True)
class Row:
    """A linear equation: sum of coefs * d[coords] = signal(t), or 0 without a signal.

    ``owner`` is the support or joint it belongs to, ``holds`` what it holds, in words.
    """

    coords: Index
    coefs: Array
    owner: str
    holds: str
    signal: Course | None = None

    def value(self, t: float) -> float:
        """Return the right-hand side at load factor or time t."""
        return 0.0 if self.signal is None else self.signal(t)


class Constraint(Protocol):
    """A nonlinear scalar equation g(d, t) = 0, enforced by a multiplier."""

    owner: str
    holds: str
    dofs: Index

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return g, its gradient (n,) and Hessian (n, n) along ``dofs``."""
        ...


@dataclass
class Equations:
    """What supports and joints ask for, and what their user should know."""

    rows: list[Row] = field(default_factory=list)
    constraints: list[Constraint] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def combine(*parts: tuple[float, tuple[Index, Array]]) -> tuple[Index, Array]:
    """Return the sum of factor * columns as one set of (coordinates, weights), without repeats or zeros."""
    total: dict[int, float] = {}
    for factor, (coords, weights) in parts:
        for i, w in zip(coords.tolist(), (factor * weights).tolist(), strict=True):
            total[i] = total.get(i, 0.0) + w
    kept = {i: w for i, w in total.items() if w != 0.0}
    return np.array(list(kept), dtype=np.int64), np.array(list(kept.values()))


def along(columns: list[tuple[Index, Array]], x: float, y: float) -> tuple[Index, Array]:
    """Return the component of a planar vector along (x, y); exact zeros of a direction leave no column."""
    x, y = (0.0 if abs(v) < 1e-15 else v for v in (x, y))
    return combine((x, columns[0]), (y, columns[1]))


@dataclass
class DirectionPrescribed:
    """The section direction v of a point stands at a prescribed angle: v x (cos a, sin a) = 0."""

    point: PointRef
    signal: Course
    owner: str
    holds: str = "rotation"

    def __post_init__(self) -> None:
        columns, self.reference = self.point.director()
        self.dofs = np.concatenate([c for c, _ in columns])
        self.weights = [w for _, w in columns]

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return g, gradient, Hessian."""
        a = self.reference + self.signal(t)
        G = np.concatenate([self.weights[0] * math.sin(a), -self.weights[1] * math.cos(a)])
        return float(G @ e[self.dofs]), G, np.zeros((len(G), len(G)))


@dataclass
class DirectionsAligned:
    """Two section directions keep their angle: v_a x R(beta) v_b = 0, beta the reference angle from b to a."""

    a: PointRef
    b: PointRef
    owner: str
    holds: str = "relative rotation"

    def __post_init__(self) -> None:
        (ax, ay), angle_a = self.a.director()
        (bx, by), angle_b = self.b.director()
        beta = angle_a - angle_b
        c, s = math.cos(beta), math.sin(beta)
        coords = [ax[0], ay[0], bx[0], by[0]]
        self.dofs = np.concatenate(coords)
        # rows that give v_a and R v_b from the coordinates
        P, Q = np.zeros((2, len(self.dofs))), np.zeros((2, len(self.dofs)))
        ends = np.cumsum([len(k) for k in coords])
        P[0, :ends[0]], P[1, ends[0]:ends[1]] = ax[1], ay[1]
        Q[0, ends[1]:ends[2]], Q[1, ends[1]:ends[2]] = c * bx[1], s * bx[1]
        Q[0, ends[2]:], Q[1, ends[2]:] = -s * by[1], c * by[1]
        self.bilinear = np.outer(P[0], Q[1]) - np.outer(P[1], Q[0])
        self.bilinear += self.bilinear.T

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return g, gradient, Hessian."""
        local = e[self.dofs]
        G = self.bilinear @ local
        return 0.5 * float(local @ G), G, self.bilinear


@dataclass
class DirectionAtTheta:
    """A section direction follows a rotation coordinate: v_a x (cos, sin)(angle_a + theta_b) = 0."""

    a: PointRef
    b: PointRef
    owner: str
    holds: str = "relative rotation"

    def __post_init__(self) -> None:
        columns, self.reference = self.a.director()
        self.columns, self.theta = columns, self.b.theta()
        self.dofs = np.concatenate([*(c for c, _ in columns), self.theta[0]])

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return g, gradient, Hessian; theta_b is a displacement, 0 in the reference."""
        (cx, wx), (cy, wy) = self.columns
        angle = self.reference + float(self.theta[1] @ d[self.theta[0]])
        c, s = math.cos(angle), math.sin(angle)
        vx, vy = float(wx @ e[cx]), float(wy @ e[cy])
        slope = vx * c + vy * s
        G = np.concatenate([wx * s, -wy * c, self.theta[1] * slope])
        mixed = np.concatenate([wx * c, wy * s])
        H = np.zeros((len(G), len(G)))
        n = len(mixed)
        H[:n, n:] = np.outer(mixed, self.theta[1])
        H[n:, :n] = H[:n, n:].T
        H[n:, n:] = (vy * c - vx * s) * np.outer(self.theta[1], self.theta[1])
        return vx * s - vy * c, G, H


def align(a: PointRef, b: PointRef, owner: str, out: Equations) -> None:
    """Ask that the sections at a and b keep their relative angle."""
    if a.turns_by_theta and b.turns_by_theta:
        coords, coefs = combine((1.0, a.theta()), (-1.0, b.theta()))
        out.rows.append(Row(coords, coefs, owner, "relative rotation"))
    elif a.turns_by_theta:
        out.constraints.append(DirectionAtTheta(b, a, owner))
    elif b.turns_by_theta:
        out.constraints.append(DirectionAtTheta(a, b, owner))
    else:
        out.constraints.append(DirectionsAligned(a, b, owner))


def hold_rotation(point: PointRef, owner: str, out: Equations) -> None:
    """Ask that the section at a point keeps its reference direction."""
    if point.turns_by_theta:
        coords, coefs = point.theta()
    else:
        columns, angle = point.director()
        coords, coefs = along(columns, -math.sin(angle), math.cos(angle))
    out.rows.append(Row(coords, coefs, owner, "rotation"))


def prescribe_rotation(point: PointRef, signal: Course, owner: str, out: Equations) -> None:
    """Ask that the section at a point turns by signal(t) from its reference direction."""
    if point.turns_by_theta:
        coords, coefs = point.theta()
        out.rows.append(Row(coords, coefs, owner, "rotation", signal))
    else:
        out.constraints.append(DirectionPrescribed(point, signal, owner))
