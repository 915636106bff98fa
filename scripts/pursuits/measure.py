"""A case pursued to several accuracies: true errors, estimates, costs."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ancf2d.errors import Ancf2dError
from ancf2d.study.accuracy.control import solve_to_accuracy
from ancf2d.study.accuracy.setting import Setting, meshed, with_setting
from ancf2d.study.accuracy.weighted import weighted
from ancf2d.study.goal import solve_for_goal

from .cases import Study
from .limits import Limit, Solver

WANTED = (1e-2, 1e-3, 1e-4)
# truths below are round-off: no estimate has to be close to them
ROUND_OFF = 1e-10


@dataclass
class Row:
    """One pursuit; ``truth`` and ``estimate`` relative; costs over those of the cheapest setting; or why it failed."""

    name: str
    wanted: float
    truth: float = float("nan")
    limit_error: float = float("nan")
    estimate: float = float("nan")
    elements: int = 0
    cheapest: int = 0
    solves: int = 0
    work: float = float("nan")
    time: float = float("nan")
    note: str = ""
    path: tuple[Any, ...] = ()
    guesses: bool = False

    @property
    def reached(self) -> bool:
        """Whether the true error is within the wanted one."""
        return self.truth <= self.wanted

    @property
    def ratio(self) -> float:
        """Estimate over truth."""
        return self.estimate / max(self.truth, 1e-300)

    @property
    def covered(self) -> bool:
        """Whether the estimate is between the truth and ten times it, or the truth is round-off."""
        return self.truth < ROUND_OFF or 1.0 <= self.ratio <= 10.0


def measure(study: Study, folder: Path | None) -> list[Row]:
    """Return a row for each wanted accuracy; solves of the limit and of the cheapest settings are kept in ``folder``.

    They are named by the text of the case and its overrides.
    """
    loaded = study.loaded()
    name = hashlib.sha256(repr((loaded.text, study.sets)).encode()).hexdigest()[:16]
    solver = Solver(loaded, None if folder is None else folder / name)
    limit = solver.limit()
    rows = [_pursued(study.name, replace(loaded, case=replace(loaded.case, accuracy=wanted)), wanted, solver, limit)
            for wanted in WANTED]
    solver.keep()
    return rows


def _pursued(name: str, loaded: Any, wanted: float, solver: Solver, limit: Limit) -> Row:
    row = Row(name, wanted, limit_error=limit.error)
    try:
        found = solve_to_accuracy(loaded)
    except Ancf2dError as error:
        row.note = str(error)
        return row
    accuracy = found.accuracy
    level = solver.again(accuracy)
    if level.answer is None:
        row.note = level.reason
        return row
    row.truth = limit.truth(level.answer)
    row.estimate = float("inf") if accuracy["estimate"] is None else accuracy["estimate"]
    row.elements, row.solves, row.note = level.setting.elements, accuracy["solves"], accuracy["note"]
    row.path = tuple(accuracy["path"])
    cheapest = solver.cheapest(limit, wanted)
    if cheapest is not None:
        row.cheapest = cheapest.setting.elements
        row.work = sum(p["elements"] * max(p["iterations"], 1) for p in row.path) / cheapest.work
        row.guesses = loaded.case.solver.takes_guess
        alone = replace(loaded, case=replace(loaded.case, accuracy=None))
        row.time = (_seconds(lambda: solve_to_accuracy(loaded))
                    / _seconds(lambda: solve_for_goal(with_setting(alone, cheapest.setting))))
    return row


def _seconds(do: Callable[[], Any]) -> float:
    """Return the processor time of the faster of two runs."""
    found = []
    for _ in range(2):
        began = time.process_time()
        do()
        found.append(time.process_time() - began)
    return min(found)


def effectivities(study: Study, sizes: tuple[int, ...]) -> list[float | None] | None:
    """Return what the adjoint tells over what a mesh twice as fine changes, on so many times the least mesh.

    None where a case is none of statics, or where the adjoint is not believed.
    """
    loaded = study.loaded()
    loaded = replace(loaded, case=replace(loaded.case, accuracy=None))
    if not (loaded.case.solver.linear or loaded.case.solver.takes_guess):
        return None
    out: list[float | None] = []
    for size in sizes:
        counts = {name: size * mesh.least for name, mesh in meshed(loaded.case, {}).items()}
        coarse = with_setting(loaded, Setting(counts))
        solved = solve_for_goal(coarse)
        finer = solve_for_goal(with_setting(loaded, Setting({name: 2 * n for name, n in counts.items()})))
        found = weighted(coarse, solved)
        out.append(None if found is None else found.adjoint / finer.answer.gap(solved.answer))
    return out
