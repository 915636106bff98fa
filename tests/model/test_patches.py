"""Turning loads and springs: derivatives, resultants, potentials."""

import helpers
import numpy as np
import pytest

from ancf2d.model.determinacy import rigid_motion

NAMES = [*helpers.KINDS.values(), "omar", "2d3n", "ancf[2,2]"]
PLACES = [(n, g, s) for n in NAMES for g in helpers.GEOMETRIES for s in (0.37, 1.0)]
CLAMP = [{"type": "clamp", "at": "b@0"}]


def loaded(name: str, geometry, load: dict, count: int = 3):
    shape = helpers.GEOMETRIES[geometry] if isinstance(geometry, str) else geometry
    model = helpers.build({"b": helpers.body(shape, helpers.element(name, count))}, bc=CLAMP, loads=[load])
    (patch,) = model.loads.patches
    return model, patch


def sprung(name: str, geometry: str, spring: dict):
    model = helpers.build(
        {"b": helpers.body(helpers.GEOMETRIES[geometry], helpers.element(name, 3))}, bc=CLAMP, springs=[spring]
    )
    (patch,) = model.springs
    return model, patch


def total(model, patch, d, t: float = 1.0):
    Q = np.zeros(model.n_q)
    _, forces, _, dofs = helpers.patch_at(model, patch, d, t)
    np.add.at(Q, dofs, forces)
    return Q


def check_tangent(model, patch, size: float = 0.05):
    d = helpers.random_state(model, size)[: model.n_q]
    _, _, K, coords = helpers.patch_at(model, patch, d, 0.8)
    dense = np.zeros((model.n_q, model.n_q))
    for dofs, Ke in zip(coords, K, strict=True):
        dense[np.ix_(dofs, dofs)] += Ke
    scale = np.abs(dense).max()
    assert scale > 0 or patch.dofs.shape[1] == 1
    h = 1e-6
    for c in np.unique(patch.dofs):
        step = np.zeros(model.n_q)
        step[c] = h
        slope = (total(model, patch, d + step, 0.8) - total(model, patch, d - step, 0.8)) / (2 * h)
        np.testing.assert_allclose(dense[:, c], slope, atol=1e-7 * (scale + np.abs(total(model, patch, d, 0.8)).max()))
    assert patch.symmetric == (np.abs(dense - dense.T).max() <= 1e-12 * scale)


@pytest.mark.parametrize(("name", "geometry", "s"), PLACES)
def test_follower_force_stiffness_is_the_derivative_of_its_force(name, geometry, s):
    check_tangent(*loaded(name, geometry, {"type": "follower_force", "at": f"b@{s}", "value": [0.3, -0.7]}))


def test_follower_force_spread_over_the_section_has_its_stiffness_too():
    load = {"type": "follower_force", "at": "b@1", "value": [0.3, -0.7], "spread": "parabolic"}
    check_tangent(*loaded("ancf[2,2]", "arc", load))


@pytest.mark.parametrize(("name", "geometry", "s"), PLACES)
def test_moment_stiffness_is_the_derivative_of_its_force(name, geometry, s):
    if helpers.TYPES[name].has_theta:
        model, patch = loaded(name, geometry, {"type": "moment", "at": f"b@{s}", "value": 0.6})
        _, _, K, _ = helpers.patch_at(model, patch, np.zeros(model.n_q), 1.0)
        assert not K.any()
        return
    check_tangent(*loaded(name, geometry, {"type": "moment", "at": f"b@{s}", "value": 0.6}))


@helpers.covering(name=NAMES, geometry=helpers.GEOMETRIES,
                  reach=[{}, {"from": 0.21, "to": 0.4}, {"from": 0.1, "to": 0.93}])
def test_follower_line_load_stiffness_is_the_derivative_of_its_force(name, geometry, reach):
    load = {"type": "distributed", "on": "b", "value": [0.3, -0.7], "follower": True, **reach}
    check_tangent(*loaded(name, geometry, load))


@pytest.mark.parametrize("name", NAMES)
def test_follower_loads_turn_with_their_section(name):
    angle, load = 2.1, {"type": "follower_force", "at": "b@0.37", "value": [0.3, -0.7]}
    model, patch = loaded(name, "line", load)
    d = helpers.rotate(np.zeros(model.n_q), model, angle, (0.5, 0.1))
    resultant = -total(model, patch, d) @ rigid_motion(
        model.meshes["b"], np.arange(model.n_q), model.e0 + d, np.zeros(2)
    )
    direction = np.arctan2(0.7, 1.1) + angle
    c, s = np.cos(direction), np.sin(direction)
    np.testing.assert_allclose(resultant[:2], [0.3 * c + 0.7 * s, 0.3 * s - 0.7 * c], atol=1e-12)


def resultant(model, Q, centre=(0.0, 0.0)):
    return Q @ rigid_motion(model.meshes["b"], np.arange(model.n_q), model.e0, np.asarray(centre))


LENGTH = np.hypot(1.1, 0.7)


@pytest.mark.parametrize(("start", "end"), [(0.0, 1.0), (0.2, 0.9), (0.4, 0.45), (1 / 3, 2 / 3), (0.1, 0.34)])
@pytest.mark.parametrize("name", helpers.TYPES)
def test_distributed_loads_have_their_resultant_and_centre(name, start, end):
    p = np.array([0.3, -0.7])
    load = {"type": "distributed", "on": "b", "value": p.tolist(), "from": start, "to": end}
    model = helpers.build({"b": helpers.body(helpers.LINE, helpers.element(name, 3))}, bc=CLAMP, loads=[load])
    force = p * LENGTH * (end - start)
    x, y = np.array([0.3, -0.2]) + 0.5 * (start + end) * np.array([1.1, 0.7])
    expected = [*force, x * force[1] - y * force[0]]
    np.testing.assert_allclose(resultant(model, model.external(1.0)), expected, atol=1e-12)


@helpers.covering({"name": helpers.FEW_TYPES}, name=helpers.TYPES, spread=[None, "uniform", "parabolic"])
def test_point_forces_have_their_resultant_and_place(name, spread):
    load = {"type": "force", "at": "b@0.4", "value": [0.3, -0.7], **({"spread": spread} if spread else {})}
    model = helpers.build({"b": helpers.body(helpers.LINE, helpers.element(name, 3))}, bc=CLAMP, loads=[load])
    x, y = np.array([0.3, -0.2]) + 0.4 * np.array([1.1, 0.7])
    np.testing.assert_allclose(resultant(model, model.external(1.0)), [0.3, -0.7, -0.7 * x - 0.3 * y], atol=1e-12)
    assert not model.external(0.0).any()


@pytest.mark.parametrize("name", helpers.TYPES)
def test_gravity_acts_at_the_centre_of_mass(name):
    load = {"type": "gravity", "value": [0.0, -9.81]}
    model = helpers.build({"b": helpers.body(helpers.LINE, helpers.element(name, 3))}, bc=CLAMP, loads=[load])
    weight = 9.81 * 1.3 * 0.06 * LENGTH
    np.testing.assert_allclose(resultant(model, model.external(1.0)), [0, -weight, -weight * 0.85], atol=1e-12)
    # potential: lifted by 2
    lift = np.zeros(model.n_q)
    lift[model.meshes["b"].kinds == 1] = 2.0
    assert model.gravity_potential(lift, 1.0) == pytest.approx(2 * weight, rel=1e-12)


def test_amplitudes_scale_loads():
    load = {"type": "force", "at": "b@1", "value": [1.0, 0.0], "amplitude": {"type": "expression", "value": "t^2"}}
    model = helpers.build({"b": helpers.body(helpers.LINE, helpers.element("cable", 1))}, bc=CLAMP, loads=[load])
    assert model.external(0.5).sum() == pytest.approx(0.25)


TRANSLATIONAL = [
    {"between": ["b@1", [2.0, 0.3]]},
    {"between": ["b@0.37", "b@1"]},
    {"between": [[2.0, 0.3], "b@0.5"], "length": 0.2},
]
ROTATIONAL = [{"between": ["b@1", [0.0, 0.0]]}, {"between": ["b@0.37", "b@1"], "angle": 0.4}]


@pytest.mark.parametrize(
    "spring",
    [{"type": "translational", **s} for s in TRANSLATIONAL] + [{"type": "rotational", **s} for s in ROTATIONAL],
)
@pytest.mark.parametrize("geometry", helpers.GEOMETRIES)
@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_springs_pull_by_the_gradient_of_their_energy_with_its_hessian(name, geometry, spring):
    model, patch = sprung(name, geometry, {**spring, "stiffness": 3.0})
    check_tangent(model, patch)
    d, h = helpers.random_state(model, 0.05)[: model.n_q], 1e-5
    Q = total(model, patch, d)
    v = helpers.random_state(model, 1.0, 1)[: model.n_q]
    energies = [helpers.patch_at(model, patch, x, 1.0)[0] for x in (d + h * v, d - h * v)]
    assert (energies[0] - energies[1]) / (2 * h) == pytest.approx(Q @ v, abs=1e-7 * np.abs(Q * v).sum())
    assert helpers.patch_at(model, patch, d, 1.0)[0] > 0


def test_springs_are_relaxed_in_the_reference_by_default():
    zero = np.zeros(9)
    for spring in (
        {"type": "translational", "between": ["b@1", [2.0, 0.3]]},
        {"type": "rotational", "between": ["b@1", [0.0, 0.0]]},
    ):
        model, patch = sprung("reissner3", "line", {**spring, "stiffness": 3.0})
        zero = np.zeros(model.n_q)
        assert helpers.patch_at(model, patch, zero, 1.0)[0] == 0.0
    model, patch = sprung(
        "reissner3", "line", {"type": "translational", "between": ["b@1", [1.4, 1.5]], "stiffness": 3.0, "length": 0.4}
    )
    assert helpers.patch_at(model, patch, np.zeros(model.n_q), 1.0)[0] == pytest.approx(0.5 * 3 * 0.6**2)
    model, patch = sprung(
        "vallejo", "line", {"type": "rotational", "between": ["b@1", [0.0, 0.0]], "stiffness": 3.0, "angle": 0.4}
    )
    assert helpers.patch_at(model, patch, np.zeros(model.n_q), 1.0)[0] == pytest.approx(0.5 * 3 * 0.4**2)


@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_a_torsion_spring_is_wound_through_full_turns(name):
    model, patch = sprung(name, "line", {"type": "rotational", "between": ["b@1", [0.0, 0.0]], "stiffness": 3.0})
    before, turned = np.zeros(model.n_q), np.zeros(1)
    for angle in np.linspace(0, -15, 12):
        d = helpers.rotate(np.zeros(model.n_q), model, angle)
        before, turned = d, model.turns.follow(before, turned, d)
        model.turns.set_spring_angles([patch], model.e0 + d, d, turned)
        energy = helpers.patch_at(model, patch, d, 1.0)[0]
        assert energy == pytest.approx(1.5 * angle**2, abs=1e-10)


def test_a_spring_between_points_of_one_body_does_not_resist_its_rigid_motion():
    model, patch = sprung("vallejo", "arc", {"type": "translational", "between": ["b@0.2", "b@0.9"], "stiffness": 3.0})
    d = helpers.rotate(np.zeros(model.n_q), model, 2.5, (1.0, 2.0))
    assert helpers.patch_at(model, patch, d, 1.0)[0] < 1e-28
