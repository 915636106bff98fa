"""A tangent of Radau's stages serves many steps, rotated with the sections: the same motion for less work."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from motions import GRAVITY, Ride, ride, rod

from ancf2d.kernels.motion.dynamics import TANGENTS
from ancf2d.kernels.motion.reused_tangent import MAKING
from ancf2d.kernels.motion.state import TANGENT_STEP, TANGENT_STEPS
from ancf2d.solvers.motion import stepping

RADAU = ("radau5", "radau9")
TURN = 2 * np.pi


def spinning(name: str, **material: float) -> dict[str, Any]:
    """Return a rod about its pinned end, one turn per second, under gravity."""
    return {"bodies": {"a": rod(name, 4, **material)}, "loads": GRAVITY, "bc": [{"type": "pin", "at": "a@0"}],
            "initial": {"bodies": {"a": {"rotation_rate": {"omega": TURN, "about": [0, 0]}}}}}


@pytest.mark.parametrize("method", RADAU)
@pytest.mark.parametrize("name", ["reissner3", "cable", "vallejo"])
def test_old_tangents_give_the_same_motion(name: str, method: str) -> None:
    """Within Newton's tolerance both have the same stages, far from those of other steps."""
    held, fresh, other = (ride(spinning(name), 0.2, method=method, dt=dt, newton=newton)
                          for dt, newton in ((2e-3, "reuse"), (2e-3, "full"), (4e-3, "full")))
    assert np.abs(held.end()[0] - fresh.end()[0]).max() < 5e-8
    assert np.abs(other.end()[0] - fresh.end()[0]).max() > 1e-7
    assert fresh.stepper.w.counts[TANGENTS] == 100


@pytest.mark.parametrize("method", RADAU)
@pytest.mark.parametrize("name", ["reissner3", "cable", "vallejo"])
def test_a_tangent_serves_while_the_rod_turns(name: str, method: str) -> None:
    """A nearly rigid rod: hundredths of a turn per step, and one tangent for a good part of a turn."""
    whole = ride(spinning(name, E=2e9), 1.0, method=method, dt=5e-3)
    assert whole.stepper.w.counts[TANGENTS] < 200 / 5


def test_a_tangent_is_replaced_when_a_step_costs_more_than_the_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mean cost of m steps with one tangent is minimal where the next step costs more than the mean."""
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)
    trip = Ride(spinning("reissner3"), 0.2, method="radau5", dt=2e-3, every=1).start()
    trip.stepper.steps = 1
    numbers, costs, given_up = trip.stepper.s.numbers, [], 0
    while not trip.stepper.done:
        row, = trip.stepper.run()
        costs.append(row.log[-1, stepping.LOG.index("iterations")])
        with_it = int(numbers[TANGENT_STEPS])
        gone = numbers[TANGENT_STEP] == 0.0
        assert gone == (costs[-1] > (MAKING + sum(costs[-with_it:])) / with_it)
        given_up += gone
    assert len(costs) == 100
    assert 0 < given_up < 20


@pytest.mark.parametrize("method", RADAU)
def test_a_resumed_motion_has_its_earlier_tangent(monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)
    scene = spinning("reissner3", E=2e9)
    one, two = (Ride(scene, 0.3, method=method, dt=5e-3, every=1).start() for _ in range(2))
    one.stepper.steps = two.stepper.steps = 7
    one.stepper.run()
    assert one.stepper.s.numbers[TANGENT_STEPS] > 1
    kept = one.stepper.checkpoint()
    assert kept is not None
    two.stepper.resume(kept)
    one.on()
    two.on()
    assert two.stepper.w.counts[TANGENTS] > 1
    assert [row.z.tobytes() for row in one.rows[1:]] == [row.z.tobytes() for row in two.rows[1:]]
