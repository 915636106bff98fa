"""The effect of a factor on loads, or on the velocity of flows along bodies, on the matrices of small motions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...elements.shape import Array
from ...interactions.forces import LoadSet
from ...model.model import Model
from ..linear import scattered, unknowns_to_coordinates
from .linearised import RateForces

if TYPE_CHECKING:
    from scipy.sparse import csc_array

# relative force and damping that are round-off of the differences
PUSHED = 1e-9


@dataclass(frozen=True)
class Change:
    """The change of K, mu ``rate`` + mu^2 ``square``, and of C, mu ``gyration`` (n, n), by a factor mu; None for zero.

    ``damps``: whether ``gyration`` dissipates or supplies energy.
    """

    rate: csc_array | None = None
    square: csc_array | None = None
    gyration: csc_array | None = None
    damps: bool = False

    def stiffness(self, factor: float) -> csc_array | None:
        """Return the change of K."""
        parts = [f * A for f, A in ((factor, self.rate), (factor * factor, self.square)) if A is not None]
        return sum(parts[1:], parts[0]) if parts else None


def load_change(model: Model, d: Array, u: Array, rate: csc_array | None, h: float) -> Change:
    """Return the change of K by a factor on loads, ``rate`` (n, n), and that of C if the loads depend on rates.

    C is differentiated over a step ``h`` of the factor, at d (n_full,) along the response u (n_full,) to the loads.
    """
    rates = RateForces(model)
    if not rates.drags:
        return Change(rate)
    drag = (rates.drag(d + h * u, h) - rates.drag(d - h * u, -h)) / (2.0 * h)
    return Change(rate, None, drag.tocsc(), bool(abs(drag).max()))


def set_speed(model: Model, factor: float) -> None:
    """Set the factor on the velocities of flows along bodies."""
    for patch in model.loads.flows:
        patch.velocity.factor = factor


def about_without_flow(model: Model) -> str:
    """Return the state of a model without its flows: ``static`` if other loads act, else ``reference``."""
    return "static" if model.loads != LoadSet(flows=model.loads.flows) else "reference"


def speed_change(model: Model) -> Change:
    """Return the change of K and C by the factor on the velocities of flows, at the current factor."""
    T, rest = unknowns_to_coordinates(model), np.zeros(len(model.numbering.place))
    blocks = [(batch.dofs, *batch.matrices(rest, 0.0)[2:]) for batch in model.interactions.flows]
    square = (T.T @ scattered([(dofs, K) for dofs, K, _ in blocks], model.n_q) @ T).tocsc()
    gyration = (T.T @ scattered([(dofs, C) for dofs, _, C in blocks], model.n_q) @ T).tocsc()
    return Change(None, square, gyration, bool(abs(gyration + gyration.T).max() > PUSHED * abs(gyration).max()))
