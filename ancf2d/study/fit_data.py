"""Measured columns over time, load factor or frequency, and the corresponding values of a run."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..case import Dynamic, FrequencyResponse, LinearStatic, LoadedCase, QuasiStatic, Static, with_overrides
from ..case.binder import nearest
from ..case.compose import read_text
from ..case.schema.controllers import equations
from ..elements.shape import Array
from ..errors import CaseError, ComputationError, Problem, many, raise_any
from ..model.model import Model
from ..quantities import FORCES, KIND_OF, KINEMATIC, RATE_OF, RATES
from ..solvers.derivatives.differences import UnsuitedError
from ..solvers.derivatives.readings import Term
from .expressions import probes_alike
from .run import vocabulary

# solvers for each name of the first column
ABSCISSAE = {"t": "dynamic or quasi_static", "factor": "static or linear_static", "hz": "frequency_response"}
# share of the last time or load factor below which two of them are equal
NEAR = 1e-9
PARTS = ("re", "im")
# the scale of each kind of quantity, and the power of a length that converts the kind to the units of its scale
SCALES = {"position": ("place", 0), "displacement": ("place", 0), "rotation": ("place", 1), "velocity": ("rate", 0),
          "angular velocity": ("rate", 1), "force": ("force", 0), "moment": ("force", -1)}
# relative to the largest range of its kind: smaller variations are round-off or noise
FAINT = 1e-6


@dataclass(frozen=True)
class Data:
    """Measured values (n, columns) at ``x`` (n,); ``axis`` is t, factor or hz. NaN marks a value not measured."""

    axis: str
    x: Array
    names: tuple[str, ...]
    values: Array
    file: str = ""

    @property
    def known(self) -> Any:
        """Return where values were measured (n, columns)."""
        return np.isfinite(self.values)

    @property
    def interval(self) -> float:
        """The interval of which all x are multiples, or 0 if there is none."""
        gap = _gap(self.x)
        return gap if gap > 0.0 and bool(np.all(np.abs(self.x / gap - np.round(self.x / gap)) < 1e-6)) else 0.0

    def early(self, share: float) -> Data:
        """Return the data up to a share of the places."""
        rows = self.x <= np.quantile(np.repeat(self.x, self.known.sum(axis=1)), share)
        return replace(self, x=self.x[rows], values=self.values[rows])

    def scales(self, extent: float) -> Array:
        """Return the scales of differences in each column (columns,): its range, or its magnitude if it is constant.

        For a column below FAINT, the scale is the largest range of its kind, with rotations and moments compared over
        the ``extent`` [length] of the model; it is 1 if only zeros were measured.
        """
        low, high = np.nanmin(self.values, axis=0), np.nanmax(self.values, axis=0)
        varies = high - low
        size = np.where(varies > 0.0, varies, np.maximum(np.abs(low), np.abs(high)))
        kinds = [self._kind(name) for name in self.names]
        lengths = np.array([extent**power for _, power in kinds])
        largest = np.array([max(r for r, (other, _) in zip(varies * lengths, kinds, strict=True) if other == kind)
                            for kind, _ in kinds]) / lengths
        scales = np.where(size > FAINT * largest, size, largest)
        return np.where(scales > 0.0, scales, 1.0)

    def _kind(self, name: str) -> tuple[str, int]:
        """Return the kind of a column (separately for each input), and its power of a length."""
        source, rest = name.split(".", 1) if self.axis == "hz" else ("", name)
        quantity = (rest.rpartition(".")[0] if self.axis == "hz" else rest).rpartition(".")[2]
        # controllers have units of their own
        kind, power = SCALES.get(KIND_OF.get(quantity, ""), (rest, 0))
        return f"{source} {kind}", power


def read_data(path: str) -> Data:
    """Return the columns of a CSV file as written by ``export``; empty cells mean not measured. Raises CaseError."""
    text = read_text(path, "a CSV file; 'ancf2d export' writes the probes of a result file as one")
    rows = [row for row in csv.reader(io.StringIO(text)) if any(cell.strip() for cell in row)]
    if len(rows) < 2:
        raise CaseError(Problem("the file has no data", file=path, expected="a line of names, then lines of numbers"))
    names, problems = [name.strip() for name in rows[0]], list[Problem]()
    if names[0] not in ABSCISSAE:
        raise CaseError(_misnamed(names, path))
    problems += [Problem(f"there are {n} columns '{name}'", file=path, line=1, column=1, expected="each column once")
                 for name, n in Counter(names).items() if n > 1]
    values = np.full((len(rows) - 1, len(names)), np.nan)
    for k, row in enumerate(rows[1:]):
        if len(row) != len(names):
            problems.append(Problem(f"the line has {many(len(row), 'cell')}", file=path, line=k + 2,
                                    column=1, expected=f"{len(names)}, as the first line has"))
            continue
        for j, cell in enumerate(row):
            try:
                values[k, j] = float(cell) if cell.strip() else np.nan
            except ValueError:
                problems.append(Problem(f"'{cell.strip()}' in column {names[j]} is not a number", file=path,
                                        line=k + 2, column=1))
    raise_any(problems)
    return data_of(dict(zip(names, values.T, strict=True)), path)


def _gap(x: Array) -> float:
    return float(np.median(np.diff(x))) if len(x) > 1 else 0.0


def _misnamed(names: Sequence[str], file: str) -> Problem:
    return Problem(f"the first column is '{names[0][:40]}'" if names else "there is no column", file=file,
                   expected="t, factor or hz" + ", in columns separated by commas" * (";" in "".join(names[:1])))


def data_of(columns: Mapping[str, Any], file: str = "") -> Data:
    """Return named columns as data, sorted by the first one. Raises CaseError with all mistakes."""
    names = list(columns)
    problems: list[Problem] = []
    if not names or names[0] not in ABSCISSAE:
        raise CaseError(_misnamed(names, file))
    table = []
    for name in names:
        try:
            table.append(np.asarray(columns[name], float).ravel())
        except (TypeError, ValueError):
            problems.append(Problem(f"column {name} holds something other than numbers", file=file))
    raise_any(problems)
    if len({len(column) for column in table}) > 1:
        raise CaseError(Problem("the columns are of different lengths", file=file))
    x, values = table[0], np.array(table[1:]).T.reshape(len(table[0]), len(names) - 1)
    if not np.isfinite(x).all():
        problems.append(Problem(f"column {names[0]} has gaps", file=file))
    if len(names) < 2:
        problems.append(Problem("nothing was measured", file=file, expected="columns named PROBE.QUANTITY"))
    for name, column in zip(names[1:], values.T, strict=True):
        if np.isinf(column).any():
            problems.append(Problem(f"column {name} holds an infinite number", file=file,
                                    expected="finite numbers, and nothing or nan where nothing was measured"))
        elif np.isnan(column).all():
            problems.append(Problem(f"column {name} has no value", file=file, expected="at least one"))
    raise_any(problems)
    order = np.argsort(x, kind="stable")
    return Data(names[0], x[order], tuple(names[1:]), values[order], file)


# ---------------------------------------------------------------------------- comparison with a case

def check_data(loaded: LoadedCase, data: Data) -> list[Problem]:
    """Return the reasons why a case cannot be compared with data."""
    solver, problems = loaded.case.solver, []

    def say(message: str, expected: str = "", near: str = "") -> None:
        problems.append(Problem(message, file=data.file, expected=expected, near=near))

    kinds = {"t": (Dynamic, QuasiStatic), "factor": (Static, LinearStatic), "hz": FrequencyResponse}
    if not isinstance(solver, kinds[data.axis]):  # type: ignore[arg-type]
        say(f"the data are over {data.axis}, but the solver of the case is {solver.tag}",
            f"solver {ABSCISSAE[data.axis]}")
        return problems
    if solver.on_path:
        say("the load factor does not tell the states of a path apart", "method: newton")
    elif data.axis != "hz":
        (low, high), end = solver.course, solver.end
        if data.x[0] < low - 1e-9 * abs(end) or data.x[-1] > high + 1e-9 * abs(end):
            say(f"the data range from {data.x[0]:g} to {data.x[-1]:g}, the case from {low:g} to {high:g}")
        elif solver.linear and not np.all(data.x == 1.0):
            say("linear statics has one state, of factor 1", "data at factor 1, or solver static")
    probes = [*loaded.case.output.probes]
    # moving points and controllers, which are recorded over time too
    others = {name: ["s"] for name in loaded.case.moving_points}
    for name, one in loaded.case.controllers.items():
        states = [state.partition(":")[2] for state in equations(name, one).initial]
        others[name] = [*dict.fromkeys(["output", *states])]
    for name in data.names:
        base, part = ([*name.rsplit(".", 1), ""])[:2] if data.axis == "hz" else (name, PARTS[0])
        first, _, rest = base.partition(".") if data.axis == "hz" else ("", "", base)
        probe, _, quantity = rest.rpartition(".")
        if data.axis == "hz" and (part not in PARTS or first not in getattr(solver, "inputs", ())):
            say(f"column '{name}' is not INPUT.PROBE.QUANTITY.re or .im, the real or imaginary part of a response",
                " or ".join(f"{one}.PROBE.QUANTITY.re" for one in getattr(solver, "inputs", ())))
        elif probe in others and probe not in probes:
            if quantity not in others[probe]:
                say(f"column '{name}': {probe} has no {quantity}", ", ".join(others[probe]),
                    nearest(quantity, others[probe]) or "")
        elif not probe:
            say(f"column '{name}' is not PROBE.QUANTITY", ", ".join(f"{one}.QUANTITY" for one in probes))
        elif probe not in probes:
            say(f"column '{name}': the case has no probe '{probe}'", "" if nearest(probe, probes) else
                f"one of {', '.join(probes)}" if probes else "output.probes", nearest(probe, probes) or "")
        elif quantity not in (*KINEMATIC, *FORCES):
            say(f"column '{name}': '{quantity}' is not a quantity of a probe",
                "x, y, ux, uy, theta, vx, vy, omega, N, Q or M")
        elif quantity in RATES and solver.balances:
            say(f"column '{name}': a static state has no {quantity}")
    return problems


def comparable(loaded: LoadedCase, data: Data) -> LoadedCase:
    """Return a case whose run has states, or frequencies, at the measured places, and computes little else.

    Raises CaseError.
    """
    solver, output, more = loaded.case.solver, loaded.case.output, []
    if any(name.rpartition(".")[2] in FORCES for name in data.names):
        # section forces are computed only if a field asks for them
        more.append(f"output.fields=[{', '.join(dict.fromkeys((*output.fields, *FORCES)))}]")
    if isinstance(solver, Dynamic):
        step = data.interval
        taken, left = ("interval", "every") if step else ("every", "interval")
        if getattr(output, left) is not None:
            more.append(f"output.{left}=null")
        more.append(f"output.{taken}={step!r}" if step else "output.every=1")
        more.append(f"solver.t_end={float(min(solver.t_end, max(data.x[-1], _gap(data.x))))!r}")
    elif isinstance(solver, QuasiStatic):
        end = float(min(solver.t_end, data.x[-1])) or solver.t_end
        more += [f"solver.t_end={end!r}", f"solver.times={np.minimum(data.x, end).tolist()}"]
    elif isinstance(solver, Static):
        low, high = solver.course
        more.append(f"solver.factors={np.clip(data.x, low, high).tolist()}")
    elif isinstance(solver, FrequencyResponse):
        keys = {"from": solver.from_, "to": solver.to, "tolerance": solver.tolerance}
        more += [f"solver.{name}=null" for name, value in keys.items() if value is not None]
        more.append(f"solver.frequencies={data.x.tolist()}")
    return with_overrides(loaded, more, vocabulary())


class DataValues:
    """The values at the measured places (measured values,), as a function of a model and the states of its run.

    For a motion, it also provides their derivatives by probe quantities (``readings.Goals``).
    """

    all_states = True
    # derivatives that lead to the minimum, and standard errors, need no more
    negligible = 1e-4

    def __init__(self, data: Data) -> None:
        self.data, self.count = data, int(data.known.sum())

    def __call__(self, model: Model, states: Sequence[Any]) -> Array:
        """Return the values in the order of ``data.values[data.known]``. Raises ComputationError."""
        found = self._responses(states) if self.data.axis == "hz" else self._courses(model, states)
        return found[self.data.known]

    @property
    def from_probes(self) -> bool:
        """Return whether the values follow from positions of probes, and from their rates at stored states."""
        quantities = [name.rpartition(".")[2] for name in self.data.names]
        return self.data.axis == "t" and all(q in RATE_OF or (q in KINEMATIC and self.data.interval > 0.0)
                                             for q in quantities)

    def alike(self, one: Model, other: Model) -> bool:
        """Return whether both models give the same values for the same states."""
        return probes_alike(one, other, {name.rpartition(".")[0] for name in self.data.names})

    def terms(self, model: Model, states: Sequence[Any]) -> list[Term]:
        """Return the derivatives of the values by probe quantities. Raises UnsuitedError for rates between states."""
        t, first = np.unique([state.t for state in states], return_index=True)
        at, x, out = np.argwhere(self.data.known).tolist(), self.data.x, list[Term]()
        near = np.abs(t[:, None] - x).argmin(axis=0)
        between = np.clip(np.searchsorted(t, x, side="right") - 1, 0, max(len(t) - 2, 0))
        exact = not np.abs(t[near] - x).max() > NEAR * t[-1]
        for value, (row, column) in enumerate(at):
            probe, _, quantity = self.data.names[column].rpartition(".")
            if exact:
                out.append((value, int(first[near[row]]), probe, quantity, 1.0))
                continue
            if quantity not in RATE_OF:
                raise UnsuitedError("rates between states follow from all of these")
            # weights of the Hermite cubic between two states
            k = int(between[row])
            h = float(t[k + 1] - t[k])
            s = float(x[row] - t[k]) / h
            ends = ((1 - s)**2 * (1 + 2 * s), h * s * (1 - s)**2), (s * s * (3 - 2 * s), h * s * s * (s - 1))
            for state, (by_place, by_rate) in enumerate(ends, k):
                out += [(value, int(first[state]), probe, quantity, by_place),
                        (value, int(first[state]), probe, RATE_OF[quantity], by_rate)]
        return out

    def _responses(self, states: Sequence[Any]) -> Array:
        response: dict[str, Any] = {}
        for state in states:
            response |= state.report.get("response", {})
        where = np.searchsorted(np.asarray(response["hz"]), self.data.x)
        columns = []
        for name in self.data.names:
            source, rest = name.split(".", 1)
            probe, quantity, part = rest.rsplit(".", 2)
            columns.append(np.asarray(response[source][probe][quantity][part])[where])
        return np.array(columns).T

    def _courses(self, model: Model, states: Sequence[Any]) -> Array:
        from scipy.interpolate import CubicHermiteSpline, make_interp_spline

        from ..solvers.state_results import Observer

        observer = Observer(model)
        places = model.case.places_over_time
        read = [observer.observe(state) | places(state.side) | state.controllers for state in states]
        t = np.array([state.t for state in states])
        t, first = np.unique(t, return_index=True)
        near = np.abs(t[:, None] - self.data.x).argmin(axis=0)
        columns = []
        for name in self.data.names:
            probe, _, quantity = name.rpartition(".")
            if quantity not in read[-1][probe]:
                raise ComputationError(f"the solver does not compute {quantity} of {probe}")
            y = np.array([read[k][probe].get(quantity, np.nan) for k in first])
            rate = RATE_OF.get(quantity, "")
            if not np.abs(t[near] - self.data.x).max() > NEAR * t[-1]:
                columns.append(y[near])
            elif rate in read[-1][probe]:
                slope = np.array([read[k][probe][rate] for k in first])
                columns.append(CubicHermiteSpline(t, y, slope)(self.data.x))
            else:
                columns.append(make_interp_spline(t, y, k=min(3, len(t) - 1))(self.data.x))
        return np.array(columns).T
