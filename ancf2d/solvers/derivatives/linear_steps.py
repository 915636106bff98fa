"""The linear equations of one step of an integrator: derivatives of its end by its start and its residuals.

Newmark's family and Radau IIA determine z_i at s stages from residuals R_i = 0, with rates and second rates that are
linear in them, v_i = V z + v_0i and a_i = A z + a_0i. Changes of the start and of the residuals change z by

(K_i + (C_i + alpha M) V + M A) dz = -(dR_i + (C_i + alpha M) dv_0i + M da_0i).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ...elements.shape import Array
from ...kernels.lowlevel.records import Record
from ...kernels.matrices.layout import entries
from ...kernels.motion import step_equations
from ...kernels.motion.newmark import Newmark
from ...kernels.motion.radau import Radau
from ...model.mesh import Index
from ...model.model import Model
from ..linear import pattern

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# half bandwidth up to which the matrix of a step is factored as a band
BAND = 160


@dataclass
class Change:
    """Changes of the start of a step: of z, v and a (n, k), and of the values stored by the method (n, k)."""

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
        """Return a change of zero."""
        return cls(*(np.zeros((n, k)) for _ in range(4)))


@dataclass
class Stages:
    """States of the stages of a step: t (s,); z, v, a (s, n), or changes of these (s, n, k)."""

    t: Array
    z: Array
    v: Array
    a: Array


class Method(Protocol):
    """An integrator's stages, whose rates are linear in their positions."""

    stages: int

    def stages_of_step(self, own: Any, start: Array, t: float, h: float) -> Stages:
        """Return the stages of the last step, which started from positions ``start``."""
        ...

    def rates(self, h: float) -> tuple[Array, Array]:
        """Return V and A (s, s)."""
        ...

    def by_start(self, h: float) -> Array:
        """Return the coefficients (2, s, 4) of v_0 and a_0 of the stages for changes of the start's z, v, a and own."""
        ...

    def stored(self, h: float) -> Array:
        """Return the coefficients (5,) of the stored values at the end, for changes of z there and of the start."""
        ...

    def dense(self, start: Change, found: Stages, h: float, free: Array) -> Array:
        """Return the change (rows, n, k) of the interpolation's coefficients; ``free`` (n,): 0 for multipliers."""
        ...

    def dense_back(self, made: Array, h: float, free: Array) -> tuple[Change, Stages]:
        """Return the derivatives of goals by start and stages, from those by the result of ``dense``."""
        ...


class NewmarkStages:
    """Newmark's family: one stage, the end. ``Change.own`` is that of the algorithmic accelerations."""

    stages = 1

    def __init__(self, own: Newmark) -> None:
        self.am, self.af, self.beta, self.gamma = own.am, own.af, own.beta, own.gamma

    def stages_of_step(self, own: Newmark, start: Array, t: float, h: float) -> Stages:
        """Return the end of the step."""
        end = own.end
        return Stages(np.array([t + h]), *(np.array(x)[None] for x in (end.z, end.v, end.a)))

    def rates(self, h: float) -> tuple[Array, Array]:
        """Return gamma/(beta h), and the factor of the accelerations."""
        f = (1.0 - self.am) / (1.0 - self.af) / (self.beta * h * h)
        return np.array([[self.gamma / (self.beta * h)]]), np.array([[f]])

    def by_start(self, h: float) -> Array:
        """Return the coefficients of the rates at the end for fixed positions there."""
        V, A = (float(x[0, 0]) for x in self.rates(h))
        far, f = h * h * (0.5 - self.beta), 1.0 / (1.0 - self.af)
        v = [-V, 1.0 - V * h, 0.0, h * (1.0 - self.gamma) - V * far]
        return np.array([[v], [[-A, -A * h, -self.af * f, self.am * f - A * far]]])

    def stored(self, h: float) -> Array:
        """Return the coefficients of the algorithmic acceleration at the end."""
        f = 1.0 / (self.beta * h * h)
        return np.array([f, -f, -h * f, 0.0, -(0.5 - self.beta) / self.beta])

    def dense(self, start: Change, found: Stages, h: float, free: Array) -> Array:
        """Return the changes of Hermite's cubic."""
        return np.array([h * start.v, found.z[0] - start.z, h * found.v[0]])

    def dense_back(self, made: Array, h: float, free: Array) -> tuple[Change, Stages]:
        """Return the derivatives of goals by start and end."""
        none = np.zeros_like(made[:1])
        return (Change(-made[1], h * made[0], none[0], none[0]),
                Stages(np.zeros(1), made[1:2], h * made[2:3], none))


class RadauStages:
    """Radau IIA."""

    def __init__(self, own: Radau) -> None:
        self.c, self.W, self.stages = own.c, own.W, len(own.c)
        self.W2, self.ones = own.W @ own.W, own.W.sum(axis=1)
        s = self.stages
        # derivatives at 0 and at all nodes of the polynomials through the nodes, for multipliers
        self.slopes = np.zeros((s + 1, s))
        for j in range(s):
            others = np.delete(self.c, j)
            self.slopes[0, j] = np.prod(others / (others - self.c[j])) / self.c[j]
        self.slopes[1:] = self.W

    def stages_of_step(self, own: Radau, start: Array, t: float, h: float) -> Stages:
        """Return the stages."""
        moved = start.copy()
        moved[own.multipliers] = 0.0
        return Stages(t + self.c * h, own.X + moved, np.array(own.V), np.array(own.A))

    def rates(self, h: float) -> tuple[Array, Array]:
        """Return W/h and W^2/h^2."""
        return self.W / h, self.W2 / (h * h)

    def by_start(self, h: float) -> Array:
        """Return the coefficients of the rates at the stages for fixed positions there."""
        out = np.zeros((2, self.stages, 4))
        out[0, :, 0] = out[1, :, 1] = -self.ones / h
        out[1, :, 0] = -self.W2.sum(axis=1) / (h * h)
        return out

    def stored(self, h: float) -> Array:
        """Return the coefficients of the stored values, which are those of the start."""
        return np.array([0.0, 0.0, 0.0, 0.0, 1.0])

    def dense(self, start: Change, found: Stages, h: float, free: Array) -> Array:
        """Return the changes of the rates at the start and the stages; for multipliers those of their polynomial."""
        out = h * np.concatenate([start.v[None], found.v])
        held = free == 0.0
        moved = found.z[:, held] - start.z[None, held]
        out[:, held] = np.einsum("ij,jnk->ink", self.slopes, moved)
        return out

    def dense_back(self, made: Array, h: float, free: Array) -> tuple[Change, Stages]:
        """Return the derivatives of goals by start and stages."""
        held, none = free == 0.0, np.zeros_like(made[1:])
        moved = np.where(held[:, None], np.einsum("ij,ink->jnk", self.slopes, made), 0.0)
        rates = np.where(held[:, None], 0.0, h * made)
        start = Change(-moved.sum(axis=0), rates[0], none[0], none[0])
        return start, Stages(np.zeros(self.stages), moved, rates[1:], none)


# by the type of an integrator's tuple of arrays
METHODS: dict[type, type[Any]] = {Newmark: NewmarkStages, Radau: RadauStages}


def method_of(own: Record) -> Method:
    """Return the stages of an integrator from its own record."""
    found: Method = METHODS[type(own.values)](own.values)
    return found


class Entries:
    """The entries of stored symmetric matrices as sparse matrices, and the layout of matrices of steps of s stages."""

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
        """Return the sparse matrix with these entries (nnz,)."""
        from scipy.sparse import csr_array

        return csr_array((data, self.columns, self.indptr), shape=(self.n, self.n))

    @cached_property
    def places(self) -> tuple[int, Index, Index]:
        """Return half bandwidth, rows and columns (s, s, nnz) of all blocks; the stages of an unknown are adjacent."""
        s = self.s
        stage = np.arange(s)
        i = self.rows * s + stage[:, None, None]
        j = self.columns * s + stage[None, :, None]
        i, j = np.broadcast_arrays(i, j)
        return int(np.abs(i - j).max(initial=0)), i, j


class Equations:
    """The factored equations of several steps of lengths h (steps,), stored as bands if they are narrow.

    K and C + alpha M (steps s, nnz) are those of the stages, M (nnz,) the mass; ``rubs``: whether C + alpha M is not
    zero. Raises ArithmeticError with the number of the first step whose matrix is singular.
    """

    def __init__(self, entries: Entries, method: Method, h: Array, K: Array, C: Array, M: Array, rubs: bool) -> None:
        self.entries, self.rubs, self.K, self.C, self.M = entries, rubs, K, np.ascontiguousarray(C), M
        self.rates, self.by_start, self.stored = (np.array([f(one) for one in h.tolist()]) for f in
                                                  (method.rates, method.by_start, method.stored))
        self.bw, n = entries.places[0], entries.n * entries.s
        self.shape = entries.rows, entries.columns, entries.free
        if self.bw > BAND:
            self.sparse = [self._sparse(k) for k in range(len(h))]
            return
        self.lu, self.pivots = np.zeros((len(h), n, 3 * self.bw + 1)), np.zeros((len(h), 2, n), dtype=np.int64)
        done = step_equations.factor(K, self.C, M, *self.shape, self.rates, self.bw, self.lu, self.pivots)
        if done < len(h):
            raise ArithmeticError(done)

    def _sparse(self, k: int) -> Any:
        """Return the factors of step k."""
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        s, _, i, j = self.entries.s, *self.entries.places
        mine, (V, A), stage = slice(s * k, s * k + s), self.rates[k], np.arange(s)
        blocks = (V[:, :, None] * self.C[mine, None] + A[:, :, None] * self.M) * self.entries.free[self.entries.columns]
        blocks[stage, stage] += self.K[mine]
        try:
            return splu(csc_array((blocks.ravel(), (i.ravel(), j.ravel())), shape=(s * self.entries.n,) * 2))
        except RuntimeError as error:
            raise ArithmeticError(k) from error

    def follow(self, dR: Array, start: Change) -> tuple[Stages, Array]:
        """Return the changes of stages (steps s, n, k), and of all steps' starts and the last end (steps + 1, 4, n, k).

        They are caused by changes dR (steps s, n, k) of the residuals and by that of the first start.
        """
        n, s, columns = self.entries.n, self.entries.s, dR.shape[2]
        out = Stages(np.zeros(0), *(np.zeros(dR.shape) for _ in range(3)))
        ends = np.zeros((len(self.rates) + 1, 4, n, columns))
        ends[0] = start.z, start.v, start.a, start.own
        if self.bw <= BAND:
            step_equations.forward(self.lu, self.pivots, self.bw, self.C, self.M, *self.shape, self.rubs, self.rates,
                                   self.by_start, self.stored, np.ascontiguousarray(dR), np.zeros((n * s, columns)),
                                   out.z, out.v, out.a, ends)
            return out, ends
        free, M = self.entries.free[:, None], self.entries.matrix(self.M)
        for k, lu in enumerate(self.sparse):
            mine = slice(s * k, s * k + s)
            v0, a0 = free * np.tensordot(self.by_start[k], ends[k], 1)
            b = -dR[mine]
            for i in range(s):
                b[i] -= M @ a0[i]
                if self.rubs:
                    b[i] -= self.entries.matrix(self.C[s * k + i]) @ v0[i]
            z = lu.solve(b.transpose(1, 0, 2).reshape(n * s, -1)).reshape(n, s, -1).transpose(1, 0, 2)
            v, a = np.tensordot(self.rates[k], z, 1) * free + np.array([v0, a0])
            out.z[mine], out.v[mine], out.a[mine] = z, v, a
            ends[k + 1] = z[-1], v[-1], a[-1], np.tensordot(self.stored[k], np.concatenate([z[-1:], ends[k]]), 1)
        return out, ends

    def back(self, stages: Stages, starts: Array, end: Change) -> tuple[Array, Change]:
        """Return lam (steps s, n, k), with goals changing by -lam dR, and the derivatives of goals by the first start.

        ``stages`` (steps s, n, k), ``starts`` (steps, 4, n, k) and ``end`` are the direct derivatives of the goals; the
        first two are overwritten.
        """
        lam: Array = np.zeros(stages.z.shape)
        last = np.array([end.z, end.v, end.a, end.own])
        if self.bw <= BAND:
            step_equations.backward(self.lu, self.pivots, self.bw, self.C, self.M, *self.shape, self.rubs, self.rates,
                                    self.by_start, self.stored, stages.z, stages.v, stages.a,
                                    np.zeros((self.entries.n * self.entries.s, lam.shape[2])), lam, starts, last)
            return lam, Change(*last)
        s, n = self.entries.s, self.entries.n
        free, M = self.entries.free[:, None], self.entries.matrix(self.M)
        for k in range(len(self.sparse) - 1, -1, -1):
            mine = slice(s * k, s * k + s)
            zb, vb, ab = stages.z[mine], stages.v[mine], stages.a[mine]
            zb[-1] += last[0] + self.stored[k, 0] * last[3]
            vb[-1] += last[1]
            ab[-1] += last[2]
            V, A = np.asarray(self.rates)[k]
            b = zb + free * (np.tensordot(V.T, vb, 1) + np.tensordot(A.T, ab, 1))
            x = self.sparse[k].solve(b.transpose(1, 0, 2).reshape(n * s, -1), trans="T")
            lam[mine] = x.reshape(n, s, -1).transpose(1, 0, 2)
            for i in range(s):
                ab[i] -= M @ lam[s * k + i]
                if self.rubs:
                    vb[i] -= self.entries.matrix(self.C[s * k + i]) @ lam[s * k + i]
            v_by, a_by = self.by_start[k]
            of = [free * (np.tensordot(v_by[:, j], vb, 1) + np.tensordot(a_by[:, j], ab, 1))
                  + self.stored[k, j + 1] * last[3] for j in range(4)]
            last = starts[k] + np.array(of)
        return lam, Change(*last)
