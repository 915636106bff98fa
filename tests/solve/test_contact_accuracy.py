"""Adaptive steps through contact without a law, compared with closed forms: errors and their estimates."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motions import Ride, ride, rigid
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import ancf2d

G = 9.81
FALL = [{"type": "gravity", "value": [0, -G]}]
FLOOR = {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}


def ladder_leaves(height: float) -> tuple[float, float]:
    """Return the time at which a ladder of length 1 leaves the wall, and the position of its foot after 1 s.

    It slides down without friction from rest, its top at this height: w^2 = 3 g (h0 - h)/L, h over L the cosine of its
    angle. The wall pulls no sooner than h = 2/3 h0; from there on its centre moves on along the floor as fast.
    """
    def rates(_: float, y: Any) -> list[float]:
        return [y[1], 1.5 * G * math.sin(y[0])]

    def pulls(_: float, y: Any) -> float:
        return math.cos(y[0]) - 2.0 / 3.0 * height

    pulls.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(rates, (0.0, 1.0), [math.acos(height), 0.0], events=pulls, rtol=1e-11, atol=1e-12)
    t, (angle, rate) = found.t[-1], found.y[:, -1]
    speed = 0.5 * math.cos(angle) * rate
    return t, 0.5 * math.sin(angle) + speed * (1.0 - t) + 0.5


@pytest.fixture(scope="module")
def ladders() -> list[tuple[float, ancf2d.Solution]]:
    """Errors of the foot, relative to its path, and motions for tolerances 1e-5 and 1e-6."""
    width = 0.3
    height = math.sqrt(1.0 - width * width)
    _, foot = ladder_leaves(height)
    wall = {"type": "half_plane", "through": [0, 0], "normal": [1, 0]}
    out = []
    for tolerance in (1e-5, 1e-6):
        found = ancf2d.solve({
            "bodies": {"ladder": rigid([0, height], [width, 0], 1.0, 1.0 / 12.0)}, "loads": FALL,
            "obstacles": {"floor": FLOOR, "wall": wall},
            "contacts": [{"between": ["ladder", name], "side": "axis"} for name in ("floor", "wall")],
            "solver": {"type": "dynamic", "t_end": 1.0, "tolerance": tolerance},
            "output": {"interval": 0.01, "probes": {"foot": "ladder@1"}}})
        out.append((abs(found.probes["foot"]["x"] - foot) / (foot - width), found))
    return out


def test_a_ladder_that_slides_down_a_wall_leaves_it_at_two_thirds_of_its_height(ladders):
    assert [error < bound for (error, _), bound in zip(ladders, (3e-4, 2e-4), strict=True)] == [True, True]


def test_steps_to_stored_states_have_similar_lengths(ladders):
    """Short steps between long ones have larger errors than the long ones: the energy shows it."""
    assert ladders[1][1].summary["energy_drift"] < 3e-4


def test_the_estimate_through_an_impact_is_close_to_the_error(ladders):
    for error, found in ladders:
        estimate = found.summary["accuracy"]["estimate"]
        assert 0.3 * error < estimate < 30.0 * error


def test_states_inside_the_step_of_an_impact_are_on_the_exact_motion():
    """A rod falls flat: until it lands, each state is on its parabola, also if the step ends on the floor."""
    height, t_end = 0.5, 0.4
    lands = math.sqrt(2.0 * height / G)
    falls = Ride({"bodies": {"rod": rigid([0, height], [1, height], 2.0, 0.2)}, "loads": FALL,
                  "obstacles": {"floor": FLOOR}, "contacts": [{"between": ["rod", "floor"], "side": "axis"}]},
                 t_end, states=50, tolerance=1e-4)
    # as in the coarser motions that an error is estimated by
    falls.stepper.ends_at_states = False
    falls.start().on()
    t = np.array([row.t for row in falls.rows])
    expected = np.where(t < lands, height - 0.5 * G * t**2, 0.0)
    assert np.count_nonzero((t > falls.column("t")[falls.column("t") < lands - 1e-3].max()) & (t < lands)) > 1
    np.testing.assert_allclose([falls.place("rod@0.5", k)[1] for k in range(len(t))], expected, atol=2e-4 * height)


def test_friction_reverses_with_the_sliding():
    """A block on a spring loses 4 mu N/k of its amplitude per period; accuracy depends on the times of reversal."""
    mass, stiffness, mu, length, t_end = 0.216, 200.0, 0.2, 0.1, 1.0
    shift, half = mu * mass * G / stiffness, math.pi * math.sqrt(mass / stiffness)
    place = length
    for _ in range(int(t_end / half)):
        centre = math.copysign(shift, place)
        place = 2.0 * centre - place
    centre = math.copysign(shift, place)
    place = centre + (place - centre) * math.cos(math.pi * (t_end % half) / half)
    found = ancf2d.solve({
        "bodies": {"block": rigid([0, 0.01], [0.2, 0.01], mass, 1e-3) | {"section": {"height": 0.02, "width": 0.02}}},
        "loads": FALL, "obstacles": {"floor": FLOOR},
        "springs": [{"type": "translational", "between": ["block@0", [-1.0 - length, 0.01]], "stiffness": stiffness,
                     "length": 1.0}],
        "contacts": [{"between": ["block", "floor"], "friction": mu}],
        "solver": {"type": "dynamic", "t_end": t_end, "tolerance": 1e-6, "estimate": False},
        "output": {"probes": {"a": "block@0"}}}, states=False)
    assert found.probes["a"]["ux"] == pytest.approx(place - length, abs=5e-5)


def off_a_floor(floor: Callable[[float], float], rate: Callable[[float], float], height: float, t_end: float) -> float:
    """Return the height at t_end of a body that falls from rest and bounces off a moving floor without loss."""
    def gap(at: Any, t: float, y: float, v: float) -> Any:
        return y + v * (at - t) - 0.5 * G * (at - t) ** 2 - floor(at)

    t, y, v = 0.0, height, 0.0
    while True:
        times = np.linspace(t + 1e-6, t_end, 20001)
        below = np.flatnonzero(gap(times, t, y, v) < 0.0)
        if not len(below):
            return float(gap(t_end, t, y, v) + floor(t_end))
        hit = brentq(gap, times[below[0] - 1], times[below[0]], (t, y, v), xtol=1e-14)
        t, y, v = hit, floor(hit), 2.0 * rate(hit) - (v - G * (hit - t))


@pytest.mark.slow_rows("0.1*sin(9*t)-radau5-how3-1e-06", "1.0*t-radau5-how3-1e-06")
@pytest.mark.parametrize(("method", "how", "within"), [
    ("generalized_alpha", {"tolerance": 1e-4}, 1e-4), ("generalized_alpha", {"tolerance": 1e-6}, 3e-6),
    ("radau5", {"tolerance": 1e-4}, 2e-5), ("radau5", {"dt": 1e-3}, 1e-6)])
@pytest.mark.parametrize("moves", ["1.0*t", "0.1*sin(9*t)"])
def test_bounces_off_a_moving_floor_keep_the_relative_speed(moves, method, how, within):
    floor, rate = {"1.0*t": (lambda t: 1.0 * t, lambda t: 1.0),
                   "0.1*sin(9*t)": (lambda t: 0.1 * np.sin(9.0 * t), lambda t: 0.9 * math.cos(9.0 * t))}[moves]
    scene = {"bodies": {"rod": rigid([0.0, 0.5], [1.0, 0.5], 2.0, 0.2)}, "loads": FALL,
             "obstacles": {"floor": {**FLOOR, "motion": {"y": {"type": "expression", "value": moves}}}},
             "contacts": [{"between": ["rod", "floor"], "side": "axis", "restitution": 1.0}]}
    found = ride(scene, 2.0, method=method, every=1, **how)
    assert found.place("rod@0.5")[1] == pytest.approx(off_a_floor(floor, rate, 0.5, 2.0), abs=within)
    total, _ = found.totals()
    assert total[-1] - total[0] == pytest.approx(found.rows[-1].work, rel=1e-4)


@pytest.mark.parametrize("law", [None, {"stiffness": 1e6}], ids=["hard", "layer"])
@pytest.mark.parametrize(("element", "x", "radius", "missed"), [
    ({"type": "rigid"}, 0.4, 0.05, True), ({"type": "rigid"}, 0.4, 0.025, True), ({"type": "rigid"}, 0.3, 0.005, True),
    ({"type": "rigid"}, 0.5, 2.0, True), ({"type": "reissner3", "count": 4}, 0.69, 0.05, True),
    ({"type": "reissner3", "count": 4}, 0.5, 2.0, False)],
    ids=["rigid", "small", "smaller", "middle", "flexible", "node"])
def test_motions_report_an_obstacle_between_the_contact_points(
        element: dict[str, Any], x: float, radius: float, missed: bool, law: dict[str, float] | None) -> None:
    """A falling rod, with points at its nodes and in the middle of flexible elements, and a disc below.

    A layer has four points on each element and face.
    """
    rod = {"geometry": {"type": "line", "start": [0, 0.05], "end": [1, 0.05]}, "element": element,
           "section": {"height": 0.02, "width": 0.03}, "material": {"E": 7e9, "nu": 0.3, "rho": 2700}}
    solved = ancf2d.solve({
        "bodies": {"rod": rod}, "obstacles": {"disc": {"type": "circle", "center": [x, 0.02 - radius],
                                                       "radius": radius}},
        "contacts": [{"between": ["rod", "disc"], **({"law": law} if law else {})}],
        "loads": [{"type": "gravity", "value": [0, -9.81]}],
        "solver": {"type": "dynamic", "t_end": 0.08, "dt": 1e-3, "estimate": False}}, states=False)
    told = [w for w in solved.warnings if "deep in disc between its contact points" in w]
    assert len(told) == missed, solved.warnings


def test_impacts_of_viscous_bodies_are_accurate():
    """After an impact rates are less accurate than displacements, and viscous forces are proportional to them."""
    def hit(method: str, tolerance: float) -> ancf2d.Solution:
        return ancf2d.solve({
            "bodies": {"rod": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                               "section": {"height": 0.02, "width": 0.02},
                               "material": {"E": 2e9, "nu": 0.3, "rho": 1500, "damping": {"kelvin_voigt": 1e-2}},
                               "element": {"type": "reissner3", "count": 3}}},
            "boundary_conditions": [{"type": "clamp", "at": "rod@0"}],
            "obstacles": {"disc": {"type": "circle", "center": [0.7, 0.13], "radius": 0.1,
                                   "motion": {"y": {"type": "sine", "frequency": 5, "scale": 0.08}}}},
            "contacts": [{"between": ["rod", "disc"]}],
            "solver": {"type": "dynamic", "t_end": 0.2, "method": method, "tolerance": tolerance, "estimate": False},
            "output": {"interval": 0.01, "probes": {"tip": "rod@1"}}})

    fine, found = hit("radau5", 1e-5), hit("generalized_alpha", 1e-4)
    way = np.array(fine.course["tip"]["uy"])
    assert np.abs(np.array(found.course["tip"]["uy"]) - way).max() < 1e-3 * np.abs(way).max()
    assert found.energies["dissipated"][-1] == pytest.approx(fine.energies["dissipated"][-1], rel=0.03)


@pytest.mark.parametrize("height", [0.5, 0.51, 0.3])
def test_a_body_at_rest_has_no_error_of_energy(height: float) -> None:
    """It moves by the round-off of positions alone, whose work is not an error of the steps."""
    found = ancf2d.solve({
        "bodies": {"rod": rigid([0, height], [0.2, height], 0.6, 0.002)}, "loads": FALL,
        "obstacles": {"floor": {**FLOOR, "through": [0, height - 0.01]}},
        "contacts": [{"between": ["rod", "floor"]}], "solver": {"type": "dynamic", "t_end": 0.6, "tolerance": 1e-6},
    }, {"bodies.rod.section": {"height": 0.02, "width": 0.02}}, states=False)
    assert found.summary["contacts"][0]["force"][1] == pytest.approx(0.6 * G, rel=1e-8)
    assert (found.summary["energy_drift"], found.warnings) == (0.0, [])
