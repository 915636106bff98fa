"""The error of a goal element by element by the adjoint, and meshes chosen by it."""

from __future__ import annotations

import numpy as np
import pytest
from pursued import CANTILEVER, TWO, case

from ancf2d.elements import registry
from ancf2d.solvers.derivatives.statics import Equilibrium
from ancf2d.study.accuracy.control import solve_to_accuracy
from ancf2d.study.accuracy.direct import order_of
from ancf2d.study.accuracy.neighbours import SAFETY, Neighbour, solve_neighbour, verdict_of, verdict_of_two
from ancf2d.study.accuracy.setting import Level, Setting, with_setting
from ancf2d.study.accuracy.weighted import GoalOf, weighted
from ancf2d.study.goal import GoalValue, solve_for_goal


@pytest.mark.parametrize(("text", "element", "sets", "tolerance"), [
    (CANTILEVER, "{type: vallejo, count: 3}", (), 0.01),
    (CANTILEVER, "{type: 2d2n-nu, count: 3}", ("solver.type=linear_static",), 1e-6),
    (CANTILEVER, "{type: cable, count: 3}", ("goal={quantity: strain_energy}",), 0.02),
    (CANTILEVER, "{type: reissner2, count: 3}", (
        "boundary_conditions+={name: prop, type: roller, at: beam@1, fixed: y}", "goal={reaction: prop, quantity: fy}",
        "loads.0={type: distributed, on: beam, value: [0, -3e5]}"), 0.05),
    (CANTILEVER, "{type: reissner3, count: 3}", ("goal={probe: tip, quantity: M}", "output.probes.tip=beam@0.1"),
     0.02)])
def test_the_adjoint_predicts_the_change_on_a_mesh_twice_as_fine(text, element, sets, tolerance):
    """J(h/2) - J(h) = -z R, without second order: to round-off in linear statics."""
    named = ("boundary_conditions.0.name=wall",)
    loaded = case(text, element, *named, *sets)
    coarse = with_setting(loaded, Setting({"beam": 6}))
    solved = solve_for_goal(coarse)
    found = weighted(coarse, solved)
    change = solve_for_goal(with_setting(loaded, Setting({"beam": 12}))).answer.value - solved.answer.value
    assert found.change == pytest.approx(change, rel=1e-6, abs=1e-9 * solved.answer.size)
    assert found.adjoint == pytest.approx(change, rel=tolerance)
    assert found.elements["beam"].sum() == pytest.approx(found.adjoint, rel=1e-9)
    assert len(found.elements["beam"]) == 6


def test_the_adjoint_attributes_errors_to_bodies_like_refining_each_alone():
    loaded = case(TWO)
    counts = {"post": 2, "arm": 2}
    coarse = with_setting(loaded, Setting(counts))
    solved = solve_for_goal(coarse)
    found = weighted(coarse, solved)
    for name, n in counts.items():
        finer = solve_for_goal(with_setting(loaded, Setting({**counts, name: 2 * n})))
        assert found.elements[name].sum() == pytest.approx(finer.answer.value - solved.answer.value, rel=0.1)
    # the moment is largest at the post
    near, far = abs(found.elements["arm"])
    assert near > far


def test_forces_without_potential_have_no_adjoint():
    follower = case(CANTILEVER, "{type: cable, count: 3}",
                    "loads.0={type: follower_force, at: beam@1, value: [0, -500e3]}")
    coarse = with_setting(follower, Setting({"beam": 4}))
    assert weighted(coarse, solve_for_goal(coarse)) is None


@pytest.mark.parametrize("element", ["omar", "kerkkanen", "vallejo", "cable", "reissner2", "reissner3", "2d2n-nu",
                                     "2d3n-nu"])
def test_types_have_the_order_by_which_meshes_are_chosen(element):
    """Errors of the strain energy under a load along the beam fall at least with the order of the type."""
    loaded = case(CANTILEVER, f"{{type: {element}, count: 2}}", "solver.type=linear_static",
                  "loads.0={type: distributed, on: beam, value: [0, -3e4]}", "goal={quantity: strain_energy}")
    promised = order_of(registry.element_type(element))
    values = [solve_for_goal(with_setting(loaded, Setting({"beam": n}))).answer.value for n in (4, 8, 16)]
    first, second = abs(values[1] - values[0]), abs(values[2] - values[1])
    assert second <= max(first * 2.0 ** -(promised - 0.35), 1e-9 * abs(values[-1]))


def level(value: float) -> Level:
    return Level(Setting({"beam": 4}), "", GoalValue(value, 1.0))


@pytest.mark.parametrize("order", [1.0, 2.0, 3.0, 4.0])
def test_neighbours_estimate_the_error_of_a_power_law(order):
    """f = 1 + h^p/100: estimates are the safety factor times the true error, of the finest mesh twice it."""
    found = verdict_of(*(level(1.0 + 0.01 * (2.0**-k) ** order) for k in range(3)), 4.0)
    assert found.error == pytest.approx(SAFETY * 0.01 * 2.0**-order, rel=1e-9)
    assert 0.01 * 4.0**-order < found.finer_error <= 5 * 0.01 * 4.0**-order
    assert found.estimate.value == pytest.approx(1.0, abs=1e-12)
    assert found.estimate.order == pytest.approx(order, rel=1e-9)


@pytest.mark.parametrize("order", [1.0, 2.0, 3.0, 4.0, 6.0])
def test_a_finer_mesh_alone_bounds_the_error_of_every_order(order):
    """f = 1 + h^p/100: the estimate is 1.25 to 2.5 times the error of the coarser mesh.

    That of the finer one is not below its error.
    """
    found = verdict_of_two(*(level(1.0 + 0.01 * (2.0**-k) ** order) for k in (1, 2)))
    assert SAFETY * 0.01 * 2.0**-order <= found.error * (1 + 1e-12) <= 2.0 * SAFETY * 0.01 * 2.0**-order
    assert found.finer_error >= SAFETY * 0.01 * 4.0**-order * (1 - 1e-12)
    assert found.estimate.order is None


def test_meshes_that_agree_by_chance_are_not_believed():
    """The finer mesh has the same value, the coarser one differs: its difference counts at the type's order."""
    found = verdict_of(level(1.064), level(1.0), level(1.0 - 1e-12), 4.0)
    assert found.error >= 0.064 / 2.0**6
    assert verdict_of(level(0.8), level(0.8001), level(0.95), 4.0) is None
    assert verdict_of(level(0.9), level(1.1), level(0.95), 4.0) is None
    assert verdict_of(level(1.0), level(1.0), level(1.0), 4.0).error == 0.0


TENSE = CANTILEVER.replace("height: 0.1, width: 0.1}", "EA: 1e7, kGA: 1e7, EI: 0.01}").replace(
    "material: {E: 2.07e11, nu: 0.3, rho: 7850}, ", "").replace(
    "{type: clamp, at: beam@0}", "{name: wall, type: clamp, at: beam@0}, {type: roller, at: beam@1, fixed: y}, "
    "{type: fix, at: beam@1, coordinates: [rx_y]}").replace(
    "value: [0, -500e3]}", "value: [1e3, 0]}, {type: distributed, on: beam, value: [0, -1e-3]}").replace(
    "goal: {probe: tip, quantity: uy}", "goal: {probe: root, quantity: M}").replace("tip: beam@1", "root: beam@0")


def test_finer_neighbours_alone_are_solved_until_a_layer_shows():
    """The moment on the first meshes has errors of factors; errors are relative to the value of each mesh."""
    loaded = case(TENSE.replace("rx_y", "theta"), "{type: reissner3, count: 2}",
                  "accuracy=1e-2")
    found = solve_to_accuracy(loaded).accuracy
    u = 0.5 * 2.0 * np.sqrt(1e3 / 0.01)
    exact = -1e-3 * (u - 1.0) / u**2
    assert abs(found["path"][0]["value"] / exact) > 2.0
    assert abs(found["value"] / exact - 1.0) <= found["estimate"] <= 1e-2
    # a mesh is only solved with its load steps if it is judged: the first one, and the result
    assert sum(level["iterations"] > 20 for level in found["path"]) == 2


def test_elements_are_short_in_the_layer_that_the_goal_depends_on():
    """A beam clamped at both ends under tension T bends within sqrt(EI/T) of them.

    M = q L^2/4 (u - tanh u)/(u^2 tanh u), u = L/2 sqrt(T/EI) (Timoshenko & Gere 1961, section 1.11).
    """
    found = solve_to_accuracy(case(TENSE, "{type: cable, count: 2}", "accuracy=1e-3")).accuracy
    assert found["achieved"]
    u = 0.5 * 2.0 * np.sqrt(1e3 / 0.01)
    assert found["value"] == pytest.approx(-1e-3 * (u - 1.0) / u**2, rel=1e-3)
    lengths = np.diff(found["nodes"]["beam"])
    assert lengths[0] <= lengths.max() / 8
    # the layer at the other end has no part in the moment at this one
    assert lengths[-1] >= 4 * lengths[0]
    # the mesh as it is told gives the same value
    nodes = {"beam": tuple(found["nodes"]["beam"])}
    again = with_setting(case(TENSE, "{type: cable, count: 2}"), Setting(found["elements"], nodes=nodes))
    assert solve_for_goal(again).answer.value == pytest.approx(found["value"], rel=1e-9)


@pytest.mark.parametrize("goal", [
    "{probe: tip, quantity: uy}", "{probe: tip, quantity: theta}", "{quantity: strain_energy}",
    *(f"{{reaction: foot, quantity: {q}}}" for q in ("fx", "fy", "m"))])
@pytest.mark.parametrize("solver", ["static", "linear_static"])
def test_gradients_of_goals_need_no_differences(goal, solver):
    loaded = case(TWO, "", "boundary_conditions.0.name=foot", f"goal={goal}", f"solver.type={solver}")
    mesh = with_setting(loaded, Setting({"post": 2, "arm": 3}))
    solved = solve_for_goal(mesh)
    equilibrium = Equilibrium(solved.model, solved.state, solver == "linear_static")
    J, z = GoalOf(loaded.case.goal, equilibrium), equilibrium.z
    differences = [J.slope(z, way) for way in np.eye(len(z))]
    assert J.by_formula(z) == pytest.approx(differences, rel=1e-4, abs=1e-6 * np.abs(differences).max())


MODES = ("solver={type: eigen, modes: 12}", "goal={kind: bending, number: 3}", "loads=[]")


def test_neighbours_of_a_neighbour_with_few_modes_are_not_whole_either():
    loaded = case(CANTILEVER, "{type: vallejo, count: 3}", *MODES)
    coarse = with_setting(loaded, Setting({"beam": 6}))
    solved = solve_for_goal(coarse)
    known, at = Neighbour(coarse, solved.model, [solved.state], True), Level(Setting({"beam": 6}), "", solved.answer)
    for elements in (12, 24):
        at, known = solve_neighbour(at, known, True)
        assert at.setting.counts == {"beam": elements}
        assert len(known.state.report["frequencies"]) < 12
        assert not known.whole
