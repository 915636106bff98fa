"""Rotation of a section: derivatives, full turns, small angles, and conjugate moments."""

import helpers
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.elements.definition import derivative_order
from ancf2d.elements.registry import ELEMENTS
from ancf2d.model.determinacy import rigid_motion
from ancf2d.model.points import point_ref
from ancf2d.model.rotation import Rotation

PLACES = [(n, g, s) for n in helpers.KINDS.values() for g in helpers.GEOMETRIES for s in (0.0, 0.37, 1.0)]


def rotation_at(name: str, geometry: str, s: float):
    model = helpers.build(
        {"b": helpers.body(helpers.GEOMETRIES[geometry], helpers.element(name, 3))}, bc=[{"type": "clamp", "at": "b@0"}]
    )
    return model, Rotation(point_ref(model.meshes["b"], s))


@pytest.mark.parametrize(("name", "geometry", "s"), PLACES)
def test_the_gradient_is_the_derivative_of_the_angle(name, geometry, s):
    model, rotation = rotation_at(name, geometry, s)
    d = helpers.random_state(model, 0.05)[: model.n_q]
    e, h = model.e0 + d, 1e-6
    for k, c in enumerate(rotation.dofs):
        step = np.zeros(model.n_q)
        step[c] = h
        slope = (rotation.value(e + step, d + step) - rotation.value(e - step, d - step)) / (2 * h)
        assert rotation.gradient(e)[k] == pytest.approx(slope, abs=1e-8 * np.abs(rotation.gradient(e)).max())


@pytest.mark.parametrize(("name", "geometry", "s"), PLACES)
@settings(max_examples=4, deadline=None)
@given(angle=st.floats(-3, 3))
def test_a_rigid_rotation_turns_every_section_by_its_angle(name, geometry, s, angle):
    model, rotation = rotation_at(name, geometry, s)
    d = helpers.rotate(np.zeros(model.n_q), model, angle)
    assert rotation.value(model.e0 + d, d) == pytest.approx(angle, abs=1e-12)
    axes = rotation.axes(model.e0 + d, d)
    direction = rotation.point.angle + angle
    np.testing.assert_allclose(axes[:, 0], [np.cos(direction), np.sin(direction)], atol=1e-12)
    np.testing.assert_allclose(axes[:, 1], [-np.sin(direction), np.cos(direction)], atol=1e-12)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_full_turns_are_counted(name, sense):
    model, rotation = rotation_at(name, "arc", 0.37)
    near = 0.0
    for angle in sense * np.linspace(0, 25, 20):
        d = helpers.rotate(np.zeros(model.n_q), model, angle)
        near = rotation.value(model.e0 + d, d, near)
        assert near == pytest.approx(angle, abs=1e-11)


@pytest.mark.parametrize(("name", "geometry", "s"), PLACES)
def test_small_rotations_keep_their_digits(name, geometry, s):
    model, rotation = rotation_at(name, geometry, s)
    d = 1e-13 * helpers.random_state(model, 1.0)[: model.n_q]
    linear = rotation.linear(model.e0, d)
    assert linear != 0.0
    assert rotation.value(model.e0 + d, d) == pytest.approx(linear, rel=1e-10)


@pytest.mark.parametrize(("name", "geometry", "s"), PLACES)
def test_the_angle_is_conjugate_to_a_moment(name, geometry, s):
    """A unit moment does work 1 on a unit rotation and none on a translation."""
    model, rotation = rotation_at(name, geometry, s)
    e = model.e0 + helpers.random_state(model, 0.05)[: model.n_q]
    rates = rigid_motion(model.meshes["b"], rotation.dofs, e, np.array([0.3, 0.4]))
    np.testing.assert_allclose(rotation.gradient(e) @ rates, [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("name", ELEMENTS)
def test_nodal_derivatives_are_those_of_shape_functions(name):
    """At a node, the derivative that is a coordinate there is that of one shape function alone."""
    mesh = rotation_at(name, "line", 0.0)[0].meshes["b"]
    element, shape = mesh.plan.element, mesh.classes[0].sampler.shape
    for node, coordinate in element.functionals:
        # of the first of three elements
        point = point_ref(mesh, element.nodes[node].at / 3.0)
        assert point.node is not None
        order = derivative_order(coordinate)
        values = shape(np.array([point.xi]), np.zeros(1), *order)[0]
        assert point.shape_row(*order) / mesh.shape_weights == pytest.approx(values / mesh.shape_weights, rel=1e-12,
                                                                             abs=1e-12 / mesh.shape_weights.max())
