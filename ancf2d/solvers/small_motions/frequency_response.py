"""Response of probes to oscillating loads and motions: (K + s C + s^2 M) z = f0 + s f1 + s^2 f2 at s = i omega."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ...case import FrequencyResponse
from ...elements.shape import Array
from ...errors import ComputationError
from ...model.mesh import Index
from ...model.model import Model
from ...results.responses import interpolated
from ..state import State
from .factors import Factors
from .inputs_and_outputs import Input, Inputs, Output, outputs, warnings_of
from .linearised import small_motions
from .projected import Complex, Quadratic, Space, projected_values, within_constraints

# minimum numbers of unknowns and frequencies for computing responses in a space of few vectors
LARGE, MANY = 400, 40
# number of frequencies with which the space starts, and the largest share of all frequencies that is solved
FIRST_FREQUENCIES, MAX_SOLVED_SHARE = 6, 0.5
# change of the responses, relative to the largest displacement of a probe at that frequency, that ends the search, and
# how many times in succession it must be met
SETTLED, CALM = 1e-7, 2
# relative correction that is round-off, and the largest number of corrections of a solution
ROUND_OFF, MAX_CORRECTIONS = 1e-11, 6
# number of frequencies evaluated in the space at a time
BLOCK = 64
# number of frequencies in a range for which a space is built before points are placed, and most rounds of both
SEARCHED, ROUNDS = 200, 6
# damping ratio of the sharpest resonance to be resolved, closest relative distance of points, and most points
SHARPEST, CLOSEST, MOST_POINTS = 1e-5, 2.1e-5, 20_000
# smallest amplitudes to be resolved, relative to the largest of all probes
FAINT = 1e-3


def solve_frequency_response(model: Model, spec: FrequencyResponse) -> Iterator[State]:
    """Yield the excited state, with the complex amplitudes of all probes over the frequency.

    They are amplitudes of exp(i omega t), for each input at its size in the case.
    """
    small = small_motions(model, spec.about, "frequency_response")
    state = small.base.state
    inputs, probes = Inputs(small)(spec.inputs), outputs(small, spec.inputs)
    problem = Quadratic(small, relaxes=True)
    if spec.frequencies is None:
        hz, found, error = placed_responses(problem, inputs, probes, spec, model.case.goal_frequencies)
        if len(hz) >= MOST_POINTS:
            state.warnings = [*state.warnings, f"{len(hz)} frequencies do not resolve the responses. Use a smaller "
                              "range or a larger solver.tolerance"]
    else:
        hz = list(spec.frequencies)
        found, error = responses(problem, inputs, probes, hz)
    state.warnings = [*state.warnings, *warnings_of(small, inputs=inputs)]
    state.report = {"response": _report(hz, inputs, probes, found), "response_error": error}
    state.tables = {"response": _table(hz, inputs, probes, found)}
    yield state


def responses(problem: Quadratic, inputs: Sequence[Input], probes: Sequence[Output], hz: Sequence[float]
              ) -> tuple[Complex, float | None]:
    """Return the complex amplitudes (frequencies, inputs, outputs) of ``probes``, and an estimate of their error.

    The error is relative to the largest displacement of a probe at the same frequency, for section forces to the
    largest of these; None if each frequency is solved directly.
    """
    if problem.n >= LARGE and len(hz) >= MANY and not problem.relaxing:
        found = _Reduced(problem, inputs, probes).settled(np.array(hz))
        if found is not None:
            return found
    return _Solved(problem, inputs, probes)(hz), None


def placed_responses(problem: Quadratic, inputs: Sequence[Input], probes: Sequence[Output], spec: FrequencyResponse,
                     more: Sequence[float]) -> tuple[list[float], Complex, float | None]:
    """Return the frequencies of a range, refined where the responses bend, and the results of ``responses``.

    ``more`` are frequencies in the range to be included.
    """
    hz = np.unique([*spec.hz, *more])
    space = np.geomspace if spec.scale == "log" else np.linspace
    grid, reduced = np.union1d(hz, space(hz[0], hz[-1], SEARCHED)[1:-1]), _Reduced(problem, inputs, probes)
    place = _Placing(problem, probes, spec)
    # for relaxing materials, the matrix is not a quadratic polynomial of s, so that no projected matrices can be stored
    for _ in range(0 if problem.relaxing else ROUNDS):
        found = reduced.settled(grid)
        if found is None:
            break
        hz = place(reduced.at, hz, reduced.poles())
        if len(hz) == len(grid):
            return hz.tolist(), *found
        grid = hz
    solved = _Solved(problem, inputs, probes)
    hz = place(solved, hz, np.zeros(0, dtype=complex) if problem.relaxing else reduced.poles())
    return hz.tolist(), solved(hz), None


class _Placing:
    """Places frequencies so densely that a cubic through four neighbours gives the response between them."""

    def __init__(self, problem: Quadratic, probes: Sequence[Output], spec: FrequencyResponse) -> None:
        self.tolerance = spec.resolution
        self.axis: Callable[[Array], Array] = np.log if spec.scale == "log" else np.asarray
        self.back: Callable[[Array], Array] = np.exp if spec.scale == "log" else np.asarray
        self.compared = _comparable_outputs(problem, probes)

    def __call__(self, at: Callable[[Array], Complex], hz: Array, poles: Complex) -> Array:
        """Return frequencies ``hz`` and additional ones where the responses ``at`` them bend.

        The first candidates are the middles between two neighbours and the resonances of ``poles`` [1/s], which may be
        too narrow to be noticed otherwise.
        """
        values = at(hz)
        tries = np.union1d(self._middles(hz), self._resonances(poles, hz[0], hz[-1]))
        while len(tries) and len(hz) < MOST_POINTS:
            tries = np.setdiff1d(tries, hz)
            found = at(tries) if len(tries) else values[:0]
            guess, size = interpolated(self.axis(hz), values, self.axis(tries))
            size, bends = np.maximum(size, np.abs(found)), np.zeros(len(tries), dtype=bool)
            for some, unit in self.compared:
                gap, near = np.abs(found - guess)[:, :, some] * unit, size[:, :, some] * unit
                near = np.maximum(near, FAINT * near.max(axis=2, keepdims=True, initial=0.0))
                bends |= (gap > self.tolerance * near).any(axis=(1, 2))
            new, merged = tries[bends], np.union1d(hz, tries[bends])
            values, old = np.empty((len(merged), *values.shape[1:]), dtype=complex), values
            values[np.searchsorted(merged, hz)], values[np.searchsorted(merged, new)] = old, found[bends]
            hz, k = merged, np.searchsorted(merged, new)
            ends = np.unique(np.concatenate([k - 1, k]))
            tries = self._middles(hz, ends[(ends >= 0) & (ends < len(hz) - 1)])
        return hz

    def _middles(self, hz: Array, some: Any = slice(None)) -> Array:
        """Return the middles between neighbours that are not too close."""
        low, high = hz[:-1][some], hz[1:][some]
        wide = high - low > CLOSEST * high
        return np.asarray(self.back(0.5 * (self.axis(low[wide]) + self.axis(high[wide]))))

    @staticmethod
    def _resonances(poles: Complex, low: float, high: float) -> Array:
        """Return the frequencies of resonances, and both sides of undamped ones, where the response is infinite."""
        f, sharp = np.abs(poles.imag) / (2 * math.pi), np.abs(poles.real) < SHARPEST * np.abs(poles)
        f = np.unique(np.concatenate([f[~sharp], f[sharp] * (1 - SHARPEST), f[sharp] * (1 + SHARPEST)]))
        return f[(f > low) & (f < high)]


class _Solved:
    """Responses (frequencies, inputs, outputs), each frequency solved directly and only once."""

    def __init__(self, problem: Quadratic, inputs: Sequence[Input], probes: Sequence[Output]) -> None:
        self.problem, self.inputs, self.probes = problem, inputs, probes
        self.known: dict[float, Complex] = {}

    def __call__(self, hz: Sequence[float] | Array) -> Complex:
        """Return the responses at some frequencies."""
        return np.array([self._one(float(f)) for f in hz]).reshape(len(hz), len(self.inputs), len(self.probes))

    def _one(self, f: float) -> Complex:
        if f not in self.known:
            s = 2j * math.pi * f
            found = _direct(self.problem, self.inputs, s)
            self.known[f] = response_of(self.problem, self.inputs, self.probes, s, found)
        return self.known[f]


class _Reduced:
    """Responses in the space of the motions at a few frequencies, chosen where the responses change most.

    The vectors of the space satisfy the constraints, so that multipliers drop out. If an input moves a constraint,
    ``lifts`` (inputs, n) is a motion that follows it, and the space holds the difference from it.
    """

    def __init__(self, problem: Quadratic, inputs: Sequence[Input], probes: Sequence[Output]) -> None:
        self.problem, self.inputs, self.probes = problem, inputs, probes
        self.space, self.known = Space(problem, within_constraints(problem)), dict[float, Complex]()
        self.compared = _comparable_outputs(problem, probes)
        self.lifts = np.zeros((len(inputs), problem.n))
        self._forces = [one.f for one in inputs]
        self._read = np.zeros((3, len(probes), 0))

    def settled(self, hz: Array) -> tuple[Complex, float] | None:
        """Return the responses (frequencies, inputs, outputs) and their error, or None if too many must be solved."""
        # at the frequency of an undamped mode, the projected matrix is singular, too
        with suppress(np.linalg.LinAlgError):
            return self._settled(hz)
        return None

    def _settled(self, hz: Array) -> tuple[Complex, float] | None:
        if not self.known:
            for k in np.unique(np.linspace(0, len(hz) - 1, FIRST_FREQUENCIES).round().astype(int)):
                self._solve(float(hz[k]))
        # first in the widest gap, then where the last extension changed the responses most
        old, calm, worst = self.at(hz), 0, self._widest(hz)
        while len(self.known) < MAX_SOLVED_SHARE * len(hz):
            error = self._relative_change(self._solve(float(hz[worst]))[None], old[worst:worst + 1])[0]
            new, known = self.at(hz), np.isin(hz, list(self.known))
            changes = self._relative_change(new, old)
            error = max(float(error), float(changes.max()))
            calm = calm + 1 if error <= SETTLED else 0
            if calm == CALM:
                for k in np.flatnonzero(known):
                    new[k] = self.known[float(hz[k])]
                return new, error
            changes[known] = -1.0
            worst = int(np.argmax(changes)) if changes.max() > 0.1 * SETTLED else self._widest(hz)
            old = new
        return None

    def _widest(self, hz: Array) -> int:
        """Return the middle of the widest gap between the solved frequencies."""
        known = [-1, *np.flatnonzero(np.isin(hz, list(self.known))).tolist(), len(hz)]
        return max(((b - a, (a + b) // 2) for a, b in itertools.pairwise(known)))[1]

    def _solve(self, f: float) -> Complex:
        """Return the responses (inputs, outputs) at a frequency, and add the motions to the space."""
        s = 2j * math.pi * f
        Z = _direct(self.problem, self.inputs, s)
        if not self.known:
            self._lift(Z)
        for z, lift in zip(Z, self.lifts, strict=True):
            self.space.add(z.real - lift)
            self.space.add(np.ascontiguousarray(z.imag))
        self.known[f] = response_of(self.problem, self.inputs, self.probes, s, Z)
        return self.known[f]

    def _lift(self, Z: Sequence[Complex]) -> None:
        p = self.problem
        for k, (one, z) in enumerate(zip(self.inputs, Z, strict=True)):
            if one.f[0][~p.is_coordinate].any():
                lift = self.lifts[k] = np.where(p.is_coordinate, z.real, 0.0)
                self._forces[k] = one.f - np.array([p.stiffness(lift), p.damping(lift), p.mass(lift)])

    def poles(self) -> Complex:
        """Return the eigenvalues [1/s] of small motions in the space."""
        at = 2 * math.pi * math.sqrt(max(min(self.known), 1e-3 * max(self.known)) * max(self.known))
        return projected_values(self.space.project(), at)

    def at(self, hz: Array) -> Complex:
        """Return the responses (frequencies, inputs, outputs) in the space."""
        K, C, M = self.space.project()
        V, num = self.space.V, self.problem.small.model.numbering
        old = self._read.shape[2]
        new = np.zeros((len(V) - old, len(self.probes), 3))
        for rows, v in zip(new, V[old:], strict=True):
            d = num.expanded(v)
            rows[:] = [probe.contributions(d) for probe in self.probes]
        self._read = np.concatenate([self._read, new.T], axis=2)
        F = np.array([f @ V.T for f in self._forces])
        held, direct = np.zeros((len(self.inputs), len(self.probes), 3)), _direct_parts(self.inputs, self.probes)
        for rows, one, lift in zip(held, self.inputs, self.lifts, strict=True):
            d = num.expanded(lift) + one.p
            rows[:] = [probe.contributions(d) for probe in self.probes]
        rates = [k for k in range(3) if self._read[k].any() or held[:, :, k].any()]
        out = np.zeros((len(hz), len(self.inputs), len(self.probes)), dtype=complex)
        for first in range(0, len(hz), BLOCK):
            s = 2j * math.pi * hz[first:first + BLOCK, None, None]
            y = np.linalg.solve(K + s * C + s * s * M, (F[:, 0] + s * F[:, 1] + s * s * F[:, 2]).transpose(0, 2, 1))
            y = y.transpose(0, 2, 1)
            out[first:first + BLOCK] = direct + sum((y @ self._read[k].T + held[:, :, k]) * s**k for k in rates)
        return out

    def _relative_change(self, new: Complex, old: Complex) -> Array:
        """Return the difference of responses (m, inputs, outputs), relative to the largest of their kind (m,)."""
        out = np.zeros(len(new))
        for some, unit in self.compared:
            size, off = (np.abs(x[:, :, some] * unit).max(axis=2) for x in (new, new - old))
            out = np.maximum(out, (off / np.where(size > 0.0, size, 1.0)).max(axis=1))
        return out


def _comparable_outputs(problem: Quadratic, probes: Sequence[Output]) -> list[tuple[Index, Array]]:
    """Return the indices of displacements and of section forces among the outputs, with factors to compare them.

    Rotations count as displacements at the distance of the extent, moments as forces there. Velocities follow from
    displacements.
    """
    extent, quantities = problem.small.model.extent, [p.quantity for p in probes]
    sorts = [{"x": 1.0, "y": 1.0, "ux": 1.0, "uy": 1.0, "theta": extent}, {"N": 1.0, "Q": 1.0, "M": 1.0 / extent}]
    found = [(np.array([k for k, q in enumerate(quantities) if q in sort], dtype=np.int64),
              np.array([sort[q] for q in quantities if q in sort])) for sort in sorts]
    return [(some, unit) for some, unit in found if len(some)]


def _direct_parts(inputs: Sequence[Input], probes: Sequence[Output]) -> Array:
    """Return the direct contribution of each input to each output (inputs, outputs)."""
    return np.array([[probe.direct.get(one.name, 0.0) for probe in probes] for one in inputs])


def _direct(problem: Quadratic, inputs: Sequence[Input], s: complex) -> list[Complex]:
    """Return the motion z (n,) caused by each input at s, from one factorisation.

    Raises ComputationError if the response is infinite.
    """
    factors = Factors(problem.matrix(s))
    found = [] if factors.singular else [refined_response(problem, factors, problem.force(one, s), s) for one in inputs]
    if not found or not all(np.isfinite(z).all() for z in found):
        raise ComputationError("the response is infinite: an undamped mode has this frequency, or something is free to "
                               "move", at={"hz": float(f"{abs(s) / (2 * math.pi):.6g}")},
                               advice="damping, or another frequency")
    return found


def refined_response(problem: Quadratic, factors: Factors, f: Complex, s: complex) -> Complex:
    """Return the solution for f, refined beyond the round-off of the assembled matrix of a fine mesh."""
    z = np.asarray(factors.solve(f))
    last = np.inf
    for _ in range(MAX_CORRECTIONS):
        more = np.asarray(factors.solve(f - problem.action(s, z)))
        size = float(np.linalg.norm(problem.weights * more) / (np.linalg.norm(problem.weights * z) or 1.0))
        if not size < 0.5 * last:
            break
        z, last = z + more, size
        if size <= ROUND_OFF:
            break
    return z


def response_of(problem: Quadratic, inputs: Sequence[Input], probes: Sequence[Output], s: complex,
                Z: Sequence[Complex]) -> Complex:
    """Return the values of probes (inputs, outputs) for motions z (n,) at s."""
    num = problem.small.model.numbering
    out = np.zeros((len(inputs), len(probes)), dtype=complex)
    for row, one, z in zip(out, inputs, Z, strict=True):
        real, imag = (num.expanded(np.ascontiguousarray(part)) for part in (z.real, z.imag))
        full = np.asarray(real + 1j * imag + one.p, dtype=np.complex128)
        row[:] = [probe.response(s, full, one.name) for probe in probes]
    return out


def _report(hz: Sequence[float], inputs: Sequence[Input], probes: Sequence[Output], found: Complex) -> dict[str, Any]:
    out: dict[str, Any] = {"hz": list(hz)}
    for i, one in enumerate(inputs):
        of_probes: dict[str, Any] = out.setdefault(one.name, {})
        for k, probe in enumerate(probes):
            values = found[:, i, k]
            of_probes.setdefault(probe.probe, {})[probe.quantity] = {"re": values.real.tolist(),
                                                                     "im": values.imag.tolist()}
    return out


def _table(hz: Sequence[float], inputs: Sequence[Input], probes: Sequence[Output], found: Complex
           ) -> dict[str, list[Any]]:
    """Return the response as columns: hz, then INPUT.PROBE.QUANTITY.re and .im."""
    out: dict[str, list[Any]] = {"hz": list(hz)}
    for i, one in enumerate(inputs):
        for k, probe in enumerate(probes):
            values, name = found[:, i, k], f"{one.name}.{probe.probe}.{probe.quantity}"
            out[f"{name}.re"], out[f"{name}.im"] = values.real.tolist(), values.imag.tolist()
    return out
