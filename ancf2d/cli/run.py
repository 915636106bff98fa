"""``ancf2d run``: solve a case and write a result file."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import click

from ..errors import ResultsError
from .failures import FAILED, expected_met
from .options import (
    case_argument,
    case_stem,
    debug_option,
    examples,
    force_option,
    json_option,
    quiet_option,
    read_case,
    set_option,
    verbose_option,
)
from .session import Bar, Session
from .text import command_line, say

if TYPE_CHECKING:
    from ..solvers.state import State


@click.command(epilog=examples("ancf2d run beam.yaml",
                               "ancf2d run beam.yaml -o fine.h5 --set bodies.beam.element.count=64",
                               "ancf2d run beam.yaml --accuracy 1e-4", "ancf2d run beam.yaml --json"))
@case_argument
@click.option("-o", "--output", type=click.Path(), metavar="OUT.h5",
              help="Result file; default: the case's name with .h5, in the working directory.")
@set_option
@click.option("--accuracy", type=click.FloatRange(0.0, 1.0, min_open=True, max_open=True), metavar="TOL",
              help="Required relative accuracy of the case's goal. Chooses meshes, time steps and, with element: auto, "
              "element types, and estimates the error. Exits with 1 if the accuracy is not reached.")
@click.option("--check", is_flag=True, help="Exit with 1 if a value under 'expected' is not met.")
@click.option("--resume", is_flag=True, help="Continue an interrupted run over time (dynamic, quasi_static) from its "
              "last checkpoint in OUT.h5.part; the result is bitwise identical to that of an uninterrupted run.")
@force_option
@json_option
@quiet_option
@verbose_option
@debug_option
@click.pass_obj
def command(session: Session, case: str, output: str | None, overrides: tuple[str, ...], check: bool,
            resume: bool, force: bool, accuracy: float | None) -> int:
    """Solve a case and write an HDF5 result file.

    Prints probes, reactions, and expected next to computed values. A rerun replaces its own earlier result once it has
    succeeded.
    """
    session.subject = {"case": case}
    out = output if output is not None else f"{case_stem(case)}.h5"
    more = () if accuracy is None else (f"accuracy={accuracy!r}",)
    loaded = read_case(case, (*overrides, *more), out, force)
    from ..solvers.state_results import unbalanced_forces
    from ..study.accuracy.control import is_pursued
    from ..study.record import Progress, run_end
    from ..study.run import run_case, solver_name
    from .report import built_report, pursue, run_report

    if is_pursued(loaded):
        if resume:
            raise click.UsageError("--resume continues a single run, but solving to an accuracy takes many.")
        return pursue(session, loaded, out, force, check)
    bar = Bar("solving", session.shows_progress)
    end, moves = run_end(loaded.case), solver_name(loaded.case) == "dynamic"
    state: State | None = None

    def follow(new: State) -> None:
        nonlocal state
        state = new
        done = new.t / end if end else 1.0
        if not moves:
            bar.update(done)
        else:
            bar.update(done, f"t = {new.t:.4g} of {end:.4g} {loaded.case.units.time}", new.left or 0.0)

    progress = Progress(state=follow, warn=session.warn, note=session.note, compiling=session.note_once,
                        built=lambda model: session.detail(built_report(model)) if session.verbose else None)
    session.parting = lambda: _report_part(session, out, interrupted=True)
    with bar:
        outcome = run_case(loaded, out, force=force, command=session.command_line, progress=progress, resume=resume)
    session.print_json(outcome.summary)
    if outcome.failure is not None:
        say(outcome.failure.text(), err=True)
        _report_part(session, out)
        return FAILED
    unbalanced = 0.0 if state is None or moves else unbalanced_forces(outcome.model, state)
    session.out(run_report(outcome.summary, loaded.case.units, outcome.model.extent, unbalanced))
    session.out(f"\nresults in {out}; next: {command_line('plot', out)}")
    return expected_met(outcome.summary, check)


def _report_part(session: Session, out: str, interrupted: bool = False) -> None:
    """Print where the states of an unfinished run are stored, and how to continue from them."""
    from ..results import part_path, read_checkpoint

    part, more = part_path(out), ""
    if not part.exists():
        return
    with suppress(ResultsError):
        if interrupted and read_checkpoint(part) is not None:
            arguments = [a for a in session.arguments if a != "--resume"]
            more = f"; to continue: {command_line(*arguments, '--resume')}"
    session.note(f"the results so far are in {part}; next: {command_line('info', part)}{more}")
