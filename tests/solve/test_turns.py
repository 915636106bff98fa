"""Whole turns of sections: counted from step to step and stored with every state."""

from __future__ import annotations

import math

import h5py
import helpers as h
import numpy as np
import pytest
import yaml
from motions import rigid

from ancf2d.model.transfer import transferred
from ancf2d.results import open_results
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import Run
from ancf2d.solvers.registry import solve
from ancf2d.solvers.state_results import Observer, reactions
from ancf2d.solvers.statics.newton import Start
from ancf2d.solvers.statics.static import solve_static
from ancf2d.study.run import load, run_case

# a bar of 3 kg and 1 m about its end: J = 1 kg m^2
BAR = rigid((0, 0), (1, 0), 3.0, 0.25)
PIN = [{"name": "hinge", "type": "pin", "at": "b@0"}]
TIP = {"probes": {"tip": "b@1"}}


def spring(stiffness: float, damping: float = 0.0):
    """Return a torsion spring between the bar and the ground."""
    return [{"type": "rotational", "between": ["b@0", [0, 0]], "stiffness": stiffness, "damping": damping}]


def swing(t: float) -> tuple[float, float]:
    """Return theta and its rate for J = 1 on k = 5 from theta = 0 with 8 rad/s."""
    w = math.sqrt(5.0)
    return 8.0 / w * math.sin(w * t), 8.0 * math.cos(w * t)


SWING = {"bc": PIN, "springs": spring(5.0), "initial": {"rotation_rate": {"omega": 8.0}}}


def moving(t_end: float, interval: float, solver=None, **scene):
    """Return the model of a bar and the states of its motion."""
    given = {"type": "dynamic", "t_end": t_end, "estimate": False, **(solver or {"tolerance": 1e-8})}
    model = h.build({"b": BAR}, given, output={**TIP, "interval": interval}, **scene)
    return model, list(Run(model, model.case.solver).states())


def theta(model, state) -> float:
    return Observer(model).observe(state)["tip"]["theta"]


def case(path, **changes):
    """Write the case of the bar on its spring."""
    data = {"bodies": {"b": BAR}, "boundary_conditions": PIN, "springs": spring(5.0), "output": TIP,
            "solver": {"type": "dynamic", "t_end": 0.6, "tolerance": 1e-8, "estimate": False}, **changes}
    path.write_text(yaml.safe_dump(h._plain(data)))
    return load(path)


def run(path, out, **changes):
    """Return probes and energies at the end of a case."""
    outcome = run_case(case(path, **changes), str(out))
    assert outcome.failure is None
    return outcome.summary["probes"]["tip"], outcome.summary["energy"]


@pytest.mark.slow
def test_a_motion_continues_from_a_file_with_its_turns(tmp_path):
    first, _ = run(tmp_path / "first.yaml", tmp_path / "first.h5", initial={"rotation_rate": {"omega": 8.0}})
    assert first["theta"] == pytest.approx(swing(0.6)[0], rel=1e-6)
    assert first["theta"] > math.pi
    with open_results(tmp_path / "first.h5") as results:
        assert results.turned(-1)[0] == pytest.approx(first["theta"], rel=1e-12)
    then, energy = run(tmp_path / "then.yaml", tmp_path / "then.h5", initial={"from": "first.h5"})
    assert (then["theta"], then["omega"]) == pytest.approx(swing(1.2), rel=1e-6)
    assert energy["strain"] == pytest.approx(2.5 * then["theta"]**2, rel=1e-9)


def test_a_file_without_turns_counts_as_the_first_turn(tmp_path):
    first, _ = run(tmp_path / "first.yaml", tmp_path / "first.h5", initial={"rotation_rate": {"omega": 8.0}})
    with h5py.File(tmp_path / "first.h5", "r+") as file:
        del file["states/turned"]
    with open_results(tmp_path / "first.h5") as results:
        assert results.turned(-1) is None
    then, _ = run(tmp_path / "then.yaml", tmp_path / "then.h5", initial={"from": "first.h5"},
                  solver={"type": "dynamic", "t_end": 1e-9, "tolerance": 1e-8, "estimate": False})
    assert then["theta"] == pytest.approx(first["theta"] - 2 * math.pi, rel=1e-6)


def test_a_bar_turned_by_a_moment_stays_in_static_equilibrium():
    """k = 5 under 20 N m: 4 rad, more than half a turn."""
    model, states = moving(0.5, 0.1, bc=PIN, springs=spring(5.0), loads=[{"type": "moment", "at": "b@0", "value": 20}],
                           initial={"from": "static"})
    for state in states:
        assert theta(model, state) == pytest.approx(4.0, rel=1e-6)
        assert state.energy == pytest.approx(40.0, rel=1e-6)


def test_a_resumed_motion_has_the_energies_of_an_uninterrupted_one(monkeypatch):
    # every state ends a chunk, from which a run can go on
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)
    model, states = moving(1.2, 0.05, **SWING)
    kept = [s.checkpoint for s in states if s.checkpoint is not None and 0.5 < s.t < 0.9]
    assert kept
    *_, end = Run(model, model.case.solver).states(kept[0])
    assert end.history == states[-1].history
    assert end.history["strain"] == pytest.approx(2.5 * swing(1.2)[0]**2, rel=1e-6)
    np.testing.assert_array_equal(end.turned, states[-1].turned)


@pytest.mark.parametrize("interval", [0.25, 0.5, 1.0, 2.0])
def test_turns_do_not_depend_on_how_many_states_are_stored(interval):
    """J = 1 under 40 N m against 2 N m/rad and 0.5 N m s/rad, beside its closed solution: up to 36 rad and back."""
    scene = {"bc": PIN, "springs": spring(2.0, 0.5), "loads": [{"type": "moment", "at": "b@0", "value": 40.0}]}
    model, states = moving(4.0, interval, **scene)
    wd, a = math.sqrt(2.0 - 0.0625), 0.25
    for state in states:
        t = state.t
        expected = 20.0 - 20.0 * math.exp(-a * t) * (math.cos(wd * t) + a / wd * math.sin(wd * t))
        assert theta(model, state) == pytest.approx(expected, rel=1e-6, abs=1e-6)
        assert state.energy == pytest.approx(expected**2, rel=1e-5, abs=1e-5)
        # moment and spring are couples: the hinge alone moves the centre, 0.5 m away
        omega = Observer(model).observe(state)["tip"]["omega"]
        alpha = 40.0 - 0.5 * omega - 2.0 * expected
        c, s = math.cos(expected), math.sin(expected)
        pull = reactions(model, state)["hinge"]
        np.testing.assert_allclose([pull["fx"], pull["fy"]],
                                   1.5 * np.array([-alpha * s - omega**2 * c, alpha * c - omega**2 * s]),
                                   rtol=1e-3, atol=0.1)


def test_a_step_of_more_than_half_a_turn_is_cut_with_a_torsion_spring():
    """8 rad/s in steps of 0.5 s against a spring that hardly slows: stages would be on other turns than their step."""
    model, states = moving(4.0, 4.0, {"dt": 0.5, "method": "radau9"}, bc=PIN, springs=spring(1e-3),
                           initial={"rotation_rate": {"omega": 8.0}})
    w = math.sqrt(1e-3)
    assert theta(model, states[-1]) == pytest.approx(8.0 / w * math.sin(4.0 * w), rel=1e-3)
    assert states[-1].energy == pytest.approx(0.5e-3 * theta(model, states[-1])**2, rel=1e-9)


# ------------------------------------------------------------------ statics

SECTION = {"height": 0.005, "width": 0.05}
EI = h.STEEL["E"] * 0.05 * 0.005**3 / 12
KINDS = {"rigid": BAR, **{n: h.body(h.line(1.0), h.element(n, 4), SECTION, h.STEEL) for n in ("vallejo", "cable")}}


def at_end(body, solver, start=None, **scene):
    """Return the model of a bar and its last static state."""
    model = h.build({"b": body}, solver, output={"probes": {"root": "b@0", "tip": "b@1"}}, **scene)
    *_, state = solve(model) if start is None else solve_static(model, start=start)
    return model, state


# all at once in one step, which is the hardest, each kind of body
@pytest.mark.slow_rows("vallejo-10")
@pytest.mark.parametrize(("kind", "steps"), h.chosen([("cable", 3), ("vallejo", 10), *((k, 1) for k in KINDS)],
                                                     [("cable", 3), ("vallejo", 10)]))
def test_a_spring_is_wound_up_in_any_number_of_load_steps(kind, steps):
    """40 N m on 2 N m/rad: 20 rad."""
    model, state = at_end(KINDS[kind], {"type": "static", "steps": steps}, bc=PIN, springs=spring(2.0),
                          loads=[{"type": "moment", "at": "b@0", "value": 40}])
    assert theta(model, state) == pytest.approx(20.0, rel=1e-8)
    assert state.energy == pytest.approx(400.0, rel=1e-8)


@pytest.mark.parametrize("steps", [1, 2, 5])
@pytest.mark.parametrize("kind", ["vallejo", "cable"])
def test_a_prescribed_angle_determines_the_turn(kind, steps):
    model, state = at_end(KINDS[kind], {"type": "static", "steps": steps},
                          bc=[*PIN, {"type": "prescribed", "at": "b@0", "angle": 20.0}])
    assert theta(model, state) == pytest.approx(20.0, rel=1e-9)


@pytest.mark.parametrize(("clamped", "steps"), [(0, 2), (1, 2), (0, 10)])
@pytest.mark.parametrize("name", ["vallejo", "cable"])
def test_a_rolled_up_beam_counts_turns_from_its_clamp(name, clamped, steps):
    """Under 4 pi EI/L a cantilever turns twice, from its clamp at either end, however few the steps."""
    body = h.body(h.line(1.0), h.element(name, 16), SECTION, {**h.STEEL, "nu": 0.0})
    scene = {"bc": [{"type": "clamp", "at": f"b@{clamped}", "hold": "section"}],
             "loads": [{"type": "moment", "at": f"b@{1 - clamped}", "value": 4 * math.pi * EI}]}
    model, state = at_end(body, {"type": "static", "steps": steps}, **scene)
    probes = Observer(model).observe(state)
    turned, held = (probes[k]["theta"] for k in (("tip", "root"), ("root", "tip"))[clamped])
    assert turned == pytest.approx(4 * math.pi, rel=0.03)
    assert held == pytest.approx(0.0, abs=1e-9)
    # from a guess the last state comes at once
    finer = h.body(h.line(1.0), h.element(name, 32), SECTION, {**h.STEEL, "nu": 0.0})
    new = h.build({"b": finer}, {"type": "static"}, **scene)
    start = Start(transferred(state.d, model, new), int(state.history["negative_pivots"]), state.turned)
    model, state = at_end(finer, {"type": "static"}, start, **scene)
    found = Observer(model).observe(state)[("tip", "root")[clamped]]["theta"]
    assert found == pytest.approx(turned, rel=0.03)
