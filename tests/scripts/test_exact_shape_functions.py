"""The printed shape functions are those of the elements."""

from __future__ import annotations

import re

import numpy as np
import pytest

from ancf2d.elements.registry import ELEMENTS
from ancf2d.elements.shape import ShapeFunctions
from scripts import shape_functions


@pytest.mark.parametrize("name", ELEMENTS)
def test_printed_functions_have_the_values_of_the_element(name: str) -> None:
    kind, l, h, nu = ELEMENTS[name], 1.7, 0.6, 0.3
    rng = np.random.default_rng(5)
    x, y = l * rng.random(7), h * (rng.random(7) - 0.5)
    if not any(p.degree_y for p in kind.polynomials):
        y[:] = 0.0
    printed = []
    for line in shape_functions.report(kind).splitlines()[1:]:
        formula = re.split(r" at [\d.]+ +", line)[1]
        formula = formula.replace("^", "**").replace(" + ", "+").replace(" - ", "-")
        # a product is written as a blank
        formula = re.sub(r"(?<=[\w)]) (?=[\w(])", "*", formula)
        printed.append(eval(formula, {}, {"xi": x / l, "eta": y / l, "l": l, "nu": nu}) + 0 * x)
    S = ShapeFunctions(kind, l, h, nu)(x / l, 2 * y / h)
    np.testing.assert_allclose(np.array(printed).T, S, atol=1e-13)
