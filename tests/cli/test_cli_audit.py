"""``ancf2d audit`` as a user calls it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from ancf2d.study.audit.examine import CHECKS

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]

OWN = """\
name: mine
basis: ["1", "x", "y", "x*y", "x^2", "x^3"]
nodes: [{at: 0, coordinates: [r, r_x, r_y]}, {at: 1, coordinates: [r, r_x, r_y]}]
formulation: enhanced
"""


@pytest.mark.slow
def test_json_has_every_check_with_number_verdict_and_meaning(call_json: CallJson) -> None:
    found = call_json("audit", "2d2n", "--preset", "paper", "--json")
    assert (found["element"], found["formulation"], found["shear_factor"]) == ("2d2n", "continuum", 0.5)
    assert [c["name"] for c in found["checks"]] == [c.name for c in CHECKS]
    for check in found["checks"]:
        assert check["verdict"] in ("pass", "fail", "note")
        assert check["value"] is None or isinstance(check["value"], float)
        assert check["meaning"].strip()
        assert "\n" not in check["meaning"]
    factor = next(c for c in found["checks"] if c["name"] == "shear_factor")
    assert factor["value"] == pytest.approx(0.5)
    assert sum(found["verdicts"].values()) == len(CHECKS)


def test_a_table_with_a_line_for_each_check_and_exit_0_for_any_verdict(call: Call, folder: Path) -> None:
    (folder / "mine.yaml").write_text(OWN)
    result = call("audit", "mine.yaml", "--quadrature", "1,1")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[0] == "mine: basis 1, x, y, x*y, x^2, x^3; 12 coordinates"
    assert lines[1] == "formulation enhanced, 1 x 1 Gauss points"
    assert [line.split()[0] for line in lines[4:4 + len(CHECKS)]] == [c.name for c in CHECKS]
    assert "6 motions of an element without strain energy with 1 x 1 points" in result.stdout
    assert lines[-1].endswith(" note")
    assert call("audit", "reissner2", "-q").stdout == ""


def test_coordinates_that_do_not_determine_the_basis_are_a_verdict(call: Call, folder: Path) -> None:
    (folder / "mine.yaml").write_text(OWN.replace('"x^2"', '"x^2*y^2"'))
    result = call("audit", "mine.yaml")
    assert result.exit_code == 0
    assert "rank 5 of 6" in result.stdout
    last = f"{len(CHECKS) - 1} other checks were not made because there are no shape functions"
    assert result.stdout.splitlines()[-1] == last


@pytest.mark.parametrize(("arguments", "words"), [
    (["rigid"], "rigid has no strain: there is nothing to examine"),
    (["vallejoo"], "did you mean 'vallejo'?"), (["none.yaml"], "none.yaml: error: cannot read the file"),
    (["2d2n", "--formulation", "enhanced"], "2d2n has no formulation enhanced"),
    (["2d2n", "--quadrature", "2"], "'2' is not a pair of numbers of Gauss points"),
    (["vallejo", "--preset", "paper"], "the paper does not use vallejo"), (["wrong.yaml"], "wrong.yaml:2:14: error: "
                                                                           "basis")])
def test_wrong_input_is_explained_with_exit_2(call: Call, folder: Path, arguments: list[str], words: str) -> None:
    (folder / "wrong.yaml").write_text(OWN.replace('"x"', '"x^^2"'))
    result = call("audit", *arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert result.stdout == ""
    failed = json.loads(call("audit", *arguments, "--json").stdout)
    assert failed["status"] == "failed"
    assert failed["reason"]


def test_the_element_of_a_file_is_used_in_cases(call_json: CallJson, folder: Path) -> None:
    """A file that describes omar gives the element omar."""
    (folder / "mine.yaml").write_text(OWN)
    case = {"bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [2, 0]},
                                "section": {"height": 0.1, "width": 0.1}, "material": {"E": 2.07e11, "nu": 0.3},
                                "element": {"definition": "mine.yaml", "count": 4}}},
            "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
            "loads": [{"type": "force", "at": "beam@1", "value": [0, -1000]}], "solver": {"type": "linear_static"},
            "output": {"probes": {"tip": "beam@1"}}}
    own = call_json("run", _written(folder, case), "--json")["probes"]["tip"]["uy"]
    case["bodies"]["beam"]["element"] = {"type": "omar", "count": 4}  # type: ignore[index]
    assert own == pytest.approx(call_json("run", _written(folder, case), "--json")["probes"]["tip"]["uy"], rel=1e-12)


def _written(folder: Path, case: dict[str, Any]) -> str:
    (folder / "case.yaml").write_text(json.dumps(case))
    return "case.yaml"
