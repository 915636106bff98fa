"""Displacements of a model that count as none: round-off, and motion on the springs of sticking contact points."""

from __future__ import annotations

from ..model.model import Model

UNIT_ROUNDOFF = 2.0**-53
# displacements, relative to the extent of a model, that are round-off of the positions
STILL = 32 * UNIT_ROUNDOFF
# the same where stiff springs hold sticking contact points without a law
STUCK = 1e-8
# least displacement, relative to the extent, to which errors of a motion are relative, as at its start
LEAST = 1e-9


def sticks(model: Model) -> bool:
    """Return whether springs hold sticking contact points, as in friction without a law."""
    return any(pair.hard and pair.item.friction for pair in model.contacts)


def least_motion(model: Model) -> float:
    """Return the displacement [length] below which nothing counts as moved."""
    return (STUCK if sticks(model) else STILL) * model.extent


def least_size(model: Model, tolerance: float) -> float:
    """Return the least displacement [length] to which local errors of a motion are relative.

    Adaptive steps do not resolve the springs of sticking points; with fixed steps ``tolerance`` is 0.
    """
    vibrates = least_motion(model) / tolerance if tolerance > 0.0 and sticks(model) else 0.0
    return max(LEAST * model.extent, vibrates)
