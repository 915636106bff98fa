"""Jobs on a Dask cluster, through the executor of its client."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from typing import Any

from ..errors import ComputationError
from .digests import program

CONNECT = 10.0  # seconds until a scheduler must have answered
WORKERS = 30.0  # seconds until it must have a worker
INSTALL = "the same ancf2d in the environments of scheduler and workers"
_one_at_a_time = threading.Lock()


class Task:
    """A function on a worker, which must have the program that asks for it: another one has other results."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function, self.wanted = function, program()

    def __call__(self, job: Any) -> Any:
        """Return function(job). Raises ComputationError on a worker with another version of ancf2d."""
        if program() != self.wanted:
            raise ComputationError(f"a worker has ancf2d {program()}, this is {self.wanted}", advice=INSTALL)
        # a worker may have several threads; results are written by one at a time
        with _one_at_a_time:
            return self.function(job)


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, type[Exception]]]:
    """Give the executor of a cluster, and what it raises for a job whose worker died, time and again.

    Raises ComputationError where scheduler or workers cannot be reached or used.
    """
    from distributed import Client, KilledWorker

    # it logs with tracebacks what is told here in a sentence, by loggers with levels of their own
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
