"""The coarsest mesh that is fine enough: a ladder of nested meshes, then a jump predicted from the observed order."""

from __future__ import annotations

import math
from dataclasses import replace

from ..goal import sequence
from ..order import Estimate
from ..variants import Variant
from .estimates import best, choose, judge, relative_distance, usable_levels
from .pursuit import LEAST_TOLERANCE, MOST_ELEMENTS, MOST_LEVELS, MOST_WORK, Pursuit
from .setting import Level, Setting, meshed, with_setting

LADDER = 3          # least number of levels; the first is the coarsest mesh
HOPELESS = 256      # times the coarsest mesh: the case is given up if no mesh up to this size can be solved
AIM = 0.7           # of the wanted error: target of a predicted mesh
TRUSTED = (1.0, 6.0)  # range of orders that predictions accept
LEAP, HOP = 32.0, 4.0  # largest refinement at once, and the largest whose order need not be confirmed
STEP = 1.5          # smallest useful refinement
# levels before the elements are redistributed over several bodies, and log2 of the largest ratio of their shares
EVEN, SLIGHT = 4, 3
# of the goal: larger differences of two coarse meshes count as oscillation if the third mesh goes back
SWING = 0.02
# the search is given up after this many meshes in a row without a smaller error, or without any value
STALLED = 4
# of the difference between meshes: if time steps have more effect than this, they are reduced
NOISE = 0.25


class Ladder:
    """Meshes of a case in fixed proportions: ``shares`` of each body, times a size."""

    def __init__(self, pursuit: Pursuit, types: dict[str, Variant], tolerance: float | None) -> None:
        self.pursuit, self.types, self.tolerance = pursuit, types, tolerance
        self.method: str | None = None
        self.meshes = meshed(pursuit.loaded.case, types)
        self.shares = {name: float(mesh.least) for name, mesh in self.meshes.items()}
        self.levels: list[Level] = []

    def setting(self, size: float) -> Setting:
        """Return the setting of the mesh of a size."""
        counts = {name: self.meshes[name].count(share * size) for name, share in self.shares.items()}
        return Setting(counts, self.types, self.tolerance, method=self.method)

    def climb(self, wanted: float) -> tuple[Level | None, float, Estimate]:
        """Refine until the estimated error of a mesh is below ``wanted``.

        Returns that level, or the finest that was solved (None if there is none), its error, and the estimate.
        """
        size, shared, hopeless, failed = 1.0, len(self.shares) < 2, "", 0
        for _ in range(MOST_LEVELS):
            why = "coarse mesh of the series" if len(self.levels) < LADDER else "predicted from the observed order"
            failed = 0 if self._add(size, why) is not None else failed + 1
            if failed and not self.levels and size > HOPELESS:
                break
            if failed >= STALLED and self.levels:
                hopeless = f"{STALLED} finer meshes have no value: {self.pursuit.levels[-1].reason}"
                break
            self._find_weights()
            level, error, found = self._chosen(wanted)
            if self._has_enough_levels() and (error <= wanted or (found.asymptotic and "round-off" in found.note)):
                break
            if self._steps_matter():
                size = max(1.0, size / 4.0)
                continue
            if not shared and len(self.levels) >= EVEN:
                shared = True
                size = self._redistribute(size)
                continue
            size *= self._factor(error / wanted, found)
            hopeless = self._hopeless(size)
            if hopeless:
                break
        level, error, found = self._chosen(wanted) if not hopeless else best(self.levels, wanted)
        return level, error, replace(found, note="; ".join(note for note in (found.note, hopeless) if note))

    def _has_enough_levels(self) -> bool:
        """Return whether there are enough levels for an estimate: three.

        One more is needed if the values oscillate, as with elements that lock, and if zones end within elements: coarse
        meshes may hardly differ if none of their integration points are in the zones that yield.
        """
        levels = usable_levels(self.levels)
        if len(levels) != LADDER:
            return len(levels) > LADDER
        if levels[-1].zones:
            return False
        first, middle, last = sequence([level.answer for level in levels if level.answer is not None])
        swings = (middle - first) * (last - middle) < 0.0
        return not swings or relative_distance(*levels[:2]) <= SWING

    def _hopeless(self, size: float) -> str:
        """Return why a mesh of a size is not worth solving, or an empty text."""
        elements = self.setting(size).elements
        if elements > MOST_ELEMENTS:
            return f"more than {MOST_ELEMENTS} elements would be needed"
        if self.levels and elements * self.levels[-1].iterations > MOST_WORK:
            return f"{elements} elements and about {self.levels[-1].iterations} iterations would be needed"
        recent = [level.estimate or 0.0 for level in self.levels[-STALLED - 1:]]
        if len(self.levels) >= LADDER + STALLED and recent[-1] >= 0.5 * max(recent[:-1]):
            return f"{STALLED} finer meshes have not reduced the error"
        return ""

    def _steps_matter(self) -> bool:
        """Return whether meshes differ because of the time steps; if so, reduce the tolerance, discard all levels."""
        if self.tolerance is None or len(self.levels) <= LADDER or self.tolerance <= LEAST_TOLERANCE:
            return False
        if self.levels[-1].missed_by:
            return False
        middle, last = self.levels[-2:]
        gap = relative_distance(middle, last)
        if gap < 0.5 * relative_distance(self.levels[-3], middle):
            return False
        finer = self.pursuit.solve(self.pursuit.sharper(middle.setting),
                                   "whether the time steps cause the differences between meshes")
        if not relative_distance(middle, finer) > NOISE * gap:
            return False
        self.tolerance, self.method = finer.setting.tolerance, finer.setting.method
        self.levels = []
        return True

    def _chosen(self, wanted: float) -> tuple[Level | None, float, Estimate]:
        """Return the coarsest sufficient level, or the finest if its order is confirmed and it is written already."""
        found, error = judge(self.levels)
        if found.asymptotic and self.tolerance is None and self.levels and self.pursuit.written is self.levels[-1]:
            return self.levels[-1], error, found
        return choose(self.levels, wanted)

    def _redistribute(self, size: float) -> float:
        """Distribute the elements by the influence of the bodies and discard the levels; return the next size."""
        if not self.pursuit.by_adjoint:
            self.pursuit.weights = influence_by_body(self.pursuit, self.setting(size / 2.0)) or self.pursuit.weights
        weights = shares_by_weight(self.pursuit.weights)
        if weights is None or min(weights.values()) == 1.0:
            return 2.0 * size
        self.pursuit.tell("shares of the elements: " + ", ".join(f"{name} {w:g}" for name, w in weights.items()))
        self.shares = {name: share * weights[name] for name, share in self.shares.items()}
        self.levels = []
        return size

    def _find_weights(self) -> None:
        """Find the influence of each body's mesh on the goal, before the first estimate is reported.

        Uses the adjoint on the second mesh if possible, else refines one body of the first mesh after the other.
        """
        pursuit = self.pursuit
        if len(self.levels) != LADDER - 1 or len(self.shares) < 2 or pursuit.weights:
            return
        if pursuit.last is not None and pursuit.last[0] is self.levels[-1]:
            from .weighted import weighted

            found = weighted(with_setting(pursuit.loaded, self.levels[-1].setting), pursuit.last[1])
            if found is not None:
                pursuit.weights, pursuit.by_adjoint = found.bodies, True
                return
        pursuit.weights = influence_by_body(self.pursuit, self.levels[0].setting) or {}

    def _add(self, size: float, why: str) -> Level | None:
        estimate_of = (lambda level: judge([*self.levels, level])) if len(self.levels) >= LADDER - 1 else None
        level = self.pursuit.solve(self.setting(size), why, estimate_of)
        if level.answer is None:
            return None
        if not self.levels or level.setting.elements > self.levels[-1].setting.elements:
            self.levels.append(level)
        _, error = judge(self.levels)
        level.estimate = error if math.isfinite(error) else None
        return level

    def _factor(self, excess: float, found: Estimate) -> float:
        """Return the refinement factor of the next mesh, for an error that is too large by ``excess``.

        It is 2 unless the order is confirmed, and also if meshes start from the state of another one: then the meshes
        in between cost little, and more of them improve the estimate.
        """
        if self.pursuit.starts_from_guess or not found.asymptotic or found.order is None or len(self.levels) <= LADDER:
            return 2.0
        p = min(max(found.order, TRUSTED[0]), TRUSTED[1])
        wanted = (excess / AIM) ** (1.0 / p)
        # a long way takes two leaps, the first of which confirms the order
        factor = wanted if wanted <= HOP else min(wanted / 2.0, LEAP)
        # multiples of one half keep the nodes of the mesh before the last
        return max(STEP, math.ceil(2.0 * factor - 0.25) / 2.0)


def influence_by_body(pursuit: Pursuit, base: Setting) -> dict[str, float] | None:
    """Return how far the goal moves if each body of a mesh alone is refined once, or None if that is unknown."""
    middle = pursuit.solve(base, "starting mesh for refining single bodies")
    if middle.answer is None:
        return None
    moves = {}
    for name in base.counts:
        finer = pursuit.solve(replace(base, counts={**base.counts, name: 2 * base.counts[name]}),
                                     f"effect of the mesh of {name}")
        if finer.answer is None:
            return None
        moves[name] = finer.answer.distance(middle.answer)
    return moves


def shares_by_weight(moves: dict[str, float]) -> dict[str, float] | None:
    """Return the share of each body in the elements, from the goal's change with its mesh, or None if unknown.

    With contributions D n^-p to the error, the fewest elements for an error have n of each body in the proportions
    D^(1/(p + 1)). Shares are powers of two, so that meshes double in proportion.
    """
    most = max(moves.values(), default=0.0)
    if most == 0.0:
        return None
    # the order is not known yet; two is assumed
    return {name: 2.0 ** -(SLIGHT if move == 0.0 else min(SLIGHT, round(math.log2(most / move) / 3.0)))
            for name, move in moves.items()}
