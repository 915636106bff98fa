"""Effects on small motions, and loads reported to have none; velocity-dependent line loads, in motion too.

A drag of c v per length on a body of mass rhoA per length is Rayleigh damping with alpha = c/rhoA, where the body has
no other mass.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ancf2d

C = 2.0
DRAG = {"name": "drag", "type": "distributed", "on": "b", "value": ["-c*vx", "-c*vy"]}
MASS = {"damping": {"rayleigh": {"alpha": C, "beta": 0.0}}}


def cantilever(solver: dict[str, Any], loads: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    """Return a cantilever of length, EI and rhoA 1."""
    return {"parameters": {"c": C}, "loads": loads, "solver": solver, "output": {"probes": {"tip": "b@1"}}, **more,
            "bodies": {"b": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                             "section": {"EA": 1e4, "EI": 1, "rhoA": 1}, "element": {"type": "cable", "count": 6}}},
            "boundary_conditions": [{"type": "clamp", "at": "b@0"}]}


def pairs(case: dict[str, Any]) -> list[complex]:
    """Return the eigenvalues of a case."""
    return [complex(one["growth"], one["omega"]) for one in ancf2d.solve(case, states=False).summary["frequencies"]]


PUSH = {"name": "push", "type": "force", "at": "b@1", "value": [0, 1]}


def test_drag_damps_vibrations_about_the_static_state() -> None:
    about = {"type": "eigen", "modes": 3, "about": "static"}
    found = pairs(cantilever(about, [PUSH, DRAG]))
    assert found == pytest.approx(pairs(cantilever(about, [PUSH], **MASS)), rel=1e-9)
    assert np.real(found) == pytest.approx(-C / 2, rel=1e-9)


@pytest.mark.parametrize("solver", [{"type": "frequency_response", "frequencies": [0.3, 3]},
                                    {"type": "state_space", "outputs": ["tip.uy"], "modes": 3}])
def test_drag_damps_responses(solver: dict[str, Any]) -> None:
    spec = {**solver, "about": "static", "inputs": ["push"]}
    found, due = (ancf2d.solve(case, states=False).summary for case in
                  (cantilever(spec, [PUSH, DRAG]), cantilever(spec, [PUSH], **MASS)))
    assert not found["warnings"]
    if spec["type"] == "frequency_response":
        one, other = (np.array(s["response"]["push"]["tip"]["uy"]["im"]) for s in (found, due))
    else:
        one, other = (np.array([p["growth"] for p in s["state_space"]["poles"]]) for s in (found, due))
    assert one == pytest.approx(other, rel=1e-9)
    assert np.abs(other).min() > 1e-4


@pytest.mark.slow
def test_drag_moves_the_load_at_which_a_follower_load_makes_a_column_flutter() -> None:
    """A drag that does not scale is Rayleigh's alpha; one that does grows with the factor."""
    follower = {"type": "follower_force", "at": "b@1", "value": [-1, 0]}
    spec = {"type": "buckling", "modes": 1}

    def factor(case: dict[str, Any]) -> float:
        return float(ancf2d.solve(case, states=False).summary["critical"][0]["factor"])
    damped = factor(cantilever(spec, [follower], **MASS))
    assert damped > 1.005 * factor(cantilever(spec, [follower]))
    assert factor(cantilever(spec, [follower, {**DRAG, "amplitude": {"type": "constant"}}])) == pytest.approx(damped)
    scaled = cantilever(spec, [follower, DRAG], parameters={"c": C / damped}, goal={"load_factor": 1})
    assert factor(scaled) == pytest.approx(damped, rel=1e-9)
    found = ancf2d.sensitivity(scaled, ["parameters.c"]).rows[0]
    h = 1e-3 * C / damped
    high, low = (factor({**scaled, "parameters": {"c": C / damped + s * h}}) for s in (1, -1))
    assert found.method == "exact"
    assert found.derivative == pytest.approx((high - low) / (2 * h), rel=1e-5)


@pytest.mark.parametrize("solver", [{"type": "eigen", "modes": 1}, {"type": "frequency_response", "frequencies": [1]},
                                    {"type": "state_space", "outputs": ["tip.uy"], "modes": 1}])
def test_items_without_effect_on_small_motions_are_reported(solver: dict[str, Any]) -> None:
    """Drag and a damper quadratic in the velocity; loaded springs and prescribed motions."""
    inputs = {} if solver["type"] == "eigen" else {"inputs": ["push"]}
    square = {**DRAG, "value": ["-c*vx*sqrt(vx^2 + vy^2)", "-c*vy*sqrt(vx^2 + vy^2)"]}
    damper = {"type": "translational", "between": ["b@1", [1, 1]], "force": "0.1*u + v*abs(v)"}
    case = cantilever({**solver, **inputs, "about": "static"}, [PUSH, square], springs=[damper])
    reason = "its damping force is of higher order in the rates, so it has no effect on small motions"
    assert ancf2d.solve(case, states=False).warnings == [f"{what}: {reason}" for what in ("springs.0", "loads.1")]
    spring = {"type": "rotational", "between": [[0, 0], "b@1"], "stiffness": 1, "angle": 0.2}
    case = cantilever({**solver, **inputs}, [PUSH], springs=[spring])
    case["boundary_conditions"].append({"type": "roller", "at": "b@0.5", "fixed": "y"})
    case["boundary_conditions"].append({"type": "prescribed", "at": "b@0.5", "x": {"type": "ramp", "scale": 1e-3}})
    said = " ".join(ancf2d.solve(case, states=False).warnings)
    assert "prescribed motions" in said
    assert "the reference is not an equilibrium, because springs are loaded there" in said


def test_undamped_modes_report_neglected_drag() -> None:
    case = cantilever({"type": "eigen", "modes": 1, "about": "static", "damped": False}, [PUSH, DRAG])
    assert ancf2d.solve(case, states=False).warnings == [
        "these modes are undamped (damped: false), so the damping of loads.1 has no effect"]


@pytest.mark.slow
def test_the_equations_of_a_case_include_drag_and_switched_dampers() -> None:
    """Compared by SciPy's integrator with ``ancf2d.solve``: drag, a damper that begins, an accelerating fluid."""
    case = cantilever({"type": "dynamic", "t_end": 0.3, "tolerance": 1e-9, "method": "radau5"},
                      [{**PUSH, "value": [0, 3]}, DRAG], springs=[
                          {"type": "translational", "between": ["b@1", [1, 1]], "damping": 2,
                           "active": {"from": 0.15}}],
                      fluid={"on": "b", "rhoA": 0.5, "velocity": {"type": "ramp", "t0": 0, "t1": 0.3, "scale": 4}})
    case["bodies"]["b"]["section"]["EA"] = 100
    case["bodies"]["b"]["element"]["count"] = 2
    equations = ancf2d.system(case)
    n, y, t = equations.n, np.concatenate(equations.initial()), 0.0
    for end in (0.15, 0.3):
        # the damper begins between the two
        found = solve_ivp(lambda t, y: np.append(y[n:], equations.accelerations(y[:n], y[n:], t)[0]), (t, end), y,
                          method="DOP853", rtol=1e-9, atol=1e-11)
        y, t = found.y[:, -1], end + 1e-12
    tip = equations.probe("tip", y[:n], y[n:], 0.3)
    due = ancf2d.solve(case, states=False).probes["tip"]
    assert [tip[q] for q in ("ux", "uy", "vy")] == pytest.approx([due[q] for q in ("ux", "uy", "vy")], rel=1e-6)


def test_an_input_without_effect_is_reported() -> None:
    """A slack tendon exerts nothing, and its slack may change."""
    tendon = {"name": "line", "type": "tendon", "through": ["b@1", [1, 0.5]], "stiffness": 1, "slack": -0.1}
    lifted = {"type": "force", "at": "b@1", "value": [0, 0.5]}
    spec = {"type": "frequency_response", "frequencies": [1], "inputs": ["line"], "about": "static"}
    lowered = {**lifted, "value": [0, -0.5]}
    said = "the input line exerts no force and moves nothing in this state, so nothing responds to it"
    for load, told in ((lifted, [said]), (lowered, [])):
        assert ancf2d.solve(cantilever(spec, [tendon, load], parameters={}), states=False).warnings == told
