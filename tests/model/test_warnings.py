"""What a user is told of a model that will run but may mislead."""

from __future__ import annotations

import pytest

from ancf2d.case import load_case_text
from ancf2d.model.build import build_model

CASE = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [2, 0]}}
    section: {{height: {height}, width: 0.1}}
    material: {{E: 2e11, nu: 0.3}}
    element: {{{element}, count: 8}}
boundary_conditions: [{{type: clamp, at: beam@0, hold: {hold}}}]
solver: {{type: static}}
"""


def warnings(element: str, height: float, hold: str = "all") -> list[str]:
    element = element if element.startswith("type:") else f"type: {element}"
    return build_model(load_case_text(CASE.format(element=element, height=height, hold=hold))).warnings


@pytest.mark.parametrize(("element", "thick", "thin"), [
    ("omar", 0.01, 0.001), ("2d2n", 0.1, 0.01), ("2d3n", 0.6, 0.1), ("li", 0.01, 0.001),
    ("2d3n-nu", 0.1, 0.01)])
def test_elements_that_lock_when_long_beside_their_height_say_so(element: str, thick: float, thin: float) -> None:
    assert not warnings(element, thick)
    (said,) = warnings(element, thin)
    assert "too stiff in bending" in said


@pytest.mark.parametrize("element", ["vallejo", "reissner3", "cable", "kerkkanen"])
def test_elements_without_such_a_bound_say_nothing(element: str) -> None:
    assert not warnings(element, 1e-5, "section")


def test_a_section_clamp_that_leaves_the_warping_free_says_so() -> None:
    assert "leaves the warping coordinates" in warnings("ancf, order: [3, 3]", 0.1, "section")[0]
    assert not warnings("ancf, order: [3, 3]", 0.1, "breathe")


@pytest.mark.parametrize(("element", "off"), [
    ("type: patel, formulation: enhanced", "11.2"), ("type: ancf, order: [2, 2], formulation: enhanced", "11.2"),
    ("type: patel", None), ("type: omar", None), ("type: ancf, order: [3, 3]", None)])
def test_a_short_body_whose_law_is_wrong_across_says_so(element: str, off: str | None) -> None:
    """The coupling on the axis alone is escaped by a stretch along that varies with y^2."""
    said = [w for w in warnings(element, 200.0, "breathe") if "loaded across" in w]
    assert len(said) == (off is not None)
    assert off is None or f"is off by {off} % where so short a body is loaded across, at nu = 0.3" in said[0]
    assert not [w for w in warnings(element, 1.5, "breathe") if "loaded across" in w]


@pytest.mark.parametrize("element", ["2d2n", "2d3n", "2d2n-nu", "2d3n-nu"])
def test_a_short_body_whose_neighbours_part_says_so(element: str) -> None:
    assert any("loaded across" in w for w in warnings(element, 2.5))
    assert not any("loaded across" in w for w in warnings(element, 1.5))
    one = CASE.replace("count: 8", "count: 1").format(element=f"type: {element}", height=2.5, hold="all")
    assert not any("loaded across" in w for w in build_model(load_case_text(one)).warnings)
