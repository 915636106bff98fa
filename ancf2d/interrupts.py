"""Handling of Ctrl-C: it is never lost, and is deferred while it would do damage."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

# an exception in a callback from LLVM is swallowed, and one inside numba is reported as an error of the kernel
COMPILERS = ("llvmlite", "numba")
AGAIN_SECONDS = 0.05


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextmanager
def uninterrupted(number: int = signal.SIGINT) -> Iterator[None]:
    """Defer Ctrl-C, or another signal, until the end of the block.

    Blocking the signal would not suffice: the system delivers a signal that the main thread blocks to another thread,
    and Python then still interrupts the main thread.
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
    """Defer Ctrl-C while a kernel is compiled; do nothing if the caller handles Ctrl-C itself."""
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
    """Signal handler that raises KeyboardInterrupt, later if it would be swallowed now."""

    def __init__(self) -> None:
        self.waiting = False
        self._timers: list[threading.Timer] = []
        self._hook = sys.unraisablehook

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal: raise KeyboardInterrupt, or try again later if a compiler is running."""
        at = frame
        while at is not None:
            if str(at.f_globals.get("__name__")).split(".")[0] in COMPILERS:
                self._try_again()
                return
            at = at.f_back
        self.waiting = False
        raise KeyboardInterrupt

    def unraisable(self, found: Any) -> None:
        """Retry an interruption that was raised inside a callback, from which no exception can get out."""
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
        """Stop handling: restore the hook for unraisable exceptions and cancel all timers."""
        sys.unraisablehook = self._hook
        for timer in self._timers:
            timer.cancel()
            timer.join()
