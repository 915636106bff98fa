"""The simplest element type of each body that the goal's accuracy allows: rigid < cable < reissner < ancf."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...case import Rectangle
from ..variants import Variant
from .mesh import Ladder
from .pursuit import Pursuit, apart
from .setting import Level

BEAM, CABLE, RIGID = Variant("reissner3"), Variant("cable"), Variant("rigid")
CONTINUUM = (Variant("ancf", (3, 3)), Variant("ancf", (3, 2)), Variant("ancf", (3, 1)))
# times the least mesh: where models are compared, and up to where meshes are refined while that brings them closer
SIZE, FINEST = 4.0, 64.0
# of the goal: models further apart are not told from their meshes
FAR = 0.1


@dataclass
class Choice:
    """Element types by body, why each, and the error of the model, relative to the goal."""

    types: dict[str, Variant]
    why: dict[str, str]
    error: float


def candidates(pursuit: Pursuit, name: str) -> list[Variant]:
    """Return the types that a body may have, the simplest first, the one that errors are against last."""
    case = pursuit.loaded.case
    goal = case.goal
    # a rigid body alone has a course over time, but no equilibrium to tell of
    moves = case.solver.moves or len(case.bodies) > 1
    out = [RIGID, CABLE, BEAM] if moves else [CABLE, BEAM]
    if goal is not None and goal.model == "continuum" and isinstance(case.bodies[name].section, Rectangle):
        out += CONTINUUM[::-1]
    return out


def choose_types(pursuit: Pursuit, bodies: list[str], allowed: float, tolerance: float | None) -> Choice:
    """Return the simplest types with which the goal moves by no more than ``allowed`` (relative) in all.

    Each body in turn is made as simple as its share allows, the others as they are so far; what is left of the
    allowance goes to the next.
    """
    ladders = {name: candidates(pursuit, name) for name in bodies}
    best = {name: ladder[-1] for name, ladder in ladders.items()}
    types = dict(best)
    why = {name: f"errors are relative to {ladder[-1].element}" for name, ladder in ladders.items()}
    meshes = _Meshes(pursuit, tolerance)
    if meshes.solve(best, SIZE, "reference model for the errors").answer is None:
        return Choice(types, why, 0.0)
    error, left = 0.0, allowed
    for i, name in enumerate(bodies):
        share = left / (len(bodies) - i)
        for kind in ladders[name][:-1]:
            tried = {**types, name: kind}
            moved = meshes.moved(tried, best, error + share, f"{name} as {kind.element}")
            if moved is None:
                continue
            if moved - error <= share:
                types, error = tried, max(error, moved)
                left = allowed - error
                why[name] = f"with {kind.element} the goal moves by {moved:.1e}; {share:.1e} may go to the model"
                break
            why[name] = (f"with {kind.element} the goal would move by {moved:.1e}, more than the {share:.1e} that may "
                         "go to the model")
    return Choice(types, why, error)


@dataclass
class _Meshes:
    """Meshes that models are compared on."""

    pursuit: Pursuit
    tolerance: float | None

    def solve(self, types: dict[str, Variant], size: float, why: str) -> Level:
        """Return the level of some types on a mesh of a size."""
        return self.pursuit.solve(Ladder(self.pursuit, types, self.tolerance).setting(size), why)

    def moved(self, types: dict[str, Variant], best: dict[str, Variant], enough: float, why: str) -> float | None:
        """Return how far the goal moves with simpler types, relative; None where they cannot be had.

        Where that is more than ``enough`` it may be the mesh that errs, not the model: meshes double as long as the
        two come closer by at least a half.
        """
        if self.pursuit.refuses(Ladder(self.pursuit, types, self.tolerance).setting(SIZE)) is not None:
            return None
        size, before = SIZE, float("inf")
        finest = SIZE if self.tolerance is not None else FINEST
        while True:
            gap = apart(self.solve(types, size, why), self.solve(best, size, "reference model for the errors"))
            if gap <= enough or 2.0 * size > finest or not gap <= min(FAR, 0.5 * before):
                return min(gap, before) if math.isfinite(min(gap, before)) else None
            size, before = 2.0 * size, gap
