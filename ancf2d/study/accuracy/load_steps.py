"""Steps to a wanted accuracy, where an equilibrium depends on the way to it: where bodies rub or remember."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from ..order import Estimate
from .judging import apart
from .pursuit import MOST_ELEMENTS, MOST_WORK, Pursuit
from .setting import Level

# of the wanted error: load steps that move the goal by no more leave what meshes tell as it is; and the share of an
# error that a mesh twice as fine is taken to have at least
MOVED, FALLS = 0.2, 0.35
# times the steps of a path: fewer tell nothing of shorter ones; and how much shorter they are made before they have to
MORE, MOST = 1.4, 256.0


def in_steps(pursuit: Pursuit, rough: Level, error: float, found: Estimate) -> dict[str, Any]:
    """Solve the mesh that was chosen with steps half as long, until that moves the goal little; return its accuracy.

    Where shorter steps have moved the goal, a mesh twice as fine tells whether the error is still what meshes with long
    ones told.
    """
    shorter = _Shorter(pursuit, rough, error, found)
    known = rough
    while True:
        fine = shorter.next()
        if fine.answer is None:
            pursuit.report.pop("steps_error", None)
            return pursuit.accuracy(shorter.rough, shorter.found, error) | {
                "achieved": False, "note": f"the steps are not judged, as those with {fine.setting.named_steps} fail"}
        accuracy = pursuit.accuracy(fine, *shorter.told(fine))
        if error <= pursuit.wanted and apart(fine, known) > MOVED * pursuit.wanted:
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
        shorter.go_on(fine)


@dataclass
class _Shorter:
    """Steps half as long as before on a mesh of an ``error``, of which meshes tell what they ``found``.

    Errors of steps are of first order: that of the shorter ones is the difference to the ``rough`` ones, twice as long.
    It is no less than half of the one before and a quarter of the one before that, since points that stick or slip by
    chance alike move nothing. ``moved``: these differences; ``between``: steps of a path that are not many more than
    the rough ones, as it asks for steps that are as short, and tell nothing.
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
        """Go on from steps on another mesh: steps twice as long tell of these."""
        longer = self.pursuit.solve(replace(rough.setting, steps=self._steps(0.5 * self.ratio)), "effect of the steps")
        self.moved = [0.0 if longer.answer is None else apart(longer, rough)]
        self.go_on(rough)

    def go_on(self, rough: Level) -> None:
        """Take steps as those that shorter ones are compared with."""
        self.rough, self.between = rough, []
        self.moved.append(0.0)

    def next(self) -> Level:
        """Return the level of steps half as long, or shorter where these are not many more."""
        while True:
            self.ratio *= 2.0
            fine = self.pursuit.whole(replace(self.rough.setting, steps=self._steps(self.ratio)), "effect of the steps",
                                      self.told)
            if fine.answer is None or fine.made >= MORE * self.rough.made or self.ratio >= MOST:
                return fine
            self.between.append(fine)

    def told(self, level: Level) -> tuple[Estimate, float]:
        """Return what is known of a level, and its error."""
        self.moved[-1] = max(apart(level, other) for other in (self.rough, *self.between) if other is not level)
        error = self.pursuit.report["steps_error"] = max(0.5**k * moved for k, moved in enumerate(self.moved[:-4:-1]))
        return self.found, self.error + error

    def _steps(self, ratio: float) -> dict[str, Any]:
        return self.pursuit.loaded.case.solver.with_steps(ratio)


def _refined(pursuit: Pursuit, level: Level, error: float) -> tuple[Level, float]:
    """Return a level, or a finer mesh with its load steps that errs by no more than is wanted, and its error.

    The level itself where a mesh twice as fine differs by no more than its ``error``; the finest where none will do.
    The error of meshes is their difference to those half as fine, or a share of the error of these if that is more.
    """
    coarse, told = level, 0.0
    while True:
        counts = {name: 2 * n for name, n in coarse.setting.counts.items()}
        fine = pursuit.solve(replace(coarse.setting, counts=counts), "whether meshes differ as with longer steps")
        moved = apart(fine, coarse)
        if coarse is level and (fine.answer is None or moved <= error):
            return level, error
        if fine.answer is None:
            return coarse, told
        coarse, told = fine, max(moved, FALLS * told)
        work = 4 * fine.work > MOST_WORK or 2 * sum(counts.values()) > MOST_ELEMENTS
        if work or told <= (1.0 - MOVED) * pursuit.wanted:
            return fine, told
