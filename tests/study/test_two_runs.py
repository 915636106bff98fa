"""The error estimate of a motion from a run that is finer in space and time, on random beams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

import pytest
from instruments.scenes import two_runs

# 9 and 17 take more than ten seconds each
TRIALS = [k for k in range(2, 22) if k not in (9, 17)]


@pytest.mark.trials([0, 1, *(pytest.param(k, marks=pytest.mark.slow) for k in TRIALS)])
def test_two_runs_do_not_accept_an_error_above_the_wanted_one(number: int, pytestconfig: pytest.Config,
                                                              measured: Callable[..., None]) -> None:
    found = two_runs.judged(pytestconfig.getoption("seed"), number)
    if found is None:
        pytest.skip("no motion, or its limit is not known")
    measured("", "two runs", asdict(found), "instruments.scenes.two_runs:report")
    assert not found.accepts_too_much(found.two)
