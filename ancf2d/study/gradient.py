"""Derivatives of the results of a run with respect to numbers of its case."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..case import (
    Buckling,
    Eigen,
    FrequencyResponse,
    Goal,
    LinearStatic,
    LoadedCase,
    QuasiStatic,
    Static,
    with_overrides,
)
from ..case.numbers import CaseNumber, numbers_at
from ..elements.shape import Array
from ..errors import ComputationError
from ..model.model import Model
from ..model.section import remembers_way
from ..solvers.contact import force_at_fixed_place
from ..solvers.derivatives.differences import Quotient, UnsuitedError, derivative
from ..solvers.derivatives.load_factors import Growth, Instability
from ..solvers.derivatives.motion import Motion
from ..solvers.derivatives.motion_adjoint import MotionAdjoint, recorded_motion
from ..solvers.derivatives.motion_states import NEWTON, lengths_of
from ..solvers.derivatives.small_motions import ForcedVibration, Vibration
from ..solvers.derivatives.statics import Equilibrium, Path, Response
from ..solvers.derivatives.transposed_steps import RecordedMotion, StepLengthError
from ..solvers.derivatives.varied_motions import why_unsuited
from ..solvers.registry import solve
from ..solvers.state import State
from ..solvers.statics.static import unscaled
from .expressions import GoalValues
from .goal import for_study
from .record import Progress
from .run import prepare, run_case, vocabulary

# relative steps of a number: between models at the same unknowns, where forces are known to the last digits but cancel
# each other, and between runs
STEP, STEP_OF_RUNS = 4e-4, 2e-3
# tolerance of equilibria that are compared with each other, relative to the displacements
TIGHT = 1e-12

# function to differentiate: numbers (m,) from the states of a model. It may have ``goals``, those that it reads of
# modes and load factors; ``all_states``, False if it reads the last state alone; ``weights``, which returns how much
# the derivatives of its values count; and ``from_probes``, True if it has the methods of ``readings.Goals``
GoalFunction = Callable[[Model, Sequence[Any]], Array]


@dataclass
class Derivatives:
    """Results (m,) of runs, and their derivatives (m, n) by n numbers of a case.

    ``errors`` (m, n) are the estimated errors of the derivatives; ``methods`` (n,) say how each was found.
    """

    variables: list[CaseNumber]
    values: Array
    jacobian: Array
    errors: Array
    methods: list[str]


def gradient(loaded: LoadedCase, goals: Iterable[Goal] | GoalFunction, paths: Sequence[str],
             progress: Progress | None = None) -> tuple[Array, Array]:
    """Return the values (m,) of goals, and their derivatives (m, n) by the numbers of a case at some paths.

    ``goals`` are goals of the case format, or a function of a model and the states of its run that returns the values.
    Raises CaseError if a path leads to no number that can vary, ComputationError if a run fails.
    """
    found = derivatives(loaded, goals, numbers_at(loaded, paths), progress)
    return found.values, found.jacobian


def derivatives(loaded: LoadedCase, goals: Iterable[Goal] | GoalFunction, variables: Sequence[CaseNumber],
                progress: Progress | None = None) -> Derivatives:
    """Return the results of ``gradient`` with error estimates and methods."""
    function = goals if callable(goals) else GoalValues(tuple(goals))
    run = DifferentiableRun(loaded, function, progress or Progress(), numbers=len(variables))
    return derivatives_of(run, variables)


def derivatives_of(run: DifferentiableRun, variables: Sequence[CaseNumber]) -> Derivatives:
    """Return the results of ``derivatives`` for a case that was solved."""
    run.compute_together(variables)
    found = [run.differentiate(variable) for variable in variables]
    shape = len(variables), len(run.values)
    columns, errors = (np.array(rows).reshape(shape).T for rows in ([q.value for q, _ in found],
                                                                    [q.error for q, _ in found]))
    return Derivatives(list(variables), run.values, columns, errors, [how for _, how in found])


class DifferentiableRun:
    """A case solved once, the values watched in it, and their derivatives by numbers of the case."""

    def __init__(self, loaded: LoadedCase, function: GoalFunction, progress: Progress,
                 warn: Callable[[str], None] = lambda text: None, numbers: int = 0) -> None:
        self.loaded, self.function = _tight(for_study(loaded)), function
        # warnings of the case come from its own run, not from runs with changed numbers
        self.progress = replace(progress, warn=warn)
        self.models: dict[str, Callable[[float], Model]] = {}
        self.moves = loaded.case.solver.moves
        self.middle: Array | None = None
        # the motion, if its steps were stored for the adjoint, and the lengths of fixed steps
        self.motion: RecordedMotion | None = None
        self.lengths: list[float] = []
        self.model, states = self._first_run(numbers)
        self.progress = replace(progress, warn=lambda text: None, state=lambda state: None, built=lambda model: None,
                                checks_mesh=False)
        self.values, self.numbering = function(self.model, states), numbering_of(self.model)
        # states for the derivatives; the method is chosen when the number of variables is known
        self.states = states
        self.adjoint: MotionAdjoint | None = None
        self.responses: list[Any] | None = None
        self.reason = ""

    def _first_run(self, numbers: int) -> tuple[Model, list[Any]]:
        """Return model and states of the case; the motion is stored if its derivatives will use the adjoint."""
        for tolerance in NEWTON if self._takes_adjoint(numbers) else ():
            warnings = list[str]()
            try:
                found = self._run(self.loaded, partial(self._recorded, tolerance=tolerance), warnings.append)
            except StepLengthError:
                continue
            except (UnsuitedError, ComputationError):
                break
            for text in warnings:
                self.progress.warn(text)
            return found
        self.motion = None
        return self._run(self.loaded)

    def _recorded(self, model: Model, tolerance: float) -> Iterator[State]:
        """Return the states of a motion, which is stored for the adjoint if possible."""
        if why_no_response(model):
            return solve(model)
        goals: Any = self.function
        self.motion = RecordedMotion(model, goals.all_states, tolerance, self.lengths)
        return self.motion.states()

    def _run(self, loaded: LoadedCase, how: Callable[[Model], Iterator[State]] | None = None,
             warn: Callable[[str], None] | None = None) -> tuple[Model, list[Any]]:
        """Return model and states of a run, solved by ``how``. Raises CaseError and ComputationError."""
        states: list[Any] = []
        progress = replace(self.progress, state=states.append, warn=warn or self.progress.warn)
        outcome = run_case(loaded, progress=progress, solve=how)
        if outcome.failure is not None:
            raise outcome.failure
        return outcome.model, states

    def _choose_method(self, numbers: int) -> None:
        """Choose the method of derivatives: one adjoint per goal, or one linearised motion per number."""
        if self.adjoint is None and self.responses is None:
            if self._takes_adjoint(max(numbers, 1)):
                self.adjoint = self._adjoint()
            if self.adjoint is None:
                self._take_responses()

    def _takes_adjoint(self, numbers: int) -> bool:
        """Return whether the goals are probe quantities of a motion, and not more than ``numbers``."""
        function: Any = self.function
        return self.moves and getattr(function, "from_probes", False) and function.count <= numbers

    def _adjoint(self) -> MotionAdjoint | None:
        """Return the adjoint of a motion's goals, or None if there is none."""
        goals: Any = self.function
        if why_no_response(self.model):
            return None
        try:
            motion, states = self.motion, self.states
            if motion is None:
                motion, states = recorded_motion(self.model, goals.all_states, lengths_of(states))
            return MotionAdjoint(motion, states, goals)
        except UnsuitedError:
            return None

    def _take_responses(self) -> None:
        """Use responses of the states for the derivatives instead of the adjoint."""
        self.adjoint = self.motion = None
        self.responses, self.reason = self._responses(self.states)
        self.states = self.states[-1:]

    def _responses(self, states: list[Any]) -> tuple[list[Any], str]:
        """Return the responses of the states to a change, or the reason why runs with a changed number are needed."""
        reason, goals = why_no_response(self.model), getattr(self.function, "goals", None)
        all_states = getattr(self.function, "all_states", True) and len(states) > 1
        if not reason and self.model.contacts and any(g.limit_point is not None for g in goals or ()):
            reason = "contact changes along the path"
        if not reason and not self.moves and force_at_fixed_place(self.model):
            reason = "contact points between nodes differ between runs"
        if not reason and goals is None and isinstance(self.model.case.solver, Eigen | Buckling):
            reason = "the modes that are read are unknown"
        if not reason and all_states and not self.moves and (self.model.contacts or any(s.report for s in states)):
            reason = "states along the path have no derivative of their own"
        if reason:
            return [], reason
        if self.moves:
            function: Any = self.function
            from_probes = getattr(function, "from_probes", False)
            return [Motion(self.model, states, all_states, function if from_probes else None)], ""
        return responses(self.model, states, all_states, goals), ""

    def compute_together(self, variables: Sequence[CaseNumber]) -> None:
        """Compute together the parts that are cheaper for several numbers than for each."""
        self._choose_method(len(variables))
        steps = [(self._varied_model(v), STEP * size_of(v, self.model.extent)) for v in variables]
        if self.adjoint is not None:
            try:
                self.adjoint.prepare(steps)
            except UnsuitedError:
                self._take_responses()
        for one in self.responses or ():
            one.prepare(steps)

    def differentiate(self, variable: CaseNumber) -> tuple[Quotient, str]:
        """Return the derivative by a number, and how it was found."""
        self._choose_method(1)
        size, reason = size_of(variable, self.model.extent), self.reason
        if self.adjoint is not None or self.responses:
            try:
                return self._by_responses(variable, STEP * size), "exact"
            except UnsuitedError as error:
                reason = str(error)
            finally:
                self.models.pop(variable.path, None)
        return self._differences(variable, STEP_OF_RUNS * size), f"differences of runs: {reason}"

    def exact(self, variables: Sequence[CaseNumber]) -> Array | None:
        """Return the derivatives (m, n) of a motion's values if all are linear in changes of its states, else None.

        Derivatives that would need further runs, or readings of changed states, are left to callers with cheaper
        methods.
        """
        self.compute_together(variables)
        if self.adjoint is None and not any(one.readings for one in self.responses or ()):
            return None
        try:
            return np.array([self._by_responses(v, STEP * size_of(v, self.model.extent)).value for v in variables]).T
        except UnsuitedError:
            return None

    def _varied_model(self, variable: CaseNumber) -> Callable[[float], Model]:
        """Return a function that builds the model with a number changed by a step, each once."""
        if variable.path not in self.models:
            models: dict[float, Model] = {}

            def at(step: float) -> Model:
                if step not in models:
                    found = prepare(_tight(for_study(varied(self.loaded, variable, step))), self.model,
                                    for_differences=True)
                    if numbering_of(found) != self.numbering:
                        raise UnsuitedError("the unknowns change with the number")
                    if rubs(found) != rubs(self.model):
                        raise UnsuitedError("friction depends on the load path")
                    if self.model.case.solver.timed and _times_of(found) != _times_of(self.model):
                        raise UnsuitedError("the times of steps and of stored states change with the number")
                    models[step] = found
                return models[step]
            self.models[variable.path] = at
        return self.models[variable.path]

    def _by_responses(self, variable: CaseNumber, h: float) -> Quotient:
        at = self._varied_model(variable)
        if self.adjoint is not None:
            return self.adjoint.slope(at, h)
        slopes = [one.slope(at, h) for one in self.responses or ()]
        if any(getattr(one, "readings", None) for one in self.responses or ()):
            return slopes[0]

        def values_near(step: float, model: Model | None = None, errors: float = 0.0) -> Array:
            model = model or (at(step) if step else self.model)
            return self.function(model, [
                s for one, slope in zip(self.responses or (), slopes, strict=True)
                for s in one.states(model, step * (slope.value + errors * slope.error) + abs(step) * slope.kink)])
        if self.middle is None:
            # differs from the values of the run: Newton's iterations go further where steps are differentiated, contact
            # points slide with a lift-off point, and a peak lies between the frequencies of a range
            differs = self.moves or self.model.contacts or isinstance(self.model.case.solver, FrequencyResponse)
            self.middle = values_near(0.0) if differs else self.values
        found = derivative(values_near, min(slope.h for slope in slopes), self._weights(), middle=self.middle)
        # relative errors of the states count as far as the values change with the states, not with the number itself
        share, moved = max(_share(slope) for slope in slopes), values_near(found.h, self.model)
        by_states = np.abs(moved - self.middle) / found.h
        by_errors = np.abs(values_near(found.h, self.model, 1.0) - moved) / found.h
        return Quotient(found.value, found.error + np.maximum(share * by_states, by_errors), found.h)

    def _differences(self, variable: CaseNumber, h: float) -> Quotient:
        """Return the derivative by a number from runs at other values. Raises ComputationError if meshes differ."""
        meshes: set[Any] = set()

        def run(step: float) -> Array:
            model, states = self._run(_tight(for_study(varied(self.loaded, variable, step))))
            meshes.add(mesh_of(model))
            if len(meshes) > 1:
                raise ComputationError(f"the mesh changes with {variable.path}: there is no derivative at "
                                       f"{variable.value:.9g}", advice="another value, or element: {nodes: regular}")
            return self.function(model, states)
        return derivative(run, h, self._weights(), middle=self.values)

    def _weights(self) -> Array | None:
        """Return the weights of the values in the choice of difference steps, or None."""
        weights = getattr(self.function, "weights", None)
        return None if weights is None else weights(self.values)


def rubs(model: Model) -> bool:
    """Return whether any contact has friction."""
    return any(pair.item.friction for pair in model.contacts)


def why_no_response(model: Model) -> str:
    """Return why the states of a model have no response to changes, or an empty text if they have one."""
    solver = model.case.solver
    if solver.moves:
        return why_unsuited(model)
    balances = isinstance(solver, LinearStatic | Static | QuasiStatic)
    if model.remembers and (remembers_way(model.case) if balances else not solver.scales or model.loads.flows):
        return "materials depend on the load history"
    if rubs(model):
        return "friction depends on the load path"
    if solver.scales and not model.loads.flows and next(unscaled(model), None) is not None:
        return "constant loads deform the model first"
    if not balances and not isinstance(solver, Eigen | Buckling | FrequencyResponse):
        return "the solver has no equilibrium states"
    return ""


def responses(model: Model, states: Sequence[Any], all_states: bool, goals: Sequence[Goal] | None) -> list[Response]:
    """Return the responses of the states of a run (of the last one unless ``all_states``) that ``goals`` need.

    Without goals these are the responses at all frequencies.
    """
    solver, kept, asked = model.case.solver, states if all_states else states[-1:], goals or ()
    if isinstance(solver, Eigen):
        modes = [(g.kind, g.number) for g in asked if g.kind is not None and g.number is not None]
        return [Vibration(model, state, modes) for state in kept]
    if isinstance(solver, Buckling):
        kind = Growth if model.loads.flows or not model.symmetric else Instability
        return [kind(model, state, [g.load_factor for g in asked if g.load_factor]) for state in kept]
    if isinstance(solver, FrequencyResponse):
        read = None if goals is None else [g for g in goals if g.input is not None]
        return [ForcedVibration(model, state, read) for state in kept]
    if solver.on_path:
        return [Path(model, states, [g.limit_point for g in asked if g.limit_point])]
    return [Equilibrium(model, state, solver.linear) for state in kept]


def _times_of(model: Model) -> tuple[Any, ...]:
    """Return the options that determine when time steps end, and which states are stored."""
    return model.case.solver, model.case.output.every, model.case.output.interval


def _share(found: Quotient) -> float:
    """Return the largest error of a derivative relative to its largest value."""
    largest = float(np.abs(found.value).max(initial=0.0))
    return float(found.error.max(initial=0.0)) / largest if largest else 0.0


def _tight(loaded: LoadedCase) -> LoadedCase:
    """Return a case whose equilibria are converged to the last digits."""
    solver = loaded.case.solver
    if isinstance(solver, Eigen):
        return replace(loaded, case=replace(loaded.case, solver=replace(solver, verify=False)))
    if not isinstance(solver, Static):
        return loaded
    tolerance = min(solver.tolerance or TIGHT, TIGHT)
    return replace(loaded, case=replace(loaded.case, solver=replace(solver, tolerance=tolerance, verify=False)))


def varied(loaded: LoadedCase, variable: CaseNumber, h: float) -> LoadedCase:
    """Return a case with one of its numbers changed by h. Raises CaseError if the result is invalid."""
    return with_overrides(loaded, [variable.override(variable.value + h)], vocabulary())


def size_of(variable: CaseNumber, extent: float) -> float:
    """Return the scale for changes of a number: its value, that of its list, or the model's size."""
    return abs(variable.value) or variable.list_scale or extent


def mesh_of(model: Model) -> tuple[Any, ...]:
    """Return a key that is equal for two meshes whose elements correspond."""
    return tuple((name, m.plan.element.name, m.plan.formulation.name, tuple(p.count for p in m.plan.pieces), m.n_dofs)
                 for name, m in model.meshes.items())


def numbering_of(model: Model) -> tuple[Any, ...]:
    """Return a key that is equal for two models whose unknowns correspond."""
    num = model.numbering
    return mesh_of(model), num.free.tobytes(), num.dependent.tobytes(), num.n_multipliers
