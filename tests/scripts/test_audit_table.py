"""The page of the audit: every check is explained, every listed type has its verdicts."""

import re
from pathlib import Path

import pytest

from ancf2d.elements.registry import ELEMENTS
from ancf2d.study.audit.examine import CHECKS, LAW_CHECKS, audit
from ancf2d.study.audit.subject import FAIL, PASS, subject
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


def rows_below(mark):
    """Return the rows of a generated table, without its second line."""
    text = PAGE[PAGE.index(f"<!-- generated: {mark} -->"):]
    head, _, *rows = text[:text.index("<!-- end -->")].splitlines()[1:]
    return [[cell.strip() for cell in line.split(" | ")] for line in (row.strip("| ") for row in (head, *rows))]


@pytest.mark.parametrize("number", range(len(audit_table.asked())), ids=list(audit_table.asked()))
def test_the_page_is_current(number):
    """A third of the checks for each type, and a third of the types for each check."""
    title, (name, options) = list(audit_table.asked().items())[number]
    (head, *rows), (_, *failed) = rows_below("audit-verdicts"), rows_below("audit-failures")
    shown = {row[0].strip("`"): row[head.index(title)] for row in rows}
    known = [c for c in CHECKS if c.name not in audit_table.LEFT_OUT]
    assert list(shown) == [c.name for c in known]
    for answer in audit(subject(name, **options), known[number % 3::3]).results:
        found, check = answer.finding, answer.check.name
        assert shown[check] == {PASS: "pass", FAIL: "**fail**"}.get(found.verdict, "note"), check
        told = [row[2:] for row in failed if row[:2] == [title, f"`{check}`"]]
        assert told == ([["-" if found.value is None else f"{found.value:.3g}", found.meaning]]
                        if found.verdict == FAIL else []), "run: python -m scripts.make_docs"


def test_tables_agree_with_the_audit(monkeypatch):
    some = {k: v for k, v in audit_table.asked().items() if k in ("2d2n", "omar, paper")}
    monkeypatch.setattr(audit_table, "asked", lambda: some)
    rows = [[c.strip() for c in line.split("|")[1:-1]] for line in audit_table.verdicts().splitlines()]
    assert rows[0] == ["check", "2d2n", "omar, paper"]
    assert ["`reversal_symmetry`", "**fail**", "pass"] in rows
    assert ["`shear_factor`", "pass", "**fail**"] in rows
    failures = audit_table.failures()
    assert "| omar, paper | `shear_factor` | 0.5 |" in failures
    assert failures.count("2d2n | `spurious_branch`") == 1
