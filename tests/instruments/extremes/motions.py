"""Motion at the extremes: slenderness, far too short and far too long steps, very many steps and turns."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache, partial
from typing import Any

from instruments.motions import conservation

from .cell import Cell, Found
from .scenes import BY_LABEL, DEFAULTS, USUAL, Beam, Subject, force, solve

G = 9.81
SPUN = "rod that spins freely: energy and angular momentum"
METHODS = ("radau5", "radau9", "generalized_alpha", "hht", "newmark", "energy_momentum")


def falling(ratio: float, stiff: float = 0.5) -> Beam:
    """Return a pendulum of given slenderness with EI = ``stiff`` rho A g L^3, so that all fall alike."""
    h = 1.0 / ratio
    return Beam(L=1.0, h=h, b=h, E=12.0 * stiff * 1000.0 * G / h**2, rho=1000.0)


def pendulum(subject: Subject, beam: Beam, count: int, t_end: float, **solver: Any) -> dict[str, Any]:
    """Return a pendulum that falls from the horizontal."""
    return {"bodies": {"beam": beam.body(subject, count)}, "boundary_conditions": [{"type": "pin", "at": "beam@0"}],
            "loads": [{"type": "gravity", "value": [0, -G]}],
            "solver": {"type": "dynamic", "t_end": t_end, **solver}, "output": {"probes": {"tip": "beam@1"}}}


@cache
def fallen(ratio: float, t_end: float) -> tuple[float, float]:
    """Return the position of the tip, by the geometrically exact beam with a tight tolerance."""
    run = solve(pendulum(BY_LABEL["reissner3"], falling(min(ratio, 1e3)), 16, t_end, method="radau9", tolerance=1e-9,
                         estimate=False))
    return run.probes["tip"]["x"], run.probes["tip"]["y"]


def told(summary: dict[str, Any], error: float) -> list[str]:
    """Return the estimated error of the steps as a warning if it announces the error."""
    estimate = summary.get("accuracy", {}).get("estimate")
    return [f"error of the steps: about {estimate:.1g}"] if estimate is not None and estimate > 0.2 * error else []


def slender_fall(label: str, ratio: float) -> Found:
    """Compare a falling pendulum, steps by the default tolerance, with the geometrically exact one."""
    t_end = 0.6
    run = solve(pendulum(BY_LABEL[label], falling(ratio), 8, t_end, estimate=False, tolerance=1e-6))
    x, y = fallen(ratio, t_end)
    off = math.hypot(run.probes["tip"]["x"] - x, run.probes["tip"]["y"] - y)
    return Found(max(off, run.summary["energy_drift"]), run.warnings)


def stiff_fall(label: str) -> Found:
    """Compare a nearly rigid steel pendulum, L/h = 100, with the rigid one: theta'' = -3 g sin(theta)/(2 L)."""
    from scipy.integrate import solve_ivp

    beam = Beam(L=1.0, h=0.01, b=0.01, E=2.07e14, rho=7850.0)
    run = solve(pendulum(BY_LABEL[label], beam, 4, 2.0, estimate=False, tolerance=1e-6))
    angle = solve_ivp(lambda t, u: [u[1], -1.5 * G * math.cos(u[0])], (0, 2.0), [0.0, 0.0], rtol=1e-11, atol=1e-12,
                      method="DOP853").y[0, -1]
    tip = run.probes["tip"]
    return Found(math.hypot(tip["x"] - math.cos(angle), tip["y"] - math.sin(angle)), run.warnings)


def stepped(label: str, method: str, ratio: float) -> Found:
    """Compare a pendulum with fixed steps, ``ratio`` times its fastest period, with one of tight tolerance."""
    subject, t_end = BY_LABEL[label], 0.5
    beam = Beam(L=1.0, h=0.05, b=0.05, E=1e7, rho=1000.0)
    # a wave along the shortest element, there and back
    period = 2.0 * (beam.L / 4) * math.sqrt(beam.rho / beam.E)
    run = solve(pendulum(subject, beam, 4, t_end, method=method, dt=min(ratio * period, t_end)))
    x, y = _fine(label, t_end)
    off = math.hypot(run.probes["tip"]["x"] - x, run.probes["tip"]["y"] - y)
    return Found(off, [*run.warnings, *told(run.summary, off)])


@cache
def _fine(label: str, t_end: float) -> tuple[float, float]:
    beam = Beam(L=1.0, h=0.05, b=0.05, E=1e7, rho=1000.0)
    run = solve(pendulum(BY_LABEL[label], beam, 4, t_end, method="radau9", tolerance=1e-10, estimate=False))
    return run.probes["tip"]["x"], run.probes["tip"]["y"]


def many_steps(label: str, steps: int) -> Found:
    """Return the largest relative change of energy and momenta of a rod in free flight."""
    found = conservation.drift(label, steps)
    return Found(max(found["energy"], found["linear"], found["angular"]))


def flown(label: str, method: str, steps: int) -> Found:
    """Return the change of linear momentum and the gain of energy of a rod in free flight.

    A method that damps may lose energy. Forces of elements have no sum but their round-off, of EA = 8e7 N about 1e-8 N,
    which in steps of 1e-4 s add to 1e-9 Ns after a million, beside 10 Ns: 1e-9 leaves them ten times the room.
    """
    found = conservation.drift(label, steps, method)
    return Found(max(found["linear"], found["gain"]))


def spun(label: str, solver: str) -> Found:
    """Return the change of energy and angular momentum of a rod that spins freely ten thousand times.

    ``energy_momentum`` keeps both, but for round-off. Adaptive steps err by their tolerance each, and the energy by
    twice that: 3e5 steps, thirty a turn, may lose 6e-5 at 1e-10.
    """
    return Found(*conservation.spun(label, solver, 1e4))


def over_the_top(label: str, speed: float) -> Found:
    """Compare a stiff pendulum thrown upwards with the rigid one, through the upright position or nearly so.

    ``speed`` : the rate of rotation at the start over that which just reaches the upright from below.
    """
    from scipy.integrate import solve_ivp

    subject, omega, t_end = BY_LABEL[label], speed * math.sqrt(6.0 * G), 1.5
    beam = Beam(L=1.0, h=0.05, b=0.05, E=2e11, rho=1000.0)
    case = pendulum(subject, beam, 4, t_end, estimate=False, tolerance=1e-7)
    case["bodies"]["beam"] = beam.body(subject, 4, angle=-math.pi / 2)
    case["initial"] = {"rotation_rate": {"omega": omega, "about": [0, 0]}}
    run = solve(case)
    angle = solve_ivp(lambda t, u: [u[1], -1.5 * G * math.cos(u[0])], (0, t_end), [-math.pi / 2, omega], rtol=1e-11,
                      atol=1e-12, method="DOP853").y[0, -1]
    tip = run.probes["tip"]
    return Found(math.hypot(tip["x"] - math.cos(angle), tip["y"] - math.sin(angle)), run.warnings)


def crank(label: str, method: str, turns: float) -> Found:
    """Compare a slider, driven by a crank through its dead points, with its kinematics."""
    subject = BY_LABEL[label]
    arm, rod = Beam(L=0.3, h=0.02, b=0.02, E=2e11), Beam(L=0.7, h=0.02, b=0.02, E=2e11)
    case = {"bodies": {"crank": {"geometry": {"type": "line", "start": [0, 0], "end": [arm.L, 0]},
                                 "element": {"type": "rigid", "mass": 0.1, "inertia": 1e-3}},
                       "rod": rod.body(subject, 2, (arm.L, 0.0))},
            "boundary_conditions": [{"type": "pin", "at": "crank@0"},
                                    {"type": "prescribed", "at": "crank@0",
                                     "angle": {"type": "expression", "value": f"{2 * math.pi * turns}*t^3"}}],
            "joints": [{"type": "pin", "between": ["crank@1", "rod@0"]},
                       {"type": "slider", "at": "rod@1", "through": [0, 0], "along": [1, 0]}],
            "solver": {"type": "dynamic", "t_end": 1.0, "method": method,
                       "tolerance": 1e-6, "estimate": False},
            "output": {"probes": {"slider": "rod@1"}}}
    run = solve(case)
    angle = 2 * math.pi * turns
    x = arm.L * math.cos(angle) + math.sqrt(rod.L**2 - (arm.L * math.sin(angle)) ** 2)
    return Found(abs(run.probes["slider"]["x"] - x), run.warnings)


def pushed_dead(label: str) -> Found:
    """Push a slider at the dead point of its crank: nothing turns by itself, or the run says why it stops."""
    subject, rod = BY_LABEL[label], Beam(L=0.7, h=0.02, b=0.02, E=2e11)
    case = {"bodies": {"crank": Beam(L=0.3, h=0.02, b=0.02, E=2e11).body(subject, 2),
                       "rod": rod.body(subject, 2, (0.3, 0.0))},
            "boundary_conditions": [{"type": "pin", "at": "crank@0"}],
            "joints": [{"type": "pin", "between": ["crank@1", "rod@0"]},
                       {"type": "slider", "at": "rod@1", "through": [0, 0], "along": [1, 0]}],
            "loads": [force([-10.0, 0], at="rod@1")], "solver": {"type": "dynamic", "t_end": 0.01, "tolerance": 1e-6},
            "output": {"probes": {"slider": "rod@1"}}}
    run = solve(case)
    return Found(abs(run.probes["slider"]["x"] - 1.0), run.warnings)


def many_states(label: str, states: int) -> Found:
    """Store many states, one per step, and return the drift of energy; all of them must be stored."""
    case = pendulum(BY_LABEL[label], Beam(), 1, 1.0, method="energy_momentum", dt=1.0 / states, estimate=False)
    case["output"]["every"] = 1
    run = solve(case, states=True)
    return Found(run.summary["energy_drift"] if run.d.shape[0] == states + 1 else math.inf, run.warnings)


def loop(third: bool) -> Found:
    """A parallelogram of rigid bars, with a third bar that constrains the same motion twice, and a single bar."""
    def bar(x0: float, y0: float, x1: float, y1: float) -> dict[str, Any]:
        return {"geometry": {"type": "line", "start": [x0, y0], "end": [x1, y1]},
                "element": {"type": "rigid", "mass": 1.0, "inertia": 1 / 12}}

    case = {"bodies": {"a": bar(0, 0, 0, -1), "b": bar(0, -1, 2, -1), "c": bar(2, -1, 2, 0)},
            "boundary_conditions": [{"type": "pin", "at": "a@0"}, {"type": "pin", "at": "c@1"}],
            "joints": [{"type": "pin", "between": ["a@1", "b@0"]}, {"type": "pin", "between": ["b@1", "c@0"]}],
            "loads": [force([5.0, 0], at="b@0.5")],
            "solver": {"type": "dynamic", "t_end": 0.3, "tolerance": 1e-8, "estimate": False},
            "output": {"probes": {"a": "a@1", "c": "c@0"}}}
    if third:
        case["bodies"]["d"] = bar(1, -1, 1, 0)
        case["boundary_conditions"].append({"type": "pin", "at": "d@1"})
        case["joints"].append({"type": "pin", "between": ["b@0.5", "d@0"]})
    run = solve(case)
    a, c = run.probes["a"], run.probes["c"]
    return Found(math.hypot(c["x"] - a["x"] - 2.0, c["y"] - a["y"]) if abs(a["x"]) > 0.05 else math.inf, run.warnings)


def rows() -> Iterator[Cell]:
    """Yield every motion."""
    for ratio in (10, 1e2, 1e3, 1e4, 1e5, 1e6):
        for s in DEFAULTS if ratio <= 1e3 else USUAL:
            yield Cell("motion: slenderness L/h", f"{ratio:g}", s.label,
                       "falling pendulum at tolerance 1e-6, EI = rho A g L^3/2, beside the beam; energy",
                       0.05, partial(slender_fall, s.label, ratio), 40.0)
    for s in DEFAULTS:
        yield Cell("motion: traps", "radau5", s.label, "stiff thin pendulum at tolerance 1e-6, beside the rigid one",
                   1e-3, partial(stiff_fall, s.label), 40.0, quick=s in USUAL)
    for s in USUAL:
        for speed in (0.9, 0.999, 1.001, 1.5):
            yield Cell("motion: traps", f"{speed:g} of the speed", s.label, "pendulum thrown to and over the upright",
                       0.1 if 0.9 < speed < 1.1 else 1e-2, partial(over_the_top, s.label, speed), 40.0,
                       quick=s.label == "cable")
        for method in METHODS[:2]:
            yield Cell("motion: traps", method, s.label, "crank through its dead points, two turns", 1e-3,
                       partial(crank, s.label, method, 2.0), 40.0)
        yield Cell("motion: traps", "radau5", s.label, "slider pressed at its dead point", 1e-3,
                   partial(pushed_dead, s.label), 40.0)
        for method in METHODS:
            for ratio in (1e-2, 0.1, 1.0, 10.0, 100.0):
                yield Cell("motion: step over fastest period", f"{ratio:g}", f"{s.label}, {method}",
                           "falling pendulum, tip after half a second", 2e-3,
                           partial(stepped, s.label, method, ratio), 60.0, quick=ratio == 10 and s.label == "cable")
    for third in (False, True):
        yield Cell("motion: traps", "three bars" if third else "two bars", "rigid", "parallelogram: stays one", 1e-7,
                   partial(loop, third), 60.0, quick=True)
    yield Cell("motion: steps", "1e+05 states", "cable, energy_momentum", "every step stored: energy", 1e-6,
               partial(many_states, "cable", 10**5), 300.0)
    for label, numbers in (("vallejo", (10**4,)), ("omar", (10**6,)), ("cable", (10**4, 10**6))):
        for steps in numbers:
            yield Cell("motion: steps", f"{steps:g}", f"{label}, energy_momentum", "free flight: energy and momenta",
                       1e-9, partial(many_steps, label, steps), 400.0)
    yield Cell("motion: steps", f"{10**6:g}", "reissner2, generalized_alpha",
               "free flight: linear momentum, and no gain of energy", 1e-9,
               partial(flown, "reissner2", "generalized_alpha", 10**6), 400.0)
    for label in ("cable", "vallejo"):
        yield Cell("motion: turns", f"{10**4:g}", f"{label}, energy_momentum", SPUN, 1e-9,
                   partial(spun, label, "method: energy_momentum, dt: 1e-2"), 400.0)
    yield Cell("motion: turns", f"{10**4:g}", "reissner3, radau9", SPUN, 1e-4,
               partial(spun, "reissner3", "method: radau9, tolerance: 1e-10"), 400.0)
