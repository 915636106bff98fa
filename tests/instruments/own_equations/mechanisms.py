"""Random mechanisms compared with the independent equations."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

import ancf2d

from .bodies import RIGID
from .motion import Motion, move
from .points import Array
from .random_mechanisms import FORMS, mechanism
from .verdict import Kind, Verdict, judge

# what moves has waves of all lengths, for which elements have not the order that they have in statics
_RIGID = Kind((RIGID,), 1)
KINDS = [*3 * [_RIGID], Kind(({"type": "reissner3"},), 1), *4 * [_RIGID],
         Kind(({"type": "vallejo", "formulation": "structural"},), 1)]
# elements a body, and tolerance of the steps
RUNS = ((8, 1e-7), (16, 1e-9))
# of the own equations: degree of each piece, and tolerance of steps where sections ring or do not
DEGREES, RINGING, RIGID_ONLY = (5, 7), 1e-7, 1e-11


def mechanisms(numbers: Iterable[int]) -> Iterator[Verdict]:
    """Yield a verdict for each mechanism."""
    for number in numbers:
        kind = KINDS[number // len(FORMS) % len(KINDS)]
        case, name = mechanism(number, kind.elements[0]), FORMS[number % len(FORMS)].__name__.replace("_", " ")
        times = np.arange(21) * case["output"]["interval"]
        if kind is _RIGID:
            rough = true = _own(move(case, times, RIGID_ONLY))
        else:
            rough, true = (_own(move(case, times, RINGING, degree=degree)) for degree in DEGREES)
        runs = [meshed(case, *run) for run in RUNS]
        verdict = Verdict(number, kind.name, name, runs[-1])
        try:
            judge(verdict, true, [_computed(run) for run in runs], kind.order, extent=1.0, rough=rough)
        except ancf2d.Ancf2dError as error:
            verdict.failed(error)
        yield verdict


def meshed(case: dict[str, Any], count: int, tolerance: float) -> dict[str, Any]:
    """Return a case with so many elements on every body, and the tolerance of its steps."""
    case = copy.deepcopy(case)
    case["solver"]["tolerance"] = tolerance
    for body in case["bodies"].values():
        if body["element"]["type"] != "rigid":
            body["element"]["count"] = count
    return case


def _groups(course: dict[str, dict[str, Array]], energies: Array, momenta: Array,
            reactions: dict[str, dict[str, float]]) -> dict[str, Array]:
    """Return the values to compare: over time at the probes, and at the end."""
    over = {"displacements": ("ux", "uy"), "rotations": ("theta",), "velocities": ("vx", "vy"), "spins": ("omega",)}
    found = {what: np.array([[c[q] for q in names] for c in course.values()]) for what, names in over.items()}
    return {**found, "energies": energies, "linear momentum": momenta[:2], "angular momentum": momenta[2:],
            "reaction forces": np.array([[r["fx"], r["fy"]] for r in reactions.values()]),
            "reaction moments": np.array([r["m"] for r in reactions.values()])}


def _own(own: Motion) -> dict[str, Array]:
    probes = own.scene.case["output"]["probes"]
    return _groups({n: own.course(at) for n, at in probes.items()}, np.array([*own.energies().values()]),
                   own.momenta(), own.scene.reactions(own.multipliers))


def _computed(case: dict[str, Any]) -> dict[str, Array]:
    found = ancf2d.solve(case)
    energy, momentum = found.summary["energy"], found.summary["momentum"]
    return _groups({n: dict(found.course[n]) for n in found.probes}, np.array([energy["strain"], energy["kinetic"]]),
                   np.array([*momentum["linear"], momentum["angular"]]), found.reactions)
