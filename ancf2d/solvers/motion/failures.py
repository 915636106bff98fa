"""Why a motion (``stepping.Stepper``) cannot go on: undefined values, joints without a meaning, failed steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.contact_geometry import FREE, SUPPORTED
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
from ...kernels.sliding import sliding_check
from ...model.point_patch import check_facing
from ..active_set import blocked, driven_into
from ..state import Row

# of the size of a model: further away, strains are lost in round-off of positions
FAR = 1e9
# the same: what touches, where a motion cannot go on
NEAR = 1e-6


# what is told below is of states that overflow: numpy need not tell it, too
@np.errstate(all="ignore")
def check_signals(motion: Any, t: float) -> None:
    """Raise the ComputationError of an expression that has no value at t."""
    for signal in motion.signals:
        if not signal.fed:
            signal(t)
    motion.answers.check(t - motion.t)


def check_joints(motion: Any, row: Row) -> None:
    """Raise where joints are met by what they do not mean: a point off its body, a section turned inside out."""
    if not motion.facing and not len(motion.p.sliding.multiplier):
        return
    p, d = motion.at_row(row), np.zeros(len(motion.p.place))
    signals_at(p, row.side, motion.w.amps)
    fill_full(p, row.z, motion.w.amps, 0, d)
    check_facing(motion.facing, d, row.side)
    bad = sliding_check(p.sliding, d) if len(p.sliding.multiplier) else -1
    if bad >= 0:
        raise [c for c in motion.model.constraints if isinstance(c, OnAxis)][bad].lost(t=row.t)


def fastest(motion: Any) -> float:
    """Return the rate [m/s] at which a motion would go FAR in the time of its case; none is meant to."""
    return FAR * float(motion.p.extent) / float(motion.model.case.solver.t_end)


@np.errstate(all="ignore")
def failure(motion: Any, outcome: int) -> ComputationError:
    """Return what to say of a step that could not be made."""
    h = float(motion.s.numbers[STEP_SIZE])
    at: dict[str, Any] = {"t": float(f"{motion.t:.9g}"), "step": int(motion.s.numbers[COUNT]) + 1,
                          "dt": float(f"{h:.3g}")}
    # steps end by round-off beside a time from which on there is no value
    check_signals(motion, motion.t + max(h, 1e-6 * motion.spec.t_end))
    check_joints(motion, motion.here())
    weights = motion.p.weights
    worst = int(np.argmax(np.where(np.isfinite(motion.w.x), weights * np.abs(motion.w.x), np.inf)))
    if motion.p.full[worst] < motion.model.n_q:
        at["coordinate"] = motion.model.describe_coordinate(int(motion.p.full[worst]))
    far = motion.reached / float(motion.p.extent)
    if far > FAR or outcome == UNBOUNDED:
        how = f"it has gone {far:.2g} times as far as the model is large" if far > FAR else \
            f"it has become faster than {fastest(motion):.2g} {motion.model.case.units.labels[0]}/" \
            f"{motion.model.case.units.labels[2]}"
        return ComputationError(
            f"the motion grows without bound: {how}", at=at,
            advice="look at what feeds it: a controller or a load that answers the motion and makes it unstable, or "
            "constants that are far too large")
    near = _driven_near(motion)
    if outcome == INTO_SUPPORTS or near:
        return _blocked(motion, at, near)
    reason = {NOT_FINITE: "the forces are no longer finite",
              SINGULAR: "the matrix of a step is singular"}.get(outcome, "Newton's method did not converge")
    return ComputationError(
        f"{reason}, however small the step", at=at, history=[float(x) for x in motion.w.history if x != 0.0],
        advice="look at the last states: an element may be inverted, or the mechanism may be in a singular position. "
        "Smaller steps before it, or a smaller tolerance, may help")


def _driven_near(motion: Any) -> list[tuple[Any, int]]:
    """Return the points that supports alone move, by pair and number, that have come to an obstacle without a law.

    Sections that turned about such points can give way no more.
    """
    p, d = motion.p, np.zeros(len(motion.p.place))
    signals_at(p, motion.t, motion.w.amps)
    fill_full(p, motion.s.z, motion.w.amps, 0, d)
    return driven_into(motion.model, d, motion.t, -NEAR * float(p.extent))


def _blocked(motion: Any, at: dict[str, Any], near: list[tuple[Any, int]]) -> ComputationError:
    """Return what to say where supports or joints hold a body in what it touches."""
    model, mem = motion.model, motion.p.points.mem
    into = [(p.pair, p.number)
            for p, rows in zip(model.interactions.points, model.interactions.rows, strict=True)
            if isinstance(p, ContactPoint) and (mem[rows, FREE] == SUPPORTED).any()]
    at.pop("coordinate", None)
    return blocked(into or near, at)


@np.errstate(all="ignore")
def stuck(motion: Any, message: str | None) -> ComputationError:
    """Return what to say of a step that SciPy could not make."""
    beyond = max(float(motion.s.numbers[OLD_STEP]), 1e-6 * motion.spec.t_end)
    for t in (motion.t, motion.t + beyond):
        check_signals(motion, t)
    check_joints(motion, motion.here())
    reason = message or "the motion is no longer finite"
    return ComputationError(
        f"{motion.method.name}: {reason.rstrip('.').lower()}", at={"t": float(f"{motion.t:.9g}"),
                                                                "step": int(motion.s.numbers[COUNT]) + 1},
        advice="use method radau5, which takes longer steps in stiff motion, and look at the last states: an element "
        "may be inverted")
