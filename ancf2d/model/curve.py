"""Reference curves of bodies: straight pieces and arcs, by arclength."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..case import Arc, Line, Polyline

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Piece:
    """A stretch of constant curvature: ``start`` and ``angle`` of its first point, its length and count.

    ``kappa`` is dtheta/ds [1/m], 0 for a straight piece; ``s0`` the arclength where it begins.
    """

    start: tuple[float, float]
    angle: float
    length: float
    kappa: float
    s0: float
    count: int

    @property
    def l(self) -> float:
        """Reference length of one element."""
        return self.length / self.count

    def position(self, s: float | NDArray[np.floating]) -> tuple[Array, Array]:
        """Return points (..., 2) and tangent angles (...) at arclength s from the piece's start."""
        way: Array = np.asarray(s, dtype=float)
        theta = self.angle + self.kappa * way
        chord = way * np.sinc(0.5 * self.kappa * way / np.pi)
        middle = self.angle + 0.5 * self.kappa * way
        x = self.start[0] + chord * np.cos(middle)
        y = self.start[1] + chord * np.sin(middle)
        return np.stack([x, y], axis=-1), theta

    def derivative(self, theta: Array, i: int, j: int) -> Array:
        """Return d^(i+j) r/dx^i dy^j on the axis (..., 2) of r(x, y) = c(x) + y n(x), for (i, j) != (0, 0)."""
        turn = 1j * self.kappa
        tangent = np.exp(1j * np.asarray(theta, dtype=float))
        if j == 0:
            z = turn ** (i - 1) * tangent
        elif j == 1:
            z = 1j * turn**i * tangent
        else:
            z = np.zeros_like(tangent)
        return np.stack([z.real, z.imag], axis=-1)


def share_count(lengths: list[float], count: int) -> list[int]:
    """Share ``count`` elements among pieces in proportion to their lengths, at least one each.

    Raises OverflowError where the lengths together are no number.
    """
    total = sum(lengths)
    if not math.isfinite(count * total):
        raise OverflowError("the length is no number")
    ideal = [count * length / total for length in lengths]
    shares = [max(1, math.floor(i)) for i in ideal]
    while sum(shares) < count:
        k = max(range(len(shares)), key=lambda m: ideal[m] - shares[m])
        shares[k] += 1
    while sum(shares) > count:
        k = max((m for m in range(len(shares)) if shares[m] > 1), key=lambda m: shares[m] - ideal[m])
        shares[k] -= 1
    return shares


def _straight_pieces(points: list[tuple[float, float]], count: int) -> tuple[Piece, ...]:
    pairs = list(pairwise(points))
    lengths = [math.dist(a, b) for a, b in pairs]
    pieces, s0 = [], 0.0
    previous: float | None = None
    for (a, b), length, n in zip(pairs, lengths, share_count(lengths, count), strict=True):
        angle = math.atan2(b[1] - a[1], b[0] - a[0])
        if previous is not None:
            angle = previous + math.remainder(angle - previous, 2 * math.pi)
        pieces.append(Piece(a, angle, length, 0.0, s0, n))
        previous, s0 = angle, s0 + length
    return tuple(pieces)


def pieces_of(geometry: Line | Arc | Polyline, count: int) -> tuple[Piece, ...]:
    """Return the pieces of a body's geometry with ``count`` elements in all."""
    if isinstance(geometry, Line):
        return _straight_pieces([geometry.start, geometry.end], count)
    if isinstance(geometry, Polyline):
        return _straight_pieces(list(geometry.points), count)
    sweep = geometry.to - geometry.from_
    sign = math.copysign(1.0, sweep)
    start = (geometry.center[0] + geometry.radius * math.cos(geometry.from_),
             geometry.center[1] + geometry.radius * math.sin(geometry.from_))
    return (Piece(start, geometry.from_ + sign * math.pi / 2, geometry.radius * abs(sweep),
                  sign / geometry.radius, 0.0, count),)
