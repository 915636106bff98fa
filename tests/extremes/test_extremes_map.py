"""The map of extremes itself: verdicts, stored results, and no wrong cell on the page."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest
from instruments.extremes import cell, table
from instruments.extremes.table import all_rows

import ancf2d

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


def made(compute, limit: float = 1e-3, seconds: float = 5.0) -> cell.Verdict:
    return cell.run(cell.Cell("axis", "1", "vallejo", "measure", limit, compute, seconds))


def refuse() -> cell.Found:
    raise ancf2d.ComputationError("no equilibrium")


def wait() -> cell.Found:
    began = time.process_time()
    while time.process_time() < began + 5.0:
        pass
    return cell.Found(0.0)


@pytest.mark.parametrize(("compute", "verdict"), [
    (lambda: cell.Found(1e-4), "holds"), (lambda: cell.Found(1e-2), "wrong"), (lambda: cell.Found(math.nan), "wrong"),
    (lambda: cell.Found(1e-2, ["round-off limits it"]), "degrades"),
    (lambda: cell.Found(1e-2, ["redundant: a pin"]), "wrong"), (refuse, "refused"), (lambda: 1 / 0, "wrong")])
def test_a_wrong_number_is_wrong_unless_a_warning_announces_it(compute, verdict: str) -> None:
    assert made(compute).verdict == verdict


def test_a_cell_that_takes_too_long_is_abandoned() -> None:
    assert made(wait, seconds=0.1).verdict == "slow"


def test_verdicts_make_tables() -> None:
    rows = [asdict(made(lambda: cell.Found(1e-4))), asdict(made(lambda: cell.Found(1.0)))]
    assert "**wrong** 1e+00 [1]" in table.grids(rows[1:])
    assert "| all | 2 | 1 | 0 | 0 | 0 | 1 |" in table.counts(rows)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Generate the cells of the map if its page is requested."""
    if "every" in metafunc.fixturenames:
        cells = list(all_rows()) if metafunc.config.getoption("pages") else []
        metafunc.parametrize("every", cells, ids=lambda c: c.key)


@pytest.mark.pages
def test_cell(every: cell.Cell, measured: Callable[..., None]) -> None:
    found = cell.run(every)
    for place, maker in (("counts", "counts"), ("map", "grids")):
        measured("extremes.md", place, asdict(found), f"instruments.extremes.table:{maker}")
    assert found.verdict not in ("slow", "wrong")


def test_every_cell_has_a_key_of_its_own() -> None:
    keys = [c.key for c in all_rows()]
    assert len(keys) == len(set(keys)) > 4000


def test_the_page_has_no_wrong_cell() -> None:
    page = (ROOT / "docs" / "extremes.md").read_text(encoding="utf-8")
    assert "**wrong**" not in page
    assert "| all | " in page
