"""Small motions about a state at rest: M z'' + C z' + K z = f with sparse matrices over the unknowns of a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError
from ...interactions.forces import LoadSet
from ...kernels.elements import viscous_force
from ...kernels.matrices.layout import stored_entries
from ...model.mesh import Index
from ...model.model import Model
from ..contact import memory, restore_memory
from ..ldl import SymmetricBand, SymmetricFronts
from ..linear import (
    GeneralBand,
    TangentMatrix,
    assemble_mass,
    coriolis_matrix,
    make_matrix,
    pattern,
    scattered,
    unknowns_to_coordinates,
)
from ..state import State
from .lowest_modes import Pencil, degrees_of_freedom

if TYPE_CHECKING:
    from scipy.sparse import csc_array


@dataclass
class Base:
    """The state about which a model is linearised, and the model whose loads act there."""

    model: Model
    state: State
    loaded: bool

    def pencil(self) -> Pencil:
        """Return the tangent stiffness there."""
        return Pencil(self.model, self.state.d, self.state.t, self.loaded, self.state.turned)


def base_state(model: Model, about: str) -> Base:
    """Return the reference, where no loads act, or the equilibrium under all of them (``about: static``).

    Raises ComputationError if there is no such equilibrium.
    """
    if about == "static":
        return _equilibrium(model)
    guides = [guide for guide in model.loads.guides if len(guide.depends)]
    return _reference(replace(model, loads=LoadSet(flows=model.loads.flows, guides=guides)))


def _reference(model: Model) -> Base:
    d = model.displacements(np.zeros(model.numbering.n_unknowns), 0.0)
    zero = np.zeros(len(d))
    history = {"step": 0, "factor": 0.0, "iterations": 0}
    state = State(0.0, d, zero, zero, 0.0, last=True, history=history, warnings=_one_sided_warnings(model))
    return Base(model, state, False)


def _one_sided_warnings(model: Model) -> list[str]:
    """Return warnings about springs that act only on one side of the reference."""
    found = []
    for spring in (one for one in model.springs if one.path and one.breaks):
        f, H, _ = spring.forces(np.zeros(len(spring.p0)), 0.0)
        if H.any() and not f.any():
            found.append(f"{spring.path} is one-sided at the reference; small motions are computed as if it acted in "
                         "both directions")
    return found


def _equilibrium(model: Model) -> Base:
    from ..statics.static import solve_static

    iterations, warnings, state = 0, [], None
    for state in solve_static(model):
        iterations += int(state.history["iterations"])
        warnings += state.warnings
    assert state is not None
    state.history["iterations"], state.warnings = iterations, warnings
    # where bodies lift off, contact points move along with the lift-off point: otherwise bodies would pivot about them
    restore_memory(model, memory(model), slide=True)
    return Base(model, state, True)


class Linearised:
    """K, C and M of small motions about a state: M z'' + C z' + K z = f.

    ``z`` (n,) are changes of the unknowns, in the order of ``model.numbering.free``, including multipliers, whose rows
    of K hold the gradients of their constraints. K contains the stiffness of loads that turn or move, unless the state
    is the reference, and is then not symmetric; C contains dashpots, Kelvin-Voigt and Rayleigh damping, and the
    Coriolis forces of a rotating frame.
    """

    def __init__(self, base: Base) -> None:
        self.base, self.model = base, base.model
        self.pencil = base.pencil()
        self.rates = RateForces(base.model)
        self.n = base.model.numbering.n_unknowns

    @cached_property
    def K(self) -> csc_array:
        """The tangent stiffness (n, n)."""
        return to_sparse(self.model, self.pencil.matrix, self.pencil.K)

    @cached_property
    def M(self) -> csc_array:
        """The mass matrix (n, n); rotary inertia of point masses is that of small rotations about the state."""
        mass = make_matrix(self.model)
        assemble_mass(self.model, mass, self.model.e0 + self.base.state.d[:self.model.n_q])
        return to_sparse(self.model, mass, mass.target.values)

    @cached_property
    def viscous(self) -> csc_array | None:
        """Kelvin-Voigt damping and Rayleigh's beta (n, n) alone, or None if there is none."""
        return self.rates.viscous_matrix(self.base.state.d)

    def viscous_forces(self, x: Array) -> Array:
        """Return ``viscous`` times x (n,), computed through the strains."""
        num = self.model.numbering
        return num.reduce(self.rates.viscous_forces(self.base.state.d, num.expanded(x)))

    @cached_property
    def relaxing(self) -> list[Relaxing]:
        """The contributions of relaxing materials to K, one for each set of terms."""
        return [Relaxing(self.model, self.base.state.d, terms) for terms in self.model.maxwell]

    @cached_property
    def external_damping(self) -> csc_array:
        """Other dissipation (n, n): dashpots, linearised at rest, and Rayleigh's alpha."""
        return self.rates.external_damping(self.base.state.d, self.base.state.t, self.M if self.rates.alpha else None)

    @property
    def dampers(self) -> csc_array:
        """All dissipation (n, n)."""
        return self.external_damping if self.viscous is None else self.external_damping + self.viscous

    @cached_property
    def coriolis(self) -> csc_array:
        """The Coriolis forces of a rotating frame and of flows (n, n)."""
        return self.rates.coriolis(self.base.state.t)

    @property
    def C(self) -> csc_array:
        """All forces proportional to rates (n, n)."""
        return self.dampers + self.coriolis

    def stiffness(self, x: Array) -> Array:
        """Return K x through the strains, with the digits that the assembled K of a fine mesh has lost."""
        return self.pencil.stiffness(x)

    def pencil_with_mass(self) -> Pencil:
        """Return K with M as the other matrix, for small motions about the state."""
        return self.pencil.with_mass(self.model.e0 + self.base.state.d[:self.model.n_q])


def small_motions(model: Model, about: str, solver: str) -> Linearised:
    """Return the small motions for a solver, in a rotating frame about the equilibrium there.

    Raises ComputationError if nothing can move, or there is no such equilibrium.
    """
    if degrees_of_freedom(model) <= 0:
        raise ComputationError("supports and joints hold all coordinates, so nothing can vibrate",
                               at={"solver": solver},
                               advice="fewer supports or joints")
    return Linearised(base_state(model, "static" if model.case.steady_rotation is not None else about))


class Relaxing:
    """The contribution to K, for motions exp(s t), of materials with the same Maxwell terms: V times a function of s.

    ``V`` (n, n) is their stiffness at the long-time modulus, from strains alone.
    """

    def __init__(self, model: Model, d: Array, terms: tuple[tuple[float, float], ...]) -> None:
        self.model, self.d, self.terms = model, d, terms
        self.groups = [group for pool, group in zip(model.pools, model.groups, strict=True)
                       if pool.plan.section.maxwell == terms]
        self.V = _by_columns(model, self.forces)

    def factor(self, s: complex) -> complex:
        """Return sum g s tau/(1 + s tau), real for real s."""
        return sum((g * s * tau / (1.0 + s * tau) for g, tau in self.terms), 0.0)

    def slope(self, s: complex) -> complex:
        """Return the derivative of the factor by s."""
        return sum((g * tau / (1.0 + s * tau) ** 2 for g, tau in self.terms), 0.0)

    def forces(self, v: Array) -> Array:
        """Return V v (n_full,) of motions in full coordinates."""
        out = np.zeros(len(v))
        self.model.set_natural(None)
        for group in self.groups:
            viscous_force(group, 1.0, self.d, v, out)
        return out

    def stiffness(self, x: Array) -> Array:
        """Return V x (n,), computed through the strains."""
        num = self.model.numbering
        return num.reduce(self.forces(num.expanded(x)))


class RateForces:
    """The forces of a model that depend on the rates of its coordinates."""

    def __init__(self, model: Model) -> None:
        self.model = model
        damping, spin = model.case.damping, model.case.steady_rotation
        self.alpha = damping.rayleigh.alpha if damping else 0.0
        self.viscous = [(pool.tau, group) for pool, group in zip(model.pools, model.groups, strict=True) if pool.tau]
        self.drags = any(getattr(load, "damped", False) for load in model.loads.patches)
        self.dashpots = self.drags or any(spring.damped for spring in model.springs)
        self.omega = spin.omega if spin else 0.0
        self.flows = bool(model.loads.flows)

    @property
    def gyrates(self) -> bool:
        """Return whether C may be unsymmetric: in rotating frames, with flows along bodies, with drag of loads."""
        return bool(self.omega or self.flows or self.drags)

    @property
    def damps(self) -> bool:
        """Return whether anything dissipates energy."""
        return bool(self.alpha or self.viscous or self.dashpots)

    @cached_property
    def _T(self) -> csc_array:
        return unknowns_to_coordinates(self.model)

    @cached_property
    def _coriolis(self) -> csc_array:
        return coriolis_matrix(self.model, self.omega)

    def __call__(self, d: Array, v: Array, t: float, mass: Callable[[], csc_array], linear: bool = False) -> Array:
        """Return the forces (n_full,) caused by rates v (n_full,) at d and t, to first order in v if ``linear``.

        ``mass`` returns M (n_q, n_q) if needed.
        """
        out, n_q = self.viscous_forces(d, v), self.model.n_q
        for forces, dofs in self.model.interactions.rate_forces(d, v, t, linear):
            np.add.at(out, dofs, forces)
        if self.omega:
            out[:n_q] += self._coriolis @ v[:n_q]
        if self.alpha:
            out[:n_q] += self.alpha * (mass() @ v[:n_q])
        return out

    def external_damping(self, d: Array, t: float, M: csc_array | None) -> csc_array:
        """Return dashpots and drag of loads, linearised at d (n_full,) at rest at t, and alpha M (n, n).

        M (n, n) is needed if there is alpha.
        """
        from scipy.sparse import csc_array

        n = self.model.numbering.n_unknowns
        out = csc_array((n, n)) if M is None else self.alpha * M
        return csc_array(out + self._damping_of(self.model.interactions.dampers, d, t) if self.dashpots else out)

    def drag(self, d: Array, t: float) -> csc_array:
        """Return the contribution (n, n) of loads to ``external_damping``."""
        return self._damping_of(self.model.interactions.drags, d, t)

    def _damping_of(self, batches: Sequence[Any], d: Array, t: float) -> csc_array:
        blocks = [(batch.dofs, batch.matrices(d, t)[3]) for batch in batches]
        return (self._T.T @ scattered(blocks, self.model.n_q) @ self._T).tocsc()

    def viscous_matrix(self, d: Array) -> csc_array | None:
        """Return Kelvin-Voigt damping at d (n_full,), Rayleigh's beta included (n, n), or None if there is none."""
        return _by_columns(self.model, lambda v: self.viscous_forces(d, v)) if self.viscous else None

    def viscous_forces(self, d: Array, v: Array) -> Array:
        """Return the Kelvin-Voigt forces (n_full,) caused by rates v (n_full,) at d, Rayleigh's beta included."""
        out = np.zeros(len(v))
        self.model.set_natural(None)
        for tau, group in self.viscous:
            viscous_force(group, tau, d, v, out)
        return out

    def coriolis(self, t: float) -> csc_array:
        """Return the Coriolis forces of the rotating frame and of flows along bodies at t (n, n)."""
        from scipy.sparse import csc_array

        n = self.model.numbering.n_unknowns
        out = csc_array(self._T.T @ self._coriolis @ self._T) if self.omega else csc_array((n, n))
        if self.flows:
            rest = np.zeros(len(self.model.numbering.place))
            blocks = [(b.dofs, b.matrices(rest, t)[3]) for b in self.model.interactions.flows]
            out = out + csc_array(self._T.T @ scattered(blocks, self.model.n_q) @ self._T)
        return out


def to_sparse(model: Model, matrix: TangentMatrix, values: Array) -> csc_array:
    """Return the matrix (n, n) with these values, stored in the layout of ``matrix``."""
    if isinstance(matrix, SymmetricBand):
        return _of_band(values)
    i, j = entries(model, matrix)
    held, matrix.values[...] = matrix.values.copy(), values
    out = sparse(matrix.read(i, j), i, j, model.numbering.n_unknowns)
    matrix.values[...] = held
    out.eliminate_zeros()
    return out


def _of_band(values: Array) -> csc_array:
    """Return the matrix (n, n) of a symmetric band, whose row i has the entries (i, i - bw) to (i, i)."""
    from scipy.sparse import dia_array

    n, bw = values.shape[0], values.shape[1] - 1
    diagonals, offsets = np.zeros((2 * bw + 1, n)), np.arange(-bw, bw + 1)
    for p in range(bw + 1):
        diagonals[bw + p] = values[:, bw - p]
        diagonals[bw - p, :n - p] = values[p:, bw - p]
    out = dia_array((diagonals, offsets), shape=(n, n)).tocsc()
    out.eliminate_zeros()
    return out


def sparse(values: Array, i: Index, j: Index, n: int) -> csc_array:
    """Return the matrix (n, n) with these entries, listed column by column."""
    from scipy.sparse import csc_array

    return csc_array((values, i.astype(np.int32), np.searchsorted(j, np.arange(n + 1))), shape=(n, n))


def entries(model: Model, matrix: TangentMatrix) -> tuple[Index, Index]:
    """Return the row and column of each possible nonzero entry of a model's matrix, column by column."""
    n = model.numbering.n_unknowns
    if isinstance(matrix, SymmetricBand | GeneralBand):
        bw = matrix.bw
        i = np.add.outer(np.arange(n), np.arange(-bw, bw + 1)).ravel()
        inside = (i >= 0) & (i < n)
        return i[inside], np.repeat(np.arange(n), 2 * bw + 1)[inside]
    if isinstance(matrix, SymmetricFronts) and model.numbering.couplings is not None:
        low, high = stored_entries(matrix.fronts)
        code: Index = np.unique(np.append(low * n + high, high * n + low))
    else:
        rows, columns = pattern(model)
        code = np.unique(columns.astype(np.int64) * n + rows.astype(np.int64))
    return code % max(n, 1), code // max(n, 1)


def _by_columns(model: Model, forces: Callable[[Array], Array]) -> csc_array:
    """Return the matrix (n, n) of forces (n_full,) that are linear in rates (n_full,), many columns at a time.

    No two columns of the same colour have entries in the same row (Curtis, Powell & Reid 1974).
    """
    num = model.numbering
    matrix = make_matrix(model)
    i, j = entries(model, matrix)
    n = num.n_unknowns
    if isinstance(matrix, SymmetricBand | GeneralBand):
        colours: Index = np.arange(n) % (2 * matrix.bw + 1)
    else:
        colours = _colours(sparse(np.ones(len(i)), i, j, n))
    values, colour_of = np.zeros(len(i)), colours[j]
    for colour in range(int(colours.max(initial=-1)) + 1):
        v = num.expanded((colours == colour).astype(float))
        v[num.n_q:] = 0.0
        mine = np.flatnonzero(colour_of == colour)
        values[mine] = num.reduce(forces(v))[i[mine]]
    out = sparse(values, i, j, n)
    out.eliminate_zeros()
    return out


def _colours(P: csc_array) -> Index:
    near, out = (P.T @ P).tocsc(), np.full(P.shape[1], -1)
    for k in range(len(out)):
        taken = set(out[near.indices[near.indptr[k]:near.indptr[k + 1]]].tolist())
        out[k] = next(c for c in count() if c not in taken)
    return out
