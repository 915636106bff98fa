"""The page of the examination: every check is explained, every listed type has its verdicts."""

import re
from pathlib import Path

import pytest

from ancf2d.elements.registry import ELEMENTS
from ancf2d.study.audit.examine import CHECKS, LAW_CHECKS
from scripts import audit_table

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "audit.md").read_text(encoding="utf-8")


def test_every_check_is_explained_and_nothing_else():
    explained = PAGE[PAGE.index("## Checks"):PAGE.index("## Verdicts")]
    first = re.findall(r"^\| (`.*?) \|", explained, re.M)
    assert {name for cell in first for name in re.findall(r"`(\w+)`", cell)} == {
        c.name for c in (*CHECKS, *LAW_CHECKS)}


@pytest.mark.parametrize("name", ELEMENTS)
def test_the_page_has_a_column_for_every_listed_type(name):
    head = next(line for line in PAGE.splitlines() if line.startswith("| check | omar"))
    assert name in [cell.strip() for cell in head.split("|")]


def test_tables_agree_with_the_examination(monkeypatch):
    some = {k: v for k, v in audit_table.asked().items() if k in ("2d2n", "omar, paper")}
    monkeypatch.setattr(audit_table, "asked", lambda: some)
    rows = [[c.strip() for c in line.split("|")[1:-1]] for line in audit_table.verdicts().splitlines()]
    assert rows[0] == ["check", "2d2n", "omar, paper"]
    assert ["`reversal_symmetry`", "**fail**", "pass"] in rows
    assert ["`shear_factor`", "pass", "**fail**"] in rows
    failures = audit_table.failures()
    assert "| omar, paper | `shear_factor` | 0.5 |" in failures
    assert failures.count("2d2n | `spurious_branch`") == 1
