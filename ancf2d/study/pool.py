"""Many independent jobs, in this process or in several, with the same results."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from ..errors import ComputationError

J = TypeVar("J")
R = TypeVar("R")


def run_jobs(function: Callable[[J], R], jobs: Sequence[J], processes: int,
             done: Callable[[int], None] = lambda count: None) -> list[R]:
    """Return function(job) of every job, in their order; ``done`` is told how many are finished.

    ``function`` is a module-level function. Raises ComputationError where a process dies.
    """
    if processes <= 1 or len(jobs) <= 1:
        out = []
        for count, job in enumerate(jobs, start=1):
            out.append(function(job))
            done(count)
        return out
    # spawn: a forked child inherits locks and threads of numerical libraries in whatever state they are
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(processes, len(jobs)), context, _leave_interrupts_to_the_parent) as pool:
        try:
            futures = [pool.submit(function, job) for job in jobs]
            for count, _ in enumerate(as_completed(futures), start=1):
                done(count)
            return [f.result() for f in futures]
        except BrokenProcessPool:
            raise ComputationError("a process that was solving a mesh has died", advice="fewer --jobs, if memory "
                                   "ran out") from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
