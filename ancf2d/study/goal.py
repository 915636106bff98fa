"""The goal of a case: its value after a run, its course over time, and the scale of its errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..case import Dynamic, FrequencyResponse, Goal, LoadedCase, Solver
from ..elements.shape import Array
from ..errors import CaseError, ComputationError
from ..model.build import build_model
from ..model.model import Model
from ..quantities import DISPLACEMENTS, KIND_OF
from .record import Progress
from .run import Outcome, Solve, lacking, quantity, run_case
from .windows import window_key, window_of

if TYPE_CHECKING:
    from ..solvers.statics.newton import Start

SHARE = 1e-3
TINY = 2.0**-1022


def goal_of(loaded: LoadedCase, lacking: str = "no value to find the error of") -> Goal:
    """Return the goal of a case. Raises CaseError if it has none; ``lacking`` says what is missing without it."""
    if loaded.case.goal is None:
        raise CaseError(loaded.source.problem((), f"the case has no goal, so there is {lacking}",
                                              expected="for example goal: {probe: mid, quantity: uy}"))
    return loaded.case.goal


def goal_kind(goal: Goal) -> str:
    """Return the kind of quantity of a goal: displacement, force, ..., energy."""
    return "phase" if goal.part == "phase" else KIND_OF.get(goal.quantity or "", "energy")


def smallest_scale(goal: Goal, summary: dict[str, Any], model: Model, d: Any) -> float:
    """Return 1e-3 of the largest quantity of the goal's kind in the model.

    All probes and reactions count; for displacements also all nodal coordinates d (n_q,) and the least motion that is
    not round-off, for rotations these over the extent of the model, for positions the extent.
    """
    from ..solvers.least_motion import least_motion

    kind = goal_kind(goal)
    if kind == "phase":
        return SHARE * math.pi
    if goal.input is not None:
        return smallest_peak(summary["response"][goal.input], kind)
    rows = [*summary["probes"].values(), *summary.get("reactions", {}).values()]
    largest = [abs(v) for row in rows for q, v in row.items() if KIND_OF.get(q) == kind]
    if kind in ("displacement", "rotation"):
        size = 1.0 if kind == "displacement" else model.extent
        largest += [float(abs(model.weights * d).max(initial=0.0)) / size, least_motion(model) / SHARE / size]
    if kind == "position":
        largest.append(model.extent)
    return SHARE * max(largest, default=0.0)


def smallest_peak(probes: dict[str, Any], kind: str) -> float:
    """Return 1e-3 of the largest amplitude of a kind in the responses of all probes to one input."""
    return SHARE * max((math.hypot(*v) for row in probes.values() for q, H in row.items() if KIND_OF.get(q) == kind
                        for v in zip(H["re"], H["im"], strict=True)), default=0.0)


def error_scale(value: float, smallest: float) -> float:
    """Return the divisor for relative errors of a value: the value, or the smallest scale if that is larger."""
    return max(abs(value), smallest, TINY)


@dataclass(frozen=True)
class Curves:
    """Responses ``H`` (n, curves) at frequencies ``hz`` (n,), and the sizes (curves,) that errors are relative to."""

    hz: Array
    H: Any
    sizes: Array
    log: bool

    def distance(self, other: Curves) -> float:
        """Return the largest difference to other responses over all frequencies, relative to the sizes."""
        hz = np.union1d(self.hz, other.hz)
        gap = np.abs(self.at(hz) - other.at(hz)) / self.sizes
        return float(gap.max(initial=0.0))

    def at(self, hz: Array) -> Any:
        """Return the responses at other frequencies, by the cubics for which the points were placed."""
        from ..results.responses import interpolated

        if np.array_equal(hz, self.hz):
            return self.H
        axis = np.log if self.log else np.asarray
        return interpolated(axis(self.hz), self.H, axis(hz))[0]


def curves_of(goal: Goal | None, response: dict[str, Any], log: bool) -> Curves:
    """Return the responses whose accuracy is wanted: that of the goal, or those of all probes.

    The size of each is its peak, or 1e-3 of the largest of its kind for the same input if the peak is smaller.
    """
    H, sizes = [], []
    for name in (n for n in response if n != "hz"):
        for probe, quantities in response[name].items():
            for q in DISPLACEMENTS if goal is None else quantities:
                if goal is None or (name, probe, q) == (goal.input, goal.probe, goal.quantity):
                    H.append(np.array(quantities[q]["re"]) + 1j * np.array(quantities[q]["im"]))
                    kind = goal_kind(Goal(probe=probe, quantity=q))
                    sizes.append(max(float(np.abs(H[-1]).max()), smallest_peak(response[name], kind), TINY))
    return Curves(np.array(response["hz"]), np.array(H).T, np.array(sizes), log)


@dataclass
class GoalValue:
    """The goal of one run.

    ``value`` at the end; ``course`` (states,) at all stored times of a motion; ``size`` > 0 is the scale of its errors:
    the value, or if larger ``smallest``, 1e-3 of the largest of its kind in the model; in motion the largest
    displacement of the goal's probe over time (for other quantities their own largest value). ``curves``: responses
    over the frequency, with errors relative to their peaks; without a goal ``value`` is 1. ``period``: 2 pi for phases,
    which are equivalent modulo that, else 0. ``sampling``: uncertainty of a value over a window due to the stored
    times; ``jumps``: the value may be reached at another time on each mesh.
    """

    value: float
    size: float
    course: Array | None = None
    smallest: float = 0.0
    curves: Curves | None = None
    period: float = 0.0
    sampling: float = 0.0
    jumps: bool = False

    def gap(self, other: GoalValue) -> float:
        """Return the value minus that of another answer, modulo the period."""
        found, period = self.value - other.value, max(self.period, other.period)
        return found - period * round(found / period) if period else found

    def distance(self, other: GoalValue) -> float:
        """Return the distance to another answer, in the goal's units.

        In motion it is the largest over time, for responses the largest over the frequency.
        """
        if self.curves is not None and other.curves is not None:
            return other.size * other.curves.distance(self.curves)
        if self.course is None or other.course is None or len(self.course) != len(other.course):
            return abs(self.gap(other))
        return float(np.max(np.abs(self.course - other.course), initial=0.0))

    def beyond(self, coarse: GoalValue, factor: float) -> GoalValue:
        """Return this answer extrapolated by ``factor`` times its difference to a coarser one."""
        course = None
        if self.course is not None and coarse.course is not None and len(self.course) == len(coarse.course):
            course = self.course + factor * (self.course - coarse.course)
        return replace(self, value=self.value + factor * self.gap(coarse), course=course, curves=None)


@dataclass
class Solved:
    """A run for its goal: the answer, the outcome of the run, and its last state."""

    answer: GoalValue
    outcome: Outcome
    state: Any

    @property
    def model(self) -> Model:
        """The model."""
        return self.outcome.model

    @property
    def summary(self) -> dict[str, Any]:
        """The object that ``--json`` prints."""
        return self.outcome.summary

    def start_on(self, model: Model) -> Start | None:
        """Return the state as a start on another mesh, None if the bodies have other element types there."""
        from ..model.transfer import transferred
        from ..solvers.statics.newton import Start

        d = transferred(self.state.d, self.model, model)
        return None if d is None else Start(d, int(self.state.history["negative_pivots"]), self.state.turned)

    @property
    def types(self) -> tuple[str, str]:
        """The element types and the formulations of the bodies, several joined by +."""
        plans = [m.plan for m in self.model.meshes.values() if not m.plan.rigid]
        return ("+".join(dict.fromkeys(p.element.name for p in plans)),
                "+".join(dict.fromkeys(p.formulation.name for p in plans)))


def for_study(loaded: LoadedCase) -> LoadedCase:
    """Return a case without parts that only cost time in a study or vary between runs: estimates, times of states."""
    case = replace(loaded.case, accuracy=None)
    if isinstance(case.solver, Dynamic):
        case = replace(case, solver=replace(case.solver, estimate=False), output=replace(case.output, every=None))
    return replace(loaded, case=case)


@dataclass
class Target:
    """The result file to which runs are written; ``written``: it contains the best run already."""

    out: str
    force: bool = False
    command: str = ""
    written: bool = False


def solve_for_goal(loaded: LoadedCase, progress: Progress | None = None, target: Target | None = None,
                   annotate: Callable[[Solved], None] = lambda found: None, solve: Solve | None = None) -> Solved:
    """Solve a case that has a goal or responses; ``solve`` replaces the solver.

    The results are written to ``target``, after ``annotate`` may have added to the summary. Raises CaseError, and
    ComputationError if the run fails or does not yield the goal.
    """
    # the frequencies are only dense enough to compare curves if an accuracy is asked for
    whole = loaded.case.accuracy is not None
    loaded = for_study(loaded)
    goal = loaded.case.goal if isinstance(loaded.case.solver, FrequencyResponse) else goal_of(loaded)
    watch = _GoalRecorder(goal, loaded.case.solver, whole)
    given = progress or Progress()

    def built(model: Model) -> None:
        watch.begin(model)
        given.built(model)

    def taken(state: Any) -> None:
        watch.record(state)
        given.state(state)

    progress = replace(given, state=taken, built=built)
    found: list[GoalValue] = []

    def conclude(summary: dict[str, Any], model: Model) -> None:
        answer = watch.answer(summary, model)
        if answer is not None:
            found.append(answer)
            annotate(Solved(answer, Outcome(summary, model), watch.last))

    where: dict[str, Any] = {} if target is None else {
        "out": target.out, "force": target.force, "command": target.command}
    outcome = run_case(loaded, progress=progress, conclude=conclude, solve=solve, **where)
    if outcome.failure is not None:
        raise outcome.failure
    if not found:
        # other warnings say why there are fewer load factors or limit points
        more = [] if goal is None or goal.kind is not None else [w for w in outcome.warnings if "goal has no" not in w]
        raise ComputationError(": ".join([lacking(goal, outcome.summary), *["; ".join(more)] * bool(more)]))
    return Solved(found[0], outcome, watch.last)


def course_of_goal(loaded: LoadedCase) -> tuple[Model, GoalValue, int, int]:
    """Solve a motion for the course of its goal alone; return the model, the answer, iterations, and steps.

    Raises CaseError, and ComputationError if the motion fails.
    """
    from ..solvers.registry import solve

    loaded = for_study(loaded)
    model, watch = build_model(loaded), _GoalRecorder(goal_of(loaded), loaded.case.solver, False)
    watch.begin(model)
    steps = iterations = 0
    for state in solve(model):
        watch.record(state)
        done = state.blocks.get("iterations", ())
        steps, iterations = steps + len(done), iterations + int(sum(done))
    return model, watch.course_answer(), iterations, steps


class _GoalRecorder:
    """Records the goal of a motion state by state; with ``whole``, responses are compared over all frequencies."""

    def __init__(self, goal: Goal | None, solver: Solver, whole: bool) -> None:
        self.goal, self.solver, self.moves, self.whole = goal, solver, solver.moves, whole
        self.course: list[float] = []
        self.largest = 0.0
        self.last: Any = None
        self.model: Any = None
        self.observer: Any = None

    def begin(self, model: Model) -> None:
        """Store the model before it is solved."""
        from ..solvers.state_results import Observer

        # other probes than the goal's only cost time
        named = () if self.goal is None or self.goal.probe is None else (self.goal.probe,)
        self.model, self.observer = model, Observer(model, named=named)

    def record(self, state: Any) -> None:
        """Record the next state."""
        self.last = state
        if not self.moves or self.goal is None or window_of(self.goal) is not None:
            return
        summary = self._summary(state)
        value = quantity(self.goal, summary)
        self.course.append(np.nan if value is None else value)
        place = summary["probes"].get(self.goal.probe, {})
        displaces = goal_kind(self.goal) in ("displacement", "position") and "ux" in place
        own = float(np.hypot(place["ux"], place["uy"])) if displaces else abs(value or 0.0)
        self.largest = max(self.largest, own)

    def answer(self, summary: dict[str, Any], model: Model) -> GoalValue | None:
        """Return the answer of a finished run, or None if the goal has no value."""
        over_all = self.goal is None or (self.whole and self.goal.hz is None)
        if isinstance(self.solver, FrequencyResponse) and over_all:
            curves = curves_of(self.goal, summary["response"], self.solver.scale == "log")
            if self.goal is None:
                return GoalValue(1.0, 1.0, curves=curves)
            return GoalValue(quantity(self.goal, summary) or 0.0, float(curves.sizes[0]), curves=curves)
        assert self.goal is not None
        value = quantity(self.goal, summary)
        if value is None:
            return None
        smallest = smallest_scale(self.goal, summary, model, self.last.d[:model.n_q])
        if window_of(self.goal) is not None:
            sampling = summary["windows"][window_key(self.goal)]["sampling"]
            return GoalValue(value, error_scale(value, smallest), None, smallest, sampling=sampling,
                          jumps=self.goal.peak_over is not None)
        if not self.course:
            period = 2.0 * math.pi if self.goal.part == "phase" else 0.0
            return GoalValue(value, error_scale(value, smallest), None, smallest, period=period)
        return replace(self.course_answer(), value=value, smallest=smallest)

    def course_answer(self) -> GoalValue:
        """Return the answer of a motion, without the scale of other quantities."""
        return GoalValue(self.course[-1], max(self.largest, TINY), np.array(self.course))

    def _summary(self, state: Any) -> dict[str, Any]:
        """Return the part of a summary that the goal can refer to, at one state."""
        from ..solvers.state_results import reactions

        out: dict[str, Any] = {"probes": self.observer.observe(state), "energy": state.history}
        if self.goal is not None and self.goal.reaction is not None:
            out["reactions"] = reactions(self.model, state)
        return out


def sequence(answers: Sequence[GoalValue]) -> list[float]:
    """Return a sequence of numbers whose differences are the distances of neighbouring answers, for extrapolation.

    It ends with the last value. For scalar answers it consists of their values (phases without jumps of 2 pi); courses
    over time, and responses over the frequency, approach the last one from one side.
    """
    if any(a.course is None and a.curves is None for a in answers):
        last = answers[-1]
        return [last.value + a.gap(last) if last.period else a.value for a in answers]
    out = [a.value for a in answers[-1:]]
    for a, b in zip(answers[-2::-1], answers[:0:-1], strict=True):
        out.append(out[-1] + a.distance(b))
    return out[::-1]
