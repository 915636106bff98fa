"""Supports and joints that begin or end during a motion: releases and catches, compared with closed forms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import helpers
import numpy as np
import pytest
from motions import resumed_behind_events

import ancf2d
from ancf2d.errors import ComputationError
from ancf2d.results import writer
from ancf2d.solvers.motion import stepping
from ancf2d.study.run import run_case

ROD = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
       "section": {"EA": 1e4, "kGA": 4e3, "EI": 1e2, "rhoA": 1, "rhoI": 0}, "element": {"type": "rigid"}}
SECOND = ("generalized_alpha", "energy_momentum")
METHODS = ("radau5", *SECOND, "DOP853")


def solve(method: str = "radau5", t_end: float = 1.0, bodies: Any = None, **more: Any) -> Any:
    return ancf2d.solve({
        "bodies": bodies or {"rod": ROD},
        "solver": {"type": "dynamic", "t_end": t_end, "tolerance": 1e-9, "method": method, "estimate": False},
        "output": {"interval": 0.05, "probes": {"left": "rod@0", "right": "rod@1"}}, **more})


@pytest.mark.slow_rows("energy_momentum-{'to': 0.4}")
@helpers.covering(method=METHODS, active=[{"to": 0.4}, {"until": "right.theta > 0.8"}])
def test_a_rod_flies_on_when_its_pin_is_released(method: str, active: Any) -> None:
    """It rotates about its end with omega = 2 to t = 0.4; then its centre continues with its velocity."""
    solved = solve(method, boundary_conditions=[{"name": "pivot", "type": "pin", "at": "rod@0", "active": active}],
                   initial={"rotation_rate": {"omega": 2, "about": [0, 0]}})
    t = solved.course_t
    free = np.clip(t - 0.4, 0, None)
    angle, at = 2 * t, 2 * np.minimum(t, 0.4)
    centre = [0.5 * np.cos(at) - np.sin(0.8) * free, 0.5 * np.sin(at) + np.cos(0.8) * free]
    expected = [centre[0] + 0.5 * np.cos(angle) - 1, centre[1] + 0.5 * np.sin(angle)]
    near = 2e-5 if method in SECOND else 1e-8
    assert solved.course["right"]["ux"] == pytest.approx(expected[0], abs=near)
    assert solved.course["right"]["uy"] == pytest.approx(expected[1], abs=near)
    [event] = solved.summary["events"]
    assert event == {"t": pytest.approx(0.4, abs=near), "what": "pivot ends"}
    # nothing jumps, and nothing holds it any more
    assert solved.summary["momentum"]["linear"] == pytest.approx([-math.sin(0.8), math.cos(0.8)], abs=near)
    assert solved.summary["energy"]["dissipated"] == 0.0
    assert solved.summary["energy_drift"] < 1e-7
    assert np.hypot(*(solved.reactions["pivot"][q] for q in ("fx", "fy"))) < 1e-9


@pytest.mark.parametrize("method", ["DOP853", pytest.param("radau5", marks=pytest.mark.slow),
                                    pytest.param("Radau", marks=pytest.mark.slow)])
def test_an_event_at_the_end_of_a_step_is_not_missed(method: str) -> None:
    """Round-off decides whether such a step ends just before the event or just after it."""
    for angle in np.linspace(0.375, 1.805, 6).tolist():
        pin = {"name": "pivot", "type": "pin", "at": "rod@0", "active": {"until": f"right.theta > {angle!r}"}}
        solved = solve(method, boundary_conditions=[pin], initial={"rotation_rate": {"omega": 2, "about": [0, 0]}})
        assert [event["t"] for event in solved.summary["events"]] == pytest.approx([angle / 2], abs=1e-8)


@helpers.covering(method=METHODS, active=[{"from": 0.35}, {"after": "left.uy > 0.35"}])
def test_a_pin_that_catches_a_rod_takes_a_quarter_of_its_momentum(method: str, active: Any) -> None:
    """A rod in translation with v = 1: omega = 3 v/2 L about its end, 1/8 m v^2 is lost (angular momentum)."""
    solved = solve(method, boundary_conditions=[{"name": "hook", "type": "pin", "at": "rod@0", "active": active}],
                   initial={"velocity": [0, 1]})
    t = solved.course_t
    angle = 1.5 * np.clip(t - 0.35, 0, None)
    near = 2e-5 if method in SECOND else 1e-8
    assert solved.course["left"]["uy"] == pytest.approx(np.minimum(t, 0.35), abs=near)
    assert solved.course["right"]["uy"] == pytest.approx(np.minimum(t, 0.35) + np.sin(angle), abs=near)
    [event] = solved.summary["events"]
    assert event["what"] == "hook begins"
    none = pytest.approx(0, abs=1e-9)
    assert event["impulse"] == {"fx": none, "fy": pytest.approx(-0.25), "m": none}
    assert solved.summary["energy"]["dissipated"] == pytest.approx(1 / 8, rel=1e-6)
    assert solved.summary["energy_drift"] < 1e-7


def test_a_second_pin_stops_a_hinged_rod_by_the_force_across_it() -> None:
    """At an angle of 0.0015 both its constraints stop the rod: the one along the rod would need 670 times the impulse.

    The rod is at rest in all stored states: energies are relative to the kinetic energy that the pin takes.
    """
    solved = solve(t_end=0.1, loads=[{"type": "force", "at": "rod@1", "value": [0, 10], "active": {"from": 0.01}}],
                   boundary_conditions=[{"type": "pin", "at": "rod@0"}, {
                       "name": "stop", "type": "pin", "at": "rod@1", "active": {"from": 0.02}}])
    [event] = [event for event in solved.summary["events"] if event["what"] == "stop begins"]
    assert event["impulse"] == {"fx": pytest.approx(0, abs=1e-6), "fy": pytest.approx(-0.1, rel=1e-5),
                                "m": pytest.approx(0, abs=1e-9)}
    assert solved.summary["energy"]["dissipated"] == pytest.approx(0.5 / 3 * 0.3**2, rel=1e-5)
    assert solved.summary["energy_drift"] < 1e-7


def test_round_off_of_a_model_at_rest_has_no_energy_balance() -> None:
    """A torque within a weld: only its round-off moves the rods."""
    other = {**ROD, "geometry": {"type": "line", "start": [1, 0], "end": [1.7, 0.6]}}
    solved = solve(t_end=0.4, bodies={"rod": ROD, "other": other}, joints=[
        {"type": "weld", "between": ["rod@1", "other@0"]}], boundary_conditions=[{"type": "pin", "at": "rod@0"}],
        loads=[{"type": "torque", "between": ["rod@1", "other@0"], "value": 1,
                "amplitude": {"type": "ramp", "t1": 0.1}}],
        springs=[{"type": "rotational", "between": ["rod@0", "other@0"], "stiffness": 10}])
    assert np.abs(solved.course["right"]["uy"]).max() < 1e-12
    assert solved.summary["energy_drift"] == 0.0
    assert not solved.summary["warnings"]


@pytest.mark.parametrize(("method", "tolerance", "share"), [
    ("radau5", 1e-7, 1e-4), ("generalized_alpha", 1e-7, 2e-3), ("generalized_alpha", 1e-5, 6e-3)])
def test_energy_lost_to_strong_damping_after_a_catch_is_counted(method: str, tolerance: float, share: float) -> None:
    """A caught beam comes to rest at once, in steps far shorter than before: nearly all energy is dissipated."""
    body = {**ROD, "section": {"height": 0.02, "width": 0.02}, "element": {"type": "reissner3", "count": 2},
            "material": {"E": 2e9, "nu": 0.3, "rho": 1000, "damping": {"kelvin_voigt": 1.0}}}
    solved = solve(bodies={"rod": body}, t_end=0.3, initial={"velocity": [0, -2]}, solver={
        "type": "dynamic", "t_end": 0.3, "tolerance": tolerance, "method": method, "estimate": False},
        boundary_conditions=[{"name": "grip", "type": "clamp", "at": "rod@0", "active": {"from": 0.1}}])
    energy = solved.summary["energy"]
    assert energy["dissipated"] > 0.79
    assert energy["kinetic"] + energy["strain"] + energy["dissipated"] == pytest.approx(0.5 * 0.4 * 4, rel=share)


@pytest.mark.slow_rows("2d2n-None", "patel-breathe", "reissner3-None")
@pytest.mark.parametrize(("element", "hold"), helpers.chosen(
    [*((element, None) for element in ("rigid", "reissner3", "vallejo", "cable", "2d2n", "patel")),
     ("2d2n", "breathe"), ("patel", "breathe")], ["rigid", "reissner3", ("2d2n", None), ("patel", "breathe")]))
def test_a_clamp_keeps_a_section_at_its_current_angle(element: str, hold: str | None) -> None:
    """A beam that rotates freely with omega = 3 is caught at 69 degrees, and swings about that angle."""
    body = {**ROD, "element": {"type": element, **({} if element == "rigid" else {"count": 2})}}
    body["section"] = {**ROD["section"], "rhoI": 0 if element == "rigid" else 1e-2}
    if element in ("2d2n", "patel"):
        body |= {"section": {"height": 0.1, "width": 0.1}, "material": {"E": 1e6, "nu": 0, "rho": 100}}
    solved = solve(bodies={"rod": body}, t_end=0.6, boundary_conditions=[
        {"name": "grip", "type": "clamp", "at": "rod@0", "active": {"from": 0.4},
         **({"hold": hold} if hold else {})}],
                   initial={"rotation_rate": {"omega": 3, "about": [0, 0]}})
    caught = solved.course_t > 0.4
    x, y, theta = (solved.course["left"][q][caught] for q in ("x", "y", "theta"))
    assert theta == pytest.approx(theta[0], abs=1e-9)
    if hold is None:
        assert x == pytest.approx(x[0], abs=1e-9)
        assert y == pytest.approx(y[0], abs=1e-9)
    # a section that breathes may move across, by what its mean is off the axis; along it is held
    assert (along := x * np.cos(theta) + y * np.sin(theta)) == pytest.approx(along[0], abs=1e-9)
    # spinning about one end, a beam that is not rigid stretches a little before
    assert solved.course["left"]["theta"][-1] == pytest.approx(1.2, abs=1e-8 if element == "rigid" else 0.05)
    assert solved.summary["energy"]["dissipated"] > 0.0
    assert solved.summary["energy_drift"] < 1e-6
    if element == "rigid":
        # all of m v of the centre, v = (0, 1.5), and of the angular momentum about the end
        [event] = solved.summary["events"]
        assert event["impulse"] == {"fx": pytest.approx(0, abs=1e-9), "fy": pytest.approx(-1.5),
                                    "m": pytest.approx(-0.25 - 0.75 * math.cos(1.2))}
        assert solved.summary["energy"]["dissipated"] == pytest.approx(1.5)


@pytest.mark.parametrize("method", ["radau5", *SECOND, "DOP853"])
def test_a_gripper_takes_a_rod_along(method: str) -> None:
    """A rod in translation with v = 1 is gripped by a support moving with 3, and then released.

    Its end moves on from where it is, at the rate prescribed: m (3 - 1) as impulse, of which half the work is lost.
    """
    lift = {"type": "expression", "value": "3*t"}
    solved = solve(method, boundary_conditions=[
        {"name": "grip", "type": "prescribed", "at": "rod@0", "ux": 0, "uy": lift, "angle": 0,
         "active": {"from": 0.3, "to": 0.6}}], initial={"velocity": [0, 1]})
    t = solved.course_t
    expected = np.where(t < 0.3, t, 0.3 + 3 * (t - 0.3))
    assert solved.course["left"]["uy"] == pytest.approx(expected, abs=1e-8)
    assert solved.course["right"]["uy"] == pytest.approx(expected, abs=1e-8)
    begins, ends = solved.summary["events"]
    none = pytest.approx(0, abs=1e-9)
    assert begins["offset"] == {"ux": none, "uy": pytest.approx(0.3 - 0.9), "angle": none}
    assert begins["impulse"] == {"fx": none, "fy": pytest.approx(2.0), "m": pytest.approx(1.0)}
    assert ends["what"] == "grip ends"
    energy = solved.summary["energy"]
    assert energy["kinetic"] == pytest.approx(4.5)
    assert energy["dissipated"] == pytest.approx(2.0)
    assert energy["work"] == pytest.approx(6.0)
    assert solved.summary["energy_drift"] < 1e-7


@pytest.mark.parametrize("element", ["rigid", "vallejo", "2d2n"])
def test_a_motor_engages_with_a_turning_rod(element: str) -> None:
    """A rod that rotates with 2 rad/s about a pin is driven from t = 0.4, from its angle, with 5 rad/s."""
    body = {**ROD, "element": {"type": element, **({} if element == "rigid" else {"count": 1})}}
    if element != "rigid":
        body |= {"section": {"height": 0.1, "width": 0.1}, "material": {"E": 1e8, "nu": 0, "rho": 100}}
    rise = {"type": "expression", "value": "7 + 5*(t - 0.4)"}
    solved = solve(bodies={"rod": body}, t_end=0.5, boundary_conditions=[
        {"type": "pin", "at": "rod@0"},
        {"name": "motor", "type": "prescribed", "at": "rod@0", "angle": rise, "active": {"from": 0.4}}],
                   initial={"rotation_rate": {"omega": 2, "about": [0, 0]}},
                   solver={"type": "dynamic", "t_end": 0.5, "tolerance": 1e-6, "estimate": False})
    caught, t = solved.course_t >= 0.4, solved.course_t
    found = solved.course["left"]["theta"][caught]
    assert found - found[0] == pytest.approx(5 * (t[caught] - 0.4), abs=1e-8)
    assert found[0] == pytest.approx(0.8, abs=1e-3)
    [event] = solved.summary["events"]
    assert math.remainder(event["offset"]["angle"], 2 * math.pi) == pytest.approx(
        math.remainder(found[0] - 7, 2 * math.pi))
    if element == "rigid":
        # angular momentum 1/3 (5 - 2), of its work at 5 rad/s half of 1/3 9 is lost
        assert event["impulse"]["m"] == pytest.approx(1.0)
        assert solved.summary["energy"]["dissipated"] == pytest.approx(1.5)
        assert solved.summary["energy"]["work"] == pytest.approx(5.0)
    assert solved.summary["energy_drift"] < 1e-4


@pytest.mark.parametrize("kind", ["pin", "weld"])
def test_a_joint_that_ends_conserves_momentum(kind: str) -> None:
    """Two collinear rods that spin about their common centre separate at t = 0.3: each continues along the tangent."""
    other = {**ROD, "geometry": {"type": "line", "start": [1, 0], "end": [2, 0]}}
    solved = solve(bodies={"rod": ROD, "other": other},
                   joints=[{"name": "tie", "type": kind, "between": ["rod@1", "other@0"], "active": {"to": 0.3}}],
                   initial={"rotation_rate": {"omega": 2, "about": [1, 0]}})
    t = solved.course_t
    free, at, angle = np.clip(t - 0.3, 0, None), 2 * np.minimum(t, 0.3), 2 * t
    x = 1 - 0.5 * np.cos(at) + math.sin(0.6) * free - 0.5 * np.cos(angle)
    assert solved.course["left"]["x"] == pytest.approx(x, abs=1e-8)
    assert solved.summary["momentum"]["linear"] == pytest.approx([0, 0], abs=1e-9)
    # m L^2/12 and m (L/2)^2 of each, about the origin as about any point
    assert solved.summary["momentum"]["angular"] == pytest.approx(2 * 2 / 3)
    assert solved.summary["energy_drift"] < 1e-8


@pytest.mark.parametrize("kind", ["pin", "weld"])
def test_a_joint_that_begins_is_a_plastic_impact(kind: str) -> None:
    """Two collinear rods, one at rest, become one chain or one rod: momentum is conserved, energy does not rise."""
    other = {**ROD, "geometry": {"type": "line", "start": [1, 0], "end": [2, 0]}}
    meets = {"name": "tie", "type": kind, "between": ["rod@1", "other@0"]}
    solved = solve(bodies={"rod": ROD, "other": other}, joints=[{**meets, "active": {"from": 1e-7}}], t_end=0.2,
                   initial={"bodies": {"rod": {"rotation_rate": {"omega": 1, "about": [1, 0]}}}})
    # rod turns about the joint: I = 1/3 about it, its centre at omega/2 across
    assert solved.summary["momentum"]["linear"] == pytest.approx([0.0, -0.5], abs=1e-3)
    assert solved.summary["momentum"]["angular"] == pytest.approx(1 / 3 - 0.5, rel=1e-6)
    lost = solved.summary["energy"]["dissipated"]
    # welded: both as one of length 2 about its centre: omega (8/12) = 1/3, v = -1/4
    assert lost == pytest.approx(0.0 if kind == "pin" else 1 / 6 - 0.5 * (2 / 3 * 0.25 + 2 / 16), abs=1e-6)
    apart = {**meets, "active": {"after": "t > 0.3"}}
    with pytest.raises(ComputationError, match="tie begins while its points are apart"):
        solve(bodies={"rod": ROD, "other": other}, joints=[apart], initial={"bodies": {"rod": {"velocity": [-1, 0]}}})


@pytest.mark.slow_rows("weld-types3")
@pytest.mark.parametrize(("kind", "types"), [("pin", ("rigid", "rigid")), ("weld", ("rigid", "rigid")),
                                             ("weld", ("cable", "rigid")), ("weld", ("reissner3", "cable"))])
def test_a_joint_begins_where_points_meet(kind: str, types: tuple[str, str]) -> None:
    """A spinning rod comes from 0.4 away, with v = -1, and the end of a resting one catches its middle."""
    rod, other = ({**ROD, "element": {"type": t} if t == "rigid" else {"type": t, "count": 2}} for t in types)
    other["geometry"] = {"type": "line", "start": [0.9, 0], "end": [1.9, 0]}
    if types[0] == "reissner3":
        rod["section"] = {**ROD["section"], "rhoI": 1e-3}
    solved = solve(bodies={"rod": rod, "other": other}, t_end=0.6, parameters={"there": 1.0},
                   solver={"type": "dynamic", "t_end": 0.6, "tolerance": 1e-7, "estimate": False},
                   joints=[{"name": "tie", "type": kind, "between": ["rod@1", "other@0.5"],
                            "active": {"after": "middle.x < there"}}],
                   initial={"bodies": {"other": {"velocity": [-1, 0],
                                                 "rotation_rate": {"omega": 3, "about": [1.4, 0]}}}},
                   output={"interval": 0.05, "probes": {"end": "rod@1", "middle": "other@0.5"}})
    event, = solved.summary["events"]
    assert (event["what"], event["t"]) == ("tie begins", pytest.approx(0.4, abs=1e-6))
    end, middle, later = solved.course["end"], solved.course["middle"], solved.course_t > 0.41
    for axis in "xy":
        assert end[axis][later] == pytest.approx(middle[axis][later], abs=1e-6)
    assert solved.summary["momentum"]["linear"] == pytest.approx([-1.0, 0.0], abs=1e-5)
    assert solved.summary["momentum"]["angular"] == pytest.approx(3 / 12, abs=1e-5)
    between = (middle["theta"] - end["theta"])[later]
    if kind == "weld":
        # it keeps the angle at which they meet; a rod that stretches as it spins is a little behind
        assert np.ptp(between) < 1e-6
        assert between[0] == pytest.approx(1.2, abs=1e-5 if types[1] == "rigid" else 1e-3)
    if types[0] == "rigid":
        # both move on at half the speed; of the pin the one that spins goes on, welded both turn about their centre
        lost = 0.25 if kind == "pin" else 0.25 + 0.5 * 9 / 12 * (1 - 1 / (2 + 2 * 12 / 16))
        assert solved.summary["energy"]["dissipated"] == pytest.approx(lost, abs=1e-6)
    assert solved.summary["energy_drift"] < 1e-4


@helpers.covering(method=METHODS, active=[{"from": 0.4}, {"after": "left.y < 0.6"}])
def test_a_slider_begins_where_the_point_reaches_its_line(method: str, active: Any) -> None:
    """An upright rod at v = (2, -1) meets the line y = (x - 1.8)/3 + 0.6 with its lower end, and slides along it.

    The impulse P acts across the line, on the end: v+ = v + P n/m, omega+ = P n_x/(m L/6), n . v+_end = 0.
    """
    rod = {**ROD, "geometry": {"type": "line", "start": [1, 1], "end": [1, 2]}}
    n = np.array([-1.0, 3.0]) / math.sqrt(10)
    solved = solve(method, bodies={"rod": rod}, t_end=0.8, initial={"velocity": [2, -1]},
                   joints=[{"name": "rail", "type": "slider", "at": "rod@0", "through": [-1.2, -0.4],
                            "along": [3, 1], "active": active}])
    near = 1e-5 if method in SECOND else 1e-7
    P = -(n @ [2, -1]) / (1 + 3 * n[0] ** 2)
    v, omega = np.array([2, -1]) + P * n, 6 * P * n[0]
    event, = solved.summary["events"]
    assert (event["what"], event["t"]) == ("rail begins", pytest.approx(0.4, abs=near))
    lost = 0.5 * 5 - 0.5 * (v @ v) - 0.5 * omega**2 / 12
    assert solved.summary["energy"]["dissipated"] == pytest.approx(lost, abs=near)
    t, left = solved.course_t, solved.course["left"]
    off = n[0] * (left["x"] - 1.8) + n[1] * (left["y"] - 0.6)
    assert off[t < 0.39] == pytest.approx(n @ [2, -1] * (t[t < 0.39] - 0.4), abs=near)
    assert off[t > 0.41] == pytest.approx(0 * t[t > 0.41], abs=near)
    # nothing acts along the line: the centre keeps its speed along it
    along = np.array([n[1], -n[0]])
    assert solved.summary["momentum"]["linear"] @ along == pytest.approx(along @ [2, -1], abs=10 * near)
    assert solved.summary["energy_drift"] < 1e-6


@helpers.covering(method=["radau5", "energy_momentum", "DOP853"],
                  active=[{"to": 0.4}, {"from": 0.4}, {"until": "bead.x > 2.3"}, {"after": "bead.y > 0"}])
def test_a_bead_comes_onto_a_bar_or_leaves_it(method: str, active: Any) -> None:
    """A rod whose end slides along a bar, from or up to their meeting at 2.4, at a right angle and along it."""
    bar = {**ROD, "geometry": {"type": "line", "start": [0, 0], "end": [4, 0]}}
    ends = not {"from", "after"} & set(active)
    meets = {"type": "prismatic", "point": "rod@0", "on": "bar", "name": "rail"}
    at = 1.5 if ends else 1.3
    rod = {**ROD, "geometry": {"type": "line", "start": [at, 0 if ends else -0.4], "end": [at, 1 if ends else 0.6]}}
    solved = solve(method, bodies={"bar": bar, "rod": rod}, t_end=0.7, joints=[{**meets, "active": active}],
                   boundary_conditions=[{"type": "clamp", "at": "bar@0"}],
                   loads=[{"type": "force", "at": "rod@0.5", "value": [0, 1]}] if ends else [],
                   initial={"bodies": {"rod": {"velocity": [2, 0 if ends else 1]}}},
                   output={"interval": 0.05, "probes": {"bead": "rod@0", "top": "rod@1"}})
    t, bead = solved.course_t, solved.course["bead"]
    near = 1e-5 if method == "energy_momentum" else 1e-8
    free = np.clip(t - 0.4, 0, None)
    assert [e["what"] for e in solved.summary["events"]] == ["rail " + ("ends" if ends else "begins")]
    assert bead["x"] == pytest.approx(at + 2 * t, abs=near)
    # upright throughout: what pulls it off accelerates it from then on, what it meets stops it
    assert bead["y"] == pytest.approx(0.5 * free**2 if ends else np.minimum(t - 0.4, 0), abs=near)
    assert solved.course["top"]["theta"] == pytest.approx(0 * t, abs=near)
    assert solved.summary["energy"]["dissipated"] == pytest.approx(0.0 if ends else 0.5, abs=near)
    assert solved.summary["energy_drift"] < 1e-7


@pytest.mark.parametrize(("start", "said"), [([1.5, 1], "distance from the axis of bar is violated by"),
                                             ([6, 0], "one is beyond the end of its axis")])
def test_a_bead_off_its_bar_cannot_begin_to_slide(start: list[float], said: str) -> None:
    rod = {**ROD, "geometry": {"type": "line", "start": start, "end": [start[0], start[1] + 1]}}
    slides = {"type": "prismatic", "point": "rod@0", "on": "bar", "name": "rail"}
    with pytest.raises(ComputationError, match=f"rail begins while its points are apart: {said}"):
        solve(bodies={"bar": {**ROD, "geometry": {"type": "line", "start": [0, 0], "end": [4, 0]}}, "rod": rod},
              joints=[{**slides, "active": {"from": 0.1}}])


def test_a_motion_that_failed_at_an_event_fails_there_again_when_resumed(tmp_path: Path,
                                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is kept of an incomplete event."""
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 1e3)  # the states and the failure come at once
    monkeypatch.setattr(writer, "FLUSH_SECONDS", 0.0)
    case = ancf2d.load({
        "bodies": {"rod": ROD, "other": {**ROD, "geometry": {"type": "line", "start": [1.5, 0], "end": [2.5, 0]}}},
        "joints": [{"name": "tie", "type": "pin", "between": ["rod@1", "other@0"], "active": {"after": "t > 0.3"}}],
        "initial": {"bodies": {"rod": {"velocity": [1, 0]}}},
        "solver": {"type": "dynamic", "t_end": 1, "dt": 0.01, "estimate": False},
        "output": {"interval": 0.05, "probes": {"right": "rod@1"}}})
    found = [run_case(case, str(tmp_path / "a.h5"), resume=again).summary for again in (False, True)]
    assert "tie begins while its points are apart" in found[0]["reason"]
    for key in ("reason", "at", "probes", "t"):
        assert found[1][key] == found[0][key]


def test_redundant_supports_act_once() -> None:
    """A permanent clamp, a pin at the same point that begins and one that takes over when the clamp ends."""
    solved = solve(boundary_conditions=[
        {"name": "grip", "type": "clamp", "at": "rod@0", "active": {"to": 0.3}},
        {"name": "pivot", "type": "pin", "at": "rod@0", "active": {"from": 0.1}},
        {"name": "rest", "type": "roller", "at": "rod@0", "fixed": "x"}],
        loads=[{"type": "moment", "at": "rod@0", "value": 1}])
    # from t = 0.3 on, 3 rad/s^2 about the end
    t = np.clip(solved.course_t - 0.3, 0, None)
    assert solved.course["right"]["theta"] == pytest.approx(1.5 * t**2, abs=1e-8)
    assert solved.course["left"]["uy"] == pytest.approx(0 * t, abs=1e-12)


CASE = """\
bodies:
  rod:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {EA: 1e4, kGA: 1e4, EI: 1e2, rhoA: 1, rhoI: 1e-3}
    element: {type: reissner3, count: 2}
boundary_conditions:
  - {name: pivot, type: pin, at: rod@0, active: {until: right.theta < -0.3}}
  - {name: hook, type: clamp, at: rod@1, active: {after: right.y < -1}}
loads:
  - {type: gravity, value: [0, -9.81]}
solver: {type: dynamic, t_end: 0.8, tolerance: 1e-6}
output: {interval: 0.02, probes: {left: rod@0, right: rod@1}}
"""


@pytest.mark.slow
def test_a_motion_resumes_across_switched_supports(monkeypatch: pytest.MonkeyPatch) -> None:
    report = resumed_behind_events(CASE, monkeypatch)[-1].report
    assert [e["what"] for e in report["events"]] == ["pivot ends", "hook begins"]
    assert report["energy_drift"] < 1e-3


def test_supports_that_cannot_begin_are_refused() -> None:
    jumps = {"type": "expression", "value": "0 if t < 0.5 else 1"}
    for support, says in (({"type": "prescribed", "ux": jumps, "active": {"from": 0.1}}, "jumps at t = 0.5"),
                          ({"type": "pin", "active": {}}, "nothing is given")):
        with pytest.raises(ancf2d.CaseError, match=says):
            solve(boundary_conditions=[{"at": "rod@0", **support}])
    with pytest.raises(ancf2d.CaseError, match="only with dynamic"):
        solve(boundary_conditions=[{"type": "clamp", "at": "rod@0", "active": {"to": 1}}], solver={"type": "static"},
              output={})
