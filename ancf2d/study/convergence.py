"""Convergence studies: a goal over meshes or time steps and element types, with errors, orders and limits."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, cast

from ..case import Dynamic, LoadedCase, load_case_text
from ..case.overrides import OPTION
from ..case.units import SI
from ..errors import UNSOLVED, CaseError, Problem, verdict
from ..quantities import QUANTITIES
from ..results import Column, write_tables
from ..results.records import known_column
from .forecast import Done, Forecast, steps_of
from .goal import GoalValue, error_scale, goal_of, sequence, solve_for_goal
from .order import Estimate, estimate, observed_order, order_from_errors, round_off_level
from .pool import ALONE, DIED, Workers, run_jobs
from .record import Progress
from .run import describe_goal, prepare, result_header, vocabulary
from .variants import (
    Variant,
    check_flexible,
    count_of,
    default_meshes,
    distribute,
    flexible,
    overrides_for,
    proportional,
)
from .warmup import warm_up


@dataclass(frozen=True)
class Steps:
    """Time steps to refine instead of the mesh: ``key`` of the solver (dt or tolerance) and its values."""

    key: str
    values: tuple[float, ...]


def with_step(loaded: LoadedCase, key: str, value: float) -> LoadedCase:
    """Return the case of a motion with fixed steps (``key`` dt) or adaptive ones (``key`` tolerance)."""
    changes: dict[str, Any] = {"dt": None, "tolerance": None, key: value}
    solver: Any = replace(cast(Dynamic, loaded.case.solver), **changes)
    return replace(loaded, case=replace(loaded.case, solver=solver))


# error that time steps may accumulate, in multiples of the tolerance
STEPS = 100.0


@dataclass(frozen=True)
class Job:
    """One mesh or time step of one variant, with everything that another process needs to solve it."""

    text: str
    file: str
    overrides: tuple[str, ...]
    variant: Variant
    elements: int
    key: str = ""
    step: float | None = None

    def load(self) -> LoadedCase:
        """Return the case with this element type, mesh and step. Raises CaseError."""
        loaded = load_case_text(self.text, self.file, self.overrides, vocabulary(), os.path.dirname(self.file))
        return loaded if self.step is None else with_step(loaded, self.key, self.step)

    @property
    def cost(self) -> float:
        """Return the size of this level, compared with others of its variant: elements times steps."""
        fixed = self.key == "dt"
        return self.elements * steps_of(self.step if fixed else None, None if fixed else self.step)

    @property
    def row(self) -> Row:
        """Return the row of this level before it is solved."""
        return Row(self.variant.element, self.variant.formulation or "", self.elements, self.step)


@dataclass
class Row:
    """The goal on one mesh, or with one time ``step`` (dt [s], or tolerance).

    ``error`` is relative (see ``GoalValue``), in motion the largest over time; ``order`` is observed from this row and
    the coarser ones; ``kinks``: a force or support acts inside an element. ``status`` is converged, or failed with a
    ``reason``.
    """

    element: str
    formulation: str
    elements: int
    step: float | None = None
    dofs: int | None = None
    value: float | None = None
    error: float | None = None
    order: float | None = None
    wall_s: float | None = None
    status: str = "converged"
    reason: str = ""
    answer: GoalValue | None = field(default=None, repr=False)
    kinks: bool = field(default=False, repr=False)

    def as_json(self) -> dict[str, Any]:
        """Return the ``--json`` form of the row."""
        named = {f.name: getattr(self, f.name) for f in fields(self) if f.repr}
        return {k: v for k, v in named.items() if v not in ("", None) or k not in ("reason", "step")}


@dataclass
class Series:
    """The rows of one element type, coarse to fine, and the estimate of their limit."""

    rows: list[Row]
    estimate: Estimate
    reference: float | None

    @property
    def element(self) -> str:
        """The element type."""
        return self.rows[0].element

    @property
    def formulation(self) -> str:
        """The formulation."""
        return self.rows[0].formulation

    def as_json(self) -> dict[str, Any]:
        """Return the ``--json`` form of the limit."""
        e = self.estimate
        return {"extrapolated": e.value, "error_bar": e.error_bar, "order": e.order, "asymptotic": e.asymptotic,
                "note": e.note}


@dataclass
class Convergence:
    """A finished convergence study, with one series of meshes or time steps for each element type."""

    case: str
    title: str
    goal: str
    reference: float | None
    series: list[Series]
    warnings: list[str]
    over: str = "elements"
    labels: tuple[str, str, str] = SI

    @property
    def rows(self) -> list[Row]:
        """All rows, type by type."""
        return [row for s in self.series for row in s.rows]

    @property
    def converged(self) -> bool:
        """Return whether any mesh could be solved."""
        return any(row.value is not None for row in self.rows)

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``--json`` prints."""
        limits = [{"element": s.element, "formulation": s.formulation, **s.as_json()} for s in self.series]
        alone = self.series[0].as_json() if len(self.series) == 1 else dict.fromkeys(self.series[0].as_json())
        out = {"case": self.case, "title": self.title, "status": "converged" if self.converged else "failed",
               "goal": self.goal, "reference": "auto" if self.reference is None else self.reference, "over": self.over,
               "rows": [row.as_json() for row in self.rows], **alone, "elements": limits, "warnings": self.warnings}
        if not self.converged:
            out.update(reason=self.rows[0].reason, at={"elements": self.rows[0].elements})
        return out


def convergence(loaded: LoadedCase, variants: Sequence[Variant] = (Variant(),), meshes: Sequence[int] | None = None,
                reference: float | None = None, workers: Workers = ALONE,
                compiling: Callable[[str], None] = lambda text: None,
                done: Done = lambda share, left: None, steps: Steps | None = None) -> Convergence:
    """Solve a case on a sequence of meshes, or with a sequence of time steps, and judge the goal's convergence.

    ``meshes`` are numbers of elements of the whole model (default: five, doubling from the case's own); ``steps`` keep
    the case's mesh; errors are relative to ``reference``, or with None to each type's own limit. Raises CaseError for a
    case without a goal, or one that no variant can solve; a level that fails gives a row with the reason.
    """
    goal = goal_of(loaded, "no value to study the convergence of")
    if steps is not None and not loaded.case.solver.moves:
        raise CaseError(loaded.source.problem(("solver", "type"), "there are no time steps to refine",
                                              expected="solver: {type: dynamic}, or meshes to refine"))
    if steps is None:
        check_flexible(loaded, "for a motion: time steps to refine (--dt, --tolerance)")
    if any(v == Variant(formulation=v.formulation) for v in variants):
        prepare(loaded)
    own = sum(count_of(b) for b in flexible(loaded.case).values())
    default = default_meshes(loaded.case) if steps is None else [own]
    counts, warnings = meshes_of(loaded, sorted(set(meshes or default)))
    if steps is not None and len(counts) > 1:
        raise CaseError(loaded.source.problem(("solver",), "several meshes and several time steps at once",
                                              expected="one mesh with several time steps, or several meshes"))
    jobs = [[_job(loaded, v, c, workers, steps, x) for c in counts for x in _values(steps)] for v in variants]
    _warm_up([group[0] for group in jobs], compiling)
    flat = [job for group in jobs for job in group]
    ahead = Forecast([(job.variant, job.cost) for job in flat], workers, done)
    rows = run_jobs(ahead.followed(solve_job), flat, workers, _lost, ahead.record, ahead.tick)
    if any(row.kinks for row in rows):
        warnings.append("something acts inside elements of some meshes because of nodes: regular or preset: paper, so "
                        "orders are rough")
    k = len(jobs[0])
    series = [_judge(rows[i * k:(i + 1) * k], reference) for i in range(len(variants))]
    for one in series if steps is None else ():
        one.estimate = _with_note(one, loaded.case.solver)
    return Convergence(loaded.source.file, loaded.case.title, describe_goal(goal), reference, series,
                       warnings, "elements" if steps is None else steps.key, loaded.case.units.labels)


def _with_note(series: Series, solver: Any) -> Estimate:
    """Return the estimate, with a note if meshes of a motion differ by no more than the error of their time steps."""
    found, answers = series.estimate, [row.answer for row in series.rows if row.answer is not None][-2:]
    if not isinstance(solver, Dynamic) or solver.dt is not None or found.asymptotic or len(answers) < 2:
        return found
    apart = answers[1].distance(answers[0]) / answers[1].size
    if apart > STEPS * solver.local_error:
        return found
    return replace(found, note=f"not asymptotic: the last two meshes differ by {apart:.1e}, which errors of the time "
                   f"steps can cause (tolerance {solver.local_error:g}); a smaller tolerance, such as --set "
                   f"solver.tolerance={1e-3 * solver.local_error:.0e}, shows the error of the mesh")


def _values(steps: Steps | None) -> list[float | None]:
    """Return the time steps, coarse to fine; a single None for those of the case."""
    return [None] if steps is None else [*sorted(set(steps.values), reverse=True)]


def meshes_of(loaded: LoadedCase, totals: Sequence[int]) -> tuple[list[dict[str, int]], list[str]]:
    """Return the elements of each body for each mesh, and warnings about meshes that differ from those asked for."""
    counts: list[dict[str, int]] = []
    warnings = []
    for total in totals:
        new = distribute(loaded.case, total)
        if sum(new.values()) != total:
            warnings.append(f"{total} elements are too few for the bodies, so {sum(new.values())} are used")
        elif not proportional(loaded.case, new):
            split = ", ".join(f"{n} {name}" for name, n in new.items())
            warnings.append(f"{total} elements cannot be divided in the proportions of the case ({split}): orders are "
                            "rough")
        if new not in counts:
            counts.append(new)
    return counts, warnings


def _job(loaded: LoadedCase, variant: Variant, counts: dict[str, int], workers: Workers, steps: Steps | None,
         value: float | None) -> Job:
    overrides = (*loaded.overrides, *overrides_for(loaded.case, variant, counts))
    key = "" if steps is None else steps.key
    return Job(loaded.text, workers.file(loaded.source.file), overrides, variant, sum(counts.values()), key, value)


def _warm_up(first: Sequence[Job], compiling: Callable[[str], None]) -> None:
    """Compile the kernels once, before several processes would. Raises CaseError if no variant can be solved."""
    problems, refused = [], 0
    for job in first:
        try:
            warm_up(prepare(job.load()), compiling)
        except CaseError as error:
            refused += 1
            problems += [_about(job.variant, p) for p in error.problems]
    if refused == len(first):
        raise CaseError(problems)


def _about(variant: Variant, problem: Problem) -> Problem:
    """Return a problem of an element type in terms of the option --element instead of the overrides made from it."""
    if not problem.file.startswith(OPTION):
        return problem
    return Problem(problem.message, file=f"--element {variant.label}", path=problem.path, expected=problem.expected)


def solve_job(job: Job, progress: Progress | None = None) -> Row:
    """Return the row of one mesh; a failure is reported in the row."""
    row = job.row
    try:
        _solve(job, row, progress)
    except UNSOLVED as error:
        row.status, row.reason = "failed", verdict(error)[1]
    return row


def _lost(job: Job) -> Row:
    row = job.row
    row.status, row.reason = "failed", DIED
    return row


def _solve(job: Job, row: Row, progress: Progress | None) -> None:
    found = solve_for_goal(job.load(), progress)
    row.element, row.formulation = found.types
    row.kinks = any(m.plan.inside() for m in found.model.meshes.values() if not m.plan.rigid)
    row.elements, row.dofs = found.model.n_elements, found.model.n_q
    row.wall_s, row.answer, row.value = found.summary["wall_s"], found.answer, found.answer.value


def _judge(rows: list[Row], reference: float | None) -> Series:
    """Fill in errors and orders in the rows of one element type; return the rows with their limit."""
    good = [row for row in rows if row.answer is not None]
    answers = [row.answer for row in good if row.answer is not None]
    n = [float(row.elements) if row.step is None else 1.0 / row.step for row in good]
    f, scale = sequence(answers), answers[-1].size if answers else 1.0
    found = estimate(n, f, scale)
    limit = limit_of(answers, found, reference)
    for row, answer, unwrapped in zip(good, answers, f, strict=True):
        if answer.period:
            row.value = unwrapped
        if limit is not None and (reference is not None or len(good) > 1):
            row.error = answer.distance(limit) / limit.size
    settled = round_off_level(f, scale)
    for i, row in enumerate(good):
        if reference is not None:
            errors = [r.error or 0.0 for r in good[max(i - 1, 0):i + 1]]
            row.order = order_from_errors(n[i - 1:i + 1], errors) if i >= 1 else None
        elif i >= 2 and (settled is None or i <= settled):
            row.order = observed_order(n[i - 2:i + 1], f[i - 2:i + 1])
    value = None if found.value is None or limit is None else found.value if reference is not None else limit.value
    return Series(rows, replace(found, value=value), None if limit is None else limit.value)


def limit_of(answers: Sequence[GoalValue], found: Estimate, reference: float | None) -> GoalValue | None:
    """Return the answer that errors are relative to: the reference, or the limit of the sequence."""
    if not answers:
        return None
    last = answers[-1]
    if reference is not None:
        # the reference of a motion is its value at the end
        size = last.size if last.course is not None else error_scale(reference, last.smallest)
        return GoalValue(reference, size, period=last.period)
    if found.value is None:
        return None
    if last.course is None:
        return GoalValue(found.value, error_scale(found.value, last.smallest), period=last.period)
    gap = last.distance(answers[-2]) if len(answers) > 1 else 0.0
    # distances approach their limit from one side: the remaining fraction of the last distance leads to the limit
    return last.beyond(answers[-2], abs(found.value - last.value) / gap) if gap > 0.0 else last


def goal_units(loaded: LoadedCase) -> str:
    """Return the units of a case's goal, as a template for result files."""
    goal = goal_of(loaded)
    if goal.kind is not None:
        return "rad/{T}"
    if goal.quantity is None:
        return "1"
    if goal.part == "phase":
        return "rad"
    return known_column("probe", goal.quantity).units if goal.quantity in QUANTITIES else "{F}*{L}"


def write_convergence(study: Convergence, loaded: LoadedCase, path: str, command: str = "", *,
                      force: bool = False) -> Path:
    """Write the rows as table ``convergence``; return the path. Raises ResultsError."""
    names = ("element", "formulation", "elements", "dofs", "value", "error", "order", "wall_s", "status")
    columns = (Column("value", goal_units(loaded), f"the goal: {study.goal}"),
               Column("status", "none", "converged or failed"))
    table = {name: [getattr(row, name) for row in study.rows] for name in names}
    attrs = {"goal": study.goal, "reference": "auto" if study.reference is None else study.reference}
    # the rows are in the table already
    summary = {k: v for k, v in study.as_json().items() if k != "rows"}
    return write_tables(path, result_header(loaded, command), {"convergence": (table, attrs)}, columns, summary,
                        force=force)
