"""Symmetric matrices with our own LDL^T, which exchanges no rows: bands and fronts, bordered by constraints or not."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..elements.shape import Array
from ..kernels.matrices.band import ldl_factor, ldl_solve
from ..kernels.matrices.fronts import fronts_factor, fronts_product, fronts_solve
from ..kernels.matrices.layout import Fronts, entries
from ..kernels.matrices.matrix import Nested, SymBand, band_product
from ..model.mesh import Index

# a pivot below this share of the terms it is the difference of is round-off
SINGULAR = 4e-16
# what constraints add to the stiffness, beside that of the unknowns that they act on
STIFF = 10.0
# stiffness beside the largest one of the matrix, both as forces over displacements, that counts as none
NO_STIFFNESS = 1e-12
# and the most that they add beside the stiffness by which they yield
MOST = 0.5
# what stands for it where there is none at all, so large that round-off of forces moves nothing [N/m]
RIGID = 1e15


@dataclass(frozen=True)
class Pivots:
    """What a factorisation tells: the unknown where it broke (or -1), negative and smallest relative pivots."""

    bad: int
    negative: int
    smallest: float


@dataclass(frozen=True)
class Multipliers:
    """The multipliers of a symmetric matrix [K, G^T; G, 0] and the unknowns that each acts on, one after the other.

    ``multiplier`` (m,) are their positions, ``index`` (k,) those of the unknowns in their rows of G, ``owner`` (k,) the
    multiplier that each belongs to; ``weights`` (n,) the displacement that a unit of an unknown stands for, 0 for
    multipliers. ``open``: whether some rows of G may vanish, those of contacts that are open; ``loads``: all of the
    model over its extent [N/m].
    """

    multiplier: Index
    index: Index
    owner: Index
    weights: Array
    open: bool = False
    loads: float = 0.0

    @cached_property
    def moved(self) -> NDArray[np.bool_]:
        """Whether each unknown (n,) is a coordinate, and no multiplier."""
        out: NDArray[np.bool_] = np.ones(len(self.weights), dtype=bool)
        out[self.multiplier] = False
        return out

    @property
    def alone(self) -> bool:
        """Whether constraints alone say where everything is: there are as many as coordinates."""
        return not self.open and 2 * len(self.multiplier) >= len(self.weights)

    def stiffness(self, g: Array, diagonal: Array) -> Array:
        """Return gamma (m,) for the rows of G with entries g (k,): as stiff as what they act on, in any units.

        Rows that act on nothing stiff (bars between bars) are as stiff as the rows that they share unknowns with.
        """
        moves = self.weights > 0.0
        sizes = np.abs(diagonal)
        sizes[moves] /= self.weights[moves] ** 2
        largest = float(sizes[moves].max(initial=0.0))
        # what would not bear the loads before anything has gone far out of sight is round-off of their directions
        largest = largest if largest > NO_STIFFNESS * self.loads else RIGID
        weights, sizes = self.weights[self.index], np.where(sizes > NO_STIFFNESS * largest, sizes, 0.0)
        scaled, m = (g / weights) ** 2, len(self.multiplier)
        gamma: Array = np.zeros(m)
        left = np.bincount(self.owner, scaled, m) > 0.0
        while left.any():
            known = sizes[self.index]
            # what is not stiff itself is taken for stiff: else an entry of round-off beside it would say all
            given = np.bincount(self.owner, scaled / np.where(known > 0.0, known, largest), m)
            found = left & (np.bincount(self.owner, scaled * (known > 0.0), m) > 0.0)
            if not found.any():
                # no stiffness anywhere near: any number does
                found = left
            gamma[found] = STIFF / given[found]
            new = found[self.owner]
            np.add.at(sizes, self.index[new], gamma[self.owner[new]] * scaled[new])
            left = left & ~found
        return gamma


class Symmetric(ABC):
    """A symmetric matrix with our own LDL^T, which exchanges no rows; the pivot signs give the inertia.

    Multipliers make it indefinite. Factored is [K + G^T gamma G, G^T; G, 0], which has the same inertia, as it is
    congruent, and the same solution, once gamma G^T times the multipliers' part is added to the other part of the
    right-hand side (Golub & Greif 2003). Where K is positive definite on what the constraints leave free,
    K + G^T gamma G is so altogether. As each multiplier stands behind all unknowns that it acts on, no pivot then
    vanishes. Constraints that yield have -c for a 0; theirs becomes -c/(1 - gamma c), and what is solved for is
    1 - gamma c times the multiplier.
    """

    values: Array
    target: Any

    def __init__(self, n: int, multipliers: Multipliers | None) -> None:
        self.scale, self.multipliers = np.zeros(n), multipliers
        self.pull: Array | None = None
        self.shares: Array = np.ones(0)
        if multipliers is not None:
            self.rows = self.at(multipliers.multiplier[multipliers.owner], multipliers.index)

    @abstractmethod
    def at(self, i: Index, j: Index) -> Index:
        """Return where entries (i, j), j <= i, are among the values."""

    @abstractmethod
    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of a matrix with such entries, stored as this one."""

    @abstractmethod
    def product(self, values: Array, x: Array) -> Array:
        """Return A x of a matrix with such entries, stored as this one."""

    @abstractmethod
    def _factored(self) -> tuple[int, int, float]:
        """Factor the values in place; return what ``Pivots`` holds."""

    @abstractmethod
    def _solved(self, x: Array) -> None:
        """Solve with the factors in place."""

    def clear(self) -> None:
        """Set every entry to zero."""
        self.values.fill(0.0)

    def read(self, i: Index, j: Index) -> Array:
        """Return the entries (i, j) of the matrix as it was assembled, before it is factored."""
        return self.values.reshape(-1)[self.at(np.maximum(i, j), np.minimum(i, j))]

    def drop_multipliers(self, values: Array) -> None:
        """Set the rows of the multipliers to zero in a matrix with such entries, stored as this one."""
        if self.multipliers is not None:
            values.reshape(-1)[self.rows] = 0.0

    def factor(self) -> Pivots:
        """Factor in place: K = L D L^T."""
        m = self.multipliers
        if m is not None:
            if m.alone:
                self.formed = self.values.copy()
            self._stiffen(m)
        return Pivots(*self._factored())

    def _stiffen(self, m: Multipliers) -> None:
        """Add gamma g g^T of each multiplier, and keep gamma g."""
        flat = self.values.reshape(-1)
        g, diagonal = flat[self.rows], self.diagonal(self.values).copy()
        gamma, yields = m.stiffness(g, diagonal), np.maximum(-diagonal[m.multiplier], 0.0)
        np.minimum(gamma, MOST / np.maximum(yields, MOST / np.maximum(gamma, 1e-300)), out=gamma)
        self.shares = 1.0 - gamma * yields
        flat[self.at(m.multiplier, m.multiplier)] /= self.shares
        self.pull = pull = gamma[m.owner] * g
        used = np.flatnonzero(g)
        owner, count = m.owner[used], np.bincount(m.owner[used], minlength=len(m.multiplier))
        first = np.cumsum(count) - count
        # each entry of a row with each of the same row
        many = count[owner]
        one = np.repeat(np.arange(len(used)), many)
        other = np.arange(len(one)) - np.repeat(np.cumsum(many) - many, many) + np.repeat(first[owner], many)
        a, b = used[one], used[other]
        lower = m.index[b] <= m.index[a]
        a, b = a[lower], b[lower]
        np.add.at(flat, self.at(m.index[a], m.index[b]), pull[a] * g[b])

    def add_pulls(self, moves: Array, out: Array) -> None:
        """Add the sizes of the forces that gamma makes of what constraints move (m,) to those of unknowns (n,).

        None before the first factors, and none where constraints alone say where everything is.
        """
        m = self.multipliers
        if m is not None and self.pull is not None and not m.alone:
            np.add.at(out, m.index, np.abs(self.pull) * moves[m.owner])

    def solve(self, b: Array, out: Array | None = None) -> Array:
        """Return K^-1 b, in ``out`` if given."""
        x = np.empty_like(b) if out is None else out
        x[:] = b
        m = self.multipliers
        if m is None:
            self._solved(x)
        elif m.alone:
            # the constraints move everything, whatever the forces; multipliers bear what forces and stiffness ask for,
            # and have no part of gamma, beside which they may be round-off
            x[m.moved] = 0.0
            self._solved_with(m, x)
            x[m.multiplier] = 0.0
            borne = np.where(m.moved, b - self.product(self.formed, x), 0.0)
            self._solved(borne)
            x[m.multiplier] = borne[m.multiplier] / self.shares
        else:
            self._solved_with(m, x)
        return x

    def _solved_with(self, m: Multipliers, x: Array) -> None:
        assert self.pull is not None
        np.add.at(x, m.index, self.pull * x[m.multiplier][m.owner])
        self._solved(x)
        x[m.multiplier] /= self.shares

    @property
    def knows_inertia(self) -> bool:
        """Return True."""
        return True


class SymmetricBand(Symmetric):
    """Symmetric band."""

    def __init__(self, n: int, bw: int, multipliers: Multipliers | None = None) -> None:
        self.bw = bw
        self.values = np.zeros((n, bw + 1))
        self.target = SymBand(self.values)
        super().__init__(n, multipliers)

    def at(self, i: Index, j: Index) -> Index:
        """Return where entries (i, j), j <= i, are among the values."""
        return i * self.bw + self.bw + j

    def _factored(self) -> tuple[int, int, float]:
        return ldl_factor(self.values, SINGULAR, self.scale)  # type: ignore[no-any-return]

    def _solved(self, x: Array) -> None:
        ldl_solve(self.values, x)

    def product(self, values: Array, x: Array) -> Array:
        """Return A x."""
        y = np.empty(len(x))
        band_product(values, x, y)
        return y

    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of A."""
        return values[:, -1]


class SymmetricFronts(Symmetric):
    """Fronts of a branched frame."""

    def __init__(self, fronts: Fronts, multipliers: Multipliers | None = None) -> None:
        self.fronts = fronts
        self.values = np.zeros(int(fronts.at[-1]))
        self.target = Nested(self.values, fronts)
        super().__init__(len(fronts.owner), multipliers)

    def at(self, i: Index, j: Index) -> Index:
        """Return where entries (i, j), j <= i, are among the values."""
        return entries(self.fronts, i, j)

    def _factored(self) -> tuple[int, int, float]:
        return fronts_factor(self.fronts, self.values, SINGULAR, self.scale)  # type: ignore[no-any-return]

    def _solved(self, x: Array) -> None:
        fronts_solve(self.fronts, self.values, x)

    def product(self, values: Array, x: Array) -> Array:
        """Return A x."""
        y = np.empty(len(x))
        fronts_product(self.fronts, values, x, y, False)
        return y

    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of A."""
        every = np.arange(len(self.fronts.owner))
        return values[self.at(every, every)]
