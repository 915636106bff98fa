"""Independent jobs in one process or in several."""

from __future__ import annotations

import os
import signal

import pytest

from ancf2d.errors import ComputationError
from ancf2d.study.pool import run_jobs


def square(x: float) -> float:
    return x * x


def die(x: int) -> int:
    if x == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return x


@pytest.mark.parametrize("processes", [1, 2])
def test_results_keep_the_order_of_the_jobs(processes: int) -> None:
    counts: list[int] = []
    assert run_jobs(square, [3.0, 1.0, 2.0], processes, counts.append) == [9.0, 1.0, 4.0]
    assert counts == [1, 2, 3]


def test_death_of_a_process_is_a_failed_computation() -> None:
    with pytest.raises(ComputationError, match="has died"):
        run_jobs(die, [1, 2, 3], 2)
