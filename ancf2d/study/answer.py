"""What a run answers to a case's goal: a value, and in motion its course over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..case import Dynamic, Goal, LoadedCase
from ..elements.shape import Array
from ..errors import CaseError, ComputationError
from ..model.model import Model
from .goal import TINY, error_scale, goal_kind, smallest_scale
from .run import Progress, describe_goal, quantity, run_case


@dataclass
class Answer:
    """A goal as one run has it.

    ``value`` at the end; ``course`` (states,) at all stored times of a motion; ``size`` > 0 is what its errors are
    relative to: the value, or where that is smaller ``smallest``, 1e-3 of the largest of its kind in the model; in
    motion the largest displacement of the goal's probe over time (of other quantities their own largest value).
    """

    value: float
    size: float
    course: Array | None = None
    smallest: float = 0.0

    def distance(self, other: Answer) -> float:
        """Return how far another answer is from this one, in the goal's units: in motion the most over time."""
        if self.course is None or other.course is None or len(self.course) != len(other.course):
            return abs(self.value - other.value)
        return float(np.max(np.abs(self.course - other.course), initial=0.0))

    def beyond(self, coarse: Answer, factor: float) -> Answer:
        """Return this answer moved on by ``factor`` times its difference to a coarser one."""
        course = None
        if self.course is not None and coarse.course is not None and len(self.course) == len(coarse.course):
            course = self.course + factor * (self.course - coarse.course)
        return Answer(self.value + factor * (self.value - coarse.value), self.size, course, self.smallest)


@dataclass
class Solved:
    """A run for its goal: the answer, the model, the ``--json`` summary, and d (n_q,) at the end."""

    answer: Answer
    model: Model
    summary: dict[str, Any]
    d: Array


def for_study(loaded: LoadedCase) -> LoadedCase:
    """Return a case without what only costs time in a study: error estimates, expected values, times that differ."""
    case = replace(loaded.case, expected=(), accuracy=None)
    if isinstance(case.solver, Dynamic):
        case = replace(case, solver=replace(case.solver, estimate=False), output=replace(case.output, every=None))
    return replace(loaded, case=case)


def solve_for_goal(loaded: LoadedCase, progress: Progress | None = None) -> Solved:
    """Solve a case that has a goal. Raises CaseError, and ComputationError where it fails or has no such value."""
    loaded = for_study(loaded)
    goal = loaded.case.goal
    if goal is None:
        raise CaseError(loaded.source.problem((), "the case has no goal: nothing is named that an error could be of",
                                              expected="for example goal: {probe: mid, quantity: uy}"))
    watch = _Watch(goal, isinstance(loaded.case.solver, Dynamic))
    progress = replace(progress or Progress(), state=watch.take, built=watch.begin)
    outcome = run_case(loaded, progress=progress)
    if outcome.failure is not None:
        raise outcome.failure
    value = quantity(goal, outcome.summary)
    if value is None:
        raise ComputationError(f"the solver gives no value of {describe_goal(goal)}")
    d = watch.last.d[:outcome.model.n_q]
    smallest = smallest_scale(goal, outcome.summary, outcome.model, d)
    size = max(watch.largest, TINY) if watch.course else error_scale(value, smallest)
    course = np.array(watch.course) if watch.course else None
    return Solved(Answer(value, size, course, smallest), outcome.model, outcome.summary, d)


class _Watch:
    """Follows the goal of a motion from state to state."""

    def __init__(self, goal: Goal, moves: bool) -> None:
        self.goal, self.moves = goal, moves
        self.course: list[float] = []
        self.largest = 0.0
        self.last: Any = None
        self.model: Any = None
        self.observer: Any = None

    def begin(self, model: Model) -> None:
        """Take the model before it is solved."""
        from ..solve.post import Observer

        self.model, self.observer = model, Observer(model)

    def take(self, state: Any) -> None:
        """Take the next state."""
        self.last = state
        if not self.moves:
            return
        summary = self._summary(state)
        value = quantity(self.goal, summary)
        self.course.append(np.nan if value is None else value)
        place = summary["probes"].get(self.goal.probe, {})
        displaces = goal_kind(self.goal) in ("displacement", "position") and "ux" in place
        own = float(np.hypot(place["ux"], place["uy"])) if displaces else abs(value or 0.0)
        self.largest = max(self.largest, own)

    def _summary(self, state: Any) -> dict[str, Any]:
        """Return what the goal can be of, at one state."""
        from ..solve.post import reactions

        out: dict[str, Any] = {"probes": self.observer.observe(state), "energy": state.history}
        if self.goal.reaction is not None:
            out["reactions"] = reactions(self.model, state)
        return out


def sequence(answers: Sequence[Answer]) -> list[float]:
    """Return a sequence of numbers with the distances of neighbouring answers, which ends with the last value.

    Of scalar answers these are their values; courses over time approach the last one from one side.
    """
    if any(a.course is None for a in answers):
        return [a.value for a in answers]
    out = [a.value for a in answers[-1:]]
    for a, b in zip(answers[-2::-1], answers[:0:-1], strict=True):
        out.append(out[-1] + a.distance(b))
    return out[::-1]
