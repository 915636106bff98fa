"""Response of probes to loads and motions that oscillate: (K + s C + s^2 M) z = f0 + s f1 + s^2 f2 at s = i omega."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..case import FrequencyResponse
from ..errors import ComputationError
from ..model.model import Model
from .factors import Factors
from .inputs import Input, Inputs, Output, outputs
from .linearised import Linearised, base_state
from .reduced import Complex, Quadratic
from .state import State


def solve_frequency_response(model: Model, spec: FrequencyResponse) -> Iterator[State]:
    """Yield the one state that is excited, with the complex amplitudes of all probes over the frequency.

    They are those of exp(i omega t), for each input at the size that the case gives it.
    """
    if not model.case.output.probes:
        raise ComputationError("there are no probes whose response could be told", at={"solver": "frequency_response"},
                               advice="name points under output.probes")
    turns = model.case.steady_rotation is not None
    base = base_state(model, "static" if turns else spec.about)
    small, state = Linearised(base), base.state
    inputs, probes = Inputs(small)(spec.inputs), outputs(small)
    found = responses(Quadratic(small), inputs, probes, spec.hz)
    state.report = {"response": _report(spec.hz, inputs, probes, found)}
    state.tables = {"response": _table(spec.hz, inputs, probes, found)}
    yield state


def responses(problem: Quadratic, inputs: Sequence[Input], probes: Sequence[Output], hz: Sequence[float]) -> Complex:
    """Return the amplitudes (frequencies, inputs, outputs) of what ``probes`` read."""
    out = np.zeros((len(hz), len(inputs), len(probes)), dtype=complex)
    for k, f in enumerate(hz):
        s = 2j * math.pi * f
        out[k] = _read(problem, inputs, probes, s, _direct(problem, inputs, s))
    return out


def _direct(problem: Quadratic, inputs: Sequence[Input], s: complex) -> list[Complex]:
    """Return the motion z (n,) that each input causes at s, from one factorisation."""
    factors = Factors(problem.matrix(s))
    found = [] if factors.singular else [np.asarray(factors.solve(_force(one, s))) for one in inputs]
    if not found or not all(np.isfinite(z).all() for z in found):
        raise ComputationError("the response is infinite: an undamped mode has this frequency, or something moves "
                               "freely", at={"hz": float(f"{abs(s) / (2 * math.pi):.6g}")},
                               advice="give damping, or another frequency")
    return found


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
