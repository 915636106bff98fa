"""Processors: how many this process may keep busy, and work done meanwhile by copies of it."""

from __future__ import annotations

import mmap
import os
import signal
import sys
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial

# libraries below numpy would each start a thread per core in every process; they look at this when numpy is imported
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
           "NUMBA_NUM_THREADS")
# a copy that takes longer than this [s] hangs: nothing that it does is missed, only late
PATIENCE = 60.0
_TICK = 0.005
# copies per processor, most of which wait, and pieces of work that are told apart
_COPIES, _PIECES = 3, 1 << 16


def cores() -> int:
    """Return how many processors this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads() -> int:
    """Return how many threads a computation may have: all processors, or what OMP_NUM_THREADS says."""
    wanted = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    return max(1, int(wanted)) if wanted.isdecimal() else cores()


@contextmanager
def aside(work: Callable[[], object]) -> Iterator[None]:
    """Do ``work`` in a copy of this process while the block is gone through, and wait for it at the end.

    Nothing is done where there is one processor, or no copies can be made that are safe to work in (other systems than
    Linux). What goes wrong in the copy is not told: whoever needs its work does it again. A block that fails, or is
    interrupted, ends the copy.
    """
    child = _copy() if sys.platform == "linux" and threads() > 1 else None
    if child == 0:
        _work(work)
    if child is None:
        yield
        return
    try:
        yield
        end = time.monotonic() + PATIENCE
        while child is not None and time.monotonic() < end:
            if os.waitpid(child, os.WNOHANG)[0]:
                child = None
            else:
                time.sleep(_TICK)
    finally:
        if child is not None:
            with suppress(OSError):
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)


class _Team:
    """This process and copies of it that do tasks, one per processor at a time.

    What several tasks need, a piece of work, is done by the first that comes to it. The others wait for it, and let
    further copies take tasks meanwhile.
    """

    def __init__(self, tasks: Sequence[Callable[[], object]], places: int) -> None:
        self._tasks, self._me, self._placed = tasks, 0, False
        self._next, self._places = os.pipe(), os.pipe()
        os.write(self._next[1], bytes(range(len(tasks))))
        os.close(self._next[1])
        os.write(self._places[1], bytes(places - 1))
        # for each piece of work: 0, or the number of the one that does it
        self._doers = mmap.mmap(-1, _PIECES)

    def work(self, number: int) -> None:
        """Do tasks until there are none left; the first needs no place to begin, and ends where it has given it up."""
        self._me, self._placed = number, number == 1
        try:
            while self._placed or (number > 1 and os.read(self._places[0], 1)):
                self._placed = True
                task = os.read(self._next[0], 1)
                if not task:
                    break
                self._tasks[task[0]]()
        finally:
            while (piece := self._doers.find(bytes([number]), 0)) >= 0:
                self._doers[piece] = 0
            self._leave()

    def first_to(self, name: str) -> bool:
        """Return whether this one is to do a piece of work; if not, it was waited for."""
        piece = _piece(name)
        doer = self._doers[piece]
        if doer not in (0, self._me):
            self._leave()
            end = time.monotonic() + PATIENCE
            while self._doers[piece] == doer:
                if time.monotonic() > end:
                    break
                time.sleep(_TICK)
            else:
                return False
        self._doers[piece] = self._me
        return True

    def done(self, name: str) -> None:
        """Let those go on who wait for a piece of work."""
        self._doers[_piece(name)] = 0

    def _leave(self) -> None:
        if self._placed:
            self._placed = False
            os.write(self._places[1], b"\0")

    def dismiss(self, copies: int) -> None:
        """Let copies that wait for a place find that no tasks are left."""
        os.write(self._places[1], bytes(copies))

    def close(self) -> None:
        """Let go of what was shared."""
        for descriptor in (self._next[0], *self._places):
            os.close(descriptor)
        self._doers.close()


# those who share this process's work now
_team: _Team | None = None


def spread(tasks: Sequence[Callable[[], object]]) -> None:
    """Do tasks (255 at most) here and in copies of this process, one per processor, for what they leave in a cache.

    Each takes the next one when it is done with its last. What they need in common, they do once: see ``first_to``.
    """
    global _team
    count = min(threads(), len(tasks))
    if count < 2:
        for task in tasks:
            task()
        return
    copies = min(len(tasks), _COPIES * count) - 1
    _team = _Team(tasks, count)
    try:
        with ExitStack() as stack:
            for k in range(copies):
                stack.enter_context(aside(partial(_team.work, k + 2)))
            _team.work(1)
            _team.dismiss(copies)
    finally:
        _team.close()
        _team = None


def first_to(name: str) -> bool:
    """Return whether this process is to do a piece of work that others, with which it shares tasks, may need too.

    If not, one of them has done it while this one waited. Whoever is told True says ``done`` at its end.
    """
    return _team is None or _team.first_to(name)


def done(name: str) -> None:
    """Let those go on who wait for a piece of work that this process was ``first_to``."""
    if _team is not None:
        _team.done(name)


def _piece(name: str) -> int:
    return zlib.crc32(name.encode()) % _PIECES


def _copy() -> int | None:
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
        return os.fork()
    return None


def _work(work: Callable[[], object]) -> None:
    """Work without a word, and end without what a process does at its end: that is the other's."""
    try:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        with open(os.devnull, "r+", encoding="utf-8") as nothing:
            for descriptor in range(3):
                os.dup2(nothing.fileno(), descriptor)
        sys.stdout = sys.stderr = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - it ends with the copy
        work()
    finally:
        os._exit(0)
