"""The path of a result file: only success replaces an earlier result, and foreign files are safe."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from synthetic import bent_beam
from test_results_writer import start

from ancf2d.errors import ResultsError
from ancf2d.results import open_results, part_path
from ancf2d.results import target as target_module


def test_only_success_replaces_an_earlier_result(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5")
    before = path.read_bytes()
    assert bent_beam(path, finish=False) == part_path(path)
    assert path.read_bytes() == before
    with open_results(part_path(path)) as r:
        assert (r.status, r.nt) == ("interrupted", 6)
        assert r.summary == {"reason": "stopped", "output": str(part_path(path))}
    bent_beam(path, angle=2.0)
    assert path.read_bytes() != before
    assert os.listdir(tmp_path) == ["a.h5"]


@pytest.mark.parametrize(("error", "status"), [(ValueError("no pivot"), "failed"),
                                               (KeyboardInterrupt(), "interrupted")])
def test_leaving_by_an_exception_keeps_states(tmp_path: Path, error: BaseException,
                                              status: str) -> None:
    def run() -> None:
        with start(tmp_path / "a.h5") as w:
            w.append(0, np.zeros(12))
            raise error

    with pytest.raises(type(error)):
        run()
    assert os.listdir(tmp_path) == ["a.h5.part"]
    with open_results(tmp_path / "a.h5.part") as r:
        assert (r.status, r.nt) == (status, 1)


def test_leaving_by_an_exception_without_states_leaves_nothing(tmp_path: Path) -> None:
    def run() -> None:
        with start(tmp_path / "a.h5") as w:
            w.log({"step": 0})
            raise ValueError("no pivot")

    with pytest.raises(ValueError, match="no pivot"):
        run()
    assert os.listdir(tmp_path) == []


def test_a_failed_run_without_states_leaves_nothing(tmp_path: Path) -> None:
    with start(tmp_path / "a.h5") as w:
        w.finish({"status": "failed"}, "failed")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("unnamed", [True, False], ids=["unnamed file", "named file"])
def test_only_the_part_file_is_visible_during_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                    unnamed: bool) -> None:
    if not unnamed:
        monkeypatch.delattr(os, "O_TMPFILE")
    with start(tmp_path / "a.h5") as w:
        assert os.listdir(tmp_path) == ["a.h5.part"]
        with open_results(tmp_path / "a.h5.part") as r:
            assert (r.status, r.nt) == ("running", 0)
        w.append(0, np.zeros(12))
        w.flush()
        with open_results(tmp_path / "a.h5.part") as r:
            assert (r.status, r.nt) == ("running", 1)
        w.finish()
    assert os.listdir(tmp_path) == ["a.h5"]
    assert (tmp_path / "a.h5").stat().st_mode & 0o777 == 0o666 & ~_umask()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_a_foreign_file_is_replaced_only_with_force(tmp_path: Path) -> None:
    path = tmp_path / "thesis.h5"
    path.write_text("years of work")
    with pytest.raises(ResultsError, match=r"not made by ancf2d.*--force"):
        start(path)
    assert path.read_text() == "years of work"
    with start(path, force=True) as w:
        w.finish()
    with open_results(path) as r:
        assert r.status == "converged"


def test_a_foreign_file_that_appears_during_the_run_survives(tmp_path: Path) -> None:
    w = start(tmp_path / "a.h5")
    w.append(0, np.zeros(12))
    (tmp_path / "a.h5").write_text("mine")
    with pytest.raises(ResultsError, match=r"stays in .*a\.h5\.part"):
        w.finish()
    assert (tmp_path / "a.h5").read_text() == "mine"
    with open_results(tmp_path / "a.h5.part") as r:
        assert r.nt == 1


def test_a_missing_folder_a_folder_in_the_way_and_a_device_are_explained(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match="does not exist"):
        start(tmp_path / "none" / "a.h5")
    (tmp_path / "file").touch()
    with pytest.raises(ResultsError, match="is not a folder"):
        start(tmp_path / "file" / "a.h5")
    (tmp_path / "a.h5").mkdir()
    with pytest.raises(ResultsError, match="in the way"):
        start(tmp_path / "a.h5")
    (tmp_path / "b.h5.part").mkdir()
    with pytest.raises(ResultsError, match="in the way"):
        start(tmp_path / "b.h5")
    with pytest.raises(ResultsError, match=r"device|permission"):
        start(Path("/dev/null"), force=True)


def test_a_folder_without_permission_is_explained(tmp_path: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(target_module.os, "access", lambda *_: False)
    with pytest.raises(ResultsError, match="no permission to write"):
        start(tmp_path / "a.h5")


def test_a_full_disk_is_a_results_error_and_keeps_flushed_data(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    w = start(tmp_path / "a.h5")
    w.append(0, np.zeros(12))
    w.flush()

    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    w.append(1, np.zeros(12))
    with pytest.raises(ResultsError, match=r"cannot write .*No space left on device"):
        w.flush()
    monkeypatch.undo()
    with open_results(tmp_path / "a.h5.part") as r:
        assert r.nt == 1
    bent_beam(tmp_path / "a.h5")


def test_a_second_run_on_the_same_target_is_refused(tmp_path: Path) -> None:
    with start(tmp_path / "a.h5") as w:
        w.append(0, np.zeros(12))
        with pytest.raises(ResultsError, match="another run is writing"):
            start(tmp_path / "a.h5", force=True)
        w.finish()
    with open_results(tmp_path / "a.h5") as r:
        assert r.nt == 1


def test_the_file_of_a_killed_run_is_replaced(tmp_path: Path) -> None:
    bent_beam(tmp_path / "a.h5", finish=False)
    bent_beam(tmp_path / "a.h5")
    assert os.listdir(tmp_path) == ["a.h5"]


def test_a_foreign_part_file_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "a.h5.part").write_text("a download")
    with pytest.raises(ResultsError, match=r"a\.h5\.part' exists and was not made by ancf2d"):
        start(tmp_path / "a.h5")
    assert (tmp_path / "a.h5.part").read_text() == "a download"
