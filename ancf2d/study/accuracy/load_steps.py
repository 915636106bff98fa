"""Load steps to a wanted accuracy, for equilibria that depend on the path: with friction, or materials with memory."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ...case import Case
from ..order import Estimate
from .judging import apart
from .pursuit import MOST_ELEMENTS, MOST_WORK, Pursuit
from .setting import Level

# of the wanted error: smaller effects of load steps on the goal leave the estimate of meshes valid; and the least error
# assumed of a mesh twice as fine, as a share of the coarser one's
MOVED, FALLS = 0.2, 0.35


def follows_way(case: Case) -> bool:
    """Return whether a case has load steps to an equilibrium that depends on the path."""
    return case.solver.takes_guess and (any(contact.friction > 0.0 for contact in case.contacts) or any(
        material.non_hookean for body in case.bodies.values() for material in body.materials))


def in_steps(pursuit: Pursuit, rough: Level, error: float, found: Estimate) -> dict[str, Any]:
    """Solve the chosen mesh with steps half as long, until that hardly changes the goal; return its accuracy.

    Errors of steps are of first order: that of the shorter ones is the difference. At least half the error of the
    longer ones is assumed, since points that stick or slip alike by accident in both runs hide the difference; the
    error of the first run comes from steps twice as long. If shorter steps have changed the goal, a mesh twice as fine
    shows whether the mesh error is still the one found with long steps.
    """
    from ...solvers.statics.static import STEPS

    def told(level: Level) -> tuple[Estimate, float]:
        pursuit.report["steps_error"] = max(apart(level, rough), 0.5 * before)
        return found, error + pursuit.report["steps_error"]

    def with_longer(level: Level, steps: int) -> float:
        longer = pursuit.solve(replace(level.setting, steps=max(steps // 2, 1)), "effect of the load steps")
        return 0.0 if longer.answer is None else apart(longer, level)

    steps = getattr(pursuit.loaded.case.solver, "steps", None) or STEPS
    known, before = rough, with_longer(rough, steps)
    while True:
        steps *= 2
        fine = pursuit.whole(replace(rough.setting, steps=steps), "effect of the load steps", told)
        if fine.answer is None:
            pursuit.report.pop("steps_error", None)
            return pursuit.accuracy(rough, found, error) | {
                "achieved": False, "note": f"the load steps are not judged, as {steps} of them fail"}
        accuracy = pursuit.accuracy(fine, *told(fine))
        if error <= pursuit.wanted and apart(fine, known) > MOVED * pursuit.wanted:
            finer, error = _refined(pursuit, fine, error)
            known = finer
            if finer is not fine:
                found = Estimate(None, None, None, False, "meshes differ more with shorter load steps")
                rough, before = finer, with_longer(finer, steps)
                continue
        if accuracy["achieved"] or error > pursuit.wanted:
            return accuracy
        if 2 * fine.work > MOST_WORK:
            return accuracy | {"note": "the load steps needed would take too long"}
        rough, before = fine, pursuit.report["steps_error"]


def _refined(pursuit: Pursuit, level: Level, error: float) -> tuple[Level, float]:
    """Return a level, or a finer mesh with its load steps whose error is small enough, and its error.

    Returns the level itself if a mesh twice as fine differs by no more than its ``error``, and the finest mesh if none
    is good enough. The error of a mesh is its difference from that half as fine, or a share of that one's error if
    larger.
    """
    coarse, told = level, 0.0
    while True:
        counts = {name: 2 * n for name, n in coarse.setting.counts.items()}
        fine = pursuit.solve(replace(coarse.setting, counts=counts), "whether meshes differ as with longer load steps")
        moved = apart(fine, coarse)
        if coarse is level and (fine.answer is None or moved <= error):
            return level, error
        if fine.answer is None:
            return coarse, told
        coarse, told = fine, max(moved, FALLS * told)
        work = 4 * fine.work > MOST_WORK or 2 * sum(counts.values()) > MOST_ELEMENTS
        if work or told <= (1.0 - MOVED) * pursuit.wanted:
            return fine, told
