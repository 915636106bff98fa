"""A forked copy of the process: its work is available at the end, and it never outlives its block."""

import os
import re
import sys
import threading
import time
from pathlib import Path

import pytest

from ancf2d import processors as module
from ancf2d.api import solving
from ancf2d.processors import _openblas, aside, one_blas_thread

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="copies are made on Linux alone")


@pytest.fixture(autouse=True)
def two_processors(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")


def children() -> set[str]:
    """Return the child processes of this process."""
    return set(Path(f"/proc/self/task/{threading.get_native_id()}/children").read_text().split())


def test_the_work_of_the_copy_is_done_at_the_end_and_by_the_copy_alone(tmp_path):
    def work():
        time.sleep(0.2)
        (tmp_path / "done").write_text(str(os.getpid()))

    before = children()
    with aside(work):
        assert not (tmp_path / "done").exists()
    assert int((tmp_path / "done").read_text()) != os.getpid()
    assert children() == before


def test_failures_in_the_copy_are_silent(capfd):
    def work():
        print("never seen")
        raise ValueError("never seen")

    with aside(work):
        pass
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_block_that_fails_ends_the_copy(error):
    began, before = time.monotonic(), children()
    with pytest.raises(error), aside(lambda: time.sleep(60)):
        raise error
    assert time.monotonic() - began < 30
    assert children() == before


def test_a_copy_that_hangs_is_ended(monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", 0.1)
    before = children()
    with aside(lambda: time.sleep(60)):
        pass
    assert children() == before


def test_one_processor_is_not_shared(monkeypatch, tmp_path):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    with aside(lambda: (tmp_path / "done").touch()):
        time.sleep(0.2)
    assert not (tmp_path / "done").exists()


@pytest.mark.skipif(not list(_openblas()), reason="NumPy uses another library")
def test_python_functions_restrict_openblas_and_restore_it(monkeypatch):
    """Also if NumPy is loaded first: a variable of the environment would then have no effect."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    found, before = list(_openblas()), [number() for number, _ in _openblas()]

    def numbers():
        return [number() for number, _ in found]
    try:
        for _, restrict in found:
            restrict(2)
        several = numbers()
        with one_blas_thread():
            with one_blas_thread():
                assert numbers() == [1] * len(found)
            assert numbers() == [1] * len(found)
        assert numbers() == several
        monkeypatch.setattr(solving, "load", lambda *arguments: pytest.fail(str(numbers())))
        for call in (solving.solve, solving.convergence, solving.sensitivity):
            with pytest.raises(pytest.fail.Exception, match=re.escape(str([1] * len(found)))):
                call("case.yaml")
        assert numbers() == several
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
        with one_blas_thread():
            assert numbers() == several
    finally:
        for (_, restrict), n in zip(found, before, strict=True):
            restrict(n)
