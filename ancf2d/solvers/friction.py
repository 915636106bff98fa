"""Coulomb friction of contact without a law in statics: which closed points stick and which slide.

A point that sticks is held to a place on the obstacle by a spring so stiff that its slip counts as none. One that
slides bears the friction coefficient times its normal force, against the slip since the last accepted state. Between
equilibria what sticks beyond its limit begins to slide, and what slides along its friction sticks (the return mapping
of plasticity; Wriggers, Computational Contact Mechanics, 2006, section 5.2).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements.contact_geometry import FREE, FRICTION, HELD, SLIDES, SLIDING, STICK, STICKS
from ..elements.shape import Array
from ..errors import ComputationError

if TYPE_CHECKING:
    from ..model.contact_tables import ContactTable

# what friction may exceed its limit by, beside the largest limit, and slip beside the extent of the scene that is none
EXCESS, NO_SLIP = 1e-9, 1e-14


def hold(one: ContactTable, which: Iterable[int], d: Array, accepted: tuple[Array, float], t: float) -> None:
    """Let friction hold points that close at d (n_full,) to where on the obstacle they were in the accepted state.

    Raises ComputationError at a corner.
    """
    before, now = one.stand(*accepted)[1], one.stand(d, t)[1]
    for k in which:
        point = one.points[k]
        if point.mem[HELD] > 0.0 and point.mem[FREE] == SLIDING:
            raise ComputationError(f"{one.pair.name}: a body slides over a corner of {one.pair.other}, where friction "
                                   "without a contact law is undefined", at={"factor": float(f"{t:.6g}")},
                                   advice="a circle in place of the corner, or a contact law")
        # what was opposite to nothing is held to where it closes
        one.anchor(k, now[k] if np.isnan(before[k]).any() else before[k])
        point.mem[SLIDES], way = STICKS, one.slip(k, now[k], before[k])
        if abs(way) > NO_SLIP * point.scale and abs(way) * point.par[STICK] > _limit(point, d):
            point.mem[SLIDES] = -np.sign(way)


def _limit(point: Any, d: Array) -> float:
    return float(point.par[FRICTION] * max(-d[point.multiplier], 0.0))


def rub(one: ContactTable, d: Array, t: float, accepted: tuple[Array, float]) -> int:
    """Let points that stick beyond their limit at an equilibrium d (n_full,) slide, and those stick that slide along
    their friction; return how many."""
    before, now = one.stand(*accepted)[1], one.stand(d, t)[1]
    closed = [k for k, p in enumerate(one.points) if p.mem[HELD] > 0.0]
    largest = max((_limit(one.points[k], d) for k in closed), default=0.0)
    changed = 0
    for k in closed:
        point = one.points[k]
        if point.mem[SLIDES] == STICKS:
            way = one.slip(k, now[k], one.anchor(k))
            if point.par[STICK] * abs(way) > _limit(point, d) + EXCESS * largest:
                point.mem[SLIDES] = -np.sign(way)
                changed += 1
        elif one.slip(k, now[k], before[k]) * point.mem[SLIDES] > NO_SLIP * point.scale:
            point.mem[SLIDES] = STICKS
            changed += 1
    return changed
