"""Processors: how many this process may use, and work that forked copies of it do in parallel."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress

# libraries used by numpy would each start one thread per core in every process; they read this when numpy is imported
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
           "NUMBA_NUM_THREADS")
# a copy that takes longer than this [s] hangs and is killed; its work is then only done later
PATIENCE = 60.0
_TICK = 0.005
# extension modules of NumPy and SciPy, each linked to its own OpenBLAS, and names of that library's functions
_LINKED = ("numpy.linalg._umath_linalg", "scipy.linalg._flapack")
_NAMES = [(f"{prefix}openblas_get_num_threads{suffix}", f"{prefix}openblas_set_num_threads{suffix}")
          for prefix in ("scipy_", "") for suffix in ("64_", "")]


def cores() -> int:
    """Return the number of processors that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads() -> int:
    """Return the number of threads that a computation may use: OMP_NUM_THREADS, or one per processor."""
    wanted = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    return max(1, int(wanted)) if wanted.isdecimal() else cores()


class _Restricted:
    """The computations that restrict OpenBLAS at present, and how to undo it when the last of them ends."""

    lock, users = threading.Lock(), 0
    undo = ExitStack()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Restrict OpenBLAS to one thread while the block runs, unless OPENBLAS_NUM_THREADS is set.

    ancf2d distributes elements over threads itself; additional OpenBLAS threads would wait in busy loops. The variable
    has no effect once NumPy is loaded, but the functions of the loaded libraries do. On systems where a library does
    not find the functions of those that it is linked to, and for other libraries than OpenBLAS, nothing changes.
    """
    with _Restricted.lock:
        _Restricted.users += 1
        if _Restricted.users == 1 and "OPENBLAS_NUM_THREADS" not in os.environ:
            for number, restrict in _openblas():
                _Restricted.undo.callback(restrict, number())
                restrict(1)
    try:
        yield
    finally:
        with _Restricted.lock:
            _Restricted.users -= 1
            if not _Restricted.users:
                _Restricted.undo.close()


def _openblas() -> Iterator[tuple[Callable[[], int], Callable[[int], object]]]:
    """Yield the functions that return and set the number of threads of each OpenBLAS that is loaded."""
    import scipy.linalg  # noqa: F401 - loads its OpenBLAS

    for file in filter(None, (getattr(sys.modules.get(name), "__file__", None) for name in _LINKED)):
        with suppress(OSError):
            library = ctypes.CDLL(file)
            yield from ((library[get], library[set_]) for get, set_ in _NAMES if hasattr(library, get))


@contextmanager
def aside(work: Callable[[], object]) -> Iterator[None]:
    """Do ``work`` in a forked copy of this process while the block runs, and wait for it at the end.

    The work is skipped if there is only one processor, or where a copy cannot safely be made (other systems than
    Linux). Errors in the copy are not reported: whoever needs its work does it again. If the block fails or is
    interrupted, the copy is killed.
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


def spread(tasks: Sequence[Callable[[], object]], before: Callable[[int], None] = lambda k: None) -> None:
    """Do tasks (255 at most) in this process and in copies of it, one per processor, for the caches that they fill.

    Each process takes the next task when it has finished one. ``before`` is called with the number of each task done
    here.
    """
    reading, writing = os.pipe()
    os.write(writing, bytes(range(len(tasks))))
    os.close(writing)

    def work(told: Callable[[int], None] = lambda k: None) -> None:
        while number := os.read(reading, 1):
            told(number[0])
            tasks[number[0]]()

    try:
        with ExitStack() as copies:
            for _ in range(min(threads(), len(tasks)) - 1):
                copies.enter_context(aside(work))
            work(before)
    finally:
        os.close(reading)


def _copy() -> int | None:
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
        return os.fork()
    return None


def _work(work: Callable[[], object]) -> None:
    """Do the work silently in the copy, and exit without Python's clean-up, which is left to the parent."""
    try:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        with open(os.devnull, "r+", encoding="utf-8") as nothing:
            for descriptor in range(3):
                os.dup2(nothing.fileno(), descriptor)
        sys.stdout = sys.stderr = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - it ends with the copy
        work()
    finally:
        os._exit(0)
