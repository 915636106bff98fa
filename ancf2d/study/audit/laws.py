"""Checks of material laws in the element: tangent, objectivity, dissipation, and cycles.

They are made for every law that the formulation supports, or for its own law if that has memory. A free beam of two
elements follows a path of random displacements that strain it far beyond yield.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...errors import CaseError
from ...model.model import Model
from ...solvers.energy import extra_energy
from ...solvers.small_motions.linearised import to_sparse
from ...solvers.system import System
from .fields import rigidly_moved, rotated
from .subject import NOTE, ROUND_OFF, Finding, Subject, judged

YIELD = {"yield": 0.004, "hardening": {"isotropic": 0.0, "kinematic": 0.2}}
LAWS: dict[str, dict[str, Any]] = {
    "viscoelastic": {"viscoelastic": [{"modulus": 0.5, "time": 0.3}, {"modulus": 2.0, "time": 3.0}]},
    "yield": YIELD,
    "curve": {"stress_strain": {"strain": [0.004, 0.01, 0.02], "stress": [0.004, 0.006, 0.012], "unloading": "curve"}},
    "neo_hooke": {"law": "neo_hooke"}}
# the formulation's own law, if it has memory
OWN = "own"
# largest displacement of a coordinate, as a share of the height; steps of a cycle, time of a step, and cycles
SIZE, STEPS, DT, CYCLES = 0.03, 40, 0.05, 12
# relative step of differences; accuracy of these, of sums along a path, and of differences of cycles
STEP, DIFFERENCED, SUMMED, SETTLED = 1e-6, 1e-5, 1e-2, 1e-4


def _models_by_law(s: Subject) -> dict[str, Model]:
    """Return a free beam for each law that the element supports."""
    own = s.formulation.law
    if own.state and not own.elastic:
        return {OWN: s.free(3.0, 2)}
    found = {}
    for name, keys in LAWS.items():
        try:
            found[name] = s.free(3.0, 2, material=keys)
        except CaseError:
            continue
    return found


def _worst(s: Subject, measure: Callable[[Model], float], allowed: float, good: str, bad: str) -> Finding:
    """Return the finding for the law with the largest value of ``measure``."""
    found = {name: measure(model) for name, model in _models_by_law(s).items()}
    if not found:
        return Finding(None, NOTE, "the formulation supports only linear laws")
    name = max(found, key=lambda k: found[k] if math.isfinite(found[k]) else math.inf)
    laws = ", ".join(found)
    return judged(found[name], allowed, f"{good} ({laws})", f"{bad}: {name} of {laws}")


def _random_displacements(model: Model) -> Array:
    """Return two random displacement vectors (2, n_q) of magnitude SIZE."""
    return SIZE * np.random.default_rng(2).uniform(-1.0, 1.0, (2, model.n_q)) / model.weights


def _cycle(model: Model, share: float = 1.0) -> list[Array]:
    """Return the displacements along a closed path from the reference configuration, or along a share of it."""
    a, b = _random_displacements(model)
    phase = 2.0 * math.pi * np.arange(1, round(share * STEPS) + 1) / STEPS
    return [math.sin(p) * a + (1.0 - math.cos(p)) * b for p in phase]


def _follow(model: Model, path: Sequence[Array], every: int = 1) -> tuple[Array, Array]:
    """Follow a path; return the work and the stored energy (m,) at its start and after every ``every`` steps."""
    system, work, energy = System(model), [0.0], [0.0]
    last, Q = np.zeros(model.n_q), np.zeros(model.n_q)
    for k, d in enumerate(path, start=1):
        model.set_step(DT)
        balance = system.forces(d, 0.0)
        system.accept(d, 0.0)
        model.set_step(0.0)
        work.append(work[-1] + 0.5 * float((Q + balance.Q) @ (d - last)))
        if k % every == 0:
            energy.append(balance.energy + sum(extra_energy(model, d, 0.0)[:2]))
        last, Q = d, balance.Q.copy()
    return np.array(work[::every]), np.array(energy)


def law_tangent(s: Subject) -> Finding:
    """Examine the tangent within a step, on the way out and on the way back."""
    def off(model: Model) -> float:
        system, worst = System(model), 0.0
        for share in (0.3, 0.8):
            model.states[:] = 0.0
            model.set_step(math.inf)
            _follow(model, _cycle(model, share), STEPS)
            d, v = _cycle(model, share + 0.1)[-1], _random_displacements(model)[1]
            model.set_step(DT)
            system.assemble(d, 0.0)
            K = to_sparse(model, system.matrix, system.matrix.target.values)
            ends = [system.forces(d + h * v, 0.0).Q.copy() for h in (STEP, -STEP)]
            z, out = v[model.numbering.free], model.numbering.reduce((ends[0] - ends[1]) / (2.0 * STEP))
            worst = max(worst, float(np.abs(K @ z - out).max() / np.abs(out).max()))
        return worst
    return _worst(s, off, DIFFERENCED, "the tangent is the derivative of the forces", "the tangent is not the "
                  "derivative of the forces")


def law_objectivity(s: Subject) -> Finding:
    """Examine the forces at the end of a path on which the body rotates further with every step."""
    def off(model: Model) -> float:
        start, path, system = model.states.copy(), _cycle(model, 0.6), System(model)
        _follow(model, path, STEPS)
        Q = system.forces(path[-1], 0.0).Q.copy()
        model.states[:] = start
        angles = 0.7 * np.arange(1, len(path) + 1)
        _follow(model, [rigidly_moved(model, d, a) for d, a in zip(path, angles, strict=True)], STEPS)
        P = system.forces(rigidly_moved(model, path[-1], angles[-1]), 0.0).Q
        return float(np.abs(P - rotated(model, Q, angles[-1])).max() / np.abs(Q).max())
    return _worst(s, off, ROUND_OFF, "forces rotate with a body that rotates along a load path", "forces depend on "
                  "the rotation along a load path")


def law_dissipation(s: Subject) -> Finding:
    """Examine whether work minus stored energy ever decreases, relative to the largest energy."""
    def off(model: Model) -> float:
        work, energy = _follow(model, _cycle(model) * 2)
        lost = work - energy
        return float((np.maximum.accumulate(lost) - lost).max() / energy.max())
    return _worst(s, off, SUMMED, "no load path creates energy", "a load path creates energy")


def law_cycles(s: Subject) -> Finding:
    """Examine whether cycles, after the first ones, dissipate equal energies, and elastic laws none."""
    def off(model: Model) -> float:
        work, energy = _follow(model, _cycle(model) * CYCLES, STEPS // 2)
        lost = np.diff((work - energy)[::2])
        return float(abs(lost[-1] - (lost[-2] if model.remembers else 0.0)) / energy.max())
    return _worst(s, off, SETTLED, "repeated cycles dissipate the same energy",
                  "repeated cycles do not settle")
