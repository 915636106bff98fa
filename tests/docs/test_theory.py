"""The theory covers everything that a case can use."""

from __future__ import annotations

from pathlib import Path

import pytest

from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.elements.registry import ELEMENTS
from ancf2d.solvers.motion.integrators import INTEGRATORS
from ancf2d.solvers.registry import SOLVERS

ROOT = Path(__file__).parents[2]
THEORY = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")


def rows(heading: str) -> str:
    """Return the first columns of the tables below a heading, up to the next heading of the same level."""
    rank = heading.split()[0]
    text = THEORY[THEORY.index(f"\n{heading}\n") + 1:]
    end = text.find(f"\n{rank} ", 1)
    return "\n".join(line.split("|")[1] for line in text[:end].splitlines() if line.startswith("| "))


@pytest.mark.parametrize(("heading", "names"), [
    ("### Choosing an element type", [*ELEMENTS, "ancf", "rigid"]),
    ("## Formulations", list(FORMULATIONS)),
    ("## Motion", list(INTEGRATORS)),
])
def test_every_choice_has_a_row_that_says_when_to_use_it(heading: str, names: list[str]) -> None:
    assert [name for name in names if f"`{name}`" not in rows(heading)] == []


def test_every_solver_has_a_row() -> None:
    assert [kind.tag for kind in SOLVERS if f"`{kind.tag}`" not in rows("## Solvers")] == []  # type: ignore[attr-defined]
