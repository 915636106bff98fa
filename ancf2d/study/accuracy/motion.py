"""Motions to a wanted accuracy: time steps are judged on a coarse mesh, the mesh by three meshes.

Errors of time steps hardly depend on the mesh. So the mesh with half the elements predicted from the order of the
element types is also solved with a tenth of the tolerance, and the predicted mesh only once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

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
