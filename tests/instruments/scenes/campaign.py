"""Random scenes, examined, and the outcomes."""

from __future__ import annotations

import math
import random
import signal
import traceback
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import yaml

from scripts.pages import table

from .answer import kind_of_message
from .checks import CHECKS, Check, Scene, drawn_by_lot
from .generate import scene
from .shapes import Data
from .shrink import shrunk
from .similar import UnfitError

# checks per scene that need further solutions, drawn by lot
DRAWN = 1
# for a scene with all its checks, of the processor's time, kernels that are compiled included [s]
PATIENCE = 300.0


@dataclass
class Record:
    """The outcome of one scene: of each check, and the violations."""

    number: int
    solver: str
    refusal: str = ""
    outcomes: dict[str, str] = field(default_factory=dict)
    violations: dict[str, str] = field(default_factory=dict)


class TooLongError(BaseException):
    """A scene that takes longer than its time limit; not an answer of ancf2d, so not an ``Exception``."""


def too_long(number: int, frame: FrameType | None) -> None:
    """Raise TooLongError."""
    raise TooLongError


def outcome(item: Scene, check: Check) -> tuple[str, str]:
    """Return the outcome of a check in a word, and the violation, '' unless the word is violated."""
    try:
        found = item.find(check)
    except UnfitError:
        return "unfit", ""
    except Exception:
        return "violated", f"the examination itself failed: {traceback.format_exc(limit=-3)}"
    if found.violated:
        return "violated", f"{found.ratio:.2g} times what is allowed: {found.what}"
    if found.refusal:
        return ("blunt" if found.refusal.startswith("ill-conditioned") else "refused"), ""
    return ("held" if found.ratio <= 1.0 else "announced"), ""


def examine(seed: int, number: int, solver: str | None = None, drawn: int = DRAWN, laws: bool = False) -> Record:
    """Try one scene."""
    case = scene(seed, number, solver, laws)
    item = Scene(case, (seed, number))
    record = Record(number, item.solver)
    rng = random.Random(f"draw {seed} {number}")
    signal.signal(signal.SIGPROF, too_long)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        if item.base.refusal:
            record.refusal = kind_of_message(item.base.refusal)
        for check in drawn_by_lot(item, rng, drawn):
            word, what = outcome(item, check)
            record.outcomes[check.name] = word
            if what:
                record.violations[check.name] = what
    except TooLongError:
        record.refusal = f"given up after {PATIENCE:.0f} s"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return record


def counterexample(seed: int, number: int, solver: str | None, name: str, laws: bool = False) -> Data:
    """Return the smallest scene found that violates a check as a scene does."""
    check = next(c for c in CHECKS if c.name == name)
    case = scene(seed, number, solver, laws)

    def finding(case: Data) -> Any:
        try:
            return Scene(case, (seed, number)).find(check)
        except UnfitError:
            return None

    first = finding(case)

    def violates(smaller: Data) -> bool:
        found = finding(smaller)
        return found is not None and found.violated and math.isinf(found.ratio) == math.isinf(first.ratio)

    return shrunk(case, violates)


def write_case(path: Path, case: Data, text: str) -> None:
    """Write a case with a comment."""
    comment = "".join(f"# {line}\n" for line in text.splitlines())
    path.write_text(comment + yaml.safe_dump(case, sort_keys=False, default_flow_style=None, width=110),
                    encoding="utf-8")


# ---------------------------------------------------------------------- told

WORDS = ("held", "announced", "refused", "blunt", "unfit", "violated")
# of how many scenes a page tells why they were refused
OFTEN = 5


def report(rows: list[dict[str, Any]]) -> str:
    """Return the tables of outcomes of scenes (records as data), and of the reasons of refusals."""
    records = [Record(**row) for row in rows]
    head = ["invariance", "solver", "held", "announced", "refused", "ill-conditioned", "not applicable", "violated"]
    refused = refusals(records)
    often = [row for row in refused if row[2] >= OFTEN] or refused[:1]
    counted = ", ".join(f"{n} {solver}" for solver, n in Counter(r.solver for r in records).most_common())
    return (f"{table(head, counts(records))}\n\n{len(records)} scenes: {counted}; "
            f"{sum(bool(r.violations) for r in records)} with a violation, {sum(n for *_, n in refused)} "
            f"refused. The most frequent reasons:\n\n{table(['reason', 'solver', 'scenes'], often)}")


def counts(records: Iterable[Record]) -> list[list[Any]]:
    """Return rows: check, solver, and the numbers of scenes by outcome (``WORDS``)."""
    counts: Counter[tuple[str, str, str]] = Counter()
    for record in records:
        for name, word in record.outcomes.items():
            counts[name, record.solver, word] += 1
    pairs = [(c.name, s) for c in CHECKS for s in c.solvers]
    return [[name, solver, *(counts[name, solver, word] for word in WORDS)] for name, solver in pairs
            if any(counts[name, solver, word] for word in WORDS)]


def refusals(records: Iterable[Record]) -> list[tuple[str, str, int]]:
    """Return (message, solver, scenes), the most frequent first."""
    counts = Counter((r.refusal, r.solver) for r in records if r.refusal)
    return [(message, solver, n) for (message, solver), n in counts.most_common()]
