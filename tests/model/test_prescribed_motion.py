"""Signals of loads and prescribed motions of a dynamic case, and impossible motions."""

from __future__ import annotations

from typing import Any

import helpers
import numpy as np
import pytest

from ancf2d.case import LoadedCase, Ramp, Sine
from ancf2d.errors import CaseError, Problem
from ancf2d.model.build import build_model
from ancf2d.model.model import Model
from ancf2d.model.timing import Signal

BAR = {"b": helpers.body(helpers.line(2.0, start=(1.0, -0.5)), helpers.element("reissner3", 2))}
FLAT = {"b": helpers.body(helpers.line(2.0, start=(1.0, -0.5)), helpers.element("vallejo", 2))}
SINE = {"type": "sine", "frequency": 0.5}
DYNAMIC = {"type": "dynamic", "t_end": 2.0, "dt": 0.01}


def problems_of(loaded: LoadedCase) -> list[Problem]:
    """Return the problems of building the model of a case."""
    try:
        build_model(loaded)
    except CaseError as error:
        return error.problems
    return []


def motion(bodies: dict[str, Any] = BAR, **given: Any) -> dict[str, Any]:
    """Return a dynamic scene with a prescribed motion of its end."""
    return {"bodies": bodies, "solver": DYNAMIC, "bc": [{"name": "hand", "type": "prescribed", "at": "b@0", **given}]}


def moved(model: Model) -> dict[str, Any]:
    """Return the signal of each prescribed motion."""
    equations = [*model.rows, *model.constraints]
    return {e.holds: e.signal for e in equations if getattr(e, "signal", None) is not None}


def formula(text: str) -> dict[str, str]:
    """Return an expression."""
    return {"type": "expression", "value": text}


def test_prescribed_positions_displacements_and_angles_are_signals_from_the_reference() -> None:
    for bodies in (BAR, FLAT):
        model = helpers.build(**motion(bodies, x=formula("1 + t"), uy=SINE, angle=SINE))
        found = moved(model)
        assert found["x"](0.25) == pytest.approx(0.25)
        assert found["x"].rate(0.25) == pytest.approx(1.0)
        assert found["uy"] == found["rotation"] == Signal(Sine(frequency=0.5))


def test_a_number_is_the_position_at_all_times() -> None:
    model = helpers.build(**motion(x=1.0, y=-0.5, angle=0.0))
    assert moved(model) == {"x": Signal(None, 1.0, -1.0), "y": Signal(None, -0.5, 0.5), "rotation": Signal(None, 0.0)}
    assert [s(t) for s in moved(model).values() for t in (0.0, 0.7)] == [0.0] * 6


def test_loads_without_an_amplitude_are_constant_over_time_and_the_others_follow_theirs() -> None:
    ramp = {"type": "ramp", "t0": 0.5, "t1": 1.5}
    loads = [{"type": "force", "at": "b@1", "value": [3.0, 0.0]}, {"type": "gravity", "value": [0, -9.81]},
             {"type": "follower_force", "at": "b@1", "value": [0, 1.0], "amplitude": ramp},
             {"type": "distributed", "on": "b", "value": [0, 2.0], "amplitude": ramp}]
    model = helpers.build(BAR, DYNAMIC, loads=loads)
    followed = {load.amplitude for load in model.loads.dead} | {p.signal for p in model.loads.patches}
    assert followed == {Signal(), Signal(Ramp(t0=0.5, t1=1.5))}
    F0, F1, F2 = (model.external(t) for t in (0.0, 1.0, 2.0))
    np.testing.assert_allclose(F1 - F0, 0.5 * (F2 - F0), rtol=1e-12, atol=1e-12)
    assert np.abs(F0).max() > 1.0
    assert np.abs(F2 - F0).max() > 0.1


REFUSED = [
    ({"x": 1.5}, "x", "prescribed x is 1.5 at t = 0, but the point is at x = 1"),
    ({"y": formula("t - 0.6")}, "y", "prescribed y is -0.6 at t = 0, but the point is at y = -0.5"),
    ({"ux": 0.1}, "ux", "ux is 0.1 at t = 0"),
    ({"uy": {"type": "sine", "frequency": 1, "phase": 0.5}}, "uy", "uy is 0.479426 at t = 0"),
    ({"angle": 0.2}, "angle", "angle is 0.2 at t = 0"),
    ({"angle": formula("1/t")}, "angle", "divides by zero"),
    ({"ux": formula("0 if t < 0.5 else 1")}, "ux", "jumps at t = 0.5"),
    ({"angle": formula("0 if t < 0.5 else 1 if t < 1.25 else 2")}, "angle", "jumps at t = 0.5 and once more"),
    ({"x": formula("1 if t == 0 else 1.2")}, "x", "jumps at t = "),
]


@pytest.mark.parametrize("bodies", [BAR, FLAT], ids=["theta", "direction"])
@pytest.mark.parametrize(("given", "key", "words"), REFUSED)
def test_contradictory_motions_of_a_body_are_refused_at_their_entry(
        bodies: dict[str, Any], given: dict[str, Any], key: str, words: str) -> None:
    problems = problems_of(helpers.load(**motion(bodies, **given)))
    (problem,) = problems
    assert words in problem.message
    assert problem.message.startswith("hand: the prescribed")
    assert problem.path == ("boundary_conditions", 0, key)


@pytest.mark.parametrize("given", [
    {"x": formula("1 + abs(t - 1) - 1")}, {"ux": {"type": "ramp", "t0": 0, "t1": 1}},
    {"angle": formula("t if t < 1 else 1")}, {"uy": formula("0 if t < 2.5 else 1")},
])
def test_corners_and_jumps_after_the_end_are_allowed(given: dict[str, Any]) -> None:
    assert problems_of(helpers.load(**motion(**given))) == []


@pytest.mark.parametrize("start", ["static", "before.h5"])
def test_a_motion_from_another_state_may_start_elsewhere(start: str) -> None:
    scene = {**motion(x=1.5), "initial": {"from": start}}
    assert problems_of(helpers.load(**scene)) == []


def test_redundant_prescribed_motions_must_agree_until_the_end() -> None:
    scene = motion(ux=formula("t if t > 1.7 else 0.5*abs(t) - 0.5*t"))
    scene["bc"].append({"name": "wall", "type": "pin", "at": "b@0"})
    messages = [p.message for p in problems_of(helpers.load(**scene))]
    assert any("contradicts" in m for m in messages)


def test_static_motions_may_start_with_a_step_but_positions_start_at_the_body() -> None:
    step = {"type": "constant", "scale": 0.1}
    assert problems_of(helpers.load(**{**motion(ux=step, uy=step, angle=step), "solver": "static"})) == []
    scene = motion(ux=step, y={"type": "constant"}, angle=0.1)
    (problem,) = problems_of(helpers.load(**{**scene, "solver": "static"}))
    assert "y is 1 at t = 0, but the point is at y = -0.5" in problem.message
    assert problem.path[-1] == "y"


def test_building_raises_the_problems() -> None:
    with pytest.raises(CaseError, match="is 0\\.2 at t = 0"):
        helpers.build(**motion(angle=0.2))
