"""Errors in the positions of bodies with a layer between them, because their contact points do not see all of it.

Both bodies bear half of the pressure, each at points of its own. Here the layer is integrated over many more points,
dense enough for the ends and corners of the other body. In statics, one Newton step with their forces and stiffness
gives the error.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements.contact_geometry import POWER, STIFFNESS, WEIGHT
from ..elements.shape import gauss
from ..errors import SingularTangentError
from ..interactions.contact_curves import Spot, levels_of
from ..kernels.facing import IN_RANGE
from ..model.contact_tables import BodyTable
from ..model.model import Model
from .state import State
from .system import System

if TYPE_CHECKING:
    from ..interactions.body_contact import BodyPair

# intervals of two Gauss points each over the height of a body; largest number of them along a face
INTERVALS, MOST_INTERVALS = 4, 1024


def _dense_points(pair: BodyPair) -> list[Spot]:
    """Return many places along the elements of a body that have contact points, and across its ends."""
    mesh, levels, (x, w) = pair.mesh, levels_of(pair.mesh, pair.item.side), gauss(2)
    step = min(mesh.plan.section.height, pair.against.plan.section.height) / INTERVALS
    most = max(MOST_INTERVALS // len(mesh.dofs), 2)

    def divided(parts: int) -> Any:
        return zip(((np.arange(parts)[:, None] + x) / parts).ravel().tolist(), np.tile(w / parts, parts).tolist(),
                   strict=True)

    out = []
    for ie, eta in sorted({(p.ie, p.eta) for p in pair.spots if p.eta in levels}):
        begin, length = float(mesh.starts[ie]), float(mesh.lengths[ie])
        out += [Spot(ie, 2.0 * a - 1.0, eta, b * length) for a, b in divided(min(math.ceil(length / step), most))
                if all(abs(begin + a * length - s) >= near for s, near in pair.excluded)]
    for ie, z in sorted({(p.ie, p.z) for p in pair.spots if p.eta not in levels}):
        low, high = levels
        out += [Spot(ie, z, low + (high - low) * a, b * mesh.plan.section.height) for a, b in divided(4 * INTERVALS)]
    return out


class BodyLayer:
    """The layer of one contact between bodies; ``known`` are the tables of its contact points on either body."""

    def __init__(self, model: Model, known: list[BodyTable]) -> None:
        self.model = model
        self.system: System | None = None
        self.few, self.many = known, [BodyTable((), one.pair.with_points(
            replace(one.pair.item, friction=0.0), one.pair.mesh, _dense_points(one.pair))) for one in known]
        self.of_axes = known[0].pair.item.side == "axis"
        if not self.of_axes:
            for one in self.many:
                one.within = IN_RANGE
        solver = model.case.solver
        self.balances = not (solver.moves or solver.on_path)

    def position_error(self, state: State) -> tuple[float, float, float]:
        """Return the position error of bodies in a state, their overlap, and the overlap for their points' forces."""
        force, depth, d, t = np.zeros(2), 0.0, state.d, state.side
        found = [[one.nodal_forces(d, np.zeros_like(d), t, False, self.balances) for one in tables]
                 for tables in (self.few, self.many)]
        for k, tables in enumerate((self.few, self.many)):
            for one, (_, _, energy, _) in zip(tables, found[k], strict=True):
                # the energy is k w g^2/2 for the depth g
                stiffness = one.pair.par[:, WEIGHT] * one.pair.par[:, STIFFNESS]
                force[k] += np.sqrt(2.0 * stiffness * energy).sum()
                depth = max(depth, float(np.sqrt(2.0 * energy / stiffness).max()))
        for one in self.many if self.of_axes else ():
            one.keep_sides(d, t)
        if depth == 0.0:
            return 0.0, 0.0, 0.0
        yields = depth * float(force[0] / force[1]) ** POWER if force[1] > 0.0 else 0.0
        return self._displacement(state, found) if self.balances else abs(depth - yields), depth, yields

    def _displacement(self, state: State, found: list[list[Any]]) -> float:
        """Return the displacement [m] of the bodies if the forces of many points replace those of the few."""
        model, num, d = self.model, self.model.numbering, state.d
        self.system = system = self.system or System(model)
        system.count_from((d.copy(), model.turns.from_reference(d) if state.turned is None else state.turned))
        excess, stiffness = np.zeros(len(d)), []
        for sign, tables in zip((-1.0, 1.0), found, strict=True):
            for coords, Q, _, K in tables:
                bears = np.flatnonzero(Q.any(axis=1))
                np.add.at(excess, coords[bears], sign * Q[bears])
                stiffness.append((sign * K[bears], coords[bears]))
        system.assemble(d, state.side, more=stiffness)
        try:
            system.factor({"factor": state.t})
        except SingularTangentError:
            return 0.0
        return system.norm(system.matrix.solve(num.reduce(excess)))
