"""Newton's method: one equilibrium from a nearby state, and the criteria of convergence."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...errors import ComputationError, SingularTangentError
from ...interactions.prismatic import check_ends
from ...model.element_limits import check_inverted
from ...model.model import Model
from ...model.point_patch import check_facing
from ..active_set import (
    PENETRATION,
    ROUNDS,
    STRATEGIES,
    Strategy,
    check_supports,
    initialise_active_set,
    not_found,
    update_active_set,
)
from ..contact import check_crossed, check_pressed_through, memory, pressing_points, restore_memory, softer_layers
from ..friction import stick_least_slipping
from ..least_motion import STILL, UNIT_ROUNDOFF, sticks
from ..lift_off import PlaceHistory
from ..long_vectors import chunks, largest
from ..state import Graded, State
from ..system import Balance, System
from .layer_increments import LayerIncrements

TOLERANCE = 1e-9
MAX_ITERATIONS = 30
# residual relative to the largest force: if axial stiffness far exceeds bending stiffness, displacements converge first
BALANCE = 1e-8
# relative to the largest force of one spring or load: if these cancel, their remainder determines the displacements
CANCELLED = 1e-10
# displacements less accurate than this cause a warning
POOR = 1e-6
# a residual within this multiple of the round-off bound counts as zero
FLOOR = 4.0
# an equilibrium farther from a guess than this share of the guess may be on another branch
NEAR = 0.5
# largest ratio of successive increments at which their sum is taken as converging
SLOWEST = 0.9
# number of times that the same points may press, at the same places, on the way to one equilibrium
VISITS = 8
# stiffness of contact layers, relative to their own, in the solutions that lead to one that fails at once
SOFTER = (1e-5, 1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3)
# share up to which a solution may fail, because bodies pass through such soft layers
TOO_SOFT = 1e-3


@dataclass
class NewtonResult:
    """A converged state of Newton's method, with the largest residual [N, N m].

    ``first`` (n_unknowns,) is the first correction, if the iteration began at an equilibrium; ``uncertainty`` [m] if
    round-off ended it, else 0; ``overlap`` [m] is the deepest penetration of an obstacle.
    """

    d: Array
    Q: Array
    F: Array
    energy: float
    residual: float
    iterations: int
    increments: list[float]
    first: Array | None
    negative_pivots: int
    uncertainty: float
    overlap: float = 0.0


def newton(system: System, d: Array, t_old: float | None, t: float, tolerance: float, max_iterations: int,
           last: Array | None = None) -> NewtonResult:
    """Return the equilibrium at t as ``_newton`` does, without adhesion at contacts and penetration of obstacles.

    Contact points are opened and closed between equilibria until none changes. In layers, d (n_full,) may lead too far
    if it is extrapolated; then Newton's method starts again at the ``last`` equilibrium. Raises ComputationError.
    """
    if not any(pair.hard for pair in system.model.contacts):
        result = _solved(system, d, t_old, t, tolerance, max_iterations, last)
        check_pressed_through(system.model, result.d, {"factor": float(f"{t:.6g}")})
        return result
    kept = memory(system.model)
    rough = any(pair.hard and pair.item.friction for pair in system.model.contacts)
    initialise_active_set(system, d, t if t_old is None else t_old)
    try:
        first = _held(system, d, t_old, t, tolerance, max_iterations)
        check_supports(system, first.d, t)
        touching = memory(system.model)
        *others, final = STRATEGIES if rough else STRATEGIES[:1]
        for strategy in others:
            try:
                return _settled(system, replace(first, d=first.d.copy()), t, tolerance, max_iterations, strategy)
            except ComputationError:
                restore_memory(system.model, touching)
        return _settled(system, first, t, tolerance, max_iterations, final)
    except ComputationError:
        restore_memory(system.model, kept)
        raise


def _solved(system: System, d: Array, t_old: float | None, t: float, tolerance: float, max_iterations: int,
            last: Array | None = None) -> NewtonResult:
    """Return the equilibrium as ``_newton`` does; if it fails in layers, from the ``last`` one, or by way of softer
    layers.
    """
    if all(pair.hard for pair in system.model.contacts):
        return _newton(system, d, t_old, t, tolerance, max_iterations)
    start = d.copy() if last is None else last.copy()
    for guess in [d] if last is None else [d, start.copy()]:
        try:
            return _newton(system, guess, t_old, t, tolerance, max_iterations)
        except SingularTangentError:
            raise
        except ComputationError:
            continue
    found = False
    for share in SOFTER:
        try:
            with softer_layers(system.model, share):
                start = _newton(system, start.copy(), t if found else t_old, t, tolerance, max_iterations).d
            found = True
        except ComputationError:
            if found or share > TOO_SOFT:
                raise
    return _newton(system, start, t, t, tolerance, max_iterations)


def _held(system: System, d: Array, t_old: float | None, t: float, tolerance: float, max_iterations: int
          ) -> NewtonResult:
    """Return the equilibrium as ``_solved`` does; while sliding contacts leave the tangent singular, let one stick."""
    while True:
        try:
            return _solved(system, d, t_old, t, tolerance, max_iterations)
        except SingularTangentError:
            if not stick_least_slipping(system.model.contact_tables, d, t, system.accepted or (d, t)):
                raise


def _settled(system: System, result: NewtonResult, t: float, tolerance: float, max_iterations: int, strategy: Strategy
             ) -> NewtonResult:
    """Return the equilibrium at which no contact point opens, closes, sticks or slides any more, from a first one."""
    history, visits = PlaceHistory(), Counter[tuple[bytes, ...]]()
    iterations, worst = 0, 0.0
    for _ in range(ROUNDS):
        iterations += result.iterations
        changed, worst = update_active_set(system, result.d, t, history, strategy)
        if not changed:
            result.iterations, result.overlap = iterations, worst
            check_pressed_through(system.model, result.d, {"factor": float(f"{t:.6g}")})
            return result
        visits[pressing := pressing_points(system.model)] += 1
        if visits[pressing] > VISITS:
            break
        result = _held(system, result.d, t, t, tolerance, max_iterations)
    raise not_found(t, worst)


def _newton(system: System, d: Array, t_old: float | None, t: float, tolerance: float, max_iterations: int
            ) -> NewtonResult:
    """Return the equilibrium at t from the state d at t_old, or a guess if that is None; d is overwritten.

    Converged means that the next increment, by the observed contraction, would be below ``tolerance`` of the
    displacements and the forces balance to 1e-8 of the largest, or to their round-off; or that increments have stopped
    decreasing while the residual is no more than round-off. Raises ComputationError if it does not converge.
    """
    num, z, first = system.model.numbering, np.empty(system.model.numbering.n_unknowns), None
    at, increments, residuals = {"factor": float(f"{t:.6g}")}, list[float](), list[float]()
    layers = None if all(pair.hard for pair in system.model.contacts) else LayerIncrements(system.weights)
    for iteration in range(1, max_iterations + 1):
        balance = moved_balance(system, d, t_old if iteration == 1 else None, t)
        balance = _not_too_far(system, layers, balance, d, t) if layers else balance
        residuals.append(largest(balance.R))
        if not np.isfinite(residuals[-1]):
            raise ComputationError("the forces are no longer finite", at=at, history=residuals)
        pivots = system.factor(at)
        if iteration == 1:
            system.check_tangent(d, t if t_old is None or not system.model.moves else t_old, pivots)
        z = np.negative(system.matrix.solve(balance.R, out=z), out=z)
        if iteration == 1:
            # multipliers change the tangent even if nothing moves
            presses, first = z[num.free >= num.n_q].any(), None if t_old is None else z.copy()
        increments.append(system.norm(z))
        check_divergence(increments, system.model.extent, at, residuals)
        # such small corrections are lost in the round-off of the coordinates
        nothing = max(increments[-2:]) <= UNIT_ROUNDOFF * system.model.extent
        stalled = len(increments) > 2 and increments[-1] > 0.5 * increments[-2]
        if stalled and (nothing or only_position_noise(system, increments) or at_floor(balance.R, system.noise(d, t))):
            uncertainty = min(increments[-2:])
            break
        np.add(d[num.where], layers.next(d[num.where], z, balance.R) if layers else z, out=z)
        system.model.displacements(z, t, out=d)
        # bodies that rest on obstacles may not move at all
        rests = bool(system.model.contacts) and nothing
        # an unloaded model returns to zero displacement and force, which leaves no scale to compare with
        idle = iteration > 3 and max(increments[-3:]) <= UNIT_ROUNDOFF * system.model.extent
        if (iteration > 1 or not presses) and (idle or rests or has_converged(increments, system.norm(z), tolerance)):
            balance = system.forces(d, t, out=system.room)
            if idle or balanced(system, balance, d, t):
                uncertainty = 0.0
                break
    else:
        raise ComputationError(f"Newton's method did not converge in {max_iterations} iterations", at=at,
                               history=residuals)
    # the result keeps these forces; allocated but untouched, others take no memory yet
    system.room.Q = np.empty_like(balance.Q)
    return NewtonResult(d, balance.Q, balance.F, balance.energy, largest(balance.R), iteration, increments,
                        first, pivots.negative - num.n_multipliers, uncertainty)


def _not_too_far(system: System, layers: LayerIncrements, balance: Balance, d: Array, t: float) -> Balance:
    """Return the balance at d (n_full,), which is moved back if the last increment overshoots."""
    def residual(x: Array) -> Array:
        return system.forces(system.model.displacements(x, t, out=d), t, out=system.room).R

    return system.assemble(d, t, out=system.room) if layers.shortened(balance.R, residual) else balance


def only_position_noise(system: System, increments: list[float]) -> bool:
    """Return whether the increments are round-off of positions, amplified by the stiff springs of sticking points."""
    return max(increments[-2:]) <= STILL * system.model.extent and sticks(system.model)


def balanced(system: System, balance: Balance, d: Array, t: float) -> bool:
    """Return whether no residual at d exceeds 1e-8 of the largest force, round-off, or 1e-10 of forces that cancel."""
    return (system.imbalance(balance) <= BALANCE or at_floor(balance.R, system.noise(d, t))
            or system.balances(balance, d, t, CANCELLED))


def at_floor(R: Array, noise: Array) -> bool:
    """Return whether no residual exceeds the bound of round-off."""
    return all(bool(np.all(np.abs(R[part]) <= FLOOR * noise[part])) for part in chunks(len(R)))


def moved_balance(system: System, d: Array, t_old: float | None, t: float) -> Balance:
    """Return the residual of the linear predictor for motion prescribed between the old and the new factor.

    The tangent is that of the old state, with the old values of the motion. Without such a motion, balance and tangent
    are those at d and t, in the room of the system.
    """
    model = system.model
    if t_old is None or t_old == t or not model.moves:
        return system.assemble(d, t, out=system.room)
    system.assemble(d, t_old)
    moved = model.displacements(d[model.numbering.where], t)
    loads = system.forces(d, t)
    R = loads.R + model.numbering.reduce(system.action(d, moved - d, t))
    return Balance(loads.Q, loads.F, R, loads.energy)


def has_converged(increments: list[float], size: float, tolerance: float) -> bool:
    """Return whether the next increment, by the observed contraction, is below ``tolerance`` of the displacements.

    Where increments decrease slowly, as friction on layers may cause, the sum of all that follow must be.
    """
    last = increments[-1]
    if last == 0.0:
        return True
    if len(increments) < 2 or increments[-2] == 0.0:
        return False
    contraction = last / increments[-2]
    if contraction < 0.5:
        return last * contraction <= tolerance * size
    slow = len(increments) > 3 and max(b / a for a, b in pairwise(increments[-4:]) if a > 0.0) < SLOWEST
    return slow and last * contraction <= (1.0 - contraction) * tolerance * size


def check_divergence(increments: list[float], extent: float, at: dict[str, Any], residuals: list[float]) -> None:
    """Raise ComputationError if increments grow or exceed every scale of the model."""
    grows = len(increments) > 4 and increments[-1] > 2 * increments[-2] > 4 * increments[-3]
    if not np.isfinite(increments[-1]) or increments[-1] > 1e6 * extent or grows:
        raise ComputationError("Newton's method diverges", at=at, history=residuals)


def check_sound(model: Model, d: Array, last: tuple[Array, float] | None, t: float) -> None:
    """Raise ComputationError if a solution of the equations is not a valid state of the model.

    ``last`` is the previous state (n_full,) and its time.
    """
    check_ends(model.constraints, d)
    check_facing(model.constraints, d, t)
    check_inverted(model, d, last and last[0], t)
    if last is not None and model.contacts:
        check_crossed(model, d, last, t)


def negative_pivots(system: System, d: Array, t: float) -> int:
    """Return the negative pivots of the tangent at the equilibrium itself, not one increment before it."""
    system.assemble(d, t)
    return system.factor({"factor": float(f"{t:.6g}")}).negative - system.model.numbering.n_multipliers


def inexact(when: str, share: float) -> str:
    """Return the warning that round-off leaves displacements accurate to a share of the largest."""
    return Graded(f"round-off limits the state at {when}: displacements are accurate to about {share:.1g} of the "
                  "largest. Fewer or longer elements give more digits", "round-off", share)


def too_deep(model: Model, when: str, depth: float) -> list[str]:
    """Return a warning if a body penetrates an obstacle between its contact points, else nothing."""
    told = (f"at {when} a body is {depth:.2g} deep in an obstacle between its contact points. Use more elements in the "
            "contact zone")
    return [Graded(told, "deep", depth)] if depth > 2.0 * PENETRATION * model.extent else []


def state_of(system: System, result: NewtonResult, t: float, number: int, cutbacks: int, warnings: list[str]) -> State:
    """Return the state to be yielded for an equilibrium: step ``number``, after ``cutbacks`` cuts."""
    history = {"step": number, "factor": t, "iterations": result.iterations, "residual": result.residual,
               "increment": result.increments[-1] if result.increments else 0.0, "cutbacks": cutbacks,
               "energy": result.energy, "negative_pivots": result.negative_pivots}
    size = system.norm(result.d[system.model.numbering.where])
    when = f"t = {t:.6g}" if system.model.case.solver.timed else f"factor {t:.6g}"
    if result.uncertainty > max(POOR * size, STILL * system.model.extent):
        warnings = [*warnings, inexact(when, result.uncertainty / size)]
    warnings = warnings + too_deep(system.model, when, result.overlap)
    turned = system.count(result.d, t)
    return State(t, result.d, result.Q, result.F, result.energy, turned, history=history, warnings=warnings)


@dataclass(frozen=True)
class Start:
    """A guess of the equilibrium under the full load: ``d`` (n_full,), and the negative pivots expected there.

    ``turned`` (bodies,) are its full turns.
    """

    d: Array
    negative_pivots: int
    turned: Array | None = None


def equilibrium_near(system: System, start: Start, t: float, tolerance: float, max_iterations: int
                     ) -> NewtonResult | None:
    """Return the equilibrium next to a guess, or None if there is none or it may be on another branch."""
    free, turns, touched = system.model.numbering.free, system.turns(), memory(system.model)
    guess = system.model.displacements(start.d[free], t)
    if start.turned is not None:
        system.count_from((guess, start.turned))
    try:
        result = newton(system, guess.copy(), t, t, tolerance, max_iterations)
        check_sound(system.model, result.d, None, t)
    except ComputationError:
        system.count_from(turns)
        restore_memory(system.model, touched)
        return None
    strayed = system.distance(result.d, guess) > NEAR * system.norm(guess[free])
    crossed = system.knows_inertia and negative_pivots(system, result.d, t) != start.negative_pivots
    if strayed or crossed:
        system.count_from(turns)
        restore_memory(system.model, touched)
        return None
    return result
