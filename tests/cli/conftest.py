"""A folder with a small case, and the command line as a user calls it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from commandline import BEAM

from ancf2d.case import load_case_text
from ancf2d.cli import main
from ancf2d.study.run import run_case, vocabulary


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """Compile the kernels before tests look at the output of the command line."""
    run_case(load_case_text(BEAM, vocabulary=vocabulary()))


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run studies in this process, which has its imports, unless a test sets --jobs."""
    monkeypatch.setattr("ancf2d.processors.cores", lambda: 1)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory with the case ``beam.yaml``."""
    (tmp_path / "beam.yaml").write_text(BEAM)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def call(folder: Path) -> Callable[..., Result]:
    """The command line in this process, as ``call("run", "beam.yaml")``."""
    def invoke(*arguments: str) -> Result:
        return CliRunner().invoke(main, list(arguments))
    return invoke


@pytest.fixture
def solved(call: Callable[..., Result]) -> Callable[..., Result]:
    """As ``call``, in a folder with the result file ``beam.h5`` of the case, of three steps."""
    assert call("run", "beam.yaml", "--set", "solver={type: static, steps: 3}", "-q").exit_code == 0
    return call


@pytest.fixture
def call_json(call: Callable[..., Result]) -> Callable[..., dict[str, Any]]:
    """As ``call``, but return the one JSON object that must be all of stdout."""
    def invoke(*arguments: str) -> dict[str, Any]:
        found = json.loads(call(*arguments).stdout, parse_constant=_no_constant)
        assert isinstance(found, dict)
        return found
    return invoke


def _no_constant(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")
