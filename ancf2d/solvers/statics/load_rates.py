"""Derivatives by the load factor at 0 along the linear response, and how large a step they are formed with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ..ldl import Symmetric
from ..small_motions.lowest_modes import Pencil
from ..system import System

# half the difference in the load factor that rates are formed with
SMALL = 1e-4
# rotation or strain of the states between which the tangent is differentiated
STEP = 1e-3
# share of a step at which one-sided springs are seen to act, and of what they would bear if all motion strained them
NEAR, EDGE = 1e-2, 1e-3
# points and weights (over 12 steps) of derivatives by the load factor; forward from where tendons begin to pull
CENTRAL = ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0))
FORWARD = ((0, -25.0), (1, 48.0), (2, -36.0), (3, 16.0), (4, -3.0))


def response_size(pencil: Pencil, u: Array) -> float:
    """Return the rotation or strain that a response u (n_full,) is."""
    model = pencil.model
    turned = np.concatenate([mesh.gradients for mesh in model.meshes.values()])
    moved = pencil.system.norm(u[model.numbering.free]) / model.extent
    return max(moved, float((turned * np.abs(u[:model.n_q])).max(initial=0.0)))


def step_of(model: Model, size: float) -> float:
    """Return the step of the load factor that rotates or strains the model, or what winds tendons up, by ``STEP``.

    ``size`` is that of the linear response.
    """
    whole = max([size, *(getattr(spring, "winds", 0.0) for spring in model.springs)])
    return STEP / whole if whole else 1.0


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


def _one_sided(model: Model) -> Iterator[tuple[str, Any]]:
    """Yield springs and elastic tendons that act on one side alone, with where they stand in the case."""
    for (k, item), spring in zip(model.case.resting_springs.items(), model.springs, strict=False):
        if item.breaks:
            yield f"springs.{k}", spring
    tendons = [k for k, item in enumerate(model.case.loads) if getattr(item, "stiffness", None) is not None]
    yield from ((f"loads.{k}", tendon) for k, tendon in zip(tendons, model.loads.springs, strict=True))


def points_of(model: Model) -> Sequence[tuple[int, float]]:
    """Return points and weights of derivatives by the load factor at 0, where tendons that it winds up have a kink."""
    return FORWARD if any(batch.signals for batch in model.interactions.springs) else CENTRAL


def residual_rate(pencil: Pencil) -> Array:
    """Return dR/dt (n,) at fixed unknowns."""
    return sum(weight * pencil.system.forces(pencil.d, k * SMALL).R
               for k, weight in points_of(pencil.model)) / (12 * SMALL)


def tangent_rate(pencil: Pencil, u: Array, h: float) -> Array:
    """Return dK/dt along the response u, as values in the tangent's storage, by differences of fourth order.

    At a distance h that is a small rotation and strain: the truncation is its fourth power, round-off 1e-13 of K.
    The rows of constraints have no part in it: K is reduced to what constraints leave free along vectors that are
    K-orthogonal to what they hold, and in these their turning is of second order.
    """
    system = System(pencil.model)
    system.count_from(pencil.system.turns())
    out = np.zeros_like(pencil.K)
    for k, weight in points_of(pencil.model):
        system.assemble(pencil.d + k * h * u, k * h)
        out += weight / (12 * h) * system.matrix.target.values
    if isinstance(system.matrix, Symmetric):
        system.matrix.drop_multipliers(out)
    return out
