"""Convergence of real cases, compared with the mathematics of their elements."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import pytest
from jobs import BENDING, CANTILEVER, EI, KGA, SHEAR, SQUARE, F, L

from ancf2d.case import Dynamic, LoadedCase, Static, load_case_text
from ancf2d.errors import CaseError
from ancf2d.study.convergence import Convergence, Row, Series, Steps, _with_note, convergence, limit_of
from ancf2d.study.goal import GoalValue, error_scale, sequence, smallest_scale
from ancf2d.study.order import estimate
from ancf2d.study.pool import Workers
from ancf2d.study.run import Progress, checks, run_case, vocabulary
from ancf2d.study.variants import Variant, parse_variants


def load(text: str = CANTILEVER, *overrides: str) -> LoadedCase:
    return load_case_text(text, overrides=overrides, vocabulary=vocabulary())


def values(study: Convergence) -> list[float | None]:
    return [row.value for row in study.rows]


def test_linear_elements_with_one_point_converge_like_their_closed_form() -> None:
    """Tip deflection F L^3/(3 EI) (1 - 1/(4 n^2)) + F L/kGA.

    Source: Hughes, Taylor & Kanoknukulchai, IJNME 11 (1977) 1529, the one-point element on a tip force.
    """
    study = convergence(load(), meshes=[2, 4, 8, 16])
    for row in study.rows:
        assert row.value == pytest.approx(BENDING * (1 - 1 / (4 * row.elements**2)) + SHEAR, rel=1e-10)
        assert row.dofs == 3 * (row.elements + 1)
        assert row.error == pytest.approx(abs(BENDING / (4 * row.elements**2)) / abs(BENDING + SHEAR), rel=1e-6)
        assert row.wall_s is not None
        assert 0 < row.wall_s < 1
    found = study.series[0].estimate
    assert found.order == pytest.approx(2.0, abs=1e-6)
    assert found.value == pytest.approx(BENDING + SHEAR, rel=1e-9)
    assert found.asymptotic
    assert [row.order for row in study.rows[:2]] == [None, None]
    assert [row.order for row in study.rows[2:]] == pytest.approx([2.0, 2.0], abs=1e-6)


def test_uneven_meshes_give_the_same_limit() -> None:
    found = convergence(load(), meshes=[3, 4, 7, 15]).series[0].estimate
    assert found.order == pytest.approx(2.0, abs=1e-6)
    assert found.value == pytest.approx(BENDING + SHEAR, rel=1e-9)


def test_errors_and_orders_against_a_given_reference() -> None:
    study = convergence(load(), meshes=[2, 4, 8], reference=BENDING)
    for row in study.rows:
        assert row.value is not None
        assert row.error == pytest.approx(abs(row.value - BENDING) / abs(BENDING), rel=1e-12)
    assert study.rows[0].order is None
    assert study.rows[1].order is not None


def test_cubic_elements_are_exact_at_nodes_and_so_have_no_order() -> None:
    study = convergence(load(), parse_variants("cable"), [1, 2, 4, 8])
    assert values(study) == pytest.approx([BENDING] * 4, rel=1e-11)
    assert study.series[0].estimate.order is None
    assert "order undefined" in study.series[0].estimate.note


def test_slow_approach_is_not_called_asymptotic_and_its_bar_covers_the_limit() -> None:
    """2d3n locks on coarse meshes; the beam's deflection is still within its error bar."""
    found = convergence(load(), parse_variants("2d3n"), [4, 8, 16, 32]).series[0].estimate
    assert not found.asymptotic
    assert "not asymptotic" in found.note
    assert found.value is not None
    assert found.error_bar is not None
    assert abs(found.value - (BENDING + SHEAR)) < found.error_bar


def test_default_meshes_double_from_that_of_the_case() -> None:
    assert [row.elements for row in convergence(load()).rows] == [2, 4, 8, 16, 32]


@pytest.mark.slow
def test_values_do_not_depend_on_the_number_of_processes() -> None:
    text = CANTILEVER.replace("linear_static}", "static, steps: 2}")
    variants = parse_variants("reissner2,vallejo:structural")
    one = convergence(load(text), variants, [2, 4, 8])
    two = convergence(load(text), variants, [2, 4, 8], workers=Workers(2))
    assert values(one) == values(two)
    assert [s.estimate for s in one.series] == [s.estimate for s in two.series]


def test_overrides_of_the_case_hold_on_every_mesh() -> None:
    study = convergence(load(CANTILEVER, "loads.0.value=[0, -6]"), parse_variants("cable"), [1, 2])
    assert values(study) == pytest.approx([2 * BENDING] * 2, rel=1e-10)


def test_failed_meshes_are_rows_and_the_rest_is_judged() -> None:
    """One Newton iteration is not enough for bending on any of its meshes."""
    text = CANTILEVER.replace("linear_static}", "static, max_iterations: 1}").replace(str(F), "-600")
    study = convergence(load(text), meshes=[2, 4])
    assert [row.status for row in study.rows] == ["failed", "failed"]
    assert all(row.reason and row.value is None for row in study.rows)
    found = study.as_json()
    assert found["status"] == "failed"
    assert found["reason"]
    assert found["extrapolated"] is None


def test_bodies_are_refined_in_proportion_and_exceptions_are_reported() -> None:
    first = ("  first:\n    geometry: {type: line, start: [-1, 0], end: [0, 0]}\n"
             f"    section: {{EA: 1.0e6, kGA: {KGA}, EI: {EI}}}\n    element: {{type: reissner2, count: 1}}\n")
    half = CANTILEVER.replace("bodies:\n", "bodies:\n" + first)
    half = half.replace("at: beam@0}", "at: first@0}").replace(
        "loads:", "joints:\n  - {type: weld, between: [first@1, beam@0]}\nloads:")
    study = convergence(load(half), meshes=[2, 3, 4, 6, 12])
    assert [row.elements for row in study.rows] == [2, 3, 4, 6, 12]
    assert [w.split(" elements")[0] for w in study.warnings] == ["2", "4"]
    assert study.series[0].estimate.value == pytest.approx(F * 3.0**3 / (3 * EI) + F * 3.0 / KGA, rel=1e-3)


def test_json_is_the_contracts_object() -> None:
    found = convergence(load(), meshes=[2, 4, 8, 16]).as_json()
    assert set(found["rows"][0]) >= {"element", "elements", "dofs", "value", "error", "order", "wall_s"}
    assert found["rows"][0]["element"] == "reissner2"
    assert {"extrapolated", "error_bar", "order", "asymptotic"} <= set(found)
    several = convergence(load(), parse_variants("reissner2,cable"), [2, 4]).as_json()
    assert several["extrapolated"] is None
    assert [e["element"] for e in several["elements"]] == ["reissner2", "cable"]


def test_wrong_case_is_reported_where_it_is_wrong() -> None:
    with pytest.raises(CaseError, match="the case has no goal"):
        convergence(load(CANTILEVER.replace("goal: {probe: tip, quantity: uy}\n", "")))
    with pytest.raises(CaseError, match="free to turn") as error:
        convergence(load(CANTILEVER.replace("type: clamp", "type: pin")))
    assert error.value.problems[0].line > 0
    with pytest.raises(CaseError, match=r"--element cable:structural: .*no formulation structural"):
        convergence(load(), [Variant("cable", None, "structural")])


def test_error_of_a_small_value_is_relative_to_the_largest_of_its_kind() -> None:
    """The tip's ux is round-off compared with uy: judged against 1e-3 of the largest displacement."""
    loaded = load(CANTILEVER, "goal.quantity=ux")
    states = []
    outcome = run_case(loaded, progress=Progress(state=states.append))
    assert loaded.case.goal is not None
    d = states[0].d[:outcome.model.n_q]
    smallest = smallest_scale(loaded.case.goal, outcome.summary, outcome.model, d)
    assert smallest == pytest.approx(1e-3 * abs(outcome.summary["probes"]["tip"]["uy"]), rel=1e-6)
    assert error_scale(1e-20, smallest) == smallest
    assert error_scale(-5.0, smallest) == 5.0
    found = convergence(loaded, meshes=[2, 4, 8]).series[0].estimate
    assert "round-off" in found.note


def test_the_error_of_a_rotation_that_symmetry_forbids_is_relative_to_the_motion_of_the_model() -> None:
    """The middle of a simply supported beam does not rotate, and there is no other probe."""
    loaded = load(CANTILEVER.replace("type: clamp", "type: pin").replace("beam@1", "beam@0.5"), "goal.quantity=theta",
                  "boundary_conditions+={type: pin, at: beam@1}")
    assert "round-off" in convergence(loaded, meshes=[2, 4, 8]).series[0].estimate.note


def test_the_error_of_zero_displacements_is_zero() -> None:
    """Displacements of 1e-123 count as zero, though none of their digits agree between meshes."""
    loaded = load(CANTILEVER)
    outcome = run_case(loaded)
    assert loaded.case.goal is not None
    summary = {"probes": {"tip": {"ux": 0.0, "uy": -7e-123}}}
    smallest = smallest_scale(loaded.case.goal, summary, outcome.model, 0.0 * outcome.model.weights)
    assert 1e-16 * outcome.model.extent < error_scale(-7e-123, smallest) < 1e-3 * outcome.model.extent


def test_phases_on_both_sides_of_pi_are_neighbours() -> None:
    """Phases that tend to pi + 0.03 with order 2, each reported between -pi and pi."""
    wanted = [math.pi + 0.03 - 0.16 / 4**k for k in range(4)]
    told = [math.remainder(p, 2 * math.pi) for p in wanted]
    assert told[0] > 3 > -3 > told[-1]
    answers = [GoalValue(p, 3.0, period=2 * math.pi) for p in told]
    f = sequence(answers)
    found = estimate([2.0, 4.0, 8.0, 16.0], f, 3.0)
    limit = limit_of(answers, found, None)
    assert limit is not None
    assert found.order == pytest.approx(2.0)
    assert math.remainder(limit.value - 0.03 - math.pi, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert [a.distance(limit) for a in answers] == pytest.approx([0.16 / 4**k for k in range(4)])


def test_expected_value_that_is_not_computed_is_not_met() -> None:
    loaded = load(CANTILEVER + "expected: [{probe: tip, quantity: uy, value: -8.0e-3, rtol: 1}]\n")
    assert checks(loaded.case, {"probes": {"tip": {"uy": -8e-3}}})[0]["met"]
    missing = checks(loaded.case, {"probes": {}})[0]
    assert (missing["met"], missing["value"], missing["difference"]) == (False, None, None)


def test_a_custom_element_is_refined_too(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(
        "name: mine\nbasis: ['1', 'x', 'x^2', 'x^3']\nnodes: [{at: 0, coordinates: [r, r_x]}, {at: 1, coordinates: "
        "[r, r_x]}]\n")
    text = CANTILEVER.replace("{type: reissner2, count: 2}", "{definition: own.yaml, count: 2}")
    loaded = load_case_text(text, str(tmp_path / "case.yaml"), vocabulary=vocabulary(), directory=str(tmp_path))
    study = convergence(loaded, meshes=[2, 4])
    assert study.rows[0].element == "mine"
    assert values(study) == pytest.approx([BENDING] * 2, rel=1e-9)


SWING = """
bodies:
  rod:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.1, width: 0.05}
    material: {E: 1e6, nu: 0.3, rho: 1000}
    element: {type: cable, count: 2}
boundary_conditions: [{type: pin, at: rod@0}]
loads: [{type: gravity, value: [0, -9.81]}]
initial: {rotation_rate: {omega: 1, about: [0, 0]}}
solver: {type: dynamic, t_end: 0.3, tolerance: 1e-7}
goal: {probe: tip, quantity: y}
output: {interval: 0.02, probes: {tip: rod@1}}
"""


def test_motion_converges_over_time_steps_with_the_order_of_its_integrator() -> None:
    study = convergence(load_case_text(SWING + "\n", vocabulary=vocabulary(), overrides=(
        "solver.method=generalized_alpha",)), steps=Steps("dt", (2e-3, 1e-3, 5e-4, 2.5e-4)))
    assert study.over == "dt"
    assert [row.step for row in study.rows] == [2e-3, 1e-3, 5e-4, 2.5e-4]
    assert study.rows[-1].order == pytest.approx(2.0, abs=0.1)
    # errors are the largest over time, relative to the largest displacement, against the extrapolated course
    fine = convergence(load_case_text(SWING, vocabulary=vocabulary()), steps=Steps("tolerance", (1e-11,))).rows[0]
    assert fine.answer is not None
    for row in study.rows:
        assert row.answer is not None
        assert row.error == pytest.approx(row.answer.distance(fine.answer) / fine.answer.size, rel=0.1)


def test_motion_converges_over_meshes() -> None:
    study = convergence(load_case_text(SWING, vocabulary=vocabulary()), meshes=[2, 4, 8, 16])
    errors = [row.error for row in study.rows]
    # the start is sudden: waves of all lengths keep the order below the four of smooth motion
    assert all(coarse > 5 * fine for coarse, fine in itertools.pairwise(errors))
    assert study.rows[-1].order > 2.5
    assert len(study.rows[0].answer.course) == 16


def test_time_steps_of_a_static_case_are_refused() -> None:
    text = SWING.replace("{type: dynamic, t_end: 0.3, tolerance: 1e-7}", "{type: static}").replace(
        "initial: {rotation_rate: {omega: 1, about: [0, 0]}}\n", "").replace("interval: 0.02, ", "")
    with pytest.raises(CaseError, match="no time steps to refine"):
        convergence(load_case_text(text, vocabulary=vocabulary()), steps=Steps("dt", (1e-3,)))


def test_kinks_inside_elements_are_reported_with_regular_nodes() -> None:
    """With nodes at the load the first mesh is exact; without, a kink inside elements spoils the order."""
    between = CANTILEVER.replace("beam@1", "beam@0.3").replace("reissner2", "reissner3")
    acting, regular = (convergence(load(between.replace("count: 2", f"count: 2, nodes: {nodes}")), meshes=[4, 8, 16])
                       for nodes in ("acting", "regular"))
    a = 0.3 * L
    exact = F * a**3 / (3 * EI) + F * a / KGA
    assert values(acting) == pytest.approx([exact] * 3, rel=1e-8)
    assert not acting.warnings
    assert abs(regular.rows[0].value / exact - 1) > 1e-5
    assert any("inside elements of some meshes" in text for text in regular.warnings)


@pytest.mark.parametrize(("apart", "told"), [(1e-5, True), (1e-2, False)])
def test_mesh_differences_below_the_error_of_time_steps_are_reported(apart: float, told: bool) -> None:
    """Growing differences, below and above a hundred times the tolerance of the steps, 1e-5."""
    values = [1.0, 1.0 + apart / 3, 1.0 - apart]
    rows = [Row("reissner3", "", n, answer=GoalValue(x, 1.0)) for n, x in zip((2, 4, 8), values, strict=True)]
    series = Series(rows, estimate([2.0, 4.0, 8.0], values, 1.0), None)
    assert not series.estimate.asymptotic
    note = _with_note(series, Dynamic(t_end=1.0, tolerance=1e-5)).note
    assert ("errors of the time steps" in note) == told
    assert ("--set solver.tolerance=1e-08" in note) == told
    assert ("finer meshes are needed" in note) != told
    assert _with_note(series, Static()).note == series.estimate.note


def rigid(solver: str) -> LoadedCase:
    """A rigid bar on a torsion spring."""
    text = SQUARE.replace("reissner3, count: 2", "rigid").replace("type: clamp", "type: pin")
    text = text.replace("material: {E: 2.07e11, nu: 0.3}", "material: {E: 2.07e11, nu: 0.3, rho: 7850}")
    text += "springs: [{type: rotational, between: [b@0, [0, 0]], stiffness: 100}]\n"
    return load_case_text(text.replace("{type: linear_static}", solver), vocabulary=vocabulary())


def test_rigid_bodies_have_no_mesh_to_refine_but_their_motions_have_steps() -> None:
    from ancf2d.study.tradeoff.plan import Choice
    from ancf2d.study.tradeoff.study import tradeoff

    with pytest.raises(CaseError, match="every body is rigid, so there is no mesh to refine"):
        convergence(rigid("{type: static}"))
    with pytest.raises(CaseError, match="every body is rigid, so there is no mesh to refine"):
        tradeoff(rigid("{type: static}"), Choice())
    study = convergence(rigid("{type: dynamic, t_end: 0.1, tolerance: 1e-4}"), steps=Steps("tolerance", (1e-3, 1e-5)))
    assert [row.status for row in study.rows] == ["converged", "converged"]


def test_an_accuracy_is_reached_without_any_mesh() -> None:
    from ancf2d.study.accuracy.control import solve_to_accuracy

    loaded = rigid("{type: static}")
    pursued = load_case_text(loaded.text, overrides=["accuracy=1e-6"], vocabulary=vocabulary())
    accuracy = solve_to_accuracy(pursued, None).outcome.summary["accuracy"]
    assert accuracy["achieved"]
    assert accuracy["estimate"] == 0.0
