"""Contact in a state: forces, contact zones and history variables of the points."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..elements.contact_geometry import (
    ON_BEAM,
    ON_ELEMENT,
    PLACE,
    PLACEMENT,
    SLIDING,
    SLIP_STATUS,
    STATUS,
    STICK,
    STIFFNESS,
)
from ..elements.shape import Array
from ..errors import ComputationError
from ..interactions.contact import CompliantContact, ContactPair, ContactPoint
from ..interactions.contact_curves import levels_of
from ..model.determinacy import rigid_motion
from ..model.mesh import Index
from ..model.model import Model
from .active_set import PENETRATION

# decimals of z to which places of points are the same
SAME_PLACES = 7

if TYPE_CHECKING:
    from ..model.contact_tables import ContactTable
    from .state import State


def memory(model: Model) -> list[Array]:
    """Return a copy of the history variables of all contact points."""
    return [one.memory.copy() for one in model.contact_tables]


def restore_memory(model: Model, saved: list[Array], slide: bool = False) -> None:
    """Restore the history variables of contact points; with ``slide``, points at places of lift-off slide."""
    for one, mem in zip(model.contact_tables, saved, strict=True):
        for own, row in zip(_memory_views(one), mem, strict=True):
            own[:len(row)] = row
            if slide and one.pair.places_move and own[PLACEMENT] == ON_BEAM:
                own[PLACEMENT] = SLIDING


def pressing_points(model: Model) -> tuple[bytes, ...]:
    """Return which contact points without a law press, where, and whether they stick or slide, for comparison."""
    out = []
    for one in (one for one in model.contact_tables if one.pair.hard):
        mem, closed = one.memory, one.memory[:, STATUS] > 0.0
        place = np.where(one.free, mem[:, PLACE].round(SAME_PLACES), 0.0)
        out += [closed.tobytes(), np.where(closed, [mem[:, SLIP_STATUS], place], 0.0).tobytes()]
    return tuple(out)


def layers_pressed(model: Model, d: Array, t: float) -> list[Any]:
    """Return which points (m,) of each contact with a law are in its layer at d (n_full,)."""
    return [one.gaps(d, t)[0] < 0.0 for one in model.contact_tables if not one.pair.hard]


@contextmanager
def softer_layers(model: Model, share: float) -> Iterator[None]:
    """Make contact layers softer within a block: their stiffness, and that of their friction, is a share of it."""
    layers = [pair for pair in model.contacts if not pair.hard]
    kept = [pair.par[:, [STIFFNESS, STICK]].copy() for pair in layers]
    try:
        for pair, stiffness in zip(layers, kept, strict=True):
            pair.par[:, [STIFFNESS, STICK]] = share * stiffness
        yield
    finally:
        for pair, stiffness in zip(layers, kept, strict=True):
            pair.par[:, [STIFFNESS, STICK]] = stiffness


def force_at_fixed_place(model: Model) -> bool:
    """Return whether a force acts at a movable place that is fixed in the equations and chosen only between equilibria.

    Such places are where a body penetrates most: on another body, and inside a contact zone.
    """
    for one in model.contact_tables:
        place, fixed = one.memory[:, PLACEMENT], [ON_ELEMENT] if one.pair.places_move else [ON_ELEMENT, ON_BEAM]
        if one.pair.hard and ((one.memory[:, STATUS] > 0.0) & np.isin(place, fixed)).any():
            return True
    return False


def _memory_views(one: ContactTable) -> list[Array]:
    """Return views of the history variables of each point of a contact; points with a law share one table."""
    return [p.mem for p in one.points] if one.points else list(one.pair.mem)


def layer_memory(model: Model) -> dict[str, Array]:
    """Return the history variables of the points of each layer, by the name of their array in a result file."""
    return {layer_name(k, pair): pair.mem[:, :pair.size] for k, pair in enumerate(model.contacts) if not pair.hard}


def layer_name(k: int, pair: Any) -> str:
    """Return the name of the array with the history variables of a model's contact number k."""
    return f"contacts/{k} {pair.name}: {pair.body}"


def set_memory(model: Model, rows: Array) -> None:
    """Set the history variables of contact points from a table of all point laws (items, numbers)."""
    for patch, at in zip(model.interactions.points, model.interactions.rows, strict=True):
        if isinstance(patch, CompliantContact):
            size = patch.pair.size
            patch.pair.mem[:, :size] = rows[at, :size]
        elif isinstance(patch, ContactPoint):
            size = patch.pair.size
            patch.mem[:size] = rows[at][0, :size]


class Touch(NamedTuple):
    """Gaps and forces of one contact in a state.

    ``gap`` (m,) [m], ``force`` (m, 2) on the body of the points, ``moment`` (m,) about the origin and size ``normal``
    (m,) of the force without friction for each point, ``s`` (m,) along the first body of the contact. Gaps up to
    ``near`` are closed.
    """

    pair: ContactPair
    s: Array
    gap: Array
    force: Array
    moment: Array
    normal: Array
    near: float

    @property
    def closed(self) -> Any:
        """Which points have a force (m,)."""
        return np.hypot(*self.force.T) > 0.0

    @property
    def touching(self) -> Any:
        """Which points touch (m,): those with a force or, without a law, with zero gap."""
        return self.closed | (self.gap <= self.near) if self.pair.hard else self.closed


def touches(model: Model, state: State) -> list[Touch]:
    """Return gaps and forces of each contact of a model in a state."""
    return [_touch(model, one, state) for one in model.contact_tables]


def nodal_forces_of_points(one: ContactTable, state: State, friction: bool = True) -> tuple[Index, Array]:
    """Return coordinates (m, n) and forces (m, n) of the points of a contact in a state; see ``ContactTable.nodal``."""
    v = np.zeros(len(state.d))
    if state.v is not None:
        v[:len(state.v)] = state.v
    return one.nodal_forces(state.d, v, state.side, friction)[:2]


def forces_of_points(model: Model, one: ContactTable, state: State, friction: bool = True) -> tuple[Array, Array]:
    """Return the force (m, 2) of each point of a contact on its body, and its moment (m,) about the origin.

    Without ``friction``, only normal forces count.
    """
    mesh = one.pair.mesh
    coords, Q = nodal_forces_of_points(one, state, friction)
    m, own = len(Q), mesh.plan.element.n_dof
    e = model.e0 + state.d[:model.n_q]
    moves = rigid_motion(mesh, coords[:, :own].ravel(), e, np.zeros(2)).reshape(m, own, 3)
    total = -np.einsum("mn,mnk->mk", Q[:, :own], moves)
    return total[:, :2], total[:, 2]


def _touch(model: Model, one: ContactTable, state: State) -> Touch:
    gap, _ = one.gaps(state.d, state.side)
    force, moment = forces_of_points(model, one, state)
    pressing = forces_of_points(model, one, state, False)[0] if one.pair.item.friction else force
    table, _ = one.updated(state.d, state.side)
    gap[one.free & ~(table.mem[:, PLACEMENT] > 0.0)] = np.nan
    return Touch(one.pair, one.s_on_first_body(), gap, force, moment, np.hypot(*pressing.T),
                 2.0 * PENETRATION * model.extent)


def check_pressed_through(model: Model, d: Array, at: dict[str, float]) -> None:
    """Raise ComputationError if bodies overlap so deeply that contact may let them pass."""
    touching: list[Any] = [one for one in model.contact_tables if one.pair.on_bodies]
    if not touching:
        return
    from ..kernels.body_passages import may_be_deep

    for one in touching:
        pair = one.pair
        itself = pair.against is pair.mesh
        inside = itself or may_be_deep(one.facing, one.table, d, pair.too_deep, 0.5 * pair.height)
        if inside and (found := pair.pressed_through(d)):
            law = "more elements where they touch" if pair.hard else "a stiffer law or none"
            raise ComputationError(f"{found}, where contact may no longer hold it", at=at,
                                   advice=f"{law}, smaller steps, or smaller loads")


def check_crossed(model: Model, d: Array, last: tuple[Array, float], t: float) -> None:
    """Raise ComputationError if a body has passed through its partner since the last state (with its time)."""
    for one in model.contact_tables:
        if one.crossed(last, d, t):
            raise ComputationError(f"{one.pair.name}: {one.pair.body} passes through {one.pair.other}",
                                   at={"factor": float(f"{t:.6g}")}, advice="more steps, or an initial gap")


def contact_report(model: Model, state: State) -> list[dict[str, Any]]:
    """Return force, moment about the origin, pressing force and zone of each contact of a model, for ``--json``."""
    of: dict[int, list[Touch]] = {}
    for touch in touches(model, state):
        of.setdefault(id(touch.pair.item), []).append(touch)
    return [_report_of(parts) for parts in of.values()]


def _report_of(parts: list[Touch]) -> dict[str, Any]:
    """Return the entry of one contact; both bodies may have points."""
    first, last = (np.concatenate(ends) for ends in zip(*map(_stretches, parts), strict=True))
    fx, fy = sum(touch.pair.sign * touch.force.sum(axis=0) for touch in parts)
    return {"name": parts[0].pair.name, "force": [float(fx), float(fy)],
            "moment": float(sum(touch.pair.sign * touch.moment.sum() for touch in parts)),
            "normal": float(sum(touch.normal.sum() for touch in parts)),
            "length": max(_contact_length(touch) for touch in parts if touch.pair.sign >= 0.0 or touch.pair.hard),
            "from": float(first.min()) if len(first) else None, "to": float(last.max()) if len(last) else None}


def _stretches(touch: Touch) -> tuple[Array, Array]:
    """Return start and end along the first body of the stretches (k,) that the touching points represent.

    Without a law, and on an end of a body, these are the points themselves. Other points with a law represent lengths,
    in order along an element.
    """
    pair, first, last = touch.pair, touch.s.copy(), touch.s.copy()
    if not pair.hard and pair.sign >= 0.0:
        lengths, length = _represented_lengths(pair), pair.mesh.plan.length
        for ie, eta in {(p.ie, p.eta) for p in pair.spots}:
            here = np.flatnonzero([(p.ie, p.eta) == (ie, eta) for p in pair.spots] & (lengths > 0.0))
            here = here[np.argsort(touch.s[here], kind="stable")]
            last[here] = (pair.mesh.starts[ie] + np.cumsum(lengths[here])) / length
        first = last - lengths / length
    return first[touch.touching], last[touch.touching]


def _represented_lengths(pair: ContactPair) -> Array:
    """Return the length of the axis (m,) that each point with a law represents, 0 on an end."""
    along = levels_of(pair.mesh, pair.item.side)
    return np.array([p.weight if p.eta in along else 0.0 for p in pair.spots])


def _contact_length(touch: Touch) -> float:
    """Return the length of the reference axis along which a body touches.

    Without a law it is the distance between neighbouring points that touch; with a law, points represent lengths.
    """
    pair = touch.pair
    if not pair.hard:
        return float(_represented_lengths(pair)[touch.touching].sum())
    total = 0.0
    for eta in {p.eta for p in pair.spots}:
        here = np.array([p.eta == eta for p in pair.spots]) & np.isfinite(touch.gap)
        order = np.argsort(touch.s[here], kind="stable")
        s, closed = touch.s[here][order], touch.touching[here][order]
        both = closed[1:] & closed[:-1]
        total += float(np.diff(s)[both].sum()) * pair.mesh.plan.length
    return total


def obstacle_reactions(model: Model, state: State) -> dict[str, dict[str, float]]:
    """Return the force and moment of each obstacle on the bodies; the moment is about its centre in the state."""
    out: dict[str, dict[str, float]] = {
        name: {"fx": 0.0, "fy": 0.0, "m": 0.0} for name in model.case.obstacles
        if any(pair.other == name for pair in model.contacts)}
    for touch in touches(model, state):
        pair = touch.pair
        if pair.other not in out:
            continue
        (fx, fy), m = touch.force.sum(axis=0), float(touch.moment.sum())
        x, y = centre_at(pair, state.d[:model.n_q], state.side, model.case.obstacles[pair.other])
        to = out[pair.other]
        to["fx"] += float(fx)
        to["fy"] += float(fy)
        to["m"] += m - x * float(fy) + y * float(fx)
    return out


def obstacle_motions(model: Model, state: State) -> dict[str, dict[str, float]]:
    """Return displacement and rotation about its centre of each obstacle that follows amplitudes."""
    out = {}
    for name, frame in model.frames.items():
        if frame.signals:
            x, y, angle = frame.pose(state.d[:model.n_q], state.side)
            out[name] = {"ux": float(x), "uy": float(y), "theta": float(angle)}
    return out


def centre_at(pair: ContactPair, d: Array, t: float, obstacle: Any) -> tuple[float, float]:
    """Return the position of an obstacle's centre at d (n_q,) and t."""
    x, y, angle = pair.frame.pose(d, t)
    (ox, oy), (cx, cy) = pair.frame.origin, obstacle.centre
    c, s = np.cos(angle), np.sin(angle)
    return float(ox + x + c * (cx - ox) - s * (cy - oy)), float(oy + y + s * (cx - ox) + c * (cy - oy))
