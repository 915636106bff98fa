"""The simplest element type of each body that the goal's accuracy allows: rigid < cable < reissner < ancf."""

from __future__ import annotations

from dataclasses import dataclass

from ...case import Dynamic, Rectangle
from ..variants import Variant
from .mesh import Ladder
from .pursuit import Pursuit
from .setting import Setting

BEAM, CABLE, RIGID = Variant("reissner3"), Variant("cable"), Variant("rigid")
CONTINUUM = (Variant("ancf", (3, 3)), Variant("ancf", (3, 2)), Variant("ancf", (3, 1)))
# times the least mesh: models are told apart on meshes of types that err little there
SIZE = 6.0


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
    moves = isinstance(case.solver, Dynamic) or len(case.bodies) > 1
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
    types = {name: ladder[-1] for name, ladder in ladders.items()}
    why = {name: f"{ladder[-1].element} is what errors are against" for name, ladder in ladders.items()}
    best = pursuit.solve(_setting(pursuit, types, tolerance), "the model that errors are against")
    if best.answer is None:
        return Choice(types, why, 0.0)
    error, left = 0.0, allowed
    for i, name in enumerate(bodies):
        share = left / (len(bodies) - i)
        for kind in ladders[name][:-1]:
            tried = {**types, name: kind}
            setting = _setting(pursuit, tried, tolerance)
            if pursuit.refuses(setting) is not None:
                continue
            level = pursuit.solve(setting, f"{name} as {kind.element}")
            if level.answer is None:
                continue
            moved = level.answer.distance(best.answer) / best.answer.size
            if moved - error <= share:
                types, error = tried, max(error, moved)
                left = allowed - error
                why[name] = f"with {kind.element} the goal moves by {moved:.1e}; {share:.1e} may go to the model"
                break
            why[name] = (f"with {kind.element} the goal would move by {moved:.1e}, more than the {share:.1e} that may "
                         "go to the model")
    return Choice(types, why, error)


def _setting(pursuit: Pursuit, types: dict[str, Variant], tolerance: float | None) -> Setting:
    return Ladder(pursuit, types, tolerance).setting(SIZE)
