"""A time that a study keeps to: what is left of it, and what the next solution will take."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

# exponents of cost over size: what is assumed of one solution, and what two may tell
USUAL_GROWTH, SLOWEST_GROWTH, FASTEST_GROWTH = 1.3, 0.5, 3.0


class Budget:
    """So many seconds from now on, by a clock that only goes forward."""

    def __init__(self, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.seconds, self.clock = seconds, clock
        self.began = clock()

    @property
    def spent(self) -> float:
        """Seconds since the beginning."""
        return self.clock() - self.began

    def affords(self, predicted: float) -> bool:
        """Whether something that takes ``predicted`` seconds ends in time."""
        return self.spent + predicted < self.seconds


def predicted_cost(sizes: Sequence[float], seconds: Sequence[float], size: float) -> float | None:
    """Return what a solution of a size will take after the last two that were measured, growing by a power of size.

    None where nothing was measured.
    """
    if not sizes:
        return None
    growth = USUAL_GROWTH
    if len(sizes) > 1 and sizes[-1] != sizes[-2] and min(seconds[-2:]) > 0.0:
        found = math.log(seconds[-1] / seconds[-2]) / math.log(sizes[-1] / sizes[-2])
        growth = min(max(found, SLOWEST_GROWTH), FASTEST_GROWTH)
    return seconds[-1] * float(size / sizes[-1]) ** growth
