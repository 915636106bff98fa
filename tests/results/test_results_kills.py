"""Kills at any moment: the file on disk is the last commit or the one before, never a part of one."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import HEADER, coordinates, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.results import ResultWriter, open_results, part_path
from ancf2d.results import series as series_module
from ancf2d.results import writer as writer_module
from ancf2d.results.journal import JournaledFile, open_hdf5

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
KILLED = 9  # the exit code of a process that kill_at ended


def dies(moment: int, action: Callable[[], object]) -> bool:
    """Run a function in a process that dies in its ``moment``-th change to a file; False if it survived."""
    process = os.fork()
    if not process:
        try:
            kill_at(moment)
            action()
            os._exit(0)
        finally:
            os._exit(1)
    end = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    assert end in (0, KILLED)
    return end == KILLED


def moments(part: Path, action: Callable[[], object]) -> Iterator[bool]:
    """Run a function in processes, each of which dies at a later moment, until one survives.

    The file is as it was at first before each, and so is the writer, which belongs to this process.
    """
    content = part.read_bytes()
    for moment in range(1, 10_000):
        died = dies(moment, action)
        yield died
        if not died:
            return
        part.write_bytes(content)


def kill_at(moment: int) -> None:
    """Kill this process in the middle of its ``moment``-th change to a file."""
    left, write, cut = [moment], os.pwrite, os.ftruncate

    def dying_write(descriptor: int, data: bytes, at: int) -> int:
        left[0] -= 1
        if left[0] == 0:
            write(descriptor, memoryview(data)[:len(data) // 2], at)
            os._exit(KILLED)
        return write(descriptor, data, at)

    def dying_cut(descriptor: int, size: int) -> None:
        left[0] -= 1
        if left[0] == 0:
            os._exit(KILLED)
        cut(descriptor, size)

    os.pwrite, os.ftruncate = dying_write, dying_cut  # type: ignore[assignment]


def grown(path: Path, states: int) -> ResultWriter:
    """A running file with ``states`` committed states."""
    e0 = coordinates("tangent", np.linspace(0, 1, 3), 0.0)
    w = ResultWriter(path, HEADER, [tangent_body("beam", 2, 1.0, 0.1)], e0)
    for i in range(states):
        add(w, i)
    w.flush()
    return w


def add(w: ResultWriter, i: int) -> None:
    w.append(i, np.full(12, float(i)), {"step": i}, {"tip": {"x": i, "y": -i}})


def check_states(path: Path) -> int:
    """Check that the states in a file are complete; return their number."""
    with open_results(path) as r:
        np.testing.assert_array_equal(r.t, np.arange(r.nt))
        for i in np.unique(np.linspace(0, r.nt - 1, 30).astype(int)) if r.nt else ():
            np.testing.assert_array_equal(r.d(i), float(i))
        if r.nt:
            np.testing.assert_array_equal(r.history["step"], np.arange(r.nt))
            np.testing.assert_array_equal(r.probes["tip"]["y"], -np.arange(r.nt))
        return r.nt


def test_every_moment_of_a_commit_leaves_the_old_states_or_the_new(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 1e9)
    monkeypatch.setattr(series_module, "COLUMN_CHUNK", 1)  # index nodes split every 64 rows
    monkeypatch.setattr(series_module, "LARGEST_COLUMN_CHUNK", 1)
    w = grown(tmp_path / "a.h5", 64)
    for i in range(64, 70):
        add(w, i)
    outcomes = [check_states(part_path(w.path)) for _ in moments(part_path(w.path), w.flush)]
    w.discard()
    assert len(outcomes) > 20
    assert outcomes == sorted(outcomes)
    assert set(outcomes) == {64, 70}


class Unjournaled(JournaledFile):
    """What HDF5 writes goes to the disk at once."""

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        os.pwrite(self._descriptor, view, self._at)
        self._at += len(view)
        self._size = max(self._size, self._at)
        return len(view)


def test_plain_flushes_of_hdf5_would_leave_unreadable_files(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 1e9)
    monkeypatch.setattr(writer_module, "JournaledFile", Unjournaled)
    lost = 0
    w = grown(tmp_path / "a.h5", 64)
    for i in range(64, 70):
        add(w, i)
    for _ in moments(part_path(w.path), w.flush):
        try:
            check_states(part_path(w.path))
        except ResultsError:
            lost += 1
    w.discard()
    assert lost > 0


def test_every_moment_of_the_first_commit_leaves_a_readable_file(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 1e9)
    w = grown(tmp_path / "a.h5", 0)
    for i in range(3):
        add(w, i)
    outcomes = [check_states(part_path(w.path) if died else w.path)
                for died in moments(part_path(w.path), lambda: w.finish({}))]
    w.discard()
    assert set(outcomes) == {0, 3}


def test_a_damaged_journal_is_not_read(tmp_path: Path,
                                       monkeypatch: pytest.MonkeyPatch) -> None:
    w = grown(tmp_path / "a.h5", 3)
    add(w, 3)
    with monkeypatch.context() as patch:
        patch.setattr(os, "ftruncate", lambda *_: None)
        w.flush()
    content = part_path(w.path).read_bytes()
    w.discard()
    for place in (slice(-1, None), slice(-12, -8), slice(-20, -12), slice(-8000, -28)):
        broken = bytearray(content)
        broken[place] = bytes(b ^ 0xA5 for b in broken[place])
        (tmp_path / "b.h5").write_bytes(broken)
        try:  # the pages are in place already, so what lies below is whole
            assert check_states(tmp_path / "b.h5") == 4
        except ResultsError:
            pytest.fail("a file was refused for the damaged journal behind it")


def test_reads_and_sizes_include_uncommitted_writes(tmp_path: Path) -> None:
    (tmp_path / "f").write_bytes(bytes(range(256)) * 40)
    reference = bytearray((tmp_path / "f").read_bytes())
    descriptor = os.open(tmp_path / "f", os.O_RDWR)
    rng = np.random.default_rng(2)
    stream = JournaledFile(descriptor)
    for k in range(200):
        at, count = int(rng.integers(0, 30_000)), int(rng.integers(1, 9000))
        data = rng.bytes(count)
        stream.seek(at)
        assert stream.write(data) == count
        reference.extend(bytes(max(0, at + count - len(reference))))
        reference[at:at + count] = data
        if k % 17 == 16:
            stream.commit()
            assert (tmp_path / "f").read_bytes() == reference
        stream.seek(at := int(rng.integers(0, len(reference))))
        found = bytearray(5000)
        stream.readinto(found)
        assert found == reference[at:at + 5000].ljust(5000, b"\0")
    os.close(descriptor)


def test_a_plain_hdf5_file_needs_no_journal(tmp_path: Path) -> None:
    w = grown(tmp_path / "a.h5", 3)
    with open_hdf5(part_path(w.path)) as f:
        assert f["states/t"].shape == (3,)
    w.discard()


ENDLESS = """
import sys
sys.path[:0] = {paths!r}
import numpy as np
import ancf2d.results.writer as writer
from synthetic import HEADER, coordinates, tangent_body
writer.FLUSH_SECONDS = {flush}
e0 = coordinates("tangent", np.linspace(0, 1, {ne} + 1), 0.0)
print("ready", flush=True)
with writer.ResultWriter({path!r}, HEADER, [tangent_body("beam", {ne}, 1.0, 0.1)], e0) as w:
    for i in range(10**9):
        w.append(i, np.full(len(e0), float(i)), {{"step": i}}, {{"tip": {{"x": i, "y": -i}}}})
"""


def test_a_process_that_is_killed_leaves_a_readable_file_or_none(tmp_path: Path) -> None:
    rng, paths = random.Random(5), [str(HERE.parents[1]), str(HERE)]
    for k in range(8):
        path = tmp_path / f"{k}.h5"
        code = ENDLESS.format(paths=paths, flush=rng.choice([0.0, 0.002]), path=str(path),
                              ne=rng.choice([4, 200]))
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(rng.uniform(0, 0.25))
            process.kill()
        assert not path.exists()
        if part_path(path).exists():
            check_states(part_path(path))
    left = list(tmp_path.iterdir())
    assert [p.suffix for p in left] == [".part"] * len(left)


def test_data_behind_the_last_commit_of_a_killed_run_is_not_read(tmp_path: Path) -> None:
    """A damaged heap of texts is damage where HDF5 would read it, and harmless behind the commit."""
    w = grown(tmp_path / "a.h5", 3)
    w.flush()
    left = tmp_path / "b.h5.part"
    heap = b"GCOL\x01\0\0\0" + (4096).to_bytes(8, "little") + b"\x01" + bytes(4079)
    left.write_bytes(part_path(w.path).read_bytes() + heap)
    assert check_states(left) == 3
    w.discard()
