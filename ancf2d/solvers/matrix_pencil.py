"""A pair of symmetric matrices (K, B) of a model at a state: shifted factorisations, products, inertia."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..elements.shape import Array
from ..kernels.elements import tangent_action
from ..model.model import Model
from .ldl import Pivots
from .linear import make_matrix
from .mass import assemble_mass
from .system import System


class Pencil:
    """Tangent K of a model at (d, t) beside another matrix B of its unknowns, stored alike.

    ``loads`` tells whether loads that turn or move add their stiffness; ``turned`` (bodies,) the whole turns at d. The
    model's tangent must be symmetric.
    """

    def __init__(self, model: Model, d: Array, t: float, loads: bool, turned: Array | None = None) -> None:
        self.model, self.d, self.t, self.loads = model, d, t, loads
        self.system = System(model)
        self.system.count_from((d, model.turns.from_reference(d) if turned is None else turned))
        self.balance = self.system.assemble(d, t, load_stiffness=loads)
        self.matrix = self.system.matrix
        self.K: Array = self.matrix.target.values.copy()
        self.B: Array = self.K
        self.n = model.numbering.n_unknowns
        self.multipliers = model.numbering.n_multipliers

    def with_mass(self, e: Array | None = None) -> Pencil:
        """Return this pencil with B = M, that of small motion about coordinates ``e`` where they are given."""
        mass = make_matrix(self.model)
        assemble_mass(self.model, mass, e)
        self.B = mass.target.values
        return self

    def factor(self, shift: float) -> Pivots:
        """Factor K - shift B."""
        values = self.matrix.target.values
        if shift == 0.0:
            values[...] = self.K
        else:
            np.multiply(self.B, -shift, out=values)
            values += self.K
        return self.matrix.factor()

    def negative(self, pivots: Pivots) -> int | None:
        """Return how many negative eigenvalues K - shift B has (Sylvester), those of the multipliers not counted.

        None where it is singular or pivoting hides the inertia.
        """
        if pivots.bad >= 0:
            return None
        if not self.matrix.knows_inertia:
            return None
        return pivots.negative - self.multipliers

    def solve(self, b: Array) -> Array:
        """Return (K - shift B)^-1 b of the last shift."""
        return self.matrix.solve(b)

    def other(self, x: Array) -> Array:
        """Return B x."""
        return self.matrix.product(self.B, x)

    def formed(self, x: Array) -> Array:
        """Return K x as the formed matrix gives it."""
        return self.matrix.product(self.K, x)

    def diagonals(self) -> tuple[Array, Array]:
        """Return the diagonals of K and B."""
        return self.matrix.diagonal(self.K), self.matrix.diagonal(self.B)

    def stiffness(self, x: Array) -> Array:
        """Return K x by way of the strains, with the digits that the formed K of fine meshes has lost."""
        num = self.model.numbering
        v = np.zeros(len(self.d))
        num.expand(x, v)
        return num.reduce(self.full_stiffness(v))

    def full_stiffness(self, v: Array) -> Array:
        """Return K v in full coordinates, by way of the strains."""
        out = np.zeros(len(v))
        self.model.set_natural(self.t if self.loads else None)
        for group in self.model.groups:
            tangent_action(group, self.d, v, out)
        for _, _, K, dofs in self.system.patches(self.d, self.t, elastic=not self.loads):
            np.add.at(out, dofs, np.einsum("mij,mj->mi", K, v[dofs]))
        return out


def each(apply: Any, V: Array) -> Array:
    """Return A v of every row v."""
    out = np.empty_like(V)
    for k, v in enumerate(V):
        out[k] = apply(v)
    return out


def ritz(V: Array, HV: Array, GV: Array, m: int) -> tuple[Array, Array]:
    """Return the lowest m values of V H V^T y = value V G V^T y (G positive on V), and their combinations (m, k)."""
    H, G = V @ HV.T, V @ GV.T
    scale = np.sqrt(np.diag(G))
    w, U = np.linalg.eigh(0.5 * (G + G.T) / np.outer(scale, scale))
    keep = w > 1e-10
    T = (U[:, keep] / np.sqrt(w[keep])) / scale[:, None]
    values, Y = np.linalg.eigh(0.5 * T.T @ (H + H.T) @ T)
    return values[:m], (T @ Y[:, :m]).T
