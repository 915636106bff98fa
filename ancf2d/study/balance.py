"""How well the forces of a state balance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.model import Model

if TYPE_CHECKING:
    from ..solvers.state import State


def unbalanced_forces(model: Model, state: State) -> float:
    """Return the sum of the forces that a state leaves without balance [force]: no force in it is known better.

    They are the residuals of the free positions (coordinates r), as absolute values.
    """
    numbering = model.numbering
    positions = np.concatenate([mesh.kinds < 2 for mesh in model.meshes.values()])
    free = numbering.free < model.n_q
    R = numbering.reduce(state.Q - state.F)[free]
    return float(np.abs(R[positions[numbering.free[free]]]).sum())
