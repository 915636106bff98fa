"""Observed order in time of every integrator of ancf2d's own: smooth motions, with constraints and driven ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import helpers as h
import numpy as np
import pytest
from instruments.motions.orders import ORDER, PAIRS, SCENES, SMOOTHEST
from motions import GRAVITY, orders, ride, rod
from scipy.integrate import solve_ivp

import ancf2d
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import Run

CASES = Path(__file__).parents[2] / "cases" / "dynamic"
# how many steps the runs take; order 9 is at round-off soon
STEPS = {2: (64, 256), 5: (48, 96), 9: (14, 21)}
# 36 units of the last place: closer to round-off, chance decides whether Newton's method gets there
TIGHT = {"tight": 8e-15, "max_iterations": 40}


@pytest.fixture(scope="module")
def references():
    return {name: ride(scene, t_end, method="radau9", dt=t_end / 96, **TIGHT).end()
            for name, (scene, t_end) in SCENES.items()}


@pytest.mark.parametrize(("scene", "method"), PAIRS)
def test_errors_fall_with_the_order_of_the_method(references, scene, method):
    data, t_end = SCENES[scene]
    order = ORDER[method]
    steps = (6, 10) if order == 9 and scene in SMOOTHEST else STEPS[order]
    errors = []
    for n in steps:
        moved = ride(data, t_end, method=method, dt=t_end / n, **TIGHT)
        assert moved.column("rejected").max() == 0
        errors.append(np.abs(moved.end() - references[scene]).max(axis=1))
    seen = np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0])
    assert np.all(seen > order - (1.5 if order == 9 else 0.3))
    assert np.all(seen < order + 0.9)


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha"])
def test_estimates_of_fixed_steps_cover_vibrations_that_hide_the_order(method: str) -> None:
    """The free rod's own vibrations dominate the errors of the steps, which fall with order 2 for any method."""
    base = {"output.interval": 0.15, "bodies.rod.element.count": 8, "expected": []}

    def places(**solver: Any) -> tuple[np.ndarray, float | None]:
        found = ancf2d.solve(CASES / "free_rod.yaml", {**base, "solver": {
            "type": "dynamic", "t_end": 3, **solver}})
        ends = [np.stack([found.course[p][q] for q in ("ux", "uy")]) for p in ("lower", "upper", "middle")]
        return np.array(ends), (found.accuracy or {}).get("estimate")

    fine, _ = places(method="radau9", tolerance=1e-11, estimate=False)
    sizes = np.linalg.norm(fine, axis=1).max(axis=1)
    for steps in (100, 200, 400, 800) if method == "radau5" else (800, 1600, 3200):
        found, estimate = places(method=method, dt=3 / steps)
        error = float((np.linalg.norm(found - fine, axis=1).max(axis=1) / sizes).max())
        assert estimate is not None
        assert error < estimate < 10 * error


def double_pendulum(t_end):
    """Return the end of the lower bar of the double pendulum (2,), by its equations in the two angles."""
    m1, J1, m2, J2, L1 = 1.3, 0.2, 0.9, 0.11, 1.0
    L2, start = np.hypot(0.6, 0.7), np.arctan2(-0.7, 0.6)

    def rates(t, w):
        p, q, dp, dq = w
        c, s = m2 * L1 * L2 / 2 * np.cos(p - q), m2 * L1 * L2 / 2 * np.sin(p - q)
        M = [[J1 + (m1 / 4 + m2) * L1**2, c], [c, J2 + m2 * L2**2 / 4]]
        f = [-s * dq**2 - 9.81 * (m1 / 2 + m2) * L1 * np.cos(p), s * dp**2 - 9.81 * m2 * L2 / 2 * np.cos(q)]
        return [dp, dq, *np.linalg.solve(M, f)]

    p, q = solve_ivp(rates, (0, t_end), [0, start, 0, 0], method="DOP853", rtol=1e-13, atol=1e-13).y[:2, -1]
    return np.array([L1 * np.cos(p) + L2 * np.cos(q), L1 * np.sin(p) + L2 * np.sin(q)])


def test_bars_in_natural_coordinates_swing_like_their_angles():
    scene, t_end = SCENES["double pendulum"]
    moved = ride(scene, t_end, method="radau9", dt=t_end / 96, **TIGHT)
    np.testing.assert_allclose(moved.place("b@1"), double_pendulum(t_end), atol=2e-11)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["generalized_alpha", "hht"])
@pytest.mark.parametrize("rho", [0.5, 0.7, 0.9])
def test_second_order_at_every_spectral_radius(references, method, rho):
    scene, t_end = SCENES["double pendulum"]
    errors = [np.abs(ride(scene, t_end, method=method, dt=t_end / n, **TIGHT, spectral_radius=rho).end()
                     - references["double pendulum"]).max() for n in (64, 128, 256)]
    np.testing.assert_allclose(orders(errors), 2.0, atol=0.1)


def test_without_damping_the_generalized_alpha_family_is_one_method():
    scene, t_end = SCENES["pendulum"]
    plain = ride(scene, t_end, method="newmark", dt=0.01).end()
    for method in ("hht", "generalized_alpha"):
        np.testing.assert_allclose(ride(scene, t_end, method=method, dt=0.01, spectral_radius=1.0).end(), plain,
                                   atol=1e-11)
        damped = ride(scene, t_end, method=method, dt=0.01, spectral_radius=0.6).end()
        assert np.abs(damped - plain).max() > 1e-3


@pytest.mark.parametrize("method", ["radau5", "radau9"])
def test_the_error_of_a_step_iterated_to_round_off_equals_that_of_a_converged_one(method):
    ended = 0
    for E in (2e6, 2e7, 2e8):
        scene = {"bodies": {"a": rod("vallejo", 12, E=E)}, "bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY,
                 "initial": {"rotation_rate": {"omega": 3, "about": [0, 0]}}}
        one, two = (ride(scene, 0.01, method=method, dt=0.01, tight=tight, max_iterations=40) for tight in (0, 1e-17))
        assert len(one.log) == len(two.log) == 1
        np.testing.assert_allclose(two.column("error"), one.column("error"), rtol=1e-6)
        # the increment that no more is made of is not counted
        ended += (two.stepper.w.history > 0).sum() > two.column("iterations")[0]
    assert ended > 0


@pytest.mark.parametrize(("method", "steps"), [("radau5", 1000), ("radau9", 250)])
def test_residuals_of_newtons_method_do_not_add_up_over_many_short_steps(method, steps):
    """If the predicted stages are within Newton's tolerance of the solution, one increment is not enough."""
    scene, t_end = SCENES["double pendulum"]
    moved = ride(scene, t_end, method=method, dt=t_end / steps)
    np.testing.assert_allclose(moved.place("b@1"), double_pendulum(t_end), atol=1e-11)


@pytest.mark.parametrize("method", ["generalized_alpha", "energy_momentum", "radau5"])
def test_the_estimate_is_a_safety_factor_times_the_error_at_half_the_order(method):
    """A mass on a spring: u = v sin(omega t)/omega. The difference d = (2^p - 1) error counts as d/(2^((1 + p)/2) - 1).
    """
    bar = {"geometry": {"type": "line", "start": [0, 0], "end": [0.1, 0]},
           "element": {"type": "rigid", "mass": 1.0, "inertia": 0.01}}
    found = ancf2d.solve({
        "bodies": {"b": bar}, "boundary_conditions": [{"type": "roller", "at": f"b@{s}", "fixed": "y"} for s in (0, 1)],
        "springs": [{"type": "translational", "between": [[-1, 0], "b@0"], "stiffness": 100.0}],
        "initial": {"velocity": [1.0, 0]}, "output": {"probes": {"p": "b@0"}},
        "solver": {"type": "dynamic", "t_end": 1.0, "dt": 0.01, "method": method}})
    u, exact = found.d[:, 0], 0.1 * np.sin(10.0 * np.array(found.t))
    error = np.abs(u - exact).max() / np.abs(u).max()
    order = 5 if method == "radau5" else 2
    assert found.accuracy["order"] == pytest.approx(order, abs=0.1)
    expected = 1.25 * error * (2**order - 1) / (2 ** (0.5 * (1 + order)) - 1)
    assert found.accuracy["estimate"] == pytest.approx(expected, rel=0.1)


def steel_pendulum(t_end, **solver):
    """A thin steel rod that falls from the horizontal: Newton's method limits steps, not the tolerance."""
    return {"bodies": {"rod": {
        "geometry": {"type": "line", "start": [0, 0], "end": [1.8, 0]}, "section": {"height": 0.01, "width": 0.01},
        "material": {"E": 2.1e11, "nu": 0.3, "rho": 7850}, "element": {"type": "reissner3", "count": 4}}},
        "boundary_conditions": [{"type": "pin", "at": "rod@0"}], "loads": [{"type": "gravity", "value": [0, -9.81]}],
        "output": {"interval": 0.01, "probes": {"tip": "rod@1"}},
        "solver": {"type": "dynamic", "t_end": t_end} | solver}


@pytest.fixture(scope="module")
def fallen():
    return ancf2d.solve(steel_pendulum(0.6, method="radau9", tolerance=1e-9, estimate=False)).d[:, -3:-1]


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("method", ["radau5", "radau9"])
def test_the_estimate_is_not_reduced_by_coarser_runs_with_equal_steps(fallen, method, tolerance):
    """Runs with the same steps differ by a tenth of their error, or less."""
    found = ancf2d.solve(steel_pendulum(0.6, method=method, tolerance=tolerance))
    error = np.linalg.norm(found.d[:, -3:-1] - fallen, axis=1).max() / np.linalg.norm(fallen, axis=1).max()
    assert 0.4 < found.accuracy["estimate"] / error < 6.0


def test_a_level_without_longer_steps_is_abandoned_wherever_calls_end(monkeypatch):
    """The clock decides only how many steps a call makes; resumed runs continue alike."""
    found = []
    for rows in (4096, 9):
        monkeypatch.setattr(stepping, "LOG_ROWS", rows)
        monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)
        scene = steel_pendulum(0.6, tolerance=1e-4)
        model = h.build(scene.pop("bodies"), scene.pop("solver"), **scene)
        run = Run(model, model.case.solver)
        states = list(run.states())
        found.append((run.estimate.levels, states[-1].report["accuracy"]))
    assert found[0][0] == 1
    assert found[0] == found[1]
    middle = next(s.checkpoint for s in states[20:] if s.checkpoint is not None)
    *_, last = Run(model, model.case.solver).states(middle)
    assert last.report["accuracy"] == found[0][1]
