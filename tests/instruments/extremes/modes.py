"""Modes and buckling loads at the extremes: slenderness, number of elements, rigid modes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from .cell import Cell, Found
from .references import pinned_load, pinned_omega
from .scenes import BY_LABEL, DEFAULTS, SUBJECTS, USUAL, Beam, Subject, apart, solve
from .statics import slender

# (b L)^2 of the first bending of a free beam: cos b cosh b = 1
FREE = 22.373285448
# the same of a clamped one: cos b cosh b = -1
CLAMPED = 3.516015269


def pinned(subject: Subject, beam: Beam, count: int) -> dict[str, Any]:
    """Return a pinned beam; supports are spread over the section if it warps."""
    spread = {"spread": "parabolic"} if subject.type.degree_y > 1 else {}
    roller = {"type": "roller", "at": "beam@1", "fixed": "y"}
    return {"bodies": {"beam": beam.body(subject, count)},
            "boundary_conditions": [{"type": "pin", "at": "beam@0", **spread}, {**roller, **spread}],
            "solver": {"type": "eigen", "modes": 3}}


def first_bending(label: str, beam: Beam, count: int) -> Found:
    """Compare the first bending frequency of a pinned beam with Timoshenko's."""
    subject = BY_LABEL[label]
    run = solve(pinned(subject, beam, count))
    expected = pinned_omega(beam if subject.shears else replace(beam, nu=-0.999999))
    found = min((f["omega"] for f in run.summary["frequencies"]), key=lambda w: abs(w - expected))
    return Found(apart(found, expected), run.warnings)


def free_modes(label: str, beam: Beam, count: int) -> Found:
    """Compare zero modes and the first bending mode of a free beam with theory; a missing zero is a large error."""
    subject = BY_LABEL[label]
    run = solve({"bodies": {"beam": beam.body(subject, count)}, "solver": {"type": "eigen", "modes": 5}})
    found = run.summary["frequencies"]
    if [f["kind"] for f in found[:3]] != ["rigid"] * 3 or any(f["omega"] for f in found[:3]):
        return Found(math.inf, run.warnings, str(found[:4]))
    if any(f["kind"] == "rigid" for f in found[3:]):
        return Found(math.inf, run.warnings, "more than three rigid modes")
    expected = FREE * math.sqrt(beam.EI / (beam.rho * beam.A)) / beam.L**2
    return Found(apart(found[3]["omega"], expected), run.warnings)


def damped_bending(label: str, beam: Beam, count: int) -> Found:
    """Compare abs(s) of the first bending mode of a cantilever with Rayleigh damping with Euler-Bernoulli theory."""
    expected = CLAMPED * math.sqrt(beam.EI / (beam.rho * beam.A)) / beam.L**2
    run = solve({"bodies": {"beam": beam.body(BY_LABEL[label], count)}, "solver": {"type": "eigen", "modes": 3},
                 "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
                 "damping": {"rayleigh": {"alpha": 0.1 * expected, "beta": 0.0}}})
    lowest = min((math.hypot(f["omega"], f["growth"]) for f in run.summary["frequencies"]), default=math.inf)
    return Found(apart(lowest, expected), run.warnings)


def euler(label: str, beam: Beam, count: int) -> Found:
    """Compare the buckling load of a pinned column with Euler's, corrected for shear and shortening."""
    subject = BY_LABEL[label]
    case = pinned(subject, beam, count)
    spread = {"spread": "parabolic"} if subject.type.degree_y > 1 else {}
    case.update(solver={"type": "buckling", "modes": 1},
                loads=[{"type": "force", "at": "beam@1", "value": [-beam.EI / beam.L**2, 0], **spread}])
    run = solve(case)
    expected = pinned_load(beam, subject.shears) * beam.L**2 / beam.EI
    factors = run.summary["load_factors"]
    return Found(apart(factors[0], expected) if factors else math.inf, run.warnings)


def rows() -> Iterator[Cell]:
    """Yield modes and buckling loads."""
    axis = "modes: slenderness L/h"
    for ratio in (2, 10, 1e2, 1e3, 1e4, 1e5, 1e6):
        beam = slender(ratio)
        for s in SUBJECTS:
            yield Cell(axis, f"{ratio:g}", s.label, "first bending of a pinned beam, 16 elements, beside Timoshenko",
                       0.2 if ratio == 2 else 0.03, partial(first_bending, s.label, beam, 16), quick=ratio == 1e4)
        for s in DEFAULTS:
            if ratio >= 100:
                yield Cell(axis, f"{ratio:g}", s.label, "three rigid modes and the first bending of a free beam", 0.03,
                           partial(free_modes, s.label, beam, 16), quick=ratio == 1e4)
            if ratio >= 10:
                yield Cell("buckling: slenderness L/h", f"{ratio:g}", s.label,
                           "pinned column, 16 elements, beside Euler", 0.03, partial(euler, s.label, beam, 16),
                           quick=ratio == 1e4)
    for nu in (-0.9, 0.0, 0.499):
        for s in SUBJECTS:
            yield Cell("modes: Poisson's ratio", f"{nu:g}", s.label, "first bending of a pinned beam, L/h = 10", 0.03,
                       partial(first_bending, s.label, replace(slender(10), nu=nu), 16))
    for count in (1, 10, 1000, 10**4, 10**5):
        for s in DEFAULTS if count <= 1000 else USUAL if count < 10**5 else [USUAL[0], USUAL[2]]:
            yield Cell("modes: elements", f"{count:g}", s.label, "three rigid modes and the first bending, L/h = 100",
                       100.0 if count == 1 else 0.03, partial(free_modes, s.label, slender(100), count), 150.0)
            if count <= 10**4:
                yield Cell("buckling: elements", f"{count:g}", s.label, "pinned column, L/h = 20, beside Euler",
                           0.5 if count == 1 else 0.03, partial(euler, s.label, slender(20), count), 60.0)
