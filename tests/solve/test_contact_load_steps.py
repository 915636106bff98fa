"""Load steps and paths with obstacles: cut steps, steps past an obstacle, and snap over a corner."""

from __future__ import annotations

import re

import helpers
import numpy as np
import pytest
from test_contact_statics import CLAMP, strip

from ancf2d.elements.contact_geometry import STATUS
from ancf2d.errors import ComputationError
from ancf2d.solvers.contact import contact_report
from ancf2d.solvers.registry import solve
from ancf2d.solvers.state_results import reactions
from ancf2d.solvers.statics import newton, static


def test_a_cut_load_step_reopens_its_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first step, in which the strip touches, is rejected: the next one starts without contact."""
    tried, touched = [], []

    def refused(model, *state):
        tried.append(state)
        if len(tried) == 1:
            raise ComputationError("refused")

    def begun(system, *how):
        touched.append(sum(p.mem[STATUS] > 0.0 for one in system.model.contact_tables for p in one.points))
        return found(system, *how)

    found = static.newton
    monkeypatch.setattr(static, "check_sound", refused)
    monkeypatch.setattr(static, "newton", begun)
    solution = helpers.Solution(strip(4, bc=[CLAMP], loads=[{"type": "force", "at": "beam@1", "value": [0, -1.0]}],
                                      obstacles={"solid": {"type": "half_plane", "through": [0, -1e-3],
                                                           "normal": [0, 1]}}))
    assert solution.state.t == 1.0
    assert touched[:2] == [0, 0]
    assert touched[-1] > 0


def test_a_step_whose_points_go_to_and_fro_ends_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two points that open and close in turn, without end: a step with so little hope is made shorter at once."""
    rounds = []

    def swapped(system, d, t, *how):
        rounds.append(t)
        first, second = (one.points[k] for one in system.model.contact_tables for k in (-1, -2))
        first.mem[STATUS], second.mem[STATUS] = (1.0, 0.0) if len(rounds) % 2 else (0.0, 1.0)
        return 1, 0.0

    monkeypatch.setattr(newton, "update_active_set", swapped)
    model = strip(4, bc=[CLAMP], loads=[{"type": "force", "at": "beam@1", "value": [0, -1.0]}],
                  obstacles={"solid": {"type": "half_plane", "through": [0, -1e-3], "normal": [0, 1]}})
    with pytest.raises(ComputationError, match="the contact points were not found"):
        helpers.Solution(model)
    assert 2 * newton.VISITS < rounds.count(rounds[0]) <= 2 * newton.VISITS + 2 < newton.ROUNDS


def test_no_step_leads_past_a_disc_between_two_nodes() -> None:
    """The first equilibrium of a step may be inside a disc, beyond its centre, or past it."""
    x, radius, found = 0.8, 0.04, []
    for steps in (1, 20):
        solution = helpers.Solution(strip(
            7, bc=[CLAMP], solver={"type": "static", "steps": steps},
            loads=[{"type": "force", "at": "beam@1", "value": [0, -1]}],
            obstacles={"solid": {"type": "circle", "center": [x, -radius - 0.02], "radius": radius}}))
        found.append(solution.r("beam@1"))
        assert contact_report(solution.model, solution.state)[0]["force"][1] > 0.5
    np.testing.assert_allclose(*found, atol=1e-6)


@pytest.mark.parametrize(("gap", "force", "place"), [
    # load steps settle the place of lift-off to 1e-5 of half an element
    (0.0, 5e-6, 1e-6),
    # the tip touches
    (0.05, 1e-9, 1e-8)])
def test_arc_length_passes_the_states_of_load_steps_in_contact(gap: float, force: float, place: float) -> None:
    """A cantilever touches a disc, between two nodes or with its tip, in the same state by either method."""
    scene = {"bc": [CLAMP], "loads": [{"type": "force", "at": "beam@0.5", "value": [0, -2]}],
             "obstacles": {"solid": {"type": "circle", "center": [1, -0.1 - gap], "radius": 0.1}}}
    arc = {"type": "static", "method": "arc_length", "until": {"load_factor": 1}}
    steps, along = (helpers.Solution(strip(8, solver=solver, **scene)) for solver in ("static", arc))
    (one,), (other,) = (contact_report(s.model, s.state) for s in (steps, along))
    assert one["force"][1] > 0.1
    assert not steps.state.warnings + along.state.warnings
    np.testing.assert_allclose(other["force"], one["force"], rtol=1e-6, atol=force)
    np.testing.assert_allclose(along.r("beam@0.5"), steps.r("beam@0.5"), rtol=place)


@pytest.mark.parametrize(("gap", "step", "close"), [
    # the tip slides inwards, and friction holds it back, with errors of first order in the steps
    (0.1, 0.01, 0.05),
    # a force pulls it along, and friction holds it from the first step on
    (0.0, 0.1, 1e-6)])
def test_friction_on_a_path_is_that_of_load_steps(gap: float, step: float, close: float) -> None:
    scene = {"bc": [CLAMP], "loads": [{"type": "force", "at": "beam@1", "value": [0 if gap else 1, -3]}],
             "obstacles": {"solid": {"type": "half_plane", "through": [0, -gap], "normal": [0, 1]}},
             "friction": 0.5, "law": {"stiffness": 1e6}}
    found = []
    for solver in ({"type": "static", "steps": int(1.0 / step)},
                   {"type": "static", "method": "arc_length", "until": {"load_factor": 1}, "largest_step": step}):
        solution = helpers.Solution(strip(8, solver=solver, **scene))
        found.append(contact_report(solution.model, solution.state)[0]["force"])
    np.testing.assert_allclose(*found, rtol=close)
    assert abs(found[0][0]) > 0.02 * found[0][1]


def hook(steps, ends):
    """Return a hook above a catch that moves in from the right: positions of the catch at shares of the steps."""
    data = helpers.body(
        {"type": "polyline", "points": [[0, 0], [0.02, 0], [0.02, -0.003]]}, helpers.element("reissner3", 8),
        {"height": 0.0015, "width": 0.005}, {"E": 2.4e9, "nu": 0.38})
    catch = {"type": "polyline", "points": [[0.021, -0.006], [0.024, -0.004], [0.0275, -0.002], [0.028, -0.002],
                                            [0.029, -0.004], [0.04, -0.004]],
             "motion": {"x": {"type": "table", "t": list(ends), "value": list(ends.values())}}}
    return helpers.build({"hook": data}, {"type": "static", "steps": steps}, obstacles={"catch": catch},
                         bc=[{"name": "root", "type": "clamp", "at": "hook@0"}],
                         contacts=[{"name": "nose", "between": ["hook", "catch"], "side": "axis"}])


def tip(model, state):
    """Return the position of the tip of the hook."""
    return np.array([0.02, -0.003]) + state.d[model.n_q - 3:model.n_q - 1]


@pytest.mark.parametrize("steps", [20, 40])
def test_a_tip_beyond_a_corner_leaves_the_corner(steps):
    """The nose of a hook climbs the slope of a catch that moves in below it, and then stands on its crest.

    The corner between these is next to the axis beside the tip there; it was taken to be inside the nose, and held it.
    """
    model = hook(steps, {0.0: 0.0, 0.2: -0.0067, 1.0: -0.0077})
    *_, state = solve(model)
    x, y = tip(model, state)
    assert y == pytest.approx(-0.002, abs=1e-12)
    assert 0.0275 - 0.0077 < x < 0.028 - 0.0077
    # the crest bears it upright, and the root turns that round
    force = reactions(model, state)["root"]
    assert abs(force["fx"]) < 1e-9 * abs(force["fy"])


def test_a_hook_snaps_over_a_corner_with_a_warning():
    """The flank of the catch pushes the nose along the arm, the crest does not, and there is nothing in between.

    The tip leaves the flank at its corner and stands where that of a hook is whose catch has moved in.
    """
    model = hook(60, {0.0: 0.0, 0.1: -0.0085, 0.2: -0.01, 0.5: -0.008, 1.0: -0.0075})
    states = list(solve(model))
    (said,) = [w for s in states for w in s.warnings]
    assert re.search(r"bodies in contact snap at load factor 0\.\d+: they move by 3e-05 m at once", said)
    on_crest = hook(20, {0.0: 0.0, 0.2: -0.0067, 1.0: -0.0077})
    *_, there = solve(on_crest)
    np.testing.assert_allclose(tip(model, states[-1]), tip(on_crest, there), rtol=0, atol=1e-12)
