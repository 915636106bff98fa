"""Mass matrices and weights: total mass, kinetic energy of rigid motion, weight consistent with mass."""

from types import SimpleNamespace

import helpers
import numpy as np
import pytest

from ancf2d.interactions.inertia import mass_terms
from ancf2d.model.classes import ElementClass, mass_matrix
from ancf2d.model.determinacy import rigid_motion
from ancf2d.model.mesh import BodyMesh
from ancf2d.model.points import point_ref

H, B, RHO = helpers.SECTION["height"], helpers.SECTION["width"], helpers.MATERIAL["rho"]
A, I = H * B, B * H**3 / 12


def mesh_of(name: str, geometry: dict, count: int) -> BodyMesh:
    model = helpers.build(
        {"b": helpers.body(geometry, helpers.element(name, count))}, bc=[{"type": "clamp", "at": "b@0"}]
    )
    return model.meshes["b"]


def rigid_inertia(mesh: BodyMesh, centre) -> np.ndarray:
    """Return V^T M V (3, 3) for the rates V of unit translations and rotation about ``centre``."""
    out = np.zeros((3, 3))
    for dofs, k in zip(mesh.dofs, mesh.cls, strict=True):
        V = rigid_motion(mesh, dofs, mesh.e0, np.asarray(centre))
        # scalar shape functions: the matrix is the same in every frame
        out += V.T @ mass_matrix(mesh.classes[k].sampler) @ V
    return out


def section_inertia(name: str) -> float:
    return 0.0 if helpers.TYPES[name].section_kind == "tangent" else RHO * I


@pytest.mark.parametrize("name", helpers.TYPES)
def test_kinetic_energy_of_rigid_motion_of_a_straight_body_is_exact(name):
    mesh = mesh_of(name, helpers.line(1.7, 0.6), 3)
    middle = mesh.plan.position(0.5)[0]
    m, J = RHO * A * 1.7, RHO * A * 1.7**3 / 12 + section_inertia(name) * 1.7
    np.testing.assert_allclose(rigid_inertia(mesh, middle), np.diag([m, m, J]), rtol=1e-11, atol=1e-12 * m)


@pytest.mark.parametrize("name", helpers.TYPES)
def test_kinetic_energy_of_rigid_motion_of_an_arc_converges_to_that_of_the_annulus(name):
    R, sweep = helpers.ARC["radius"], 1.2
    errors = []
    for count in (8, 16):
        inertia = rigid_inertia(mesh_of(name, helpers.ARC, count), helpers.ARC["center"])
        m = RHO * A * R * sweep
        if helpers.TYPES[name].section_kind == "interpolated":
            J = RHO * B * sweep * ((R + H / 2) ** 4 - (R - H / 2) ** 4) / 4
        else:
            J = m * R**2 + section_inertia(name) * R * sweep
        assert inertia[0, 0] == pytest.approx(inertia[1, 1], rel=1e-13)
        assert inertia[0, 1] == pytest.approx(0, abs=1e-12 * m)
        errors.append(max(abs(inertia[0, 0] / m - 1), abs(inertia[2, 2] / J - 1)))
    if helpers.TYPES[name].common_coefficients:
        # its reference sections are curved on an arc: another body, by the square of height over radius
        assert errors[1] < 0.5 * (H / R) ** 2
        return
    assert errors[1] < 2e-3
    assert errors[1] < 0.3 * errors[0] or errors[1] < 1e-10


@pytest.mark.parametrize("name", helpers.TYPES)
def test_mass_matrix_is_symmetric_and_positive(name):
    mesh = mesh_of(name, helpers.ARC, 2)
    M = mass_matrix(mesh.classes[0].sampler)
    np.testing.assert_allclose(M, M.T, atol=1e-15 * np.abs(M).max())
    scale = np.sqrt(np.diag(M))
    used = scale > 0
    if helpers.TYPES[name].section_kind != "tangent":
        assert used.all()
    assert np.linalg.eigvalsh((M / np.outer(scale, scale))[np.ix_(used, used)]).min() > 1e-14


@pytest.mark.parametrize("geometry", helpers.GEOMETRIES)
@pytest.mark.parametrize("name", helpers.TYPES)
def test_weight_is_the_mass_matrix_times_a_uniform_acceleration(name, geometry):
    mesh = mesh_of(name, helpers.GEOMETRIES[geometry], 2)
    sampler, nc = mesh.classes[0].sampler, mesh.plan.element.components
    ones = np.zeros(mesh.plan.element.n_dof)
    ones[::nc] = [c == "r" for _, c in mesh.plan.element.functionals]
    weights = ElementClass(sampler, (), 0.0).mass_weights
    np.testing.assert_allclose(weights, (mass_matrix(sampler) @ ones)[::nc], atol=1e-14)


@pytest.mark.parametrize("name", ["vallejo", "cable"])
def test_the_inertia_of_a_point_mass_between_the_nodes_of_an_arc_turns_with_its_section(name):
    """The interpolated direction there is not a unit vector."""
    bodies = {"b": helpers.body(helpers.ARC, helpers.element(name, 1))}
    model = helpers.build(bodies, bc=[{"type": "clamp", "at": "b@0"}])
    _, term = mass_terms(SimpleNamespace(mass=2.0, inertia=0.7), point_ref(model.meshes["b"], 0.31))
    turning = np.stack([-model.e0[1::2], model.e0[0::2]], axis=1).ravel()
    twice_kinetic = term.inertia * sum((weights @ turning[coords]) ** 2 for coords, weights in term.columns)
    assert twice_kinetic == pytest.approx(0.7, rel=1e-12)
