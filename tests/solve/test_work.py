"""Counted work of representative cases: a guard against slowness that does not depend on the machine.

``work.json`` holds reviewed counts. More than stored is a regression; less is progress to be stored: ``pytest
tests/solve/test_work.py --update``, and review the difference.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import helpers as h
import pytest
from motions import GRAVITY, STEEL, Ride, rigid, rod

from ancf2d.kernels.motion.state import COUNT, REJECTED
from ancf2d.solvers import linear, system

STORED = Path(__file__).with_name("work.json")
# steps that adapt, and iterations that end at round-off, may be a few more or less on another machine
SHARE = 0.02
KERNELS = ("force", "force_tangent", "tangent_action", "force_noise")
MATRICES = ("SymmetricBand", "SymmetricFronts", "GeneralBand", "GeneralSparse")

LOADED = {"bc": [{"type": "clamp", "at": "beam@0"}], "loads": [{"type": "force", "at": "beam@1", "value": [0, -5e5]}]}
PRESSED = {"bc": [{"type": "clamp", "at": "beam@0"}],
           "loads": [{"type": "force", "at": "beam@1", "value": [-1.2e6, 1e3]}]}
SECTION = {"height": 0.1, "width": 0.1}
PINNED = {"bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY}
CRANK = {
    "bodies": {"crank": rigid([0, 0], [0.2, 0], 1.0, 0.02), "rod": rod("vallejo", 4, (0.2, 0), (1.0, 0))},
    "bc": [{"type": "prescribed", "at": "crank@0", "ux": 0, "uy": 0,
            "angle": {"type": "expression", "value": "3*t"}}],
    "joints": [{"name": "wrist", "type": "pin", "between": ["crank@1", "rod@0"]},
               {"name": "guide", "type": "slider", "at": "rod@1", "through": [0, 0], "along": [2, 0]}],
    "initial": {"bodies": {"crank": {"rotation_rate": {"omega": 3.0, "about": [0, 0]}},
                           "rod": {"rotation_rate": {"omega": -3.0 * 0.2 / 0.8, "about": [1.0, 0]}}}}}


def beam(name: str, count: int) -> dict[str, Any]:
    """Return the bodies of a steel beam of 2 m."""
    return {"beam": h.body(h.line(2.0), h.element(name, count), SECTION, STEEL)}


def still(name: str, count: int, solver: Any, **scene: Any) -> Callable[[pytest.MonkeyPatch], Counter[str]]:
    """Return counts of kernel calls, factorisations, solutions, states and iterations of a static case."""
    def work(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
        found: Counter[str] = Counter()

        def tallied(what: str, call: Callable[..., Any]) -> Callable[..., Any]:
            def count(*args: Any, **kwargs: Any) -> Any:
                found[what] += 1
                return call(*args, **kwargs)
            return count

        model = h.build(beam(name, count), solver, **scene)
        for kernel in KERNELS:
            monkeypatch.setattr(system, kernel, tallied(kernel, getattr(system, kernel)))
        for matrix in MATRICES:
            for method in ("factor", "solve"):
                kind = getattr(linear, matrix)
                monkeypatch.setattr(kind, method, tallied(method, getattr(kind, method)))
        states = h.Solution(model).states
        found["states"] = len(states)
        found["iterations"] = sum(int(s.history.get("iterations", 0)) for s in states)
        return found
    return work


def moving(scene: dict[str, Any], t_end: float, **solver: Any) -> Callable[[pytest.MonkeyPatch], Counter[str]]:
    """Return counts of evaluations, factorisations, steps and iterations of a motion."""
    def work(_: pytest.MonkeyPatch) -> Counter[str]:
        ride = Ride(scene, t_end, states=10, **solver).start().on()
        forces, tangents, factorisations = (int(x) for x in ride.stepper.w.counts)
        numbers = ride.stepper.s.numbers
        return Counter({"forces": forces, "tangents": tangents, "factor": factorisations,
                        "steps": int(numbers[COUNT]), "rejected": int(numbers[REJECTED]),
                        "iterations": int(ride.column("iterations").sum())})
    return work


FALLING = {"bodies": {"a": rod("reissner3", 4)}, **PINNED}
TWELVE = {"bodies": {"a": rod("vallejo", 4)}, **PINNED}
# two materials that relax unlike one another
RELAXING = {"bodies": {"a": rod("reissner3", 4, viscoelastic=[{"modulus": 2.0, "time": 0.03}]),
                       "b": rod("vallejo", 2, (0, 1), (1, 1), viscoelastic=[{"modulus": 0.5, "time": 0.1},
                                                                            {"modulus": 0.2, "time": 1.0}])},
            "bc": [{"type": "pin", "at": "a@0"}, {"type": "pin", "at": "b@0"}], "loads": GRAVITY}
# a step has dozens of periods of the fastest vibrations; the force bends the beam beyond its yield stress
YIELDING = {"bodies": {"a": h.body(h.line(1.0), h.element("reissner3", 200), {"height": 0.02, "width": 0.02}, {
                "E": 2e11, "nu": 0.3, "rho": 7850, "yield": 2.5e8, "hardening": {"kinematic": 1e10}})},
            "bc": [{"type": "clamp", "at": "a@0"}], "loads": [{"type": "force", "at": "a@1", "value": [0, -460]}]}
# a bar that swings, of elements so short that their vibrations are far too fast for the steps
SHORT = {"bodies": {"a": h.body(h.line(1.2), h.element("2d2n", 64), {"height": 0.253, "width": 0.006335},
                                {"E": 7e5, "nu": 0.3, "rho": 5540})}, **PINNED}
CASES: dict[str, Callable[[pytest.MonkeyPatch], Counter[str]]] = {
    "large deflection, reissner2": still("reissner2", 64, "static", **LOADED),
    "large deflection, vallejo": still("vallejo", 16, "static", **LOADED),
    "path beyond buckling, reissner3": still("reissner3", 8, {"type": "static", "method": "arc_length"}, **PRESSED),
    "modes, reissner2, dense": still("reissner2", 20, {"type": "eigen", "modes": 6}, bc=LOADED["bc"]),
    "modes, vallejo, Lanczos": still("vallejo", 200, {"type": "eigen", "modes": 10}, bc=LOADED["bc"]),
    "buckling, reissner3": still("reissner3", 100, {"type": "buckling", "modes": 3}, **PRESSED),
    "motion, radau5, fixed steps": moving(FALLING, 0.5, dt=0.01),
    "motion, radau5, adaptive": moving(FALLING, 0.5, tolerance=1e-6),
    "motion of short elements, radau5, long steps": moving(SHORT, 0.5, dt=5e-3),
    "motion, radau9, adaptive": moving(TWELVE, 0.5, tolerance=1e-6, method="radau9"),
    "motion of materials that relax, radau5, fixed steps": moving(RELAXING, 0.5, dt=0.01),
    "motion of materials that relax, radau9, adaptive": moving(RELAXING, 0.5, tolerance=1e-6, method="radau9"),
    "motion, generalized alpha": moving(TWELVE, 0.2, dt=1e-3, method="generalized_alpha"),
    "motion, generalized alpha, full Newton": moving(TWELVE, 0.2, dt=1e-3, method="generalized_alpha", newton="full"),
    "motion of fibres, generalized alpha, long steps": moving(YIELDING, 2e-3, dt=1e-4, method="generalized_alpha"),
    "motion of fibres, radau9, long steps": moving(YIELDING, 2e-3, dt=1e-4, method="radau9"),
    "motion, energy-momentum": moving(TWELVE, 0.2, dt=1e-3, method="energy_momentum"),
    "mechanism with multipliers, radau5": moving(CRANK, 0.2, tolerance=1e-5),
    "mechanism with multipliers, generalized alpha": moving(CRANK, 0.2, dt=2e-3, method="generalized_alpha")}


@pytest.mark.parametrize("name", CASES)
def test_work_has_not_grown(name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    now = {what: n for what, n in CASES[name](monkeypatch).items() if n}
    if request.config.getoption("--update"):
        update(name, now)
    stored = json.loads(STORED.read_text(encoding="utf-8"))[name]
    off = [f"{what}: {now.get(what, 0)} instead of {stored.get(what, 0)}" for what in sorted(now.keys() | stored.keys())
           if abs(now.get(what, 0) - stored.get(what, 0)) > 1 + SHARE * stored.get(what, 0)]
    assert not off, f"{name}: {', '.join(off)} (fewer is progress: --update, and review)"


def update(name: str, now: dict[str, int]) -> None:
    """Store the counts of a case, and drop those of deleted cases."""
    stored = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    stored[name] = now
    kept = {case: dict(sorted(stored[case].items())) for case in CASES if case in stored}
    STORED.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def test_no_stored_count_is_left_over() -> None:
    assert json.loads(STORED.read_text(encoding="utf-8")).keys() == CASES.keys()


def test_one_tangent_too_many_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    assemble = system.System.assemble

    def twice(self: Any, *args: Any, **kwargs: Any) -> Any:
        assemble(self, *args, **kwargs)
        return assemble(self, *args, **kwargs)

    name = "large deflection, vallejo"
    stored = json.loads(STORED.read_text(encoding="utf-8"))[name]
    monkeypatch.setattr(system.System, "assemble", twice)
    assert CASES[name](monkeypatch)["force_tangent"] == 2 * stored["force_tangent"]


def test_starts_that_fail_are_seldom_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Newton's method limits the steps of a thin steel bar, it fails from the start of a step, too."""
    bar = h.body(h.line(1.8), h.element("reissner3", 8), {"height": 0.01, "width": 0.01},
                 {"E": 2.07e11, "nu": 0.3, "rho": 7850})
    found = moving({"bodies": {"a": bar}, **PINNED}, 1.5, tolerance=1e-4)(monkeypatch)
    assert found["rejected"] > 10
    # each step and each failure needs a tangent; one more for a second start
    assert found["tangents"] - found["steps"] - found["rejected"] < 0.5 * found["rejected"]
