"""plot, info and compare, as a user calls them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

Call = Callable[..., Result]
CallJson = Callable[..., dict[str, Any]]


def test_plot_saves_to_the_given_path_only(solved: Call, folder: Path) -> None:
    assert solved("plot", "beam.h5").stdout == "wrote beam-shape.png (shape)\n"
    assert solved("plot", "beam.h5", "load_deflection", "--save", "path.svg", "--data", "path.csv").exit_code == 0
    assert sorted(os.listdir(folder)) == ["beam-shape.png", "beam.h5", "beam.yaml", "path.csv", "path.svg"]
    assert "tip uy" in (folder / "path.csv").read_text()


def test_plot_lists_kinds_and_explains_unavailable_ones(solved: Call, folder: Path) -> None:
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


def test_info_shows_the_origin_in_text_and_json(solved: Call, call_json: CallJson) -> None:
    assert "ancf2d run beam.yaml --set 'solver={type: static, steps: 3}'" in solved("info", "beam.h5").stdout
    assert call_json("info", "beam.h5", "--json")["steps"] == 3
