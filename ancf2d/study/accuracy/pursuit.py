"""The levels solved on the way to a wanted accuracy, each solved once."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from ...case import LoadedCase
from ...errors import Ancf2dError, CaseError, ComputationError, many, verdict
from ...model.model import Model
from ...solvers.motion.integrators import DEFAULT, SHARPER, default_method
from ...solvers.registry import solve
from ..goal import Solved, Target, course_of_goal, solve_for_goal
from ..order import Estimate
from ..record import Progress
from ..run import Outcome, Solve, prepare
from .setting import Level, Setting, bodies_with_meshes, with_setting

if TYPE_CHECKING:
    from ...solvers.statics.newton import Start

# most elements of all bodies in the search for an accuracy
MOST_ELEMENTS = 200_000
# most elements times iterations of one solve: some minutes
MOST_WORK = 10**7
MOST_LEVELS = 30
LEAST_TOLERANCE = 1e-12


# function that gives the estimate and relative error of a solved level
EstimateOf = Callable[[Level], tuple[Estimate, float]]


@dataclass
class Pursuit:
    """A case, the relative accuracy wanted, and all levels solved so far, in order.

    ``model_error``: the error of simpler models or frequencies, which meshes do not show; ``guesses``: statics may
    start from the ``latest`` state of the same element types on another mesh. ``last``: the level solved last, and its
    solution; ``case``: the case with its setting. ``weights``: the influence of each body's mesh on the goal, relative
    to the others; ``by_adjoint``: they come from the adjoint. ``judged``: the estimate and error reported last.
    """

    loaded: LoadedCase
    wanted: float
    progress: Progress
    target: Target | None = None
    tell: Callable[[str], None] = lambda text: None
    levels: list[Level] = field(default_factory=list)
    known: dict[Any, Level] = field(default_factory=dict)
    model_error: float = 0.0
    report: dict[str, Any] = field(default_factory=dict)
    outcome: Outcome | None = None
    written: Level | None = None
    guesses: bool = True
    latest: dict[Any, Solved] = field(default_factory=dict)
    last: tuple[Level, Solved] | None = None
    case: LoadedCase | None = None
    weights: dict[str, float] = field(default_factory=dict)
    by_adjoint: bool = False
    judged: tuple[Estimate, float] = Estimate(None, None, None, False, ""), math.inf

    def solve(self, setting: Setting, why: str, estimate_of: EstimateOf | None = None, how: Solve | None = None
              ) -> Level:
        """Return the level of a setting, solved unless it is known, by ``how`` if that is given.

        If it may be the result, ``estimate_of`` gives its error: then it is written, unless it starts from a guess.
        Raises CaseError for an invalid case.
        """
        level = self.known.get(setting.name)
        if level is None:
            level = self.new_level(setting, why)
            if self.starts_from_guess:
                self._run(level, None, lambda model: solve(model, self._guess(model, level)))
            else:
                self._run(level, estimate_of, how)
        return level

    def solve_aside(self, setting: Setting, why: str) -> Level:
        """Same as ``solve`` for a motion that is not the result: only the course of its goal, without a summary."""
        level = self.known.get(setting.name)
        if level is None:
            level, began = self.new_level(setting, why), time.perf_counter()
            try:
                model, level.answer, level.iterations, level.step_count = course_of_goal(
                    with_setting(self.loaded, setting))
                level.dofs = model.n_q
            except (ComputationError, MemoryError) as error:
                level.reason = verdict(error)[1]
            level.wall_s = time.perf_counter() - began
        return level

    def new_level(self, setting: Setting, why: str) -> Level:
        """Return a new level of a setting, reported and not solved yet."""
        self.tell(many(setting.elements, "element") + (
            "" if setting.tolerance is None else f", tolerance {setting.tolerance:.1g}") + (
            "" if setting.method is None else f", {setting.method}") + (
            f", {setting.named_steps}" if setting.steps else "") + f": {why}")
        level = self.known[setting.name] = Level(setting, why, kinks=self.slides(setting),
                                                 zones=self.ends_within(setting))
        self.levels.append(level)
        return level

    def solve_as_result(self, setting: Setting, why: str, estimate_of: EstimateOf) -> Level:
        """Return the level of a setting, solved with all its load steps and written as the preliminary result."""
        return self.resolve_as_result(self.known.get(setting.name) or self.new_level(setting, why), estimate_of)

    def resolve_as_result(self, level: Level, estimate_of: EstimateOf, how: Solve | None = None) -> Level:
        """Solve a level with all its load steps, or as ``how`` says, and write it as the preliminary result."""
        self._run(level, estimate_of, how)
        return level

    def add_neighbour(self, found: tuple[Level, Any]) -> tuple[Level, Any]:
        """Store a level that was solved as a neighbour, with its additional data; return both."""
        level, other = found
        self.tell(f"{many(level.setting.elements, 'element')}: {level.why}")
        self.levels.append(level)
        self.known.setdefault(level.setting.name, level)
        return level, other

    def slides(self, setting: Setting) -> bool:
        """Return whether a point slides along a body that deforms."""
        case = self.loaded.case
        meshed = bodies_with_meshes(case, setting.types)
        return any(joint.slides_along in meshed for joint in case.joints)

    def ends_within(self, setting: Setting) -> bool:
        """Return whether zones end within elements, at a different place in each mesh.

        Such zones occur where fibres of a body yield or follow a curve, or where bodies touch without a law in statics.
        """
        case = self.loaded.case
        meshed = bodies_with_meshes(case, setting.types)
        touches = case.solver.balances and any(contact.law is None for contact in case.contacts)
        return touches or any(material.fibres for body in meshed.values() for material in body.materials)

    def write(self, level: Level, estimate_of: EstimateOf) -> None:
        """Make a level the result: solve it once more from the reference configuration, unless written already."""
        if self.written is not level:
            self.tell(f"{many(level.setting.elements, 'element')}: the result")
            self._run(level, estimate_of)

    @property
    def starts_from_guess(self) -> bool:
        """Return whether meshes start from the state of another one."""
        return self.guesses and self.loaded.case.solver.takes_guess

    def _guess(self, model: Model, level: Level) -> Start | None:
        """Return the latest state of the same element types on another mesh, as a start."""
        latest = self.latest.get(level.setting.kinds)
        return None if latest is None else latest.start_on(model)

    def _run(self, level: Level, estimate_of: EstimateOf | None, how: Solve | None = None) -> None:
        """Solve a level; with ``estimate_of``, which gives its error, it becomes the preliminary result."""
        # warnings about intermediate meshes are suppressed: their sequence shows more than each by itself, and more of
        # zones that yield than one mesh does
        quiet = replace(self.progress, warn=lambda text: None, note=lambda text: None,
                        checks_mesh=estimate_of is not None, checks_zones=False)

        def conclude(found: Solved) -> None:
            level.store(found.answer, found.summary)
            level.dofs, level.reason, self.last = found.model.n_q, "", (level, found)
            if estimate_of is not None:
                found.summary["accuracy"] = self.accuracy(level, *estimate_of(level))

        target = None if estimate_of is None else self.target
        self.case = with_setting(self.loaded, level.setting)
        try:
            found = solve_for_goal(self.case, quiet, target, conclude, how)
        except (ComputationError, MemoryError) as error:
            level.reason = verdict(error)[1]
            return
        if self.loaded.case.solver.takes_guess and not level.missed_by:
            # a mesh that has missed an obstacle may be on its wrong side, so its state is no start for others
            self.latest[level.setting.kinds] = found
        if estimate_of is not None:
            self.outcome, self.written = found.outcome, level
            if self.target is not None:
                self.target.written = True

    def accuracy(self, level: Level, found: Estimate, error: float) -> dict[str, Any]:
        """Return ``accuracy`` of the summary for a level, with its estimate ``found`` and its ``error``."""
        self.judged = found, error
        sampled = 0.0 if level.answer is None else level.answer.sampling / level.answer.size
        total, note = error + self.model_error + sampled, found.note
        if sampled:
            self.report["sampling_error"] = sampled
        if sampled > 0.5 * self.wanted:
            note = "; ".join(n for n in (note, "stored times are too far apart for the window: a smaller "
                                         "output.interval helps") if n)
        value, size = (None, None) if level.answer is None else (level.answer.value, level.answer.size)
        estimate = total if math.isfinite(total) else None
        if self.loaded.case.goal is None:
            value = None
        return {"value": value, "estimate": estimate, "scale": size,
                "absolute": None if estimate is None or size is None else estimate * size, "wanted": self.wanted,
                "achieved": bool(total <= self.wanted), "order": found.order, "limit": found.value,
                "by_body": self.by_body(level, error),
                "elements": dict(level.setting.counts), "nodes": level.setting.node_positions(),
                "tolerance": level.setting.tolerance, "method": level.setting.method,
                "fibres": level.setting.fibres, "steps": None,
                **level.setting.steps, "note": note, "solves": len(self.levels), "wall_s": self.wall_s, **self.report,
                "path": [level.as_json() for level in self.levels]}

    def by_body(self, level: Level, error: float) -> dict[str, float] | None:
        """Return the parts of the mesh error due to each body, or None if unknown.

        Their sum is the part of the estimate that is due neither to time or load steps, fibres nor to simpler models.
        """
        left = error - sum(self.report.get(name, 0.0) for name in ("time_error", "steps_error", "fibres_error"))
        bodies = level.setting.counts
        if not math.isfinite(left) or (len(bodies) > 1 and not self.weights):
            return None
        weights = {name: self.weights.get(name, 0.0) for name in bodies}
        whole = sum(weights.values())
        if whole == 0.0:
            # a single body, or no body that affects the goal
            weights, whole = dict.fromkeys(bodies, 1.0), float(len(bodies))
        return {name: left * weights.get(name, 0.0) / whole if whole else 0.0 for name in self.loaded.case.bodies}

    def sharper(self, setting: Setting) -> Setting:
        """Return a setting whose finer time steps show the error of those of another one.

        If Newton's method limits the steps, a smaller tolerance changes few of them, so the default method is compared
        with a more accurate one.
        """
        assert setting.tolerance is not None
        return replace(self.accurate(setting), tolerance=tenth(setting.tolerance))

    def accurate(self, setting: Setting) -> Setting:
        """Return a setting with a method more accurate than the default; one that the case names is kept."""
        if getattr(self.loaded.case.solver, "method", "") is not None:
            return setting
        # models with impacts, which have another default, are never verified before they are solved
        other = self.last is not None and default_method(self.last[1].model) != DEFAULT
        return replace(setting, method=None if other else SHARPER)

    def why_refused(self, setting: Setting) -> Ancf2dError | None:
        """Return why the case cannot be built with a setting, or None if it can."""
        try:
            prepare(with_setting(self.loaded, setting))
        except CaseError as error:
            return error
        return None

    @property
    def wall_s(self) -> float:
        """Seconds of all solves."""
        return sum(level.wall_s for level in self.levels)


def tenth(tolerance: float) -> float:
    """Return a tenth of a tolerance, without round-off digits of decimal fractions."""
    return float(f"{0.1 * tolerance:.6g}")
