"""Element types described in files: their properties hold, and all errors are reported at once."""

import json

import pytest

from ancf2d.case import DefinitionNode, ElementDefinition, load_case_text
from ancf2d.elements.registry import ELEMENTS
from ancf2d.errors import CaseError
from ancf2d.model.build import build_model
from ancf2d.model.own_element import SINGULAR, condition, element_issues, own_element, rank, undetermined
from ancf2d.study.run import vocabulary
from ancf2d.study.variants import described

OMAR = {"name": "mine", "basis": ["1", "x", "y", "x*y", "x^2", "x^3"],
        "nodes": [{"at": 0, "coordinates": ["r", "r_x", "r_y"]}, {"at": 1, "coordinates": ["r", "r_x", "r_y"]}]}


def model(tmp_path, **more):
    """Return the model of a cantilever with a custom element."""
    (tmp_path / "mine.yaml").write_text(json.dumps({**OMAR, **more}))
    case = {"bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [2, 0]},
                                "section": {"height": 0.1, "width": 0.1}, "material": {"E": 1.0, "nu": 0.3},
                                "element": {"definition": "mine.yaml", "count": 2}}},
            "boundary_conditions": [{"type": "clamp", "at": "beam@0"}], "solver": {"type": "linear_static"}}
    return build_model(load_case_text(json.dumps(case), vocabulary=vocabulary(), directory=str(tmp_path)))


def definition(basis, *coordinates, places=(0.0, 1.0)):
    return ElementDefinition("mine", tuple(basis), tuple(DefinitionNode(at, coordinates) for at in places))


@pytest.mark.parametrize(("quadrature", "rule"), [
    ("exact", ((5, 3), (5, 3))), ([2, 1], ((2, 1), (2, 1))),
    ({"normal": [3, 2], "shear": [1, 1]}, ((3, 2), (1, 1)))])
def test_the_quadrature_of_a_definition_is_the_default_of_its_element(tmp_path, quadrature, rule):
    plan = model(tmp_path, quadrature=quadrature).meshes["beam"].plan
    assert (plan.rule.normal, plan.rule.shear) == rule
    assert plan.formulation.name == "continuum"


@pytest.mark.parametrize("name", ["omar", "vallejo", "patel", "2d2n-nu", "cable", "reissner3"])
def test_a_description_of_a_listed_type_is_that_type(name):
    known = ELEMENTS[name]
    described = own_element(ElementDefinition("mine", known.basis,
                                              tuple(DefinitionNode(n.at, n.coordinates) for n in known.nodes)))
    assert (described.polynomials, described.functionals) == (known.polynomials, known.functionals)
    assert undetermined(described) is None
    assert described.section_kind == known.section_kind


def test_all_problems_are_reported_at_once_with_their_lines(tmp_path):
    """Unreadable values do not hide problems of others."""
    (tmp_path / "e.yaml").write_text("""\
name: 5
basis: ["1", "x^^2", "sin(x)", "1"]
nodes:
  - {at: 0, coordinates: [r]}
  - {at: 0.9, coordinates: [r, rx]}
  - {at: 0.8, coordinates: [r, r_x]}
formulaton: continuum
lobatto: 0.5
""")
    with pytest.raises(CaseError) as caught:
        described(str(tmp_path / "e.yaml"))
    assert {p.path for p in caught.value.problems} == {
        ("name",), ("formulaton",), ("basis", 1), ("basis", 2), ("basis", 3), ("basis",), ("nodes",),
        ("nodes", 1, "coordinates", 1), ("nodes", 2, "at")}


def test_a_case_reports_problems_in_the_file_of_its_element(tmp_path):
    with pytest.raises(CaseError, match=r"mine\.yaml:1:.*'z' is not a power of x"):
        model(tmp_path, basis=["1", "x", "y", "x*y", "x^2", "z"])


@pytest.mark.parametrize(("basis", "coordinates", "words"), [
    (["1", "x", "y"], ["r", "r_y"], "3 basis functions for 4 nodal coordinates"),
    (["1", "x"], ["r_x"], "need the coordinate r"),
    (["1", "x"], ["r", "r_x", "theta"], "theta needs r at the same node")])
def test_files_that_are_not_elements(basis, coordinates, words):
    assert any(words in issue.message for issue in element_issues(definition(basis, *coordinates)))


@pytest.mark.parametrize("basis", [
    # x^2 y^2 vanishes in r, r_x and r_y on y = 0; r_x(0) in x^2, x^3 and x^4; x + y is no new function
    ["1", "x", "y", "x*y", "x^2*y^2", "x^3"], ["1", "x^2", "x^3", "x^4", "y", "x*y"],
    ["1", "x", "y", "x + y", "x*y", "x^3"]])
def test_coordinates_that_do_not_determine_the_basis(tmp_path, basis):
    element = own_element(definition(basis, "r", "r_x", "r_y"))
    assert undetermined(element)
    assert rank(element, 1.0, 0.3) == 5
    assert condition(element, 1.0, 0.3) > SINGULAR
    with pytest.raises(CaseError, match="basis"):
        model(tmp_path, basis=basis)


@pytest.mark.parametrize("name", [*ELEMENTS])
def test_listed_types_are_well_determined_at_any_length(name):
    assert max(condition(ELEMENTS[name], length, 0.3) for length in (0.1, 1.0, 100.0)) < 1e7


def test_the_condition_number_does_not_depend_on_the_form_of_the_basis():
    nodes = ("r", "r_x", "r_y")
    plain = own_element(definition(["1", "x", "y", "x*y", "x^2", "x^3"], *nodes))
    mixed = own_element(definition(["1", "1 + x", "x - 3*y", "5*x*y", "x^2 + x^3", "x^3"], *nodes))
    assert condition(mixed, 2.0, 0.3) == pytest.approx(condition(plain, 2.0, 0.3), rel=1e-9)
