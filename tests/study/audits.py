"""Shared by the tests of the audit: findings of single checks, and elements described in files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ancf2d.study.audit.examine import CHECKS, audit
from ancf2d.study.audit.subject import Finding, Subject, subject


def findings(s: Subject, *names: str) -> dict[str, Finding]:
    """Return the findings of the named checks (all but the cost by default)."""
    chosen = tuple(c for c in CHECKS if (c.name in names if names else c.name != "cost"))
    assert len(chosen) == (len(names) or len(CHECKS) - 1)
    return {a.check.name: a.finding for a in audit(s, chosen).results}


def verdicts(s: Subject, *names: str) -> dict[str, str]:
    """Return the verdicts of the named checks."""
    return {name: f.verdict for name, f in findings(s, *names).items()}


def find(name: str, *checks: str, **options: Any) -> dict[str, Finding]:
    """Return the findings of checks on a listed type or a file."""
    return findings(subject(name, **options), *checks)


def written(folder: Path, basis: list[str], *coordinates: str, places: tuple[float, ...] = (0.0, 1.0),
            **more: Any) -> str:
    """Write the description of an element with a neutral name and return its file."""
    file = folder / "element.yaml"
    nodes = [{"at": at, "coordinates": list(coordinates)} for at in places]
    file.write_text(json.dumps({"name": "mine", "basis": basis, "nodes": nodes, **more}), encoding="utf-8")
    return str(file)
