"""Independent jobs in one process or in several."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from jobs import die, square, threads

from ancf2d.processors import cores
from ancf2d.study.pool import Workers, run_jobs

HERE = Path(__file__).parent


def minus(job: float) -> float:
    return -job


@pytest.mark.parametrize("processes", [1, 2])
def test_results_keep_the_order_of_the_jobs(processes: int) -> None:
    found: dict[int, float] = {}
    results = run_jobs(square, [3.0, 1.0, 2.0], Workers(processes), minus, lambda i, x, seconds: found.update({i: x}))
    assert results == [9.0, 1.0, 4.0]
    assert found == {0: 9.0, 1: 1.0, 2: 4.0}


@pytest.mark.slow
def test_death_of_a_process_ends_only_its_job() -> None:
    assert run_jobs(die, list(range(15)), Workers(2), minus) == [0, 1, -2, *range(3, 12), -12, 13, 14]


@pytest.mark.slow
def test_libraries_start_no_threads_in_the_processes() -> None:
    assert run_jobs(threads, [1, 2], Workers(2), minus) == [0, 0]


def test_the_number_of_available_cores() -> None:
    assert cores() == int(subprocess.run(["nproc"], env={"PATH": os.environ["PATH"]}, capture_output=True, text=True,
                                         check=True).stdout)


SCRIPT = """
import os, sys
from multiprocessing import popen_spawn_posix
sys.path.insert(0, {tests!r})
from jobs import wait_with_note
from ancf2d.study.pool import Workers, run_jobs

def stopped(*given):
    number = begin(*given)
    os.kill(os.getpid(), {at_once})
    return number

if __name__ == "__main__":
    if {at_once}:
        begin, popen_spawn_posix.util.spawnv_passfds = popen_spawn_posix.util.spawnv_passfds, stopped
    try:
        run_jobs(wait_with_note, [{folder!r}] * 4, Workers(2), len)
    except KeyboardInterrupt:
        sys.exit(130)
"""
ENDS = {signal.SIGINT: 130, signal.SIGTERM: -signal.SIGTERM, signal.SIGKILL: -signal.SIGKILL}


def _sweeping(folder: Path, at_once: int = 0) -> subprocess.Popen[str]:
    """Start two processes, from one that stops itself as soon as the first has started if ``at_once`` is a signal."""
    file = folder / "main.py"
    file.write_text(SCRIPT.format(tests=str(HERE), folder=str(folder), at_once=int(at_once)))
    return subprocess.Popen([sys.executable, str(file)], stderr=subprocess.PIPE, text=True, start_new_session=True)


@pytest.mark.slow
@pytest.mark.parametrize("how", ENDS)
def test_processes_end_with_their_parent(tmp_path: Path, how: signal.Signals) -> None:
    """Interrupted or killed: no process is left behind, and none prints anything."""
    process = _sweeping(tmp_path)
    children = _wait_for_numbers(tmp_path, 2)
    # a terminal interrupts all of its processes
    (os.killpg if how is signal.SIGINT else os.kill)(process.pid, how)
    _, said = process.communicate(timeout=20)
    assert (process.returncode, said) == (ENDS[how], "")
    until = time.monotonic() + 10
    while any(Path(f"/proc/{n}").exists() for n in children) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(Path(f"/proc/{n}").exists() for n in children)


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_new_processes_get_their_first_job(tmp_path: Path, how: signal.Signals) -> None:
    process = _sweeping(tmp_path, how)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (ENDS[how], "")


def _wait_for_numbers(folder: Path, count: int) -> list[str]:
    until = time.monotonic() + 20
    while time.monotonic() < until:
        found = [p.name for p in folder.iterdir() if p.name.isdigit()]
        if len(found) == count:
            return found
        time.sleep(0.05)
    raise AssertionError("the processes did not begin")
