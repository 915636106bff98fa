"""The error of a goal from each element, by the adjoint: the dual-weighted residual on a mesh twice as fine.

The state of a mesh, taken over to one with elements half as long, leaves forces R there. With the tangent K and the
gradient g of the goal J, K z = g gives how the goal answers to forces, and J(h/2) - J(h) = -z R (Becker & Rannacher
2001, An optimal control approach to a posteriori error estimation, section 2). K and g are those halfway between the
two states, so that what is left out is of third order: thin elements answer to a state taken over with axial forces far
from small. What elements contribute is told by z less its interpolation on the coarse mesh, to which R is orthogonal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...case import Goal, LoadedCase, refined
from ...elements.shape import Array
from ...errors import ComputationError, SingularTangentError
from ...model.build import build_model
from ...model.mesh import Index
from ...model.model import Model
from ...model.transfer import transferred
from ...solvers.post import Observer
from ..goal import Solved, goal_kind
from ..measures import GoalValues
from .neighbours import Neighbour

# step of differences, of the model's size; unknowns whose gradient is found one by one; and how far the gradient of
# what is near the goal may be from the change along the correction before all others are looked at
STEP, MOST, OFF = 1e-5, 400, 0.05
# iterations on the finer mesh, and the last correction beside the whole
NEWTON, CLOSE = 8, 1e-4
# how far the adjoint may be from the change that the finer mesh makes, beside it, to be believed
TRUST = 0.25


@dataclass
class Weighted:
    """How the goal changes on a mesh twice as fine: in all, by the adjoint alone, and from each element of bodies."""

    change: float
    adjoint: float
    elements: dict[str, Array]

    @property
    def bodies(self) -> dict[str, float]:
        """How large the contribution of each body is."""
        return {name: float(abs(found.sum())) for name, found in self.elements.items()}


def has_adjoint(loaded: LoadedCase, model: Model) -> bool:
    """Whether the error of a solved case can be told by its adjoint: statics whose forces have a potential."""
    solver = loaded.case.solver
    return (solver.linear or solver.takes_guess) and not model.remembers and not model.contacts and bool(
        model.symmetric or solver.linear)


def weighted(loaded: LoadedCase, solved: Solved, finer: Neighbour | None = None) -> Weighted | None:
    """Return where the error of a solved case comes from, None where the adjoint cannot tell.

    ``loaded`` is the case with the mesh that was solved. Costs a model with elements half as long, its tangent and a
    few solves with that; less where that mesh is solved already, and given as ``finer``.
    """
    from ...solvers.derivatives.statics import Equilibrium

    model, state, goal = solved.model, solved.state, loaded.case.goal
    if goal is None or not has_adjoint(loaded, model):
        return None
    fine = build_model(refined(loaded)) if finer is None else finer.model
    d = transferred(state.d, model, fine)
    if d is None or fine.numbering.n_multipliers != model.numbering.n_multipliers:
        return None
    begin = d[fine.numbering.free]
    near = replace(state, d=fine.displacements(begin, state.t)) if finer is None else finer.state
    try:
        found = Equilibrium(fine, near, loaded.case.solver.linear)
        if finer is None and not _settled(found, begin):
            return None
        end, J = found.z, _Goal(goal, found)
        # halfway, where gradient and tangent of what is quadratic tell of the whole way
        g = J.gradient(0.5 * (begin + end), end - begin)
        if g is None:
            return None
        found.tangent_at(0.5 * (begin + end))
        z, first = found.system.matrix.solve(g), J(begin) - solved.answer.value
        left = found.state_at(fine, begin)
        parts = _by_element(model, fine, z, left.Q - left.F, state.Q - state.F)
        # the goal itself reads the finer mesh otherwise
        here = [(body, mesh.element_at(s)[0]) for body, s in J.points() if body in parts
                for mesh in [model.meshes[body]]] or [(b, k) for b, v in parts.items() for k in range(len(v))]
        for body, ie in here:
            parts[body][ie] += first / len(here)
        told = Weighted(J(end) - solved.answer.value, sum(float(v.sum()) for v in parts.values()), parts)
        return told if abs(told.adjoint - told.change) <= TRUST * abs(told.change) else None
    except (ComputationError, SingularTangentError, FloatingPointError):
        return None


def _settled(found: Any, begin: Array) -> bool:
    """Move to the equilibrium of the finer mesh; whether it is found."""
    for _ in range(0 if found.linear else NEWTON):
        found.tangent_at(found.z)
        if found.correct() <= CLOSE * found.system.norm(found.z - begin):
            return True
    return bool(found.linear)


class _Goal:
    """A goal as a function of the unknowns of an equilibrium."""

    def __init__(self, goal: Goal, found: Any) -> None:
        self.goal, self.found, self.watch = goal, found, GoalValues((goal,))
        self.observer = Observer(found.model, goal_kind(goal) in ("force", "moment"))

    def __call__(self, z: Array) -> float:
        found, model = self.found, self.found.model
        if self.goal.probe is None:
            return float(self.watch(model, [found.state_at(model, z)])[0])
        # probes are read from displacements, without forces
        state = replace(found.state, d=model.displacements(z, found.t), linear=found.linear)
        turned = found.system.count(state.d, found.t)
        return self.observer.read(self.goal.probe, state, turned)[str(self.goal.quantity)]

    def slope(self, z: Array, way: Array) -> float:
        """Return the derivative along a change of the unknowns."""
        size = self.found.system.norm(way)
        if size == 0.0:
            return 0.0
        h = STEP * self.found.model.extent / size
        return (self(z + h * way) - self(z - h * way)) / (2.0 * h)

    def gradient(self, z: Array, way: Array) -> Array | None:
        """Return dJ/dz (n,) by differences for the unknowns near the goal, for all where those do not explain ``way``.

        None where there are too many.
        """
        g, known = np.zeros_like(z), np.zeros(len(z), dtype=bool)
        along = self.slope(z, way)
        if goal_kind(self.goal) == "energy":
            # forces of what stores energy are its gradient, unless loads do
            state = self.found.state_at(self.found.model, z)
            g = self.found.model.numbering.reduce(state.Q)
            if abs(float(g @ way) - along) <= OFF * abs(along):
                return g
            g = np.zeros_like(z)
        everything: Index = np.arange(len(z))
        for some in (self._near(), everything):
            some = some[~known[some]]
            if len(some) > MOST:
                return None
            for i in some.tolist():
                unit = np.zeros_like(z)
                unit[i] = 1.0
                g[i] = self.slope(z, unit)
            known[some] = True
            if abs(float(g @ way) - along) <= OFF * abs(along):
                return g
        return None

    def _near(self) -> Index:
        """Return the unknowns of the elements at the goal's point; beside them, too, where it is a force."""
        model: Model = self.found.model
        beside = 0 if goal_kind(self.goal) in ("displacement", "position", "rotation") else 1
        full = np.zeros(len(model.numbering.place), dtype=bool)
        for body, s in self.points():
            mesh = model.meshes[body]
            ie = mesh.element_at(s)[0]
            full[mesh.dofs[max(ie - beside, 0):ie + beside + 1]] = True
        return np.flatnonzero(full[model.numbering.free])

    def points(self) -> Iterator[tuple[str, float]]:
        case = self.found.model.case
        if self.goal.probe is not None:
            point = case.output.probes[self.goal.probe]
            yield point.at.body, point.at.s
        for support in case.boundary_conditions:
            if self.goal.reaction is not None and support.name == self.goal.reaction:
                yield support.at.body, support.at.s


def _by_element(coarse: Model, fine: Model, z: Array, R: Array, balance: Array) -> dict[str, Array]:
    """Return what elements of the coarse mesh contribute to -z R: (ne,) of each body that deforms.

    ``R`` are the forces left on nodal coordinates of the fine mesh and ``balance`` those of the coarse one, where they
    are what bodies exchange: so each body is told by its own.
    """
    full = np.zeros(len(fine.numbering.place))
    fine.numbering.expand(z, full)
    down = transferred(full, fine, coarse)
    smooth = None if down is None else transferred(down, coarse, fine)
    assert down is not None
    assert smooth is not None
    owners = np.zeros(len(full))
    for mesh in fine.meshes.values():
        np.add.at(owners, mesh.dofs, 1.0)
    parts, out = (smooth - full) * R / np.maximum(owners, 1.0), {}
    for name, mesh in fine.meshes.items():
        if mesh.plan.rigid:
            continue
        before = coarse.meshes[name]
        own, theirs = np.unique(mesh.dofs), np.unique(before.dofs)
        elements = parts[mesh.dofs].sum(axis=1).reshape(len(before.dofs), -1).sum(axis=1)
        # what the finer mesh integrates otherwise goes where the rest comes from
        rest = float(down[theirs] @ balance[theirs] - full[own] @ R[own]) - float(elements.sum())
        size = float(abs(elements).sum())
        out[name] = elements + (rest / size * abs(elements) if size else rest / len(elements))
    return out
