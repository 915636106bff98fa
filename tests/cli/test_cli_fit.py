"""``ancf2d fit`` as a user calls it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from click.testing import Result

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]
# uy = F L^3/(3 E I) = -8e-3 of the case, exactly: EI = 2e3 gives half of it
DATA = "factor,tip.uy,tip.ux\n1,-4.001e-3,\n1,-3.999e-3,\n1,-4e-3,0\n"
FIT = ("fit", "beam.yaml", "--data", "data.csv", "--vary", "bodies.beam.section.EI=100:1e4")


def test_fit_prints_and_writes_as_the_contract_says(call: Call, call_json: CallJson, folder: Path) -> None:
    (folder / "data.csv").write_text(DATA)
    found = call_json(*FIT, "--json")
    row, = found["rows"]
    assert row["path"] == "bodies.beam.section.EI"
    assert abs(row["value"] - 2000.0) < 1e-3
    # the mean of three values with a deviation of 1e-6: the relative error is 1e-6/sqrt(3)/4e-3 and more by m/(m - n)
    assert 1e-4 < row["standard_error"] / 2000.0 < 3e-4
    assert found["output"] == "beam-fitted.yaml"
    assert call_json("run", found["output"], "--json")["probes"]["tip"]["uy"] + 4e-3 < 1e-8
    told = call(*FIT)
    assert told.exit_code == 0, told.output
    assert "bodies.beam.section.EI" in told.stdout
    assert call("plot", found["results"], "--data", "fit.csv").exit_code == 0
    assert (folder / "fit.csv").read_text().startswith("curve,")


def test_all_problems_are_reported_and_nothing_is_written(call: Call, folder: Path) -> None:
    (folder / "data.csv").write_text("factor,tip.uy\n1,x\n")
    before = sorted(p.name for p in folder.iterdir())
    result = call(*FIT, "--vary", "b=2:1", "--sigma", "c")
    assert result.exit_code == 2
    for text in ("'x' in column tip.uy is not a number", "2:1 is not a range", "not PROBE.QUANTITY=NUMBER"):
        assert text in result.stderr
    assert call(*FIT[:3], "nowhere.csv", *FIT[4:]).exit_code == 2
    (folder / "data.csv").write_text(DATA.replace("tip.ux", "tip.uy"))
    assert "there are 2 columns 'tip.uy'" in call(*FIT).stderr
    (folder / "data.csv").write_text(DATA)
    whole = call(*FIT, "--vary", "bodies.beam.element.count=1:9")
    assert "--vary bodies.beam.element.count=1:9: error: bodies.beam.element.count must be a whole" in whole.stderr
    assert "is an input of this command" in call(*FIT, "-o", "data.csv").stderr
    assert sorted(p.name for p in folder.iterdir()) == before
