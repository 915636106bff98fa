"""``ancf2d validate``: list all problems of cases, without solving."""

from __future__ import annotations

from typing import Any

import click

from ..errors import CaseError, Problem, listing, many
from .failures import WRONG, problem_object
from .options import cases_argument, examples, json_session, set_option
from .session import Session
from .text import say


@click.command(epilog=examples("ancf2d validate beam.yaml", "ancf2d validate beam.yaml swing.yaml --json"))
@cases_argument
@set_option
@json_session
def command(session: Session, cases: tuple[str, ...], overrides: tuple[str, ...]) -> int:
    """Check cases without solving them.

    Prints every problem with file, line and column, what was expected and the nearest valid name, then one line for
    each valid case. Exits with 2 if any case is invalid.
    """
    found = [_check(case, overrides, session) for case in cases]
    session.print_json({"status": "ok" if all(f["status"] == "ok" for f in found) else "failed", "cases": found})
    count = sum(len(f["problems"]) for f in found)
    wrong = [f["case"] for f in found if f["problems"]]
    for f in found:
        if not f["problems"]:
            session.out(f"{f['case']}: ok")
    if not wrong:
        return 0
    say(f"{many(count, 'problem')} in {wrong[0] if len(wrong) == 1 else many(len(wrong), 'case')}", err=True)
    return WRONG


def _check(case: str, overrides: tuple[str, ...], session: Session) -> dict[str, Any]:
    """Check one case, print its problems and warnings, and return its entry for ``--json``."""
    from ..study.accuracy.control import check
    from ..study.run import load

    problems: list[Problem] = []
    warnings: list[str] = []
    try:
        warnings = check(load(case, overrides))
    except CaseError as error:
        problems = error.problems
    for text in listing(problems):
        say(text, err=True)
    for text in warnings:
        session.warn(f"{case}: {text}")
    return {"case": case, "status": "failed" if problems else "ok",
            "problems": [problem_object(p) for p in problems], "warnings": warnings}
