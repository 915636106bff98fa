"""Response of probes to loads and motions that oscillate: (K + s C + s^2 M) z = f0 + s f1 + s^2 f2 at s = i omega."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ..case import FrequencyResponse
from ..elements.shape import Array
from ..errors import ComputationError
from ..model.model import Model
from .factors import Factors
from .inputs import Input, Inputs, Output, outputs
from .linearised import small_motions
from .reduced import Complex, Quadratic, Space
from .state import State

# from so many unknowns and frequencies on, responses are computed in a space of few vectors
LARGE, MANY = 400, 40
# frequencies that the space begins with, and most of them beside all
BEGIN, SHARE = 6, 0.5
# change of the responses, beside the largest displacement of a probe at that frequency, that ends the search, and how
# many times one after the other
SETTLED, CALM = 1e-7, 2
# relative correction that is none, and most corrections of a solution
ROUND_OFF, MOST = 1e-11, 6


def solve_frequency_response(model: Model, spec: FrequencyResponse) -> Iterator[State]:
    """Yield the one state that is excited, with the complex amplitudes of all probes over the frequency.

    They are those of exp(i omega t), for each input at the size that the case gives it.
    """
    if not model.case.output.probes:
        raise ComputationError("there are no probes whose response could be told", at={"solver": "frequency_response"},
                               advice="name points under output.probes")
    small = small_motions(model, spec.about, "frequency_response")
    state = small.base.state
    inputs, probes = Inputs(small)(spec.inputs), outputs(small)
    found, error = responses(Quadratic(small), inputs, probes, spec.hz)
    state.report = {"response": _report(spec.hz, inputs, probes, found), "response_error": error}
    state.tables = {"response": _table(spec.hz, inputs, probes, found)}
    yield state


def responses(problem: Quadratic, inputs: Sequence[Input], probes: Sequence[Output], hz: Sequence[float]
              ) -> tuple[Complex, float | None]:
    """Return the amplitudes (frequencies, inputs, outputs) of what ``probes`` read, and an estimate of their error.

    The error is beside the largest displacement of a probe at the same frequency; None where each frequency is solved.
    """
    num = problem.small.model.numbering
    if problem.n >= LARGE and len(hz) >= MANY and not num.n_multipliers:
        # at a frequency of an undamped mode the projected matrix is singular too
        with suppress(np.linalg.LinAlgError):
            found = _Reduced(problem, inputs, probes, np.array(hz)).settled()
            if found is not None:
                return found
    out = np.zeros((len(hz), len(inputs), len(probes)), dtype=complex)
    for k, f in enumerate(hz):
        s = 2j * math.pi * f
        out[k] = _read(problem, inputs, probes, s, _direct(problem, inputs, s))
    return out, None


class _Reduced:
    """Responses in the space of those at a few frequencies, which are chosen where the responses change most."""

    def __init__(self, problem: Quadratic, inputs: Sequence[Input], probes: Sequence[Output], hz: Array) -> None:
        self.problem, self.inputs, self.probes, self.hz = problem, inputs, probes, hz
        self.space, self.known = Space(problem), dict[int, Complex]()
        extent = problem.small.model.extent
        # rates follow from displacements; rotations count as displacements at the distance of the extent
        self.moves = np.array([0.0 if p.order else extent if p.quantity == "theta" else 1.0 for p in probes])
        self._read = np.zeros((len(probes), 0))

    def settled(self) -> tuple[Complex, float] | None:
        """Return the responses (frequencies, inputs, outputs) and their error, None if too many have to be solved."""
        for k in np.unique(np.linspace(0, len(self.hz) - 1, BEGIN).round().astype(int)):
            self._solve(int(k))
        # in the widest gap first, then where the space has changed most
        old, calm, worst = self._responses(), 0, self._widest()
        while len(self.known) < SHARE * len(self.hz):
            error = self._off(self._solve(worst)[None], old[worst:worst + 1])[0]
            new = self._responses()
            changes = self._off(new, old)
            error = max(float(error), float(changes.max()))
            calm = calm + 1 if error <= SETTLED else 0
            if calm == CALM:
                for k, known in self.known.items():
                    new[k] = known
                return new, error
            changes[list(self.known)] = -1.0
            worst = int(np.argmax(changes)) if changes.max() > 0.1 * SETTLED else self._widest()
            old = new
        return None

    def _widest(self) -> int:
        """Return the middle of the widest gap between the frequencies that are known."""
        known = sorted(self.known)
        return max(((b - a, (a + b) // 2) for a, b in itertools.pairwise(known)))[1]

    def _solve(self, k: int) -> Complex:
        """Return the responses (inputs, outputs) at frequency k, and add the motions to the space."""
        s = 2j * math.pi * self.hz[k]
        Z = _direct(self.problem, self.inputs, s)
        for z in Z:
            self.space.add(np.ascontiguousarray(z.real))
            self.space.add(np.ascontiguousarray(z.imag))
        self.known[k] = _read(self.problem, self.inputs, self.probes, s, Z)
        return self.known[k]

    def _responses(self) -> Complex:
        K, C, M = self.space.project()
        V, model = self.space.V, self.problem.small.model
        d, old = np.zeros(len(model.numbering.place)), self._read.shape[1]
        new = np.zeros((len(self.probes), len(V) - old))
        for column, v in zip(new.T, V[old:], strict=True):
            model.numbering.expand(v, d)
            column[:] = [probe.of(d).real for probe in self.probes]
        self._read = np.hstack([self._read, new])
        F = np.array([one.f @ V.T for one in self.inputs])
        held = np.array([[probe.of(one.p) for probe in self.probes] for one in self.inputs])
        order = np.array([probe.order for probe in self.probes])
        out = np.zeros((len(self.hz), len(self.inputs), len(self.probes)), dtype=complex)
        for row, f in zip(out, self.hz, strict=True):
            s = 2j * math.pi * f
            y = np.linalg.solve(K + s * C + s * s * M, (F[:, 0] + s * F[:, 1] + s * s * F[:, 2]).T)
            row[:] = (y.T @ self._read.T + held) * s**order
        return out

    def _off(self, new: Complex, old: Complex) -> Array:
        """Return how far responses (m, inputs, outputs) are apart beside the largest displacement of a probe (m,)."""
        size = np.abs(new * self.moves).max(axis=2)
        off = np.abs((new - old) * self.moves).max(axis=2)
        return np.asarray((off / np.where(size > 0.0, size, 1.0)).max(axis=1))


def _direct(problem: Quadratic, inputs: Sequence[Input], s: complex) -> list[Complex]:
    """Return the motion z (n,) that each input causes at s, from one factorisation."""
    factors = Factors(problem.matrix(s))
    found = [] if factors.singular else [_refined(problem, factors, _force(one, s), s) for one in inputs]
    if not found or not all(np.isfinite(z).all() for z in found):
        raise ComputationError("the response is infinite: an undamped mode has this frequency, or something moves "
                               "freely", at={"hz": float(f"{abs(s) / (2 * math.pi):.6g}")},
                               advice="give damping, or another frequency")
    return found


def _refined(problem: Quadratic, factors: Factors, f: Complex, s: complex) -> Complex:
    """Return the solution for f, with the digits that the formed matrix of a fine mesh has lost."""
    z = np.asarray(factors.solve(f))
    last = np.inf
    for _ in range(MOST):
        parts = [np.ascontiguousarray(part) for part in (z.real, z.imag)]
        K, C, M = (act(parts[0]) + 1j * act(parts[1]) for act in (problem.stiffness, problem.damping, problem.mass))
        more = np.asarray(factors.solve(f - K - s * C - s * s * M))
        size = float(np.linalg.norm(problem.weights * more) / (np.linalg.norm(problem.weights * z) or 1.0))
        if not size < 0.5 * last:
            break
        z, last = z + more, size
        if size <= ROUND_OFF:
            break
    return z


def _force(one: Input, s: complex) -> Complex:
    return np.asarray(one.f[0] + s * one.f[1] + s * s * one.f[2], dtype=complex)


def _read(problem: Quadratic, inputs: Sequence[Input], probes: Sequence[Output], s: complex, Z: Sequence[Complex]
          ) -> Complex:
    """Return what probes read (inputs, outputs) of motions z (n,) at s."""
    num = problem.small.model.numbering
    out = np.zeros((len(inputs), len(probes)), dtype=complex)
    d = np.zeros((2, len(num.place)))
    for row, one, z in zip(out, inputs, Z, strict=True):
        num.expand(np.ascontiguousarray(z.real), d[0])
        num.expand(np.ascontiguousarray(z.imag), d[1])
        full = d[0] + 1j * d[1] + one.p
        row[:] = [s**probe.order * probe.of(full) for probe in probes]
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
