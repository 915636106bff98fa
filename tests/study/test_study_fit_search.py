"""The search of a fit: how many runs it takes, and derivatives of what motions have where something was measured."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import ancf2d
from ancf2d.case.axes import read_bounds
from ancf2d.study.fit import fit
from ancf2d.study.fit_data import Watch, comparable, data_of
from ancf2d.study.fit_search import Search
from ancf2d.study.gradient import gradient

ARM = """\
title: Arm that falls on a hub
bodies:
  arm:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.01, width: 0.03}
    material: {E: 7.0e+10, nu: 0.3, rho: 2700, damping: {kelvin_voigt: 3.0e-4}}
    element: {type: cable, count: 4}
boundary_conditions:
  - {name: hub, type: pin, at: arm@0}
springs:
  - {name: hub, type: rotational, between: [[0, 0], arm@0], stiffness: 300, damping: 0.5}
  - {name: stay, type: translational, between: [arm@0.6, [0.6, 0.4]], stiffness: 800, length: 0.4}
masses:
  - {name: tip, at: arm@1, mass: 0.3}
loads:
  - {name: weight, type: force, at: arm@1, value: [0, -15]}
solver: {type: dynamic, t_end: 0.6, dt: 4.0e-3, method: generalized_alpha}
output:
  interval: 0.012
  probes: {tip: arm@1, mid: arm@0.5, third: arm@0.3}
"""
# true, first guess, bounds
FIVE = {"bodies.arm.material.damping.kelvin_voigt": (3e-4, 5e-4, "1e-5:3e-3"),
        "springs.hub.stiffness": (300.0, 380.0, "100:900"), "springs.hub.damping": (0.5, 0.8, "0.05:5"),
        "loads.weight.value.1": (-15.0, -12.0, "-30:-5"), "masses.tip.mass": (0.3, 0.36, "0.1:1")}


@pytest.fixture(scope="module")
def arm_run() -> Any:
    return ancf2d.solve(ARM)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 6))
def test_five_numbers_of_a_motion_in_few_runs(arm_run: Any, seed: int) -> None:
    """Exact derivatives at the guess and near the minimum, with Broyden's updates between them; differences alone
    would be ten runs for each step of the search."""
    noise = 2e-4 * np.random.default_rng(seed).standard_normal((3, len(arm_run.results.probe_t)))
    data = {"t": arm_run.results.probe_t}
    data |= {f"{n}.uy": arm_run.results.probes[n]["uy"] + noise[k] for k, n in enumerate(("tip", "mid", "third"))}
    guess = ancf2d.load(ARM, {path: first for path, (_, first, _) in FIVE.items()})
    found = fit(guess, data_of(data), read_bounds([f"{path}={bounds}" for path, (_, _, bounds) in FIVE.items()]))
    assert [row.path for row in found.rows] == list(FIVE)
    for row in found.rows:
        assert row.standard_error is not None
        assert abs(row.value - FIVE[row.path][0]) < 4.0 * row.standard_error, row.path
    # the minimum lies below the true numbers, by what five numbers follow of the noise
    off = np.array([found.model[:, k] - data[name] for k, name in enumerate(found.data.names)])
    beside = np.sum((off / found.scales[:, None])**2) / np.sum((noise / found.scales[:, None])**2)
    assert 1.0 - 4.0 * 5.0 / noise.size < beside < 1.0
    assert found.runs <= 15


@pytest.mark.slow_rows("adaptive", "at states")
@pytest.mark.parametrize(("solver", "x", "quantities"), [
    ("dt: 4.0e-3, method: generalized_alpha", 0.012 * np.arange(1, 5), ("uy", "vx", "omega")),
    ("dt: 4.0e-3, method: generalized_alpha", np.array([0.01, 0.0173, 0.0401]), ("x", "uy", "theta")),
    ("dt: 4.0e-3, method: generalized_alpha", 0.012 * (np.arange(1, 4) + 1e-7 * np.sin(np.arange(1, 4))),
     ("uy", "vx", "omega")),
    ("tolerance: 1.0e-5", 0.02 * np.arange(1, 4), ("y", "theta", "vy"))],
    ids=["at states", "between states", "rates close to states", "adaptive"])
def test_values_of_motions_are_sums_of_changes_of_states(solver: str, x: np.ndarray, quantities: tuple[str, ...]
                                                         ) -> None:
    """The derivatives are those of readings of changed states: for a number that the probes do not depend on, one that
    moves them, and one that prescribes where their body is."""
    text = ARM.replace("{name: hub, type: pin, at: arm@0}", "{name: hub, type: prescribed, at: arm@0, x: 0, y: {type: "
                       "sine, scale: 0.01, frequency: 2}}").replace("dt: 4.0e-3, method: generalized_alpha", solver)
    text = text.replace("t_end: 0.6", "t_end: 0.06")
    data = data_of({"t": x, **{f"{p}.{q}": 0.0 * x for p, q in zip(("tip", "mid", "third"), quantities, strict=True)}})
    case, read = comparable(ancf2d.load(text), data), Watch(data)
    paths = ("masses.tip.mass", "bodies.arm.geometry.end.0", "boundary_conditions.hub.y.scale")

    def plain(model: Any, states: Any) -> np.ndarray:
        return read(model, states)
    assert read.places
    (value, J), (same, by_states) = gradient(case, read, paths), gradient(case, plain, paths)
    np.testing.assert_array_equal(value, same)
    for k in range(len(paths)):
        np.testing.assert_allclose(J[:, k], by_states[:, k], atol=1e-6 * np.abs(by_states[:, k]).max())


def test_a_step_takes_the_place_of_a_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    """Derivatives of a linear model are exact, whether the runs go along the numbers or across the last step."""
    A, z = np.random.default_rng(0).normal(size=(7, 3)), np.array([0.2, 0.5, 0.9])
    places: list[np.ndarray] = []
    one = Search.__new__(Search)
    one.loaded, one.measured, one.scale = ancf2d.load(ARM), np.zeros(7), np.ones(7)
    monkeypatch.setattr(one, "model", lambda at: places.append(at) or A @ at, raising=False)

    def found(z: np.ndarray, *step: Any) -> np.ndarray:
        places.clear()
        return one._differences(z, A @ z, *step)
    dz = np.array([0.1, -0.2, 0.05])
    for at in (z, np.array([0.0, 1.0, 0.5])):
        for step, runs in (((), 3), (((dz, A @ dz),), 2 if at is z else 3)):
            np.testing.assert_allclose(found(at, *step), A, rtol=1e-9, atol=1e-10)
            assert len(places) == runs
            assert all(np.all((place >= 0.0) & (place <= 1.0)) for place in places)
