"""Derivatives of goals of motions by the adjoint, compared with differences of motions solved to round-off."""

from dataclasses import replace

import numpy as np
import pytest
from test_study_motion_gradient import SCENE, solved

import ancf2d
from ancf2d.case.numbers import numbers_at
from ancf2d.solvers.derivatives import motion, motion_states
from ancf2d.solvers.motion import own_integrators
from ancf2d.solvers.state import State
from ancf2d.solvers.state_results import Observer
from ancf2d.study.expressions import GoalValues, Measures, Vocabulary, read_measure
from ancf2d.study.gradient import DifferentiableRun, derivatives, prepare
from ancf2d.study.record import Progress

# held without multipliers, and by others where the case has them
CLAMP, PIN = ("boundary_conditions.base={name: base, type: clamp, at: arm@0}",
              "boundary_conditions.base={name: base, type: pin, at: arm@0}")
# what acts on bodies, springs, masses and loads, what damps, how it begins
NUMBERS = ["bodies.arm.material.E", "bodies.arm.material.damping.kelvin_voigt", "bodies.arm.section.width",
           "bodies.fork.geometry.end.0", "bodies.fork.section.rhoA", "springs.stay.stiffness",
           "springs.stay.between.1.0", "springs.coil.damping", "masses.lump.mass", "loads.push.value.1",
           "loads.pull.amplitude.frequency", "damping.rayleigh.alpha", "initial.bodies.fork.rotation_rate.omega"]
SOME = ["bodies.arm.material.rho", "springs.coil.angle", "loads.weight.value.1"]
# integrator and how the arm is held: with multipliers where the scene has them, which Newmark's method refuses
MOTIONS = {"generalized_alpha": ("generalized_alpha", CLAMP, NUMBERS), "radau5": ("radau5", CLAMP, NUMBERS),
           "multipliers": ("radau5", None, [*SOME, "boundary_conditions.base.uy.scale"]), "hht": ("hht", CLAMP, SOME),
           "newmark": ("newmark", PIN, SOME), "radau9": ("radau9", None, SOME)}


# beyond the corner of a load
SHORT = "solver.t_end=0.006"


def scene(folder, method, held, *more):
    """Return the scene of motions, with an integrator and a support of its arm."""
    (folder / "scene.yaml").write_text(SCENE)
    return ancf2d.load(folder / "scene.yaml", [f"solver.method={method}", *([held] if held else []), *more])


def found(loaded, paths):
    """Return the derivatives (numbers,) by the adjoint."""
    run = DifferentiableRun(loaded, GoalValues((loaded.case.goal,)), Progress())
    variables = numbers_at(loaded, paths)
    run.compute_together(variables)
    assert run.adjoint is not None
    rows = [run.differentiate(variable) for variable in variables]
    assert {how for _, how in rows} == {"exact"}
    return np.array([quotient.value[0] for quotient, _ in rows]), np.array([quotient.error[0] for quotient, _ in rows])


@pytest.mark.parametrize("name", ["newmark", *(pytest.param(name, marks=pytest.mark.slow) for name in MOTIONS
                                               if name != "newmark")])
def test_both_directions_are_those_of_the_same_steps(name, monkeypatch, tmp_path):
    """Both directions have the same matrices, transposed: psi . (J^-1 dR) = (J^-T psi) . dR.

    Forwards, derivatives are those of the discrete motion: test_study_motion_gradient.py.
    """
    # corrections of the motion forwards go on to round-off, too
    monkeypatch.setattr(motion_states, "ENOUGH", 1e-13)
    monkeypatch.setattr(motion, "CLOSE", 1e-12)
    method, held, paths = MOTIONS[name]
    loaded = scene(tmp_path, method, held, SHORT)
    read = GoalValues((loaded.case.goal,))
    told = derivatives(loaded, lambda model, states: read(model, states), numbers_at(loaded, paths))
    assert set(told.methods) == {"exact"}
    values, errors = found(loaded, paths)
    assert (errors <= 1e-6 * np.abs(values)).all()
    # what changes of the goal by a relative change of the number are, where it hardly depends on it
    sizes = np.abs([variable.value for variable in told.variables])
    apart = np.abs(values - told.jacobian[0])
    assert (apart <= 1e-9 * np.abs(values) + 1e-11 * abs(told.values[0]) / sizes).all(), apart / np.abs(values)


@pytest.mark.slow
def test_rates_that_supports_do_not_allow():
    """A clamped bar with an initial rotation about its middle: its projection depends on the mass distribution.

    Forwards, both rates at the start are projected anew; backwards v' = M^-1 T^T M' (V - T v) of M v = T^T M V.
    """
    case = ancf2d.load({
        "bodies": {"bar": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                           "section": {"height": {"s": [0, 1], "value": [0.03, 0.01]}, "width": 0.02},
                           "material": {"E": 1e9, "nu": 0.3, "rho": 1000}, "element": {"type": "cable", "count": 2}}},
        "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "bar@0"}],
        "masses": [{"name": "lump", "at": "bar@1", "mass": 0.1}],
        "initial": {"rotation_rate": {"omega": 2.0, "about": [0.5, 0]}},
        "solver": {"type": "dynamic", "method": "generalized_alpha", "t_end": 0.02, "dt": 2e-3, "estimate": False},
        "goal": {"probe": "tip", "quantity": "vy"}, "output": {"probes": {"tip": "bar@1"}}})
    of_bar = ("section.height.value.1", "material.rho", "material.E")
    paths = ["masses.lump.mass", *(f"bodies.bar.{name}" for name in of_bar)]
    read = GoalValues((case.case.goal,))
    told = derivatives(case, lambda model, states: read(model, states), numbers_at(case, paths))
    assert set(told.methods) == {"exact"}
    values, _ = found(case, paths)
    assert values == pytest.approx(told.jacobian[0], rel=1e-7)


def swept(goal=None, **more):
    """A damped arm on a moving wall."""
    return {"bodies": {"arm": {"geometry": {"type": "line", "start": [0, 0], "end": [0.8, 0.3]},
                               "section": {"height": 0.02, "width": 0.03},
                               "material": {"E": 1e8, "nu": 0.3, "rho": 1100, "damping": {"kelvin_voigt": 1e-3}},
                               "element": {"type": "cable", "count": 3}}},
            "boundary_conditions": [{"type": "clamp", "at": "arm@0"}],
            "solver": {"type": "dynamic", "method": "hht", "t_end": 0.2, "dt": 4e-3, "estimate": False},
            "goal": goal or {"probe": "tip", "quantity": "uy"},
            "output": {"probes": {"tip": "arm@1", "middle": "arm@0.8"}}, **more}


def assert_runs(case, steps):
    """Assert that the adjoint agrees with differences of runs, by numbers and their increments."""
    case = ancf2d.load(case)
    values, _ = found(case, list(steps))
    for variable, value in zip(numbers_at(case, list(steps)), values, strict=True):
        h = steps[variable.path]
        at = [ancf2d.solve(case, [variable.override(variable.value + k * h)], states=False).value
              for k in (1, -1, 2, -2)]
        assert value == pytest.approx((8 * (at[0] - at[1]) - (at[2] - at[3])) / (12 * h), rel=1e-6), variable.path


@pytest.mark.slow
def test_natural_strains_whose_rates_cause_viscous_forces(monkeypatch):
    """Kelvin-Voigt stress depends on strain rates minus those of natural strains: their load does not depend on lam."""
    monkeypatch.setattr(own_integrators, "TIGHT", 1e-13)
    bend = {"name": "bend", "type": "eigenstrain", "on": "arm", "curvature": 0.3,
            "amplitude": {"type": "sine", "frequency": 2}}
    stay = {"name": "stay", "type": "translational", "between": ["arm@0.7", [0.5, -0.4]], "stiffness": 300,
            "damping": 2}
    assert_runs(swept(loads=[bend], springs=[stay]),
                {"springs.stay.damping": 2e-3, "loads.bend.curvature": 1e-3, "bodies.arm.material.E": 1e5})


@pytest.mark.slow
@pytest.mark.parametrize("goal", [{}, {"mean_over": [0.03, 0.2]}])
def test_prescribed_motion_is_read_after_a_corner_of_a_signal(goal, monkeypatch):
    """The probe moves with the support at the end of its element, also if signals had a corner before."""
    monkeypatch.setattr(own_integrators, "TIGHT", 1e-13)
    push = {"name": "push", "type": "force", "at": "arm@0.4", "value": [0, -3],
            "amplitude": {"type": "table", "t": [0, 0.06, 0.2], "value": [0, 1, 0.3]}}
    case = swept({"probe": "middle", "quantity": "uy", **goal}, loads=[push])
    case["boundary_conditions"].append({"name": "drive", "type": "prescribed", "at": "arm@1",
                                        "uy": {"type": "sine", "scale": 0.02, "frequency": 4}})
    assert_runs(case, {"boundary_conditions.drive.uy.scale": 1e-4, "loads.push.value.1": 1e-2})


def test_positions_of_probes_change_their_values(tmp_path):
    """u_y of a probe off the axis is that of the axis plus y (cos(theta) - cos(theta_0)); along the body it varies."""
    y = 0.004
    loaded = scene(tmp_path, "radau5", CLAMP, "solver.t_end=0.004", f"output.probes.tip={{at: arm@0.7, y: {y}}}")
    values, _ = found(loaded, ["output.probes.tip.y", "output.probes.tip.at"])
    above, ahead, *behind = (ancf2d.solve(loaded, [f"output.probes.tip={{at: arm@{s}, y: {h}}}"], states=False).value
                             for s, h in ((0.7, y + 1e-4), (0.701, y), (0.699, y), (0.7, y - 1e-4)))
    assert values == pytest.approx([(above - behind[1]) / 2e-4, (ahead - behind[0]) / 2e-3], rel=1e-4)


@pytest.mark.slow_rows("radau5-mean_over: [0.002, 0.009]")
@pytest.mark.parametrize(("method", "goal"), [
    ("radau5", "mean_over: [0.002, 0.009]"), ("generalized_alpha", "mean_over: [0.002, 0.009]"),
    pytest.param("radau5", "peak_over: [0.0033, 0.0071]", marks=pytest.mark.slow)])
def test_goals_over_windows(method, goal, monkeypatch, tmp_path):
    """Stored states at ends of steps and within them, and samples between them, are differentiated as read."""
    monkeypatch.setattr(own_integrators, "TIGHT", 1e-13)
    loaded = scene(tmp_path, method, CLAMP, "goal={probe: knee, quantity: ux, " + goal + "}")
    paths, h = ["loads.pull.value.0", "bodies.arm.material.rho"], 3e-5
    for variable, value in zip(numbers_at(loaded, paths), found(loaded, paths)[0], strict=True):
        expected = (solved(loaded, variable.path, h) - solved(loaded, variable.path, -h)) / (2 * h * variable.value)
        assert value == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
def test_expressions_over_a_motion(tmp_path):
    """The chain rule over products, powers, extremes, goals over windows, masses and parameters, both ways."""
    loaded = scene(tmp_path, "newmark", PIN, "solver.t_end=0.003", "output.interval=0.0005", "parameters={far: 0.3}",
                   "goal={probe: knee, quantity: ux, mean_over: [0.0008, 0.0024]}")
    texts = ["tip.x*tip.vy^2 + 3*goal", "mass*sqrt(1 + max(tip.uy - 2*knee.uy)) - min(tip.omega)", "far^2*knee.theta",
             "max(far - tip.x)/mass", "mass"]
    words, paths = Vocabulary(loaded), ["bodies.arm.material.rho", "parameters.far", "springs.stay.stiffness",
                                        "bodies.fork.geometry.end.0", "masses.lump.mass"]
    read = Measures([read_measure(text, "--minimise", words, ["far"]) for text in texts], loaded.case.goal)
    assert read.from_probes
    assert read.count == 4
    variables = numbers_at(loaded, paths)
    forth = derivatives(loaded, lambda model, states: read(model, states), variables)
    assert set(forth.methods) == {"exact"}
    back = DifferentiableRun(loaded, read, Progress())
    back.compute_together(variables)
    assert back.adjoint is not None
    for variable, column in zip(variables, forth.jacobian.T, strict=True):
        assert back.differentiate(variable)[0].value == pytest.approx(column, rel=1e-6, abs=1e-9), variable.path


@pytest.mark.slow
def test_rows_of_extremes_over_a_motion(tmp_path):
    """Largest values of parts of the motion, no more than there are numbers, both ways."""
    loaded = scene(tmp_path, "newmark", PIN, "solver.t_end=0.003", "output.interval=0.0003")
    texts = ["max(tip.uy - 2*knee.uy)", "tip.x - 3*min(tip.omega)", "max(knee.x)"]
    paths = ["bodies.arm.material.rho", "springs.stay.stiffness", "bodies.fork.geometry.end.0", "masses.lump.mass",
             "loads.pull.value.0", "loads.push.value.1", "bodies.arm.material.E", "bodies.arm.section.width"]
    variables = numbers_at(loaded, paths)
    read = Measures([read_measure(text, "--minimise", Vocabulary(loaded)) for text in texts], None,
                    [True, True, False], len(variables))
    back = DifferentiableRun(loaded, read, Progress(), numbers=len(variables))
    assert [(part.number, part.groups) for part in read.parts] == [(0, 2), (1, 2)]
    assert read.count == 7
    assert back.values[read.rows(0)].max() == back.values[0]
    back.compute_together(variables)
    assert back.adjoint is not None
    forth = derivatives(loaded, lambda model, states: read(model, states), variables)
    assert set(forth.methods) == {"exact"}
    for variable, column in zip(variables, forth.jacobian.T, strict=True):
        assert back.differentiate(variable)[0].value == pytest.approx(column, rel=1e-6, abs=1e-9), variable.path


@pytest.mark.slow
def test_a_number_that_changes_a_phase_by_many_turns(tmp_path):
    """u = F (1 - cos(w t))/(m w^2) - ... of a free mass under F sin(w t), after 400 turns of the signal: steps shorten.

    m u'' = F sin(w t) gives u = F/(m w) (t - sin(w t)/w), and du/dw by hand.
    """
    w, t, F, m = 2 * np.pi * 400.0, 1.0, 3.0, 2.0
    case = {"bodies": {"mass": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                "section": {"height": 0.1, "width": 0.1},
                                "element": {"type": "rigid", "mass": m, "inertia": 1.0}}},
            "loads": [{"name": "push", "type": "force", "at": "mass@0.5", "value": [F, 0],
                       "amplitude": {"type": "sine", "frequency": w / (2 * np.pi)}}],
            "solver": {"type": "dynamic", "t_end": t, "dt": 2.5e-4, "method": "radau5"},
            "goal": {"probe": "mass", "quantity": "ux"}, "output": {"probes": {"mass": "mass@0.5"}, "interval": 1.0}}
    row, = ancf2d.sensitivity(case, ["loads.push.amplitude.frequency"]).rows
    exact = F / m * (-(t - np.sin(w * t) / w) / w**2 + (-t * np.cos(w * t) / w + np.sin(w * t) / w**2) / w)
    assert row.method == "exact"
    assert row.derivative == pytest.approx(2 * np.pi * exact, rel=1e-5)


def test_values_of_probes_are_differentiated(tmp_path):
    """Differences of values, along coordinates and their rates, on the axis and off it."""
    loaded = scene(tmp_path, "radau5", CLAMP, "output.probes={tip: fork@1, off: {at: fork@0.7, y: 0.01}, "
                   "knee: {at: arm@0.6, y: 0.004}}", "goal.probe=tip")
    model, rng = prepare(loaded), np.random.default_rng(5)
    d, v, none = 0.02 * rng.standard_normal(model.n_q), rng.standard_normal(model.n_q), np.zeros(model.n_q)
    state, observer, h = State(0.0, d, none, none, 0.0, v=v), Observer(model), 1e-6

    def read(name, quantity, step):
        moved = replace(state, d=d + step * one, v=v + step * two)
        return observer.observe(moved)[name][quantity]

    one, two = rng.standard_normal((2, model.n_q))
    for name in observer.probes:
        for quantity in ("x", "uy", "theta", "vx", "vy", "omega"):
            coords, by_d, by_v = observer.slopes(name, quantity, state)
            exact = (read(name, quantity, h) - read(name, quantity, -h)) / (2 * h)
            assert by_d @ one[coords] + by_v @ two[coords] == pytest.approx(exact, rel=1e-6), (name, quantity)


def test_a_corner_of_a_rigid_body():
    """A bent bar of mass mu per length under a force from rest: theta = (r x F) t^2/(2 J), r from its centre of mass.

    The place of its corner changes how the coordinates of both pieces follow from those of the body.
    """
    def rotation(points, F=(10.0, 17.0), t=1e-4, mu=2.0):
        points = np.array(points)
        way, middle = np.diff(points, axis=0), 0.5 * (points[1:] + points[:-1])
        m = mu * np.hypot(*way.T)
        center = m @ middle / m.sum()
        J = m @ (np.sum(way**2, axis=1) / 12 + np.sum((middle - center) ** 2, axis=1))
        r = points[-1] - center
        return (r[0] * F[1] - r[1] * F[0]) * t**2 / (2 * J)

    points, h = [[0.0, 0.1], [0.05, 0.3], [0.25, 0.27]], 1e-5
    case = {"bodies": {"bar": {"geometry": {"type": "polyline", "points": points}, "element": {"type": "rigid"},
                               "section": {"EA": 1.0, "kGA": 1.0, "EI": 1.0, "rhoA": 2.0, "rhoI": 0.0}}},
            "loads": [{"type": "force", "at": "bar@1", "value": [10.0, 17.0]}],
            "solver": {"type": "dynamic", "t_end": 1e-4, "dt": 1e-5, "method": "radau5"},
            "goal": {"probe": "foot", "quantity": "theta"}, "output": {"probes": {"foot": "bar@0"}}}
    study = ancf2d.sensitivity(case, [f"bodies.bar.geometry.points.{k}.{i}" for k in range(3) for i in range(2)])
    for row in study.rows:
        k, i = map(int, row.path.split(".")[-2:])
        moved = np.zeros((3, 2))
        moved[k, i] = h
        exact = (rotation(points + moved) - rotation(points - moved)) / (2 * h)
        assert row.method == "exact"
        assert row.derivative == pytest.approx(exact, rel=1e-4), row.path


@pytest.mark.parametrize("method", ["newmark", "radau5"])
def test_a_motion_without_unknowns(method):
    """A clamped rigid bar is at rest: its end moves with its geometry, and a load has no effect."""
    case = {"bodies": {"bar": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0.2]},
                               "section": {"height": 0.1, "width": 0.1},
                               "element": {"type": "rigid", "mass": 2.0, "inertia": 1.0}}},
            "boundary_conditions": [{"type": "clamp", "at": "bar@0"}],
            "loads": [{"type": "force", "at": "bar@1", "value": [3, 4]}],
            "solver": {"type": "dynamic", "t_end": 1.0, "dt": 0.1, "method": method},
            "goal": {"probe": "tip", "quantity": "y"}, "output": {"probes": {"tip": "bar@1"}}}
    study = ancf2d.sensitivity(case, ["bodies.bar.geometry.end.1", "loads.0.value.1"])
    found = {row.path: row.derivative for row in study.rows}
    assert study.goal == pytest.approx(0.2)
    assert found == pytest.approx({"bodies.bar.geometry.end.1": 1.0, "loads.0.value.1": 0.0}, abs=1e-9)
