"""Choice of element types that a case leaves open: the simplest models that change the goal by little enough.

In statics the reference model alone shows what simpler models would change. By virtual work, strains of a body that
a simpler model leaves out displace the goal by int N N*/EA + Q Q*/kGA + M M*/EI ds, with the section forces N, Q, M of
the state and N*, Q*, M* of the adjoint state, which the gradient of the goal causes as a load. In motions, the types
that follow from how far each body bends or stretches are solved once to confirm them. In other problems each type is
solved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...case import Goal, LoadedCase, Rectangle
from ...elements.shape import Array
from ...errors import ComputationError, SingularTangentError
from ...model.mesh import BodyMesh
from ...model.model import Model
from ...quantities import KINEMATIC, MOTIONS
from ...solvers.registry import solve
from ...solvers.state import State
from ..goal import Solved, goal_kind
from ..run import Solve
from ..variants import Variant
from .estimates import relative_distance
from .mesh import Ladder
from .pursuit import Pursuit
from .setting import Level

BEAM, CABLE, RIGID = Variant("reissner3"), Variant("cable"), Variant("rigid")
CONTINUUM = (Variant("ancf", (3, 3)), Variant("ancf", (3, 2)), Variant("ancf", (3, 1)))
# strains that types leave out: stretch, shear, bending
LEFT_OUT = {CABLE: (1,), RIGID: (0, 1, 2)}
# times the coarsest mesh: the mesh for comparing models, and the finest one if refinement brings them closer
SIZE, FINEST = 4.0, 64.0
# times the change that is allowed: types predicted to change the goal by more are not solved
HOPELESS = 10.0
# of the goal: if models are further apart, refinement of their meshes is not tried
FAR = 0.1


# function that returns the change of the goal, or None if it cannot be computed, from the types of the bodies, one body
# with its type in place of that, and the change that would be allowed in all
Change = Callable[[dict[str, Variant], str, Variant, float], float | None]


@dataclass
class Choice:
    """Element types by body, the reason for each, and the relative model error of the goal."""

    types: dict[str, Variant]
    why: dict[str, str]
    error: float


def candidates(pursuit: Pursuit, name: str) -> list[Variant]:
    """Return the types that a body may have, the simplest first; the last one is the reference for errors."""
    case = pursuit.loaded.case
    goal = case.goal
    # a single rigid body can move, but statics of it alone has no meaning
    moves = case.solver.moves or len(case.bodies) > 1
    out = [RIGID, CABLE, BEAM] if moves else [CABLE, BEAM]
    if goal is not None and goal.model == "continuum" and isinstance(case.bodies[name].section, Rectangle):
        out += CONTINUUM[::-1]
    return out


def choose_types(pursuit: Pursuit, bodies: list[str], allowed: float, tolerance: float | None) -> Choice:
    """Return the simplest types that change the goal by no more than ``allowed`` (relative) in all."""
    ladders = {name: candidates(pursuit, name) for name in bodies}
    best, meshes = {name: ladder[-1] for name, ladder in ladders.items()}, _Meshes(pursuit, tolerance)
    deformation = Deformation(bodies) if pursuit.loaded.case.solver.moves else None
    watched = None if deformation is None else lambda model: deformation.watch(model, solve(model))
    level = meshes.solve(best, SIZE, "reference model for the errors", watched)
    reference = Choice(best, {name: f"errors are relative to {kind.element}" for name, kind in best.items()}, 0.0)
    if level.answer is None:
        return reference
    predicted = _predictor(pursuit, ladders, deformation)
    if predicted is not None:
        choice = _simplified(ladders, allowed, reference, predicted)
        change = meshes.change_of(choice, best, allowed)
        if change is not None and change <= allowed:
            return replace(choice, error=change)

    def changed(types: dict[str, Variant], name: str, kind: Variant, enough: float) -> float | None:
        """Return the change found by a solution, or a predicted one that is far too large."""
        alone = 0.0 if predicted is None else predicted({}, name, kind, enough) or 0.0
        return alone if alone > HOPELESS * enough else meshes.goal_change(
            {**types, name: kind}, best, enough, f"{name} as {kind.element}")

    return _simplified(ladders, allowed, reference, changed)


def _simplified(ladders: dict[str, list[Variant]], allowed: float, reference: Choice, changed: Change) -> Choice:
    """Return the types chosen for one body after the other, with the present types of the others.

    Each body is made as simple as its share of ``allowed`` permits; the rest of its share goes to the next body.
    """
    types, why, error, left = dict(reference.types), dict(reference.why), 0.0, allowed
    for i, (name, ladder) in enumerate(ladders.items()):
        share = left / (len(ladders) - i)
        for kind in ladder[:-1]:
            change = changed(types, name, kind, error + share)
            if change is None:
                continue
            if change - error <= share:
                types, error = {**types, name: kind}, max(error, change)
                left = allowed - error
                why[name] = (f"with {kind.element} the goal changes by about {change:.1e}; {share:.1e} is allowed for "
                             "the model")
                break
            why[name] = (f"with {kind.element} the goal would change by about {change:.1e}, more than the {share:.1e} "
                         "that is allowed for the model")
    return Choice(types, why, error)


def _predictor(pursuit: Pursuit, ladders: dict[str, list[Variant]], deformation: Deformation | None) -> Change | None:
    """Return what types change according to the reference model solved last, or None if nothing is known.

    In motions it follows from how far bodies deform, else from virtual work. Effects of bodies add up.
    """
    if any(kind not in LEFT_OUT for ladder in ladders.values() for kind in ladder[:-1]):
        return None
    assert pursuit.case is not None
    assert pursuit.last is not None
    level, solved = pursuit.last
    effects = effects_of_strains(pursuit.case, solved, list(ladders)) if deformation is None else deformation.effects(
        pursuit.loaded.case.goal)
    if effects is None or level.answer is None:
        return None
    size = level.answer.size
    return lambda types, name, kind, enough: sum(
        abs(float(effects[body][LEFT_OUT[one],].sum())) / size
        for body, one in {**types, name: kind}.items() if one in LEFT_OUT)


@dataclass
class Deformation:
    """How far bodies leave their shape in a motion: the largest distance [m] of nodes from a rigidly moved body."""

    bodies: list[str]
    most: dict[str, float] = field(default_factory=dict)
    meshes: dict[str, BodyMesh] = field(default_factory=dict)

    def watch(self, model: Model, states: Iterable[State]) -> Iterator[State]:
        """Yield the states of a motion after a look at each."""
        shapes = {name: self._nodes(model, name, np.zeros_like(model.e0)) for name in self.bodies}
        self.most, self.meshes = dict.fromkeys(self.bodies, 0.0), model.meshes
        for state in states:
            for name, shape in shapes.items():
                r = self._nodes(model, name, state.d)
                turned = np.vdot(shape, r)
                off = r - shape * (turned / abs(turned) if turned else 1.0)
                self.most[name] = max(self.most[name], float(np.abs(off).max()))
            yield state

    def _nodes(self, model: Model, name: str, d: Array) -> NDArray[np.complex128]:
        """Return positions of nodes, x + i y, relative to their mean."""
        mesh = model.meshes[name]
        x, y = (np.flatnonzero(mesh.kinds == k) + mesh.first_dof for k in (0, 1))
        r = model.e0[x] + d[x] + 1j * (model.e0[y] + d[y])
        return r - r.mean()

    def effects(self, goal: Goal | None) -> dict[str, Array] | None:
        """Return what stretch, shear and bending of each body (3,) may contribute to a displacement or rotation.

        None for other goals. The part of shear is that of a force in the middle of a simply supported beam.
        """
        if goal is None or goal.quantity not in MOTIONS:
            return None
        out = {}
        for name, most in self.most.items():
            plan = self.meshes[name].plan
            size = most / plan.length if goal_kind(goal) == "rotation" else most
            shear = 12.0 * plan.section.EI / (plan.section.kGA * plan.length**2)
            out[name] = size * np.array([0.0, min(shear, 1.0), 1.0])
        return out


def effects_of_strains(loaded: LoadedCase, solved: Solved, bodies: list[str]) -> dict[str, Array] | None:
    """Return what stretch, shear and bending of each body (3,) contribute to the goal of statics, to first order.

    None without an adjoint state, for goals that depend on stiffnesses other than through displacements and reactions,
    or if natural strains act, which displace bodies without forces.
    """
    from ...solvers.derivatives.statics import Equilibrium
    from ...solvers.resolution import CheckedBody
    from .weighted import GoalOf, has_adjoint

    model, state, goal = solved.model, solved.state, loaded.case.goal
    if goal is None or not has_adjoint(loaded, model) or model.loads.natural:
        return None
    if goal.reaction is None and (goal.probe is None or goal.quantity not in KINEMATIC):
        return None
    try:
        found = Equilibrium(model, state, loaded.case.solver.linear, 0)
        J = GoalOf(goal, found)
        g = J.gradient(found.z, found.z)
        if g is None:
            return None
        found.tangent_at(found.z)
        adjoint = model.numbering.expanded(found.system.matrix.solve(g))
        if goal.reaction is not None:
            # the influence line of a reaction: the support itself moves
            adjoint -= J.of_forces(found.z)
    except (ComputationError, SingularTangentError, FloatingPointError):
        return None
    d = np.zeros_like(state.d) if state.linear else state.d
    forces = found.system.action(d, adjoint, state.t, linear=found.linear, loads=not found.linear)
    out = {}
    for name in bodies:
        body = CheckedBody(model, model.meshes[name])
        own = body.forces(state, body.some)
        other = body.added(state, adjoint, forces, None) if not state.linear else body.forces(
            replace(state, d=state.d + adjoint, Q=state.Q + forces), body.some) - own
        out[name] = np.einsum("ek,ekc,ekc,ekc->c", body.ds, own, other, body.compliance)
    return out


@dataclass
class _Meshes:
    """The meshes on which models are compared."""

    pursuit: Pursuit
    tolerance: float | None

    def solve(self, types: dict[str, Variant], size: float, why: str, how: Solve | None = None) -> Level:
        """Return the level solved with some types on the mesh of a size."""
        return self.pursuit.solve(Ladder(self.pursuit, types, self.tolerance).setting(size), why, how=how)

    def change_of(self, choice: Choice, best: dict[str, Variant], allowed: float) -> float | None:
        """Return how far the goal changes with types that were foreseen; None if they are not possible.

        In statics small changes are those of virtual work. Types are only solved if nothing that is left deforms, or
        if supports of rigid bodies may be redundant, which leaves reactions indeterminate.
        """
        if choice.types == best:
            return 0.0
        goal, kinds = self.pursuit.loaded.case.goal, set(choice.types.values())
        reacts = goal is not None and goal.reaction is not None
        if self.tolerance is not None or kinds == {RIGID} or (reacts and RIGID in kinds):
            return self.goal_change(choice.types, best, allowed, "the types that follow")
        refused = self.pursuit.why_refused(Ladder(self.pursuit, choice.types, self.tolerance).setting(SIZE))
        return choice.error if refused is None else None

    def goal_change(self, types: dict[str, Variant], best: dict[str, Variant], enough: float, why: str) -> float | None:
        """Return how far the goal changes with simpler types, relative; None if the types are not possible.

        A distance of more than ``enough`` may be due to the mesh instead of the model: meshes are doubled as long as
        this reduces the distance at least by half.
        """
        if self.pursuit.why_refused(Ladder(self.pursuit, types, self.tolerance).setting(SIZE)) is not None:
            return None
        size, before = SIZE, float("inf")
        finest = SIZE if self.tolerance is not None else FINEST
        while True:
            simple = self.solve(types, size, why)
            gap = relative_distance(simple, self.solve(best, size, "reference model for the errors"))
            # a mesh that misses an obstacle cannot be compared
            gap = float("inf") if simple.missed_by else gap
            if gap <= enough or 2.0 * size > finest or not gap <= min(FAR, 0.5 * before):
                return min(gap, before) if math.isfinite(min(gap, before)) else None
            size, before = 2.0 * size, gap
