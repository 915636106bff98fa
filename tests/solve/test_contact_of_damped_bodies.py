"""Motions of damped bodies with contact without a law: viscous waves after impacts, and changing contact points."""

from __future__ import annotations

from typing import Any

import helpers
import pytest

import ancf2d


def pressed(kind: str, count: int, damping: float, method: str) -> Any:
    """Return the motion of a damped cantilever that a disc presses down."""
    material = {"E": 2e11, "nu": 0.3, "rho": 7800.0, "damping": {"kelvin_voigt": damping}}
    body = helpers.body(helpers.line(1.0), helpers.element(kind, count), {"height": 0.015, "width": 0.05}, material)
    disc = {"type": "circle", "center": [0.83, 0.12], "radius": 0.1, "motion": {"y": {"type": "ramp", "scale": -0.08}}}
    return ancf2d.solve({
        "bodies": {"leaf": body}, "boundary_conditions": [{"type": "clamp", "at": "leaf@0"}],
        "obstacles": {"disc": disc}, "contacts": [{"between": ["leaf", "disc"]}],
        "output": {"probes": {"tip": "leaf@1"}},
        "solver": {"type": "dynamic", "t_end": 1.0, "tolerance": 1e-4, "method": method, "estimate": False}})


@pytest.mark.parametrize(("kind", "count", "damping"), [
    # the gap that round-off leaves in an impact would be a velocity in the much shorter steps after it
    ("reissner3", 32, 1e-2),
    # the force moves from one point to the next while the disc slides along
    pytest.param("vallejo", 16, 1e-3, marks=pytest.mark.slow)])
def test_a_damped_leaf_follows_the_disc_that_presses_it(kind: str, count: int, damping: float) -> None:
    found, other = (pressed(kind, count, damping, method) for method in ("generalized_alpha", "radau5"))
    assert found.summary["steps"] < 1500
    tips = [one.summary["probes"]["tip"]["uy"] for one in (found, other)]
    assert tips[0] == pytest.approx(tips[1], rel=1e-4)
    lost = [one.energies["dissipated"][-1] / one.energies["strain"].max() for one in (found, other)]
    assert lost[0] == pytest.approx(lost[1], abs=2e-3)
