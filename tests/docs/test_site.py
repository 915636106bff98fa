"""The documents as a site: its table of contents is complete, and it builds without a warning."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
CONFIGURATION = ROOT / "scripts" / "site" / "mkdocs.yml"


def pages(nav: Any) -> list[str]:
    """Return the files that a table of contents names, chapter by chapter."""
    if isinstance(nav, str):
        return [nav]
    return [page for part in (nav.values() if isinstance(nav, dict) else nav) for page in pages(part)]


def test_every_document_is_in_the_table_of_contents_once() -> None:
    nav = yaml.safe_load(CONFIGURATION.read_text(encoding="utf-8"))["nav"]
    documents = [p.name for p in (ROOT / "docs").glob("*.md")] + ["index.md", "CHANGELOG.md", "CONTRIBUTING.md"]
    assert sorted(pages(nav)) == sorted(documents), f"nav of {CONFIGURATION}"


def test_the_readme_lists_every_document() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    listed = text[text.index("\n## Documents\n"):text.index("\n## Elements\n")]
    assert [p.name for p in (ROOT / "docs").glob("*.md") if f"](docs/{p.name})" not in listed] == []


@pytest.mark.skipif(find_spec("mkdocs") is None, reason="MkDocs is not installed: pip install 'ancf2d[docs]'")
@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "-f", str(CONFIGURATION),
                           "-d", str(tmp_path / "site")], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    first = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert 'href="tutorial/' in first
    assert "docs/tutorial" not in first
    gallery = (tmp_path / "site" / "gallery" / "index.html").read_text(encoding="utf-8")
    assert 'href="../cases/static/deep_arch.yaml"' in gallery
    assert (tmp_path / "site" / "cases" / "static" / "deep_arch.yaml").exists()
