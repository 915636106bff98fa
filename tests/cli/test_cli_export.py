"""``ancf2d export`` as a user calls it."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from ancf2d.results.export import FORMATS

Call = Callable[..., Result]


@pytest.fixture
def solved(call: Call) -> Call:
    assert call("run", "beam.yaml", "-q", "--set", "solver={type: static, steps: 3}").exit_code == 0
    return call


def test_probes_are_columns_named_as_in_the_contract(solved: Call, folder: Path) -> None:
    result = solved("export", "beam.h5", "tip.csv")
    assert (result.exit_code, result.stdout) == (0, "wrote tip.csv (the probes over time, load factor or frequency)\n")
    rows = list(csv.DictReader((folder / "tip.csv").read_text().splitlines()))
    assert list(rows[0])[:3] == ["factor", "tip.x", "tip.y"]
    summary = json.loads(solved("info", "beam.h5", "--json").stdout)["summary"]
    assert float(rows[-1]["tip.uy"]) == summary["probes"]["tip"]["uy"]
    assert [float(row["factor"]) for row in rows] == pytest.approx([0, 1 / 3, 2 / 3, 1])


def test_the_help_describes_every_format(call: Call) -> None:
    described = call("export", "--help").stdout.split("Examples:")[0]
    assert [suffix for suffix in FORMATS if suffix not in described] == []


def test_json_object_names_the_file(solved: Call, folder: Path) -> None:
    found: dict[str, Any] = json.loads(solved("export", "beam.h5", "all.json", "--json").stdout)
    assert found == {"file": "beam.h5", "output": "all.json", "status": "written",
                     "bytes": (folder / "all.json").stat().st_size}


@pytest.mark.parametrize(("arguments", "said"), [
    (("beam.h5", "beam.xdmf"), "unknown suffix '.xdmf' (known: .vtkhdf, "),
    (("beam.h5", "beam.yaml"), "unknown suffix '.yaml'"), (("beam.h5", "there.csv"), "replace it with --force"),
    (("none.h5", "a.csv"), "there is no result file 'none.h5'"), (("beam.yaml", "a.csv"), "is not an HDF5 file"),
    (("beam.h5", "none/a.csv"), "does not exist"), (("beam.h5",), "missing argument")],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "")
def test_refusals_exit_with_2_and_change_nothing(solved: Call, folder: Path, arguments: tuple[str, ...],
                                                 said: str) -> None:
    (folder / "there.csv").write_text("mine")
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    result = solved("export", *arguments)
    assert (result.exit_code, said in result.stderr) == (2, True), result.stderr
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_a_study_without_probes_says_where_to_export_its_table(call: Call) -> None:
    assert call("sensitivity", "beam.yaml", "--set", "goal={probe: tip, quantity: uy}", "--to", "loads.0.value.1",
                "-o", "study.h5").exit_code == 0
    result = call("export", "study.h5", "study.csv")
    assert (result.exit_code, "--data FILE.csv" in result.stderr) == (2, True), result.stderr
    assert call("plot", "study.h5", "--data", "study.csv").exit_code == 0


def test_force_replaces(solved: Call, folder: Path) -> None:
    (folder / "there.csv").write_text("mine")
    assert solved("export", "beam.h5", "there.csv", "--force").exit_code == 0
    assert (folder / "there.csv").read_text().startswith("factor,tip.x")
