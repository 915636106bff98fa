"""A case solved to a wanted accuracy of its goal: element types, steps in time, meshes, and what to say of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ...case import Dynamic, LoadedCase
from ...errors import CaseError, ComputationError
from ..record import Progress
from ..run import Outcome, describe_goal, prepare
from ..variants import Variant, flexible
from .fidelity import BEAM, choose_types
from .mesh import LADDER, Ladder, count_text, shares_by_weight
from .pursuit import Pursuit, Target
from .setting import Level, with_setting

# accuracy of a case that leaves element types open and names none
DEFAULT = 1e-3
# of the wanted error: what steps in time, and what simpler models, may take
TIME, MODEL = 0.3, 0.3
FIRST_TOLERANCE, TENTH, LEAST_TOLERANCE = 0.1, 0.1, 1e-12


@dataclass
class Reached:
    """The end of a pursuit: the outcome of the run that is the result, and its accuracy."""

    outcome: Outcome
    accuracy: dict[str, Any]

    @property
    def achieved(self) -> bool:
        """Whether the estimated error is below the wanted one."""
        return bool(self.accuracy["achieved"])


def is_pursued(loaded: LoadedCase) -> bool:
    """Whether a case asks for an accuracy, or leaves element types open."""
    return loaded.case.accuracy is not None or bool(_open_bodies(loaded))


def first_mesh(loaded: LoadedCase) -> LoadedCase:
    """Return a case on its coarsest mesh, with beams where element types are left open. Raises CaseError."""
    pursuit = Pursuit(loaded, loaded.case.accuracy or DEFAULT, Progress())
    types = dict.fromkeys(_open_bodies(loaded), BEAM)
    return with_setting(loaded, Ladder(pursuit, types, _tolerance_of(pursuit)).setting(1.0))


def _open_bodies(loaded: LoadedCase) -> list[str]:
    return [name for name, b in flexible(loaded.case).items() if b.element.type == "auto"]


def solve_to_accuracy(loaded: LoadedCase, target: Target | None = None, progress: Progress | None = None,
                      tell: Callable[[str], None] = lambda text: None) -> Reached:
    """Solve a case to the accuracy that it asks for; the best that was found where that is not reached.

    Raises CaseError for a case without a goal or that cannot be solved at all, ComputationError where no mesh could be.
    """
    if loaded.case.goal is None:
        raise CaseError(loaded.source.problem(("accuracy",), "an accuracy needs a goal that it is of",
                                              expected="for example goal: {probe: mid, quantity: uy}"))
    pursuit = Pursuit(loaded, loaded.case.accuracy or DEFAULT, progress or Progress(), target, tell)
    prepare(first_mesh(loaded))
    types = _types(pursuit)
    tolerance = _steps(pursuit, types)
    shares = shares_by_weight(pursuit, types, tolerance)
    ladder = Ladder(pursuit, types, tolerance, shares)
    if shares is not None:
        _say_shares(pursuit, ladder)
    last, _, note = ladder.climb(max(pursuit.wanted - pursuit.apart, 0.1 * pursuit.wanted))
    if last is None:
        reasons = [level.reason for level in pursuit.levels if level.reason]
        raise ComputationError(f"no mesh could be solved: {reasons[-1] if reasons else note}",
                               at={"elements": pursuit.levels[-1].setting.elements},
                               advice="run the case with a mesh of your own, which tells more")
    before = ladder.levels[:ladder.levels.index(last)]
    pursuit.write(last, before)
    if pursuit.outcome is None:
        raise ComputationError(last.reason)
    accuracy = pursuit.accuracy([*before, last])
    pursuit.outcome.summary["accuracy"] = accuracy
    return Reached(pursuit.outcome, accuracy)


def _types(pursuit: Pursuit) -> dict[str, Variant]:
    open_bodies = _open_bodies(pursuit.loaded)
    if not open_bodies:
        return {}
    chosen = choose_types(pursuit, open_bodies, MODEL * pursuit.wanted, _tolerance_of(pursuit))
    pursuit.apart += chosen.error
    pursuit.report["model_error"] = chosen.error
    pursuit.report["types"] = {name: {"element": chosen.types[name].element, "why": chosen.why[name]}
                               for name in open_bodies}
    return chosen.types


def _tolerance_of(pursuit: Pursuit) -> float | None:
    """Return the tolerance that steps in time are begun with, None where nothing moves."""
    return FIRST_TOLERANCE * pursuit.wanted if isinstance(pursuit.loaded.case.solver, Dynamic) else None


def _steps(pursuit: Pursuit, types: dict[str, Variant]) -> float | None:
    """Return the tolerance of steps in time whose error on a coarse mesh is a share of the wanted one."""
    tolerance = _tolerance_of(pursuit)
    if tolerance is None:
        return None
    setting = Ladder(pursuit, types, tolerance).setting(LADDER[1])
    rough, error = _with_tolerance(pursuit, setting, tolerance), float("inf")
    while tolerance >= LEAST_TOLERANCE:
        fine = _with_tolerance(pursuit, setting, TENTH * tolerance)
        if rough.answer is not None and fine.answer is not None:
            error = fine.answer.distance(rough.answer) / fine.answer.size
            if error <= TIME * pursuit.wanted:
                break
        tolerance, rough = TENTH * tolerance, fine
    pursuit.apart += error if error < float("inf") else 0.0
    pursuit.report["time_error"] = error
    return tolerance


def _with_tolerance(pursuit: Pursuit, setting: Any, tolerance: float) -> Level:
    return pursuit.solve(replace(setting, tolerance=tolerance), "steps in time: how much they matter")


def _say_shares(pursuit: Pursuit, ladder: Ladder) -> None:
    pursuit.tell(f"elements are shared as {count_text(pursuit.loaded.case, ladder.setting(LADDER[-1]).counts)}")


def describe(accuracy: dict[str, Any], goal: Any) -> str:
    """Return what was reached in one sentence."""
    estimate = accuracy["estimate"]
    about = "no estimate of the error" if estimate is None else f"estimated error {estimate:.1e}"
    verdict = "reached" if accuracy["achieved"] else "NOT reached"
    return (f"{describe_goal(goal)} = {accuracy['value']:.10g}, {about} (wanted {accuracy['wanted']:.1e}: {verdict}), "
            f"{sum(accuracy['elements'].values())} elements, {accuracy['solves']} solves")

