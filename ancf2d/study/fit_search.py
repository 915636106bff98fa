"""The search for the numbers with which a case agrees best with data: its residuals and their derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..case import LoadedCase, with_overrides
from ..case.axes import Bounds
from ..case.numbers import Variable
from ..elements.shape import Array
from ..errors import ComputationError
from .fit_data import Data, Watch
from .gradient import Study, derivatives_of
from .record import Progress
from .run import vocabulary

# steps of the differences of motions, as shares of the way between the bounds: where time steps are fixed, and where
# they adapt, so that runs side by side differ by their errors too
STEP, STEP_ADAPTIVE = 1e-4, 2e-3
# the share of a motion's data that a search begins with, if there are so many values for each number; how close to the
# minimum it goes there (as SETTLED), in so many steps at most
FIRST_PART, ENOUGH, NEAR, FIRST_STEPS = 1.0 / 3.0, 5, 2.0, 12
# the relative decrease of the squares that is none, with exact derivatives and with differences of runs
TOLERANCE, TOLERANCE_OF_RUNS = 1e-8, 1e-6
# of the region of confidence: how far derivatives are carried that standard errors follow from; distances from the
# minimum that are close to it, and where a search ends
CARRIED, CLOSE, SETTLED = 10.0, 1.0, 0.1
# of a step's change of the residuals, what derivatives may miss and still be mended
BENT = 0.5
# shares of the way between the bounds within which a number is at one
AT_BOUND = 1e-6
# of the singular values of the Jacobian: parameters below are not told by the data
SINGULAR = 1e-7


class _RenewedError(Exception):
    """Derivatives have been made anew where the search is: it goes on with a new region of trust."""


class _SettledError(Exception):
    """A search has come to its end."""


class _Secant(NamedTuple):
    """A place z (n,) with residuals f (m,) and derivatives J (m, n), last computed anew at ``made`` (n,)."""

    z: Array
    f: Array
    J: Array
    made: Array


class Search:
    """Differences between a case and data as a function of z (n,) in [0, 1], the places between the bounds."""

    def __init__(self, loaded: LoadedCase, data: Data, variables: list[Variable], bounds: Sequence[Bounds],
                 scales: Array, progress: Progress, done: Callable[[int, float], None]) -> None:
        self.loaded, self.data, self.variables, self.bounds = loaded, data, variables, bounds
        self.watch, self.progress, self.done, self.runs = Watch(data), progress, done, 0
        # bounds above 0 are gone through by equal ratios
        self.ratios = [b.low > 0.0 for b in bounds]
        self.scale = np.broadcast_to(scales, data.values.shape)[data.known]
        self.scales, self.measured = scales, data.values[data.known]
        # which values (m,) count
        self.counts = np.ones(len(self.measured), dtype=bool)
        # derivatives of what is solved over time take several runs: they are carried from step to step
        self.timed = loaded.case.solver.timed
        self.exact = self.watch.places and loaded.case.solver.moves
        # the last two, since a step may have led away from where derivatives are wanted
        self.solved: list[tuple[bytes, Study]] = []
        self.last: Array | None = None
        self.secant: _Secant | None = None

    def values(self, z: Array) -> list[float]:
        """Return the parameters at z."""
        return [float(b.low * (b.high / b.low) ** s if ratio else b.low + (b.high - b.low) * s)
                for b, s, ratio in zip(self.bounds, z.tolist(), self.ratios, strict=True)]

    def place(self, values: Sequence[float]) -> Array:
        """Return where parameters are between their bounds."""
        return np.array([math.log(v / b.low) / math.log(b.high / b.low) if ratio and v > 0.0
                         else (v - b.low) / (b.high - b.low)
                         for b, v, ratio in zip(self.bounds, values, self.ratios, strict=True)])

    def rates(self, z: Array) -> Array:
        """Return the derivatives (n,) of the parameters to z."""
        return np.array([v * math.log(b.high / b.low) if ratio else b.high - b.low
                         for b, v, ratio in zip(self.bounds, self.values(z), self.ratios, strict=True)])

    def case(self, z: Array) -> LoadedCase:
        """Return the case at z. Raises CaseError."""
        options = [v.override(x) for v, x in zip(self.variables, self.values(z), strict=True)]
        return with_overrides(self.loaded, options, vocabulary())

    def study(self, z: Array) -> Study:
        """Return what the case is at z, solved once. Raises CaseError and ComputationError."""
        known = next((one for at, one in self.solved if at == z.tobytes()), None)
        if known is None:
            self.runs += 1
            known = Study(self.case(z), self.watch, replace(self.progress, judges=False))
            self.solved = [*self.solved[-1:], (z.tobytes(), known)]
        return known

    def model(self, z: Array) -> Array:
        """Return what the case has at z in place of the data. Raises CaseError and ComputationError."""
        return self.study(z).values

    def residuals(self, z: Array) -> Array:
        """Return the differences (m,) beside their scales, infinite ones where the case cannot be solved."""
        try:
            found = (self.model(z) - self.measured) / self.scale
        except ComputationError:
            if self.last is None:
                raise
            return np.full(len(self.measured), np.inf)
        self.last = found
        self.done(self.runs, float(np.sqrt(np.mean(found**2))))
        return found

    def _counted(self, z: Array) -> Array:
        """Return the differences (m,) that count.

        Raises _RenewedError where derivatives that were carried far led to larger ones.
        """
        f, known, now = np.where(self.counts, self.residuals(z), 0.0), self.secant, self.counts
        larger = known is not None and self.exact and not f @ f <= known.f[now] @ known.f[now]
        if known is not None and larger and _distance(known.z, known.made, known.f[now], known.J[now]) > CARRIED:
            self.secant = known._replace(J=self._anew(known.z, known.f), made=known.z)
            raise _RenewedError
        return f

    def _parts(self) -> list[Array]:
        """Return the values (m,) that count first, and at last: early ones of a motion, then all.

        A vibration that is out of step by half a period or more hides the way to the minimum; early on it is not yet.
        """
        x = np.broadcast_to(self.data.x[:, None], self.data.values.shape)[self.data.known]
        early, whole = x <= np.quantile(x, FIRST_PART), np.ones(len(x), dtype=bool)
        few = np.count_nonzero(early) < ENOUGH * len(self.variables)
        return [whole] if few or not self.loaded.case.solver.moves else [early, whole]

    def jacobian(self, z: Array) -> Array:
        """Return the derivatives (m, n) of the differences to z. Raises ComputationError."""
        if not self.timed:
            found = derivatives_of(self.study(z), self._variables_at(z))
            self.runs += sum(4 for method in found.methods if method != "exact")
            return found.jacobian * self.rates(z) / self.scale[:, None]
        assert self.last is not None
        return self._secants(z, self.last)

    def _variables_at(self, z: Array) -> list[Variable]:
        return [replace(v, value=x) for v, x in zip(self.variables, self.values(z), strict=True)]

    def _secants(self, z: Array, f: Array) -> Array:
        """Return the derivatives of runs over time, with Broyden's update from step to step.

        They are made anew where the search comes close to its end far from where they were made, since standard errors
        follow from them, and where the update misses most of a step. Raises _SettledError at the end.
        """
        known, J, made, step, now = self.secant, None, z, None, self.counts
        if known is not None and np.array_equal(z, known.z):
            J, made = known.J, known.made
        elif known is not None:
            dz, df = step = z - known.z, f - known.f
            off = df - known.J @ dz
            if np.linalg.norm(off[now]) < BENT * np.linalg.norm(df[now]):
                J, made = known.J + np.outer(off, dz) / float(dz @ dz), known.made
        ends = now.all()
        if J is None or (ends and _offset(z, f, J) < CLOSE and _distance(z, made, f, J) > CARRIED):
            J, made = self._anew(z, f, step), z
        self.secant = _Secant(z, f, J, made)
        if _offset(z, f[now], J[now]) < (SETTLED if ends else NEAR):
            raise _SettledError
        return J

    def _anew(self, z: Array, f: Array, step: tuple[Array, Array] | None = None) -> Array:
        """Return the derivatives (m, n) of runs over time: exact ones, where a motion has them, or by differences."""
        found = self.study(z).exact(self._variables_at(z)) if self.exact else None
        if found is None:
            self.exact = False
            return self._differences(z, f, step)
        # the motion is made once more, beside its changes
        self.runs += 1
        return found * self.rates(z) / self.scale[:, None]

    def _differences(self, z: Array, f: Array, step: tuple[Array, Array] | None = None) -> Array:
        """Return the derivatives (m, n) of runs over time by one run for each number, to the inside of its bounds.

        A ``step`` (n,) to z, with its change (m,) of f, saves one run where bounds let the others go across it.
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
        """Return what SciPy finds from z0."""
        from scipy.optimize import OptimizeResult, least_squares

        self.last, self.secant, self.solved, found = None, None, [], None
        for part in self._parts():
            self.counts, found = part, None
            while found is None:
                try:
                    found = least_squares(
                        self._counted, z0, lambda z: self.jacobian(z) * self.counts[:, None], (0.0, 1.0), method="trf",
                        x_scale="jac", ftol=TOLERANCE_OF_RUNS if self.timed else TOLERANCE, xtol=TOLERANCE,
                        gtol=TOLERANCE, max_nfev=None if self.counts.all() else FIRST_STEPS)
                    if self.timed and self.counts.all():
                        found.jac = self._anew(found.x, found.fun)
                except (_RenewedError, _SettledError) as why:
                    assert self.secant is not None
                    z0, f, J, _ = self.secant
                    if isinstance(why, _SettledError):
                        found = OptimizeResult(x=z0, fun=f, jac=J, cost=0.5 * float(f @ f), success=True, message="")
            z0 = found.x
        return found


def _offset(z: Array, f: Array, J: Array) -> float:
    """Return how far a place is from the minimum, beside the size of the region of confidence about it.

    The relative offset of Bates & Watts (Technometrics 23, 1981). Numbers that are held by a bound are left out.
    """
    slope = J.T @ f
    free = ~(((z < AT_BOUND) & (slope > 0.0)) | ((z > 1.0 - AT_BOUND) & (slope < 0.0)))
    U, s, _ = np.linalg.svd(J[:, free], full_matrices=False)
    within = U[:, s > SINGULAR * s.max(initial=0.0)].T @ f
    return float(np.linalg.norm(within)) / _confidence(f, within)


def _distance(z: Array, other: Array, f: Array, J: Array) -> float:
    """Return how far two places are from each other beside the size of the region of confidence."""
    return float(np.linalg.norm(J @ (z - other))) / _confidence(f, np.linalg.qr(J)[0].T @ f)


def _confidence(f: Array, within: Array) -> float:
    """Return the size of residuals along n directions that noise explains; ``within`` (n,) is there of f (m,)."""
    across, n = max(float(f @ f) - float(within @ within), 0.0), max(len(within), 1)
    return max(math.sqrt(across * n / (len(f) - n)), 1e-300)
