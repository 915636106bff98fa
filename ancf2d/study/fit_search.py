"""The search for the numbers with which a case agrees best with data: residuals and their derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..case import LoadedCase, with_overrides
from ..case.axes import Bounds
from ..case.numbers import CaseNumber
from ..elements.shape import Array
from ..errors import ComputationError
from .fit_data import Data, DataValues, comparable
from .gradient import DifferentiableRun, derivatives_of
from .record import Progress
from .run import vocabulary

# difference steps for motions, as shares of the way between the bounds: with fixed time steps, and with adaptive ones,
# where runs also differ by their errors
STEP, STEP_ADAPTIVE = 1e-4, 2e-3
# share of a motion's data used in the first part of a search, if it has at least ENOUGH values per number; distance
# from the minimum at which that part ends (like SETTLED), and its largest number of steps
FIRST_PART, ENOUGH, NEAR, FIRST_STEPS = 1.0 / 3.0, 5, 2.0, 12
# relative decrease of the sum of squares for convergence, with exact derivatives and with differences of runs
TOLERANCE, TOLERANCE_OF_RUNS = 1e-8, 1e-6
# in units of the region of confidence: how far derivatives are carried at most for standard errors; distance from the
# minimum that is close to it, and that at which a search ends
CARRIED, CLOSE, SETTLED = 10.0, 1.0, 0.1
# largest relative miss of a step's change of the residuals for which derivatives are updated instead of recomputed
BENT = 0.5
# shares of the way between the bounds within which a number is at one
AT_BOUND = 1e-6
# of the largest singular value of the Jacobian: the data do not determine parameters with smaller ones
SINGULAR = 1e-7


class _RenewedError(Exception):
    """Derivatives were recomputed at the present point: the search restarts with a new trust region."""


class _SettledError(Exception):
    """The search has converged."""


class _Secant(NamedTuple):
    """A point z (n,) with residuals f (m,) and derivatives J (m, n), these computed at ``computed_at`` (n,)."""

    z: Array
    f: Array
    J: Array
    computed_at: Array


class Search:
    """Differences between a case and data as a function of z (n,) in [0, 1], positions between the bounds.

    ``first_part``: only the way to the minimum is sought, not the minimum itself. ``runs``: number of runs, of which
    those over the first part of the time count in proportion.
    """

    def __init__(self, loaded: LoadedCase, data: Data, variables: list[CaseNumber], bounds: Sequence[Bounds],
                 scales: Array, progress: Progress, done: Callable[[int, float], None], first_part: bool = False
                 ) -> None:
        self.loaded, self.data, self.variables, self.bounds = comparable(loaded, data), data, variables, bounds
        self.function, self.progress, self.done, self.runs = DataValues(data), progress, done, 0.0
        self.first_part = first_part
        # parameters with positive bounds are scaled logarithmically
        self.ratios = [b.low > 0.0 for b in bounds]
        self.scale = np.broadcast_to(scales, data.values.shape)[data.known]
        self.scales, self.measured = scales, data.values[data.known]
        # derivatives of solutions over time take several runs: they are updated from step to step
        self.timed = loaded.case.solver.timed
        self.exact = self.function.from_probes and loaded.case.solver.moves
        # the last two, since a step may have led away from the point where derivatives are wanted
        self.solved: list[tuple[bytes, DifferentiableRun]] = []
        self.last: Array | None = None
        self.secant: _Secant | None = None

    def values(self, z: Array) -> list[float]:
        """Return the parameters at z."""
        return [float(b.low * (b.high / b.low) ** s if ratio else b.low + (b.high - b.low) * s)
                for b, s, ratio in zip(self.bounds, z.tolist(), self.ratios, strict=True)]

    def positions(self, values: Sequence[float]) -> Array:
        """Return the positions of parameters between their bounds."""
        return np.array([math.log(v / b.low) / math.log(b.high / b.low) if ratio and v > 0.0
                         else (v - b.low) / (b.high - b.low)
                         for b, v, ratio in zip(self.bounds, values, self.ratios, strict=True)])

    def rates(self, z: Array) -> Array:
        """Return the derivatives (n,) of the parameters by z."""
        return np.array([v * math.log(b.high / b.low) if ratio else b.high - b.low
                         for b, v, ratio in zip(self.bounds, self.values(z), self.ratios, strict=True)])

    def case(self, z: Array) -> LoadedCase:
        """Return the case at z. Raises CaseError."""
        options = [v.override(x) for v, x in zip(self.variables, self.values(z), strict=True)]
        return with_overrides(self.loaded, options, vocabulary())

    def run_at(self, z: Array) -> DifferentiableRun:
        """Return the case solved at z, each once. Raises CaseError and ComputationError."""
        known = next((one for at, one in self.solved if at == z.tobytes()), None)
        if known is None:
            self.runs += 1.0
            known = DifferentiableRun(self.case(z), self.function, replace(self.progress, checks_mesh=False))
            self.solved = [*self.solved[-1:], (z.tobytes(), known)]
        return known

    def model(self, z: Array) -> Array:
        """Return the computed values at z for comparison with the data. Raises CaseError and ComputationError."""
        return self.run_at(z).values

    def residuals(self, z: Array) -> Array:
        """Return the scaled differences (m,); they are infinite if the case cannot be solved."""
        try:
            found = (self.model(z) - self.measured) / self.scale
        except ComputationError:
            if self.last is None:
                raise
            return np.full(len(self.measured), np.inf)
        self.last = found
        self.done(math.ceil(self.runs), float(np.sqrt(np.mean(found**2))))
        return found

    def _residuals_or_renewal(self, z: Array) -> Array:
        """Return the differences (m,).

        Raises _RenewedError if derivatives that were carried far led to a larger sum of squares.
        """
        f, known = self.residuals(z), self.secant
        larger = known is not None and self.exact and not f @ f <= known.f @ known.f
        if known is not None and larger and _distance(known.z, known.computed_at, known.f, known.J) > CARRIED:
            self.secant = known._replace(J=self._recomputed(known.z, known.f), computed_at=known.z)
            raise _RenewedError
        return f

    def _after_first_part(self, z0: Array) -> Array:
        """Return the place to which the early data of a motion lead from z0, or z0 if there are too few of them.

        A vibration that is out of phase by half a period or more hides the way to the minimum; early on it is not yet.
        """
        if self.first_part or not self.loaded.case.solver.moves:
            return z0
        data = self.data.early(FIRST_PART)
        if np.count_nonzero(data.known) < ENOUGH * len(self.variables):
            return z0
        share, before = data.x[-1] / self.data.x[-1], self.runs
        search = Search(self.loaded, data, self.variables, self.bounds, self.scales, self.progress,
                        lambda runs, residual: self.done(math.ceil(before + share * runs), residual), first_part=True)
        try:
            return np.asarray(search.minimise(z0).x)
        finally:
            self.runs += share * search.runs

    def jacobian(self, z: Array) -> Array:
        """Return the derivatives (m, n) of the differences by z. Raises ComputationError."""
        if not self.timed:
            found = derivatives_of(self.run_at(z), self._variables_at(z))
            self.runs += sum(4 for method in found.methods if method != "exact")
            return found.jacobian * self.rates(z) / self.scale[:, None]
        assert self.last is not None
        return self._secants(z, self.last)

    def _variables_at(self, z: Array) -> list[CaseNumber]:
        return [replace(v, value=x) for v, x in zip(self.variables, self.values(z), strict=True)]

    def _secants(self, z: Array, f: Array) -> Array:
        """Return the derivatives of runs over time, with Broyden's update from step to step.

        They are recomputed if the update misses most of a step, and near the end of the search if they were computed
        far away, since standard errors follow from them. Raises _SettledError at the end.
        """
        known, J, computed_at, step = self.secant, None, z, None
        if known is not None and np.array_equal(z, known.z):
            J, computed_at = known.J, known.computed_at
        elif known is not None:
            dz, df = step = z - known.z, f - known.f
            off = df - known.J @ dz
            if np.linalg.norm(off) < BENT * np.linalg.norm(df):
                J, computed_at = known.J + np.outer(off, dz) / float(dz @ dz), known.computed_at
        near = not self.first_part and J is not None and _offset(z, f, J) < CLOSE
        if J is None or (near and _distance(z, computed_at, f, J) > CARRIED):
            J, computed_at = self._recomputed(z, f, step), z
        self.secant = _Secant(z, f, J, computed_at)
        if _offset(z, f, J) < (NEAR if self.first_part else SETTLED):
            raise _SettledError
        return J

    def _recomputed(self, z: Array, f: Array, step: tuple[Array, Array] | None = None) -> Array:
        """Return the derivatives (m, n) of runs over time, exactly if the motion has them, else by differences."""
        found = self.run_at(z).exact(self._variables_at(z)) if self.exact else None
        if found is None:
            self.exact = False
            return self._differences(z, f, step)
        # the motion is computed once more, together with its derivatives
        self.runs += 1.0
        return found * self.rates(z) / self.scale[:, None]

    def _differences(self, z: Array, f: Array, step: tuple[Array, Array] | None = None) -> Array:
        """Return the derivatives (m, n) of runs over time by one run per number, towards the inside of its bounds.

        A ``step`` (n,) to z, with its change (m,) of f, saves one run if the bounds allow differences perpendicular to
        it.
        """
        h = STEP if getattr(self.loaded.case.solver, "dt", None) is not None else STEP_ADAPTIVE

        def inside(way: Array) -> float:
            return next((end for end in (h, -h) if np.all((z + end * way >= 0.0) & (z + end * way <= 1.0))), 0.0)
        ways, columns = np.eye(len(z)), list[Array]()
        if step is not None:
            across = np.linalg.qr(step[0][:, None], mode="complete")[0][:, 1:].T
            across /= np.abs(across).max(axis=1, keepdims=True)
            if all(inside(way) for way in across):
                ways, columns = np.vstack([step[0], across]), [step[1]]
        for way in ways[len(columns):]:
            there = (self.model(z + inside(way) * way) - self.measured) / self.scale
            columns.append((there - f) / inside(way))
        return np.asarray(np.linalg.solve(ways, np.array(columns)).T, dtype=float)

    def minimise(self, z0: Array) -> Any:
        """Return the result of SciPy's ``least_squares`` from z0."""
        from scipy.optimize import OptimizeResult, least_squares

        self.last, self.secant, self.solved, found = None, None, [], None
        z0 = self._after_first_part(z0)
        while found is None:
            try:
                found = least_squares(
                    self._residuals_or_renewal, z0, self.jacobian, (0.0, 1.0), method="trf", x_scale="jac",
                    ftol=TOLERANCE_OF_RUNS if self.timed else TOLERANCE, xtol=TOLERANCE, gtol=TOLERANCE,
                    max_nfev=FIRST_STEPS if self.first_part else None)
                if self.timed and not self.first_part:
                    found.jac = self._recomputed(found.x, found.fun)
            except (_RenewedError, _SettledError) as why:
                assert self.secant is not None
                z0, f, J, _ = self.secant
                if isinstance(why, _SettledError):
                    found = OptimizeResult(x=z0, fun=f, jac=J, cost=0.5 * float(f @ f), success=True, message="")
        return found


def _offset(z: Array, f: Array, J: Array) -> float:
    """Return the distance from the minimum relative to the size of the region of confidence.

    The relative offset of Bates & Watts (Technometrics 23, 1981). Numbers held by a bound are left out.
    """
    slope = J.T @ f
    free = ~(((z < AT_BOUND) & (slope > 0.0)) | ((z > 1.0 - AT_BOUND) & (slope < 0.0)))
    U, s, _ = np.linalg.svd(J[:, free], full_matrices=False)
    within = U[:, s > SINGULAR * s.max(initial=0.0)].T @ f
    return float(np.linalg.norm(within)) / _confidence(f, within)


def _distance(z: Array, other: Array, f: Array, J: Array) -> float:
    """Return the distance between two points relative to the size of the region of confidence."""
    return float(np.linalg.norm(J @ (z - other))) / _confidence(f, np.linalg.qr(J)[0].T @ f)


def _confidence(f: Array, within: Array) -> float:
    """Return the size of residuals in n directions due to noise; ``within`` (n,) is the part of f (m,) in them."""
    across, n = max(float(f @ f) - float(within @ within), 0.0), max(len(within), 1)
    return max(math.sqrt(across * n / (len(f) - n)), 1e-300)
