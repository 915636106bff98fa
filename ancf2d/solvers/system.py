"""Residual and tangent of a model at a state: elements, patches, constraints and dead loads together."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..elements.shape import Array
from ..errors import SingularTangentError
from ..kernels.elements import commit, force, force_noise, force_tangent, natural_slope, tangent_action
from ..kernels.matrices.matrix import scatter_patches
from ..model.determinacy import own_motions
from ..model.groups import with_trials
from ..model.mesh import Index
from ..model.model import Model
from .ldl import Pivots, Symmetric
from .linear import make_matrix
from .threads import Crew, largest, largest_share, pieces

UNIT_ROUNDOFF = 2.0**-53
# displacements beside the extent of a model that are round-off of the positions themselves
STILL = 32 * UNIT_ROUNDOFF
# the same where friction without a law holds points by springs, which give a little
STUCK = 1e-8
# errors of a motion that is smaller than this share of the extent, as at its start, are relative to it
LEAST = 1e-9
# times what round-off of forces does to displacements when it is of one sign everywhere
ROUNDED = 10.0
# relative pivots above this are no round-off
SUSPECT = 1e-10
# work through the strains beside that of the forces: motions that strain nothing do less
HIDDEN = 1e-8


def sticks(model: Model) -> bool:
    """Return whether springs hold points that stick, as friction without a law does."""
    return any(pair.hard and pair.item.friction for pair in model.contacts)


def least_motion(model: Model) -> float:
    """Return the displacement [length] below which nothing has moved."""
    return (STUCK if sticks(model) else STILL) * model.extent


def least_size(model: Model, tolerance: float) -> float:
    """Return the displacement [length] that local errors of a motion are relative to at least.

    Adaptive steps do not resolve the vibrations of springs that hold what sticks; with fixed ones ``tolerance`` is 0.
    """
    vibrates = least_motion(model) / tolerance if tolerance > 0.0 and sticks(model) else 0.0
    return max(LEAST * model.extent, vibrates)


@dataclass
class Balance:
    """Forces at a state: ``Q`` (n_full,) of elements and patches, ``F`` dead loads, ``R`` = Q - F on the unknowns,
    less what ``System.held`` bears.
    """

    Q: Array
    F: Array
    R: Array
    energy: float


# a state (n_full,) and its whole turns (bodies,), as ``model.rotation.Turns`` has them
Turned = tuple[Array, Array]


class System:
    """A model with its tangent matrix; one object per solve."""

    def __init__(self, model: Model) -> None:
        self.model, self.groups = model, with_trials(model.groups)
        self.crew = Crew(self.groups, model.numbering)
        self.matrix = make_matrix(model)
        n = model.numbering
        self.weights = np.zeros(n.n_unknowns)
        coordinates = n.free < n.n_q
        self.weights[coordinates] = model.weights[n.free[coordinates]]
        self.evaluations = 0
        # forces (n_unknowns,) that hold a state in balance beside the loads
        self.held: Array | None = None
        # the last accepted state (n_full,) with its load factor, from which bodies slide along obstacles
        self.accepted: tuple[Array, float] | None = None
        # along what contacts change at a state (n_full,) and factor, where not at that load: how unknowns answer then
        self.along: Callable[[Array, float], Callable[[Array], Array]] | None = None
        # the state (n_full,) and factor that elements keep on trial
        self._tried: tuple[Array, float] | None = None
        self._dead: tuple[float, Array] | None = None
        self._counted: Turned = np.zeros(len(n.place)), np.zeros(len(model.meshes))

    def _dead_loads(self, t: float) -> Array:
        """Return the dead loads (n_full,) at t, made anew where t has changed; not to be written to."""
        if self._dead is None or self._dead[0] != t:
            self._dead = t, self.model.external(t)
            self._dead[1].flags.writeable = False
        return self._dead[1]

    @cached_property
    def room(self) -> Balance:
        """Return arrays for forces that are gone with the next ones: fresh pages for long ones take time each time."""
        num = self.model.numbering
        return Balance(np.zeros(len(num.place)), np.zeros(0), np.zeros(num.n_unknowns), 0.0)

    @cached_property
    def _sizes(self) -> Array:
        return np.zeros(len(self.model.numbering.place))

    def _no_forces(self, out: Balance | None) -> tuple[Array, Array | None]:
        """Return zeros for the forces (n_full,), and where the residual goes."""
        if out is None:
            return np.zeros(len(self.model.numbering.place)), None
        out.Q.fill(0.0)
        return out.Q, out.R

    def patches(self, d: Array, t: float, elastic: bool = False, linear: bool = False
                ) -> Iterator[tuple[float, Array, Array, Index]]:
        """Yield (energy, Q, K, dofs) of springs, constraints and, unless ``elastic``, of loads that turn or move.

        ``linear``: constraints are those of linear theory about the reference.
        """
        model, n_q = self.model, self.model.n_q
        if not model.patches and not model.constraints:
            return
        if model.winds:
            model.turns.recall(model.springs, model.e0 + d[:n_q], d[:n_q], self.count(d, t))
        yield from model.interactions.patches(d, t, elastic, linear)

    def assemble(self, d: Array, t: float, load_stiffness: bool = True, out: Balance | None = None) -> Balance:
        """Return the forces at d (n_full,), in arrays of ``out`` if given, and fill the tangent matrix.

        ``load_stiffness=False`` leaves the derivative of turning loads out of the matrix (linear theory about the
        reference).
        """
        self.evaluations += 1
        self._tried = None
        self.matrix.clear()
        Q, R = self._no_forces(out)
        self.model.set_natural(t if load_stiffness else None)
        energy = self.crew.total(lambda g: force_tangent(g, d, 1.0, Q, self.matrix.target, self.model.numbering.places))
        for u, q, K, dofs in self.patches(d, t, not load_stiffness, not load_stiffness):
            energy += u
            np.add.at(Q, dofs, q)
            scatter_patches(self.matrix.target, np.ascontiguousarray(K), dofs, 0, len(dofs),
                            self.model.numbering.places)
        if not load_stiffness:
            self.add_loads(Q, d, t)
            energy += self.add_natural(Q, d, None, t)
        return self._balance(Q, R, t, energy)

    def _balance(self, Q: Array, room: Array | None, t: float, energy: float) -> Balance:
        F = self._dead_loads(t)
        R = self.model.numbering.reduce(Q, F, room)
        if self.held is not None:
            R -= self.held
        return Balance(Q, F, R, float(energy))

    def noise(self, d: Array, t: float) -> Array:
        """Return what round-off alone can leave of the residual at d (n_unknowns,), until it is asked for again."""
        n, out = self.model.numbering, self._sizes
        np.abs(self._dead_loads(t), out=out)
        self.model.set_natural(t)
        self.crew.total(lambda g: force_noise(g, d, out))
        for _, q, K, dofs in self.patches(d, t):
            np.add.at(out, dofs, np.abs(q) + np.einsum("mij,mj->mi", np.abs(K), np.abs(d[dofs])))
        if sticks(self.model):
            # what sticks is held as well as its position is known
            for batch in self.model.interactions.held:
                K = np.abs(batch.matrices(d, t)[2])
                np.add.at(out, batch.dofs, self.model.extent * K[:, :, :-1].sum(axis=2))
        if any(not pair.hard for pair in self.model.contacts):
            # and what a layer bears
            for batch in self.model.interactions.springs:
                K = np.abs(batch.matrices(d, t)[2]) * (batch.table.restitution != -1.0)[:, None, None]
                np.add.at(out, batch.dofs, self.model.extent * K.sum(axis=2))
        # constraints hold no better than positions are known
        scales = np.array([c.scale for c in self.model.constraints])
        out[self.model.n_q:] += scales
        sizes = n.reduce_sizes(out)
        if isinstance(self.matrix, Symmetric):
            self.matrix.add_pulls(scales, sizes)
        sizes *= UNIT_ROUNDOFF
        return sizes

    def still(self, d: Array, t: float) -> float:
        """Return the displacement [m] below which nothing moves: what round-off of forces does, by the last factors."""
        return ROUNDED * self.norm(self.matrix.solve(self.noise(d, t)))

    def rigid_forces(self) -> Array:
        """Return what round-off makes of no force: those of elements in unit rigid motions (3, n_unknowns).

        Two translations by 1 m and a turn that moves the coordinates by up to 1 m, in the reference. What these forces
        move stands for what is not known of a linear solution: soft motions are told from stiff ones by differences of
        displacements that are as large.
        """
        n_q = self.model.n_q
        motions = np.zeros((n_q, 3))
        for mesh in self.model.meshes.values():
            motions[mesh.first_dof:mesh.first_dof + mesh.n_dofs] = own_motions(mesh, self.model.e0)
        out, zero = np.zeros((3, self.model.numbering.n_unknowns)), np.zeros(len(self.model.numbering.place))
        self.model.set_natural(None)
        for k in range(3):
            moved, forces = zero.copy(), zero.copy()
            # no power of two, whose products would be exact
            moved[:n_q] = 1.1 * motions[:, k] / np.max(self.model.weights * np.abs(motions[:, k]))
            self._act(zero, moved, forces)
            out[k] = self.model.numbering.reduce(forces) / 1.1
        return out

    def accept(self, d: Array, t: float) -> None:
        """Let laws that have a memory remember the state d (n_full,) at t: a step has been accepted there."""
        if self.model.contacts:
            self.accepted = d.copy(), t
            for batch in (*self.model.interactions.springs, *self.model.interactions.held):
                batch.accept(d, t)
        if not self.model.remembers:
            return
        tried, self._tried = self._tried, None
        if tried is not None and tried[1] == t and np.array_equal(tried[0], d):
            for group in self.groups:
                group.values.memory.states[:] = group.values.memory.trial
            return
        self.model.set_natural(t)
        for group in self.groups:
            if group.law.state:
                commit(group, d)

    def add_loads(self, Q: Array, d: Array, t: float, sign: float = 1.0) -> None:
        """Add the forces of loads that turn or move at d and t to Q (n_full,), times ``sign``."""
        e = self.model.e0 + d[:self.model.n_q]
        for load in self.model.interactions.loads if self.model.loads.patches else ():
            np.add.at(Q, load.dofs, sign * load.evaluate(e, d, t)[1])

    def add_natural(self, Q: Array, d: Array, at: float | None, to: float) -> float:
        """Add to Q (n_full,) what linear theory about d and the natural strains at a factor makes of those at another.

        None stands for no natural strains. Returns the energy that they would store if nothing moved.
        """
        model = self.model
        if not model.loads.natural:
            return 0.0
        model.set_natural(at, {k: load.amplitude(to) - (0.0 if at is None else load.amplitude(at))
                               for k, load in enumerate(model.loads.natural)})
        return sum(natural_slope(group, d, Q) for group in model.groups)

    def forces(self, d: Array, t: float, out: Balance | None = None, linear: bool = False) -> Balance:
        """Return the forces at d without a tangent, in arrays of ``out`` if given.

        ``linear``: constraints and natural strains are those of linear theory about the reference.
        """
        Q, R = self._no_forces(out)
        self.model.set_natural(None if linear else t)
        energy = self.crew.total(lambda g: force(g, d, Q))
        if self.model.remembers:
            self._tried = None if linear else (d.copy(), t)
        for u, q, _, dofs in self.patches(d, t):
            energy += u
            np.add.at(Q, dofs, q)
        if linear:
            energy += self.add_natural(Q, d, None, t)
        return self._balance(Q, R, t, energy)

    def action(self, d: Array, v: Array, t: float, linear: bool = False, loads: bool = False) -> Array:
        """Return K(d) v of elements, springs, constraints and, if asked, loads that turn, in full coordinates.

        ``linear`` is that of ``patches``.
        """
        out = np.zeros(len(d))
        self.model.set_natural(None if linear else t)
        self._act(d, v, out)
        for _, _, K, dofs in self.patches(d, t, not loads, linear):
            np.add.at(out, dofs, np.einsum("mij,mj->mi", K, v[dofs]))
        return out

    def _act(self, d: Array, v: Array, out: Array) -> None:
        self.crew.total(lambda g: tangent_action(g, d, v, out))

    def factor(self, at: dict[str, Any]) -> Pivots:
        """Factor the tangent; raises ComputationError that names the free coordinates where it is singular."""
        pivots = self.matrix.factor()
        if pivots.bad >= 0:
            raise self.singular(pivots.bad, at)
        return pivots

    def answers(self, d: Array, t: float) -> Callable[[Array], Array]:
        """Return how the unknowns answer to forces (n_unknowns,), by the tangent at d (n_full,) and t as last factored.

        At this load or, on a path, along what picks its points.
        """
        return self.matrix.solve if self.along is None else self.along(d, t)

    def check_tangent(self, d: Array, t: float, pivots: Pivots) -> None:
        """Check as ``check_strained`` does the tangent at d (n_full,) and t, as it was assembled and factored last."""
        num = self.model.numbering

        def apply(z: Array) -> Array:
            full = np.zeros(len(d))
            num.expand(z, full)
            return num.reduce(self.action(d, full, t, loads=True))

        self.check_strained(apply, pivots, {"factor": float(f"{t:.6g}")})

    def check_strained(self, apply: Callable[[Array], Array], pivots: Pivots, at: dict[str, Any]) -> None:
        """Raise SingularTangentError where a motion strains nothing, but has round-off for a stiffness in the factors.

        Random forces move such a motion more than any other. ``apply`` is the stiffness through the strains, which
        tells it from a soft one.
        """
        if pivots.smallest > SUSPECT:
            return
        forces = self.weights * np.random.default_rng(0).standard_normal(len(self.weights))
        moved = self.matrix.solve(forces)
        if abs(moved @ apply(moved)) < HIDDEN * abs(moved @ forces):
            raise self.singular(int(np.argmax(self.weights * np.abs(moved))), at)

    def singular(self, unknown: int, at: dict[str, Any]) -> SingularTangentError:
        """Return what to raise where an unknown has no stiffness."""
        full = int(self.model.numbering.free[unknown])
        if full < self.model.n_q and self.model.contacts:
            return SingularTangentError(
                f"the tangent stiffness is singular: nothing holds {self.model.describe_coordinate(full)}; contacts "
                "hold a body only while they press", at=at,
                advice="a support or a weak spring that holds it until it touches; without a law, bodies that touch "
                "with no gap at the start; or a motion (type: dynamic with damping) that comes to rest")
        if full < self.model.n_q:
            return SingularTangentError(
                f"the tangent stiffness is singular: {self.model.describe_coordinate(full)} has no stiffness", at=at,
                advice="a support or joint that holds it, or a quadrature with more points if it is a zero-energy mode")
        held = self.model.constraints[full - self.model.n_q]
        return SingularTangentError(
            f"the tangent stiffness is singular: {held.owner} ({held.holds}) repeats or contradicts other supports, "
            "joints and rigid bodies", at=at, advice="supports and joints that hold each motion only once")

    def turns(self) -> Turned:
        """Return what turns are counted from: the state last counted or, where torsion springs wind, evaluated."""
        return self._counted

    def count_from(self, turns: Turned) -> None:
        """Count turns from a state again, after others were tried."""
        self._counted = turns

    def count(self, d: Array, t: float) -> Array:
        """Count turns on to a state d (n_full,); return them (bodies,). A prescribed angle means its full turns."""
        turns, n_q = self.model.turns, self.model.n_q
        turned = turns.follow(*self._counted, d)
        for point, angle in (told for c in self.model.constraints for told in c.turns_by(t)):
            turns.hold(point, angle, self.model.e0 + d[:n_q], d[:n_q], turned)
        self._counted = d.copy(), turned
        return turned

    @property
    def knows_inertia(self) -> bool:
        """Whether the last negative pivots count negative eigenvalues: not where rows were exchanged."""
        return self.model.symmetric and self.matrix.knows_inertia

    def norm(self, z: Array) -> float:
        """Return the largest displacement that a change of the unknowns stands for [m]."""
        return largest(z, self.weights)

    def distance(self, d: Array, other: Array) -> float:
        """Return the largest displacement between two states (n_full,) [m]."""
        where = self.model.numbering.where
        a, b = d[where], other[where]
        return max((largest(a[p] - b[p], self.weights[p]) for p in pieces(len(a))), default=0.0)

    def imbalance(self, balance: Balance) -> float:
        """Return the largest residual beside the largest force, both as forces [N] through the coordinates' weights."""
        n_q, w = self.model.n_q, self.model.weights
        scale = max(largest_share(balance.Q[:n_q], w), largest_share(balance.F[:n_q], w))
        return largest_share(balance.R, self.weights) / scale if scale > 0.0 else 0.0

    def balances(self, balance: Balance, d: Array, t: float, share: float) -> bool:
        """Whether no residual exceeds a share of the largest force of one spring or load alone at d (n_full,).

        Where they cancel on the coordinates that they share, as a torque does with the spring that it winds up, no sum
        tells how large they are, and round-off of the solution is larger than that of the sums.
        """
        weights, largest_force = np.zeros(len(d)), 0.0
        weights[:self.model.n_q] = self.model.weights
        for _, q, _, dofs in self.patches(d, t):
            largest_force = max(largest_force, largest_share(q.ravel(), weights[dofs].ravel()))
        return largest_share(balance.R, self.weights) <= share * largest_force

    def describe(self, unknown: int) -> str:
        """Return the name of an unknown: coordinate, body and place."""
        full = int(self.model.numbering.free[unknown])
        if full >= self.model.n_q:
            return self.model.describe_multiplier(full - self.model.n_q)
        return self.model.describe_coordinate(full)
