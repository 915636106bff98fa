"""``ancf2d sensitivity``: differentiate the goal of a case with respect to its numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ..errors import many
from .options import case_argument, examples, force_option, json_session, read_case, set_option
from .session import Bar, Session
from .text import number, table

if TYPE_CHECKING:
    from ..study.sensitivity import Sensitivity


@click.command(epilog=examples("ancf2d sensitivity beam.yaml",
                               "ancf2d sensitivity beam.yaml --to bodies.beam.section.height --to loads.0.value.1",
                               "ancf2d sensitivity beam.yaml -o influence.h5"))
@case_argument
@click.option("--to", "paths", multiple=True, metavar="PATH",
              help="A number of the case, e.g. bodies.beam.section.height, loads.0.value.1 or parameters.kp, or the "
              "key of a point BODY@S, e.g. loads.0.at, whose S is varied. May be given several times. Default: every "
              "number that can vary.")
@click.option("-o", "--output", type=click.Path(), metavar="OUT.h5", help="Write the table to a result file.")
@set_option
@force_option
@json_session
def command(session: Session, case: str, paths: tuple[str, ...], output: str | None,
            overrides: tuple[str, ...], force: bool) -> int:
    """Differentiate the goal of a case with respect to its numbers.

    Prints value, derivative and elasticity (relative change of the goal per relative change of the number), the most
    influential number first. Derivatives of equilibria, limit points, frequencies, buckling factors, responses
    and motions are exact; all others are differences of runs.
    """
    session.subject = {"case": case}
    loaded = read_case(case, overrides, output, force)
    from ..study.record import Progress
    from ..study.sensitivity import sensitivity, write_sensitivity

    with Bar("differentiating", session.shows_progress) as bar:
        study = sensitivity(loaded, paths, Progress(compiling=session.note_once), bar.follow)
    session.report_study(study, report(study), output,
                 lambda path: write_sensitivity(study, loaded, path, session.command_line, force=force))
    return 0


def report(study: Sensitivity) -> str:
    """Return a study as printed text: the goal, a row for each number, then the numbers without a derivative."""
    from ..case.units import with_unit

    head = ["number", "value", "derivative", "error", "elasticity"]
    idle = [row.path for row in study.idle]
    rows = [[row.path, number(row.value), number(row.derivative, 7), f"{row.error:.0e}",
             number(row.elasticity, 4)] for row in study.rows if row.path not in idle]
    lines = [study.title] if study.title else []
    lines += [f"{with_unit(study.described, study.labels)} = {number(study.goal, 10)}", ""]
    lines += table([head, *rows]) if rows else [] if idle else ["no number of the case can vary"]
    if idle:
        lines += ["", f"{many(len(idle), 'number')} without influence: {', '.join(idle)}"]
    methods = sorted({row.method for row in study.rows} - {"exact"})
    for method in methods:
        some = [row.path for row in study.rows if row.method == method]
        lines += ["", f"{method}: {'all' if len(some) == len(study.rows) else ', '.join(some)}"]
    if study.skipped:
        lines += ["", f"{many(len(study.skipped), 'number')} without a derivative: {', '.join(study.skipped)}"]
    return "\n".join(lines)
