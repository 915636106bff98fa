"""Derivatives of small motions by a number of the case: of frequencies and responses.

The results satisfy A(p) x = f(p) or A(p) x = 0. Differences of varied models, applied to the same x, give A' x; left
vectors and factors of A turn these into derivatives of eigenvalues and responses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...case import Eigen, FrequencyResponse, Goal
from ...elements.shape import Array
from ...errors import ComputationError
from ...interactions.forces import LoadSet
from ...model.model import Model
from ..small_motions.factors import Factors
from ..small_motions.frequency_response import refined_response, response_of
from ..small_motions.inputs_and_outputs import Input, Inputs, Output, outputs
from ..small_motions.linearised import Base, Linearised
from ..small_motions.projected import Complex, Quadratic
from ..state import State
from .differences import Quotient, derivative
from .statics import Equilibrium, OneByOne
from .varied_motions import ModelAt

if TYPE_CHECKING:
    from scipy.sparse import csc_array

# iterations for eigenvectors, of each kind
ITERATIONS = 3
# relative difference of equal eigenvalues, and relative shift from one at which its matrix is factored
EQUAL, BESIDE = 1e-6, 1e-7
# y^T dT/ds x of equal eigenvalues, for vectors of size 1, below which they have too few eigenvectors
DEFECTIVE = 1e-6
# relative change of the last digit of a number
EPS = float(np.finfo(float).eps)
# tolerance of a peak, and step of differences around it, relative to the distance of frequencies
PEAK, AROUND = 1e-9, 0.02


class SmallMotions(OneByOne):
    """Small motions about a state of a model, and the derivatives of that state."""

    def __init__(self, model: Model, state: State, about: str, damped: bool) -> None:
        self.model, self.state, self.damped = model, state, damped
        self.noise: Array | None = None
        self.loaded = about == "static" or model.case.steady_rotation is not None
        self.rest = Equilibrium(model, state) if self.loaded else None
        self.z = state.d[model.numbering.free] if self.rest is None else self.rest.z
        self.problem = self.problem_at(model, self.z)
        self.n = len(self.z) if self.rest is not None else 0

    def state_at(self, model: Model, z: Array) -> State:
        """Return the state of a model about which motions are linearised, at unknowns z (n,)."""
        if self.rest is not None:
            return self.rest.state_at(model, z)
        return replace(self.state, d=model.displacements(z, self.state.t), turned=None)

    def problem_at(self, model: Model, z: Array) -> Quadratic:
        """Return the matrices of a model at unknowns z (n,)."""
        base = model if self.loaded else replace(model, loads=LoadSet(flows=model.loads.flows))
        small = Linearised(Base(base, self.state_at(base, z), self.loaded))
        return Quadratic(small, self.damped, relaxes=self.damped)

    def varied_matrices(self, at: ModelAt, h: float) -> tuple[Callable[[float], Quadratic], Quotient]:
        """Return the matrices as a function of the change of the number, and the derivative (n,) of an equilibrium."""
        if self.rest is None:
            return lambda step: self.problem_at(at(step), self.z), Quotient(np.zeros(0), np.zeros(0), h)
        rest = self.rest.slope(at, h)
        return lambda step: self.problem_at(at(step), self.z + step * rest.value), rest

    def round_off(self, f: Callable[[Quadratic], Array], rest: Quotient) -> Array | float:
        """Return the change of f(matrices) when the unknowns of the state change in their last digits.

        Stiff bodies turn these digits into forces, so that differences along a small change of the state, ``rest``,
        need longer steps.
        """
        if not rest.value.any():
            return 0.0
        if self.noise is None:
            z = self.z * (1.0 + EPS * np.random.default_rng(0).choice([-1.0, 1.0], len(self.z)))
            self.noise = np.abs(f(self.problem_at(self.model, z)) - f(self.problem))
        return self.noise

    def unknowns_and_rest(self, change: Array) -> tuple[Array, Array]:
        """Return the unknowns (n,) of the state changed by the first part of ``change``, and the rest of that."""
        return (self.z + change[:self.n] if self.n else self.z), change[self.n:]


@dataclass
class _Cluster:
    """An eigenvalue s [1/s], or several equal ones; their entries in the report, and right and left vectors (n, m).

    ``G`` (m, m) is y^T dT/ds x.
    """

    entries: list[int]
    wanted: list[int]
    s: complex
    x: Complex
    y: Complex
    G: Complex


class Vibration(SmallMotions):
    """Eigenvalues of small motions about a state, T(s) x = 0: s' = -y^T T'(s) x / y^T dT/ds x.

    For m equal ones, the derivatives are the m eigenvalues of the same expression with x, y (n, m) (Lancaster,
    Numerische Mathematik 6, 1964), in ascending order if the number increases, in descending order if it decreases.
    ``wanted``: kinds and numbers of the modes to be differentiated.
    """

    def __init__(self, model: Model, state: State, wanted: Sequence[tuple[str, int]]) -> None:
        spec = model.case.solver
        assert isinstance(spec, Eigen)
        super().__init__(model, state, spec.about, spec.damped)
        entries = state.report["frequencies"]
        self.clusters: list[_Cluster] = []
        for k, e in enumerate(entries):
            mine = next((c for c in self.clusters if k in c.entries), None)
            if (e["kind"], e["number"]) in wanted:
                if mine is None:
                    self.clusters.append(mine := self._cluster(k))
                mine.wanted.append(mine.entries.index(k))

    def _cluster(self, entry: int) -> _Cluster:
        entries, p = self.state.report["frequencies"], self.problem
        s = complex(entries[entry]["growth"], entries[entry]["omega"])
        values = np.array([complex(e["growth"], e["omega"]) for e in entries])
        near = np.flatnonzero(np.abs(values - s) <= EQUAL * abs(s)).tolist()
        if not s.imag:
            raise ComputationError(f"the frequency omega = {s.imag:.9g} belongs to a motion that does not vibrate, so "
                                   "it has no derivative", at={"mode": entry + 1}, advice="a goal for another mode")
        if near[-1] == len(entries) - 1 and len(near) > 1:
            raise ComputationError(f"the frequency omega = {s.imag:.9g} is one of several equal ones, of which there "
                                   "may be more than solver.modes", at={"mode": entry + 1},
                                   advice=f"solver.modes: {len(entries) + 2}")
        s = complex(values[near].mean())
        A, near_s, free, n_q = p.matrix(s), p.matrix(s * (1.0 + BESIDE)), self.model.numbering.free, self.model.n_q
        start = self.state.arrays["modes/shapes"][0][near].astype(complex)
        if "modes/quarter" in self.state.arrays:
            start = start + 1j * self.state.arrays["modes/quarter"][0][near]
        x = np.where(free < n_q, start[:, np.minimum(free, n_q - 1)], 0.0).T
        x, y = null_vectors(near_s, A, x), null_vectors(near_s.T, A.T, x.conj())
        slopes = np.array([p.slope(s, one) for one in x.T]).T
        G = y.T @ slopes
        sizes = np.linalg.norm(y, axis=0)[:, None] * np.linalg.norm(slopes, axis=0)
        if len(near) > 1 and np.linalg.svd(G / sizes, compute_uv=False)[-1] < DEFECTIVE:
            raise ComputationError(f"the frequencies omega = {s.imag:.9g} coalesce: their derivatives are infinite",
                                   at={"mode": entry + 1})
        return _Cluster(near, [], s, x, y, G)

    def slope(self, at: ModelAt, h: float) -> Quotient:
        """Return dz/dp (n,) of the state, if it is an equilibrium, then ds/dp of the modes (real, imaginary).

        For equal ones that separate, it is the mean of both sides, and ``kink`` the difference of each side from it.
        """
        problem, rest = self.varied_matrices(at, h)

        def forms(p: Quadratic) -> Array:
            return np.concatenate([parts(-(c.y.T @ np.array([p.action(c.s, x) for x in c.x.T]).T).ravel())
                                   for c in self.clusters])
        found = derivative(lambda step: forms(problem(step)), h, round_off=self.round_off(forms, rest))
        out, n = [replace(rest, kink=np.zeros_like(rest.value))], 0
        for c in self.clusters:
            m = len(c.entries)
            F, off = (x[n:n + 2 * m * m].reshape(m, m, 2) @ [1.0, 1j] for x in (found.value, found.error))
            out.append(parted(c.G, F, off, c.wanted))
            n += 2 * m * m
        return joined(out, found.h)

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the state of a model with its frequencies changed."""
        z, rest = self.unknowns_and_rest(change)
        report = {**self.state.report, "frequencies": [dict(e) for e in self.state.report["frequencies"]]}
        places = [c.entries[k] for c in self.clusters for k in c.wanted]
        for place, (real, imaginary) in zip(places, rest.reshape(-1, 2).tolist(), strict=True):
            entry = report["frequencies"][place]
            entry["growth"] += real
            entry["omega"] += imaginary
            entry["hz"] = entry["omega"] / (2 * math.pi)
        return [replace(self.state_at(model, z), report=report)]


class ForcedVibration(SmallMotions):
    """Responses to oscillating inputs: Z(s) x = f gives x' = Z^-1 (f' - Z' x) at each frequency.

    ``goals`` name a frequency each, or ask for the peak; without goals, all frequencies are differentiated. The peak of
    a range lies between its frequencies and is located first.
    """

    def __init__(self, model: Model, state: State, goals: Sequence[Goal] | None) -> None:
        spec = model.case.solver
        assert isinstance(spec, FrequencyResponse)
        super().__init__(model, state, spec.about, True)
        self.spec = spec
        self.inputs, self.outputs = self._read(self.problem)
        self.hz: list[float] = list(state.report["response"]["hz"])
        # place in the report, frequency, and the only goal that is read there
        self.at: list[tuple[int, float, Goal | None]] = [(k, hz, None) for k, hz in enumerate(self.hz)] \
            if goals is None else [(*self._place(goal), goal) for goal in goals]
        self.factors: list[Factors] = []
        self.x: list[list[Complex]] = []
        for _, hz, _ in self.at:
            s = 2j * math.pi * hz
            self.factors.append(Factors(self.problem.matrix(s)))
            self.x.append([refined_response(self.problem, self.factors[-1], self.problem.force(one, s), s)
                           for one in self.inputs])

    def _read(self, problem: Quadratic) -> tuple[list[Input], list[Output]]:
        return Inputs(problem.small)(self.spec.inputs), outputs(problem.small, self.spec.inputs)

    def _place(self, goal: Goal) -> tuple[int, float]:
        """Return the place in the report and the frequency of a goal; a peak is located between the frequencies."""
        if goal.hz is not None:
            return self.hz.index(goal.hz), goal.hz
        from scipy.optimize import brentq, minimize_scalar

        H = self.state.report["response"][goal.input][goal.probe][goal.quantity]
        k = int(np.argmax(np.hypot(H["re"], H["im"])))
        if self.spec.frequencies is not None:
            return k, self.hz[k]
        of = [one for one in self.inputs if one.name == goal.input]
        read = [one for one in self.outputs if (one.probe, one.quantity) == (goal.probe, goal.quantity)]

        def height(hz: float) -> float:
            s = 2j * math.pi * hz
            x = Factors(self.problem.matrix(s)).solve(self.problem.force(of[0], s))
            return -abs(response_of(self.problem, of, read, s, [x])[0, 0])
        low, high = self.hz[max(k - 1, 0)], self.hz[min(k + 1, len(self.hz) - 1)]
        peak = minimize_scalar(height, bounds=(low, high), method="bounded", options={"xatol": PEAK * (high - low)})
        if peak.fun >= height(self.hz[k]):
            return k, self.hz[k]

        def slope(hz: float) -> float:
            step = AROUND * (high - low)
            one, two = (height(hz + n * step) - height(hz - n * step) for n in (1, 2))
            return 8.0 * one - two
        # round-off limits a maximum to its square root, the zero of the slope only to round-off itself
        ends = peak.x - 2.0 * AROUND * (high - low), peak.x + 2.0 * AROUND * (high - low)
        vanishes = slope(ends[0]) * slope(ends[1]) < 0.0
        return k, float(brentq(slope, *ends, xtol=PEAK * (high - low)) if vanishes else peak.x)

    def slope(self, at: ModelAt, h: float) -> Quotient:
        """Return dz/dp (n,) of the state, if it is an equilibrium, then dx/dp (frequencies, inputs, n, 2)."""
        problem, rest = self.varied_matrices(at, h)

        def changes(p: Quadratic) -> Array:
            inputs, out = self._read(p)[0], []
            for (_, hz, _), X, factors in zip(self.at, self.x, self.factors, strict=True):
                s = 2j * math.pi * hz
                out += [refined_response(self.problem, factors, p.force(one, s) - p.action(s, x), s)
                        for x, one in zip(X, inputs, strict=True)]
            return parts(np.concatenate(out)) if out else np.zeros(0)
        weights = np.tile(np.repeat(self.problem.weights, 2), len(self.at) * len(self.inputs))
        found = derivative(lambda step: changes(problem(step)), h, weights, round_off=self.round_off(changes, rest))
        return Quotient(np.append(rest.value, found.value), np.append(rest.error, found.error), found.h)

    def states(self, model: Model, change: Array) -> list[State]:
        """Return the state of a model with its responses changed, at the differentiated frequencies."""
        z, rest = self.unknowns_and_rest(change)
        p = self.problem_at(model, z)
        inputs, probes = self._read(p)
        X = rest.reshape(len(self.at), len(self.inputs), -1, 2) @ [1.0, 1j]
        old = self.state.report["response"]
        response: dict[str, Any] = {"hz": list(self.hz), **{
            one.name: {probe: {q: {part: list(H[part]) for part in H} for q, H in row.items()}
                       for probe, row in old[one.name].items()} for one in inputs}}
        for (k, hz, goal), known, moved in zip(self.at, self.x, X, strict=True):
            x = [one + dx for one, dx in zip(known, moved, strict=True)]
            found = response_of(p, inputs, probes, 2j * math.pi * hz, x)
            for i, j in np.ndindex(found.shape):
                names = inputs[i].name, probes[j].probe, probes[j].quantity
                if goal is None or names == (goal.input, goal.probe, goal.quantity):
                    H = response[names[0]][names[1]][names[2]]
                    H["re"][k], H["im"][k] = float(found[i, j].real), float(found[i, j].imag)
        return [replace(p.small.base.state, report={**self.state.report, "response": response})]


def parted(G: NDArray[Any], F: NDArray[Any], off: NDArray[Any], wanted: Sequence[int]) -> Quotient:
    """Return the derivatives of equal eigenvalues, those of G^-1 F: the mean of both sides, and the difference from it.

    ``wanted`` are their places in order; ``off`` (m, m) is the error of F. Complex ones become two numbers each.
    """
    vibrate, slopes = np.iscomplexobj(off), np.linalg.eigvals(np.linalg.solve(G, F))
    slopes = slopes[np.argsort(slopes.imag if vibrate else slopes.real)]
    mean, kink = (0.5 * (slopes + sign * slopes[::-1])[list(wanted)] for sign in (1.0, -1.0))
    error = np.abs(np.linalg.solve(G, off)).max()
    value, away = (parts(x) if vibrate else x.real for x in (mean, kink))
    return Quotient(value, np.full(len(value), error), 0.0, away)


def joined(parts: Sequence[Quotient], h: float) -> Quotient:
    value, error = (np.concatenate([getattr(one, name) for one in parts]) for name in ("value", "error"))
    return Quotient(value, error, h, np.concatenate([np.atleast_1d(one.kink) for one in parts]))


def parts(z: NDArray[Any]) -> Array:
    """Return real and imaginary parts (2 m,), alternating."""
    return np.array([z.real, z.imag]).T.ravel()


def null_vectors(near: csc_array, A: csc_array, x: Complex) -> Complex:
    """Return the null vectors (n,) or (n, m) of A, from start vectors, with the factors of a matrix ``near`` A.

    Inverse iteration finds those of the other matrix; residual inverse iteration (Neumaier, SIAM Journal on Numerical
    Analysis 22, 1985) corrects them.
    """
    factors = Factors(near.tocsc())
    for k in range(2 * ITERATIONS):
        x = factors.solve(x) if k < ITERATIONS else x - factors.solve(A @ x)
        x = np.linalg.qr(x)[0] if x.ndim > 1 else x / np.linalg.norm(x)
    return x
