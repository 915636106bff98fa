"""The linear equations of one step of an integrator: how its end changes with its start, and with its residuals.

Newmark's family and Radau IIA determine z_i at s stages from residuals R_i = 0, with rates and second rates that are
linear in them, v_i = V z + v_0i and a_i = A z + a_0i: changes of the start and of the residuals change z by

(K_i + (C_i + alpha M) V + M A) dz = -(dR_i + (C_i + alpha M) dv_0i + M da_0i).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..elements.shape import Array
from ..kernels.lowlevel.records import Record
from ..kernels.newmark import Newmark
from ..kernels.radau import Radau
from ..kernels.tree import entries
from ..model.mesh import Index
from ..model.model import Model
from .linear import pattern

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# half bandwidth up to which the matrix of a step is factored as a band
BAND = 160


@dataclass
class Change:
    """Changes of what a step begins with: of z, v and a (n, k), and of what a method keeps beside (n, k)."""

    z: Array
    v: Array
    a: Array
    own: Array

    def plus(self, other: Change) -> Change:
        """Return the sum of two changes."""
        return Change(self.z + other.z, self.v + other.v, self.a + other.a, self.own + other.own)

    def only(self, columns: Any) -> Change:
        """Return some of the columns."""
        return Change(self.z[:, columns], self.v[:, columns], self.a[:, columns], self.own[:, columns])

    @classmethod
    def none(cls, n: int, k: int) -> Change:
        """Return no change."""
        return cls(*(np.zeros((n, k)) for _ in range(4)))


@dataclass
class Stages:
    """States of the stages of a step: t (s,); z, v, a (s, n), or changes of these (s, n, k)."""

    t: Array
    z: Array
    v: Array
    a: Array


class Method(Protocol):
    """The stages of an integrator, linear in their positions."""

    stages: int

    def taken(self, own: Any, start: Array, t: float, h: float) -> Stages:
        """Return the stages of the step that was made from positions ``start`` last."""
        ...

    def rates(self, h: float) -> tuple[Array, Array]:
        """Return V and A (s, s)."""
        ...

    def constants(self, start: Change, h: float) -> tuple[Array, Array]:
        """Return what a change of the start adds to the rates and second rates of the stages (s, n, k)."""
        ...

    def end(self, start: Change, found: Stages, h: float) -> Change:
        """Return the change of the end."""
        ...

    def dense(self, start: Change, found: Stages, h: float, free: Array) -> Array:
        """Return the change (rows, n, k) of what the interpolation is made of; ``free`` (n,): 0 of multipliers."""
        ...


class NewmarkStages:
    """Newmark's family: one stage, the end. ``Change.own`` is that of the algorithmic accelerations."""

    stages = 1

    def __init__(self, own: Newmark) -> None:
        self.am, self.af, self.beta, self.gamma = own.am, own.af, own.beta, own.gamma

    def taken(self, own: Newmark, start: Array, t: float, h: float) -> Stages:
        """Return the end of the step."""
        end = own.end
        return Stages(np.array([t + h]), *(np.array(x)[None] for x in (end.z, end.v, end.a)))

    def rates(self, h: float) -> tuple[Array, Array]:
        """Return gamma/(beta h), and the factor of the accelerations."""
        f = (1.0 - self.am) / (1.0 - self.af) / (self.beta * h * h)
        return np.array([[self.gamma / (self.beta * h)]]), np.array([[f]])

    def constants(self, start: Change, h: float) -> tuple[Array, Array]:
        """Return what is left of the rates where the end does not move."""
        V, A = self.rates(h)
        z = start.z + h * start.v + h * h * (0.5 - self.beta) * start.own
        v = start.v + h * (1.0 - self.gamma) * start.own
        a = (self.am * start.own - self.af * start.a) / (1.0 - self.af)
        return (v - V[0, 0] * z)[None], (a - A[0, 0] * z)[None]

    def end(self, start: Change, found: Stages, h: float) -> Change:
        """Return the change of the end; the algorithmic acceleration is what moves it there."""
        z, v, a = found.z[0], found.v[0], found.a[0]
        before = start.z + h * start.v + h * h * (0.5 - self.beta) * start.own
        return Change(z, v, a, (z - before) / (self.beta * h * h))

    def dense(self, start: Change, found: Stages, h: float, free: Array) -> Array:
        """Return the changes of Hermite's cubic."""
        return np.array([h * start.v, found.z[0] - start.z, h * found.v[0]])


class RadauStages:
    """Radau IIA."""

    def __init__(self, own: Radau) -> None:
        self.c, self.W, self.stages = own.c, own.W, len(own.c)
        self.W2, self.ones = own.W @ own.W, own.W.sum(axis=1)
        s = self.stages
        # derivatives at 0 and at all nodes of the polynomials through these, of multipliers
        self.slopes = np.zeros((s + 1, s))
        for j in range(s):
            others = np.delete(self.c, j)
            self.slopes[0, j] = np.prod(others / (others - self.c[j])) / self.c[j]
        self.slopes[1:] = self.W

    def taken(self, own: Radau, start: Array, t: float, h: float) -> Stages:
        """Return the stages."""
        moved = start.copy()
        moved[own.multipliers] = 0.0
        return Stages(t + self.c * h, own.X + moved, np.array(own.V), np.array(own.A))

    def rates(self, h: float) -> tuple[Array, Array]:
        """Return W/h and W^2/h^2."""
        return self.W / h, self.W2 / (h * h)

    def constants(self, start: Change, h: float) -> tuple[Array, Array]:
        """Return what is left of the rates where no stage moves."""
        one, two = self.ones[:, None, None], (self.W2.sum(axis=1))[:, None, None]
        return -one * start.z / h, -two * start.z / (h * h) - one * start.v / h

    def end(self, start: Change, found: Stages, h: float) -> Change:
        """Return the change of the last stage."""
        return Change(found.z[-1], found.v[-1], found.a[-1], start.own)

    def dense(self, start: Change, found: Stages, h: float, free: Array) -> Array:
        """Return the changes of the rates at the start and the stages; of multipliers by their polynomial."""
        out = h * np.concatenate([start.v[None], found.v])
        held = free == 0.0
        moved = found.z[:, held] - start.z[None, held]
        out[:, held] = np.einsum("ij,jnk->ink", self.slopes, moved)
        return out


# by the kind of their own tuples
METHODS: dict[type, type[Any]] = {Newmark: NewmarkStages, Radau: RadauStages}


def method_of(own: Record) -> Method:
    """Return the stages of an integrator by its own record."""
    found: Method = METHODS[type(own.values)](own.values)
    return found


class Entries:
    """The entries of symmetric matrices of a model in motion as sparse ones, and the matrices of steps of s stages."""

    def __init__(self, model: Model, p: Record, stages: int) -> None:
        n, self.s = len(p.coordinate), stages
        i, j = (np.asarray(x, dtype=np.int64) for x in pattern(model))
        i, j = np.append(i, np.arange(n)), np.append(j, np.arange(n))
        both = np.unique(np.maximum(i, j) * n + np.minimum(i, j))
        low_i, low_j = both // n, both % n
        at = low_i * p.width + p.width - 1 + low_j - low_i if p.width else entries(p.fronts, low_i, low_j)
        below = low_i > low_j
        rows, columns = np.append(low_i, low_j[below]), np.append(low_j, low_i[below])
        order = np.lexsort((columns, rows))
        # row by row
        self.n, self.rows, self.columns = n, rows[order], columns[order]
        self.at = np.append(at, at[below])[order]
        self.indptr = np.searchsorted(self.rows, np.arange(n + 1))
        self.free = np.array(p.coordinate)

    def read(self, A: Array) -> Array:
        """Return the entries (..., nnz) of stored matrices (..., entries), row by row."""
        return np.asarray(A[..., self.at])

    def matrix(self, data: Array) -> csr_array:
        """Return the sparse matrix of its entries (nnz,)."""
        from scipy.sparse import csr_array

        return csr_array((data, self.columns, self.indptr), shape=(self.n, self.n))

    @cached_property
    def _places(self) -> tuple[int, Index, Index]:
        """Return half bandwidth, rows and columns (s, s, nnz) of all blocks, stages of an unknown side by side."""
        s = self.s
        stage = np.arange(s)
        i = self.rows * s + stage[:, None, None]
        j = self.columns * s + stage[None, :, None]
        i, j = np.broadcast_arrays(i, j)
        return int(np.abs(i - j).max(initial=0)), i, j

    def factors(self, K: Array, damping: Array, M: Array, V: Array, A: Array) -> StepFactors:
        """Return the factors of a step's matrix from entries K, C + alpha M (s, nnz) and M (nnz,)."""
        free = self.free[self.columns]
        blocks = (V[:, :, None] * damping[:, None] + A[:, :, None] * M) * free
        stage = np.arange(self.s)
        blocks[stage, stage] += K
        return StepFactors(self.n, self.s, blocks, *self._places)


class StepFactors:
    """The factors of a step's matrix, as a band where it is narrow. Raises ArithmeticError where it is singular."""

    def __init__(self, n: int, s: int, blocks: Array, bw: int, i: Index, j: Index) -> None:
        self.n, self.s, self.bw = n, s, bw
        if bw <= BAND:
            from scipy.linalg import lapack

            band = np.zeros((n * s, 3 * bw + 1))
            band[j, 2 * bw + i - j] = blocks
            self.lu, self.rows, info = lapack.dgbtrf(band.T, bw, bw, overwrite_ab=True)
            if info != 0:
                raise ArithmeticError
        else:
            from scipy.sparse import csc_array
            from scipy.sparse.linalg import splu

            A = csc_array((blocks.ravel(), (i.ravel(), j.ravel())), shape=(n * s, n * s))
            try:
                self.sparse = splu(A)
            except RuntimeError as error:
                raise ArithmeticError from error

    def solve(self, b: Array) -> Array:
        """Return the stages (s, n, k) of right-hand sides (s, n, k)."""
        flat = np.ascontiguousarray(b.transpose(1, 0, 2)).reshape(self.n * self.s, -1)
        if self.bw <= BAND:
            from scipy.linalg import lapack

            x = lapack.dgbtrs(self.lu, self.bw, self.bw, flat, self.rows)[0]
        else:
            x = self.sparse.solve(flat)
        return np.asarray(x).reshape(self.n, self.s, -1).transpose(1, 0, 2)
