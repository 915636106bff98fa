"""Results of solving a case: the summary, and all states as arrays."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable, Sequence
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from ..case import LoadedCase
from ..errors import ComputationError, ResultsError
from ..plot.body import magnified, visible_scale
from ..results import Results, Table, open_results
from ..results.notebooks import html_table
from ..study.convergence import Convergence as StudyConvergence
from ..study.run import Outcome, describe_goal, quantity
from ..study.sensitivity import sensitivity

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

WIDTH, HEIGHT, MARGIN = 480.0, 240.0, 12.0
# least extent of the picture, to avoid division by zero for bodies without height or width [length]
SMALLEST = 1e-300
# greatest number of points along all bodies, to limit the size of the page
MOST_POINTS = 4000
REFERENCE, NOW = "#999999", "#1f5fa8"
# the argument that functions of paths expect
PATHS = "paths, such as ['bodies.beam.section.height']"


def raise_type_error(what: str, expected: str, given: Any) -> NoReturn:
    """Raise the TypeError for a wrong argument."""
    raise TypeError(f"{what}: expected {expected}, got {given!r}"[:300])


def texts_of(given: Any, what: str, expected: str, single: bool = True) -> tuple[str, ...]:
    """Return a tuple of texts, empty for None; ``single`` allows one plain string. Raises TypeError for others."""
    if given is None:
        return ()
    if isinstance(given, str) and single:
        return (given,)
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise_type_error(what, expected, given)
    found = tuple(given)
    if not all(isinstance(text, str) for text in found):
        raise_type_error(what, expected, given)
    return found


def as_html(report: str, before: list[np.ndarray], after: list[np.ndarray]) -> str:
    """Return a solution as HTML: the axes of its bodies (n, 2) before and after, if there are any, and its report.
    """
    picture = _picture(before, after) if before else ""
    # without wrapping, columns stay aligned in a narrow window
    return f'{picture}<pre style="white-space: pre; overflow-x: auto">{escape(report)}</pre>'


def _picture(before: list[np.ndarray], after: list[np.ndarray]) -> str:
    """Return the axes of all bodies in the reference and the last state as SVG; small displacements are magnified."""
    extent = float(np.hypot(*np.ptp(np.concatenate(before), axis=0)))
    factor = visible_scale(extent, max(float(np.hypot(*(b - a).T).max()) for a, b in zip(before, after, strict=True)))
    after = [a + factor * (b - a) for a, b in zip(before, after, strict=True)]
    lines = [*((line, REFERENCE) for line in before), *((line, NOW) for line in after)]
    step = max(1, sum(len(points) for points, _ in lines) // MOST_POINTS)
    points = np.concatenate([line for line, _ in lines])
    if not np.isfinite(points).all():
        return ""
    low, high = points.min(0), points.max(0)
    scale = float(np.min((np.array([WIDTH, HEIGHT]) - 2 * MARGIN) / np.maximum(high - low, SMALLEST)))
    size = (high - low) * scale + 2 * MARGIN
    drawn = "".join(_line(np.append(line[:-1:step], line[-1:], 0), colour, low, scale, size[1])
                    for line, colour in lines)
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]:.0f}" height="{size[1]:.0f}" '
            f'role="img">{drawn}</svg>' + (f"<p>{magnified(factor).lstrip(', ')}</p>" if factor != 1.0 else ""))


def _line(points: np.ndarray, colour: str, low: np.ndarray, scale: float, height: float) -> str:
    x, y = ((points - low) * scale + MARGIN).T
    text = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, height - y, strict=True))
    dashes = ' stroke-dasharray="5 4"' if colour == REFERENCE else ""
    return f'<polyline points="{text}" fill="none" stroke="{colour}" stroke-width="2"{dashes}/>'


Array = np.ndarray


class Temporary:
    """A folder for a result file that was not requested; it is removed together with the results read from it."""

    def __init__(self) -> None:
        self.folder = tempfile.mkdtemp(prefix="ancf2d-")
        self.file = Path(self.folder, "solution.h5")

    def remove(self) -> None:
        """Remove the folder and its contents."""
        shutil.rmtree(self.folder, ignore_errors=True)


class Solution:
    """A solved case: its summary, its states and, if one was written, its result file.

    Nodal coordinates have the order of ``results``; state i of ``t``, ``d``, ``e``, ``v`` is state i of the result
    file: in statics the reference and the load steps, in motion the stored times. Arrays are read when they are first
    used, which raises ResultsError if no states were kept.
    """

    def __init__(self, case: LoadedCase, outcome: Outcome, temporary: Temporary | None = None) -> None:
        self.case, self.model = case, outcome.model
        self.failure: ComputationError | None = outcome.failure
        place = outcome.summary["output"]
        self._results = None if place is None else open_results(place)
        # an output file that was not requested is not shown
        self.summary: dict[str, Any] = {**outcome.summary, "output": None} if temporary is not None else outcome.summary
        if temporary is not None:
            if self._results is None:
                temporary.remove()
            else:
                self._results.called = f"the solution of {case.source.file}"
                # the results may outlive the solution
                self._results.release(temporary.remove)

    # ------------------------------------------------------------------ what was found

    @property
    def status(self) -> str:
        """``converged``, or ``failed`` for a solution made with ``partial``."""
        return str(self.summary["status"])

    @property
    def title(self) -> str:
        """Title of the case."""
        return str(self.summary["title"])

    @property
    def probes(self) -> dict[str, dict[str, float]]:
        """The last values of all probes: ``probes["tip"]["uy"]``."""
        found: dict[str, dict[str, float]] = self.summary["probes"]
        return found

    @property
    def reactions(self) -> dict[str, dict[str, float]]:
        """The last reactions of all supports: ``reactions["wall"]["fy"]``."""
        found: dict[str, dict[str, float]] = self.summary.get("reactions", {})
        return found

    @property
    def checks(self) -> list[dict[str, Any]]:
        """The expected values of the case, each with the computed value."""
        found: list[dict[str, Any]] = self.summary["checks"]
        return found

    @property
    def warnings(self) -> list[str]:
        """The warnings of the run."""
        return list(self.summary["warnings"])

    @property
    def accuracy(self) -> dict[str, Any] | None:
        """The reached accuracy, if one was requested: ``estimate``, ``achieved``, ``path``, ...; else None."""
        return self.summary.get("accuracy")

    @property
    def value(self) -> float | None:
        """The value of the case's goal, or None if it has no goal."""
        goal = self.case.case.goal
        return None if goal is None else quantity(goal, self.summary)

    def gradient(self, paths: str | Sequence[str]) -> Array:
        """Return the derivatives (n,) of the goal with respect to the numbers at some paths, by ``sensitivity``.

        This plain function of paths suits optimisers and automatic differentiation frameworks. Raises CaseError
        and ComputationError.
        """
        asked = texts_of(paths, "paths", PATHS)
        slopes = {row.path: row.derivative for row in sensitivity(self.case, asked).rows} if asked else {}
        return np.array([slopes[path] for path in asked])

    # ------------------------------------------------------------------ states

    @property
    def path(self) -> Path | None:
        """The result file, or None if none was written."""
        place = self.summary["output"]
        return None if place is None else Path(place)

    @property
    def has_states(self) -> bool:
        """Whether any states were kept."""
        return self._results is not None and self._results.nt > 0

    @property
    def results(self) -> Results:
        """Everything that was stored, as from ``ancf2d.open_results``. Raises ResultsError if nothing was stored."""
        if self._results is None:
            raise ResultsError("this solution kept no states; solve with states=True or with an output file")
        return self._results

    @property
    def t(self) -> Array:
        """Load factor or time of each state (nt,)."""
        return self.results.t

    @property
    def e0(self) -> Array:
        """Reference nodal coordinates (nq,)."""
        return self.results.e0

    @cached_property
    def d(self) -> Array:
        """Displacements of the nodal coordinates (nt, nq)."""
        return self.results.rows("d")

    @property
    def e(self) -> Array:
        """Nodal coordinates (nt, nq)."""
        return self.e0 + self.d

    @cached_property
    def v(self) -> Array:
        """Rates of the nodal coordinates (nt, nq) of a motion. Raises ResultsError for other cases."""
        return self.results.rows("v")

    @property
    def course(self) -> dict[str, Table]:
        """Probe quantities along ``course_t``: at every step, or in a motion in every stored state.

        ``course["tip"]["uy"]`` is an array.
        """
        return self.results.probes

    @property
    def course_t(self) -> Array:
        """Load factor or time of the values in ``course``."""
        return self.results.probe_t

    @property
    def energies(self) -> Table:
        """Energies of a motion by name, arrays along ``t``."""
        return self.results.energies

    @property
    def tables(self) -> dict[str, Table]:
        """Further tables by name, such as those of limit points."""
        return self.results.tables

    @property
    def arrays(self) -> dict[str, Array]:
        """Further arrays by name, such as the shapes of modes."""
        return {name: self.results.array(name) for name in self.results.arrays}

    def axis(self, body: str, state: int | None = -1) -> Array:
        """Return the axis of a body as a line of points (n, 2) [length] in a state (None: the reference)."""
        axis = self.results.faces(body, state)["axis"]
        return np.concatenate([axis[:, :-1].reshape(-1, 2), axis[-1, -1:]])

    def plot(self, kind: str | None = None, **options: Any) -> Figure:
        """Return a Matplotlib figure, the same as ``ancf2d plot`` draws; ``options`` are those of the kind.

        Raises ResultsError if the kind is unknown or the solution lacks the data for it.
        """
        from ..plot import draw
        from ..study.fields_of_states import StatesWithFields

        with StatesWithFields(self.results.path) as results:
            results.called = self.results.called
            return draw(results, kind, **options)

    def to_xarray(self, states: bool = True) -> Dataset:
        """Return probes, states, energies, modes and fields as an xarray data set; see ``Results.to_xarray``.

        Raises ImportError if xarray is not installed, ResultsError if no states were kept.
        """
        return self.results.to_xarray(states)

    # ------------------------------------------------------------------ shown

    def __repr__(self) -> str:
        goal, value = self.case.case.goal, self.value
        found = "" if goal is None or value is None else f", {describe_goal(goal)} = {value:.8g}"
        title = f" {self.title!r}" if self.title else ""
        return f"<Solution{title}: {self.status}, {self.summary['solver']}, {self.summary['elements']} elements{found}>"

    def __str__(self) -> str:
        """Return the text that ``ancf2d run`` prints."""
        from ..cli.report import run_report

        if self.failure is not None:
            return self.failure.text()
        return run_report(self.summary, self.case.case.units, self.model.extent)

    def _repr_html_(self) -> str:
        """Return the solution as shown in notebooks: the text of ``ancf2d run``, and a picture of the bodies."""
        names = list(self.results.bodies) if self.has_states else []
        return as_html(str(self), [self.axis(name, None) for name in names], [self.axis(name) for name in names])


class Convergence(StudyConvergence):
    """A finished convergence study: ``rows`` of all types, ``series`` with the limit of each."""

    def __repr__(self) -> str:
        title = f" {self.title!r}" if self.title else ""
        found = [f"{s.element} {s.estimate.value:.8g}" for s in self.series if s.estimate.value is not None]
        limits = f", limit of {', '.join(found)}" if found else ""
        return f"<Convergence{title}: {self.goal}, {len(self.rows)} rows{limits}>"

    def __str__(self) -> str:
        """Return the text that ``ancf2d convergence`` prints."""
        from ..cli.convergence import report

        return report(self)

    def _repr_html_(self) -> str:
        """Return the table of the study, and a line on the limit of each type, as HTML."""
        from ..cli.convergence import limits, row_cells

        head, *rows = row_cells(self)
        return f"<b>{escape(self.title)}</b>" * bool(self.title) + html_table(rows, head) + "".join(
            f"<p>{escape(line)}</p>" for line in limits(self))
