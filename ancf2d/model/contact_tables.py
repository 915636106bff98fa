"""Tables of the points of one contact for the kernels: gaps, and where a body penetrates most."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import numpy as np

from ..elements.contact_gaps import FOOT, FOOT_KIND, LOOP, SPAN, START, SURFACE, distance_along, is_past_end
from ..elements.contact_geometry import (
    ANCHOR,
    BENDING,
    FEATURE,
    FRICTION,
    HALF_INTERVAL,
    HOME,
    ON_BEAM,
    ON_ELEMENT,
    OPPOSITE,
    PLACE,
    PLACEMENT,
    SHEAR,
    SLIDING,
    SLIP_STATUS,
    STATUS,
    UNUSED_ON_ELEMENT,
)
from ..elements.contact_layer import slip
from ..elements.contact_sliding import at_corner
from ..elements.shape import Array
from ..interactions.beam_curves import BeamCurves
from ..interactions.body_contact import BodyPair, facing_table
from ..interactions.contact import CompliantContact, ContactPair, ContactPoint, memory_of, movable_by_element
from ..kernels.curves import point_accept
from ..kernels.lowlevel.records import Record
from .mesh import Index
from .point_tables import point_table
from .timing import rates_of

# depth between closed points that counts as none where curves are not cubic, relative to the extent of the scene, and
# relative to the deflection that their forces would cause in the middle of an element
BETWEEN, ROUGH = 1e-6, 40.0


class ContactTable:
    """The points of a contact with an obstacle, with their current history variables.

    ``fixed`` (m,) marks points whose gap supports hold; ``supported`` (m, 2) ends of intervals that touch due to this.
    """

    def __init__(self, constraints: Iterable[Any], pair: Any) -> None:
        self.pair = pair
        self.signals: list[Any] = []
        self.points = [c for c in constraints if isinstance(c, ContactPoint) and c.pair is pair]
        self.patches: list[Any] = self.points or [CompliantContact(pair)]
        self.table = Record(point_table(self.patches, self.signals))
        self.size, self.movable = pair.size, movable_by_element(pair.spots)
        self.curves = BeamCurves(self.patches)
        self.fixed, self.supported = (np.zeros((len(self.points), *n), dtype=bool) for n in ((), (2,)))
        # gaps of fixed points where a motion starts, if negative
        self.initial_gaps = np.zeros(len(self.points))

    @property
    def memory(self) -> Array:
        """The current history variables of the points (m, size)."""
        return (memory_of(self.points) if self.points else self.pair.mem)[:, :self.size]

    def updated(self, d: Array, t: float) -> tuple[Record, Array]:
        """Return the table, updated to the state d (n_full,), and the amplitudes at t."""
        self.table.mem[:, :self.size] = self.memory
        amps = np.array([(s(t), *rates_of(s, t)) for s in self.signals]).reshape(-1, 3)
        self.update_curves(d)
        return self.table, amps

    def nodal_forces(self, d: Array, v: Array, t: float, with_friction: bool, stiff: bool = False
              ) -> tuple[Index, Array, Array, Array]:
        """Return coordinates (m, n), forces of elastic sign (m, n), energy (m,) and stiffness (m, n, n) of each point.

        At d and v (n_full,). The coordinates of a point's own element come first, then those of what it touches. The
        stiffness is empty unless ``stiff``. If not ``with_friction``, friction is left out.
        """
        from ..kernels.points import point_matrices

        table, amps = self.updated(d, t)
        friction, m = table.par[:, FRICTION].copy(), len(table.forces)
        table.par[:, FRICTION] *= with_friction
        coords: Index = table.dofs.reshape(m, -1)
        n = coords.shape[1]
        energy, Q, (K, C) = np.zeros(m), np.zeros((m, n)), np.zeros((2, m if stiff else 0, n, n))
        point_matrices(table, d, v, amps, False, energy, Q, K, C)
        table.par[:, FRICTION] = friction
        return coords, Q, energy, K

    def update_curves(self, d: Array) -> None:
        """Update the curves that the points are on to d (n_full,); the obstacle opposite needs no search."""
        self.curves.write(self.table, d, True)

    def placement_at(self, k: int, feature: float) -> float:
        """Return mem[PLACEMENT] of point k between nodes, opposite to a part (``feature``) of the obstacle: it slides
        at a corner; elsewhere it stands at a place of the curve that it is on."""
        point = self.points[k]
        if at_corner(point.par, feature):
            return SLIDING
        return ON_ELEMENT if point.mem[PLACEMENT] in (ON_ELEMENT, UNUSED_ON_ELEMENT) else ON_BEAM

    @cached_property
    def free(self) -> Any:
        """Which points may move along their element (m,)."""
        return np.array([p.free for p in self.pair.spots])

    @cached_property
    def first_free(self) -> Any:
        """Which points are the first movable ones of their intervals (m,)."""
        first = {p: k for k, p in reversed([*enumerate(self.pair.spots)])}
        return self.free & np.array([first[p] == k for k, p in enumerate(self.pair.spots)])

    @cached_property
    def ends(self) -> Any:
        """The fixed points at both ends of the interval of each movable point (m, 2), -1 where there is none."""
        mesh, half = self.pair.mesh, self.pair.par[:, HALF_INTERVAL]
        count, closed = len(mesh.dofs), mesh.plan.closed
        known = {(p.ie, round(p.z, 9), p.eta): k for k, p in enumerate(self.pair.spots) if not p.free}
        out = np.full((len(half), 2), -1)
        for k in np.flatnonzero(self.free):
            p = self.pair.spots[k]
            for side, z in enumerate((p.z - half[k], p.z + half[k])):
                after = p.ie + 1 if p.ie < count - 1 else 0 if closed else p.ie
                own = known.get((p.ie, round(z, 9), p.eta), -1)
                out[k, side] = own if own >= 0 or z < 1.0 - 1e-9 else known.get((after, -1.0, p.eta), -1)
        return out

    def find_supported_ends(self, d: Array, t: float, near: float) -> None:
        """Update ``supported``: which interval ends, held by supports, are closer than ``near`` at d (n_full,)."""
        for side in range(2):
            end = self.ends[:, side]
            if self.fixed[end[end >= 0]].any():
                self.supported[:, side] = (end >= 0) & self.fixed[end] & (np.abs(self.gaps(d, t)[0][end]) <= near)
            at = {k: (float(self.pair.par[k, HOME] + (2 * side - 1) * self.pair.par[k, HALF_INTERVAL]), -1.0)
                  for k in np.flatnonzero(self.free & (self.ends[:, side] < 0)).tolist()}
            if at:
                gap = self.gradients(d, t, at)[2]
                self.supported[list(at), side] = np.abs(gap[list(at)]) <= near

    def inside_zone(self, held: Any) -> Any:
        """Return which intervals (m,) between fixed points are inside a contact zone.

        ``held`` (m,) marks the closed points. An interval is inside if on either side the next interval has a closed
        point between its ends or is closed at both of them, or if there is no interval beyond a closed end.
        """
        free, ends = np.flatnonzero(self.free), self.ends[self.free]
        closed, none = (held[ends] & (ends >= 0)) | self.supported[free], len(held)
        beyond = np.full((none + 1, 2), none)
        for side in range(2):
            beyond[ends[:, side], side] = free
        points, whole = np.append(held, False), np.ones(none + 1, dtype=bool)
        whole[free] = closed.all(axis=1)
        out = np.zeros(none, dtype=bool)
        out[free] = True
        for side in range(2):
            following = np.where(ends[:, side] >= 0, beyond[ends[:, side], 1 - side], none)
            out[free] &= points[following] | (closed[:, side] & whole[following])
        return out

    def allowed_penetration(self, held: Any, force: Array) -> Array:
        """Return the penetration (m,) between the ends of elements that counts as none.

        ``held`` marks the closed points, ``force`` (m,) has their forces. Where curves are not cubic, the forces of
        neighbouring closed points cause part of this penetration by bending the beam.
        """
        free, out = np.flatnonzero(self.free), np.zeros(len(held))
        if not self.pair.places_move or self.pair.cubic:
            return out
        ends, par = self.ends[free], self.pair.par[free]
        closed = held[ends] & (ends >= 0)
        # ends that supports hold have no closed point
        near = (closed | self.supported[free]).any(axis=1)
        soft = par[:, BENDING] / 64.0 + par[:, SHEAR] / 4.0
        out[free] = np.where(near, BETWEEN * self.pair.scale + ROUGH * soft * np.where(
            closed, np.abs(force[ends]), 0.0).sum(axis=1), 0.0)
        return out

    def gaps(self, d: Array, t: float) -> tuple[Array, Any]:
        """Return the gap of each point (m,) at its current place, and whether its face can touch there."""
        return self.gaps_and_places(d, t)[::2]

    def gaps_and_places(self, d: Array, t: float, at: dict[int, tuple[float, float]] | None = None
                        ) -> tuple[Array, Array, Any]:
        """Return the gap of each point (m,), its place on the obstacle, and whether its face can touch there.

        Movable points are at their current place, or at the one given in ``at`` (see ``gradients``).
        """
        from ..kernels.contact import contact_gaps

        table, amps = self._placed(d, t, at)
        (gap, along), faces = np.zeros((2, len(table.forces))), np.zeros(len(table.forces), dtype=bool)
        contact_gaps(table, d, amps, gap, along, faces)
        return gap, along, faces

    def slip(self, k: int, now: Any, before: Any) -> float:
        """Return how far point k has slid along the obstacle from ``before`` to ``now``."""
        return float(slip(self.points[k].par, now, before))

    def place_at_distance(self, place: Any, way: float) -> Any:
        """Return the place on the obstacle at distance ``way`` from another."""
        return place + way

    def anchor(self, k: int, held: Any = None) -> Any:
        """Return the place at which friction holds point k; set it to ``held`` first if given."""
        mem = self.points[k].mem
        if held is not None:
            mem[ANCHOR] = held
        return mem[ANCHOR]

    def deepest(self, d: Array, t: float) -> tuple[Array, Array, Array]:
        """Return the largest penetration (m,) between fixed points, its z, and the part of the obstacle, for the first
        movable point of each interval; 0 for all others.
        """
        from ..kernels.contact import deepest

        table, amps = self.updated(d, t)
        depth, place, feature = np.zeros((3, len(table.forces)))
        deepest(table, self.first_free, d, amps, depth, place, feature)
        return depth, place, feature

    def gradients(self, d: Array, t: float, at: dict[int, tuple[float, float]] | None = None
                  ) -> tuple[Any, Array, Array]:
        """Return coordinates (m, n), gradients of the gap (m, n) and gaps (m,) of the points at d (n_full,).

        Movable points are at their current place, or at the (z, part of the obstacle) given in ``at``.
        """
        table, amps = self._placed(d, t, at)
        table.mem[:, STATUS] = 1.0
        dofs = table.dofs.reshape(len(table.forces), -1).copy()
        # forces of the gap's multiplier alone, without friction
        Q = self._of_unit(table, d, amps, 1.0, 0.0)
        return dofs[:, :-1], Q[:, :-1], Q[:, -1]

    def slip_gradients(self, d: Array, t: float, at: dict[int, tuple[float, float]] | None = None) -> Array:
        """Return the gradients (m, n) of the places on the obstacle; arguments as of ``gradients``."""
        table, amps = self._placed(d, t, at)
        table.mem[:, STATUS], table.mem[:, SLIP_STATUS] = 1.0, 1.0
        Q = self._of_unit(table, d, amps, -1.0, 0.0) - self._of_unit(table, d, amps, -1.0, 1.0)
        return Q[:, :-1]

    def _placed(self, d: Array, t: float, at: dict[int, tuple[float, float]] | None) -> tuple[Record, Array]:
        """Return table and amplitudes, with the points in ``at`` moved to their given places (see ``gradients``)."""
        table, amps = self.updated(d, t)
        for k, (place, feature) in (at or {}).items():
            table.mem[k, PLACE], table.mem[k, FEATURE] = place, feature
            table.mem[k, PLACEMENT] = self.placement_at(k, feature)
        if at:
            self.update_curves(d)
        return table, amps

    @staticmethod
    def _of_unit(table: Record, d: Array, amps: Array, multiplier: float, friction: float) -> Array:
        """Return the forces of elastic sign (m, n) of points with a given multiplier, without compliance of curves."""
        from ..kernels.points import point_matrices

        m, unit = len(table.forces), d.copy()
        unit[table.dofs.reshape(m, -1)[:, -1]] = multiplier
        n = table.dofs.size // m
        energy, Q, (K, C) = np.zeros(m), np.zeros((m, n)), np.zeros((2, 0, n, n))
        kept = table.par[:, [FRICTION, BENDING, SHEAR]]
        table.par[:, [FRICTION, BENDING, SHEAR]] = friction, 0.0, 0.0
        point_matrices(table, unit, np.zeros_like(d), amps, False, energy, Q, K, C)
        table.par[:, [FRICTION, BENDING, SHEAR]] = kept
        return Q

    def gap_slopes(self, d: Array, t: float) -> tuple[Array, Array]:
        """Return g_z and g_zz (m,) of points between nodes."""
        from ..kernels.contact import gap_slopes

        table, amps = self.updated(d, t)
        slope, bend = np.zeros((2, len(table.forces)))
        gap_slopes(table, d, amps, slope, bend)
        return slope, bend

    def past_ends(self, d: Array, t: float) -> Any:
        """Return that no point (m,) is beyond an end: obstacles have none."""
        return np.zeros(len(self.points), dtype=bool)

    def crossed(self, before: tuple[Array, float], d: Array, t: float) -> bool:
        """Return whether a point passes through the obstacle from ``before`` (state and time) to d (n_full,) at t."""
        from ..kernels.contact import obstacle_crossed

        earlier, (table, amps), free = self.updated(*before)[1], self.updated(d, t), self.free
        # along the curves of elements, because the fields of beam curves change with the state
        table.mem[free, PLACEMENT] = UNUSED_ON_ELEMENT
        self.update_curves(d)
        return bool(obstacle_crossed(table, free, before[0], earlier, d, amps, self.pair.scale))

    def s_on_first_body(self) -> Array:
        """Return S (m,) of each point on the first body of the contact."""
        return self.s_on_own_body(self.pair.mesh)

    def s_on_other_body(self) -> Array:
        """Return S (m,) of the place opposite to each point on the other body: NaN, as an obstacle has none."""
        return np.full(len(self.pair.spots), np.nan)

    def s_on_own_body(self, mesh: Any) -> Array:
        """Return S (m,) of each point on its own body."""
        s: Array = self.pair.s.copy()
        for k in np.flatnonzero(self.free & (self.table.mem[:, PLACEMENT] > 0.0)):
            ie = self.pair.spots[k].ie
            s[k] = (mesh.starts[ie] + 0.5 * (self.table.mem[k, PLACE] + 1.0) * mesh.lengths[ie]) / mesh.plan.length
        return s


class BodyTable(ContactTable):
    """The points of a contact of a body with another body or with itself."""

    # at which distance the opposite element is searched (``kernels.facing.face``)
    within = np.inf

    def __init__(self, constraints: Iterable[Any], pair: Any) -> None:
        super().__init__(constraints, pair)
        self.facing = Record(facing_table(self.patches))

    def update_curves(self, d: Array) -> None:
        """Find the element opposite to each point at d (n_full,), and use its coordinates."""
        from ..kernels.facing import EVERY, face

        face(self.facing, self.table, d, self.within, EVERY)

    def keep_sides(self, d: Array, t: float) -> None:
        """Store, for points with a law, the side of an axis that they are on in the accepted state d (n_full,) at t."""
        table, amps = self.updated(d, t)
        point_accept(table, d, amps)
        self.pair.mem[:, :self.size] = table.mem[:, :self.size]

    def crossed(self, before: tuple[Array, float], d: Array, t: float) -> bool:
        """Same as ``ContactTable.crossed``, for bodies."""
        from ..kernels.body_passages import bodies_cross

        return bool(bodies_cross(self.facing, self.table, before[0], d))

    def past_ends(self, d: Array, t: float) -> Any:
        """Return which points (m,) are beyond an end of the other body at d (n_full,)."""
        return self._past_ends(self.updated(d, t)[0])

    @staticmethod
    def _past_ends(table: Record) -> Any:
        """Return which points (m,) of an updated table are beyond an end of the other body."""
        par, found = table.par[:, OPPOSITE:], table.mem[:, FOOT_KIND]
        return np.array([is_past_end(*row) for row in zip(par, found, strict=True)], dtype=bool)

    def gaps_and_places(self, d: Array, t: float, at: dict[int, tuple[float, float]] | None = None
                        ) -> tuple[Array, Array, Any]:
        """Return the gap of each point (m,), infinite where nothing is opposite, its place on the other body (m, 3; see
        ``kernels.facing``), and whether something other than an end of that body is opposite."""
        from ..kernels.facing import body_gaps

        table, _ = self._placed(d, t, at)
        gap, places = np.zeros(len(table.forces)), np.zeros((len(table.forces), 3))
        body_gaps(self.facing, table, d, gap, places)
        return gap, places, np.isfinite(gap) & ~self._past_ends(table)

    def slip(self, k: int, now: Array, before: Array) -> float:
        """Return how far point k has slid from one place (3,) to another; 0 if they are on different surfaces."""
        if now[2] != before[2]:
            return 0.0
        return float(now[1] * distance_along(self.points[k].par[OPPOSITE + LOOP], now[0], before[0]))

    def place_at_distance(self, place: Array, way: float) -> Array:
        """Return the place (3,) on the other body at distance ``way`` from another."""
        return place + np.array([way / place[1], 0.0, 0.0])

    def anchor(self, k: int, held: Array | None = None) -> Array:
        """Return the place (3,) at which friction holds point k; set it to ``held`` first if given."""
        mem = self.points[k].mem
        if held is not None:
            mem[ANCHOR], mem[SURFACE] = held[0], held[2]
        return np.array([mem[ANCHOR], 0.0, mem[SURFACE]])

    def deepest(self, d: Array, t: float) -> tuple[Array, Array, Array]:
        """Same as ``ContactTable.deepest``, for bodies; the last array is 0."""
        from ..kernels.body_passages import body_deepest

        table, n = self.updated(d, t)[0], len(self.table.forces)
        depth, place = np.zeros(n), np.zeros(n)
        body_deepest(self.facing, table, self.first_free, d, depth, place)
        return depth, place, np.zeros(n)

    def s_on_first_body(self) -> Array:
        """Return S (m,) on the first body of the contact: of the points, or of the places opposite to them."""
        return self.s_on_own_body(self.pair.mesh) if self.pair.sign >= 0.0 else self.s_on_other_body()

    def s_on_other_body(self) -> Array:
        """Return S (m,) of the place opposite to each point on the other body, as last found."""
        par, mem = self.table.par[:, OPPOSITE:], self.table.mem
        out: Array = (par[:, START] + 0.5 * (mem[:, FOOT] + 1.0) * par[:, SPAN]) / self.pair.against.plan.length
        return out


def contact_table(constraints: Iterable[Any], pair: ContactPair | BodyPair) -> ContactTable:
    """Return the table of one contact."""
    return BodyTable(constraints, pair) if pair.on_bodies else ContactTable(constraints, pair)
