"""Error against cost: errors from closed forms and finer solutions, counted costs, budgets by the clock of the test."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from jobs import BENDING, CANTILEVER, SHEAR

from ancf2d.case import LoadedCase, load_case_text
from ancf2d.errors import CaseError, ComputationError
from ancf2d.study.goal import GoalValue, solve_for_goal
from ancf2d.study.pool import ALONE
from ancf2d.study.run import vocabulary
from ancf2d.study.tradeoff.measure import Measured
from ancf2d.study.tradeoff.plan import Choice, Limit, Planner, limit
from ancf2d.study.tradeoff.study import Row, TradeoffStudy, accuracy_name, tradeoff
from ancf2d.study.variants import Variant, parse_variants

THICK = """\
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.2, width: 0.1}
    material: {E: 1.0e9, nu: 0.3, rho: 1000}
    element: {type: vallejo, count: 4}
boundary_conditions:
  - {name: left, type: pin, at: beam@0}
  - {name: right, type: roller, at: beam@1, fixed: y}
solver: {type: eigen, modes: 3}
goal: {kind: bending, number: 1}
"""
SWING = """\
bodies:
  rod:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {EA: 5e3, kGA: 2e3, EI: 4.0, rhoA: 5, rhoI: 4e-3}
    element: {type: cable, count: 2}
boundary_conditions: [{type: pin, at: rod@0}]
loads: [{type: gravity, value: [0, -9.81]}]
initial: {rotation_rate: {omega: 1, about: [0, 0]}}
solver: {type: dynamic, t_end: 0.1, tolerance: 1e-6}
goal: {probe: tip, quantity: y}
output: {interval: 0.02, probes: {tip: rod@1}}
"""


def load(text: str = CANTILEVER, *overrides: str) -> LoadedCase:
    return load_case_text(text, overrides=overrides, vocabulary=vocabulary())


def chosen(types: str = "reissner2", **more: Any) -> Choice:
    return Choice(variants=tuple(parse_variants(types)), **{"repeat": 1, **more})


def ticking(step: float) -> Callable[[], float]:
    """Return a clock that advances by ``step`` at every reading."""
    moment = [0.0]

    def now() -> float:
        moment[0] += step
        return moment[0]
    return now


def studied(study: TradeoffStudy, element: str) -> Sequence[Row]:
    return [row for row in study.rows if row.measured.element == element]


def test_errors_are_those_of_the_closed_form() -> None:
    """Tip deflection F L^3/(3 EI) (1 - 1/(4 n^2)) + F L/kGA.

    Source: Hughes, Taylor & Kanoknukulchai, IJNME 11 (1977) 1529, the one-point element on a tip force.
    """
    study = tradeoff(load(), chosen(meshes=(2, 4, 8)))
    assert [row.measured.elements for row in study.rows] == [2, 4, 8]
    for row in study.rows:
        assert row.error == pytest.approx(BENDING / (4 * row.measured.elements**2) / (BENDING + SHEAR), rel=1e-4)
        assert row.measured.wall_s is not None
        assert row.measured.wall_s > 0
        assert row.measured.memory is not None
        assert row.measured.memory > 0
    assert study.series[0].limit.answer is not None
    assert study.series[0].limit.answer.value == pytest.approx(BENDING + SHEAR, rel=1e-8)


def test_an_error_near_that_of_its_reference_is_only_bounded() -> None:
    """Cubic elements are exact at their nodes: only round-off remains, in the reference as in the rows."""
    study = tradeoff(load(), chosen("cable", meshes=(1, 2, 4)))
    for row in study.rows:
        assert row.error is None
        assert row.error_below is not None
        assert row.error_below < 1e-9
        assert row.judged == row.error_below
        assert row.as_json()["error"] is None
    assert study.recommended(1e-4) is not None


@pytest.mark.parametrize(("error", "told"), [(9.9e-6, False), (1.01e-5, True)])
def test_errors_are_given_from_ten_times_that_of_the_reference(error: float, told: bool) -> None:
    reference = Limit(GoalValue(1.0, 1.0), 1e-6)
    assert reference.resolves(reference.error(GoalValue(1.0 + error, 1.0))) is told
    assert not Limit(GoalValue(1.0, 1.0), math.inf).resolves(1.0)
    assert not Limit(note="unknown").resolves(math.inf)


def test_without_finer_meshes_the_finest_rows_have_no_error() -> None:
    """With a budget that ends after three meshes, the third is as fine as its own reference."""
    done: list[float] = []
    study = tradeoff(load(), chosen(meshes=(2, 4, 8), budget=10.0), done=lambda share, left: done.append(share),
                     clock=lambda: 4.0 * len(done))
    assert [row.measured.elements for row in study.rows] == [2, 4, 8]
    assert study.rows[0].error is not None
    assert study.rows[2].error is None
    assert study.rows[2].error_below is not None


@pytest.mark.parametrize(("values", "known"), [((1.0, 1.1, 1.11, 1.2, 1.25), False),
                                               ((1.0, 1.5, 1.7, 1.8, 1.85), True)])
def test_diverging_answers_have_no_known_limit(values: tuple[float, ...], known: bool) -> None:
    planned = Planner(load(), chosen(meshes=(2, 4, 8)), ALONE).series()[0]
    for task, value in zip(planned.reference.tasks, values, strict=False):
        found = Measured(task, "reissner2", "", task.elements, answer=GoalValue(value, value))
        planned.reference.record(found)
    assert limit(planned).known is known


def test_errors_against_a_given_number() -> None:
    study = tradeoff(load(), chosen(meshes=(2, 4), reference=BENDING))
    for row in study.rows:
        assert row.measured.answer is not None
        assert row.error == pytest.approx(abs(row.measured.answer.value - BENDING) / abs(BENDING), rel=1e-12)
    assert study.as_json()["against"] == "reference"


def test_refused_type_is_a_row_with_the_reason() -> None:
    wrong = Variant("cable", None, "structural")
    study = tradeoff(load(), Choice(variants=(Variant(), wrong), meshes=(2, 4), repeat=1))
    refused = [row.as_json() for row in study.rows if row.measured.status == "refused"]
    assert len(refused) == 1
    assert refused[0]["element"] == "cable"
    assert "no formulation structural" in refused[0]["reason"]
    assert refused[0]["error"] is None
    assert not refused[0]["pareto"]
    assert len(studied(study, "reissner2")) == 2
    with pytest.raises(CaseError, match="no formulation structural"):
        tradeoff(load(), Choice(variants=(wrong,)))


@pytest.mark.slow
def test_json_is_the_contracts_object_and_its_overrides_give_what_they_promise() -> None:
    study = tradeoff(load(), chosen("reissner2,cable,2d2n", meshes=(2, 4, 8), accuracies=(1e-2, 1e-30)))
    found = study.as_json()
    keys = {"element", "formulation", "elements", "dofs", "value", "error", "wall_s", "memory_bytes", "pareto"}
    assert all(keys <= set(row) for row in found["rows"])
    assert set(found["recommended"]) == {"1e-2", "1e-30"}
    assert found["recommended"]["1e-30"] is None
    best = found["recommended"]["1e-2"]
    assert {"element", "formulation", "elements", "error", "wall_s", "set"} <= set(best)
    again = solve_for_goal(load(CANTILEVER, *best["set"]))
    assert again.answer.value == best["value"]
    assert accuracy_name(1e-3) == "1e-3"
    assert accuracy_name(5e-4) == "5e-4"


def test_front_is_over_all_rows_by_error_and_time() -> None:
    study = tradeoff(load(), chosen("reissner2,reissner3", meshes=(2, 4, 8)))
    points = [(row.measured.wall_s, row.judged) for row in study.rows]
    for row, point in zip(study.rows, points, strict=True):
        assert row.pareto == (not any(p != point and p[0] <= point[0] and p[1] <= point[1] for p in points))


def test_a_study_ends_with_its_budget_and_lists_missing_rows() -> None:
    """A clock that advances by a second at every reading: fewer solutions than seconds."""
    choice = chosen("reissner2,cable", meshes=(2, 4, 8, 16), budget=5.0)
    study = tradeoff(load(), choice, clock=ticking(1.0))
    assert 0 < len(study.rows) < 5
    rows = [task for task in study.dropped if task.repeat]
    assert len(rows) + len(study.rows) == 8
    assert {"element", "elements", "for"} <= set(study.as_json()["dropped"][0])
    nothing = tradeoff(load(), chosen(meshes=(2, 4), budget=0.0))
    assert not nothing.converged
    assert nothing.as_json()["status"] == "failed"


def test_every_type_has_its_share_of_the_budget() -> None:
    study = tradeoff(load(), chosen("reissner2,reissner3,cable", meshes=(2, 4, 8, 16), budget=12.0), clock=ticking(1.0))
    assert all(studied(study, name) for name in ("reissner2", "reissner3", "cable"))


def test_default_meshes_double_in_the_proportions_of_the_case_and_end_where_nothing_changes() -> None:
    study = tradeoff(load(CANTILEVER, "bodies.beam.element.count=3"), chosen("cable"))
    assert [row.measured.elements for row in study.rows] == [2, 4]
    assert [row.measured.elements for row in tradeoff(load(), chosen()).rows] == [2, 4, 8, 16, 32, 64]


@pytest.mark.slow
def test_frequencies_are_judged_and_models_are_distinguished() -> None:
    study = tradeoff(load(THICK), chosen("cable,vallejo", meshes=(4, 8)))
    cable, vallejo = study.series
    assert study.continuum.known
    assert study.continuum_q == [1, 2, 3, 4]
    # Euler-Bernoulli leaves out shear and rotary inertia: pi^2/2 (1 + E/kG) (h/L)^2/12 of the first frequency
    assert cable.model_error == pytest.approx(math.pi**2 / 24 * (1 + 2.6 * 1.2) * 0.2**2, rel=0.2)
    assert vallejo.model_error is not None
    assert vallejo.model_error < 5e-3
    total = tradeoff(load(THICK), chosen("cable,vallejo", meshes=(4, 8), continuum=True))
    for row in total.rows:
        assert row.error is not None
        known = total.series[row.series]
        # what the model's error is not known better than counts as error too
        unsure = known.model_error < 10 * known.model_error_bar
        model = known.model_error + (known.model_error_bar if unsure else 0.0)
        assert row.judged == pytest.approx(row.error + model, rel=1e-12)
    assert total.recommended(1e-2) in studied(total, "vallejo")


def test_stiffnesses_have_no_continuum_reference() -> None:
    study = tradeoff(load(), chosen(meshes=(2, 4)))
    assert study.as_json()["continuum"] is None
    assert "stiffnesses" in study.continuum.note
    with pytest.raises(ComputationError, match="stiffnesses"):
        tradeoff(load(), chosen(meshes=(2, 4), continuum=True))


@pytest.mark.slow
def test_motion_is_judged_over_integrators_steps_and_meshes() -> None:
    choice = chosen("cable", meshes=(2, 4), methods=("generalized_alpha", "radau5"), key="dt", steps=(2e-3, 1e-3))
    study = tradeoff(load(SWING), choice)
    rows = {(r.task.setting.method, r.task.setting.step, r.measured.elements): r for r in study.rows}
    assert len(rows) == 8
    # with meshes as coarse as two elements, steps do not matter to the fifth-order method
    errors = [rows["radau5", dt, 2].error for dt in (2e-3, 1e-3)]
    assert errors[0] == pytest.approx(errors[1], rel=0.05)
    fine = solve_for_goal(load(SWING, "bodies.rod.element.count=8", "solver.tolerance=1e-8")).answer
    for row in study.rows:
        assert row.measured.answer is not None
        assert len(row.measured.answer.course) == 6
        expected = row.measured.answer.distance(fine) / fine.size
        assert row.error == pytest.approx(expected, rel=0.1) or row.error_below >= expected
    best = study.as_json()["recommended"]["1e-2"]
    assert {"method", "dt"} <= set(best)
    again = solve_for_goal(load(SWING, *best["set"]))
    assert again.answer.value == best["value"]


def test_steps_and_integrators_of_a_static_case_are_refused() -> None:
    with pytest.raises(CaseError, match="no integrator to choose"):
        tradeoff(load(), chosen(key="dt", steps=(1e-3,)))
    with pytest.raises(CaseError, match="no goal"):
        tradeoff(load(CANTILEVER.replace("goal: {probe: tip, quantity: uy}\n", "")), chosen())
