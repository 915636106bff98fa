"""Records of a run: takes the states of a solver, collects probes and totals, and writes the result file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..case import Case, Static
from ..model.model import Model
from ..solvers.state import Graded
from .windows import Windows

if TYPE_CHECKING:
    from ..results import Checkpoint
    from ..solvers.state import State


@dataclass
class Progress:
    """Callbacks that report the progress of a run.

    ``state`` is called with each state, ``warn`` with each new warning, ``note`` with remarks, ``built`` with the model
    before it is solved, ``compiling`` with a remark when kernels have to be compiled first. ``checks_mesh``: check
    whether the mesh is fine enough, and warn if not; ``checks_zones``: where bodies yield, too.
    """

    state: Callable[[State], None] = lambda state: None
    warn: Callable[[str], None] = lambda text: None
    note: Callable[[str], None] = lambda text: None
    built: Callable[[Model], None] = lambda model: None
    compiling: Callable[[str], None] = lambda text: None
    checks_mesh: bool = True
    checks_zones: bool = True


class Clock:
    """Iterator over the states of a solver that adds up the seconds the solver takes, not those between states."""

    def __init__(self, states: Iterator[State]) -> None:
        self.states, self.seconds = states, 0.0

    def __iter__(self) -> Iterator[State]:
        return self

    def __next__(self) -> State:
        started = time.perf_counter()
        try:
            return next(self.states)
        finally:
            self.seconds += time.perf_counter() - started


def run_end(case: Case) -> float:
    """Return the final time or load factor of a run; infinite for a path, which may pass its final value on the way."""
    return float("inf") if case.solver.on_path else case.solver.end


def joined(probes: dict[str, dict[str, float]], more: dict[str, dict[str, float]], what: str
           ) -> dict[str, dict[str, float]]:
    """Return both dictionaries joined; a name in ``more`` that is also in ``probes`` gets the prefix ``what``."""
    return {**probes, **{name if name not in probes else f"{what} {name}": values for name, values in more.items()}}


class Recorder:
    """Records of a run; with a ``writer``, they are also stored in its result file."""

    def __init__(self, model: Model, writer: Any, progress: Progress, warnings: list[str]) -> None:
        from ..solvers.between_contact_points import ErrorsBetweenPoints
        from ..solvers.fields import FieldReader
        from ..solvers.plastic_zones import PlasticZones
        from ..solvers.resolution import Resolution
        from ..solvers.state_results import Observer

        self.model, self.case, self.writer, self.progress, self.warnings = model, model.case, writer, progress, warnings
        self.observer, self.resolution, self.zones = Observer(model), Resolution(model), PlasticZones(model)
        self.between = ErrorsBetweenPoints(model)
        # a keeper of checkpoints stores nothing else
        self.stores = writer is not None and writer.stores
        self.fields = FieldReader(model) if self.stores else None
        self.end = run_end(self.case)
        self.moves = self.case.solver.moves
        self.state: State | None = None
        self.last_reactions: tuple[State | None, dict[str, dict[str, float]]] = (None, {})
        self.probes: dict[str, dict[str, float]] = {}
        self.totals: dict[str, Any] = {"iterations": 0, "steps": 0}
        self.report: dict[str, Any] = {}
        self.worst: dict[str, Graded] = {}
        self.clock, self.windows = Clock(iter(())), Windows(model)
        # only the last state's probes are reported; earlier ones are for a result file or goals over a window of time
        self.reads_all = self.stores or bool(self.windows.goals)
        # history variables of the elements before the first step
        self.unloaded = model.states.copy() if model.remembers else None

    def record(self, state: State) -> None:
        """Record the next state."""
        if self.stores and self.totals["steps"] == 0 and isinstance(self.case.solver, Static):
            self._reference()
        self.state = state
        if self.reads_all:
            self.probes = self.observer.observe(state)
        self.warn(state.warnings)
        self.report.update(state.report)
        self.between.check(state)
        if self.moves:
            self.windows.record(state, self.probes, self._reactions)
            self._take_motion(state)
        else:
            self._take_equilibrium(state)
        if self.writer is not None and not self.stores:
            self.writer.keep(self._checkpoint(state))
        self.progress.state(state)

    def conclude(self) -> None:
        """Report the worst of the collected warnings, and check the last state as a whole."""
        from ..model.element_limits import coarse_warnings

        self.warn(map(str, self.worst.values()))
        if self.between.checks:
            self.report["contact_error"] = self.between.error
        if self.state is not None and not self.reads_all:
            self.probes = self.observer.observe(self.state)
        if self.state is None or not self.progress.checks_mesh:
            return
        if not self.state.linear:
            self.warn(coarse_warnings(self.model, self.state.d))
        self.warn(self.between.warnings())
        self.warn(self.resolution.warnings(self.state))
        if self.progress.checks_zones:
            self.warn(self.zones.warnings(self.state))

    def store_layers(self) -> None:
        """Store what the points of layers remember of the last equilibrium, for a motion that starts from it."""
        from ..solvers.contact import layer_memory

        if self.stores and self.case.solver.balances and not self.moves:
            for name, rows in layer_memory(self.model).items():
                self.writer.array(name, rows, "1", "history variables of the points of a layer in the last state")

    def warn(self, texts: Iterable[str]) -> None:
        """Report warnings; of those that concern single states, only the worst of each kind at the end."""
        for text in texts:
            if not isinstance(text, Graded):
                self.warnings.append(text)
                self.progress.warn(text)
            elif text.kind not in self.worst or text.size > self.worst[text.kind].size:
                self.worst[text.kind] = text

    def _reference(self) -> None:
        from ..solvers.registry import initial_state

        start = initial_state(self.model)
        start.memory = self.unloaded
        self._store(start, None, self._over_time(start, self.observer.observe(start)))

    def _over_time(self, state: State, probes: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
        """Return the values to store for a state: probes, moving points and obstacles, the goal's reaction."""
        # no name of a probe contains a dot
        places = self.case.places_over_time(state.side)
        probes = {**probes, **places}
        if self.model.frames:
            from ..solvers.contact import obstacle_motions

            probes = joined(probes, obstacle_motions(self.model, state), "obstacle")
        name = self.case.goal.reaction if self.case.goal is not None else None
        return probes if name is None else joined(probes, {name: self._reactions(state)[name]}, "reaction")

    def _reactions(self, state: State) -> dict[str, dict[str, float]]:
        """Return the reactions of a state, computed once."""
        from ..solvers.state_results import reactions

        if self.last_reactions[0] is not state:
            self.last_reactions = state, reactions(self.model, state)
        return self.last_reactions[1]

    def _take_equilibrium(self, state: State) -> None:
        self.totals["iterations"] += int(state.history["iterations"])
        self.totals["steps"] += 1
        self.zones.follow(state)
        if not self.stores:
            return
        self._write_once(state)
        if self.case.output.stores(self.totals["steps"], state.t) or state.t >= self.end or state.last:
            self._store(state, state.history, self._over_time(state, self.probes), checkpoint=self._checkpoint(state))
        else:
            self.writer.log(state.history, t=state.t, probes=self._over_time(state, self.probes))

    def _write_once(self, state: State) -> None:
        for path, (data, units, description) in state.arrays.items():
            self.writer.array(path, data, units, description, up_to_sign=path.startswith("modes/"))
        for name, columns in state.tables.items():
            self.writer.table(name, columns)

    def _take_motion(self, state: State) -> None:
        """Add up the steps since the last state, and store them with this one."""
        self._count(state.blocks)
        if self.progress.checks_mesh:
            self.resolution.check(state)
        if not self.stores:
            return
        self._write_once(state)
        v = None if state.v is None else state.v[:self.model.n_q]
        # controllers are recorded over time, like probes
        series = self._over_time(state, self.probes) | state.controllers
        self._store(state, None, series, v=v, steps=state.blocks, energies=state.history,
                    checkpoint=self._checkpoint(state))

    def _store(self, state: State, history: dict[str, float] | None, probes: dict[str, dict[str, float]],
               **more: Any) -> None:
        from ..solvers.state_results import turns_of

        self.writer.append(state.t, state.d[:self.model.n_q], history, probes, turned=turns_of(self.model, state),
                           fields={} if self.fields is None else self.fields.read(state), **more)

    def _count(self, steps: dict[str, Any]) -> None:
        if not len(steps.get("dt", ())):
            return
        # few steps lie between two states: lists are faster than arrays
        totals, dt = self.totals, steps["dt"].tolist()
        totals["steps"] += len(dt)
        totals["iterations"] += int(sum(steps["iterations"].tolist()))
        totals["rejected"] = totals.get("rejected", 0) + int(sum(steps["rejected"].tolist()))
        totals["dt"] = [pick([*totals.get("dt", dt), *dt]) for pick in (min, max)]

    # ------------------------------------------------------------------ interruptions

    def _checkpoint(self, state: State) -> Checkpoint | None:
        """Return the checkpoint of a state; None at the end of the run, where nothing is left to compute."""
        if state.checkpoint is None or state.last or state.t >= self.end:
            return None
        from ..results import Checkpoint

        notes = {"totals": dict(self.totals), "report": dict(self.report),
                 "warnings": list(self.warnings), "worst": [[w, w.kind, w.size] for w in self.worst.values()],
                 "wall_s": self.clock.seconds, "resolution": self.resolution.checkpoint_data(),
                 "windows": self.windows.checkpoint_data(), "between": self.between.checkpoint_data()}
        return Checkpoint(state.t, state.checkpoint, notes)

    def restore(self, found: Checkpoint) -> None:
        """Restore totals, report, warnings and collected values from a checkpoint."""
        notes = found.notes
        self.totals.update(notes["totals"])
        self.report.update(notes["report"])
        self.warnings[:] = notes["warnings"]
        self.worst = {kind: Graded(text, kind, size) for text, kind, size in notes.get("worst", ())}
        self.clock.seconds = notes["wall_s"]
        self.resolution.restore(notes["resolution"])
        self.windows.restore(notes["windows"])
        self.between.restore(notes["between"])
