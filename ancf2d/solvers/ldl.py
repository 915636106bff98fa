"""Symmetric matrices with our own LDL^T without row exchanges: bands and fronts, with or without constraints."""

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
from ..kernels.matrices.layout import Fronts, entries, stored_entries
from ..kernels.matrices.matrix import Nested, SymBand, band_product
from ..model.mesh import Index

# a pivot below this share of the terms whose difference it is counts as zero
SINGULAR = 4e-16
# factor for the stiffness that constraints add, relative to that of the unknowns on which they act
STIFF = 10.0
# stiffness relative to the largest of the matrix, both as force per displacement, that counts as none
NO_STIFFNESS = 1e-12
# largest product of this added stiffness and the compliance of a yielding constraint
MOST = 0.5
# replaces a missing stiffness; so large that round-off of forces moves nothing [N/m]
RIGID = 1e15


@dataclass(frozen=True)
class Pivots:
    """Results of a factorisation: unknown where it failed (or -1), number of negative and smallest relative pivot."""

    bad: int
    negative: int
    smallest: float


@dataclass(frozen=True)
class Multipliers:
    """The multipliers of a symmetric matrix [K, G^T; G, 0] and the unknowns on which each acts.

    ``multiplier`` (m,) are their positions, ``index`` (k,) those of the unknowns in their rows of G, ``owner`` (k,) the
    multiplier of each; ``weights`` (n,) the displacement that a unit of an unknown stands for, 0 for multipliers.
    ``open``: whether some rows of G may vanish, as those of open contacts; ``loads``: sum of all loads of the model
    over its extent [N/m].
    """

    multiplier: Index
    index: Index
    owner: Index
    weights: Array
    open: bool = False
    loads: float = 0.0

    @cached_property
    def moved(self) -> NDArray[np.bool_]:
        """Return whether each unknown (n,) is a coordinate (True) or a multiplier."""
        out: NDArray[np.bool_] = np.ones(len(self.weights), dtype=bool)
        out[self.multiplier] = False
        return out

    @property
    def alone(self) -> bool:
        """Return whether constraints alone determine the configuration: there are as many as coordinates."""
        return not self.open and 2 * len(self.multiplier) >= len(self.weights)

    def stiffness(self, g: Array, diagonal: Array) -> Array:
        """Return gamma (m,) for rows of G with entries g (k,): as stiff as the coordinates they act on, in any units.

        Rows that act on nothing stiff (bars between bars) are as stiff as the rows with which they share unknowns.
        """
        moves = self.weights > 0.0
        sizes = np.abs(diagonal)
        sizes[moves] /= self.weights[moves] ** 2
        largest = float(sizes[moves].max(initial=0.0))
        # a stiffness that could not bear the loads without huge displacements is round-off of their directions
        largest = largest if largest > NO_STIFFNESS * self.loads else RIGID
        weights, sizes = self.weights[self.index], np.where(sizes > NO_STIFFNESS * largest, sizes, 0.0)
        scaled, m = (g / weights) ** 2, len(self.multiplier)
        gamma: Array = np.zeros(m)
        left = np.bincount(self.owner, scaled, m) > 0.0
        while left.any():
            known = sizes[self.index]
            # unknowns without stiffness count as stiff: else an entry of round-off next to them would dominate
            given = np.bincount(self.owner, scaled / np.where(known > 0.0, known, largest), m)
            found = left & (np.bincount(self.owner, scaled * (known > 0.0), m) > 0.0)
            if not found.any():
                # no stiffness anywhere near: any number will do
                found = left
            gamma[found] = STIFF / given[found]
            new = found[self.owner]
            np.add.at(sizes, self.index[new], gamma[self.owner[new]] * scaled[new])
            left = left & ~found
        return gamma


class Symmetric(ABC):
    """A symmetric matrix with our own LDL^T, without row exchanges; the signs of the pivots give the inertia.

    Multipliers make it indefinite. We factor [K + G^T gamma G, G^T; G, 0], which is congruent and so has the same
    inertia, and the same solution once gamma G^T times the multipliers' part is added to the other part of the
    right-hand side (Golub & Greif 2003). If K is positive definite on the null space of G, K + G^T gamma G is positive
    definite. As each multiplier comes after all unknowns on which it acts, no pivot vanishes then. Constraints that
    yield have -c instead of 0; it becomes -c/(1 - gamma c), and the solution contains 1 - gamma c times the multiplier.
    """

    values: Array
    target: Any
    places: Any

    def __init__(self, n: int, multipliers: Multipliers | None) -> None:
        self.scale, self.multipliers = np.zeros(n), multipliers
        self.pull: Array | None = None
        self.shares: Array = np.ones(0)
        if multipliers is not None:
            self.rows = self.at(multipliers.multiplier[multipliers.owner], multipliers.index)

    @abstractmethod
    def at(self, i: Index, j: Index) -> Index:
        """Return the places of entries (i, j), j <= i, among the values; the matrix must have them."""

    @abstractmethod
    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of a matrix with the given values, stored as this one."""

    @abstractmethod
    def product(self, values: Array, x: Array) -> Array:
        """Return A x for a matrix with the given values, stored as this one."""

    @abstractmethod
    def _factored(self) -> tuple[int, int, float]:
        """Factor the values in place; return the entries of ``Pivots``."""

    @abstractmethod
    def _solved(self, x: Array) -> None:
        """Solve in place with the factors."""

    def clear(self) -> None:
        """Set every entry to zero."""
        self.values.fill(0.0)

    def read(self, i: Index, j: Index) -> Array:
        """Return the entries (i, j) of the assembled matrix, before it is factored."""
        return self.values.reshape(-1)[self.at(np.maximum(i, j), np.minimum(i, j))]

    def drop_multipliers(self, values: Array) -> None:
        """Set the rows of the multipliers to zero in a matrix with the given values, stored as this one."""
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
        """Add gamma g g^T of each multiplier, and store gamma g."""
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
        # all pairs of entries of the same row
        many = count[owner]
        one = np.repeat(np.arange(len(used)), many)
        other = np.arange(len(one)) - np.repeat(np.cumsum(many) - many, many) + np.repeat(first[owner], many)
        a, b = used[one], used[other]
        lower = m.index[b] <= m.index[a]
        a, b = a[lower], b[lower]
        np.add.at(flat, self.at(m.index[a], m.index[b]), pull[a] * g[b])

    def add_pulls(self, moves: Array, out: Array) -> None:
        """Add bounds of gamma's forces for errors ``moves`` (m,) of constraints to those of the unknowns, ``out`` (n,).

        Nothing is added before the first factorisation, or if constraints alone determine the configuration.
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
            # the constraints determine all displacements, regardless of the forces; the multipliers then balance forces
            # and stiffness, without a part of gamma, compared with which they may be round-off
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
        """Return True: rows are never exchanged."""
        return True


class SymmetricBand(Symmetric):
    """Symmetric band."""

    def __init__(self, n: int, bw: int, multipliers: Multipliers | None = None) -> None:
        self.bw = bw
        self.values = np.zeros((n, bw + 1))
        self.target = SymBand(self.values)
        super().__init__(n, multipliers)

    def at(self, i: Index, j: Index) -> Index:
        """Return the places of entries (i, j), j <= i, among the values."""
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
    """Fronts of a branched frame, or of bodies that touch each other (``changes``)."""

    def __init__(self, fronts: Fronts, multipliers: Multipliers | None = None, changes: bool = False) -> None:
        # each matrix tells by itself what it has missed
        self.fronts = fronts._replace(missed=np.zeros(2, dtype=np.int64))
        self.values = np.zeros(int(fronts.at[-1]))
        self.target = Nested(self.values, self.fronts)
        super().__init__(len(fronts.owner), multipliers)
        # entries that only fill-in has, between multipliers and unknowns on which they do not act
        self.unused = self._unused(multipliers) if changes and multipliers is not None else np.zeros(0, dtype=np.int64)

    def _unused(self, m: Multipliers) -> Index:
        n, number = len(m.weights), np.full(len(m.weights), -1)
        number[m.multiplier] = np.arange(len(m.multiplier))
        i, j = stored_entries(self.fronts, ~m.moved)
        multiplier, other = np.maximum(number[i], number[j]), np.where(number[i] < 0, i, j)
        return self.at(i, j)[~np.isin(multiplier * n + other, m.owner * n + m.index)]

    @property
    def missed(self) -> bool:
        """Return whether a number was assembled to an entry that the matrix lacks, or that a multiplier does not use.

        The factorisation takes into account only the unknowns on which each multiplier is known to act.
        """
        return bool(self.fronts.missed[0]) or bool(self.values[self.unused].any())

    def at(self, i: Index, j: Index) -> Index:
        """Return the places of entries (i, j), j <= i, among the values."""
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
