"""Version, licence, changelog and citation agree everywhere."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import yaml

import ancf2d

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
RELEASES = re.findall(r"^## \[(.+?)\](?: - (\d{4}-\d\d-\d\d))?$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"),
                      re.M)


def test_version_and_licence_are_the_same_in_package_citation_and_project() -> None:
    assert PROJECT["version"] == ancf2d.__version__ == CITATION["version"]
    assert PROJECT["license"] == CITATION["license"]


def test_the_changelog_begins_with_this_version_and_is_ordered_by_date() -> None:
    released = [r for r in RELEASES if r[0] != "Unreleased"]
    assert released[0] == (ancf2d.__version__, CITATION["date-released"])
    assert [date for _, date in released] == sorted((date for _, date in released), reverse=True)


def test_every_change_is_of_a_known_kind() -> None:
    kinds = re.findall(r"^### (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    assert set(kinds) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_the_citation_has_what_its_format_requires() -> None:
    # Citation File Format 1.2.0: these keys, and for each reference type, title and authors
    assert CITATION["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= set(CITATION)
    for reference in CITATION["references"]:
        assert {"type", "title", "authors"} <= set(reference)
        assert re.fullmatch(r"10\.\d{4,9}/\S+", reference["doi"])
    assert all({"name"} <= set(a) or {"family-names"} <= set(a) for a in CITATION["authors"])
