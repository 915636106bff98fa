"""Coarser motions for error estimates run in threads next to a long motion, without any effect on results."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ancf2d.kernels.motion.state import COUNT
from ancf2d.solvers.motion import estimate, stepping
from ancf2d.solvers.motion.dynamic import Run
from tests import helpers as h

ROD = {"rod": h.body(h.line(1.0), h.element("cable", 4), {"height": 0.02, "width": 0.02},
                     {"E": 1e8, "nu": 0.3, "rho": 1000.0})}
CLAMPED = {"boundary_conditions": [{"type": "clamp", "at": "rod@0"}]}
GRAVITY = {"type": "gravity", "value": [0, -9.81]}
SINE = {"type": "sine", "frequency": 3.0}
SCENES: dict[str, dict[str, Any]] = {
    "amplitude": {**CLAMPED, "loads": [{"type": "force", "at": "rod@1", "value": [0, -20], "amplitude": SINE}]},
    "natural strain": {**CLAMPED, "loads": [{"type": "eigenstrain", "on": "rod", "curvature": 0.2, "amplitude": SINE}]},
    "relaxing": {**CLAMPED, "loads": [GRAVITY]},
    "springs": {"loads": [GRAVITY], "springs": [
        {"type": "translational", "between": [[-0.2, 0.1], "rod@0"], "stiffness": 300, "damping": 1},
        {"type": "rotational", "between": [[1, 0], "rod@1"], "stiffness": 2}]},
    "prescribed": {"loads": [GRAVITY], "boundary_conditions": [
        {"type": "prescribed", "at": "rod@0", "x": 0, "y": {"type": "expression", "value": "0.02*sin(9*t)"}}]},
}


def run_of(scene: str, **solver: Any) -> Run:
    material = {"viscoelastic": [{"modulus": 0.5, "time": 0.1}]} if scene == "relaxing" else {}
    rod = {**ROD["rod"], "material": {**ROD["rod"]["material"], **material}}
    model = h.build({"rod": rod}, {"type": "dynamic", "t_end": 0.2, **solver}, output={"interval": 0.01, "probes": {
        "tip": "rod@1"}}, **SCENES[scene])
    run = Run(model, model.case.solver)
    # ends a run behind a few steps, as long motions do behind many
    run.stepper.steps = 4
    return run


def groups_of(problem: Any) -> Any:
    """Return the element groups with addresses in a problem."""
    return problem._others[-1]


def arrays(values: Any, name: str = "p") -> dict[str, np.ndarray]:
    """Return the arrays of a record by name."""
    if isinstance(values, np.ndarray):
        return {name: values} if values.size else {}
    fields = zip(values._fields, values, strict=True) if isinstance(values, tuple) else ()
    return {key: x for field, value in fields for key, x in arrays(value, f"{name}.{field}").items()}


@pytest.mark.parametrize("scene", SCENES)
def test_motions_write_no_shared_arrays(scene: str) -> None:
    run = run_of(scene, tolerance=1e-4)
    assert run.estimate is not None
    run.estimate.start(*run.begin())
    one, other = run.stepper, run.estimate.coarse[0]
    tables = [(one.p.values, other.p.values), *((a.values, b.values) for a, b in zip(
        groups_of(one.p), groups_of(other.p), strict=True))]
    shared = [x for mine, theirs in tables for x, y in zip(arrays(mine).values(), arrays(theirs).values(), strict=True)
              if np.shares_memory(x, y)]
    before = [x.tobytes() for x in shared]
    groups = [arrays(group.values) for group in run.model.groups]
    written = {"p.plan.work", "p.plan.loaded", "p.natural.amount", "p.memory.states"}
    for group, own in zip(groups, groups_of(one.p), strict=True):
        assert not any(np.shares_memory(x, group[name]) for name, x in arrays(own.values).items() if name in written)
    while not other.done:
        other.run()
    assert len(shared) > 10
    assert [x.tobytes() for x in shared] == before


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("solver", [{"tolerance": 1e-4}, {"dt": 2e-3, "method": "generalized_alpha"}],
                         ids=["adaptive", "fixed"])
def test_estimates_are_the_same_bits_in_threads(scene: str, solver: dict[str, Any], monkeypatch: pytest.MonkeyPatch
                                                ) -> None:
    found, made = {}, set()
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 1e-9)
    for number in (1, 2):
        monkeypatch.setattr(estimate, "threads", lambda number=number: number)
        run = run_of(scene, **solver)
        states = list(run.states())
        assert run.estimate is not None
        made.add(run.estimate.pool is None)
        found[number] = run.estimate.report(), run.estimate.largest.tobytes(), states[-1].d.tobytes()
    assert made == {True, False}
    assert found[1][0]["estimate"] > 0.0
    assert found[1] == found[2]


def test_a_resumed_motion_has_the_same_estimate_in_threads(monkeypatch: pytest.MonkeyPatch
                                                           ) -> None:
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 1e-9)
    monkeypatch.setattr(estimate, "threads", lambda: 2)
    run = run_of("amplitude", tolerance=1e-4)
    kept = [state.checkpoint for state in run.states() if state.checkpoint is not None]
    later = run_of("amplitude", tolerance=1e-4)
    for _ in later.states(kept[len(kept) // 2]):
        pass
    assert run.estimate is not None
    assert later.estimate is not None
    assert later.estimate.pool is not None
    assert later.estimate.report() == run.estimate.report()


def test_an_estimate_does_not_depend_on_the_length_of_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for seconds in (1e-9, 10.0):
        monkeypatch.setattr(stepping, "CHUNK_SECONDS", seconds)
        run = run_of("prescribed", tolerance=1e-6)
        found.append([len(list(run.states()))])
        assert run.estimate is not None
        found[-1] += [run.estimate.report(), run.estimate.largest.tobytes(), run.estimate.made.tobytes()]
    assert found[0][0] == 21
    assert found[0] == found[1]


def test_a_second_coarser_motion_without_longer_steps_is_abandoned() -> None:
    """Newton's method limits the steps of a slender pendulum: the second coarser motion is abandoned at once."""
    slender = h.body(h.line(1.8), h.element("reissner3", 4), {"height": 0.004, "width": 0.03},
                     {"E": 2e11, "nu": 0.3, "rho": 2700.0})
    model = h.build({"rod": slender}, {"type": "dynamic", "t_end": 0.8, "tolerance": 1e-4}, loads=[GRAVITY],
                    boundary_conditions=[{"type": "pin", "at": "rod@0"}], output={"probes": {"tip": "rod@1"}})
    run = Run(model, model.case.solver)
    for _ in run.states():
        pass
    assert run.estimate is not None
    first, second = (int(motion.s.numbers[COUNT]) for motion in run.estimate.coarse)
    assert run.estimate.levels == 1
    assert first > 1.8 * estimate.SEEN
    assert estimate.SEEN <= second < 1.5 * estimate.SEEN


def test_a_level_whose_steps_are_divided_into_many_is_abandoned(monkeypatch: pytest.MonkeyPatch) -> None:
    """A motion made unstable by longer steps may need a hundred times as many of them."""
    run = run_of("amplitude", dt=1e-3)
    judge = run.estimate
    assert judge is not None
    for _ in run.states():
        pass
    assert (judge.own, judge.levels, judge.failed) == (200, 2, "")
    made, nothing = np.zeros((2, 1, 2)), np.zeros(0)
    for first, second, vain in ((100, 50, [False, False]), (100, 600, [False, True]), (900, 450, [True, False])):
        made[:, 0, 1] = first, second
        assert judge._is_vain(made, np.array([200.0]), nothing, nothing)[:, 0].tolist() == vain
    assert judge.report()["order"] is not None
    judge.levels = 1
    assert judge.report()["estimate"] > 0.0
    assert judge.report()["order"] is None

    monkeypatch.setattr(estimate, "MANY", 0)
    monkeypatch.setattr(estimate, "DIVIDED", 0.4)
    run = run_of("amplitude", dt=1e-3)
    judge = run.estimate
    assert judge is not None
    for _ in run.states():
        pass
    assert judge.levels == 0
    assert "divided" in judge.warnings()[0]
    assert judge.report()["estimate"] is None
    judge.failed = ""
    judge.resume(judge.checkpoint())
    assert "divided" in judge.failed
