"""What a check finds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .subject import Subject

PASS, FAIL, NOTE = "pass", "fail", "note"
# below this share of its scale a number is round-off
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Finding:
    """A number (None where there is none), a verdict (pass, fail, note) and one line that says what it means."""

    value: float | None
    verdict: str
    meaning: str


@dataclass(frozen=True)
class Check:
    """One question put to an element: its name, the question, and the computation that answers it.

    ``work`` is about how long that takes, compared with the other checks.
    """

    name: str
    question: str
    examine: Callable[[Subject], Finding]
    work: float = 1.0


@dataclass(frozen=True)
class Answer:
    """A check with what it found."""

    check: Check
    finding: Finding

    def as_json(self) -> dict[str, Any]:
        """Return what ``--json`` prints of a check."""
        f = self.finding
        return {"name": self.check.name, "value": f.value, "verdict": f.verdict, "meaning": f.meaning,
                "question": self.check.question}


def judged(value: float, allowed: float, good: str, bad: str) -> Finding:
    """Return a finding that passes up to an allowed size; a number that is none fails."""
    if math.isfinite(value) and abs(value) <= allowed:
        return Finding(value, PASS, good)
    return Finding(value, FAIL, bad)


def percent(share: float) -> str:
    """Return a share as people read it: 9.0 %, 0.02 %."""
    size = abs(100.0 * share)
    return f"{size:.1f} %" if size >= 0.1 else f"{size:.2g} %"


def plural(count: int, what: str) -> str:
    """Return '1 mode', '2 modes'."""
    return f"{count} {what}{'' if count == 1 else 's'}"
