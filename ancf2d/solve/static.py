"""Static equilibrium: one linear solve, or Newton with load steps that adapt."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..elements.shape import Array
from ..errors import ComputationError
from ..model.inversion import check_inverted
from ..model.model import Model
from ..model.point_patch import check_facing
from ..model.sliding import check_ends
from .pieces import largest, pieces
from .refine import refined
from .state import State
from .system import UNIT_ROUNDOFF, Balance, System

TOLERANCE = 1e-9
MAX_ITERATIONS = 30
STEPS = 10
# residual forces beside the largest force: where axial stiffness dwarfs bending stiffness, displacements converge first
BALANCE = 1e-8
# a residual within this multiple of the bound of round-off cannot be told from zero
FLOOR = 4.0
# displacements known to less than this many digits are worth a word
POOR = 1e-6
# and of no use where this share of them is not known
HOPELESS = 0.5
# a step that moves this much further than the one before, or the first than it would by linear theory, has left the
# branch
JUMP = 8.0
SMALLEST_STEP = 2.0**-16
# tries within one full step before the path is given up
MOST_TRIES = 60
# easy steps in a row before a cut step grows again
PATIENCE = 2
# an equilibrium further from a guess than this share of the guess may be on another branch
NEAR = 0.5


@dataclass(frozen=True)
class Start:
    """A guess of the equilibrium under the whole load: ``d`` (n_full,), and the negative pivots expected there."""

    d: Array
    negative_pivots: int


@dataclass
class NewtonResult:
    """A converged state of Newton's method, with the largest residual [N, N m].

    ``uncertainty`` [m] is where round-off ended it, else 0.
    """

    d: Array
    Q: Array
    F: Array
    energy: float
    residual: float
    iterations: int
    increments: list[float]
    negative_pivots: int
    uncertainty: float


def solve_linear(model: Model) -> Iterator[State]:
    """Yield the one state of linear statics: K(0) d = Q_k with every load at its full factor.

    Moments and follower loads act in the reference directions; their load stiffness is no linear theory.
    """
    system, num = System(model), model.numbering
    zero = np.zeros(len(num.place))
    start = system.assemble(zero, 1.0, load_stiffness=False)
    stiff = bool(system.matrix.diagonal(system.matrix.values).any())
    pivots = system.factor({"solver": "linear_static"})
    d = model.displacements(np.zeros(num.n_unknowns), 1.0)
    R0 = start.Q - start.F

    def apply(z: Array) -> Array:
        full = np.zeros(len(d))
        num.expand(z, full)
        return num.reduce(system.action(zero, full, 1.0))

    load = -num.reduce(R0 + (system.action(zero, d, 1.0) if d.any() else 0.0))
    if stiff:
        floor = max(system.norm(system.matrix.solve(f)) for f in system.rigid_forces())
        z, known = refined(apply, system.matrix.solve, system.norm, load, floor)
    else:
        # rigid bodies alone, which constraints hold: there is nothing to refine
        z, known = system.matrix.solve(load), 0.0
    if not np.isfinite(system.norm(z)):
        raise ComputationError("the linear solve gave no finite displacement", at={"solver": "linear_static"},
                               advice="check loads and stiffnesses for extreme values")
    if known > HOPELESS:
        raise ComputationError(
            "round-off has drowned the soft motions beside the stiff ones: no digit of the displacements is known",
            at={"solver": "linear_static"}, advice="fewer or longer elements, another element type, or solver static")
    d = model.displacements(z, 1.0)
    elastic = system.action(zero, d, 1.0)
    energy = 0.5 * float(elastic[:model.n_q] @ d[:model.n_q])
    history = {"step": 1, "factor": 1.0, "iterations": 1, "residual": 0.0, "increment": system.norm(d[num.where]),
               "cutbacks": 0, "energy": energy, "negative_pivots": pivots.negative - num.n_multipliers}
    warnings = [] if known <= POOR else [
        f"round-off limits the displacements: they are known to about {known:.1g} of the largest; fewer or longer "
        "elements, or solver static, know more"]
    yield State(1.0, d, start.Q + elastic, start.F, energy, linear=True, history=history, warnings=warnings)


def newton(system: System, d: Array, t_old: float, t: float, tolerance: float, max_iterations: int) -> NewtonResult:
    """Return the equilibrium at t from the state d of t_old, which is written to: it becomes the result's.

    Converged means that the next increment, by the contraction seen, would be below ``tolerance`` of the
    displacements and the forces balance to 1e-8 of the largest, or to their round-off; or that increments have
    stopped falling while the residual is no more than round-off. Raises ComputationError when it does not converge.
    """
    num, z = system.model.numbering, np.empty(system.model.numbering.n_unknowns)
    at = {"factor": float(f"{t:.6g}")}
    increments: list[float] = []
    residuals: list[float] = []
    for iteration in range(1, max_iterations + 1):
        if iteration == 1 and system.model.moves and t != t_old:
            balance = _with_motion(system, d, t_old, t)
        else:
            balance = system.assemble(d, t, out=system.room)
        residuals.append(largest(balance.R))
        if not np.isfinite(residuals[-1]):
            raise ComputationError("the forces are no longer finite numbers", at=at, history=residuals)
        pivots = system.factor(at)
        z = system.matrix.solve(balance.R, out=z)
        np.negative(z, out=z)
        increments.append(system.norm(z))
        check_divergence(increments, system.model.extent, at, residuals)
        stalled = len(increments) > 2 and increments[-1] > 0.5 * increments[-2]
        if stalled and at_floor(balance.R, system.noise(d, t)):
            uncertainty = min(increments[-2:])
            break
        np.add(d[num.where], z, out=z)
        system.model.displacements(z, t, out=d)
        if has_converged(increments, system.norm(z), tolerance):
            balance = system.forces(d, t, out=system.room)
            if balanced(system, balance, d, t):
                uncertainty = 0.0
                break
    else:
        raise ComputationError(f"Newton's method did not converge in {max_iterations} iterations", at=at,
                               history=residuals)
    return NewtonResult(d, balance.Q.copy(), balance.F, balance.energy, largest(balance.R), iteration, increments,
                        pivots.negative - num.n_multipliers, uncertainty)


def balanced(system: System, balance: Balance, d: Array, t: float) -> bool:
    """Whether no residual at d exceeds 1e-8 of the largest force, or none what round-off can leave of it."""
    return system.imbalance(balance) <= BALANCE or at_floor(balance.R, system.noise(d, t))


def at_floor(R: Array, noise: Array) -> bool:
    """Whether no residual exceeds what round-off can leave."""
    return all(bool(np.all(np.abs(R[part]) <= FLOOR * noise[part])) for part in pieces(len(R)))


def _with_motion(system: System, d: Array, t_old: float, t: float) -> Balance:
    """Return the residual of the linear predictor for motion prescribed between the old and the new factor.

    The tangent is that of the old state, which equilibrates the motion it had.
    """
    model = system.model
    system.assemble(d, t_old)
    moved = model.displacements(d[model.numbering.where], t)
    loads = system.forces(d, t)
    R = model.numbering.reduce(loads.Q - loads.F + system.action(d, moved - d, t))
    return Balance(loads.Q, loads.F, R, loads.energy)


def has_converged(increments: list[float], size: float, tolerance: float) -> bool:
    """Whether the next increment, by the contraction seen, is below ``tolerance`` of the size of the displacements."""
    last = increments[-1]
    if last == 0.0:
        return True
    if len(increments) < 2:
        return False
    contraction = last / increments[-2]
    return contraction < 0.5 and last * contraction <= tolerance * size


def check_divergence(increments: list[float], extent: float, at: dict[str, Any], residuals: list[float]) -> None:
    """Raise ComputationError where increments grow or exceed every scale of the model."""
    grows = len(increments) > 4 and increments[-1] > 2 * increments[-2] > 4 * increments[-3]
    if not np.isfinite(increments[-1]) or increments[-1] > 1e6 * extent or grows:
        raise ComputationError("Newton's method diverges", at=at, history=residuals)


@dataclass
class _Path:
    """The equilibrium path so far, for extrapolation."""

    t: list[float]
    d: list[Array]

    def extrapolate(self, t: float) -> Array:
        """Return the polynomial through the last states (at most quadratic) at t."""
        k = min(3, len(self.t))
        ts, ds = self.t[-k:], self.d[-k:]
        weights = [float(np.prod([(t - b) / (a - b) for b in ts if b != a])) for a in ts]
        out = weights[0] * ds[0]
        for part in pieces(len(out)):
            for weight, d in zip(weights[1:], ds[1:], strict=True):
                out[part] += weight * d[part]
        return out

    def push(self, t: float, d: Array) -> None:
        self.t, self.d = [*self.t[-2:], t], [*self.d[-2:], d]


def solve_static(model: Model, steps: int | None = None, tolerance: float | None = None,
                 max_iterations: int | None = None, end: float = 1.0, start: Start | None = None) -> Iterator[State]:
    """Yield a state per load step, from the reference (factor 0) to ``end``.

    The factor grows by at most ``end/steps`` at a time; a step in trouble is cut, and grows again after easy ones.
    Only the last state where that is found from ``start`` at once. Raises ComputationError where the path cannot be
    followed.
    """
    system = System(model)
    tolerance, max_iterations = tolerance or TOLERANCE, max_iterations or MAX_ITERATIONS
    near = None if start is None else _near(system, start, end, tolerance, max_iterations)
    if near is not None:
        yield _state(system, near, end, 1, 0, near.negative_pivots)
        return
    largest = end / (steps or STEPS)
    d = model.displacements(np.zeros(model.numbering.n_unknowns), 0.0)
    path = _Path([0.0], [d])
    t, h, cutbacks, number, negative, easy = 0.0, largest, 0, 0, 0, PATIENCE
    moved, mark, tries = np.inf, 0.0, 0
    while t < end * (1 - 1e-12):
        target = end if t + h * (1 + 1e-9) >= end else t + h
        tries += 1
        try:
            result = newton(system, path.extrapolate(target), target if len(path.t) > 1 else t, target, tolerance,
                            max_iterations)
            check_ends(model.constraints, result.d)
            check_facing(model.constraints, result.d, target)
            check_inverted(model, result.d, path.d[-1], target)
            distance = system.distance(result.d, path.d[-1])
            rate = distance / (target - t)
            jump = rate > JUMP * (moved if number else result.increments[0] / target)
            if jump and distance > UNIT_ROUNDOFF * model.extent:
                raise ComputationError("the state jumps to another branch", at={"factor": float(f"{target:.6g}")})
        except ComputationError as error:
            h, cutbacks, easy = 0.5 * (target - t), cutbacks + 1, 0
            if h < SMALLEST_STEP * largest or tries > MOST_TRIES:
                raise _stuck(error, t, number) from error
            continue
        if result.negative_pivots != negative and system.knows_inertia:
            result.negative_pivots = _confirmed_pivots(system, result, target)
        moved = max(rate, 1e-3 * moved if np.isfinite(moved) else 0.0)
        number, easy = number + 1, easy + 1
        path.push(target, result.d)
        yield _state(system, result, target, number, cutbacks, negative)
        negative = result.negative_pivots
        if easy >= PATIENCE:
            h = min(largest, 2 * h)
        t, cutbacks = target, 0
        if t >= mark + largest * (1 - 1e-9):
            mark, tries = t, 0


def _near(system: System, start: Start, t: float, tolerance: float, max_iterations: int) -> NewtonResult | None:
    """Return the equilibrium next to a guess, None where there is none, or one that may be on another branch."""
    free = system.model.numbering.free
    guess = system.model.displacements(start.d[free], t)
    try:
        result = newton(system, guess.copy(), t, t, tolerance, max_iterations)
        check_ends(system.model.constraints, result.d)
        check_facing(system.model.constraints, result.d, t)
        check_inverted(system.model, result.d, None, t)
    except ComputationError:
        return None
    strayed = system.distance(result.d, guess) > NEAR * system.norm(guess[free])
    crossed = system.knows_inertia and _confirmed_pivots(system, result, t) != start.negative_pivots
    return None if strayed or crossed else result


def _confirmed_pivots(system: System, result: NewtonResult, t: float) -> int:
    """Return the negative pivots of the tangent at the equilibrium itself, not one increment before it."""
    system.assemble(result.d, t)
    return system.factor({"factor": float(f"{t:.6g}")}).negative - system.model.numbering.n_multipliers


def _state(system: System, result: NewtonResult, t: float, number: int, cutbacks: int, negative: int) -> State:
    history = {"step": number, "factor": t, "iterations": result.iterations, "residual": result.residual,
               "increment": result.increments[-1] if result.increments else 0.0, "cutbacks": cutbacks,
               "energy": result.energy, "negative_pivots": result.negative_pivots}
    warnings = []
    if result.negative_pivots != negative and system.knows_inertia:
        warnings.append(f"a critical point was passed before factor {t:.6g}: {result.negative_pivots} negative pivots "
                        f"instead of {negative}; equilibrium beyond it may be unstable")
    size = system.norm(result.d[system.model.numbering.where])
    # displacements below round-off of the positions themselves are none
    if result.uncertainty > max(POOR * size, UNIT_ROUNDOFF * system.model.extent):
        warnings.append(f"round-off limits the state at factor {t:.6g}: displacements are known to about "
                        f"{result.uncertainty / size:.1g} of the largest; fewer or longer elements know more")
    return State(t, result.d, result.Q, result.F, result.energy, history=history, warnings=warnings)


def _stuck(error: ComputationError, t: float, number: int) -> ComputationError:
    f = error.failure
    return ComputationError(
        f"no equilibrium was found beyond load factor {t:.6g}: {f.reason}", at={"step": number + 1, **f.at},
        history=f.history,
        advice=f.advice or "a limit point of the load is likely (method: arc_length follows it); else more steps, or "
                           "supports that leave no mechanism")
