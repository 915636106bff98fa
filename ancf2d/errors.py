"""The failures that ancf2d expects; each carries what its reader needs to know."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

# characters of a source line that a message shows
WIDTH = 92


def many(count: int, what: str) -> str:
    """Return '1 element', '8 elements'."""
    return f"{count} {what}{'' if count == 1 else 's'}"


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a case file, with the place where it stands.

    ``line`` and ``column`` count from 1; 0 where a problem has no place in the text.
    """

    message: str
    file: str = ""
    line: int = 0
    column: int = 0
    path: tuple[Any, ...] = ()
    expected: str = ""
    near: str = ""
    source_line: str = ""

    @property
    def sentence(self) -> str:
        """The problem without its place, with what was expected and the name that may have been meant."""
        expected = f"; expected {self.expected}" if self.expected else ""
        return self.message + expected + (f"; did you mean '{self.near}'?" if self.near else "")

    def __str__(self) -> str:
        """Return ``file:line:column: error: message`` with the source line, or option, and a caret below it."""
        shown = bool(self.source_line.strip()) and self.column >= 1
        place = f"{self.file}:{self.line}:{self.column}: " if self.line else f"{self.file}: "
        # an option of the command line is named by the line that is shown of it
        named = self.file and (self.line or not shown)
        head = f"{place if named else ''}error: {self.sentence}"
        if not shown:
            return head
        text, caret = _around(self.source_line, self.column)
        number = f"{self.line:5d}" if self.line else " " * 5
        return f"{head}\n{number} | {text}\n      | {' ' * caret}^"


def _around(line: str, column: int) -> tuple[str, int]:
    """Return the part of a source line around a column, and how far right its caret stands."""
    first = max(0, column - 1 - WIDTH * 2 // 3) if len(line) > WIDTH else 0
    left = "... " if first else ""
    right = " ..." if first + WIDTH < len(line) else ""
    shown = [_visible(c) for c in line[first: first + WIDTH].rstrip("\r\n")]
    before = "".join(shown[: column - 1 - first])
    wide = sum(unicodedata.east_asian_width(c) in "WF" for c in before)
    return left + "".join(shown) + right, len(left) + len(before) + wide


def _visible(c: str) -> str:
    """Return what stands for a character on a terminal: no tab, no control character."""
    if c == "\t":
        return "    "
    return c if c.isprintable() else "?"


class Ancf2dError(Exception):
    """Base class of all failures that ancf2d explains; the command line never shows them as tracebacks."""

    exit_code = 1


class PluginError(Ancf2dError):
    """A plugin cannot be loaded, or declares what cannot be."""

    exit_code = 2


class CaseError(Ancf2dError):
    """The case or the command line is wrong; ``problems`` lists everything that is wrong, in file order."""

    exit_code = 2

    def __init__(self, problems: list[Problem] | Problem | str) -> None:
        if isinstance(problems, str):
            problems = Problem(problems)
        if isinstance(problems, Problem):
            problems = [problems]
        self.problems = sorted(problems, key=lambda p: (p.file, p.line, p.column))
        super().__init__("\n".join(str(p) for p in self.problems))


def all_of(*readers: Callable[[], Any]) -> list[Any]:
    """Return what each of some functions returns. Raises CaseError with the problems of all."""
    found: list[Any] = []
    problems: list[Problem] = []
    for read in readers:
        try:
            found.append(read())
        except CaseError as error:
            problems += error.problems
    if problems:
        raise CaseError(problems)
    return found


@dataclass
class Failure:
    """Where and how a computation failed, and what its user can change."""

    reason: str
    at: dict[str, Any] = field(default_factory=dict)
    history: list[float] = field(default_factory=list)
    advice: str = ""


class ComputationError(Ancf2dError):
    """A computation failed; ``failure`` says where and how, the likely cause and what to change."""

    def __init__(self, reason: str, *, at: dict[str, Any] | None = None,
                 history: list[float] | None = None, advice: str = "") -> None:
        self.failure = Failure(reason, dict(at or {}), list(history or []), advice)
        super().__init__(self.text())

    def text(self) -> str:
        """Return the failure as the sentences that the command line prints."""
        f = self.failure
        lines = [f"error: {f.reason}"]
        if f.at:
            lines.append("  at: " + ", ".join(f"{k} {v}" for k, v in f.at.items()))
        if f.history:
            shown = [f"{r:.2e}" for r in f.history]
            shown = shown if len(shown) <= 9 else [*shown[:3], "...", *shown[-5:]]
            lines.append("  residuals: " + " ".join(shown))
        if f.advice:
            lines.append(f"  try: {f.advice}")
        return "\n".join(lines)


class SingularTangentError(ComputationError):
    """The tangent stiffness is singular: nothing holds the model, or a state stands at a critical load."""


class ResultsError(Ancf2dError):
    """A result file cannot be read or written: it is missing, damaged, of another program, or would be overwritten."""

    exit_code = 2


class CheckpointError(ResultsError):
    """A checkpoint does not hold what the solver goes on from; the message says in what it differs."""


# what costs a study one row
UNSOLVED = (CaseError, ComputationError, MemoryError)


def verdict(error: BaseException) -> tuple[str, str]:
    """Return the status (refused as a case, or failed by the computation) and the reason of an UNSOLVED error."""
    if isinstance(error, CaseError):
        return "refused", error.problems[0].sentence
    if isinstance(error, ComputationError):
        return "failed", error.failure.reason
    return "failed", "there is not enough memory for this case"
