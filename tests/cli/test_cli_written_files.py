"""Files that commands write: which files they replace, and unusual names and texts."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from commandline import BEAM
from helpers import chosen, covering

Call = Callable[..., Result]

WRITING = {
    "run": ("run", "beam.yaml", "-o"), "convergence": ("convergence", "beam.yaml", "-o"),
    "tradeoff": ("tradeoff", "beam.yaml", "-o"), "csv": ("sweep", "beam.yaml", "--over", "title=a", "--csv"),
    "figure": ("plot", "beam.h5", "--save"), "data": ("plot", "beam.h5", "--data"),
    "animation": ("plot", "beam.h5", "--animate"), "view": ("view", "beam.h5", "--save"),
    "sensitivity": ("sensitivity", "beam.yaml", "--to", "loads.tip.value.1", "-o"),
    "history": ("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-6:-1", "--minimise", "goal^2", "--history"),
    "best": ("optimise", "beam.yaml", "--vary", "loads.tip.value.1=-6:-1", "--minimise", "goal^2", "-o"),
    "export": ("export", "beam.h5"), "schema": ("schema", "-o"), "reference": ("schema", "--markdown", "-o")}

SUFFIXES = {"figure": ".png", "animation": ".gif", "export": ".csv", "reference": ".md", "csv": ".csv", "data": ".csv",
            "view": ".html", "best": ".yaml", "schema": ".json"}


@pytest.mark.slow_rows("figure")
@pytest.mark.parametrize("command", chosen(WRITING, ["run", "figure", "export"]))
def test_files_of_other_programs_are_replaced_only_with_force(solved: Call, folder: Path, command: str) -> None:
    mine = folder / f"mine{SUFFIXES.get(command, '.h5')}"
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
def test_an_impossible_output_file_is_reported_first(solved: Call, folder: Path, command: str, name: str) -> None:
    before = sorted(os.listdir(folder))
    result = solved(*WRITING[command], name)
    assert result.exit_code == 2
    assert result.stderr.startswith("error: ")
    assert "internal error" not in result.stderr
    assert sorted(os.listdir(folder)) == before


def test_new_replaces_a_case_only_with_force(call: Call, folder: Path) -> None:
    assert call("new", "beam").exit_code == 2
    assert (folder / "beam.yaml").read_text() == BEAM
    for name in ("", "sub/", "none/case", 300 * "x"):
        result = call("new", name)
        assert (result.exit_code, "internal error" in result.stderr) == (2, False), name
    assert os.listdir(folder) == ["beam.yaml"]
    assert call("new", "beam", "--force").exit_code == 0
    assert call("validate", "beam.yaml").exit_code == 0

ODD = "\x1b]0;mine\x07\x9b31m\u202eb"


def test_control_characters_in_names_and_titles_are_escaped(call: Call, folder: Path) -> None:
    """Titles and file names are printed with escapes in place of control characters."""
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
