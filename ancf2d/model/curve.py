"""Axes of bodies in pieces, each divided into equally long elements."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case import Arc, CurveGeometry, Geometry, Line, LinePiece, PathGeometry, Polyline, Spline
from .axis import ArcAxis, Axis, AxisError, ParametricAxis, check_closed, curve, spline
from .grading import Grading, runs

Array = NDArray[np.float64]

# distance, relative to an element, below which a point is at a node
AT_NODE = 1e-9
# distance, relative to the body's length, below which points share one node; shorter elements are inaccurate
TOGETHER = 1e-5
# difference of curvature times body length below which it is round-off
JUMP = 1e-9
# least and largest number of stretches of a rigid curved body
LEAST, LONGEST = 4, 400
# shares of a count that differ by less are equal up to round-off
ALIKE = 1e-6


@dataclass(frozen=True)
class Piece:
    """A stretch of an axis: where it starts on it [m], its length and number of elements.

    ``s0`` is the arc length of the body at its start; ``continues``: whether it continues the piece before smoothly;
    ``kink``: whether derivatives along the axis can jump at its start.
    """

    axis: Axis
    length: float
    s0: float
    count: int
    begin: float = 0.0
    continues: bool = False
    kink: bool = False

    @property
    def shared(self) -> bool:
        """Return whether its first node is the last node of the piece before."""
        return self.continues and not self.kink

    @property
    def l(self) -> float:
        """Reference length of one element."""
        return self.length / self.count

    @property
    def kappa(self) -> float | None:
        """Constant curvature dtheta/ds [1/m] (0 for a straight piece), or None if it varies."""
        return self.axis.kappa if isinstance(self.axis, ArcAxis) else None

    @property
    def angle(self) -> float:
        """Direction at its start."""
        return float(self.axis.position(np.array(self.begin))[1])

    @property
    def start(self) -> Array:
        """The point (2,) at its start."""
        return self.position(0.0)[0]

    def position(self, s: float | NDArray[np.floating]) -> tuple[Array, Array]:
        """Return points (..., 2) and tangent angles (...) at arc length s from the piece's start."""
        z, theta = self.axis.position(self.begin + np.asarray(s, dtype=float))
        return _pair(z), theta

    def derivative(self, s: float | NDArray[np.floating], i: int, j: int) -> Array:
        """Return d^(i+j) r/dx^i dy^j on the axis (..., 2) of r(x, y) = c(x) + y n(x), for (i, j) != (0, 0)."""
        found = self.axis.derivatives(self.begin + np.asarray(s, dtype=float), i + min(j, 1))[-1]
        return _pair(found if j == 0 else 1j * found if j == 1 else 0.0 * found)

    def curvature(self, s: float | NDArray[np.floating]) -> Array:
        """Return dtheta/ds (...) [1/m] at arc length s from the piece's start."""
        t, bend = self.axis.derivatives(self.begin + np.asarray(s, dtype=float), 2)
        curvature: Array = (t.conj() * bend).imag
        return curvature

    @cached_property
    def turning_angles(self) -> Array:
        """The angles (count,) by which the elements turn [rad]."""
        return np.diff(self.position(self.l * np.arange(self.count + 1))[1])

    def nearest(self, r: Array) -> float:
        """Return the arc length within the piece of its point nearest to r (2,)."""
        return self.axis.nearest(complex(*r), self.begin, self.begin + self.length) - self.begin


def _pair(z: Any) -> Array:
    return np.ascontiguousarray(z, dtype=complex).view(float).reshape(*np.shape(z), 2)


def share_count(lengths: Sequence[float], count: int) -> list[int]:
    """Divide ``count`` elements among pieces in proportion to their lengths, at least one each.

    What remains after rounding down goes to the largest remainders. Of pieces equal up to round-off, those in the
    middle come first, in pairs, so that shares are symmetric where possible. Raises OverflowError if the total length
    is not finite.
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
    """Return up to ``number`` of the places, from the middle outwards, symmetric where possible."""
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
        pieces.append(Piece(ArcAxis(a, angle, 0.0), length, s0, 1))
        previous, s0 = angle, s0 + length
    return pieces


def _arc(geometry: Arc) -> Piece:
    sweep = geometry.to - geometry.from_
    sign = math.copysign(1.0, sweep)
    start = (geometry.center[0] + geometry.radius * math.cos(geometry.from_),
             geometry.center[1] + geometry.radius * math.sin(geometry.from_))
    return Piece(ArcAxis(start, geometry.from_ + sign * math.pi / 2, sign / geometry.radius),
                 geometry.radius * abs(sweep), 0.0, 1)


def _path(geometry: PathGeometry) -> list[Piece]:
    pieces: list[Piece] = []
    start, angle, s0 = geometry.start, geometry.heading, 0.0
    for part in geometry.pieces:
        if isinstance(part, LinePiece):
            length, kappa = part.line, 0.0
        else:
            length, kappa = part.arc * abs(part.angle), math.copysign(1.0 / part.arc, part.angle)
        pieces.append(Piece(ArcAxis(start, angle, kappa), length, s0, 1, continues=bool(pieces)))
        (x, y), theta = pieces[-1].position(length)
        start, angle, s0 = (float(x), float(y)), float(theta), s0 + length
    if geometry.closed:
        check_closed(complex(*geometry.start), complex(*start), math.remainder(angle - geometry.heading, 2 * math.pi),
                     s0)
    return pieces


@lru_cache(maxsize=256)
def _undivided(geometry: Geometry) -> tuple[tuple[Piece, ...], tuple[float, ...]]:
    """Return the pieces of a geometry, one element each, and the arc lengths inside them where derivatives jump.

    Raises AxisError if the geometry is not a smooth curve.
    """
    if isinstance(geometry, Line):
        return tuple(_straight_pieces([geometry.start, geometry.end])), ()
    if isinstance(geometry, Polyline):
        return tuple(_straight_pieces(list(geometry.points))), ()
    if isinstance(geometry, Arc):
        return (_arc(geometry),), ()
    if isinstance(geometry, PathGeometry):
        return tuple(_path(geometry)), ()
    axes, knots = spline(geometry) if isinstance(geometry, Spline) else (curve(geometry), [])
    starts = np.concatenate([[0.0], np.cumsum([axis.length for axis in axes])]).tolist()
    return tuple(Piece(axis, axis.length, s0, 1, continues=s0 > 0.0)
                 for axis, s0 in zip(axes, starts, strict=False)), tuple(knots)


def knots(geometry: Geometry) -> list[float]:
    """Return the places S at which elements of a smooth axis should end: the points of a spline.

    Derivatives of the curvature jump there, and elements across them would lose their order.
    """
    try:
        pieces, found = _undivided(geometry)
    except (AxisError, ArithmeticError):
        return []  # reported when the body is resolved
    return [s / (pieces[-1].s0 + pieces[-1].length) for s in found]


def jumps(geometry: Geometry) -> list[float]:
    """Return the places S where smooth pieces of different curvature meet."""
    pieces = _undivided(geometry)[0]
    length = pieces[-1].s0 + pieces[-1].length
    return [b.s0 / length for a, b in pairwise(pieces)
            if b.continues and abs(float(b.curvature(0.0)) - float(a.curvature(a.length))) * length > JUMP]


def short_pieces(geometry: Geometry, turn: float) -> tuple[Piece, ...]:
    """Return a smooth geometry in stretches that turn by about ``turn`` [rad], at most about ``LONGEST`` of them.

    Stretches also end where derivatives jump. Raises AxisError if the geometry is not a smooth curve.
    """
    whole, places = _undivided(geometry)
    length = whole[-1].s0 + whole[-1].length
    most = max(LEAST, _up(min(turning(geometry) / turn, LONGEST)))
    cut = _stretches(whole, [s / length for s in places])
    return tuple(part for p in cut for n in [_up(most * p.length / length)]
                 for part in _split(p, [p.length * k / n for k in range(1, n)]))


def _up(x: float) -> int:
    """Return x rounded up, except that x up to round-off above an integer gives this integer."""
    return math.ceil(x * (1.0 - ALIKE))


def is_closed(geometry: Geometry) -> bool:
    """Return whether the geometry is a closed curve."""
    return isinstance(geometry, Spline | CurveGeometry | PathGeometry) and geometry.closed


def turning(geometry: Geometry) -> float:
    """Return the total absolute angle [rad] by which the smooth pieces of a geometry turn."""
    return sum(p.axis.turning if isinstance(p.axis, ParametricAxis) else abs(p.kappa or 0.0) * p.length
               for p in _undivided(geometry)[0])


def _split(piece: Piece, places: list[float]) -> list[Piece]:
    """Return a piece divided at places (arc lengths); the parts continue one another."""
    if not places:
        return [piece]
    return [replace(piece, begin=piece.begin + a, length=b - a, s0=piece.s0 + a,
                    continues=piece.continues if a == 0.0 else True)
            for a, b in pairwise([0.0, *places, piece.length])]


def _inside(pieces: Sequence[Piece], nodes: Sequence[float]) -> list[list[float]]:
    """Return for each piece the nodes inside it as arc lengths; nodes are given as fractions S of the body.

    Nodes closer than ``TOGETHER`` to an end of the piece, or to the node before, are left out.
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


def _stretches(whole: Sequence[Piece], nodes: Sequence[float]) -> list[Piece]:
    return [part for p, found in zip(whole, _inside(whole, nodes), strict=True) for part in _split(p, found)]


def stretches(geometry: Geometry, nodes: Sequence[float], grading: Grading | None = None) -> list[float]:
    """Return the lengths of the stretches between corners and ``nodes`` (fractions S of the body's arc length).

    With a grading, return their shares of the elements instead; its given nodes divide the geometry, too.
    """
    whole = _undivided(geometry)[0]
    if grading is None:
        return [p.length for p in _stretches(whole, nodes)]
    ends = _ends(_stretches(whole, [*nodes, *grading.nodes]))
    return np.diff(grading.shares(ends)).tolist()


def _ends(pieces: Sequence[Piece]) -> Array:
    """Return the places S where the pieces start, and 1."""
    ends = np.array([*(p.s0 for p in pieces), pieces[-1].s0 + pieces[-1].length])
    return ends / ends[-1]


def pieces_of(geometry: Geometry, count: int, nodes: Sequence[float] = (), refine: int = 1,
              kinks: Sequence[float] = (), grading: Grading | None = None) -> tuple[Piece, ...]:
    """Return the pieces of a geometry with ``count`` elements in all, or more if there are more pieces.

    Pieces are divided at ``nodes`` (fractions S of the body's arc length), unless all of these are nodes of equal
    elements anyway; then only at ``kinks``, a subset of them. Every element is divided into ``refine`` equal ones.
    Graded elements of different length become separate pieces.
    """
    # cached: several bodies may have equal arguments
    return _pieces_of(geometry, count, tuple(nodes), refine, tuple(kinks), grading)


@lru_cache(maxsize=256)
def _pieces_of(geometry: Geometry, count: int, nodes: tuple[float, ...], refine: int, kinks: tuple[float, ...],
               grading: Grading | None) -> tuple[Piece, ...]:
    whole = _undivided(geometry)[0]
    regular = tuple(replace(p, count=n) for p, n in zip(whole, share_count([p.length for p in whole], count),
                                                        strict=True))
    if grading is not None:
        parts = _graded(_stretches(whole, [*nodes, *grading.nodes]), count, refine, grading)
    elif all(abs(sigma / p.l - round(sigma / p.l)) <= AT_NODE
             for p, found in zip(regular, _inside(whole, nodes), strict=True) for sigma in found):
        parts = [part for p, found in zip(regular, _inside(whole, kinks), strict=True) for part in _cut(p, found)]
    else:
        some = _stretches(whole, nodes)
        shares = share_count([p.length for p in some], max(count, len(some)))
        parts = [replace(p, count=n) for p, n in zip(some, shares, strict=True)]
    if grading is None:
        parts = [replace(p, count=refine * p.count) for p in parts]
    length = whole[-1].s0 + whole[-1].length
    # the start of a closed axis is its end, too
    at = [s * length for s in kinks] + ([0.0] if is_closed(geometry) and 1.0 in kinks else [])
    return tuple(replace(p, kink=(p.s0 > 0.0 or is_closed(geometry)) and any(
        abs(sigma - p.s0) <= TOGETHER * length for sigma in at)) for p in parts)


def _graded(some: Sequence[Piece], count: int, refine: int, grading: Grading) -> list[Piece]:
    """Return stretches divided into ``count`` times ``refine`` graded elements; each piece has equal elements."""
    ends = _ends(some)
    x, length = grading.shares(ends), some[-1].s0 + some[-1].length
    counts = share_count(np.diff(x).tolist(), max(count, len(some)))
    parts = []
    for k, (piece, n) in enumerate(zip(some, counts, strict=True)):
        s = grading.places(np.linspace(x[k], x[k + 1], n * refine + 1))
        s[0], s[-1] = ends[k], ends[k + 1]
        found = runs(length * np.diff(s))
        at = np.cumsum([part for part, _ in found])[:-1].tolist()
        parts += [replace(p, count=m) for p, (_, m) in zip(_split(piece, at), found, strict=True)]
    return parts


def _cut(piece: Piece, places: list[float]) -> list[Piece]:
    """Return a piece of equal elements, divided at some of their nodes."""
    ends = [0, *(round(sigma / piece.l) for sigma in places), piece.count]
    return [replace(p, count=b - a) for p, (a, b) in zip(_split(piece, [n * piece.l for n in ends[1:-1]]),
                                                        pairwise(ends), strict=True)]


def peak_nodes(pieces: Sequence[Piece], acting: Sequence[float]) -> Array:
    """Return for each end of an element (count + 1,) whether the moment may peak there.

    Moments may peak at the ends of a body, at nodes that its pieces do not share, and where something acts at a node.
    """
    starts = np.concatenate([p.s0 + p.l * np.arange(p.count) for p in pieces])
    length = pieces[-1].s0 + pieces[-1].length
    alone = np.concatenate([[k == 0 and not p.shared for k in range(p.count)] for p in pieces])
    at = np.append(starts, length)
    there = np.append(alone, True)
    there[0] = True
    for s in acting:
        there |= np.abs(at - s * length) <= TOGETHER * length
    return there


def peaks(pieces: Sequence[Piece], acting: Sequence[float]) -> list[int]:
    """Return for each element -1 or 1 if the moment may peak only at its start or only at its end, else 0."""
    return [int(end) - int(start) for start, end in pairwise(peak_nodes(pieces, acting))]
