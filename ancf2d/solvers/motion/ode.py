"""SciPy's integrators on the equations of motion: RK45, DOP853, Radau, BDF, LSODA."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ...case import Dynamic
from ...elements.shape import Array
from ...kernels.lowlevel.records import Record
from ...kernels.motion.advance import CHECK, END, INSIDE, NEAR
from ...kernels.motion.events import BEYOND, FLOAT, FLOATS, NO_VALUE, NONE, SAMPLES, TRIES, check_conditions
from ...kernels.motion.ode import accelerations, accept_step, mass_factors, place, powers, rates, tangents
from ...kernels.motion.state import COUNT, LOST, OLD_STEP, SIZE, STEP_SIZE, TIME, WORK, motion
from ...kernels.motion.stops import AFTER_ENGAGEMENT, AT_END, AT_START, LARGEST_RETRY, SHORTEST, acting
from ...kernels.motion.stops import TRIES as STOP_TRIES
from ...model.model import Model
from . import stepping
from .breaks import first_step, pass_break
from .dense import dense
from .failures import stuck
from .integrators import SCIPY_METHODS
from .stepping import LOG, Row, Stepper

# the smallest relative tolerance that SciPy accepts
SMALLEST = 100.0 * float(np.finfo(float).eps)
# Lobatto points and weights on [0, 1], for work along a step
LOBATTO = ((0.0, 1 / 12), (0.5 - 0.1 * 5**0.5, 5 / 12), (0.5 + 0.1 * 5**0.5, 5 / 12), (1.0, 1 / 12))


def cubic(t0: float, y0: Array, t1: float, y1: Array) -> Callable[[float], Array]:
    """Return y = (z, v) over time between two states, with the cubic z that has their positions and rates."""
    h, (z0, v0), (z1, v1) = t1 - t0, np.split(y0, 2), np.split(y1, 2)
    a, b = z1 - z0 - h * v0, h * (v1 - v0)

    def at(t: float) -> Array:
        x = (t - t0) / h
        z = z0 + x * h * v0 + x * x * ((3.0 - 2.0 * x) * a - (1.0 - x) * b)
        return np.concatenate([z, v0 + (x * (6.0 * (1.0 - x) * a - (2.0 - 3.0 * x) * b)) / h])
    return at


class OdeStepper(Stepper):
    """A motion stepped by an integrator of SciPy, with the interface of ``Stepper``.

    Local errors are kept below ``tolerance`` relative to the largest displacement (and speed) so far, coordinates
    weighted as displacements; ``dt`` is the largest step. While a stop acts, the tolerance is tighter, so that errors
    of rates do not grow beyond it until the end (``_share``). Multipliers are solved for with the accelerations. After
    each step, positions and rates are projected onto the constraints by the least change in the metric of the mass.
    """

    looks_ahead = False

    def __init__(self, model: Model, problem: Any, signals: list[Any], spec: Dynamic, dt: float, wanted: Array,
                 every: int = 0, follows: bool = False) -> None:
        super().__init__(model, problem, signals, spec, dt, wanted, every, follows)
        self.scipy = SCIPY_METHODS[self.method.name]
        self.tolerance = spec.local_error
        n = len(self.p.coordinate)
        self.free = np.flatnonzero(self.p.coordinate)
        self.constrained = len(self.free) < n
        self.factors = self.p.mass.copy()
        if not self.constrained:
            mass_factors(self.p, self.w, self.factors)
        self.scale = np.array([1e-3 * self.p.extent, 1e-3 * self.p.extent / spec.t_end])
        self.begun, self.struck = self.scale, False
        self.inner = Record(motion(n, 0, 0))
        self.solver: Any = None
        self.log: list[list[float]] = []

    def start(self, d: Array, v: Array, turned: Array) -> None:
        """Start at full coordinates d with rates v, projected onto the motions that supports and joints allow."""
        self._begin_from(d, v, turned)

    def _restart(self) -> None:
        """Restart SciPy's solver from the motion and let it choose its first step."""
        self.solver = None
        self.s.numbers[STEP_SIZE] = 0.0

    # ------------------------------------------------------------------ the equations as SciPy sees them

    def rates(self, t: float, y: Array) -> Array:
        """Return y'."""
        out = np.empty_like(y)
        rates(self.p, self.w, self.factors, self.inner, self.free, t, y, out)
        return out

    def jacobian(self, t: float, y: Array) -> Array:
        """Return dy'/dy, without the curvature of constraints."""
        place(self.inner, self.free, y)
        accelerations(self.p, self.w, self.factors, self.inner, t)
        K, C, KKT = (np.zeros_like(self.p.mass) for _ in range(3))
        tangents(self.p, self.w, self.inner, t, K, C, KKT)
        free, m = self.free, len(self.free)
        forces = np.zeros((len(self.p.coordinate), 2 * m))
        K, C, KKT = (dense(A, self.p) for A in (K, C, KKT))
        C -= K
        inner = np.arange(self.p.inner, len(KKT))
        KKT[inner, inner] = 1.0
        forces[free, :m], forces[free, m:] = K[np.ix_(free, free)], C[np.ix_(free, free)]
        out = np.zeros((2 * m, 2 * m))
        out[:m, m:] = np.eye(m)
        out[m:] = -np.linalg.solve(KKT, forces)[free]
        out[m:, m:] -= self.p.alpha * np.eye(m)
        # states of controllers have first derivatives only
        states = np.flatnonzero(free >= self.p.inner)
        out[states] += out[m + states]
        out[m + states] = 0.0
        return out

    def _begin(self, stop: float, first: float | None = None) -> Any:
        """Return SciPy's solver from the motion to ``stop``; ``first`` is the step to try first."""
        from scipy import integrate

        self.begun, self.struck = self.scale.copy(), self._struck()
        y = np.concatenate([self.s.z[self.free], self.s.v[self.free]])
        longest = min(self.dt or np.inf, self.longest_step())
        more: dict[str, Any] = {"jac": self.jacobian} if self.scipy.jacobian else {}
        # SciPy's own choice of the first step depends on the unit of time
        more["first_step"] = min(first_step(self), longest, 0.5 * (stop - self.t))
        solver = getattr(integrate, self.method.name)(self.rates, self.t, y, stop, max_step=longest,
                                                      rtol=self._share(), atol=self._weights(), **more)
        if first is not None:
            solver.h_abs = first
        elif self.scipy.keeps and self.s.numbers[STEP_SIZE] > 0.0:
            solver.h_abs = float(self.s.numbers[STEP_SIZE])
        return solver

    def _struck(self) -> bool:
        """Return whether a stop acts on the motion."""
        out = np.zeros(len(self.p.stops))
        if len(out):
            acting(self.p, self.w, self.s.z, self.s.v, self.t, out)
        return bool(out.any())

    def _share(self) -> float:
        """Return the relative tolerance of a step.

        A body leaves a stop with an error of its velocity, which causes a position error that grows with time.
        """
        size, speed = self.scale
        share = min(1.0, size / (speed * self.spec.t_end)) if self.struck else 1.0
        return max(self.tolerance * share, min(self.tolerance, SMALLEST))

    def _weights(self) -> Array:
        """Return the absolute tolerances (2 m,)."""
        weights = self.p.weights[self.free]
        states = self.free >= self.p.inner
        sizes = self.p.feedback.scale
        weights[states] = self.scale[0] / np.where(sizes > 0.0, sizes, 1.0)
        return self._share() * np.concatenate([self.scale[0] / weights, self.scale[1] / weights])

    # ------------------------------------------------------------------ stepping

    def _go(self, found: list[Row], most: float) -> None:
        """Step for about a fifth of a second and append the states; there are no coarser motions that count steps."""
        started = time.perf_counter()
        while not self.done:
            stop = self.pieces[self.piece].stop
            if self.solver is None:
                self.solver = self._begin(stop)
            event = not self._step(found) or self.events.mark_conditions()
            following = self.events.switch_marked(found) if event else self.piece + 1
            while not self.done and (event or self.t >= stop):
                pass_break(self, following)
                stop, event = self.pieces[self.piece].stop, self.events.mark_conditions()
                following = self.events.switch_marked(found) if event else self.piece + 1
            if found and time.perf_counter() - started > stepping.CHUNK_SECONDS:
                break
        self.pending = np.array(self.log).reshape(-1, len(LOG))

    def _step(self, found: list[Row]) -> bool:
        """Make a step; return False if it was given up for an event at its start."""
        if self._struck() != self.struck:
            self.solver = self._begin(self.pieces[self.piece].stop)
        solver, t, evaluations = self.solver, self.t, self.solver.nfev
        if not self.scipy.fixed:
            solver.rtol, solver.atol = self._share(), self._weights()
        message = solver.step()
        if solver.status == "failed" or not np.isfinite(solver.y).all():
            raise stuck(self, message)
        path: Any = None
        lands = False
        if len(self.p.stops):
            path, lands = self._stop_at_spring(t)
        if self.events.conditions:
            path = self._stop_at_event(t)
            if path is None:
                self.solver = None
                return False
        if self.solver is not solver:
            # the step has been repeated with a new solver
            evaluations = evaluations - solver.nfev
        solver = self.solver
        h, evaluations = solver.t - t, solver.nfev - evaluations
        inside = self._inside(t, solver.t)
        if path is None and (self.tracks_work or len(inside)):
            path = solver.dense_output()
        error = self._local_error(h)
        at_end = bool(len(inside)) and inside[-1] >= solver.t - NEAR * h
        states = [(x, path(x), self._work(path, t, x), self._turned(x - t, x, path(x)))
                  for x in inside[:len(inside) - at_end]]
        self.s.numbers[[WORK, LOST]] = self._work(path, t, solver.t)
        worst = self._keep(h)
        if lands:
            self._restart()
            self.s.numbers[STEP_SIZE] = AFTER_ENGAGEMENT * h
        tries = evaluations // self.scipy.stages if self.scipy.stages else 1
        self.log.append([self.s.numbers[COUNT], solver.t, h, evaluations, tries - 1, error, worst])
        for x, y, work, turned in states:
            self._store(found, x, INSIDE, y, work, turned)
        self.next_wanted += len(inside)
        if len(inside) or (self.every and self.s.numbers[COUNT] % self.every == 0):
            kind = CHECK if len(states) and not at_end else END
            self._store(found, inside[-1] if at_end else solver.t, kind, solver.y, self.s.numbers[[WORK, LOST]],
                        self.s.turned[0])
        return True

    def _stop_at_event(self, t: float) -> Any:
        """Shorten the step just made from t so that it ends where a condition becomes true in it.

        Return its interpolation, or None if the condition becomes true at t, to round-off. One-step methods repeat the
        step until it ends there.
        """
        for k in range(TRIES):
            solver = self.solver
            path, near = solver.dense_output(), FLOATS * FLOAT * solver.t
            found = self._crossing(path, t, solver.t, BEYOND * (solver.t - t) if k else 0.0)
            if found is None or abs(found - solver.t) <= near:
                return path
            if found <= t + near:
                return None
            if not self.scipy.one_step:
                solver.t, solver.y, solver.status = found, path(found), "running"
                return path
            self.solver = self._begin(min(found, self.pieces[self.piece].stop), found - t)
            message = self.solver.step()
            if self.solver.status == "failed":
                raise stuck(self, message)
        return self.solver.dense_output()

    def _stop_at_spring(self, t: float) -> tuple[Any, bool]:
        """Shorten the step just made from t so that it ends where a one-sided spring engages or releases.

        Return its interpolation (None if the step was not changed), and whether it ends at such a place.
        """
        for k in range(STOP_TRIES):
            solver = self.solver
            # stages that are not part of the solution may engage a stop, which spoils interpolations of high order
            path = cubic(solver.t_old, solver.y_old, solver.t, solver.y) if self.scipy.one_step else (
                solver.dense_output())
            found = self._first_change(path, t, solver.t)
            # in an implicit step, a stiff stop holds the end of the step at the place where it engages
            if found is None or ((k > 0 or not self.scipy.one_step) and solver.t - found <= AT_END * (solver.t - t)):
                return solver.dense_output() if k > 0 or found is not None else None, found is not None
            if not self.scipy.one_step:
                solver.t, solver.y, solver.status = found, path(found), "running"
                return path, True
            found = min(found, t + LARGEST_RETRY * (solver.t - t)) if k == 0 else found
            self.solver = self._begin(min(found, self.pieces[self.piece].stop), found - t)
            message = self.solver.step()
            if self.solver.status == "failed":
                raise stuck(self, message)
        return self.solver.dense_output(), True

    def _first_change(self, path: Any, t: float, end: float) -> float | None:
        """Return the first time between t and ``end`` at which a spring engages or releases, or None.

        Changes at the start, where the previous step has ended, are ignored.
        """
        def acts(x: float) -> Array:
            out = np.zeros(len(self.p.stops))
            place(self.inner, self.free, path(x))
            acting(self.p, self.w, self.inner.z, self.inner.v, x, out)
            return out

        before, begun = acts(t), t
        near = max(AT_START * max(end - t, self.s.numbers[OLD_STEP]), SHORTEST * self.longest_step())
        for x in (t + (end - t) * k / SAMPLES for k in range(1, SAMPLES + 1)):
            now, times = acts(x), []
            for k in np.flatnonzero(now != before):
                low, high = begun, x
                while low < (middle := 0.5 * (low + high)) < high:
                    low, high = (middle, high) if acts(middle)[k] == before[k] else (low, middle)
                if high - t > near:
                    times.append(high)
                before[k] = now[k]
            if times:
                return min(times)
            begun = x
        return None

    def _crossing(self, path: Any, t: float, end: float, beyond: float) -> float | None:
        """Return the time at which a condition becomes true between t and ``end`` (or up to ``beyond`` later), or None.

        The conditions that hold there, to round-off, are marked.
        """
        def holds(x: float) -> bool:
            place(self.inner, self.free, path(x))
            found = check_conditions(self.p, self.w, self.inner.z, self.inner.v, x)
            if found == NO_VALUE:
                raise stuck(self, "a condition has no value")
            return bool(found != NONE)

        times = [t + (end - t) * k / SAMPLES for k in range(SAMPLES)] + [end] + ([end + beyond] if beyond else [])
        k = next((k for k in range(1, len(times)) if holds(times[k])), None)
        if k is None:
            return None
        low, high = times[k - 1], times[k]
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (low, middle) if holds(middle) else (middle, high)
        _ = holds(high + 2.0 * FLOATS * FLOAT * end) or holds(high)
        return high

    def _inside(self, t: float, end: float) -> Array:
        """Return the times of wanted states up to the end of a step."""
        if self.every:
            return self.wanted[:0]
        last = int(np.searchsorted(self.wanted, end + NEAR * (end - t), side="right"))
        return self.wanted[self.next_wanted:last]

    def _keep(self, h: float) -> float:
        """Move the motion to the end of the step, projected onto the constraints; return their violation."""
        solver, s = self.solver, self.s
        place(s, self.free, solver.y)
        worst = float(accept_step(self.p, self.w, s, solver.t))
        s.turned[:] = self.turns_on(solver.t, h, s.z, s.v)
        if self.constrained:
            solver.y = np.concatenate([s.z[self.free], s.v[self.free]])
            solver.f = self.rates(solver.t, solver.y)
        s.numbers[TIME], s.numbers[OLD_STEP] = solver.t, h
        s.numbers[COUNT] += 1.0
        s.numbers[STEP_SIZE] = getattr(solver, "h_abs", 0.0)
        weights = self.p.weights
        self.scale = np.maximum(self.scale, [np.max(weights * np.abs(x), initial=0.0) for x in (s.z, s.v)])
        s.numbers[SIZE] = self.scale[0]
        short = solver.status == "finished" and solver.t < self.pieces[self.piece].stop
        if short or (self.scipy.fixed and np.any(self.scale > 2.0 * self.begun)):
            self.solver = None
        return worst

    def _local_error(self, h: float) -> float:
        """Return the local error of the step relative to the size of the motion, or SciPy's own bound on it."""
        solver, m = self.solver, len(self.free)
        if self.scipy.stages == 0:
            return self.tolerance
        if hasattr(solver, "E5"):
            # Hairer, Norsett & Wanner 1993, Sec. II.10: two estimates combined
            fifth, third = (solver.K.T @ e for e in (solver.E5, solver.E3))
            sizes = np.hypot(np.abs(fifth), 0.1 * np.abs(third))
            error = fifth * np.divide(np.abs(fifth), sizes, out=np.ones_like(sizes), where=sizes > 0)
        else:
            error = solver.K.T @ solver.E
        return float(np.max(self.p.weights[self.free] * np.abs(h * error[:m]), initial=0.0) / self.scale[0])

    def _work(self, path: Any, t: float, x: float) -> Array:
        """Return work and loss up to x in a step from t, integrated at the Lobatto points of its interpolation."""
        out = self.s.numbers[[WORK, LOST]]
        for c, weight in LOBATTO if self.tracks_work else ():
            at = t + c * (x - t)
            rates = powers(self.p, self.w, self.factors, self.inner, self.free, at, path(at))
            out += (x - t) * weight * np.array(rates)
        return out

    def _turned(self, h: float, t: float, y: Array) -> Array:
        """Return the counted rotations (sections,) at y, a time h after the current state of the motion."""
        place(self.inner, self.free, y)
        turned: Array = self.turns_on(t, h, self.inner.z, self.inner.v)[0]
        return turned

    def _store(self, found: list[Row], t: float, kind: int, y: Array, work: Array, turned: Array) -> None:
        at = self.inner
        place(at, self.free, y)
        accelerations(self.p, self.w, self.factors, at, t)
        log = [] if kind == CHECK else self.log
        found.append(self._row(float(t), kind, at.z, at.v, at.a, work, turned, np.array(log).reshape(-1, len(LOG))))
        self.log = self.log[len(log):]

    def last(self) -> Row:
        """Return the state at the time reached, with the rest of the log."""
        accelerations(self.p, self.w, self.factors, self.s, self.t)
        self.log = []
        return super().last()

    # ------------------------------------------------------------------ checkpoints

    def checkpoint(self) -> dict[str, Array] | None:
        """Return everything that the motion needs to go on, or None if SciPy's method does not allow that."""
        kept = super().checkpoint() if self.scipy.keeps else None
        return kept and {**kept, "scale": self.scale.copy()}

    def resume(self, kept: dict[str, Array]) -> None:
        """Restore the motion from a checkpoint."""
        super().resume(kept)
        self.scale, self.log = kept["scale"].copy(), self.pending.tolist()
