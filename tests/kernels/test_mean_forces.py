"""Forces of a step that conserves energy and momentum, and Kelvin-Voigt forces, for every type and formulation."""

import helpers
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.kernels.elements import force, mean_force, mean_force_tangent, viscous_force
from ancf2d.kernels.matrices.layout import Places
from ancf2d.kernels.matrices.matrix import Csr
from ancf2d.model.body_groups import damping_time
from ancf2d.model.classes import mass_matrix

CASES = [v for v in helpers.VARIANTS if FORMULATIONS[v[1]].law.mean is not None]
EVERY = pytest.mark.parametrize(("name", "formulation"), helpers.chosen(CASES, helpers.FEW_VARIANTS))
SIZE = 0.05 * helpers.SECTION["height"]
TAU = 0.3
SEEDS = st.integers(0, 2**32 - 1)
MODELS: dict = {}


def model_of(name: str, formulation: str, geometry: str = "arc"):
    def make():
        spec = helpers.element(name, 2, formulation)
        scene = {"b": helpers.body(helpers.GEOMETRIES[geometry], spec)}
        return helpers.build(scene, bc=[{"type": "clamp", "at": "b@0"}])

    key = (name, formulation, geometry)
    if key not in MODELS:
        MODELS[key] = make()
    return MODELS[key]


def state(model, seed: int, angle: float = 0.0):
    return helpers.rotate(helpers.random_state(model, SIZE, seed)[: model.n_q], model, angle, (0.4, -0.3))


def energy(model, d) -> float:
    return force(model.groups[0], d, np.zeros(model.n_q))


def turning(model, d, omega: float = 1.0):
    """Return the rates of all nodal coordinates for a rotation of the deformed body about the origin."""
    e, w = model.e0 + d, np.zeros(model.n_q)
    for mesh in model.meshes.values():
        for k, kind in enumerate(mesh.kinds.tolist()):
            i = mesh.first_dof + k
            if kind in (0, 3):
                w[i], w[i + 1] = -omega * e[i + 1], omega * e[i]
            elif kind == 2:
                w[i] = omega
    return w


@EVERY
@settings(max_examples=12, deadline=None)
@given(seed=SEEDS, angle=st.floats(-3, 3), size=st.floats(-7, 0))
def test_work_of_a_step_is_the_change_of_energy_plus_dissipation(name, formulation, seed, angle, size):
    for geometry in helpers.GEOMETRIES:
        model = model_of(name, formulation, geometry)
        d0 = state(model, seed)
        d1 = d0 + 10.0**size * (state(model, seed + 1, angle) - d0)
        U0, U1 = energy(model, d0), energy(model, d1)
        for damping in (0.0, 0.7):
            Q = np.zeros(model.n_q)
            U, lost = mean_force(model.groups[0], damping, d0, d1, Q)
            assert pytest.approx(U1, rel=1e-13) == U
            assert lost > 0.0 if damping else lost == 0.0
            tolerance = 1e-13 * (U0 + U1 + lost + np.abs(Q * (d1 - d0)).sum())
            assert Q @ (d1 - d0) == pytest.approx(U1 - U0 + lost, rel=0, abs=tolerance)


@EVERY
@settings(max_examples=12, deadline=None)
@given(seed=SEEDS, angle=st.floats(-3, 3))
def test_forces_of_a_step_have_no_resultant_and_no_moment_about_the_mid_point(name, formulation, seed, angle):
    model = model_of(name, formulation)
    d0, d1 = state(model, seed), state(model, seed + 1, angle)
    Q = np.zeros(model.n_q)
    mean_force(model.groups[0], 0.7, d0, d1, Q)
    rates = [turning(model, 0.5 * (d0 + d1))]
    for k in (0, 1):
        shift = np.zeros(model.n_q)
        shift[np.flatnonzero(model.meshes["b"].kinds == 0) + k] = 1.0
        rates.append(shift)
    for w in rates:
        assert abs(Q @ w) <= 1e-12 * np.abs(Q * w).sum()


@EVERY
def test_a_step_of_zero_length_has_the_elastic_force_and_half_its_tangent(name, formulation):
    model = model_of(name, formulation)
    group, n, d = model.groups[0], model.n_q, state(model, 3, 0.5)
    elastic, plain = np.zeros(n), np.zeros(n)
    force(group, d, elastic)
    values = np.zeros(n * n)
    matrix = Csr(values, n * np.arange(n + 1), np.tile(np.arange(n), n))
    none = np.zeros(0, dtype=np.int64)
    mean_force_tangent(group, 0.0, d, d, plain, matrix, Places(np.arange(n), none, none, np.zeros(0)))
    K = helpers.dense_tangent(model, d)
    np.testing.assert_allclose(plain, elastic, atol=1e-13 * np.abs(elastic).max())
    np.testing.assert_allclose(values.reshape(n, n), 0.5 * K, atol=1e-13 * np.abs(K).max())


@EVERY
def test_tangent_of_a_small_step_is_the_derivative_of_its_force(name, formulation):
    """With damping; the neglected unsymmetric part vanishes with the step."""
    model = model_of(name, formulation)
    group, n, d0 = model.groups[0], model.n_q, state(model, 3)
    step = helpers.random_state(model, 1e-7 * SIZE, 4)[:n]
    v = helpers.random_state(model, 1e-3 * SIZE, 5)[:n]
    values, Q = np.zeros(n * n), np.zeros((3, n))
    matrix = Csr(values, n * np.arange(n + 1), np.tile(np.arange(n), n))
    none = np.zeros(0, dtype=np.int64)
    mean_force_tangent(group, 0.7, d0, d0 + step, Q[0], matrix, Places(np.arange(n), none, none, np.zeros(0)))
    for k, sign in ((1, 1.0), (2, -1.0)):
        mean_force(group, 0.7, d0, d0 + step + sign * v, Q[k])
    A = values.reshape(n, n)
    assert np.max(np.abs(0.5 * (Q[1] - Q[2]) - A @ v) / (np.abs(A) @ np.abs(v))) < 1e-6


@EVERY
def test_force_beside_the_tangent_is_that_of_the_force_alone(name, formulation):
    model = model_of(name, formulation)
    group, n, d0, d1 = model.groups[0], model.n_q, state(model, 3), state(model, 4, 0.5)
    Q, R, values = np.zeros(n), np.zeros(n), np.zeros(n * n)
    matrix = Csr(values, n * np.arange(n + 1), np.tile(np.arange(n), n))
    none = np.zeros(0, dtype=np.int64)
    U, lost = mean_force_tangent(group, 0.7, d0, d1, Q, matrix, Places(np.arange(n), none, none, np.zeros(0)))
    assert mean_force(group, 0.7, d0, d1, R) == pytest.approx((U, lost), rel=1e-13)
    np.testing.assert_allclose(Q, R, atol=1e-13 * np.abs(R).max())
    A = values.reshape(n, n)
    np.testing.assert_allclose(A, A.T, atol=1e-14 * np.abs(A).max())


def test_nan_without_a_known_conserving_form():
    model = model_of("reissner3", "geometrically_exact")
    assert np.isnan(mean_force(model.groups[0], 0.0, state(model, 1), state(model, 2), np.zeros(model.n_q))[1])


def dense_mass(model):
    mesh, M = model.meshes["b"], np.zeros((model.n_q, model.n_q))
    for dofs, c in zip(mesh.dofs, mesh.cls, strict=True):
        M[np.ix_(dofs, dofs)] += mass_matrix(mesh.classes[c].sampler)
    return M


@pytest.mark.parametrize(("name", "formulation"), [("vallejo", "enhanced"), ("2d3n", "continuum"), ("cable", "cable"),
                                                   ("cable", "green"), ("omar", "structural")])
def test_a_free_steel_rod_keeps_energy_and_angular_momentum(name, formulation):
    """Over steps of 0.05 rad, iterated to a fixed point; the mid-point rule itself would not conserve energy."""
    omega, h, steps = 20.0, 2.5e-3, 40
    scene = {"b": helpers.body(helpers.line(1.0, 0.3), helpers.element(name, 3, formulation),
                               {"height": 0.02, "width": 0.02}, helpers.STEEL)}
    model = helpers.build(scene, {"type": "dynamic", "t_end": 1, "dt": h})
    group, n, M = model.groups[0], model.n_q, dense_mass(model)
    d, v = np.zeros(n), turning(model, np.zeros(n), omega)
    none = np.zeros(0, dtype=np.int64)

    def totals():
        return 0.5 * v @ M @ v + energy(model, d), turning(model, d) @ M @ v

    start = totals()
    for _ in range(steps):
        move, last = h * v, np.inf
        while True:
            Q, values = np.zeros(n), np.zeros(n * n)
            matrix = Csr(values, n * np.arange(n + 1), np.tile(np.arange(n), n))
            mean_force_tangent(group, 0.0, d, d + move, Q, matrix, Places(np.arange(n), none, none, np.zeros(0)))
            K = values.reshape(n, n) + 2.0 / h**2 * M
            change = np.linalg.solve(K, -(Q + M @ (2.0 / h * (move / h - v))))
            move = move + change
            size = float(np.max(np.abs(change) * model.weights))
            if size > 0.5 * last and size < 1e-10:
                break
            last = size
        d, v = d + move, 2.0 / h * move - v
    assert energy(model, d) > 1e-9 * start[0]
    assert totals() == pytest.approx(start, rel=1e-12)


@helpers.every_variant
def test_viscous_power_is_the_work_of_the_viscous_forces(name, formulation):
    model = model_of(name, formulation)
    d, v, Q = state(model, 1, 0.4), helpers.random_state(model, 1.0, 2)[: model.n_q], np.zeros(model.n_q)
    power = viscous_force(model.groups[0], TAU, d, v, Q)
    assert power > 0.0
    assert Q @ v == pytest.approx(power, rel=1e-12)


@helpers.every_variant
def test_viscous_forces_are_tau_times_the_stiffness_in_small_motion(name, formulation):
    model = model_of(name, formulation)
    v, Q = helpers.random_state(model, 1.0, 2)[: model.n_q], np.zeros(model.n_q)
    viscous_force(model.groups[0], TAU, np.zeros(model.n_q), v, Q)
    K = helpers.dense_tangent(model, np.zeros(model.n_q))
    np.testing.assert_allclose(Q, TAU * K @ v, atol=1e-13 * TAU * (np.abs(K) @ np.abs(v)).max())


@helpers.every_variant
def test_rigid_motion_of_a_bent_body_meets_no_viscous_force(name, formulation):
    model = model_of(name, formulation)
    d, Q = state(model, 1, 0.4), np.zeros(model.n_q)
    w = turning(model, d, 5.0)
    w[np.flatnonzero(model.meshes["b"].kinds == 0)] += 2.0
    power = viscous_force(model.groups[0], TAU, d, w, Q)
    other = np.zeros(model.n_q)
    strained = viscous_force(model.groups[0], TAU, d, np.abs(w), other)
    assert power <= 1e-22 * strained
    assert np.abs(Q / model.weights).max() <= 1e-11 * np.abs(other / model.weights).max()


@helpers.every_variant
@pytest.mark.parametrize("turns", [1000.0, -1000.3])
def test_a_thousand_turns_dissipate_nothing(name, formulation, turns):
    EV = helpers.MATERIAL["E"] * 0.3 * 0.2 * 1.5
    for geometry in helpers.GEOMETRIES:
        model = model_of(name, formulation, geometry)
        d = helpers.rotate(np.zeros(model.n_q), model, 2.0 * np.pi * turns)
        # a rotation of 6000 rad is known to 1e-12, which is the strain between it and the position gradients
        assert energy(model, d) <= (1e-22 if helpers.TYPES[name].has_theta else 1e-28) * EV


def test_damping_times_are_those_of_the_material_and_of_rayleigh():
    material = {**helpers.MATERIAL, "damping": {"kelvin_voigt": 0.25}}
    spec, stiff = helpers.element("cable", 1), {"EA": 1.0, "EI": 1.0, "kGA": 1.0, "rhoA": 1.0}
    bodies = {
        "a": helpers.body(helpers.line(1.0), spec, material=material),
        "b": helpers.body(helpers.line(1.0), spec),
        "c": helpers.body(helpers.line(1.0), helpers.element("reissner2", 1), stiff),
    }
    solver = {"type": "dynamic", "t_end": 1, "dt": 0.1}
    assert [damping_time(helpers.build(bodies, solver).case, name) for name in bodies] == [0.25, 0.0, 0.0]
    damped = helpers.build(bodies, solver, damping={"rayleigh": {"beta": 0.5}})
    assert [damping_time(damped.case, name) for name in bodies] == [0.75, 0.5, 0.5]
    assert [pool.tau for pool in damped.pools] == [0.75, 0.5, 0.5]
