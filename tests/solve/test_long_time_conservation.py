"""Small versions of the measurements in docs/motion.md: conservation, steady rotation, long steps, joints."""

from __future__ import annotations

import pytest
from instruments.motions import conservation, joints, runs, traps

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("element", ["vallejo", "cable"])
def test_ten_thousand_steps_conserve_energy_and_momentum(element: str) -> None:
    found = conservation.drift(element, 10_000)
    assert found["strain"] > 0.05
    assert found["energy"] < 1e-11
    assert found["linear"] < 1e-12
    assert found["angular"] < 1e-11


def test_steady_rotation_conserves_its_strain_energy() -> None:
    element, solver = conservation.WAYS[0]
    change, steps, _ = conservation.steady(element, solver, 20)
    assert steps > 20_000
    assert change < 1e-10


@pytest.mark.parametrize("element", ["omar", "2d2n", "vallejo", "cable", "reissner3"])
def test_a_thousand_turns_cause_no_strain(element: str) -> None:
    assert conservation.turned_strain(element, 1000 + 1 / 3) < 3e-14


@pytest.fixture(scope="module")
def fine() -> runs.Motion:
    return traps.motion("reissner3", 8, "method: radau9, tolerance: 1e-9")


@pytest.mark.parametrize("method", traps.METHODS)
def test_too_long_steps_are_recognised(method: str, fine: runs.Motion) -> None:
    found = traps.trap("reissner3", method, "dt: 0.01", 8, fine)
    assert found.honest
    assert found.code in (0, 2)
    if found.code == 0:
        assert found.truth is not None
        assert found.estimate is not None
        assert 1e-7 < found.truth < 1e-2
        assert found.truth < traps.COVERS * found.estimate


def test_an_estimate_far_below_the_truth_misleads() -> None:
    def said(**more: object) -> bool:
        return traps.Trap("cable", "hht", **{"code": 0, "truth": 1e-2, "estimate": 5e-4, **more}).honest
    assert not said()
    assert not said(estimate=None)
    assert said(estimate=2e-3)
    assert said(cut=1)
    assert said(code=1, truth=None, estimate=None)


@pytest.mark.parametrize("joint", joints.JOINTS, ids=lambda j: j.name)
def test_joints_hold_in_their_log_and_at_their_probes(joint: joints.Joint) -> None:
    log, seen = joints.hold(joint, "method: generalized_alpha, dt: 1e-3, estimate: false")
    assert log < 1e-13
    assert seen is None or seen < 1e-12
