"""Fits of numbers of a case to measured data: least squares between bounds, standard errors, the fitted case."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..case import LoadedCase
from ..case.axes import Bounds
from ..case.numbers import CaseNumber, moved_starts, number_at, numbers_between, text_with
from ..case.units import QUANTITY_UNITS, unit_label
from ..elements.shape import Array
from ..errors import CaseError, ComputationError, Problem, many, raise_any
from ..results import Column, write_tables
from ..results.target import MARK, replacing
from .digests import inputs_of
from .fit_data import Data, check_data
from .fit_search import AT_BOUND, SINGULAR, Search
from .record import Progress
from .run import prepare, result_header, vocabulary
from .warmup import objects_frozen


@dataclass
class Fitted:
    """A fitted parameter: its value and standard error, None if the data do not determine it."""

    path: str
    value: float
    standard_error: float | None
    low: float
    high: float
    start: float


@dataclass
class Fit:
    """Fitted parameters, and how well the case agrees with the data.

    ``residual`` is the root mean square of all differences relative to the ``scales`` (columns,) of their columns,
    ``rms`` (columns,) that of each column in its units. ``model`` (n, columns) contains the computed values at the
    places of the data. ``starts`` lists parameters and residual of each start, the best one first.
    """

    case: str
    title: str
    rows: list[Fitted]
    residual: float
    data: Data
    model: Array
    scales: Array
    rms: Array
    correlation: Array
    runs: int
    starts: list[dict[str, Any]]
    loaded: LoadedCase
    warnings: list[str] = field(default_factory=list)

    def overrides(self) -> list[str]:
        """Return ``PATH=VALUE`` for each fitted parameter."""
        return [number_at(self.loaded, row.path).override(row.value) for row in self.rows]

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``--json`` prints."""
        columns = [{"name": name, "rms": float(rms), "scale": float(scale)}
                   for name, rms, scale in zip(self.data.names, self.rms, self.scales, strict=True)]
        correlation = [[None if math.isnan(v) else v for v in row] for row in self.correlation.tolist()]
        return {"case": self.case, "title": self.title, "status": "converged", "rows": [vars(r) for r in self.rows],
                "residual": self.residual, "columns": columns, "correlation": correlation,
                "points": int(self.data.known.sum()), "runs": self.runs, "starts": self.starts,
                "warnings": self.warnings}


@objects_frozen()
def fit(loaded: LoadedCase, data: Data, vary: Sequence[str], sigma: Mapping[str, float] | None = None,
        starts: int = 1, progress: Progress | None = None,
        done: Callable[[int, float], None] = lambda runs, residual: None) -> Fit:
    """Find the numbers of a case, between bounds, for which it agrees best with data in the sense of least squares.

    ``vary``: ``PATH=low:high`` of each number. The differences in each column are divided by its noise ``sigma``, or by
    its range. ``starts``: number of searches, the first from the case's own numbers, others from points spread between
    the bounds; the best one counts. ``done`` is called with the number of runs and the residual. The search is SciPy's
    ``least_squares`` (trust region reflective). Raises CaseError with all problems, ComputationError if no start can be
    solved.
    """
    bounds, variables = _variables(loaded, data, vary, sigma or {})
    scales = np.array([(sigma or {}).get(name, scale)
                       for name, scale in zip(data.names, data.scales(prepare(loaded).extent), strict=True)])
    problem = Search(loaded, data, variables, bounds, scales, progress or Progress(), done)
    best, tried, failures, places = None, [], [], _starts(problem, starts)
    for z0 in places:
        try:
            found = problem.minimise(z0)
        except ComputationError as error:
            failures.append(error)
            continue
        tried.append((float(found.cost), problem.values(z0), found))
        best = found if best is None or found.cost < best.cost else best
    if best is None:
        raise failures[0]
    tried.sort(key=lambda one: one[0])
    paths = [b.path for b in bounds]
    searches = [{"start": dict(zip(paths, start, strict=True)), "residual": float(np.sqrt(np.mean(one.fun**2))),
                 "values": dict(zip(paths, problem.values(one.x), strict=True))} for _, start, one in tried]
    warnings = moved_starts(variables, bounds, problem.values(places[0]))
    return _conclude(loaded, problem, best, tried[0][1], searches,
                     warnings + [f"a start failed: {e}" for e in failures])


def _variables(loaded: LoadedCase, data: Data, vary: Sequence[str], sigma: Mapping[str, float]
               ) -> tuple[list[Bounds], list[CaseNumber]]:
    problems, bounds, variables = check_data(loaded, data), list[Bounds](), list[CaseNumber]()
    try:
        bounds, variables = numbers_between(loaded, vary, vocabulary())
    except CaseError as error:
        problems += error.problems
    for name, noise in sigma.items():
        if name not in data.names:
            problems.append(Problem(f"the data have no column '{name}'", file=f"--sigma {name}={noise:g}",
                                    expected=f"one of {', '.join(data.names)}"))
        elif not (math.isfinite(noise) and noise > 0.0):
            problems.append(Problem("the noise must be > 0", file=f"--sigma {name}={noise:g}"))
    if not vary:
        problems.append(Problem("nothing is varied", expected="--vary PATH=LOW:HIGH"))
    if data.known.sum() <= len(vary):
        problems.append(Problem(f"there are too few values ({int(data.known.sum())}) to fit "
                                f"{many(len(vary), 'number')}", file=data.file, expected="more values than numbers"))
    raise_any(problems)
    return bounds, variables


def _starts(problem: Search, count: int) -> list[Array]:
    """Return the starting points of the searches: the case's own numbers, then points of a Sobol sequence."""
    from scipy.stats import qmc

    own = problem.positions([v.value for v in problem.variables])
    inside = np.where((own > 0.0) & (own < 1.0), own, 0.5)
    more = qmc.Sobol(len(own), seed=0).random_base2(max(math.ceil(math.log2(max(count - 1, 1))), 0))
    return [inside, *(0.05 + 0.9 * more[:count - 1])]


def _conclude(loaded: LoadedCase, problem: Search, found: Any, start: Sequence[float], tried: list[dict[str, Any]],
              warnings: list[str]) -> Fit:
    """Return the fit with its standard errors, from a linear model in the neighbourhood of the minimum.

    With J the Jacobian, cov = (J^T J)^-1 J^T S J (J^T J)^-1, where S has the variance of the residual of each column,
    times m/(m - n): columns may differ in their noise (White, Econometrica 48, 1980).
    """
    data, known, values = problem.data, problem.data.known, problem.values(found.x)
    column = np.broadcast_to(np.arange(len(data.names)), known.shape)[known]
    counts = np.bincount(column, minlength=len(data.names))
    squares = np.bincount(column, found.fun**2, len(data.names)) / counts
    m, n = found.jac.shape
    U, s, Vt = np.linalg.svd(found.jac, full_matrices=False)
    determined = s > SINGULAR * max(float(s.max(initial=0.0)), 1e-300)
    A = (Vt[determined].T / s[determined]) @ U[:, determined].T
    covariance = (A * squares[column] * m / (m - n)) @ A.T
    # parameters with a part in directions that the data do not determine get no error
    lost = (np.abs(Vt[~determined]) > 1e-3).any(axis=0) if (~determined).any() else np.zeros(n, bool)
    errors = np.sqrt(np.diag(covariance)) * np.abs(problem.rates(found.x))
    sizes = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(sizes, sizes)
    correlation[lost] = correlation[:, lost] = np.nan
    rows = []
    for k, (b, v) in enumerate(zip(problem.bounds, values, strict=True)):
        rows.append(Fitted(b.path, v, None if lost[k] else float(errors[k]), b.low, b.high, start[k]))
        if lost[k]:
            warnings.append(f"{b.path}: the data do not determine it, or not separately from the others")
        if min(found.x[k], 1.0 - found.x[k]) < AT_BOUND:
            warnings.append(f"{b.path} ends at the bound {v:g}; the data may want it beyond")
    if loaded.case.expected:
        warnings.append("the expected values of the case are those of its own numbers, not of the fitted ones")
    if not found.success:
        warnings.append(f"the search has stopped early: {found.message}")
    model = np.full(data.values.shape, np.nan)
    model[known] = problem.measured + found.fun * problem.scale
    return Fit(loaded.source.file, loaded.case.title, rows, float(np.sqrt(np.mean(found.fun**2))), data, model,
               problem.scales, np.sqrt(squares) * problem.scales, correlation, math.ceil(problem.runs), tried, loaded,
               warnings)


def write_case(loaded: LoadedCase, values: Mapping[str, float], path: str | os.PathLike[str], how: str,
               force: bool = False) -> list[str]:
    """Write a case with other numbers at some paths, keeping the text of its file where possible.

    Its first line says ``how`` they were found. Returns remarks for the user. Raises ResultsError.
    """
    text, kept = text_with(loaded, values, vocabulary())
    lines = [line for line in text.splitlines(keepends=True) if not line.startswith(f"# {MARK}")]
    with replacing(path, force) as private:
        private.write_text(f"# {MARK}: {how}\n" + "".join(lines), encoding="utf-8")
    remarks = [] if kept else [f"'{path}' has the case with its defaults, without comments"]
    if inputs_of(loaded)[1:] and Path(path).absolute().parent != Path(loaded.source.file).absolute().parent:
        remarks.append(f"'{path}' names files that it is read with; they are beside '{loaded.source.file}'")
    return remarks


def write_fit(fit: Fit, path: str | os.PathLike[str], command: str = "", force: bool = False) -> None:
    """Write tables ``fit`` (parameters) and ``fitted`` (data and model) to a result file. Raises ResultsError."""
    labels = fit.loaded.case.units.labels
    columns = [Column(n, "as in the case" if n != "path" else "none", text) for n, text in (
        ("path", "path of the parameter"), ("value", "fitted value"), ("standard_error", "its standard error"),
        ("low", "lower bound"), ("high", "upper bound"), ("start", "where the search began"))]
    table: dict[str, Any] = {fit.data.axis: fit.data.x}
    for k, name in enumerate(fit.data.names):
        quantity = name.removesuffix(".re").removesuffix(".im").rpartition(".")[2]
        units = unit_label(QUANTITY_UNITS.get(quantity, "1"), labels)
        table |= {f"data {name}": fit.data.values[:, k], f"model {name}": fit.model[:, k]}
        columns += [Column(f"data {name}", units, f"{name} as measured"),
                    Column(f"model {name}", units, f"{name} of the fitted case")]
    columns.append(Column("factor", "1", "load factor") if fit.data.axis == "factor" else
                   Column("t", "{T}", "time") if fit.data.axis == "t" else Column("hz", "1/{T}", "frequency"))
    rows = {c.name: [getattr(row, c.name) for row in fit.rows] for c in columns[:6]}
    write_tables(path, result_header(fit.loaded, command), {"fit": (rows, {}), "fitted": (table, {})}, columns,
                 fit.as_json(), force=force)
