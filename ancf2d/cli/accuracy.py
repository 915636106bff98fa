"""``ancf2d run --accuracy``: what was tried, what was reached."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .failures import FAILED, expected_met
from .session import Session
from .text import TIME, command_line, duration, number, say, table

if TYPE_CHECKING:
    from ..case import LoadedCase
    from ..study.accuracy.pursuit import Target


def pursue(session: Session, loaded: LoadedCase, out: str, force: bool, check: bool) -> int:
    """Solve a case to the accuracy that it asks for, and say how; return the exit code."""
    from ..case.units import with_unit
    from ..study.accuracy.control import describe, solve_to_accuracy
    from ..study.accuracy.pursuit import Target
    from ..study.record import Progress
    from ..study.run import describe_goal
    from .report import run_report

    progress = Progress(warn=session.warn, note=session.note, compiling=session.note_once)
    target = Target(out, force, session.command_line)
    session.parting = lambda: _tell_best(session, target)
    reached = solve_to_accuracy(loaded, target, progress, session.note)
    summary = reached.outcome.summary
    session.print_json(summary)
    for text in summary["warnings"]:
        session.warn(text)
    goal = loaded.case.goal
    named = "" if goal is None else with_unit(describe_goal(goal), loaded.case.units.labels)
    session.out(path_table(reached.accuracy, named))
    chosen = choices(reached.accuracy)
    if chosen:
        session.out(chosen)
    session.out(describe(reached.accuracy, goal) + "\n")
    session.out(run_report(summary, loaded.case.units, reached.outcome.model.extent, 0.0))
    session.out(f"\nresults in {out}; next: {command_line('plot', out)}")
    if not reached.achieved:
        say(f"error: the wanted accuracy {reached.accuracy['wanted']:g} was not reached: "
            f"{reached.accuracy['note'] or 'the estimated error is larger'}", err=True)
        return FAILED
    return expected_met(summary, check)


def _tell_best(session: Session, target: Target) -> None:
    """Say that there is a result, though not yet the one that was wanted."""
    if target.written:
        session.note(f"the best so far is in {target.out}; next: {command_line('info', target.out)}")


def path_table(accuracy: dict[str, Any], goal: str) -> str:
    """Return all solves as a table, with the values of the ``goal`` where it has a name."""
    timed = accuracy["tolerance"] is not None
    rows = [["elements", *(["tolerance"] if timed else []), *([goal] if goal else []), "error about", TIME, "why"]]
    for level in accuracy["path"]:
        bodies = level.get("bodies")
        rows.append([str(level["elements"]) if bodies is None else "+".join(str(n) for n in bodies.values()),
                     *([f"{level['tolerance']:.1g}"] if timed else []), *([number(level["value"], 10)] if goal else []),
                     "-" if level["estimate"] is None else f"{level['estimate']:.1e}", duration(level["wall_s"]),
                     f"failed: {level['reason']}" if "reason" in level else level["why"]])
    return "\n".join([*table(rows, left=(len(rows[0]) - 1,)), ""])


def choices(accuracy: dict[str, Any]) -> str:
    """Return what was chosen for each body that was left open, and why, and the parts of the error."""
    lines = [f"{name}: {chosen['element']}; {chosen['why']}" for name, chosen in accuracy.get("types", {}).items()]
    parts = [f"{text} {accuracy[key]:.1e}" for key, text in (("model_error", "model"), ("time_error", "time steps"),
                                                        ("points_error", "points in the frequency"))
             if key in accuracy]
    if parts:
        lines.append("of the estimated error: " + ", ".join(parts))
    return "\n".join([*lines, ""]) if lines else ""
