"""Ctrl-C at awkward moments."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import HEADER, coordinates, tangent_body

from ancf2d.interrupts import AGAIN_SECONDS, COMPILERS, patient_interrupts, uninterrupted
from ancf2d.results import ResultWriter, open_results, part_path

pytestmark = pytest.mark.slow

OTHERS: list[ThreadPoolExecutor] = []
CALLBACK = """
def callback(interrupt):
    interrupt()
    return sum(range(1000))
"""


def _interrupt_now() -> None:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(5)


@pytest.mark.parametrize("module", [f"{name}.core.within" for name in COMPILERS])
def test_an_interruption_waits_until_a_kernel_is_compiled(module: str) -> None:
    scope: dict[str, Any] = {"__name__": module}
    exec(CALLBACK, scope)
    before = signal.getsignal(signal.SIGINT)
    with patient_interrupts():
        assert scope["callback"](lambda: os.kill(os.getpid(), signal.SIGINT)) == sum(range(1000))
        with pytest.raises(KeyboardInterrupt):
            time.sleep(5)
        with pytest.raises(KeyboardInterrupt):
            _interrupt_now()
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.skipif(os.name != "posix", reason="shells that ignore signals")
def test_interrupts_work_if_the_shell_ignores_them() -> None:
    """As a shell without job control does for background processes."""
    test = "test_critical_sections_are_finished_first"
    found = subprocess.run([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "slow or not slow",
                            f"{__file__}::{test}"],
                           preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN), capture_output=True,
                           text=True, timeout=120)
    assert found.returncode == 0, found.stdout


def test_interrupts_are_left_to_a_caller_that_handles_them() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with patient_interrupts():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("module", [f"{name}.core.within" for name in COMPILERS])
def test_an_interruption_that_waits_for_the_compiler_does_not_outlive_the_command(module: str) -> None:
    """It is raised at the end, and later code is not interrupted."""
    scope: dict[str, Any] = {"__name__": module}
    exec(CALLBACK, scope)
    threads = threading.active_count()
    with pytest.raises(KeyboardInterrupt), patient_interrupts():
        scope["callback"](_interrupt)
    assert threading.active_count() == threads
    time.sleep(2 * AGAIN_SECONDS)


class _Fleeting:
    def __del__(self) -> None:
        _interrupt()
        sum(range(1000))


def _interrupted_as_it_goes() -> None:
    _Fleeting()
    time.sleep(5)
    pytest.fail("the interruption was lost")


def test_an_interruption_where_exceptions_are_lost_comes_a_moment_later(capfd: pytest.CaptureFixture[str]) -> None:
    hook = sys.unraisablehook
    with pytest.raises(KeyboardInterrupt), patient_interrupts():
        _interrupted_as_it_goes()
    assert sys.unraisablehook is hook
    assert capfd.readouterr().err == ""


def _interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


@pytest.fixture(autouse=True)
def _others() -> Iterator[None]:
    """Start another thread before signals are deferred: signals that it takes still reach the main thread."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(int).result()
        OTHERS[:] = [pool]
        yield


def _from_another_thread() -> None:
    OTHERS[0].submit(_interrupt).result()


@pytest.mark.parametrize("send", [_interrupt, _from_another_thread])
def test_critical_sections_are_finished_first(send: Any) -> None:
    before, done = signal.getsignal(signal.SIGINT), []

    def work() -> None:
        send()
        time.sleep(0.01)
        done.append(1)

    with pytest.raises(KeyboardInterrupt), uninterrupted():
        work()
    assert done == [1]
    assert signal.getsignal(signal.SIGINT) is before


class _Interrupting(dict[str, float]):
    """Values that cause an interruption while they are written."""

    def items(self) -> Any:
        _from_another_thread()
        return super().items()


def _writer(path: Path) -> ResultWriter:
    e0 = coordinates("tangent", np.linspace(0, 1, 3), 0.0)
    return ResultWriter(path, HEADER, [tangent_body("beam", 2, 1.0, 0.1)], e0)


def test_a_state_is_written_completely_despite_an_interruption(tmp_path: Path) -> None:
    """Another thread takes the signal, as threads of numerical libraries may."""
    def write() -> None:
        with _writer(tmp_path / "a.h5") as writer:
            writer.append(0.0, np.zeros(12))
            writer.append(1.0, np.ones(12), energies=_Interrupting({"strain": 1.0}))

    with pytest.raises(KeyboardInterrupt):
        write()
    with open_results(part_path(tmp_path / "a.h5")) as found:
        assert (found.nt, found.status) == (2, "interrupted")


def test_a_file_interrupted_at_its_creation_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from ancf2d.results.target import Target

    publish = Target.publish

    def hit(self: Target, image: bytes) -> None:
        publish(self, image)
        _from_another_thread()

    monkeypatch.setattr(Target, "publish", hit)
    with pytest.raises(KeyboardInterrupt):
        _writer(tmp_path / "a.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_second_interruption_prints_no_second_message(monkeypatch: pytest.MonkeyPatch) -> None:
    import click

    from ancf2d.cli import app, main

    class Stop(click.Command):
        def invoke(self, ctx: click.Context) -> None:
            ctx.obj.parting = lambda: (_interrupt(), time.sleep(0.01), click.echo("what is left"))
            raise KeyboardInterrupt

    monkeypatch.setattr(app, "COMMANDS", {**app.COMMANDS, "stop": "Stop."})
    monkeypatch.setattr(app.App, "get_command", lambda *_: Stop("stop"))
    with pytest.raises(SystemExit) as found:
        main(["stop"])
    assert found.value.code == 130


def test_an_interruption_after_the_json_object_prints_no_other(capsys: pytest.CaptureFixture[str]) -> None:
    from ancf2d.cli.failures import explain
    from ancf2d.cli.session import Session

    session = Session(["run", "--json"], json=True)
    session.print_json({"status": "converged"})
    assert explain(KeyboardInterrupt(), session) == 130
    assert json.loads(capsys.readouterr().out) == {"status": "converged"}
