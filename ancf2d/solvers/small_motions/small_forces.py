"""N, Q and M of small motions: what they are to first order in the coordinates, their rates and the inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError
from ...interactions.forces import LoadSet
from ...model.points import PointRef
from ..element_loads import reach
from ..section_forces import SectionForces
from ..state import State
from .linearised import Linearised

# displacement, beside the size of the element, by which forces are differentiated
SMALL = 1e-6
# factor on a load by which natural strains are differentiated
FACTOR = 1e-3


class SmallForces:
    """The section forces of one probe in small motions about a state.

    ``coords`` (n,) and ``weights`` (3, 3, n): N, Q, M are the sum of weights[:, k] @ d[coords] with the coordinates d
    (n_full,), their rates and their second rates for k = 0, 1, 2. Raises ComputationError where a support or joint
    without a multiplier holds the probe's element between its nodes.
    """

    def __init__(self, small: Linearised, name: str, point: PointRef) -> None:
        base = small.base
        case, self.small, self.name, self.point = base.model.case, small, name, point
        acting = [load for load in case.loads if base.loaded and load.name not in case.inputs]
        # at rest: no rates, and the forces of elements as linear as their tangent
        still = np.zeros((2, len(base.state.d)))
        self.state = replace(base.state, linear=False, v=still[0], a=still[1], about=base.state.d)
        self.model = replace(base.model, case=replace(case, loads=tuple(acting)), inputs={})
        coords = reach(self.model, point.mesh, point.ie, base.state)
        if coords is None:
            raise ComputationError(f"N, Q and M of the probe {name} are not computed, because a support or joint holds "
                                   "its element between the nodes", at={"probe": name},
                                   advice="the default element.nodes, which places a node there, or another probe")
        self.coords = coords
        self.forces = SectionForces(self.model, point.mesh, np.array([point.xi]))
        self.weights = np.stack([self._derivatives(rate) for rate in range(3)], axis=1)

    def strained(self) -> Array:
        """Return what strains alone make of N, Q, M (3, n), by the coordinates: viscous forces, of a time of 1 s."""
        tau = self.forces.tau
        self.forces.tau = tau + 1.0
        found = self._derivatives(1) - self.weights[:, 1]
        self.forces.tau = tau
        return np.asarray(found)

    def _derivatives(self, rate: int) -> Array:
        """Return the derivatives (3, n) by coordinates, their rates or their second rates."""
        n_q, out = self.model.n_q, np.zeros((3, len(self.coords)))
        key = ("d", "v", "a")[rate]
        start, mesh = getattr(self.state, key), self.point.mesh
        size = SMALL * min(float(mesh.lengths[self.point.ie]), 0.5 * mesh.plan.section.height)
        for k, c in enumerate(self.coords.tolist()):
            if rate and c >= n_q:
                continue  # multipliers have no rates
            # forces are linear in multipliers
            h = size / float(self.model.weights[c]) if c < n_q else max(1.0, abs(start[c]))
            ends, places = [], []
            for step in (h, -h):
                moved = start.copy()
                moved[c] += step
                ends.append(self._at(self.forces, replace(self.state, **{key: moved})))
                places.append(moved[c])
            # the steps that are left when they are rounded
            out[:, k] = (ends[0] - ends[1]) / (places[0] - places[1])
        return out

    def _at(self, forces: SectionForces, state: State) -> Array:
        return np.asarray(forces(state, np.array([self.point.ie]))[0, 0])

    def direct(self, name: str) -> Array:
        """Return what a load that is an input adds to N, Q, M (3,) where nothing moves."""
        model = self.small.base.model
        loads = model.inputs.get(name)
        if loads is None:
            return np.zeros(3)
        # natural strains are not quite linear in their size; what has no amplitude follows the load factor
        natural = [replace(one, amplitude=lambda t: t) for one in loads.natural]
        guides = [replace(one, tension=lambda d, t, by=one.wound: t * by(d)) for one in loads.guides]
        own = tuple(replace(load, amplitude=None) for load in model.case.loads if load.name == name)
        alone = replace(model, case=replace(model.case, loads=own, steady_rotation=None), inputs={},
                        loads=LoadSet(natural=natural, guides=guides))
        forces = SectionForces(alone, self.point.mesh, np.array([self.point.xi]))
        ends = [self._at(forces, replace(self.state, side=step)) for step in (FACTOR, -FACTOR)]
        alone.set_natural(None)
        return (ends[0] - ends[1]) / (2.0 * FACTOR)
