"""Every example at the end of a command's help runs, in a folder with the files it names."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner
from commandline import BEAM

from ancf2d.cli import main
from ancf2d.cli.app import COMMANDS, app

pytestmark = pytest.mark.slow

MINE = """\
name: mine
basis: ["1", "x", "y", "x*y", "x^2 + nu*y^2", "x^3"]
nodes: [{at: 0, coordinates: [r, r_x, r_y]}, {at: 1, coordinates: [r, r_x, r_y]}]
formulation: continuum
"""
STEEL = BEAM.replace("{EA: 1.0e6, kGA: 3.0e5, EI: 1.0e3}", "{height: 0.1, width: 0.1}\n"
                     "    material: {E: 2.07e11, nu: 0.3, rho: 7850}").replace("linear_static", "static, steps: 2")
STEEL = STEEL.partition("expected")[0]


def examples(name: str) -> list[str]:
    """Return the command lines at the end of a command's help."""
    command = app.get_command(None, name)  # type: ignore[arg-type]
    assert command is not None
    return [line.strip() for line in (command.epilog or "").splitlines() if line.startswith("  ")]


def invoke(line: str) -> None:
    """Run a command line, up to the parts that need a shell."""
    words = shlex.split(line)
    words = words[:next((k for k, word in enumerate(words) if word in (">", ">>")), None)]
    result = CliRunner().invoke(main, words[1:])
    assert result.exit_code == 0, f"{line}\n{result.output}"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with the cases and result files of the examples."""
    folder = tmp_path_factory.mktemp("examples")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        (folder / "beam.yaml").write_text(STEEL)
        (folder / "mine.yaml").write_text(MINE)
        invoke("ancf2d new swing --kind pendulum")
        swing = (folder / "swing.yaml").read_text()
        (folder / "swing.yaml").write_text(swing.replace("t_end: 1.5", "t_end: 0.02").replace("count: 8", "count: 2"))
        for line in ("run beam.yaml", "run beam.yaml -o stored.h5", "run swing.yaml", "export beam.h5 tip.csv"):
            invoke(f"ancf2d {line}")
        yield folder


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_examples(name: str) -> None:
    assert examples(name)
    assert {line.split()[:2] == ["ancf2d", name] for line in examples(name)} == {True}


# view without --save serves its page until it is interrupted: tests/cli/test_cli_view.py; compiling everything takes
# minutes: tests/cli/test_cli_first_run.py
@pytest.mark.parametrize("line", [line for name in COMMANDS for line in examples(name)
                                  if name != "compile" and (name != "view" or "--save" in line)])
def test_an_example_runs(line: str, place: Path) -> None:
    invoke(line)
