"""The error estimate of one mesh from a finer one, on random beams and rings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

import pytest
from instruments.scenes import two_meshes


@pytest.mark.trials([0, 1, 2, 3, *(pytest.param(k, marks=pytest.mark.slow) for k in range(4, 30))])
def test_two_meshes_do_not_accept_an_error_above_the_wanted_one(number: int, pytestconfig: pytest.Config,
                                                                measured: Callable[..., None]) -> None:
    found = two_meshes.judged(pytestconfig.getoption("seed"), number)
    if found is None:
        pytest.skip("no equilibrium, or its limit is not known")
    measured("", "two meshes", asdict(found), "instruments.scenes.two_meshes:report")
    assert not found.accepts_too_much(found.two)
