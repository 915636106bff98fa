"""Residual forces of a state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import cantilever

from ancf2d.solvers.registry import solve
from ancf2d.solvers.state_results import unbalanced_forces


@pytest.mark.parametrize("kind", ["2d3n", "reissner2"])
def test_an_unbalanced_force_is_counted_in_full(kind: str) -> None:
    loads = [{"type": "force", "at": "beam@1", "value": [0, -3000]}]
    model = cantilever({"type": kind, "count": 8}, loads, solver="linear_static").model
    (state,) = solve(model)
    assert unbalanced_forces(model, state) < 1e-4
    # x of the last node and, the other way, y of the first free one; the held node balances anything
    mesh = model.meshes["beam"]
    x, y = mesh.dofs[-1][mesh.kinds[mesh.dofs[-1]] == 0][-1], mesh.dofs[0][mesh.kinds[mesh.dofs[0]] == 1][-1]
    for columns, forces, total in (([x], [5.0], 5.0), ([x, y], [5.0, -2.0], 7.0), ([0, 1], [5.0, 5.0], 0.0)):
        F = state.F.copy()
        np.add.at(F, columns, forces)
        assert unbalanced_forces(model, replace(state, F=F)) == pytest.approx(total, abs=1e-3)
