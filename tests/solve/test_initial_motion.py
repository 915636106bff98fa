"""The start of a motion: rigid velocity fields, static equilibrium, result files; refusals name their line."""

from __future__ import annotations

from pathlib import Path

import helpers as h
import numpy as np
import pytest
import yaml
from motions import Ride, rigid, rod

from ancf2d.errors import CaseError, ComputationError
from ancf2d.kernels.elements import viscous_force
from ancf2d.model.build import build_model
from ancf2d.model.points import point_ref
from ancf2d.solvers.energy import Energies
from ancf2d.solvers.linear import full_mass
from ancf2d.solvers.motion.dynamic import Run
from ancf2d.solvers.motion.initial import initial_motion, initial_problems
from ancf2d.solvers.system import System
from ancf2d.study.run import load, run_case

DYNAMIC = {"type": "dynamic", "t_end": 1, "dt": 0.01}
SPIN = {"velocity": [0.4, -1.0], "rotation_rate": {"omega": 3.0, "about": [0.2, 0.7]}}


def strain_power(model, d, v) -> float:
    """Return eps'^T D eps' of a state."""
    Q = np.zeros(len(d))
    return sum(viscous_force(group, 1.0, d, v, Q) for group in model.groups)


@h.every_small_variant
def test_a_rigid_velocity_field_strains_nothing(name, formulation):
    model = h.build({"b": h.body(h.ARC, h.element(name, 2, formulation))}, DYNAMIC, initial=SPIN)
    d, v, _ = initial_motion(model)
    other = h.random_state(model, 1.0)
    assert strain_power(model, d, v) < 1e-24 * strain_power(model, d, other) * (v @ v) / (other @ other)


@pytest.mark.parametrize("name", ["2d2n", "cable", "reissner3", "ancf[2,2]"])
def test_a_deformed_body_rotates_in_its_current_shape(name):
    """The rates of nodal coordinates are omega x their current values, not the reference values."""
    bodies = {"b": h.body(h.line(2.0), h.element(name, 4), {"height": 0.1, "width": 0.1}, h.STEEL)}
    scene = {"bc": [{"type": "clamp", "at": "b@0"}], "loads": [{"type": "force", "at": "b@1", "value": [0, -1e5]}]}
    model = h.build(bodies, DYNAMIC, initial={"from": "static", **SPIN}, **scene)
    d, v, _ = initial_motion(model)
    assert abs(d).max() > 0.1
    power, typical = strain_power(model, d, v), strain_power(model, d, h.random_state(model, 1.0))
    assert power < 1e-20 * typical
    # the field of the reference would strain it
    resting = h.build(bodies, DYNAMIC, initial=SPIN, **scene)
    assert strain_power(model, d, initial_motion(resting)[1]) > 1e-8 * typical


def test_velocities_of_points_are_those_of_the_field():
    model = h.build({"b": h.body(h.ARC, h.element("2d2n", 3))}, DYNAMIC, initial=SPIN)
    _, v, _ = initial_motion(model)
    point = point_ref(model.meshes["b"], 0.4)
    x, y = (w @ model.e0[c] for c, w in point.position())
    found = [w @ v[c] for c, w in point.position()]
    np.testing.assert_allclose(found, [0.4 - 3.0 * (y - 0.7), -1.0 + 3.0 * (x - 0.2)], rtol=1e-12)


def test_values_of_single_bodies_override_common_ones():
    bodies = {n: h.body(h.LINE, h.element("reissner2", 2)) for n in ("a", "b", "c")}
    own = {"b": {"velocity": [7.0, 0.0]}, "c": {"rotation_rate": {"omega": -1.0}}}
    model = h.build(bodies, DYNAMIC, initial={**SPIN, "bodies": own})
    _, v, _ = initial_motion(model)
    parts = {n: v[m.first_dof:m.first_dof + m.n_dofs].reshape(-1, 3) for n, m in model.meshes.items()}
    assert np.all(parts["a"][:, 2] == 3.0)
    np.testing.assert_array_equal(parts["b"], np.tile([7.0, 0.0, 0.0], (3, 1)))
    assert np.all(parts["c"][:, 2] == -1.0)
    np.testing.assert_allclose(parts["c"][0, :2], [-0.2, -0.3], atol=1e-15)


LOADS = [
    {"type": "gravity", "value": [0, -9.81]},
    {"type": "force", "at": "b@1", "value": [0, 4e4], "amplitude": {"type": "expression", "value": "0.5*cos(3*t)"}},
    {"type": "follower_force", "at": "b@0.5", "value": [1e3, 2e4]},
    {"type": "moment", "at": "b@1", "value": 2e4, "amplitude": {"type": "sine", "frequency": 1, "phase": 0.3}},
    {"type": "distributed", "on": "b", "value": [0, 1e4], "amplitude": {"type": "ramp", "t0": 0, "t1": 1}},
]


@pytest.mark.parametrize("name", ["vallejo", "cable", "reissner2", "2d3n"])
def test_forces_balance_in_the_static_start(name):
    """With loads at their value at t = 0 (a ramp from 0 is zero), nothing accelerates."""
    bodies = {"b": h.body(h.LINE, h.element(name, 3), {"height": 0.05, "width": 0.1}, h.STEEL)}
    model = h.build(bodies, DYNAMIC, bc=[{"type": "clamp", "at": "b@0"}], loads=LOADS, initial={"from": "static"})
    d, v, _ = initial_motion(model)
    assert abs(d).max() > 1e-3
    assert not v.any()
    system = System(model)
    assert system.imbalance(system.forces(d, 0.0)) < 1e-7
    assert system.imbalance(system.forces(d, 0.1)) > 1e-4


def test_a_static_start_needs_supports():
    bodies = {"b": h.body(h.LINE, h.element("vallejo", 2))}
    model = h.build(bodies, DYNAMIC, bc=[{"type": "pin", "at": "b@0"}], initial={"from": "static"})
    with pytest.raises(CaseError, match=r"initial\.from static: 'b' is free to turn"):
        initial_motion(model)
    assert initial_problems(model)[0].line == 1


def test_a_failed_static_start_names_its_purpose():
    bodies = {"b": h.body(h.LINE, h.element("vallejo", 2))}
    loads = [{"type": "force", "at": "b@1", "value": [-1e11, 0]}]
    model = h.build(bodies, DYNAMIC, bc=[{"type": "clamp", "at": "b@0"}], loads=loads, initial={"from": "static"})
    with pytest.raises(ComputationError, match="no equilibrium to start the motion from"):
        initial_motion(model)


def write(path: Path, **changes) -> Path:
    """Write a case of one clamped beam."""
    data = {"bodies": {"b": h.body(h.line(2.0), h.element("vallejo", 3), {"height": 0.1, "width": 0.1}, h.STEEL)},
            "boundary_conditions": [{"type": "clamp", "at": "b@0"}],
            "loads": [{"type": "force", "at": "b@1", "value": [0, -1e5]}], "solver": {"type": "static"}, **changes}
    path.write_text(yaml.safe_dump(h._plain(data)))
    return path


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """Return the directory of a static result ``bent.h5`` and its displacements."""
    place = tmp_path_factory.mktemp("start")
    outcome = run_case(load(write(place / "bent.yaml")), str(place / "bent.h5"))
    assert outcome.failure is None
    from ancf2d.results import open_results

    with open_results(place / "bent.h5") as results:
        return place, results.d(-1)


def dynamic(place: Path, from_: str, start=None, **changes):
    """Return the model of a dynamic case that starts from a file in its folder."""
    initial = {"from": from_, **(start or {})}
    return build_model(load(write(place / "motion.yaml", solver=DYNAMIC, initial=initial, **changes)))


def test_a_file_next_to_the_case_gives_its_last_state(bent):
    place, d = bent
    start, v, _ = initial_motion(dynamic(place, "bent.h5"))
    np.testing.assert_array_equal(start, d)
    assert not v.any()
    assert abs(d).max() > 0.1


def test_rates_of_a_file_are_kept_by_default(bent):
    from ancf2d.results import ResultWriter
    from ancf2d.study.run import body_record, result_header

    place, d = bent
    loaded = load(place / "bent.yaml")
    model = dynamic(place, "moving.h5")
    rates = np.arange(1.0, model.n_q + 1)
    names = {"b": [c for node in model.meshes["b"].coordinate_names for c in node]}
    with ResultWriter(place / "moving.h5", result_header(loaded), [body_record(model.meshes["b"])], model.e0,
                      names) as writer:
        writer.append(0.0, d, {"step": 0}, {}, v=0 * rates)
        writer.append(1.0, d, {"step": 1}, {}, v=rates)
        writer.finish({}, "converged")
    np.testing.assert_array_equal(initial_motion(model)[1], rates)
    v = initial_motion(dynamic(place, "moving.h5", {"velocity": [1.0, 0.0]}))[1].reshape(-1, 2)
    assert set(v[:, 0]) == {0.0, 1.0}
    assert not v[:, 1].any()


OTHER = {
    "another mesh": (h.body(h.line(2.0), h.element("vallejo", 4), {"height": 0.1, "width": 0.1}, h.STEEL),
                     "has 3 elements of type vallejo in b, the case has 4 of type vallejo"),
    "another type": (h.body(h.line(2.0), h.element("reissner3", 3), {"height": 0.1, "width": 0.1}, h.STEEL),
                     "3 elements of type vallejo in b, the case has 3 of type reissner3"),
    "another reference": (h.body(h.line(2.1), h.element("vallejo", 3), {"height": 0.1, "width": 0.1}, h.STEEL),
                          "nodes or directions differ by 0.1"),
}


@pytest.mark.parametrize("what", OTHER)
def test_a_file_of_another_kind_is_refused_at_its_line(bent, what):
    body, message = OTHER[what]
    model = dynamic(bent[0], "bent.h5", bodies={"b": body})
    with pytest.raises(CaseError, match=message) as caught:
        initial_motion(model)
    (problem,) = caught.value.problems
    assert problem.source_line.strip() == "from: bent.h5"
    assert initial_problems(model) == [problem]


def test_a_file_with_other_bodies_is_refused(bent):
    body = h.body(h.line(2.0), h.element("vallejo", 3), {"height": 0.1, "width": 0.1}, h.STEEL)
    model = dynamic(bent[0], "bent.h5", bodies={"b": body, "c": body})
    with pytest.raises(CaseError, match="has the bodies b, the case has b, c"):
        initial_motion(model)


@pytest.mark.parametrize(("support", "message"), [
    ({"type": "pin", "at": "b@1"},
     r"hold [xy] of b at S = 1 at another place than the last state of '.*bent\.h5', by 0\."),
    ({"type": "prescribed", "at": "b@1", "angle": {"type": "expression", "value": "t"}},
     r"support_1: the rotation differs in the last state of '.*bent\.h5'"),
])
def test_a_file_whose_state_violates_supports_is_refused(bent, support, message):
    model = dynamic(bent[0], "bent.h5", boundary_conditions=[{"name": "support_1", **support}])
    with pytest.raises(CaseError, match=message):
        initial_motion(model)


def test_a_file_that_is_missing_or_not_a_result_is_refused(bent):
    place, _ = bent
    (place / "text.h5").write_text("no results")
    for name in ("absent.h5", "text.h5"):
        with pytest.raises(CaseError, match=name) as caught:
            initial_motion(dynamic(place, name))
        assert caught.value.problems[0].source_line.strip() == f"from: {name}"


def test_without_supports_the_mass_of_all_coordinates_is_that_of_the_unknowns():
    from ancf2d.solvers.linear import assemble_mass, make_matrix

    for name in ("2d2n", "cable", "reissner3"):
        model = h.build({"b": h.body(h.ARC, h.element(name, 3))}, DYNAMIC,
                        masses=[{"at": "b@0.4", "mass": 2.0, "inertia": 0.7}])
        matrix = make_matrix(model)
        assemble_mass(model, matrix)
        x = np.random.default_rng(1).standard_normal(model.n_q)
        out = np.zeros(model.n_q)
        out[model.numbering.free] = matrix.product(matrix.values, x[model.numbering.free])
        np.testing.assert_allclose(full_mass(model) @ x, out, atol=1e-12)


# ------------------------------------------------------------------ velocities that supports and joints do not allow


def begun(scene):
    """Return the model of a scene, and d and the rates at the start of its motion."""
    ride = Ride(scene, 1e-3, method="radau5", tolerance=1e-6).start()
    d, v, _ = ride.full(0)
    return ride.model, d, v


def test_a_rod_on_two_sliders_keeps_the_velocity_along_their_line():
    """Pushed along x at 30 degrees to the line: cos^2 of the energy remains."""
    along = [np.cos(np.pi / 6), np.sin(np.pi / 6)]
    slide = [{"type": "slider", "at": f"b@{s}", "through": [0, 0], "along": along} for s in (0, 1)]
    model, _, v = begun({"bodies": {"b": rigid((0, 0), along, 3.0, 0.25)}, "joints": slide,
                         "initial": {"velocity": [1, 0]}})
    np.testing.assert_allclose(v[:4], np.cos(np.pi / 6) * np.tile(along, 2), rtol=1e-12)
    assert Energies(model).kinetic(v) == pytest.approx(1.5 * 0.75, rel=1e-12)


@pytest.mark.parametrize("order", ["ab", "ba"])
@pytest.mark.parametrize("make", [lambda *ends: rigid(*ends, 1.0, 1 / 12), lambda *ends: rod("cable", 2, *ends)],
                         ids=["rigid", "cable"])
def test_a_joint_conserves_momentum_for_any_order_of_bodies(order, make):
    bodies = {"a": make((0, 0), (1, 0)), "b": make((1, 0), (2, 0))}
    scene = {"bodies": {name: bodies[name] for name in order},
             "joints": [{"type": "pin", "between": ["a@1", "b@0"]}],
             "initial": {"bodies": {"a": {"velocity": [0.6, 0.8]}}}}
    model, d, v = begun(scene)
    energies = Energies(model)
    asked = initial_motion(model)[1]
    # also about the origin: the joint's forces are opposite ones at one point
    np.testing.assert_allclose(energies.momentum(d, v), energies.momentum(d, asked), rtol=1e-12, atol=1e-13)
    assert energies.kinetic(v) < 0.99 * energies.kinetic(asked)


def test_two_rigid_rods_that_are_joined_in_flight():
    """One of two rods of 1 kg has (0, 1) m/s: the impulse at the pin is 1/8 N s, by m = 1 and J = 1/12 of both."""
    scene = {"bodies": {"a": rigid((0, 0), (1, 0), 1.0, 1 / 12), "b": rigid((1, 0), (2, 0), 1.0, 1 / 12)},
             "joints": [{"type": "pin", "between": ["a@1", "b@0"]}], "initial": {"bodies": {"a": {"velocity": [0, 1]}}}}
    model, _, v = begun(scene)
    # an impulse at an end changes its velocity by 4 times, the other end's by -2 times what it gives the centre
    np.testing.assert_allclose(v[1:8:2], [1 + 2 / 8, 0.5, 0.5, -2 / 8], rtol=1e-12)
    assert Energies(model).kinetic(v) == pytest.approx(0.5 - 1 / 16, rel=1e-12)


def test_a_falling_rod_that_is_caught_at_its_end_turns_about_it():
    """Angular momentum about the pin is conserved: omega = 3 v/(2 L); a quarter of the energy is lost, as reported."""
    scene = {"bodies": {"b": rigid((0, 0), (2, 0), 3.0, 1.0)}, "bc": [{"type": "pin", "at": "b@0"}],
             "initial": {"velocity": [0, -1]}}
    model, _, v = begun(scene)
    np.testing.assert_allclose(v[:4], [0, 0, 0, -1.5], atol=1e-14)
    first = next(Run(model, model.case.solver).states())
    assert first.report["initial"] == pytest.approx({"given": 1.5, "kinetic": 1.125, "lost": 0.375}, rel=1e-12)
    assert len(first.warnings) == 1
    assert "0.375 of 1.5" in first.warnings[0]
    assert "25 %" in first.warnings[0]


def test_a_driven_end_starts_as_after_an_impact():
    """A rod at rest whose end is suddenly driven at 1 m/s transversely: its other end recoils at half of that."""
    drive = {"type": "prescribed", "at": "b@0", "uy": {"type": "expression", "value": "t"}}
    model, _, v = begun({"bodies": {"b": rigid((0, 0), (1, 0), 3.0, 0.25)}, "bc": [drive]})
    np.testing.assert_allclose(v[:4], [0, 1, 0, -0.5], atol=1e-14)
    assert Energies(model).kinetic(v) == pytest.approx(3.0 / 8, rel=1e-12)


def test_a_linkage_keeps_velocities_that_its_joints_allow():
    """A four-bar with the angular velocities of its closure, 7 rad/s at the crank."""
    a, b, c, d = (np.array(x) for x in ((0.0, 0.0), (0.0, 0.5), (1.2, 1.0), (1.0, 0.0)))

    def turn(r):
        return np.array([-r[1], r[0]])

    w = 7.0
    coupler, rocker = np.linalg.solve(np.array([turn(c - b), -turn(c - d)]).T, -w * turn(b - a))
    spin = {"crank": (w, a), "coupler": (coupler, b), "rocker": (rocker, d)}
    own = {name: {"rotation_rate": {"omega": rate, "about": about.tolist()}} for name, (rate, about) in spin.items()}
    own["coupler"]["velocity"] = (w * turn(b - a)).tolist()
    scene = {"bodies": {"crank": rigid(a, b, 1, 0.02), "coupler": rigid(b, c, 2, 0.2), "rocker": rigid(c, d, 1.5, 0.1)},
             "joints": [{"type": "pin", "between": ["crank@1", "coupler@0"]},
                        {"type": "pin", "between": ["coupler@1", "rocker@0"]}],
             "bc": [{"type": "pin", "at": "crank@0"}, {"type": "pin", "at": "rocker@1"}], "initial": {"bodies": own}}
    model, _, v = begun(scene)
    asked = initial_motion(model)[1]
    np.testing.assert_allclose(v[:model.n_q], asked[:model.n_q], atol=1e-13)
    first = next(Run(model, model.case.solver).states())
    assert not first.warnings
    assert abs(first.report["initial"]["lost"]) < 1e-13 * first.report["initial"]["given"]


@pytest.mark.parametrize("name", ["vallejo", "cable", "reissner3"])
def test_flexible_rods_keep_a_rotation_about_their_joint_and_support(name):
    scene = {"bodies": {"a": rod(name, 2, (0, 0), (1, 0)), "b": rod(name, 2, (1, 0), (2, 0))},
             "joints": [{"type": "pin", "between": ["a@1", "b@0"]}], "bc": [{"type": "pin", "at": "a@0"}],
             "initial": {"rotation_rate": {"omega": 3.0}}}
    model, _, v = begun(scene)
    asked = initial_motion(model)[1]
    np.testing.assert_allclose(v[:model.n_q], asked[:model.n_q], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("raised", [0.3, 0.4])
def test_a_motion_from_a_file_starts_with_its_contacts(tmp_path, raised):
    """A disc lifts the end of a lever, which rests there, although the disc would overlap it in the reference."""
    pressed = {
        "bodies": {"lever": {"geometry": h.line(1.0), "element": {"type": "rigid", "mass": 1.0, "inertia": 0.1}}},
        "boundary_conditions": [{"type": "pin", "at": "lever@0"}],
        "springs": [{"type": "rotational", "between": [[0, 0], "lever@0"], "stiffness": 50.0}],
        "obstacles": {"disc": {"type": "circle", "center": [1.3, -0.6], "radius": 0.5,
                               "motion": {"y": {"type": "ramp", "scale": 0.3}}}},
        "contacts": [{"between": ["lever", "disc"], "side": "axis"}], "loads": [],
        "output": {"probes": {"tip": "lever@1"}}, "solver": {"type": "static"}}
    lifted = run_case(load(write(tmp_path / "pressed.yaml", **pressed)), str(tmp_path / "pressed.h5")).summary
    pressed["obstacles"]["disc"]["motion"]["y"] = {"type": "constant", "scale": raised}
    moving = {**pressed, "initial": {"from": "pressed.h5"}, "solver": {**DYNAMIC, "t_end": 0.1}}
    loaded = load(write(tmp_path / "moving.yaml", **moving))
    if raised > 0.3:
        with pytest.raises(CaseError, match="lever and disc overlap in the last state"):
            run_case(loaded)
    else:
        tip = run_case(loaded).summary["probes"]["tip"]
        assert tip["uy"] == pytest.approx(lifted["probes"]["tip"]["uy"], rel=1e-6)
        assert tip["uy"] > 0.09
        assert abs(tip["vy"]) < 1e-6


@pytest.mark.slow_rows("changes0")
@pytest.mark.parametrize("changes", [{}, {"joints": [{"type": "pin", "between": ["a@1", "b@0"], "name": "other"}]}])
def test_energy_momentum_continues_from_a_file_without_a_break(tmp_path, changes):
    """Its rates meet constraints only in the mean of steps; with other joints they are projected."""
    scene = {"bodies": {"a": {"geometry": h.line(1.0), "element": {"type": "rigid", "mass": 1.0, "inertia": 0.1}},
                        "b": {"geometry": {"type": "line", "start": [1, 0], "end": [1, 1]},
                              "element": {"type": "rigid", "mass": 2.0, "inertia": 0.2}}},
             "boundary_conditions": [{"type": "pin", "at": "a@0"}], "loads": [{"type": "gravity", "value": [0, -9.81]}],
             "joints": [{"type": "pin", "between": ["a@1", "b@0"]}], "output": {"probes": {"tip": "b@1"}}}

    def end(name: str, t_end: float, **more) -> np.ndarray:
        solver = {"type": "dynamic", "t_end": t_end, "dt": 0.05, "method": "energy_momentum", "estimate": False}
        found = run_case(load(write(tmp_path / f"{name}.yaml", **{**scene, "solver": solver, **more})),
                         str(tmp_path / f"{name}.h5")).summary["probes"]["tip"]
        return np.array([found[k] for k in ("ux", "uy", "vx", "vy")])

    whole, _ = end("whole", 0.5), end("first", 0.25)
    apart = np.abs(end("second", 0.25, initial={"from": "first.h5"}, **changes) - whole).max()
    assert apart > 1e-3 if changes else apart < 1e-9


def test_a_body_at_rest_near_an_obstacle_takes_the_requested_steps():
    """Round-off of its energy is not a gain, although the kinetic energy is even smaller."""
    frame = h.body({"type": "polyline", "points": [[0, 0], [0.5, 0], [1, 0.3]]}, h.element("reissner2", 2),
                   {"height": 0.05, "width": 0.05}, {"E": 1e8, "nu": 0.3, "rho": 1000})
    outcome = run_case(h.load(
        {"rod": frame}, {"type": "dynamic", "t_end": 5e-3, "dt": 5e-4, "method": "generalized_alpha"},
        bc=[{"type": "clamp", "at": "rod@0"}], loads=[{"type": "follower_force", "at": "rod@1", "value": [-5, -8]}],
        obstacles={"floor": {"type": "half_plane", "through": [0, -3], "normal": [0, 1]}},
        contacts=[{"between": ["rod", "floor"]}], initial={"from": "static"}))
    assert outcome.summary["steps"] == 10
