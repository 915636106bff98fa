"""One case from model to summary and, where asked, to a result file."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..case import Case, LoadedCase, Static, Vocabulary, load_case
from ..elements import registry
from ..elements.definition import coordinate_components
from ..elements.formulations import FORMULATIONS
from ..errors import CaseError, ComputationError
from ..model.build import build_model
from ..model.model import Model

if TYPE_CHECKING:
    from ..results import BodyRecord
    from ..solve.state import State


def vocabulary() -> Vocabulary:
    """Return the names that a case may use, from the registries."""
    types = [*registry.ELEMENTS.values(), *(registry.ancf(1, q) for q in range(1, registry.MAX_ORDER[1] + 1))]
    coordinates = {c: None for t in types for n in t.nodes for k in n.coordinates if k != "theta"
                   for c in coordinate_components(k, t.has_theta)}
    return Vocabulary(element_types=(*registry.names(), "rigid"), formulations=tuple(FORMULATIONS),
                      nodal_coordinates=tuple(coordinates), output_fields=("N", "Q", "M"))


@dataclass
class Progress:
    """What a run tells while it goes on.

    ``state`` is called with each state, ``warn`` with each new warning, ``built`` with the model before it is
    solved, ``compiling`` when kernels have to be compiled first.
    """

    state: Callable[[State], None] = lambda state: None
    warn: Callable[[str], None] = lambda text: None
    built: Callable[[Model], None] = lambda model: None
    compiling: Callable[[], None] = lambda: None


@dataclass
class Outcome:
    """A finished run: the ``--json`` object, and the failure where there was one."""

    summary: dict[str, Any]
    model: Model
    failure: ComputationError | None = None
    warnings: list[str] = field(default_factory=list)


def load(path: str | os.PathLike[str], overrides: Sequence[str] = ()) -> LoadedCase:
    """Return the case in a file, read with the names that the registries know. Raises CaseError with all problems."""
    return load_case(path, overrides, vocabulary())


def prepare(loaded: LoadedCase) -> Model:
    """Return the model of a case (nothing is compiled). Raises CaseError with all problems, the solver's too."""
    from ..solve.registry import unavailable

    problems = unavailable(loaded)
    try:
        model = build_model(loaded)
    except CaseError as error:
        raise CaseError([*problems, *error.problems]) from None
    if problems:
        raise CaseError(problems)
    return model


def check(loaded: LoadedCase) -> list[str]:
    """Check a case beyond its format, without numba; return its warnings. Raises CaseError with all problems."""
    return prepare(loaded).warnings


def solver_name(case: Case) -> str:
    """Return ``solver.type`` of a case."""
    words = type(case.solver).__name__
    return "".join("_" + c.lower() if c.isupper() else c for c in words).lstrip("_")


def end_factor(case: Case) -> float:
    """Return the load factor that a static case ends at; infinite for a path, which may pass its last one before."""
    if isinstance(case.solver, Static) and case.solver.method != "newton":
        return float("inf")
    return float(getattr(getattr(case.solver, "until", None), "value", 1.0))


def run_case(loaded: LoadedCase, out: str | None = None, *, force: bool = False, command: str = "",
             progress: Progress | None = None) -> Outcome:
    """Solve a case; write its result file where ``out`` names one; return the outcome.

    Raises CaseError for a wrong case and ResultsError for a file that cannot be written; a failed computation
    is returned, with the states found so far.
    """
    model = prepare(loaded)
    progress = progress or Progress()
    progress.built(model)
    warnings = list(model.warnings)
    for text in warnings:
        progress.warn(text)
    writer = None if out is None else _writer(loaded, model, out, force, command)
    try:
        return _solve(loaded, model, writer, progress, warnings)
    except BaseException:
        if writer is not None:
            writer.__exit__(*_exception())
        raise


def _exception() -> tuple[Any, Any, Any]:
    import sys

    return sys.exc_info()


class _Clock:
    """Hands on the states of a solver and counts the time that it takes, without what is done with them."""

    def __init__(self, states: Iterator[State]) -> None:
        self.states, self.seconds = states, 0.0

    def __iter__(self) -> Iterator[State]:
        return self

    def __next__(self) -> State:
        started = time.perf_counter()
        try:
            return next(self.states)
        finally:
            self.seconds += time.perf_counter() - started


def _solve(loaded: LoadedCase, model: Model, writer: Any, progress: Progress, warnings: list[str]) -> Outcome:
    from ..solve.post import Observer
    from ..solve.registry import initial_state, solve
    from .warmup import warm_up

    warm_up(model, progress.compiling)
    observer = Observer(model)
    every, end = loaded.case.output.every or 1, end_factor(loaded.case)
    clock = _Clock(_checked(loaded, model, solve(model)))
    state, failure, probes, totals, report = None, None, {}, {"iterations": 0, "steps": 0}, {}
    try:
        for state in clock:
            if writer is not None and totals["steps"] == 0 and isinstance(loaded.case.solver, Static):
                start = initial_state(model)
                writer.append(start.t, start.d[:model.n_q], None, Observer(model).observe(start))
            probes = observer.observe(state)
            totals["iterations"] += int(state.history["iterations"])
            totals["steps"] += 1
            for text in state.warnings:
                warnings.append(text)
                progress.warn(text)
            report.update(state.report)
            if writer is not None:
                for path, (data, units, description) in state.arrays.items():
                    writer.array(path, data, units, description, up_to_sign=path.startswith("modes/"))
                for name, columns in state.tables.items():
                    writer.table(name, columns)
                if totals["steps"] % every == 0 or state.t >= end or state.last:
                    writer.append(state.t, state.d[:model.n_q], state.history, probes)
                else:
                    writer.log(state.history, t=state.t, probes=probes)
            progress.state(state)
    except ComputationError as error:
        failure = error
    summary = summarise(loaded, model, state, probes, totals, clock.seconds, failure, report)
    summary["warnings"] = warnings
    if writer is not None:
        place = writer.finish(summary, "failed" if failure else "converged")
        summary["output"] = str(place) if place.exists() else None
    return Outcome(summary, model, failure, warnings)


def _checked(loaded: LoadedCase, model: Model, states: Iterator[State]) -> Iterator[State]:
    """Return the states, their modes checked on a finer mesh where the case asks for that."""
    if not getattr(loaded.case.solver, "verify", False):
        return states
    from .verify import verified

    return verified(loaded, model, states)


def summarise(loaded: LoadedCase, model: Model, state: State | None, probes: dict[str, dict[str, float]],
              totals: dict[str, int], wall: float, failure: ComputationError | None,
              report: dict[str, Any]) -> dict[str, Any]:
    """Return the object that ``--json`` prints; ``report`` is what the solver adds to it."""
    from ..solve.post import energies, reactions

    out: dict[str, Any] = {
        "case": loaded.source.file, "title": loaded.case.title, "status": "failed" if failure else "converged",
        "solver": solver_name(loaded.case), "elements": model.n_elements, "dofs": model.n_q}
    if failure is not None:
        out.update(reason=failure.failure.reason, at=failure.failure.at, advice=failure.failure.advice,
                   residuals=failure.failure.history)
    out["probes"] = probes
    if state is not None:
        out["reactions"] = reactions(model, state)
        out["energy"] = energies(model, state)
        out["load_factor"] = state.t
    out.update(totals, **report)
    out["wall_s"] = wall
    out["checks"] = checks(loaded.case, out) if failure is None else []
    out["output"] = None
    return out


def quantity(goal: Any, summary: dict[str, Any]) -> float | None:
    """Return the value of a goal (or expected value) from a summary, None where it is not there."""
    if goal.limit_point is not None:
        points = summary.get("limit_points", [])[goal.limit_point - 1:goal.limit_point]
        if goal.probe is None or not points:
            return points[0]["factor"] if points else None
        return points[0]["probes"].get(goal.probe, {}).get(goal.quantity)
    if goal.probe is not None:
        return summary["probes"].get(goal.probe, {}).get(goal.quantity)
    if goal.reaction is not None:
        return summary.get("reactions", {}).get(goal.reaction, {}).get(goal.quantity)
    if goal.kind is not None:
        return next((f["omega"] for f in summary.get("frequencies", ())
                     if (f["kind"], f["number"]) == (goal.kind, goal.number)), None)
    if goal.load_factor is not None:
        factors = summary.get("load_factors", [])[goal.load_factor - 1:goal.load_factor]
        return factors[0] if factors else None
    if goal.quantity == "strain_energy":
        return summary.get("energy", {}).get("strain")
    return None


def describe_goal(goal: Any) -> str:
    """Return 'mid uy' for a goal."""
    limit = None if goal.limit_point is None else f"limit point {goal.limit_point}"
    factor = None if goal.load_factor is None else f"load factor {goal.load_factor}"
    parts = (limit, factor, goal.probe, goal.reaction, goal.quantity, goal.kind, goal.number)
    return " ".join(str(p) for p in parts if p is not None)


def checks(case: Case, summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Return each expected value beside the computed one and whether it is met."""
    out = []
    for item in case.expected:
        value = quantity(item, summary)
        allowed = (item.rtol or 0.0) * abs(item.value) + (item.atol or 0.0)
        difference = None if value is None else value - item.value
        out.append({"what": describe_goal(item), "expected": item.value, "value": value, "difference": difference,
                    "allowed": allowed, "met": difference is not None and abs(difference) <= allowed,
                    "source": item.source or ""})
    return out


def result_header(loaded: LoadedCase, command: str = "") -> dict[str, Any]:
    """Return what every result file says of its case."""
    case = loaded.case
    return {"case_text": loaded.text, "case_completed": loaded.completed, "case_name": loaded.source.file,
            "overrides": list(loaded.overrides), "title": case.title, "solver": solver_name(case),
            "units": {"length": case.units.length, "force": case.units.force, "time": case.units.time},
            "command_line": command}


def _writer(loaded: LoadedCase, model: Model, out: str, force: bool, command: str) -> Any:
    from ..results import ResultWriter

    names = {m.plan.name: [c for node in m.coordinate_names for c in node] for m in model.meshes.values()}
    return ResultWriter(out, result_header(loaded, command), [body_record(m) for m in model.meshes.values()], model.e0,
                        names, force=force)


SAMPLES = np.linspace(0.0, 1.0, 21)


def body_record(mesh: Any) -> BodyRecord:
    """Return how a body is drawn: sampled shape functions on the axis and at both faces."""
    from ..results import BodyRecord

    element, plan = mesh.plan.element, mesh.plan
    S = np.array([[c.shape(SAMPLES, np.full(len(SAMPLES), eta)) for eta in (-1.0, 0.0, 1.0)] for c in mesh.classes])
    S_x = np.array([c.shape(SAMPLES, np.zeros(len(SAMPLES)), 1, 0) for c in mesh.classes])
    node_shape = [next(k for k, (i, name) in enumerate(element.functionals) if i == node and name == "r")
                  for node in range(len(element.nodes))]
    ends = np.concatenate([p.s0 + p.l * np.arange(p.count) for p in plan.pieces] + [[plan.length]])
    return BodyRecord(plan.name, element.name, plan.formulation.name, plan.section.height, plan.section.width,
                      element.section_kind, mesh.dofs, mesh.nodes, np.array(node_shape), mesh.cls,
                      np.array([c.shape.l for c in mesh.classes]), SAMPLES, S, S_x, ends / plan.length)
