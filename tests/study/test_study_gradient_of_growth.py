"""Derivatives of factors at which small motions begin to grow: Ziegler's pendulum, columns and pipes."""

import copy
import re
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.optimize import brentq

import ancf2d
from ancf2d.case import Goal
from ancf2d.case.numbers import number_at
from ancf2d.errors import ComputationError
from ancf2d.study.gradient import derivatives, gradient

LINK = {"element": {"type": "rigid", "mass": 1e-11, "inertia": 1e-11}}
# two rigid links with a spring and a damper at each joint, a mass at each end; loads that turn and that do not
PENDULUM = {
    "bodies": {"lower": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, **LINK},
               "upper": {"geometry": {"type": "line", "start": [1, 0], "end": [2, 0]}, **LINK}},
    "boundary_conditions": [{"type": "pin", "at": "lower@0"}],
    "joints": [{"type": "pin", "between": ["lower@1", "upper@0"]}],
    "masses": [{"name": "m1", "at": "lower@1", "mass": 2.2}, {"name": "m2", "at": "upper@1", "mass": 0.9}],
    "springs": [{"name": "s1", "type": "rotational", "between": ["lower@0", [0, 0]], "stiffness": 1.1, "damping": 0},
                {"name": "s2", "type": "rotational", "between": ["lower@1", "upper@0"], "stiffness": 0.8,
                 "damping": 0}],
    "loads": [{"name": "turns", "type": "follower_force", "at": "upper@1", "value": [-1, 0]},
              {"name": "stays", "type": "force", "at": "upper@1", "value": [-0.1, 0]}],
    "solver": {"type": "buckling", "modes": 1}, "goal": {"load_factor": 1}}
NUMBERS = {"springs.s1.stiffness": 1.1, "springs.s2.stiffness": 0.8, "masses.m1.mass": 2.2, "masses.m2.mass": 0.9,
           "springs.s1.damping": 0.0, "springs.s2.damping": 0.0, "loads.turns.value.0": -1.0,
           "loads.stays.value.0": -0.1}


def critical(numbers: list[float], kind: str, near: float) -> float:
    """Return the factor near another at which det(K + s C + s^2 M) = a4 s^4 + ... + a0 begins to have growing roots.

    Frequencies meet where a2^2 = 4 a4 a0; roots come to the axis where a1 a2 a3 = a4 a1^2 + a0 a3^2 (Hurwitz), and to 0
    where a0 = 0.
    """
    k1, k2, m1, m2, c1, c2, turns, stays = numbers

    def margin(mu: float) -> float:
        F, D = -mu * turns, -mu * stays
        entries = [[[k1 + k2 - D - F, c1 + c2, m1 + m2], [F - k2, -c2, m2]], [[-k2, -c2, m2], [k2 - D, c2, m2]]]
        (a, b), (c, d) = ([np.polynomial.Polynomial(e) for e in row] for row in entries)
        a0, a1, a2, a3, a4 = (a * d - b * c).coef
        return float({"meets": a2 * a2 - 4 * a4 * a0, "axis": a1 * a2 * a3 - a4 * a1 * a1 - a0 * a3 * a3,
                      "diverges": a0}[kind])
    return float(brentq(margin, 0.98 * near, 1.02 * near, xtol=1e-14, rtol=1e-14))


@pytest.mark.slow_rows("axis-more1", "diverges-more2")
@pytest.mark.parametrize(("kind", "more"), [
    ("meets", {}), ("axis", {"springs.s1.damping": 0.05, "springs.s2.damping": 0.02}),
    ("diverges", {"loads.stays.value.0": -1.5, "springs.s2.damping": 0.02})])
def test_zieglers_pendulum(kind: str, more: dict[str, float]) -> None:
    """Where frequencies meet, where a damped motion begins to grow, and where one diverges: by the polynomial of s."""
    case = ancf2d.load(copy.deepcopy(PENDULUM), [f"{path}={value}" for path, value in more.items()])
    numbers = NUMBERS | more
    paths = [path for path in numbers if kind != "meets" or "damping" not in path]
    found = derivatives(case, [case.case.goal], [number_at(case, path) for path in paths])
    assert found.methods == ["exact"] * len(paths)
    near = float(found.values[0])
    assert near == pytest.approx(critical(list(numbers.values()), kind, near), rel=1e-7)
    for path, slope in zip(paths, found.jacobian[0], strict=True):
        h = 2e-3 * abs(numbers[path] or 1.0)
        at = [critical([*(numbers | {path: numbers[path] + k * h}).values()], kind, near) for k in (1, -1, 2, -2)]
        expected = (8 * (at[0] - at[1]) - (at[2] - at[3])) / (12 * h)
        assert slope == pytest.approx(expected, rel=1e-7, abs=1e-7 * near), path


def test_without_dampers_there_is_no_derivative_with_respect_to_them() -> None:
    """Even vanishing damping changes the factor at which motions begin to grow (Ziegler 1952)."""
    with pytest.raises(ComputationError, match="even vanishing damping changes the factor"):
        ancf2d.sensitivity(copy.deepcopy(PENDULUM), ["springs.s1.damping"])


@pytest.mark.slow
def test_roots_that_meet_on_the_real_axis_are_left_to_runs() -> None:
    """Beyond flutter two growing motions cease to vibrate (Ziegler 1952): s is not 0 there, and has no derivative."""
    case = ancf2d.load({**copy.deepcopy(PENDULUM), "solver": {"type": "buckling", "modes": 2},
                        "goal": {"load_factor": 2}}, ["loads.stays.value.0=0"])
    row = ancf2d.sensitivity(case, ["loads.turns.value.0"]).rows[0]
    assert row.method.startswith("differences of runs: several motions begin to grow at the factor, or not from s = 0")
    assert row.elasticity == pytest.approx(-1.0, rel=1e-5)


@pytest.mark.slow
def test_two_equal_pendulums_are_left_to_runs() -> None:
    """Both begin to flutter at once, and a spring of one separates them: the other one limits the factor."""
    case = copy.deepcopy(PENDULUM)
    text = yaml.safe_dump(case)
    for name in ("lower", "upper", "m1", "m2", "s1", "s2", "turns", "stays"):
        text = re.sub(rf"\b{name}\b", f"{name}_b", text)
    other = yaml.safe_load(text)
    for key in ("boundary_conditions", "joints", "masses", "springs", "loads"):
        case[key] += other[key]
    case["bodies"] |= other["bodies"]
    row, = ancf2d.sensitivity(case, ["springs.s1.stiffness"]).rows
    assert row.method.startswith("differences of runs: several motions")


def column(**more: Any) -> dict[str, Any]:
    """A slender column, or a pipe, of EI = L = 1."""
    return {"bodies": {"c": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                             "section": {"EA": 1e4, "kGA": 1e4, "EI": 1.0, "rhoA": 0.8, "rhoI": 1e-6},
                             "element": {"type": "cable", "count": 2}, **more.pop("body", {})}},
            "boundary_conditions": [{"type": "clamp", "at": "c@0"}],
            "solver": {"type": "buckling", "modes": 1}, "goal": {"load_factor": 1}, **more}


def test_a_pipe_by_its_dimensions() -> None:
    """The critical velocity is sqrt(EI/rhoA)/L times a function of the share of the fluid's mass."""
    case = column(fluid={"on": "c", "rhoA": 0.2, "velocity": 1.0})
    loaded = ancf2d.load(case)
    values, J = gradient(loaded, [loaded.case.goal], ["bodies.c.geometry.end.0", "bodies.c.section.EI",
                                                      "fluid.velocity", "bodies.c.section.rhoA", "fluid.rhoA"])
    u = values[0]
    assert J[0, :3] == pytest.approx([-u, 0.5 * u, -u], rel=1e-8)
    assert 0.8 * J[0, 3] + 0.2 * J[0, 4] == pytest.approx(-0.5 * u, rel=1e-8)


FLOWS = {"fluid": {"on": "c", "rhoA": 0.2, "velocity": 1.0}}
TURNS = {"loads": [{"name": "tip", "type": "follower_force", "at": "c@1", "value": [-1, 0]}]}


@pytest.mark.slow
@pytest.mark.parametrize(("more", "path", "h"), [
    (TURNS, "masses.m.mass", 2e-3), (TURNS, "bodies.c.section.rhoA", 2e-3),
    ({**TURNS, "body": {"material": {"damping": {"kelvin_voigt": 0.02}}}}, "bodies.c.material.damping.kelvin_voigt",
     1e-4),
    ({**TURNS, "body": {"material": {"viscoelastic": [{"modulus": 0.5, "time": 0.1}]}}},
     "bodies.c.material.viscoelastic.0.modulus", 2e-3),
    ({**TURNS, "damping": {"rayleigh": {"alpha": 0.5, "beta": 0.01}}}, "damping.rayleigh.alpha", 5e-3),
    ({**TURNS, "body": {"material": {"viscoelastic": [{"modulus": 0.5, "time": 0.1}]}}},
     "bodies.c.material.viscoelastic.0.time", 5e-4),
    (FLOWS, "fluid.rhoA", 1e-3), (FLOWS, "masses.m.mass", 2e-3),
    ({**FLOWS, "loads": [{"name": "weight", "type": "gravity", "value": [0.5, -3.0]}]}, "loads.weight.value.1", 1e-2)])
def test_columns_compared_with_differences_of_runs(more: dict[str, Any], path: str, h: float) -> None:
    """Coalescing frequencies, dampers, a relaxing material, and flow about the equilibrium under a weight."""
    case = ancf2d.load(column(masses=[{"name": "m", "at": "c@0.7", "mass": 0.3}], **copy.deepcopy(more)))
    variable = number_at(case, path)
    found = derivatives(case, [case.case.goal], [variable])
    assert found.methods == ["exact"]

    def at(k: int) -> float:
        return float(ancf2d.solve(case, [variable.override(variable.value + k * h)], states=False).value)
    expected = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h)
    assert found.jacobian[0, 0] == pytest.approx(expected, rel=1e-6)


def test_reactions_at_the_onset_of_a_pipe_are_those_without_flow() -> None:
    """The factor scales only the velocity: the reaction is proportional to the weight, for any flow."""
    case = ancf2d.load(column(loads=[{"name": "weight", "type": "gravity", "value": [0, -0.3]}], **FLOWS))
    values, J = gradient(case, [case.case.goal, Goal(reaction="c@0", quantity="fy")], ["loads.weight.value.1"])
    assert J[1, 0] == pytest.approx(values[1] / -0.3, rel=1e-9)
