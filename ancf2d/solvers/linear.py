"""Tangent and mass matrices of the unknowns: bands for chains, fronts or compressed rows for others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..elements.shape import Array
from ..interactions.inertia import mass_block, mass_terms
from ..kernels.matrices.layout import Places, stored_entries
from ..kernels.matrices.matrix import Band, Csr, scatter_classes
from ..model.classes import mass_matrix
from ..model.fronts import make_fronts, meeting
from ..model.mesh import Index, joined
from ..model.model import Model
from ..model.numbering import Numbering
from .ldl import SINGULAR, Multipliers, Pivots, SymmetricBand, SymmetricFronts
from .state import State

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


# a band wider than this many element widths costs more than general sparse factors
WIDE_BAND = 4
# a diagonal entry is the pivot if it is at least this share of the largest entry in its column
PIVOT = 0.1


class TangentMatrix(Protocol):
    """A matrix that kernels assemble, with the ``places`` of coordinates, and that can be factored and solved."""

    target: Any
    places: Places
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
        """Return A x for a symmetric matrix A with the given values, stored as this one."""
        ...

    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of a matrix with the given values, stored as this one."""
        ...

    def read(self, i: Index, j: Index) -> Array:
        """Return the entries (i, j) of the assembled matrix, before it is factored."""
        ...

    @property
    def knows_inertia(self) -> bool:
        """Return whether the negative pivots of the last factors count the negative eigenvalues, if symmetric."""
        ...


class GeneralBand:
    """Unsymmetric band (follower forces), by LAPACK's LU with row exchanges."""

    places: Places

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
        from scipy.sparse import dia_array

        diagonals = dia_array((values.T[self.bw:], np.arange(self.bw, -self.bw - 1, -1)), shape=(len(x), len(x)))
        return np.asarray(diagonals @ x)

    def diagonal(self, values: Array) -> Array:
        """Return the diagonal of A."""
        return values[:, 2 * self.bw]

    def read(self, i: Index, j: Index) -> Array:
        """Return the entries (i, j) of the assembled matrix, before it is factored."""
        return self.values[j, 2 * self.bw + i - j]

    @property
    def knows_inertia(self) -> bool:
        """Return False: rows are exchanged."""
        return False


class GeneralSparse:
    """Compressed rows with SuperLU, for wide unsymmetric bands; rows are exchanged with ``exchange`` or if needed."""

    places: Places

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
        """Factor: P_r K P_c = L U; without row exchanges, the signs of the pivots give the inertia."""
        from scipy.sparse.linalg import splu

        K = self._matrix().tocsc()
        # of all bodies that may touch each other, only few elements do
        K.eliminate_zeros()
        scale = np.abs(K.diagonal())
        # an ordering for K + K^T gives much fill-in if rows are exchanged
        order, threshold = ("COLAMD", PIVOT) if self.exchange else ("MMD_AT_PLUS_A", 0.0)
        try:
            self.lu = splu(K, permc_spec=order, diag_pivot_thresh=threshold,
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

    def read(self, i: Index, j: Index) -> Array:
        """Return the entries (i, j) of the matrix as it was assembled."""
        return np.asarray(self._matrix()[i, j]).ravel()

    @property
    def knows_inertia(self) -> bool:
        """Return whether no row was exchanged."""
        return bool(np.array_equal(self.lu.perm_r, self.lu.perm_c))


def matrix_of_one(kind: type) -> TangentMatrix:
    """Return a matrix of the given kind with one unknown."""
    if kind is GeneralSparse:
        return GeneralSparse(1, np.zeros(1), np.zeros(1))
    if kind is SymmetricFronts:
        return SymmetricFronts(make_fronts(np.zeros(1, dtype=np.int64), [np.zeros((1, 1), dtype=np.int64)]))
    return SymmetricBand(1, 0) if kind is SymmetricBand else GeneralBand(1, 0)


def pattern(model: Model) -> tuple[Array, Array]:
    """Return the row and column of every entry to which an element or patch can contribute."""
    num = model.numbering
    fronts = num.complete.fronts
    if num.couplings is not None and fronts is not None:
        low, high = stored_entries(fronts)
        return np.append(low, high), np.append(high, low)
    sets = [m.dofs for m in model.meshes.values()] + [p.dofs for p in model.patches]
    sets += [np.append(c.dofs, num.n_q + k)[None, :] for k, c in enumerate(model.constraints)]
    meets = []
    for dofs in sets:
        place = num.place[dofs]
        plain = (place >= -1).all(axis=1)
        meets += [place[plain], *(np.unique(np.concatenate([_terms(num, int(i)) for i in line]))[None, :]
                                  for line in place[~plain])]
    rows, columns = meeting(num.n_unknowns, meets).nonzero()
    return rows, columns


def _terms(num: Numbering, i: int) -> Index:
    if i >= -1:
        return np.array([i] if i >= 0 else [], dtype=np.int64)
    return num.index[num.indptr[-2 - i]:num.indptr[-1 - i]]


def _multipliers(model: Model, num: Numbering) -> Multipliers | None:
    """Return the multipliers of a model in its matrix, or None if it has none."""
    if not model.constraints:
        return None
    weights: Array = np.zeros(num.n_unknowns)
    coordinates = num.free < num.n_q
    weights[coordinates] = model.weights[num.free[coordinates]]
    # all dead loads at the last load factor or time
    dead = model.external(getattr(model.case.solver, "t_end", 1.0))[:model.n_q]
    return Multipliers(num.place[num.n_q:], np.concatenate(num.acts_on),
                       np.repeat(np.arange(len(num.acts_on)), [len(r) for r in num.acts_on]), weights,
                       bool(model.contacts), float(np.abs(dead / model.weights).sum()) / model.extent)


def make_matrix(model: Model, num: Numbering | None = None) -> TangentMatrix:
    """Return an empty tangent matrix of the kind that suits the model's bandwidth and symmetry.

    ``num`` is the numbering of the model, by default for all elements of bodies that may touch each other.
    """
    num = model.numbering.complete if num is None else num
    matrix = _empty_matrix(model, num)
    matrix.places = num.rows
    return matrix


def _empty_matrix(model: Model, num: Numbering) -> TangentMatrix:
    n, bw = num.n_unknowns, min(num.half_bandwidth, max(num.n_unknowns - 1, 0))
    if model.symmetric or n == 0:  # LAPACK takes no empty band
        multipliers = _multipliers(model, num)
        if num.fronts is not None:
            return SymmetricFronts(num.fronts, multipliers, num.couplings is not None)
        return SymmetricBand(n, bw, multipliers)
    if bw <= max(WIDE_BAND * num.largest_element, 60) or n <= 200:
        return GeneralBand(n, bw)
    return GeneralSparse(n, *pattern(model), exchange=bool(model.constraints))


def point_masses(model: Model, e: Array | None = None) -> Iterator[tuple[Index, Array]]:
    """Yield (coordinates (n,), matrix (n, n)) of each point mass; see ``mass_terms`` for ``e``."""
    for item in model.case.resting_masses:
        yield mass_block(mass_terms(item, model.point(item.at), e))


def assemble_mass(model: Model, matrix: TangentMatrix, e: Array | None = None) -> None:
    """Fill ``matrix`` with T^T M T, M = int rho S^T S dV plus the point masses; rows of multipliers are zero.

    With ``e`` (n_q,) it is that of small motions about these coordinates. As shape functions are scalar, an element's M
    is the same in every frame, so each class has one.
    """
    places = matrix.places
    matrix.clear()
    for mesh in model.meshes.values():
        Ms = np.array([c.mass for c in mesh.classes])
        scatter_classes(matrix.target, Ms, np.ascontiguousarray(mesh.cls, dtype=np.int64),
                        np.ascontiguousarray(mesh.dofs), places)
    for dofs, M in fluid_masses(model):
        scatter_classes(matrix.target, M[None], np.zeros(len(dofs), dtype=np.int64), np.ascontiguousarray(dofs),
                        places)
    for coords, M in point_masses(model, e):
        scatter_classes(matrix.target, M[None], np.zeros(1, dtype=np.int64), coords[None, :].astype(np.int64), places)


def full_mass(model: Model, e: Array | None = None) -> csr_matrix:
    """Return the constant mass matrix M (n_q, n_q) of all nodal coordinates, point masses included.

    With ``e`` (n_q,) it is that of small motions about these coordinates.
    """
    masses = ((coords[None, :], M) for coords, M in point_masses(model, e))
    return scattered([*_element_masses(model), *masses], model.n_q)


def coriolis_matrix(model: Model, omega: float) -> csr_matrix:
    """Return 2 omega G (n_q, n_q), G = int rho S^T J S dV with J the quarter turn: the Coriolis forces in a frame that
    rotates with ``omega``.

    Rotations of sections are the same in both frames: theta has no Coriolis terms.
    """
    blocks = []
    for mesh in model.meshes.values():
        nc = mesh.plan.element.components
        for k, cls in enumerate(mesh.classes):
            M = mass_matrix(cls.sampler)
            G = np.zeros_like(M)
            G[:, 0::nc], G[:, 1::nc] = M[:, 1::nc], -M[:, 0::nc]
            blocks.append((mesh.dofs[mesh.cls == k], 2.0 * omega * G))
    terms = (term for m in model.case.resting_masses for term in mass_terms(m, model.point(m.at)))
    for term in (term for term in terms if len(term.columns) == 2):
        (cx, wx), (cy, wy) = term.columns
        block = 2.0 * omega * term.inertia * np.outer(np.append(0.0 * wx, wy), np.append(wx, 0.0 * wy))
        blocks.append((np.append(cx, cy)[None, :], block - block.T))
    return scattered(blocks, model.n_q)


def fluid_masses(model: Model) -> Iterator[tuple[Index, Array]]:
    """Yield coordinates (m, n) and matrix (n, n) of the fluids that bodies carry."""
    for what in model.case.flows:
        yield from what.masses(model.meshes[what.on])


def _element_masses(model: Model) -> Iterator[tuple[Index, Array]]:
    yield from fluid_masses(model)
    for mesh in model.meshes.values():
        for k, cls in enumerate(mesh.classes):
            yield mesh.dofs[mesh.cls == k], cls.mass


def scattered(blocks: Iterable[tuple[Index, Array]], n: int) -> csr_matrix:
    """Return the sum (n, n) of blocks: coordinates (m, k) and matrices (m, k, k), or one matrix for all."""
    from scipy.sparse import coo_matrix, csr_matrix

    # the numbers that a sparse matrix stores: wider ones would be copied
    index = np.int32 if n < 2**31 else np.int64
    rows, columns, values = [], [], []
    for dofs, M in blocks:
        m, k = dofs.shape
        short = dofs.astype(index)
        rows.append(np.repeat(short, k, axis=1).ravel())
        columns.append(np.tile(short, (1, k)).ravel())
        values.append(np.broadcast_to(M, (m, k, k)).ravel())
    if not values:
        return csr_matrix((n, n))
    out = coo_matrix((joined(values), (joined(rows), joined(columns))), shape=(n, n)).tocsr()
    out.eliminate_zeros()
    return out


def unknowns_to_coordinates(model: Model) -> csr_matrix:
    """Return T (n_q, n) from unknowns to nodal coordinates, without prescribed motions."""
    from scipy.sparse import csr_matrix

    num = model.numbering
    own = num.free < num.n_q
    rows = np.concatenate([num.free[own], np.repeat(num.dependent, np.diff(num.indptr))])
    columns = np.concatenate([np.flatnonzero(own), num.index])
    values = np.concatenate([np.ones(own.sum()), num.value])
    return csr_matrix((values, (rows, columns)), shape=(num.n_q, num.n_unknowns))


def inertia_rates(model: Model, state: State) -> Array | None:
    """Return a + alpha v (n_q,): M times it are the inertia forces plus Rayleigh's alpha; None in statics."""
    if state.a is None:
        return None
    a, damping = state.a[:model.n_q], model.case.damping
    if damping is None or state.v is None:
        return a
    return a + damping.rayleigh.alpha * state.v[:model.n_q]
