"""The discrete model of a case for external solvers and integrators: residual, tangents, mass and probes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..case.schema.points import MovingPoint
from ..case.schema.profiles import PointExpression
from ..elements.shape import Array
from ..errors import CaseError, ComputationError, Problem
from ..model.mesh import Index
from ..model.model import Model
from .linear import full_mass, unknowns_to_coordinates
from .long_vectors import largest
from .motion.initial import HELD, initial_motion
from .small_motions.linearised import RateForces, to_sparse
from .state import State
from .state_results import Observer, turns_of
from .system import System

if TYPE_CHECKING:
    from scipy.sparse import csc_array


class DiscreteModel:
    """The equations of a case for its unknowns z: R(z, t) = 0 in statics, M z'' + R(z, z', t) = 0 in motion.

    The ``n`` unknowns are the displacements of the nodal coordinates that supports and joints leave free, in the order
    of ``e0``, followed by one multiplier for each constraint that cannot be eliminated. ``names`` lists them. R
    contains internal forces minus loads, so K = dR/dz is the tangent stiffness; the row of a multiplier contains its
    constraint g, so R = 0 means that the constraint is met. t is the load factor, but the time in dynamic cases. In
    dynamic cases R includes damping and the inertia of prescribed motion; in ``linear_static`` R is linear.

    ``d`` stands for the unknowns z (n,), zero in the reference, and ``v`` for their rates. Without multipliers both may
    also have all nodal displacements (nq,), such as ``Solution.d[-1]``; ``d`` then has to meet the supports.

    All methods raise ValueError for arrays of another shape, TypeError for complex ones, and ComputationError where an
    amplitude has no value at t or a point has left the body on which it slides.

    Torsion springs on sections without theta count full turns, and prismatic joints follow their point, from one
    evaluation to the next. Fibres that yield are evaluated as if strained from the reference in one step.

    Raises CaseError if no function R(z, z', t) describes the case: states of controllers and materials, conditions,
    friction, impacts; or if this R leaves something out: loads and masses that move along bodies, feedback, drag.
    """

    def __init__(self, model: Model) -> None:
        left = [Problem(message, path=path) if model.loaded is None else model.loaded.source.problem(path, message)
                for path, message in _left_out(model)]
        if left:
            raise CaseError(left)
        self._model, self._system, num = model, System(model), model.numbering
        # order of the nodal coordinates: the place of each unknown in the matrices of the system
        self._order: Index = np.argsort(num.free)
        self._moving = model.case.solver.moves
        self._linear = model.case.solver.linear
        self._reference = np.zeros(len(num.place))
        self._rates = RateForces(model)

    def __repr__(self) -> str:
        title, m = self._model.case.title, self._model.numbering.n_multipliers
        return f"<DiscreteModel{f' {title!r}' if title else ''}: {self.n} unknowns, {m} of them multipliers>"

    # ------------------------------------------------------------------ unknowns

    @property
    def n(self) -> int:
        """The number of unknowns, multipliers included."""
        return self._model.numbering.n_unknowns

    @property
    def e0(self) -> Array:
        """All nodal coordinates (nq,) of the reference, body after body: positions and gradients x, y, and angles."""
        return self._model.e0.copy()

    @property
    def multipliers(self) -> Index:
        """The indices (m,) of the multipliers among the unknowns, at the end."""
        return np.arange(self.n - self._model.numbering.n_multipliers, self.n)

    @property
    def warnings(self) -> list[str]:
        """The warnings about the model, such as elements that lock."""
        return list(self._model.warnings)

    @cached_property
    def names(self) -> list[str]:
        """The unique names of the unknowns: ``"ry_x of beam at S = 0.25"``; S is the fraction of the arc length."""
        model, met, out = self._model, Counter[str](), []
        every = [*model.coordinate_names(), *map(model.describe_multiplier, range(len(model.constraints)))]
        for name in (every[full] for full in model.numbering.free[self._order].tolist()):
            met[name] += 1
            # two sides of a node may have coordinates of their own
            out.append(name if met[name] == 1 else f"{name} ({met[name]})")
        return out

    def expand(self, z: ArrayLike, t: float = 1.0, order: int = 0) -> Array:
        """Return the displacements of all nodal coordinates (nq,), including those that supports and joints determine.

        ``e0 + expand(z, t)`` are the nodal coordinates. With ``order`` 1 or 2, ``z`` and the result are first or second
        rates.
        """
        if order not in (0, 1, 2):
            raise ValueError(f"order is {order!r}; expected 0, 1 or 2")
        return self._full(self._unknowns(z, "z", t, order), t, order)[:self._model.n_q]

    def _unknowns(self, given: ArrayLike, what: str, t: float, order: int = 0) -> Array:
        """Return unknowns (n,), or their rates, in the order of the system."""
        found = np.asarray(given)
        if np.iscomplexobj(found):
            raise TypeError(f"{what} is complex; use real numbers")
        num, full = self._model.numbering, not self._model.constraints
        found = found.astype(float)
        if found.shape == (self.n,):
            out = np.empty(self.n)
            out[self._order] = found
            return out
        if full and found.shape == (num.n_q,):
            out = found[num.free]
            off = largest(self._full(out, t, order) - found, self._model.weights) if order == 0 else 0.0
            if off > HELD * self._model.extent:
                raise ValueError(f"{what} violates supports and joints by {off:.3g} at t = {t:g}")
            return out
        other = f", or all {num.n_q} nodal coordinates" if full else ""
        raise ValueError(f"{what} has the shape {found.shape}; expected ({self.n},), the unknowns{other}")

    def _full(self, z: Array, t: float, order: int = 0) -> Array:
        """Return d (n_full,) or its rates from the unknowns in the order of the system; multipliers have no rates."""
        if order == 0:
            return self._model.displacements(z, t)
        out = self._model.numbering.expanded(z)
        if self._moving:
            self._model.prescribed(t, out, order)
        out[self._model.n_q:] = 0.0
        return out

    # ------------------------------------------------------------------ residual and its derivatives

    def residual(self, d: ArrayLike, v: ArrayLike | None = None, t: float = 1.0) -> Array:
        """Return R (n,) at the unknowns d with rates v (default 0), at load factor or time t."""
        rates = np.zeros(self.n) if v is None else self._unknowns(v, "v", t, 1)
        return self._residual(self._full(self._unknowns(d, "d", t), t), rates, t)

    def _residual(self, d: Array, rates: Array, t: float) -> Array:
        """Return R (n,) at d (n_full,), for rates (n,) of the unknowns in the order of the system."""
        num, driven = self._model.numbering, self._moving and self._model.moves
        R = self._rest(d, t)
        if rates.any() or driven:
            R = R + num.reduce(self._rate_forces(d, self._full(rates, t, 1), t))
        if driven:
            R = R + num.reduce(self._inertia(self._full(np.zeros(self.n), t, 2)))
        return R[self._order]

    def _rest(self, d: Array, t: float) -> Array:
        """Return R (n,) without rates, in the order of the system."""
        system, zero = self._system, self._reference
        if not self._linear:
            return system.forces(d, t).R
        start = system.assemble(zero, t, load_stiffness=False)
        return start.R + self._model.numbering.reduce(system.action(zero, d, t, linear=True))

    def _rate_forces(self, d: Array, v: Array, t: float) -> Array:
        """Return the forces (n_full,) that rates v (n_full,) cause at d and t."""
        d = self._reference if self._linear else d
        return self._rates(d, v, t, lambda: self._M, self._linear)

    def _inertia(self, a: Array) -> Array:
        """Return the inertia forces (n_full,) of second rates a (n_full,)."""
        out, n_q = np.zeros(len(a)), self._model.n_q
        out[:n_q] = self._M @ a[:n_q]
        return out

    def tangent(self, d: ArrayLike, t: float = 1.0) -> csc_array:
        """Return K = dR/dd (n, n) without rates, multipliers included; it is symmetric unless loads follow the body."""
        full = self._full(self._unknowns(d, "d", t), t)
        if self._linear:
            self._system.assemble(self._reference, t, load_stiffness=False)
        else:
            self._system.assemble(full, t)
        matrix = self._system.matrix
        return self._ordered(to_sparse(self._model, matrix, matrix.values))

    def damping(self, d: ArrayLike, t: float = 1.0) -> csc_array:
        """Return C = dR/dv (n, n) without rates: damping of springs and materials, Coriolis forces."""
        full = self._reference if self._linear else self._full(self._unknowns(d, "d", t), t)
        viscous = self._rates.viscous_matrix(full)
        C = self._rates.external_damping(full, t, self._mass if self._rates.alpha else None) + self._rates.coriolis(t)
        return self._ordered(C if viscous is None else C + viscous)

    def _ordered(self, A: csc_array) -> csc_array:
        """Return a matrix of the system in the order of the nodal coordinates."""
        return A[self._order][:, self._order]

    @property
    def mass(self) -> csc_array:
        """The constant mass matrix M (n, n) of motions; rows of multipliers are zero.

        Raises ComputationError if a body has no density.
        """
        return self._reduced_mass.copy()

    @cached_property
    def _M(self) -> Any:
        """The mass matrix (n_q, n_q) of all coordinates."""
        lacking = [name for name, mesh in self._model.meshes.items() if not mesh.plan.section.rhoA > 0.0]
        if lacking:
            raise ComputationError(f"there is no mass matrix: {', '.join(lacking)} has no mass",
                                   advice="material.rho, or section.rhoA if the section is given by stiffnesses")
        return full_mass(self._model)

    @cached_property
    def _mass(self) -> csc_array:
        """The mass matrix (n, n) in the order of the system."""
        from scipy.sparse import csc_array

        T = unknowns_to_coordinates(self._model)
        return csc_array(T.T @ self._M @ T)

    @cached_property
    def _reduced_mass(self) -> csc_array:
        return self._ordered(self._mass)

    # ------------------------------------------------------------------ motion

    def initial(self) -> tuple[Array, Array]:
        """Return the unknowns and their rates (n,) at t = 0 of a dynamic case, as given by ``initial``.

        The given rates are projected onto the constraints of supports and joints; multipliers are 0. Raises
        ComputationError in other cases, and if a static equilibrium to start from is not found; CaseError if a file is
        unusable.
        """
        if not self._moving:
            raise ComputationError("only dynamic cases have an initial state", advice="solver: {type: dynamic, ...}")
        d, v, turned = initial_motion(self._model)
        self._system.count_from((d, turned))
        driven = self._full(np.zeros(self.n), 0.0, 1)
        given = self._model.numbering.reduce(self._inertia(v - driven))[self._order]
        rows, rates = self._constraints(d, v, driven, 0.0)
        return d[self._model.numbering.free][self._order], self._with_constraints(given, rows, -rates[0])[0]

    def accelerations(self, d: ArrayLike, v: ArrayLike, t: float) -> tuple[Array, Array]:
        """Return the second rates (n,) of the unknowns at d with rates v at time t, and the multipliers (m,).

        The accelerations satisfy M a + R(d, v, t) = 0 with these multipliers, regardless of those in ``d``, and the
        second derivatives of all constraints. The entries of multipliers are zero. With y = [d, v], y' = [v, a].

        Raises ComputationError if the mass matrix is singular or constraints hold the same motion twice.
        """
        z, rates = self._unknowns(d, "d", t), self._unknowns(v, "v", t, 1)
        full = self._full(z, t)
        full[self._model.n_q:] = 0.0
        R = self._residual(full, rates, t)
        driven = self._full(np.zeros(self.n), t, 2)
        rows, second = self._constraints(full, self._full(rates, t, 1), driven, t)
        return self._with_constraints(-R, rows, -second[1])

    def _constraints(self, d: Array, v: Array, driven: Array, t: float) -> tuple[Array, Array]:
        """Return the gradients G (m, n) of the constraints g(d, t) = 0, and their rate terms (2, m).

        These are g_t and v^T g_qq v + 2 g_qt v + g_tt at d with rates v, each plus G ``driven`` (all (n_full,)).
        """
        m, found = len(self._model.constraints), self._model.interactions
        if not m:
            return np.zeros((0, self.n)), np.zeros((2, 0))
        G, rates = np.zeros((m, self.n)), found.constraint_rates(d, v, t)
        for k, (_, dofs, row) in enumerate(found.gradients(d, t)):
            gradient = np.zeros(len(d))
            gradient[dofs] = row
            G[k] = self._model.numbering.reduce(gradient)[self._order]
            rates[:, k] += gradient @ driven
        return G, rates

    def _with_constraints(self, forces: Array, G: Array, rates: Array) -> tuple[Array, Array]:
        """Return a (n,) and the multipliers (m,) of M a + G^T lambda = forces, G a = rates."""
        if not len(G):
            return np.asarray(self._mass_factors.solve(forces)), rates
        m, b = self.multipliers, forces.copy()
        A = self._reduced_mass.tolil()
        A[m, :], A[:, m], b[m] = G, G.T, rates
        a = self._factored(A.tocsc()).solve(b)
        found = a[m]
        a[m] = 0.0
        return a, found

    @cached_property
    def _mass_factors(self) -> Any:
        return self._factored(self._reduced_mass)

    @staticmethod
    def _factored(A: csc_array) -> Any:
        from scipy.sparse.linalg import splu

        try:
            return splu(A)
        except RuntimeError:
            raise ComputationError(
                "the mass matrix is singular, or joints hold the same motion twice",
                advice="give every body a density (rhoI too if the section is given by stiffnesses); remove joints "
                "that hold the same motion twice") from None

    # ------------------------------------------------------------------ probes

    def probe(self, name: str, d: ArrayLike, v: ArrayLike | None = None, t: float = 1.0) -> dict[str, float]:
        """Return the values of a probe at d: x, y, ux, uy and theta; with v also vx, vy and omega.

        ``theta`` is relative to the reference; for a body that rotates as a whole it may lack full turns. Raises
        ValueError for an unknown probe.
        """
        if name not in self._observer.probes:
            known = ", ".join(self._observer.probes) or "none"
            raise ValueError(f"the case has no probe '{name}'; it has {known}")
        none, rates = self._reference, None if v is None else self._full(self._unknowns(v, "v", t, 1), t, 1)
        state = State(t, self._full(self._unknowns(d, "d", t), t), none, none, 0.0, linear=self._linear, v=rates)
        return self._observer.read(name, state, turns_of(self._model, state))

    @cached_property
    def _observer(self) -> Observer:
        return Observer(self._model, forces=False)


def _left_out(model: Model) -> Iterator[tuple[tuple[Any, ...], str]]:
    """Yield path and message for everything in a case that the residual does not contain."""
    case, over_time = model.case, model.case.solver.timed
    for group in ("boundary_conditions", "joints", "springs", "masses", "loads"):
        for k, item in enumerate(getattr(case, group)):
            for why in dict.fromkeys(_why_left_out(item, group in ("boundary_conditions", "joints"))):
                yield (group, k), _message(f"{group}.{k}", why)
    for k, contact in enumerate(case.contacts):
        if contact.friction:
            yield ("contacts", k, "friction"), _message(f"contacts.{k}.friction", "friction depends on the load path")
        elif over_time and contact.law is None:
            yield ("contacts", k), _message(f"contacts.{k}", "impacts without a law make velocities jump")
    for name in model.meshes if over_time else ():
        if model.meshes[name].plan.section.maxwell or name in model.remembers:
            yield ("bodies", name), _message(f"bodies.{name}", "its material remembers past strains")


def _why_left_out(item: Any, holds: bool) -> Iterator[str]:
    """Yield why R(z, z', t) cannot contain an item of a case; ``holds``: it is a support or joint."""
    active = getattr(item, "active", None)
    if active is not None and (holds or active.waits):
        yield "it waits for a condition" if active.waits else "it is let go"
    fields = [v for value in vars(item).values() for v in (value if isinstance(value, tuple) else (value,))]
    for value in fields:
        if isinstance(value, MovingPoint):
            yield "it moves along a body"
        elif isinstance(value, PointExpression):
            # its quantities are those of the load's own point
            continue
        elif getattr(value, "quantities", ()):
            yield f"it depends on {', '.join(value.quantities)}"


def _message(where: str, why: str) -> str:
    return f"{where}: {why}, which the residual of ancf2d.system does not contain; ancf2d.solve takes it into account"
