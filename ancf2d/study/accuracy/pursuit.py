"""Levels solved on the way to a wanted accuracy, and the sequence of meshes that estimates the error of the last."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ...case import LoadedCase
from ...errors import Ancf2dError, CaseError, ComputationError
from ..answer import Answer, File, sequence, solve_for_goal
from ..order import Estimate, estimate, observed_order, round_off_level
from ..record import Progress
from ..run import Outcome
from .setting import Level, Setting, with_setting

# of all bodies, on the way to an accuracy
MOST_ELEMENTS = 200_000
MOST_LEVELS = 30
# orders that errors are estimated by, how much neighbouring ones may differ, and what is added to be safe
LEAST, MOST, ALIKE, SAFETY = 0.5, 8.0, 2.5, 1.5


@dataclass
class Target:
    """The result file that the last level is written to."""

    out: str
    force: bool = False
    command: str = ""


@dataclass
class Pursuit:
    """A case, the relative accuracy that is wanted, and all levels solved so far, in their order.

    ``apart``: the share of the error that meshes do not tell of (steps in time, model).
    """

    loaded: LoadedCase
    wanted: float
    progress: Progress
    target: Target | None = None
    tell: Callable[[str], None] = lambda text: None
    levels: list[Level] = field(default_factory=list)
    known: dict[Any, Level] = field(default_factory=dict)
    apart: float = 0.0
    report: dict[str, Any] = field(default_factory=dict)
    outcome: Outcome | None = None
    written: Level | None = None

    def solve(self, setting: Setting, why: str, before: Sequence[Level] | None = None) -> Level:
        """Return the level of a setting, solved unless it is known.

        ``before``: the meshes that it ends a sequence of, if it may be the last: it is written. Raises CaseError for
        a case that cannot be.
        """
        name = (tuple(setting.counts.items()), tuple(setting.types.items()), setting.tolerance)
        if name not in self.known:
            self.tell(f"{setting.elements} elements" + (
                "" if setting.tolerance is None else f", tolerance {setting.tolerance:.1g}") + f": {why}")
            level = self.known[name] = Level(setting, why)
            self.levels.append(level)
            self._run(level, before)
        return self.known[name]

    def write(self, level: Level, before: Sequence[Level]) -> None:
        """Make a level the result, solved again only where it was not written."""
        if self.written is not level:
            self._run(level, before)

    def _run(self, level: Level, before: Sequence[Level] | None) -> None:
        keeps = before is not None
        quiet = replace(self.progress, warn=lambda text: None, note=lambda text: None)

        def conclude(summary: dict[str, Any], answer: Answer) -> None:
            level.answer, level.wall_s = answer, summary["wall_s"] + level.wall_s
            summary["accuracy"] = self.accuracy([*(before or ()), level])

        file = None if self.target is None or not keeps else File(
            self.target.out, self.target.force, self.target.command, conclude)
        try:
            found = solve_for_goal(with_setting(self.loaded, level.setting), quiet, file)
        except ComputationError as error:
            level.reason = error.failure.reason
            return
        except MemoryError:
            level.reason = "there is not enough memory for this mesh"
            return
        level.answer, level.dofs = found.answer, found.model.n_q
        if file is None:
            level.wall_s += found.summary["wall_s"]
        if keeps:
            self.outcome, self.written = found.outcome, level

    def accuracy(self, levels: Sequence[Level]) -> dict[str, Any]:
        """Return ``accuracy`` of the summary for a sequence of meshes that ends with the result."""
        found, error = judge(levels)
        last, total = levels[-1], error + self.apart
        return {"value": None if last.answer is None else last.answer.value,
                "estimate": total if math.isfinite(total) else None, "wanted": self.wanted,
                "achieved": bool(total <= self.wanted), "order": found.order, "elements": dict(last.setting.counts),
                "tolerance": last.setting.tolerance, "note": found.note, "solves": len(self.levels),
                "wall_s": self.wall_s, **self.report, "path": [level.as_json() for level in self.levels]}

    def refuses(self, setting: Setting) -> Ancf2dError | None:
        """Return why the case cannot be built with a setting, None where it can."""
        from ..run import prepare

        try:
            prepare(with_setting(self.loaded, setting))
        except CaseError as error:
            return error
        return None

    @property
    def wall_s(self) -> float:
        """Seconds of all solves."""
        return sum(level.wall_s for level in self.levels)


def judge(levels: Sequence[Level]) -> tuple[Estimate, float]:
    """Return what solved levels tell, and the estimated error of the last one, relative (infinite without one).

    Two neighbouring orders are averaged where they agree by and large, and the smaller one is taken where not: meshes
    on the way to an accuracy are seldom asymptotic yet, and orders that still grow promise too much.
    """
    answers = [level.answer for level in levels if level.answer is not None]
    n = [float(level.setting.elements) for level in levels if level.answer is not None]
    if not answers:
        return Estimate(None, None, None, False, "no mesh has a value"), math.inf
    f, size = sequence(answers), answers[-1].size
    found = estimate(n, f, size)
    order = None if len(f) < 3 or round_off_level(f, size) is not None else observed_order(n[-3:], f[-3:])
    if order is None or order <= LEAST:
        bar = found.error_bar
        return found, math.inf if bar is None else bar / size
    before = observed_order(n[-4:-1], f[-4:-1]) if len(f) > 3 else None
    alike = before is not None and order / ALIKE < before < order * ALIKE
    trusted = order if before is None else 0.5 * (order + before) if alike else min(order, max(before, LEAST))
    step = (f[-1] - f[-2]) / math.expm1(min(trusted, MOST) * math.log(n[-1] / n[-2]))
    note = "" if alike else "the order is not confirmed"
    return Estimate(f[-1] + step, SAFETY * abs(step), trusted, alike, note), SAFETY * abs(step) / size
