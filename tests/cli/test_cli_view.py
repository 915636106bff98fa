"""``ancf2d view``, and fields and animations of ``ancf2d plot``, as a user calls them."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from commandline import BEAM

import ancf2d.view as view_module

Call = Callable[..., Result]


@pytest.fixture
def solved(call: Call, folder: Path) -> Call:
    stiffnesses = "section: {EA: 1.0e6, kGA: 3.0e5, EI: 1.0e3}"
    rectangle = "section: {height: 0.1, width: 0.1}\n    material: {E: 1.0e8, nu: 0.3}"
    assert stiffnesses in BEAM
    (folder / "beam.yaml").write_text(BEAM.replace(stiffnesses, rectangle))
    solver = "solver={type: static, steps: 3}"
    assert call("run", "beam.yaml", "--set", solver, "--set", "output.fields=[stress, M]", "-q").exit_code == 0
    return call


def test_a_page_is_saved_and_its_size_and_contents_are_printed(solved: Call, folder: Path) -> None:
    result = solved("view", "beam.h5", "--save", "page.html")
    assert result.exit_code == 0
    text = (folder / "page.html").read_text(encoding="utf-8")
    assert text.startswith("<!doctype html>")
    size = round(len(text.encode()) / 1e3)
    assert result.stdout.startswith(f"wrote page.html ({size} kB; all 4 states, displacements to 1/32767")


def test_a_page_shows_fields_that_are_computed_from_states(solved: Call, folder: Path) -> None:
    assert solved("view", "beam.h5", "--field", "strain", "--field", "N", "--save", "page.html").exit_code == 0
    text = (folder / "page.html").read_text(encoding="utf-8")
    names = json.loads("[" + ",".join(re.findall(r'{"name":("[^"]*"),"frames"', text)) + "]")
    assert names == ["strain along the axis, ε_xx", "strain across the axis, ε_yy", "shear strain, 2 ε_xy",
                     "axial force N"]
    result = solved("view", "beam.h5", "--field", "warp", "--save", "other.html")
    assert result.exit_code == 2
    assert "has no field 'warp' (it has stress, strain, energy, N, Q, M)" in result.stderr


@pytest.mark.parametrize("flag", [True, False])
def test_a_page_is_served_and_opened_in_the_browser_unless_disabled(solved: Call, monkeypatch: pytest.MonkeyPatch,
                                                                    flag: bool) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(view_module, "serve", lambda html, port, ready: ready(f"http://127.0.0.1:{port}/"))
    result = solved("view", "beam.h5", "--port", "8123", *(["--no-browser"] if flag else []))
    assert result.stdout.startswith("beam.h5 is served at http://127.0.0.1:8123/ until Ctrl-C (all 4 states")
    assert opened == ([] if flag else ["http://127.0.0.1:8123/"])


@pytest.mark.parametrize(("arguments", "said"), [
    (["beam.h5", "--save", "beam.h5"], "is an input of this command"),
    (["beam.yaml"], "is not an HDF5 file"),
    (["none.h5"], "there is no result file 'none.h5'"),
    (["beam.h5", "--save", "none/page.html"], "cannot write 'none/page.html'"),
], ids=lambda value: " ".join(value) if isinstance(value, list) else "")
def test_view_refuses_with_a_sentence(solved: Call, folder: Path, arguments: list[str], said: str) -> None:
    before = (folder / "beam.h5").read_bytes()
    result = solved("view", *arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert (folder / "beam.h5").read_bytes() == before


@pytest.mark.slow
def test_fields_and_animations_of_a_solved_case(solved: Call, folder: Path) -> None:
    assert solved("plot", "beam.h5", "fields", "--component", "xy", "--save", "s.pdf").exit_code == 0
    assert solved("plot", "beam.h5", "section_forces", "--data", "M.csv").exit_code == 0
    assert solved("plot", "beam.h5", "--animate", "a.gif", "--frames", "3").stdout == "wrote a.gif (shape)\n"
    assert sorted(os.listdir(folder)) == ["M.csv", "a.gif", "beam.h5", "beam.yaml", "s.pdf"]
    assert "--state, --unrolled, --animate" in solved("plot", "beam.h5", "--list").stdout


@pytest.mark.parametrize(("arguments", "said"), [
    (["fields", "--field", "warp"], "has no field 'warp' (it has stress, strain, energy;"),
    (["section_forces", "--quantity", "Z"], "draws N, Q, M, not 'Z'"),
    (["history", "--animate", "a.gif"], "history cannot be animated"),
    (["--animate", "a.png"], "animations are .gif or .mp4 files"),
    (["--animate", "beam.h5"], "is an input of this command"),
    (["snapshots", "--at", "0,7"], "holds states from 0 to 1, none at 7"),
], ids=lambda value: " ".join(value) if isinstance(value, list) else "")
def test_unavailable_figures_are_explained(solved: Call, folder: Path, arguments: list[str], said: str) -> None:
    result = solved("plot", "beam.h5", *arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert sorted(os.listdir(folder)) == ["beam.h5", "beam.yaml"]
