"""Many variants of one case: combinations, lists or samples of some of its values, with all rows in one file."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..case import Case, CaseText, Dynamic
from ..case.axes import Axis, combinations
from ..case.compose import read_text
from ..case.numbers import unused_parameters
from ..case.overrides import OPTION as SET
from ..errors import CaseError, Problem, raise_any, verdict, write_error
from .digests import content_name, files_of
from .forecast import Done, Forecast, steps_of
from .pool import ALONE, Workers, no_interrupts, run_jobs
from .run import prepare, result_header, vocabulary
from .samples import Design
from .sweep_runs import Job, solve_job, stored_summary, summary_of_lost
from .sweep_table import RUNS, Ledger, Row, Sweep, outcome_of
from .variants import count_of, flexible
from .warmup import kernels_of, objects_frozen, warm_up


@objects_frozen()
def plan(case: str, axes: list[Axis], overrides: Sequence[str], folder: Path, workers: Workers, command: str = "",
         force: bool = False, *, paired: bool = False, samples: Design | None = None, keep: bool = False) -> Sweep:
    """Return the sweep of a case file over some axes, with nothing computed yet; results go to ``folder``.

    The axes are combined; with ``paired`` or ``samples``, they are run through together. An invalid variant gives a
    refused row. Raises CaseError with all problems if all variants are invalid, if no row uses a parameter that varies,
    and if an axis overwrites a value that another option gives.
    """
    text, file, known = read_text(case), workers.file(case), vocabulary()
    axes = axes if samples is None else samples.axes
    origin = CaseText(text, file, os.path.dirname(file))
    _check_overwritten(origin, overrides, axes)
    sweep = Sweep(case, "", axes, folder, [], [], samples=samples, keep=keep, force=force, command=command)
    problems: list[Problem] = []
    unused = [axis for axis in axes if axis.path.startswith("parameters.")]
    for values in combinations(axes, paired or samples is not None):
        row = Row({axis.path: value for axis, value in zip(axes, values, strict=True)})
        options = (*overrides, *(axis.override(value) for axis, value in zip(axes, values, strict=True)))
        sweep.rows.append(row)
        try:
            loaded = origin.load(options, known)
        except CaseError as error:
            row.status, row.reason = verdict(error)
            problems += error.problems
            sweep.jobs.append(None)
            continue
        if unused:
            names = unused_parameters(loaded.case)
            unused = [axis for axis in unused if axis.path.split(".")[1] in names]
        sweep.title, sweep.labels = loaded.case.title, loaded.case.units.labels
        sweep.header = sweep.header or {**result_header(loaded), "overrides": list(overrides)}
        name = content_name(loaded.completed, files_of(loaded))
        place = workers.file(str(folder / RUNS / f"{name}.h5"))
        sweep.jobs.append(Job(text, file, options, loaded.case.goal, place, name, kernels_of(loaded.data),
                              _size(loaded.case), command, force, keep,
                              # a copy without cached texts, which are not needed again
                              replace(loaded) if workers == ALONE else None))
    if not any(sweep.jobs):
        raise CaseError(_distinct(problems, axes, drawn=samples is not None))
    if unused:
        raise CaseError([Problem(f"nothing in the case uses {axis.path}", f"{axis.option}{axis.text}",
                                 expected="a parameter that a formula of the case names") for axis in unused])
    return sweep


def _check_overwritten(origin: CaseText, overrides: Sequence[str], axes: list[Axis]) -> None:
    """Raise CaseError if an axis overwrites a value that an earlier option gives."""
    given = [(f"{SET}{text}", origin.place(text.partition("=")[0].removesuffix("+"))) for text in overrides]
    problems = []
    for axis in axes:
        option, place = f"{axis.option}{axis.text}", origin.place(axis.path)
        problems += [Problem(f"{option} overwrites this value in every row", earlier, expected="one of them")
                     for earlier, other in given if other[:len(place)] == place]
        given.append((option, place))
    raise_any(problems)


def _size(case: Case) -> float:
    elements = sum(count_of(body) for body in flexible(case).values())
    solver = case.solver
    if not isinstance(solver, Dynamic):
        return float(max(elements, 1))
    return max(elements, 1) * solver.t_end * steps_of(solver.dt, solver.local_error)


def _distinct(problems: list[Problem], axes: list[Axis], drawn: bool) -> list[Problem]:
    """Return each problem once; problems of overrides made from an axis name the axis as it was given.

    Of problems that differ only in the value drawn for an axis, the first is returned.
    """
    found: dict[tuple[Any, ...], Problem] = {}
    for p in problems:
        axis = next((a for a in axes if p.file.startswith(f"{SET}{a.path}=")), None)
        if axis is not None:
            p = Problem(p.message, f"{axis.option}{axis.text}", path=p.path, expected=p.expected, near=p.near)
        found.setdefault((p.file, p.line, p.column, p.path if drawn and axis else p.message), p)
    return list(found.values())


def run_sweep(sweep: Sweep, workers: Workers, compiling: Callable[[str], None] = lambda text: None,
              done: Done = lambda share, left: None) -> None:
    """Fill in the rows of a sweep from earlier results or by running the case; write ``sweep.h5``.

    Equal cases are run once. Results of the same case by the same ancf2d are reused unless the sweep forces new ones.
    ``done`` is called with the progress. Raises ResultsError if the folder or file cannot be created, and the errors of
    ``run_jobs``.
    """
    try:
        (sweep.folder / RUNS if sweep.keep else sweep.folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise write_error(sweep.folder, error, act="make the folder") from error
    ledger = Ledger(sweep.folder, sweep.force, compiling)
    try:
        _run(sweep, ledger, workers, compiling, done)
    finally:
        with no_interrupts():
            ledger.close(sweep)


@objects_frozen()
def _run(sweep: Sweep, ledger: Ledger, workers: Workers, compiling: Callable[[str], None], done: Done) -> None:
    needed: dict[str, tuple[Job, list[Row]]] = {}
    for row, job in zip(sweep.rows, sweep.jobs, strict=True):
        if job is not None:
            needed.setdefault(job.name, (job, []))[1].append(row)
    for name, (job, rows) in list(needed.items()):
        found = None if job.force else _known(job, ledger)
        if found is not None:
            found["output"] = found["output"] or str(sweep.file)
            for row in rows:
                row.store(found, reused=True)
            del needed[name]
    jobs = [job for job, _ in needed.values()]
    if workers.scheduler is None:
        _warm_up(jobs, compiling)

    ahead = Forecast([(job.kernels, job.size) for job in jobs], workers, done)

    def store_result(i: int, summary: dict[str, Any], seconds: float) -> None:
        job, rows = needed[jobs[i].name]
        if job.keep and summary["status"] == "converged" and not os.path.exists(job.output):
            unseen = f"'{job.output}' was written by a worker on another machine and is not visible here"
            summary.setdefault("warnings", []).append(unseen)
        found = outcome_of(job.goal, summary)
        if found["status"] == "converged":
            ledger.store(job.name, found)
            found["output"] = found["output"] or str(sweep.file)
        for row in rows:
            row.store(found)
        ahead.record(i, summary, seconds)

    run_jobs(ahead.followed(solve_job), jobs, workers, summary_of_lost, store_result, ahead.tick)


def _known(job: Job, ledger: Ledger) -> dict[str, Any] | None:
    """Return the known result of a case, from the rows of the folder or (always with ``keep``) its result file."""
    if not job.keep and job.name in ledger.known:
        return {**ledger.known[job.name], "output": job.output if os.path.exists(job.output) else None}
    summary = stored_summary(job)
    if summary is None:
        return None
    found = outcome_of(job.goal, summary)
    ledger.store(job.name, found)
    return dict(found)


def _warm_up(jobs: Sequence[Job], compiling: Callable[[str], None]) -> None:
    """Compile in this process kernels that several would wait for; refused cases are reported in their rows."""
    first = {job.kernels: job for job in reversed(jobs)}
    for job in first.values():
        try:
            warm_up(prepare(job.load()), compiling)
        except CaseError:
            continue
