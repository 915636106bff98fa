"""What begins and ends during a motion: loads and springs with ``active``, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import ancf2d

# a point of mass 1 that moves along x alone, as good as free
BODY = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
        "section": {"EA": 1, "kGA": 1, "EI": 1, "rhoA": 1, "rhoI": 0}, "element": {"type": "rigid"}}


def run(t_end: float = 2.0, method: str = "radau5", **more: Any) -> Any:
    return ancf2d.solve({
        "bodies": {"bar": BODY},
        "boundary_conditions": [{"type": "roller", "at": "bar@0", "fixed": "y"},
                                {"type": "roller", "at": "bar@1", "fixed": "y"}],
        "solver": {"type": "dynamic", "t_end": t_end, "tolerance": 1e-8, "method": method, "estimate": False},
        "output": {"interval": 0.1, "probes": {"end": "bar@1"}}, **more})


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha", "DOP853"])
def test_a_force_acts_for_a_while(method: str) -> None:
    solved = run(method=method, loads=[{"name": "push", "type": "force", "at": "bar@0", "value": [3, 0],
                                        "active": {"from": 0.3, "to": 1.05}}])
    t = solved.course_t
    during = np.clip(t - 0.3, 0, 0.75)
    expected = 1.5 * during**2 + 3 * 0.75 * np.clip(t - 1.05, 0, None)
    assert solved.course["end"]["ux"] == pytest.approx(expected, abs=1e-6)
    assert solved.summary["events"] == [{"t": 0.3, "what": "push begins"}, {"t": 1.05, "what": "push ends"}]
    # the work is that of the force
    assert solved.summary["energy"]["kinetic"] == pytest.approx(0.5 * 2.25**2, rel=1e-6)
    assert solved.summary["energy_drift"] < 1e-6


def test_amplitudes_go_on_within() -> None:
    solved = run(loads=[{"type": "force", "at": "bar@0", "value": [1, 0], "active": {"from": 0.5},
                         "amplitude": {"type": "sine", "frequency": 0.5}}])
    # v = int sin(pi t)
    v = solved.course["end"]["vx"]
    t = np.clip(solved.course_t, 0.5, None)
    assert v == pytest.approx((np.cos(0.5 * math.pi) - np.cos(math.pi * t)) / math.pi, abs=1e-7)


@pytest.mark.parametrize("method", ["radau5", "energy_momentum"])
def test_a_latch_is_a_spring_that_ends(method: str) -> None:
    # swings with omega = 3 to t = 1, then flies on with the velocity that it has there
    solved = run(method=method, springs=[{"name": "latch", "type": "translational", "between": [[-1, 0], "bar@0"],
                                          "stiffness": 9, "active": {"to": 1.0}}],
                 initial={"velocity": [0.2, 0]})
    t = solved.course_t
    expected = np.where(t < 1, 0.2 / 3 * np.sin(3 * np.minimum(t, 1)),
                        0.2 / 3 * math.sin(3) + 0.2 * math.cos(3) * (t - 1))
    assert solved.course["end"]["ux"] == pytest.approx(expected, abs=2e-6)
    assert solved.summary["momentum"]["linear"][0] == pytest.approx(0.2 * math.cos(3), abs=1e-6)
    assert solved.summary["energy_drift"] < 1e-6


def test_a_spring_that_begins_and_a_start_from_equilibrium() -> None:
    load = {"type": "force", "at": "bar@0", "value": [2, 0]}
    first = {"type": "translational", "between": [[-1, 0], "bar@0"], "stiffness": 8, "length": 1}
    solved = run(springs=[{**first, "active": {"to": 0.5}}, {**first, "stiffness": 4, "active": {"from": 0.5}}],
                 loads=[load], initial={"from": "static"})
    # at rest at 2/8, then about 2/4
    t = np.clip(solved.course_t - 0.5, 0, None)
    assert solved.course["end"]["ux"] == pytest.approx(0.5 - 0.25 * np.cos(2 * t), abs=1e-6)


def test_the_order_is_kept_over_ten_events() -> None:
    """Five pulses: x is known piece by piece; the error of fixed steps falls with the fifth power."""
    pulses = [{"type": "force", "at": "bar@0", "value": [1, 0],
               "active": {"from": 0.137 + 0.3 * k, "to": 0.291 + 0.3 * k},
               "amplitude": {"type": "expression", "value": "exp(t)"}} for k in range(5)]
    spring = {"type": "translational", "between": [[-1, 0], "bar@0"], "stiffness": 30, "length": 1}

    def end(dt: float) -> float:
        return float(run(loads=pulses, springs=[spring], solver={
            "type": "dynamic", "t_end": 1.7, "dt": dt, "estimate": False, "method": "radau5"}).probes["end"]["ux"])
    w = math.sqrt(30)
    exact = 0.0
    for k in range(5):
        a, b = 0.137 + 0.3 * k, 0.291 + 0.3 * k
        # int_a^b exp(s) sin(w (T - s))/w ds
        def part(s: float) -> float:
            return math.exp(s) * (math.sin(w * (1.7 - s)) + w * math.cos(w * (1.7 - s))) / (1 + w * w)
        exact += (part(b) - part(a)) / w
    errors = [abs(end(dt) - exact) for dt in (0.1, 0.05)]
    assert math.log2(errors[0] / errors[1]) > 4.5


def test_what_begins_is_checked() -> None:
    load = {"type": "force", "at": "bar@0", "value": [1, 0]}
    for active, says in (({}, "nothing is given"), ({"from": 2, "to": 1}, "from must be less than to")):
        with pytest.raises(ancf2d.CaseError, match=says):
            run(loads=[{**load, "active": active}])
    with pytest.raises(ancf2d.CaseError, match="only with dynamic"):
        run(loads=[{**load, "active": {"to": 1}}], solver={"type": "static"}, output={})
