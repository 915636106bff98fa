"""How the states of a model change with a number of its case, to first order, without solving for them again.

R(z, p) = 0 gives dz/dp = -K^-1 dR/dp with the tangent K of the solution: one factorisation for all numbers. dR/dp is
taken by differences of models that are built beside the number at the same unknowns z, so that every kind of number is
differentiated by the same few lines. What is read from states (``states``) is then differentiated along (z', p').
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ..case import Buckling, Eigen, LinearStatic, LoadFactor, Static
from ..elements.shape import Array
from ..errors import ComputationError
from ..interactions.forces import LoadSet
from ..model.model import Model
from .beside import Varied, unsuited
from .buckling import STEP as STRETCH
from .buckling import response_size, response_state, tangent_rate
from .contact import memory, recall
from .differences import Quotient, derivative
from .factors import Factors
from .linearised import Base, Linearised, stored
from .lowest_modes import Pencil
from .motion_variation import Motion
from .projected import Complex, Quadratic
from .refine import refined
from .state import State
from .static import unscaled
from .system import System

# corrections of a solution before it is differentiated, and of eigenvectors
POLISH, ITERATIONS = 3, 3
# eigenvalues this close, relative, are one; and how far from one its matrix is factored
EQUAL, BESIDE = 1e-6, 1e-7
# half the difference in the load factor that rates are formed with
SMALL = 1e-4


class Response(Protocol):
    """The first change of what a solver finds."""

    def slope(self, at: Varied, h: float) -> Quotient:
        """Return the derivative of all that changes, by differences of models with steps near h."""
        ...

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the states of a model beside the first one, where everything has changed by so much."""
        ...

    def prepare(self, beside: Sequence[tuple[Varied, float]]) -> None:
        """Find together what is found more cheaply for several numbers than for each."""
        ...


class _OneByOne:
    """What is found for each number by itself."""

    def prepare(self, beside: Sequence[tuple[Varied, float]]) -> None:
        """Do nothing."""


class Equilibrium(_OneByOne):
    """An equilibrium R(z, t) = 0 at a load factor t, or the solution of linear statics."""

    def __init__(self, model: Model, state: State, linear: bool = False) -> None:
        self.model, self.t, self.linear, self.state = model, state.t, linear, state
        self.z = state.d[model.numbering.free].copy()
        self.contacts = memory(model) if model.contacts else None
        self.turns = state.d.copy(), model.turns.from_reference(state.d) if state.turned is None else state.turned
        self.system = self._system(model)
        self.zero = np.zeros(len(state.d))
        self.tangent_at(self.z)
        for _ in range(POLISH):
            self.correct()

    def tangent_at(self, z: Array) -> None:
        """Factor the tangent at unknowns z (n,), in linear statics that of the reference."""
        d = self.zero if self.linear else self.model.displacements(z, self.t)
        self.system.assemble(d, self.t, load_stiffness=not self.linear)
        self.system.factor({"factor": self.t})

    def correct(self) -> float:
        """Move the unknowns to where the tangent balances the forces; return by how much [m]."""
        step = self._solved(-self.residual(self.model))
        self.z = self.z + step
        return self.system.norm(step)

    def _system(self, model: Model) -> System:
        system = System(model)
        system.count_from(self.turns)
        if self.contacts is not None:
            recall(model, self.contacts)
        return system

    def _solved(self, b: Array) -> Array:
        """Return K^-1 b to the digits that the strains have."""
        model, num = self.model, self.model.numbering
        d = self.zero if self.linear else model.displacements(self.z, self.t)

        def apply(z: Array) -> Array:
            full = np.zeros(len(d))
            num.expand(z, full)
            return num.reduce(self.system.action(d, full, self.t, linear=self.linear, loads=not self.linear))
        if not b.any():
            return np.zeros_like(b)
        if model.symmetric or self.linear:
            return refined(apply, self.system.matrix.solve, self.system.norm, b, 0.0)[0]
        z = self.system.matrix.solve(b)
        return np.asarray(z + self.system.matrix.solve(b - apply(z)))

    def residual(self, model: Model) -> Array:
        """Return R (n,) of a model at the unknowns of this equilibrium."""
        system, d = self._system(model), model.displacements(self.z, self.t)
        if not self.linear:
            return system.forces(d, self.t).R
        start = system.assemble(self.zero, self.t, load_stiffness=False)
        return start.R + model.numbering.reduce(system.action(self.zero, d, self.t, linear=True))

    def slope(self, at: Varied, h: float) -> Quotient:
        """Return dz/dp (n,).

        Steps are judged by the displacements that the residuals stand for: at the same unknowns stiff motions take
        part, whose forces are far larger than those that the loads balance.
        """
        weights = self.system.weights
        return derivative(lambda s: -self._solved(self.residual(at(s))), h, weights, self._unknown)

    @cached_property
    def _unknown(self) -> float:
        """What round-off of the forces does to displacements [m]."""
        d = self.zero if self.linear else self.model.displacements(self.z, self.t)
        return self.system.norm(self.system.matrix.solve(self.system.noise(d, self.t)))

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the state of a model at the unknowns z + change."""
        return [self.state_at(model, self.z + change)]

    def state_at(self, model: Model, z: Array) -> State:
        """Return the state of a model at unknowns z (n,)."""
        system, d, t = self._system(model), model.displacements(z, self.t), self.t
        if not self.linear:
            found = system.forces(d, t)
            return replace(self.state, d=d, Q=found.Q, F=found.F, energy=found.energy, turned=system.count(d, t))
        start = system.assemble(self.zero, t, load_stiffness=False)
        elastic, natural = system.action(self.zero, d, t, linear=True), np.zeros_like(d)
        energy = 0.5 * float(elastic[:model.n_q] @ d[:model.n_q])
        energy += system.add_natural(natural, self.zero, None, t) + float(natural @ d)
        return replace(self.state, d=d, Q=start.Q + elastic, F=start.F, energy=energy)


@dataclass
class _Mode:
    """An eigenvalue s [1/s], its entry in the report, and its right and left vectors (n,)."""

    entry: int
    s: complex
    x: Complex
    y: Complex
    scale: complex


class Vibration(_OneByOne):
    """Eigenvalues of small motions about a state, T(s) x = 0: s' = -y^T T'(s) x / y^T dT/ds x.

    ``wanted``: the kinds and numbers of those that are differentiated.
    """

    def __init__(self, model: Model, state: State, wanted: Sequence[tuple[str, int]]) -> None:
        spec = model.case.solver
        assert isinstance(spec, Eigen)
        self.model, self.state, self.damped = model, state, spec.damped
        self.loaded = spec.about == "static" or model.case.steady_rotation is not None
        self.rest = Equilibrium(model, state) if self.loaded else None
        self.z = state.d[model.numbering.free] if self.rest is None else self.rest.z
        self.problem = self._problem(model, self.z)
        entries = state.report["frequencies"]
        self.modes = [self._mode(k) for k, e in enumerate(entries) if (e["kind"], e["number"]) in wanted]

    def _problem(self, model: Model, z: Array) -> Quadratic:
        base = model if self.loaded else replace(model, loads=LoadSet(flows=model.loads.flows))
        if self.rest is not None:
            state = self.rest.state_at(model, z)
        else:
            d = base.displacements(z, self.state.t)
            state = replace(self.state, d=d, turned=None)
        return Quadratic(Linearised(Base(base, state, self.loaded)), self.damped, relaxes=self.damped)

    def _mode(self, entry: int) -> _Mode:
        entries, p = self.state.report["frequencies"], self.problem
        s = complex(entries[entry]["growth"], entries[entry]["omega"])
        near = [e for e in entries if abs(complex(e["growth"], e["omega"]) - s) <= EQUAL * abs(s)]
        if len(near) > 1 or not s.imag:
            what = "is that of a motion that does not vibrate" if not s.imag else "is one of several that are equal"
            raise ComputationError(f"the frequency omega = {s.imag:.9g} {what}: it has no derivative",
                                   at={"mode": entry + 1}, advice="a goal that names another mode, or a model without "
                                   "that symmetry")
        A = p.matrix(s * (1.0 + BESIDE))
        start = self.state.arrays["modes/shapes"][0][entry].astype(complex)
        if "modes/quarter" in self.state.arrays:
            start = start + 1j * self.state.arrays["modes/quarter"][0][entry]
        free = self.model.numbering.free
        x = np.where(free < self.model.n_q, start[np.minimum(free, self.model.n_q - 1)], 0.0)
        x, y = _null(Factors(A), x), _null(Factors(A.T.tocsc()), x.conj())
        scale = complex(y @ p.slope(s, x))
        return _Mode(entry, s, x, y, scale)

    @cached_property
    def _n(self) -> int:
        return len(self.z) if self.rest is not None else 0

    def slope(self, at: Varied, h: float) -> Quotient:
        """Return dz/dp (n,) of the state, where it is an equilibrium, then ds/dp of the modes (real, imaginary)."""
        moved = None if self.rest is None else self.rest.slope(at, h)

        def forms(step: float) -> Array:
            z = self.z if moved is None else self.z + step * moved.value
            p = self._problem(at(step), z)
            out = [complex(-(m.y @ p.action(m.s, m.x)) / m.scale) for m in self.modes]
            return np.array([part for one in out for part in (one.real, one.imag)])
        found = derivative(forms, h)
        first = (np.zeros(0), np.zeros(0)) if moved is None else (moved.value, moved.error)
        return Quotient(np.append(first[0], found.value), np.append(first[1], found.error), found.h)

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the state of a model with its frequencies changed."""
        state = self.state if self.rest is None else self.rest.state_at(model, self.z + change[:self._n])
        report = {**self.state.report, "frequencies": [dict(e) for e in self.state.report["frequencies"]]}
        for mode, (real, imaginary) in zip(self.modes, change[self._n:].reshape(-1, 2).tolist(), strict=True):
            entry = report["frequencies"][mode.entry]
            entry["growth"] += real
            entry["omega"] += imaginary
            entry["hz"] = entry["omega"] / (2 * math.pi)
        if self.rest is None:
            d = model.displacements(self.z, self.state.t)
            return [replace(state, d=d, report=report)]
        return [replace(state, report=report)]


def _each(apply: Callable[[Array], Array], x: Complex) -> Complex:
    """Return A x of a real A."""
    return np.asarray(apply(np.ascontiguousarray(x.real)) + 1j * apply(np.ascontiguousarray(x.imag)))


def _null(factors: Factors, x: Complex) -> Complex:
    """Return the vector that a nearly singular matrix makes 0, by inverse iteration from another."""
    for _ in range(ITERATIONS):
        x = factors.solve(x)
        x = x / np.linalg.norm(x)
    return x


class Instability(_OneByOne):
    """Linear buckling (K + mu dK/dt) phi = 0: mu' = -phi^T (K' + mu (dK/dt)') phi / phi^T dK/dt phi.

    The linear response u and its rate of the tangent are those of ``solvers.buckling``. ``wanted``: the numbers of the
    load factors that are differentiated, from 1 on.
    """

    def __init__(self, model: Model, state: State, wanted: Sequence[int]) -> None:
        self.model, self.state, self.wanted = model, state, list(wanted)
        self.pencil = self._pencil(model)
        self.pencil.system.factor({"solver": "buckling"})
        self.u = (state.d - self.pencil.d)[model.numbering.free]
        for _ in range(POLISH):
            self.u = self.u - self.pencil.solve(self._unbalanced(self.pencil, self.u))
        self.h = STRETCH / response_size(self.pencil, self._full(model, self.u))
        self.values = [state.report["load_factors"][k - 1] for k in wanted]
        for one in self.values:
            if sum(abs(f - one) <= EQUAL * one for f in state.report["load_factors"]) > 1:
                raise ComputationError(f"the load factor {one:.9g} is one of several that are equal: it has no "
                                       "derivative", advice="a model without that symmetry")
        self.shapes = [self._shape(k - 1, one) for k, one in zip(wanted, self.values, strict=True)]

    def _pencil(self, model: Model) -> Pencil:
        return Pencil(model, model.displacements(np.zeros(model.numbering.n_unknowns), 0.0), 0.0, True)

    def _shape(self, number: int, factor: float) -> Array:
        """Return a shape (n,), with its multipliers, to the last digits."""
        from scipy.sparse import diags_array

        pencil, n_q, free = self.pencil, self.model.n_q, self.model.numbering.free
        shape = self.state.arrays["modes/shapes"][0][number]
        rate = stored(self.model, pencil.matrix, tangent_rate(pencil, self._full(self.model, self.u), self.h))
        moved = diags_array((free < n_q).astype(float))
        A = stored(self.model, pencil.matrix, pencil.K) + factor * (1.0 + BESIDE) * (moved @ rate @ moved)
        start = np.where(free < n_q, shape[np.minimum(free, n_q - 1)], 0.0)
        return np.asarray(_null(Factors(A.tocsc()), start).real)

    @staticmethod
    def _full(model: Model, u: Array) -> Array:
        """Return dd/dt (n_full,) of its unknowns u (n,)."""
        out = np.zeros(len(model.numbering.place))
        model.numbering.expand(u, out)
        if model.moves:
            zero = np.zeros(len(u))
            out += (model.displacements(zero, SMALL) - model.displacements(zero, -SMALL)) / (2 * SMALL)
        return out

    def _unbalanced(self, pencil: Pencil, u: Array) -> Array:
        """Return dR/dt + K u (n,) at the reference."""
        high, low = (pencil.system.forces(pencil.d, t) for t in (SMALL, -SMALL))
        return np.asarray((high.R - low.R) / (2 * SMALL)
                          + pencil.model.numbering.reduce(pencil.full_stiffness(self._full(pencil.model, u))))

    def _rate(self, pencil: Pencil, u: Array, x: Array) -> float:
        """Return x^T dK/dt x along the response u, by way of the strains; constraints' rows have no part in it."""
        num = pencil.model.numbering
        full, way, out = np.zeros(len(num.place)), self._full(pencil.model, u), 0.0
        num.expand(np.where(num.free < num.n_q, x, 0.0), full)
        for k, weight in ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0)):
            moved = pencil.system.action(pencil.d + k * self.h * way, full, k * self.h, loads=True)
            out += weight / (12 * self.h) * float(full @ moved)
        return out

    def slope(self, at: Varied, h: float) -> Quotient:
        """Return du/dp (n,) of the response, then dmu/dp of the factors."""
        first = derivative(lambda s: self._unbalanced(self._pencil(at(s)), self.u), h)
        change = -self.pencil.solve(first.value)

        def forms(step: float) -> Array:
            pencil, u = self._pencil(at(step)), self.u + step * change
            return np.array([float(x @ pencil.stiffness(x)) + mu * self._rate(pencil, u, x)
                             for x, mu in zip(self.shapes, self.values, strict=True)])
        scales, found = np.array([self._rate(self.pencil, self.u, x) for x in self.shapes]), derivative(forms, h)
        return Quotient(np.append(change, -found.value / scales),
                        np.append(np.zeros_like(change), np.abs(found.error / scales)), found.h)

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the linear response of a model with its load factors changed."""
        n, pencil = len(self.u), self._pencil(model)
        factors = np.array(self.state.report["load_factors"])
        factors[np.array(self.wanted, dtype=int) - 1] += change[n:]
        return [response_state(pencil, pencil.d, self._full(model, self.u + change[:n]), factors,
                               np.zeros((len(factors), n)), [], 0)]


def why_not(model: Model) -> str:
    """Return why the states of a model have no such response, empty where they have one."""
    solver = model.case.solver
    if solver.moves:
        return unsuited(model)
    if model.remembers:
        return "materials remember the way to a state"
    if any(pair.item.friction for pair in model.contacts):
        return "friction depends on the way to a state"
    if solver.on_path and not isinstance(getattr(solver, "until", None), LoadFactor):
        return "the end of the path depends on the case"
    if solver.scales and (model.loads.flows or not model.symmetric):
        return "loads have no potential"
    if solver.scales and next(unscaled(model), None) is not None:
        return "constant loads have moved the model before"
    if not isinstance(solver, LinearStatic | Static | Eigen | Buckling):
        return "the solver has no states of equilibrium"
    return ""


def responses(model: Model, states: Sequence[Any], whole: bool, modes: Sequence[tuple[str, int]],
              factors: Sequence[int]) -> list[Response]:
    """Return the responses of the states of a run, of the last one unless ``whole``.

    ``modes`` and load ``factors`` (by number) are those that are wanted.
    """
    solver, kept = model.case.solver, states if whole else states[-1:]
    if solver.moves:
        return [Motion(model, states[-1], whole)]
    if isinstance(solver, Eigen):
        return [Vibration(model, state, modes) for state in kept]
    if isinstance(solver, Buckling):
        return [Instability(model, state, factors) for state in kept]
    return [Equilibrium(model, state, solver.linear) for state in kept]
