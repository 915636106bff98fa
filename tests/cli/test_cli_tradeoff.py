"""``ancf2d tradeoff`` as a user calls it."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from ancf2d.cli.tradeoff import memory_text
from ancf2d.plot.kinds import build
from ancf2d.results import Results

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]
STUDY = ("tradeoff", "beam.yaml", "--element", "reissner2,cable,cable:structural", "--elements", "2,4,8", "--repeat",
         "1", "--accuracy", "1e-2,1e-30")


def test_table_fits_the_terminal_and_recommends_commands_that_run(call: Call) -> None:
    result = call(*STUDY)
    assert result.exit_code == 0, result.stderr
    table, advice = result.stdout.split("\nfor 1e-2:")
    assert max(map(len, table.splitlines())) <= 100
    assert "*" in table
    assert "cable:structural is refused: cable has no formulation structural" in " ".join(table.split())
    assert "for 1e-30: no setting is known to be this accurate" in advice
    command = next(line for line in advice.splitlines() if line.strip().startswith("ancf2d run"))
    assert call(*shlex.split(command)[1:], "-o", "best.h5").exit_code == 0


def test_json_has_rows_and_recommendations(call_json: CallJson) -> None:
    found = call_json(*STUDY, "--json")
    assert found["status"] == "converged"
    assert [row["status"] for row in found["rows"]] == 6 * ["converged"] + ["refused"]
    assert any(row["pareto"] for row in found["rows"])
    assert found["recommended"]["1e-2"]["wall_s"] > 0
    assert found["recommended"]["1e-30"] is None


def test_file_holds_the_table_and_plot_draws_it_with_its_front(call: Call, folder: Path) -> None:
    result = call(*STUDY, "-o", "study.h5")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.endswith("results in study.h5; next: ancf2d plot study.h5\n")
    assert call("plot", "study.h5").stdout == "wrote study-tradeoff.png (tradeoff)\n"
    with Results("study.h5") as found:
        table = found.tables["tradeoff"]
        assert table["elements"].tolist() == [2, 4, 8, 2, 4, 8]
        assert table.attrs["goal"] == "tip uy"
        curves = build(found).panels[0].curves  # type: ignore[attr-defined]
        best = {(x, y) for x, y, on in zip(table["wall_s"], table["judged"], table["pareto"], strict=True) if on}
        assert set(zip(curves[-1].x, curves[-1].y, strict=True)) == best
        assert {c.name for c in curves} == {"reissner2", "cable", "Pareto front"}
    assert call("plot", "study.h5", "--against", "dofs").exit_code == 0
    assert "known: wall_s, dofs, memory_bytes" in call("plot", "study.h5", "--against", "elements").stderr
    assert (folder / "study-tradeoff.png").stat().st_size > 1000


@pytest.mark.parametrize(("arguments", "message"), [
    (("--budget", "soon"), "'soon' is not a time; expected for example 60s or 5min"),
    (("--element", "cabel"), "did you mean 'cable'?"),
    (("--dt", "1e-3", "--tolerance", "1e-3"), "--dt and --tolerance are both given"),
    (("--method", "newmark"), "no integrator to choose"),
    (("--against", "continuum", "--reference", "1"), "--against continuum needs the limits of the types"),
    (("--accuracy", "0"), "not a list of positive numbers"),
    (("--element", "cable:structural"), "cable has no formulation structural"),
    (("--quadrature", "[2,"), "'[2,' is not a list of quadratures"),
    (("-o", "beam.yaml"), "is an input of this command"),
])
def test_wrong_input_is_reported_before_anything_is_computed(call: Call, arguments: tuple[str, ...], message: str,
                                                             ) -> None:
    result = call("tradeoff", "beam.yaml", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr


def test_a_budget_that_is_too_small_fails_with_a_reason(call: Call, call_json: CallJson) -> None:
    result = call("tradeoff", "beam.yaml", "--budget", "0")
    assert result.exit_code == 1
    assert "error: the budget did not allow any solution" in result.stderr
    assert "left out" in result.stdout
    assert call_json("tradeoff", "beam.yaml", "--budget", "0", "--json")["status"] == "failed"


def test_the_column_of_memory_has_one_width() -> None:
    """Values near a change of unit have three digits whatever their last digits are."""
    for count, text in ((310, "0.31 kB"), (9994, "9.99 kB"), (9996, "10.0 kB"), (123_456, " 123 kB"),
                        (999_400, " 999 kB"), (999_600, "1.00 MB"), (1_100_000, "1.10 MB"), (2.5e9, "2.50 GB")):
        assert memory_text(int(count)) == text
