"""Ctrl-C at any moment: it is never lost, and waits where it would do damage."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

# an exception in what LLVM calls back is swallowed, and one in numba is told as an error of the kernel
COMPILERS = ("llvmlite", "numba")
AGAIN_SECONDS = 0.05


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextmanager
def uninterrupted(number: int = signal.SIGINT) -> Iterator[None]:
    """Let Ctrl-C, or another signal, wait until the end of the block.

    A mask of signals would not do: the system hands a signal that the main thread blocks to another thread, and
    Python then interrupts the main thread all the same.
    """
    before = signal.getsignal(number)
    if not _in_main_thread() or before in (signal.SIG_IGN, None):
        yield
        return
    waiting: list[int] = []
    try:
        signal.signal(number, lambda number, _: waiting.append(number))
        yield
    finally:
        signal.signal(number, before)
        if waiting:
            signal.raise_signal(number)


@contextmanager
def patient_interrupts() -> Iterator[None]:
    """Let an interruption wait while a kernel is compiled; change nothing where a caller handles them itself."""
    if not _in_main_thread() or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    patience = _Patience()
    try:
        signal.signal(signal.SIGINT, patience.interrupt)
        sys.unraisablehook = patience.unraisable
        yield
    finally:
        try:
            with uninterrupted():
                patience.end()
        finally:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        if patience.waiting:
            raise KeyboardInterrupt


class _Patience:
    """Raises KeyboardInterrupt, a moment later where it would be swallowed."""

    def __init__(self) -> None:
        self.waiting = False
        self._timers: list[threading.Timer] = []
        self._hook = sys.unraisablehook

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """React to the signal."""
        at = frame
        while at is not None:
            if str(at.f_globals.get("__name__")).split(".")[0] in COMPILERS:
                self._try_again()
                return
            at = at.f_back
        self.waiting = False
        raise KeyboardInterrupt

    def unraisable(self, found: Any) -> None:
        """Take up an interruption that came in what Python calls back, where nothing can be raised."""
        if found.exc_type is KeyboardInterrupt:
            self._try_again()
        else:
            self._hook(found)

    def _try_again(self) -> None:
        self.waiting = True
        again = threading.Timer(AGAIN_SECONDS, os.kill, (os.getpid(), signal.SIGINT))
        again.daemon = True
        again.start()
        self._timers.append(again)

    def end(self) -> None:
        """Let no signal come later."""
        sys.unraisablehook = self._hook
        for timer in self._timers:
            timer.cancel()
            timer.join()
