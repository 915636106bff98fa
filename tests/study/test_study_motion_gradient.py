"""Derivatives of motions: closed forms, and differences of motions whose steps are solved to round-off."""

import math
from typing import Any

import numpy as np
import pytest

import ancf2d
from ancf2d.case.numbers import number_at, numbers_at
from ancf2d.kernels.lowlevel.records import Record
from ancf2d.kernels.motion import many_states
from ancf2d.model.groups import unlike
from ancf2d.solvers.derivatives import linear_steps
from ancf2d.solvers.derivatives.varied_motions import VariedNumber
from ancf2d.solvers.motion import own_integrators
from ancf2d.solvers.motion.dynamic import Run
from ancf2d.study.expressions import GoalValues
from ancf2d.study.gradient import derivatives, gradient, prepare, varied

THROWN = {
    "bodies": {"stick": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                         "section": {"height": 0.05, "width": 0.02}, "material": {"E": 2e9, "nu": 0.3, "rho": 1000},
                         "element": {"type": "vallejo", "count": 2}}},
    "loads": [{"name": "weight", "type": "gravity", "value": [0, -9.81]}],
    "initial": {"velocity": [2.0, 1.0]},
    "output": {"probes": {"end": "stick@1"}, "interval": 0.03},
    "goal": {"probe": "end", "quantity": "uy"},
}

# what acts: springs with dampers, a joint, motion that is prescribed, loads that turn, vary and have corners
SCENE = """
bodies:
  arm:
    geometry: {type: line, start: [0, 0], end: [0.6, 0.1]}
    section: {height: "0.03*(1 - 0.3*s)", width: 0.02}
    material: {E: 2e9, nu: 0.3, rho: 1200, damping: {kelvin_voigt: 1e-4}}
    element: {type: vallejo, count: 2}
  fork:
    geometry: {type: line, start: [0.6, 0.1], end: [1, -0.2]}
    section: {EA: 1e6, kGA: 4e5, EI: 60, rhoA: 0.8, rhoI: 1e-3}
    element: {type: reissner3, count: 2}
boundary_conditions:
  - {name: base, type: prescribed, at: arm@0, ux: 0, angle: 0,
     uy: {type: sine, frequency: 3, scale: 0.01}}
joints:
  - {name: knee, type: pin, between: [arm@1, fork@0]}
springs:
  - {name: stay, type: translational, between: [fork@1, [1.1, 0.6]], stiffness: 300, length: 0.5, damping: 4}
  - {name: coil, type: rotational, between: [arm@1, fork@0], stiffness: 20, angle: 0.2, damping: 0.3}
masses:
  - {name: lump, at: fork@1, mass: 0.2, inertia: 1e-3}
loads:
  - {name: weight, type: gravity, value: [0, -9.81]}
  - {name: push, type: follower_force, at: fork@1, value: [1, 6], amplitude: {type: ramp, t1: 0.0047}}
  - {name: pull, type: force, at: arm@1, value: [3, 5], amplitude: {type: sine, frequency: 40}}
initial: {bodies: {fork: {rotation_rate: {omega: 3, about: [0.6, 0.1]}}}}
damping: {rayleigh: {alpha: 0.8, beta: 0}}
solver: {type: dynamic, t_end: 0.01, dt: 0.0005, max_iterations: 40}
goal: {probe: tip, quantity: uy}
output:
  probes: {tip: fork@1, knee: arm@1}
  interval: 0.0021
"""

# pairwise: every kind of number with one integrator, every integrator with many kinds
NUMBERS = {
    "generalized_alpha": ("bodies.arm.material.E", "springs.stay.damping", "loads.push.value.1",
                          "bodies.fork.geometry.end.0"),
    "hht": ("bodies.fork.section.EI", "bodies.fork.section.rhoA", "masses.lump.mass", "springs.stay.between.1.0",
            "springs.coil.angle", "initial.bodies.fork.rotation_rate.omega"),
    "newmark": ("springs.stay.stiffness", "loads.pull.amplitude.frequency", "damping.rayleigh.alpha"),
    "radau5": ("bodies.arm.material.rho", "springs.coil.damping", "boundary_conditions.base.uy.scale",
               "bodies.arm.material.damping.kelvin_voigt"),
    "radau9": ("bodies.arm.section.width", "springs.stay.length", "loads.weight.value.1"),
}

# multipliers are not for Newmark's method
MORE = {"newmark": ["boundary_conditions.base={name: base, type: pin, at: arm@0}"]}


def solved(loaded, path, h):
    """Return the goal with a number changed by the share h."""
    variable = number_at(loaded, path)
    return ancf2d.solve(loaded, [variable.override(variable.value * (1 + h))], states=False).value


@pytest.mark.parametrize("method", [m if m == "generalized_alpha" else
                                    pytest.param(m, marks=pytest.mark.slow) for m in NUMBERS])
def test_steps_are_differentiated(method, monkeypatch, tmp_path):
    """Derivatives are those of the discrete motion: central differences of runs, by every integrator."""
    monkeypatch.setattr(own_integrators, "TIGHT", 1e-13)
    (tmp_path / "scene.yaml").write_text(SCENE)
    # beyond the corner of a load
    changes = [f"solver.method={method}", "solver.t_end=0.006", *MORE.get(method, [])]
    loaded = ancf2d.load(tmp_path / "scene.yaml", changes)
    h, read = 3e-5, GoalValues((loaded.case.goal,))
    # of any function of states it is not known what these do to it
    told = derivatives(loaded, lambda model, states: read(model, states), numbers_at(loaded, NUMBERS[method]))
    assert set(told.methods) == {"exact"}
    for variable, value, error in zip(told.variables, told.jacobian[0], told.errors[0], strict=True):
        expected = (solved(loaded, variable.path, h) - solved(loaded, variable.path, -h)) / (2 * h * variable.value)
        assert value == pytest.approx(expected, rel=1e-6, abs=1e-9 / abs(variable.value)), variable.path
        assert error <= 1e-6 * abs(value)


@pytest.mark.slow_rows("driven")
@pytest.mark.parametrize("shaft", [{"type": "pin"}, {"type": "prescribed", "ux": 0, "uy": 0, "angle": {
    "type": "expression", "value": "1 - cos(6*t)"}}], ids=["free", "driven"])
def test_reactions_of_a_mechanism(shaft, monkeypatch):
    """Forces depend on the tangent of a follower load at once, on positions after some time, on driven ones never."""
    monkeypatch.setattr(own_integrators, "TIGHT", 1e-13)
    bars = {name: {"geometry": {"type": "line", "start": start, "end": end},
                   "element": {"type": "rigid", "mass": 0.5, "inertia": 0.004}}
            for name, start, end in (("crank", [0, 0], [0.2, 0.1]), ("rod", [0.2, 0.1], [0.9, 0]))}
    loaded = ancf2d.load({
        "bodies": bars, "boundary_conditions": [{"name": "shaft", "at": "crank@0", **shaft}],
        "joints": [{"type": "pin", "between": ["crank@1", "rod@0"]},
                   {"type": "slider", "at": "rod@1", "through": [0.9, 0], "along": [1, 0]}],
        "loads": [{"name": "push", "type": "follower_force", "at": "rod@0.5", "value": [4, 3]}],
        "solver": {"type": "dynamic", "t_end": 0.3, "dt": 0.01},
        "goal": {"reaction": "shaft", "quantity": "m" if "angle" in shaft else "fx"}})
    numbers, h = ("loads.push.value.1", "bodies.rod.element.mass"), 1e-3
    told = {row.path: row for row in ancf2d.sensitivity(loaded, numbers).rows}
    for path in numbers:
        value = number_at(loaded, path).value
        near, far = (solved(loaded, path, k * h) - solved(loaded, path, -k * h) for k in (1, 2))
        assert told[path].method == "exact"
        assert told[path].derivative == pytest.approx((8 * near - far) / (12 * h * value), rel=1e-6)


@pytest.mark.slow_rows("solver1")
@pytest.mark.parametrize("solver", [pytest.param({"dt": 0.02}, marks=pytest.mark.slow), {"tolerance": 1e-6},
                                    {"dt": 0.02, "method": "generalized_alpha"}])
def test_a_thrown_body_is_known_in_closed_form(solver):
    """u_y = v t + g t^2/2, for any steps: at the end and, also within steps, at all stored times."""
    case = ancf2d.load({**THROWN, "solver": {"type": "dynamic", "t_end": 0.1, **solver}})
    times = []

    def places(model, states):
        times[:] = [state.t for state in states]
        return np.array([state.d[1] for state in states])

    _, J = gradient(case, places, ["initial.velocity.1", "loads.weight.value.1", "bodies.stick.material.E"])
    t = np.array(times)
    assert len(t) > 3
    assert J[:, 0] == pytest.approx(t, abs=1e-9)
    assert J[:, 1] == pytest.approx(t**2 / 2, abs=1e-9)
    assert J[:, 2] == pytest.approx(0.0, abs=1e-18)


# which elements of arm and fork a number changes the forces of, and how many groups are left in residuals
ACTS = {"springs.stay.stiffness": ([], [], 0), "bodies.arm.section.height.value.0": ([0], [], 1),
        # what is prescribed moves elements that are the same
        "boundary_conditions.base.uy.scale": ([], [], 2)}


def test_residual_differences_are_those_of_the_affected_elements(tmp_path):
    """Differences of residuals equal those of all elements, and contain only elements whose forces change."""
    (tmp_path / "scene.yaml").write_text(SCENE)
    loaded = ancf2d.load(tmp_path / "scene.yaml",
                         ["bodies.arm.section.height={s: [0, 0.5, 1], value: [0.03, 0.025, 0.02]}"])
    model = prepare(loaded)
    run = Run(model, model.case.solver)
    base = run.stepper
    rng, shape = np.random.default_rng(3), (2, len(base.s.z))
    z, v, a = 1e-3 * rng.standard_normal((3, *shape))
    memories = [np.repeat(x[None], 2, axis=0) for x in (base.p.points.mem, base.p.sliding.memory)]
    at = Record(many_states.States(np.array([0.001, 0.002]), z, v, a, *memories))
    for path, (arm, fork, groups) in ACTS.items():
        variable = number_at(loaded, path)
        h = 4e-4 * abs(variable.value)
        one = VariedNumber(lambda h, of=variable: prepare(varied(loaded, of, h)), h, run)
        found = [unlike(alike).tolist() for alike in zip(*(own.model.groups for own in one.runs), strict=True)]
        assert found == [arm, fork], path
        left = zip(one.differing.problems, one.differing.elements, strict=True)
        assert [len(p.groups) + len(elements) for p, elements in left] == [groups] * 4, path
        some = one.differing.residuals(at, base.p)
        whole, R = np.zeros((2, *shape)), np.zeros(shape)
        for own, weights in zip(one.runs, one.weights.T, strict=True):
            many_states.residuals(own.stepper.p, own.stepper.w, at, R)
            whole += weights[:, None, None] * R
        assert np.abs(whole[0]).max() > 0.0, path
        # round-off of the forces of all elements, divided by h
        assert some == pytest.approx(whole, rel=0.0, abs=1e-8 * np.abs(whole).max() + 1e-11 / h), path


@pytest.mark.slow
def test_numbers_without_exact_derivatives_are_reported(tmp_path):
    """Corners of signals that move with a number, and SciPy's integrators, take differences of runs."""
    (tmp_path / "scene.yaml").write_text(SCENE)
    loaded = ancf2d.load(tmp_path / "scene.yaml", ["solver.t_end=0.006", "solver.method=radau5"])
    row, = ancf2d.sensitivity(loaded, ["loads.push.amplitude.t1"]).rows
    assert row.method == "differences of runs: the times of corners of signals depend on the number"
    case = {**THROWN, "solver": {"type": "dynamic", "t_end": 0.1, "dt": 0.02}}
    row, = ancf2d.sensitivity(ancf2d.load(case), ["solver.t_end"]).rows
    assert row.method == "differences of runs: the times of steps and of stored states change with the number"
    assert row.derivative == pytest.approx(1.0 - 9.81 * 0.1, rel=1e-6)
    case = {**THROWN, "solver": {"type": "dynamic", "t_end": 0.01, "dt": 0.005, "method": "energy_momentum"}}
    row, = ancf2d.sensitivity(ancf2d.load(case), ["initial.velocity.1"]).rows
    assert row.method == "differences of runs: the steps of energy_momentum are not differentiated"
    assert row.derivative == pytest.approx(0.01, rel=1e-6)


MASS, SWING = 2.0, 20.0


def behind_a_stop(number: str, **stop: Any) -> Any:
    """Return how the position of a mass depends on a number, 0.3 s after a stop at 0.1 m hit with 1 m/s."""
    case = {"format": 1, "bodies": {"b": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                          "element": {"type": "rigid", "mass": MASS, "inertia": 0.1}}},
            "boundary_conditions": [{"type": "roller", "at": f"b@{s}", "fixed": "y"} for s in (0, 1)],
            "initial": {"velocity": [1.0, 0]}, "output": {"probes": {"p": "b@0"}},
            "goal": {"probe": "p", "quantity": "ux"}, **stop,
            "solver": {"type": "dynamic", "t_end": 0.3, "tolerance": 1e-10, "method": "radau9", "estimate": False}}
    row, = ancf2d.sensitivity(ancf2d.load(case), [number]).rows
    assert row.method == "differences of runs: the times at which one-sided springs and tendons act depend on the case"
    return row


def test_the_position_after_a_damped_stop_is_differentiated_by_runs():
    """The force jumps when the stop engages, at a time that depends on the case: steps do not see that.

    It flies back as fast as a damped half swing leaves it: dx/dg = 1 + exp(-pi D/sqrt(1 - D^2)), in the stop until the
    elongation is 0 again.
    """
    share = 0.1
    row = behind_a_stop("springs.stop.gap", springs=[
        {"name": "stop", "type": "translational", "between": [[-1, 0], "b@0"], "stiffness": MASS * SWING**2,
         "damping": 2 * share * MASS * SWING, "gap": 0.1}])
    assert row.derivative == pytest.approx(1 + math.exp(-math.pi * share / math.sqrt(1 - share**2)), rel=1e-4)


def test_the_position_after_a_taut_tendon_is_differentiated_by_runs():
    """After half an oscillation, x = 2 g - v (t - pi/omega)."""
    row = behind_a_stop("initial.velocity.0", loads=[
        {"type": "tendon", "through": ["b@0", [-1, 0]], "stiffness": 1.1 * MASS * SWING**2, "slack": 0.1}])
    assert row.derivative == pytest.approx(math.pi / SWING - 0.3, rel=1e-4)


def test_steps_of_wide_models_have_sparse_matrices(monkeypatch, tmp_path):
    """Factors as a band, and those of SciPy's sparse matrices, give the same derivatives."""
    (tmp_path / "scene.yaml").write_text(SCENE)
    loaded = ancf2d.load(tmp_path / "scene.yaml", ["solver.method=radau5", "solver.t_end=0.002"])
    paths, read = ["springs.stay.damping", "damping.rayleigh.alpha"], GoalValues((loaded.case.goal,))
    _, narrow = gradient(loaded, lambda model, states: read(model, states), paths)
    monkeypatch.setattr(linear_steps, "BAND", 0)
    _, wide = gradient(loaded, lambda model, states: read(model, states), paths)
    assert wide == pytest.approx(narrow, rel=1e-8)
    assert np.abs(wide).min() > 0.0


def test_natural_strains_with_different_amplitudes():
    """Two that follow f and 1 - f are one constant strain: so are their derivatives."""
    def slopes(**amplitudes):
        loads = [{"name": name, "type": "eigenstrain", "on": "stick", "curvature": 0.3, "amplitude": how}
                 for name, how in amplitudes.items()]
        case = ancf2d.load(THROWN | {"loads": loads, "solver": {"type": "dynamic", "t_end": 0.02, "dt": 0.001}})
        return gradient(case, [case.case.goal], [f"loads.{name}.curvature" for name in amplitudes])

    value, one = slopes(a={"type": "constant"})
    same, two = slopes(a={"type": "expression", "value": "t/0.02"}, b={"type": "expression", "value": "1 - t/0.02"})
    assert same == pytest.approx(value, rel=1e-9)
    assert two.sum() == pytest.approx(one[0, 0], rel=1e-7)
    assert abs(two[0, 1]) > 0.01 * abs(one[0, 0])


@pytest.mark.slow
def test_a_spring_that_begins():
    """A mass moves at v until t1, and then on a spring: x = v t1 cos(w s) + v/w sin(w s), s = t - t1, w = sqrt(k/m)."""
    m, k, v, t1, t = 2.0, 50.0, 0.3, 0.4, 1.0
    case = {"bodies": {"mass": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                "section": {"height": 0.1, "width": 0.1},
                                "element": {"type": "rigid", "mass": m, "inertia": 1.0}}},
            "springs": [{"type": "translational", "between": ["mass@0", [-1, 0]], "stiffness": k, "length": 1.0,
                         "active": {"from": t1}}],
            "boundary_conditions": [{"type": "roller", "at": "mass@0", "fixed": "y"},
                                    {"type": "roller", "at": "mass@1", "fixed": "y"}],
            "initial": {"velocity": [v, 0]},
            "solver": {"type": "dynamic", "t_end": t, "tolerance": 1e-9, "method": "radau5"},
            "goal": {"probe": "mass", "quantity": "ux"}, "output": {"probes": {"mass": "mass@0"}}}
    study, w, s = ancf2d.sensitivity(case, ["springs.0.stiffness", "springs.0.active.from"]), np.sqrt(k / m), t - t1
    found = {row.path.rpartition(".")[2]: row for row in study.rows}
    assert study.goal == pytest.approx(v * t1 * np.cos(w * s) + v / w * np.sin(w * s), rel=1e-6)
    slope = -v * t1 * s * np.sin(w * s) + v * (s * np.cos(w * s) / w - np.sin(w * s) / w**2)
    assert found["stiffness"].method == "exact"
    assert found["stiffness"].derivative == pytest.approx(slope / (2 * w * m), rel=1e-6)
    # the number that moves its time is left to runs, no other one
    assert found["from"].method == "differences of runs: the times of corners of signals depend on the number"
    assert found["from"].derivative == pytest.approx(v * t1 * w * np.sin(w * s), rel=1e-6)


@pytest.mark.slow_rows("mid.M--150.0")
@pytest.mark.parametrize(("name", "force"), [("tip.uy", -150.0), ("mid.M", -150.0)])
def test_steps_are_shortened_where_a_run_shortens_them(name, force):
    """Newton's method does not converge to a tighter tolerance in such steps, in either direction."""
    probe, quantity = name.split(".")
    loaded = ancf2d.load({
        "bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [2, 0]},
                            "section": {"EA": 1e6, "kGA": 4e5, "EI": 500, "rhoA": 2, "rhoI": 1e-3},
                            "element": {"type": "reissner3", "count": 3}}},
        "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
        "loads": [{"name": "tip", "type": "force", "at": "beam@1", "value": [0, force]}],
        "solver": {"type": "dynamic", "method": "generalized_alpha", "t_end": 0.2, "dt": 0.02, "estimate": False},
        "goal": {"probe": probe, "quantity": quantity}, "output": {"probes": {"tip": "beam@1", "mid": "beam@0.5"}}})
    path, h = "loads.tip.value.1", 1e-4 * force
    low, run, high = (ancf2d.solve(loaded, [f"{path}={force + by!r}"], states=False) for by in (-h, 0.0, h))
    assert run.summary["rejected"] > 0
    study = ancf2d.sensitivity(loaded, [path])
    assert study.rows[0].method == "exact"
    assert study.goal == pytest.approx(run.value, rel=1e-8)
    assert study.rows[0].derivative == pytest.approx((high.value - low.value) / (2 * h), rel=1e-6)


BRIDGE = {"bodies": {"deck": {"geometry": {"type": "line", "start": [0, 0], "end": [4, 0]},
                              "section": {"height": 0.1, "width": 0.05}, "material": {"E": 1e9, "nu": 0.3, "rho": 1e3},
                              "element": {"type": "reissner3", "count": 4}}},
          "boundary_conditions": [{"type": "pin", "at": "deck@0"}, {"type": "roller", "at": "deck@1", "fixed": "y"}],
          "solver": {"type": "dynamic", "t_end": 0.8, "dt": 0.01, "method": "radau5"},
          "goal": {"probe": "middle", "quantity": "uy"}, "output": {"probes": {"middle": "deck@0.5"}}}


def test_a_force_that_crosses_a_bridge():
    """Small deflections are proportional to the force, in whatever elements it has been."""
    push = {"type": "force", "at": {"on": "deck", "s": {"type": "expression", "value": "1.1*t"}},
            "value": [0, -0.01]}
    study = ancf2d.sensitivity({**BRIDGE, "loads": [push]}, ["loads.0.value.1"])
    assert study.rows[0].method == "exact"
    assert study.rows[0].derivative == pytest.approx(study.goal / -0.01, rel=1e-4)


@pytest.mark.slow
def test_a_support_that_catches_a_motion_is_differentiated_by_runs():
    """It fixes its point at the reached position, which the steps do not contain."""
    catch = {"type": "pin", "at": "deck@0.25", "active": {"from": 0.3}}
    case = {**BRIDGE, "boundary_conditions": [*BRIDGE["boundary_conditions"], catch],
            "loads": [{"type": "gravity", "value": [0, -9.81]}]}
    row, = ancf2d.sensitivity(case, ["bodies.deck.material.E"]).rows
    assert row.method == "differences of runs: a support or joint begins at the current position of the motion"
    high, low = (ancf2d.solve(case, [f"bodies.deck.material.E={E!r}"]).value for E in (1.001e9, 0.999e9))
    assert row.derivative == pytest.approx((high - low) / 2e6, rel=1e-3)


def test_a_fixed_body_has_derivatives_of_its_reaction():
    """Nothing moves: fy = m g, for any integrator."""
    study = ancf2d.sensitivity({
        "bodies": {"block": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                             "element": {"type": "rigid", "mass": 3.0, "inertia": 0.1}}},
        "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "block@0"}],
        "loads": [{"name": "weight", "type": "gravity", "value": [0, -9.81]}],
        "solver": {"type": "dynamic", "t_end": 0.1, "dt": 0.01, "method": "generalized_alpha"},
        "goal": {"reaction": "wall", "quantity": "fy"}}, ["bodies.block.element.mass", "loads.weight.value.1"])
    found = {row.path: row.derivative for row in study.rows}
    assert found == pytest.approx({"bodies.block.element.mass": 9.81, "loads.weight.value.1": -3.0}, rel=1e-7)
