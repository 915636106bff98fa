"""Steps to a wanted accuracy: of motions, and of equilibria that depend on the path (friction, materials with memory).

The time steps of a motion are judged on a coarse mesh, its mesh by three meshes. Errors of time steps hardly depend on
the mesh. So the mesh with half the elements predicted from the order of the element types is also solved with a tenth
of the tolerance, and the predicted mesh only once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from ..order import Estimate
from ..variants import Variant
from .judging import judge, relative_distance
from .mesh import influence_by_body
from .pursuit import LEAST_TOLERANCE, MOST_ELEMENTS, MOST_WORK, Pursuit, tenth
from .setting import Level, Setting, meshed

# factors from the difference of two runs to the error of each: a tenth of the tolerance leaves at most a third of it
LOOSE, TIGHT = 1.5, 0.5
# allowance for larger errors of time steps on a finer mesh, and their largest share of the wanted error
FINER, SHARE = 1.5, 0.25
# meshes after the first three; target error and largest refinement of each
MORE, AIM, LEAP = 2, 0.7, 4.0


@dataclass
class Motion:
    """Search for a motion with some element types; its first mesh has a quarter of the ``predicted`` elements."""

    pursuit: Pursuit
    types: dict[str, Variant]
    predicted: dict[str, int]
    tolerance: float
    levels: list[Level] = field(default_factory=list)
    time_error: float = math.inf
    method: str | None = None

    def reach(self, wanted: float) -> tuple[Level, float, Estimate] | None:
        """Return a level whose estimated error is below ``wanted``, its error, and the estimate.

        None if three to five meshes do not reach it.
        """
        pursuit = self.pursuit
        if not self.predicted or pursuit.loaded.case.goal is None or pursuit.slides(self._setting(1)):
            return None
        if not self._choose_tolerance(wanted):
            return None
        size = 4
        for _ in range(1 + MORE):
            setting = self._setting(size)
            if setting.elements > MOST_ELEMENTS or setting.elements * self.levels[-1].iterations > MOST_WORK:
                return None
            level = pursuit.solve(setting, "predicted from the order of the element type" if size == 4 else
                                  "predicted from the observed order", self._estimate_of)
            if level.answer is None:
                return None
            self.levels.append(level)
            found, error = judge(self.levels)
            if error + self.time_error <= wanted and pursuit.written is level:
                pursuit.report["time_error"] = self.time_error
                return level, error + self.time_error, found
            if found.order is None or found.order <= 0.0:
                return None
            factor = (error / (AIM * (wanted - self.time_error))) ** (1.0 / min(max(found.order, 1.0), 4.0))
            size *= math.ceil(min(max(factor, 2.0), LEAP))
        return None

    def _setting(self, size: int) -> Setting:
        meshes = meshed(self.pursuit.loaded.case, self.types)
        counts = {name: size * meshes[name].count(0.25 * n) for name, n in self.predicted.items()}
        return Setting(counts, self.types, self.tolerance, method=self.method)

    def _choose_tolerance(self, wanted: float) -> bool:
        """Solve two coarse meshes, the second with several tolerances, and choose one; return whether one suffices."""
        first = self.pursuit.solve(self._setting(1), "a quarter of the elements that are predicted")
        loose = self.pursuit.solve(self._setting(2), "half of the elements that are predicted")
        while self.tolerance > LEAST_TOLERANCE and 2 * loose.work <= MOST_WORK:
            tight = self.pursuit.solve(self.pursuit.sharper(loose.setting), "effect of the time steps")
            gap = FINER * relative_distance(loose, tight)
            if not math.isfinite(gap) or first.answer is None:
                return False
            if len(self.predicted) > 1 and not self.pursuit.weights:
                self.pursuit.weights = influence_by_body(self.pursuit, first.setting) or {}
            if LOOSE * gap <= SHARE * wanted:
                self.levels, self.time_error = [first, loose], LOOSE * gap
                return True
            self.tolerance, self.method = tenth(self.tolerance), tight.setting.method
            if TIGHT * gap <= SHARE * wanted:
                self.levels, self.time_error = [first, tight], TIGHT * gap
                return True
            loose = tight
        return False

    def _estimate_of(self, level: Level) -> tuple[Estimate, float]:
        found, error = judge([*self.levels, level])
        level.estimate = error if math.isfinite(error) else None
        self.pursuit.report["time_error"] = self.time_error
        return found, error + self.time_error


# of the wanted error: smaller effects of load steps on the goal leave the estimate of meshes valid; and the least error
# assumed of a mesh twice as fine, as a share of the coarser one's
MOVED, FALLS = 0.2, 0.35
# least ratio of the steps of two paths that shows their errors; largest number by which steps are divided to reach it
APART, MOST = 1.4, 256.0


def in_steps(pursuit: Pursuit, rough: Level, error: float, found: Estimate) -> dict[str, Any]:
    """Solve the chosen mesh with steps half as long, until that hardly changes the goal; return its accuracy.

    If shorter steps change the goal, a mesh twice as fine shows whether the mesh error is still the one found with long
    steps.
    """
    shorter = _ShorterSteps(pursuit, rough, error, found)
    known = rough
    while True:
        fine = shorter.next()
        if fine.answer is None:
            pursuit.report.pop("steps_error", None)
            return pursuit.accuracy(shorter.rough, shorter.found, error) | {
                "achieved": False, "note": f"the steps are not judged, as those with {fine.setting.named_steps} fail"}
        accuracy = pursuit.accuracy(fine, *shorter.estimate_of(fine))
        if error <= pursuit.wanted and relative_distance(fine, known) > MOVED * pursuit.wanted:
            finer, error = _refined(pursuit, fine, error)
            known, shorter.error = finer, error
            if finer is not fine:
                shorter.found = Estimate(None, None, None, False, "meshes differ more with shorter steps")
                shorter.begin(finer)
                continue
        if accuracy["achieved"] or error > pursuit.wanted:
            return accuracy
        if 2 * fine.work > MOST_WORK:
            return accuracy | {"note": "the steps needed would take too long"}
        shorter.compare_with(fine)


@dataclass
class _ShorterSteps:
    """Steps half as long as before on one mesh, with its ``error`` and the estimate ``found`` from other meshes.

    Errors of steps are of first order: that of the shorter steps is the difference from the ``rough`` ones, twice as
    long. At least half of the previous difference and a quarter of the one before are assumed, since points that stick
    or slip alike by accident in both runs hide the difference. ``moved``: these differences; ``between``: paths with
    hardly more steps than the rough one, because the path itself limits its steps; they show nothing.
    """

    pursuit: Pursuit
    rough: Level
    error: float
    found: Estimate
    ratio: float = 1.0
    moved: list[float] = field(default_factory=list)
    between: list[Level] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.begin(self.rough)

    def begin(self, rough: Level) -> None:
        """Start again on another mesh, with steps twice as long for comparison."""
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
            if fine.answer is None or fine.step_count >= APART * self.rough.step_count or self.ratio >= MOST:
                return fine
            self.between.append(fine)

    def estimate_of(self, level: Level) -> tuple[Estimate, float]:
        """Return the estimate from meshes for a level, and its error with that of the steps."""
        self.moved[-1] = max(relative_distance(level, other) for other in (self.rough, *self.between)
                             if other is not level)
        error = self.pursuit.report["steps_error"] = max(0.5**k * moved for k, moved in enumerate(self.moved[:-4:-1]))
        return self.found, self.error + error

    def _steps(self, ratio: float) -> dict[str, Any]:
        return self.pursuit.loaded.case.solver.with_steps(ratio)


def _refined(pursuit: Pursuit, level: Level, error: float) -> tuple[Level, float]:
    """Return a level, or a finer mesh with its load steps whose error is small enough, and its error.

    Returns the level itself if a mesh twice as fine differs by no more than its ``error``, and the finest mesh if none
    is good enough. The error of a mesh is its difference from that half as fine, or a share of that one's error if
    larger.
    """
    coarse, assumed = level, 0.0
    while True:
        counts = {name: 2 * n for name, n in coarse.setting.counts.items()}
        fine = pursuit.solve(replace(coarse.setting, counts=counts), "whether meshes differ as with longer steps")
        moved = relative_distance(fine, coarse)
        if coarse is level and (fine.answer is None or moved <= error):
            return level, error
        if fine.answer is None:
            return coarse, assumed
        coarse, assumed = fine, max(moved, FALLS * assumed)
        work = 4 * fine.work > MOST_WORK or 2 * sum(counts.values()) > MOST_ELEMENTS
        if work or assumed <= (1.0 - MOVED) * pursuit.wanted:
            return fine, assumed
