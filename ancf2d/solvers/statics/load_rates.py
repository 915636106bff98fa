"""Derivatives by the load factor at 0 along the linear response, and how large a step they are formed with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...elements.shape import Array
from ...model.model import Model
from ..ldl import Symmetric
from ..small_motions.lowest_modes import Pencil
from ..system import System
from .one_sided import check_edges, one_sided, step_before

# half the difference in the load factor that rates are formed with
SMALL = 1e-4
# rotation or strain of the states between which the tangent is differentiated
STEP = 1e-3
# points and weights (over 12 steps) of derivatives by the load factor; forward from where something begins to act
CENTRAL = ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0))
FORWARD = ((0, -25.0), (1, 48.0), (2, -36.0), (3, 16.0), (4, -3.0))


def response_size(pencil: Pencil, u: Array) -> float:
    """Return the rotation or strain that a response u (n_full,) is."""
    model = pencil.model
    turned = np.concatenate([mesh.gradients for mesh in model.meshes.values()])
    moved = pencil.system.norm(u[model.numbering.free]) / model.extent
    return max(moved, float((turned * np.abs(u[:model.n_q])).max(initial=0.0)))


def step_of(pencil: Pencil, u: Array, size: float) -> float:
    """Return the step of the load factor that rotates or strains the model, or what winds tendons up, by ``STEP``.

    It is shorter where one-sided springs would begin or cease to act within the steps of a difference. ``size`` is that
    of the linear response u (n_full,). Raises ComputationError where a spring is at its edge, and u keeps it there.
    """
    whole = max([size, *(getattr(spring, "winds", 0.0) for spring in pencil.model.springs)])
    h = STEP / whole if whole else 1.0
    check_edges(pencil, u, h)
    return step_before(pencil, u, h, max(k for k, _ in points_of(pencil.model)))


def points_of(model: Model) -> Sequence[tuple[int, float]]:
    """Return points and weights of derivatives by the load factor at 0, forward where springs or tendons may have a
    kink there.
    """
    kinks = any(batch.signals for batch in model.interactions.springs) or any(one_sided(model))
    return FORWARD if kinks else CENTRAL


def residual_rate(pencil: Pencil) -> tuple[Array, bool]:
    """Return dR/dt (n,) at fixed unknowns, and whether any force changes with t, if only where supports hold.

    Where nothing has a kink, forces are linear in the load factor: two points tell the rate.
    """
    points = points_of(pencil.model)
    points = points if points is FORWARD else ((1, 6.0), (-1, -6.0))
    found = [pencil.system.forces(pencil.d, k * SMALL) for k, _ in points]
    out = np.sum([weight / (12 * SMALL) * at.R for (_, weight), at in zip(points, found, strict=True)], axis=0)
    changes = not all(np.array_equal(at.F, found[0].F) and np.array_equal(at.Q, found[0].Q) for at in found)
    return np.asarray(out), changes


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
