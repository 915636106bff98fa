"""Some of the mutants that docs/robustness.md reports by the thousand, and the trial itself."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from instruments.fuzz import case_mutants, case_trial, command, pen, result_mutants, result_trial, trees

pytestmark = pytest.mark.slow

LINUX = pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="needs the memory of processes")


@LINUX
def test_mutants_of_case_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "work").mkdir()
    found = [trial for trial, _ in case_trial.trials(tmp_path / "work", 7, range(40))]
    assert [f for trial in found for f in trial.faults] == []
    assert {trial.validated for trial in found} == {0, 2}


@LINUX
def test_mutants_of_result_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("bases", "work"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(result_mutants, "KINDS", {k: result_mutants.KINDS[k] for k in ("static", "modes")})
    bases = result_mutants.make_bases(tmp_path / "bases")
    found = [trial for trial, _ in result_trial.trials(tmp_path / "work", bases, 7, range(6))]
    assert [f for trial in found for f in trial.faults] == []
    assert {trial.read for trial in found} == {True, False}


def test_mutants_are_the_same_every_time() -> None:
    assert case_mutants.mutant(3, 5) == case_mutants.mutant(3, 5) != case_mutants.mutant(3, 6)
    base = case_mutants.bases()[0]
    before = list(trees.places(base))
    case_mutants.mutant(3, 5)
    assert list(trees.places(case_mutants.bases()[0])) == before


def _misbehave(job: str) -> str:
    if job == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if job == "memory":
        return str(len(bytearray(1 << 30)))
    if job == "hang":
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        time.sleep(60)
    if job == "long":
        time.sleep(60)
    return job


@LINUX
def test_work_that_dies_hangs_or_takes_too_much_is_detected() -> None:
    limits = pen.Limits(patience=0.5, grace=0.5, memory=200 << 20)
    found: dict[str, Any] = {job: ended for job, ended in pen.confined(
        _misbehave, ["fine", "die", "memory", "hang", "long", "again"], limits)}
    assert found["die"].fault == "its process was ended by SIGKILL"
    assert found["memory"].fault.startswith("MemoryError")
    assert found["hang"].fault == "went on for 0 s after it was interrupted"
    assert found["long"].notes == ["interrupted outside of a command"]
    assert (found["fine"].value, found["again"].value) == ("fine", "again")


@pytest.mark.parametrize(("code", "out", "err", "said"), [
    (3, "", "error: no", "exit code 3"), (1, "", "Traceback (most recent call last)", "prints 'Traceback"),
    (1, "", "internal error, please report", "internal error"), (2, "", "", "without a word")])
def test_broken_promises_are_detected(code: int, out: str, err: str, said: str) -> None:
    assert any(said in fault for fault in command.Called(["run", "a.yaml"], code, out, err).faults())
    assert any("no JSON" in fault for fault in command.Called(["run", "--json"], 0, "{", "").faults())
    assert command.unreal_numbers({"a": [1.0, {"b": float("nan")}]}) == ["summary.a[1].b"]
