"""Known traps by name: singular positions, contradictory constraints, zero loads, numbers of any size."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import ancf2d

from .cell import Cell, Found
from .scenes import BY_LABEL, DEFAULTS, SUBJECTS, USUAL, Beam, apart, cantilever, force, free, solve
from .statics import slender

STEEL = {"E": 2.07e11, "nu": 0.3, "rho": 7850}
Case = dict[str, Any]
SOLVERS: dict[str, dict[str, Any]] = {
    "linear_static": {"type": "linear_static"}, "static": {"type": "static"},
    "arc_length": {"type": "static", "method": "arc_length"}, "eigen": {"type": "eigen", "modes": 2},
    "buckling": {"type": "buckling", "modes": 1}, "dynamic": {"type": "dynamic", "t_end": 0.01, "tolerance": 1e-4},
}


def stiff_axial(label: str) -> Found:
    """A clamped beam with EA L^2/EI = 1e10 compared with Reissner's beam: the elastica at P L^2/EI = 2."""
    subject = BY_LABEL[label]
    case = cantilever(subject, Beam(), 16, [force([0, -2.0])], hold="section")
    body = case["bodies"]["beam"]
    body.pop("material")
    body["section"] = {"EA": 1e10, "kGA": 4e9, "EI": 1.0}
    run = solve(case)
    # elliptic integrals (Mattiasson 1981, Table 1)
    return Found(max(abs(run.probes["tip"]["uy"] + 0.49346), abs(run.probes["tip"]["ux"] + 0.16064)), run.warnings)


def ring(label: str) -> Found:
    """A closed, welded ring under a small opposite pair of forces, compared with P R^3/EI (pi/4 - 2/pi)."""
    subject, beam = BY_LABEL[label], slender(100)
    R, P = 0.5, 1e-4 * beam.EI
    body = beam.body(subject, 64)
    body["geometry"] = {"type": "arc", "center": [0, 0], "radius": R, "from": -math.pi / 2, "to": 1.5 * math.pi}
    case = {"bodies": {"ring": body},
            "boundary_conditions": [{"type": "clamp", "at": "ring@0", "hold": "section"}],
            "joints": [{"type": "weld", "between": ["ring@0", "ring@1"]}],
            "loads": [{"type": "force", "at": "ring@0.5", "value": [0, P]}], "solver": {"type": "static"},
            "output": {"probes": {"top": "ring@0.5"}}}
    run = solve(case)
    return Found(apart(run.probes["top"]["uy"], P * R**3 / beam.EI * (math.pi / 4 - 2 / math.pi)), run.warnings)


def snap(label: str) -> Found:
    """A shallow arch above its limit load: newton must refuse, or report that it is on another branch."""
    subject = BY_LABEL[label]
    body = Beam(h=0.02, b=0.02, E=1e9).body(subject, 16)
    body["geometry"] = {"type": "polyline", "points": [[-1, 0], [0, 0.15], [1, 0]]}
    case = {"bodies": {"arch": body}, "boundary_conditions": [{"type": "pin", "at": "arch@0"},
                                                              {"type": "pin", "at": "arch@1"}],
            "loads": [{"type": "force", "at": "arch@0.5", "value": [0, -2500]}], "solver": {"type": "static"},
            "output": {"probes": {"top": "arch@0.5"}}}
    run = solve(case)
    inverted = run.probes["top"]["y"] < 0.0
    return Found(0.0 if inverted and run.warnings else math.inf, run.warnings)


def clamped_twice(label: str, ratio: float) -> Found:
    """A beam clamped at both ends under a small central force, compared with P L^3/(192 EI) + P L/(4 kGA)."""
    subject, beam = BY_LABEL[label], slender(ratio)
    P = 1e-3 * beam.EI / beam.L**2
    hold = free(subject)
    case = {"bodies": {"beam": beam.body(subject, 16)},
            "boundary_conditions": [{"type": "clamp", "at": "beam@0", "hold": hold},
                                    {"type": "clamp", "at": "beam@1", "hold": hold}],
            "loads": [force([0, -P], subject, at="beam@0.5")], "solver": {"type": "linear_static"},
            "output": {"probes": {"mid": "beam@0.5"}}}
    run = solve(case)
    shear = P * beam.L / (4 * beam.kGA) if subject.shears else 0.0
    return Found(apart(run.probes["mid"]["uy"], -(P * beam.L**3 / (192 * beam.EI) + shear)), run.warnings)


def zero_load(label: str, solver: str) -> Found:
    """No load: nothing moves, or there is nothing to solve."""
    run = solve(cantilever(BY_LABEL[label], Beam(), 4, [force([0, 0])], SOLVERS[solver]))
    tip = run.probes["tip"]
    moved = max(abs(tip[k]) for k in ("ux", "uy", "theta")) if "ux" in tip else 0.0
    if solver == "buckling":
        return Found(math.inf, run.warnings)
    return Found(moved + abs(run.summary["energy"]["strain"]), run.warnings)


def massless(label: str, solver: str, given: bool) -> Found:
    """A motion of a body without density must be refused."""
    case = cantilever(BY_LABEL[label], Beam(), 4, [force([0, -1])], SOLVERS[solver])
    if given:
        case["bodies"]["beam"]["material"]["rho"] = 0.0
    else:
        del case["bodies"]["beam"]["material"]["rho"]
    solve(case)
    return Found(math.inf)


def twice(label: str, solver: str) -> Found:
    """Two supports with the same constraint: as one support, with a warning."""
    case = cantilever(BY_LABEL[label], Beam(), 4, [force([0, -10])], SOLVERS[solver])
    one = solve(case).probes["tip"]["uy"]
    case["boundary_conditions"] += [{"type": "pin", "at": "beam@0"}, {"type": "roller", "at": "beam@0", "fixed": "y"}]
    run = solve(case)
    if not any("redundant" in w for w in run.warnings):
        return Found(math.inf, run.warnings, "not told")
    return Found(apart(run.probes["tip"]["uy"], one))


def at_odds(label: str) -> Found:
    """Two supports that prescribe different motions of one point must be refused."""
    case = cantilever(BY_LABEL[label], Beam(), 4, [])
    case["boundary_conditions"] += [{"type": "prescribed", "at": "beam@1", "uy": 0.01},
                                    {"type": "prescribed", "at": "beam@1", "uy": 0.02}]
    solve(case)
    return Found(math.inf)


def jump(label: str) -> Found:
    """A motion with a jump would need an infinite velocity and must be refused."""
    case = cantilever(BY_LABEL[label], Beam(), 4, [], SOLVERS["dynamic"])
    step = {"type": "table", "t": [0, 0.005, 0.005, 0.01], "value": [0, 0, 0.01, 0.01]}
    case["boundary_conditions"].append({"type": "prescribed", "at": "beam@1", "uy": step})
    solve(case)
    return Found(math.inf)


def flipped(label: str, turn: float) -> Found:
    """A soft section turned at its end in one static step: it has the prescribed angle, or the run fails."""
    subject, beam = BY_LABEL[label], Beam()
    case = cantilever(subject, beam, 4, [], {"type": "static", "steps": 1})
    case["boundary_conditions"].append({"type": "prescribed", "at": "beam@1", "angle": turn})
    run = solve(case)
    return Found(abs(run.probes["tip"]["theta"] - turn), run.warnings)


def toggle(label: str, slope: float) -> Found:
    """A nearly singular roller: its force is exactly the load over the slope, or the mechanism is named."""
    subject, beam = BY_LABEL[label], slender(100)
    H = 1e-9 * beam.EA * slope
    case = {"bodies": {"beam": beam.body(subject, 8)},
            "boundary_conditions": [
                {"type": "roller", "at": "beam@0", "fixed": "y"}, {"type": "roller", "at": "beam@0.5", "fixed": "y"},
                {"name": "near", "type": "roller", "at": "beam@1", "normal": [slope, 1.0]}],
            "loads": [{"type": "force", "at": "beam@1", "value": [H, 0]}], "solver": {"type": "linear_static"}}
    run = solve(case)
    return Found(apart(run.reactions["near"]["fx"], -H), run.warnings)


def extreme_number(change: str) -> Found:
    """A number at the limits of floating point: solved and right, or refused; never NaN."""
    case = ancf2d.load(cantilever(BY_LABEL["vallejo"], Beam(), 4, [force([0, -1e-3])]), [change])
    run = ancf2d.solve(case, states=False)
    numbers = [*run.probes["tip"].values(), *run.reactions["wall"].values()]
    if not all(math.isfinite(x) for x in numbers):
        return Found(math.inf, run.warnings, "not finite")
    body = case.case.bodies["beam"]
    h, b, L = body.section.height, body.section.width, body.geometry.end[0]
    P, EI = -case.case.loads[0].value[1], body.material.E * b * h**3 / 12
    beam = Beam(L, h, b, body.material.E, body.material.nu)
    small = P * L**2 < 0.01 * EI
    if small:
        return Found(apart(run.probes["tip"]["uy"], -beam.tip(P)), run.warnings)
    return Found(apart(run.reactions["wall"]["fy"], P), run.warnings)


NUMBERS = ("bodies.beam.material.E=1e300", "bodies.beam.material.E=1e-300", "bodies.beam.section.height=1e-150",
           "bodies.beam.section.height=1e100", "bodies.beam.section.width=1e-300", "bodies.beam.section.width=1e300",
           "loads.0.value=[0,-1e300]", "loads.0.value=[0,-1e-300]", "bodies.beam.geometry.end=[1e-150,0]",
           "bodies.beam.geometry.end=[1e150,0]", "bodies.beam.material.nu=0.4999999999",
           "bodies.beam.material.nu=-0.9999999999", "solver.tolerance=1e-300", "solver.tolerance=0.99")


def amplitude(text: str, solver: str) -> Found:
    """An amplitude without a value somewhere must be refused."""
    load = {**force([0, -1e-3]), "amplitude": {"type": "expression", "value": text}}
    solve(cantilever(BY_LABEL["vallejo"], Beam(), 4, [load], SOLVERS[solver]))
    return Found(math.inf)


AMPLITUDES = ("1/(t - t)", "sqrt(-1 - t)", "exp(1000 + 1e4*t)", "(t - 2)^0.5", "1e308*10*t")


def rows() -> Iterator[Cell]:
    """Yield every trap."""
    def trap(name: str, value: str, label: str, limit: float, compute: Callable[[], Found], seconds: float = 30.0,
             ) -> Cell:
        return Cell("traps", value, label, name, limit, compute, seconds, quick=label in ("vallejo", "-"))

    for s in USUAL:
        yield trap("clamped beam, EA L^2/EI = 1e10, beside the elastica", "static", s.label, 2e-3,
                   partial(stiff_axial, s.label))
        for value in SOLVERS:
            if value not in ("eigen",):
                yield trap("no load: no displacement", value, s.label, 0.0, partial(zero_load, s.label, value))
        for value in ("eigen", "dynamic"):
            yield trap("no density: refused", value, s.label, 0.0, partial(massless, s.label, value, True))
            yield trap("density left out: refused", value, s.label, 0.0, partial(massless, s.label, value, False))
        for value in ("linear_static", "static"):
            yield trap("held twice: as once, and told", value, s.label, 1e-9, partial(twice, s.label, value))
        yield trap("motions at odds: refused", "static", s.label, 0.0, partial(at_odds, s.label))
        yield trap("motion with a jump: refused", "dynamic", s.label, 0.0, partial(jump, s.label))
        for slope in (1e-3, 1e-6, 1e-8, 1e-10, 1e-12):
            yield trap("roller that hardly holds: its force", f"slope {slope:g}", s.label, 1e-4,
                       partial(toggle, s.label, slope))
    for s in SUBJECTS:
        for turn in (1.0, 2.0, 3.1):
            yield trap("end turned at once: where it stands", f"{turn:g} rad", s.label, 1e-6,
                       partial(flipped, s.label, turn))
    for s in DEFAULTS:
        for ratio in (10.0, 100.0, 1e4):
            yield trap("clamped at both ends, beside Timoshenko", f"L/h = {ratio:g}", s.label, 0.05,
                       partial(clamped_twice, s.label, ratio))
        yield trap("closed ring, pulled apart, beside the thin ring", "static", s.label, 0.02, partial(ring, s.label))
        yield trap("shallow frame pressed through under load control", "static", s.label, 0.0, partial(snap, s.label))
    for change in NUMBERS:
        yield trap("a number out of all proportion", change, "-", 1e-3, partial(extreme_number, change))
    for text in AMPLITUDES:
        for solver in ("static", "dynamic"):
            yield trap("an amplitude without a value: refused", text, f"- ({solver})", 0.0,
                       partial(amplitude, text, solver))
