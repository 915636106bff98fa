"""Element forces and tangents: gradient of the energy, objectivity, small strains, zero-energy modes."""

import math

import helpers
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.kernels.elements import element_matrices, force, force_noise, force_tangent, stations, tangent_action
from ancf2d.kernels.matrices.layout import Places
from ancf2d.kernels.matrices.matrix import Csr

EVERY = helpers.covering({"variant": helpers.FEW_VARIANTS}, variant=helpers.VARIANTS, geometry=helpers.GEOMETRIES)
SIZE = 0.05 * helpers.SECTION["height"]


def model_of(name: str, formulation: str | None, geometry, count: int = 2, **more):
    shape = helpers.GEOMETRIES.get(geometry, geometry) if isinstance(geometry, str) else geometry
    section, material = more.pop("section", None), more.pop("material", None)
    spec = helpers.element(name, count, formulation, **more)
    return helpers.build({"b": helpers.body(shape, spec, section, material)}, bc=[{"type": "clamp", "at": "b@0"}])


def energy_and_force(model, d):
    Q = np.zeros(model.n_q)
    return force(model.groups[0], d, Q), Q


@EVERY
def test_force_is_the_gradient_of_the_energy(name, formulation, geometry):
    model = model_of(name, formulation, geometry)
    d = helpers.random_state(model, SIZE)[: model.n_q]
    _, Q = energy_and_force(model, d)
    for seed in (1, 2):
        v = helpers.random_state(model, 1.0, seed)[: model.n_q]
        # the difference quotient of a quartic (or close to one) by Richardson's extrapolation
        slopes = [
            (energy_and_force(model, d + h * v)[0] - energy_and_force(model, d - h * v)[0]) / (2 * h)
            for h in (2e-4 * SIZE, 1e-4 * SIZE)
        ]
        assert (4 * slopes[1] - slopes[0]) / 3 == pytest.approx(Q @ v, abs=1e-6 * np.abs(Q * v).sum())


@EVERY
def test_tangent_is_the_derivative_of_the_force_and_symmetric(name, formulation, geometry):
    model = model_of(name, formulation, geometry)
    d = helpers.random_state(model, SIZE)[: model.n_q]
    K = helpers.dense_tangent(model, d)
    np.testing.assert_allclose(K, K.T, atol=1e-14 * np.abs(K).max())
    v, h = helpers.random_state(model, 1.0, 3)[: model.n_q], 1e-5 * SIZE
    slope = (energy_and_force(model, d + h * v)[1] - energy_and_force(model, d - h * v)[1]) / (2 * h)
    # each row against its own terms, so that high gradients count as much as positions
    assert np.max(np.abs(slope - K @ v) / (np.abs(K) @ np.abs(v))) < 1e-7


@helpers.every_variant
@settings(max_examples=3, deadline=None)
@given(angle=st.floats(-20, 20), x=st.floats(-3, 3), y=st.floats(-3, 3))
def test_rigid_motion_costs_nothing(name, formulation, angle, x, y):
    for geometry in helpers.GEOMETRIES:
        model = RIGID.setdefault((name, formulation, geometry), model_of(name, formulation, geometry))
        d = helpers.rotate(np.zeros(model.n_q), model, angle, (x, y))
        energy, Q = energy_and_force(model, d)
        EV = helpers.MATERIAL["E"] * 0.3 * 0.2 * 1.5
        assert energy <= 1e-25 * EV
        assert np.abs(Q / model.weights).max() <= 1e-12 * EV / 0.1**2


RIGID: dict = {}


@helpers.every_variant
@settings(max_examples=4, deadline=None)
@given(angle=st.floats(-7, 7))
def test_energy_and_force_turn_with_the_body(name, formulation, angle):
    model = RIGID.setdefault((name, formulation, "arc"), model_of(name, formulation, "arc"))
    d = helpers.random_state(model, SIZE)[: model.n_q]
    energy, Q = energy_and_force(model, d)
    turned_energy, turned_Q = energy_and_force(model, helpers.rotate(d, model, angle, (0.7, -0.4)))
    assert turned_energy == pytest.approx(energy, rel=1e-11)
    as_coordinates = helpers.rotate(Q - model.e0, model, angle) + model.e0
    theta = model.meshes["b"].kinds == 2
    as_coordinates[theta] = Q[theta]
    np.testing.assert_allclose(
        turned_Q * model.weights**-1, as_coordinates * model.weights**-1, atol=1e-10 * np.abs(Q / model.weights).max()
    )


@pytest.mark.parametrize("name", helpers.TYPES)
def test_reference_arcs_are_free_of_stress(name):
    model = model_of(name, None, "arc")
    energy, Q = energy_and_force(model, np.zeros(model.n_q))
    assert energy == 0.0
    assert not Q.any()


@helpers.every_variant
def test_a_uniaxial_strain_of_1e_12_keeps_its_digits(name, formulation):
    """EA eps^2 L/2 of a stiff beam: (J^T J - I)/2 with eps = 1e-12 would have only four correct digits."""
    strain, E, h, b, L = 1e-12, 2.07e11, 0.1, 0.2, 2.0
    model = model_of(
        name,
        formulation,
        helpers.line(L),
        3,
        section={"height": h, "width": b},
        material={"E": E, "nu": 0.0, "rho": 1.0},
    )
    mesh, d = model.meshes["b"], np.zeros(model.n_q)
    local = {"r": lambda x: strain * x, "r_x": lambda x: strain}
    for ie, dofs in enumerate(mesh.dofs):
        for k, (node, coordinate) in enumerate(mesh.plan.element.functionals):
            x = L / 3 * (ie + mesh.plan.element.nodes[node].at)
            d[dofs[mesh.plan.element.components * k]] = local.get(coordinate, lambda x: 0.0)(x)
    energy, _ = energy_and_force(model, d)
    assert energy == pytest.approx(0.5 * E * h * b * strain**2 * L, rel=1e-10)


def zero_modes(name: str, formulation: str | None, geometry: str, **more) -> int:
    """Count the zero-energy modes of a free body of three elements, beyond the three rigid ones."""
    model = model_of(name, formulation, geometry, 3, **more)
    K = helpers.dense_tangent(model, np.zeros(model.n_q))
    scale = 1 / np.sqrt(np.diag(K))
    values = np.linalg.eigvalsh(K * np.outer(scale, scale))
    return int((values < 1e-11 * values[-1]).sum()) - 3


def element_zero_modes(name: str, formulation: str, quadrature, **more) -> int:
    """Count the zero-energy modes of one free element, beyond the three rigid ones; ``quadrature`` None: default."""
    more.update({} if quadrature is None else {"quadrature": quadrature})
    model = model_of(name, formulation, "line", 1, **more)
    K = helpers.dense_tangent(model, np.zeros(model.n_q))
    scale = 1 / np.sqrt(np.diag(K))
    values = np.linalg.eigvalsh(K * np.outer(scale, scale))
    return int((values < 1e-11 * values[-1]).sum()) - 3


@pytest.mark.parametrize("geometry", helpers.GEOMETRIES)
@helpers.every_variant
def test_the_default_rule_leaves_only_rigid_motions_without_energy(name, formulation, geometry):
    assert zero_modes(name, formulation, geometry) == 0


@helpers.every_variant
def test_the_default_rule_has_no_hidden_modes_for_any_poissons_ratio(name, formulation):
    """Coefficients of the basis can depend on nu; the default rule must suit all of them."""
    for nu in (-0.5, 0.0, 1e-3, 0.3, 0.45):
        found = element_zero_modes(name, formulation, None, material={"E": 5.0, "nu": nu, "rho": 1.3})
        assert found == 0, nu


def test_linear_elements_with_bending_sections_have_two_points_along():
    """With straight sections one point has no hidden modes; with y^2 in the basis, one point would have some."""
    assert element_zero_modes("ancf[1,1]", "continuum", None) == 0
    assert element_zero_modes("ancf[1,2]", "continuum", None) == 0
    assert element_zero_modes("ancf[1,2]", "continuum", [1, 3]) > 0


@pytest.mark.parametrize(("name", "hidden"), [("omar", 2), ("patel", 2), ("li", 3), ("vallejo", 0), ("2d3n", 0)])
def test_two_by_two_points_have_the_predicted_number_of_hidden_modes(name, hidden):
    assert element_zero_modes(name, "continuum", [2, 2]) == hidden


@pytest.mark.parametrize(("name", "formulation", "geometry"), helpers.chosen([(*v, "arc") for v in helpers.DEFAULTS],
                                                                        helpers.FEW_VARIANTS))
def test_assembled_tangent_and_its_action_are_the_sum_of_element_matrices(name, formulation, geometry):
    model = model_of(name, formulation, geometry, 3)
    n, d = model.n_q, helpers.random_state(model, SIZE)[: model.n_q]
    K = helpers.dense_tangent(model, d)
    values = np.zeros(n * n)
    matrix = Csr(values, n * np.arange(n + 1), np.tile(np.arange(n), n))
    none = np.zeros(0, dtype=np.int64)
    Q = np.zeros(n)
    energy = force_tangent(model.groups[0], d, 1.0, Q, matrix, Places(np.arange(n), none, none, np.zeros(0)))
    np.testing.assert_allclose(values.reshape(n, n), K, atol=1e-14 * np.abs(K).max())
    expected, F = energy_and_force(model, d)
    assert energy == pytest.approx(expected, rel=1e-14)
    np.testing.assert_allclose(Q, F, atol=1e-14 * np.abs(F).max())
    v, action = helpers.random_state(model, 1.0, 6)[:n], np.zeros(n)
    tangent_action(model.groups[0], d, v, action)
    np.testing.assert_allclose(action, K @ v, atol=1e-14 * (np.abs(K) @ np.abs(v)).max())


def test_station_values_give_the_energy():
    model = model_of("vallejo", "enhanced", "arc", 3)
    group, d = model.groups[0], helpers.random_state(model, SIZE)
    shape = (3, group.law.B.shape[2], group.law.D.shape[1])
    eps, sigma = np.zeros(shape), np.zeros(shape)
    stations(group, d, eps, sigma)
    assert 0.5 * np.sum(eps * sigma) == pytest.approx(energy_and_force(model, d)[0], rel=1e-13)


@EVERY
def test_tangents_of_translations_vanish_to_the_last_bit(name, formulation, geometry):
    """The entries of nodes' positions sum to zero: otherwise a million elements would add up round-off."""
    model = model_of(name, formulation, geometry, 3)
    group, d = model.groups[0], helpers.random_state(model, SIZE)[: model.n_q]
    ne, n = group.dofs.shape
    Q, K = np.zeros((ne, n)), np.zeros((ne, n, n))
    element_matrices(group, d, Q, K)
    np.testing.assert_array_equal(K, np.swapaxes(K, 1, 2))
    element = model.meshes["b"].plan.element
    nc, positions = element.components, [k for k, (_, kind) in enumerate(element.functionals) if kind == "r"]
    columns = np.add.outer([0, 1], [nc * k for k in positions])
    rows = columns.ravel() if len(positions) > 2 else range(n)
    for Ke in K:
        assert all(math.fsum(Ke[a, some]) == 0.0 for a in rows for some in columns)


@helpers.every_variant
def test_the_round_off_bound_turns_with_the_body(name, formulation):
    """A beam along y in the state of one along x: the same bounds, with y and x exchanged."""
    noises = []
    for turned in (False, True):
        model = model_of(name, formulation, {"type": "line", "start": [0, 0], "end": [0, 1.5] if turned else [1.5, 0]})
        nc, n = model.meshes["b"].plan.element.components, model.n_q
        d = helpers.random_state(model, SIZE)[:n].reshape(-1, nc)
        d[:, 1] *= 1e-3
        d[:, :2] = d[:, 1::-1] * [-1.0, 1.0] if turned else d[:, :2]
        out = np.zeros(n)
        force_noise(model.groups[0], d.ravel().copy(), out)
        out = out.reshape(-1, nc)
        out[:, :2] = out[:, 1::-1] if turned else out[:, :2]
        noises.append(out)
    np.testing.assert_allclose(noises[1], noises[0], rtol=1e-6)
