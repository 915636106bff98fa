"""Every valid case loads, is complete when written out, and satisfies its JSON Schema."""

import dataclasses
import re
from pathlib import Path

import jsonschema
import pytest

import ancf2d
from ancf2d.case import (
    TEMPLATES,
    GroundPoint,
    LimitPoints,
    LoadFactor,
    Point,
    PointExpression,
    ProbeReaches,
    ProfileExpression,
    Selective,
    definition_schema,
    json_schema,
    load_case,
    load_case_text,
    markdown_reference,
    template,
)
from ancf2d.case.compose import compose
from ancf2d.case.emit import walk
from ancf2d.case.nodes import Origin, plain_data
from ancf2d.case.numbers import unused_parameters
from ancf2d.case.records import keys_of, tag_of
from ancf2d.errors import CaseError

VALID = sorted((Path(__file__).parent / "valid").glob("*.yaml"))
BROKEN = sorted((Path(__file__).parent / "broken").glob("*.yaml"))


@pytest.fixture(scope="module")
def validator(vocabulary):
    schema = json_schema(vocabulary)
    jsonschema.Draft7Validator.check_schema(schema)
    return jsonschema.Draft7Validator(schema)


def data_of(text):
    return plain_data(compose(text, Origin("f", [])))


@pytest.mark.parametrize("path", VALID, ids=lambda p: p.stem)
def test_completed_text_is_the_same_case(path, vocabulary):
    loaded = load_case(path, vocabulary=vocabulary)
    again = load_case_text(loaded.completed, vocabulary=vocabulary, directory=path.parent)
    assert again.case == loaded.case
    assert again.completed == loaded.completed
    assert again.definitions == loaded.definitions


@pytest.mark.parametrize("path", VALID, ids=lambda p: p.stem)
def test_schema_accepts(path, vocabulary, validator):
    loaded = load_case(path, vocabulary=vocabulary)
    validator.validate(data_of(loaded.text))
    validator.validate(data_of(loaded.completed))


@pytest.mark.parametrize("path", [p for p in BROKEN if p.stem.startswith(("shape_", "value_"))],
                         ids=lambda p: p.stem)
def test_schema_rejects_values_that_are_wrong_by_themselves(path, validator):
    # beyond a schema: what a text says in its own language, such as a name that is no parameter, zero vectors, infinity
    beyond = ("value_text_for_number", "value_expression", "value_profile", "shape_profile", "value_zero_direction",
              "value_null", "value_start_state", "value_s_outside", "value_infinite", "value_nan", "value_too_large")
    if not path.stem.startswith(beyond):
        assert not validator.is_valid(data_of(path.read_text(encoding="utf-8")))


def test_valid_cases_use_the_whole_format(vocabulary):
    """The valid cases contain every record and every key of it."""
    given, known = set(), set()
    for path in VALID:
        loaded = load_case(path, vocabulary=vocabulary)
        for where, value, _ in walk(loaded.case):
            # an expression in s, or in quantities of a point, is written as a text, without keys
            if dataclasses.is_dataclass(value) and not isinstance(value, ProfileExpression | PointExpression):
                keys = keys_of(type(value))
                known |= {(type(value).__name__, name) for name in keys}
                data = plain_data(loaded.source.node(where)[0])
                data = data if isinstance(data, dict) else {}
                given |= {(type(value).__name__, name) for name in keys if name in data}
    assert known - given == set()
    # linear_static has no keys
    assert {name for name, _ in known} >= set(json_schema(vocabulary)["definitions"]) - {
        "LinearStatic"}


def test_the_contract_example(vocabulary):
    case = load_case(Path(__file__).parent / "valid" / "simply_supported.yaml",
                     vocabulary=vocabulary).case
    beam = case.bodies["beam"]
    assert (beam.geometry.start, beam.geometry.end) == ((0.0, 0.0), (2.0, 0.0))
    assert (beam.section.height, beam.section.width) == (0.1, 0.1)
    assert (beam.material.E, beam.material.nu, beam.material.rho) == (2.07e11, 0.3, 7850.0)
    assert (beam.element.type, beam.element.count) == ("2d2n", 8)
    left, right = case.boundary_conditions
    assert (left.name, left.at) == ("left", Point("beam", 0.0))
    assert (right.name, right.at, right.fixed) == (None, Point("beam", 1.0), "y")
    assert case.loads[0].value == (0.0, -1000.0)
    assert case.loads[0].amplitude is None
    assert tag_of(type(case.solver)) == "linear_static"
    assert (case.goal.probe, case.goal.quantity) == ("mid", "uy")
    assert case.output.probes["mid"].at == Point("beam", 0.5)
    assert case.expected[0].source == "Table 1"


def test_unions_by_keys_and_shape(vocabulary):
    here = Path(__file__).parent / "valid"
    frame = load_case(here / "frame.yaml", vocabulary=vocabulary).case
    assert frame.solver.until == LoadFactor(2.5)
    assert frame.springs[0].between == (Point("beam", 0.25), GroundPoint(500.0, 0.0))
    assert frame.bodies["arch"].element.quadrature == Selective((2, 2), (1, 1))
    assert frame.bodies["beam"].element.quadrature == (3, 2)
    assert frame.bodies["column"].element.quadrature == "exact"
    assert [type(body.section).__name__ for body in frame.bodies.values()] == [
        "Rectangle", "AreaSection", "Stiffness", "Stiffness", "NoneType"]
    assert frame.boundary_conditions[6].ux == 12.5
    lee = load_case(here / "lee_frame.yaml", vocabulary=vocabulary).case
    assert lee.solver.until == LimitPoints(2)
    control = load_case(here / "displacement_control.yaml", vocabulary=vocabulary).case
    assert control.solver.until == ProbeReaches("tip", "theta", -80.0)


def test_values_cannot_be_changed(vocabulary):
    case = load_case(VALID[0], vocabulary=vocabulary).case
    with pytest.raises(dataclasses.FrozenInstanceError):
        case.title = "other"
    with pytest.raises(dataclasses.FrozenInstanceError):
        del case.title
    changed = dataclasses.replace(case, title="other")
    assert changed.title == "other"
    assert changed != case
    assert hash(Point("a", 0.5)) == hash(Point("a", 0.5))
    assert repr(Point("a", 0.5)) == "Point(body='a', s=0.5)"


@pytest.mark.parametrize("kind", TEMPLATES)
def test_templates(kind, vocabulary, validator):
    text = template("a: b # c", kind)
    loaded = load_case_text(text, vocabulary=vocabulary)
    assert text.startswith("# yaml-language-server: $schema=ancf2d.schema.json\n")
    assert loaded.case.title.startswith("a: b # c, ")
    validator.validate(data_of(text))
    assert not unused_parameters(loaded.case)


def test_unknown_template():
    with pytest.raises(CaseError, match="did you mean 'cantilever'"):
        template("x", "cantiliver")


def test_schema_has_descriptions_for_editors(vocabulary):
    schema = json_schema(vocabulary)
    modulus = schema["definitions"]["Material"]["properties"]["E"]
    number, formula, table = modulus.pop("anyOf")
    assert number == {"type": "number", "exclusiveMinimum": 0}
    assert formula["type"] == "string"
    assert table == {"$ref": "#/definitions/ProfileTable"}
    assert modulus == {"description": "Young's modulus [Pa]", "examples": [2.07e11]}
    assert schema["definitions"]["Eigen"]["properties"]["modes"]["default"] == 10
    assert schema["definitions"]["Force"]["properties"]["type"]["const"] == "force"
    assert schema["properties"]["solver"]["allOf" if "allOf" in schema["properties"]["solver"]
                                          else "oneOf"]
    for definition in [schema, *schema["definitions"].values()]:
        assert definition["additionalProperties"] is False
        assert all("description" in p for p in definition["properties"].values())
    assert "Case" not in schema["definitions"]
    jsonschema.Draft7Validator.check_schema(definition_schema(vocabulary))


def test_reference_names_every_key(vocabulary):
    text = markdown_reference(vocabulary)
    for definition in json_schema(vocabulary)["definitions"].values():
        for name in definition["properties"]:
            assert f"| `{name}` |" in text or name == "type"
    anchors = {"".join(c for c in line.lstrip("# ").lower() if c.isalnum() or c in " -_")
               .replace(" ", "-") for line in text.split("\n") if line.startswith("#")}
    links = {part.split(")")[0] for part in text.split("](#")[1:]}
    assert links <= anchors


def test_a_motion_without_steps_has_the_documented_ones(vocabulary):
    solver = load_case(Path(__file__).parent / "valid" / "motion_without_steps.yaml", vocabulary=vocabulary).case.solver
    assert (solver.dt, solver.tolerance, solver.local_error) == (None, None, 1e-6)
    assert "default 1e-06" in markdown_reference(vocabulary)


def variants(kind: str) -> list[str]:
    """Yield a template with each of its alternatives: '# or:' replaces the line above, '# and:' adds one."""
    lines, out, last = template("case", kind).splitlines(), [], 0
    for k, line in enumerate(lines):
        offer = re.match(r"( *)# (or|and): (.+)$", line)
        if offer is None:
            last = k
            continue
        taken = [*lines]
        taken[k] = offer[1] + offer[3]
        if offer[2] == "or":
            taken[last] = ""
        out.append("\n".join(taken) + "\n")
    return out


# the first of each template is a quick test
OFFERS = [pytest.param(text, id=f"{kind} {k}", marks=pytest.mark.slow if k else ())
          for kind in TEMPLATES for k, text in enumerate(variants(kind))]


def test_templates_offer_alternatives() -> None:
    assert len(OFFERS) > 2 * len(TEMPLATES)
    assert not any("also:" in template("case", kind) for kind in TEMPLATES)


@pytest.mark.parametrize("text", OFFERS)
def test_alternatives_in_the_comments_of_templates_work(text: str) -> None:
    """Uncommented, each line makes a case that can be solved; motions for a short time."""
    solution = ancf2d.solve(text, ["solver.t_end=0.02"] if "t_end" in text else [], states=False)
    assert solution.status == "converged"


def test_a_component_of_a_line_load_may_be_a_number_in_quotes(vocabulary, validator):
    """["0", "-2*vy"] are two expressions; a number in quotes is an expression, too."""
    text = (Path(__file__).parent / "valid" / "feedback.yaml").read_text(encoding="utf-8")
    text = re.sub(r'value: \["-drag.*', 'value: ["0", "-2*vy"]}', text)
    loaded = load_case_text(text, vocabulary=vocabulary)
    across, along = loaded.case.loads[1].value
    assert (across.value(0.3), str(along.written())) == (0.0, "-2*vy")
    assert load_case_text(loaded.completed, vocabulary=vocabulary).case == loaded.case
    validator.validate(data_of(text))
