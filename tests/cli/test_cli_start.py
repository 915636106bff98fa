"""What the command line costs before it does anything."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from commandline import run_python

import ancf2d.cli
from ancf2d.cli.app import COMMANDS, app

HEAVY = ("numpy", "scipy", "numba", "yaml", "h5py", "matplotlib")


def modules_after(arguments: list[str]) -> set[str]:
    """Return which heavy packages a process has imported after a command line."""
    found = run_python(f"""
import json, sys
from ancf2d.cli import main
try:
    main({arguments!r})
except SystemExit as end:
    assert end.code == 0, end.code
print(json.dumps([m for m in {HEAVY!r} if m in sys.modules]), file=sys.stderr)
""")
    assert found.returncode == 0, found.stderr
    return set(json.loads(found.stderr.strip().split("\n")[-1]))


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], *([name, "--help"] for name in COMMANDS)],
                         ids=" ".join)
def test_help_imports_no_library(arguments: list[str]) -> None:
    assert modules_after(arguments) == set()


def test_validate_imports_no_compiler_and_no_file_format(folder: Path) -> None:
    assert modules_after(["validate", "beam.yaml"]) == {"numpy", "yaml"}


def test_every_command_has_a_module_and_every_command_module_is_listed() -> None:
    folder = Path(ancf2d.cli.__file__).parent
    modules = {p.stem for p in folder.glob("*.py") if "@click.command" in p.read_text()}
    assert modules == set(COMMANDS)
    for name in COMMANDS:
        command = app.get_command(None, name)  # type: ignore[arg-type]
        assert command is not None
        assert command.help


def test_completion_names_commands_kinds_and_options() -> None:
    def complete(words: str, number: int) -> list[str]:
        found = run_python(f"""
import os, runpy, sys
os.environ.update(COMP_WORDS={words!r}, COMP_CWORD="{number}", _ANCF2D_COMPLETE="bash_complete")
sys.argv = ["ancf2d"]
runpy.run_module("ancf2d", run_name="__main__")
""")
        return [line.split(",")[1] for line in found.stdout.split()]
    assert complete("ancf2d ", 1) == list(COMMANDS)
    assert "frame" in complete("ancf2d new --kind f", 3)
    assert "--set" in complete("ancf2d run --s", 2)
