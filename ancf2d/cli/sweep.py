"""``ancf2d sweep``: many variants of one case, in parallel, one table."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .failures import FAILED
from .options import (
    case_argument,
    case_stem,
    debug_option,
    examples,
    jobs_option,
    json_option,
    quiet_option,
    scheduler_option,
    set_option,
    workers,
)
from .session import Bar, Session
from .text import TIME, duration, many, number, say, table

if TYPE_CHECKING:
    from ..study.sweep import Row, Sweep


@click.command(epilog=examples("ancf2d sweep beam.yaml --over bodies.beam.element.count=4,8,16",
                               'ancf2d sweep beam.yaml --over "loads.tip.value=[0,-1e3],[0,-2e3]" --csv table.csv',
                               "ancf2d sweep beam.yaml --over bodies.beam.element.count=4,8 "
                               "--over bodies.beam.element.type=cable,reissner3"))
@case_argument
@click.option("--over", "over", multiple=True, required=True, metavar="PATH=A,B,...",
              help="A key of the case and the values it takes, in YAML, separated by commas. If given several times, "
              "all combinations are run.")
@set_option
@jobs_option("Number of processes that solve cases at the same time.", "one per core")
@scheduler_option
@click.option("--out", "-o", type=click.Path(), metavar="DIR",
              help="Folder of the result files; default: the case's name with -sweep, in the working directory.")
@click.option("--csv", "csv_file", type=click.Path(), metavar="FILE", help="Also write the table as CSV.")
@click.option("--force", is_flag=True, help="Recompute existing rows, and replace files that ancf2d did not write.")
@json_option
@quiet_option
@debug_option
@click.pass_obj
def command(session: Session, case: str, over: tuple[str, ...], overrides: tuple[str, ...], jobs: int | None,
            scheduler: str | None, out: str | None, csv_file: str | None, force: bool) -> int:
    """Run all combinations of some values of a case.

    Each combination has its own result file, named by a digest of the case. Results that the same version of ancf2d
    has computed before are reused, so an interrupted sweep continues where it stopped. The row of a combination that
    failed gives the reason. Exits with 1 if any combination fails.
    """
    session.subject = {"case": case}
    from ..case.axes import read_axes
    from ..results import check_output
    from ..study.pool import no_interrupts
    from ..study.sweep import plan, run_sweep, write_csv

    axes, who = read_axes(over), workers(jobs, scheduler)
    folder = Path(out if out is not None else f"{case_stem(case)}-sweep")
    check_output(csv_file, force, case)
    sweep = plan(case, axes, overrides, folder, who, session.command_line, force)
    session.parting = lambda: _part(session, sweep)
    session.subject = sweep.as_json()
    with Bar("solving", session.shows_progress) as bar:
        def done(share: float, left: float | None) -> None:
            bar.update(share, f"{len(sweep.finished)} of {len(sweep.rows)}", left)
        try:
            run_sweep(sweep, who, session.note_once, done)
        finally:
            with no_interrupts():
                session.subject = sweep.as_json()
                if csv_file is not None:
                    write_csv(sweep, csv_file, force=force)
    return _tell(session, sweep, csv_file)


def _part(session: Session, sweep: Sweep) -> None:
    rows = many(len(sweep.rows), "row")
    session.note(f"{len(sweep.finished)} of {rows} are finished, with results in {sweep.folder}; run the same command "
                 "again to continue")


def _tell(session: Session, sweep: Sweep, csv_file: str | None) -> int:
    for text, count in Counter(text for row in sweep.rows for text in row.warnings).items():
        session.warn(text if count == 1 else f"{text} ({count} rows)")
    session.print_json(sweep.as_json())
    session.out(report(sweep))
    if csv_file is not None:
        session.out(f"wrote {csv_file}")
    bad = Counter(row.status for row in sweep.rows if row.status != "converged")
    if bad:
        say(f"error: of {many(len(sweep.rows), 'row')}, "
            + " and ".join(f"{count} {status}" for status, count in bad.items()), err=True)
        return FAILED
    return 0


def report(sweep: Sweep) -> str:
    """Return a sweep as people read it: a row per combination, then where the results are."""
    from ..case.units import with_unit
    from ..study.sweep import short_names, shown, value_names

    paths = [axis.path for axis in sweep.axes]
    names, estimated = value_names(sweep), any(row.estimate is not None for row in sweep.rows)
    values = [with_unit(name, sweep.labels) for name in names]
    head = [*short_names(paths), "status", *values, "elements", TIME, *(["error"] if estimated else []), "result", ""]
    rows = [[*(shown(row.set[p]) for p in paths), row.status, *(number(row.values.get(n), 8) for n in names),
             "-" if row.elements is None else str(row.elements), "-" if row.wall_s is None else duration(row.wall_s),
             *(["-" if row.estimate is None else f"{row.estimate:.1e}"] if estimated else []),
             "-" if row.output is None else Path(row.output).name, _remark(row)] for row in sweep.rows]
    left = (*(k for k, p in enumerate(paths) if not _numbers(sweep, p)), len(paths), len(head) - 2, len(head) - 1)
    lines = [sweep.title, ""] if sweep.title else []
    lines += [*table([head, *rows], left=left), "", f"results in {sweep.folder}"]
    reused = sum(row.reused for row in sweep.rows)
    if reused:
        lines[-1] += f"; {reused} of {many(len(sweep.rows), 'row')} were computed before"
    return "\n".join(lines)


def _remark(row: Row) -> str:
    return row.reason or ("reused" if row.reused else "")


def _numbers(sweep: Sweep, path: str) -> bool:
    return all(isinstance(row.set[path], int | float) for row in sweep.rows)
