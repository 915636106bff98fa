"""Ctrl-C where it does not fit."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import pytest

from ancf2d.cli.interrupts import COMPILERS, patient_interrupts

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


def test_interruptions_that_a_caller_handles_are_left_to_it() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with patient_interrupts():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
