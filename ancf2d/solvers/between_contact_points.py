"""Check over a run that bodies do not penetrate obstacles, or lose pressure, between their contact points.

A layer yields D under its pressure, the integral F of k D over the overlap, which grows as D^(3/2) on round surfaces.
The points of an element sum up to another pressure G, under which the layer would yield D (G/F)^(2/3). The difference
is the error in the body's position. Without a law the error is the whole penetration that a motion leaves between fixed
points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements.contact_geometry import CIRCLE, HALF_INTERVAL, HOME, OPPOSITE, POWER, SHAPE
from ..elements.shape import Array
from ..interactions.contact_curves import Spot, layer_rule, levels_of
from ..model.model import Model
from .least_motion import least_size
from .long_vectors import largest
from .state import State

if TYPE_CHECKING:
    from ..model.contact_tables import ContactTable

# share of the largest displacement, and of the radius of a disc, above which an error gives a warning
DISPLACEMENT_SHARE, RADIUS_SHARE = 0.01, 0.1


class _ObstacleLayer:
    """The faces or the axis of a body on an obstacle with a law: one interval for each element."""

    def __init__(self, contact: ContactTable) -> None:
        from ..model.contact_tables import contact_table

        mesh, item = contact.pair.mesh, contact.pair.item
        levels = levels_of(mesh, item.side)
        self.count, self.closed = len(mesh.dofs), mesh.plan.closed
        lengths, last = [float(l) for l in mesh.lengths], self.count - 1
        pair = contact.pair.with_points(item, mesh, [Spot(ie, 0.0, eta, l, free=True) for eta in levels
                                            for ie, l in enumerate(lengths)])
        pair.par[:, HOME], pair.par[:, HALF_INTERVAL] = 0.0, 1.0
        self.half: Array = 0.5 * np.tile(mesh.lengths, len(levels))
        # places and weights (intervals, points) of the points of the layer
        rules = len(levels) * [layer_rule(mesh, ie) for ie in range(self.count)]
        self.rule: Array = np.zeros((2, len(rules), max(len(x) for x, _ in rules)))
        for k, (x, w) in enumerate(rules):
            self.rule[:, k, :len(x)] = x, w
        self.table = contact_table((), pair)
        # the ends of the body, where it may be deepest without being parallel to the surface, and their intervals
        ends = [] if self.closed else [Spot(ie, z, eta, lengths[ie]) for eta in levels
                                       for ie, z in ((0, -1.0), (last, 1.0))]
        self.ends = [(k // 2 * self.count + p.ie, p.z) for k, p in enumerate(ends)]
        self.tips = contact_table((), contact.pair.with_points(item, mesh, ends)) if ends else None

    def position_error(self, state: State) -> tuple[float, float, float]:
        """Return the position error of the body in a state, its depth there, and the depth for the summed forces."""
        from ..kernels.contact import overlaps

        d, t = state.d, state.side
        depth, place, _ = self.table.deepest(d, t)
        for (k, z), gap, faces in zip(self.ends, *self.tips.gaps(d, t), strict=True) if self.tips else ():
            if faces and -gap > depth[k]:
                depth[k], place[k] = -gap, z
        if not depth.any():
            return 0.0, 0.0, 0.0
        table, amps = self.table.updated(d, t)
        exact, summed = np.zeros((2, len(depth)))
        overlaps(table, d, amps, place, *self.rule, exact, summed)
        both = self._sums_with_neighbours(self.half * np.array([exact, summed]))
        yields = depth * np.where(both[0] > 0.0, both[1] / np.where(both[0] > 0.0, both[0], 1.0), 1.0) ** POWER
        k = int(np.argmax(np.abs(depth - yields)))
        return float(abs(depth[k] - yields[k])), float(depth[k]), float(yields[k])

    def _sums_with_neighbours(self, forces: Array) -> Array:
        """Return sums (2, m) over each element and its neighbours along the same curve."""
        rows = forces.reshape(2, -1, self.count)
        ends = rows[..., [-1, 0]] if self.closed and self.count > 2 else np.zeros((*rows.shape[:2], 2))
        wide = np.concatenate([ends[..., :1], rows, ends[..., 1:]], axis=-1)
        return (wide[..., :-2] + wide[..., 1:-1] + wide[..., 2:]).reshape(2, -1)


class ErrorsBetweenPoints:
    """Largest position errors of bodies between their contact points during a run.

    Without a law, load steps add points on obstacles there, and paths report such depths themselves.
    """

    def __init__(self, model: Model) -> None:
        self.model, solver = model, model.case.solver
        # contacts with possible errors, and their checks: layers on obstacles, between bodies, obstacles without a law
        self.checks: list[tuple[Any, Any]] = []
        for one in model.contact_tables if model.contacts and (solver.moves or solver.balances) else ():
            pair = one.pair
            if pair.hard:
                self.checks += [(pair, one)] if solver.moves and not pair.on_bodies else []
            elif not pair.on_bodies:
                self.checks.append((pair, _ObstacleLayer(one)))
            elif not any(pair.item is other.item for other, _ in self.checks):
                from .layers_between_bodies import BodyLayer

                halves: list[Any] = [half for half in model.contact_tables if half.pair.item is pair.item]
                self.checks.append((pair, BodyLayer(model, halves)))
        # the largest displacement, not below that to which errors are relative; the largest error, and the largest
        # relative to the radius of a disc, each as: error, depth, depth for the summed forces, time, number of the
        # contact
        self.displacement, self.worst, self.worst_on_disc = least_size(model, 0.0), np.zeros(5), np.zeros(5)

    def check(self, state: State) -> None:
        """Check the next state."""
        if not self.checks or state.linear:
            return
        from .active_set import depth_of

        model, d, t = self.model, state.d, state.side
        self.displacement = max(self.displacement, largest(d[:model.n_q], model.weights))
        for k, (pair, check) in enumerate(self.checks):
            if pair.hard:
                error = depth = depth_of(check, d, t)
                yields = 0.0
            else:
                error, depth, yields = check.position_error(state)
            par = pair.par[0]
            small = error / par[OPPOSITE + 2] if par[SHAPE] == CIRCLE and par[OPPOSITE + 2] > 0.0 else 0.0
            for record, size in ((self.worst, error), (self.worst_on_disc, small)):
                if size > record[0]:
                    record[:] = size, depth, yields, t, k

    @property
    def error(self) -> float:
        """Largest error relative to the largest displacement or the radius of a disc, if it gives a warning; else 0."""
        error = float(self.worst[0]) / self.displacement
        small = float(self.worst_on_disc[0])
        return max(error if error > DISPLACEMENT_SHARE else 0.0, small if small > RADIUS_SHARE else 0.0)

    def warnings(self) -> list[str]:
        """Return the warnings for the whole run."""
        if self.error == 0.0:
            return []
        of_all = self.worst[0] > DISPLACEMENT_SHARE * self.displacement
        error, depth, yields, t, k = (self.worst if of_all else self.worst_on_disc).tolist()
        pair, solver = self.checks[int(k)][0], self.model.case.solver
        when = f"{'t' if solver.moves or solver.timed else 'factor'} = {t:.6g}"
        law = "" if pair.hard else ", none of which touches it" if yields == 0.0 else (
            f", where its layer would yield {yields:.2g} under the forces at these points, which are off as much")
        what = f"{pair.body} is {depth:.2g} deep in {pair.other} between its contact points{law}"
        if pair.on_bodies:
            both = f"{pair.body} and {pair.other}" if pair.body != pair.other else f"parts of {pair.body}"
            what = (f"{both} are {depth:.2g} deep in one another and {error:.2g} off, as their contact points do not "
                    "see all of the layer between them")
        fewer = ("several rigid bodies, welded, in place of one" if pair.mesh.plan.rigid
                 else "more elements in the contact zone")
        return [f"{pair.name}: at {when} {what}. Use {fewer}"]

    def checkpoint_data(self) -> list[Any]:
        """Return the values to store in checkpoints."""
        return [self.displacement, self.worst.tolist(), self.worst_on_disc.tolist()]

    def restore(self, saved: list[Any]) -> None:
        """Restore the values of a checkpoint."""
        self.displacement, self.worst[:], self.worst_on_disc[:] = saved
