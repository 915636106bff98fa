"""One run of a case, from the model to the summary and, if requested, the result file."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..case import Case, LoadedCase, Vocabulary, load_case
from ..case.numbers import unused_parameters
from ..case.part_checks import material_warnings
from ..case.records import tag_of
from ..case.units import unit_warnings
from ..elements import registry
from ..elements.definition import coordinate_components
from ..elements.formulations import FORMULATIONS
from ..errors import CheckpointError, ComputationError, raise_any
from ..extend.plugins import load_plugins
from ..model.build import build_model
from ..model.model import Model
from ..model.own_element import element_issues
from ..solvers.fields import FIELDS
from ..solvers.motion.integrators import INTEGRATORS
from .digests import files_of
from .record import Progress, Recorder
from .windows import value_at, window_key, window_of

if TYPE_CHECKING:
    from ..results import BodyRecord, FieldRecord
    from ..solvers.state import State


def vocabulary() -> Vocabulary:
    """Return the names that a case may use, from the registries; loads plugins first. Raises PluginError."""
    load_plugins()
    types = [*registry.ELEMENTS.values(), *(registry.ancf(1, q) for q in range(1, registry.MAX_ORDER[1] + 1))]
    coordinates = {c: None for t in types for n in t.nodes for k in n.coordinates if k != "theta"
                   for c in coordinate_components(k, t.has_theta)}
    return Vocabulary(element_types=(*registry.names(), "rigid"), formulations=tuple(FORMULATIONS),
                      nodal_coordinates=tuple(coordinates), integrators=tuple(INTEGRATORS),
                      output_fields=tuple(FIELDS), element_issues=element_issues)


@dataclass
class Outcome:
    """Outcome of a run: the ``--json`` object, and the failure if there was one."""

    summary: dict[str, Any]
    model: Model
    failure: ComputationError | None = None
    warnings: list[str] = field(default_factory=list)


def load(path: str | os.PathLike[str], overrides: Sequence[str] = ()) -> LoadedCase:
    """Return the case in a file, read with the names in the registries. Raises CaseError with all problems."""
    return load_case(path, overrides, vocabulary())


def prepare(loaded: LoadedCase, like: Model | None = None, for_differences: bool = False) -> Model:
    """Return the model of a case, without compiling anything. Raises CaseError with all problems, also the solver's.

    ``like`` is a model of the same case with other values, whose unchanged parts are used. ``for_differences``: the
    model only serves for differences to ``like`` (``build_model``): checks and warnings are left out.
    """
    from ..solvers.fields import field_problems
    from ..solvers.motion.initial import initial_problems
    from ..solvers.motion.integrators import method_problems
    from ..solvers.registry import left_out

    model = build_model(loaded, like=like, for_differences=for_differences)
    problems = [*initial_problems(model), *method_problems(model), *field_problems(model)]
    raise_any(problems)
    if for_differences:
        return model
    model.warnings += [*left_out(loaded.case), *unit_warnings(loaded.case), *material_warnings(loaded.case),
                       *(f"parameters.{name}: nothing in the case uses it" for name in unused_parameters(loaded.case))]
    return model


def solver_name(case: Case) -> str:
    """Return ``solver.type`` of a case."""
    return tag_of(type(case.solver))


Conclude = Callable[[dict[str, Any], Model], None]
Solve = Callable[[Model], "Iterator[State]"]


def run_case(loaded: LoadedCase, out: str | None = None, *, force: bool = False, command: str = "",
             progress: Progress | None = None, resume: bool = False, conclude: Conclude | None = None,
             solve: Solve | None = None, checkpoints: Path | None = None, like: Model | None = None,
             kernels: str = "", brief: bool = False) -> Outcome:
    """Solve a case, write its result file if ``out`` names one, and return the outcome.

    With ``resume``, an interrupted run over time continues from its last checkpoint, to the same result bit for bit; if
    there is no checkpoint, the run starts from the beginning. ``conclude`` may add to the summary of a successful run
    before it is written. ``solve`` yields the states instead of the solver. ``checkpoints``: a file from which a run
    over time without a result file can be resumed; it is removed at the end. ``like``: a model of the case with other
    values, whose unchanged parts are used. ``kernels``: the name of the kernels that the run needs, if known.
    ``brief``: leave reactions, contacts and energies out of the summary if no goal or expected value can need them.

    Raises CaseError for a wrong case and ResultsError for a file that cannot be written or resumed. A failed
    computation is returned, with the states found before the failure.
    """
    from .warmup import warm_up

    model = prepare(loaded, like)
    progress = progress or Progress()
    progress.built(model)
    warnings = list(model.warnings)
    for text in warnings:
        progress.warn(text)
    goes_on = resume and out is not None and _resumes(loaded.case, out, progress)
    writer = None if out is None else _writer(loaded, model, out, force, command, goes_on)
    if out is None and checkpoints is not None and loaded.case.solver.timed:
        writer = _checkpoint_keeper(loaded, model, checkpoints)
    try:
        warm_up(model, progress.compiling, kernels)
        return _solve(loaded, model, writer, progress, warnings, conclude, solve, brief)
    except BaseException as error:
        if writer is not None:
            writer.__exit__(type(error), error, error.__traceback__)
        raise


def _solve(loaded: LoadedCase, model: Model, writer: Any, progress: Progress, warnings: list[str],
           conclude: Conclude | None, solve: Solve | None, brief: bool) -> Outcome:
    recorder, failure = Recorder(model, writer, progress, warnings), None
    recorder.clock.states = _with_verification(loaded, model, _states(model, writer, solve))
    if writer is not None and writer.resumed is not None:
        recorder.restore(writer.resumed)
    try:
        for state in recorder.clock:
            recorder.record(state)
    except ComputationError as error:
        failure = error
    recorder.conclude()
    if failure is None:
        recorder.store_layers()
    summary = summarise(loaded, model, recorder, failure, brief)
    if conclude is not None and failure is None:
        conclude(summary, model)
    if writer is not None:
        place = writer.finish(summary, "failed" if failure else "converged")
        summary["output"] = str(place) if place.exists() else None
    return Outcome(summary, model, failure, warnings)


def _states(model: Model, writer: Any, solve: Solve | None) -> Iterator[State]:
    """Return the states of the solver, resumed from the writer's checkpoint if there is one."""
    from ..solvers import registry

    if writer is not None and writer.resumed is not None:
        try:
            return registry.solve(model, writer.resumed.values)
        except CheckpointError as error:
            writer.reject_checkpoint(error)
    return (solve or registry.solve)(model)


def _with_verification(loaded: LoadedCase, model: Model, states: Iterator[State]) -> Iterator[State]:
    """Return the states, with modes or load steps verified if the case asks for it."""
    if not getattr(loaded.case.solver, "verify", False):
        return states
    from .verify import verified

    return verified(loaded, model, states)


def summarise(loaded: LoadedCase, model: Model, recorder: Recorder, failure: ComputationError | None,
              brief: bool = False) -> dict[str, Any]:
    """Return the object that ``--json`` prints, from the records of a run; ``brief`` as in ``run_case``."""
    from ..solvers.state_results import energies, reactions

    state = recorder.state
    asked = [goal for goal in (loaded.case.goal, *loaded.case.expected) if goal is not None]
    # goals other than quantities of probes may be reactions or energies
    brief = brief and all(goal.probe is not None for goal in asked)
    out: dict[str, Any] = {
        "case": loaded.source.file, "title": loaded.case.title, "status": "failed" if failure else "converged",
        "solver": solver_name(loaded.case), "elements": model.n_elements, "dofs": model.n_q}
    if failure is not None:
        out.update(reason=failure.failure.reason, at=failure.failure.at, advice=failure.failure.advice,
                   residuals=failure.failure.history)
    out["probes"] = recorder.probes
    if state is not None and state.controllers:
        out["controllers"] = state.controllers
    if state is not None:
        if not brief:
            out["reactions"] = reactions(model, state)
        if model.contacts and not brief:
            from ..solvers.contact import contact_report

            out["contacts"] = contact_report(model, state)
        if recorder.moves:
            out["energy"] = dict(state.history)
        elif not brief:
            out["energy"] = energies(model, state)
        out["t" if recorder.case.solver.timed else "load_factor"] = state.t
        if "negative_pivots" in state.history and model.symmetric:
            out["negative_pivots"] = int(state.history["negative_pivots"])
    if recorder.windows.goals:
        out["windows"] = recorder.windows.values()
    out.update(recorder.report)
    out.update(recorder.totals)
    out["wall_s"] = recorder.clock.seconds
    out["checks"] = checks(loaded.case, out) if failure is None else []
    goal = loaded.case.goal
    if failure is None and goal is not None and quantity(goal, out) is None:
        recorder.warn([f"the goal has no value: {lacking(goal, out)}"])
    out["output"] = None
    out["warnings"] = recorder.warnings
    return out


def quantity(goal: Any, summary: dict[str, Any]) -> float | None:
    """Return the value of a goal (or expected value) from a summary, or None if it is not there."""
    if window_of(goal) is not None:
        return summary.get("windows", {}).get(window_key(goal), {}).get("value")
    if goal.limit_point is not None:
        points = summary.get("limit_points", [])[goal.limit_point - 1:goal.limit_point]
        if goal.probe is None or not points:
            return points[0]["factor"] if points else None
        return points[0]["probes"].get(goal.probe, {}).get(goal.quantity)
    if goal.input is not None:
        return _response_value(goal, summary.get("response", {}))
    if goal.kind is not None:
        return next((f["omega"] for f in summary.get("frequencies", ())
                     if (f["kind"], f["number"]) == (goal.kind, goal.number)), None)
    if goal.load_factor is not None:
        factors = summary.get("load_factors", [])[goal.load_factor - 1:goal.load_factor]
        return factors[0] if factors else None
    return value_at(goal, summary)


def _response_value(goal: Any, response: dict[str, Any]) -> float | None:
    """Return the part of a response that a goal asks for; of equivalent phases, the one nearest to the expected one."""
    found = response.get(goal.input, {}).get(goal.probe, {}).get(goal.quantity)
    if found is None:
        return None
    H = np.array(found["re"]) + 1j * np.array(found["im"])
    if goal.hz is None:
        return float(np.abs(H).max())
    if goal.hz not in response["hz"]:
        return None
    one = complex(H[response["hz"].index(goal.hz)])
    if goal.part == "phase":
        angle, near = float(np.angle(one)), getattr(goal, "value", 0.0)
        return angle + 2 * math.pi * round((near - angle) / (2 * math.pi))
    return {"re": one.real, "im": one.imag}.get(goal.part, abs(one))


def describe_goal(goal: Any) -> str:
    """Return a goal in words, such as 'mid uy'."""
    if goal is None:
        return "responses"
    if goal.input is not None:
        at = "" if goal.hz is None else f" at {goal.hz:g} Hz"
        named = {"re": "real part of the response", "im": "imaginary part of the response"}.get(goal.part, "response")
        return f"{named} to {goal.input}{at}: {goal.probe} {goal.quantity}" + (" phase" if goal.part == "phase" else "")
    if window_of(goal) is not None:
        return window_key(goal)
    limit = None if goal.limit_point is None else f"limit point {goal.limit_point}"
    factor = None if goal.load_factor is None else f"load factor {goal.load_factor}"
    parts = (limit, factor, goal.probe, goal.reaction, goal.quantity, goal.kind, goal.number)
    return " ".join(str(p) for p in parts if p is not None)


def lacking(goal: Any, summary: dict[str, Any]) -> str:
    """Return the reason why a solution has no value for a goal."""
    if goal.kind is not None and "frequencies" in summary:
        return (f"{describe_goal(goal)} is not among the {len(summary['frequencies'])} modes found. Raise "
                "solver.modes, or name another mode")
    return f"the solver does not compute {describe_goal(goal)}"


def checks(case: Case, summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the comparison of each expected value with the computed one: difference, tolerance, whether it is met."""
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
    """Return the header of every result file about its case: text, name, digest of files, title, solver, units."""
    case = loaded.case
    return {"case_text": loaded.text, "case_completed": loaded.completed, "case_name": loaded.source.file,
            "case_files": files_of(loaded), "overrides": list(loaded.overrides), "title": case.title,
            "solver": solver_name(case),
            "units": {"length": case.units.length, "force": case.units.force, "time": case.units.time},
            "command_line": command}


def _resumes(case: Case, out: str, progress: Progress) -> bool:
    """Return whether the run can be resumed from a checkpoint; notes the checkpoint, or why there is none."""
    from ..results import part_path, read_checkpoint

    part, name, found = part_path(out), solver_name(case), None
    if not case.solver.timed:
        why = f"a run of solver {name} has no checkpoints"
    elif not part.exists():
        why = f"there is no unfinished '{part}'"
    else:
        found = read_checkpoint(part)
        why = f"'{part}' holds no checkpoint"
    progress.note(f"{why}: starting from the beginning" if found is None else
                  f"resuming '{part}' at t = {found.t:.6g} {case.units.time}")
    return found is not None


def _writer(loaded: LoadedCase, model: Model, out: str, force: bool, command: str, resume: bool) -> Any:
    from ..results import ResultWriter

    header = result_header(loaded, command)
    if resume:
        return ResultWriter.resume(out, header, model.e0, force=force)
    names = {m.plan.name: [c for node in m.coordinate_names for c in node] for m in model.meshes.values()}
    writer = ResultWriter(out, header, [body_record(m) for m in model.meshes.values()], model.e0, names,
                          fields=field_records(model), force=force)
    for k, load in enumerate(loaded.case.loads):
        if load.drawn is not None:
            writer.array(f"guides/loads.{k}", load.drawn, f"S 1; y {loaded.case.units.length}",
                         "S and y of points through which the guide of a tendon is drawn")
    return writer


def _checkpoint_keeper(loaded: LoadedCase, model: Model, path: Path) -> Any:
    from ..json_values import plain
    from ..results.checkpoint import CheckpointKeeper

    return CheckpointKeeper(path, result_header(loaded), model.e0, plain)


def field_records(model: Model) -> list[FieldRecord]:
    """Return the descriptions, for the result file, of the fields that a case asks for."""
    from ..results import FieldRecord
    from ..solvers.fields import FieldReader

    return [FieldRecord(body.body, f.name, f.components, f.units, f.description, body.along(f),
                        body.across(f)) for body in FieldReader(model).bodies for f in body.fields]


SAMPLES = np.linspace(0.0, 1.0, 21)


def body_record(mesh: Any) -> BodyRecord:
    """Return the data to draw a body: shape functions sampled on the axis and at both faces (or layer boundaries)."""
    from ..results import BodyRecord

    element, plan = mesh.plan.element, mesh.plan
    # elements that differ only by faces at varying offsets from the axis share their shape functions
    keys = [k if element.section_kind == "interpolated" else id(c.shape) for k, c in enumerate(mesh.classes)]
    alike = dict(zip(keys, mesh.classes, strict=True))
    rows = np.array([list(alike).index(key) for key in keys])
    samplers, zero = [c.sampler for c in alike.values()], np.zeros(len(SAMPLES))
    layers, half, levels = plan.section.layers, 0.5 * plan.section.height, None
    if layers:
        levels = np.array([layers[0].bottom, 0.0, layers[-1].top, *(layer.top for layer in layers[:-1])])
    etas = (-1.0, 0.0, 1.0) if levels is None else levels / half
    S = np.array([[one.derivative(SAMPLES, zero + eta, 0, 0) for eta in etas] for one in samplers])
    S_x = np.array([one.derivative(SAMPLES, zero, 1, 0) for one in samplers])
    heights = np.array([np.broadcast_to(c.sampler.at(SAMPLES).height, len(SAMPLES)) for c in mesh.classes])
    node_shape = [next(k for k, (i, name) in enumerate(element.functionals) if i == node and name == "r")
                  for node in range(len(element.nodes))]
    ends = np.append(mesh.starts, plan.length)
    return BodyRecord(plan.name, element.name, plan.formulation.name, plan.section.height, plan.section.width,
                      element.section_kind, mesh.dofs, mesh.nodes, np.array(node_shape), rows[mesh.cls],
                      np.array([one.shape.l for one in samplers]), SAMPLES, S, S_x, ends / plan.length,
                      heights=heights[mesh.cls] if np.any(heights != plan.section.height) else None,
                      levels=levels)
