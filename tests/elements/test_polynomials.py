"""Basis functions as text: accepted and refused texts, and shifted coefficients."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ancf2d.elements.definition import MAX_DEGREE, parse


def value(text: str, nu: float, x: float, y: float, l: float = 1.7, half: float = 0.3) -> float:
    xi, eta = 2 * x / l - 1, y / half
    return float(sum(c * xi**i * eta**j for (i, j), c in parse(text).coefficients(nu, l, half).items()))


@pytest.mark.parametrize(
    ("text", "function"),
    [
        ("1", lambda x, y, nu: 1.0),
        ("x", lambda x, y, nu: x),
        ("x*y", lambda x, y, nu: x * y),
        ("x^2 + nu*y^2", lambda x, y, nu: x**2 + nu * y**2),
        ("x**2+y**2", lambda x, y, nu: x**2 + y**2),
        ("-2.5*x^3 + 4*x*y - y", lambda x, y, nu: -2.5 * x**3 + 4 * x * y - y),
        ("nu^2*x*x*y", lambda x, y, nu: nu**2 * x**2 * y),
        ("x^0*y^1", lambda x, y, nu: y),
        (" 3 * y ", lambda x, y, nu: 3 * y),
    ],
)
def test_a_text_is_the_polynomial_it_writes(text, function):
    for x, y in ((0.0, 0.0), (0.4, -0.2), (1.7, 0.3)):
        assert value(text, 0.3, x, y) == pytest.approx(function(x, y, 0.3), abs=1e-14)


def test_degrees_are_the_highest_powers():
    p = parse("x^2*y + x*y^3")
    assert (p.degree_x, p.degree_y) == (2, 3)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "z",
        "x+",
        "x y",
        "x^y",
        "x^-1",
        "x/2",
        "2x",
        "sin(x)",
        "(x)",
        "x^2.5",
        "x**",
        "*x",
        "1e3*x",
        "__import__('os')",
        "x" * 300,
    ],
)
def test_other_texts_are_refused(text):
    with pytest.raises(ValueError, match=r"."):
        parse(text)


def test_powers_are_bounded():
    assert parse(f"x^{MAX_DEGREE}").degree_x == MAX_DEGREE
    with pytest.raises(ValueError, match="powers above"):
        parse(f"x^{MAX_DEGREE}*x")


@given(
    st.lists(st.tuples(st.integers(-9, 9), st.integers(0, 5), st.integers(0, 4)), min_size=1, max_size=5),
    st.floats(0.1, 10),
    st.floats(0.01, 10),
    st.floats(0, 1),
    st.floats(-1, 1),
)
@pytest.mark.slow
def test_shifted_and_scaled_coefficients_are_the_same_polynomial(terms, l, half, xi01, eta):
    text = " + ".join(f"{abs(c)}*x^{i}*y^{j}" for c, i, j in terms)
    x, y = l * xi01, half * eta
    parts = [abs(c) * x**i * y**j for c, i, j in terms]
    size = sum(abs(c) * l**i * half**j for c, i, j in terms)
    assert value(text, 0.0, x, y, l, half) == pytest.approx(sum(parts), abs=1e-12 * size + 1e-300)


def test_coefficients_are_carried_in_extended_precision():
    assert all(isinstance(c, np.longdouble) for c in parse("x^2 + nu*y^2").coefficients(0.3, 1.0, 0.1).values())
