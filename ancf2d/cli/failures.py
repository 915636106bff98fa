"""Messages on stderr, JSON objects and exit codes for failures."""

from __future__ import annotations

from typing import Any

import click

from ..errors import Ancf2dError, CaseError, ComputationError, Problem, cause_of, listing, many
from .session import Session
from .text import discard_output, say

# errors that a plugin does not cause by mistake
EXPECTED = (Ancf2dError, click.ClickException, click.Abort, KeyboardInterrupt, EOFError, OSError, MemoryError)
FAILED, WRONG, INTERRUPTED = 1, 2, 130


def explain(error: BaseException, session: Session) -> int:
    """Print the explanation of a failure and return the exit code."""
    if isinstance(error, MemoryError):
        # frees the memory of the failed work, because printing needs some
        error.__traceback__ = error.__context__ = None
    if session.debug:
        import traceback

        say("".join(traceback.format_exception(error)), err=True)
    if not isinstance(error, EXPECTED):
        from ..extend.plugins import blame

        error = blame(error) or error
    if isinstance(error, click.ClickException):
        # --json may come after the argument that could not be parsed
        session.json = session.json or "--json" in session.arguments
        reason, code = _usage(error), WRONG
    elif isinstance(error, CaseError):
        say(problems_text(error.problems, session.subject.get("case", "")), err=True)
        reason, code = error.problems[0].message, error.exit_code
    elif isinstance(error, Ancf2dError):
        text = error.text() if isinstance(error, ComputationError) else f"error: {error}"
        say(text, err=True)
        reason, code = _reason(error), error.exit_code
    elif isinstance(error, KeyboardInterrupt | click.Abort | EOFError):
        say("interrupted", err=True)
        session.parting()
        reason, code = "interrupted", INTERRUPTED
    elif isinstance(error, OSError):
        what = "the output" if error.filename is None else f"'{error.filename}'"
        reason, code = f"cannot read or write {what}: {cause_of(error)}", FAILED
        discard_output()
        say(f"error: {reason}", err=True)
    elif isinstance(error, MemoryError):
        reason, code = "there is not enough memory for this", FAILED
        say(f"error: {reason}", err=True)
    else:
        reason, code = f"internal error, please report: {_named(error)}", FAILED
        say(f"{reason} (--debug shows where)" if not session.debug else reason, err=True)
    session.print_json(failure_object(error, reason, code, session.subject))
    return code


# kinds of numbers in click's words and in plain ones
_KINDS = {"float range": "a number", "integer range": "a whole number", "float": "a number",
          "integer": "a whole number"}


def _usage(error: click.ClickException) -> str:
    """Print a usage error of the command line in the style of all other errors; return the reason."""
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        error.show()
        return "no command"
    reason = error.format_message()
    for theirs, ours in _KINDS.items():
        reason = reason.replace(f"is not a valid {theirs}", f"is not {ours}")
    if isinstance(error, click.NoSuchOption):
        from difflib import get_close_matches

        near = get_close_matches(error.option_name, error.possibilities or [], 1, 0.7)
        reason = f"no such option '{error.option_name}'" + (f"; did you mean '{near[0]}'?" if near else "")
    context = getattr(error, "ctx", None)
    hint = "" if context is None else f" (see '{context.command_path} --help')"
    say(f"error: {reason[:1].lower()}{reason[1:].rstrip('.')}{hint}", err=True)
    return reason


def _named(error: BaseException) -> str:
    text = str(error).strip().split("\n")[0]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _reason(error: Ancf2dError) -> str:
    return error.failure.reason if isinstance(error, ComputationError) else str(error)


def failure_object(error: BaseException, reason: str, code: int, subject: dict[str, Any]) -> dict[str, Any]:
    """Return the object that ``--json`` prints for a failure."""
    found: dict[str, Any] = {**subject, "status": "interrupted" if code == INTERRUPTED else "failed", "reason": reason,
                             "at": {}}
    if isinstance(error, CaseError):
        first = error.problems[0]
        found["at"] = {"file": first.file, **({"line": first.line, "column": first.column} if first.line else {})}
        found["problems"] = [problem_object(p) for p in error.problems]
    elif isinstance(error, ComputationError):
        found.update(at=error.failure.at, advice=error.failure.advice, residuals=error.failure.history)
    return found


def problem_object(problem: Problem) -> dict[str, Any]:
    """Return a problem as an object for JSON; ``path`` is dotted as in ``--set``."""
    return {"file": problem.file, "line": problem.line, "column": problem.column,
            "path": ".".join(map(str, problem.path)), "message": problem.message, "expected": problem.expected,
            "near": problem.near}


def problems_text(problems: list[Problem], case: str) -> str:
    """Return problems one below the other, followed by their number."""
    lines = listing(problems)
    if case:
        # none may be in the case itself, but in an option or in data
        where = f" in {case}" if any(p.file == case for p in problems) else ""
        lines.append(many(len(problems), "problem") + where)
    return "\n".join(lines)


def expected_met(summary: dict[str, Any], check: bool) -> int:
    """Return the exit code of a run; with ``check``, it is that of a failure if an expected value is not met."""
    missed = [c for c in summary["checks"] if not c["met"]]
    if check and missed:
        say(f"error: {many(len(missed), 'expected value')} not met", err=True)
        return FAILED
    return 0
