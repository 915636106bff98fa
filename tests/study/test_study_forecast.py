"""Predicted costs and the remaining time of a study, with a clock that only the work moves."""

from __future__ import annotations

import heapq
import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from jobs import SQUARE

from ancf2d.case import load_case_text
from ancf2d.case.axes import read_axes
from ancf2d.pace import Pace, SteadyEstimate
from ancf2d.solvers.motion.stepping import Stepper
from ancf2d.study import convergence as convergence_module
from ancf2d.study import sweep as sweep_module
from ancf2d.study.forecast import Budget, Forecast, predicted_cost
from ancf2d.study.pool import ALONE, Workers
from ancf2d.study.record import Progress
from ancf2d.study.run import run_case, vocabulary
from ancf2d.study.sweep import plan, run_sweep
from ancf2d.study.variants import parse_variants

# seconds of a solution over its elements: in proportion, with a constant part, of a sparse and a dense factorisation
LAWS = {"linear": lambda n: 0.1 * n, "constant part": lambda n: 5.0 + 0.1 * n, "power": lambda n: 0.01 * n**1.5,
        "cubic": lambda n: 1e-4 * n**3}
MESHES = [4, 8, 16, 32, 64, 128]
SLICES = 20


def test_cost_grows_as_the_last_two_did_within_reason() -> None:
    assert predicted_cost([], [], 8) is None
    assert predicted_cost([2, 4], [1.0, 4.0], 8) == pytest.approx(16.0)
    assert predicted_cost([4], [1.0], 8) == pytest.approx(2**1.3)
    # noise does not make a finer mesh cheaper, nor hopeless
    assert predicted_cost([2, 4], [1.0, 0.1], 8) > 0.1
    assert predicted_cost([2, 4], [1.0, 100.0], 8) == pytest.approx(800.0)


def test_estimates_of_many_jobs_take_a_small_share_of_their_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now, told = [0.0], []
    ahead = Forecast([("a", 1.0)] * 2000, done=lambda share, left: told.append(share), clock=lambda: now[0])
    estimate = ahead.left

    def left(running: float | None = None) -> float | None:
        now[0] += 0.01
        return estimate(running)

    monkeypatch.setattr(ahead, "left", left)
    for i in range(2000):
        now[0] += 0.05
        ahead.record(i, None, 0.05)
    assert 10 < len(told) <= 0.01 * 2000 * 0.05 / 0.01
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_budget_counts_from_its_beginning() -> None:
    moments = iter([100.0, 103.0, 103.0, 110.5])
    budget = Budget(10.0, lambda: next(moments))
    assert budget.affords(6.9)
    assert not budget.affords(7.0)
    assert not budget.affords(0.0)


class Clock:
    """A clock moved by the work, and the reported remaining times: moments, seconds left."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        self.told: list[tuple[float, float | None]] = []
        monkeypatch.setattr(time, "monotonic", lambda: self.now)
        monkeypatch.setattr(time, "perf_counter", lambda: self.now)

    def done(self, share: float, left: float | None) -> None:
        self.told.append((self.now, left))

    def work(self, seconds: float, progress: Any = None) -> None:
        """Let time pass in slices; after each a state without news of the remaining time."""
        for _ in range(SLICES):
            self.now += seconds / SLICES
            if progress is not None:
                progress.state(SimpleNamespace(left=None))

    def assert_right(self, first: float) -> None:
        """Check that all reports after the first job and 5 % of the time are right within a factor of two.

        The last twentieth is exempt: a second more or less is much of what is left there.
        """
        whole = self.now - 1000.0
        told = [(t - 1000.0, left) for t, left in self.told
                if max(first, 0.05 * whole) < t - 1000.0 < 0.95 * whole]
        assert len(told) > SLICES
        for t, left in told:
            assert left is not None
            assert 0.5 <= left / (whole - t) <= 2.0, (t / whole, left, whole - t)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


@pytest.mark.parametrize("law", LAWS)
def test_the_time_left_of_a_convergence_study_is_right_within_a_factor_of_two(
        law: str, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two element types, the second four times as expensive."""
    cost = LAWS[law]

    def solve(job: Any, progress: Any = None) -> Any:
        clock.work(cost(job.elements) * (4.0 if job.variant.element == "vallejo" else 1.0), progress)
        return job.row

    monkeypatch.setattr(convergence_module, "solve_job", solve)
    monkeypatch.setattr(convergence_module, "_warm_up", lambda first, compiling: None)
    loaded = load_case_text(SQUARE, vocabulary=vocabulary())
    convergence_module.convergence(loaded, parse_variants("reissner3"), MESHES, done=clock.done)
    clock.assert_right(cost(MESHES[0]))
    clock.told, began = [], clock.now
    convergence_module.convergence(loaded, parse_variants("reissner3,vallejo"), MESHES, done=clock.done)
    # of the second type nothing is known before its first mesh is solved
    second = began + sum(map(cost, MESHES)) + 4.0 * cost(MESHES[0])
    for t, left in clock.told:
        if second < t < clock.now - 0.05 * (clock.now - began):
            assert left is not None
            assert 0.5 <= left / (clock.now - t) <= 2.0


@pytest.mark.parametrize("law", LAWS)
def test_the_time_left_of_a_sweep_is_right_within_a_factor_of_two(
        law: str, clock: Clock, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def solve(job: Any, progress: Any = None) -> dict[str, Any]:
        clock.work(LAWS[law](job.size), progress)
        return {"status": "failed", "reason": ""}

    monkeypatch.setattr(sweep_module, "solve_job", solve)
    monkeypatch.setattr(sweep_module, "_warm_up", lambda jobs, compiling: None)
    case = tmp_path / "case.yaml"
    case.write_text(SQUARE)
    axes = read_axes([f"bodies.b.element.count={','.join(map(str, MESHES))}", "loads.0.value=[0,-1],[0,-2]"])
    run_sweep(plan(str(case), axes, (), tmp_path / "out", ALONE), ALONE, done=clock.done)
    clock.assert_right(LAWS[law](MESHES[0]))


def in_processes(costs: Sequence[float], count: int, startup: float, ahead: Forecast, clock: Clock) -> None:
    """Let processes with a start-up time do jobs in order, with a forecast every second."""
    free, ends = [startup] * count, []
    for i, cost in enumerate(costs):
        end = heapq.heappop(free) + cost
        heapq.heappush(free, end)
        ends.append((end, 1, i))
    origin = clock.now
    seconds = [(float(t), 0, 0) for t in range(int(max(ends)[0]))]
    for moment, ended, i in sorted(ends + seconds):
        clock.now = origin + moment
        if ended:
            ahead.record(i, None, costs[i])
        else:
            ahead.tick()


@pytest.mark.parametrize("count", [2, 4])
@pytest.mark.parametrize("law", LAWS)
def test_the_time_left_accounts_for_parallel_processes(law: str, count: int, clock: Clock) -> None:
    sizes = [n for n in MESHES for _ in range(6)]
    startup = 8.0
    ahead = Forecast([("kind", float(n)) for n in sizes], Workers(count), clock.done)
    in_processes([LAWS[law](n) for n in sizes], count, startup, ahead, clock)
    # two sizes tell how the cost grows
    clock.assert_right(startup + LAWS[law](MESHES[0]) * 6 / count + LAWS[law](MESHES[1]) + 1.0)


def test_the_forecast_of_a_running_job_is_used(clock: Clock) -> None:
    """After one job of 10 s the second one, twice as large, reports that it will take 500 s."""
    ahead = Forecast([("kind", 1000.0), ("kind", 2000.0), ("kind", 2000.0)], clock=lambda: clock.now)
    clock.now += 10.0
    ahead.record(0, None, 10.0)
    assert ahead.left() == pytest.approx(40.0, rel=0.1)
    assert ahead.left(500.0) == pytest.approx(520.0, rel=0.1)


SWING = """
bodies:
  b: {geometry: {type: line, start: [0, 0], end: [1, 0]}, section: {height: 0.1, width: 0.1},
      material: {E: 2.07e11, nu: 0.3, rho: 7850}, element: {type: rigid}}
boundary_conditions: [{type: pin, at: b@0}]
loads: [{type: gravity, value: [0, -9.81]}]
solver: {type: dynamic, t_end: 1, dt: 0.005}
output: {probes: {tip: b@1}, interval: 0.005}
"""


def test_the_time_left_of_a_motion_includes_work_ahead_of_the_stored_states(
        clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """A call of the kernels makes many steps, whose states are processed afterwards.

    Here a call takes 10 s, of the coarser motions 5 s, and each of 200 states 0.1 s. Half of the work is done at the
    first state, at t = 0.005 of 1; a third state is needed to know how long one takes.
    """
    run = Stepper.run

    def stepped(stepper: Stepper, *most: float) -> Any:
        clock.now += 10.0 if stepper.dt == 0.005 else 5.0
        return run(stepper, *most)

    def taken(state: Any) -> None:
        clock.now += 0.1
        clock.done(state.t, state.left)

    monkeypatch.setattr(Stepper, "run", stepped)
    run_case(load_case_text(SWING, vocabulary=vocabulary()), progress=Progress(state=taken))
    third = next(t for t, left in clock.told if left is not None) - 1000.0
    assert clock.told[2][1] is None
    assert clock.told[3][1] is not None
    clock.assert_right(third - 0.05)


def test_the_pace_of_the_latter_half_is_extrapolated() -> None:
    """Of 100 s the first 10 pass without any work: from 15 s on they no longer count."""
    found = Pace()
    for t in range(1, 100):
        found.mark(max(t - 10.0, 0.0) / 90.0, float(t))
        left = found.left(1.0)
        if t >= 15:
            assert left is not None
            assert 1.0 - 1e-9 <= left / (100.0 - t) <= (2.0 if t < 20 else 1.1)


@pytest.mark.parametrize(("power", "worst"), [(1.0, 1.01), (0.5, 1.01), (0.1, 1.1), (2.0, 2.01)])
def test_growing_steps_are_expected_to_keep_growing(power: float, worst: float) -> None:
    """Seconds t^power after the time t: from 2 % of the motion on, in chunks with the steps between them."""
    found, last = Pace(), 0.0
    for k in range(1, 400):
        t = (k / 400) ** (1 / power)
        steps = [((k - 1 + j / 50) / 400) ** (1 / power) for j in range(1, 50)]
        found.mark(t, float(k), within=steps)
        left = found.left(1.0)
        assert left is not None
        if (0.5 if power > 1.0 else 0.02) < t < 0.98:
            ratio = left / (400.0 - k)
            assert 1 / worst < ratio < worst, (t, ratio)
        last = t
    assert last < 1.0
    assert len(found.at) <= 401


def test_a_time_is_reported_once_it_has_settled() -> None:
    """The forecast is 1000 s for 20 s, then 100 s; and 300 s from 70 s on."""
    calm, told = SteadyEstimate(), {}
    for second in range(1, 100):
        whole = 1000.0 if second < 20 else 100.0 if second < 70 else 300.0
        told[second] = calm(float(second), whole - second)
    assert told[1] is None
    assert told[10] == 990.0
    assert all(told[k] is None for k in range(20, 38))
    assert all(told[k] == 100.0 - k for k in range(41, 70))
    assert all(told[k] is None for k in range(70, 100))


def test_there_is_no_forecast_before_any_work_is_done() -> None:
    found = Pace(0.4)
    found.mark(0.4, 10.0)
    assert found.left(1.0) is None
    found.mark(1.0, 20.0)
    assert found.left(1.0) == 0.0
