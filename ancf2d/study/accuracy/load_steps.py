"""Load steps to a wanted accuracy, where an equilibrium depends on the way to it: where bodies rub or remember."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ...case import Case
from ..order import Estimate
from .pursuit import MOST_WORK, Pursuit, apart
from .setting import Level


def follows_way(case: Case) -> bool:
    """Return whether load steps that a case has lead to an equilibrium that depends on them."""
    return case.solver.takes_guess and (any(contact.friction > 0.0 for contact in case.contacts) or any(
        material.remembers for body in case.bodies.values() for material in body.materials))


def in_steps(pursuit: Pursuit, rough: Level, error: float, found: Estimate) -> dict[str, Any]:
    """Solve the mesh that was chosen with steps half as long, until that moves the goal little; return its accuracy.

    Errors of steps are of first order: that of the shorter ones is the difference. It is no less than half of that of
    the longer ones, since points that stick or slip by chance alike in both move nothing; steps twice as long tell that
    of the first.
    """
    from ...solvers.statics.static import STEPS

    def told(level: Level) -> tuple[Estimate, float]:
        pursuit.report["steps_error"] = max(apart(level, rough), 0.5 * before)
        return found, error + pursuit.report["steps_error"]

    steps = getattr(pursuit.loaded.case.solver, "steps", None) or STEPS
    longer = pursuit.solve(replace(rough.setting, steps=max(steps // 2, 1)), "effect of the load steps")
    before = 0.0 if longer.answer is None else apart(longer, rough)
    while True:
        steps *= 2
        fine = pursuit.whole(replace(rough.setting, steps=steps), "effect of the load steps", told)
        if fine.answer is None:
            pursuit.report.pop("steps_error", None)
            return pursuit.accuracy(rough, found, error) | {
                "achieved": False, "note": f"the load steps are not judged, as {steps} of them fail"}
        accuracy = pursuit.accuracy(fine, *told(fine))
        if accuracy["achieved"] or error > pursuit.wanted:
            return accuracy
        if 2 * fine.work > MOST_WORK:
            return accuracy | {"note": "the load steps needed would take too long"}
        rough, before = fine, pursuit.report["steps_error"]
