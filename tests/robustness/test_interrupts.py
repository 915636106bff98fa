"""Ctrl-C where it does not fit."""

from __future__ import annotations

import os
import signal
import time

import pytest

from ancf2d.cli.interrupts import COMPILER, patient_interrupts

CALLBACK = """
def callback(interrupt):
    interrupt()
    return sum(range(1000))
"""


def _interrupt_now() -> None:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(5)


def test_an_interruption_waits_until_the_compiler_has_called_back() -> None:
    scope = {"__name__": COMPILER}
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
