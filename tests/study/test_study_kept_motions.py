"""Steps of a motion stored for its adjoint, and the choice between both directions."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from test_study_motion_adjoint import CLAMP, PIN, SHORT, SOME, found, scene

import ancf2d
from ancf2d.case.numbers import numbers_at
from ancf2d.solvers.derivatives import linear_steps, transposed_steps
from ancf2d.solvers.motion import stepping
from ancf2d.study import gradient
from ancf2d.study.expressions import GoalValues
from ancf2d.study.goal import for_study
from ancf2d.study.gradient import DifferentiableRun, prepare, run_case
from ancf2d.study.record import Progress


def test_storage_of_a_motion_does_not_change_derivatives(monkeypatch, tmp_path):
    """Steps recomputed from few or many checkpoints, and sparse matrices, give the same derivatives."""
    loaded = scene(tmp_path, "radau5", CLAMP, SHORT)
    values, _ = found(loaded, SOME)
    for name, size in (("KEPT", 0), ("WINDOW", 0), ("LEAST", 2), ("CHECKPOINTS", 0)):
        monkeypatch.setattr(transposed_steps, name, size)
        assert found(loaded, SOME)[0] == pytest.approx(values, rel=1e-9), name
    monkeypatch.setattr(linear_steps, "BAND", 0)
    assert found(loaded, SOME)[0] == pytest.approx(values, rel=1e-8)


def test_checkpoints_stay_within_their_memory(monkeypatch, tmp_path):
    """Every second one is dropped if there are too many, and the steps between the others are recomputed."""
    for name, size in (("KEPT", 0), ("WINDOW", 0), ("LEAST", 2), ("CHECKPOINTS", 0)):
        monkeypatch.setattr(transposed_steps, name, size)
    loaded = scene(tmp_path, "generalized_alpha", CLAMP, "solver.dt=1e-4", "loads.push.amplitude={type: constant}")
    motion = transposed_steps.RecordedMotion(prepare(loaded), False, 1e-12, None)
    list(motion.states())
    # windows of 8 steps
    assert sum(part.count for part in motion.parts) == 100
    assert len([part for part in motion.parts if part.count]) <= 3


def test_steps_are_made_once_for_values_and_derivatives(monkeypatch, tmp_path):
    """The run for the values is stored for the adjoint, if Newton's method takes few iterations in its steps."""
    loaded, made = scene(tmp_path, "newmark", PIN, SHORT, "solver.dt=0.0001"), list[int]()
    advance = stepping.Stepper.advance

    def counted(self, found, steps):
        out = advance(self, found, steps)
        made.append(out[1])
        return out
    # kernels that have to be compiled make steps, too
    told, steps = [], run_case(for_study(loaded)).summary["steps"]
    monkeypatch.setattr(stepping.Stepper, "advance", counted)
    for once in (True, False):
        if not once:
            monkeypatch.setattr(gradient, "NEWTON", ())
        made.clear()
        told.append(ancf2d.sensitivity(loaded, SOME))
        assert sum(made) == steps * (1 if once else 2)
    one, two = ({row.path: row.derivative for row in t.rows} for t in told)
    assert one == pytest.approx(two, rel=1e-9)
    assert told[0].goal == pytest.approx(told[1].goal, rel=1e-8)
    assert told[0].warnings == told[1].warnings


def test_the_last_step_is_kept_however_long_it_takes(monkeypatch, tmp_path):
    """Calls make steps for a short time only: of a large model one by one, including the last one."""
    loaded = scene(tmp_path, "newmark", PIN, SHORT)
    many, _ = found(loaded, SOME)
    monkeypatch.setattr(transposed_steps, "CHUNK_SECONDS", 0.0)
    single, _ = found(loaded, SOME)
    assert np.abs(single).min() > 0.0
    assert single == pytest.approx(many, rel=1e-9)


@pytest.mark.parametrize(("iterations", "push", "tight"), [(5, 3e3, False), (12, 1e4, True)])
def test_steps_are_as_long_as_those_of_a_run(tmp_path, iterations, push, tight):
    """A tolerance that Newton's method cannot reach is relaxed; steps that a run also shortens are kept so."""
    loaded = for_study(scene(tmp_path, "newmark", PIN, SHORT, f"solver.max_iterations={iterations}", "solver.dt=2e-3",
                             f"loads.push.value=[0, {-push}]"))
    outcome = run_case(loaded)
    assert outcome.summary["rejected"] > 0
    for tolerance, kept in ((1e-13, tight), (1e-10, True)):
        motion = transposed_steps.RecordedMotion(outcome.model, False, tolerance, [])
        with nullcontext() if kept else pytest.raises(transposed_steps.StepLengthError):
            *_, last = motion.states()
            assert last.report["rejected"] == outcome.summary["rejected"]


def test_a_bead_that_slides_off_its_rail_ends_the_stored_motion():
    """r = 0.5 cosh(4 t) reaches the end of the rail of 2 m at t = 0.516, as in a run."""
    def rigid(a, b, mass, inertia):
        return {"geometry": {"type": "line", "start": [a, 0], "end": [b, 0]}, "section": {"height": 0.1, "width": 0.1},
                "element": {"type": "rigid", "mass": mass, "inertia": inertia}}
    turn = {"type": "expression", "value": "4*t"}
    loaded = ancf2d.load({
        "bodies": {"rail": rigid(0, 2, 1.0, 0.5), "bead": rigid(0.45, 0.55, 2.0, 2e-3)},
        "boundary_conditions": [{"type": "prescribed", "at": "rail@0", "ux": 0, "uy": 0, "angle": turn}],
        "joints": [{"name": "sleeve", "type": "prismatic", "point": "bead@0.5", "on": "rail"}],
        "initial": {"rotation_rate": {"omega": 4.0, "about": [0, 0]}},
        "solver": {"type": "dynamic", "t_end": 0.52, "tolerance": 1e-6, "method": "radau5"},
        "goal": {"probe": "bead", "quantity": "x"}, "output": {"probes": {"bead": "bead@0.5"}}})
    with pytest.raises(ancf2d.ComputationError, match=r"sleeve: bead@0\.5 has slid off the end of rail"):
        list(transposed_steps.RecordedMotion(prepare(loaded), False, 1e-10, None).states())


def test_the_direction_is_chosen_by_goals_and_numbers(tmp_path):
    """One adjoint per goal, or one forward solution per number: the fewer."""
    loaded = scene(tmp_path, "radau5", CLAMP)
    goals = tuple(replace(loaded.case.goal, quantity=name) for name in ("x", "y", "theta"))
    for paths, back in ((SOME, True), (SOME[:2], False)):
        run = DifferentiableRun(loaded, GoalValues(goals), Progress())
        run.compute_together(numbers_at(loaded, paths))
        assert (run.adjoint is not None) == back
