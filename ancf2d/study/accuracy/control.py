"""Solution of a case to a wanted accuracy of its goal: choice of element types, time steps and meshes, and reports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...case import Case, FrequencyResponse, Goal, LoadedCase, QuasiStatic, with_overrides
from ...errors import ComputationError, many
from ...model.curve import stretches
from ...model.plan import acting_points
from ...model.section import remembers_way
from ..goal import GoalValue, Target, goal_kind
from ..order import Estimate
from ..record import Progress
from ..run import Outcome, describe_goal, prepare, vocabulary
from ..variants import Variant, flexible
from ..windows import window_of
from .direct import Direct
from .estimates import relative_distance
from .fibres import begin_fibres, in_fibres
from .mesh import Ladder
from .models import BEAM, choose_types
from .pursuit import LEAST_TOLERANCE, MOST_WORK, Pursuit
from .setting import Level, with_setting
from .steps import Motion, in_steps

# accuracy for a case that leaves element types open and gives no accuracy
DEFAULT = 1e-3
# largest shares of the wanted error for time or load steps, for simpler models, and for frequency points; and first
# tolerance of quasi_static
TIME, MODEL, POINTS, BEGUN = 0.2, 0.3, 0.1, 0.1
# safety factor of the model error, which is found on coarse meshes
SAFE = 1.25
# of the wanted error: two solutions of one mesh further apart are on different branches
BRANCH = 0.1


@dataclass
class Reached:
    """The result of a search for an accuracy: the outcome of the final run, and its accuracy."""

    outcome: Outcome
    accuracy: dict[str, Any]

    @property
    def achieved(self) -> bool:
        """Return whether the estimated error is below the wanted one."""
        return bool(self.accuracy["achieved"])


def is_pursued(loaded: LoadedCase) -> bool:
    """Return whether a case asks for an accuracy, or leaves element types open."""
    return loaded.case.accuracy is not None or bool(_open_bodies(loaded))


def first_mesh(loaded: LoadedCase) -> LoadedCase:
    """Return a case on its coarsest mesh, with beams for open element types. Raises CaseError."""
    pursuit = Pursuit(loaded, loaded.case.accuracy or DEFAULT, Progress())
    types = dict.fromkeys(_open_bodies(loaded), BEAM)
    return with_setting(loaded, Ladder(pursuit, types, _tolerance_of(pursuit)).setting(1.0))


def check(loaded: LoadedCase) -> list[str]:
    """Check a case beyond its format, without numba; return its warnings. Raises CaseError with all problems.

    A case that asks for an accuracy is checked on its coarsest mesh.
    """
    return prepare(first_mesh(loaded) if is_pursued(loaded) else loaded).warnings


def _open_bodies(loaded: LoadedCase) -> list[str]:
    return [name for name, b in flexible(loaded.case).items() if b.element.type == "auto"]


def solve_to_accuracy(loaded: LoadedCase, target: Target | None = None, progress: Progress | None = None,
                      tell: Callable[[str], None] = lambda text: None) -> Reached:
    """Solve a case to the accuracy that it asks for; if that is not reached, return the best solution found.

    Raises CaseError for a case without a goal (a frequency response needs none) or one that cannot be solved at all,
    ComputationError if no mesh could be solved.
    """
    wanted = loaded.case.accuracy or DEFAULT
    dense = _with_points(loaded, POINTS * wanted)
    pursuit = Pursuit(dense or _with_tolerance(loaded, BEGUN * wanted), wanted, progress or Progress(), target, tell)
    if dense is not None:
        pursuit.model_error = pursuit.report["points_error"] = POINTS * wanted
    if _open_bodies(loaded) or not (loaded.case.solver.moves or Direct(pursuit, {}, wanted).applies()):
        prepare(first_mesh(loaded))
    for name, body in flexible(loaded.case).items():
        if body.element.nodes == "regular" and stretches(body.geometry, acting_points(loaded.case)[name])[1:]:
            pursuit.tell(f"bodies.{name}: nodes are placed where something acts, despite nodes: regular, because "
                         "meshes with kinks inside elements cannot show the accuracy")
    # states that depend on the path must be reached along it on every mesh
    pursuit.guesses = not follows_way(loaded.case)
    types = _types(pursuit)
    counts_fibres = begin_fibres(pursuit, types)
    accuracy = _climbed(pursuit, types, _tolerance_of(pursuit))
    if counts_fibres and pursuit.written is not None:
        accuracy = in_fibres(pursuit, pursuit.written, accuracy)
    if pursuit.outcome is None:
        raise ComputationError(next(level.reason for level in pursuit.levels[::-1] if level.reason))
    pursuit.outcome.summary["accuracy"] = accuracy
    return Reached(pursuit.outcome, accuracy)


def follows_way(case: Case) -> bool:
    """Return whether the equilibrium depends on the steps that lead to it, because of memory or friction."""
    rubs = any(contact.friction > 0.0 for contact in case.contacts)
    return bool(case.solver.with_steps(1.0)) and (rubs or remembers_way(case))


def _with_points(loaded: LoadedCase, error: float) -> LoadedCase | None:
    """Return a frequency response over a range, with points so dense that cubic interpolation meets the error.

    None if the accuracy concerns something else, or a single frequency.
    """
    solver, goal = loaded.case.solver, loaded.case.goal
    if not isinstance(solver, FrequencyResponse) or solver.frequencies is not None:
        return None
    if goal is not None and goal.hz is not None:
        return None
    return with_overrides(loaded, [f"solver.tolerance={min(error, solver.resolution)!r}"], vocabulary())


def _with_tolerance(loaded: LoadedCase, tolerance: float) -> LoadedCase:
    """Return a case whose first time steps have this tolerance if its result depends on them."""
    if not (isinstance(loaded.case.solver, QuasiStatic) and follows_way(loaded.case)):
        return loaded
    return with_overrides(loaded, [f"solver.tolerance={tolerance!r}"], vocabulary())


def _climbed(pursuit: Pursuit, types: dict[str, Variant], tolerance: float | None) -> dict[str, Any]:
    """Refine the mesh, and the time steps if there are any; write the result and return its accuracy."""
    left = max(pursuit.wanted - pursuit.model_error, 0.1 * pursuit.wanted)
    direct = _directly(pursuit, types, tolerance, left) if pursuit.guesses else None
    if direct is not None:
        return pursuit.accuracy(direct[0], direct[2], direct[1])
    ladder = Ladder(pursuit, types, tolerance)
    follows = follows_way(pursuit.loaded.case)
    level, error, found = ladder.climb((1.0 - TIME) * left if follows or tolerance is not None else left)
    if level is None:
        reasons = [level.reason for level in pursuit.levels if level.reason]
        raise ComputationError(f"no mesh could be solved: {reasons[-1] if reasons else found.note}",
                               at={"elements": pursuit.levels[-1].setting.elements},
                               advice="run the case with a mesh of your own to see more")
    if tolerance is not None:
        return _in_time(pursuit, level, error, found)
    expected = level.answer
    pursuit.write(level, lambda level: (found, error))
    if pursuit.starts_from_guess and _strayed(level, expected, BRANCH * left):
        pursuit.tell("the load steps have changed, so all meshes are solved again")
        pursuit.guesses = False
        pursuit.known.clear()
        return _climbed(pursuit, types, tolerance)
    return in_steps(pursuit, level, error, found) if follows else pursuit.accuracy(level, found, error)


def _directly(pursuit: Pursuit, types: dict[str, Variant], tolerance: float | None, wanted: float
              ) -> tuple[Level, float, Estimate] | None:
    """Return the result of directly predicted meshes, or None if a ladder of meshes is needed."""
    direct = Direct(pursuit, types, wanted)
    if tolerance is None:
        return direct.reach()
    found = Motion(pursuit, types, direct.first().counts, tolerance).reach(wanted)
    if found is None:
        pursuit.report.pop("time_error", None)
    return found


def _strayed(level: Level, expected: GoalValue | None, allowed: float) -> bool:
    """Return whether the load steps of a level failed, or ended in another state than the solve from a guess."""
    if level.reason or level.answer is None or expected is None:
        return True
    return level.answer.distance(expected) > allowed * expected.size


def _in_time(pursuit: Pursuit, rough: Level, error: float, found: Estimate) -> dict[str, Any]:
    """Solve the chosen mesh with smaller steps, until that hardly changes the goal; return its accuracy."""
    def estimate_of(level: Level) -> tuple[Estimate, float]:
        # a ten times larger tolerance has at least three times the error
        pursuit.report["time_error"] = 0.5 * relative_distance(level, rough)
        return found, error + pursuit.report["time_error"]

    while True:
        fine = pursuit.solve(pursuit.sharper(rough.setting), "effect of the time steps", estimate_of)
        pursuit.write(fine, estimate_of)
        accuracy = pursuit.accuracy(fine, *estimate_of(fine))
        if accuracy["achieved"] or error > pursuit.wanted or fine.reason:
            return accuracy
        if (fine.setting.tolerance or 0.0) <= LEAST_TOLERANCE or 2 * fine.work > MOST_WORK:
            return accuracy | {"note": "the time steps needed would take too long"}
        rough = fine


def _types(pursuit: Pursuit) -> dict[str, Variant]:
    open_bodies = _open_bodies(pursuit.loaded)
    if not open_bodies:
        return {}
    chosen = choose_types(pursuit, open_bodies, MODEL * pursuit.wanted, _tolerance_of(pursuit))
    error = SAFE * chosen.error
    pursuit.model_error += error
    pursuit.report["model_error"] = error
    pursuit.report["types"] = {name: {"element": chosen.types[name].element, "why": chosen.why[name]}
                               for name in open_bodies}
    return chosen.types


def _tolerance_of(pursuit: Pursuit) -> float | None:
    """Return the initial tolerance of time steps, or None if the case is not a motion."""
    return pursuit.wanted if pursuit.loaded.case.solver.moves else None


def _measured_by(accuracy: dict[str, Any], goal: Goal, moves: bool) -> str:
    """Return in words the scale of the relative error of a goal."""
    value, size = accuracy["value"], accuracy["scale"]
    if abs(size - abs(value)) <= 1e-12 * size:
        return "the value"
    if not moves or window_of(goal) is not None:
        return f"{size:.4g}, a thousandth of the largest {goal_kind(goal)} in the model"
    what = f"displacement of {goal.probe}" if goal_kind(goal) in ("displacement", "position") else "value over time"
    return f"{size:.4g}, the largest {what}"


def describe(accuracy: dict[str, Any], case: Case) -> str:
    """Return the accuracy reached for a case, in one sentence."""
    estimate, goal = accuracy["estimate"], case.goal
    about = "no estimate of the error"
    if estimate is not None:
        about = f"error about {estimate:.1e} of their peaks" if goal is None else (
            f"error about {accuracy['absolute']:.1e}, which is {estimate:.1e} of "
            + _measured_by(accuracy, goal, case.solver.moves))
    measured = describe_goal(goal) + ("" if goal is None else f" = {accuracy['value']:.10g}")
    verdict = "reached" if accuracy["achieved"] else "NOT reached"
    return (f"{measured}, {about} (wanted {accuracy['wanted']:.1e}: {verdict}), "
            f"{many(sum(accuracy['elements'].values()), 'element')}, {many(accuracy['solves'], 'solve')}")
