"""Derivatives by the load factor at 0 along the linear response, and the steps of their differences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...elements.shape import Array
from ...model.model import Model
from ..ldl import Symmetric
from ..small_motions.lowest_modes import Pencil
from ..system import System
from .one_sided import check_not_engaging, one_sided, step_without_switching

# half the difference in the load factor for rates
SMALL = 1e-4
# rotation or strain between the states for the derivative of the tangent
STEP = 1e-3
# points and weights (over 12 steps) of derivatives by the load factor; forward if something engages at 0
CENTRAL = ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0))
FORWARD = ((0, -25.0), (1, 48.0), (2, -36.0), (3, 16.0), (4, -3.0))


def response_size(pencil: Pencil, u: Array) -> float:
    """Return the rotation or strain of a response u (n_full,)."""
    model = pencil.model
    moved = pencil.system.norm(u[model.numbering.free]) / model.extent
    return max(moved, *(mesh.largest_gradient(u) for mesh in model.meshes.values()))


def step_of(pencil: Pencil, u: Array, size: float) -> float:
    """Return the step of the load factor that rotates or strains the model, or winds up tendons, by ``STEP``.

    It is shorter if one-sided springs would engage or release within the difference. ``size`` is that of the linear
    response u (n_full,). Raises ComputationError if a spring is just about to engage and u keeps it there.
    """
    whole = max([size, *(getattr(spring, "winding_strain", 0.0) for spring in pencil.model.springs)])
    h = STEP / whole if whole else 1.0
    check_not_engaging(pencil, u, h)
    return step_without_switching(pencil, u, h, max(k for k, _ in points_of(pencil.model)))


def points_of(model: Model) -> Sequence[tuple[int, float]]:
    """Return points and weights of derivatives by the load factor at 0.

    They are forward differences if springs or tendons may have a kink there, else central ones.
    """
    kinks = any(batch.signals for batch in model.interactions.springs) or bool(one_sided(model))
    return FORWARD if kinks else CENTRAL


def residual_rate(pencil: Pencil) -> tuple[Array, bool]:
    """Return dR/dt (n,) at fixed unknowns, and whether any force (even one on a support) changes with t.

    Without kinks, forces are linear in the load factor, so that two points suffice.
    """
    points = points_of(pencil.model)
    points = points if points is FORWARD else ((1, 6.0), (-1, -6.0))
    found = [pencil.system.forces(pencil.d, k * SMALL) for k, _ in points]
    out = np.sum([weight / (12 * SMALL) * at.R for (_, weight), at in zip(points, found, strict=True)], axis=0)
    changes = not all(np.array_equal(at.F, found[0].F) and np.array_equal(at.Q, found[0].Q) for at in found)
    return np.asarray(out), changes


def tangent_rate(pencil: Pencil, u: Array, h: float) -> Array:
    """Return dK/dt along the response u, as values in the tangent's storage, by differences of fourth order.

    The step h is a small rotation and strain: the truncation error is its fourth power, round-off 1e-13 of K. The rows
    of constraints are left out: K is projected on the motions that constraints allow, along vectors that are
    K-orthogonal to the constrained motions, and there the rotation of the constraints has an effect of second order.
    """
    system = System(pencil.model, fixed=True)
    system.count_from(pencil.system.turns())
    out = np.zeros_like(pencil.K)
    for k, weight in points_of(pencil.model):
        system.assemble(pencil.d + k * h * u, k * h)
        out += weight / (12 * h) * system.matrix.target.values
    if isinstance(system.matrix, Symmetric):
        system.matrix.drop_multipliers(out)
    return out
