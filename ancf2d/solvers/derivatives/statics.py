"""Derivatives of the states of a model by a number of its case, without solving again.

R(z, p) = 0 gives dz/dp = -K^-1 dR/dp with the tangent K of the solution: one factorisation for all numbers. dR/dp is
taken by differences of varied models at the same unknowns z, which handles every kind of number alike. Values of the
states (``states``) are then differentiated along (z', p').
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Protocol

import numpy as np

from ...case import LimitPoints, LoadFactor, Static
from ...elements.shape import Array
from ...model.model import Model
from ..contact import memory, restore_memory
from ..iterative_refinement import refined
from ..small_motions.factors import Factors
from ..small_motions.linearised import to_sparse
from ..state import State
from ..state_results import Observer
from ..statics.continuation import Curve
from ..statics.path_events import goal_of
from ..system import System
from .differences import Quotient, UnsuitedError, derivative
from .varied_motions import ModelAt

# number of corrections of a solution before it is differentiated
POLISH = 3
# number of corrections of derivatives if tangents are not exact, and relative size at which they end
CORRECTIONS, EXACT = 12, 1e-9
# displacement, relative to the scene, over which tangents are differentiated along a path
ALONG = 1e-3


class Response(Protocol):
    """The first derivative of a solver's result."""

    def slope(self, at: ModelAt, h: float) -> Quotient:
        """Return the derivative of all variables, by differences of models with steps near h."""
        ...

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the states of a varied model, for a change of all variables."""
        ...

    def prepare(self, numbers: Sequence[tuple[ModelAt, float]]) -> None:
        """Compute in advance derivatives that are cheaper for several numbers at once."""
        ...


class OneByOne:
    """Derivatives that are found separately for each number."""

    def prepare(self, numbers: Sequence[tuple[ModelAt, float]]) -> None:
        """Do nothing."""


class Equilibrium(OneByOne):
    """An equilibrium R(z, t) = 0 at a load factor t, or the solution of linear statics."""

    def __init__(self, model: Model, state: State, linear: bool = False, polish: int = POLISH) -> None:
        self.model, self.t, self.linear, self.state = model, state.t, linear, state
        self.z = state.d[model.numbering.free].copy()
        self.contacts = memory(model) if model.contacts else None
        self.turns = state.d.copy(), model.turns.from_reference(state.d) if state.turned is None else state.turned
        self.system = self.system_of(model)
        self.zero = np.zeros(len(state.d))
        if polish:
            self.tangent_at(self.z)
        for _ in range(polish):
            self.correct()

    def tangent_at(self, z: Array) -> None:
        """Factor the tangent at unknowns z (n,), in linear statics that of the reference."""
        d = self.zero if self.linear else self.model.displacements(z, self.t)
        self.system.assemble(d, self.t, load_stiffness=not self.linear)
        self.system.factor({"factor": self.t})

    def correct(self) -> float:
        """Make a Newton step with the factored tangent; return its size [m]."""
        step = self._solved(-self.residual(self.model))
        self.z = self.z + step
        return self.system.norm(step)

    def system_of(self, model: Model) -> System:
        system = System(model)
        system.count_from(self.turns)
        if self.contacts is not None:
            restore_memory(model, self.contacts, slide=True)
        return system

    def _solved(self, b: Array) -> Array:
        """Return K^-1 b, refined with K through the strains."""
        model, num = self.model, self.model.numbering
        d = self.zero if self.linear else model.displacements(self.z, self.t)

        def apply(z: Array) -> Array:
            return num.reduce(self.system.action(d, num.expanded(z), self.t, linear=self.linear,
                                                 loads=not self.linear))
        if not b.any():
            return np.zeros_like(b)
        if model.symmetric or self.linear:
            return refined(apply, self.system.matrix.solve, self.system.norm, b, 0.0)[0]
        z = self.system.matrix.solve(b)
        return np.asarray(z + self.system.matrix.solve(b - apply(z)))

    def residual(self, model: Model, change: Array | float = 0.0) -> Array:
        """Return R (n,) of a model at the unknowns of this equilibrium plus ``change``."""
        t = self.load_factor(model)
        system, d = self.system_of(model), model.displacements(self.z + change, t)
        if not self.linear:
            return system.forces(d, t).R
        start = system.assemble(self.zero, self.t, load_stiffness=False)
        return start.R + model.numbering.reduce(system.action(self.zero, d, self.t, linear=True))

    def load_factor(self, model: Model) -> float:
        """Return the load factor of the state of a model."""
        return self.t

    def slope(self, at: ModelAt, h: float) -> Quotient:
        """Return dz/dp (n,).

        Steps are judged by the displacements that the residuals cause: at fixed unknowns, stiff motions contribute,
        whose forces are far larger than those of the loads.
        """
        weights = self.system.weights
        found = derivative(lambda s: -self._solved(self.residual(at(s))), h, weights, self._unknown)
        return found if self.contacts is None else self._corrected(at, found)

    def _corrected(self, at: ModelAt, found: Quotient) -> Quotient:
        """Return dz/dp (n,) with stationary residuals along it: tangents of sliding points are not exact."""
        system, z = self.system, found.value

        def more(step: float) -> Array:
            return step * z - self._solved(self.residual(at(step), step * z))
        for _ in range(CORRECTIONS):
            found = derivative(more, found.h, system.weights, self._unknown)
            last, z = found.value - z, found.value
            found = replace(found, error=found.error + np.abs(last))
            if system.norm(last) <= EXACT * system.norm(z):
                break
        return found

    @cached_property
    def _unknown(self) -> float:
        """The displacement [m] caused by round-off of the forces."""
        d = self.zero if self.linear else self.model.displacements(self.z, self.t)
        return self.system.norm(self.system.matrix.solve(self.system.noise(d, self.t)))

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the state of a model at the unknowns z + change."""
        return [self.state_at(model, self.z + change, self.load_factor(model))]

    def state_at(self, model: Model, z: Array, t: float | None = None) -> State:
        """Return the state of a model at unknowns z (n,), and at another load factor if given."""
        t = self.t if t is None else t
        system, d = self.system_of(model), model.displacements(z, t)
        if not self.linear:
            found = system.forces(d, t)
            return replace(self.state, t=t, side=t, d=d, Q=found.Q, F=found.F, energy=found.energy,
                           turned=system.count(d, t))
        start = system.assemble(self.zero, t, load_stiffness=False)
        elastic, natural = system.action(self.zero, d, t, linear=True), np.zeros_like(d)
        energy = 0.5 * float(elastic[:model.n_q] @ d[:model.n_q])
        energy += system.add_natural(natural, self.zero, None, t) + float(natural @ d)
        return replace(self.state, d=d, Q=start.Q + elastic, F=start.F, energy=energy)


class EndAtLoadFactor(Equilibrium):
    """The end of a path at a load factor that the case gives."""

    def load_factor(self, model: Model) -> float:
        """Return the load factor that the case of a model gives."""
        spec = model.case.solver
        assert isinstance(spec, Static)
        assert isinstance(spec.until, LoadFactor)
        return spec.until.value


class PathEnd(OneByOne):
    """A state of a path with an unknown load factor t: a limit point, or where a probe reaches a value.

    R(z, t) = 0 has one equation too few; g(z, t) = 0 is added. For a probe, g is the distance from the value; at a
    limit point, psi^T K phi with the fixed null vectors psi and phi of K there (Griewank & Reddien, SIAM Journal on
    Numerical Analysis 21, 1984), which gives t' = -psi^T dR/dp / psi^T dR/dt there.
    """

    def __init__(self, model: Model, state: State, limit: bool) -> None:
        self.model, self.limit = model, limit
        self.rest = Equilibrium(model, state, polish=0)
        self.system, self.curve, n = self.rest.system, Curve(self.rest.system, 0.0, 1), len(self.rest.z)
        self.t_size = abs(self.rest.t) or 1.0
        # initially a random direction that is not perpendicular to the path
        start = self.rest.z / (self.system.norm(self.rest.z) or 1.0)
        self.tangent = np.append(start + 1e-3 * np.random.default_rng(0).standard_normal(n), self.rest.t)
        self._factor()
        for _ in range(POLISH):
            self._factor()
            off = self._unbalanced(model)
            change = self._met(-self._within(off[:-1]), -off[-1])
            self.rest.z, self.rest.t = self.rest.z + change[:-1], self.rest.t + float(change[-1])
        self._factor()

    def _factor(self) -> None:
        """Factor [K, dR/dt; c], where c is parallel to the path, and find the path's tangent (n + 1,)."""
        from scipy.sparse import block_array

        system, t = self.system, self.rest.t
        self.d = d = self.model.displacements(self.rest.z, t)
        system.assemble(d, t)
        self.by_t = self.curve.load_rate(d, t)
        K = to_sparse(self.model, system.matrix, system.matrix.target.values)
        self.c = self.tangent * np.append(system.weights**2, (self.model.extent / self.t_size)**2)
        rows = [[K, self.by_t[:, None]], [self.c[None, :-1], self.c[None, -1:]]]
        A = block_array(rows, format="csc")
        last = np.append(np.zeros(len(K.indptr) - 1), 1.0)
        self.factors = Factors(A)
        self.tangent, psi = self.factors.solve(last), Factors(A.T.tocsc()).solve(last)[:-1]
        # not finite if no load changes with the load factor
        with np.errstate(divide="ignore", invalid="ignore"):
            self.tangent = self.tangent / system.norm(self.tangent[:-1])
            self.phi, self.psi = self.tangent[:-1], psi / float(psi @ self.by_t)
        self.met = self._rate(self.tangent)

    def _within(self, b: Array) -> Array:
        """Return a change (n + 1,) of z and t that changes R by b (n,), refined with K through the strains."""
        x = self.factors.solve(np.append(b, 0.0))
        for _ in range(2):
            off = b - self._stiffness(self.system, self.d, self.rest.t, x[:-1]) - x[-1] * self.by_t
            x = x + self.factors.solve(np.append(off, -float(self.c @ x)))
        return np.asarray(x)

    def _met(self, change: Array, b: float) -> Array:
        """Return a change (n + 1,) moved along the path so that it changes g by b."""
        return np.asarray(change + (b - self._rate(change)) / self.met * self.tangent)

    def _rate(self, direction: Array) -> float:
        """Return the derivative of g along a direction (n + 1,)."""
        size = max(self.system.norm(direction[:-1]) / self.model.extent, abs(float(direction[-1])) / self.t_size)
        h = ALONG / size if size else 1.0
        return float(derivative(lambda k: np.array([self._goal(self.model, *(
            self.rest.z + k * direction[:-1], self.rest.t + k * float(direction[-1])))]), h).value[0])

    def _goal(self, model: Model, z: Array, t: float) -> float:
        """Return g of a model."""
        d, spec = model.displacements(z, t), model.case.solver
        if self.limit:
            return float(self.psi @ self._stiffness(self.rest.system_of(model), d, t, self.phi))
        assert isinstance(spec, Static)
        goal = goal_of(model, spec.until)
        assert goal is not None
        goal.settle(*self.rest.turns)
        return goal.distance(d, t)

    @staticmethod
    def _stiffness(system: System, d: Array, t: float, x: Array) -> Array:
        """Return K x (n,), computed through the strains."""
        num = system.model.numbering
        return num.reduce(system.action(d, num.expanded(x), t, loads=True))

    def _unbalanced(self, model: Model) -> Array:
        """Return R and g (n + 1,) of a model at this state."""
        return np.append(self.rest.residual(model), self._goal(model, self.rest.z, self.rest.t))

    def slope(self, at: ModelAt, h: float) -> Quotient:
        """Return dz/dp and dt/dp (n + 1,). Raises UnsuitedError if no load changes with the load factor."""
        if not np.isfinite(self.met):
            raise UnsuitedError("no load changes with the load factor there, as where a tendon hangs loose")
        weights = np.append(self.system.weights, [self.model.extent / self.t_size, 1.0 / abs(self.met)])

        def changes(step: float) -> Array:
            off = self._unbalanced(at(step))
            return np.append(-self._within(off[:-1]), -off[-1])
        found = derivative(changes, h, weights)
        error = found.error[:-1] + found.error[-1] / abs(self.met) * np.abs(self.tangent)
        return Quotient(self._met(found.value[:-1], found.value[-1]), error, found.h)

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the state of a model with unknowns and load factor changed."""
        return [self.rest.state_at(model, self.rest.z + change[:-1], self.rest.t + float(change[-1]))]


class Path(OneByOne):
    """The end of a path and some of its limit points, given by number."""

    def __init__(self, model: Model, states: Sequence[State], limits: Sequence[int]) -> None:
        spec, self.last = model.case.solver, states[-1]
        assert isinstance(spec, Static)
        self.limits = sorted(set(limits))
        passed = [next(s for s in states if len(s.report["limit_points"]) >= k) for k in self.limits]
        self.parts: list[Equilibrium | PathEnd] = [PathEnd(model, s, limit=True) for s in passed]
        if isinstance(spec.until, LoadFactor):
            self.parts.append(EndAtLoadFactor(model, self.last))
        else:
            self.parts.append(PathEnd(model, self.last, isinstance(spec.until, LimitPoints)))

    def slope(self, at: ModelAt, h: float) -> Quotient:
        """Return the derivatives of all these states, concatenated."""
        found = [part.slope(at, h) for part in self.parts]
        self.lengths = np.cumsum([len(q.value) for q in found])
        return Quotient(np.concatenate([q.value for q in found]), np.concatenate([q.error for q in found]),
                        min(q.h for q in found))

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the last state, with the limit points in its report."""
        found = [part.states(model, one)[0]
                 for part, one in zip(self.parts, np.split(change, self.lengths[:-1]), strict=True)]
        points, observer = list(self.last.report["limit_points"]), Observer(model)
        for k, state in zip(self.limits, found[:-1], strict=True):
            points[k - 1] = {"factor": state.t, "probes": observer.observe(state)}
        return [replace(found[-1], report={**self.last.report, "limit_points": points})]
