"""Steps to a wanted accuracy, for equilibria that depend on the path: with friction, or materials with memory."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from ..order import Estimate
from .judging import relative_distance
from .pursuit import MOST_ELEMENTS, MOST_WORK, Pursuit
from .setting import Level

# of the wanted error: smaller effects of load steps on the goal leave the estimate of meshes valid; and the least error
# assumed of a mesh twice as fine, as a share of the coarser one's
MOVED, FALLS = 0.2, 0.35
# least ratio of the steps of two paths that shows their errors; largest number by which steps are divided to reach it
MORE, MOST = 1.4, 256.0


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
            if fine.answer is None or fine.step_count >= MORE * self.rough.step_count or self.ratio >= MOST:
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
