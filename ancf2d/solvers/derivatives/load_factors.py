"""Derivatives of load factors of buckling, and of factors at which small motions begin to grow, by a number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ..small_motions.changes import about_without_flow, load_change, set_speed, speed_change
from ..small_motions.linearised import Base, Linearised, to_sparse
from ..small_motions.lowest_modes import Pencil
from ..small_motions.projected import Quadratic
from ..state import State
from ..statics.buckling import response_state
from ..statics.load_rates import SMALL, points_of, residual_rate, response_size, step_of, tangent_rate
from .differences import Quotient, UnsuitedError, derivative
from .onsets import Onset, Singular, times
from .small_motions import BESIDE, EQUAL, SmallMotions, joined, null_vectors, parted, parts
from .statics import POLISH, OneByOne
from .varied_motions import ModelAt

if TYPE_CHECKING:
    from scipy.sparse import csc_array


class LinearResponse(OneByOne):
    """The linear response u to the loads that the factor scales, and the derivative of the tangent along it.

    Both are those of ``statics.buckling``.
    """

    def __init__(self, model: Model, state: State) -> None:
        self.model, self.state = model, state
        self.pencil = self.pencil_of(model)
        self.pencil.system.factor({"solver": "buckling"})
        self.u = (state.d - self.pencil.d)[model.numbering.free]
        for _ in range(POLISH):
            self.u = self.u - self.pencil.solve(self._unbalanced(self.pencil, self.u))
        way = self.full(model, self.u)
        self.h = step_of(self.pencil, way, response_size(self.pencil, way))

    def pencil_of(self, model: Model) -> Pencil:
        """Return the tangent of a model at the reference."""
        return Pencil(model, model.displacements(np.zeros(model.numbering.n_unknowns), 0.0), 0.0, True)

    @staticmethod
    def full(model: Model, u: Array) -> Array:
        """Return dd/dt (n_full,) of its unknowns u (n,)."""
        out = model.numbering.expanded(u)
        if model.moves:
            zero = np.zeros(len(u))
            out += (model.displacements(zero, SMALL) - model.displacements(zero, -SMALL)) / (2 * SMALL)
        return out

    def _unbalanced(self, pencil: Pencil, u: Array) -> Array:
        """Return dR/dt + K u (n,) at the reference."""
        return np.asarray(residual_rate(pencil)[0] + pencil.model.numbering.reduce(
            pencil.full_stiffness(self.full(pencil.model, u))))

    def change(self, at: ModelAt, h: float) -> Quotient:
        """Return du/dp (n,)."""
        first = derivative(lambda s: self._unbalanced(self.pencil_of(at(s)), self.u), h)
        change = -self.pencil.solve(first.value)
        return Quotient(change, np.zeros_like(change), first.h, np.zeros_like(change))

    def rate(self) -> csc_array:
        """Return dK/dt (n, n) along the response, as assembled."""
        from scipy.sparse import diags_array

        free, pencil = self.model.numbering.free, self.pencil
        values = tangent_rate(pencil, self.full(self.model, self.u), self.h)
        moved = diags_array((free < self.model.n_q).astype(float))
        return (moved @ to_sparse(self.model, pencil.matrix, values) @ moved).tocsc()

    def rates(self, pencil: Pencil, u: Array, Y: Array, X: Array) -> Array:
        """Return Y^T dK/dt X (m, k) along a response u, through the strains, without the rows of constraints."""
        num, way = pencil.model.numbering, self.full(pencil.model, u)
        left, right = (np.array([self._moved(pencil.model, x) for x in Z.T]) for Z in (Y, X))
        out = np.zeros((len(left), len(right)))
        for k, weight in points_of(pencil.model):
            moved = [pencil.system.action(pencil.d + k * self.h * way, one, k * self.h, loads=True) for one in right]
            out += weight / (12 * self.h) * (left @ np.array(moved).reshape(-1, len(num.place)).T)
        return out

    @staticmethod
    def _moved(model: Model, x: Array) -> Array:
        """Return x (n,) in full coordinates (n_full,), without multipliers."""
        num = model.numbering
        return num.expanded(np.where(num.free < num.n_q, x, 0.0))

    def state_with(self, model: Model, du: Array, numbers: Sequence[int], changes: Array) -> State:
        """Return the linear response of a model with u and some load factors changed (``numbers`` from 1)."""
        n, pencil = len(self.u), self.pencil_of(model)
        factors = np.array(self.state.report["load_factors"])
        factors[np.array(numbers, dtype=int) - 1] += changes
        found = response_state(pencil, pencil.d, self.full(model, self.u + du), factors, np.zeros((len(factors), n)),
                               [], 0)
        return replace(found, report=_report(self.state, factors))


def _report(state: State, factors: Array) -> dict[str, Any]:
    """Return the report of a state with other load factors."""
    critical = [{**one, "factor": f} for one, f in zip(state.report["critical"], factors.tolist(), strict=True)]
    return {**state.report, "load_factors": factors.tolist(), "critical": critical}


class Instability(LinearResponse):
    """Linear buckling (K + mu dK/dt) phi = 0: mu' = -phi^T (K' + mu (dK/dt)') phi / phi^T dK/dt phi.

    ``wanted``: the numbers (from 1) of the load factors to be differentiated.
    """

    def __init__(self, model: Model, state: State, wanted: Sequence[int]) -> None:
        super().__init__(model, state)
        self.wanted = list(wanted)
        self.shapes = [self._shapes(k - 1) for k in wanted]

    def _shapes(self, number: int) -> tuple[float, Array, int]:
        """Return a load factor, the shapes (n, m) of all that are equal to it, and its place among them.

        Raises ComputationError if there may be more equal ones than were computed.
        """
        factors = self.state.report["load_factors"]
        near = [k for k, f in enumerate(factors) if abs(f - factors[number]) <= EQUAL * abs(factors[number])]
        if len(near) > 1 and near[-1] == len(factors) - 1:
            raise ComputationError(f"the load factor {factors[number]:.9g} is one of several equal ones, of which "
                                   "there may be more than solver.modes",
                                   advice=f"solver.modes: {len(factors) + 2}")
        factor = float(np.mean([factors[k] for k in near]))
        pencil, n_q, free = self.pencil, self.model.n_q, self.model.numbering.free
        shapes = self.state.arrays["modes/shapes"][0][near]
        K, rate = to_sparse(self.model, pencil.matrix, pencil.K), factor * self.rate()
        start = np.where(free < n_q, shapes[:, np.minimum(free, n_q - 1)], 0.0).T
        return factor, null_vectors(K + (1.0 + BESIDE) * rate, K + rate, start).real, near.index(number)

    def slope(self, at: ModelAt, h: float) -> Quotient:
        """Return du/dp (n,) of the response, then dmu/dp of the factors, with a ``kink`` where equal ones separate."""
        first = self.change(at, h)

        def forms(step: float) -> Array:
            pencil, u = self.pencil_of(at(step)), self.u + step * first.value
            return np.concatenate([
                (X.T @ np.array([pencil.stiffness(x) for x in X.T]).T + mu * self.rates(pencil, u, X, X)).ravel()
                for mu, X, _ in self.shapes])
        found = derivative(forms, h)
        out, n = [first], 0
        for _, X, place in self.shapes:
            m = X.shape[1]
            F, off = (-one[n:n + m * m].reshape(m, m) for one in (found.value, found.error))
            out.append(parted(self.rates(self.pencil, self.u, X, X), F, off, [place]))
            n += m * m
        return joined(out, found.h)

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the linear response of a model with its load factors changed."""
        n = len(self.u)
        return [self.state_with(model, change[:n], self.wanted, change[n:])]


class _Loads(LinearResponse):
    """Loads without a potential, scaled by the factor: it adds mu dK/dt to K, along the linear response."""

    def __init__(self, model: Model, state: State) -> None:
        super().__init__(model, state)
        self.adds = load_change(model, self.pencil.d, self.full(model, self.u), self.rate(), self.h)
        self.n = len(self.u)

    def matrices(self, model: Model, change: Array) -> Quadratic:
        """Return the matrices of a model without the contribution of the factor."""
        pencil = self.pencil_of(model)
        zero = np.zeros(len(pencil.d))
        about = State(0.0, pencil.d, zero, zero, 0.0, turned=pencil.system.turns()[1])
        return Quadratic(Linearised(Base(model, about, True)), relaxes=True)

    def added(self, problem: Quadratic, change: Array, one: Onset) -> complex:
        """Return y^T T_added x, the contribution of the factor, for a response changed by ``change`` (n,)."""
        Y, X = (np.array([v.real, v.imag]).T for v in (one.y, one.x))
        pencil, u = problem.small.pencil, self.u + change
        found = np.array([1.0, 1j]) @ self.rates(pencil, u, Y, X) @ np.array([1.0, 1j])
        drag = load_change(pencil.model, pencil.d, self.full(pencil.model, u), None, self.h)
        return complex(one.factor * found + one.y @ times(drag, one.s, one.factor, one.x))


class _Flows(SmallMotions):
    """Flow along bodies with velocities scaled by the factor: it adds mu^2 to K and mu to C, about the state without
    flow.
    """

    def __init__(self, model: Model, state: State) -> None:
        self.adds = speed_change(model)
        set_speed(model, 0.0)
        super().__init__(model, state, about_without_flow(model), True)
        set_speed(model, 1.0)

    def matrices(self, model: Model, change: Array) -> Quadratic:
        """Return the matrices of a model without the factor's contribution, for a state changed by ``change`` (n,)."""
        set_speed(model, 0.0)
        return self.problem_at(model, self.z + change if self.n else self.z)

    def change(self, at: ModelAt, h: float) -> Quotient:
        """Return dz/dp (n,) of the state, if it is an equilibrium."""
        def still(step: float) -> Model:
            model = at(step)
            set_speed(model, 0.0)
            return model
        return self.varied_matrices(still, h)[1]

    def added(self, problem: Quadratic, change: Array, one: Onset) -> complex:
        """Return y^T T_added x, the contribution of the factor."""
        model = problem.small.model
        set_speed(model, 1.0)
        adds = speed_change(model)
        set_speed(model, 0.0)
        return complex(one.y @ times(adds, one.s, one.factor, one.x))

    def state_with(self, model: Model, dz: Array, numbers: Sequence[int], changes: Array) -> State:
        """Return the state of a model with its unknowns and some factors changed (``numbers`` from 1)."""
        factors = np.array(self.state.report["load_factors"])
        factors[np.array(numbers, dtype=int) - 1] += changes
        set_speed(model, 0.0)
        found = self.state_at(model, self.z + dz if self.n else self.z)
        set_speed(model, 1.0)
        return replace(found, report=_report(self.state, factors))


class Growth(OneByOne):
    """Factors at which small motions begin to grow: with y^T T = T x = 0 there, 0 = y^T (T' + s' dT/ds + mu' dT/dmu) x.

    In divergence s stays 0. Flutter begins with an imaginary s if anything dissipates or supplies energy, else where
    two frequencies meet, with y^T dT/ds x = 0. ``wanted``: the numbers of the factors to be differentiated.
    """

    def __init__(self, model: Model, state: State, wanted: Sequence[int]) -> None:
        self.loading = _Flows(model, state) if model.loads.flows else _Loads(model, state)
        self.state, self.wanted, self.n, self.reason = state, list(wanted), self.loading.n, ""
        singular = Singular(self.loading.matrices(model, np.zeros(self.n)), self.loading.adds)
        critical = [state.report["critical"][k - 1] for k in wanted]
        try:
            self.onsets = [singular.near(one["factor"], one["omega"]) for one in critical]
        except UnsuitedError as error:
            self.reason = str(error)

    def slope(self, at: ModelAt, h: float) -> Quotient:
        """Return the derivative (n,) of the state or response, then dmu/dp of the factors.

        Raises UnsuitedError if that is not known, ComputationError if it does not exist.
        """
        if self.reason:
            raise UnsuitedError(self.reason)
        first = self.loading.change(at, h)

        def forms(step: float) -> Array:
            change = step * first.value
            problem = self.loading.matrices(at(step), change)
            if problem.small.rates.damps and any(one.meets for one in self.onsets):
                raise ComputationError("even vanishing damping changes the factor at which motions grow, so there is "
                                       "no derivative at zero damping", advice="a small damping instead of 0")
            return parts(np.array([one.y @ problem.action(one.s, one.x) + self.loading.added(problem, change, one)
                                   for one in self.onsets]))
        scale = np.repeat([1.0 / (abs(one.by[1]) * abs(one.factor)) for one in self.onsets], 2)
        found = derivative(forms, h, scale) if self.onsets else Quotient(np.zeros(0), np.zeros(0), h)
        by_p, off = (x.reshape(-1, 2) @ [1.0, 1j] for x in (found.value, found.error))
        rates = [[one.rate(by) for one, by in zip(self.onsets, some, strict=True)] for some in (by_p, off, off.conj())]
        return joined([replace(first, kink=np.zeros_like(first.value)),
                       Quotient(np.array(rates[0]), np.abs(rates[1:]).max(0), found.h, np.zeros(len(self.onsets)))],
                      found.h)

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the state of a model with its factors changed."""
        return [self.loading.state_with(model, change[:self.n], self.wanted, change[self.n:])]
