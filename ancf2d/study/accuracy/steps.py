"""Steps to a wanted accuracy: of motions, and of equilibria that depend on the path (friction, materials with memory).

A motion is solved on the mesh that the order of the element types predicts, and once more with a finer mesh and finer
time steps: their distance shows the error of both. Only if it is too large, or says little, are errors of time steps
and of the mesh told apart, by runs on one mesh and by three meshes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

from ..order import Estimate
from ..variants import Variant
from ..windows import window_of
from .estimates import judge, relative_distance
from .mesh import influence_by_body
from .neighbours import Verdict, verdict_of_two
from .pursuit import LEAST_TOLERANCE, MOST_ELEMENTS, MOST_WORK, Pursuit
from .setting import Level, Setting, meshed

# factors from the difference of two runs to the error of each: a tenth of the tolerance leaves at most a third of it
LOOSE, TIGHT = 1.5, 0.5
# allowance for larger errors of time steps on a finer mesh, and their largest share of the wanted error
FINER, SHARE = 1.5, 0.25
# meshes after the first three; target error and largest refinement of each
MORE, AIM, LEAP = 2, 0.7, 4.0
# quarters of the predicted elements: the mesh, and that of the run that verifies it, with a tenth of its tolerance
WHOLE, BEYOND = 4, 6


@dataclass
class Motion:
    """Search for a motion with some element types, from the mesh with the ``predicted`` elements, multiples of two."""

    pursuit: Pursuit
    types: dict[str, Variant]
    predicted: dict[str, int]
    tolerance: float
    levels: list[Level] = field(default_factory=list)
    time_error: float = math.inf
    method: str | None = None

    def reach(self, wanted: float) -> tuple[Level, float, Estimate] | None:
        """Return a level whose estimated error is below ``wanted``, its error, and the estimate.

        None if five meshes do not reach it.
        """
        goal, pursuit = self.pursuit.loaded.case.goal, self.pursuit
        if not self.predicted or goal is None or pursuit.slides(self._setting(WHOLE)):
            return None
        # by accident two runs may agree in one value, but hardly over a whole course
        if window_of(goal) is None and not pursuit.loaded.case.contacts and not pursuit.ends_within(
                self._setting(WHOLE)):
            level, verdict = self.verified(wanted)
            if verdict is not None and verdict.error <= wanted:
                return level, verdict.error, verdict.estimate
            return self._on_three_meshes(wanted, WHOLE, BEYOND)
        meshes = meshed(pursuit.loaded.case, self.types)
        self.predicted = {name: 4 * meshes[name].count(0.25 * n) for name, n in self.predicted.items()}
        return self._on_three_meshes(wanted, WHOLE // 2, WHOLE)

    def verified(self, wanted: float) -> tuple[Level, Verdict | None]:
        """Return the predicted mesh, and its verdict by one run that is finer in space and time.

        That run leaves at most two thirds of the error.
        """
        pursuit, verdict = self.pursuit, None
        finer = pursuit.sharper(self._setting(BEYOND))

        def estimate_of(level: Level) -> tuple[Estimate, float]:
            nonlocal verdict
            if 4 * level.work <= MOST_WORK and finer.elements <= MOST_ELEMENTS:
                fine = pursuit.solve_aside(finer, "finer in space and time, to verify")
                verdict = verdict_of_two(level, fine, BEYOND / WHOLE)
            if verdict is None:
                return Estimate(None, None, None, False, "no finer run verifies it"), math.inf
            level.estimate = verdict.error
            if verdict.error <= wanted:
                self._find_weights()
            return verdict.estimate, verdict.error

        self.method = finer.method
        return pursuit.solve_as_result(self._setting(WHOLE), "predicted from the order of the element type",
                                       estimate_of), verdict

    def _on_three_meshes(self, wanted: float, second: int, size: int) -> tuple[Level, float, Estimate] | None:
        """Same as ``reach``; the second mesh has some quarters of the predicted elements, the third one ``size``."""
        pursuit = self.pursuit
        if not self._choose_tolerance(wanted, second):
            return None
        for _ in range(1 + MORE):
            setting = self._setting(size)
            if setting.elements > MOST_ELEMENTS or setting.elements * self.levels[-1].iterations > MOST_WORK:
                return None
            level = pursuit.solve(setting, "predicted from the order of the element type" if size == WHOLE else
                                  "predicted from the observed order", self._estimate_of)
            if level.answer is None:
                return None
            found, error = judge([*self.levels, level])
            if error + self.time_error <= wanted:
                pursuit.write(level, self._estimate_of)
                return level, error + self.time_error, found
            self.levels.append(level)
            if found.order is None or found.order <= 0.0:
                return None
            factor = (error / (AIM * (wanted - self.time_error))) ** (1.0 / min(max(found.order, 1.0), 4.0))
            size *= math.ceil(min(max(factor, 2.0), LEAP))
        return None

    def _setting(self, quarters: int) -> Setting:
        counts = {name: n * quarters // WHOLE for name, n in self.predicted.items()}
        return Setting(counts, self.types, self.tolerance, method=self.method)

    def _find_weights(self) -> None:
        """Find the influence of each body's mesh on the goal, on a coarse mesh."""
        if len(self.predicted) > 1 and not self.pursuit.weights:
            meshes = meshed(self.pursuit.loaded.case, self.types)
            coarse = {name: meshes[name].count(0.25 * n) for name, n in self.predicted.items()}
            self.pursuit.weights = influence_by_body(self.pursuit, replace(self._setting(WHOLE), counts=coarse)) or {}

    def _choose_tolerance(self, wanted: float, quarters: int) -> bool:
        """Solve a mesh with several tolerances and choose one, then half of that mesh; return whether one suffices."""
        loose = self.pursuit.solve(self._setting(quarters), "first mesh")
        while (loose.setting.tolerance or 0.0) > LEAST_TOLERANCE and 2 * loose.work <= MOST_WORK:
            tight = self.pursuit.solve(self.pursuit.sharper(loose.setting), "effect of the time steps")
            gap = FINER * relative_distance(loose, tight)
            if not math.isfinite(gap):
                return False
            self._find_weights()
            for level, share in ((loose, LOOSE), (tight, TIGHT)):
                # the run that verified the predicted mesh has the smaller tolerance
                if share * gap <= SHARE * wanted and (quarters < WHOLE or level is tight):
                    assert level.setting.tolerance is not None
                    self.tolerance, self.method = level.setting.tolerance, level.setting.method
                    first = self.pursuit.solve(self._setting(quarters // 2), "half of these elements")
                    self.levels, self.time_error = [first, level], share * gap
                    return first.answer is not None
            loose = tight
        return False

    def _estimate_of(self, level: Level) -> tuple[Estimate, float]:
        found, error = judge([*self.levels, level])
        level.estimate = error if math.isfinite(error) else None
        self.pursuit.report["time_error"] = self.time_error
        return found, error + self.time_error


# of the wanted error: smaller effects of load steps or fibres on the goal leave the estimate of meshes valid; and the
# least error assumed of a mesh twice as fine, as a share of the coarser one's
MOVED, FALLS = 0.2, 0.35
# factors by which halving the steps reduces their effect: of first order; and the slowest, of points that start to
# slip one after another
HALVED, SLOW = 0.5, 2.0 / 3.0
# least ratio of the steps of two paths that shows their errors; largest number by which steps are divided to reach it
APART, MOST = 1.4, 256.0


def in_steps(pursuit: Pursuit, rough: Level, error: float, found: Estimate) -> dict[str, Any]:
    """Solve the chosen mesh with steps half as long, until that hardly changes the goal; return its accuracy.

    If shorter steps change the goal, a mesh twice as fine shows whether the mesh error is still the one found with long
    steps.
    """
    shorter = _ShorterSteps(pursuit, rough, error, found)
    while True:
        fine = shorter.next()
        if fine.answer is None or pursuit.outcome is None:
            pursuit.report.pop("steps_error", None)
            return pursuit.accuracy(shorter.rough, shorter.found, shorter.error) | {
                "achieved": False, "note": f"the error of the steps is unknown: {fine.setting.named_steps} fail"}
        if shorter.finer is not None:
            shorter.begin(shorter.finer)
            continue
        accuracy: dict[str, Any] = pursuit.outcome.summary["accuracy"]
        if accuracy["achieved"] or shorter.error > pursuit.wanted:
            return accuracy
        if 2 * fine.work > MOST_WORK:
            return accuracy | {"note": "the steps needed would take too long"}
        shorter.compare_with(fine)


@dataclass
class _ShorterSteps:
    """Steps half as long as before on one mesh, with its ``error`` and the estimate ``found`` from other meshes.

    ``moved``: the changes of the goal from steps twice as long; ``between``: paths with hardly more steps than the
    ``rough`` one, because the path itself limits its steps; they show nothing. ``known``: the level with this error;
    ``finer``: the mesh that the last level needs, if that is another one.
    """

    pursuit: Pursuit
    rough: Level
    error: float
    found: Estimate
    ratio: float = 1.0
    moved: list[float] = field(default_factory=list)
    between: list[Level] = field(default_factory=list)
    finer: Level | None = None

    def __post_init__(self) -> None:
        self.known = self.rough
        self.begin(self.rough)

    def begin(self, rough: Level) -> None:
        """Start again on another mesh, with steps twice as long for comparison."""
        self.finer = None
        longer = self.pursuit.solve(replace(rough.setting, steps=self._steps(0.5 * self.ratio)), "effect of the steps")
        self.moved = [0.0 if longer.answer is None else relative_distance(longer, rough)]
        self.compare_with(rough)

    def compare_with(self, rough: Level) -> None:
        """Compare shorter steps with these from now on."""
        self.rough, self.between = rough, []
        self.moved.append(0.0)

    def next(self) -> Level:
        """Return the level with steps half as long, or shorter if these are hardly more."""
        while True:
            self.ratio *= 2.0
            fine = self.pursuit.solve_as_result(replace(self.rough.setting, steps=self._steps(self.ratio)),
                                                "effect of the steps", self.estimate_of)
            if fine.answer is None or self._shows(fine):
                return fine
            self.between.append(fine)

    def _shows(self, level: Level) -> bool:
        """Return whether a path has enough steps more than the rough one, or as many as possible."""
        return level.step_count >= APART * self.rough.step_count or self.ratio >= MOST

    def estimate_of(self, level: Level) -> tuple[Estimate, float]:
        """Return the estimate from meshes for a level, and its error with that of the steps."""
        self.moved[-1] = max(relative_distance(level, other) for other in (self.rough, *self.between)
                             if other is not level)
        error = self.pursuit.report["steps_error"] = error_of_steps(self.moved)
        # before the level is written, so that its file lists the check
        if self._shows(level) and self.error <= self.pursuit.wanted:
            self._check_mesh(level)
        return self.found, self.error + error

    def _check_mesh(self, level: Level) -> None:
        """Find a mesh that is fine enough with the steps of a level if these change the goal."""
        if relative_distance(level, self.known) > MOVED * self.pursuit.wanted:
            self.known, self.error = fine_enough(self.pursuit, level, self.error, "longer steps")
            if self.known is not level:
                self.finer = self.known
                self.found = Estimate(None, None, None, False, "meshes differ more with shorter steps")

    def _steps(self, ratio: float) -> dict[str, Any]:
        return self.pursuit.loaded.case.solver.with_steps(ratio)


def error_of_steps(moved: Sequence[float]) -> float:
    """Return the error of the last of several runs, from the changes caused by halving the steps, last one last.

    Changes that fall by a factor q sum up to the last one times q/(1 - q); q is the larger of the last two factors,
    between 1/2, errors of first order, and SLOW. At least half of the change before and a quarter of the one before
    that count as the last, since points that stick or slip alike by accident in two runs hide their difference.
    """
    falls = [b / a if a > 0.0 else SLOW * (b > 0.0) for a, b in pairwise(moved[-3:])]
    q = min(max(HALVED, *falls), SLOW) if falls else HALVED
    return max(HALVED**k * change for k, change in enumerate(moved[:-4:-1])) * q / (1.0 - q)


def fine_enough(pursuit: Pursuit, level: Level, error: float, before: str) -> tuple[Level, float]:
    """Return a level, or a finer mesh with its load steps whose error is small enough, and its error.

    Returns the level itself if a mesh twice as fine differs by no more than its ``error``, and the finest mesh if none
    is good enough. The error of a mesh is its difference from that half as fine, or a share of that one's error if
    larger. ``before`` says in the report with which steps or fibres ``error`` was found.
    """
    coarse, assumed = level, 0.0
    while True:
        counts = {name: 2 * n for name, n in coarse.setting.counts.items()}
        fine = pursuit.solve(replace(coarse.setting, counts=counts), f"whether meshes differ as with {before}")
        moved = relative_distance(fine, coarse)
        if coarse is level and (fine.answer is None or moved <= error):
            return level, error
        if fine.answer is None:
            return coarse, assumed
        coarse, assumed = fine, max(moved, FALLS * assumed)
        work = 4 * fine.work > MOST_WORK or 2 * sum(counts.values()) > MOST_ELEMENTS
        if work or assumed <= (1.0 - MOVED) * pursuit.wanted:
            return fine, assumed
