"""Stress, strain and plastic strain of the fibres of a body, at the stations where elements sample them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..elements.shape import Array
from ..kernels.elements import commit, stations
from ..kernels.lowlevel.records import Record
from ..model.mesh import BodyMesh
from ..model.model import Model
from .section_forces import apart, natural_rates
from .state import State
from .stress import OverBody, stress_of


class StressOfFibres:
    """The fibres of a body at the stations xi (ne, nx) of its elements and places eta (ny,), each by its own law.

    Shear is that of the elastic section. Across, fibres are strained by -nu of their elastic and by -1/2 of their
    plastic strain.
    """

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array, eta: Array) -> None:
        self.model, self.mesh, self.size = model, mesh, (*xi.shape, len(eta))
        rows, self.rule = np.unique(xi, axis=0, return_inverse=True)
        self.elastic = [stress_of(model, mesh, row, eta) for row in rows]
        section, points = mesh.plan.section, len(eta) // len(mesh.plan.section.laws)
        self.laws = [(law, slice(k * points, (k + 1) * points)) for k, law in enumerate(section.laws)]
        nu = [layer.nu for layer in section.layers] or [section.nu]
        self.nu = np.repeat(nu, points)
        heights = np.stack([np.broadcast_to(mesh.sections(row).height, self.size[:2]) for row in rows])
        self.y = 0.5 * heights[self.rule.ravel(), np.arange(len(xi)), :, None] * eta

    def __call__(self, state: State) -> OverBody:
        """Return the fields of a state."""
        shear = self._shear(state)
        borne, plastic = self._strained(state, True)
        whole = self._strained(state, False)[0] if self.model.loads.natural else borne
        stress = np.empty(self.size)
        for law, some in self.laws:
            stress[..., some] = law.stress_of(borne[..., some], plastic[..., some])
        across = -self.nu * (borne - plastic) - 0.5 * plastic
        return OverBody(np.stack([stress, np.zeros_like(stress), shear[..., 0]], axis=-1),
                        np.stack([whole, across, shear[..., 1]], axis=-1), np.full((*self.size, 1), np.nan),
                        plastic[..., None])

    def _shear(self, state: State) -> Array:
        """Return shear stress and strain (ne, nx, ny, 2) of the elastic section."""
        found = [of(state) for of in self.elastic]
        both = np.stack([np.stack([f.stress[..., 2], f.strain[..., 2]], axis=-1) for f in found])
        return np.asarray(both[self.rule.ravel(), np.arange(self.size[0])])

    def _strained(self, state: State, natural: bool) -> tuple[Array, Array]:
        """Return the strains of the fibres and their plastic strains (ne, nx, ny), natural strains taken off or not."""
        model, mesh, law = self.model, self.mesh, self.mesh.plan.formulation.law
        group = apart(model, mesh, np.arange(self.size[0]))
        memory = group.values.memory
        states = memory.states[memory.row].copy()
        alone: Any = Record(group.values._replace(memory=memory._replace(row=np.arange(self.size[0]), states=states)))
        model.set_natural(state.side if natural else None,
                          None if state.v is None or not natural else natural_rates(model, state, 1))
        d = state.d[:model.n_q][mesh.dofs].ravel()
        commit(alone, d)
        # states that have been accepted lead to themselves
        eps, sigma = np.zeros((2, *states.shape[:2], law.strains))
        stations(alone, d, eps, sigma)
        found, n, nx = states[:, :self.size[1]], law.strains, self.size[1]
        eps = eps[:, :nx] + found[..., :n]
        strain = eps[..., :1] - self.y * eps[..., 1 if n == 2 else 2, None]
        return strain, found[..., 2 * n::2][..., :self.size[2]]
