"""Statics at the extremes: slenderness, Poisson's ratio, elements and their aspect ratio, strains, roll-up, loads."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial

import ancf2d
from instruments.motions import conservation

from .cell import Cell, Found
from .references import bent_tip, series_tip, stretch_force
from .scenes import BY_LABEL, DEFAULTS, SUBJECTS, USUAL, Beam, Subject, apart, cantilever, force, solve

LINEAR = {"type": "linear_static"}
ALPHA = 2.0


def rows() -> Iterator[Cell]:
    """Yield every cell of statics."""
    yield from slenderness()
    yield from poisson()
    yield from counts()
    yield from aspects()
    yield from neighbours()
    yield from strains()
    yield from rolls()
    yield from columns()
    yield from turns()


def slender(ratio: float) -> Beam:
    """Return a beam of given slenderness L/h."""
    return Beam(L=1.0, h=1.0 / ratio, b=1.0 / ratio)


def linear_tip(label: str, beam: Beam, count: int) -> Found:
    """Compare a cantilever's tip with Timoshenko's beam, or Euler-Bernoulli's for types without shear."""
    subject = BY_LABEL[label]
    P = 1e-3 * beam.EI / beam.L**2
    run = solve(cantilever(subject, beam, count, [force([0, -P], subject)], LINEAR))
    return Found(apart(run.probes["tip"]["uy"], -beam.tip(P, subject.shears)), run.warnings)


@cache
def bend(label: str, beam: Beam, count: int) -> ancf2d.Solution:
    """Solve a cantilever bent to P L^2/EI = 2."""
    subject = BY_LABEL[label]
    return solve(cantilever(subject, beam, count, [force([0, -ALPHA * beam.EI / beam.L**2], subject)]))


def bent_far(label: str, beam: Beam, count: int) -> Found:
    """Compare the tip of a cantilever in large bending with Reissner's beam."""
    run, (ux, uy) = bend(label, beam, count), bent_tip(beam, ALPHA, BY_LABEL[label].shears)
    tip = run.probes["tip"]
    return Found(math.hypot(tip["ux"] - ux, tip["uy"] - uy) / math.hypot(ux, uy), run.warnings)


def equilibrium(label: str, beam: Beam, count: int) -> Found:
    """Compare the reactions with the load and its lever arm."""
    run, P = bend(label, beam, count), ALPHA * beam.EI / beam.L**2
    wall, arm = run.reactions["wall"], run.probes["tip"]["x"]
    off = max(abs(wall["fx"]) / P, abs(wall["fy"] / P - 1.0))
    if BY_LABEL[label].type.degree_y <= 1:
        # where a section warps, the force acts on its mean, which the probe on the axis is not
        off = max(off, abs(wall["m"] / (P * arm) - 1.0))
    return Found(off, run.warnings)


def slenderness() -> Iterator[Cell]:
    """Yield cantilevers up to L/h = 1e6, in every type and formulation."""
    axis = "slenderness L/h"
    for ratio in (1, 10, 1e2, 1e3, 1e4, 1e5, 1e6):
        beam = slender(ratio)
        for s in SUBJECTS:
            yield Cell(axis, f"{ratio:g}", s.label, "small bending, 16 elements, beside Timoshenko",
                       0.2 if ratio == 1 else 0.02, partial(linear_tip, s.label, beam, 16), quick=ratio in (10, 1e6))
            if ratio >= 10:
                yield Cell(axis, f"{ratio:g}", s.label, "bent to P L^2/EI = 2, 16 elements, beside Reissner",
                           0.05 if ratio == 10 else 0.02, partial(bent_far, s.label, beam, 16), quick=ratio == 1e4)
                yield Cell(axis, f"{ratio:g}", s.label, "the same: reactions beside load and arm",
                           max(1e-7, 1e-16 * 12 * ratio**2 / ALPHA), partial(equilibrium, s.label, beam, 16),
                           quick=ratio == 1e4)


def stretched(label: str, nu: float) -> Found:
    """Compare stretch and thinning of a bar under a spread force with Hooke's law."""
    subject, beam = BY_LABEL[label], Beam(nu=nu)
    case = cantilever(subject, beam, 8, [{**force([1e-3 * beam.EA, 0]), "spread": "uniform"}], LINEAR)
    case["output"]["probes"].update(face={"at": "beam@0.37", "y": beam.h / 2})
    run = solve(case)
    off = apart(run.probes["tip"]["ux"], 1e-3 * beam.L)
    if subject.thins:
        off = max(off, abs(run.probes["face"]["uy"] / (1e-3 * beam.h / 2) + nu))
    return Found(off, run.warnings)


def exact(subject: Subject) -> float:
    """Return the tolerance of a uniform strain: round-off, unless neighbours share only coordinates."""
    return 1e-3 if subject.type.common_coefficients else 1e-8


def poisson() -> Iterator[Cell]:
    """Yield bending and stretch over Poisson's ratio."""
    for nu in (-0.9, -0.5, 0.0, 0.3, 0.45, 0.49, 0.499):
        for s in SUBJECTS:
            yield Cell("Poisson's ratio", f"{nu:g}", s.label, "small bending, L/h = 10, 16 elements, beside Timoshenko",
                       0.02, partial(linear_tip, s.label, Beam(nu=nu), 16), quick=nu == 0.499)
            yield Cell("Poisson's ratio", f"{nu:g}", s.label, "stretch and thinning beside Hooke", exact(s),
                       partial(stretched, s.label, nu), quick=nu == 0.499)


def counts() -> Iterator[Cell]:
    """Yield from one to a million elements."""
    for count in (1, 10, 100, 1000, 10**4, 10**5, 10**6):
        for s in DEFAULTS if count <= 10**4 else USUAL if count < 10**6 else [USUAL[0], USUAL[2]]:
            yield Cell("elements", f"{count:g}", s.label, "small bending, L/h = 20, beside Timoshenko",
                       0.35 if count == 1 else 0.02, partial(linear_tip, s.label, slender(20), count), 120.0)
            if count <= 1000 or (count == 10**4 and s in USUAL):
                yield Cell("elements", f"{count:g}", s.label, "bent to P L^2/EI = 2, L/h = 20, beside Reissner",
                           0.7 if count == 1 else 0.02, partial(bent_far, s.label, slender(20), count), 120.0)


def aspects() -> Iterator[Cell]:
    """Yield elements with length over height from 1e-3 to 1e4."""
    for count, ratio in ((10**3, 10.0), (100, 10.0), (10, 10.0), (8, 80.0), (8, 800.0), (8, 8e3),
                         (8, 8e4)):
        for s in DEFAULTS:
            yield Cell("element length over height", f"{ratio / count:g}", s.label,
                       "bent to P L^2/EI = 2, beside Reissner", 0.06,
                       partial(bent_far, s.label, slender(ratio), count))


def in_series(labels: tuple[str, str], parts: tuple[Beam, Beam]) -> Found:
    """Compare a cantilever of two welded bodies with Timoshenko's beams in series."""
    one, two = (BY_LABEL[name] for name in labels)
    total = parts[0].L + parts[1].L
    soft = max(parts, key=lambda p: p.L**3 / p.EI)
    P = 1e-3 * soft.EI / total**2
    case = {"bodies": {"a": parts[0].body(one, 8), "b": parts[1].body(two, 8, (parts[0].L, 0.0))},
            "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "a@0", "hold": "section"}],
            "joints": [{"type": "weld", "between": ["a@1", "b@0"]}],
            "loads": [force([0, -P], two, at="b@1")], "solver": LINEAR, "output": {"probes": {"tip": "b@1"}}}
    run = solve(case)
    expected = -series_tip([(p.L, p.EI, p.kGA if s.shears else math.inf)
                            for p, s in zip(parts, (one, two), strict=True)], P)
    return Found(apart(run.probes["tip"]["uy"], expected), run.warnings)


def neighbours() -> Iterator[Cell]:
    """Yield two welded bodies that differ in stiffness, length or height by up to 1e8."""
    plain = Beam(L=1.0, h=0.02, b=0.02, nu=0.0)
    pairs = [(s.label, s.label) for s in DEFAULTS] + [("vallejo", "reissner3"), ("cable", "vallejo"),
                                                     ("reissner3", "cable"), ("2d2n-nu", "vallejo")]
    for ratio in (1e-8, 1e-4, 1.0, 1e4, 1e8):
        for a, b in pairs:
            label, stiff = a if a == b else f"{a} + {b}", replace(plain, E=plain.E * ratio)
            yield Cell("stiffness of the next body", f"{ratio:g}", label, "small bending, beside Timoshenko", 0.02,
                       partial(in_series, (a, b), (plain, stiff)), quick=ratio in (1e-8, 1e8))
            if ratio < 1.0:
                yield Cell("length of the next body", f"{ratio:g}", label, "small bending, beside Timoshenko", 0.02,
                           partial(in_series, (a, b), (plain, replace(plain, L=ratio))))
                yield Cell("height of the next body", f"{ratio:g}", label, "small bending, beside Timoshenko", 0.02,
                           partial(in_series, (a, b), (plain, replace(plain, h=0.02 * ratio, L=ratio))))


def is_green(subject: Subject) -> bool:
    """Whether its bar has Green-Lagrange strain."""
    return subject.thins or subject.formulation == "green"


def pulled(label: str, stretch: float) -> Found:
    """Compare the elongation of a bar under a force with the law of its formulation."""
    subject, beam = BY_LABEL[label], Beam(L=0.3, nu=0.3)
    N = stretch_force(is_green(subject), stretch) * beam.EA
    run = solve(cantilever(subject, beam, 4, [{**force([N, 0]), "spread": "uniform"}]))
    return Found(apart(run.probes["tip"]["ux"], (stretch - 1.0) * beam.L), run.warnings)


def pressed(label: str, stretch: float) -> Found:
    """Compare the force of a bar at a prescribed stretch with the law of its formulation."""
    subject, beam = BY_LABEL[label], Beam(L=0.3, nu=0.0)
    case = cantilever(subject, beam, 4, [])
    case["boundary_conditions"].append({"name": "press", "type": "prescribed", "at": "beam@1",
                                        "ux": (stretch - 1.0) * beam.L})
    run = solve(case)
    expected = stretch_force(is_green(subject), stretch) * beam.EA
    return Found(abs(run.reactions["press"]["fx"] - expected) / beam.EA, run.warnings)


def strains() -> Iterator[Cell]:
    """Yield tension to a strain of one half, and compression to zero length and beyond."""
    for strain in (1e-12, 1e-6, 1e-2, 0.1, 0.5, -1e-6, -1e-2, -0.1, -0.3):
        for s in SUBJECTS:
            yield Cell("strain", f"{strain:g}", s.label, "by a force, beside the law of the formulation",
                       1e-2 if s.type.common_coefficients else 1e-7,
                       partial(pulled, s.label, 1.0 + strain), quick=strain in (1e-12, 0.5, -0.3))
    for stretch in (0.5, 0.2, 0.01, 0.0, -0.1):
        for s in SUBJECTS:
            if s.type.degree_y <= 1:
                yield Cell("pressed to this part of the length", f"{stretch:g}", s.label,
                           "prescribed, beside the law of the formulation", 1e-7, partial(pressed, s.label, stretch),
                           quick=stretch in (0.2, -0.1))


def rolled(label: str, turns: float, count: int) -> Found:
    """Compare a cantilever rolled up by a moment with the circle."""
    subject, beam = BY_LABEL[label], slender(100)
    M = 2.0 * math.pi * turns * beam.EI / beam.L
    case = cantilever(subject, beam, count, [{"type": "moment", "at": "beam@1", "value": M}], hold=None)
    run = solve(case)
    tip, angle = run.probes["tip"], 2.0 * math.pi * turns
    x, y = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle
    off = max(math.hypot(tip["x"] - x, tip["y"] - y), abs(tip["theta"] / angle - 1.0))
    return Found(off, run.warnings)


def rolls() -> Iterator[Cell]:
    """Yield an arc closed to a circle, once and more."""
    for turns in (0.5, 1.0, 2.0):
        for s in SUBJECTS:
            yield Cell("rolled up, turns", f"{turns:g}", s.label, "by a moment, 40 elements, beside the circle", 0.05,
                       partial(rolled, s.label, turns, 40), quick=turns == 1.0 and s in DEFAULTS)


def column(label: str, ratio: float, aside: float) -> Found:
    """Compare a cantilever column under ``ratio`` times its buckling load, with a small transverse force, with theory.

    Below the buckling load the tip goes aside by the beam-column's formula; above, the run must tell.
    """
    subject, beam = BY_LABEL[label], slender(100)
    critical = beam.EI * (math.pi / 2 / beam.L) ** 2
    P, k = ratio * critical, 0.5 * math.pi * math.sqrt(ratio) / beam.L
    across = aside * beam.EI / beam.L**2
    run = solve(cantilever(subject, beam, 20, [force([-P, across], subject)]))
    tip = run.probes["tip"]
    if ratio >= 1.0:
        # the straight column is the other solution: it is told of, or the column has bent
        straight = abs(tip["ux"] / beam.L) < 0.01
        return Found(math.inf if straight and not run.warnings else 0.0, run.warnings,
                     "warns: " + run.warnings[0] if run.warnings else "bends")
    x = k * beam.L
    expected = across * beam.L**3 / beam.EI * ((math.tan(x) - x) / x**3 if x > 1e-3 else 1 / 3)
    shear = across * beam.L / beam.kGA
    return Found(apart(tip["uy"], expected + (shear if subject.shears else 0.0)), run.warnings)


def pushed(label: str, ratio: float, count: int = 256) -> Found:
    """Compare the lever arm of a cantilever under a very large transverse force with M^2 = 2 P EI, the elastica's."""
    subject, beam = BY_LABEL[label], slender(1000)
    P = ratio * beam.EI * (math.pi / 2 / beam.L) ** 2
    run = solve(cantilever(subject, beam, count, [force([0, -P], subject)]))
    return Found(apart(run.probes["tip"]["x"], math.sqrt(2 * beam.EI / P)), run.warnings)


def columns() -> Iterator[Cell]:
    """Yield loads from nearly zero to a thousand times the buckling load."""
    for ratio in (1e-12, 1e-6, 0.5, 0.99, 1.1, 2.0, 10.0, 1e3):
        for s in DEFAULTS:
            yield Cell("load over buckling load", f"{ratio:g}", s.label, "column, pushed aside, beside the beam-column",
                       0.05 if ratio < 0.9 else 0.5, partial(column, s.label, ratio, 1e-6), 30.0)
    for count, ratio in ((64, 100.0), (64, 1e3), (256, 100.0), (256, 1e3)):
        # linear elements err by about a twelfth of (l/lambda)^2, lambda = sqrt(EI/P) how far the wall is felt
        limit = max(0.05, (0.5 * math.pi / count) ** 2 * ratio / 6.0)
        for s in DEFAULTS:
            yield Cell("load over buckling load", f"{ratio:g}", s.label,
                       f"across, {count} elements, beside the elastica", limit,
                       partial(pushed, s.label, ratio, count), 30.0)


def turned(label: str, turns: int) -> Found:
    """Turn a pinned beam statically: no strain, and the tip comes back."""
    subject, beam = BY_LABEL[label], Beam()
    case = {"bodies": {"beam": beam.body(subject, 2)},
            "boundary_conditions": [{"type": "pin", "at": "beam@0"},
                                    {"type": "prescribed", "at": "beam@0", "angle": 2 * math.pi * (turns + 0.125)}],
            "solver": {"type": "static", "steps": 16 * turns}, "output": {"probes": {"tip": "beam@1"}}}
    run = solve(case)
    c = math.sqrt(0.5)
    off = max(abs(run.probes["tip"]["x"] - c), abs(run.probes["tip"]["y"] - c),
              math.sqrt(2 * run.summary["energy"]["strain"] / beam.EA))
    return Found(off, run.warnings)


def strained(label: str, number: int) -> Found:
    """Return the strain that a rigid rotation by many turns and a third leaves in the coordinates."""
    return Found(conservation.turned_strain(label, number + 1 / 3))


def turns() -> Iterator[Cell]:
    """Yield beams turned statically by many turns."""
    for number in (1, 10, 100):
        for s in DEFAULTS if number < 100 else USUAL:
            yield Cell("turns", f"{number:g}", s.label, "turned at its pin: place and strain", 1e-9,
                       partial(turned, s.label, number), 60.0)
    for number in (100, 10**4):
        for s in DEFAULTS:
            if s.order is None:
                yield Cell("turns", f"{number:g}", s.label, "coordinates turned rigidly: strain", 1e-9,
                           partial(strained, s.label, number))
