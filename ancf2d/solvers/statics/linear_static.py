"""Linear statics: one solve, with the accuracy of its result."""

from __future__ import annotations

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ..iterative_refinement import refined
from ..state import State
from ..system import System
from .newton import POOR
from .one_sided import check_taut

# displacements with a larger relative uncertainty are useless
HOPELESS = 0.5


def solve_linear(model: Model) -> State:
    """Return the one state of linear statics: K(0) d = Q_k with every load at its full factor.

    Moments and follower loads act in the reference directions; linear theory has no load stiffness. Raises
    ComputationError if no digit of the displacements is significant.
    """
    system, num = System(model), model.numbering
    zero = np.zeros(len(num.place))
    start = system.assemble(zero, 1.0, load_stiffness=False)
    pivots = system.factor({"solver": "linear_static"})
    Q, F = start.Q, start.F
    # one long vector less
    del start
    d = model.displacements(np.zeros(num.n_unknowns), 1.0)

    def apply(z: Array) -> Array:
        return num.reduce(system.action(zero, num.expanded(z), 1.0, linear=True))

    system.check_strained(apply, pivots, {"solver": "linear_static"})
    load = -num.reduce(Q - F + (system.action(zero, d, 1.0, linear=True) if d.any() else 0.0))
    floor = max(system.norm(system.matrix.solve(f)) for f in system.rigid_forces())
    z, known = refined(apply, system.matrix.solve, system.norm, load, floor,
                       lambda: system.displacement_noise(zero, 1.0))
    if not np.isfinite(system.norm(z)):
        raise ComputationError("the linear solve gave displacements that are not finite",
                               at={"solver": "linear_static"}, advice="check loads and stiffnesses for extreme values")
    if known > HOPELESS:
        raise ComputationError(
            "the stiffness is too ill-conditioned: no digit of the displacements is significant",
            at={"solver": "linear_static"}, advice="fewer or longer elements, another element type, or solver static")
    d = model.displacements(z, 1.0)
    check_taut(model, d)
    elastic = system.action(zero, d, 1.0, linear=True)
    energy = 0.5 * float(elastic[:model.n_q] @ d[:model.n_q])
    natural = np.zeros_like(d)
    energy += system.add_natural(natural, zero, None, 1.0) + float(natural @ d)
    history = {"step": 1, "factor": 1.0, "iterations": 1, "residual": 0.0, "increment": system.norm(d[num.where]),
               "cutbacks": 0, "energy": energy, "negative_pivots": pivots.negative - num.n_multipliers}
    warnings = [] if known <= POOR else [
        f"round-off limits the displacements: they are accurate to about {known:.1g} of the largest. Fewer or longer "
        "elements, or solver static, give more digits"]
    warnings += _pretensioned(model, d)
    return State(1.0, d, Q + elastic, F, energy, linear=True, history=history, warnings=warnings)


def _pretensioned(model: Model, d: Array) -> list[str]:
    """Return a warning that section forces neglect how the pretension of an elastic tendon rotates with its body."""
    rest, moved = np.zeros(model.n_q), d[:model.n_q]
    names = sorted({g.mesh.plan.name for g in model.loads.guides
                    if 0.0 < g.tension(rest, 1.0) != g.tension(moved, 1.0)})
    return [f"N, Q and M of {', '.join(names)} neglect the rotation of the tendon's pretension with the body: use "
            "solver static for them"] if names else []
