"""Many variants of one case: all combinations of some of its values, each a run with a result file of its own."""

from __future__ import annotations

import csv
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import __version__
from ..case import Case, Dynamic, Goal, LoadedCase, load_case_text
from ..case.axes import OPTION as OVER
from ..case.axes import Axis, combinations
from ..case.compose import read_text
from ..case.emit import flow
from ..case.overrides import OPTION as SET
from ..case.units import SI
from ..errors import UNSOLVED, CaseError, Problem, ResultsError, verdict
from ..results.target import SWEEP_COLUMNS, replacing
from .accuracy.control import is_pursued, solve_to_accuracy
from .accuracy.pursuit import Target
from .digests import content_name, files_of
from .forecast import Done, Forecast, steps_of
from .pool import DIED, Workers, run_jobs
from .record import Progress
from .run import describe_goal, prepare, quantity, run_case, vocabulary
from .variants import count_of, flexible
from .warmup import kernels_of, warm_up

# modes and buckling loads that a row tells where the case has no goal
FIRST = 3
# between two looks at a result that another process is writing
TURN_SECONDS = 0.1


@dataclass
class Row:
    """One combination: the values ``set``, and what came of it.

    ``status`` is converged, failed (by the computation) or refused (as a case), the latter two with a ``reason``;
    empty until it is known. ``values`` are the goal or, where the case has none, probes, modes or load factors;
    ``estimate`` is that of the relative error. ``reused`` where an earlier run had computed it.
    """

    set: dict[str, Any]
    status: str = ""
    reason: str = ""
    goal: float | None = None
    values: dict[str, float | None] = field(default_factory=dict)
    output: str | None = None
    elements: int | None = None
    dofs: int | None = None
    wall_s: float | None = None
    accuracy: dict[str, Any] | None = None
    warnings: list[str] = field(default_factory=list)
    reused: bool = False

    @property
    def estimate(self) -> float | None:
        """The estimate of the relative error, where the run gives one."""
        return (self.accuracy or {}).get("estimate")

    def as_json(self) -> dict[str, Any]:
        """Return what ``--json`` prints of the row."""
        out = {k: v for k, v in vars(self).items() if k not in ("reason", "warnings") or v}
        return {**out, "status": self.status or "waiting"}


@dataclass(frozen=True)
class Job:
    """A run that another process can do.

    ``name`` is that of its result by content, ``kernels`` what it compiles, ``size`` elements times steps.
    """

    text: str
    file: str
    overrides: tuple[str, ...]
    goal: Goal | None
    output: str
    name: str
    kernels: str
    size: float
    command: str
    force: bool = False

    def load(self) -> LoadedCase:
        """Return the case. Raises CaseError."""
        return load_case_text(self.text, self.file, self.overrides, vocabulary(), os.path.dirname(self.file))


@dataclass
class Sweep:
    """All combinations of a case's values: a row of each and the job that it needs, None where it is refused."""

    case: str
    title: str
    axes: list[Axis]
    folder: Path
    rows: list[Row]
    jobs: list[Job | None]
    labels: tuple[str, str, str] = SI

    @property
    def finished(self) -> list[Row]:
        """The rows whose outcome is known."""
        return [row for row in self.rows if row.status]

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``--json`` prints."""
        done = all(row.status == "converged" for row in self.rows)
        return {"case": self.case, "title": self.title, "status": "converged" if done else "failed",
                "folder": str(self.folder), "rows": [row.as_json() for row in self.rows]}


def plan(case: str, axes: list[Axis], overrides: Sequence[str], folder: Path, workers: Workers, command: str = "",
         force: bool = False) -> Sweep:
    """Return the sweep of a case file over some axes, nothing computed yet; results go to ``folder``.

    A combination that is no valid case is a refused row. Raises CaseError where all are, with all their problems.
    """
    text, file = read_text(case), workers.file(case)
    rows: list[Row] = []
    jobs: list[Job | None] = []
    problems: list[Problem] = []
    title, labels = "", SI
    for values in combinations(axes):
        row = Row({axis.path: value for axis, value in zip(axes, values, strict=True)})
        options = (*overrides, *(axis.override(value) for axis, value in zip(axes, values, strict=True)))
        rows.append(row)
        try:
            loaded = load_case_text(text, file, options, vocabulary(), os.path.dirname(file))
        except CaseError as error:
            row.status, row.reason = verdict(error)
            problems += error.problems
            jobs.append(None)
            continue
        title, labels = loaded.case.title, loaded.case.units.labels
        name = content_name(loaded.completed, files_of(loaded))
        jobs.append(Job(text, file, options, loaded.case.goal, workers.file(str(folder / f"{name}.h5")), name,
                        kernels_of(loaded.case), _size(loaded.case), command, force))
    if not any(jobs):
        raise CaseError(_distinct(problems, axes))
    return Sweep(case, title, axes, folder, rows, jobs, labels)


def _size(case: Case) -> float:
    elements = sum(count_of(body) for body in flexible(case).values())
    solver = case.solver
    if not isinstance(solver, Dynamic):
        return float(max(elements, 1))
    return max(elements, 1) * solver.t_end * steps_of(solver.dt, solver.local_error)


def _distinct(problems: list[Problem], axes: list[Axis]) -> list[Problem]:
    """Return each problem once; those of overrides that the axes became name the axis as it was given."""
    found: dict[tuple[Any, ...], Problem] = {}
    for p in problems:
        axis = next((a for a in axes if p.file.startswith(f"{SET}{a.path}=")), None)
        if axis is not None:
            p = Problem(p.message, f"{OVER}{axis.text}", path=p.path, expected=p.expected, near=p.near)
        found.setdefault((p.file, p.line, p.column, p.message), p)
    return list(found.values())


def run_sweep(sweep: Sweep, workers: Workers, compiling: Callable[[str], None] = lambda text: None,
              done: Done = lambda share, left: None) -> None:
    """Fill in the rows of a sweep: from results that are there, else by running the case.

    Equal cases are run once. Results of the same case by the same ancf2d are used again unless the sweep forces new
    ones. ``done`` is told the progress. Raises ResultsError where there can be no folder, and what ``run_jobs``
    raises.
    """
    try:
        sweep.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultsError(f"cannot make the folder '{sweep.folder}': {error.strerror}") from error
    needed: dict[str, tuple[Job, list[Row]]] = {}
    for row, job in zip(sweep.rows, sweep.jobs, strict=True):
        if job is not None:
            needed.setdefault(job.name, (job, []))[1].append(row)
    for name, (job, rows) in list(needed.items()):
        summary = None if job.force else stored_summary(job)
        if summary is not None:
            _fill(rows, job.goal, summary, reused=True)
            del needed[name]
    jobs = [job for job, _ in needed.values()]
    if workers.scheduler is None:
        _warm_up(jobs, compiling)

    ahead = Forecast([(job.kernels, job.size) for job in jobs], workers, done)

    def take(i: int, summary: dict[str, Any], seconds: float) -> None:
        if summary["status"] == "converged" and not os.path.exists(jobs[i].output):
            unseen = f"'{jobs[i].output}' was written by a worker on another machine and is not visible here"
            summary.setdefault("warnings", []).append(unseen)
        _fill(needed[jobs[i].name][1], jobs[i].goal, summary)
        ahead.take(i, summary, seconds)

    run_jobs(ahead.followed(solve_job), jobs, workers, _lost, take, ahead.tick)


def _warm_up(jobs: Sequence[Job], compiling: Callable[[str], None]) -> None:
    """Compile in this process what several would wait for; a case that is refused is told by its row."""
    first = {job.kernels: job for job in reversed(jobs)}
    for job in first.values():
        try:
            warm_up(prepare(job.load()), compiling)
        except CaseError:
            continue


def _fill(rows: Sequence[Row], goal: Goal | None, summary: dict[str, Any], reused: bool = False) -> None:
    for row in rows:
        row.status, row.reason, row.reused = summary["status"], summary.get("reason", ""), reused
        row.elements, row.dofs, row.wall_s = summary.get("elements"), summary.get("dofs"), summary.get("wall_s")
        row.accuracy, row.output = summary.get("accuracy"), summary.get("output")
        row.warnings = list(summary.get("warnings", ()))
        if row.status == "converged" or _fell_short(summary):
            row.goal = None if goal is None else quantity(goal, summary)
            row.values = {describe_goal(goal): row.goal} if goal is not None else told(summary)


def _fell_short(summary: dict[str, Any]) -> bool:
    """Whether a run has a value, but not with the accuracy that its case asks for."""
    return (summary.get("accuracy") or {}).get("achieved") is False


def told(summary: dict[str, Any]) -> dict[str, float | None]:
    """Return the numbers that tell most of a run without a goal: modes, load factors or displacements of probes."""
    found: dict[str, float | None] = {f"{name}.{q}": values.get(q) for name, values in summary["probes"].items()
                                      for q in ("ux", "uy")}
    if summary.get("frequencies"):
        return {f"omega {k}": f["omega"] for k, f in enumerate(summary["frequencies"][:FIRST], start=1)}
    if summary.get("load_factors"):
        return {f"load factor {k}": f for k, f in enumerate(summary["load_factors"][:FIRST], start=1)}
    return found


# ---------------------------------------------------------------------------- results by content

def stored_summary(job: Job) -> dict[str, Any] | None:
    """Return the summary of a finished result of the same case by the same ancf2d, None where there is none."""
    from ..results import open_results

    if not os.path.exists(job.output):
        return None
    try:
        with open_results(job.output) as found:
            # the name tells the case; that the file is what its name says is asked of what it holds
            same = content_name(found.case_completed, files_of(job.load())) == job.name
            if found.status != "converged" or found.attrs.get("version_ancf2d") != __version__ or not same:
                return None
            return {**found.summary, "output": job.output}
    except ResultsError:
        return None


def solve_job(job: Job, progress: Progress | None = None) -> dict[str, Any]:
    """Run one case and return its summary; what fails is told in it."""
    try:
        return _solve_in_turn(job, progress)
    except UNSOLVED as error:
        status, reason = verdict(error)
        return {"status": status, "reason": reason}
    except ResultsError as error:
        return {"status": "failed", "reason": str(error)}
    except Exception as error:
        # a row among thousands: the others are not given up for it
        return {"status": "failed", "reason": f"internal error, please report: {type(error).__name__}: {error}"}


def _solve_in_turn(job: Job, progress: Progress | None) -> dict[str, Any]:
    """Run one case, or wait for another process that runs it, and take its result."""
    from ..results.target import BusyError

    while True:
        try:
            return _solve(job, progress)
        except BusyError:
            time.sleep(TURN_SECONDS)
        summary = None if job.force else stored_summary(job)
        if summary is not None:
            return summary


def _solve(job: Job, progress: Progress | None) -> dict[str, Any]:
    from ..results import part_path

    loaded = job.load()
    if not os.path.isdir(os.path.dirname(job.output) or "."):
        raise ResultsError(f"there is no folder '{os.path.dirname(job.output)}' on this worker; several machines need "
                           "a shared folder")
    options: dict[str, Any] = {"force": job.force or _left_over(job.output), "command": job.command}
    if is_pursued(loaded):
        summary = solve_to_accuracy(loaded, Target(job.output, **options)).outcome.summary
        wanted = summary["accuracy"]["wanted"]
        short = {"status": "failed", "reason": f"the wanted accuracy {wanted:g} was not reached"}
        return {**summary, **(short if _fell_short(summary) else {})}
    if not job.force and isinstance(loaded.case.solver, Dynamic) and part_path(job.output).exists():
        try:
            return run_case(loaded, job.output, resume=True, progress=progress, **options).summary
        except ResultsError:
            # left by other options or an unreadable file: it is replaced
            pass
    return run_case(loaded, job.output, progress=progress, **options).summary


def _left_over(output: str) -> bool:
    """Return whether a file under the name of a result, which no one else gives, is one or the beginning of one."""
    from ..results.safe import SIGNATURE

    try:
        with open(output, "rb") as stream:
            return SIGNATURE.startswith(stream.read(len(SIGNATURE)))
    except OSError:
        return False


def _lost(job: Job) -> dict[str, Any]:
    return {"status": "failed", "reason": DIED}


def value_names(sweep: Sweep) -> list[str]:
    """Return the names of the computed values of any row."""
    return list(dict.fromkeys(name for row in sweep.rows for name in row.values))


def shown(value: Any) -> str:
    """Return a value as it is read in a table: texts as they are, all else as YAML has it."""
    return value if isinstance(value, str) else flow(value)


def short_names(paths: Sequence[str]) -> list[str]:
    """Return the shortest ends of dotted paths that tell them apart."""
    def end(path: str, parts: int) -> str:
        return ".".join(path.split(".")[-parts:])

    out = []
    for path in paths:
        whole = path.count(".") + 1
        out.append(next((end(path, k) for k in range(1, whole)
                         if sum(end(p, k) == end(path, k) for p in paths) == 1), path))
    return out


def write_csv(sweep: Sweep, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write the finished rows: full paths of the varied values, then what was computed, at full precision.

    Raises ResultsError where the file cannot be written, or was not made by ancf2d, unless ``force``.
    """
    paths, names = [axis.path for axis in sweep.axes], value_names(sweep)
    with (replacing(path, force) as private,
          private.open("w", newline="", encoding="utf-8", errors="backslashreplace") as stream):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*paths, "status", *names, *SWEEP_COLUMNS])
        for row in sweep.finished:
            writer.writerow([*(shown(row.set[p]) for p in paths), row.status, *(row.values.get(n) for n in names),
                             row.elements, row.dofs, row.wall_s, row.estimate, row.output, row.reason])
