"""SciPy's integrators by name, and what each allows."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import Problem
from ..model.model import Model


@dataclass(frozen=True)
class Scheme:
    """What an integrator of SciPy allows.

    ``one_step``: it looks at no earlier step, so that states can be put onto the constraints; ``stages`` that it
    evaluates per try, where that tells how many tries a step took; ``keeps``: it goes on from (t, y, h) alone;
    ``jacobian``: it takes one; ``fixed``: its error weights cannot change on the way.
    """

    one_step: bool
    stages: int = 0
    keeps: bool = False
    jacobian: bool = False
    fixed: bool = False


SCHEMES = {
    "RK45": Scheme(True, stages=6, keeps=True),
    "DOP853": Scheme(True, stages=12, keeps=True),
    "Radau": Scheme(True, jacobian=True),
    "BDF": Scheme(False, jacobian=True),
    "LSODA": Scheme(False, jacobian=True, fixed=True),
}


def method_problems(model: Model) -> list[Problem]:
    """Return why the method of a case cannot move its model: multistep methods and multipliers do not go together."""
    method = getattr(model.case.solver, "method", None)
    if method not in SCHEMES or SCHEMES[method].one_step or not model.constraints or model.loaded is None:
        return []
    owners = ", ".join(sorted({c.owner for c in model.constraints}))
    message = (f"solver.method: {method} goes on from earlier steps, which cannot be kept on the constraints of "
               f"{owners}")
    return [model.loaded.source.problem(("solver", "method"), message, "Radau, RK45, DOP853, or a method of the tool's "
                                        "own, such as radau5")]
