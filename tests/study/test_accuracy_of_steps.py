"""Accuracy of goals that depend on steps: over time, and along paths with unloading fibres."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import helpers as h
import pytest

import ancf2d
from ancf2d.study.accuracy.steps import error_of_steps


@pytest.mark.parametrize("q", [0.5, 0.6, 2.0 / 3.0])
def test_changes_of_a_geometric_series_sum_to_its_rest(q: float) -> None:
    values = [1.0 - q**k for k in range(5)]
    moved = [b - a for a, b in pairwise(values)]
    for n in range(2, 5):
        assert error_of_steps(moved[:n]) == pytest.approx(1.0 - values[n])


def test_errors_of_steps_are_of_first_order_at_best_and_do_not_grow_for_ever() -> None:
    assert error_of_steps([0.3]) == pytest.approx(0.3)
    assert error_of_steps([1.0, 0.3]) == pytest.approx(0.5)
    assert error_of_steps([0.1, 0.1]) == error_of_steps([0.05, 0.1]) == pytest.approx(0.2)


def test_a_change_that_vanishes_by_accident_is_not_trusted() -> None:
    assert error_of_steps([0.4, 0.2, 0.0]) == pytest.approx(0.1)
    assert error_of_steps([0.0, 0.0, 0.0]) == 0.0


def test_accuracy_includes_steps_over_time() -> None:
    """A bar of one Maxwell term is loaded and unloaded: one element has no error of its own, steps have one.

    u(t) = F L/(E A) int J'(t - s) f(s) ds of the load f, a triangle of a second, with the creep
    J(t) = 1 - g/(1 + g) e^(-t/T), T = (1 + g) tau.
    """
    E, g, tau, area = 2.0e6, 0.5, 0.1, 1e-4
    T, share = (1.0 + g) * tau, g / (1.0 + g)
    case = {"bodies": {"bar": {"geometry": h.line(1.0), "section": {"height": 0.01, "width": 0.01},
                               "material": {"E": E, "nu": 0.3, "viscoelastic": [{"modulus": g, "time": tau}]},
                               "element": h.element("cable", 1)}},
            "boundary_conditions": [{"type": "clamp", "at": "bar@0"}],
            "loads": [{"type": "force", "at": "bar@1", "value": [0.1, 0],
                       "amplitude": {"type": "table", "t": [0, 0.5, 1], "value": [0, 1, 0]}}],
            "solver": {"type": "quasi_static", "t_end": 1, "tolerance": 0.5},
            "goal": {"probe": "end", "quantity": "ux"}, "output": {"probes": {"end": "bar@1"}}}

    def ramp(t: float) -> float:
        return t - share * T * (1.0 - math.exp(-t / T))

    exact = 0.1 / (E * area) * 2.0 * (ramp(1.0) - 2.0 * ramp(0.5))
    found = ancf2d.solve({**case, "accuracy": 1e-3}, states=False)
    assert found.accuracy["achieved"]
    assert 1e-8 < abs(found.value - exact) / found.accuracy["scale"] < found.accuracy["estimate"]


def truss(**solver: Any) -> dict[str, Any]:
    def bar(start: list[float], end: list[float]) -> dict[str, Any]:
        return {"geometry": {"type": "line", "start": start, "end": end}, "section": {"height": 0.01, "width": 0.01},
                "material": {"E": 2e11, "nu": 0.3, "yield": 2.5e8, "hardening": {"kinematic": 2e10}},
                "element": h.element("cable", 1)}

    return {"bodies": {"left": bar([0, 0], [1, 0.1]), "right": bar([1, 0.1], [2, 0])},
            "boundary_conditions": [{"name": "base", "type": "pin", "at": "left@0"}, {"type": "pin", "at": "right@1"}],
            "joints": [{"type": "pin", "between": ["left@1", "right@0"]}],
            "loads": [{"type": "force", "at": "left@1", "value": [0, -1000]}],
            "solver": {"type": "static", "method": "arc_length",
                       "until": {"probe": "top", "quantity": "uy", "reaches": -0.17}, **solver},
            "goal": {"reaction": "base", "quantity": "fy"}, "output": {"probes": {"top": "left@1"}}}


def test_accuracy_includes_steps_of_a_path() -> None:
    """Yielded bars unload as a truss snaps through: the reversal lies within a step."""
    exact = ancf2d.solve(truss(largest_step=0.004), states=False).value
    found = ancf2d.solve({**truss(), "accuracy": 2e-3}, states=False)
    assert found.accuracy["achieved"]
    assert found.accuracy["largest_step"] < 0.1
    assert abs(found.value / exact - 1.0) < found.accuracy["estimate"]


def test_steps_of_a_path_can_be_made_shorter() -> None:
    long, short = (ancf2d.solve(truss(largest_step=size), states=False).summary["steps"] for size in (0.1, 0.01))
    assert short > 2 * long


def test_steps_over_time_can_be_made_shorter() -> None:
    case = {**truss(), "solver": {"type": "quasi_static", "t_end": 1, "steps": 700}}
    case["loads"][0]["value"] = [0, -100]
    assert ancf2d.solve(case, states=False).summary["steps"] >= 700


@pytest.mark.parametrize(("solver", "told"), [
    ({"method": "displacement", "largest_step": 0.01}, "method displacement has no largest step"),
    ({"largest_step": 0}, "solver.largest_step must be")])
def test_steps_of_solvers_without_a_path_are_refused(solver: dict[str, Any], told: str) -> None:
    with pytest.raises(ancf2d.CaseError, match=told):
        ancf2d.load(truss(**solver))


def test_elastic_materials_have_no_error_of_steps() -> None:
    bar = {"geometry": h.line(1.0), "section": {"height": 0.01, "width": 0.01}, "element": h.element("cable", 1),
           "material": {"E": 2e11, "nu": 0.3, "stress_strain": {
               "strain": [0.00125, 0.02], "stress": [2.5e8, 3.2e8], "unloading": "curve"}}}
    found = ancf2d.solve({"bodies": {"bar": bar}, "boundary_conditions": [{"type": "clamp", "at": "bar@0"}],
                          "loads": [{"type": "force", "at": "bar@1", "value": [3e4, 0]}], "solver": {"type": "static"},
                          "goal": {"probe": "end", "quantity": "ux"}, "output": {"probes": {"end": "bar@1"}},
                          "accuracy": 1e-2}, states=False)
    assert "steps_error" not in found.accuracy
