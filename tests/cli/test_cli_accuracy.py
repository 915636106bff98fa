"""``ancf2d run --accuracy``: its output and files, and wrong use."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from commandline import BEAM

from ancf2d.case import load_case_text
from ancf2d.results import open_results
from ancf2d.study.accuracy.control import describe
from ancf2d.study.accuracy.pursuit import Pursuit

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]
CASE = """
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {height: 0.1, width: 0.1}
    material: {E: 2.07e11, nu: 0.3}
    element: {type: reissner3, count: 3}
boundary_conditions: [{name: wall, type: clamp, at: beam@0}]
loads: [{type: force, at: beam@1, value: [0, -500e3]}]
solver: {type: static}
goal: {probe: tip, quantity: uy}
output: {probes: {tip: beam@1}}
"""


@pytest.fixture(autouse=True)
def written(folder: Path) -> None:
    (folder / "bent.yaml").write_text(CASE)


def test_the_levels_the_estimate_and_the_file_are_printed(call: Call, folder: Path) -> None:
    result = call("run", "bent.yaml", "--accuracy", "1e-4")
    assert result.exit_code == 0
    assert "tip uy = -0.68" in result.stdout
    assert "(wanted 1.0e-04: reached)" in result.stdout
    assert "predicted from the order of the element type" in result.stdout
    assert "next: ancf2d plot bent.h5" in result.stdout
    assert "elements: twice as fine, to verify" in result.stderr
    with open_results("bent.h5") as results:
        assert results.summary["accuracy"]["achieved"]
        assert results.nt == 11


def test_json_has_the_accuracy_of_the_contract(call_json: CallJson) -> None:
    found = call_json("run", "bent.yaml", "--accuracy", "1e-3", "--json")
    accuracy = found["accuracy"]
    assert accuracy["achieved"] is True
    assert accuracy["wanted"] == 1e-3
    assert 0 < accuracy["estimate"] <= 1e-3
    assert accuracy["value"] == found["probes"]["tip"]["uy"]
    assert sum(accuracy["elements"].values()) == found["elements"]


def test_open_element_types_are_chosen_with_a_reason(call: Call) -> None:
    result = call("run", "bent.yaml", "--accuracy", "2e-2", "--set", "bodies.beam.element=auto")
    assert result.exit_code == 0
    assert "beam: cable; with cable the goal changes by about" in result.stdout
    assert "of the estimated error: model" in result.stdout


def test_an_unreachable_accuracy_fails_with_the_best_result(call: Call, folder: Path) -> None:
    result = call("run", "bent.yaml", "--accuracy", "1e-15")
    assert result.exit_code == 1
    assert "NOT reached" in result.stdout
    assert "error: the wanted accuracy 1e-15 was not reached" in result.stderr
    with open_results("bent.h5") as results:
        assert not results.summary["accuracy"]["achieved"]


@pytest.mark.parametrize("value", ["0", "2", "-1e-3", "much"])
def test_no_accuracy_is_a_wrong_command_line(call: Call, value: str, folder: Path) -> None:
    result = call("run", "bent.yaml", "--accuracy", value)
    assert result.exit_code == 2
    assert "--accuracy" in result.stderr
    assert not (folder / "bent.h5").exists()


def test_many_solves_are_not_resumed(call: Call) -> None:
    result = call("run", "bent.yaml", "--accuracy", "1e-3", "--resume")
    assert result.exit_code == 2
    assert "--resume" in result.stderr


def test_an_accuracy_needs_a_goal(call: Call, folder: Path) -> None:
    (folder / "bent.yaml").write_text(CASE.replace("goal: {probe: tip, quantity: uy}\n", ""))
    result = call("run", "bent.yaml", "--accuracy", "1e-3")
    assert result.exit_code == 2
    assert "goal" in result.stderr
    assert "1 problem" in result.stderr


@pytest.mark.slow
def test_rows_of_a_sweep_reach_the_accuracy_that_they_ask_for(call: Call, call_json: CallJson, folder: Path) -> None:
    """One row for each accuracy; a row that cannot reach it fails, with the value found."""
    (folder / "open.yaml").write_text(CASE.replace("{type: reissner3, count: 3}", "auto"))
    rows = call_json("sweep", "open.yaml", "--over", "accuracy=2e-2,1e-4", "--jobs", "1",
                     "--json")["rows"]
    assert [row["status"] for row in rows] == ["converged", "converged"]
    for row in rows:
        assert row["accuracy"]["achieved"]
        assert row["accuracy"]["estimate"] <= row["set"]["accuracy"]
    assert [row["accuracy"]["types"]["beam"]["element"] for row in rows] == ["cable", "reissner3"]
    result = call("sweep", "bent.yaml", "--over", "accuracy=1e-3,1e-15", "--jobs", "1", "--json")
    assert result.exit_code == 1
    good, bad = json.loads(result.stdout)["rows"]
    assert (good["status"], bad["status"]) == ("converged", "failed")
    assert bad["reason"] == "the wanted accuracy 1e-15 was not reached"
    assert bad["goal"] == pytest.approx(good["goal"], rel=1e-3)


def test_an_interrupted_search_names_the_best_result_so_far(call: Call, folder: Path,
                                                            monkeypatch: pytest.MonkeyPatch) -> None:
    again, asked = Pursuit.resolve_as_result, []

    def interrupted(*arguments: Any) -> Any:
        asked.append(1)
        if len(asked) == 3:
            raise KeyboardInterrupt
        return again(*arguments)

    monkeypatch.setattr(Pursuit, "resolve_as_result", interrupted)
    text = CASE.replace("type: static", "type: linear_static").replace("reissner3", "reissner2")
    (folder / "bent.yaml").write_text(text)
    result = call("run", "bent.yaml", "--accuracy", "1e-9")
    assert result.exit_code == 130
    assert "the best so far is in bent.h5" in result.stderr
    assert "wanted 1.0e-09: not reached" in call("info", "bent.h5").stdout


@pytest.mark.parametrize(("size", "tolerance", "said"), [
    (0.3, None, "error about 1.5e-04, which is 5.0e-04 of the value"),
    (4.0, 1e-5, "error about 2.0e-03, which is 5.0e-04 of 4, the largest displacement of tip"),
    (0.5, None, "error about 2.5e-04, which is 5.0e-04 of 0.5, a thousandth of the largest displacement in the model")])
def test_the_error_of_the_printed_value_is_printed_with_its_scale(size: float, tolerance: float | None,
                                                                  said: str) -> None:
    moves = BEAM.replace("type: linear_static", "type: dynamic, t_end: 1").replace("EA:", "rhoA: 1.0, EA:")
    found = {"value": -0.3, "estimate": 5e-4, "scale": size, "absolute": 5e-4 * size, "wanted": 1e-3, "achieved": True,
             "tolerance": tolerance, "elements": {"beam": 2}, "solves": 3}
    case = load_case_text(BEAM if tolerance is None else moves).case
    assert describe(found, case) == f"tip uy = -0.3, {said} (wanted 1.0e-03: reached), 2 elements, 3 solves"
