"""The motions that ``cases/dynamic`` expects, recomputed; the method itself compared with published values."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from instruments.references import motions as motion_references

from ancf2d.study.run import load

CASES = Path(__file__).parents[2] / "cases" / "dynamic"


def expected(case: str, probe: str) -> list[float]:
    """Return the expected end position of a probe."""
    found = {e.quantity: e.value for e in load(CASES / f"{case}.yaml").case.expected if e.probe == probe}
    return [found["x"], found["y"]]


@pytest.mark.slow
def test_first_pendulum_as_an_independent_cable() -> None:
    tip = motion_references.pendulum_1([0.5, 1.0, 1.5], 1, 2e-3)
    np.testing.assert_allclose(tip, [[0.991498, -1.502307], [-1.685664, -0.631293], [-1.774687, -0.300800]], atol=3e-5)


@pytest.mark.slow
def test_second_pendulum_as_an_independent_geometrically_exact_beam() -> None:
    tip = motion_references.pendulum_2([0.25, 0.5], 4, 2.5e-3)
    np.testing.assert_allclose(tip, [[1.171603, -0.308758], [0.354320, -1.307083]], atol=2e-5)


def test_slider_crank_as_published() -> None:
    y = motion_references.slider_crank([0.1, 0.2, 0.3], 2, 2e-3)[:, 1]
    np.testing.assert_allclose(y, [0.0674, -0.0251, 0.1219], atol=1e-4)


def test_spin_up_as_simo_and_vu_quoc() -> None:
    tip = motion_references.spin_up([5, 7.5, 10], 1, 0.05)
    np.testing.assert_allclose(tip[:, 1], [-0.4685, -0.5591, -0.3628], atol=5e-5)


# motions that no published value is compared with above, coarser than what the expected values are from; elements,
# steps and what that may cost [m]
@pytest.mark.slow
@pytest.mark.parametrize(("case", "motion", "probes", "count", "h", "atol"), [
    ("slider_crank_rigid", "slider_crank_rigid", ["middle"], 2, 1e-3, 1e-5),
    ("double_pendulum", "double_pendulum", ["elbow", "tip"], 2, 5e-3, 2e-5),
    ("four_bar", "four_bar", ["middle"], 1, 1e-3, 2e-6),
    ("free_rod", "free_rod", ["lower", "upper"], 3, 0.025, 1e-4),
])
def test_expected_end_of_the_motion(case: str, motion: str, probes: list[str], count: int, h: float,
                                    atol: float) -> None:
    t_end = load(CASES / f"{case}.yaml").case.solver.t_end
    end = motion_references.MOTIONS[motion]([t_end], count, h)[-1]
    np.testing.assert_allclose(np.concatenate([expected(case, p) for p in probes]), end, rtol=0, atol=atol)


def test_expected_end_of_the_spin_up() -> None:
    angle = motion_references.spin(7.5, 6, 15)[0]
    c, s = math.cos(angle), math.sin(angle)
    u, v = motion_references.spin_up([7.5], 1, 0.05)[0]
    np.testing.assert_allclose(expected("spin_up", "tip"), [c * u - s * v, s * u + c * v], rtol=0, atol=2e-6)
