"""Springs and tendons that act on one side alone, where a computation about one state cannot represent it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ..small_motions.lowest_modes import Pencil

# share of a step at which one-sided springs are seen to act, and of what they would bear if all motion strained them
NEAR, EDGE = 1e-2, 1e-3
# of a tension, the push that is round-off
SLACK = 1e-9


def check_edges(pencil: Pencil, u: Array, h: float) -> None:
    """Raise ComputationError where the response u (n_full,) does not take a one-sided spring from its edge to where it
    acts: the tangent takes it to act, and what buckles would move it either way. ``h`` is a step of the load factor.
    """
    model, d, step = pencil.model, pencil.d, NEAR * h
    for what, spring in _one_sided(model):
        moved = step * (spring.G @ u[spring.dofs[0]])
        at = spring.G @ d[spring.dofs[0]]
        f, H, _ = spring.forces(at.copy(), 0.0)
        due = EDGE * np.abs(H).max() * max(np.abs(moved).max(), step * getattr(spring, "winds", 0.0) * spring.rest)
        if H.any() and not f.any() and np.abs(spring.forces(at + moved, step)[0]).max() <= due:
            raise ComputationError(f"{what} acts on one side alone, and the loads do not make it act: its stiffness "
                                   "jumps where the model would buckle", at={"solver": "buckling"},
                                   advice="the model without it where it hangs loose; static with method: arc_length "
                                   "and a small imperfection where the model may buckle either way")


def check_taut(model: Model, d: Array) -> None:
    """Raise ComputationError where an elastic tendon would push, or begins to pull, in linear statics: d (n_full,)."""
    rest = np.zeros_like(d)
    for what, tendon in _tendons(model):
        before, linear, other = (tendon.linear_tension(one, 1.0) for one in (rest, d, -d))
        pushes = linear < -SLACK * max(abs(linear), abs(other))
        if pushes or before == linear == 0.0 < tendon.tension(d, 1.0):
            does = "would push" if pushes else "hangs loose in the reference and then pulls"
            raise ComputationError(f"{what} {does}, which linear statics cannot represent",
                                   at={"solver": "linear_static"}, advice="solver static")


def _tendons(model: Model) -> Iterator[tuple[str, Any]]:
    """Yield elastic tendons with where they stand in the case."""
    numbers = [k for k, item in enumerate(model.case.loads) if getattr(item, "stiffness", None) is not None]
    yield from ((f"loads.{k}", tendon) for k, tendon in zip(numbers, model.loads.springs, strict=True))


def _one_sided(model: Model) -> Iterator[tuple[str, Any]]:
    """Yield springs and elastic tendons that act on one side alone, with where they stand in the case."""
    for (k, item), spring in zip(model.case.resting_springs.items(), model.springs, strict=False):
        if item.breaks:
            yield f"springs.{k}", spring
    yield from _tendons(model)
