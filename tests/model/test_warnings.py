"""Warnings of models that will run but may mislead."""

from __future__ import annotations

import math
from typing import Any

import helpers
import pytest

import ancf2d
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


@pytest.mark.parametrize("element", ["reissner3, quadrature: [2, 2]",
                                     "vallejo, formulation: structural, quadrature: [3, 2]"])
def test_points_across_the_section_have_no_effect_in_axial_rules_and_give_a_warning(element: str) -> None:
    assert any("the points across have no effect" in said for said in warnings(element, 0.1))
    assert not any("the points across" in said for said in warnings(element.replace(", 2]", ", 1]"), 0.1))


@pytest.mark.parametrize(("element", "thick", "thin"), [
    ("omar", 0.01, 0.001), ("2d2n", 0.1, 0.01), ("2d3n", 0.6, 0.1), ("li", 0.01, 0.001),
    ("2d3n-nu", 0.1, 0.01)])
def test_slender_elements_that_lock_give_a_warning(element: str, thick: float, thin: float) -> None:
    assert not warnings(element, thick)
    (said,) = warnings(element, thin)
    assert "too stiff in bending" in said


@pytest.mark.parametrize("element", ["vallejo", "reissner3", "cable", "kerkkanen"])
def test_elements_without_such_a_bound_give_no_warning(element: str) -> None:
    assert not warnings(element, 1e-5, "section")


def test_a_section_clamp_that_leaves_warping_free_gives_a_warning() -> None:
    assert "leaves the warping coordinates" in warnings("ancf, order: [3, 3]", 0.1, "section")[0]
    assert not warnings("ancf, order: [3, 3]", 0.1, "breathe")


@pytest.mark.parametrize(("element", "off"), [
    ("type: patel, formulation: enhanced", "11"), ("type: ancf, order: [2, 2], formulation: enhanced", "11"),
    ("type: patel", None), ("type: omar", None), ("type: ancf, order: [3, 3]", None)])
def test_a_short_body_with_a_wrong_transverse_law_gives_a_warning(element: str, off: str | None) -> None:
    """A longitudinal stretch that varies with y^2 escapes the coupling on the axis."""
    said = [w for w in warnings(element, 200.0, "breathe") if "transverse load" in w]
    assert len(said) == (off is not None)
    where = "under transverse load on a body as short as this, at nu = 0.3"
    assert off is None or f"is {off} % in error {where}" in said[0]
    assert not [w for w in warnings(element, 1.5, "breathe") if "transverse load" in w]


@pytest.mark.parametrize("element", ["2d2n", "2d3n", "2d2n-nu", "2d3n-nu"])
def test_a_short_body_with_nonconforming_elements_gives_a_warning(element: str) -> None:
    assert any("transverse load" in w for w in warnings(element, 2.5))
    assert not any("transverse load" in w for w in warnings(element, 1.5))
    one = CASE.replace("count: 8", "count: 1").format(element=f"type: {element}", height=2.5, hold="all")
    assert not any("transverse load" in w for w in build_model(load_case_text(one)).warnings)


def arc(element: str, formulation: str, count: int) -> helpers.Solution:
    """Solve a quarter ring of 30 heights, clamped at one end, with a unit moment on the other."""
    geometry = {"type": "arc", "center": [0, 0], "radius": 1, "from": 0, "to": math.pi / 2}
    body = helpers.body(geometry, helpers.element(element, count, formulation), {"height": 0.05, "width": 0.1})
    return helpers.solved({"b": body}, "linear_static", bc=[{"type": "clamp", "at": "b@0", "hold": "section"}],
                          loads=[{"type": "moment", "at": "b@1", "value": 1e-9}])


@pytest.mark.parametrize(("element", "count"), [("omar", 3), ("omar", 5), ("vallejo", 3), ("vallejo", 5), ("li", 3)])
def test_arcs_that_bend_too_stiffly_report_the_error(element: str, count: int) -> None:
    """The end turns by M L/(E I), whatever the arc: formulation enhanced is too stiff only where its elements are."""
    out = arc(element, "enhanced", count)
    exact = 1e-9 * math.pi / 2 / out.model.meshes["b"].plan.section.EI
    off = 100 * (exact / out.theta("b@1") - 1)
    said = [w for w in out.model.warnings if "too stiff" in w]
    assert bool(said) == (off > 5)
    if said:
        number = float(said[0].split("too stiff in bending by ")[1].split(" %")[0])
        assert number == pytest.approx(off, rel=0.05)
        assert "enhanced or" not in said[0]


def test_the_advice_differs_from_the_choice_in_use_and_does_not_depend_on_the_arc() -> None:
    (straight,) = (w for w in warnings("vallejo, formulation: continuum", 0.1) if "too stiff" in w)
    (curved,) = (w for w in arc("vallejo", "continuum", 5).model.warnings if "too stiff" in w)
    assert "too stiff by 9.9 % at nu = 0.3. Use formulation enhanced or structural" in straight
    assert straight.split(": ")[1] == curved.split(": ")[1]


def test_an_arc_too_wide_for_an_element_gives_a_warning() -> None:
    assert any("rotates by 1.6 rad" in w for w in arc("vallejo", "enhanced", 1).model.warnings)
    assert not any("an element rotates by" in w for w in arc("vallejo", "enhanced", 2).model.warnings)


@pytest.mark.parametrize(("nu", "rule", "soft"), [(1e-3, None, False), (0.0, None, False), (1e-3, [2, 2], True),
                                                  (0.0, [2, 2], True), (0.3, [2, 2], False)])
def test_hidden_modes_stiffened_only_by_nu_give_a_warning(nu: float, rule: list[int] | None, soft: bool) -> None:
    """Of x^2 + nu y^2 and x^3, two points along see nothing but the part with nu: without it, modes below bending."""
    spec = helpers.element("2d2n-nu", 2, **({} if rule is None else {"quadrature": rule}))
    material = {"E": 1e7, "nu": nu, "rho": 1000.0}
    beam = helpers.body(helpers.line(1.0), spec, {"height": 0.1, "width": 0.1}, material)
    found = helpers.solved({"beam": beam}, {"type": "eigen", "modes": 1},
                           bc=[{"type": "clamp", "at": "beam@0"}])
    assert any("with little or no stiffness" in text for text in found.model.warnings) == soft
    bending = 1.8751**2 * math.sqrt(1e7 * 0.1**2 / 12 / 1000.0)
    assert (found.state.report["frequencies"][0]["omega"] < 0.5 * bending) == soft


@pytest.mark.parametrize(("element", "rule", "hidden"), [
    ("omar", [2, 2], 2), ("li", [2, 2], 3), ("patel", [2, 3], 2), ("cable", [2, 1], 1), ("vallejo", [1, 2], 4),
    ("omar", "exact", 0), ("2d2n", [3, 3], 0), ("cable", [5, 1], 0), ("reissner3", [3, 1], 0),
    ("kerkkanen", {"normal": [2, 2], "shear": [1, 2]}, 0)])
@pytest.mark.parametrize("length", [0.5, 100.0])
def test_a_rule_with_hidden_modes_gives_a_warning_for_any_slenderness(element: str, rule: Any, hidden: int,
                                                                      length: float) -> None:
    """The numbers are dimensions of the null space of an element, less the three of rigid motion."""
    spec = helpers.element(element, 1, quadrature=rule, **({"formulation": "continuum"} if rule == "exact" else {}))
    found = helpers.build({"b": helpers.body(helpers.line(length), spec)}, bc=[{"type": "clamp", "at": "b@0"}]).warnings
    said = [w for w in found if "with little or no stiffness" in w]
    assert [f"leave {hidden} motion" in w for w in said] == [True] * bool(hidden)


@pytest.mark.parametrize(("depth", "told"), [(0.03, True), (1e-4, False)])
@pytest.mark.parametrize("bodies", [False, True])
def test_initial_penetration_of_a_layer_gives_a_warning(depth: float, bodies: bool, told: bool) -> None:
    """A beam of 1 m begins so deep in the floor, or in another beam: by more than a hundredth of its length."""
    beam = helpers.body(helpers.line(1.0), helpers.element("reissner2", 4), {"height": 0.1, "width": 0.1},
                        {"E": 1e7, "nu": 0.3})
    case: dict[str, Any] = {"bodies": {"beam": beam},
                            "boundary_conditions": [{"type": "clamp", "at": "beam@0"}], "solver": {"type": "static"},
                            "contacts": [{"between": ["beam", "under"], "law": {"stiffness": 1e5}}]}
    if bodies:
        line = {"type": "line", "start": [0, -0.1 + depth], "end": [1.1, -0.1 + depth]}
        case["bodies"]["under"] = {**beam, "geometry": line}
        case["boundary_conditions"].append({"type": "clamp", "at": "under@0"})
    else:
        case["obstacles"] = {"under": {"type": "half_plane", "through": [0, -0.05 + depth], "normal": [0, 1]}}
    found = [w for w in build_model(ancf2d.load(case)).warnings if "overlap in the reference" in w]
    assert [f"by up to {depth:g} at S" in w for w in found] == [True] * told


@pytest.mark.parametrize(("more", "side", "told"), [({}, "surface", True), ({}, "axis", False),
                                                    ({"section": {"height": 0.1, "width": 0.1}}, "surface", False)])
def test_faces_of_a_rigid_bar_without_a_section_give_a_warning(more: dict[str, Any], side: str, told: bool) -> None:
    """Its assumed height is a twentieth of its length: its faces are a fortieth from the axis."""
    bar = {"geometry": helpers.line(2.0), "element": {"type": "rigid", "mass": 1, "inertia": 1}, **more}
    case = {"bodies": {"bar": bar}, "solver": {"type": "dynamic", "t_end": 1},
            "obstacles": {"floor": {"type": "half_plane", "through": [0, -1], "normal": [0, 1]}},
            "contacts": [{"between": ["bar", "floor"], "side": side}]}
    found = [w for w in build_model(ancf2d.load(case)).warnings if "section" in w]
    assert ["bar has no section, so its faces are taken to be 0.05 from its axis" in w for w in found] == [True] * told
