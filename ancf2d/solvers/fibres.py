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
    """The fibres of a body at its stations xi (nx,) and places eta (ny,), each by its own law.

    Shear is that of the elastic section. Across, fibres are strained by -nu of their elastic and by -1/2 of their
    plastic strain.
    """

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array, eta: Array) -> None:
        self.model, self.mesh, self.size = model, mesh, (len(mesh.dofs), len(xi), len(eta))
        self.elastic = stress_of(model, mesh, xi, eta)
        section, points = mesh.plan.section, len(eta) // len(mesh.plan.section.laws)
        self.laws = [(law, slice(k * points, (k + 1) * points)) for k, law in enumerate(section.laws)]
        nu = [layer.nu for layer in section.layers] or [section.nu]
        self.nu = np.repeat(nu, points)
        height = np.broadcast_to(np.asarray(mesh.sections(xi).height, dtype=float), self.size[:2])
        self.y = 0.5 * height[..., None] * eta

    def __call__(self, state: State) -> OverBody:
        """Return the fields of a state."""
        elastic = self.elastic(state)
        borne, plastic = self._strained(state, True)
        whole = self._strained(state, False)[0] if self.model.loads.natural else borne
        stress = np.empty(self.size)
        for law, some in self.laws:
            stress[..., some] = law.stress_of(borne[..., some], plastic[..., some])
        across = -self.nu * (borne - plastic) - 0.5 * plastic
        return OverBody(np.stack([stress, np.zeros_like(stress), elastic.stress[..., 2]], axis=-1),
                        np.stack([whole, across, elastic.strain[..., 2]], axis=-1), np.full((*self.size, 1), np.nan),
                        plastic[..., None])

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
