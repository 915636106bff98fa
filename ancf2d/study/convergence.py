"""Mesh refinement: the goal of a case over meshes and element types, with errors, orders and limits."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from ..case import LoadedCase, load_case_text
from ..case.overrides import OPTION
from ..errors import CaseError, ComputationError, Problem
from .goal import error_scale, smallest_scale
from .order import Estimate, estimate, observed_order, order_from_errors, round_off_level
from .pool import ALONE, DIED, Workers, run_jobs
from .run import Progress, describe_goal, prepare, quantity, run_case, vocabulary
from .variants import Variant, default_meshes, distribute, overrides_for, proportional
from .warmup import warm_up


@dataclass(frozen=True)
class Job:
    """One mesh of one variant: everything that another process needs to solve it."""

    text: str
    file: str
    overrides: tuple[str, ...]
    variant: Variant
    elements: int

    def load(self) -> LoadedCase:
        """Return the case with this element type and mesh. Raises CaseError."""
        return load_case_text(self.text, self.file, self.overrides, vocabulary(), os.path.dirname(self.file))

    @property
    def row(self) -> Row:
        """The row of this mesh before it is solved."""
        return Row(self.variant.element, self.variant.formulation or "", self.elements)


@dataclass
class Row:
    """The goal on one mesh.

    ``error`` is relative to the reference, or to ``smallest`` where that is larger; ``order`` is the observed
    one between this mesh and the coarser ones. ``status`` is converged, or failed with a ``reason``.
    """

    element: str
    formulation: str
    elements: int
    dofs: int | None = None
    value: float | None = None
    error: float | None = None
    order: float | None = None
    wall_s: float | None = None
    status: str = "converged"
    reason: str = ""
    smallest: float = field(default=0.0, repr=False)

    def as_json(self) -> dict[str, Any]:
        """Return what ``--json`` prints of the row."""
        return {k: v for k, v in asdict(self).items() if k != "smallest" and (k != "reason" or v)}


@dataclass
class Series:
    """The meshes of one element type, coarse to fine, and what they tell of its limit."""

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
        """Return what ``--json`` prints of the limit."""
        e = self.estimate
        return {"extrapolated": e.value, "error_bar": e.error_bar, "order": e.order, "asymptotic": e.asymptotic,
                "note": e.note}


@dataclass
class Convergence:
    """A finished study: a series per element type."""

    case: str
    title: str
    goal: str
    reference: float | None
    series: list[Series]
    warnings: list[str]

    @property
    def rows(self) -> list[Row]:
        """All rows, type by type."""
        return [row for s in self.series for row in s.rows]

    @property
    def converged(self) -> bool:
        """Whether any mesh could be solved."""
        return any(row.value is not None for row in self.rows)

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``--json`` prints."""
        limits = [{"element": s.element, "formulation": s.formulation, **s.as_json()} for s in self.series]
        alone = self.series[0].as_json() if len(self.series) == 1 else dict.fromkeys(self.series[0].as_json())
        out = {"case": self.case, "title": self.title, "status": "converged" if self.converged else "failed",
               "goal": self.goal, "reference": "auto" if self.reference is None else self.reference,
               "rows": [row.as_json() for row in self.rows], **alone, "elements": limits, "warnings": self.warnings}
        if not self.converged:
            out.update(reason=self.rows[0].reason, at={"elements": self.rows[0].elements})
        return out


def convergence(loaded: LoadedCase, variants: Sequence[Variant] = (Variant(),), meshes: Sequence[int] | None = None,
                reference: float | None = None, workers: Workers = ALONE,
                compiling: Callable[[], None] = lambda: None, done: Callable[[float], None] = lambda share: None,
                ) -> Convergence:
    """Solve a case on a sequence of meshes for each element type, and judge the goal's convergence.

    ``meshes`` are numbers of elements of the whole model (default: five, doubling from the case's own);
    ``reference`` is what errors are against, None for each type's own limit. Raises CaseError for a case
    without a goal, or one that no variant can solve; a mesh that fails is a row that says so.
    """
    if loaded.case.goal is None:
        raise CaseError(loaded.source.problem((), "the case has no goal: nothing is named that should converge",
                                              expected="for example goal: {probe: mid, quantity: uy}"))
    if any(v == Variant(formulation=v.formulation) for v in variants):
        prepare(loaded)
    counts, warnings = _meshes(loaded, sorted(set(meshes or default_meshes(loaded.case))))
    jobs = [[_job(loaded, v, c, workers) for c in counts] for v in variants]
    _warm_up([group[0] for group in jobs], compiling)
    flat = [job for group in jobs for job in group]
    count = itertools.count(1)
    rows = run_jobs(solve_job, flat, workers, _lost, lambda i, row: done(next(count) / len(flat)))
    k = len(counts)
    series = [_judge(rows[i * k:(i + 1) * k], reference) for i in range(len(variants))]
    return Convergence(loaded.source.file, loaded.case.title, describe_goal(loaded.case.goal), reference, series,
                       warnings)


def _meshes(loaded: LoadedCase, totals: Sequence[int]) -> tuple[list[dict[str, int]], list[str]]:
    """Return the elements of each body for each mesh, and what does not come out as asked."""
    counts: list[dict[str, int]] = []
    warnings = []
    for total in totals:
        new = distribute(loaded.case, total)
        if sum(new.values()) != total:
            warnings.append(f"{total} elements are too few for the bodies: {sum(new.values())} are used")
        elif not proportional(loaded.case, new):
            split = ", ".join(f"{n} {name}" for name, n in new.items())
            warnings.append(f"{total} elements cannot be shared in the proportions of the case ({split}): orders are "
                            "rough")
        if new not in counts:
            counts.append(new)
    return counts, warnings


def _job(loaded: LoadedCase, variant: Variant, counts: dict[str, int], workers: Workers) -> Job:
    overrides = (*loaded.overrides, *overrides_for(loaded.case, variant, counts))
    return Job(loaded.text, workers.file(loaded.source.file), overrides, variant, sum(counts.values()))


def _warm_up(first: Sequence[Job], compiling: Callable[[], None]) -> None:
    """Compile once, before several processes would; raise CaseError where no variant can be solved."""
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
    """Return a problem of an element type that the command line names, without the overrides that it became."""
    if not problem.file.startswith(OPTION):
        return problem
    return Problem(problem.message, file=f"--element {variant.label}", path=problem.path, expected=problem.expected)


def solve_job(job: Job) -> Row:
    """Return the row of one mesh; what fails is told in it."""
    row = job.row
    try:
        _solve(job, row)
    except CaseError as error:
        row.status, row.reason = "failed", error.problems[0].message
    except ComputationError as error:
        row.status, row.reason = "failed", error.failure.reason
    except MemoryError:
        row.status, row.reason = "failed", "there is not enough memory for this mesh"
    return row


def _lost(job: Job) -> Row:
    row = job.row
    row.status, row.reason = "failed", DIED
    return row


def _solve(job: Job, row: Row) -> None:
    loaded = job.load()
    goal = loaded.case.goal
    states: list[Any] = [None]
    outcome = run_case(loaded, progress=Progress(state=lambda state: states.__setitem__(0, state)))
    model, summary = outcome.model, outcome.summary
    plans = [m.plan for m in model.meshes.values()]
    row.element = "+".join(dict.fromkeys(p.element.name for p in plans))
    row.formulation = "+".join(dict.fromkeys(p.formulation.name for p in plans))
    row.elements, row.dofs = model.n_elements, model.n_q
    if outcome.failure is not None:
        raise outcome.failure
    row.wall_s = summary["wall_s"]
    row.value = None if goal is None else quantity(goal, summary)
    if goal is None or row.value is None:
        raise ComputationError(f"the solver gives no value of {describe_goal(goal)}")
    row.smallest = smallest_scale(goal, summary, model, states[0].d[:model.n_q])


def _judge(rows: list[Row], reference: float | None) -> Series:
    """Fill in errors and orders of the rows of one element type; return them with their limit."""
    good = [row for row in rows if row.value is not None]
    n, f = [float(row.elements) for row in good], [float(row.value) for row in good if row.value is not None]
    smallest = good[-1].smallest if good else 0.0
    scale = error_scale(f[-1], smallest) if good else 1.0
    found = estimate(n, f, scale)
    against = found.value if reference is None else reference
    for row in good:
        if against is not None and row.value is not None and (reference is not None or len(good) > 1):
            row.error = abs(row.value - against) / error_scale(against, smallest)
    settled = round_off_level(f, scale)
    for i, row in enumerate(good):
        if reference is not None:
            errors = [r.error or 0.0 for r in good[max(i - 1, 0):i + 1]]
            row.order = order_from_errors(n[i - 1:i + 1], errors) if i >= 1 else None
        elif i >= 2 and (settled is None or i <= settled):
            row.order = observed_order(n[i - 2:i + 1], f[i - 2:i + 1])
    return Series(rows, found, against)
