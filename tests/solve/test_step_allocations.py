"""Steps of a motion take no memory: sixty of them allocate what thirty do, whatever moves."""

from __future__ import annotations

from typing import Any

import pytest
from motions import GRAVITY, OWN, Ride, rigid, rod
from numba.core.runtime import _nrt_python, rtsys

DT, FEW, MANY = 1e-3, 30, 60
SWAY = {"type": "expression", "value": "0.01*sin(20*t)"}
SCENES: dict[str, dict[str, Any]] = {
    "pendulum": {"bodies": {"a": rod("vallejo")}, "bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY},
    "shaken, damped, with a rigid end": {
        "bodies": {"a": rod("vallejo", damping={"kelvin_voigt": 1e-3}),
                   "b": rigid([1, 0], [1.5, 0], 0.3, 0.02)},
        "bc": [{"type": "prescribed", "at": "a@0", "ux": SWAY, "uy": 0}],
        "joints": [{"type": "pin", "between": ["a@1", "b@0"]}],
        "springs": [{"type": "translational", "between": ["b@1", [1.5, 1.0]], "stiffness": 20.0, "damping": 0.5}],
        "loads": [*GRAVITY, {"type": "moment", "at": "a@1", "value": 0.1}]}}
# multipliers refuse what damps nothing
PAIRS = [(s, m) for s in SCENES for m in OWN if m != "newmark" or s == "pendulum"]


@pytest.fixture(autouse=True)
def _counted() -> Any:
    _nrt_python.memsys_enable_stats()
    yield
    _nrt_python.memsys_disable_stats()


def allocated(scene: dict[str, Any], method: str, steps: int) -> int:
    """Return how often compiled code took memory in so many steps, with one state stored."""
    ride = Ride(scene, steps * DT, method=method, dt=DT).start()
    # all in one call
    ride.stepper.steps = 2 * MANY
    before = rtsys.get_allocation_stats().alloc
    ride.on()
    assert len(ride.log) >= steps
    return int(rtsys.get_allocation_stats().alloc - before)


@pytest.mark.parametrize(("scene", "method"), PAIRS)
def test_steps_take_no_memory(scene: str, method: str) -> None:
    assert allocated(SCENES[scene], method, MANY) == allocated(SCENES[scene], method, FEW)
