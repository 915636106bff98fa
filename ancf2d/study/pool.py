"""Many independent jobs: in this process, in several of this machine, or on a Dask cluster, with the same results.

The last two use executors with the interface of the standard library (``concurrent.futures.Executor``).
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from ..errors import ComputationError
from ..interrupts import uninterrupted
from ..processors import THREADS
from .digests import program

CONNECT = 10.0  # seconds until a scheduler must have answered
WORKERS = 30.0  # seconds until it must have a worker
INSTALL = "the same ancf2d in the environments of scheduler and workers"
_one_at_a_time = threading.Lock()


class Task:
    """A function to call on a worker; refuses workers with another version of ancf2d, whose results may differ."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function, self.wanted = function, program()

    def __call__(self, job: Any) -> Any:
        """Return function(job). Raises ComputationError on a worker with another version of ancf2d."""
        if program() != self.wanted:
            raise ComputationError(f"a worker has ancf2d {program()}, this is {self.wanted}", advice=INSTALL)
        # a worker may have several threads, but results must be written by one at a time
        with _one_at_a_time:
            return self.function(job)


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, type[Exception]]]:
    """Yield the executor of a cluster, and the exception it raises for a job whose worker died repeatedly.

    Raises ComputationError if scheduler or workers cannot be reached or used.
    """
    from distributed import Client, KilledWorker

    # distributed logs, with tracebacks, what is reported here in one sentence, and its loggers have levels of their own
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with _connected(Client, address) as client:
            _wait_for_workers(client, address)
            executor = client.get_executor(pure=False)
            try:
                yield executor, KilledWorker
            except CancelledError:
                raise ComputationError(f"the scheduler at {address} was lost") from None
            except (ImportError, AttributeError, RuntimeError) as error:
                first = " ".join(str(error).split()).partition(". ")[0]
                reason = f"the cluster at {address} cannot run ancf2d: {first}"
                raise ComputationError(reason, advice=INSTALL) from error
            finally:
                executor.shutdown(wait=False)
    finally:
        logging.disable(before)


@contextmanager
def _connected(connect: Callable[..., Any], address: str) -> Iterator[Any]:
    try:
        client = connect(address, timeout=CONNECT, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise ComputationError(f"there is no Dask scheduler at {address}: {error}", advice="dask scheduler, which "
                               "prints its address") from None
    try:
        yield client
    finally:
        client.close()


def _wait_for_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=WORKERS)
    except TimeoutError:
        raise ComputationError(f"the scheduler at {address} has no workers", advice=f"dask worker {address}") from None


J = TypeVar("J")
R = TypeVar("R")

DIED = "the process that solved this died: it was killed or ran out of memory"
# seconds between two checks of running jobs
TICK = 1.0


@dataclass(frozen=True)
class Workers:
    """Where the jobs run: in ``processes`` of this machine, or on the workers of the Dask scheduler at an address."""

    processes: int = 1
    scheduler: str | None = None

    def file(self, name: str) -> str:
        """Return the name of a file as valid for workers: those of a cluster have other working directories."""
        return name if self.scheduler is None else os.path.abspath(name)


ALONE = Workers()  # this process


def run_jobs(function: Callable[[J], R], jobs: Sequence[J], workers: Workers, lost: Callable[[J], R],
             done: Callable[[int, R, float], None] = lambda i, result, seconds: None,
             tick: Callable[[], None] = lambda: None) -> list[R]:
    """Return function(job) for all jobs, in their order.

    ``done`` is called with number, result and seconds of each job when it ends; ``tick`` is called every second while
    other processes work.

    ``function`` is a module-level function that reports failures in its result; ``lost`` gives the result of a job
    whose process died. Raises ComputationError if the cluster cannot be used.
    """
    results: dict[int, R] = {}

    def take(i: int, result: R, seconds: float = 0.0) -> None:
        results[i] = result
        done(i, result, seconds)

    timed = _Timed(function)
    if workers.scheduler is not None:
        left: list[int] = []
        with cluster(workers.scheduler) as (executor, death):
            left = gather(executor, Task(timed), dict(enumerate(jobs)), take, death, tick)
        for i in left:
            take(i, lost(jobs[i]))
    elif workers.processes <= 1 or len(jobs) <= 1:
        for i, job in enumerate(jobs):
            take(i, *timed(job))
    else:
        _run_in_processes(workers.processes, timed, jobs, take, lost, tick)
    return [results[i] for i in range(len(jobs))]


class _Timed(Generic[J, R]):
    """A function of a job that also returns the seconds it took."""

    def __init__(self, function: Callable[[J], R]) -> None:
        self.function = function

    def __call__(self, job: J) -> tuple[R, float]:
        began = time.perf_counter()
        return self.function(job), time.perf_counter() - began


def _run_in_processes(count: int, function: _Timed[J, R], jobs: Sequence[J], take: Callable[..., None],
                      lost: Callable[[J], R], tick: Callable[[], None]) -> None:
    waiting = dict(enumerate(jobs))
    while waiting:
        left = _attempt(count, function, waiting, take, tick)
        # jobs start in order: one of the first killed the process, and is found by giving each a process of its own
        for i in left[:count]:
            if _attempt(1, function, {i: jobs[i]}, take, tick):
                take(i, lost(jobs[i]))
        waiting = {i: jobs[i] for i in left[count:]}


def _attempt(count: int, function: _Timed[J, R], jobs: Mapping[int, J], take: Callable[..., None],
             tick: Callable[[], None]) -> list[int]:
    left: list[int] = []
    with _processes(min(count, len(jobs))) as pool:
        left = gather(pool, function, jobs, take, BrokenProcessPool, tick)
    return left


def gather(executor: Executor, function: Callable[[J], tuple[R, float]], jobs: Mapping[int, J],
           take: Callable[..., None], death: type[Exception], tick: Callable[[], None]) -> list[int]:
    """Call ``take`` with each result when it arrives; return the sorted numbers of the jobs that raised ``death``."""
    left, futures = [], {}
    # a process that is abandoned before it receives its job prints a traceback
    with uninterrupted(signal.SIGTERM), no_interrupts():
        for i, job in jobs.items():
            try:
                futures[executor.submit(function, job)] = i
            except death:
                left.append(i)
    waiting = set(futures)
    while waiting:
        ended, waiting = wait(waiting, timeout=TICK, return_when=FIRST_COMPLETED)
        for future in sorted(ended, key=futures.__getitem__):
            try:
                result = future.result()
            except death:
                left.append(futures[future])
            else:
                take(futures[future], *result)
        tick()
    return sorted(left)


# ---------------------------------------------------------------------------- processes of this machine

@contextmanager
def _processes(count: int) -> Iterator[Executor]:
    """Yield a pool of processes; if the block fails or is interrupted, they are terminated at once."""
    # spawn: a forked child inherits locks and threads of numerical libraries in an undefined state
    others = set(multiprocessing.active_children())
    with _quiet_tracker():
        pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), begin_worker,
                                   (tuple(sys.warnoptions),))
    try:
        yield pool
    except BaseException:
        with no_interrupts():
            for child in set(multiprocessing.active_children()) - others:
                child.terminate()
            pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


@contextmanager
def _quiet_tracker() -> Iterator[None]:
    """Silence the resource tracker, a process that starts with the first pool and cleans up after killed processes."""
    before = os.environ.get("PYTHONWARNINGS", "")
    os.environ["PYTHONWARNINGS"] = f"{before},ignore:resource_tracker".lstrip(",")
    try:
        yield
    finally:
        os.environ["PYTHONWARNINGS"] = before
        if not before:
            del os.environ["PYTHONWARNINGS"]


@contextmanager
def no_interrupts() -> Iterator[None]:
    """Defer Ctrl-C; processes started in the block inherit the blocked signal, so that only their parent handles it."""
    with uninterrupted():
        if not hasattr(signal, "pthread_sigmask"):
            yield
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_worker(warnoptions: tuple[str, ...]) -> None:
    """Initialise a process of a pool: one thread, Ctrl-C ignored, and an exit when the parent exits."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.update(dict.fromkeys(THREADS, "1"))
    if not warnoptions:
        warnings.simplefilter("ignore")
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
