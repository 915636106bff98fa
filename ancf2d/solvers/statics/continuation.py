"""Points of an equilibrium path: tangents, and the bordered Newton iteration that finds the next point.

Equilibrium Q(z, t) - F(z, t) = 0 has one equation too few for the unknowns z and the load factor t. A control c(z, t) =
0 is added: the arc length from the last point, the load factor, or the value of a probe. Each iteration uses one
factorisation of the tangent stiffness for two right-hand sides (Ramm 1981; Crisfield 1981).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...elements.contact_geometry import STATUS
from ...elements.shape import Array
from ...errors import ComputationError
from ...kernels.elements import natural_slope
from ..active_set import PENETRATION, ROUNDS, initialise_active_set, not_found, update_active_set
from ..contact import layers_pressed, memory, restore_memory
from ..least_motion import UNIT_ROUNDOFF
from ..lift_off import PlaceHistory, fix_places, release_places
from ..linear import GeneralSparse
from ..system import Balance, System
from .layer_increments import LayerIncrements
from .newton import at_floor, balanced, check_divergence, check_sound, has_converged, newton
from .one_sided import springs_acting
from .path_controls import ArcLength, Control, Metric

# with history variables, iterations after which Newton steps are shortened, and by which factor: where yielding
# sections meet, full steps may cycle between fibres that yield and fibres that unload
FULL_STEPS, SHORTENED = 8, 0.75
# half the difference in t for derivatives of prescribed constraints and springs; trial step that shows what touches
SMALL = 1e-5
# multiples of it that are tried
STARTS = (1.0, 10.0, 100.0, 1e3, 1e4)


@dataclass
class PathPoint:
    """An equilibrium with its tangent ``z`` (n_unknowns,) = dz/ds, ``rate`` = dt/ds; s is the path's parameter.

    ``uncertainty`` [m] if round-off ended the iteration, else 0; ``touching`` is the stored state of the contacts,
    ``acting`` which points are in layers and which one-sided springs have stiffness.
    """

    d: Array
    t: float
    s: float
    z: Array
    rate: float
    negative: int
    balance: Balance
    iterations: int
    increment: float
    uncertainty: float
    touching: list[Array]
    acting: list[Any]

    @property
    def tangent(self) -> tuple[Array, float]:
        """The direction of the path: (dz/ds, dt/ds)."""
        return self.z, self.rate


@dataclass
class Found:
    """The result of the bordered Newton iteration; ``iterations`` is the largest number for one set of contacts."""

    d: Array
    t: float
    iterations: int
    increment: float
    uncertainty: float


class Curve:
    """The equilibrium path of a model.

    ``turns`` are those of the last point, from which corrections count.
    """

    def __init__(self, system: System, tolerance: float, max_iterations: int) -> None:
        self.system, self.model = system, system.model
        self.tolerance, self.max_iterations = tolerance, max_iterations
        self.turns = system.turns()
        # number of negative pivots of the last tangent
        self.pivots = 0
        squares = system.weights**2
        self.metric = Metric(squares / max(int(np.count_nonzero(squares)), 1), 0.0)
        zero = np.zeros(self.model.numbering.n_unknowns)
        self.motion = self.model.displacements(zero, 1.0) - self.model.displacements(zero, 0.0)
        # scaling amplitudes equal the load factor, so that this difference is the derivative
        self.dead = self.model.external(1.0) - self.model.external(0.0)
        self.natural = {k: load.amplitude(1.0) - load.amplitude(0.0) for k, load in enumerate(self.model.loads.natural)}

    def load_rate(self, d: Array, t: float) -> Array:
        """Return dR/dt at fixed unknowns (n_unknowns,), by the loads and motions that scale."""
        model = self.model
        out, e = -self.dead, model.e0 + d[:model.n_q]
        for load in model.interactions.loads:
            np.add.at(out, load.dofs, load.evaluate(e, d, 1.0)[1] - load.evaluate(e, d, 0.0)[1])
            if model.moves:
                K = load.evaluate(e, d, t)[2]
                np.add.at(out, load.dofs, np.einsum("mij,mj->mi", K, self.motion[load.dofs]))
        for batch in (one for one in model.interactions.springs if one.signals):
            # the winding of a tendon, which starts to pull at a kink: forward difference
            now, then, later = (batch.evaluate(e, d, t + k * SMALL)[1] for k in range(3))
            np.add.at(out, batch.dofs, (4.0 * then - 3.0 * now - later) / (2 * SMALL))
        for side in (1.0, -1.0):
            for _, Q, _, dofs in model.interactions.constraints(d, t + side * SMALL):
                np.add.at(out, dofs, side * Q / (2 * SMALL))
        if model.loads.natural:
            model.set_natural(t, self.natural)
            for group in model.groups:
                natural_slope(group, d, out)
        if model.moves:
            out += self.system.action(d, self.motion, t)
        return model.numbering.reduce(out)

    def correct(self, control: Control, d: Array, t: float) -> Found:
        """Return the equilibrium that satisfies the control, from a guess. Raises ComputationError.

        Contact points open, close and move between such equilibria; their response includes that of the load factor.
        """
        touching = memory(self.model)
        try:
            return self._settled(control, d, t, self._with_moving_places)
        except ComputationError:
            if not any(pair.hard and pair.places_move for pair in self.model.contacts):
                raise
            restore_memory(self.model, touching)
            return self._settled(control, d, t, self._with_fixed_places)

    def _settled(self, control: Control, d: Array, t: float,
                 find: Callable[[Control, Array, float, PlaceHistory], Found]) -> Found:
        """Same as ``correct``, with ``find`` as the solver for fixed contacts, until no contact point changes."""
        self.system.count_from(self.turns)
        history = PlaceHistory()
        found = find(control, d, t, history)
        self.system.along = partial(self._response, control)
        for number in range(ROUNDS):
            touching = memory(self.model)
            changed, worst = update_active_set(self.system, found.d, found.t, history)
            if not changed:
                return found
            # points that closed in the first round may pull in the second
            if number == 1 and (turned := self._turned_back(control, found, touching)) is not None:
                return turned
            again = find(control, found.d, found.t, history)
            found = replace(again, iterations=max(found.iterations, again.iterations))
        raise not_found(found.t, worst)

    def _turned_back(self, control: Control, found: Found, touching: list[Array]) -> Found | None:
        """Return the equilibrium of an arc with the load factor on the other side of its start, or None if none fits.

        Points that have just closed and would pull press there: a path turns back where a load pushes a body onto an
        obstacle while the load factor falls. The contacts are those of ``found``, stored in ``touching``.
        """
        if not isinstance(control, ArcLength):
            return None
        changed = memory(self.model)
        restore_memory(self.model, touching)
        try:
            turned = self._corrected(control, found.d, 2.0 * control.t0 - found.t)
            if not update_active_set(self.system, turned.d, turned.t, PlaceHistory())[0]:
                return turned
        except ComputationError:
            pass
        restore_memory(self.model, changed)
        return None

    def first_point(self, start: Found, way: float, scale: Callable[[Array, Array], float]) -> PathPoint:
        """Return the start of a path, with the contacts and tangent just after it as the load factor goes one ``way``.

        Bodies that merely rest on obstacles at the start have no contact force that shows which points open at once,
        and points at zero gap do not yet press. ``scale`` is that of ``point``.
        """
        hard = any(pair.hard for pair in self.model.contacts)
        if hard:
            initialise_active_set(self.system, start.d, start.t)
        touching, (after, step) = memory(self.model), self._just_after(start, way)
        if step == 0.0 or (hard and self._apart(start)):
            restore_memory(self.model, touching)
        point = self.point(start, 0.0, scale)
        if step != 0.0 and any((one != two).any() for one, two in zip(
                point.acting, self._acting(after, start.t + step), strict=True)):
            by_load = (after - start.d)[self.model.numbering.free] / step
            point.rate = scale(start.d, by_load)
            point.z = point.rate * by_load
        return point

    def _just_after(self, start: Found, way: float) -> tuple[Array, float]:
        """Return an equilibrium (n_full,) next to the start of a path, and the change of the load factor.

        The change is 0 if nothing touches, or if no equilibrium is found. With points at zero gap in layers, it may be
        found only at larger loads, which curve the bodies.
        """
        self.system.count_from(self.turns)
        for step in (way * SMALL * share for share in STARTS if self.model.contacts):
            try:
                t = start.t + step
                return newton(self.system, start.d.copy(), start.t, t, self.tolerance, self.max_iterations).d, step
            except ComputationError:
                if all(pair.hard for pair in self.model.contacts):
                    break
        return start.d, 0.0

    def _apart(self, start: Found) -> bool:
        """Return whether a closed point has a gap at the start."""
        return any(gap > PENETRATION * self.model.extent for one in self.model.contact_tables if one.pair.hard
                   for gap, p in zip(one.gaps(start.d, start.t)[0], one.points, strict=True) if p.mem[STATUS] > 0.0)

    def _response(self, control: Control, d: Array, t: float) -> Callable[[Array], Array]:
        """Return the function that gives the response to forces while the load factor follows the control."""
        solve = self.system.matrix.solve
        by_load = -solve(self.load_rate(d, t))
        _, gradient, by_t = control.evaluate(d, t)
        slope = by_t + float(gradient @ by_load)

        def response(b: Array) -> Array:
            z = solve(b)
            return np.asarray(z - float(gradient @ z) / slope * by_load)
        return response

    def _with_fixed_places(self, control: Control, d: Array, t: float, history: PlaceHistory) -> Found:
        """Same as ``_corrected``, with all contact places fixed."""
        return self._corrected(control, d, t)

    def _with_moving_places(self, control: Control, d: Array, t: float, history: PlaceHistory) -> Found:
        """Same as ``_corrected``, with the places of lift-off moving along."""
        slid = release_places([one for one in self.model.contact_tables if one.pair.hard], history)
        found = self._corrected(control, d, t)
        fix_places(slid, found.d, found.t)
        if slid and self.knows_inertia and self.pivots < self.model.numbering.n_multipliers:
            # the beam would turn about this place rather than lift off
            raise ComputationError("a place of lift-off is not the one that bears", at={"factor": float(f"{t:.6g}")})
        # a place may have slid beyond its interval
        rests = not slid or balanced(self.system, self.system.forces(found.d, found.t), found.d, found.t)
        return found if rests else self._corrected(control, found.d, found.t)

    def _corrected(self, control: Control, d: Array, t: float) -> Found:
        """Return the equilibrium that satisfies the control with the present set of closed points."""
        system, free = self.system, self.model.numbering.free
        increments: list[float] = []
        residuals: list[float] = []
        layers = None
        if not all(pair.hard for pair in self.model.contacts):
            layers = LayerIncrements(np.sqrt(np.append(self.metric.weights, self.metric.load)))

        def residual(x: Array) -> Array:
            nonlocal d, t
            t = float(x[-1])
            d = self.model.displacements(x[:-1], t)
            return system.forces(d, t).R

        for iteration in range(1, self.max_iterations + 1):
            balance = system.assemble(d, t)
            if layers and layers.shortened(balance.R, residual):
                balance = system.assemble(d, t)
            at = {"factor": float(f"{t:.6g}")}
            residuals.append(float(np.max(np.abs(balance.R), initial=0.0)))
            if not np.isfinite(residuals[-1]):
                raise ComputationError("the forces are no longer finite", at=at, history=residuals)
            self.pivots = system.factor(at).negative
            z, dt = self._bordered(control, balance, d, t)
            if iteration > FULL_STEPS and self.model.remembers:
                z, dt = SHORTENED * z, SHORTENED * dt
            increments.append(system.norm(z))
            check_divergence(increments, self.model.extent, at, residuals)
            stalled = len(increments) > 2 and increments[-1] > 0.5 * increments[-2]
            if stalled and at_floor(balance.R, system.noise(d, t)):
                return Found(d, t, iteration, increments[-1], min(increments[-2:]))
            x, step = np.append(d[free], t), np.append(z, dt)
            x += layers.next(x.copy(), step, balance.R) if layers else step
            d, t = self.model.displacements(x[:-1], float(x[-1])), float(x[-1])
            # bodies that rest on obstacles may not move at all
            rests = bool(self.model.contacts) and max(increments[-2:]) <= UNIT_ROUNDOFF * self.model.extent
            if ((rests or has_converged(increments, system.norm(d[free]), self.tolerance))
                    and balanced(system, system.forces(d, t), d, t)):
                return Found(d, t, iteration, increments[-1], 0.0)
        raise ComputationError(f"Newton's method did not converge in {self.max_iterations} iterations", at=at,
                               history=residuals)

    def _bordered(self, control: Control, balance: Balance, d: Array, t: float) -> tuple[Array, float]:
        """Return the Newton step (z, dt) of [K, dR/dt; dc/dz, dc/dt] with two solves."""
        by_residual = -self.system.matrix.solve(balance.R)
        by_load = -self.system.matrix.solve(self.load_rate(d, t))
        c, gradient, by_t = control.evaluate(d, t)
        slope = by_t + float(gradient @ by_load)
        if slope == 0.0 or not np.isfinite(slope):
            raise ComputationError("the load factor has no effect on the controlled quantity",
                                   at={"factor": float(f"{t:.6g}")})
        dt = -(c + float(gradient @ by_residual)) / slope
        return by_residual + dt * by_load, dt

    def point(self, found: Found, s: float, scale: Callable[[Array, Array], float]) -> PathPoint:
        """Return a converged state with its tangent; ``scale(d, dz/dt)`` returns dt/ds."""
        check_sound(self.model, found.d, None, found.t)
        touching = memory(self.model)
        # places of lift-off move along the path, unless they would meet other points
        for slide in (True, False):
            restore_memory(self.model, touching, slide)
            balance = self.system.assemble(found.d, found.t)
            pivots = self.system.factor({"factor": float(f"{found.t:.6g}")})
            if not self.knows_inertia or pivots.negative >= self.model.numbering.n_multipliers:
                break
        self.system.check_tangent(found.d, found.t, pivots)
        by_load = -self.system.matrix.solve(self.load_rate(found.d, found.t))
        restore_memory(self.model, touching)
        if touching:
            # with fixed places, since the state is not balanced for places beyond their interval
            balance = self.system.forces(found.d, found.t)
        rate, negative = scale(found.d, by_load), pivots.negative - self.model.numbering.n_multipliers
        return PathPoint(found.d, found.t, s, rate * by_load, rate, negative, balance, found.iterations,
                         found.increment, found.uncertainty, touching, self._acting(found.d, found.t))

    def _acting(self, d: Array, t: float) -> list[Any]:
        """Return which points are in layers, and which one-sided springs have stiffness."""
        return [*layers_pressed(self.model, d, t), *springs_acting(self.model, d, t)]

    @property
    def knows_inertia(self) -> bool:
        """Return whether pivot signs give the inertia, which they do not if sparse factors have exchanged rows."""
        matrix = self.system.matrix
        return not isinstance(matrix, GeneralSparse) or matrix.knows_inertia
