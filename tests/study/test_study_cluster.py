"""The same jobs on a Dask scheduler with its workers, all on the loopback interface."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest
from jobs import die, square, wait_with_note

from ancf2d.errors import ComputationError
from ancf2d.study import pool
from ancf2d.study.pool import Workers, run_jobs

# every process that collects tests would import it
pytestmark = [pytest.mark.slow, pytest.mark.skipif(find_spec("distributed") is None, reason="without distributed")]
HERE = Path(__file__).parent


@contextmanager
def dask(folder: Path, *arguments: str, **more: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run ``dask`` with access to the jobs of these tests, and end it."""
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, **more}
    with (folder / "dask.log").open("ab") as log:
        process = subprocess.Popen([sys.executable, "-m", "dask", *arguments], env=environment, stdout=log,
                                   stderr=log, cwd=folder)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(2)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def started_scheduler(folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Give a scheduler with its address."""
    file = folder / "scheduler.json"
    # by default, a job is tried on three more workers before it is held to be what kills them
    with dask(folder, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show",
              "--scheduler-file", str(file), DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0") as process:
        until = time.monotonic() + 30
        while not (file.exists() and file.stat().st_size):
            assert time.monotonic() < until, (folder / "dask.log").read_text()
            time.sleep(0.05)
        yield process, json.loads(file.read_text())["address"]


@contextmanager
def scheduler(folder: Path) -> Iterator[str]:
    """Give the address of a scheduler."""
    with started_scheduler(folder) as (_, found):
        yield found


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a scheduler with a worker of two threads."""
    folder = tmp_path_factory.mktemp("dask")
    with ExitStack() as stack:
        found = stack.enter_context(scheduler(folder))
        stack.enter_context(dask(folder, "worker", found, "--nthreads", "2", "--no-dashboard", "--local-directory",
                                 str(folder)))
        yield found


def minus(job: float) -> float:
    return -job


def test_results_keep_the_order_of_the_jobs(address: str) -> None:
    found: dict[int, float] = {}
    workers = Workers(scheduler=address)
    results = run_jobs(square, [3.0, 1.0, 2.0], workers, minus, lambda i, x, seconds: found.update({i: x}))
    assert results == [9.0, 1.0, 4.0]
    assert found == {0: 9.0, 1: 1.0, 2: 4.0}


def test_another_version_on_a_worker_is_refused(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool, "program", lambda: "0.0.1")
    with pytest.raises(ComputationError, match=r"a worker has ancf2d .*, this is 0\.0\.1"):
        run_jobs(square, [1.0], Workers(scheduler=address), minus)


def test_functions_missing_on_workers_are_reported(address: str, tmp_path: Path,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "only_here.py").write_text("def same(x):\n    return x\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    from only_here import same

    with pytest.raises(ComputationError, match=r"cannot run ancf2d: .*deserialization"):
        run_jobs(same, [1.0], Workers(scheduler=address), minus)


def test_death_of_a_worker_ends_only_its_job(address: str) -> None:
    assert run_jobs(die, [2], Workers(scheduler=address), minus) == [-2]
    assert run_jobs(die, [0, 1], Workers(scheduler=address), minus) == [0, 1]


@pytest.mark.parametrize(("begin", "said"), [
    (lambda address: "tcp://127.0.0.1:1", "there is no Dask scheduler at tcp://127.0.0.1:1"),
    (lambda address: address, "has no workers")], ids=["no scheduler", "no workers"])
def test_a_missing_scheduler_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begin: Callable[[str], str],
                                         said: str) -> None:
    monkeypatch.setattr(pool, "CONNECT", 2.0)
    monkeypatch.setattr(pool, "WORKERS", 0.5)
    with scheduler(tmp_path) as lonely, pytest.raises(ComputationError, match=said):
        run_jobs(square, [1.0], Workers(scheduler=begin(lonely)), minus)


def test_a_lost_scheduler_is_reported_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                      capfd: pytest.CaptureFixture[str]) -> None:
    """Nothing else is printed, although Dask logs tracebacks."""
    monkeypatch.setattr(pool, "CONNECT", 2.0)
    began = tmp_path / "began"
    began.mkdir()

    def kill_when_begun() -> None:
        until = time.monotonic() + 20
        while not list(began.iterdir()) and time.monotonic() < until:
            time.sleep(0.02)
        process.kill()

    with started_scheduler(tmp_path) as (process, found), dask(tmp_path, "worker", found, "--nthreads", "1",
                                                              "--no-dashboard", "--no-nanny", "--local-directory",
                                                              str(tmp_path)):
        threading.Thread(target=kill_when_begun, daemon=True).start()
        with pytest.raises(ComputationError, match=r"the scheduler at .* was lost"):
            run_jobs(wait_with_note, [str(began)], Workers(scheduler=found), len)
    assert capfd.readouterr().err == ""


def test_files_have_paths_that_other_workers_can_find() -> None:
    assert Workers(scheduler="tcp://127.0.0.1:8786").file("a.h5") == str(Path.cwd() / "a.h5")
    assert Workers(2).file("a.h5") == "a.h5"
