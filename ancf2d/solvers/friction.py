"""Coulomb friction of contact without a law in statics: which closed points stick and which slide.

A spring so stiff that its slip is negligible holds a sticking point to a place on the obstacle. A sliding point bears
the friction coefficient times its normal force, against the slip since the last accepted state. Between equilibria,
sticking points beyond their limit start to slide, and sliding points that move with their friction force stick (return
mapping as in plasticity; Wriggers, Computational Contact Mechanics, 2006, section 5.2).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements.contact_geometry import FRICTION, PLACEMENT, SLIDING, SLIP_STATUS, STATUS, STICK, STICKS
from ..elements.shape import Array
from ..errors import ComputationError

if TYPE_CHECKING:
    from ..model.contact_tables import ContactTable

# tolerance of the friction limit, relative to the largest limit; slip, relative to the scene's extent, that is none
EXCESS, NO_SLIP = 1e-9, 1e-14


def anchor_points(one: ContactTable, which: Iterable[int], d: Array, accepted: tuple[Array, float], t: float) -> None:
    """Anchor points that close at d (n_full,) to their places on the obstacle in the accepted state.

    Raises ComputationError at a corner.
    """
    before, now = one.gaps_and_places(*accepted)[1], one.gaps_and_places(d, t)[1]
    for k in which:
        point = one.points[k]
        if point.mem[STATUS] > 0.0 and point.mem[PLACEMENT] == SLIDING:
            raise ComputationError(f"{one.pair.name}: a body slides over a corner of {one.pair.other}, where friction "
                                   "without a contact law is undefined", at={"factor": float(f"{t:.6g}")},
                                   advice="a circle in place of the corner, or a contact law")
        # a point with nothing opposite before is anchored where it closes
        one.anchor(k, now[k] if np.isnan(before[k]).any() else before[k])
        point.mem[SLIP_STATUS], slip = STICKS, one.slip(k, now[k], before[k])
        if abs(slip) > NO_SLIP * point.scale and abs(slip) * point.par[STICK] > _coulomb_limit(point, d):
            point.mem[SLIP_STATUS] = -np.sign(slip)


def _coulomb_limit(point: Any, d: Array) -> float:
    return float(point.par[FRICTION] * max(-d[point.multiplier], 0.0))


def wrong_states(one: ContactTable, d: Array, t: float) -> dict[int, float]:
    """Return the closed points that stick beyond their limit at an equilibrium d (n_full,), or slide with their
    friction force, and their right friction state."""
    now = one.gaps_and_places(d, t)[1]
    closed = np.flatnonzero(one.memory[:, STATUS] > 0.0).tolist()
    largest = max((_coulomb_limit(one.points[k], d) for k in closed), default=0.0)
    out: dict[int, float] = {}
    for k in closed:
        point, slip = one.points[k], one.slip(k, now[k], one.anchor(k))
        if point.mem[SLIP_STATUS] == STICKS:
            if point.par[STICK] * abs(slip) > _coulomb_limit(point, d) + EXCESS * largest:
                out[k] = -float(np.sign(slip))
        elif slip * point.mem[SLIP_STATUS] + _coulomb_limit(point, d) / point.par[STICK] > NO_SLIP * point.scale:
            out[k] = STICKS
    return out


def set_friction_states(one: ContactTable, to: dict[int, float]) -> int:
    """Set the friction state of points: sliding with a sign, or sticking; return how many change."""
    changed = sum(one.points[k].mem[SLIP_STATUS] != state for k, state in to.items())
    for k, state in to.items():
        one.points[k].mem[SLIP_STATUS] = state
    return changed


def _sliding(one: ContactTable) -> list[int]:
    mem = one.memory
    return np.flatnonzero((mem[:, STATUS] > 0.0) & (mem[:, SLIP_STATUS] != STICKS)).tolist()


def _stick(one: ContactTable, k: int, now: Any, d: Array) -> None:
    """Let a sliding point stick at its place, with the friction force that it has."""
    point = one.points[k]
    one.anchor(k, one.place_at_distance(now, point.mem[SLIP_STATUS] * _coulomb_limit(point, d) / point.par[STICK]))
    point.mem[SLIP_STATUS] = STICKS


def stick_least_slipping(tables: Iterable[ContactTable], d: Array, t: float, accepted: tuple[Array, float]) -> bool:
    """Let the sliding point with the least slip up to d (n_full,) stick; return whether there is one.

    If all touching points slide and nothing else holds a body, no force resists its rigid motion. Friction of two
    points may hold it in many places; in this one it has moved least.
    """
    slid = []
    for one in tables:
        if one.pair.hard and one.pair.item.friction:
            before, now = one.gaps_and_places(*accepted)[1], one.gaps_and_places(d, t)[1]
            slid += [(abs(one.slip(k, now[k], before[k])), one, k, now[k]) for k in _sliding(one)]
    if not slid:
        return False
    *_, one, k, place = min(slid, key=lambda found: found[0])
    _stick(one, k, place, d)
    return True


@contextmanager
def sticking(tables: Iterable[ContactTable], d: Array, t: float) -> Iterator[None]:
    """Let the points that slide at d (n_full,) stick within this context, with the friction forces that they have.

    The tangent is then that of a stable state, whereas sliding friction would push a body further on.
    """
    saved = []
    for one in tables:
        if one.pair.hard and one.pair.item.friction and (sliding := _sliding(one)):
            now = one.gaps_and_places(d, t)[1]
            for k in sliding:
                saved.append((one.points[k].mem, one.points[k].mem.copy()))
                _stick(one, k, now[k], d)
    try:
        yield
    finally:
        for mem, before in saved:
            mem[:] = before
