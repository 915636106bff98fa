"""What the site of the documents has beside docs/: the README as its first page, the cases, the licence; for MkDocs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
FIRST = "index.md"


def on_files(files: Files, config: Any) -> Files:
    """Add the files that documents link to outside docs/."""
    added = {name: name for name in ("LICENSE", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff")}
    added[FIRST] = "README.md"
    added |= {p: p for p in (f.relative_to(ROOT).as_posix() for f in ROOT.glob("cases/**/*.yaml"))}
    for place, source in added.items():
        files.append(File.generated(config, place, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links to where the files are on the site."""
    if page.file.src_uri in (FIRST, "CONTRIBUTING.md"):
        return re.sub(r"\]\(docs/", "](", markdown).replace("](README.md", f"]({FIRST}")
    return re.sub(r"\]\(\.\./(README\.md)?", lambda m: f"]({FIRST}" if m[1] else "](", markdown)
