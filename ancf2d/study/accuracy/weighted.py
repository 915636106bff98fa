"""Error of a goal from each element by the adjoint method: the dual-weighted residual on a mesh twice as fine.

The state of a mesh, transferred to one with elements half as long, leaves residual forces R there. With the tangent K
and the gradient g of the goal J, the adjoint z solves K z = g, and J(h/2) - J(h) = -z R (Becker & Rannacher 2001, An
optimal control approach to a posteriori error estimation, section 2). K and g are taken halfway between the two states,
which leaves an error of third order; this matters because thin elements respond to a transferred state with large axial
forces. The contributions of elements use z minus its interpolation on the coarse mesh, to which R is orthogonal.
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
from ...quantities import KINEMATIC
from ...solvers.state_results import Observer
from ..expressions import GoalValues
from ..goal import Solved, goal_kind
from .neighbours import Neighbour

# difference step relative to the model's size; most unknowns whose gradient is found one by one; relative error along
# the correction that makes the gradient near the goal insufficient
STEP, MOST, OFF = 1e-5, 400, 0.05
# iterations on the finer mesh, and the last correction relative to the whole
NEWTON, CLOSE = 8, 1e-4
# largest relative difference between adjoint and actual change for which the adjoint is trusted
TRUST = 0.25


@dataclass
class Weighted:
    """Change of the goal on a mesh twice as fine: actual, by the adjoint, and the contribution of each element."""

    change: float
    adjoint: float
    elements: dict[str, Array]

    @property
    def bodies(self) -> dict[str, float]:
        """Return the size of the contribution of each body."""
        return {name: float(abs(found.sum())) for name, found in self.elements.items()}


def has_adjoint(loaded: LoadedCase, model: Model) -> bool:
    """Return whether the adjoint can estimate the error of a solved case: statics whose forces have a potential."""
    solver = loaded.case.solver
    return (solver.linear or solver.takes_guess) and not model.remembers and not model.contacts and bool(
        model.symmetric or solver.linear)


def weighted(loaded: LoadedCase, solved: Solved, finer: Neighbour | None = None) -> Weighted | None:
    """Return the contributions of elements to the error of a solved case, or None if the adjoint cannot give them.

    ``loaded`` is the case with the mesh that was solved. Costs a model with elements half as long, its tangent and a
    few solves with that; less if that mesh is solved already and given as ``finer``.
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
        # the solver's own state needs no iterations to remove its last residual
        found = Equilibrium(fine, near, loaded.case.solver.linear, *([] if finer is None else [0]))
        if finer is None and not _settled(found, begin):
            return None
        end, J = found.z, GoalOf(goal, found)
        # halfway: with a gradient and tangent taken there, quadratic terms are exact
        g = J.gradient(0.5 * (begin + end), end - begin)
        if g is None:
            return None
        found.tangent_at(0.5 * (begin + end))
        z, first = found.system.matrix.solve(g), J(begin) - solved.answer.value
        left = found.state_at(fine, begin)
        parts = _by_element(model, fine, z, left.Q - left.F, state.Q - state.F)
        # the goal of the same state differs on the finer mesh
        here = [(body, mesh.element_at(s)[0]) for body, s in J.points() if body in parts
                for mesh in [model.meshes[body]]] or [(b, k) for b, v in parts.items() for k in range(len(v))]
        for body, ie in here:
            parts[body][ie] += first / len(here)
        out = Weighted(J(end) - solved.answer.value, sum(float(v.sum()) for v in parts.values()), parts)
        return out if abs(out.adjoint - out.change) <= TRUST * abs(out.change) else None
    except (ComputationError, SingularTangentError, FloatingPointError):
        return None


def _settled(found: Any, begin: Array) -> bool:
    """Move to the equilibrium of the finer mesh; return whether it is found."""
    for _ in range(0 if found.linear else NEWTON):
        found.tangent_at(found.z)
        if found.correct() <= CLOSE * found.system.norm(found.z - begin):
            return True
    return bool(found.linear)


class GoalOf:
    """A goal as a function of the unknowns of an equilibrium."""

    def __init__(self, goal: Goal, equilibrium: Any) -> None:
        self.goal, self.equilibrium, self.values_of = goal, equilibrium, GoalValues((goal,))
        self.observer = Observer(equilibrium.model, goal_kind(goal) in ("force", "moment"))

    def __call__(self, z: Array) -> float:
        equilibrium, model = self.equilibrium, self.equilibrium.model
        if self.goal.probe is None:
            return float(self.values_of(model, [equilibrium.state_at(model, z)])[0])
        # probes are read from displacements, without forces
        state = replace(equilibrium.state, d=model.displacements(z, equilibrium.t), linear=equilibrium.linear)
        turned = equilibrium.system.count(state.d, equilibrium.t)
        return self.observer.read(self.goal.probe, state, turned)[str(self.goal.quantity)]

    def slope(self, z: Array, way: Array) -> float:
        """Return the derivative along a change of the unknowns."""
        size = self.equilibrium.system.norm(way)
        if size == 0.0:
            return 0.0
        h = STEP * self.equilibrium.model.extent / size
        return (self(z + h * way) - self(z - h * way)) / (2.0 * h)

    def gradient(self, z: Array, way: Array) -> Array | None:
        """Return dJ/dz (n,) by a formula if that explains the change along ``way``.

        If not, by differences for unknowns near the goal, or for all if those do not explain it. None if there are too
        many unknowns.
        """
        g, known = self.by_formula(z), np.zeros(len(z), dtype=bool)
        along = self.slope(z, way)
        if g is not None and abs(float(g @ way) - along) <= OFF * abs(along):
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

    def by_formula(self, z: Array) -> Array | None:
        """Return dJ/dz (n,) of an energy without that of loads, a reaction, or a place or rotation; else None."""
        equilibrium, model = self.equilibrium, self.equilibrium.model
        d = equilibrium.zero if equilibrium.linear else model.displacements(z, equilibrium.t)
        if goal_kind(self.goal) == "energy":
            # elastic forces are the gradient of the energy, unless loads store energy too
            full = equilibrium.state_at(model, z).Q
        elif self.goal.reaction is not None:
            full = equilibrium.system.action(d, self.of_forces(z), equilibrium.t, equilibrium.linear,
                                             loads=not equilibrium.linear)
        elif self.goal.probe is not None and self.goal.quantity in KINEMATIC:
            turned = equilibrium.system.count(d, equilibrium.t)
            coords, by, _ = self.observer.slopes(self.goal.probe, str(self.goal.quantity), replace(
                equilibrium.state, d=d, turned=turned))
            full = np.zeros(len(d))
            np.add.at(full, coords, by)
        else:
            return None
        return np.asarray(model.numbering.reduce(full))

    def of_forces(self, z: Array) -> Array:
        """Return the derivatives (n_full,) of a reaction by the forces at the coordinates that its support holds."""
        model = self.equilibrium.model
        state, out = self.equilibrium.state_at(model, z), np.zeros(len(model.numbering.place))
        before = float(self.values_of(model, [state])[0])
        for i in {int(i) for row in model.rows if row.owner == self.goal.reaction for i in row.coords}:
            Q = state.Q.copy()
            Q[i] += 1.0
            out[i] = float(self.values_of(model, [replace(state, Q=Q)])[0]) - before
        return out

    def _near(self) -> Index:
        """Return the unknowns of the elements at the goal's point, and of their neighbours if the goal is a force."""
        model: Model = self.equilibrium.model
        beside = 0 if goal_kind(self.goal) in ("displacement", "position", "rotation") else 1
        full = np.zeros(len(model.numbering.place), dtype=bool)
        for body, s in self.points():
            mesh = model.meshes[body]
            ie = mesh.element_at(s)[0]
            full[mesh.dofs[max(ie - beside, 0):ie + beside + 1]] = True
        return np.flatnonzero(full[model.numbering.free])

    def points(self) -> Iterator[tuple[str, float]]:
        case = self.equilibrium.model.case
        if self.goal.probe is not None:
            point = case.output.probes[self.goal.probe]
            yield point.at.body, point.at.s
        for support in case.boundary_conditions:
            if self.goal.reaction is not None and support.name == self.goal.reaction:
                yield support.at.body, support.at.s


def _by_element(coarse: Model, fine: Model, z: Array, R: Array, balance: Array) -> dict[str, Array]:
    """Return the contributions to -z R of the elements (ne,) of the coarse mesh, for each body that deforms.

    ``R`` are the residual forces at the nodal coordinates of the fine mesh and ``balance`` those of the coarse one,
    which are the forces between bodies: with them, each body gets its own contribution.
    """
    full = fine.numbering.expanded(z)
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
        # the effect of different integration on the finer mesh is distributed like the rest
        rest = float(down[theirs] @ balance[theirs] - full[own] @ R[own]) - float(elements.sum())
        size = float(abs(elements).sum())
        out[name] = elements + (rest / size * abs(elements) if size else rest / len(elements))
    return out
