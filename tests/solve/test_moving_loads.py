"""Forces, masses and springs that move along bodies, compared with series, modes and conserved quantities."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers import chosen
from instruments.motions.crossings import along, bridge, moving_force, moving_mass, peak, under_force, under_mass
from numpy.typing import NDArray

import ancf2d
from ancf2d.study.run import prepare

Array = NDArray[np.float64]


@pytest.mark.parametrize("speed", chosen((0.1, 0.5, 1.0, 2.0), (0.5,)))
def test_force_that_crosses_a_beam(speed: float) -> None:
    force = -1e-3
    solved = ancf2d.solve(under_force(speed, force))
    t = solved.course_t
    expected = moving_force(speed, 0.5, t, force)
    found = solved.course["mid"]["uy"]
    assert found == pytest.approx(expected, abs=2e-4 * np.abs(expected).max())
    # the peak factor beside the static deflection, and when it comes
    (factor, place), (wanted, there) = (peak(t, y, force / 48) for y in (found, expected))
    assert factor == pytest.approx(wanted, rel=2e-4)
    assert place == pytest.approx(there, abs=5e-3)
    if speed == 1.0:
        # on leaving the beam, the first term alone: pi/2 of 96/pi^4 (Timoshenko)
        assert (factor, place) == (pytest.approx(48 / math.pi**3, rel=1e-3), pytest.approx(1.0))


@pytest.mark.parametrize(("speed", "mass"), [pytest.param(0.2, 0.5, marks=pytest.mark.slow), (0.6, 1.0)])
def test_mass_that_crosses_a_beam(speed: float, mass: float) -> None:
    g = 1e-3
    solved = ancf2d.solve(under_mass(speed, mass, g))
    expected = g * moving_mass(speed, mass, solved.course_t)
    assert solved.course["mid"]["uy"] == pytest.approx(expected, abs=3e-3 * np.abs(expected).max())
    assert solved.summary["energy_drift"] < 1e-4


BAR = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
       "section": {"EA": 1, "kGA": 1, "EI": 1, "rhoA": 3, "rhoI": 0}, "element": {"type": "rigid"}}


@pytest.mark.slow_rows("DOP853", "generalized_alpha", "radau9")
@pytest.mark.parametrize("method", ["radau5", "radau9", "generalized_alpha", "DOP853"])
def test_mass_on_a_turning_bar_keeps_the_angular_momentum(method: str) -> None:
    # inertia of the bar 1, of the mass r^2: omega (1 + r^2) stays, by the Coriolis force alone
    solved = ancf2d.solve({
        "bodies": {"bar": BAR}, "boundary_conditions": [{"type": "pin", "at": "bar@0"}],
        "masses": [{"at": {"on": "bar", "s": {"type": "expression", "value": "0.2 + 0.6*t^2"}}, "mass": 1}],
        "initial": {"rotation_rate": {"omega": 2}},
        "solver": {"type": "dynamic", "t_end": 1, "tolerance": 1e-8, "method": method},
        "output": {"probes": {"tip": "bar@1"}, "interval": 0.25}})
    r, found = 0.2 + 0.6 * solved.course_t**2, solved.summary
    assert solved.course["tip"]["omega"] == pytest.approx(2 * 1.04 / (1 + r * r), rel=3e-5)
    # both are those of bar and mass, whose velocity along the bar ends at 1.2; what they gain is the work of the drive
    assert found["momentum"]["angular"] == pytest.approx(2.08, rel=3e-5)
    assert found["energy"]["kinetic"] == pytest.approx(0.5 * 2.08**2 / 1.64 + 0.72, rel=3e-5)
    assert found["energy"]["work"] == pytest.approx(0.5 * 2.08**2 / 1.64 + 0.72 - 2.08, abs=6e-5)
    assert found["energy_drift"] < 3e-5


@pytest.mark.slow_rows("generalized_alpha")
@pytest.mark.parametrize("method", ["radau5", "generalized_alpha"])
def test_a_mass_moves_along_a_body_driven_by_a_controller(method: str) -> None:
    # omega (1 + r^2) = 2 t under a moment of 2 that a controller puts out; its state rests, the latch at the end holds
    # nothing: both give the matrices of a step numbers of their own
    solved = ancf2d.solve({
        "bodies": {"bar": BAR},
        "boundary_conditions": [{"type": "pin", "at": "bar@0"},
                                {"type": "roller", "fixed": "y", "at": "bar@1", "active": {"from": 0.9}}],
        "masses": [{"at": {"on": "bar", "s": {"type": "expression", "value": "0.2 + 0.6*t^2"}}, "mass": 1}],
        "controllers": {"motor": {"type": "state", "rate": {"z": "-z"}, "output": "2 + z"}},
        "loads": [{"type": "moment", "at": "bar@0", "value": 1, "amplitude": {"type": "expression", "value": "motor"}}],
        "solver": {"type": "dynamic", "t_end": 0.8, "tolerance": 1e-8, "method": method},
        "output": {"probes": {"tip": "bar@1"}, "interval": 0.2}})
    r, t = 0.2 + 0.6 * solved.course_t**2, solved.course_t
    assert solved.course["tip"]["omega"] == pytest.approx(2 * t / (1 + r * r), rel=3e-5, abs=1e-9)


def test_reactions_hold_a_moving_mass() -> None:
    # on a bar that two supports hold the mass moves freely: reactions follow its weight and where it is
    solved = ancf2d.solve({
        "bodies": {"bar": BAR},
        "boundary_conditions": [{"name": "left", "type": "pin", "at": "bar@0"},
                                {"name": "right", "type": "roller", "at": "bar@1", "fixed": "y"}],
        "masses": [{"at": {"on": "bar", "s": {"type": "expression", "value": "t^2"}}, "mass": 2}],
        "loads": [{"type": "gravity", "value": [0, -10]}],
        "solver": {"type": "dynamic", "t_end": 0.5, "tolerance": 1e-6}, "output": {"interval": 0.1}}, states=False)
    assert solved.reactions["right"]["fy"] == pytest.approx(15 + 20 * 0.25)
    # the drive pushes the mass by 2 m along the bar, which is taken from the bar
    assert solved.reactions["left"]["fx"] == pytest.approx(2 * 2.0)


@pytest.mark.slow
def test_mass_falls_off_the_end() -> None:
    # a bar on a pin with a spring: behind s = 1 nothing is there, and the motion is that of the bar alone
    def run(after: float) -> Array:
        solved = ancf2d.solve({
            "bodies": {"bar": BAR}, "boundary_conditions": [{"type": "pin", "at": "bar@0"}],
            "springs": [{"type": "rotational", "between": [[0, 0], "bar@0"], "stiffness": 9}],
            "masses": [{"at": {"on": "bar", "s": {"type": "expression", "value": f"t if t < 1 else {after}"}},
                        "mass": 1}],
            "initial": {"rotation_rate": {"omega": 0.1}},
            "solver": {"type": "dynamic", "t_end": 2, "tolerance": 1e-8},
            "output": {"probes": {"tip": "bar@1"}, "interval": 0.01}})
        return solved.course["tip"]["theta"]
    off = run(2.0)
    # theta'' = -9 theta with the inertia of the bar, 1; from t = 1 on
    A = np.array([[math.cos(3 * x), math.sin(3 * x)] for x in np.linspace(0, 1, 101)])
    part = np.linalg.lstsq(A, off[100:], rcond=None)[0]
    assert A @ part == pytest.approx(off[100:], abs=1e-7)
    assert run(3.0) == pytest.approx(off)


@pytest.mark.slow
def test_spring_with_a_moving_end() -> None:
    # a car of mass 1 on a spring of stiffness 4 over a level rigid bar: it bounces as on the ground
    solved = ancf2d.solve({
        "bodies": {"road": {**BAR, "geometry": {"type": "line", "start": [0, 0], "end": [4, 0]}},
                   "car": {**BAR, "geometry": {"type": "line", "start": [0, 1], "end": [0, 2]},
                           "section": {"EA": 1, "kGA": 1, "EI": 1, "rhoA": 1, "rhoI": 0}}},
        "boundary_conditions": [{"type": "clamp", "at": "road@0"},
                                {"type": "prescribed", "at": "car@0", "x": {"type": "expression", "value": "2*t"},
                                 "angle": 0}],
        "springs": [{"type": "translational", "between": [{"on": "road", "s": {"type": "ramp", "t1": 2}}, "car@0"],
                     "stiffness": 4, "damping": 0.4}],
        "loads": [{"type": "gravity", "value": [0, -1]}],
        "solver": {"type": "dynamic", "t_end": 1.5, "tolerance": 1e-8}, "output": {"probes": {"seat": "car@0"}}})
    c, w = 0.2, math.sqrt(4 - 0.04)
    t = solved.course_t
    expected = -0.25 * (1 - np.exp(-c * t) * (np.cos(w * t) + c / w * np.sin(w * t)))
    assert solved.course["seat"]["uy"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("s", "work"), [("0.8", 0.0), ("0.2 + 0.6*t^2", None)])
def test_the_weight_of_a_moving_mass_has_a_potential(s: str, work: float | None) -> None:
    """Bar and mass fall about a pin: energy is conserved with the mass at rest on the bar, else its drive does work."""
    solved = ancf2d.solve({
        "bodies": {"bar": BAR}, "boundary_conditions": [{"type": "pin", "at": "bar@0"}],
        "masses": [{"at": {"on": "bar", "s": {"type": "expression", "value": s}}, "mass": 2}],
        "loads": [{"type": "gravity", "value": [0, -10]}],
        "solver": {"type": "dynamic", "t_end": 0.7, "tolerance": 1e-8, "estimate": False},
        "output": {"probes": {"tip": "bar@1"}, "interval": 0.1}}, states=False)
    tip, energy = solved.probes["tip"], solved.summary["energy"]
    r = 0.8 if work == 0.0 else 0.2 + 0.6 * 0.49
    # heights above where they are in the reference at t = 0
    potential = 10 * (3 * 0.5 * tip["y"] + 2 * r * tip["y"])
    kinetic = 0.5 * (1 + 2 * r * r) * tip["omega"]**2 + (0.0 if work == 0.0 else (1.2 * 0.7)**2)
    assert energy["potential"] == pytest.approx(potential, rel=1e-9)
    # rates of a rigid bar are along it within the tolerance of the steps alone
    assert energy["kinetic"] == pytest.approx(kinetic, rel=1e-6)
    assert energy["work"] == pytest.approx(kinetic + potential if work is None else work, abs=1e-6)
    assert solved.summary["energy_drift"] < 1e-7


def test_a_mass_that_leaves_its_bar_takes_its_energy_and_momentum_along() -> None:
    found = ancf2d.solve({
        "bodies": {"bar": BAR}, "boundary_conditions": [{"type": "pin", "at": "bar@0"}],
        "masses": [{"at": {"on": "bar", "s": {"type": "expression", "value": "0.5 + t"}}, "mass": 2}],
        "loads": [{"type": "gravity", "value": [0, -10]}], "initial": {"rotation_rate": {"omega": 2}},
        "solver": {"type": "dynamic", "t_end": 0.7, "tolerance": 1e-8, "estimate": False},
        "output": {"probes": {"tip": "bar@1"}}}, states=False)
    tip, energy = found.probes["tip"], found.summary["energy"]
    # the inertia of the bar about its pin is 1, its weight 30
    assert found.summary["momentum"]["angular"] == pytest.approx(tip["omega"], rel=1e-6)
    assert energy["kinetic"] == pytest.approx(0.5 * tip["omega"]**2, rel=1e-6)
    assert energy["potential"] == pytest.approx(30 * 0.5 * tip["y"], rel=1e-6)
    assert found.summary["energy_drift"] < 1e-7


def test_loads_that_never_reach_their_body_give_a_warning() -> None:
    def said(**more: Any) -> list[str]:
        return prepare(ancf2d.load(bridge(0.5, **more))).warnings
    off: dict[str, Any] = {"on": "beam"}
    for value, meets in (("-3*t", False), ("t + 0.3", True), ("1.5 + t", False), ("-1 if t < 0.3123 else 2", False),
                         ("2 if t < 0.3123 else 0.5", True), ("1e5*(t - 0.3123)", True)):
        off["s"] = {"type": "expression", "value": value}
        told = said(loads=[{"type": "force", "at": off, "value": [0, 1]}])
        assert [text.startswith("loads.0.at: s is between") for text in told] == [True] * (not meets)
        assert said(masses=[{"at": off, "mass": 1}]) == [text.replace("loads", "masses") for text in told]
    (text,) = said(loads=[{"type": "force", "at": "beam@0.5", "value": [0, 1], "active": {"from": 9}}])
    assert text == "loads.0: it begins at t = 9, but the motion ends at 0.63662"


def test_moving_loads_are_checked() -> None:
    case = bridge(0.5, loads=[{"type": "force", "at": {"on": "beams", "s": {"type": "ramp"}}, "value": [0, 1]}])
    with pytest.raises(ancf2d.CaseError, match="there is no body 'beams'"):
        ancf2d.load(case)
    case = bridge(0.5, loads=[{"type": "force", "at": along(0.5), "value": [0, 1]}])
    with pytest.raises(ancf2d.CaseError, match="only with dynamic"):
        ancf2d.load({**case, "solver": {"type": "static"}, "output": {}})
