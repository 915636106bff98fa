"""Branched frames move alike with band and front matrices, by every method."""

from __future__ import annotations

from typing import Any

import helpers as h
import numpy as np
import pytest
from motions import GRAVITY, ride

from ancf2d.model import numbering
from ancf2d.solvers.motion.integrators import INTEGRATORS

pytestmark = pytest.mark.slow

SECTION = {"height": 0.02, "width": 0.02}
SOFT = {"E": 1e8, "nu": 0.3, "rho": 1000.0}


def bar(name: str, start: list[float], end: list[float], **material: Any) -> dict[str, Any]:
    spec = h.element(name, 3)
    return h.body({"type": "line", "start": start, "end": end}, spec, SECTION, {**SOFT, **material})


def fork(name: str, joint: str, damped: bool) -> dict[str, Any]:
    """Return a stem with three arms, two of which meet again at their ends in a loop."""
    more = {"damping": {"kelvin_voigt": 1e-4}} if damped else {}
    bodies = {"stem": bar(name, [0, 0], [0.3, 0.0], **more), "up": bar(name, [0.3, 0], [0.6, 0.2], **more),
              "down": bar(name, [0.3, 0], [0.6, -0.2], **more), "on": bar(name, [0.3, 0], [0.5, 0.0], **more),
              "back": bar(name, [0.6, 0.2], [0.9, 0.1], **more), "close": bar(name, [0.6, -0.2], [0.9, 0.1], **more)}
    joints = [{"type": joint, "between": ["stem@1", "up@0", "down@0", "on@0"]},
              {"type": "weld", "between": ["up@1", "back@0"]}, {"type": "weld", "between": ["down@1", "close@0"]},
              {"type": "pin", "between": ["back@1", "close@1"]}]
    return {"bodies": bodies, "bc": [{"type": "clamp", "at": "stem@0"}], "loads": GRAVITY, "joints": joints}


def moved(nested: bool, scene: dict[str, Any], **how: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements and rates at the end, by coordinate, with fronts or a band."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numbering, "LOOSE", 0.0)
        patch.setattr(numbering, "FEW", 0)
        patch.setattr(numbering, "band_cost", lambda n, width: np.inf if nested else 0.0)
        trip = ride(scene, 2e-2, dt=5e-4, **how)
    num = trip.model.numbering
    assert (num.fronts is not None) == nested
    d, v = trip.end()
    return d[:trip.model.n_q], v[:trip.model.n_q]


@pytest.mark.parametrize("method", ["radau5", "radau9", "generalized_alpha", "hht", "newmark"])
@pytest.mark.parametrize(("name", "joint", "damped"), [("reissner2", "pin", True), ("vallejo", "weld", False)])
def test_motions_with_fronts_are_those_with_bands(name: str, joint: str, damped: bool, method: str) -> None:
    band, fronts = (moved(nested, fork(name, joint, damped), method=method) for nested in (False, True))
    for x, y in zip(band, fronts, strict=True):
        np.testing.assert_allclose(y, x, rtol=0, atol=1e-9 * np.abs(x).max())


def test_energy_and_momentum_are_conserved_with_fronts() -> None:
    scene = fork("vallejo", "weld", False)
    band, fronts = (moved(nested, scene, method="energy_momentum") for nested in (False, True))
    for x, y in zip(band, fronts, strict=True):
        np.testing.assert_allclose(y, x, rtol=0, atol=1e-8 * np.abs(x).max())


def test_joints_with_multipliers_and_sliding_points_are_the_same_with_fronts() -> None:
    scene = fork("vallejo", "weld", False)
    scene["bodies"]["rider"] = h.body({"type": "line", "start": [0.4, 0.0], "end": [0.4, -0.3]},
                                      h.element("cable", 3), SECTION, SOFT)
    scene["joints"].append({"type": "prismatic", "point": "rider@0", "on": "on"})
    band, fronts = (moved(nested, scene, method="generalized_alpha") for nested in (False, True))
    for x, y in zip(band, fronts, strict=True):
        np.testing.assert_allclose(y, x, rtol=0, atol=1e-8 * np.abs(x).max())


@pytest.mark.parametrize("method", [name for name, m in INTEGRATORS.items() if m.scipy is not None])
def test_scipys_methods_move_fronts(method: str) -> None:
    from ancf2d.kernels.motion.state import fill_full
    from ancf2d.solvers.motion.initial import initial_motion
    from ancf2d.solvers.motion.ode import OdeStepper
    from ancf2d.solvers.motion.problem import make_problem

    ends = []
    for nested in (False, True):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(numbering, "LOOSE", 0.0)
            patch.setattr(numbering, "FEW", 0)
            patch.setattr(numbering, "band_cost", lambda n, width, nested=nested: np.inf if nested else 0.0)
            scene = fork("reissner2", "weld", False)
            bodies = scene.pop("bodies")
            model = h.build(bodies, {"type": "dynamic", "t_end": 2e-4, "method": method, "tolerance": 1e-6}, **scene)
        assert (model.numbering.fronts is not None) == nested
        problem, signals = make_problem(model)
        stepper = OdeStepper(model, problem, signals, model.case.solver, 0.0, np.zeros(0))
        stepper.start(*initial_motion(model))
        while not stepper.done:
            stepper.run()
        full = np.zeros(len(problem.place))
        fill_full(problem, stepper.s.z, stepper.w.amps, 0, full)
        ends.append(full[:model.n_q])
    # their tolerance is 1e-6, and the order of unknowns moves the last digits of their steps
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-5 * np.abs(ends[0]).max())
