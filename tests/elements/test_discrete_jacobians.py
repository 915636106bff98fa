"""Discrete Jacobians between two states: exact strain increments, invariance to rotation, derivatives in the limit."""

import helpers
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_strain_functions import TYPE_OF, evaluate, law_of

from ancf2d.elements.formulations import FORMULATIONS

CONSERVING = [f.name for f in FORMULATIONS.values() if f.law.mean is not None]
CASES = [(f, g) for f in CONSERVING for g in helpers.GEOMETRIES]
# the arc is the general case
EVERY = pytest.mark.parametrize(("formulation", "geometry"), helpers.chosen(CASES, [(f, "arc") for f in CONSERVING]))
SEEDS = st.integers(0, 2**32 - 1)
LAWS: dict = {}


def law(formulation: str, geometry: str):
    return LAWS.setdefault((formulation, geometry), law_of(formulation, geometry))


def discrete(formulation: str, law, station: int, u0, u1):
    """Return eps1 - eps0 and J from the matrix that ``strain`` fills."""
    (eps0, _), (eps1, J) = (evaluate(formulation, law, station, u) for u in (u0, u1))
    point = FORMULATIONS[formulation].law
    n, m, k = point.fields, point.strains, point.references
    for p in range(len(u0) // n):
        own, strains = slice(p * n, p * n + n), slice(p * m, p * m + m)
        point.mean(law.ref[0, p * k:(p + 1) * k, station:station + 1], u0[own, None], u1[own, None],
                   eps0[strains, None], eps1[strains, None], J[strains, own, None], 1)
    return eps1 - eps0, J


def position_gradients(law, station: int, u):
    """Return the fields of the deformed body: each displacement field (x, y) added to its reference."""
    return (law.ref[0, :, station] + u).reshape(-1, 2)


@EVERY
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, size=st.floats(-8, 0))
def test_increment_of_strain_is_exact(formulation, geometry, seed, size):
    """Also for small increments at large displacements: only the round-off of the two strains remains."""
    sampled = law(formulation, geometry)
    rng = np.random.default_rng(seed)
    station = int(rng.integers(sampled.B.shape[2]))
    u0 = rng.uniform(-0.4, 0.4, sampled.B.shape[1])
    u1 = u0 + 10.0**size * rng.uniform(-0.4, 0.4, len(u0))
    increment, J = discrete(formulation, sampled, station, u0, u1)
    round_off = 1e-14 * (np.abs(J).max() * 2.0 + np.abs(J) @ np.abs(u1 - u0))
    assert np.all(np.abs(J @ (u1 - u0) - increment) <= round_off)


@EVERY
@settings(max_examples=8, deadline=None)
@given(seed=SEEDS)
def test_turning_the_mid_configuration_makes_no_strain(formulation, geometry, seed):
    sampled = law(formulation, geometry)
    rng = np.random.default_rng(seed)
    u0, u1 = rng.uniform(-0.4, 0.4, (2, sampled.B.shape[1]))
    _, J = discrete(formulation, sampled, 0, u0, u1)
    f = position_gradients(sampled, 0, 0.5 * (u0 + u1))
    turned = np.stack([-f[:, 1], f[:, 0]], axis=1).ravel()
    assert np.all(np.abs(J @ turned) <= 1e-14 * np.abs(J).max() * np.abs(turned).max())


@pytest.mark.parametrize(("formulation", "geometry"), CASES)
def test_the_order_of_the_two_states_does_not_matter(formulation, geometry):
    sampled = law(formulation, geometry)
    u0, u1 = np.random.default_rng(7).uniform(-0.4, 0.4, (2, sampled.B.shape[1]))
    np.testing.assert_allclose(
        discrete(formulation, sampled, 0, u0, u1)[1], discrete(formulation, sampled, 0, u1, u0)[1], rtol=1e-13
    )


@pytest.mark.parametrize(("formulation", "geometry"), CASES)
def test_equal_states_give_the_derivative_of_the_strain(formulation, geometry):
    sampled = law(formulation, geometry)
    u = np.random.default_rng(8).uniform(-0.4, 0.4, sampled.B.shape[1])
    np.testing.assert_allclose(
        discrete(formulation, sampled, 0, u, u)[1], evaluate(formulation, sampled, 0, u)[1], rtol=1e-13, atol=1e-14
    )


def test_only_the_interpolated_rotation_has_no_form_that_keeps_both():
    assert set(FORMULATIONS) - set(CONSERVING) == {"geometrically_exact"}
    assert set(CONSERVING) <= set(TYPE_OF)
