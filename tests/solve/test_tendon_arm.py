"""An arm of six rigid vertebrae with a tendon: each joint in statics, energies in motion."""

from __future__ import annotations

from typing import Any

import helpers
import numpy as np
import pytest
from scipy.optimize import brentq

N, LENGTH, OFF, STIFFNESS, TENSION = 6, 0.05, 0.01, 0.4, 20.0


def arm(solver: dict[str, Any], damping: float = 0.0, amplitude: Any = None, **tendon: Any) -> helpers.Solution:
    bodies = {f"v{i}": {"geometry": {"type": "line", "start": [LENGTH * i, 0], "end": [LENGTH * (i + 1), 0]},
                        "section": {"height": 0.03, "width": 0.03}, "material": {"rho": 1200.0},
                        "element": {"type": "rigid"}} for i in range(N)}
    pairs = [[f"v{i}@1", f"v{i + 1}@0"] for i in range(N - 1)]
    load = {"type": "tendon", "through": [{"at": f"v{i}@0.5", "y": OFF} for i in range(N)],
            **(tendon or {"tension": TENSION})}
    if amplitude is not None:
        load["amplitude"] = amplitude
    return helpers.solved(bodies, solver, bc=[{"type": "clamp", "at": "v0@0", "hold": "section"}],
                          joints=[{"type": "pin", "between": p} for p in pairs],
                          springs=[{"type": "rotational", "between": p, "stiffness": STIFFNESS, "damping": damping}
                                   for p in pairs], loads=[load])


def turned(found: helpers.Solution) -> list[float]:
    """Return the angles of the joints, without whole turns."""
    angles = np.diff([found.theta(f"v{i}@0.5") for i in range(N)])
    return list(np.mod(angles + np.pi, 2 * np.pi) - np.pi)


def joint_angle() -> float:
    """The span between eyelets is 2 rho cos(beta + theta/2), so k theta = T rho sin(beta + theta/2)."""
    rho, beta = np.hypot(LENGTH / 2, OFF), np.arctan(2 * OFF / LENGTH)
    return float(brentq(lambda t: STIFFNESS * t - TENSION * rho * np.sin(beta + t / 2), 0.0, 3.0))


@pytest.mark.slow
def test_every_joint_of_the_arm_turns_alike() -> None:
    assert turned(arm({"type": "static"})) == pytest.approx([joint_angle()] * (N - 1), rel=1e-10)


RISE = {"type": "ramp", "t0": 0, "t1": 0.1}


@pytest.mark.slow
@pytest.mark.parametrize("tendon", [{}, {"stiffness": 500.0, "slack": -0.05}])
def test_the_arm_in_motion_keeps_its_balance_of_energies(tendon: dict[str, Any]) -> None:
    """The work of the tension, or of winding up the elastic tendon, is in the springs and the motion."""
    found = arm({"type": "dynamic", "t_end": 0.3, "tolerance": 1e-6}, amplitude=RISE, **tendon)
    assert found.state.report["energy_drift"] < 2e-5
    # undamped, the joints swing through zero
    assert max(turned(found)) > 0.5


@pytest.mark.slow
def test_a_damped_arm_comes_to_rest_in_static_equilibrium() -> None:
    found = arm({"type": "dynamic", "t_end": 8.0, "tolerance": 1e-5}, damping=0.02, amplitude=RISE)
    assert turned(found) == pytest.approx([joint_angle()] * (N - 1), rel=1e-5)
