"""The coarsest mesh that is fine enough: a ladder of nested meshes, then a jump to where its order says."""

from __future__ import annotations

import math
from dataclasses import replace

from ...case import Case
from ..variants import Variant
from .pursuit import MOST_ELEMENTS, MOST_LEVELS, Pursuit, judge
from .setting import Level, Setting, bodies_with_meshes, least

LADDER = (2, 4, 8)  # times the least mesh
AIM = 0.7           # of the wanted error, when a mesh is predicted
TRUSTED = (1.0, 6.0)  # orders that predictions believe
LEAP, HOP = 64.0, 4.0  # largest refinement at once, with and without an order to trust
STEP = 1.5          # smallest refinement that says anything


class Ladder:
    """Meshes of a case in fixed proportions: ``shares`` of each body, times a size."""

    def __init__(self, pursuit: Pursuit, types: dict[str, Variant], tolerance: float | None,
                 shares: dict[str, float] | None = None) -> None:
        self.pursuit, self.types, self.tolerance = pursuit, types, tolerance
        bodies = bodies_with_meshes(pursuit.loaded.case, types)
        self.shares = shares or {name: float(least(body)) for name, body in bodies.items()}
        self.least = {name: least(body) for name, body in bodies.items()}
        self.levels: list[Level] = []

    def setting(self, size: float) -> Setting:
        """Return the mesh of a size."""
        counts = {name: max(self.least[name], math.ceil(share * size - 1e-9)) for name, share in self.shares.items()}
        return Setting(counts, self.types, self.tolerance)

    def climb(self, wanted: float) -> tuple[Level | None, float, str]:
        """Refine until the estimated error is below ``wanted``.

        Returns the last level that was solved (None where none was), its estimate, and what to say of it.
        """
        size, error, note = 0.0, math.inf, ""
        for size in LADDER:
            if self._add(size, "coarse mesh of the ladder") is None:
                continue
            found, error = judge(self.levels)
            if error <= wanted and len(self.levels) > 2:
                return self.levels[-1], error, found.note
        for _ in range(MOST_LEVELS):
            found, error = judge(self.levels)
            note = found.note
            if error <= wanted and len(self.levels) > 2:
                return self.levels[-1], error, note
            if "round-off" in note and found.asymptotic:
                return self.levels[-1], error, f"{note}: finer meshes do not help"
            size *= self._factor(error / wanted, found.order)
            if self.setting(size).elements > MOST_ELEMENTS:
                note = f"{note + '; ' if note else ''}more than {MOST_ELEMENTS} elements would be needed"
                break
            if self._add(size, "predicted by the order seen") is None and len(self.levels) == 0 and size > 256:
                break
        return (self.levels[-1] if self.levels else None), error, note

    def _add(self, size: float, why: str) -> Level | None:
        before = self.levels if len(self.levels) > 2 else None
        level = self.pursuit.solve(self.setting(size), why, before)
        if level.answer is None:
            return None
        if not self.levels or level.setting.elements > self.levels[-1].setting.elements:
            self.levels.append(level)
        _, error = judge(self.levels)
        level.estimate = error if math.isfinite(error) else None
        return level

    @staticmethod
    def _factor(excess: float, order: float | None) -> float:
        """Return how much finer the next mesh is, for an error that is too large by ``excess``."""
        if not math.isfinite(excess):
            return 2.0
        p = min(max(order if order is not None else 2.0, TRUSTED[0]), TRUSTED[1])
        wanted = (max(excess, 1.0) / AIM) ** (1.0 / p)
        if order is None:
            return min(max(wanted, STEP), HOP)
        # a long way is gone in two leaps, the first of which confirms the order
        return max(wanted, STEP) if wanted <= HOP else min(wanted / 2.0, LEAP)


def shares_by_weight(pursuit: Pursuit, types: dict[str, Variant], tolerance: float | None) -> dict[str, float] | None:
    """Return the share of each body in the elements, by how much the goal depends on its mesh; None where even.

    Each body alone is refined once. With contributions D n^-p to the error, the least number of elements for an error
    has n of each body in the proportions D^(1/(p + 1)).
    """
    ladder = Ladder(pursuit, types, tolerance)
    if len(ladder.shares) < 2:
        return None
    base = ladder.setting(LADDER[1])
    middle = pursuit.solve(base, "mesh that the bodies are refined from")
    if middle.answer is None:
        return None
    moves = {}
    for name in ladder.shares:
        finer = pursuit.solve(replace(base, counts={**base.counts, name: 2 * base.counts[name]}),
                              f"how much the mesh of {name} matters")
        if finer.answer is None:
            return None
        moves[name] = finer.answer.distance(middle.answer)
    most = max(moves.values())
    if most == 0.0:
        return None
    # the order is not known yet: two; a body that matters not at all keeps a sixteenth
    weights = {name: max((move / most) ** (1.0 / 3.0), 1.0 / 16.0) for name, move in moves.items()}
    return {name: ladder.shares[name] * weight for name, weight in weights.items()}


def count_text(case: Case, counts: dict[str, int]) -> str:
    """Return '12 rod, 4 crank' for several bodies, '12' for one."""
    return ", ".join(f"{n} {name}" for name, n in counts.items()) if len(counts) > 1 else str(sum(counts.values()))
