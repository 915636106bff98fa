"""Error against cost of a case over element types, meshes, integrators and steps, within a time budget."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...case import LoadedCase
from ...case.emit import flow
from ...case.units import SI
from ...errors import CaseError, ComputationError, Problem, many
from ...results import Column, write_tables
from ..convergence import goal_units
from ..forecast import Budget, Done, Forecast
from ..pool import ALONE, Workers, run_jobs
from ..run import describe_goal, result_header
from .measure import Measured, Task, lost, make_ready, measure
from .plan import (
    RESOLVED,
    Chain,
    Choice,
    Limit,
    Planner,
    Series,
    continuum,
    continuum_series,
    distance,
    limit,
    suffices,
)

TABLE = "tradeoff"
WHAT = {
    "error": "relative discretisation error against the series' own limit",
    "error_below": "upper bound of the error where it is too close to that of the reference",
    "model_error": "relative distance between the series' limit and that of the continuum",
    "judged": "basis of the front and the recommendations: error, or error_below where that is unknown, plus the model "
    "error where errors are relative to the continuum",
    "wall_s": "median of the solve times, without reading, building and compilation",
    "memory_bytes": "peak memory of Python and numpy for model and solution, measured in a separate run",
}


def pareto(cost: Sequence[float], error: Sequence[float]) -> list[bool]:
    """Return for each point whether no other one beats it, with at most its cost and error and less of one of them.

    Points that are not finite are never on the front, nor do they beat others.
    """
    front, best = [False] * len(cost), (math.inf, math.inf)
    known = [i for i in range(len(cost)) if math.isfinite(cost[i]) and math.isfinite(error[i])]
    for i in sorted(known, key=lambda i: (cost[i], error[i])):
        if error[i] < best[1] or (cost[i], error[i]) == best:
            front[i], best = True, (cost[i], error[i])
    return front


def cheapest(cost: Sequence[float], error: Sequence[float], wanted: float) -> int | None:
    """Return the index of the cheapest point with an error of at most ``wanted``, or None if there is none."""
    good = [i for i in range(len(cost)) if math.isfinite(cost[i]) and error[i] <= wanted]
    return min(good, key=lambda i: (cost[i], error[i])) if good else None


@dataclass
class Row:
    """One setting on one mesh.

    ``error`` is None if unknown; it is then below ``error_below``, if that is known. ``judged`` is the basis of the
    front and the recommendations: the error, or its bound, plus the model error if errors are relative to the
    continuum; infinite if unknown.
    """

    measured: Measured
    series: int
    error: float | None = None
    error_below: float | None = None
    model_error: float | None = None
    judged: float = math.inf
    pareto: bool = False

    @property
    def task(self) -> Task:
        """The task that was solved."""
        return self.measured.task

    def as_json(self) -> dict[str, Any]:
        """Return the ``--json`` form of the row."""
        m = self.measured
        out: dict[str, Any] = {"element": m.element, "formulation": m.formulation, "elements": m.elements}
        out.update(self.task.setting.chosen)
        out.update(dofs=m.dofs, value=None if m.answer is None else m.answer.value, error=self.error)
        if self.error_below is not None:
            out["error_below"] = self.error_below
        out["judged"] = self.judged if math.isfinite(self.judged) else None
        out.update(model_error=self.model_error, wall_s=m.wall_s, runs=m.runs, memory_bytes=m.memory,
                   pareto=self.pareto, status=m.status)
        return {**out, "reason": m.reason} if m.reason else out

    def as_recommendation(self) -> dict[str, Any]:
        """Return the recommendation: the row, and the overrides that give it."""
        row = {k: v for k, v in self.as_json().items() if k not in ("runs", "status", "pareto")}
        return {**row, "set": list(self.task.chosen)}


@dataclass
class SeriesSummary:
    """Results for a series: its limit, and the distance of that from the continuum's limit."""

    element: str
    formulation: str
    limit: Limit
    quadrature: Any = None
    model_error: float | None = None
    model_error_bar: float | None = None
    reason: str = ""
    refused: bool = False

    @property
    def model_error_at_most(self) -> float:
        """The model error, or its upper bound if it is not resolved; infinite if it is unknown."""
        if self.model_error is None or self.model_error_bar is None:
            return math.inf
        resolved = self.model_error >= RESOLVED * self.model_error_bar
        return self.model_error if resolved else self.model_error + self.model_error_bar

    def as_json(self) -> dict[str, Any]:
        """Return the ``--json`` form of the series."""
        limit = self.limit
        chosen = {} if self.quadrature is None else {"quadrature": self.quadrature}
        return {"element": self.element, "formulation": self.formulation, **chosen,
                "limit": None if limit.answer is None else limit.answer.value,
                "limit_error": limit.bar if limit.known else None,
                "model_error": self.model_error, "model_error_bar": self.model_error_bar,
                "note": self.reason or limit.note}


@dataclass
class TradeoffStudy:
    """A finished study; ``dropped`` are the tasks that did not fit into the budget, of which ``spent`` [s] was used."""

    case: str
    title: str
    goal: str
    against: str
    accuracies: Sequence[float]
    budget: float
    spent: float = 0.0
    rows: list[Row] = field(default_factory=list)
    series: list[SeriesSummary] = field(default_factory=list)
    continuum: Limit = field(default_factory=Limit)
    continuum_q: list[int] = field(default_factory=list)
    dropped: list[Task] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    labels: tuple[str, str, str] = SI

    @property
    def converged(self) -> bool:
        """Return whether any task could be solved."""
        return any(row.measured.answer is not None for row in self.rows)

    @property
    def _costs(self) -> tuple[list[float], list[float]]:
        """The times of all rows, infinite if unknown, and the errors by which they are judged."""
        times = [math.inf if row.measured.wall_s is None else row.measured.wall_s for row in self.rows]
        return times, [row.judged for row in self.rows]

    def judge(self) -> None:
        """Mark the rows on the Pareto front."""
        for row, best in zip(self.rows, pareto(*self._costs), strict=True):
            row.pareto = best

    def recommended(self, accuracy: float) -> Row | None:
        """Return the cheapest row that reaches an accuracy, or None if there is none."""
        found = cheapest(*self._costs, accuracy)
        return None if found is None else self.rows[found]

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``--json`` prints."""
        best = {accuracy_name(a): self.recommended(a) for a in self.accuracies}
        out: dict[str, Any] = {
            "case": self.case, "title": self.title, "status": "converged" if self.converged else "failed",
            "goal": self.goal, "against": self.against, "meaning": WHAT, "rows": [row.as_json() for row in self.rows],
            "recommended": {name: None if row is None else row.as_recommendation() for name, row in best.items()},
            "series": [known.as_json() for known in self.series], "continuum": self._continuum(),
            "budget_s": self.budget, "spent_s": self.spent, "dropped": [_left_out(t) for t in self.dropped],
            "warnings": self.warnings}
        if not self.converged:
            reasons = [row.measured.reason for row in self.rows if row.measured.reason]
            out.update(reason=reasons[0] if reasons else "the budget did not allow any solution", at={})
        return out

    def _continuum(self) -> dict[str, Any] | None:
        if self.continuum.answer is None:
            return None
        return {"value": self.continuum.answer.value, "error": self.continuum.bar,
                "elements": [f"ancf[3,{q}]" for q in self.continuum_q]}


def accuracy_name(accuracy: float) -> str:
    """Return an accuracy as it is usually written: 1e-3, 5e-4."""
    mantissa, exponent = f"{accuracy:.6e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def _left_out(task: Task) -> dict[str, Any]:
    return {"element": task.element, "elements": task.elements, **task.setting.chosen,
            "for": "row" if task.repeat else "reference"}


def rows_of(number: int, series: Series, found: Limit, continuum: Limit, against_continuum: bool, given: bool,
            ) -> tuple[list[Row], SeriesSummary]:
    """Return the rows of a series, judged by its limit, and its summary.

    ``continuum`` is its limit of the continuum; ``given``: the reference is a number given by the user.
    """
    rows = [Row(m, number) for chain in series.rows for m in chain.done[:chain.judged]]
    known = SeriesSummary("", "", found, series.setting.quadrature)
    for row in rows:
        known.element, known.formulation = row.measured.element, row.measured.formulation
        known.refused |= row.measured.status == "refused"
        known.reason = known.reason or (row.measured.reason if row.measured.answer is None else "")
    if found.known and continuum.known and not given:
        known.model_error, known.model_error_bar = distance(found, continuum)
    for row in rows:
        _judge(row, found, known, against_continuum)
    return rows, known


def _judge(row: Row, found: Limit, known: SeriesSummary, against_continuum: bool) -> None:
    if row.measured.answer is None:
        return
    error = found.error(row.measured.answer)
    if found.resolves(error):
        row.error = row.judged = error
    elif found.known:
        row.error_below = row.judged = error + found.bar
    row.model_error = known.model_error
    if against_continuum:
        row.judged += known.model_error_at_most


def setting_text(row: Row) -> str:
    """Return the setting of a row in words: type, mesh, method and steps."""
    more = [f"{k} {flow(v)}" for k, v in row.task.setting.chosen.items() if v is not None]
    m = row.measured
    return ", ".join([f"{m.element} ({m.formulation})", many(m.elements, "element"), *more])


def write_tradeoff(study: TradeoffStudy, loaded: LoadedCase, path: str, command: str = "", *,
                   force: bool = False) -> Path:
    """Write the solved rows as table ``tradeoff``; return the path. Raises ResultsError."""
    columns = (Column("value", goal_units(loaded), f"the goal: {study.goal}"),
               Column("error_below", "1", WHAT["error_below"]), Column("model_error", "1", WHAT["model_error"]),
               Column("judged", "1", WHAT["judged"]),
               Column("pareto", "1", "1 where no other row is both faster and more accurate", integer=True),
               Column("memory_bytes", "1", WHAT["memory_bytes"], integer=True),
               Column("runs", "1", "number of timed runs", integer=True),
               Column("method", "none", "integrator, empty for the case's"),
               Column("step", "1", "time step, or tolerance"), Column("status", "none", "converged or failed"))
    rows = [_entry(row) for row in study.rows if row.measured.status == "converged"]
    table = {name: [row[name] for row in rows] for name in rows[0]} if rows else {}
    key = next((row.task.setting.key for row in study.rows if row.task.setting.key), "")
    attrs = {"goal": study.goal, "against": study.against, "step": key}
    summary = {k: v for k, v in study.as_json().items() if k not in ("rows", "meaning")}
    return write_tables(path, result_header(loaded, command), {TABLE: (table, attrs)} if table else {}, columns,
                        summary, "converged" if study.converged else "failed", force)


def _entry(row: Row) -> dict[str, Any]:
    m, setting = row.measured, row.task.setting
    return {"element": m.element, "formulation": m.formulation, "elements": m.elements, "dofs": m.dofs or 0,
            "value": None if m.answer is None else m.answer.value, "error": row.error,
            "error_below": row.error_below, "model_error": row.model_error,
            "judged": row.judged if math.isfinite(row.judged) else None, "wall_s": m.wall_s,
            "memory_bytes": m.memory or 0, "runs": m.runs, "pareto": int(row.pareto), "method": setting.method or "",
            "step": setting.step, "status": m.status}


def tradeoff(loaded: LoadedCase, choice: Choice, workers: Workers = ALONE,
             compiling: Callable[[str], None] = lambda text: None, done: Done = lambda share, left: None,
             clock: Callable[[], float] = time.monotonic) -> TradeoffStudy:
    """Solve a case with every setting of ``choice``, the cheapest first, and judge cost and error of each.

    The budget starts when all kernels are compiled. A setting that the case refuses gives a row with the reason. Raises
    CaseError for a case without a goal, or one that refuses all settings, ComputationError if errors are wanted
    relative to a continuum that did not fit into the budget.
    """
    planner = Planner(loaded, choice, workers)
    series, behind = planner.series(), continuum_series(planner)
    _ready([*series, *behind.values()], len(series), compiling)
    budget = Budget(choice.budget, clock)
    todo = _Todo([*([s] for s in series), list(behind.values())], choice.reference)
    dropped = _solve(todo, workers, budget, done)
    study = TradeoffStudy(loaded.source.file, loaded.case.title, describe_goal(loaded.case.goal),
                  "continuum" if choice.continuum else "limit" if choice.reference is None else "reference",
                  choice.accuracies, choice.budget, budget.spent, dropped=dropped, warnings=list(planner.warnings),
                  labels=loaded.case.units.labels)
    found = {q: limit(s) for q, s in behind.items()}
    study.continuum, study.continuum_q = continuum(found), [q for q, f in found.items() if f.known]
    if choice.continuum and not study.continuum.known:
        raise ComputationError(f"the continuum solution of the case is not known: {study.continuum.note}")
    for k, s in enumerate(series):
        rows, known = rows_of(k, s, limit(s, choice.reference), study.continuum, choice.continuum,
                              choice.reference is not None)
        study.rows += rows
        if rows:
            study.series.append(known)
    study.judge()
    return study


def _ready(series: Sequence[Series], own: int, compiling: Callable[[str], None]) -> None:
    """Compile the kernels of all chains; end chains that the case refuses. Raises CaseError if it refuses all."""
    problems: list[Problem] = []
    refused = 0
    for k, s in enumerate(series):
        for chain in s.chains:
            task = chain.tasks[0]
            try:
                make_ready(task, compiling)
            except CaseError as error:
                chain.record(Measured(task, task.element, task.setting.variant.formulation or "", task.elements,
                                    status="refused", reason=error.problems[0].message))
                problems += error.problems
        refused += k < own and all(c.ended for c in s.rows)
    if refused == own:
        raise CaseError(list(dict.fromkeys(problems)))


@dataclass
class _Todo:
    """The chains of a study, and which of them continue: each group of series has its share of the time."""

    groups: list[list[Series]]
    reference: float | None

    def heads(self) -> list[tuple[float, Chain]]:
        """Return the chains that continue, with the predicted cost of the next task of each [s].

        The group with the least time spent comes first, with its cheapest chain.
        """
        out = []
        for group in self.groups:
            spent = sum(m.elapsed for s in group for c in s.chains for m in c.done)
            out += [(spent, s.cost(c), c) for s in group for c in s.chains if self._needed(s, c)]
        return [(cost, chain) for _, cost, chain in sorted(out, key=lambda head: head[:2])]

    def left(self) -> float:
        """Return the predicted time [s] of all remaining rows, and of references up to one level finer, one by one."""
        chains = [(c, max(t.elements for r in s.rows or s.chains for t in r.tasks[:r.judged or None]))
                  for group in self.groups for s in group for c in s.chains]
        ahead = Forecast()
        for k, (chain, _) in enumerate(chains):
            for m in chain.done:
                if m.status == "converged":
                    ahead.note(k, m.elements, m.elapsed / (m.runs + 1))
        return sum(task.cost(ahead.predicted(k, task.elements) or 0.0) for k, (chain, finest) in enumerate(chains)
                   if not chain.ended for task in chain.tasks[len(chain.done):] if task.elements <= 2 * finest)

    def _needed(self, series: Series, chain: Chain) -> bool:
        """Return whether the next task of a chain is useful: rows are, references only while they are too coarse."""
        task = chain.next
        if task is None or task.repeat or chain is not series.reference:
            return task is not None
        if any(c.next is not None and c.next.repeat for c in series.rows) or not series.rows:
            return True
        return not suffices(series, limit(series, self.reference))


def _solve(todo: _Todo, workers: Workers, budget: Budget, done: Done) -> list[Task]:
    """Solve the tasks that fit into the budget; return those that do not."""
    dropped: list[Task] = []
    while heads := todo.heads():
        batch: list[Chain] = []
        together = 0.0
        for cost, chain in heads:
            if not budget.affords(cost):
                dropped += chain.drop()
            elif not batch or (workers != ALONE and budget.affords(together + cost)):
                batch.append(chain)
                together += cost / max(workers.processes, 1)
        tasks = [chain.next for chain in batch]
        found = run_jobs(measure, [t for t in tasks if t is not None], workers, lost)
        for chain, result in zip(batch, found, strict=True):
            chain.record(result)
        spent = budget.spent
        left = min(todo.left() / max(workers.processes, 1), max(budget.seconds - spent, 0.0))
        done(spent / max(spent + left, 1e-9), left)
    return dropped
