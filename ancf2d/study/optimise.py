"""Optimisation of numbers of a case: SciPy's optimisers with the derivatives of ``gradient``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..case import LoadedCase, with_overrides
from ..case.axes import Bounds
from ..case.numbers import CaseNumber, moved_starts, numbers_between
from ..elements.shape import Array
from ..errors import ComputationError, all_of, many
from .expressions import MASS, Measures, Vocabulary, read_constraint, read_measure
from .gradient import DifferentiableRun
from .optimum import Optimum, Point, Row
from .record import Progress
from .run import vocabulary
from .sensitivity import on_its_mesh

METHODS = {"slsqp": "SLSQP", "trust-constr": "trust-constr"}
# relative change of the minimum for convergence, and the relative violation up to which a constraint is met
TOLERANCE, MET = 1e-9, 1e-6
# a search ends if the gradient of the Lagrangian times the ranges of all numbers is less than this share of the
# minimum; constraints and bounds this close are active there; least relative gain for which the search is restarted
PROMISED, CLOSE, GAIN = 1e-3, 1e-4, 1e-7
# least promised decrease of a violated constraint, as a share of the violation, for which the search goes on
FAINT = 0.01
# least half width of the box of a search, as a share of the ranges of the numbers
SMALLEST = 0.01
# shares of a number's range within which it is reported at its bound, and is set to the bound
AT_BOUND, EXACT = 1e-6, 1e-12


@dataclass
class Problem:
    """The objective, the numbers to vary, and the constraints (each with <= or ==)."""

    loaded: LoadedCase
    variables: list[CaseNumber]
    bounds: list[Bounds]
    measures: Measures
    kinds: list[str]
    texts: list[str]


def problem_of(loaded: LoadedCase, vary: Sequence[str], minimise: str, constraints: Sequence[str]) -> Problem:
    """Return the problem described by command line options. Raises CaseError with the mistakes of all of them."""
    words, parameters = Vocabulary(loaded), list(loaded.case.parameters)

    (bounds, variables), objective, *read = all_of(
        lambda: numbers_between(loaded, vary, vocabulary()),
        lambda: read_measure(minimise, "--minimise", words, parameters),
        *(partial(read_constraint, text, "--subject-to", words, parameters) for text in constraints))
    kinds = [kind for _, _, kind in read]
    # the right-hand sides of constraints give their scales
    measures = [objective, *(m for m, _, _ in read), *(side for _, side, _ in read)]
    with_rows = [bool(measure.extremes) and kind == "<="
                 for measure, kind in zip(measures, ["<=", *kinds], strict=False)]
    return Problem(loaded, variables, bounds, Measures(measures, loaded.case.goal, with_rows, len(variables)),
                   kinds, list(constraints))


class _Search:
    """Evaluates a problem at shares y of the ranges of its numbers, each point once."""

    def __init__(self, problem: Problem, progress: Progress, tell: Callable[[Point], None]) -> None:
        self.problem, self.progress, self.tell = problem, progress, tell
        self.loaded = on_its_mesh(problem.loaded, progress)
        self.low = np.array([b.low for b in problem.bounds])
        self.high = np.array([b.high for b in problem.bounds])
        self.range = self.high - self.low
        self.history: list[Point] = []
        self.warnings: dict[bytes, list[str]] = {}
        self.gradients = self.failed = 0
        self._last: tuple[bytes, DifferentiableRun] | None = None
        self._known: dict[bytes, Array] = {}
        self.known_slopes: dict[bytes, Array] = {}
        start = np.array([v.value for v in problem.variables])
        self.start = np.clip((start - self.low) / self.range, 0.0, 1.0)
        self.sizes = self._sizes()

    def _sizes(self) -> Array:
        """Return the scales of the values: their size at the start, for constraints the larger of both sides."""
        n, found = len(self.problem.kinds), np.abs(self.values(self.start))
        values = np.append(found[0], np.maximum(found[1:n + 1], found[n + 1:2 * n + 1]))
        return np.where(values > 0.0, values, 1.0)

    def x(self, y: Array) -> Array:
        """Return the numbers at shares y of their ranges."""
        # exactly the bound at a bound
        inside = np.where(y >= 1.0 - EXACT, self.high, self.low + self.range * y)
        return np.where(y <= EXACT, self.low, inside)

    def overrides(self, y: Array) -> list[str]:
        """Return the ``PATH=VALUE`` overrides at y."""
        return [v.override(float(x)) for v, x in zip(self.problem.variables, self.x(y), strict=True)]

    def _run_at(self, y: Array) -> DifferentiableRun:
        """Return the case solved at y. Raises ComputationError that names y."""
        key = y.tobytes()
        if self._last is None or self._last[0] != key:
            here = with_overrides(self.loaded, self.overrides(y), vocabulary())
            try:
                self.warnings[key] = []
                run = DifferentiableRun(here, self.problem.measures, self.progress, self.warnings[key].append,
                                        len(self.problem.variables))
            except ComputationError as error:
                self.failed, f = self.failed + 1, error.failure
                raise ComputationError(f"the case cannot be solved with {', '.join(self.overrides(y))}: {f.reason}",
                                       at=f.at, history=f.history, advice="narrower bounds, or more load steps"
                                       ) from error
            self._last = key, run
        return self._last[1]

    def values(self, y: Array) -> Array:
        """Return the objective and the constraints at y."""
        key = y.tobytes()
        if key not in self._known:
            self._known[key] = found = self._run_at(y).values
            self.history.append(Point(self.x(y), float(found[0]), float(np.max(self._excess(found), initial=0.0))))
            self.tell(self.history[-1])
        return self._known[key]

    def _excess(self, values: Array) -> Array:
        """Return the violation of each constraint (constraints,)."""
        own = values[1:len(self.problem.kinds) + 1]
        return np.array([abs(v) if kind == "==" else max(v, 0.0)
                         for v, kind in zip(own.tolist(), self.problem.kinds, strict=True)])

    def preferred(self, y: Array) -> Array:
        """Return y if it meets all constraints, else the best evaluated point that does, else y."""
        allowed = MET * self.sizes[1:len(self.problem.kinds) + 1]

        def meets(values: Array) -> bool:
            return bool(np.all(self._excess(values) <= allowed))
        if meets(self.values(y)):
            return y
        good = [(values[0], key) for key, values in self._known.items() if meets(values)]
        return np.frombuffer(min(good)[1]) if good else y

    def is_infeasible(self, y: Array) -> bool:
        """Return whether a constraint is violated at y and derivatives promise no decrease of it within the bounds."""
        values, slopes = self.values(y), self.slopes(y)
        for k, kind in enumerate(self.problem.kinds, 1):
            rows = self.rows(k) or slice(k, k + 1)
            for missed, slope in zip(values[rows].tolist(), slopes[rows], strict=True):
                sign = -1.0 if kind == "==" and missed < 0.0 else 1.0
                gain = -float(np.minimum(-sign * slope * y, sign * slope * (1.0 - y)).sum())
                if sign * missed > MET * self.sizes[k] and gain < FAINT * sign * missed:
                    return True
        return False

    def rows(self, number: int) -> slice | None:
        """Return the range of the rows of an expression among the values, or None if it has none."""
        return self.problem.measures.rows(number)

    def slopes(self, y: Array) -> Array:
        """Return the derivatives (values, numbers) by y."""
        key = y.tobytes()
        if key not in self.known_slopes:
            run = self._run_at(y)
            here = [CaseNumber(variable.path, float(x), variable.list_scale, variable.body)
                    for variable, x in zip(self.problem.variables, self.x(y), strict=True)]
            run.compute_together(here)
            columns = [run.differentiate(variable)[0].value for variable in here]
            self.gradients += 1
            self.known_slopes[key] = np.array(columns).T * self.range
        return self.known_slopes[key]


def optimise(problem: Problem, method: str = "slsqp", iterations: int = 100, progress: Progress | None = None,
             tell: Callable[[Point], None] = lambda point: None) -> Optimum:
    """Return the numbers of a problem, within their bounds, that minimise its objective under its constraints.

    ``method``: slsqp (Kraft 1988) or trust-constr (Byrd, Hribar & Nocedal 1999), from the values of the case. Numbers
    are scaled to their ranges, values to their sizes at the start. Raises CaseError, and ComputationError if the case
    cannot be solved at a point of the search.
    """
    search = _Search(problem, progress or Progress(), tell)
    y, success, nit, message = _minimised(search, method, iterations)
    message = (f"no convergence within {many(iterations, 'iteration')}; allow more, or widen the bounds"
               if nit >= iterations and not success else message)
    return _optimum(problem, search, y, success, message)


def _minimised(search: _Search, method: str, iterations: int) -> tuple[Array, bool, int, str]:
    """Return the end point of SciPy's optimiser, whether it converged, its iterations, and its message.

    If slsqp ends although derivatives promise a further decrease, as may happen with ==, it is restarted there. If it
    does not converge, the search continues from the best point within a box around it, a quarter as wide each time:
    steps far beyond the validity of the derivatives may end at points from which no step leads back. The same applies
    where the case cannot be solved, from the last point with derivatives.
    """
    from scipy.optimize import minimize

    options: dict[str, Any] = {"maxiter": iterations}
    if method == "slsqp":
        options["ftol"] = TOLERANCE
    else:
        # gtol checks the gradient of the Lagrangian, whose multipliers can make it 0 while constraints are not met
        options |= {"gtol": 0.0, "xtol": TOLERANCE}
    goal, constraints, y, reach, done = _Goal(search), _constraints(search, method), search.start, 1.0, 0
    last, ended = np.inf, None
    while True:
        low, high = np.maximum(y - reach, 0.0), np.minimum(y + reach, 1.0)
        with warnings.catch_warnings():
            # linear quantities such as a mass cause this warning without being a mistake
            warnings.filterwarnings("ignore", message="delta_grad == 0.0")
            try:
                result = minimize(goal.value, goal.start(y), jac=goal.slope, method=METHODS[method],
                                  bounds=goal.bounds(low, high), constraints=constraints,
                                  options=options | {"maxiter": iterations - done})
            except ComputationError:
                if method != "slsqp" or reach < SMALLEST or not search.known_slopes:
                    raise
                y, reach = np.frombuffer([*search.known_slopes][-1]), reach / 4.0
                continue
        found, done = np.clip(np.asarray(result.x)[:len(y)], low, high), done + int(result.nit)
        at_edge = bool(np.any(((found - low < EXACT) & (low > 0.0)) | ((high - found < EXACT) & (high < 1.0))))
        success = bool(result.success) and not at_edge
        outcome = found, success, done, " ".join(str(result.message).split())
        gains = last - result.fun > GAIN * abs(result.fun)
        if success and method == "slsqp" and done < iterations and gains and _can_decrease(search, goal, result.x):
            y, last, ended = found, float(result.fun), outcome
            continue
        if ended is not None and not success:
            return ended
        if success or done >= iterations or method != "slsqp" or reach < SMALLEST:
            return outcome
        if result.success:
            y = found
        elif search.is_infeasible(y := search.preferred(found)):
            return outcome
        else:
            reach /= 4.0


class _Goal:
    """The function that the optimiser minimises over z: of y itself, or a level, appended to y, above all rows.

    The smallest level above the rows of an expression is its minimum, and all rows are smooth (epigraph form; Boyd &
    Vandenberghe, Convex Optimization, 2004, section 4.1).
    """

    def __init__(self, search: _Search) -> None:
        self.search, self.n = search, len(search.start)
        self.level = search.rows(0) is not None

    def start(self, y: Array) -> Array:
        """Return the starting point of a search from y."""
        return np.append(y, self.search.values(y)[0] / self.search.sizes[0]) if self.level else y

    def bounds(self, low: Array, high: Array) -> list[tuple[float | None, float | None]]:
        """Return the bounds of each unknown of the optimiser, with y within a box."""
        return [*zip(low.tolist(), high.tolist(), strict=True), *[(None, None)] * self.level]

    def value(self, z: Array) -> float:
        """Return the objective."""
        return float(z[-1]) if self.level else float(self.search.values(z)[0] / self.search.sizes[0])

    def slope(self, z: Array) -> Array:
        """Return the derivatives of the objective by z."""
        return np.eye(self.n + 1)[-1] if self.level else self.search.slopes(z)[0] / self.search.sizes[0]


def _can_decrease(search: _Search, goal: _Goal, z: Array) -> bool:
    """Return whether known derivatives at z promise a larger decrease than a converged search would leave.

    The measure is the residual of the conditions of Karush, Kuhn and Tucker with the best multipliers of what is
    active.
    """
    from scipy.optimize import nnls

    n, slopes, values = goal.n, list[Array](), list[Array]()
    if z[:n].tobytes() not in search.known_slopes:
        return False
    for one in _constraints(search, "slsqp"):
        for sign in (1.0, -1.0) if one["type"] == "eq" else (1.0,):
            slopes.append(sign * one["jac"](z))
            values.append(sign * one["fun"](z))
    ends = np.eye(n, len(z))
    rows, left = np.concatenate([*slopes, ends, -ends]), np.concatenate([*values, z[:n], 1.0 - z[:n]])
    slope, active = goal.slope(z), rows[left <= CLOSE].T
    rest = slope - active @ nnls(active, slope)[0] if active.size else slope
    return float(np.abs(rest).sum()) > PROMISED * abs(goal.value(z))


def _constraints(search: _Search, method: str) -> list[Any]:
    """Return the constraints in the optimiser's form, and the rows of the objective that stay below its level."""
    from scipy.optimize import NonlinearConstraint

    n, level, out = len(search.start), search.rows(0) is not None, list[Any]()
    for k, kind in enumerate(("<=", *search.problem.kinds)):
        rows = search.rows(k) or slice(k, k + 1)
        if k == 0 and not level:
            continue

        def excess(z: Array, k: int = k, rows: slice = rows) -> Array:
            return search.values(z[:n])[rows] / search.sizes[k] - (z[n] if k == 0 else 0.0)

        def slopes(z: Array, k: int = k, rows: slice = rows) -> Array:
            found = search.slopes(z[:n])[rows] / search.sizes[k]
            return np.column_stack([found, np.full(len(found), -1.0 if k == 0 else 0.0)]) if level else found
        if method == "slsqp":
            out.append({"type": "eq" if kind == "==" else "ineq", "fun": lambda z, f=excess: -f(z),
                        "jac": lambda z, f=slopes: -f(z)})
        else:
            out.append(NonlinearConstraint(excess, 0.0 if kind == "==" else -np.inf, 0.0, jac=slopes))
    return out


def _optimum(problem: Problem, search: _Search, y: Array, success: bool, message: str) -> Optimum:
    y = search.preferred(y)
    values, x = search.values(y), search.x(y)
    starts, rows = np.clip([v.value for v in problem.variables], search.low, search.high).tolist(), []
    for bound, start, value, share in zip(problem.bounds, starts, x.tolist(), y.tolist(), strict=True):
        at = "low" if share <= AT_BOUND else "high" if share >= 1 - AT_BOUND else None
        rows.append(Row(bound.path, value, start, bound.low, bound.high, at))
    constraints, kept = [], True
    for text, kind, value, size in zip(problem.texts, problem.kinds, values[1:].tolist(), search.sizes[1:],
                                       strict=False):
        met = (abs(value) if kind == "==" else value) <= MET * size
        kept &= bool(met)
        constraints.append({"constraint": text, "excess": value, "met": bool(met),
                            "active": bool(abs(value) <= 10 * MET * size)})
    if not kept:
        success, message = False, "no values within the bounds were found that meet all constraints"
    loaded, minimised = search.loaded, problem.measures.measures[0].text
    warned = [*moved_starts(problem.variables, problem.bounds, starts),
              *dict.fromkeys(search.warnings[y.tobytes()])]
    if not any(slopes[0].any() for slopes in search.known_slopes.values()):
        warned.append(f"{minimised} does not depend on any of the numbers that vary" + (
            ": no material or section of the case has a mass" if minimised == MASS and not values[0] else ""))
    return Optimum(loaded.source.file, loaded.case.title, minimised, rows, float(values[0]), constraints,
                   len(search.history) + search.failed, search.failed, search.gradients, success, message,
                   search.history, warned)
