"""Lowest modes of a pair (K, B): shift-invert Lanczos, Rayleigh-Ritz, and a count that none is missing."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError
from ...kernels.elements import tangent_action
from ...model.model import Model
from ...model.rotation import CoordinateKinds
from ..ldl import Pivots
from ..least_motion import UNIT_ROUNDOFF
from ..linear import assemble_mass, make_matrix
from ..system import System
from .rayleigh_ritz import graded_ritz


class Pencil:
    """Tangent K of a model at (d, t) and another matrix B of its unknowns in the same storage.

    ``loads``: whether loads that turn or move add their stiffness; ``turned`` (bodies,): the full turns at d. The
    model's tangent must be symmetric.
    """

    def __init__(self, model: Model, d: Array, t: float, loads: bool, turned: Array | None = None) -> None:
        self.model, self.d, self.t, self.loads = model, d, t, loads
        self.system = System(model, fixed=True)
        self.system.count_from((d, model.turns.from_reference(d) if turned is None else turned))
        self.balance = self.system.assemble(d, t, load_stiffness=loads)
        self.matrix = self.system.matrix
        self.K: Array = self.matrix.target.values.copy()
        self.B: Array = self.K
        self.n = model.numbering.n_unknowns
        self.multipliers = model.numbering.n_multipliers
        # negative eigenvalues that only round-off of K causes
        self.false = 0

    def with_mass(self, e: Array | None = None) -> Pencil:
        """Return this pencil with B = M, for small motions about coordinates ``e`` if given."""
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
        """Return the number of negative eigenvalues of K - shift B (Sylvester).

        Those of multipliers and of round-off are left out. None if it is singular or pivoting hides the inertia.
        """
        if pivots.bad >= 0:
            return None
        if not self.matrix.knows_inertia:
            return None
        return pivots.negative - self.multipliers - self.false

    def solve(self, b: Array) -> Array:
        """Return (K - shift B)^-1 b for the last shift."""
        return self.matrix.solve(b)

    def apply_B(self, x: Array) -> Array:
        """Return B x."""
        return self.matrix.product(self.B, x)

    def apply_K(self, x: Array) -> Array:
        """Return K x by the assembled matrix."""
        return self.matrix.product(self.K, x)

    def diagonals(self) -> tuple[Array, Array]:
        """Return the diagonals of K and B."""
        return self.matrix.diagonal(self.K), self.matrix.diagonal(self.B)

    def stiffness(self, x: Array) -> Array:
        """Return K x through the strains, with the digits that the assembled K of a fine mesh has lost."""
        num = self.model.numbering
        return num.reduce(self.full_stiffness(num.expanded(x)))

    def full_stiffness(self, v: Array) -> Array:
        """Return K v in full coordinates, computed through the strains."""
        out = np.zeros(len(v))
        self.model.set_natural(self.t if self.loads else None)
        for group in self.model.groups:
            tangent_action(group, self.d, v, out)
        for _, _, K, dofs in self.system.patches(self.d, self.t, elastic=not self.loads):
            np.add.at(out, dofs, np.einsum("mij,mj->mi", K, v[dofs]))
        return out

    def rigid_motions(self) -> Array:
        """Return the rates (3, n_q) of all bodies that move as one: translations, rotation about the mean position."""
        model, out = self.model, np.zeros((3, self.model.n_q))
        kinds, e = CoordinateKinds(model.meshes.values()), model.e0 + self.d[:model.n_q]
        x, y = (float(e[kinds.positions + k].mean()) for k in (0, 1))
        kinds.translation(out[0], 1.0, 0.0)
        kinds.translation(out[1], 0.0, 1.0)
        kinds.rotation(out[2], e, 1.0, (x, y))
        return out


def map_rows(apply: Any, V: Array) -> Array:
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


# to the motion whose eigenvalue is next to a shift; its neighbours are at least a third farther away
INVERSE_ITERATIONS = 20
# up to this number of unknowns, or this multiple of the number of modes, it is faster to compute every mode at once
DENSE, MOST_OF_ALL = 100, 4
# additional modes, among which a gap for the count is sought
EXTRA = 5
# shifts stay this far above the round-off of K: in units of the largest K_ii/M_ii, and of round-off in soft motions
ROUND_OFF, ABOVE = 4e-15, 4.0
# eigenvalues within this share of the shift count as zero
NOTHING = 1e-8
# so do those within this share of ``characteristic``; round-off of K can make the shift much larger
SOFT = 1e-2
# relative changes by Rayleigh-Ritz above which the vectors are corrected, too
CORRECT = 5e-5
# tolerance of Lanczos; Rayleigh-Ritz squares the error
LANCZOS = 1e-8
# relative correction of an eigenvalue that is accepted
SETTLED = 1e-11
# elastic eigenvalues this many times smaller than the shift, which is kept above round-off, may be wrong
FAR = 1e6
# eigenvalues smaller than this multiple of their correction count as zero
UNSURE = 10.0
# corrections that change all values by at least this share of the change before end them
SLOW, MAX_CORRECTIONS = 0.9, 20


@dataclass
class Modes:
    """Eigenvalues (m,) [1/s^2] ascending, and vectors (m, n_unknowns) with unit modal mass.

    ``error`` (m,): relative error that corrections have left. ``floor``: bound below which eigenvalues count as zero.
    ``counted``: whether the inertia confirms that no lower mode is missing (None: unknown).
    """

    values: Array
    vectors: Array
    error: Array
    floor: float
    counted: bool | None


def degrees_of_freedom(model: Model) -> int:
    """Return the number of independent motions; contacts that touch may reduce it further."""
    num = model.numbering
    # multipliers of open contacts hold nothing
    holding = num.n_multipliers - sum(len(table.points) for table in model.contact_tables)
    return num.n_unknowns - num.n_multipliers - holding


def characteristic(pencil: Pencil) -> float:
    """Return a number below the elastic eigenvalues of a model [1/s^2].

    It is min EI/(m L^3) over the deformable bodies, m the model's mass and L its total length; for rigid bodies only, a
    share of the lowest K_ii/M_ii.
    """
    model = pencil.model
    plans = [m.plan for m in model.meshes.values()]
    length = sum(p.length for p in plans)
    mass = sum(p.section.rhoA * p.length for p in plans) + sum(m.mass for m in model.case.resting_masses)
    stiff = [p.section.EI for p in plans if not p.rigid]
    if stiff and mass:
        return min(stiff) / (mass * length**3)
    ratios = _ratios(pencil)
    return SOFT * float(ratios[ratios > 0].min(initial=np.inf)) if (ratios > 0).any() else 1.0


def _ratios(pencil: Pencil) -> Array:
    """Return K_ii/M_ii of the unknowns that have a mass."""
    K, M = pencil.diagonals()
    heavy = M > 0
    return K[heavy] / M[heavy]


def first_shift(pencil: Pencil) -> float:
    """Return the magnitude of a shift near the lowest elastic eigenvalue, above round-off of every motion [1/s^2]."""
    return max(characteristic(pencil), ROUND_OFF * float(np.max(_ratios(pencil), initial=0.0)))


def soft_shift(pencil: Pencil) -> float:
    """Return the same, above the round-off that K causes in motions that strain little [1/s^2].

    These are about as large as rigid motions. The largest K_ii/M_ii is that of thin, light sections, and its round-off
    can be as large as all frequencies of bending of a slender body.
    """
    num, K, most = pencil.model.numbering, np.abs(pencil.K), 0.0
    for v in pencil.rigid_motions():
        z = num.of_unknowns(v)
        size, mass = np.abs(z), float(z @ pencil.apply_B(z))
        if mass > 0.0:
            most = max(most, float(size @ pencil.matrix.product(K, size)) / mass)
    return max(characteristic(pencil), ABOVE * UNIT_ROUNDOFF * most)


def find_shift(pencil: Pencil) -> float:
    """Factor K - shift M at a negative shift below every eigenvalue, near the lowest elastic ones; return it.

    Negative eigenvalues that only round-off of K causes may be lower: a shift far below all others would not tell these
    apart.
    """
    first = shift = soft_shift(pencil)
    for _ in range(60):
        pivots = pencil.factor(-shift)
        if pencil.negative(pivots) in (0, None) and pivots.bad < 0:
            break
        shift *= 4.0
    else:
        raise ComputationError("no shift below the lowest eigenvalue was found", at={"shift": f"{-shift:.3g}"},
                               advice="check masses and stiffnesses for extreme values")
    if shift > first and not _grows(pencil, shift):
        shift = first
        while (pivots := pencil.factor(-shift)).bad >= 0:
            shift *= 4.0
        pencil.false = pencil.negative(pivots) or 0
    return -shift


def _grows(pencil: Pencil, shift: float) -> bool:
    """Return whether the eigenvalue next to -shift, by the last factors, is also negative through the strains."""
    v = np.random.default_rng(0).standard_normal(pencil.n)
    for _ in range(INVERSE_ITERATIONS):
        v = pencil.solve(pencil.apply_B(v))
        v /= pencil.system.norm(v)
    return float(v @ pencil.stiffness(v)) < -0.1 * shift * float(v @ pencil.apply_B(v))


def _all_modes(pencil: Pencil, shift: float) -> tuple[Array, Array]:
    """Return every finite mode from L^T (K - shift M)^-1 L, M = L L^T."""
    M = map_rows(pencil.apply_B, np.eye(pencil.n))
    scale = np.sqrt(np.where(np.diag(M) > 0, np.diag(M), 1.0))
    w, U = np.linalg.eigh(0.5 * (M + M.T) / np.outer(scale, scale))
    keep = w > 1e-13 * w[-1]
    L = (scale[:, None] * U[:, keep] * np.sqrt(w[keep])).T
    X = map_rows(pencil.solve, L)
    C = X @ L.T
    theta, Y = np.linalg.eigh(0.5 * (C + C.T))
    theta, Y = theta[::-1], Y[:, ::-1]
    # constrained motions have theta = 0 up to round-off
    real = np.flatnonzero(theta > 1e-15 * theta[0])[:degrees_of_freedom(pencil.model)]
    theta, Y = theta[real], Y[:, real]
    return shift + 1.0 / theta, (Y / theta).T @ X


def _lanczos(pencil: Pencil, shift: float, m: int, found: Array, seed: int) -> tuple[Array, Array]:
    """Return m modes nearest above the shift, M-orthogonal to ``found`` (k, n)."""
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

    n = pencil.n
    mass = LinearOperator((n, n), matvec=pencil.apply_B, dtype=float)
    weighted = map_rows(pencil.apply_B, found)

    def invert(b: Array) -> Array:
        x = pencil.solve(np.ascontiguousarray(b).ravel())
        return x - (weighted @ x) @ found if len(found) else x

    start = invert(pencil.apply_B(np.random.default_rng(seed).standard_normal(n)))
    inverse = LinearOperator((n, n), matvec=invert, dtype=float)
    try:
        values, vectors = eigsh(mass, m, M=mass, sigma=shift, OPinv=inverse, v0=start, tol=LANCZOS,
                                ncv=min(n, max(2 * m, 20)))
    except ArpackNoConvergence as error:
        raise ComputationError(f"Lanczos iteration found {len(error.eigenvalues)} of {m} modes", advice="fewer modes"
                               ) from error
    order = np.argsort(values)
    return values[order], np.ascontiguousarray(vectors.T[order])


def _refine(pencil: Pencil, values: Array, V: Array, shift: float) -> tuple[Array, Array, Array]:
    """Return values, vectors and relative errors by Rayleigh-Ritz with K through the strains, with corrections.

    If Rayleigh-Ritz hardly changes the values, the error left is quadratic in that of the vectors. Else vectors are
    corrected until the values settle.
    """
    m, scale = len(values), characteristic(pencil)
    KV, MV = map_rows(pencil.stiffness, V), map_rows(pencil.apply_B, V)
    new, Y = _ritz(V, KV, MV, m, scale)
    V, values, rest = Y @ V, new, (np.abs(new - values) / (np.abs(new) + scale))**2
    poor, before = rest > CORRECT**2, np.full(m, np.inf)
    for _ in range(MAX_CORRECTIONS):
        if not poor.any():
            break
        # not combinations of the former: soft motions would have the round-off of stiff ones
        KV, MV = map_rows(pencil.stiffness, V), map_rows(pencil.apply_B, V)
        pencil.factor(shift)
        C = map_rows(pencil.solve, KV[poor] - values[poor, None] * MV[poor])
        for _ in range(2):
            C -= (C @ MV.T) @ V
        C /= np.sqrt(np.maximum(np.einsum("kn,kn->k", C, map_rows(pencil.apply_B, C)), 1e-300))[:, None]
        # one by one: the vectors of long meshes need much memory
        KV = np.vstack([KV, map_rows(pencil.stiffness, C)])
        MV = np.vstack([MV, map_rows(pencil.apply_B, C)])
        V = np.vstack([V, C])
        new, Y = _ritz(V, KV, MV, m, scale)
        moved = np.abs(new - values)
        rate, change = np.minimum(moved / np.maximum(before, 1e-300), SLOW), moved / (np.abs(new) + scale)
        # what is left of a geometric series
        rest, before = np.where(poor, change * rate / (1.0 - rate), rest), moved
        V, values, poor = Y @ V, new, poor & (change > SETTLED)
        if np.all(rate[poor] >= SLOW):
            break
    return values, V, rest


def _ritz(V: Array, KV: Array, MV: Array, m: int, scale: float) -> tuple[Array, Array]:
    """Return the same as ``ritz``, with the digits of values that are small beside the largest."""
    if np.max(np.einsum("ij,ij->i", V, KV) / np.einsum("ij,ij->i", V, MV)) > scale / NOTHING:
        with suppress(np.linalg.LinAlgError):
            return graded_ritz(V, KV, MV, m)
    return ritz(V, KV, MV, m)


def _count(pencil: Pencil, values: Array, m: int) -> tuple[int | None, int]:
    """Return (eigenvalues by inertia, eigenvalues found) below a shift in the widest gap from the m-th on.

    The first is None if there is no gap or the inertia is hidden.
    """
    if len(values) <= m:
        return None, len(values)
    gaps = np.diff(values[m - 1:]) / np.maximum(np.abs(values[m:]), 1e-300)
    k = int(np.argmax(gaps))
    if gaps[k] < 1e-6:
        return None, len(values)
    at = 0.5 * (values[m - 1 + k] + values[m + k])
    return pencil.negative(pencil.factor(at)), m + k


def _complete(pencil: Pencil, m: int, shift: float, values: Array, V: Array, rest: Array
              ) -> tuple[Array, Array, Array, bool | None]:
    """Return the modes with those that the inertia shows to be missing, and whether it now confirms them."""
    for attempt in range(1, 4):
        inertia, found = _count(pencil, values, m)
        if inertia is None or inertia <= found:
            return values, V, rest, None if inertia is None else inertia == found
        pencil.factor(shift)
        missing = min(inertia - found + 2, pencil.n - pencil.multipliers - len(values) - 1)
        more, W = _lanczos(pencil, shift, missing, V, attempt)
        values, V, rest = _refine(pencil, np.concatenate([values, more]), np.vstack([V, W]), shift)
    return values, V, rest, False


def lowest(pencil: Pencil, m: int) -> Modes:
    """Return the m lowest modes of a pencil (fewer if there are no more)."""
    shift = find_shift(pencil)
    if pencil.n <= max(DENSE, MOST_OF_ALL * (m + EXTRA)):
        values, V = _all_modes(pencil, shift)
        values, V, rest = _refine(pencil, values[:m + EXTRA], V[:m + EXTRA], shift)
        counted: bool | None = True
    else:
        values, V = _lanczos(pencil, shift, m + EXTRA, np.zeros((0, pencil.n)), 0)
        values, V, rest, counted = _complete(pencil, m, shift, *_refine(pencil, values, V, shift))
    m = min(m, len(values))
    floor = min(NOTHING * abs(shift), SOFT * characteristic(pencil))
    unsure = np.abs(values) <= UNSURE * rest * (np.abs(values) + characteristic(pencil))
    values = np.where(unsure, 0.0, values)
    # such factors tell soft motions apart no better than round-off
    lost = (np.abs(values) > floor) & (FAR * np.maximum(np.abs(values), characteristic(pencil)) < abs(shift))
    rest = np.where(lost, np.maximum(rest, 1.0), rest)
    return Modes(values[:m], V[:m], rest[:m], floor, counted)
