"""The verification manual: every case is in it and meets its references; sections follow from cases."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "verification.md").read_text(encoding="utf-8")
CASES = sorted(p.relative_to(ROOT / "cases").with_suffix("").as_posix() for p in (ROOT / "cases").rglob("*.yaml"))


@pytest.fixture
def manual() -> Any:
    from scripts import verification_manual

    return verification_manual


def check(**more: Any) -> dict[str, Any]:
    return {"what": "tip uy", "expected": -2.0, "value": -2.001, "difference": -0.001, "allowed": 0.01, "met": True,
            "source": "by hand", **more}


def test_the_page_has_a_section_for_exactly_every_case() -> None:
    assert sorted(re.findall(r"^### (\S+)$", PAGE, re.M)) == CASES


def test_every_reference_on_the_page_is_met() -> None:
    verdicts = re.findall(r"^\|(?:[^|\n]*\|){5} ([^|\n]*) \|[^|\n]*\|$", PAGE, re.M)
    assert set(verdicts) == {"verdict", "---", "ok"}
    summary = re.findall(r"^\| \[.*?\]\(#.*?\) \| (\d+) \| (\d+) \| (\d+) \|$", PAGE, re.M)
    counts = [[int(n) for n in row] for row in summary]
    assert sum(cases for cases, _, _ in counts) == len(CASES)
    assert all(references == met for _, references, met in counts)
    assert sum(met for *_, met in counts) == verdicts.count("ok")


def test_a_missed_reference_is_marked(manual: Any) -> None:
    assert manual.row(check()) == ["tip uy", "-2", "-2.001", "1.0e-03", "1.0e-02", "ok", "by hand"]
    assert manual.row(check(met=False))[5] == "**not met**"
    assert manual.row(check(value=None, difference=None, met=False))[5] == "not solved"
    assert manual.row(check(value=-2.0, difference=1e-16))[3] == "round-off"
    assert manual.row(check(expected=0.0, value=1e-15, difference=1e-15, allowed=1e-3))[2:4] == ["0", "round-off"]


def test_the_introduction_is_the_head_of_the_case(manual: Any) -> None:
    text = "# Beam, L*h < 2\n#\n# Run it:\n#     ancf2d run <case>\n# and look.\nformat: 1\n# not this\n"
    assert manual.about(text) == ("Beam, L\\*h &lt; 2\n\nRun it:\n\n```text\nancf2d run <case>\n```\nand look.")


def test_a_case_without_references_is_an_example(manual: Any) -> None:
    section = manual.section(manual.Verified("static/a", "A * b", "About.", []))
    assert section.startswith("### static/a\n\n[A \\* b](../cases/static/a.yaml)\n\nAbout.\n")
    assert "no reference is known" in section
