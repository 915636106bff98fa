"""Error against cost of a case over element types, meshes, integrators and steps, within a time budget."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ...case import LoadedCase
from ...errors import CaseError, ComputationError, Problem
from ..forecast import Budget, Done, Forecast
from ..pool import ALONE, Workers, run_jobs
from ..run import describe_goal
from .measure import Measured, Task, lost, make_ready, measure
from .plan import Chain, Choice, Planner, Series, continuum, continuum_series, limit, suffices
from .result import TradeoffStudy, rows_of


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
