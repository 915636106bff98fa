"""``ancf2d convergence``: refine, tabulate error and observed order, extrapolate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click

from .failures import FAILED
from .options import (
    case_argument,
    complete_types,
    either,
    examples,
    force_option,
    jobs_option,
    json_session,
    parsed,
    read_case,
    scheduler_option,
    set_option,
    whole_numbers,
    workers,
)
from .session import Bar, Session
from .text import TIME, duration, number, say, table

if TYPE_CHECKING:
    from ..study.convergence import Convergence, Series
    from ..study.variants import Variant


element_counts = parsed(whole_numbers, lambda found: min(found) >= 1,
                        "not a list of numbers of elements; expected for example 2,4,8,16")
positive_numbers = parsed(lambda text: tuple(float(part) for part in text.split(",")),
                          lambda found: all(0.0 < x < math.inf for x in found),
                          "not a list of positive numbers; expected for example 4e-3,2e-3,1e-3")
# the number, or None for auto
reference_value = parsed(lambda text: None if text == "auto" else float(text),
                         lambda found: found is None or math.isfinite(found), "neither a number nor auto")


@click.command(epilog=examples("ancf2d convergence beam.yaml",
                               "ancf2d convergence beam.yaml --elements 2,4,8,16 -o study.h5",
                               'ancf2d convergence beam.yaml --element "2d2n,vallejo:structural,ancf[3,2]"',
                               "ancf2d convergence swing.yaml --dt 0.02,0.01,0.005"))
@case_argument
@click.option("--elements", "meshes", callback=element_counts, metavar="N,N,...",
              help="Numbers of elements of the whole model, divided among its bodies in the proportions of the case. "
              "Default: five meshes, doubling from the case's own.")
@click.option("--dt", "dts", callback=positive_numbers, metavar="DT,...",
              help="For a motion: fixed time steps to compare on the case's mesh, instead of meshes.")
@click.option("--tolerance", "tolerances", callback=positive_numbers, metavar="TOL,...",
              help="For a motion: tolerances of adaptive steps to compare, instead of meshes.")
@click.option("--element", "types", metavar="TYPE,...", shell_complete=complete_types,
              help="Element types to compare, e.g. 2d2n, ancf[3,2], vallejo:structural (TYPE:FORMULATION), own.yaml (a "
                   "file that describes one). Default: the case's own.")
@click.option("--formulation", help="Formulation of the types given without one.")
@click.option("--reference", default="auto", show_default=True, callback=reference_value, metavar="VALUE",
              help="Reference for the errors: a number, or auto for the extrapolated limit of each type.")
@jobs_option("Number of meshes solved at the same time; this changes measured times but no values.", "1")
@scheduler_option
@click.option("-o", "--output", type=click.Path(), metavar="OUT.h5", help="Write the table to a result file.")
@set_option
@force_option
@json_session
def command(session: Session, case: str, meshes: list[int] | None, types: str | None, formulation: str | None,
            reference: float | None, jobs: int | None, scheduler: str | None, output: str | None,
            overrides: tuple[str, ...], force: bool, dts: tuple[float, ...] | None,
            tolerances: tuple[float, ...] | None) -> int:
    """Refine the mesh or the time steps and show how the goal of a case converges.

    Prints value, error and observed order for each level, and the limit of each element type with an error bar by the
    grid convergence index. The error of a motion is the largest over its stored times.
    """
    session.subject = {"case": case}
    from ..study.convergence import Steps, convergence, write_convergence

    key, values = either(dts, tolerances)
    variants, who = _variants(types, formulation), workers(jobs, scheduler, default=1)
    loaded = read_case(case, overrides, output, force)
    steps = Steps(key, values) if key else None
    with Bar("solving", session.shows_progress) as bar:
        study = convergence(loaded, variants, meshes, reference, who, session.note_once, bar.follow, steps)
    session.report_study(study, report(study), output,
                 lambda path: write_convergence(study, loaded, path, session.command_line, force=force))
    if not study.converged:
        say("error: no mesh could be solved", err=True)
        return FAILED
    return 0


def _variants(types: str | None, formulation: str | None) -> list[Variant]:
    from ..study.variants import Variant, formulation_named, parse_variants

    try:
        if types is not None:
            return parse_variants(types, formulation)
        return [Variant(formulation=None if formulation is None else formulation_named(formulation))]
    except ValueError as error:
        raise click.UsageError(f"{error}.") from None


def row_cells(study: Convergence) -> list[list[str]]:
    """Return the table of a study as rows of cells, the header first."""
    from ..case.units import with_unit

    timed = study.over != "elements"
    several = len({s.formulation for s in study.series}) > 1
    rows = [["element", *(["formulation"] if several else []), "elements", "coordinates",
             *(["dt [" + study.labels[2] + "]" if study.over == "dt" else study.over] if timed else []),
             with_unit(study.goal, study.labels), "error", "order", TIME, ""]]
    for row in study.rows:
        order = "-" if row.order is None else f"{row.order:.2f}"
        wall = "-" if row.wall_s is None else duration(row.wall_s)
        rows.append([row.element, *([row.formulation] if several else []), str(row.elements),
                     "-" if row.dofs is None else str(row.dofs), *([number(row.step, 6)] if timed else []),
                     number(row.value, 10),
                     "-" if row.error is None else f"{row.error:.1e}", order, wall,
                     f"failed: {row.reason}" if row.reason else ""])
    return rows


def limits(study: Convergence) -> list[str]:
    """Return lines on the limit of each type, and on the reference of the errors."""
    timed = study.over != "elements"
    several = len({s.formulation for s in study.series}) > 1
    lines = [_limit(s, several) for s in study.series]
    lines = [line.replace("finer meshes", "smaller steps") if timed else line for line in lines]
    if study.reference is None and any(s.reference is not None for s in study.series):
        lines += ["", "errors are relative to the limit of each type and formulation; they exclude model error"]
    return lines


def report(study: Convergence) -> str:
    """Return a study as printed text: the table, then a line for each element type."""
    rows = row_cells(study)
    left = (0, 1, len(rows[0]) - 1) if "formulation" in rows[0] else (0, len(rows[0]) - 1)
    over = "meshes" if study.over == "elements" else "time steps"
    return "\n".join([*([study.title] if study.title else []), f"{study.goal} over {over}", "",
                      *table(rows, left=left), "", *limits(study)])


def _limit(series: Series, several: bool) -> str:
    e = series.estimate
    name = f"{series.element} ({series.formulation})" if several else series.element
    if e.value is None:
        return f"{name}: {e.note}"
    bar = "" if e.error_bar is None else f" +- {number(e.error_bar, 2)}"
    order = "" if e.order is None else f", order {e.order:.2f}"
    note = f"; {e.note}" if e.note else ""
    return f"{name}: limit {number(e.value, 10)}{bar}{order}{note}"
