"""Reference curves of bodies: straight pieces and arcs, by arclength."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..case import Arc, Line, Polyline

Array = NDArray[np.float64]

# of an element: a point that is closer to a node is at the node
AT_NODE = 1e-9
# of a body's length: points that are closer share one node, as a shorter element would spoil the arithmetic
TOGETHER = 1e-5
# of an element: shares of a count that differ by less are equal, whatever round-off says
ALIKE = 1e-6


@dataclass(frozen=True)
class Piece:
    """A stretch of constant curvature: ``start`` and ``angle`` of its first point, its length and count.

    ``kappa`` is dtheta/ds [1/m], 0 for a straight piece; ``s0`` the arclength where it begins; ``continues``: whether
    it follows the piece before smoothly; ``kink``: whether strains along the axis can jump where it begins.
    """

    start: tuple[float, float]
    angle: float
    length: float
    kappa: float
    s0: float
    count: int
    continues: bool = False
    kink: bool = False

    @property
    def shared(self) -> bool:
        """Whether its first node is the last one of the piece before."""
        return self.continues and not self.kink

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


def share_count(lengths: Sequence[float], count: int) -> list[int]:
    """Share ``count`` elements among pieces in proportion to their lengths, at least one each.

    What rounding down leaves goes to the largest remainders. Of pieces that are alike to round-off those in the middle
    come first, in pairs from there on, so that shares are symmetric wherever they can be. Raises OverflowError where
    the lengths together are no number.
    """
    total = sum(lengths)
    if not math.isfinite(count * total):
        raise OverflowError("the length is not a finite number")
    ideal = [count * length / total for length in lengths]
    shares = [max(1, math.floor(i + ALIKE)) for i in ideal]
    while (missing := count - sum(shares)) != 0:
        sign = 1 if missing > 0 else -1
        wants = {k: sign * (ideal[k] - n) for k, n in enumerate(shares) if sign > 0 or n > 1}
        most = max(wants.values())
        for k in _from_the_middle([k for k, want in wants.items() if want >= most - ALIKE], abs(missing)):
            shares[k] += sign
    return shares


def _from_the_middle(places: list[int], number: int) -> list[int]:
    """Return up to ``number`` of the places, the ones in the middle, symmetric where that can be."""
    m = len(places)
    if number >= m:
        return places
    middle = [places[m // 2]] if m % 2 and number % 2 else []
    half = m // 2
    pairs = [k for i in range(half) for k in (places[half - 1 - i], places[m - half + i])]
    return (middle + pairs)[:number]


def _straight_pieces(points: list[tuple[float, float]]) -> list[Piece]:
    pieces, s0 = [], 0.0
    previous: float | None = None
    for a, b in pairwise(points):
        angle = math.atan2(b[1] - a[1], b[0] - a[0])
        if previous is not None:
            angle = previous + math.remainder(angle - previous, 2 * math.pi)
        length = math.dist(a, b)
        pieces.append(Piece(a, angle, length, 0.0, s0, 1))
        previous, s0 = angle, s0 + length
    return pieces


def _undivided(geometry: Line | Arc | Polyline) -> list[Piece]:
    """Return the pieces of a body's geometry, one element each."""
    if isinstance(geometry, Line):
        return _straight_pieces([geometry.start, geometry.end])
    if isinstance(geometry, Polyline):
        return _straight_pieces(list(geometry.points))
    sweep = geometry.to - geometry.from_
    sign = math.copysign(1.0, sweep)
    start = (geometry.center[0] + geometry.radius * math.cos(geometry.from_),
             geometry.center[1] + geometry.radius * math.sin(geometry.from_))
    return [Piece(start, geometry.from_ + sign * math.pi / 2, geometry.radius * abs(sweep),
                  sign / geometry.radius, 0.0, 1)]


def _split(piece: Piece, places: list[float]) -> list[Piece]:
    """Return a piece as several that continue one another, from one of its places (arclengths) to the next."""
    if not places:
        return [piece]
    out = []
    for a, b in pairwise([0.0, *places, piece.length]):
        r, angle = piece.position(a)
        start = piece.start if a == 0.0 else (float(r[0]), float(r[1]))
        out.append(replace(piece, start=start, angle=float(angle), length=b - a, s0=piece.s0 + a,
                           continues=piece.continues if a == 0.0 else True))
    return out


def _inside(pieces: list[Piece], nodes: Sequence[float]) -> list[list[float]]:
    """Return for each piece the arclengths within it of nodes, given as fractions S of the body's arclength.

    A node that is closer than ``TOGETHER`` to an end of a piece, or to the one before it, is that one.
    """
    length = pieces[-1].s0 + pieces[-1].length
    out: list[list[float]] = []
    for piece in pieces:
        found: list[float] = []
        for sigma in sorted(s * length - piece.s0 for s in nodes):
            if (sigma - (found[-1] if found else 0.0) > TOGETHER * length
                    and piece.length - sigma > TOGETHER * length):
                found.append(sigma)
        out.append(found)
    return out


def _stretches(whole: list[Piece], nodes: Sequence[float]) -> list[Piece]:
    return [part for p, found in zip(whole, _inside(whole, nodes), strict=True) for part in _split(p, found)]


def stretches(geometry: Line | Arc | Polyline, nodes: Sequence[float]) -> list[float]:
    """Return the lengths of what corners and ``nodes`` (fractions S of the body's arclength) cut a geometry into."""
    return [p.length for p in _stretches(_undivided(geometry), nodes)]


def pieces_of(geometry: Line | Arc | Polyline, count: int, nodes: Sequence[float] = (),
              refine: int = 1, kinks: Sequence[float] = ()) -> tuple[Piece, ...]:
    """Return the pieces of a body's geometry with ``count`` elements in all, more only where there are more pieces.

    A piece is split at each of ``nodes`` (fractions S of the body's arclength), unless all of them are ends of the
    equal elements that the pieces have without; then it is split at ``kinks`` alone, which are some of them. Every
    element is then divided into ``refine`` ones.
    """
    whole = _undivided(geometry)
    regular = tuple(replace(p, count=n) for p, n in zip(whole, share_count([p.length for p in whole], count),
                                                        strict=True))
    if all(abs(sigma / p.l - round(sigma / p.l)) <= AT_NODE
           for p, found in zip(regular, _inside(whole, nodes), strict=True) for sigma in found):
        parts = [part for p, found in zip(regular, _inside(whole, kinks), strict=True) for part in _cut(p, found)]
    else:
        some = _stretches(whole, nodes)
        shares = share_count([p.length for p in some], max(count, len(some)))
        parts = [replace(p, count=n) for p, n in zip(some, shares, strict=True)]
    near = TOGETHER * (whole[-1].s0 + whole[-1].length)
    at = [s * near / TOGETHER for s in kinks]
    return tuple(replace(p, count=refine * p.count, kink=k > 0 and any(abs(sigma - p.s0) <= near for sigma in at))
                 for k, p in enumerate(parts))


def _cut(piece: Piece, places: list[float]) -> list[Piece]:
    """Return a piece of equal elements, split at some of their nodes."""
    ends = [0, *(round(sigma / piece.l) for sigma in places), piece.count]
    return [replace(p, count=b - a) for p, (a, b) in zip(_split(piece, [n * piece.l for n in ends[1:-1]]),
                                                        pairwise(ends), strict=True)]
