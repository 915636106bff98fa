"""The number of fibres to a wanted accuracy, for bodies whose materials yield or follow a curve."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ...elements.fibres import FIBRES
from ..order import Estimate
from ..variants import Variant
from .estimates import relative_distance
from .pursuit import MOST_WORK, Pursuit
from .setting import Level, bodies_with_meshes, gives_fibres
from .steps import MOVED, fine_enough

# share of the wanted error, and most fibres through a layer
SHARE, MOST = 0.2, 1000
# errors fall with the square of the number, but irregularly, with where yielding ends between fibres: the error is the
# last change of the goal, or this share of the change before, and so on
FADING = 0.25


def begin_fibres(pursuit: Pursuit, types: dict[str, Variant]) -> bool:
    """Return whether the number of fibres is to be chosen, after leaving a share of the wanted error for it.

    A number that the case gives is kept, and the user is told.
    """
    bodies = bodies_with_meshes(pursuit.loaded.case, types)
    given = [name for name, body in bodies.items() if any(m.fibres for m in body.materials) and gives_fibres(body)]
    if given:
        pursuit.report["fibres_given"] = given
        pursuit.tell(f"the error excludes that of the number of fibres of {', '.join(given)}, which the case gives")
    if all(map(gives_fibres, bodies.values())):
        return False
    pursuit.model_error += SHARE * pursuit.wanted
    return True


def in_fibres(pursuit: Pursuit, level: Level, before: dict[str, Any]) -> dict[str, Any]:
    """Solve the result with twice as many fibres until that hardly changes the goal; return its accuracy.

    ``before`` is the accuracy with the default number. One small change proves nothing: fibres are doubled at least
    twice.
    """
    pursuit.model_error -= SHARE * pursuit.wanted
    found, error = pursuit.judged
    kept = {} if before["achieved"] else {"achieved": False, "note": before["note"]}
    count, why = 2 * FIBRES, "effect of the number of fibres, now {}"
    rough = pursuit.solve(replace(level.setting, fibres=count), why.format(count))
    lasting = FADING * relative_distance(level, rough)

    finer: Level | None = None

    def estimate_of(fine: Level) -> tuple[Estimate, float]:
        nonlocal found, error, finer
        change = pursuit.report["fibres_error"] = max(relative_distance(fine, rough), lasting)
        enough = not kept and pursuit.accuracy(fine, found, error + change)["achieved"]
        # before the level is written, so that its file lists the check
        if enough and finer is None and relative_distance(fine, level) > MOVED * pursuit.wanted:
            finer, error = fine_enough(pursuit, fine, error, "fewer fibres")
            if finer is not fine:
                found = Estimate(None, None, None, False, "meshes differ more with more fibres")
        return found, error + change

    while True:
        count *= 2
        fine = pursuit.solve_as_result(replace(rough.setting, fibres=count), why.format(count), estimate_of)
        if fine.answer is None or rough.answer is None or pursuit.outcome is None:
            pursuit.report.pop("fibres_error", None)
            return pursuit.accuracy(rough, found, error) | {
                "achieved": False, "note": f"the number of fibres is not judged, as {count} fail"}
        if finer is not None and finer is not fine:
            return _accuracy_of(pursuit, finer, found, error + pursuit.report["fibres_error"])
        accuracy = pursuit.outcome.summary["accuracy"] | kept
        if kept or accuracy["achieved"]:
            return accuracy
        if 2 * count > MOST or 2 * fine.work > MOST_WORK:
            return accuracy | {"note": "more fibres would be needed"}
        rough, lasting = fine, FADING * pursuit.report["fibres_error"]


def _accuracy_of(pursuit: Pursuit, level: Level, found: Estimate, error: float) -> dict[str, Any]:
    """Write a level as the result, with this estimate and error; return its accuracy."""
    pursuit.resolve_as_result(level, lambda level: (found, error))
    return pursuit.accuracy(level, found, error)
