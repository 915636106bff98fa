"""A copy of the process that works meanwhile: its work is there at the end, and it never outlives the block."""

import os
import sys
import threading
import time
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

from ancf2d import processors as module
from ancf2d.processors import aside, done, first_to, spread

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="copies are made on Linux alone")


@pytest.fixture(autouse=True)
def two_processors(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")


def children() -> set[str]:
    """The processes that this one has started, which may have others than the copy."""
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


def test_what_goes_wrong_in_the_copy_is_not_told(capfd):
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


def wait_for(path: Path) -> None:
    end = time.monotonic() + 60.0
    while not path.exists():
        assert time.monotonic() < end, f"{path.name} has not been done"
        time.sleep(0.005)


def test_a_piece_that_two_tasks_need_is_done_once_while_another_task_is_taken(tmp_path):
    """The second task waits for the piece of the first, which ends after the third: a further copy has taken it."""
    def needs_the_piece(name):
        if first_to("piece"):
            (tmp_path / f"piece by {name}").touch()
            wait_for(tmp_path / "third")
            done("piece")
        else:
            assert (tmp_path / "third").exists()
        (tmp_path / name).touch()

    before = children()
    spread([partial(needs_the_piece, "first"), partial(needs_the_piece, "second"), (tmp_path / "third").touch])
    for name in ("first", "second"):
        wait_for(tmp_path / name)
    assert len(list(tmp_path.glob("piece by *"))) == 1
    assert children() == before


def test_who_fails_in_a_piece_leaves_it_to_those_who_wait(tmp_path):
    """The first to come ends without it; the other, which has waited, does it."""
    def only_the_second(name):
        while not first_to("piece"):
            pass
        if not (tmp_path / "failed").exists():
            (tmp_path / "failed").write_text(name)
            raise ValueError(name)
        (tmp_path / "piece").write_text(name)
        done("piece")

    with suppress(ValueError):  # where this process came first: its copies are ended then
        spread([partial(only_the_second, "first"), partial(only_the_second, "second")])
        wait_for(tmp_path / "piece")
        assert (tmp_path / "piece").read_text() != (tmp_path / "failed").read_text()
    assert (tmp_path / "failed").exists()


def test_tasks_of_one_processor_are_done_in_order(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    seen = []
    spread([partial(seen.append, k) for k in range(5)])
    assert seen == [0, 1, 2, 3, 4]
    assert first_to("piece")
