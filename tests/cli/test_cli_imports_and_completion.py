"""The start of the command line: imports, help, completion."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result
from commandline import run_python

import ancf2d
import ancf2d.cli
from ancf2d.cli import main
from ancf2d.cli.app import COMMANDS, app

HEAVY = ("numpy", "scipy", "numba", "yaml", "h5py", "matplotlib")


def modules_after(*commands: list[str]) -> list[set[str]]:
    """Return which large packages a process has imported after each of some command lines."""
    found = run_python(f"""
import json, sys
from ancf2d.cli import main
for arguments in {commands!r}:
    try:
        main(arguments)
    except SystemExit as end:
        assert end.code == 0, end.code
    print(json.dumps([m for m in {HEAVY!r} if m in sys.modules]), file=sys.stderr)
""")
    assert found.returncode == 0, found.stderr
    return [set(json.loads(line)) for line in found.stderr.strip().split("\n")]


def test_help_imports_no_library() -> None:
    commands = [["--help"], ["--version"], *([name, "--help"] for name in COMMANDS)]
    found = modules_after(*commands)
    assert [c for c, modules in zip(commands, found, strict=True) if modules] == []


@pytest.mark.parametrize("wanted", [None, "3"])
def test_products_of_matrices_take_one_thread_by_default(monkeypatch: pytest.MonkeyPatch,
                                                         wanted: str | None) -> None:
    """OpenBLAS reads its number of threads when NumPy loads it: the command line must set it before."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if wanted is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", wanted)
    found = run_python("""
import os, sys
import ancf2d.cli
assert "numpy" not in sys.modules
print(os.environ["OPENBLAS_NUM_THREADS"])
""")
    assert found.stdout.split() == [wanted or "1"], found.stderr


def test_validate_imports_no_compiler_and_no_file_format(folder: Path) -> None:
    assert modules_after(["validate", "beam.yaml"]) == [{"numpy", "yaml"}]


def test_every_command_has_a_module_and_every_command_module_is_listed() -> None:
    folder = Path(ancf2d.cli.__file__).parent
    modules = {p.stem for p in folder.glob("*.py") if "@click.command" in p.read_text()}
    assert modules == set(COMMANDS)
    for name in COMMANDS:
        command = app.get_command(None, name)  # type: ignore[arg-type]
        assert command is not None
        assert command.help


@pytest.mark.parametrize("name", COMMANDS)
def test_no_default_has_nested_brackets(name: str) -> None:
    command = app.get_command(None, name)  # type: ignore[arg-type]
    assert "[default: (" not in " ".join(command.get_help(click.Context(command, info_name=name)).split())


def test_completion_names_commands_kinds_and_options() -> None:
    def complete(words: str, number: int) -> list[str]:
        asked = {"COMP_WORDS": words, "COMP_CWORD": str(number), "_ANCF2D_COMPLETE": "bash_complete"}
        found = CliRunner().invoke(main, [], prog_name="ancf2d", env=asked)
        return [line.partition(",")[2] for line in found.stdout.split()]

    assert complete("ancf2d ", 1) == list(COMMANDS)
    assert "frame" in complete("ancf2d new --kind f", 3)
    assert "--set" in complete("ancf2d run --s", 2)
    assert complete("ancf2d elements reis", 2) == ["reissner2", "reissner3"]
    assert complete("ancf2d convergence beam.yaml --element cable,reis", 4) == ["cable,reissner2", "cable,reissner3"]
    assert complete("ancf2d plot beam.h5 sn", 3) == ["snapshots"]


@pytest.mark.slow_rows("words3-expected3")
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash is installed")
@pytest.mark.parametrize(("words", "expected"), [
    pytest.param(["ancf2d", "conv"], ["convergence"], marks=pytest.mark.slow),
    (["ancf2d", "run", "--acc"], ["--accuracy"]),
    pytest.param(["ancf2d", "completion", "f"], ["fish"], marks=pytest.mark.slow), (["ancf2d", "plot", "be"], [])])
def test_bash_completes_with_the_printed_completion(words: list[str], expected: list[str],
                                                    folder: Path) -> None:
    (folder / "bin").mkdir()
    program = folder / "bin" / "ancf2d"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ancf2d "$@"\n')
    program.chmod(0o755)
    quoted = " ".join(words)
    # compopt speaks only to a completion under way; what it would be told is printed in its place
    script = f"""
compopt() {{ printf 'compopt %s %s\\n' "$@"; }}
eval "$(ancf2d completion bash)"
complete -p ancf2d
COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}
_ancf2d_completion ancf2d
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(["bash", "--norc", "-c", script], capture_output=True, text=True, check=True, timeout=60,
                          env={**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}"})
    first, *found = done.stdout.split("\n")
    assert "-F _ancf2d_completion ancf2d" in first
    assert [line for line in found if line] == (expected or ["compopt -o default"])


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_get_instructions(shell: str, call: Callable[..., Result]) -> None:
    script = call("completion", shell).stdout
    assert f"_ANCF2D_COMPLETE={shell}_complete" in script


def test_a_shell_without_completion_is_refused(call: Callable[..., Result]) -> None:
    assert call("completion", "csh").exit_code == 2


def test_the_version_is_that_of_the_package(call: Callable[..., Result]) -> None:
    assert call("--version").stdout.split()[-1] == metadata.version("ancf2d") == ancf2d.__version__
