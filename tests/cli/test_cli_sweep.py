"""``ancf2d sweep`` as a user calls it."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from commandline import BEAM, start

from ancf2d.case import load_case_text
from ancf2d.cli.sweep import alike
from ancf2d.study.run import run_case, vocabulary

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]
COUNTS = ("sweep", "beam.yaml", "--over", "bodies.beam.element.count=1,2")
# goes on for some seconds, by states that are stored often
LONG = BEAM.replace("{type: linear_static}", "{type: dynamic, t_end: 1, dt: 1.0e-4}").replace("expected:", "#").replace(
    "EI: 1.0e3", "EI: 1.0e3, rhoA: 1, rhoI: 1.0e-3").replace("output:", "output:\n  every: 50")


def test_rows_follow_the_contract(call_json: CallJson) -> None:
    found = call_json("sweep", "beam.yaml", "--over", "loads.tip.value=[0,-3],[0,-6]", "--over",
                      "bodies.beam.element.count=1,2", "--keep", "--json")
    assert [row["set"] for row in found["rows"]] == [
        {"loads.tip.value": [0, f], "bodies.beam.element.count": n} for f in (-3, -6) for n in (1, 2)]
    assert {row["status"] for row in found["rows"]} == {"converged"}
    assert [row["goal"] for row in found["rows"]] == pytest.approx([-8e-3, -8e-3, -16e-3, -16e-3], rel=1e-9)
    assert all(Path(row["output"]).parent == Path("beam-sweep/runs") and Path(row["output"]).exists()
               for row in found["rows"])


def test_the_folder_of_a_sweep_cannot_have_the_name_of_a_result_file(call: Call, folder: Path) -> None:
    found = call(*COUNTS, "-o", "mine.h5")
    assert found.exit_code == 2
    assert "sweep writes sweep.h5 into a folder; expected for example 'mine'" in found.stderr
    assert not (folder / "mine.h5").exists()


def test_the_table_marks_reused_results(call: Call, folder: Path) -> None:
    first = call(*COUNTS, "--out", "mine", "--csv", "t.csv", "--keep")
    assert first.exit_code == 0, first.output
    lines = [line.split() for line in first.stdout.splitlines()]
    assert ["count", "status", "tip", "uy", "[m]", "elements", "time", "result"] in lines
    assert "results in mine/sweep.h5" in first.stdout
    again = call(*COUNTS, "--out", "mine")
    assert "results in mine/sweep.h5; 2 of 2 rows were computed before" in again.stdout
    rows = csv.DictReader((folder / "t.csv").read_text().splitlines())
    assert [row["bodies.beam.element.count"] for row in rows] == ["1", "2"]


@pytest.mark.slow
def test_samples_end_with_their_statistics(call: Call, call_json: CallJson) -> None:
    arguments = ("sweep", "beam.yaml", "--sample", "bodies.beam.section.EI~uniform(900, 1100)", "--samples", "32",
                 "--seed", "3", "--design", "lhs", "--jobs", "1")
    found = call_json(*arguments, "--json")
    assert found["samples"] == {"design": "lhs", "seed": 3, "count": 32}
    goals = [row["goal"] for row in found["rows"]]
    said = found["statistics"]["goal"]
    assert said["mean"] == pytest.approx(sum(goals) / 32, rel=1e-12)
    assert said["shares"]["bodies.beam.section.EI"] == pytest.approx(1.0, abs=1e-3)
    assert found["output"] == "beam-sweep/sweep.h5"
    told = call(*arguments).stdout
    assert "... and 22 rows more" in told
    assert "share of EI" in told
    for kind in ("sweep", "histogram", "shares"):
        assert call("plot", "beam-sweep/sweep.h5", kind, "--data", f"{kind}.csv").exit_code == 0


def test_warnings_that_differ_only_in_numbers_are_printed_once() -> None:
    said = [f"bodies.beam{k}: an error of about {share} % from S = 0 to 0.125"
            for k in (1, 2) for share in ("13", "4.6")]
    assert alike([*said, "contacts.0: no", "contacts.1: no", "contacts.1: no"]) == [
        f"{said[0]} (2 rows, with other numbers)", f"{said[2]} (2 rows, with other numbers)", "contacts.0: no",
        "contacts.1: no (2 rows)"]


def test_all_problems_of_the_axes_are_reported_at_once(call: Call) -> None:
    result = call("sweep", "beam.yaml", "--over", "a=0.1:0.2:", "--sample", "b~beta(1, 2)", "--sample", "c", "--pair")
    assert result.exit_code == 2
    for text in ("both given", "'0.1:0.2:' is not a range", "is not a distribution", "not PATH~", "nothing to pair"):
        assert text in result.stderr
    assert "need --sample" in call("sweep", "beam.yaml", "--over", "a=1,2", "--seed", "1").stderr
    assert "nothing is varied" in call("sweep", "beam.yaml").stderr
    # what every sample lacks is told once
    text = call("sweep", "beam.yaml", "--sample", "bodies.beam.element.type~uniform(1, 2)", "--samples", "4")
    assert text.exit_code == 2
    assert text.stderr.endswith("\n1 problem\n")


def test_failed_rows_exit_with_1_and_wrong_sweeps_with_2(call: Call, call_json: CallJson, folder: Path) -> None:
    result = call("sweep", "beam.yaml", "--over", "bodies.beam.section.EI=1e3,-1")
    assert result.exit_code == 1
    assert "refused" in result.stdout
    assert "error: of 2 rows, 1 refused" in result.stderr
    before = sorted(os.listdir(folder))
    result = call("sweep", "beam.yaml", "--over", "bodies.beam.elemnt.count=1,2", "--over", "loads.5.value=[0,1]")
    assert result.exit_code == 2
    assert "did you mean 'element'?" in result.stderr
    assert "--over loads.5.value=[0,1]: error: 'loads' has 1 item" in result.stderr
    # one that the case has, or has not, and none of its formulas names
    for more in ((), ("--set", "parameters={k: 3}")):
        unused = call("sweep", "beam.yaml", "--over", "parameters.k=1,2", *more)
        assert unused.exit_code == 2
        assert "nothing in the case uses parameters.k" in unused.stderr
    assert call("sweep", "beam.yaml").exit_code == 2
    assert sorted(os.listdir(folder)) == before
    assert call_json("sweep", "beam.yaml", "--over", "a", "--json")["status"] == "failed"


@pytest.mark.parametrize(("arguments", "said"), [
    (("--csv", "beam.yaml"), "is an input of this command"), (("--csv", "nowhere/t.csv"), "does not exist"),
    (("--scheduler", "here"), "not the address of a scheduler"),
    (("--scheduler", "tcp://127.0.0.1:1", "--jobs", "2"), "--jobs is for processes on this machine")],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "")
def test_wrong_input_is_reported_before_anything_is_computed(call: Call, folder: Path, arguments: tuple[str, ...],
                                                             said: str) -> None:
    result = call(*COUNTS, *arguments)
    assert (result.exit_code, said in result.stderr) == (2, True), result.stderr
    assert os.listdir(folder) == ["beam.yaml"]
    assert (folder / "beam.yaml").read_text() == BEAM


def test_convergence_has_the_same_options(call: Call) -> None:
    arguments = ("convergence", "beam.yaml", "--elements", "1,2", "--scheduler")
    assert "not the address of a scheduler" in call(*arguments, "here").stderr
    assert "--jobs is for processes" in call(*arguments, "tcp://127.0.0.1:1", "--jobs", "2").stderr


@pytest.mark.slow
def test_an_interrupted_sweep_prints_its_rows_and_can_be_resumed(folder: Path, call_json: CallJson) -> None:
    (folder / "beam.yaml").write_text(LONG)
    # compiled beforehand, so that what is waited for is the sweep
    run_case(load_case_text(LONG, overrides=["solver.t_end=1e-3"], vocabulary=vocabulary()))
    arguments = ["sweep", "beam.yaml", "--over", "solver.t_end=1e-3,2.0,2.1", "--jobs", "2", "--csv", "t.csv",
                 "--keep", "--json"]
    process = start(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    until = time.monotonic() + 120
    # one row is finished and taken, the others are under way
    while not (any(p.read_bytes().count(b"\n") == 2 for p in folder.glob("beam-sweep/*.rows"))
               and len(list(folder.glob("beam-sweep/runs/*.part"))) == 2):
        assert time.monotonic() < until
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert err.split("\n")[-3:-1] == ["interrupted", "1 of 3 rows are finished, with results in beam-sweep/sweep.h5; "
                                      "run the same command again to continue"]
    found = json.loads(out)
    assert found["status"] == "interrupted"
    assert [row["status"] for row in found["rows"]] == ["converged", "waiting", "waiting"]
    assert len((folder / "t.csv").read_text().splitlines()) == 2
    # another number of processes computes the same rows
    rows = call_json(*("1" if word == "2" else word for word in arguments))["rows"]
    assert [(row["status"], row["reused"]) for row in rows] == [("converged", True), *[("converged", False)] * 2]
