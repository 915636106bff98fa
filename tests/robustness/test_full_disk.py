"""Full disks: an explanation, no damaged file, and HDF5 continues to work."""

from __future__ import annotations

import errno
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from instruments.endurance import scenes
from instruments.fuzz.command import Called, call
from synthetic import HEADER, bent_beam, coordinates, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.results import ResultWriter, journal, open_results, part_path
from ancf2d.results.journal import JournaledFile

pytestmark = pytest.mark.slow
BEAM = scenes.case({"type": "linear_static"})


@contextmanager
def room(size: int) -> Iterator[None]:
    """Limit the size of files (bytes), as on a disk that fills."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    # Python would keep the first half of the bytecode of what is imported meanwhile, and not import it again
    writes, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        sys.dont_write_bytecode = writes


def refused(found: Called) -> None:
    """Check that a command failed with one sentence."""
    assert found.code == 1
    assert found.faults() == []
    assert found.err.count("error: ") == 1
    assert "cannot write" in found.err
    assert "File too large" in found.err


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a sound result."""
    monkeypatch.chdir(tmp_path)
    bent_beam(tmp_path / "sound.h5")
    return tmp_path


@pytest.mark.parametrize("size", [0, 10_000, 30_000, 60_000])
def test_a_run_leaves_a_readable_file_or_none(folder: Path, size: int) -> None:
    scenes.write(folder, "case", {**scenes.LONG, "solver": {"type": "dynamic", "t_end": 0.2, "dt": 1e-3}})
    assert call("run", "case.yaml", "-q").code == 0  # its kernels are compiled
    (folder / "case.h5").unlink()
    with room(size):
        refused(call("run", "case.yaml", "-q"))
    assert {p.name for p in folder.iterdir()} <= {"case.yaml", "sound.h5", "case.h5.part"}
    if (folder / "case.h5.part").exists():
        open_results(folder / "case.h5.part").close()


@pytest.mark.parametrize(("arguments", "size"), [
    (["export", "sound.h5", "out.vtkhdf"], 5000), (["export", "sound.h5", "out.json"], 100),
    (["export", "sound.h5", "out.csv"], 10), (["plot", "sound.h5", "--save", "out.png"], 5000),
    (["plot", "sound.h5", "--animate", "out.gif", "--frames", "2"], 5000),
    (["plot", "sound.h5", "--data", "out.csv"], 100), (["view", "sound.h5", "--save", "out.html"], 5000)],
    ids=lambda v: " ".join(v) if isinstance(v, list) else "")
def test_incomplete_files_of_commands_are_removed(folder: Path, arguments: list[str], size: int) -> None:
    with room(size):
        refused(call(*arguments))
    assert [p.name for p in folder.iterdir()] == ["sound.h5"]


def test_an_earlier_figure_stays(folder: Path) -> None:
    (folder / "out.png").write_bytes(b"earlier")
    with room(5000):
        refused(call("plot", "sound.h5", "--save", "out.png", "--force"))
    assert (folder / "out.png").read_bytes() == b"earlier"


def _full(*args: object) -> int:
    raise OSError(errno.ENOSPC, "No space left on device")


def _told(found: Called, file: str) -> None:
    """Check that a command names a file that it could not write, and says that the disk is full and what to do."""
    assert found.code == 1
    assert f"cannot write '{file}': the disk is full (No space left on device); free space on it" in found.err


def test_a_run_on_a_full_disk_names_its_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenes.write(folder, "case", BEAM)
    with monkeypatch.context() as disk:
        disk.setattr("ancf2d.results.target.os.write", _full)
        found = call("run", "case.yaml", "-q")
    _told(found, "case.h5")
    assert sorted(p.name for p in folder.iterdir()) == ["case.yaml", "sound.h5"]


def test_a_motion_on_a_disk_that_fills_can_be_resumed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenes.write(folder, "case", {**scenes.LONG, "solver": {"type": "dynamic", "t_end": 0.2, "dt": 1e-3}})
    commit, commits = JournaledFile.commit, []

    def fill(self: JournaledFile) -> None:
        commits.append(1)
        commit(self) if len(commits) < 4 else _full()

    monkeypatch.setattr("ancf2d.results.writer.FLUSH_SECONDS", 0.0)
    with monkeypatch.context() as disk:
        disk.setattr(JournaledFile, "commit", fill)
        found = call("run", "case.yaml", "-q")
    _told(found, "case.h5")
    assert "the states written before stay in 'case.h5.part', and --resume continues from them" in found.err
    assert call("run", "case.yaml", "-q", "--resume").code == 0
    assert not (folder / "case.h5.part").exists()


def test_a_sweep_on_a_full_disk_names_its_file_and_keeps_its_rows(folder: Path,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    scenes.write(folder, "case", BEAM)
    sweep = ("sweep", "case.yaml", "--over", "bodies.beam.element.count=1,2,3", "--jobs", "1", "-o", "out", "-q")
    # compiled code has to be stored, too
    assert call("run", "case.yaml", "-q").code == 0
    with monkeypatch.context() as disk:
        disk.setattr("ancf2d.results.target.os.write", _full)
        found = call(*sweep)
    _told(found, "out/sweep.h5")
    assert "the rows computed before are kept, and the same command continues from them" in found.err
    assert [p.name for p in (folder / "out").iterdir()] == ["sweep.rows"]
    found = call(*sweep[:-1])
    assert (found.code, "3 of 3 rows were computed before" in found.out + found.err) == (0, True)


def test_rows_that_cannot_be_listed_name_the_list(folder: Path) -> None:
    scenes.write(folder, "case", BEAM)
    with room(0):
        found = call("sweep", "case.yaml", "--over", "bodies.beam.element.count=1,2", "--jobs", "1", "-o", "out", "-q")
    assert (found.code, "cannot write 'out/sweep.rows': File too large" in found.err) == (1, True)
    assert list((folder / "out").iterdir()) == []


def _go_on(writer: ResultWriter, states: int = 20_000) -> None:
    for k in range(1, states):
        writer.append(k, np.full(12, 1.0 / k))
        writer.flush()


def test_earlier_commits_survive_disk_errors_within_hdf5(tmp_path: Path) -> None:
    e0 = coordinates("tangent", np.linspace(0, 1, 3), 0.0)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("beam", 2, 1.0, 0.1)], e0) as writer:
        writer.append(0, np.zeros(12))
        writer.flush()
        size = part_path(tmp_path / "a.h5").stat().st_size
        with room(size), pytest.raises(ResultsError, match=r"cannot write .*File too large"):
            _go_on(writer)
    with open_results(part_path(tmp_path / "a.h5")) as found:
        assert found.nt == 1


KERNEL = """
from ancf2d.kernels.lowlevel.jit import kernel

@kernel
def twice(x):
    return 2 * x
"""


def test_kernels_that_cannot_be_cached_are_still_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "kernel_of_a_full_disk.py").write_text(KERNEL)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("ancf2d.kernels.lowlevel.jit.CACHE", tmp_path / "cache")
    from kernel_of_a_full_disk import twice

    with room(0):
        assert twice(2) == 4
    assert [p.name for p in (tmp_path / "cache").iterdir()] == []


def test_a_failed_write_is_no_commit_even_if_there_is_room_again(tmp_path: Path,
                                                                 monkeypatch: pytest.MonkeyPatch) -> None:
    """The failing write is HDF5's own, of data behind the commit."""
    e0, failed, write, write_all = coordinates("tangent", np.linspace(0, 1, 3), 0.0), [], JournaledFile.write, \
        journal._write_all

    def fail(descriptor: int, data: memoryview, at: int) -> None:
        if len(data):
            failed.append(at)
            raise OSError(errno.ENOSPC, "No space left on device")

    def fail_once(self: JournaledFile, data: memoryview) -> int:
        monkeypatch.setattr(journal, "_write_all", write_all if failed else fail)
        try:
            return write(self, data)
        finally:
            monkeypatch.setattr(journal, "_write_all", write_all)

    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("beam", 2, 1.0, 0.1)], e0) as writer:
        writer.append(0, np.zeros(12))
        writer.flush()
        monkeypatch.setattr(JournaledFile, "write", fail_once)
        with pytest.raises(ResultsError, match=r"cannot write .*No space left on device"):
            _go_on(writer, 2000)
    with open_results(part_path(tmp_path / "a.h5")) as found:
        assert found.nt >= 1
        assert np.isfinite(found.rows("d")).all()
