"""Element types that the accuracy of a goal allows: what simpler models change, by virtual work."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pursued import CANTILEVER, TWO, case, limit

from ancf2d.case import load_case
from ancf2d.model.build import build_model
from ancf2d.study.accuracy.control import solve_to_accuracy
from ancf2d.study.accuracy.models import LEFT_OUT, Deformation, effects_of_strains
from ancf2d.study.accuracy.setting import Setting, with_setting
from ancf2d.study.goal import solve_for_goal
from ancf2d.study.variants import Variant

CABLE, RIGID = Variant("cable"), Variant("rigid")
PROPPED = ("boundary_conditions.0.name=wall", "boundary_conditions+={name: prop, type: roller, at: arm@1, fixed: y}",
           "loads.0={type: distributed, on: arm, value: [0, -1e5]}", "bodies.post.section.height=0.4")


@pytest.mark.parametrize("solver", ["static", "linear_static"])
@pytest.mark.parametrize(("body", "kind"), [("arm", CABLE), ("post", CABLE), ("post", RIGID)])
@pytest.mark.parametrize("sets", [(), ("goal.quantity=ux",), ("goal.quantity=theta", "output.probes.tip=arm@0.3"),
                                  (*PROPPED, "goal={reaction: prop, quantity: fy}"),
                                  (*PROPPED, "goal={reaction: wall, quantity: m}")])
def test_virtual_work_gives_the_change_of_a_simpler_model(solver, body, kind, sets):
    """dJ = -int N N*/EA + Q Q*/kGA + M M*/EI ds over the strains that the model leaves out, beside two solutions.

    Loads and the compliances left out are small, so that the goal depends linearly on them.
    """
    loaded = case(TWO, "", f"solver.type={solver}", "loads.0.value=[0, -5e3]", *sets)
    fine = {"post": 8, "arm": 16}
    reference = with_setting(loaded, Setting(fine))
    solved = solve_for_goal(reference)
    effect = effects_of_strains(reference, solved, [body])[body][list(LEFT_OUT[kind])].sum()
    simpler = {name: n for name, n in fine.items() if name != body or kind != RIGID}
    change = solve_for_goal(with_setting(loaded, Setting(simpler, {body: kind}))).answer.value - solved.answer.value
    assert -effect == pytest.approx(change, rel=0.02, abs=1e-9 * solved.answer.size)


@pytest.mark.parametrize("sets", [("goal={probe: tip, quantity: M}", "output.probes.tip=arm@0.1"),
                                  ("goal={quantity: strain_energy}",)])
def test_goals_that_depend_on_stiffness_itself_have_no_virtual_work(sets):
    loaded = with_setting(case(TWO, "", *sets), Setting({"post": 2, "arm": 4}))
    assert effects_of_strains(loaded, solve_for_goal(loaded), ["arm"]) is None


def test_an_open_type_in_statics_costs_one_solution_if_virtual_work_excludes_simpler_ones():
    found = solve_to_accuracy(case(CANTILEVER, "auto", "accuracy=1e-4")).accuracy
    assert found["types"]["beam"]["element"] == "reissner3"
    assert found["solves"] == 3


CASES = Path(__file__).parents[2] / "cases" / "dynamic"


def four_bar(*sets: str):
    """Return the linkage with open types, for a tenth of a second."""
    return load_case(CASES / "four_bar.yaml", ["solver.t_end=0.1", "output.interval=0.0025", *sets,
                                *(f"bodies.{name}.element=auto" for name in ("crank", "coupler", "rocker"))])


@pytest.mark.parametrize("height", [0.3, 1.0])
@pytest.mark.parametrize("force", [-1e5, -2e6])
@pytest.mark.parametrize("quantity", ["ux", "uy", "theta"])
def test_virtual_work_predicts_small_changes_at_large_loads(height, force, quantity):
    """The arm is bent by up to a right angle, so only the compliance of the post needs to be small."""
    loaded = case(TWO, "", f"loads.0.value=[0, {force}]", f"bodies.post.section.height={height}",
                  f"goal.quantity={quantity}")
    reference = with_setting(loaded, Setting({"post": 4, "arm": 8}))
    solved = solve_for_goal(reference)
    effect = effects_of_strains(reference, solved, ["post"])["post"].sum()
    rigid = solve_for_goal(with_setting(loaded, Setting({"arm": 8}, {"post": RIGID})))
    change = rigid.answer.value - solved.answer.value
    assert abs(change) < 0.03 * solved.answer.size
    assert -effect == pytest.approx(change, rel=0.05)


def test_rigid_bodies_on_redundant_supports_are_solved_if_their_reactions_are_wanted():
    """Elasticity distributes the moment of an arm over two clamps, however stiff the body between them is."""
    sets = ("boundary_conditions.0.name=wall", "boundary_conditions+={name: end, type: clamp, at: post@1}",
            "bodies.post.section.height=1", "accuracy=1e-2")
    text = TWO.replace("element: {type: reissner3, count: 1}", "element: auto")
    for goal, rigid in (("{reaction: end, quantity: m}", False), ("{probe: tip, quantity: uy}", True)):
        found = solve_to_accuracy(case(text, "", *sets, f"goal={goal}")).accuracy
        assert found["achieved"]
        assert (found["types"]["post"]["element"] == "rigid") == rigid


@pytest.mark.parametrize("quantity", ["uy", "theta"])
def test_types_of_a_motion_are_the_same_from_its_deformation_as_by_solving_each(quantity, monkeypatch):
    loaded = four_bar("accuracy=1e-3", f"goal.quantity={quantity}")
    foreseen = solve_to_accuracy(loaded).accuracy
    monkeypatch.setattr(Deformation, "effects", lambda self, goal: None)
    solved = solve_to_accuracy(loaded).accuracy
    assert {name: one["element"] for name, one in foreseen["types"].items()} == {
        name: one["element"] for name, one in solved["types"].items()} == {
        "crank": "rigid", "coupler": "cable", "rocker": "rigid"}
    assert foreseen["solves"] <= solved["solves"] - 3
    assert foreseen["achieved"]


def test_an_open_type_in_motion_costs_one_solution_if_its_deformation_excludes_simpler_ones():
    case = CASES / "pendulum2_reissner3.yaml"
    found = solve_to_accuracy(load_case(case, ["bodies.rod.element=auto", "accuracy=1e-2"])).accuracy
    assert found["types"]["rod"]["element"] == "reissner3"
    assert found["solves"] == 2


def test_a_body_that_moves_rigidly_keeps_its_shape_and_one_that_bends_does_not():
    """A deflection c sin(pi x/L) between nodes leaves a rigid body by its distance from the mean 2 c/pi."""
    model = build_model(with_setting(case(CANTILEVER, "{type: reissner3, count: 1}"), Setting({"beam": 64})))
    x, y = model.e0[0::3], model.e0[1::3]
    turned, bent = (np.zeros(model.n_q) for _ in range(2))
    turned[0::3], turned[1::3] = np.cos(1.0) * x - np.sin(1.0) * y - x + 3.0, np.sin(1.0) * x + np.cos(1.0) * y - y
    bent[1::3] = 1e-6 * np.sin(np.pi * (x - x.min()) / np.ptp(x))
    found = [Deformation(["beam"]) for _ in range(2)]
    for deformation, d in zip(found, (turned, bent), strict=True):
        list(deformation.watch(model, [SimpleNamespace(d=d)]))
    assert found[0].most["beam"] < 1e-12
    assert found[1].most["beam"] == pytest.approx(1e-6 * 2.0 / np.pi, rel=0.02)


@pytest.mark.parametrize("goal", ["{probe: tip, quantity: uy}", "{probe: tip, quantity: M}"])
def test_types_are_the_same_by_virtual_work_as_by_solving_each(goal):
    """A stiff post is rigid, a slender arm needs no shear; the error is that of the model with these types."""
    text = TWO.replace("element: {type: reissner3, count: 1}", "element: auto").replace("height: 0.2", "height: 2")
    loaded = case(text, "", "accuracy=1e-2", f"goal={goal}", "output.probes.tip=arm@0.9")
    found = solve_to_accuracy(loaded).accuracy
    assert {name: one["element"] for name, one in found["types"].items()} == {"post": "rigid", "arm": "cable"}
    exact = limit(case(text.replace("element: auto", "element: {type: reissner3, count: 1}"), "", f"goal={goal}",
                       "output.probes.tip=arm@0.9"), 64)
    assert abs(found["value"] - exact.value) <= found["estimate"] * exact.size
    assert np.isfinite(found["model_error"])
