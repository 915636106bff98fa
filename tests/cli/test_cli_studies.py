"""convergence, sensitivity and optimise, as a user calls them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from commandline import BEAM

from ancf2d.results import open_results

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]


def test_convergence_of_an_exact_element_is_round_off(call: Call, call_json: CallJson) -> None:
    found = call_json("convergence", "beam.yaml", "--elements", "1,2,4", "--json")
    assert [row["elements"] for row in found["rows"]] == [1, 2, 4]
    assert found["extrapolated"] == pytest.approx(-8e-3, rel=1e-10)
    assert found["order"] is None
    assert found["asymptotic"] is True
    assert found["error_bar"] < 1e-12
    assert "order undefined" in call("convergence", "beam.yaml", "--elements", "1,2,4").stdout


def test_convergence_writes_a_table_that_plot_draws(call: Call, folder: Path) -> None:
    result = call("convergence", "beam.yaml", "--element", "reissner2,reissner3", "--elements", "2,4,8", "-o",
                  "study.h5", "--reference", "-0.0080200000")
    assert result.exit_code == 0, result.output
    # F L^3/(3 E I) + F L/kGA
    assert "limit -0.00802" in result.stdout
    with open_results("study.h5") as found:
        table = found.tables["convergence"]
        assert list(table["elements"]) == [2, 4, 8, 2, 4, 8]
        assert list(table["element"]) == ["reissner2"] * 3 + ["reissner3"] * 3
        assert found.attrs["command_line"].startswith("ancf2d convergence beam.yaml")
        assert [e["element"] for e in found.summary["elements"]] == ["reissner2", "reissner3"]
    assert call("plot", "study.h5").stdout == "wrote study-convergence.png (convergence)\n"
    assert (folder / "study-convergence.png").stat().st_size > 1000
    assert "convergence" in call("info", "study.h5").stdout


def test_sensitivities_and_designs_are_written_and_drawn(call: Call, call_json: CallJson, folder: Path) -> None:
    """u is proportional to the load: the elasticity is 1 and the least load is best."""
    result = call("sensitivity", "beam.yaml", "-o", "s.h5")
    assert result.exit_code == 0
    assert "loads.tip.value.1" in result.stdout
    with open_results(folder / "s.h5") as found:
        table = found.tables["sensitivity"]
        row = list(table["path"]).index("loads.tip.value.1")
        assert table["elasticity"][row] == pytest.approx(1.0, abs=1e-8)
    assert call("plot", "s.h5").stdout == "wrote s-tornado.png (tornado)\n"
    found = call_json("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-6:-2", "--minimise", "goal^2",
                      "--subject-to", "goal <= 0", "--history", "o.h5", "--json")
    assert found["rows"][0]["value"] == pytest.approx(-2.0, abs=1e-6)
    assert found["constraints"][0]["met"]
    assert found["output"] == "beam-best.yaml"
    assert call("plot", "o.h5").stdout == "wrote o-optimisation.png (optimisation)\n"
    again = call_json("run", "beam-best.yaml", "--set", "expected=null", "--json")
    assert again["probes"]["tip"]["uy"] ** 2 == pytest.approx(found["minimum"], rel=1e-9)


@pytest.mark.parametrize(("arguments", "message"), [
    (("sensitivity", "beam.yaml", "--set", "goal=null"), "the case has no goal"),
    (("sensitivity", "beam.yaml", "--to", "loads.tip.valu.1"), "did you mean 'loads.tip.value.1'?"),
    (("sensitivity", "beam.yaml", "--to", "masses"), "beam.yaml: error: the case has no 'masses'"),
    (("sensitivity", "beam.yaml", "--to", "bodies.beam.element.count"),
     "--to bodies.beam.element.count: error: bodies.beam.element.count cannot vary about 2: "),
    (("optimise", "beam.yaml", "--vary", "loads.tip.value.1=1", "--minimise", "mass"), "not PATH=LOW:HIGH"),
    (("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-2:-1", "--minimise", "tip.uz"), "did you mean 'tip.uy'?"),
    (("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-2:-1", "--minimise", "goal", "--subject-to", "goal"),
     "no constraint")], ids=lambda v: v if isinstance(v, str) else " ".join(v))
def test_numbers_without_derivatives_are_wrong_input(call: Call, arguments: tuple[str, ...], message: str,
                                                     ) -> None:
    result = call(*arguments)
    assert result.exit_code == 2
    assert message in result.stderr


def test_convergence_row_that_fails_is_a_row(call: Call, call_json: CallJson) -> None:
    arguments = ("convergence", "beam.yaml", "--element", "cable:structural,reissner2", "--elements", "2,4")
    found = call_json(*arguments, "--json")
    assert [row["status"] for row in found["rows"]] == ["failed"] * 2 + ["converged"] * 2
    assert "cable has no formulation structural" in found["rows"][0]["reason"]
    assert call(*arguments).exit_code == 0
    alone = call("convergence", "beam.yaml", "--element", "cable:structural")
    assert alone.exit_code == 2
    assert alone.stderr.startswith("--element cable:structural: error: cable has no formulation structural")


def test_convergence_without_goal_is_a_wrong_case(call: Call, folder: Path) -> None:
    (folder / "beam.yaml").write_text(BEAM.replace("goal: {probe: tip, quantity: uy}\n", ""))
    result = call("convergence", "beam.yaml")
    assert result.exit_code == 2
    assert "the case has no goal" in result.stderr


def test_the_values_of_a_convergence_study_are_drawn_on_request(call: Call, folder: Path) -> None:
    call("convergence", "beam.yaml", "--element", "reissner2", "--elements", "2,4", "-o", "s.h5", "-q")
    assert call("plot", "s.h5", "--values", "--data", "s.csv").exit_code == 0
    assert (folder / "s.csv").read_text().startswith("curve,number of elements,tip uy [m]\nreissner2,2.0,-0.0")
