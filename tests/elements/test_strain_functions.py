"""Strains as functions of the gradient fields: derivatives by complex step, objectivity, small strain."""

import helpers
import numpy as np
import pytest

from ancf2d.elements.formulations import FORMULATIONS, strains_at

STEP = 1e-30
CASES = [(f.name, geometry) for f in FORMULATIONS.values() for geometry in helpers.GEOMETRIES]
TYPE_OF = {f: next(n for n, g in helpers.VARIANTS if g == f) for f in FORMULATIONS}


def law_of(formulation: str, geometry: str):
    spec = helpers.element(TYPE_OF[formulation], 2, formulation)
    model = helpers.build({"b": helpers.body(helpers.GEOMETRIES[geometry], spec)}, bc=[{"type": "clamp", "at": "b@0"}])
    return model.groups[0].law


def evaluate(formulation: str, law, station: int, u):
    return strains_at(FORMULATIONS[formulation], law.ref[0, :, station], u)


def fields(law, seed: int):
    return np.random.default_rng(seed).uniform(-0.4, 0.4, law.B.shape[1])


@pytest.mark.parametrize(("formulation", "geometry"), CASES)
def test_jacobian_is_the_derivative_of_the_strain(formulation, geometry):
    law = law_of(formulation, geometry)
    for station in (0, law.B.shape[2] - 1):
        u = fields(law, station)
        _, J = evaluate(formulation, law, station, u)
        for i in range(len(u)):
            v = u.astype(complex)
            v[i] += 1j * STEP
            np.testing.assert_allclose(
                J[:, i], evaluate(formulation, law, station, v)[0].imag / STEP, rtol=1e-12, atol=1e-13
            )


@pytest.mark.parametrize(("formulation", "geometry"), CASES)
def test_geometric_matrix_is_the_second_derivative_along_the_stress(formulation, geometry):
    law = law_of(formulation, geometry)
    u = fields(law, 3)
    point = FORMULATIONS[formulation].law
    n, m = point.fields, point.strains
    sigma = np.random.default_rng(4).uniform(-1, 1, law.D.shape[1])
    _, J = evaluate(formulation, law, 0, u)
    for p in range(len(u) // n):
        own, strains = slice(p * n, p * n + n), slice(p * m, p * m + m)
        H = np.ones((n, n, 1))
        ref = law.ref[0, p * point.references:(p + 1) * point.references, :1]
        point.geometric(ref, u[own, None], sigma[strains, None], J[strains, own, None], H, 1)
        H = np.triu(H[..., 0] - 1.0)
        H += np.triu(H, 1).T
        for i in range(n):
            v = u.astype(complex)
            v[p * n + i] += 1j * STEP
            _, along = evaluate(formulation, law, 0, v)
            wanted = sigma[strains] @ along[strains, own].imag / STEP
            np.testing.assert_allclose(H[:, i], wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("formulation", "geometry"), CASES)
def test_small_strains_keep_their_digits(formulation, geometry):
    """(J^T J - I)/2 would keep three digits of a strain of 1e-13; computed from displacements it keeps all."""
    law = law_of(formulation, geometry)
    u = 1e-13 * fields(law, 5)
    eps, _ = evaluate(formulation, law, 0, u)
    _, J0 = evaluate(formulation, law, 0, 0 * u)
    np.testing.assert_allclose(eps, J0 @ u, atol=1e-11 * np.abs(J0 @ u).max())


@pytest.mark.parametrize(("formulation", "geometry"), CASES)
def test_no_displacement_is_no_strain_exactly(formulation, geometry):
    law = law_of(formulation, geometry)
    eps, _ = evaluate(formulation, law, 0, np.zeros(law.B.shape[1]))
    assert not eps.any()


def test_every_formulation_has_an_element_type_and_refuses_others_with_a_reason():
    for f in FORMULATIONS.values():
        reasons = [f.refuse(t) for t in helpers.TYPES.values()]
        assert None in reasons
        assert all(r is None or len(r) > 20 for r in reasons)


def test_structural_is_refused_if_a_coordinate_would_have_no_stiffness():
    refused = {n for n, t in helpers.TYPES.items() if FORMULATIONS["structural"].refuse(t) is not None}
    assert {"2d2n", "2d3n", "2d2n-nu", "2d3n-nu", "patel", "ancf[1,2]", "ancf[2,2]", "ancf[3,3]"} <= refused
    assert not refused & {"omar", "kerkkanen", "vallejo", "li", "ancf[3,1]"}


@pytest.mark.parametrize("formulation", ["enhanced", "strain_split"])
def test_splits_are_refused_if_they_would_fail_in_uniaxial_tension(formulation):
    """Coupling on the axis only is the mean over the section if eps_yy is linear in y."""
    refused = {n for n, t in helpers.TYPES.items() if FORMULATIONS[formulation].refuse(t) is not None}
    assert {"ancf[3,3]", "ancf[8,5]", "2d2n", "2d3n", "cable", "reissner3"} <= refused
    assert not refused & {"omar", "kerkkanen", "vallejo", "li", "patel", "ancf[1,2]", "ancf[2,2]"}


@pytest.mark.parametrize("name", helpers.TYPES)
def test_the_default_formulation_of_a_type_is_one_it_offers(name):
    element = helpers.TYPES[name]
    assert FORMULATIONS[element.formulation].refuse(element) is None
