"""Reasons why a motion (``stepping.Stepper``) cannot go on: undefined values, joints off their bodies, failed steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.contact_geometry import PLACEMENT, SUPPORTED
from ...errors import ComputationError
from ...interactions.contact import ContactPoint
from ...interactions.prismatic import OnAxis
from ...kernels.motion.dynamics import signals_at
from ...kernels.motion.state import (
    COUNT,
    INTO_SUPPORTS,
    NOT_FINITE,
    OLD_STEP,
    SINGULAR,
    STEP_SIZE,
    UNBOUNDED,
    fill_full,
)
from ...kernels.motion.work import SECOND_ORDER_ERROR
from ...kernels.sliding import sliding_check
from ...model.point_patch import check_facing
from ..active_set import blocked_error, driven_points
from ..state import Row

# multiple of a model's size; farther away, round-off of positions hides the strains
FAR = 1e9
# share of a model's size: points nearer than this to an obstacle count as touching in a failed motion
NEAR = 1e-6


# these functions describe states that overflow: silence numpy's own warnings
@np.errstate(all="ignore")
def check_signals(motion: Any, t: float) -> None:
    """Raise a ComputationError if an expression has no value at t."""
    for signal in motion.signals:
        if not signal.feedback:
            signal(t)
    motion.feedback.check(t - motion.t)


def check_joints(motion: Any, row: Row) -> None:
    """Raise ComputationError if a joint has lost its meaning: a point off its body, a section turned inside out."""
    if not motion.facing and not len(motion.p.sliding.multiplier):
        return
    p, d = motion.problem_at(row), np.zeros(len(motion.p.place))
    signals_at(p, row.side, motion.w.amps)
    fill_full(p, row.z, motion.w.amps, 0, d)
    check_facing(motion.facing, d, row.side)
    bad = sliding_check(p.sliding, d) if len(p.sliding.multiplier) else -1
    if bad >= 0:
        raise [c for c in motion.model.constraints if isinstance(c, OnAxis)][bad].lost(t=row.t)


def cut_off(motion: Any, found: list[Row]) -> None:
    """Drop states from the first one on in which a joint has lost its meaning, and let the motion fail there."""
    # only stored states and the last one: the other ends of calls depend on the clock
    for k, row in enumerate([*found, motion.current_row()] if motion.done else found):
        try:
            check_joints(motion, row)
        except ComputationError as error:
            motion.failed, found[k:] = error, []
            return


def fastest(motion: Any) -> float:
    """Return the rate [m/s] at which a motion would cover FAR times the model's size within the time of the case."""
    return FAR * float(motion.p.extent) / float(motion.model.case.solver.t_end)


@np.errstate(all="ignore")
def failure(motion: Any, outcome: int) -> ComputationError:
    """Return the error for a step that could not be made."""
    h = float(motion.s.numbers[STEP_SIZE])
    at: dict[str, Any] = {"t": float(f"{motion.t:.9g}"), "step": int(motion.s.numbers[COUNT]) + 1,
                          "dt": float(f"{h:.3g}")}
    # steps shrink to round-off before a time from which an expression has no value
    check_signals(motion, motion.t + max(h, 1e-6 * motion.spec.t_end))
    check_joints(motion, motion.current_row())
    weights = motion.p.weights
    worst = int(np.argmax(np.where(np.isfinite(motion.w.x), weights * np.abs(motion.w.x), np.inf)))
    if motion.p.full[worst] < motion.model.n_q:
        at["coordinate"] = motion.model.describe_coordinate(int(motion.p.full[worst]))
    far = motion.largest_displacement / float(motion.p.extent)
    if far > FAR or outcome == UNBOUNDED:
        how = f"it has gone {far:.2g} times as far as the model is large" if far > FAR else \
            f"it has become faster than {fastest(motion):.2g} {motion.model.case.units.labels[0]}/" \
            f"{motion.model.case.units.labels[2]}"
        return ComputationError(
            f"the motion grows without bound: {how}", at=at,
            advice="look at what feeds it: a controller or a load that depends on the motion and makes it unstable, or "
            "constants that are far too large")
    near = _driven_near(motion)
    if outcome == INTO_SUPPORTS or near:
        return _blocked(motion, at, near)
    reason = {NOT_FINITE: "the forces are no longer finite",
              SINGULAR: "the matrix of a step is singular"}.get(outcome, "Newton's method did not converge")
    return ComputationError(
        f"{reason}, however small the step", at=at, history=[float(x) for x in motion.w.history if x != 0.0],
        advice=f"{other_method(motion)}{_larger_tolerance(motion, outcome)}look at the last states: an element may be "
        "inverted, or the mechanism may be in a singular position. Smaller steps before it, or a smaller tolerance, "
        "may help")


def other_method(motion: Any) -> str:
    """Return the advice to locate contacts by Radau's method where these are without friction, or none."""
    hard = [pair for pair in motion.model.contacts if pair.hard]
    if not hard or any(pair.item.friction for pair in hard) or motion.method.order > SECOND_ORDER_ERROR:
        return ""
    return "use method radau5, whose steps end where contacts open and close, or a law for the contact; else "


def _larger_tolerance(motion: Any, outcome: int) -> str:
    """Return the advice to take a larger tolerance where the integral of a controller may stop at a limit, or none."""
    if not motion.p.feedback.bounded or motion.dt > 0.0 or outcome in (NOT_FINITE, SINGULAR):
        return ""
    return "use a larger tolerance, since a controller that reaches its limit in a step can prevent convergence; else "


def _driven_near(motion: Any) -> list[tuple[Any, int]]:
    """Return the contact points (pair, number) moved by supports alone that have reached an obstacle without a law.

    The motion fails once sections can no longer yield by turning about such points.
    """
    p, d = motion.p, np.zeros(len(motion.p.place))
    signals_at(p, motion.t, motion.w.amps)
    fill_full(p, motion.s.z, motion.w.amps, 0, d)
    return driven_points(motion.model, d, motion.t, -NEAR * float(p.extent))


def _blocked(motion: Any, at: dict[str, Any], near: list[tuple[Any, int]]) -> ComputationError:
    """Return the error for supports or joints that press a body into its obstacles."""
    model, mem = motion.model, motion.p.points.mem
    into = [(p.pair, p.number)
            for p, rows in zip(model.interactions.points, model.interactions.rows, strict=True)
            if isinstance(p, ContactPoint) and (mem[rows, PLACEMENT] == SUPPORTED).any()]
    at.pop("coordinate", None)
    return blocked_error(into or near, at)


@np.errstate(all="ignore")
def stuck(motion: Any, message: str | None) -> ComputationError:
    """Return the error for a step that SciPy could not make."""
    beyond = max(float(motion.s.numbers[OLD_STEP]), 1e-6 * motion.spec.t_end)
    for t in (motion.t, motion.t + beyond):
        check_signals(motion, t)
    check_joints(motion, motion.current_row())
    reason = message or "the motion is no longer finite"
    return ComputationError(
        f"{motion.method.name}: {reason.rstrip('.').lower()}", at={"t": float(f"{motion.t:.9g}"),
                                                                "step": int(motion.s.numbers[COUNT]) + 1},
        advice="use method radau5, which takes longer steps in stiff motion, and look at the last states: an element "
        "may be inverted")
