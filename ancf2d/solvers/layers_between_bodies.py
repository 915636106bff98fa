"""How far bodies with a layer between them are off because their points of contact do not see all of it.

Both bodies bear half of the pressure, each at points of its own. A layer is summed up here over many more points, as
near to one another as it takes to see the ends and corners of the other body. In statics, one step of Newton's method
with their forces and stiffness tells where the bodies would be.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements.contact_geometry import STIFFNESS, WEIGHT
from ..elements.shape import gauss
from ..errors import SingularTangentError
from ..interactions.contact_curves import Spot, levels_of
from ..kernels.matrices.matrix import scatter_patches
from ..model.contact_tables import BodyTable
from ..model.model import Model
from .state import State
from .system import System

if TYPE_CHECKING:
    from ..interactions.body_contact import BodyPair

# intervals over the height of a body, of two Gauss points each; most of them along a face
FINE, MOST = 4, 1024
# of a depth to a force, as that of round surfaces
POWER = 2.0 / 3.0


def _places(pair: BodyPair) -> list[Spot]:
    """Return many places along the elements of a body that have points of contact, and across its ends."""
    mesh, levels, (x, w) = pair.mesh, levels_of(pair.mesh, pair.item.side), gauss(2)
    step = min(mesh.plan.section.height, pair.against.plan.section.height) / FINE
    most = max(MOST // len(mesh.dofs), 2)

    def divided(parts: int) -> Any:
        return zip(((np.arange(parts)[:, None] + x) / parts).ravel().tolist(), np.tile(w / parts, parts).tolist(),
                   strict=True)

    out = []
    for ie, eta in sorted({(p.ie, p.eta) for p in pair.spots if abs(p.z) < 1.0}):
        begin, length = float(mesh.starts[ie]), float(mesh.lengths[ie])
        out += [Spot(ie, 2.0 * a - 1.0, eta, b * length) for a, b in divided(min(math.ceil(length / step), most))
                if all(abs(begin + a * length - s) >= near for s, near in pair.beside)]
    for ie, z in sorted({(p.ie, p.z) for p in pair.spots if abs(p.z) == 1.0}):
        low, high = levels
        out += [Spot(ie, z, low + (high - low) * a, b * mesh.plan.section.height) for a, b in divided(4 * FINE)]
    return out


class BodyLayer:
    """The layer of one contact between bodies: ``known`` are its points of contact, of either body."""

    def __init__(self, model: Model, known: list[BodyTable]) -> None:
        self.model = model
        self.system: System | None = None
        self.few, self.many = known, [BodyTable((), one.pair.at(replace(one.pair.item, friction=0.0), one.pair.mesh,
                                                                _places(one.pair))) for one in known]
        self.axes = known[0].pair.item.side == "axis"
        for one in self.many:
            one.near = not self.axes
        solver = model.case.solver
        self.balances = not (solver.moves or solver.on_path)

    def off(self, state: State) -> tuple[float, float, float]:
        """Return how far the bodies are off in a state, how deep they are in one another, and what the layer would
        yield there under the forces at its points."""
        force, depth, d, t = np.zeros(2), 0.0, state.d, state.side
        found = [[one.nodal(d, np.zeros_like(d), t, False, self.balances) for one in tables]
                 for tables in (self.few, self.many)]
        for k, tables in enumerate((self.few, self.many)):
            for one, (_, _, energy, _) in zip(tables, found[k], strict=True):
                # k w g^2/2 of the depth g
                stiffness = one.pair.par[:, WEIGHT] * one.pair.par[:, STIFFNESS]
                force[k] += np.sqrt(2.0 * stiffness * energy).sum()
                depth = max(depth, float(np.sqrt(2.0 * energy / stiffness).max()))
        for one in self.many if self.axes else ():
            one.keep_sides(d, t)
        if depth == 0.0:
            return 0.0, 0.0, 0.0
        yields = depth * float(force[0] / force[1]) ** POWER if force[1] > 0.0 else 0.0
        return self._moves(state, found) if self.balances else abs(depth - yields), depth, yields

    def _moves(self, state: State, found: list[list[Any]]) -> float:
        """Return how far the forces of many points in place of few would move the bodies [m]."""
        model, num, d = self.model, self.model.numbering, state.d
        self.system = system = self.system or System(model)
        system.count_from((d.copy(), model.turns.from_reference(d) if state.turned is None else state.turned))
        system.assemble(d, state.side)
        excess = np.zeros(len(d))
        for sign, tables in zip((-1.0, 1.0), found, strict=True):
            for coords, Q, _, K in tables:
                bears = np.flatnonzero(Q.any(axis=1))
                np.add.at(excess, coords[bears], sign * Q[bears])
                scatter_patches(system.matrix.target, sign * K[bears], coords[bears], 0, len(bears), num.places)
        try:
            system.factor({"factor": state.t})
        except SingularTangentError:
            return 0.0
        return system.norm(system.matrix.solve(num.reduce(excess)))
