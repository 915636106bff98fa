"""Equilibrium of models that only their weight holds: ropes, chains and pendulums, from any start.

Such a model may be a mechanism in its reference, where the tangent is singular or the equilibrium unstable. From there
it sinks as if in a medium so viscous that inertia plays no part: M z' = -R(z), in implicit steps of growing length h
[s^2] (pseudo-transient continuation; Kelley & Keyes 1998). As long as K + M/h is positive definite over each step, the
potential falls, so that the motion ends in a minimum, which Newton's method then finds exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, cast

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError, SingularTangentError
from ...model.build import can_hang
from ...model.determinacy import free_motions
from ...model.model import Model
from ..active_set import ROUNDS, initialise_active_set, update_active_set
from ..contact import check_crossed, memory, restore_memory
from ..least_motion import STILL
from ..lift_off import PlaceHistory
from ..linear import assemble_mass, make_matrix
from ..long_vectors import largest
from ..state import State
from ..system import Balance, System
from .newton import NewtonResult, check_sound, negative_pivots, newton, state_of

# a body counts as slack if its weight exceeds this many times EI/L^2
SLACK = 100.0
# shares of the extent: first step, longest step, longest step after which Newton's method is tried, error of a step,
# push away from an unstable equilibrium, and distance from it before Newton's method is tried again
FIRST_STEP, LONGEST_STEP, SHORT_STEP, STEP_ERROR, PUSH, RETRY_DISTANCE = 0.05, 0.25, 0.02, 1e-7, 0.01, 0.1
MOST_STEPS = 5000
MOST_ITERATIONS = 12
# the next step grows after few iterations and shrinks after many; failed steps are repeated with a shorter length
EASY, GROW, SHRINK = 4, 3.0, 0.3
# largest number of steps between two tries of Newton's method; it doubles with each try that fails
LONGEST_WAIT = 32
# share of the first step below which a failing step is given up
SHORTEST = 1e-15
# beyond this many times the extent from the start, the model falls for ever
FARTHEST_FALL = 100.0
# number of steps for moving supports, and the share of one below which a shorter one is given up; sag given to links
# stretched out between them: as a share of the extent, and uniform (0) or as a parabola (1)
SUPPORT_STEPS, SHORTEST_SUPPORT_STEP = 40, 1e-4
SAGS = (0.02, 0), (0.05, 1), (0.07, 1), (0.05, 0), (0.03, 1), (0.1, 1)

FELL = ("no path of stable equilibria leads from the reference to the full load: the reported equilibrium is the one "
        "to which the model sinks from the end of the path")
FALLS = ("supports leave a mechanism until bodies touch or tendons tighten: the reported equilibrium is the one to "
         "which the model sinks under its weight from the reference")


def slack(model: Model) -> bool:
    """Return whether gravity bends a body of the model as if it had no bending stiffness."""
    g = sum(np.hypot(*load.acceleration) for load in model.case.loads if load.acceleration is not None)
    sections = [(m.plan.section, m.plan.length) for m in model.meshes.values() if not m.plan.rigid]
    return any(g * section.rhoA * length**3 > SLACK * section.EI for section, length in sections)


def free_without(model: Model, springs: Sequence[Any]) -> bool:
    """Return whether bodies could move freely without some springs."""
    others = [spring for spring in model.springs if spring not in springs]
    return bool(free_motions([*model.meshes.values()], model.rows, model.constraints, others, model.e0))


def tethered(model: Model) -> bool:
    """Return whether elastic tendons hold a mechanism under gravity, which can go slack."""
    if not model.loads.springs or model.contacts or not can_hang(model.case):
        return False
    return free_without(model, model.loads.springs)


def hanging(system: System, d: Array, factors: tuple[float, float], tolerance: float, max_iterations: int,
            why: list[str]) -> State:
    """Return a stable equilibrium that is found from the state d (n_full,).

    ``factors``: the load factor of the supports in d, and that of the equilibrium. ``why``: warnings for the state.
    Raises ComputationError if none is found.
    """
    t = factors[1]
    relaxation = _Relaxation(system, d, factors, tolerance, max_iterations)
    result = relaxation.run()
    if not system.model.winds:
        # loops that a rope pulls tight vanish, and it is arbitrary which of its sections turn over then
        system.count_from(relaxation.turns)
    warnings = list(why)
    if relaxation.pushed:
        warnings.append(f"the start is next to an unstable equilibrium (negative pivots: {relaxation.pushed}); a "
                        f"displacement of {PUSH:g} of the extent leads to the reported equilibrium, which is stable")
    check_sound(system.model, result.d, None, t)
    if result.negative_pivots > 0 and system.knows_inertia:
        warnings.append(f"unstable equilibrium at load factor {t:.6g} (negative pivots: {result.negative_pivots})")
    result.iterations += relaxation.iterations
    return state_of(system, result, t, relaxation.steps, relaxation.failures, warnings)


class _Medium:
    """A system in a viscous medium, for a step from z0 (n_unknowns,); ``rate`` [1/s^2] is 1/h."""

    def __init__(self, system: System, M: Array, z0: Array, rate: float) -> None:
        self.system, self.M, self.z0, self.rate = system, M, z0, rate

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the system itself."""
        return getattr(self.system, name)

    def assemble(self, d: Array, t: float) -> Balance:
        """Return the balance with the residual R(z) + M (z - z0)/h, and fill the tangent."""
        system = self.system
        balance = system.assemble(d, t)
        z = d[system.model.numbering.where]
        R = balance.R + self.rate * system.matrix.product(self.M, z - self.z0)
        system.matrix.values[...] += self.rate * self.M
        return replace(balance, R=R)


class _Relaxation:
    """A model in a viscous medium; ``d`` (n_full,) is its state, ``h`` [s^2] the length of the next step."""

    def __init__(self, system: System, d: Array, factors: tuple[float, float], tolerance: float,
                 max_iterations: int) -> None:
        self.system, self.model = system, system.model
        self.begin, self.t = factors
        self.tolerance, self.max_iterations = tolerance, max_iterations
        mass = make_matrix(self.model)
        assemble_mass(self.model, mass)
        self.M: Array = mass.target.values
        self.start = self.d = d
        self.hard = any(pair.hard for pair in self.model.contacts)
        initialise_active_set(system, d, factors[0])
        g = max((float(np.hypot(*load.acceleration)) for load in self.model.case.loads
                 if load.acceleration is not None), default=0.0)
        self.extent = self.model.extent
        self.h = FIRST_STEP * self.extent / (g or 1.0)
        self.shortest = SHORTEST * self.h
        self.steps = self.iterations = self.failures = 0
        # whether the potential must fall in each step
        self.checked = True
        # negative pivots of an unstable equilibrium at the start, and the unstable equilibrium left last
        self.pushed = 0
        self.last_unstable: Array | None = None
        # the turns once supports have reached their positions, from which those of the equilibrium are counted
        self.turns = system.turns()

    def run(self) -> NewtonResult:
        """Return the equilibrium to which the model sinks.

        Raises ComputationError if it does not come to rest.
        """
        if self.model.moves:
            # moving supports do work, so that the potential need not fall
            self.checked = False
            self._move_supports()
            self.checked = True
            self.turns = self.system.turns()
        wait = left = 0
        while self.steps < MOST_STEPS and self.system.distance(self.d, self.start) < FARTHEST_FALL * self.extent:
            moved, left = self._make_step(self.t), left - 1
            # if a step of any length hardly moves the model, it cannot get away from the last equilibrium
            unstable, rests = self.last_unstable, moved <= STEP_ERROR * self.extent
            near_unstable = unstable is not None and (
                self.system.distance(self.d, unstable) <= RETRY_DISTANCE * self.extent)
            if moved > SHORT_STEP * self.extent or (not rests and (near_unstable or left > 0)):
                continue
            result = self._newton(rests)
            if result is None and moved <= STILL * self.extent:
                result = self._as_result(moved)
            if result is None:
                left = wait = min(2 * wait + 1, LONGEST_WAIT)
                continue
            if not self.system.knows_inertia or result.negative_pivots <= 0:
                return result
            if self.system.distance(result.d, self.start) <= SHORT_STEP * self.extent:
                self.pushed = result.negative_pivots
            self.last_unstable, wait = result.d, 0
            self._push()
        touch = "contacts with a law, or a motion with damping (type: dynamic); " if self.hard else ""
        raise ComputationError("the model does not come to rest under its weight", at={"steps": self.steps},
                               advice=f"{touch}supports or joints for all parts that can move without limit, or "
                               "gravity on all parts that can move")

    def _make_step(self, t: float) -> float:
        """Make one step at load factor t; return how far it moved [m]. Failed steps are repeated shorter."""
        while True:
            self.steps += 1
            if self.steps > MOST_STEPS:
                return 0.0
            turns = self.system.turns()
            try:
                d, iterations = self._step(t)
            except ComputationError as error:
                self.system.count_from(turns)
                self.failures, self.h = self.failures + 1, SHRINK * self.h
                if self.h < self.shortest:
                    raise ComputationError("no equilibrium under gravity was found from this start: "
                                           f"{error.failure.reason}", at=error.failure.at,
                                           advice="a reference that is not straight between its supports"
                                           ) from error
                continue
            moved = self.system.distance(d, self.d)
            self.d = d
            self.system.count(d, t)
            self.h *= GROW if iterations <= EASY else GROW**0.5 if iterations <= 2 * EASY else 1.0 / GROW**0.5
            return moved

    def _step(self, t: float) -> tuple[Array, int]:
        """Return the end of a step, R(z) + M (z - z0)/h = 0, without penetrations, and the number of iterations.

        Raises ComputationError.
        """
        kept, iterations, history = memory(self.model), 0, PlaceHistory()
        z0 = self.d[self.model.numbering.where].copy()
        medium = _Medium(self.system, self.M, z0, 1.0 / self.h)
        d = self.model.displacements(z0, t)
        try:
            for _ in range(ROUNDS if self.hard else 1):
                d, count = self._balance(medium, d, t)
                iterations = max(iterations, count)
                if not self.hard or not update_active_set(cast(System, medium), d, t, history)[0]:
                    check_crossed(self.model, d, (self.d, t), t)
                    return d, iterations
            raise ComputationError("the contact points were not found", at={"factor": float(f"{t:.6g}")})
        except ComputationError:
            restore_memory(self.model, kept)
            raise

    def _balance(self, medium: _Medium, d: Array, t: float) -> tuple[Array, int]:
        """Return the balance in the medium near d (n_full,), and the number of iterations. Raises ComputationError."""
        system, num = self.system, self.model.numbering
        at, z0, z = {"factor": float(f"{t:.6g}")}, medium.z0, d[num.where].copy()
        sizes: list[float] = []
        for iteration in range(1, MOST_ITERATIONS + 1):
            R = medium.assemble(d, t).R
            pivots = system.factor(at)
            self.iterations += 1
            if self.checked and pivots.negative > num.n_multipliers and system.knows_inertia:
                raise ComputationError("the potential is not convex over the whole step", at=at)
            dz = -system.matrix.solve(R)
            sizes.append(system.norm(dz))
            z += dz
            if not np.isfinite(sizes[-1]) or system.norm(z - z0) > LONGEST_STEP * self.extent:
                raise ComputationError("the step goes too far", at=at)
            d = self.model.displacements(z, t)
            if sizes[-1] <= STEP_ERROR * self.extent:
                return d, iteration
        raise ComputationError("the step does not converge", at=at, history=sizes)

    def _newton(self, rests: bool) -> NewtonResult | None:
        """Return the equilibrium next to the current state, or None if there is none near.

        Raises SingularTangentError if no step moves the model (``rests``) and its tangent is singular.
        """
        turns = self.system.turns()
        try:
            result = newton(self.system, self.d.copy(), self.t, self.t, self.tolerance, self.max_iterations)
            # gravity is so weak compared with the stiffness of a rope that a second solve improves the result
            with suppress(ComputationError):
                result = newton(self.system, result.d.copy(), self.t, self.t, self.tolerance, self.max_iterations)
            if self.system.distance(result.d, self.d) > RETRY_DISTANCE * self.extent:
                raise ComputationError("another equilibrium", at={})
            result.negative_pivots = negative_pivots(self.system, result.d, self.t)
        except ComputationError as error:
            self.system.count_from(turns)
            if rests and isinstance(error, SingularTangentError):
                raise
            return None
        self.system.count(result.d, self.t)
        return result

    def _as_result(self, moved: float) -> NewtonResult:
        """Return the current state as the equilibrium, if no step moves it but round-off stops Newton's method."""
        system, num = self.system, self.model.numbering
        balance = system.assemble(self.d, self.t)
        pivots = system.factor({"factor": float(f"{self.t:.6g}")})
        return NewtonResult(self.d, balance.Q, balance.F, balance.energy, largest(balance.R), 0, [moved],
                            np.zeros(num.n_unknowns), pivots.negative - num.n_multipliers, moved)

    def _move_supports(self) -> None:
        """Move the supports to their places, in shorter and shorter steps where the model does not follow."""
        whole = (self.t - self.begin) / SUPPORT_STEPS
        self._begin_support_motion(self.begin + whole)
        share, done = 1.0, 1.0
        while done < SUPPORT_STEPS:
            h, last = self.h, min(done + share, float(SUPPORT_STEPS))
            try:
                self._make_step(self.begin + last * whole)
            except ComputationError:
                share, self.h = 0.25 * share, h
                if share < SHORTEST_SUPPORT_STEP:
                    raise
            else:
                done, share = last, min(2.0 * share, 1.0)

    def _begin_support_motion(self, factor: float) -> None:
        """Make the first step of moving supports.

        Links in one line between their supports bear any force, and their direction of sagging is undetermined: they
        are made to sag in several ways, until the step converges from one of them.
        """
        start = self.d
        failure: ComputationError | None = None
        for sag, power in ((0.0, 0), *SAGS):
            self.d = start if failure is None else self._sagging(start, sag, power)
            try:
                self._make_step(factor)
            except ComputationError as error:
                failure = failure or error
                self.h = self.shortest / SHORTEST
            else:
                return
        assert failure is not None
        raise failure

    def _sagging(self, d: Array, sag: float, power: int) -> Array:
        """Return a state that has sagged from d (n_full,) by a share of the extent."""
        model, num = self.model, self.model.numbering
        g = sum((np.array(load.acceleration) for load in model.case.loads if load.acceleration is not None),
                np.zeros(2))
        g /= np.hypot(*g) or 1.0
        across, down = np.zeros(len(num.place)), np.zeros(len(num.place))
        for mesh in model.meshes.values():
            x = mesh.first_dof + np.flatnonzero(mesh.kinds == 0)
            across[x] = across[x + 1] = g[1] * model.e0[x] - g[0] * model.e0[x + 1]
            down[x], down[x + 1] = g
        places = across[down != 0.0]
        s = (across - places.min()) / (np.ptp(places) or 1.0)
        moved = d + sag * self.extent * (4.0 * s * (1.0 - s)) ** power * down
        return model.displacements(moved[num.where], self.begin)

    def _push(self) -> None:
        """Move away from an unstable equilibrium along the fastest growing shape, by a few inverse iterations."""
        system, num = self.system, self.model.numbering
        while True:
            system.assemble(self.d, self.t)
            system.matrix.values[...] += self.M / self.h
            if system.matrix.factor().negative <= num.n_multipliers:
                break
            self.h *= SHRINK
        v = system.weights * np.random.default_rng(0).standard_normal(num.n_unknowns)
        for _ in range(20):
            v = system.matrix.solve(system.matrix.product(self.M, v))
            v /= system.norm(v)
        v *= np.sign(v[int(np.argmax(system.weights * np.abs(v)))])
        self.d = self.model.displacements(self.d[num.where] + PUSH * self.extent * v, self.t)
        system.count(self.d, self.t)
