"""Invalid arguments of the Python functions and their messages."""

from __future__ import annotations

import numpy as np
import pytest
from test_api import TEXT

import ancf2d

E = "bodies.beam.material.E"
WRONG = {
    "no case": (lambda: ancf2d.solve(None), TypeError, "case: expected a file, a text, a mapping .* got None"),
    "one override": (lambda: ancf2d.load(TEXT, "title=a"), TypeError, "overrides: .* 'path=value' .* 'title=a'"),
    "number as overrides": (lambda: ancf2d.load(TEXT, 5), TypeError, "overrides: expected a mapping"),
    "numbers as overrides": (lambda: ancf2d.load(TEXT, [5]), TypeError, "overrides: expected a mapping"),
    "accuracy": (lambda: ancf2d.solve(TEXT, accuracy="fine"), ancf2d.CaseError, r"accuracy .* got the text 'fine'"),
    "output": (lambda: ancf2d.solve(TEXT, output=5), TypeError, "output: expected the name of a file, got 5"),
    "elements": (lambda: ancf2d.convergence(TEXT, elements=4), TypeError, r"elements: .* \[2, 4, 8\], got 4"),
    "no elements": (lambda: ancf2d.convergence(TEXT, elements=[0, 1]), ancf2d.CaseError, "elements: .* got 0"),
    "half elements": (lambda: ancf2d.convergence(TEXT, elements=[2.5]), ancf2d.CaseError, "elements: .* got 2.5"),
    "steps": (lambda: ancf2d.convergence(TEXT, dt=[0.1, -0.1]), ancf2d.CaseError, "dt: .* got -0.1"),
    "step of text": (lambda: ancf2d.convergence(TEXT, tolerance=["a"]), TypeError, "tolerance: expected positive"),
    "path": (lambda: ancf2d.sensitivity(TEXT, [3]), TypeError, "to: expected paths"),
    "path of a gradient": (lambda: ancf2d.solve(TEXT).gradient([3]), TypeError, "paths: expected paths"),
    "no numbers": (lambda: ancf2d.optimise(TEXT, {}, "mass"), TypeError, "vary: expected bounds by path"),
    "paths alone": (lambda: ancf2d.optimise(TEXT, [E], "mass"), TypeError, "vary: expected bounds by path"),
    "one bound": (lambda: ancf2d.optimise(TEXT, {E: 1e9}, "mass"), TypeError, "vary: .* got {'bodies.beam.material.E"),
    "nothing to minimise": (lambda: ancf2d.optimise(TEXT, {E: (1e9, 1e10)}, None), TypeError, "minimise: expected an"),
    "no data": (lambda: ancf2d.fit(TEXT, None, {E: (1e9, 1e10)}), TypeError, "data: expected a CSV file"),
    "data of text": (lambda: ancf2d.fit(TEXT, {"factor": [1], "tip.uy": ["a"]}, {E: (1e9, 1e10)}), ancf2d.CaseError,
                     "tip.uy holds something other than numbers"),
    "no starts": (lambda: ancf2d.fit(TEXT, {"factor": [1], "tip.uy": [0]}, {E: (1e9, 1e10)}, starts=0),
                  ancf2d.CaseError, "starts is 0; expected at least 1"),
    "derivative": (lambda: (s := ancf2d.system(TEXT)).expand(np.zeros(s.n), order=3), ValueError, "order is 3"),
}


@pytest.mark.parametrize("name", WRONG)
def test_arguments_of_the_wrong_kind_are_named_with_the_expected_kind(name: str) -> None:
    call, kind, words = WRONG[name]
    with pytest.raises(kind, match=words):
        call()


def test_one_path_is_a_list_of_one() -> None:
    solution = ancf2d.solve(TEXT)
    np.testing.assert_array_equal(solution.gradient(E), solution.gradient([E]))


def test_none_is_no_override() -> None:
    assert ancf2d.load(TEXT, None).completed == ancf2d.load(TEXT).completed


def test_problems_of_a_mapping_name_keys_and_those_of_a_text_lines() -> None:
    text = TEXT.replace("height:", "heigth:", 1)
    with pytest.raises(ancf2d.CaseError, match=r"^case \(text\):\d+:\d+: error: .*'heigth'"):
        ancf2d.load(text)
    wrong = {**ancf2d.load(TEXT).data, "boundary_conditions": []}
    with pytest.raises(ancf2d.CaseError) as raised:
        ancf2d.solve(wrong)
    assert str(raised.value).startswith("case (dict), boundary_conditions: error: ")
    wrong["joints"] = [{"name": "a", "type": "pin", "between": ["beam@0", "beam@1"]}] * 2
    with pytest.raises(ancf2d.CaseError, match=r"error: joints.1.name: 'a' is already the name of joints.0$"):
        ancf2d.load(wrong)


@pytest.mark.parametrize("value", [float("nan"), np.float64("-inf"), np.array(np.inf)], ids=["nan", "-inf", "array"])
def test_a_number_that_is_not_finite_is_called_so(value: object) -> None:
    data = ancf2d.load(TEXT).data
    data["bodies"]["beam"]["material"]["E"] = value
    for given, overrides in ((data, None), (TEXT, {E: value})):
        with pytest.raises(ancf2d.CaseError, match=r"material\.E must be a finite number, got -?\.(nan|inf)"):
            ancf2d.load(given, overrides)


def test_an_empty_mapping_lacks_the_keys_of_a_case() -> None:
    with pytest.raises(ancf2d.CaseError, match="bodies is missing"):
        ancf2d.load({})


def test_messages_about_a_solution_name_its_case_and_not_the_temporary_file() -> None:
    solution = ancf2d.solve(ancf2d.load(TEXT).data)
    calls = [lambda: solution.v, lambda: solution.axis("rod"), lambda: solution.plot("energy"),
             lambda: solution.plot("shape", state=99), lambda: solution.results.field("beam", "gap")]
    for call in calls:
        with pytest.raises(ancf2d.ResultsError, match=r"the solution of case \(dict\)") as raised:
            call()
        assert ".h5" not in str(raised.value)
