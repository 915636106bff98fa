"""``ancf2d run``: its output, the files it writes, and files that it leaves alone."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from commandline import BEAM, HOPELESS

from ancf2d.cli import main
from ancf2d.results import compare_results, open_results

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]


def test_a_case_can_come_from_stdin(call: Call, folder: Path) -> None:
    found = CliRunner().invoke(main, ["run", "-", "--json"], input=BEAM)
    assert json.loads(found.stdout)["case"] == "<stdin>"
    assert json.loads(found.stdout)["output"] == "stdin.h5"
    call("run", "beam.yaml", "-q")
    assert not compare_results("beam.h5", "stdin.h5", rtol=0)
    wrong = CliRunner().invoke(main, ["validate", "beam.yaml", "-"], input=BEAM.replace("cable", "cabel"))
    assert wrong.exit_code == 2
    assert "<stdin>:7:" in wrong.stderr
    swept = CliRunner().invoke(main, ["sweep", "-", "--over", "loads.0.value.1=1,2", "--json"], input=BEAM)
    assert [row["status"] for row in json.loads(swept.stdout)["rows"]] == ["converged"] * 2
    assert CliRunner().invoke(main, ["run", "-"], input="").exit_code == 2


def test_writes_one_file_named_after_the_case_into_the_working_directory(call: Call, folder: Path) -> None:
    (folder / "cases").mkdir()
    (folder / "beam.yaml").rename(folder / "cases" / "beam.yaml")
    assert call("run", "cases/beam.yaml").exit_code == 0
    assert sorted(os.listdir(folder)) == ["beam.h5", "cases"]
    assert os.listdir(folder / "cases") == ["beam.yaml"]


def test_json_is_the_contracts_object(call_json: CallJson) -> None:
    found = call_json("run", "beam.yaml", "--json")
    assert found["case"] == "beam.yaml"
    assert (found["status"], found["solver"], found["elements"], found["dofs"]) == ("converged", "linear_static", 2, 12)
    assert found["probes"]["tip"]["uy"] == pytest.approx(-8e-3, rel=1e-9)
    assert set(found["probes"]["tip"]) == {"x", "y", "ux", "uy", "theta"}
    assert found["reactions"]["root"]["fy"] == pytest.approx(3, rel=1e-9)
    assert found["reactions"]["root"]["m"] == pytest.approx(6, rel=1e-9)
    assert found["energy"]["strain"] == pytest.approx(0.5 * 3 * 8e-3, rel=1e-9)
    assert {"kinetic", "potential"} <= set(found["energy"])
    assert (found["iterations"], found["steps"]) == (1, 1)
    assert 0 < found["wall_s"] < 1
    assert found["output"] == "beam.h5"


def test_text_shows_probes_reactions_and_expected_values_with_units(call: Call) -> None:
    assert call("run", "beam.yaml").exit_code == 0  # kernels may have to be compiled, which is told
    result = call("run", "beam.yaml", "--set", "units={length: mm, force: kN, time: s}")
    assert result.stderr == ""
    assert "uy [mm]" in result.stdout
    assert "m [kN mm]" in result.stdout
    assert "-0.008" in result.stdout
    line = next(line for line in result.stdout.split("\n") if line.startswith("tip uy"))
    assert "ok" in line
    assert "F L^3/(3 E I)" in line
    assert "next: ancf2d plot beam.h5" in result.stdout


def test_missed_value_is_printed_and_fails_only_with_check(call: Call) -> None:
    wrong = ("run", "beam.yaml", "--set", "expected.0.value=-8.4e-3")
    result = call(*wrong)
    assert result.exit_code == 0
    assert "differs by 4.8 %, allowed 1e-07 %" in result.stdout
    assert call(*wrong, "--check").exit_code == 1
    assert call("run", "beam.yaml", "--check").exit_code == 0


def test_round_off_compared_with_larger_values_is_shown_as_zero(call: Call) -> None:
    result = call("run", "beam.yaml", "--set", "loads.0.value=[0.1, -3]")
    row = next(line for line in result.stdout.split("\n") if line.startswith("root")).split()
    assert row == ["root", "-0.1", "3", "6"]
    for cell in "".join(result.stdout.split("\n")[4]).split()[1:]:
        assert cell == "0" or abs(float(cell)) > 1e-15


def test_reactions_of_slender_elements_are_known_to_round_off(call: Call, call_json: CallJson) -> None:
    """128 slender three-node elements: the residual force is less than 1e-12 of the load."""
    case = str(Path(__file__).parents[2] / "cases" / "paper" / "fig4_linear_2d3n.yaml")
    exact = call_json("run", case, "--json")["reactions"]["wall"]
    assert 0 < abs(exact["fx"]) < 1e-12 * 500000
    row = next(line for line in call("run", case).stdout.split("\n") if line.startswith("wall")).split()
    assert row == ["wall", "0", "500000", "1e+06"]


def test_result_file_records_command_line_and_overrides(call: Call) -> None:
    arguments = ("run", "beam.yaml", "-o", "fine beam.h5", "--set", "bodies.beam.element.count=5")
    assert call(*arguments).exit_code == 0
    with open_results("fine beam.h5") as found:
        assert found.attrs["command_line"] == ("ancf2d run beam.yaml -o 'fine beam.h5' --set "
                                               "bodies.beam.element.count=5")
        assert found.overrides == ["bodies.beam.element.count=5"]
        assert found.case_text == BEAM
        assert found.summary["elements"] == 5


def test_quiet_prints_nothing_and_verbose_says_what_was_built(call: Call) -> None:
    quiet = call("run", "beam.yaml", "-q")
    assert (quiet.exit_code, quiet.output) == (0, "")
    found = call("run", "beam.yaml", "-v").stderr
    assert "2 elements cable (all alike), cable, 3 x 1 Gauss points" in found
    # a clamped cable end holds x, y and the direction of r_x, its length stays free
    assert "unknowns: 9 of 12 nodal coordinates; 3 eliminated" in found
    assert "symmetric band" in found
    assert "left out: mass matrix" in found


def test_a_failed_run_says_where_and_keeps_an_earlier_result(call: Call, call_json: CallJson, folder: Path) -> None:
    assert call("run", "beam.yaml").exit_code == 0
    before = (folder / "beam.h5").read_bytes()
    (folder / "beam.yaml").write_text(HOPELESS)
    result = call("run", "beam.yaml")
    assert result.exit_code == 1
    assert result.stdout == ""
    assert "error: no equilibrium was found" in result.stderr
    assert "the results so far are in beam.h5.part" in result.stderr
    assert "Traceback" not in result.stderr
    found = call_json("run", "beam.yaml", "--json")
    assert found["status"] == "failed"
    assert found["reason"]
    assert found["at"]
    assert (folder / "beam.h5").read_bytes() == before
    assert sorted(os.listdir(folder)) == ["beam.h5", "beam.h5.part", "beam.yaml"]
    with open_results("beam.h5.part") as part:
        assert part.status == "failed"


def test_rerun_replaces_its_own_result_and_a_foreign_file_only_with_force(call: Call, folder: Path) -> None:
    (folder / "notes.h5").write_text("mine")
    result = call("run", "beam.yaml", "-o", "notes.h5")
    assert result.exit_code == 2
    assert "--force" in result.stderr
    assert (folder / "notes.h5").read_text() == "mine"
    for arguments in (["--force"], []):
        assert call("run", "beam.yaml", "-o", "notes.h5", *arguments).exit_code == 0
    with open_results("notes.h5") as found:
        assert found.summary["status"] == "converged"


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_case_itself_is_never_replaced(call: Call, folder: Path, force: list[str]) -> None:
    result = call("run", "beam.yaml", "-o", "./beam.yaml", *force)
    assert result.exit_code == 2
    assert (folder / "beam.yaml").read_text() == BEAM


def test_the_last_state_is_stored_for_any_every_and_until(call: Call) -> None:
    """The state at load factor 1.5 is stored with ``every: 100``."""
    result = call("run", "beam.yaml", "--set", "solver={type: static, steps: 3, until: {load_factor: 1.5}}", "--set",
                  "output.every=100")
    assert result.exit_code == 0, result.output
    assert "load factor 1.5" in result.stdout
    with open_results("beam.h5") as found:
        assert found.t[-1] == 1.5
        assert set(found.t) <= {0.0, 1.5}


def test_warnings_go_to_stderr_and_into_the_summary(call: Call, folder: Path) -> None:
    # two pins at one place hold it twice
    twice = BEAM.replace("loads:", "  - {name: again, type: pin, at: beam@0}\nloads:")
    (folder / "beam.yaml").write_text(twice)
    result = call("run", "beam.yaml", "--json")
    assert "warning: redundant" in result.stderr
    assert any("redundant" in w for w in json.loads(result.stdout)["warnings"])
    assert call("run", "beam.yaml", "-q").stderr == ""
