"""Independent jobs in one process or in several."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from multiprocessing import spawn
from pathlib import Path

import pytest
from jobs import die, square, threads

from ancf2d.cores import cores
from ancf2d.study.pool import Workers, run_jobs, silent_orphans

HERE = Path(__file__).parent


def minus(job: float) -> float:
    return -job


@pytest.mark.parametrize("processes", [1, 2])
def test_results_keep_the_order_of_the_jobs(processes: int) -> None:
    found: dict[int, float] = {}
    assert run_jobs(square, [3.0, 1.0, 2.0], Workers(processes), minus, found.__setitem__) == [9.0, 1.0, 4.0]
    assert found == {0: 9.0, 1: 1.0, 2: 4.0}


def test_death_of_a_process_takes_no_other_job_with_it() -> None:
    assert run_jobs(die, list(range(15)), Workers(2), minus) == [0, 1, -2, *range(3, 12), -12, 13, 14]


def test_libraries_start_no_threads_in_the_processes() -> None:
    assert run_jobs(threads, [1, 2], Workers(2), minus) == [0, 0]


def test_as_many_cores_as_this_process_may_use() -> None:
    assert cores() == int(subprocess.run(["nproc"], env={"PATH": os.environ["PATH"]}, capture_output=True, text=True,
                                         check=True).stdout)


@pytest.mark.parametrize(("how", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_processes_end_with_the_one_that_began_them(tmp_path: Path, how: signal.Signals, code: int) -> None:
    """Interrupted or killed: no process is left behind, and none says anything."""
    script = f"""
import sys
sys.path.insert(0, {str(HERE)!r})
from jobs import wait_with_note
from ancf2d.study.pool import Workers, run_jobs
if __name__ == "__main__":
    try:
        run_jobs(wait_with_note, [{str(tmp_path)!r}] * 4, Workers(2), len)
    except KeyboardInterrupt:
        sys.exit(130)
"""
    file = tmp_path / "main.py"
    file.write_text(script)
    process = subprocess.Popen([sys.executable, str(file)], stderr=subprocess.PIPE, text=True,
                               start_new_session=True)
    children = _wait_for_numbers(tmp_path, 2)
    # a terminal interrupts all of its processes
    (os.killpg if how is signal.SIGINT else os.kill)(process.pid, how)
    _, said = process.communicate(timeout=20)
    assert process.returncode == code
    assert "Traceback" not in said
    until = time.monotonic() + 10
    while any(Path(f"/proc/{n}").exists() for n in children) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(Path(f"/proc/{n}").exists() for n in children)


def _wait_for_numbers(folder: Path, count: int) -> list[str]:
    until = time.monotonic() + 20
    while time.monotonic() < until:
        found = [p.name for p in folder.iterdir() if p.name.isdigit()]
        if len(found) == count:
            return found
        time.sleep(0.05)
    raise AssertionError("the processes did not begin")


@pytest.mark.skipif(os.name != "posix", reason="pipes are handed on in another way")
def test_a_process_whose_parent_died_before_it_was_told_what_to_do_is_silent() -> None:
    (tracker, other), (reader, writer) = os.pipe(), os.pipe()
    os.close(writer)
    with silent_orphans():
        line = spawn.get_command_line(tracker_fd=tracker, pipe_handle=reader)
    found = subprocess.run(line, pass_fds=(tracker, reader), capture_output=True, text=True, timeout=60)
    assert (found.returncode, found.stdout, found.stderr) == (1, "", "")
    for descriptor in (tracker, other, reader):
        os.close(descriptor)
