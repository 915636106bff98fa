"""The verification manual: every case with its references, what is computed, and whether they agree.

What a case is about stands at the head of its file, and is taken from there.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ancf2d.study.run import load, run_case
from scripts.pages import CASES, table

# a difference below this is round-off, whose digits depend on the machine
ROUND_OFF = 1e-9
AREAS = {
    "paper": "The paper's tables", "static": "Static equilibrium", "paths": "Equilibrium paths and limit points",
    "buckling": "Buckling loads", "modes": "Natural frequencies", "dynamic": "Motion",
    "contact": "Contact",
}
TOP = """# Verification manual

This manual lists every case in `cases/` with its references: closed forms, differential equations solved to many
digits, other programs, and published values, each with its source. It is written by `python -m scripts.make_docs`,
which solves all cases.

*Allowed* is the tolerance of the case: half a unit of the last printed digit for published values, otherwise the
discretisation error that the case is meant to show. The verdict is `ok` if the value is within the tolerance.
`ancf2d run CASE` prints the same comparison:

```bash
ancf2d run cases/static/elastica.yaml
```

[accuracy.md](accuracy.md) describes the discretisation and model errors to expect, [motion.md](motion.md) compares
motions over their whole duration, [table3.md](table3.md) lists all printed frequencies, and
[audit.md](audit.md) examines single elements.
"""


@dataclass(frozen=True)
class Verified:
    """A case: its name below cases, its title, what it is about, and its checks as a run tells them."""

    name: str
    title: str
    about: str
    checks: list[dict[str, Any]]

    @property
    def met(self) -> int:
        """How many of the references are met."""
        return sum(c["met"] for c in self.checks)


def about(text: str) -> str:
    """Return the comment at the head of a case as Markdown: lines that it indents stay as they are."""
    head = re.match(r"(?:#.*\n)*", text)
    lines = [line[1:].removeprefix(" ") for line in head[0].splitlines()] if head else []
    out: list[str] = []
    inside = False
    for line in lines:
        code = line.startswith("    ")
        if code != inside:
            out += ["", "```text"] if code else ["```"]
            inside = code
        out.append(line[4:] if code else _escaped(line))
    return "\n".join(out + (["```"] if inside else []))


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;").replace("*", "\\*")


def summary_of(file: Path) -> dict[str, Any]:
    """Solve a case; return its summary. Raises CaseError where it is no case."""
    return run_case(load(file)).summary


def verified(file: Path, solved: Callable[[Path], dict[str, Any]] = summary_of) -> Verified:
    """Return what the manual says of a case, as ``solved`` solves it."""
    return Verified(file.relative_to(CASES).with_suffix("").as_posix(), load(file).case.title,
                    about(file.read_text(encoding="utf-8")), solved(file)["checks"])


def row(check: dict[str, Any]) -> list[str]:
    """Return a reference beside the computed value; digits that are round-off are not shown."""
    expected, value, allowed = check["expected"], check["value"], check["allowed"]
    if value is None:
        return [check["what"], f"{expected:.9g}", "-", "-", f"{allowed:.1e}", "not solved", check["source"]]
    off = abs(check["difference"])
    return [check["what"], f"{expected:.9g}", "0" if abs(value) < ROUND_OFF * allowed else f"{value:.7g}",
            "round-off" if off < ROUND_OFF * (abs(expected) or 1.0) else f"{off:.1e}", f"{allowed:.1e}",
            "ok" if check["met"] else "**not met**", check["source"]]


def section(case: Verified) -> str:
    """Return what the manual says of a case."""
    head = ["value", "reference", "computed", "difference", "allowed", "verdict", "source"]
    found = table(head, list(map(row, case.checks))) if case.checks else "An example; no reference is known."
    return f"### {case.name}\n\n[{_escaped(case.title)}](../cases/{case.name}.yaml)\n\n{case.about}\n\n{found}\n"


def manual(solved: Callable[[Path], dict[str, Any]] = summary_of) -> str:
    """Return docs/verification.md."""
    found = {area: [verified(file, solved) for file in sorted((CASES / area).glob("*.yaml"))] for area in AREAS}
    summary = []
    for area, cases in found.items():
        title = AREAS[area]
        anchor = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
        summary.append([f"[{title}](#{anchor})", len(cases), sum(len(c.checks) for c in cases),
                        sum(c.met for c in cases)])
    parts = [TOP, table(["", "cases", "references", "met"], summary) + "\n"]
    for area, cases in found.items():
        parts += [f"## {AREAS[area]}\n", *map(section, cases)]
    return "\n".join(parts)
