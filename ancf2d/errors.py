"""The errors that ancf2d expects; each carries the information that its reader needs."""

from __future__ import annotations

import errno
import os
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

# characters of a source line that a message shows at most
WIDTH = 92
# of more than SHOWN + 1 problems alike, SHOWN are printed in full; of the others, at most MOST_PLACES places
SHOWN, MOST_PLACES = 3, 8
# names of cases from Python; nobody has seen the text made from a mapping, so its problems name keys, not lines
MAPPING, TEXT = "case (dict)", "case (text)"


def many(count: int, what: str) -> str:
    """Return a count with its noun: '1 element', '8 elements'."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def percent(share: float) -> str:
    """Return the size of a share in percent with two digits, or all of those before the point: 0.02 %, 9 %, 114 %."""
    size = abs(100.0 * share)
    return f"{size:.2g} %" if size < 10.0 else f"{size:.0f} %"


class ItemName(str):
    """The name of an item of a mapping by names, as part of a path."""


@dataclass(frozen=True)
class Problem:
    """One mistake in a case file, with its place.

    ``line`` and ``column`` count from 1; they are 0 for a problem without a place in the text.
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
        """The message without its place, with what was expected and the known name that was probably meant."""
        expected = f"; expected {self.expected}" if self.expected else ""
        return self.message + expected + (f"; did you mean '{self.near}'?" if self.near else "")

    @property
    def kind(self) -> tuple[str, ...]:
        """What problems alike have in common: file, sentence and path without indices and names of items."""
        parts, sentence = [str(part) for part in self.path], self.sentence
        alike = ["*" if isinstance(part, int | ItemName) else str(part) for part in self.path]
        for n in range(len(parts), 0, -1):
            sentence = sentence.replace(".".join(parts[:n]), ".".join(alike[:n]))
        return self.file, sentence, *alike

    def __str__(self) -> str:
        """Return ``file:line:column: error: message`` with the source line, or option, and a caret below it."""
        if self.file == MAPPING:
            key = ".".join(map(str, self.path))
            return f"{MAPPING}{f', {key}' if key not in self.message else ''}: error: {self.sentence}"
        shown = bool(self.source_line.strip()) and self.column >= 1
        place = f"{self.file}:{self.line}:{self.column}: " if self.line else f"{self.file}: "
        # a problem in a command line option needs no file name: the option itself is shown
        named = self.file and (self.line or not shown)
        head = f"{place if named else ''}error: {self.sentence}"
        if not shown:
            return head
        text, caret = _around(self.source_line, self.column)
        number = f"{self.line:5d}" if self.line else " " * 5
        return f"{head}\n{number} | {text}\n      | {' ' * caret}^"


def listing(problems: list[Problem]) -> list[str]:
    """Return the texts of problems; of many alike, the first few and the places of the others."""
    alike: dict[tuple[str, ...], list[Problem]] = {}
    for problem in problems:
        alike.setdefault(problem.kind, []).append(problem)
    out, left = [], {kind: SHOWN if len(group) > SHOWN + 1 else len(group) for kind, group in alike.items()}
    for problem in problems:
        kind = problem.kind
        left[kind] -= 1
        if left[kind] >= 0:
            out.append(str(problem))
        if left[kind] == 0 and (more := alike[kind][SHOWN:]) and len(more) > 1:
            out.append(f"and {len(more)} more like it, at {_places(more)}")
    return out


def _places(problems: list[Problem]) -> str:
    """Return the lines of problems, or their paths if some have no line."""
    if not all(problem.line for problem in problems):
        found = [".".join(map(str, problem.path)) for problem in problems]
        return ", ".join(found if len(found) <= MOST_PLACES else [*found[:MOST_PLACES - 2], "...", found[-1]])
    spans: list[list[int]] = []
    for line in dict.fromkeys(problem.line for problem in problems):
        if spans and line == spans[-1][1] + 1:
            spans[-1][1] = line
        else:
            spans.append([line, line])
    texts = [str(first) if first == last else f"{first}-{last}" for first, last in spans]
    shown = texts if len(texts) <= MOST_PLACES else [*texts[:MOST_PLACES - 2], "...", texts[-1]]
    return f"line{'' if texts == [str(spans[0][0])] else 's'} {', '.join(shown)}"


def _around(line: str, column: int) -> tuple[str, int]:
    """Return the part of a source line around a column, and the offset of the caret below it."""
    first = max(0, column - 1 - WIDTH * 2 // 3) if len(line) > WIDTH else 0
    left = "... " if first else ""
    right = " ..." if first + WIDTH < len(line) else ""
    shown = [_visible(c) for c in line[first: first + WIDTH].rstrip("\r\n")]
    before = "".join(shown[: column - 1 - first])
    wide = sum(unicodedata.east_asian_width(c) in "WF" for c in before)
    return left + "".join(shown) + right, len(left) + len(before) + wide


def _visible(c: str) -> str:
    """Return the printable form of a character: spaces for a tab, '?' for control characters."""
    if c == "\t":
        return "    "
    return c if c.isprintable() else "?"


class Ancf2dError(Exception):
    """Base class of all errors that ancf2d explains; the command line prints them without a traceback."""

    exit_code = 1


class PartError(ValueError):
    """A part of a case that is impossible; ``key`` is the path of the wrong entry below the part."""

    def __init__(self, key: tuple[str | int, ...], message: str, expected: str = "", near: str = "") -> None:
        super().__init__(message)
        self.key, self.expected, self.near = key, expected, near


class PluginError(Ancf2dError):
    """A plugin cannot be loaded, or its declarations are invalid."""

    exit_code = 2


class CaseError(Ancf2dError):
    """The case or the command line is wrong; ``problems`` lists all mistakes in file order."""

    exit_code = 2

    def __init__(self, problems: list[Problem] | Problem | str) -> None:
        if isinstance(problems, str):
            problems = Problem(problems)
        if isinstance(problems, Problem):
            problems = [problems]
        self.problems = sorted(problems, key=lambda p: (p.file, p.line, p.column))
        super().__init__("\n".join(listing(self.problems)))


def raise_any(problems: list[Problem]) -> None:
    """Raise CaseError with all problems, if there are any."""
    if problems:
        raise CaseError(problems)


def all_of(*readers: Callable[[], Any]) -> list[Any]:
    """Call all readers and return their results. Raises CaseError with the problems of all of them."""
    found: list[Any] = []
    problems: list[Problem] = []
    for read in readers:
        try:
            found.append(read())
        except CaseError as error:
            problems += error.problems
    raise_any(problems)
    return found


def first_of(reader: Callable[[], Any], *others: Callable[[], Any]) -> Any:
    """Return the result of a reader. If it raises CaseError, the others are called, too, and their problems added."""
    try:
        return reader()
    except CaseError as error:
        first = error

    def again() -> Any:
        raise first
    return all_of(again, *others)


@dataclass
class Failure:
    """Where and how a computation failed, and what the user can change."""

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
    """The tangent stiffness is singular: the model can move freely, or the state is at a critical load."""


class ResultsError(Ancf2dError):
    """A result file cannot be read or written: it is missing, damaged, of another program, or would be overwritten."""

    exit_code = 2


class WriteError(ResultsError):
    """Writing a file failed, as on a full disk, although case and command line are right."""

    exit_code = 1


# errors of a place that the command line names: it is missing, in the way or forbidden
_WRONG_PLACE = (PermissionError, FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError)


def write_error(path: str | os.PathLike[str], error: BaseException, left: str = "", act: str = "write") -> ResultsError:
    """Return the error of a failed ``act`` on ``path``; ``left`` says what of it remains."""
    kind = ResultsError if isinstance(error, _WRONG_PLACE) else WriteError
    return kind(f"cannot {act} '{path}': {cause_of(error)}" + (f"; {left}" if left else ""))


def cause_of(error: BaseException) -> str:
    """Return why a file cannot be read or written, and what to do about a full disk."""
    number = getattr(error, "errno", None)
    # the texts of h5py have several lines
    cause = os.strerror(number) if number else str(error)
    if number in (errno.ENOSPC, errno.EDQUOT):
        return f"the disk is full ({cause}); free space on it, or write to another one"
    return cause


class CheckpointError(ResultsError):
    """A checkpoint does not fit the solver that should resume from it; the message names the difference."""


# errors that make one row of a study fail, but not the study
UNSOLVED = (CaseError, ComputationError, MemoryError)


def verdict(error: BaseException) -> tuple[str, str]:
    """Return status ('refused' for a wrong case, else 'failed') and reason of one of the UNSOLVED errors."""
    if isinstance(error, CaseError):
        return "refused", error.problems[0].sentence
    if isinstance(error, ComputationError):
        return "failed", error.failure.reason
    return "failed", "there is not enough memory for this case"
