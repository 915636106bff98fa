"""Interrupted and resumed runs: the final file is that of an uninterrupted run."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from chaotic import DYNAMIC, begin, content, states
from helpers import covering
from synthetic import HEADER, coordinates, tangent_body
from test_results_kills import dies

from ancf2d.errors import ResultsError
from ancf2d.results import (
    Checkpoint,
    ResultWriter,
    compare_results,
    describe,
    describe_text,
    open_results,
    part_path,
    read_checkpoint,
)
from ancf2d.results import writer as writer_module

HERE = Path(__file__).parent


def whole(path: Path, until: int = 30) -> Path:
    """A run without interruption."""
    w = begin(path, False)
    states(w, until)
    return w.finish({})


@pytest.mark.slow_rows("0.0-1")
@covering(flush=[0.0, 1e9], every=[1, 4])
def test_resumed_run_ends_with_the_file_of_an_uninterrupted_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                                flush: float, every: int) -> None:
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", flush)
    path, k = tmp_path / "a.h5", 0
    while k < 30:
        w, k = begin(path, k > 0), min(k + 7, 30)
        states(w, k, every)
        w.finish({"reason": "interrupted"}, "interrupted")
        found = read_checkpoint(part_path(path))
        assert found is not None
        assert found.t == k - k % every
    w = begin(path, True)
    states(w, 30)
    w.finish({})
    assert content(path) == content(whole(tmp_path / "b.h5"))
    assert not compare_results(path, tmp_path / "b.h5", rtol=0, everything=True)
    assert not part_path(path).exists()


def test_rows_beyond_the_checkpoint_are_cut_off(tmp_path: Path) -> None:
    w = begin(tmp_path / "a.h5", False)
    states(w, 10, every=4)
    w.log_block({"step": np.arange(5), "late": np.ones(5)})
    w.finish({"reason": "full"}, "failed")
    with open_results(part_path(w.path)) as r:
        assert (r.nt, r.status) == (11, "failed")
    w = begin(tmp_path / "a.h5", True)
    assert w.resumed is not None
    assert w.resumed.t == 8
    with open_results(part_path(w.path)) as r:
        assert (r.nt, r.status, r.summary) == (9, "running", {})
        assert r.history.rows == sum(k % 3 + 1 for k in range(9))
        assert len(r.probe_t) == len(r.energies["kinetic"]) == 9
    w.discard()


@pytest.mark.slow
def test_every_moment_of_resuming_leaves_something_to_resume_from(tmp_path: Path,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that dies while it resumes an old file, with bytes of the previous one still behind its end."""
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 1e9)
    w = begin(tmp_path / "left.h5", False)
    states(w, 10, every=4)
    w.flush()
    left = Path(shutil.copy(part_path(w.path), tmp_path / "left"))
    w.discard()
    with left.open("ab") as file:
        file.write(b"\xa5" * 5000)
    reference, moments = content(whole(tmp_path / "whole.h5", 12)), 0
    for moment in range(1, 1000):
        path = tmp_path / f"{moment}.h5"
        shutil.copy(left, part_path(path))
        died = dies(moment, lambda path=path: begin(path, True))  # type: ignore[misc]
        w = begin(path, True)
        states(w, 12)
        assert content(w.finish({})) == reference
        if not died:
            break
        moments += 1
    assert moments > 2


def test_a_file_torn_in_a_commit_is_resumed_with_that_commit(tmp_path: Path,
                                                             monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 1e9)
    w = begin(tmp_path / "a.h5", False)
    states(w, 5)
    with monkeypatch.context() as patch:
        patch.setattr(os, "ftruncate", lambda *_: None)
        w.flush()
    shutil.copy(part_path(w.path), part_path(tmp_path / "b.h5"))
    w.discard()
    w = begin(tmp_path / "b.h5", True)
    assert w.resumed is not None
    assert w.resumed.t == 5
    states(w, 30)
    assert content(w.finish({})) == content(whole(tmp_path / "c.h5"))


@pytest.mark.parametrize(("changed", "word"), [
    ({"case_text": "other"}, "the case has changed"), ({"case_completed": "other"}, "the case has changed"),
    ({"overrides": ["a=1"]}, "--set")])
def test_another_case_is_not_resumed_and_the_file_stays(tmp_path: Path, changed: dict[str, object],
                                                        word: str) -> None:
    w = begin(tmp_path / "a.h5", False)
    states(w, 3)
    w.finish({}, "interrupted")
    before = part_path(w.path).read_bytes()
    with pytest.raises(ResultsError, match=word):
        begin(tmp_path / "a.h5", True, {**DYNAMIC, **changed})
    assert part_path(w.path).read_bytes() == before
    begin(tmp_path / "a.h5", True).discard()  # and its lock is free


def test_another_version_or_mesh_is_not_resumed(tmp_path: Path) -> None:
    w = begin(tmp_path / "a.h5", False)
    states(w, 3)
    w.finish({}, "interrupted")
    with pytest.raises(ResultsError, match="its mesh is different"):
        ResultWriter.resume(tmp_path / "a.h5", DYNAMIC, np.zeros(12))
    with h5py.File(part_path(w.path), "r+") as file:
        file.attrs["version_ancf2d"] = "0.0.1"
    with pytest.raises(ResultsError, match=r"written by ancf2d 0\.0\.1"):
        begin(tmp_path / "a.h5", True)


def test_nothing_to_resume_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match="there is no"):
        begin(tmp_path / "a.h5", True)
    w = begin(tmp_path / "a.h5", False)
    with pytest.raises(ResultsError, match="another run is writing"):
        begin(tmp_path / "a.h5", True)
    states(w, 3, every=100)
    w.append(4.0, np.zeros(12))
    w.finish({}, "interrupted")
    with h5py.File(part_path(w.path), "r+") as file:
        del file["checkpoint"]
    assert read_checkpoint(part_path(w.path)) is None
    with pytest.raises(ResultsError, match="holds no checkpoint"):
        begin(tmp_path / "a.h5", True)


def test_a_checkpoint_that_does_not_fit_its_file_is_damage(tmp_path: Path) -> None:
    w = begin(tmp_path / "a.h5", False)
    states(w, 3)
    w.finish({}, "interrupted")
    with h5py.File(part_path(w.path), "r+") as file:
        file["checkpoint"].attrs["rows"] = [7, 3, 4]
    with pytest.raises(ResultsError, match="does not fit its states"):
        begin(tmp_path / "a.h5", True)


def test_values_of_a_checkpoint_are_read_bit_for_bit(tmp_path: Path) -> None:
    first = {"x": np.array([np.nan, -0.0, 1 / 3]), "n": np.array(2**62), "gone": np.ones(3), "a/b": np.ones((2, 3))}
    second = {"x": np.array([[np.inf], [5e-324]]), "n": np.array(-1), "none": np.zeros((0, 4)), "a/b": np.eye(2, 3),
              "on": np.array([True, False])}
    w = begin(tmp_path / "a.h5", False)
    for t, values in enumerate((first, second)):
        w.append(t, np.zeros(12), checkpoint=Checkpoint(t, values, {"text": "e\u0301", "nan": float("nan")}))
        w.flush()
        found = read_checkpoint(part_path(w.path))
        assert found is not None
        assert found.t == t
        assert found.rows == (t + 1, 0, 0)
        assert found.notes["text"] == "e\u0301"
        assert np.isnan(found.notes["nan"])
        assert set(found.values) == set(values)
        for name, value in values.items():
            assert found.values[name].shape == value.shape
            assert found.values[name].tobytes() == value.tobytes()
    with pytest.raises(ResultsError, match="not numeric"):
        w.append(2.0, np.zeros(12), checkpoint=Checkpoint(2.0, {"name": np.array("text")}))
    w.discard()


def test_a_checkpoint_is_on_disk_with_its_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The checkpoint is in the commit that first contains its state, however long states take."""
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 0.0)
    w = begin(tmp_path / "a.h5", False)
    for k in range(4):
        w.append(k, np.zeros(12), steps={"step": np.arange(2)}, checkpoint=Checkpoint(k, {"k": np.array(k)}))
        found = read_checkpoint(part_path(w.path))
        assert found is not None
        assert found.t == k
        assert found.rows == (k + 1, 2 * k + 2, 0)
    w.discard()


def test_history_rows_of_states_are_the_last_of_their_steps(tmp_path: Path) -> None:
    w = begin(tmp_path / "a.h5", False)
    w.append(0.0, np.zeros(12))
    for n in (3, 1, 2):
        w.append(1.0, np.zeros(12), steps={"step": np.arange(n), "dt": np.full(n, float(n))})
    w.finish({})
    with h5py.File(w.path) as file:
        assert file["states/history_row"][()].tolist() == [-1, 2, 3, 5]
    with open_results(w.path) as r:
        assert r.history["dt"].tolist() == [3, 3, 3, 1, 2, 2]


def test_steps_of_different_lengths_are_refused(tmp_path: Path) -> None:
    with begin(tmp_path / "a.h5", False) as w, pytest.raises(ResultsError, match="different lengths"):
        w.log_block({"step": np.arange(2), "dt": np.ones(3)})


def test_a_million_steps_are_logged(tmp_path: Path) -> None:
    with begin(tmp_path / "a.h5", False) as w:
        for k in range(100):
            columns = {name: np.full(10_000, float(k)) for name in ("t", "dt", "error", "violation")}
            w.append(k, np.zeros(12), steps={"step": np.arange(10_000), **columns})
        w.finish({})
    with open_results(w.path) as r:
        np.testing.assert_array_equal(r.history["dt"], np.repeat(np.arange(100.0), 10_000))


def test_energies_are_compared(tmp_path: Path) -> None:
    for name, value in (("a", 1.0), ("b", 1.0 + 1e-6)):
        w = ResultWriter(tmp_path / f"{name}.h5", HEADER, [tangent_body("beam", 2, 1.0, 0.1)],
                         coordinates("tangent", np.linspace(0, 1, 3), 0.0))
        w.append(1.0, np.zeros(12), energies={"kinetic": value, "strain": 1e-20 * value})
        w.finish({})
    (found,) = compare_results(tmp_path / "a.h5", tmp_path / "b.h5")
    assert found.dataset == "/energies/kinetic"


def test_info_says_whether_a_run_can_be_or_was_resumed(tmp_path: Path) -> None:
    w = begin(tmp_path / "a.h5", False)
    states(w, 10, every=4)
    w.finish({}, "interrupted")
    assert "resumable   from t = 8, by 'ancf2d run CASE --resume'" in describe_text(describe(part_path(w.path)))
    w = begin(tmp_path / "a.h5", True)
    states(w, 12)
    w.finish({})
    text = describe_text(describe(w.path))
    assert "resumed once" in text
    assert "resumable" not in text


def test_info_lists_contacts_at_the_end(tmp_path: Path) -> None:
    w = begin(tmp_path / "a.h5", False)
    states(w, 2)
    w.finish({"contacts": [
        {"name": "grip", "force": [0.0, 2.5], "moment": 0.0, "length": 0.5, "from": 0.25, "to": 0.5},
        {"name": "stop", "force": [1.0, 0.0], "moment": 0.0, "length": 0.0, "from": 1.0, "to": 1.0},
        {"name": "fold", "force": [0.0, 0.0], "moment": 0.0, "normal": 3.5, "length": 0.5, "from": 0.2, "to": 0.7},
        {"name": "far", "force": [0.0, 0.0], "moment": 0.0, "length": 0.0, "from": None, "to": None}]})
    rows = [line.split(None, 1)[1] for line in describe_text(describe(w.path)).splitlines() if "contact " in line]
    assert rows == ["grip: force = (0, 2.5) N, at S = 0.25 to 0.5", "stop: force = (1, 0) N, at S = 1",
                    "fold: pressing force = 3.5 N, at S = 0.2 to 0.7", "far: no contact at the end"]


@pytest.mark.slow
def test_a_file_is_read_while_it_is_written(tmp_path: Path) -> None:
    """Readers see one commit or the next, never a part of each, and can continue with it."""
    path, seen = tmp_path / "a.h5", set()
    paths = os.pathsep.join([str(HERE.parents[1]), str(HERE)])
    command = [sys.executable, str(HERE / "chaotic.py"), str(path), "0.01", "100_000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": paths}) as process:
        assert process.stdout is not None
        process.stdout.readline()
        for _ in range(60):
            found = read_checkpoint(part_path(path))
            if found is not None:
                assert found.t == found.values["k"]
                seen.add(found.t)
            with open_results(part_path(path)) as r:
                time.sleep(1e-3)
                np.testing.assert_array_equal(r.t, np.arange(r.nt))
                assert r.history.rows == sum(k % 3 + 1 for k in range(r.nt))
                assert all(np.isfinite(r.d(i)).all() for i in range(0, r.nt, 50))
        process.kill()
    assert len(seen) > 10


@pytest.mark.slow
def test_a_run_killed_at_random_moments_is_still_finished(tmp_path: Path) -> None:
    rng, path, until = random.Random(7), tmp_path / "a.h5", 40_000
    paths = os.pathsep.join([str(HERE.parents[1]), str(HERE)])
    reached = -1.0
    for _ in range(8):
        command = [sys.executable, str(HERE / "chaotic.py"), str(path), rng.choice(["0", "0.01"]), str(until)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": paths}) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(rng.uniform(0, 0.12))
            process.kill()
        found = read_checkpoint(part_path(path)) if part_path(path).exists() else None
        if found is not None:
            assert found.t >= reached
            reached = found.t
            with open_results(part_path(path)) as r:
                assert r.t[-1] >= reached
                assert np.isfinite(r.d(-1)).all()
    assert reached > 0
    last = int(reached) + 20
    w = begin(path, True)
    states(w, last)
    assert content(w.finish({})) == content(whole(tmp_path / "b.h5", last))


@pytest.mark.parametrize("error", [OSError("Input/output error"), KeyboardInterrupt()], ids=["disk", "interruption"])
def test_states_survive_a_failure_to_resume(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                            error: BaseException) -> None:
    w = begin(tmp_path / "a.h5", False)
    states(w, 8)
    w.finish({}, "interrupted")
    before = part_path(tmp_path / "a.h5").read_bytes()

    def fail(descriptor: int) -> None:
        raise error

    with monkeypatch.context() as context:
        context.setattr(writer_module, "recovered", fail)
        with pytest.raises((ResultsError, KeyboardInterrupt)):
            begin(tmp_path / "a.h5", True)
    assert part_path(tmp_path / "a.h5").read_bytes() == before
    begin(tmp_path / "a.h5", True).discard()  # its lock is free
