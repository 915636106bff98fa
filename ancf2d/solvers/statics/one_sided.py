"""One-sided springs and tendons where a computation about one state cannot represent them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ..small_motions.lowest_modes import Pencil

# share of a step at which one-sided springs must act, and share of the force, if all motion strained them, that they
# must have there
NEAR, EDGE = 1e-2, 1e-3
# compression relative to the tension that is round-off
SLACK = 1e-9
# share of a step below which it is not shortened for springs that engage or release
SHORTEST = 1e-6
# bisections that find where a spring begins to act
HALVINGS = 30


def check_not_engaging(pencil: Pencil, u: Array, h: float) -> None:
    """Raise ComputationError if a one-sided spring is about to engage and the response u (n_full,) does not engage it.

    The tangent contains its stiffness, but a buckling shape may move it either way. ``h`` is a step of the load factor.
    """
    model, d, step = pencil.model, pencil.d, NEAR * h
    for spring in one_sided(model):
        moved = step * (spring.G @ u[spring.dofs[0]])
        at = spring.G @ d[spring.dofs[0]]
        f, H, _ = spring.forces(at.copy(), 0.0)
        wound = step * getattr(spring, "winding_strain", 0.0) * spring.rest
        due = EDGE * np.abs(H).max() * max(np.abs(moved).max(), wound)
        if H.any() and not f.any() and np.abs(spring.forces(at + moved, step)[0]).max() <= due:
            raise ComputationError(f"{spring.path} acts on one side alone, and the loads do not make it act: its "
                                   "stiffness jumps where the model would buckle", at={"solver": "buckling"},
                                   advice="the model without it where it hangs loose; static with method: arc_length "
                                   "and a small imperfection where the model may buckle either way")


def step_without_switching(pencil: Pencil, u: Array, h: float, steps: int) -> float:
    """Return a step of the load factor, at most h, so that within ``steps`` of it no spring engages or releases.

    ``u`` (n_full,) is the linear response.
    """
    least = SHORTEST * h
    while h > least and any(switching_springs(pencil, u, k * h) for k in range(1, steps + 1)):
        h *= 0.5
    return h


def switching_springs(pencil: Pencil, u: Array, factor: float) -> list[str]:
    """Return the one-sided springs that engage or release between load factor 0 and ``factor``.

    ``u`` (n_full,) is the linear response.
    """
    return [spring.path for spring in one_sided(pencil.model)
            if _forces(spring, pencil.d, u, factor)[1].any() != _forces(spring, pencil.d, u, 0.0)[1].any()]


def neglected_work(pencil: Pencil, u: Array, factor: float, h: float) -> float:
    """Return the work that the linearisation neglects in one-sided springs, relative to that of the stiffness.

    It is the work on the response u (n_full,) of their forces at a load factor less their linear forces; ``h`` is a
    step in which none engages or releases.
    """
    work = 0.0
    for spring in one_sided(pencil.model):
        (at, *_), (step, *_), (rest, *_) = (_forces(spring, pencil.d, u, x) for x in (factor, h, 0.0))
        more = at - rest - factor / h * (step - rest)
        work += abs(float(more @ (spring.G @ u[spring.dofs[0]])))
    return work / abs(factor * float(u @ pencil.full_stiffness(u))) if work else 0.0


def _forces(spring: Any, d: Array, u: Array, factor: float) -> tuple[Array, Array]:
    """Return the forces of a spring and their derivatives at d + factor u (n_full,)."""
    f, H, _ = spring.forces(spring.G @ (d + factor * u)[spring.dofs[0]], factor)
    return f, H


def check_taut(model: Model, d: Array) -> None:
    """Raise ComputationError if an elastic tendon would push, or starts to pull, in linear statics at d (n_full,)."""
    rest = np.zeros_like(d)
    for tendon in model.loads.springs:
        before, linear, other = (tendon.linear_tension(one, 1.0) for one in (rest, d, -d))
        pushes = linear < -SLACK * max(abs(linear), abs(other))
        if pushes or before == linear == 0.0 < tendon.tension(d, 1.0):
            does = "would push" if pushes else "hangs loose in the reference and then pulls"
            raise ComputationError(f"{tendon.path} {does}, which linear statics cannot represent",
                                   at={"solver": "linear_static"}, advice="solver static")


def one_sided(model: Model) -> list[Any]:
    """Return the one-sided springs and elastic tendons of the case."""
    return [spring for spring in model.springs if spring.path and spring.breaks]


def springs_acting(model: Model, d: Array, t: float) -> list[Any]:
    """Return for each one-sided spring and elastic tendon whether it has stiffness at d (n_full,)."""
    return [spring.forces(spring.G @ d[spring.dofs[0]], t)[1].any(keepdims=True) for spring in one_sided(model)]


def share_without_switching(model: Model, a: tuple[Array, float], b: tuple[Array, float]) -> float:
    """Return the share of the straight way between two states (d, t) just after which a spring begins or ceases to act.

    1 if none does on the whole way.
    """
    def acting(x: float) -> list[bool]:
        d, t = a[0] + x * (b[0] - a[0]), a[1] + x * (b[1] - a[1])
        return [bool(one[0]) for one in springs_acting(model, d, t)]

    first, low, high = acting(0.0), 0.0, 1.0
    if acting(1.0) == first:
        return 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if acting(middle) == first else (low, middle)
    return high
