"""Residual and tangent of a model at a state: elements, patches, constraints and dead loads together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..elements.shape import Array
from ..errors import SingularTangentError
from ..kernels.elements import commit, force, force_noise, force_tangent, natural_slope, tangent_action
from ..kernels.matrices.matrix import scatter_patches
from ..model.couplings import MARGIN
from ..model.determinacy import own_motion
from ..model.groups import with_trials
from ..model.mesh import Index
from ..model.model import Model
from .divided_groups import DividedGroups
from .ldl import Pivots, Symmetric, SymmetricFronts
from .least_motion import UNIT_ROUNDOFF, sticks
from .linear import make_matrix
from .long_vectors import chunks, largest, largest_share

# factor for round-off of forces that has the same sign everywhere
ROUNDED = 10.0
# relative pivots above this are not round-off
SUSPECT = 1e-10
# work through the strains, relative to that of the forces, below which a motion strains nothing
HIDDEN = 1e-8


@dataclass
class Balance:
    """Forces at a state: ``Q`` (n_full,) of elements and patches, ``F`` dead loads, ``R`` = Q - F on the unknowns,
    minus ``System.balancing_forces``."""

    Q: Array
    F: Array
    R: Array
    energy: float


# a state (n_full,) and its ``turned`` (bodies,); see ``model.rotation.Turns``
Turned = tuple[Array, Array]


class System:
    """A model with its tangent matrix; one object per solve."""

    def __init__(self, model: Model, fixed: bool = False) -> None:
        """``fixed``: the entries of the matrix never change, even if bodies come near each other."""
        self.model, self.groups = model, with_trials(model.groups)
        self.divided = DividedGroups(self.groups, model.numbering)
        n = model.numbering
        follows = n.couplings is not None and not fixed and model.symmetric
        self.matrix = make_matrix(model, n.in_reference if follows else n.complete)
        self.weights = n.of_unknowns(model.weights)
        self.evaluations = 0
        # additional forces (n_unknowns,) that balance a state
        self.balancing_forces: Array | None = None
        # the last accepted state (n_full,) with its load factor, from which slip on obstacles is measured
        self.accepted: tuple[Array, float] | None = None
        # how the unknowns respond to forces at a state (n_full,) and factor, if the load changes with them (paths)
        self.along: Callable[[Array, float], Callable[[Array], Array]] | None = None
        # the state (n_full,) and factor of the trial history variables
        self._tried: tuple[Array, float] | None = None
        self._dead: tuple[float, Array] | None = None
        self._counted: Turned = np.zeros(len(n.place)), np.zeros(len(model.meshes))

    def _dead_loads(self, t: float) -> Array:
        """Return the dead loads (n_full,) at t, read-only; evaluated only if t has changed."""
        if self._dead is None or self._dead[0] != t:
            self._dead = t, self.model.external(t)
            self._dead[1].flags.writeable = False
        return self._dead[1]

    @cached_property
    def room(self) -> Balance:
        """Reusable arrays for forces, overwritten by the next evaluation; allocating long arrays each time is slow."""
        num = self.model.numbering
        return Balance(np.zeros(len(num.place)), np.zeros(0), np.zeros(num.n_unknowns), 0.0)

    @cached_property
    def _sizes(self) -> Array:
        return np.zeros(len(self.model.numbering.place))

    def _no_forces(self, out: Balance | None) -> tuple[Array, Array | None]:
        """Return zeros for the forces (n_full,), and the array for the residual, if any."""
        if out is None:
            return np.zeros(len(self.model.numbering.place)), None
        out.Q.fill(0.0)
        return out.Q, out.R

    def patches(self, d: Array, t: float, elastic: bool = False, linear: bool = False
                ) -> Iterator[tuple[float, Array, Array, Index]]:
        """Yield energy, Q, K and dofs of springs, flows, constraints and, unless ``elastic``, turning or moving loads.

        ``linear``: constraints are linearised about the reference.
        """
        model, n_q = self.model, self.model.n_q
        if not model.patches and not model.constraints:
            return
        if model.winds:
            model.turns.set_spring_angles(model.springs, model.e0 + d[:n_q], d[:n_q], self.count(d.copy(), t))
        yield from model.interactions.patches(d, t, elastic, linear)

    def assemble(self, d: Array, t: float, load_stiffness: bool = True, out: Balance | None = None,
                 more: Sequence[tuple[Array, Index]] = ()) -> Balance:
        """Return the forces at d (n_full,), in arrays of ``out`` if given, and fill the tangent matrix.

        ``load_stiffness=False`` is linear theory about the reference: loads have no stiffness, constraints are linear,
        and natural strains act as loads. ``more``: further matrices (m, n, n) to add, and their coordinates (m, n).
        """
        self.evaluations += 1
        self._tried = None
        balance, margin = self._assemble(d, t, load_stiffness, out, more), MARGIN
        while self.missed:
            self.follow(d, t, margin)
            balance, margin = self._assemble(d, t, load_stiffness, out, more), 2.0 * margin
        return balance

    @property
    def missed(self) -> bool:
        """Return whether the matrix lacks entries that were assembled: bodies touch where they were not near."""
        return isinstance(self.matrix, SymmetricFronts) and self.matrix.missed

    def follow(self, d: Array, t: float, margin: float = MARGIN) -> None:
        """Replace the matrix by an empty one with the entries for all elements near each other at d (n_full,)."""
        # the coordinates of patches that have a stiffness between different coordinates
        rows = (dofs[np.count_nonzero(K, axis=(1, 2)) > np.count_nonzero(np.einsum("mii->mi", K), axis=1)]
                for _, _, K, dofs in self.patches(d, t))
        self.matrix = make_matrix(self.model, self.model.numbering.near(d, margin, rows))

    def _assemble(self, d: Array, t: float, load_stiffness: bool, out: Balance | None,
                  more: Sequence[tuple[Array, Index]]) -> Balance:
        self.matrix.clear()
        Q, R = self._no_forces(out)
        places = self.matrix.places
        self.model.set_natural(t if load_stiffness else None)
        energy = self.divided.total(lambda g: force_tangent(g, d, 1.0, Q, self.matrix.target, places))
        for u, q, K, dofs in self.patches(d, t, not load_stiffness, not load_stiffness):
            energy += u
            np.add.at(Q, dofs, q)
            scatter_patches(self.matrix.target, np.ascontiguousarray(K), dofs, 0, len(dofs), places)
        for K, dofs in more:
            scatter_patches(self.matrix.target, K, dofs, 0, len(dofs), places)
        if not load_stiffness:
            self.add_loads(Q, d, t)
            energy += self.add_natural(Q, d, None, t)
        return self._balance(Q, R, t, energy)

    def _balance(self, Q: Array, room: Array | None, t: float, energy: float) -> Balance:
        F = self._dead_loads(t)
        R = self.model.numbering.reduce(Q, F, room)
        if self.balancing_forces is not None:
            R -= self.balancing_forces
        return Balance(Q, F, R, float(energy))

    def noise(self, d: Array, t: float) -> Array:
        """Return a bound of the round-off in the residual at d (n_unknowns,); the next call overwrites it."""
        n, out = self.model.numbering, self._sizes
        np.abs(self._dead_loads(t), out=out)
        self.model.set_natural(t)
        self.divided.total(lambda g: force_noise(g, d, out))
        for _, q, K, dofs in self.patches(d, t):
            np.add.at(out, dofs, np.abs(q) + np.einsum("mij,mj->mi", np.abs(K), np.abs(d[dofs])))
        for spring in self.model.springs:
            if spring.angle:
                np.add.at(out, spring.dofs[0], spring.moments_of_angle(d))
        if sticks(self.model):
            # forces on sticking points are only as accurate as their positions
            for batch in self.model.interactions.point_constraints:
                K = np.abs(batch.matrices(d, t)[2])
                np.add.at(out, batch.dofs, self.model.extent * K[:, :, :-1].sum(axis=2))
        if any(not pair.hard for pair in self.model.contacts):
            # and so are those of layers
            for batch in self.model.interactions.springs:
                K = np.abs(batch.matrices(d, t)[2]) * (batch.table.restitution != -1.0)[:, None, None]
                np.add.at(out, batch.dofs, self.model.extent * K.sum(axis=2))
        # constraints are met only as accurately as positions are known
        scales = np.array([c.scale for c in self.model.constraints])
        out[self.model.n_q:] += scales
        sizes = n.reduce_sizes(out)
        if isinstance(self.matrix, Symmetric):
            self.matrix.add_pulls(scales, sizes)
        # the round-off of one body moves others through joints, even if they bear nothing
        sizes[n.free < n.n_q] += UNIT_ROUNDOFF * largest(sizes)
        sizes *= UNIT_ROUNDOFF
        return sizes

    def displacement_noise(self, d: Array, t: float) -> float:
        """Return the displacement [m] below which nothing moves: the effect of round-off, by the last factors."""
        return ROUNDED * self.norm(self.matrix.solve(self.noise(d, t)))

    def rigid_forces(self) -> Iterator[Array]:
        """Yield the round-off in elastic forces (n_unknowns,) of three unit rigid motions, which should cause no force.

        The motions are two translations by 1 m, and a rotation that moves the coordinates by up to 1 m, in the
        reference. The displacements caused by these forces estimate the error of a linear solution: differences of
        displacements as large as these motions distinguish soft motions from stiff ones.
        """
        model = self.model
        zero, moved, forces = (np.zeros(len(model.numbering.place)) for _ in range(3))
        motion = moved[:model.n_q]
        model.set_natural(None)
        for k in range(3):
            for mesh in model.meshes.values():
                motion[mesh.first_dof:mesh.first_dof + mesh.n_dofs] = own_motion(mesh, model.e0, k)
            size = largest(motion, model.weights)
            # not a power of two, whose products would be exact
            motion *= 1.1
            motion /= size
            forces.fill(0.0)
            self._act(zero, moved, forces)
            yield model.numbering.reduce(forces) / 1.1

    def accept(self, d: Array, t: float) -> None:
        """Update the history variables of all laws with the accepted state d (n_full,) at t."""
        if self.model.contacts:
            self.accepted = d.copy(), t
            for batch in (*self.model.interactions.springs, *self.model.interactions.point_constraints):
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
        """Add the forces of turning and moving loads at d and t to Q (n_full,), times ``sign``."""
        e = self.model.e0 + d[:self.model.n_q]
        for load in self.model.interactions.loads if self.model.loads.patches else ():
            np.add.at(Q, load.dofs, sign * load.evaluate(e, d, t)[1])

    def add_natural(self, Q: Array, d: Array, at: float | None, to: float) -> float:
        """Add to Q (n_full,) the linear effect, about d, of natural strains that change from factor ``at`` to ``to``.

        None stands for no natural strains. Return the energy that the change would store if nothing moved.
        """
        model = self.model
        if not model.loads.natural:
            return 0.0
        model.set_natural(at, {k: load.amplitude(to) - (0.0 if at is None else load.amplitude(at))
                               for k, load in enumerate(model.loads.natural)})
        return sum(natural_slope(group, d, Q) for group in model.groups)

    def forces(self, d: Array, t: float, out: Balance | None = None, linear: bool = False) -> Balance:
        """Return the forces at d without a tangent, in arrays of ``out`` if given.

        With ``linear``, natural strains act as loads, as in linear theory about the reference.
        """
        Q, R = self._no_forces(out)
        self.model.set_natural(None if linear else t)
        energy = self.divided.total(lambda g: force(g, d, Q))
        if self.model.remembers:
            self._tried = None if linear else (d.copy(), t)
        for u, q, _, dofs in self.patches(d, t):
            energy += u
            np.add.at(Q, dofs, q)
        if linear:
            energy += self.add_natural(Q, d, None, t)
        return self._balance(Q, R, t, energy)

    def action(self, d: Array, v: Array, t: float, linear: bool = False, loads: bool = False) -> Array:
        """Return K(d) v of elements, springs, constraints and, with ``loads``, turning loads, in full coordinates.

        ``linear`` as in ``patches``.
        """
        out = np.zeros(len(d))
        self.model.set_natural(None if linear else t)
        self._act(d, v, out)
        for _, _, K, dofs in self.patches(d, t, not loads, linear):
            np.add.at(out, dofs, np.einsum("mij,mj->mi", K, v[dofs]))
        return out

    def _act(self, d: Array, v: Array, out: Array) -> None:
        self.divided.total(lambda g: tangent_action(g, d, v, out))

    def factor(self, at: dict[str, Any]) -> Pivots:
        """Factor the tangent; raises SingularTangentError with the names of free coordinates if it is singular."""
        pivots = self.matrix.factor()
        if pivots.bad >= 0:
            raise self.singular(pivots.bad, at)
        return pivots

    def response(self, d: Array, t: float) -> Callable[[Array], Array]:
        """Return the function that gives the response to forces (n_unknowns,), with the factored tangent at d and t.

        The load is fixed; on a path it follows the control.
        """
        return self.matrix.solve if self.along is None else self.along(d, t)

    def check_tangent(self, d: Array, t: float, pivots: Pivots) -> None:
        """Apply ``check_strained`` to the tangent at d (n_full,) and t that was assembled and factored last."""
        num = self.model.numbering

        def apply(z: Array) -> Array:
            return num.reduce(self.action(d, num.expanded(z), t, loads=True))

        self.check_strained(apply, pivots, {"factor": float(f"{t:.6g}")})

    def check_strained(self, apply: Callable[[Array], Array], pivots: Pivots, at: dict[str, Any]) -> None:
        """Raise SingularTangentError if a motion strains nothing and has only round-off as stiffness in the factors.

        Random forces cause mainly such a motion. ``apply`` is the stiffness through the strains, which distinguishes it
        from a soft motion.
        """
        if pivots.smallest > SUSPECT:
            return
        forces = self.weights * np.random.default_rng(0).standard_normal(len(self.weights))
        moved = self.matrix.solve(forces)
        if abs(moved @ apply(moved)) < HIDDEN * abs(moved @ forces):
            raise self.singular(int(np.argmax(self.weights * np.abs(moved))), at)

    def singular(self, unknown: int, at: dict[str, Any]) -> SingularTangentError:
        """Return the error to raise for an unknown without stiffness."""
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
        """Return the state from which turns are counted: the last one counted or, with torsion springs, evaluated."""
        return self._counted

    def count_from(self, turns: Turned) -> None:
        """Count turns from an earlier state again, after trials."""
        self._counted = turns

    def count(self, d: Array, t: float) -> Array:
        """Count turns up to a state d (n_full,), which is kept; return them (bodies,).

        A prescribed angle includes full turns.
        """
        turns, n_q = self.model.turns, self.model.n_q
        turned = turns.follow(*self._counted, d)
        for point, angle in (prescribed for c in self.model.constraints for prescribed in c.turns_by(t)):
            turns.match_angle(point, angle, self.model.e0 + d[:n_q], d[:n_q], turned)
        self._counted = d, turned
        return turned

    @property
    def knows_inertia(self) -> bool:
        """Return whether the last negative pivots count the negative eigenvalues: only if no rows were exchanged."""
        return self.model.symmetric and self.matrix.knows_inertia

    def norm(self, z: Array) -> float:
        """Return the largest displacement [m] in a change of the unknowns."""
        return largest(z, self.weights)

    def distance(self, d: Array, other: Array) -> float:
        """Return the largest displacement between two states (n_full,) [m]."""
        where = self.model.numbering.where
        a, b = d[where], other[where]
        return max((largest(a[p] - b[p], self.weights[p]) for p in chunks(len(a))), default=0.0)

    def imbalance(self, balance: Balance) -> float:
        """Return the largest residual relative to the largest force, both as forces [N] by the coordinates' weights."""
        n_q, w = self.model.n_q, self.model.weights
        scale = max(largest_share(balance.Q[:n_q], w), largest_share(balance.F[:n_q], w))
        return largest_share(balance.R, self.weights) / scale if scale > 0.0 else 0.0

    def balances(self, balance: Balance, d: Array, t: float, share: float) -> bool:
        """Return whether no residual exceeds a share of the largest force of a single spring or load at d (n_full,).

        If such forces cancel on shared coordinates, like a torque and the spring that it winds up, sums do not show
        their size, and round-off of the solution exceeds that of the sums.
        """
        weights, largest_force = np.zeros(len(d)), 0.0
        weights[:self.model.n_q] = self.model.weights
        for _, q, _, dofs in self.patches(d, t):
            largest_force = max(largest_force, largest_share(q.ravel(), weights[dofs].ravel()))
        return largest_share(balance.R, self.weights) <= share * largest_force

    def describe(self, unknown: int) -> str:
        """Return the label of an unknown: coordinate, body and place."""
        full = int(self.model.numbering.free[unknown])
        if full >= self.model.n_q:
            return self.model.describe_multiplier(full - self.model.n_q)
        return self.model.describe_coordinate(full)
