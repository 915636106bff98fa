"""Ctrl-C at any moment, even while kernels are compiled."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

# an exception in what LLVM calls back is swallowed, and one in numba is told as an error of the kernel
COMPILERS = ("llvmlite", "numba")
AGAIN_SECONDS = 0.05


@contextmanager
def patient_interrupts() -> Iterator[None]:
    """Let an interruption wait while a kernel is compiled; change nothing where a caller handles them itself."""
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
        if str(at.f_globals.get("__name__")).split(".")[0] in COMPILERS:
            again = threading.Timer(AGAIN_SECONDS, os.kill, (os.getpid(), number))
            again.daemon = True
            again.start()
            return
        at = at.f_back
    raise KeyboardInterrupt
