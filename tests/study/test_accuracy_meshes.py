"""The series of meshes towards a required accuracy, its error estimate, and the chosen mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import pytest
from pursued import BETWEEN, CANTILEVER, SLIDE, SWING, case

from ancf2d.case import LoadedCase, load_case_text
from ancf2d.errors import ComputationError
from ancf2d.study.accuracy.estimates import SAFETY, best, choose, judge
from ancf2d.study.accuracy.mesh import Ladder
from ancf2d.study.accuracy.pursuit import EstimateOf, Pursuit, tenth
from ancf2d.study.accuracy.setting import Level, Setting, least
from ancf2d.study.goal import GoalValue, solve_for_goal
from ancf2d.study.record import Progress
from ancf2d.study.run import run_case


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_estimates_of_a_power_law(order):
    """f = 1 + n^-p: the estimate is the safety factor times the true error of the last mesh."""
    levels = [Level(Setting({"b": n}), "", GoalValue(1.0 + n**-order, 1.0)) for n in (2, 4, 8, 27)]
    found, error = judge(levels)
    assert found.order == pytest.approx(order, rel=1e-6)
    assert error == pytest.approx(SAFETY * 27**-order, rel=1e-6)


def test_a_known_level_is_not_solved_again():
    pursuit = Pursuit(case(CANTILEVER), 1e-3, Progress())
    first = pursuit.solve(Setting({"beam": 2}), "once")
    assert pursuit.solve(Setting({"beam": 2}), "twice") is first
    assert len(pursuit.levels) == 1


def test_a_goal_that_no_mesh_has_is_reported_with_the_reason():
    """A bar in tension does not buckle."""
    pulled = load_case_text(CANTILEVER.replace("ELEMENT", "{type: cable, count: 2}").replace("[0, -500e3]", "[1, 0]")
                            .replace("type: static", "type: buckling, modes: 1")
                            .replace("goal: {probe: tip, quantity: uy}", "goal: {load_factor: 1}"))
    with pytest.raises(ComputationError, match="does not compute load factor 1: 0 positive load factors were found"):
        solve_for_goal(pulled)


def test_the_series_ends_when_finer_meshes_lack_the_goal():
    """One element has a shear mode among its first ten; finer meshes have slower modes instead."""
    beam = load_case_text(CANTILEVER.replace("ELEMENT", "{type: vallejo, count: 2}")
                          .replace("type: static", "type: eigen, modes: 10")
                          .replace("goal: {probe: tip, quantity: uy}", "goal: {kind: shear, number: 1}"))
    pursuit, told = Pursuit(beam, 1e-3, Progress()), []
    Ladder(pursuit, {}, None).climb(1e-3)
    assert pursuit.levels[0].answer is not None
    assert pursuit.levels[-1].setting.elements <= 64
    assert "shear 1 is not among the 10 modes found" in pursuit.levels[-1].reason
    run_case(beam, progress=Progress(warn=told.append))
    assert sum("the goal has no value: shear 1" in text for text in told) == 1


def levels_of(values: dict[int, float]) -> list[Level]:
    return [Level(Setting({"b": n}), "", GoalValue(value, 1.0)) for n, value in values.items()]


def test_first_meshes_that_agree_by_chance_are_not_taken_for_round_off():
    _, error = judge(levels_of({1: 0.8, 2: 0.8, 4: 0.95}))
    assert error > 0.05


def test_values_that_alternate_about_their_limit_have_an_estimate():
    found, error = judge(levels_of({2: 1.1, 4: 0.98, 8: 1.004}))
    assert found.order is None
    assert 0.004 <= error <= 0.04


def test_the_coarsest_sufficient_mesh_is_chosen_and_finer_ones_prove_it():
    levels = levels_of({n: 1.0 + n**-2 for n in (2, 4, 8, 16)})
    level, error, _ = choose(levels, 0.08)
    assert level is levels[1]
    assert 4**-2 <= error <= 1.2 * 4**-2
    assert choose(levels, 1e-6)[0] is levels[-1]
    assert choose([], 1.0)[0] is None


class Invented(Pursuit):
    """A search whose answers are a function of elements and tolerance."""

    def __init__(self, loaded: LoadedCase, answer: Callable[[int, float | None], float]) -> None:
        super().__init__(loaded, 1e-3, Progress())
        self.answer = answer

    def solve(self, setting: Setting, why: str, estimate_of: EstimateOf | None = None) -> Level:
        level = Level(setting, why, GoalValue(self.answer(setting.elements, setting.tolerance), 1.0), iterations=10)
        self.levels.append(level)
        return level


def test_a_goal_without_a_limit_is_abandoned():
    """f = 1 + log n: differences never fall."""
    pursuit = Invented(case(CANTILEVER, "{type: cable, count: 1}"), lambda n, tolerance: 1.0 + math.log(n))
    _, error, found = Ladder(pursuit, {}, None).climb(1e-3)
    assert error > 1e-3
    assert "have not reduced the error" in found.note
    assert len(pursuit.levels) < 10


def test_a_mesh_that_costs_too_much_is_not_solved():
    pursuit = Invented(case(CANTILEVER, "{type: cable, count: 1}"), lambda n, tolerance: 1.0 + n**-1.0)
    _, error, found = Ladder(pursuit, {}, None).climb(1e-9)
    assert error > 1e-9
    assert "more than 200000 elements would be needed" in found.note
    assert max(level.setting.elements for level in pursuit.levels) <= 200_000


def test_smaller_steps_are_used_if_meshes_differ_because_of_them():
    """f = 1 + n^-4 + an error of the tolerance, of alternating sign: meshes alone would never converge."""
    def answer(n: int, tolerance: float | None) -> float:
        assert tolerance is not None
        return 1.0 + n**-4.0 + 30.0 * tolerance * math.cos(2.0 * n)

    pursuit = Invented(case(SWING), answer)
    ladder = Ladder(pursuit, {}, 1e-3)
    level, error, _ = ladder.climb(1e-3)
    assert error <= 1e-3
    assert level is not None
    assert level.setting.tolerance <= 1e-4
    assert any("time steps cause" in tried.why for tried in pursuit.levels)


def test_leaps_keep_the_nodes_of_the_mesh_before_the_last():
    """f = 1 + n^-3: the mesh predicted from the order is rounded up to halves of the last one."""
    pursuit = Invented(case(CANTILEVER.replace("static", "linear_static"), "{type: cable, count: 1}"),
                       lambda n, tolerance: 1.0 + n**-3.0)
    Ladder(pursuit, {}, None).climb(1e-7)
    counts = [level.setting.elements for level in pursuit.levels]
    assert counts[:4] == [1, 2, 4, 8]
    assert all(2 * fine % coarse == 0 for coarse, fine in pairwise(counts))
    assert max(pairwise(counts), key=lambda pair: pair[1] / pair[0])[1] > 2 * 8


def test_the_best_is_kept_if_round_off_spoils_finer_meshes():
    levels = levels_of({1: 1.1, 2: 1.025, 4: 1.00625, 8: 1.0015625, 16: 1.0004, 32: 1.5})
    assert choose(levels, 1e-6)[0] is levels[-1]
    level, error, _ = best(levels, 1e-6)
    assert level is levels[-2]
    assert 4e-4 <= error <= 4e-3
    # what nothing spoilt is the finest
    assert best(levels[:-1], 1e-6)[0] is levels[-2]


def test_a_tenth_has_no_more_digits_than_the_whole():
    assert [tenth(1e-3), tenth(tenth(1e-3)), tenth(3e-7)] == [1e-4, 1e-5, 3e-8]


def test_polylines_begin_with_elements_of_one_length():
    text = CANTILEVER.replace("{type: line, start: [0, 0], end: [2, 0]}",
                              "{type: polyline, points: [[0, 0], [0, 3], [2, 3]]}")
    assert least(case(text).case.bodies["beam"]) == 5
    odd = text.replace("[2, 3]", "[2.7182818, 3]")
    assert least(case(odd).case.bodies["beam"]) == 2


def test_a_body_begins_with_stretches_of_equal_elements_and_refines_those() -> None:
    loaded = case(BETWEEN)
    assert least(loaded.case.bodies["beam"], (0.0, 0.3, 1.0)) == 3
    assert least(loaded.case.bodies["beam"], (0.0, 0.25, 1.0)) == 4
    ladder = Ladder(Pursuit(loaded, 1e-3, Progress()), {}, None)
    assert [ladder.setting(s).elements for s in (1.0, 1.5, 2.0, 6.0)] == [3, 6, 6, 18]


@pytest.mark.parametrize(("kind", "on", "kinks"), [("rigid", "beam", True), ("rigid", "bead", False)])
def test_meshes_through_which_a_kink_moves_have_no_order(kind: str, on: str, kinks: bool) -> None:
    text = SLIDE.replace("KIND", kind)
    if on == "bead":
        text = text.replace("point: bead@1, on: beam", "point: beam@0.35, on: bead")
    pursuit = Pursuit(case(text), 1e-3, Progress())
    assert pursuit.slides(Ladder(pursuit, {}, None).setting(1.0)) == kinks


def test_an_error_that_kinks_hide_by_chance_is_not_believed():
    """Two meshes that agree, after two that did not: the difference of the latter counts."""
    levels = levels_of({4: 1.04, 8: 1.001, 16: 1.0011})
    assert judge(levels)[1] < 1e-3
    for level in levels:
        level.kinks = True
    found, error = judge(levels)
    assert error > 0.039
    assert not found.asymptotic
