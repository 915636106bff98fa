"""validate, convergence, plot, info, compare, elements, schema and new, as a user calls them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from commandline import BEAM
from helpers import chosen, covering

from ancf2d.case import TEMPLATES, template
from ancf2d.cli.app import COMMANDS
from ancf2d.cli.new import KINDS
from ancf2d.cli.schema import OUTPUTS
from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.elements.registry import ELEMENTS
from ancf2d.results import open_results

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]

# ---------------------------------------------------------------------------- validate

def test_validate_prints_problems_to_stderr_and_ok_per_valid_case_to_stdout(call: Call, folder: Path) -> None:
    (folder / "wrong.yaml").write_text(BEAM.replace("EI: 1.0e3", "EI: -1"))
    (folder / "loose.yaml").write_text(BEAM.replace("type: clamp", "type: pin"))
    result = call("validate", "beam.yaml", "wrong.yaml", "loose.yaml")
    assert result.exit_code == 2
    assert result.stdout == "beam.yaml: ok\n"
    assert "wrong.yaml:6:" in result.stderr
    # a pinned beam can turn: seen without solving
    assert "free to turn" in result.stderr
    assert result.stderr.rstrip().endswith("2 problems in 2 cases")
    assert call("validate", "beam.yaml").exit_code == 0
    assert call("validate", "beam.yaml", "-q").output == ""
    assert sorted(os.listdir(folder)) == ["beam.yaml", "loose.yaml", "wrong.yaml"]


def test_validate_json_lists_the_problems_of_every_case(call_json: CallJson, folder: Path) -> None:
    (folder / "wrong.yaml").write_text(BEAM.replace("EI: 1.0e3", "EI: -1"))
    found = call_json("validate", "beam.yaml", "wrong.yaml", "none.yaml", "--json")
    assert found["status"] == "failed"
    assert [c["status"] for c in found["cases"]] == ["ok", "failed", "failed"]
    problem = found["cases"][1]["problems"][0]
    assert (problem["file"], problem["line"], problem["path"]) == ("wrong.yaml", 6, "bodies.beam.section.EI")
    assert call_json("validate", "beam.yaml", "--json")["status"] == "ok"


def test_validate_reports_solver_and_model_problems_together(call: Call, folder: Path) -> None:
    """What no solver offers does not hide a mechanism."""
    result = call("validate", "beam.yaml", "--set", "solver={type: static, method: arc_length}", "--set",
                  "boundary_conditions.root={type: pin, at: beam@0}")
    if "arc_length" not in result.stderr:
        pytest.skip("arc length is available")
    assert "free to turn" in result.stderr


# ---------------------------------------------------------------------------- convergence

def test_convergence_of_an_exact_element_is_round_off(call: Call, call_json: CallJson) -> None:
    found = call_json("convergence", "beam.yaml", "--elements", "1,2,4", "--json")
    assert [row["elements"] for row in found["rows"]] == [1, 2, 4]
    assert found["extrapolated"] == pytest.approx(-8e-3, rel=1e-10)
    assert found["order"] is None
    assert found["asymptotic"] is True
    assert found["error_bar"] < 1e-12
    assert "order undefined" in call("convergence", "beam.yaml", "--elements", "1,2,4").stdout


def test_convergence_writes_a_table_that_plot_draws(call: Call, folder: Path) -> None:
    result = call("convergence", "beam.yaml", "--element", "reissner2,reissner3", "--elements", "2,4,8", "-o",
                  "study.h5", "--reference", "-0.0080200000")
    assert result.exit_code == 0, result.output
    # F L^3/(3 E I) + F L/kGA
    assert "limit -0.00802" in result.stdout
    with open_results("study.h5") as found:
        table = found.tables["convergence"]
        assert list(table["elements"]) == [2, 4, 8, 2, 4, 8]
        assert list(table["element"]) == ["reissner2"] * 3 + ["reissner3"] * 3
        assert found.attrs["command_line"].startswith("ancf2d convergence beam.yaml")
        assert [e["element"] for e in found.summary["elements"]] == ["reissner2", "reissner3"]
    assert call("plot", "study.h5").stdout == "wrote study-convergence.png (convergence)\n"
    assert (folder / "study-convergence.png").stat().st_size > 1000
    assert "convergence" in call("info", "study.h5").stdout


def test_sensitivities_and_designs_are_written_and_drawn(call: Call, call_json: CallJson, folder: Path) -> None:
    """u is proportional to the load: elasticity 1, and the least load is best."""
    result = call("sensitivity", "beam.yaml", "-o", "s.h5")
    assert result.exit_code == 0
    assert "loads.tip.value.1" in result.stdout
    with open_results(folder / "s.h5") as found:
        table = found.tables["sensitivity"]
        row = list(table["path"]).index("loads.tip.value.1")
        assert table["elasticity"][row] == pytest.approx(1.0, abs=1e-8)
    assert call("plot", "s.h5").stdout == "wrote s-tornado.png (tornado)\n"
    found = call_json("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-6:-2", "--minimise", "goal^2",
                      "--subject-to", "goal <= 0", "--history", "o.h5", "--json")
    assert found["rows"][0]["value"] == pytest.approx(-2.0, abs=1e-6)
    assert found["constraints"][0]["met"]
    assert found["output"] == "beam-best.yaml"
    assert call("plot", "o.h5").stdout == "wrote o-optimisation.png (optimisation)\n"
    again = call_json("run", "beam-best.yaml", "--set", "expected=null", "--json")
    assert again["probes"]["tip"]["uy"] ** 2 == pytest.approx(found["minimum"], rel=1e-9)


@pytest.mark.parametrize(("arguments", "message"), [
    (("sensitivity", "beam.yaml", "--set", "goal=null"), "the case has no goal"),
    (("sensitivity", "beam.yaml", "--to", "loads.tip.valu.1"), "did you mean 'loads.tip.value.1'?"),
    (("sensitivity", "beam.yaml", "--to", "masses"), "beam.yaml: error: the case has no 'masses'"),
    (("sensitivity", "beam.yaml", "--to", "bodies.beam.element.count"),
     "--to bodies.beam.element.count: error: bodies.beam.element.count cannot vary about 2: "),
    (("optimise", "beam.yaml", "--vary", "loads.tip.value.1=1", "--minimise", "mass"), "not PATH=LOW:HIGH"),
    (("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-2:-1", "--minimise", "tip.uz"), "did you mean 'tip.uy'?"),
    (("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-2:-1", "--minimise", "goal", "--subject-to", "goal"),
     "no constraint")], ids=lambda v: v if isinstance(v, str) else " ".join(v))
def test_what_cannot_be_differentiated_or_designed_is_a_mistake(call: Call, arguments: tuple[str, ...], message: str,
                                                                ) -> None:
    result = call(*arguments)
    assert result.exit_code == 2
    assert message in result.stderr


def test_convergence_row_that_fails_is_a_row(call: Call, call_json: CallJson) -> None:
    arguments = ("convergence", "beam.yaml", "--element", "cable:structural,reissner2", "--elements", "2,4")
    found = call_json(*arguments, "--json")
    assert [row["status"] for row in found["rows"]] == ["failed"] * 2 + ["converged"] * 2
    assert "cable has no formulation structural" in found["rows"][0]["reason"]
    assert call(*arguments).exit_code == 0
    alone = call("convergence", "beam.yaml", "--element", "cable:structural")
    assert alone.exit_code == 2
    assert alone.stderr.startswith("--element cable:structural: error: cable has no formulation structural")


def test_convergence_without_goal_is_a_wrong_case(call: Call, folder: Path) -> None:
    (folder / "beam.yaml").write_text(BEAM.replace("goal: {probe: tip, quantity: uy}\n", ""))
    result = call("convergence", "beam.yaml")
    assert result.exit_code == 2
    assert "the case has no goal" in result.stderr


# ---------------------------------------------------------------------------- plot, info, compare

@pytest.fixture
def solved(call: Call) -> Call:
    assert call("run", "beam.yaml", "--set", "solver={type: static, steps: 3}", "-q").exit_code == 0
    return call


def test_plot_saves_where_it_is_told_and_next_to_nothing_else(solved: Call, folder: Path) -> None:
    assert solved("plot", "beam.h5").stdout == "wrote beam-shape.png (shape)\n"
    assert solved("plot", "beam.h5", "load_deflection", "--save", "path.svg", "--data", "path.csv").exit_code == 0
    assert sorted(os.listdir(folder)) == ["beam-shape.png", "beam.h5", "beam.yaml", "path.csv", "path.svg"]
    assert "tip uy" in (folder / "path.csv").read_text()


def test_plot_lists_kinds_and_explains_those_that_do_not_fit(solved: Call, folder: Path) -> None:
    result = solved("plot", "beam.h5", "--list")
    assert "shape*" in result.stdout
    assert "no: it holds no convergence table" in result.stdout
    assert sorted(os.listdir(folder)) == ["beam.h5", "beam.yaml"]


@pytest.mark.parametrize(("arguments", "said"), [
    (["shap"], "did you mean 'shape'?"),
    (["convergence"], "it holds no convergence table"),
    (["history", "--probe", "tipp"], "did you mean 'tip'?"),
    (["--size", "3"], "not a width and height in inches"), (["--size", "0,1e9"], "out of range"),
    (["--style", "nonesuch"], "neither a style file"), (["history", "--scale", "3"], "history has no option 'scale'"),
    (["--state", "99"], "no state 99"),
    (["--save", "figure.xyz"], "unknown suffix '.xyz'"),
    (["--save", "beam.h5"], "is an input of this command"),
    (["--data", "./beam.h5"], "is an input of this command"),
    (["shape", "history"], "one kind of figure at a time"),
], ids=lambda value: " ".join(value) if isinstance(value, list) else "")
def test_plot_refuses_with_a_sentence(solved: Call, folder: Path, arguments: list[str], said: str) -> None:
    before = (folder / "beam.h5").read_bytes()
    result = solved("plot", "beam.h5", *arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert (folder / "beam.h5").read_bytes() == before


def test_several_files_are_overlaid(solved: Call, folder: Path) -> None:
    assert solved("run", "beam.yaml", "-o", "other.h5", "-q", "--set", "solver={type: static, steps: 5}").exit_code == 0
    assert solved("plot", "beam.h5", "other.h5", "load_deflection", "--data", "both.csv").exit_code == 0
    text = (folder / "both.csv").read_text()
    assert "beam: tip uy" in text
    assert "other: tip uy" in text


@pytest.mark.slow
def test_the_difference_of_two_meshes(solved: Call, folder: Path) -> None:
    for count in (1, 3):
        solved("run", "beam.yaml", "-o", f"{count}.h5", "-q", "--set", f"bodies.beam.element={{type: reissner2, "
               f"count: {count}}}")
    result = solved("plot", "1.h5", "3.h5", "beam.h5", "difference", "--data", "d.csv", "--save", "d.png",
                    "--title", "A")
    assert result.stdout == "wrote d.png (difference)\nwrote d.csv (difference)\n"
    text = (folder / "d.csv").read_text()
    assert text.startswith('curve,"S, fraction of the arc length",distance between the axes [m]\n')
    assert {line.split(",")[0] for line in text.split("\n")[1:-1]} == {"1 (reissner2)", "3 (reissner2)"}
    assert solved("plot", "1.h5", "3.h5", "difference", "--reference", "1.h5", "--data", "d.csv").exit_code == 0
    assert "\n3," in (folder / "d.csv").read_text()
    result = solved("plot", "1.h5", "difference")
    assert (result.exit_code, "needs two result files" in result.stderr) == (2, True)
    solved("run", "beam.yaml", "-o", "long.h5", "-q", "--set", "bodies.beam.geometry.end=[3, 0]")
    assert "reference geometry of 'beam' differs" in solved("plot", "1.h5", "long.h5", "difference").stderr


def test_the_values_of_a_convergence_study_are_drawn_when_asked_for(call: Call, folder: Path) -> None:
    call("convergence", "beam.yaml", "--element", "reissner2", "--elements", "2,4", "-o", "s.h5", "-q")
    assert call("plot", "s.h5", "--values", "--data", "s.csv").exit_code == 0
    assert (folder / "s.csv").read_text().startswith("curve,number of elements,tip uy [m]\nreissner2,2.0,-0.0")


def test_compare_agrees_or_exits_with_1(solved: Call, call_json: CallJson) -> None:
    assert solved("compare", "beam.h5", "beam.h5").stdout == "beam.h5 and beam.h5 agree\n"
    solved("run", "beam.yaml", "-o", "other.h5", "-q", "--set", "solver={type: static, steps: 3}", "--set",
           "loads.0.value.1=-3.003")
    result = solved("compare", "beam.h5", "other.h5")
    assert result.exit_code == 1
    assert "/probes/tip/uy" in result.stdout
    found = call_json("compare", "beam.h5", "other.h5", "--json")
    assert found["status"] == "differ"
    assert found["differences"]
    assert solved("compare", "beam.h5", "other.h5", "--rtol", "1e-2").exit_code == 0


def test_info_tells_origin_in_text_and_json(solved: Call, call_json: CallJson) -> None:
    assert "ancf2d run beam.yaml --set 'solver={type: static, steps: 3}'" in solved("info", "beam.h5").stdout
    assert call_json("info", "beam.h5", "--json")["steps"] == 3


# ---------------------------------------------------------------------------- elements, schema, new

def test_elements_lists_every_type_with_its_default_formulation(call: Call, call_json: CallJson) -> None:
    lines = call("elements").stdout.split("\n")
    for name, element in ELEMENTS.items():
        line = next(line for line in lines if line.startswith(f"{name} "))
        assert f"{element.formulation}*" in line
    found = call_json("elements", "--json")["elements"]
    assert [e["name"] for e in found] == list(ELEMENTS)


@pytest.mark.parametrize("name", [*ELEMENTS, "ancf[3,2]"])
def test_element_tells_why_a_formulation_is_not_offered(call: Call, call_json: CallJson, name: str) -> None:
    found = call_json("elements", name, "--json")
    assert {f["name"] for f in found["formulations"]} == set(FORMULATIONS)
    assert sum(f["default"] for f in found["formulations"]) == 1
    text = call("elements", name).stdout
    for f in found["formulations"]:
        assert (f["refused"] is None) == (f["quadrature"] is not None)
        assert f["refused"] is None or f["refused"] in text
    assert len(found["basis"]) == len(set(found["basis"]))
    assert not any("^0" in b or "^1" in b for b in found["basis"])


def test_rigid_bodies_are_listed_too_and_told_apart(call: Call) -> None:
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
    """What is printed is valid, and every key on the first level is described."""
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
    if not failed:
        assert set(found) <= set(form["properties"])
        jsonschema.validate({"status": "failed", "reason": "r", "at": {}}, schema)


def test_every_command_that_prints_json_has_its_schema(call: Call) -> None:
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
def test_a_name_that_is_a_kind_gives_that_kind(call: Call, folder: Path, kind: str) -> None:
    assert call("new", kind).exit_code == 0
    assert (folder / f"{kind}.yaml").read_text() == template(kind, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_new_case_points_editors_at_a_schema_that_is_there(call: Call, folder: Path, kind: str) -> None:
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


# ---------------------------------------------------------------------------- files of others, odd names, odd texts

WRITING = {
    "run": ("run", "beam.yaml", "-o"), "convergence": ("convergence", "beam.yaml", "-o"),
    "tradeoff": ("tradeoff", "beam.yaml", "-o"), "csv": ("sweep", "beam.yaml", "--over", "title=a", "--csv"),
    "figure": ("plot", "beam.h5", "--save"), "data": ("plot", "beam.h5", "--data"),
    "animation": ("plot", "beam.h5", "--animate"), "view": ("view", "beam.h5", "--save"),
    "sensitivity": ("sensitivity", "beam.yaml", "--to", "loads.tip.value.1", "-o"),
    "history": ("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-6:-1", "--minimise", "goal^2", "--history"),
    "best": ("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-6:-1", "--minimise", "goal^2", "-o"),
    "export": ("export", "beam.h5"), "schema": ("schema", "-o"), "reference": ("schema", "--markdown", "-o")}
SUFFIXES = {"figure": ".png", "animation": ".gif", "export": ".csv", "reference": ".md"}


@pytest.mark.slow_rows("figure")
@pytest.mark.parametrize("command", chosen(WRITING, ["run", "figure", "export"]))
def test_what_ancf2d_did_not_make_is_replaced_by_force_only(solved: Call, folder: Path, command: str) -> None:
    mine = folder / f"mine{SUFFIXES.get(command, '.yaml')}"
    mine.write_text(BEAM)
    before = sorted(os.listdir(folder))
    result = solved(*WRITING[command], mine.name)
    assert (result.exit_code, f"'{mine.name}' exists and was not made by ancf2d" in result.stderr) == (2, True)
    assert sorted(os.listdir(folder)) == before
    assert mine.read_text() == BEAM
    quick = {"tradeoff": ["--element", "cable", "--elements", "1,2", "--repeat", "1"], "csv": ["--jobs", "1"],
             "animation": ["--frames", "2"]}
    arguments = [*WRITING[command], mine.name, *quick.get(command, [])]
    assert solved(*arguments, "--force").exit_code == 0
    assert mine.read_bytes() != BEAM.encode()
    assert solved(*arguments).exit_code == 0


@covering(command=WRITING, name=["", ".", "/", "..", "none/a.csv", "beam.yaml/a.csv", 300 * "x"])
def test_a_file_that_cannot_be_is_told_first(solved: Call, folder: Path, command: str, name: str) -> None:
    before = sorted(os.listdir(folder))
    result = solved(*WRITING[command], name)
    assert result.exit_code == 2
    assert result.stderr.startswith("error: ")
    assert "internal error" not in result.stderr
    assert sorted(os.listdir(folder)) == before


def test_new_never_replaces_a_case_unasked(call: Call, folder: Path) -> None:
    assert call("new", "beam").exit_code == 2
    assert (folder / "beam.yaml").read_text() == BEAM
    for name in ("", "sub/", "none/case", 300 * "x"):
        result = call("new", name)
        assert (result.exit_code, "internal error" in result.stderr) == (2, False), name
    assert os.listdir(folder) == ["beam.yaml"]
    assert call("new", "beam", "--force").exit_code == 0
    assert call("validate", "beam.yaml").exit_code == 0


ODD = "\x1b]0;mine\x07\x9b31m\u202eb"


def test_terminals_are_given_no_commands_by_names_and_titles(call: Call, folder: Path) -> None:
    """Titles and names of files are shown with escapes in place of what a terminal would obey."""
    named = f"case{ODD}.yaml"
    (folder / named).write_text(BEAM.replace("title: Cantilever with a tip force", f"title: {json.dumps(ODD)}"))
    (folder / f"bad{ODD}.yaml").write_text(BEAM.replace("EI: 1.0e3", "EI: -1"))
    for arguments in (("run", named, "-o", f"a{ODD}.h5"), ("run", named, "--json", "-o", "b.h5"), ("validate", named),
                      ("validate", f"bad{ODD}.yaml"), ("info", "b.h5"), ("info", f"a{ODD}.h5"), ("plot", f"a{ODD}.h5"),
                      ("compare", "b.h5", f"a{ODD}.h5"), ("convergence", named, "--elements", "1,2"),
                      ("run", f"no{ODD}.yaml"), ("run", named, "--set", f"x{ODD}=1"), ("plot", "b.h5", f"kind{ODD}"),
                      ("sweep", named, "--over", "loads.tip.value=[0,-1]", "--jobs", "1"), (f"a{ODD}",),
                      ("run", named, f"--{ODD}"), ("audit", ODD), ("elements", ODD), ("new", f"new{ODD}")):
        result = call(*arguments)
        assert result.exit_code in (0, 2), result.output
        assert "internal error" not in result.output
        assert not set("\x1b\x07\x9b\u202e") & set(result.stdout + result.stderr), arguments
    assert r"\x1b]0;mine\x07" in call("info", "b.h5").stdout
