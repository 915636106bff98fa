"""One measured solution of a case: its answer, and its cost in time and memory."""

from __future__ import annotations

import os
import time
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

from ...case import Body, Dynamic, LoadedCase, load_case_text
from ...case.emit import flow, written
from ...errors import UNSOLVED, ComputationError, verdict
from ...solvers.motion.integrators import DEFAULT
from ...solvers.registry import solve
from ..goal import GoalValue, Solved, for_study, solve_for_goal
from ..pool import DIED
from ..record import Clock, Progress
from ..run import prepare, vocabulary
from ..variants import Variant, element_data, flexible, nested_base, stretches_of
from ..warmup import kernels_of, warm_up

# solves are repeated until they took SHORT [s] together, or MANY times
SHORT, MANY = 0.02, 9
_WARM: set[str] = set()  # the kernels that this process has loaded


@dataclass(frozen=True)
class Setting:
    """Choices for a case other than its mesh; those that are None or empty are left as in the case.

    ``key`` names the quantity that gives a motion's steps, dt [s] or tolerance, and ``step`` is its value.
    """

    variant: Variant
    quadrature: Any = None
    method: str | None = None
    key: str = ""
    step: float | None = None

    @property
    def chosen(self) -> dict[str, Any]:
        """The choices other than type and mesh."""
        out = {} if self.quadrature is None else {"quadrature": self.quadrature}
        if self.key:
            out.update({"method": self.method, self.key: self.step})
        return out

    def overrides(self, loaded: LoadedCase, counts: dict[str, int]) -> tuple[str, ...]:
        """Return the ``PATH=VALUE`` overrides of this setting, with the given number of elements of each body."""
        out, lengths = [], stretches_of(loaded.case)
        for name, body in flexible(loaded.case).items():
            data = self.element(body, counts[name], nested_base(counts[name], len(lengths[name])))
            out.append(f"bodies.{name}.element={flow(_plain(data))}")
        return (*out, *self._steps(loaded))

    def element(self, body: Body, count: int, base: int) -> dict[str, Any]:
        """Return the ``element`` of a body, in case format, with ``count`` elements refined from ``base`` ones."""
        data = element_data(body, self.variant, count, base)
        return data if self.quadrature is None else {**data, "quadrature": self.quadrature}

    def _steps(self, loaded: LoadedCase) -> list[str]:
        solver = loaded.case.solver
        if not isinstance(solver, Dynamic):
            return []
        method = self.method or solver.method
        other = (method or DEFAULT) != (solver.method or DEFAULT)
        if other or (self.key and getattr(solver, self.key) is None):
            # an override cannot remove a key of the case, so the whole solver is replaced
            changed: dict[str, Any] = {"method": method}
            if self.key:
                changed.update({"dt": None, "tolerance": None, self.key: self.step})
            if other:
                changed["spectral_radius"] = None
            return [f"solver={flow(written(replace(solver, **changed)))}"]
        return [f"solver.{self.key}={flow(self.step)}"] if self.key else []


def _plain(data: dict[str, Any]) -> dict[str, Any]:
    return {k: list(v) if isinstance(v, tuple) else v for k, v in data.items()}


@dataclass(frozen=True)
class Task:
    """Everything that another process needs to solve and measure one setting.

    ``chosen`` overrides are added to those of the case; ``element`` is the name of the type; ``repeat``: number of
    timed runs, 0 if only the answer is wanted, fewer when ``patience`` [s] is exceeded; ``interval`` [time] of the
    stored states of a motion that gives none.
    """

    text: str
    file: str
    overrides: tuple[str, ...]
    setting: Setting
    chosen: tuple[str, ...]
    element: str
    elements: int
    repeat: int = 0
    patience: float = 0.0
    interval: float | None = None

    def cost(self, once: float) -> float:
        """Return the time [s] of all runs of the task, if one run takes ``once``."""
        return once * (1 + min(self.repeat, max(1, int(self.patience / max(once, 1e-9)))))

    def load(self) -> LoadedCase:
        """Return the case with this setting. Raises CaseError."""
        loaded = load_case_text(self.text, self.file, (*self.overrides, *self.chosen), vocabulary(),
                                os.path.dirname(self.file))
        output = loaded.case.output
        if self.interval is None or output.interval is not None:
            return loaded
        return replace(loaded, case=replace(loaded.case, output=replace(output, interval=self.interval, every=None)))


@dataclass
class Measured:
    """The result of solving a task.

    ``wall_s``: median time of ``runs`` solves, without reading, building and compiling; ``memory`` [bytes]: peak memory
    of Python and numpy for model and solution; ``elapsed``: total time; ``status``: converged, failed, or refused if
    the case does not allow this setting.
    """

    task: Task
    element: str
    formulation: str
    elements: int
    dofs: int | None = None
    answer: GoalValue | None = None
    wall_s: float | None = None
    runs: int = 0
    memory: int | None = None
    elapsed: float = 0.0
    status: str = "converged"
    reason: str = ""


def lost(task: Task) -> Measured:
    """Return the result of a task whose process died."""
    return Measured(task, task.element, task.setting.variant.formulation or "", task.elements, status="failed",
                    reason=DIED)


def measure(task: Task) -> Measured:
    """Solve a task; failures are reported in the result."""
    out, began = replace(lost(task), status="converged", reason=""), time.perf_counter()
    try:
        _measure(task, out)
    except UNSOLVED as error:
        out.status, out.reason = verdict(error)
    out.elapsed = time.perf_counter() - began
    return out


def make_ready(task: Task, compiling: Callable[[str], None] = lambda text: None) -> None:
    """Compile, or load, the kernels of a task, and run one solve with them.

    Raises CaseError for a setting that the case does not allow.
    """
    loaded = task.load()
    model = prepare(loaded)
    kernels = kernels_of(loaded.data)
    if kernels not in _WARM:
        warm_up(model, compiling)
        # loads libraries that only a whole solve calls; a failure will be reported by the measured run
        with suppress(ComputationError):
            solve_for_goal(loaded)
        _WARM.add(kernels)


def _measure(task: Task, out: Measured) -> None:
    make_ready(task)
    if task.repeat == 0:
        _note(solve_for_goal(task.load()), out)
        return
    found, out.memory = _traced(task.load())
    _note(found, out)
    model = prepare(for_study(task.load()))
    times: list[float] = []
    while _again(times, task):
        clock = Clock(solve(model))
        for _ in clock:
            pass
        times.append(clock.seconds)
    out.wall_s, out.runs = median(times), len(times)


def _again(times: list[float], task: Task) -> bool:
    """Return whether to measure once more: as often as asked for, more often if short, less often if long."""
    if not times or (len(times) < MANY and sum(times) < SHORT):
        return True
    return len(times) < task.repeat and sum(times) + times[-1] < task.patience


def _traced(loaded: LoadedCase) -> tuple[Solved, int]:
    """Solve, and return the peak memory [bytes] from the model on; tracing it takes additional time."""
    tracemalloc.start()
    try:
        found = solve_for_goal(loaded, Progress(built=lambda model: tracemalloc.reset_peak()))
        return found, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def _note(found: Solved, out: Measured) -> None:
    out.element, out.formulation = found.types
    out.elements, out.dofs, out.answer = found.model.n_elements, found.model.n_q, found.answer
