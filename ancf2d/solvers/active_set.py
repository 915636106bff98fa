"""Closed contact points from the complementarity of gaps and forces, solved exactly for the linearised state.

About a state, gaps g and forces p of the points depend linearly on each other by the tangent. The closed points follow
from

    w = b + M z,  w >= 0, z >= 0, w z = 0

with the forces of closed and the gaps of open points in w, and in z their conjugates: the opening of closed points and
the forces on open ones. Lemke's method finds the solution in a finite number of pivots, also if more points touch than
a body has coordinates there (Lemke 1965; Cottle, Pang & Stone, The Linear Complementarity Problem, 2009, section 4.4).
No combination of open and closed points occurs twice.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..elements.contact_geometry import FEATURE, PLACE, PLACEMENT, SLIDING, STATUS, TOUCH
from ..elements.shape import Array
from ..errors import ComputationError
from .contact_response import PULL, Candidate, Response
from .friction import anchor_points, set_friction_states, wrong_states
from .friction_response import FrictionResponse
from .lift_off import (
    PlaceHistory,
    choose_curves,
    closed_points,
    move_inside_zone,
    move_to_tangency,
    open_beside_fixed,
    open_point,
    place_point,
)

if TYPE_CHECKING:
    from ..model.contact_tables import ContactTable
    from ..model.model import Model
    from .system import System

# penetration that counts as none, relative to the extent of the scene
PENETRATION = 5e-9
# distance in z (-1 to 1) of places along an element that count as equal
SAME_PLACE = 1e-9
# largest number of equilibria until nothing changes
ROUNDS = 40
# share of a gap's gradient on the unknowns below which it is round-off: supports hold the point
NO_GRADIENT = 1e-9
# for gradients of gaps: pivots up to which they depend on others; addition to pivots that may be 0
DEPENDENT_GAPS, NO_PIVOT = 1e-8, 1e-14
# number of times that neighbours of closed points are closed, too, if a body would buckle between these
NEIGHBOUR_ROUNDS = 3


class Strategy(NamedTuple):
    """A strategy to find from an equilibrium the points that open and close, stick and slide next.

    Friction changes at each equilibrium or, with ``together``, jointly with opening and closing. With ``stuck``,
    sliding points stick in the tangent (``friction.sticking``); else they go on sliding. With ``moves``, places between
    nodes move to where a body lifts off.
    """

    stuck: bool = True
    together: bool = False
    moves: bool = True


# the first one is fast; if it cycles, one of the others often does not; without friction, the first three are equal
STRATEGIES = (Strategy(), Strategy(stuck=False), Strategy(together=True), Strategy(moves=False),
              Strategy(stuck=False, moves=False), Strategy(together=True, moves=False))


def initialise_active_set(system: System, d: Array, t: float) -> None:
    """Close the contact points that touch in the first state d (n_full,), and open the others."""
    if system.accepted is None:
        system.accepted = d.copy(), t
    first = [one for one in system.model.contact_tables
             if one.pair.hard and any(p.mem[STATUS] < 0.0 for p in one.points)]
    closed, rows = [], []
    for one in first:
        gap, faces = one.gaps(d, t)
        dofs, gradients, _ = one.gradients(d, t)
        moves = np.zeros(len(one.points), dtype=bool)
        for k, (point, spot) in enumerate(zip(one.points, one.pair.spots, strict=True)):
            row, moves[k] = _reduced_gradient(system, dofs[k], gradients[k])
            touches = faces[k] and not spot.free and gap[k] <= point.par[TOUCH]
            point.mem[STATUS] = float(bool(touches and moves[k]))
            if point.mem[STATUS]:
                closed.append(point)
                rows.append(_unit(row))
        one.fixed = ~moves & ~one.free
        one.initial_gaps = np.where(one.fixed, np.minimum(gap, 0.0), 0.0)
    held = _constraint_gradients(system, d, t) if closed else []
    for point, needed in zip(closed, _independent_rows(held + rows)[len(held):], strict=True):
        point.mem[STATUS] = float(needed)
    for one in first:
        if one.pair.item.friction:
            anchor_points(one, range(len(one.points)), d, (d, t), t)


def _reduced_gradient(system: System, dofs: Any, gradient: Array) -> tuple[Array, bool]:
    """Return a gap's gradient by the unknowns (n_unknowns,), and whether it is nonzero: supports may hold the point."""
    num = system.model.numbering
    full = np.zeros(len(num.place))
    np.add.at(full, dofs, gradient)
    row = num.reduce(full)
    return row, bool(np.abs(row).max(initial=0.0) > NO_GRADIENT * np.abs(gradient).max(initial=0.0))


def check_supports(system: System, d: Array, t: float) -> None:
    """Raise ComputationError if supports have moved a point into an obstacle without a law, or the obstacle into it."""
    limit, into = PENETRATION * system.model.extent, list[tuple[Any, int]]()
    for one in system.model.contact_tables:
        if one.pair.hard and one.fixed.any():
            gap, faces = one.gaps(d, t)
            deep = np.flatnonzero(one.fixed & faces & (gap < one.initial_gaps - limit)).tolist()
            dofs, gradients, _ = one.gradients(d, t) if deep else (gap, gap, gap)
            into += [(one.pair, k) for k in deep if not _reduced_gradient(system, dofs[k], gradients[k])[1]]
    into += driven_points(system.model, d, t, limit)
    if into:
        raise blocked_error(into, {"factor": float(f"{t:.6g}")})


def driven_points(model: Model, d: Array, t: float, depth: float) -> list[tuple[Any, int]]:
    """Return (pair, number) of points that only supports move and that are deeper than ``depth`` in an obstacle.

    Points that are inside in the reference do not count.
    """
    driven = [one.pair.driven for one in model.contact_tables if one.pair.driven is not None]
    return [(pair, k) for pair, start in driven
            for k in np.flatnonzero((start >= -depth) & (pair.gaps(d, t) < -depth)).tolist()]


def blocked_error(into: Iterable[tuple[Any, int]], at: dict[str, Any]) -> ComputationError:
    """Return the error for points, given as (pair, number), that supports or joints press into their obstacles."""
    found = [f"{pair.body} into {pair.other} at S = {pair.s[k]:.4g}" for pair, k in into]
    return ComputationError(
        f"supports or joints press {' or '.join(dict.fromkeys(found))}, and nothing can give way", at=at,
        advice="change their prescribed motion, leave a gap, support the body by springs, or give the contact a law")


def _unit(row: Array) -> tuple[Any, Array]:
    """Return the unknowns and entries of a gradient (n_unknowns,), divided by its length."""
    return row.nonzero()[0], row[row != 0.0] / np.linalg.norm(row)


def _constraint_gradients(system: System, d: Array, t: float) -> list[tuple[Any, Array]]:
    """Return the unit gradients of all constraints with multipliers other than those of contact points."""
    model = system.model
    contacts = {p.multiplier - model.n_q for one in model.contact_tables for p in one.points}
    found = enumerate(model.interactions.gradients(d, t))
    rows = [_reduced_gradient(system, dofs, gradient) for k, (_, dofs, gradient) in found if k not in contacts]
    return [_unit(row) for row, moves in rows if moves]


def _independent_rows(rows: list[tuple[Any, Array]]) -> Any:
    """Return which of m unit gradients are independent of those before them.

    The factors of R R^T + e I have pivots of about e for rows of R that depend on earlier ones.
    """
    from scipy.sparse import csr_array, eye_array
    from scipy.sparse.linalg import splu

    if not rows:
        return np.zeros(0, dtype=bool)
    columns, values = (np.concatenate(part) for part in zip(*rows, strict=True))
    R = csr_array((values, columns, np.cumsum([0, *(len(at) for at, _ in rows)])))
    factors = splu((R @ R.T + NO_PIVOT * eye_array(len(rows))).tocsc(), permc_spec="NATURAL",
                   diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.abs(factors.U.diagonal())[factors.perm_c] > DEPENDENT_GAPS


def _depths(one: ContactTable, d: Array, t: float) -> tuple[Array, Array, Array]:
    """Return the penetration at open points and between points (m,), its z, and the part of the obstacle."""
    free = one.free
    depth, place, feature = one.deepest(d, t)
    gap, faces = one.gaps(d, t)
    closed = closed_points(one)
    may_close = ~free & ~closed & faces
    depth[may_close] = np.maximum(-gap[may_close], 0.0)
    force = np.array([-d[p.multiplier] for p in one.points])
    depth[free & (depth <= one.allowed_penetration(closed, force))] = 0.0
    return depth, place, feature


def depth_of(one: ContactTable, d: Array, t: float) -> float:
    """Return the largest penetration [m] of a contact without a law, at points or between them, at d (n_full,)."""
    return float(_depths(one, d, t)[0].max(initial=0.0))


def overlap(model: Model, d: Array, t: float) -> float:
    """Return the largest penetration [m] of all contacts without a law at d (n_full,)."""
    return max((depth_of(one, d, t) for one in model.contact_tables if one.pair.hard), default=0.0)


def _candidates(one: ContactTable, d: Array, t: float, depths: tuple[Array, Array, Array], fixed_only: bool,
                accepted: tuple[Array, float]) -> list[Candidate]:
    """Return the closed points, the fixed points that may close and, unless ``fixed_only``, new places between them."""
    depth, place, feature = depths
    free, closed = one.free, closed_points(one)
    _, faces = one.gaps(d, t)
    dofs, rows, gap = one.gradients(d, t)
    known = np.flatnonzero(closed | (~free & faces)).tolist()
    slip_gradients, slips = _slips(one, d, t, accepted, known)
    out = [Candidate(one, k, bool(closed[k]), dofs[k], rows[k], float(gap[k]), slip_gradient=slip_gradients[k],
                     slip=slip) for k, slip in zip(known, slips, strict=True)]
    if fixed_only:
        return out
    new = {k: (float(place[k]), float(feature[k])) for k in np.flatnonzero(free & (depth > 0.0)).tolist()
           if not _in_use(one, k, place[k], feature[k])}
    dofs, rows, gap = one.gradients(d, t, new)
    slip_gradients, slips = _slips(one, d, t, accepted, list(new), new)
    return out + [Candidate(one, k, False, dofs[k], rows[k], float(gap[k]), *new[k], slip_gradients[k], slip)
                  for k, slip in zip(new, slips, strict=True)]


def _slips(one: ContactTable, d: Array, t: float, accepted: tuple[Array, float], some: list[int],
           at: dict[int, tuple[float, float]] | None = None) -> tuple[Any, list[float]]:
    """Return the gradients of the places of all points on the obstacle, and the slips of some of them.

    The slip is that since the accepted state or, for closed points, from their anchor. Without friction, gradients are
    None and slips 0.
    """
    if not one.pair.item.friction or not some:
        return [None] * len(one.points), [0.0] * len(some)
    now, before = one.gaps_and_places(d, t, at)[1], one.gaps_and_places(*accepted, at)[1]
    start = [one.anchor(k) if one.points[k].mem[STATUS] > 0.0 else before[k] for k in some]
    slips = [0.0 if np.isnan(place).any() else one.slip(k, now[k], place)
             for k, place in zip(some, start, strict=True)]
    return one.slip_gradients(d, t, at), slips


def _movable_on_element(one: ContactTable, k: int) -> list[int]:
    """Return the movable points of the same element and curve as point k, that one first."""
    here = one.pair.spots[k]
    return sorted(one.movable[here.ie, here.eta], key=lambda j: j != k)


def _in_use(one: ContactTable, k: int, place: float, feature: float) -> bool:
    """Return whether a movable point in use is already at a place, or at the same corner."""
    mems = [one.points[j].mem for j in _movable_on_element(one, k) if one.points[j].mem[STATUS] > 0.0]
    return any(mem[FEATURE] == feature if mem[PLACEMENT] == SLIDING else abs(mem[PLACE] - place) < SAME_PLACE
               for mem in mems)


def update_active_set(system: System, d: Array, t: float, history: PlaceHistory, strategy: Strategy = STRATEGIES[0]
                      ) -> tuple[int, float]:
    """Open and close contact points at an equilibrium d (n_full,), and move d along by the tangent.

    Return the number of changes, and the largest penetration [m]; ``history`` is the state of movable points on the way
    to this equilibrium. Without changes, d is an equilibrium of bodies and obstacles, however it was reached.
    """
    limit = PENETRATION * system.model.extent
    hard = [one for one in system.model.contact_tables if one.pair.hard]
    sliding = [one for one in hard if one.pair.places_move and strategy.moves]
    changed = 0
    for one in sliding:
        one.find_supported_ends(d, t, 2.0 * limit)
        changed += open_beside_fixed(one, d, history) + choose_curves(one, history)
    opened = sum(_open_past_ends(one, d, t) for one in hard)
    depths = [_depths(one, d, t) for one in hard]
    worst = max((float(depth.max(initial=0.0)) for depth, _, _ in depths), default=0.0)
    pulls = np.array([d[p.multiplier] for one in hard for p in one.points if p.mem[STATUS] > 0.0])
    friction = [(one, wrong) for one in hard if one.pair.item.friction and (wrong := wrong_states(one, d, t))]
    if not strategy.together:
        changed += sum(set_friction_states(*wrong) for wrong in friction)
    pulled = (pulls > PULL * np.abs(pulls).max(initial=0.0)).any()
    if not opened and not (strategy.together and friction) and worst <= limit and not pulled:
        changed = changed or move_to_tangency(system, sliding, d, t, history)
        return changed or sum(move_inside_zone(one, history) for one in sliding), worst
    # fixed points first, as those between depend on them
    fixed_only = any((depth[~one.free] > limit).any() for one, (depth, _, _) in zip(hard, depths, strict=True))
    accepted = system.accepted or (d, t)
    candidates = [s for one, depth in zip(hard, depths, strict=True)
                  for s in _candidates(one, d, t, depth, fixed_only, accepted)]
    changed += opened + _open_and_close(system, d, t, candidates, limit, strategy)
    # if the tangent leads back to the same set, friction may change; forces just moved are not yet in equilibrium
    return changed or sum(set_friction_states(*wrong) for wrong in friction) or int(pulled), worst


def not_found(t: float, worst: float) -> ComputationError:
    """Return the error for contact points that keep changing; ``worst`` [m] is the last penetration."""
    found = f"a body is {worst:.3g} deep in an obstacle" if worst > 0.0 else "the pressing points keep changing"
    return ComputationError(
        f"the contact points were not found: {found}", at={"factor": float(f"{t:.6g}")},
        advice="more elements in the contact zone, more steps, or obstacles that leave enough room")


def _open_past_ends(one: ContactTable, d: Array, t: float) -> int:
    """Open points that have slid beyond an end of the other body, whose corner may close instead; return how many."""
    off = [one.points[k] for k in np.flatnonzero(one.past_ends(d, t)) if one.points[k].mem[STATUS] > 0.0]
    for point in off:
        open_point(point, d)
    return len(off)


def _open_and_close(system: System, d: Array, t: float, candidates: list[Candidate], limit: float, strategy: Strategy
                    ) -> int:
    """Open and close points such that gaps and forces of the linearised state are complementary; return how many.

    If that fails, open the point with the largest pull or, if none pulls, close the deepest one.
    """
    # slip of closing points is measured from the accepted state
    accepted = system.accepted or (d.copy(), t)
    changed = 0
    slides: dict[int, float] = {}
    solution = _solution(system, d, t, candidates, limit, strategy, accepted)
    if solution:
        tried, found, slides = solution
    else:
        order = [(-d[s.point.multiplier], 0.0) if s.closed else (0.0, s.gap) for s in candidates]
        tried, found = candidates, {order.index(min(order)): 0.0}
        for one in system.model.contact_tables if strategy.together else ():
            if one.pair.hard and one.pair.item.friction:
                changed += set_friction_states(one, wrong_states(one, d, t))
    closed = [s.closed != (k in found) for k, s in enumerate(tried)]
    for s, now in zip(tried, closed, strict=True):
        if s.closed and not now:
            open_point(s.point, d)
    for k, s in enumerate(tried):
        at = s.k
        if closed[k] and not s.closed:
            at = _close(s, found[k], d)
            if s.contact.pair.item.friction:
                anchor_points(s.contact, [at], d, accepted, t)
        if closed[k] and k in slides:
            changed += set_friction_states(s.contact, {at: slides[k]})
    return changed + sum(now != s.closed for now, s in zip(closed, candidates, strict=True))


def _solution(system: System, d: Array, t: float, candidates: list[Candidate], limit: float, strategy: Strategy,
              accepted: tuple[Array, float]) -> tuple[list[Candidate], dict[int, float], dict[int, float]] | None:
    """Return the candidates, the openings and forces of those that change, and friction states; move d (n_full,) along.

    If a body would buckle between its closed points, their neighbours are closed first. None if there is no solution.
    """
    kind, most = (FrictionResponse, 0) if strategy.together else (Response, NEIGHBOUR_ROUNDS)
    tried = candidates
    added: set[int] = set()
    for more in range(most + 1):
        response = kind(system, d, t, tried, strategy.stuck)
        found = None if response.unstable and more < most else response.complementary_changes(limit)
        # not if the points that were closed open again and nothing else changes
        if found is not None and (not more or set(found) != added):
            system.model.displacements(d[system.model.numbering.where] + response.step(found), t, out=d)
            return tried, found, response.slides
        if more < most:
            tried = _with_closed_neighbours(tried, d, accepted, t)
            added = {k for k, (s, now) in enumerate(zip(candidates, tried, strict=True)) if s.closed != now.closed}
    for k in added:
        candidates[k].point.mem[STATUS] = 0.0
    return None


def _with_closed_neighbours(candidates: list[Candidate], d: Array, accepted: tuple[Array, float], t: float
                            ) -> list[Candidate]:
    """Return the candidates, with the fixed neighbours of closed ones closed, too."""
    curves: dict[tuple[int, float], list[tuple[float, int]]] = {}
    for k, s in enumerate(candidates):
        spot = s.contact.pair.spots[s.k]
        if s.closed or not spot.free:
            z = s.point.mem[PLACE] if spot.free else spot.z
            curves.setdefault((id(s.contact), spot.eta), []).append((spot.ie + 0.5 * (z + 1.0), k))
    out = list(candidates)
    for curve in curves.values():
        order = [k for _, k in sorted(curve)]
        for k, beside in [*pairwise(order), *pairwise(order[::-1])]:
            if candidates[beside].closed and not candidates[k].closed:
                out[k] = candidates[k]._replace(closed=True)
                candidates[k].point.mem[STATUS] = 1.0
                if candidates[k].contact.pair.item.friction:
                    anchor_points(candidates[k].contact, [candidates[k].k], d, accepted, t)
    return out


def _close(s: Candidate, force: float, d: Array) -> int:
    """Close a point with its force and return its number; between fixed points, use a free point of the element.

    If all are in use, the nearest one moves to the resultant of both forces: one point replaces two that approached the
    place of contact from either side. With friction, the one with the smallest force moves to the new place.
    """
    k, points, place = s.k, s.contact.points, s.place
    if s.contact.pair.spots[k].free:
        beside = _movable_on_element(s.contact, k)
        unused = [j for j in beside if points[j].mem[STATUS] <= 0.0]
        has_friction = s.contact.pair.item.friction > 0.0
        k = unused[0] if unused else min(
            beside, key=lambda j: -d[points[j].multiplier] if has_friction else abs(points[j].mem[PLACE] - place))
        mem, more = points[k].mem, -d[points[k].multiplier]
        # a point at a corner has a fixed place, and one with friction an anchor of its own
        moves = not (unused or has_friction) and SLIDING not in (mem[PLACEMENT], s.contact.placement_at(k, s.feature))
        if moves and force > 0.0 < more:
            force, place = force + more, (force * place + more * float(mem[PLACE])) / (force + more)
        place_point(s.contact, k, place, s.feature)
    point = points[k]
    point.mem[STATUS], d[point.multiplier] = 1.0, -force
    return k
