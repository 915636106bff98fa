"""Contact pressure, traction and gap on the lower and upper face of a body.

The force of each point is divided between its two neighbouring places (nodes, and divisions of an element), such that
force and moment are preserved, and divided by the length that a place represents. Between places the fields are linear.
Gaps are those of the stations themselves.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements.contact_gaps import SIGN
from ..elements.contact_geometry import OPPOSITE
from ..elements.shape import Array
from ..interactions.contact import Contact, ContactLaw
from ..interactions.contact_curves import Spot, levels_of, pieces_along
from ..model.contact_tables import contact_table
from ..model.mesh import BodyMesh
from ..model.model import Model
from .active_set import PENETRATION
from .contact import forces_of_points

if TYPE_CHECKING:
    from .state import State

# distance of equal places along a body, relative to its length
SAME = 1e-9


class ContactFields:
    """Evaluate the pressure and traction [force/length] and the gap [length] of one body for states.

    Each is (ne, nx, 2, 1): at stations ``xi`` (nx,) of the elements, on the lower and upper face. Contact of the axis
    counts for the face on its side. Pressure along the axis on the ends is left out. The gap is nan where nothing is
    opposite.
    """

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array) -> None:
        self.model, self.mesh, self.xi = model, mesh, xi
        self.tables = [one for one in model.contact_tables if mesh is one.pair.mesh or one.pair.other == mesh.plan.name]
        parts = pieces_along(mesh)
        s = mesh.starts[:, None] + mesh.lengths[:, None] * np.arange(parts) / parts
        self.grid: Array = np.append(s.ravel(), mesh.plan.length)
        steps = np.diff(self.grid)
        self.tributary: Array = 0.5 * (np.append(steps, 0.0) + np.append(0.0, steps))
        if mesh.plan.closed:
            self.tributary[[0, -1]] = self.tributary[0] + self.tributary[-1]
        self.stations = [contact_table((), pair) for item in dict.fromkeys(t.pair.item for t in self.tables)
                         for pair in self._station_pairs(item)]

    def _station_pairs(self, item: Contact) -> list[Any]:
        """Return the stations as points of one contact, without forces."""
        spots = [Spot(ie, 2.0 * x - 1.0, eta, 0.0) for eta in levels_of(self.mesh, item.side)
                 for ie in range(len(self.mesh.dofs)) for x in self.xi.tolist()]
        known = next(one.pair for one in self.tables if one.pair.item is item)
        return [known.with_points(replace(item, law=ContactLaw(1.0), friction=0.0), self.mesh, spots)]

    def __call__(self, state: State) -> dict[str, Array]:
        """Return the fields of a state by name."""
        pressure, traction = self._pressure_and_traction(state)
        return {"pressure": pressure, "traction": traction, "gap": self._gaps(state)}

    def _gaps(self, state: State) -> Array:
        ne, nx = len(self.mesh.dofs), len(self.xi)
        out = np.full((2, ne, nx), np.nan)
        for one in self.stations:
            gap = one.gaps(state.d, state.side)[0].reshape(-1, ne, nx)
            out = np.fmin(out, np.where(np.isfinite(gap), gap, np.nan))
        return np.moveaxis(out, 0, -1)[..., None]

    def _pressure_and_traction(self, state: State) -> tuple[Array, Array]:
        sums = np.zeros((2, 2, len(self.grid)))
        for one in self.tables:
            every = forces_of_points(self.model, one, state)[0]
            normal = forces_of_points(self.model, one, state, False)[0] if one.pair.item.friction else every
            if one.pair.mesh is self.mesh:
                face = np.sign([p.eta for p in one.pair.spots])
                self._distribute(sums, state, one.s_on_own_body(self.mesh), face, normal, every - normal)
            if one.pair.other == self.mesh.plan.name:
                face = one.table.par[:, OPPOSITE + SIGN]
                self._distribute(sums, state, one.s_on_other_body(), face, -normal, normal - every)
        if self.mesh.plan.closed:
            sums[..., 0] += sums[..., -1]
            sums[..., -1] = sums[..., 0]
        found = sums / self.tributary
        s = self.mesh.starts[:, None] + self.mesh.lengths[:, None] * self.xi
        at = np.array([[np.interp(s, self.grid, values) for values in faces] for faces in found])
        pressure, traction = np.moveaxis(at, 1, -1)[..., None]
        return pressure, traction

    def _distribute(self, sums: Array, state: State, S: Array, face: Array, normal: Array, along: Array) -> None:
        """Add normal and tangential forces (m, 2) at S (m,) to ``sums`` at the places of ``grid``."""
        for k in np.flatnonzero(np.hypot(*normal.T) + np.hypot(*along.T) > 0.0).tolist():
            s = float(S[k]) * self.mesh.plan.length
            t = self._direction(state, s)
            up = t[0] * normal[k, 1] - t[1] * normal[k, 0]
            if S[k] in (0.0, 1.0) and abs(float(t @ normal[k])) > abs(up) and not self.mesh.plan.closed:
                continue
            upper = int(up < 0.0 if face[k] == 0.0 else face[k] > 0.0)
            j = min(max(int(np.searchsorted(self.grid, s, side="right")) - 1, 0), len(self.grid) - 2)
            x = (s - self.grid[j]) / (self.grid[j + 1] - self.grid[j])
            values = np.array([np.hypot(*normal[k]), t @ along[k]])
            sums[:, upper, j] += (1.0 - x) * values
            sums[:, upper, j + 1] += x * values

    def _direction(self, state: State, s: float) -> Array:
        """Return the direction (2,) of the deformed axis at an arc length."""
        mesh, nc = self.mesh, self.mesh.plan.element.components
        ie = min(max(int(np.searchsorted(mesh.starts, s, side="right")) - 1, 0), len(mesh.dofs) - 1)
        x = min(max((s - float(mesh.starts[ie])) / float(mesh.lengths[ie]), 0.0), 1.0)
        slopes = mesh.classes[mesh.cls[ie]].shape(np.array([x]), np.zeros(1), 1, 0)[0]
        e = (self.model.e0 + state.d[:self.model.n_q])[mesh.dofs[ie]]
        t = np.array([slopes @ e[0::nc], slopes @ e[1::nc]])
        return t / float(np.hypot(*t))


def touching_at_both_ends(model: Model, mesh: BodyMesh, state: State) -> Any:
    """Return which elements (m,) of a body touch something without a law at both ends.

    An end also counts if it has no point because supports hold it next to an obstacle.
    """
    out: Any = np.zeros(len(mesh.dofs), dtype=bool)
    for one in model.contact_tables:
        own, other = one.pair.mesh is mesh, one.pair.other == mesh.plan.name
        if not one.pair.hard or not (own or other):
            continue
        gap, faces = one.gaps(state.d, state.side)
        fixed, touching = ~one.free, faces & (gap <= 2.0 * PENETRATION * model.extent)
        if own:
            out |= _touching_ends(mesh, one.s_on_own_body(mesh)[fixed], touching[fixed], SAME * mesh.plan.length, True)
        if other and one.pair.whole:
            # up to the middle between two points of the other body
            reach = (0.5 + SAME) * float(one.pair.mesh.lengths.max())
            out |= _touching_ends(mesh, one.s_on_other_body()[fixed], touching[fixed], reach, False)
    return out


def _touching_ends(mesh: BodyMesh, S: Array, touching: Any, reach: float, may_lack_point: bool) -> Any:
    """Return which elements (m,) have touching points, at S (k,) of a body, within ``reach`` [m] of both ends.

    With ``may_lack_point``, one end may have no point at all.
    """
    on, none = [], []
    for ends in (mesh.starts, mesh.starts + mesh.lengths):
        near = np.abs(ends[:, None] - S * mesh.plan.length) < reach
        on.append((near & touching).any(axis=1))
        none.append(may_lack_point & ~near.any(axis=1))
    return (on[0] | none[0]) & (on[1] | none[1]) & (on[0] | on[1])
