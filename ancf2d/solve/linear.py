"""The tangent matrix: a band where the mesh is a chain, fronts or compressed rows elsewhere; factors and pivots."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..elements.shape import Array
from ..kernels.band import ldl_factor_with, ldl_solve
from ..kernels.fronts import fronts_factor, fronts_product, fronts_solve
from ..kernels.mass import band_product
from ..kernels.matrix import Band, Csr, Nested, SymBand
from ..kernels.tree import Fronts, entries
from ..model.fronts import make_fronts
from ..model.mesh import Index
from ..model.model import Model, Numbering

# a pivot below this share of the terms it is the difference of is round-off
SINGULAR = 4e-16
# beyond this multiple of an element's own width, general sparse factors are cheaper than a general band
WIDE_BAND = 4
# what constraints add to the stiffness, beside that of the unknowns that they act on
STIFF = 10.0
# stiffness beside the largest one of the matrix, both as forces over displacements, that counts as none
NO_STIFFNESS = 1e-12
# what stands for it where there is none at all, so large that round-off of forces moves nothing [N/m]
RIGID = 1e15


@dataclass(frozen=True)
class Pivots:
    """What a factorisation tells: the unknown where it broke (or -1), negative and smallest relative pivots."""

    bad: int
    negative: int
    smallest: float


class TangentMatrix(Protocol):
    """A matrix that kernels add to, and that can be factored and solved."""

    target: Any
    values: Array

    def clear(self) -> None:
        """Set every entry to zero."""
        ...

    def factor(self) -> Pivots:
        """Factor in place."""
        ...

    def solve(self, b: Array, out: Array | None = None) -> Array:
        """Return K^-1 b, which may be in ``out`` if given."""
        ...

    def product(self, values: Array, x: Array) -> Array:
        """Return A x of a symmetric matrix A with such entries, stored as this one."""
        ...

    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of a matrix with such entries, stored as this one."""
        ...

    @property
    def knows_inertia(self) -> bool:
        """Whether the negative pivots of the last factors count the negative eigenvalues of a symmetric matrix."""
        ...


@dataclass(frozen=True)
class Multipliers:
    """The multipliers of a symmetric matrix [K, G^T; G, 0] and the unknowns that each acts on, one after the other.

    ``multiplier`` (m,) are their positions, ``index`` (k,) those of the unknowns in their rows of G, ``owner`` (k,) the
    multiplier that each belongs to; ``weights`` (n,) the displacement that a unit of an unknown stands for, 0 for
    multipliers.
    """

    multiplier: Index
    index: Index
    owner: Index
    weights: Array

    def stiffness(self, g: Array, diagonal: Array) -> Array:
        """Return gamma (m,) for the rows of G with entries g (k,): as stiff as what they act on, in any units.

        Rows that act on nothing stiff (bars between bars) are as stiff as the rows that they share unknowns with.
        """
        moves = self.weights > 0.0
        sizes = np.abs(diagonal)
        sizes[moves] /= self.weights[moves] ** 2
        largest = float(sizes[moves].max(initial=0.0)) or RIGID
        weights, sizes = self.weights[self.index], np.where(sizes > NO_STIFFNESS * largest, sizes, 0.0)
        scaled, m = (g / weights) ** 2, len(self.multiplier)
        gamma: Array = np.zeros(m)
        left = np.bincount(self.owner, scaled, m) > 0.0
        while left.any():
            known = sizes[self.index]
            soft = np.divide(scaled, known, out=np.zeros_like(g), where=known > 0.0)
            given = np.bincount(self.owner, soft, m)
            found = left & (given > 0.0)
            if not found.any():
                # no stiffness anywhere near: any number does
                found = left
                given = np.bincount(self.owner, scaled / largest, m)
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
    vanishes.
    """

    values: Array
    target: Any

    def __init__(self, n: int, multipliers: Multipliers | None) -> None:
        self.scale, self.multipliers = np.zeros(n), multipliers
        if multipliers is not None:
            self.rows = self.at(multipliers.multiplier[multipliers.owner], multipliers.index)

    @abstractmethod
    def at(self, i: Index, j: Index) -> Index:
        """Return where entries (i, j), j <= i, are among the values."""

    @abstractmethod
    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of a matrix with such entries, stored as this one."""

    @abstractmethod
    def _factored(self) -> tuple[int, int, float]:
        """Factor the values in place; return what ``Pivots`` holds."""

    @abstractmethod
    def _solved(self, x: Array) -> None:
        """Solve with the factors in place."""

    def clear(self) -> None:
        """Set every entry to zero."""
        self.values.fill(0.0)

    def drop_multipliers(self, values: Array) -> None:
        """Set the rows of the multipliers to zero in a matrix with such entries, stored as this one."""
        if self.multipliers is not None:
            values.reshape(-1)[self.rows] = 0.0

    def factor(self) -> Pivots:
        """Factor in place: K = L D L^T."""
        if self.multipliers is not None:
            self._stiffen(self.multipliers)
        return Pivots(*self._factored())

    def _stiffen(self, m: Multipliers) -> None:
        """Add gamma g g^T of each multiplier, and keep gamma g."""
        flat = self.values.reshape(-1)
        g = flat[self.rows]
        self.pull = m.stiffness(g, self.diagonal(self.values).copy())[m.owner] * g
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
        np.add.at(flat, self.at(m.index[a], m.index[b]), self.pull[a] * g[b])

    def solve(self, b: Array, out: Array | None = None) -> Array:
        """Return K^-1 b, in ``out`` if given."""
        x = np.empty_like(b) if out is None else out
        x[:] = b
        m = self.multipliers
        if m is None:
            self._solved(x)
        elif 2 * len(m.multiplier) < len(x):
            self._solved_with(m, x)
        else:
            # constraints alone say where everything is: forces move nothing, not even by round-off
            moves = x[m.multiplier]
            x[m.multiplier] = 0.0
            self._solved(x)
            carried, x[:] = x[m.multiplier], 0.0
            x[m.multiplier] = moves
            self._solved_with(m, x)
            x[m.multiplier] += carried
        return x

    def _solved_with(self, m: Multipliers, x: Array) -> None:
        np.add.at(x, m.index, self.pull * x[m.multiplier][m.owner])
        self._solved(x)

    @property
    def knows_inertia(self) -> bool:
        """Return True."""
        return True


class SymmetricBand(Symmetric):
    """Symmetric band."""

    def __init__(self, n: int, bw: int, multipliers: Multipliers | None = None) -> None:
        self.values = np.zeros((n, bw + 1))
        self.target = SymBand(self.values)
        super().__init__(n, multipliers)

    def at(self, i: Index, j: Index) -> Index:
        """Return where entries (i, j), j <= i, are among the values."""
        bw = self.values.shape[1] - 1
        return i * bw + bw + j

    def _factored(self) -> tuple[int, int, float]:
        return ldl_factor_with(self.values, SINGULAR, self.scale)  # type: ignore[no-any-return]

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


class GeneralBand:
    """Band that is not symmetric (follower forces), by LAPACK's LU with row exchanges."""

    def __init__(self, n: int, bw: int) -> None:
        self.bw = bw
        self.values = np.zeros((n, 3 * bw + 1))
        self.target = Band(self.values)

    def clear(self) -> None:
        """Set every entry to zero."""
        self.values.fill(0.0)

    def factor(self) -> Pivots:
        """Factor: P K = L U."""
        from scipy.linalg.lapack import dgbtrf

        scale = np.abs(self.values[:, 2 * self.bw])
        self.lu, self.piv, info = dgbtrf(self.values.T, self.bw, self.bw)
        pivots = self.lu[2 * self.bw]
        ratio = np.abs(pivots) / np.where(scale > 0, scale, 1.0)
        bad = int(np.argmin(ratio)) if info > 0 or not ratio.min() > SINGULAR else -1
        swaps = int((self.piv != np.arange(len(self.piv))).sum())
        return Pivots(bad, (int((pivots < 0).sum()) + swaps) % 2, float(ratio.min()))

    def solve(self, b: Array, out: Array | None = None) -> Array:
        """Return K^-1 b."""
        from scipy.linalg.lapack import dgbtrs

        x, _ = dgbtrs(self.lu, self.bw, self.bw, b, self.piv)
        return x

    def product(self, values: Array, x: Array) -> Array:
        """Return A x."""
        from scipy.linalg.blas import dgbmv

        n = len(x)
        return np.asarray(dgbmv(n, n, self.bw, self.bw, 1.0, values.T[self.bw:], x))

    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of A."""
        return values[:, 2 * self.bw]

    @property
    def knows_inertia(self) -> bool:
        """Return False: rows are exchanged."""
        return False


class GeneralSparse:
    """Compressed rows with SuperLU, for wide general bands; ``exchange`` rows for large pivots, or where it must be."""

    def __init__(self, n: int, rows: Array, columns: Array, exchange: bool = False) -> None:
        from scipy.sparse import coo_matrix

        pattern = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(n, n)).tocsr()
        pattern.sum_duplicates()
        pattern.sort_indices()
        self.shape = pattern.shape
        self.values = np.zeros(pattern.nnz)
        self.indptr = pattern.indptr.astype(np.int64)
        self.indices = pattern.indices.astype(np.int64)
        self.target = Csr(self.values, self.indptr, self.indices)
        self.exchange = exchange

    def _matrix(self) -> Any:
        from scipy.sparse import csr_matrix

        return csr_matrix((self.values, self.indices, self.indptr), shape=self.shape)

    def clear(self) -> None:
        """Set every entry to zero."""
        self.values.fill(0.0)

    def factor(self) -> Pivots:
        """Factor: P_r K P_c = L U, with diagonal pivots preferred so that their signs tell the inertia."""
        from scipy.sparse.linalg import splu

        K = self._matrix().tocsc()
        scale = np.abs(K.diagonal())
        try:
            self.lu = splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=float(self.exchange),
                           options={"SymmetricMode": not self.exchange})
        except RuntimeError:
            return Pivots(int(np.argmin(scale)), 0, 0.0)
        u = self.lu.U.diagonal()
        original = scale[self.lu.perm_c.argsort()]
        ratio = np.abs(u) / np.where(original > 0, original, 1.0)
        k = int(np.argmin(ratio))
        bad = int(self.lu.perm_c.argsort()[k]) if not ratio[k] > SINGULAR else -1
        return Pivots(bad, int((u < 0).sum()), float(ratio[k]))

    def solve(self, b: Array, out: Array | None = None) -> Array:
        """Return K^-1 b."""
        return self.lu.solve(b)

    def product(self, values: Array, x: Array) -> Array:
        """Return A x."""
        from scipy.sparse import csr_matrix

        return np.asarray(csr_matrix((values, self.indices, self.indptr), shape=self.shape) @ x)

    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of A."""
        row = np.repeat(np.arange(self.shape[0]), np.diff(self.indptr))
        return values[row == self.indices]

    @property
    def knows_inertia(self) -> bool:
        """Return whether no row was exchanged."""
        return bool(np.array_equal(self.lu.perm_r, self.lu.perm_c))


def matrix_of_one(kind: type) -> TangentMatrix:
    """Return a matrix of a kind with one unknown."""
    if kind is GeneralSparse:
        return GeneralSparse(1, np.zeros(1), np.zeros(1))
    if kind is SymmetricFronts:
        return SymmetricFronts(make_fronts(np.zeros(1, dtype=np.int64), [np.zeros((1, 1), dtype=np.int64)])[0])
    return SymmetricBand(1, 0) if kind is SymmetricBand else GeneralBand(1, 0)


def pattern(model: Model) -> tuple[Array, Array]:
    """Return the row and column of every entry that an element or patch can touch."""
    num = model.numbering
    rows, columns = [], []
    sets = [m.dofs for m in model.meshes.values()] + [p.dofs for p in model.patches]
    sets += [np.append(c.dofs, num.n_q + k)[None, :] for k, c in enumerate(model.constraints)]
    for dofs in sets:
        place = num.place[dofs]
        plain = (place >= -1).all(axis=1)
        a = np.repeat(place[plain], place.shape[1], axis=1).ravel()
        b = np.tile(place[plain], (1, place.shape[1])).ravel()
        used = (a >= 0) & (b >= 0)
        rows.append(a[used])
        columns.append(b[used])
        for line in place[~plain]:
            reached = np.unique(np.concatenate([_terms(num, int(i)) for i in line]))
            rows.append(np.repeat(reached, len(reached)))
            columns.append(np.tile(reached, len(reached)))
    return np.concatenate(rows), np.concatenate(columns)


def _terms(num: Numbering, i: int) -> Index:
    if i >= -1:
        return np.array([i] if i >= 0 else [], dtype=np.int64)
    return num.index[num.indptr[-2 - i]:num.indptr[-1 - i]]


def _multipliers(model: Model) -> Multipliers | None:
    """Return the multipliers of a model in its matrix, None where it has none."""
    if not model.constraints:
        return None
    num = model.numbering
    reached = [np.unique(np.concatenate([_terms(num, int(i)) for i in num.place[c.dofs]])) for c in model.constraints]
    weights: Array = np.zeros(num.n_unknowns)
    coordinates = num.free < num.n_q
    weights[coordinates] = model.weights[num.free[coordinates]]
    return Multipliers(num.place[num.n_q:], np.concatenate(reached),
                       np.repeat(np.arange(len(reached)), [len(r) for r in reached]), weights)


def make_matrix(model: Model) -> TangentMatrix:
    """Return an empty tangent of the kind that suits the model's bandwidth and symmetry."""
    num = model.numbering
    n, bw = num.n_unknowns, min(num.half_bandwidth, max(num.n_unknowns - 1, 0))
    if model.symmetric:
        multipliers = _multipliers(model)
        return SymmetricBand(n, bw, multipliers) if num.fronts is None else SymmetricFronts(num.fronts, multipliers)
    if bw <= max(WIDE_BAND * num.largest_element, 60) or n <= 200:
        return GeneralBand(n, bw)
    return GeneralSparse(n, *pattern(model), exchange=bool(model.constraints))
