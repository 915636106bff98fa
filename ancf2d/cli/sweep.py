"""``ancf2d sweep``: run many variants of one case in parallel, with one table of results."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import Problem, all_of, many, raise_any
from .failures import FAILED
from .options import (
    case_argument,
    case_stem,
    examples,
    jobs_option,
    json_session,
    scheduler_option,
    set_option,
    workers,
)
from .session import Bar, Session
from .text import TIME, duration, number, say, table

if TYPE_CHECKING:
    from ..case.axes import Axis
    from ..study.pool import Workers
    from ..study.samples import Design
    from ..study.sweep_table import Row, Sweep

SAMPLES = 128
# a number in a message, but not in a name or path
_NUMBER = re.compile(r"(?<![\w.@-])[-+]?\d+(\.\d+)?(e[-+]?\d+)?(?![\w@])")
# greatest number of rows shown for samples
SHOWN = 10


def folder_name(ctx: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """Return the name of a folder. Raises BadParameter for the name of a result file, which other commands take."""
    if value is not None and value.lower().endswith(".h5") and not Path(value).is_dir():
        raise click.BadParameter(f"'{value}' is the name of a file, but a sweep writes sweep.h5 into a folder; "
                                 f"expected for example '{value[:-3] or 'sweep'}'")
    return value


@click.command(epilog=examples("ancf2d sweep beam.yaml --over bodies.beam.element.count=4,8,16",
                               'ancf2d sweep beam.yaml --over "loads.tip.value=[0,-1e3],[0,-2e3]" --csv table.csv',
                               "ancf2d sweep beam.yaml --over bodies.beam.section.height=0.1:0.5:20 "
                               "--over bodies.beam.material.E=log:1e9:1e11:5",
                               'ancf2d sweep beam.yaml --sample "bodies.beam.material.E~normal(2.1e11, 1e10)" '
                               "--samples 256"))
@case_argument
@click.option("--over", "over", multiple=True, metavar="PATH=A,B,...",
              help="A key of the case and its values, in YAML, separated by commas; 0.1:0.5:20 means 20 values from "
              "0.1 to 0.5, log:0.1:10:5 five in equal ratios. If given several times, all combinations are run.")
@click.option("--pair", is_flag=True, help="Pair the lists of all --over instead of combining them: the first values "
              "of all lists, then the second ones, and so on.")
@click.option("--sample", "sample", multiple=True, metavar='"PATH~LAW(...)"',
              help="A key of the case and its distribution: normal(mean, sd), uniform(a, b), or lognormal(mu, sigma) "
              "with mean and standard deviation of the logarithm. May be given several times.")
@click.option("--samples", type=click.IntRange(min=2, max=100_000), metavar="N",
              help=f"Number of samples.  [default: {SAMPLES}]")
@click.option("--seed", type=click.IntRange(min=0), metavar="K", help="Seed of the samples.  [default: 0]")
@click.option("--design", type=click.Choice(["sobol", "lhs", "random"]),
              help="How samples are placed: scrambled Sobol points, a Latin hypercube, or independently.  "
              "[default: sobol]")
@set_option
@jobs_option("Number of processes that solve cases at the same time.", "one per core")
@scheduler_option
@click.option("--out", "-o", type=click.Path(), metavar="DIR", callback=folder_name,
              help="Folder of sweep.h5; default: the case's name with -sweep, in the working directory.")
@click.option("--keep", is_flag=True,
              help="Also keep the result file of each row, in DIR/runs, named by a digest of its case.")
@click.option("--csv", "csv_file", type=click.Path(), metavar="FILE", help="Also write the table as CSV.")
@click.option("--force", is_flag=True, help="Recompute existing rows, and replace files that ancf2d did not write.")
@json_session
def command(session: Session, case: str, over: tuple[str, ...], pair: bool, sample: tuple[str, ...],
            samples: int | None, seed: int | None, design: str | None, overrides: tuple[str, ...], jobs: int | None,
            scheduler: str | None, out: str | None, keep: bool, csv_file: str | None, force: bool) -> int:
    """Run a case for many values: combinations, lists or samples.

    All rows are written to one file, sweep.h5. Rows that the same version of ancf2d has computed before are reused, so
    an interrupted sweep continues where it stopped. The row of a combination that failed gives the reason. Exits with 1
    if any row fails.
    """
    session.subject = {"case": case}
    from ..results.target import TABLE, check_output
    from ..study.sweep import plan

    axes, drawn = _values(over, pair, sample, (samples, seed, design))
    who = workers(jobs, scheduler)
    folder = Path(out if out is not None else f"{case_stem(case)}-sweep")
    check_output(csv_file, force, case, kind=TABLE)
    sweep = plan(case, axes, overrides, folder, who, session.command_line, force, paired=pair, samples=drawn, keep=keep)
    session.parting = lambda: _part(session, sweep)
    session.subject = sweep.as_json()
    _run(session, sweep, who, csv_file, force)
    return _report_result(session, sweep, csv_file)


def _values(over: tuple[str, ...], pair: bool, sample: tuple[str, ...],
            drawing: tuple[int | None, int | None, str | None]) -> tuple[list[Axis], Design | None]:
    """Return the axes and, with --sample, the design. Raises CaseError with all problems of both, and UsageError."""
    from ..case.axes import read_axes, read_distributions
    from ..study.samples import design

    if not over and not sample:
        raise click.UsageError("Nothing is varied; give --over PATH=A,B,... or --sample 'PATH~normal(mean, sd)'.")
    _, axes, distributions = all_of(lambda: _check(over, pair, sample, drawing), lambda: read_axes(over, pair),
                                    lambda: read_distributions(sample))
    number_of, seed, kind = drawing
    return axes, design(distributions, number_of or SAMPLES, seed or 0, kind or "sobol") if sample else None


def _check(over: tuple[str, ...], pair: bool, sample: tuple[str, ...], drawing: tuple[Any, ...]) -> None:
    """Raise CaseError for options that exclude each other."""
    problems = []
    if over and sample:
        problems.append(Problem("--over and --sample are both given", expected="one of them; --set fixes a value"))
    if pair and len(over) < 2:
        problems.append(Problem("--pair has nothing to pair", expected="--over at least twice"))
    if not sample and any(value is not None for value in drawing):
        problems.append(Problem("--samples, --seed and --design need --sample"))
    raise_any(problems)


def _run(session: Session, sweep: Sweep, who: Workers, csv_file: str | None, force: bool) -> None:
    from ..study.pool import no_interrupts
    from ..study.sweep import run_sweep
    from ..study.sweep_table import write_csv

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


def _part(session: Session, sweep: Sweep) -> None:
    rows = many(len(sweep.rows), "row")
    session.note(f"{len(sweep.finished)} of {rows} are finished, with results in {sweep.file}; run the same command "
                 "again to continue")


def _report_result(session: Session, sweep: Sweep, csv_file: str | None) -> int:
    for text in alike(text for row in sweep.rows for text in row.warnings):
        session.warn(text)
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


def alike(warnings: Iterable[str]) -> list[str]:
    """Return the warnings of many rows, each once with the number of its rows; if only numbers differ, the first."""
    found: dict[str, Counter[str]] = {}
    for text in warnings:
        found.setdefault(_NUMBER.sub("#", text), Counter())[text] += 1
    out = []
    for texts in found.values():
        other = ", with other numbers" if len(texts) > 1 else ""
        first, count = next(iter(texts)), texts.total()
        out.append(first if count == 1 else f"{first} ({count} rows{other})")
    return out


def report(sweep: Sweep) -> str:
    """Return a sweep as printed text: a row per variant, statistics of samples, then the place of the results."""
    from ..case.units import with_unit
    from ..results.records import short_names
    from ..study.sweep_table import shown, value_names

    paths = [axis.path for axis in sweep.axes]
    names, estimated = value_names(sweep), any(row.estimate is not None for row in sweep.rows)
    head = [*short_names(paths), "status", *(with_unit(name, sweep.labels) for name in names), "elements", TIME,
            *(["error"] if estimated else []), *(["result"] if sweep.keep else []), ""]
    listed = [row for k, row in enumerate(sweep.rows)
              if sweep.samples is None or k < SHOWN or row.status != "converged"]

    def given(value: object) -> str:
        return number(value, 8) if sweep.samples is not None and isinstance(value, float) else shown(value)

    rows = [[*(given(row.set[p]) for p in paths), row.status, *(number(row.values.get(n), 8) for n in names),
             "-" if row.elements is None else str(row.elements), "-" if row.wall_s is None else duration(row.wall_s),
             *(["-" if row.estimate is None else f"{row.estimate:.1e}"] if estimated else []),
             *(["-" if row.output is None else Path(row.output).name] if sweep.keep else []), _remark(row)]
            for row in listed]
    left = (*(k for k, p in enumerate(paths) if not _numbers(sweep, p)), len(paths),
            *((len(head) - 2,) if sweep.keep else ()), len(head) - 1)
    more = len(sweep.rows) - len(listed)
    reused = sum(row.reused for row in sweep.rows)
    before = f"; {reused} of {many(len(sweep.rows), 'row')} were computed before" if reused else ""
    return "\n".join([*([sweep.title, ""] if sweep.title else []), *table([head, *rows], left=left),
                      *([f"... and {many(more, 'row')} more"] if more else []), "", *_moments(sweep, paths),
                      f"results in {sweep.file}{before}"])


def _moments(sweep: Sweep, paths: list[str]) -> list[str]:
    """Return the table of statistics over samples: moments, quantiles and shares of the variance of each value."""
    from ..case.units import with_unit
    from ..results.records import short_names
    from ..study.sweep_table import value_names

    found = sweep.statistics()
    if not found:
        return []
    units = [with_unit(name, sweep.labels) for name in value_names(sweep)]
    head = ["", "mean", "sd", "5 %", "median", "95 %", *(f"share of {name}" for name in short_names(paths))]
    rows = []
    for name, one in zip(units, found.values(), strict=True):
        quantiles, parts, errors = (one[k] or {} for k in ("quantiles", "shares", "share_errors"))
        rows.append([name, number(one["mean"], 6), number(one["sd"], 4),
                     *(number(quantiles.get(q), 6) for q in ("0.05", "0.5", "0.95")),
                     *(f"{parts[p]:.3f} +- {errors[p]:.3f}" if p in parts else "-" for p in paths)])
    return [*table([head, *rows]), ""]


def _remark(row: Row) -> str:
    return row.reason or ("reused" if row.reused else "")


def _numbers(sweep: Sweep, path: str) -> bool:
    return all(isinstance(row.set[path], int | float) for row in sweep.rows)
