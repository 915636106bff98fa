"""Shape functions: nodality, completeness, derivatives, and the closed forms that the papers print."""

from dataclasses import replace
from math import factorial

import helpers
import numpy as np
import pytest

from ancf2d.elements.definition import coordinate_components, derivative_order, parse
from ancf2d.elements.registry import ELEMENTS, MAX_ORDER, ancf, element_type
from ancf2d.elements.shape import ShapeFunctions, UnsolvableBasisError, gauss, lobatto

L, H, NU = 0.7, 0.2, 0.3
POINTS = np.random.default_rng(1).uniform(size=(40, 2)) * [1, 2] - [0, 1]
XI, ETA = POINTS.T
X, Y = L * XI, H / 2 * ETA


def shape(name: str, l: float = L, h: float = H, nu: float = NU) -> ShapeFunctions:
    return ShapeFunctions(helpers.TYPES[name], l, h, nu)


def weight(coordinate: str, l: float = L, h: float = H) -> float:
    i, j = derivative_order(coordinate)
    return l**i * (h / 2) ** j / (factorial(i) * factorial(j))


def derivative(text: str, i: int, j: int, x, y, nu: float = NU):
    total = 0.0 * x
    for t in parse(text).terms:
        if t.i >= i and t.j >= j:
            fx, fy = factorial(t.i) / factorial(t.i - i), factorial(t.j) / factorial(t.j - j)
            total = total + t.coefficient * nu**t.nu * fx * fy * x ** (t.i - i) * y ** (t.j - j)
    return total


@pytest.mark.parametrize("slender", [0.01, 1.0, 100.0])
@pytest.mark.parametrize("name", helpers.TYPES)
def test_every_nodal_coordinate_picks_its_own_shape_function(name, slender):
    element, h = helpers.TYPES[name], L * slender
    S = shape(name, h=h)
    for a, (node, coordinate) in enumerate(element.functionals):
        i, j = derivative_order(coordinate)
        row = S(np.array([element.nodes[node].at]), np.zeros(1), i, j)[0]
        scaled = [
            v * weight(coordinate, h=h) / weight(c, h=h) for v, (_, c) in zip(row, element.functionals, strict=True)
        ]
        np.testing.assert_allclose(scaled, np.eye(element.n_shape)[a], atol=1e-12)


@pytest.mark.parametrize("order", [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2)])
@pytest.mark.parametrize("name", helpers.TYPES)
def test_interpolation_and_its_derivatives_reproduce_the_basis(name, order):
    element, S = helpers.TYPES[name], shape(name)
    for text in element.basis:
        e = []
        for node, coordinate in element.functionals:
            x = np.array(L * element.nodes[node].at)
            e.append(derivative(text, *derivative_order(coordinate), x, np.zeros(())))
        # Markov: a derivative of degree n is up to n^2 times as large as the function over the half length
        size = abs(derivative(text, 0, 0, np.array(L), np.array(H / 2)))
        size *= (2 * element.degree_x**2 / L) ** order[0] * (2 * max(element.degree_y, 1) ** 2 / H) ** order[1]
        np.testing.assert_allclose(S(XI, ETA, *order) @ np.array(e), derivative(text, *order, X, Y), atol=1e-11 * size)


@pytest.mark.parametrize("name", helpers.TYPES)
def test_positions_are_a_partition_of_unity_and_complete_to_first_order(name):
    element, S = helpers.TYPES[name], shape(name)(XI, ETA)
    ones = np.array([c == "r" for _, c in element.functionals], dtype=float)
    np.testing.assert_allclose(S @ ones, 1.0, atol=1e-13)
    values = {"r": lambda x: (x, 0.0), "r_x": lambda x: (1.0, 0.0), "r_y": lambda x: (0.0, 1.0)}
    e = np.array([values.get(c, lambda x: (0.0, 0.0))(L * element.nodes[n].at) for n, c in element.functionals])
    np.testing.assert_allclose(S @ e[:, 0], X, atol=1e-13)
    if element.degree_y > 0:
        np.testing.assert_allclose(S @ e[:, 1], Y, atol=1e-13)


def test_omar_is_equation_5_with_its_misprint_corrected():
    x, y, l = X, Y, L
    closed = [
        1 - 3 * x**2 / l**2 + 2 * x**3 / l**3,
        x - 2 * x**2 / l + x**3 / l**2,
        y * (1 - x / l),
        3 * x**2 / l**2 - 2 * x**3 / l**3,
        -(x**2) / l + x**3 / l**2,
        x * y / l,
    ]
    np.testing.assert_allclose(shape("omar")(XI, ETA), np.stack(closed, axis=1), atol=1e-14)
    printed_s5 = -(x**2) / l + x**3 / l
    assert np.abs(shape("omar")(XI, ETA)[:, 4] - printed_s5).max() > 0.01


def test_2d2n_is_equation_25():
    x, y, l, q = X, Y, L, X**2 + Y**2
    closed = [
        1 - 3 * q / l**2 + 2 * x**3 / l**3,
        x - 2 * q / l + x**3 / l**2,
        y * (1 - x / l),
        3 * q / l**2 - 2 * x**3 / l**3,
        -q / l + x**3 / l**2,
        x * y / l,
    ]
    np.testing.assert_allclose(shape("2d2n")(XI, ETA), np.stack(closed, axis=1), atol=1e-14)


def test_2d3n_is_equation_28():
    x, y, l, q = X, Y, L, X**2 + Y**2
    closed = [
        1 - 3 * x / l + 2 * q / l**2,
        y - 3 * x * y / l + 2 * x**2 * y / l**2,
        4 * x / l - 4 * q / l**2,
        4 * x * y / l - 4 * x**2 * y / l**2,
        -x / l + 2 * q / l**2,
        -x * y / l + 2 * x**2 * y / l**2,
    ]
    np.testing.assert_allclose(shape("2d3n")(XI, ETA), np.stack(closed, axis=1), atol=1e-14)


@pytest.mark.parametrize(("member", "name"), [((1, 1), "kerkkanen"), ((2, 1), "vallejo")])
def test_low_orders_of_the_family_are_the_published_elements(member, name):
    a, b = ancf(*member), ELEMENTS[name]
    assert a.functionals == b.functionals
    assert [n.at for n in a.nodes] == [n.at for n in b.nodes]
    np.testing.assert_allclose(ShapeFunctions(a, L, H, NU)(XI, ETA), shape(name)(XI, ETA), atol=1e-14)


@pytest.mark.parametrize("name", ["2d2n", "2d3n"])
def test_the_papers_common_coefficient_is_the_limit_nu_1_of_the_consistent_one(name):
    np.testing.assert_allclose(shape(f"{name}-nu", nu=1.0)(XI, ETA), shape(name)(XI, ETA), atol=1e-14)
    assert np.abs(shape(f"{name}-nu")(XI, ETA) - shape(name)(XI, ETA)).max() > 1e-3


def test_2d2n_depends_on_the_direction_of_its_axis_and_omar_does_not():
    """A symmetric element is itself after half a turn about its middle: x -> l - x, y -> -y, nodes exchanged."""
    swap, sign = [3, 4, 5, 0, 1, 2], [1, -1, -1, 1, -1, -1]
    for name, symmetric in (("omar", True), ("2d2n", False)):
        S = shape(name)
        turned = S(1 - XI, -ETA)[:, swap] * sign
        assert bool(np.abs(turned - S(XI, ETA)).max() < 1e-13) == symmetric


def test_a_term_outside_the_nodal_coordinates_of_li_is_refused():
    li = ELEMENTS["li"]
    with_x2y2 = replace(li, basis=(*li.basis[:-1], "x^2*y^2"))
    with pytest.raises(UnsolvableBasisError, match="vanishes in every nodal coordinate"):
        ShapeFunctions(with_x2y2, L, H, NU)


@pytest.mark.parametrize(
    "basis", [("1", "x", "y"), ("1", "x", "y", "x*y", "x^2"), ("1", "x", "y", "x+y"), ("1", "x", "y", "y^2")]
)
def test_a_basis_of_wrong_size_or_dependent_is_refused(basis):
    with pytest.raises(UnsolvableBasisError):
        ShapeFunctions(replace(ELEMENTS["kerkkanen"], basis=basis), L, H, NU)


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 12])
def test_gauss_points_are_exact_to_degree_2n_minus_1(n):
    x, w = gauss(n)
    for k in range(2 * n):
        assert w @ x**k == pytest.approx(1 / (k + 1), rel=1e-13)
    assert abs(w @ x ** (2 * n) - 1 / (2 * n + 1)) > 1e-17


@pytest.mark.parametrize("n", [2, 3, 4, 6, 9])
def test_lobatto_points_include_the_ends_and_are_exact_to_degree_2n_minus_3(n):
    x, w = lobatto(n)
    assert (x[0], x[-1]) == (0.0, 1.0)
    np.testing.assert_allclose(x, 1 - x[::-1], atol=1e-15)
    for k in range(2 * n - 2):
        assert w @ x**k == pytest.approx(1 / (k + 1), rel=1e-12)


@pytest.mark.parametrize(
    ("name", "order"), [("r", (0, 0)), ("r_x", (1, 0)), ("r_y", (0, 1)), ("r_xy", (1, 1)), ("r_yyy", (0, 3))]
)
def test_nodal_coordinates_name_a_derivative(name, order):
    assert derivative_order(name) == order


@pytest.mark.parametrize("name", ["", "r_", "rx", "theta", "r_z", "r_yx", "s"])
def test_other_names_are_no_nodal_coordinate(name):
    with pytest.raises(ValueError, match="is not a nodal coordinate"):
        derivative_order(name)


def test_components_are_named_as_in_case_files():
    assert coordinate_components("r", theta=False) == ("x", "y")
    assert coordinate_components("r", theta=True) == ("x", "y", "theta")
    assert coordinate_components("r_xy", theta=False) == ("rxy_x", "rxy_y")


def test_orders_outside_the_family_are_refused():
    for order in ((0, 1), (1, 0), (MAX_ORDER[0] + 1, 1), (1, MAX_ORDER[1] + 1)):
        with pytest.raises(ValueError, match="outside"):
            ancf(*order)
    with pytest.raises(KeyError):
        element_type("no such element")
