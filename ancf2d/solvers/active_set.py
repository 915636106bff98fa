"""Which points of contact are closed: complementarity of gaps and forces, solved exactly for the linearised state.

Of a state and its tangent, gaps g and forces p of points respond linearly to each other. What is closed follows from

    w = b + M z,  w >= 0, z >= 0, w z = 0

where w are the forces of the points that were closed and the gaps of those that were open, and z what they answer to:
how far a closed point opens, and the force on an open one. Lemke's method finds it in a finite number of pivots, also
where more points touch than a body has coordinates there (Lemke 1965; Cottle, Pang & Stone, The Linear Complementarity
Problem, 2009, section 4.4). No combination of open and closed points comes twice.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..elements.contact_geometry import FEATURE, FREE, HELD, OWN, PLACE, SLIDING, STIFFNESS, TOUCH
from ..elements.contact_sliding import yields
from ..elements.shape import Array
from .complementarity import DEPENDENT, lemke
from .friction import hold, rub
from .lift_off import choose_curves, come_inside, let_go, open_point, slide, stand_at

if TYPE_CHECKING:
    from ..interactions.contact import ContactPoint
    from ..model.contact_tables import ContactTable
    from ..model.model import Model
    from .system import System

# penetration that counts as none, beside the extent of the scene
PENETRATION = 5e-9
# pulls beside the largest force that count as none
PULL = 1e-9
# places along an element (z from -1 to 1) that are the same
SAME = 1e-9
# equilibria on the way to one where nothing changes, before that is given up
ROUNDS = 40
# share of a gap's gradient that supports leave where it is more than round-off
MOVES = 1e-9
# of gradients of gaps: pivots up to which they depend on others, and what is added to pivots that may be 0
DEPENDENT_GAPS, NO_PIVOT = 1e-8, 1e-14
# times that points beside closed ones are closed, too, where a body would buckle between those
GROWN = 3
# compliance beside that of an element: what has no more is held by other points
HELD_ALREADY = 1e-10


def begin(system: System, d: Array, t: float) -> None:
    """Close the points of contact that touch in the first state d (n_full,), and open the others."""
    if system.accepted is None:
        system.accepted = d.copy(), t
    first = [one for one in system.model.contact_tables
             if one.pair.hard and any(p.mem[HELD] < 0.0 for p in one.points)]
    closed, rows = [], []
    for one in first:
        gap, faces = one.gaps(d, t)
        dofs, gradients, _ = one.gradients(d, t)
        moves = np.zeros(len(one.points), dtype=bool)
        for k, (point, spot) in enumerate(zip(one.points, one.pair.spots, strict=True)):
            row = _reduced(system, dofs[k], gradients[k])
            # supports may hold what is next to an obstacle where it is
            moves[k] = np.abs(row).max(initial=0.0) > MOVES * np.abs(gradients[k]).max(initial=0.0)
            touches = faces[k] and not spot.free and gap[k] <= point.par[TOUCH]
            point.mem[HELD] = float(bool(touches and moves[k]))
            if point.mem[HELD]:
                closed.append(point)
                rows.append((row.nonzero()[0], row[row != 0.0] / np.linalg.norm(row)))
        one.fixed = ~moves & ~one.free
    for point, needed in zip(closed, _independent(rows), strict=True):
        point.mem[HELD] = float(needed)
    for one in first:
        if one.pair.item.friction:
            hold(one, range(len(one.points)), d, (d, t), t)


def _reduced(system: System, dofs: Any, gradient: Array) -> Array:
    """Return the gradient (n_unknowns,) of a gap by the unknowns from that by its coordinates (n,)."""
    num = system.model.numbering
    full = np.zeros(len(num.place))
    np.add.at(full, dofs, gradient)
    return num.reduce(full)


def _independent(rows: list[tuple[Any, Array]]) -> Any:
    """Return which gaps (m,) do not follow from others, by the unknowns that change them and unit gradients.

    The factors of R R^T + e I have pivots of about e for rows of R that depend on those before them.
    """
    from scipy.sparse import csr_array, eye_array
    from scipy.sparse.linalg import splu

    if not rows:
        return np.zeros(0, dtype=bool)
    places, values = (np.concatenate(part) for part in zip(*rows, strict=True))
    R = csr_array((values, places, np.cumsum([0, *(len(at) for at, _ in rows)])))
    factors = splu((R @ R.T + NO_PIVOT * eye_array(len(rows))).tocsc(), permc_spec="MMD_AT_PLUS_A",
                   diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.abs(factors.U.diagonal())[factors.perm_c] > DEPENDENT_GAPS


class _Spot(NamedTuple):
    """A point that is closed, or may have to be.

    ``row`` (n,) is the gradient of its gap by ``dofs`` (n,); one between the points at home stands at ``place``.
    """

    one: ContactTable
    k: int
    held: bool
    dofs: Any
    row: Array
    gap: float
    place: float = 0.0
    feature: float = -1.0

    @property
    def soft(self) -> float:
        """What an open point between others yields under a unit force beyond the polynomial of its element."""
        if self.held or not self.one.pair.spots[self.k].free or self.one.stands(self.k, self.feature) == OWN:
            return 0.0
        return yields(self.point.par, self.place)[0]

    @property
    def point(self) -> ContactPoint:
        """The point whose multiplier is its force, before a free one has been chosen for it."""
        return self.one.points[self.k]


def _depths(one: ContactTable, d: Array, t: float) -> tuple[Array, Array, Array]:
    """Return how deep the body is in its obstacle at open points, or between points (m,), where, and in what."""
    free = one.free
    depth, place, feature = one.deepest(d, t)
    gap, faces = one.gaps(d, t)
    held = np.array([p.mem[HELD] > 0.0 for p in one.points])
    home = ~free & ~held & faces
    depth[home] = np.maximum(-gap[home], 0.0)
    force = np.array([-d[p.multiplier] for p in one.points])
    depth[free & (depth <= one.slack(held, force))] = 0.0
    return depth, place, feature


def overlap(model: Model, d: Array, t: float) -> float:
    """Return how deep a body is in what it touches without a law [m], at points or between them, at d (n_full,)."""
    hard = [one for one in model.contact_tables if one.pair.hard]
    return max((float(_depths(one, d, t)[0].max(initial=0.0)) for one in hard), default=0.0)


def _look(one: ContactTable, d: Array, t: float, depths: tuple[Array, Array, Array], home: bool) -> list[_Spot]:
    """Return the points that are closed, those at home that may close and, unless ``home``, places between them."""
    depth, place, feature = depths
    free, held = one.free, np.array([p.mem[HELD] > 0.0 for p in one.points])
    _, faces = one.gaps(d, t)
    dofs, rows, gap = one.gradients(d, t)
    out = [_Spot(one, k, bool(held[k]), dofs[k], rows[k], float(gap[k]))
           for k in np.flatnonzero(held | (~free & faces)).tolist()]
    if home:
        return out
    new = {k: (float(place[k]), float(feature[k])) for k in np.flatnonzero(free & (depth > 0.0)).tolist()
           if not _there(one, k, place[k], feature[k])}
    dofs, rows, gap = one.gradients(d, t, new)
    return out + [_Spot(one, k, False, dofs[k], rows[k], float(gap[k]), *new[k]) for k in new]


def _beside(one: ContactTable, k: int) -> list[int]:
    """Return the free points of the same curve of the same element as point k, that one first."""
    here = one.pair.spots[k]
    return sorted((j for j, p in enumerate(one.pair.spots) if p.free and (p.ie, p.eta) == (here.ie, here.eta)),
                  key=lambda j: j != k)


def _there(one: ContactTable, k: int, place: float, feature: float) -> bool:
    """Whether a free point in use already stands at a place, or turns about the same corner."""
    mems = [one.points[j].mem for j in _beside(one, k) if one.points[j].mem[HELD] > 0.0]
    return any(mem[FEATURE] == feature if mem[FREE] == SLIDING else abs(mem[PLACE] - place) < SAME for mem in mems)


def exchange(system: System, d: Array, t: float, left: set[ContactPoint]) -> tuple[int, float]:
    """Open and close points of contact at an equilibrium d (n_full,), and move d to where that leads by the tangent.

    Returns the number of changes, and the largest depth [m]; ``left`` gathers points that have come out of a contact
    zone on the way to this equilibrium. An equilibrium without changes is one of bodies and
    obstacles, whatever led there.
    """
    limit = PENETRATION * system.model.extent
    hard = [one for one in system.model.contact_tables if one.pair.hard]
    sliding = [one for one in hard if one.pair.still]
    turned = 0
    for one in sliding:
        one.look_at_supports(d, t, 2.0 * limit)
        turned += let_go(one, d) + choose_curves(one, left)
    off = sum(_let_off(one, d, t) for one in hard)
    depths = [_depths(one, d, t) for one in hard]
    worst = max((float(depth.max(initial=0.0)) for depth, _, _ in depths), default=0.0)
    pulls = np.array([d[p.multiplier] for one in hard for p in one.points if p.mem[HELD] > 0.0])
    turned += sum(rub(one, d, t, system.accepted or (d, t)) for one in hard if one.pair.item.friction)
    if not off and worst <= limit and not (pulls > PULL * np.abs(pulls).max(initial=0.0)).any():
        return turned or slide(system, sliding, d, t, left) or sum(come_inside(one, left) for one in sliding), worst
    # first the points at home, as those between follow from them
    home = any((depth[~one.free] > limit).any() for one, (depth, _, _) in zip(hard, depths, strict=True))
    spots = [s for one, depth in zip(hard, depths, strict=True) for s in _look(one, d, t, depth, home)]
    return turned + off + _settle(system, d, t, spots, limit), worst


def _let_off(one: ContactTable, d: Array, t: float) -> int:
    """Open points that have slid beyond an end of the other body, whose corner may close; return how many."""
    off = [one.points[k] for k in np.flatnonzero(one.past(d, t)) if one.points[k].mem[HELD] > 0.0]
    for point in off:
        open_point(point, d)
    return len(off)


class _Response:
    """How forces of closed points and gaps of open ones answer to each other at a state, by its tangent.

    ``base`` (n_unknowns,) leads to balance where nothing opens or closes; forces and gaps are then ``b`` (m,).
    """

    def __init__(self, system: System, d: Array, t: float, spots: list[_Spot]) -> None:
        self.num, self.matrix = system.model.numbering, system.matrix
        balance = system.assemble(d, t)
        pivots = system.factor({"factor": float(f"{t:.6g}")})
        self.unstable = system.knows_inertia and pivots.negative > self.num.n_multipliers
        self.base: Array = -self.matrix.solve(balance.R.copy())
        self.held = np.array([s.held for s in spots])
        self.rows = np.zeros((len(spots), len(self.num.place)))
        for row, s in zip(self.rows, spots, strict=True):
            np.add.at(row, s.dofs, s.row)
        self.at = self.num.place[[s.point.multiplier for s in spots]]
        self.force = np.array([-d[s.point.multiplier] if s.held else 0.0 for s in spots])
        self.soft = [s.soft for s in spots]
        self.stiff = np.array([s.point.par[STIFFNESS] for s in spots])
        self.b = np.where(self.held, self.force, [s.gap for s in spots]) + self.told(self.base)
        self.steps: dict[int, Array] = {}

    def told(self, z: Array) -> Array:
        """Return what forces of closed points and gaps of open ones (m,) change by with the unknowns."""
        full = np.zeros(len(self.num.place))
        self.num.expand(z, full)
        return np.where(self.held, -z[self.at], self.rows @ full)

    def answer(self, k: int) -> Array:
        """Return what they change by where closed point k opens by 1, or a force of 1 acts at the open one."""
        rhs = np.zeros(len(self.base))
        if self.held[k]:
            rhs[self.at[k]] = 1.0
        else:
            rhs = self.num.reduce(self.rows[k], np.zeros(len(self.num.place)))
        self.steps[k] = self.matrix.solve(rhs).copy()
        out = self.told(self.steps[k])
        out[k] += self.soft[k]
        return out

    def settled(self, limit: float) -> dict[int, float] | None:
        """Return how far closed points open, and the forces on open ones, so that both are complementary.

        Begins with the points that pull or are deeper than ``limit``, and adds what is wrong then. None where there
        is no such state nearby.
        """
        size = np.where(self.held, PULL * np.abs(self.force).max(initial=0.0), limit)
        working: list[int] = []
        passed: list[int] = []
        answers = np.zeros((len(self.b), 0))
        w, z = self.b, np.zeros(0)
        while new := [k for k in np.flatnonzero(w < -size).tolist() if k not in working + passed]:
            for k in new:
                answer = self.answer(k)
                if not self.held[k] and answer[k] * self.stiff[k] < HELD_ALREADY:
                    passed.append(k)
                    continue
                answers = np.column_stack([answers, answer])
                working.append(k)
            if working:
                solved = self._complementary(answers[working], np.array(working))
                if solved is None:
                    return None
                z = solved
                w = self.b + answers @ z
        return {k: float(a) for k, a in zip(working, z, strict=True) if a > 0.0}

    def _complementary(self, M: Array, working: Any) -> Array | None:
        # stiffnesses and compliances, each beside the largest of its kind
        own, closed = np.abs(np.diag(M)), self.held[working]
        most = np.where(closed, own[closed].max(initial=0.0), own[~closed].max(initial=0.0))
        scale: Array = 1.0 / np.sqrt(np.maximum(own, DEPENDENT * most))
        z = lemke(M * np.outer(scale, scale), self.b[working] * scale)
        return None if z is None else scale * z

    def step(self, found: dict[int, float]) -> Array:
        """Return how that moves the unknowns (n_unknowns,)."""
        return self.base + sum((a * self.steps[k] for k, a in found.items()), np.zeros(len(self.base)))


def _settle(system: System, d: Array, t: float, spots: list[_Spot], limit: float) -> int:
    """Open and close points so that gaps and forces of the linearised state are complementary; return how many.

    Where a body would buckle between its closed points, those beside them are closed first. Where nothing helps, the
    point that pulls most opens, or else the deepest one closes.
    """
    tried, found = spots, None
    # what closes has slid since then
    accepted = system.accepted or (d.copy(), t)
    for more in range(GROWN + 1):
        response = _Response(system, d, t, tried)
        found = None if response.unstable and more < GROWN else response.settled(limit)
        if found is not None:
            system.model.displacements(d[system.model.numbering.where] + response.step(found), t, out=d)
            break
        tried = _grown(tried)
    if found is None:
        for s, grown in zip(spots, tried, strict=True):
            s.point.mem[HELD] = s.point.mem[HELD] if s.held == grown.held else 0.0
        tried = spots
        found = {min(range(len(spots)), key=lambda k: (-d[spots[k].point.multiplier] if spots[k].held else 0.0,
                                                       0.0 if spots[k].held else spots[k].gap)): 0.0}
    closed = [s.held != (k in found) for k, s in enumerate(tried)]
    for s, now in zip(tried, closed, strict=True):
        if s.held and not now:
            open_point(s.point, d)
    for k, s in enumerate(tried):
        if closed[k] and not s.held:
            j = _close(s, found[k], d)
            if s.one.pair.item.friction:
                hold(s.one, [j], d, accepted, t)
    return sum(now != s.held for now, s in zip(closed, spots, strict=True))


def _grown(spots: list[_Spot]) -> list[_Spot]:
    """Return the points with those at home beside closed ones closed, too."""
    curves: dict[tuple[int, float], list[tuple[float, int]]] = {}
    for k, s in enumerate(spots):
        spot = s.one.pair.spots[s.k]
        if s.held or not spot.free:
            z = s.point.mem[PLACE] if spot.free else spot.z
            curves.setdefault((id(s.one), spot.eta), []).append((spot.ie + 0.5 * (z + 1.0), k))
    out = list(spots)
    for curve in curves.values():
        order = [k for _, k in sorted(curve)]
        for k, beside in [*pairwise(order), *pairwise(order[::-1])]:
            if spots[beside].held and not spots[k].held:
                out[k] = spots[k]._replace(held=True)
                spots[k].point.mem[HELD] = 1.0
    return out


def _close(s: _Spot, force: float, d: Array) -> int:
    """Close a point with its force, and return its number; between those at home any of its element not in use does.

    Where all are, that with the least force moves.
    """
    k, points = s.k, s.one.points
    if s.one.pair.spots[k].free:
        k = min(_beside(s.one, k), key=lambda j: 0.0 if points[j].mem[HELD] <= 0.0 else -d[points[j].multiplier])
    point = points[k]
    if s.one.pair.spots[k].free:
        stand_at(s.one, k, s.place, s.feature)
    point.mem[HELD], d[point.multiplier] = 1.0, -force
    return k
