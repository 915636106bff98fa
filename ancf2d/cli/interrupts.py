"""Ctrl-C at any moment, even while kernels are compiled."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

# LLVM calls back into this module: an exception there would be swallowed, and the kernel be lost with it
COMPILER = "llvmlite.binding.executionengine"
AGAIN_SECONDS = 0.05


@contextmanager
def patient_interrupts() -> Iterator[None]:
    """Let an interruption wait while LLVM calls back; change nothing where a caller handles interruptions itself."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, a moment later where the compiler would swallow it."""
    at = frame
    while at is not None:
        if at.f_globals.get("__name__") == COMPILER:
            again = threading.Timer(AGAIN_SECONDS, os.kill, (os.getpid(), number))
            again.daemon = True
            again.start()
            return
        at = at.f_back
    raise KeyboardInterrupt
