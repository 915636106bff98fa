"""``ancf2d validate`` as a user calls it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from click.testing import Result
from commandline import BEAM

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]


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


def test_validate_warns_of_a_restitution_without_impacts(call: Call, call_json: CallJson, folder: Path) -> None:
    floor = "obstacles: {floor: {type: half_plane, through: [0, -1], normal: [0, 1]}}\n"
    touch = "contacts: [{between: [beam, floor], restitution: 0.5}]\n"
    (folder / "touch.yaml").write_text(BEAM.replace("linear_static", "static") + floor + touch)
    said = "contacts.0.restitution: solver static computes no impacts, so it has no effect"
    assert call_json("validate", "touch.yaml", "--json")["cases"][0]["warnings"] == [said]
    assert f"warning: {said}" in call("run", "touch.yaml").stderr
    motion = ("--set", "solver={type: dynamic, t_end: 1}", "--set", "goal=null", "--set", "bodies.beam.section.rhoA=1",
              "--set", "expected=null")
    assert call_json("validate", "touch.yaml", "--json", *motion)["cases"][0]["warnings"] == []


def test_validate_json_lists_the_problems_of_every_case(call_json: CallJson, folder: Path) -> None:
    (folder / "wrong.yaml").write_text(BEAM.replace("EI: 1.0e3", "EI: -1"))
    found = call_json("validate", "beam.yaml", "wrong.yaml", "none.yaml", "--json")
    assert found["status"] == "failed"
    assert [c["status"] for c in found["cases"]] == ["ok", "failed", "failed"]
    problem = found["cases"][1]["problems"][0]
    assert (problem["file"], problem["line"], problem["path"]) == ("wrong.yaml", 6, "bodies.beam.section.EI")
    assert call_json("validate", "beam.yaml", "--json")["status"] == "ok"


def test_problems_of_models_name_their_keys(call: Call, folder: Path) -> None:
    """Reading the case does not find them: what an element type cannot have, and a place without a node."""
    (folder / "shear.yaml").write_text(BEAM.replace("type: cable", "type: cable, shear_factor: 0.5"))
    result = call("validate", "shear.yaml")
    assert "error: bodies.beam.element.shear_factor: cable has no shear, so shear_factor has no" in result.stderr
    result = call("validate", "beam.yaml", "--set",
                  "boundary_conditions+={type: fix, at: beam@0.3, coordinates: [x]}", "--set",
                  "bodies.beam.element.nodes=regular")
    assert "error: boundary_conditions.1.at: fix holds coordinates of a node, and there is no node at" in result.stderr
