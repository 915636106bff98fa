"""Places along elements at which a body lifts off, where contact points between nodes slide to.

A point at z with the force p does not penetrate if its gap g + c(z) p is 0 (``elements.contact_sliding``). It is at the
right place if the beam is tangent to the surface there, sigma = g_z + c_z p/2 = 0, which maximises the energy of the
equilibrium. Between equilibria, all places of a scene take a Newton step for this condition; positions and forces
change with the places by the tangent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements.contact_geometry import (
    FEATURE,
    HALF_INTERVAL,
    HOME,
    ON_BEAM,
    ON_ELEMENT,
    PLACE,
    PLACEMENT,
    SLIDING,
    SLIP_STATUS,
    STATUS,
    UNUSED,
    UNUSED_ON_ELEMENT,
)
from ..elements.contact_sliding import compliance
from ..elements.shape import Array

if TYPE_CHECKING:
    from ..interactions.contact import ContactPoint
    from ..model.contact_tables import ContactTable
    from .system import System

# half the step in z for finite differences of gradients
DIFFERENCE = 1e-4
# change of z that counts as none; largest change at a time; tolerance at the end of an interval
STEP_TOLERANCE, LARGEST_STEP, END_TOLERANCE = 1e-5, 0.6, 1e-9
# share of the distance to a closed point that is left after a step; smallest remainder before that point opens
LEFT_SHARE, OPENING_SHARE = 0.2, 0.02
# least curvature in a Newton step, relative to that of the gap alone
LEAST_CURVATURE = 1e-3
# steps of Newton's method for the place of a point that slid during an equilibrium iteration
PLACE_STEPS = 4
# number of consecutive halved steps after which an end of a bracket is dropped
MAX_HALVED = 3


@dataclass
class Bracket:
    """The interval of possible places of a point, from its last steps; ``halved`` counts halved steps in a row."""

    z: float
    ends: list[float] = field(default_factory=lambda: [-math.inf, math.inf])
    halved: int = 0
    side: int = 0

    def step(self, step: float) -> float:
        """Return a step from z that stays in the bracket: half of the distance to an end that it would pass.

        An end is dropped if it is passed repeatedly or reached, as other points may have moved.
        """
        side = int(step > 0.0)
        self.ends[1 - side], self.halved, self.side = self.z, self.halved if side == self.side else 0, side
        room = abs(self.ends[side] - self.z)
        if abs(step) >= room > STEP_TOLERANCE and self.halved < MAX_HALVED:
            self.halved += 1
            return 0.5 * (self.ends[side] - self.z)
        self.halved = 0
        if abs(step) >= room:
            self.ends[side] = math.copysign(math.inf, step)
        return step


@dataclass
class PlaceHistory:
    """State of the movable contact points on the way to one equilibrium.

    ``left_zone`` are those that have left a contact zone or were opened, ``replaced`` those whose role a point of the
    next interval has taken over; ``brackets`` limit those that move.
    """

    left_zone: set[ContactPoint] = field(default_factory=set)
    replaced: set[ContactPoint] = field(default_factory=set)
    brackets: dict[ContactPoint, Bracket] = field(default_factory=dict)

    def limited(self, place: _LiftOffPlace, step: float) -> float:
        """Return the step of a place, limited by its bracket.

        Slopes jump as other points open and close, so that Newton's method might cycle.
        """
        bracket = self.brackets.get(place.point)
        if bracket is None or bracket.z != place.z:
            bracket = self.brackets[place.point] = Bracket(place.z)
        return bracket.step(step)


def place_point(one: ContactTable, k: int, place: float, feature: float) -> None:
    """Put point k at z = ``place`` of its element, opposite to a part (``feature``) of the obstacle."""
    mem = one.points[k].mem
    mem[PLACEMENT], mem[PLACE], mem[FEATURE] = one.placement_at(k, feature), place, feature


def open_point(point: ContactPoint, d: Array) -> None:
    """Open a point, with zero force."""
    point.mem[STATUS], d[point.multiplier] = 0.0, 0.0
    if point.mem[PLACEMENT] > 0.0:
        point.mem[PLACEMENT] = UNUSED_ON_ELEMENT if point.mem[PLACEMENT] == ON_ELEMENT else UNUSED


def closed_points(one: ContactTable) -> Any:
    """Return which points of a contact are closed (m,)."""
    return one.memory[:, STATUS] > 0.0


def choose_curves(one: ContactTable, history: PlaceHistory) -> int:
    """Set the curve of movable points: the element's own inside a contact zone, elsewhere the beam's; return how many
    closed ones have left the zone, and add them to ``history.left_zone``."""
    inside, before = one.inside_zone(closed_points(one)), len(history.left_zone)
    for k in np.flatnonzero(one.free).tolist():
        mem = one.points[k].mem
        if mem[PLACEMENT] < 0.0:
            # a point that has left the zone does not join it again
            own = inside[k] and one.pair.cubic and one.points[k] not in history.left_zone
            mem[PLACEMENT] = UNUSED_ON_ELEMENT if own else UNUSED
        elif mem[PLACEMENT] == ON_ELEMENT and not inside[k]:
            mem[PLACEMENT] = ON_BEAM
            history.left_zone.add(one.points[k])
    return len(history.left_zone) - before


def _newly_inside(one: ContactTable, history: PlaceHistory) -> list[int]:
    """Return the closed points on the beam's curve now inside a contact zone, except those in ``history.left_zone``."""
    closed = closed_points(one)
    inside = one.inside_zone(closed) & closed & one.pair.cubic
    return [k for k in np.flatnonzero(inside).tolist()
            if one.points[k].mem[PLACEMENT] == ON_BEAM and one.points[k] not in history.left_zone]


def move_inside_zone(one: ContactTable, history: PlaceHistory) -> int:
    """Move closed points that are now inside a contact zone to the element's own curve; return how many."""
    found = _newly_inside(one, history)
    for k in found:
        one.points[k].mem[PLACEMENT] = ON_ELEMENT
    return len(found)


def open_beside_fixed(one: ContactTable, d: Array, history: PlaceHistory) -> int:
    """Open movable points next to closed fixed ones where curves are not cubic; return how many.

    Points that close again, because the body would penetrate without them, stay: they are then in
    ``history.left_zone``.
    """
    opened = 0
    for k, point in enumerate(one.points if not one.pair.cubic else ()):
        standing = point.mem[STATUS] > 0.0 and point.mem[PLACEMENT] == ON_BEAM
        beside = any(j >= 0 and one.points[j].mem[STATUS] > 0.0 for j in one.ends[k])
        if standing and point not in history.left_zone and (beside or one.supported[k].any()):
            open_point(point, d)
            history.left_zone.add(point)
            opened += 1
    return opened


class _LiftOffPlace:
    """A movable point at z = ``z`` with its ``force``.

    ``gap_slope`` and ``gap_curvature`` are g_z and g_zz, ``gap_slope_gradient`` (n_full,) is g_qz; ``c1`` and ``c2``
    are derivatives of c.
    """

    def __init__(self, one: ContactTable, k: int, force: float, slope: float, curvature: float, gradient: Array
                 ) -> None:
        self.one, self.k, self.point, self.force = one, k, one.points[k], force
        self.gap_slope, self.gap_curvature, self.gap_slope_gradient = slope, curvature, gradient
        self.z, self.feature = float(self.point.mem[PLACE]), float(self.point.mem[FEATURE])
        _, self.c1, self.c2 = compliance(self.point.par, self.z)

    @property
    def sigma(self) -> float:
        """Residual of tangency between beam and surface at the point."""
        return self.gap_slope + 0.5 * self.c1 * self.force

    @property
    def sigma_slope(self) -> float:
        """Derivative of sigma with respect to z, everything else fixed."""
        return self.gap_curvature + 0.5 * self.c2 * self.force


def _lift_off_points(one: ContactTable, history: PlaceHistory) -> list[int]:
    """Return the movable closed points of a contact, except those inside a contact zone."""
    inside = _newly_inside(one, history)
    return [k for k, p in enumerate(one.points)
            if p.mem[STATUS] > 0.0 and p.mem[PLACEMENT] == ON_BEAM and k not in inside]


def _lift_off_places(one: ContactTable, d: Array, t: float, history: PlaceHistory) -> list[_LiftOffPlace]:
    """Return the places of the movable closed points (``_lift_off_points``)."""
    points = _lift_off_points(one, history)
    if not points:
        return []
    slope, curvature = one.gap_slopes(d, t)
    gradients = np.zeros((len(points), len(d)))
    for side in (-1.0, 1.0):
        at = {k: (float(one.points[k].mem[PLACE] + side * DIFFERENCE), float(one.points[k].mem[FEATURE]))
              for k in points}
        dofs, rows, _ = one.gradients(d, t, at)
        for gradient, k in zip(gradients, points, strict=True):
            np.add.at(gradient, dofs[k], side * 0.5 / DIFFERENCE * rows[k])
    return [_LiftOffPlace(one, k, float(-d[one.points[k].multiplier]), float(slope[k]), float(curvature[k]), gradient)
            for k, gradient in zip(points, gradients, strict=True)]


def move_to_tangency(system: System, hard: list[ContactTable], d: Array, t: float, history: PlaceHistory) -> int:
    """Move the contact points towards tangency of beam and surface, and the equilibrium d (n_full,) with them.

    Return how many points have moved.
    """
    places = [p for one in hard for p in _lift_off_places(one, d, t, history)]
    if not places:
        return 0
    num = system.model.numbering
    system.assemble(d, t)
    system.factor({"factor": float(f"{t:.6g}")})
    solve, responses = system.response(d, t), np.zeros((len(places), len(d)))
    for response, p in zip(responses, places, strict=True):
        push = p.force * p.gap_slope_gradient
        push[p.point.multiplier] = -(p.gap_slope + p.c1 * p.force)
        num.expand(solve(num.reduce(push)), response)
    gradients, multipliers = np.array([p.gap_slope_gradient for p in places]), [p.point.multiplier for p in places]
    S = gradients @ responses.T - 0.5 * np.array([p.c1 for p in places])[:, None] * responses[:, multipliers].T
    S += np.diag([p.sigma_slope for p in places])
    steps = _step(S, np.array([p.sigma for p in places]), np.array([p.force for p in places]),
                  np.array([abs(p.sigma_slope) for p in places]))
    steps = np.array([_within_reach(p, p.z + history.limited(p, step), history) - p.z for p, step in zip(
        places, steps.tolist(), strict=True)])
    moved = np.abs(steps) > STEP_TOLERANCE
    if moved.any():
        new = [_before_closed_points(p, p.z + step, d) for p, step in zip(places, steps.tolist(), strict=True)]
        steps = np.array(new) - [p.z for p in places]
        system.model.displacements((d + steps @ responses)[num.where], t, out=d)
        for p, z in zip(places, new, strict=True):
            history.brackets[p.point].z = z
            _move(p, z, d, t, history)
    return int(moved.sum())


def release_places(hard: list[ContactTable], history: PlaceHistory) -> list[tuple[ContactTable, int]]:
    """Make the lift-off points slide with the state that is being solved for; return them."""
    out = [(one, k) for one in hard if one.pair.places_move for k in _lift_off_points(one, history)]
    for one, k in out:
        one.points[k].mem[PLACEMENT] = SLIDING
    return out


def fix_places(slid: list[tuple[ContactTable, int]], d: Array, t: float) -> None:
    """Fix the points that slid at their places in state d (n_full,) at t, at most at the ends of their intervals."""
    for one, k in slid:
        one.points[k].mem[PLACEMENT] = ON_BEAM
    for one in {id(one): one for one, _ in slid}.values():
        for _ in range(PLACE_STEPS):
            slope, curvature = one.gap_slopes(d, t)
            for k in (k for other, k in slid if other is one):
                place = _LiftOffPlace(one, k, float(-d[one.points[k].multiplier]), float(slope[k]), float(curvature[k]),
                                      d)
                par, step = place.point.par, place.sigma / place.sigma_slope if place.sigma_slope > 0.0 else 0.0
                place.point.mem[PLACE] = np.clip(place.z - step, par[HOME] - par[HALF_INTERVAL],
                                                 par[HOME] + par[HALF_INTERVAL])


def _step(S: Array, sigma: Array, force: Array, slope: Array) -> Array:
    """Return the steps of the places: Newton's method, modified to go uphill in energy."""
    weight = np.sqrt(np.maximum(force, 0.0))
    H = weight[:, None] * S / np.where(weight > 0.0, weight, 1.0)
    values, modes = np.linalg.eigh(0.5 * (H + H.T))
    size = np.maximum(np.abs(values), LEAST_CURVATURE * (modes.T**2 @ slope))
    step = modes @ ((modes.T @ (weight * sigma)) / np.where(size > 0.0, size, 1.0))
    out: Array = np.clip(-step / np.where(weight > 0.0, weight, 1.0), -LARGEST_STEP, LARGEST_STEP)
    return out


def _before_closed_points(place: _LiftOffPlace, z: float, d: Array) -> float:
    """Return z, or a place nearer by, such that no closed fixed point is passed; one that is close opens instead."""
    point = place.point
    for end, side in zip(place.one.ends[place.k].tolist(), (-1.0, 1.0), strict=True):
        if end < 0 or place.one.points[end].mem[STATUS] <= 0.0:
            continue
        room = point.par[HALF_INTERVAL] - side * (place.z - point.par[HOME])
        if side * (z - place.z) > (1.0 - LEFT_SHARE) * room:
            z = place.z + side * (1.0 - LEFT_SHARE) * room
            if LEFT_SHARE * room < OPENING_SHARE:
                other = place.one.points[end]
                d[point.multiplier] += d[other.multiplier]
                open_point(other, d)
    return z


def _within_reach(place: _LiftOffPlace, z: float, history: PlaceHistory) -> float:
    """Return z, or the end of the interval before it if no fixed point and no free next one is beyond this end.

    Also return the end if the point came from the next interval: at kinks between elements, each may lead to the other.
    """
    par, up = place.point.par, z > place.point.par[HOME]
    if abs(z - par[HOME]) <= par[HALF_INTERVAL] + END_TOLERANCE:
        return z
    next_point = _next_point(place, z)
    back = next_point is not None and place.one.points[next_point[0]] in history.replaced
    if not back and (place.one.ends[place.k, int(up)] >= 0 or next_point):
        return z
    return float(par[HOME] + (par[HALF_INTERVAL] if up else -par[HALF_INTERVAL]))


def _next_point(place: _LiftOffPlace, z: float) -> tuple[int, float] | None:
    """Return the movable point of the next interval and its place for z beyond this interval; None if it is closed."""
    pair, up, ie = place.one.pair, 1.0 if z > place.point.par[HOME] else -1.0, place.one.pair.spots[place.k].ie
    here, count = pair.spots[place.k], len(pair.mesh.dofs)
    if abs(here.z + 2.0 * up * place.point.par[HALF_INTERVAL]) > 1.0:
        ie = (ie + int(up)) % count if pair.mesh.plan.closed else ie + int(up)
        z = -up + (z - up) * float(pair.mesh.lengths[here.ie] / pair.mesh.lengths[min(max(ie, 0), count - 1)])
    for j, (other, spot) in enumerate(zip(place.one.points, pair.spots, strict=True)):
        on_element = spot.free and (spot.ie, spot.eta) == (ie, here.eta)
        if on_element and abs(z - spot.z) <= other.par[HALF_INTERVAL] + END_TOLERANCE and other.mem[STATUS] <= 0.0:
            return j, z
    return None


def _move(place: _LiftOffPlace, z: float, d: Array, t: float, history: PlaceHistory) -> None:
    """Move a point to z; beyond its interval, the movable point of the next one or the fixed one between takes over.

    The friction anchor moves along, so that rolling causes no slip.
    """
    point, points, one = place.point, place.one.points, place.one
    has_friction = one.pair.item.friction > 0.0
    to_anchor = one.anchor(place.k) - one.gaps_and_places(d, t)[1][place.k] if has_friction else 0.0
    # others may have moved meanwhile
    z = _within_reach(place, z, history)
    j = place.k
    if abs(z - point.par[HOME]) <= point.par[HALF_INTERVAL] + END_TOLERANCE:
        point.mem[PLACE] = z
    else:
        force, next_point = -d[point.multiplier], _next_point(place, z)
        j = next_point[0] if next_point else int(one.ends[place.k, int(z > point.par[HOME])])
        slides = point.mem[SLIP_STATUS]
        open_point(point, d)
        history.replaced.add(point)
        if next_point:
            place_point(one, *next_point, place.feature)
        has_friction = has_friction and points[j].mem[STATUS] <= 0.0
        if has_friction:
            points[j].mem[SLIP_STATUS] = slides
        points[j].mem[STATUS] = 1.0
        d[points[j].multiplier] -= force
    if has_friction:
        one.anchor(j, one.gaps_and_places(d, t)[1][j] + to_anchor)
