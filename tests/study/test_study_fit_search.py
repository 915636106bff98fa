"""The search of a fit: its number of runs, and derivatives of motions at measured times only."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import ancf2d
from ancf2d.solvers.derivatives.readings import CLOSE
from ancf2d.study.fit_data import DataValues, comparable, data_of
from ancf2d.study.fit_search import Search
from ancf2d.study.gradient import gradient
from scripts.bench.fits import ARM, SCENES, fitted

CASE = ARM.replace(", damping: 2", "")


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_five_numbers_of_a_motion_in_few_runs(name: str) -> None:
    """Exact derivatives at the guess and near the minimum, with Broyden's updates in between.

    Differences alone would need ten runs for each step of the search, and several periods out of step 25 runs and more.
    """
    scene, few = SCENES[name], "2.5 periods" in name
    run = ancf2d.solve(scene.case)
    for seed in range(1, 6 if few else 3):
        found, noise = fitted(scene, run, seed)
        assert [row.path for row in found.rows] == list(scene.numbers)
        for row in found.rows:
            assert row.standard_error is not None
            assert abs(row.value - scene.numbers[row.path][0]) < 4.0 * row.standard_error, row.path
        # the minimum lies below the true numbers, by what five numbers follow of the noise
        off = found.model - found.data.values
        added = np.array([noise[column] for column in found.data.names]).T
        beside = np.sum((off / found.scales)**2) / np.sum((added / found.scales)**2)
        assert 1.0 - 4.0 * 5.0 / off.size < beside < 1.0
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
    """The derivatives are those of readings of changed states.

    For a number without effect on the probes, one that moves them, and one that prescribes the motion of their body.
    """
    text = CASE.replace("{name: hub, type: pin, at: arm@0}", "{name: hub, type: prescribed, at: arm@0, x: 0, y: {type: "
                       "sine, scale: 0.01, frequency: 2}}").replace("dt: 4.0e-3, method: generalized_alpha", solver)
    text = text.replace("t_end: 0.6", "t_end: 0.06")
    data = data_of({"t": x, **{f"{p}.{q}": 0.0 * x for p, q in zip(("tip", "mid", "third"), quantities, strict=True)}})
    case, read, precise = comparable(ancf2d.load(text), data), DataValues(data), DataValues(data)
    precise.negligible = CLOSE
    paths = ("masses.tip.mass", "bodies.arm.geometry.end.0", "boundary_conditions.hub.y.scale")

    def plain(model: Any, states: Any) -> np.ndarray:
        return read(model, states)
    assert read.from_probes
    (value, J), (same, by_states) = gradient(case, precise, paths), gradient(case, plain, paths)
    np.testing.assert_array_equal(value, same)
    enough = gradient(case, read, paths)[1]
    for k in range(len(paths)):
        size = np.abs(by_states[:, k]).max()
        np.testing.assert_allclose(J[:, k], by_states[:, k], atol=1e-6 * size)
        # those of a fit need not be as exact
        np.testing.assert_allclose(enough[:, k], by_states[:, k], atol=read.negligible * size)


def test_the_first_part_of_a_search_ends_with_its_data() -> None:
    """The first third of all columns, one of which begins late; the motion ends with the last of them."""
    x = 0.012 * np.arange(1, 31)
    late = np.where(x > 0.1, x, np.nan)
    data = data_of({"t": x, "tip.uy": x, "mid.uy": late})
    early = data.early(1.0 / 3.0)
    assert early.known.sum() == pytest.approx(data.known.sum() / 3.0, abs=1.0)
    assert early.x[-1] == x[len(early.x) - 1] < 0.5 * x[-1]
    assert comparable(ancf2d.load(CASE), early).case.solver.t_end == pytest.approx(early.x[-1])


def test_a_step_replaces_a_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    """Derivatives of a linear model are exact, whether the runs go along the parameters or across the last step."""
    A, z = np.random.default_rng(0).normal(size=(7, 3)), np.array([0.2, 0.5, 0.9])
    places: list[np.ndarray] = []
    one = Search.__new__(Search)
    one.loaded, one.measured, one.scale = ancf2d.load(CASE), np.zeros(7), np.ones(7)
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
