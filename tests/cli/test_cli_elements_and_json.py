"""elements, schema and new, and the JSON output of all commands."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from commandline import BEAM

from ancf2d.case import TEMPLATES, template
from ancf2d.cli.app import COMMANDS
from ancf2d.cli.new import KINDS
from ancf2d.cli.schema import OUTPUTS
from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.elements.registry import ELEMENTS

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]


def test_elements_lists_every_type_with_its_default_formulation(call: Call, call_json: CallJson) -> None:
    lines = call("elements").stdout.split("\n")
    for name, element in ELEMENTS.items():
        line = next(line for line in lines if line.startswith(f"{name} "))
        assert f"{element.formulation}*" in line
    found = call_json("elements", "--json")["elements"]
    assert [e["name"] for e in found] == list(ELEMENTS)


@pytest.mark.parametrize("name", [*ELEMENTS, "ancf[3,2]"])
def test_element_says_why_it_lacks_a_formulation(call: Call, call_json: CallJson, name: str) -> None:
    found = call_json("elements", name, "--json")
    assert {f["name"] for f in found["formulations"]} == set(FORMULATIONS)
    assert sum(f["default"] for f in found["formulations"]) == 1
    text = call("elements", name).stdout
    for f in found["formulations"]:
        assert (f["refused"] is None) == (f["quadrature"] is not None)
        assert f["refused"] is None or f["refused"] in text
    assert len(found["basis"]) == len(set(found["basis"]))
    assert not any("^0" in b or "^1" in b for b in found["basis"])


def test_rigid_bodies_are_listed_separately(call: Call) -> None:
    assert any(line.startswith("rigid ") and "no strain" in line for line in call("elements").stdout.split("\n"))
    text = call("elements", "rigid").stdout
    assert "4 per element" in text
    assert "formulations" not in text


@pytest.mark.parametrize(("arguments", "key"), [
    (["validate", "beam.yaml"], "cases"), (["run", "beam.yaml"], "probes"),
    (["run", "beam.yaml", "--set", "accuracy=1e-2", "--set", "expected=null"], "accuracy"),
    (["run", "beam.yaml", "--set", "solver={type: buckling, modes: 1}", "--set", "loads.0.value=[-1, 0]",
      "--set", "goal=null", "--set", "expected=null"], "load_factors"),
    (["convergence", "beam.yaml", "--elements", "1,2"], "extrapolated"),
    (["convergence", "beam.yaml", "--elements", "1,2", "--element", "cable,vallejo"], "elements"),
    (["sweep", "beam.yaml", "--over", "bodies.beam.element.count=1,-1"], "rows"), (["info", "beam.h5"], "made"),
    (["compare", "beam.h5", "beam.h5"], "differences"), (["export", "beam.h5", "t.csv"], "bytes"),
    (["elements"], "elements"), (["elements", "cable"], "basis"),
    (["sensitivity", "beam.yaml", "--to", "loads.tip.value.1"], "goal"),
    (["optimise", "beam.yaml", "--vary", "loads.tip.value.1=-6:-1", "--minimise", "goal^2"], "minimum"),
    (["tradeoff", "beam.yaml", "--element", "cable", "--elements", "1,2", "--repeat", "1", "--budget", "5"],
     "recommended"),
    (["run", "none.yaml"], "problems"), (["run", "beam.yaml", "--bad"], "reason"),
], ids=lambda v: " ".join(v) if isinstance(v, list) else "")
def test_json_follows_its_schema(call: Call, call_json: CallJson, arguments: list[str], key: str) -> None:
    """The output is valid, and every key at the top level is described."""
    import jsonschema

    if "beam.h5" in arguments:
        call("run", "beam.yaml", "-q")
    schema = json.loads(call("schema", "--of", arguments[0]).stdout)
    jsonschema.Draft7Validator.check_schema(schema)
    found = call_json(*arguments, "--json")
    assert key in found
    failed = found.get("status") == "failed" and arguments[0] == "run"
    form = schema["anyOf"][1 if failed else 0]
    jsonschema.validate(found, form)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({}, schema)
    if not failed:
        assert set(found) <= set(form["properties"])
        jsonschema.validate({"status": "failed", "reason": "r", "at": {}}, schema)


def test_every_json_output_has_a_schema(call: Call) -> None:
    offered = [name for name in COMMANDS if "--json" in call(name, "--help").stdout.split("Examples:")[0]]
    offered.remove("schema")  # which only speaks of it
    assert sorted(offered) == sorted(OUTPUTS)
    assert call("schema", "--of", "run", "--markdown").exit_code == 2


def test_schema_knows_the_element_types_and_replaces_no_other_file(call: Call, folder: Path) -> None:
    schema = json.loads(call("schema").stdout)
    assert "vallejo" in json.dumps(schema)
    assert "definition" in call("schema", "--definition").stdout
    assert call("schema", "--markdown").stdout.startswith("# Case files")
    for _ in range(2):
        assert call("schema", "-o", "s.json").exit_code == 0
    assert json.loads((folder / "s.json").read_text()) == schema
    assert call("schema", "-o", "beam.yaml").exit_code == 2
    assert (folder / "beam.yaml").read_text() == BEAM


def test_kinds_of_new_are_those_of_the_case_format() -> None:
    assert KINDS == TEMPLATES


@pytest.mark.parametrize("kind", KINDS)
def test_the_name_of_a_kind_gives_that_kind(call: Call, folder: Path, kind: str) -> None:
    assert call("new", kind).exit_code == 0
    assert (folder / f"{kind}.yaml").read_text() == template(kind, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_new_case_points_editors_to_an_existing_schema(call: Call, folder: Path, kind: str) -> None:
    result = call("new", "first", "--kind", kind)
    assert result.exit_code == 0
    assert "ancf2d run first.yaml" in result.stdout
    first, *_ = (folder / "first.yaml").read_text().split("\n")
    schema = first.removeprefix("# yaml-language-server: $schema=")
    assert (folder / schema).exists()
    before = (folder / "first.yaml").read_text()
    assert call("new", "first.yaml").exit_code == 2
    assert (folder / "first.yaml").read_text() == before
    assert call("new", "first", "--force").exit_code == 0
