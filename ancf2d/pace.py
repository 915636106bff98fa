"""Estimate of the remaining time of some work from its pace."""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

# largest number of stored marks
MARKS = 400
# number of intermediate marks for the steps between two marks
WITHIN = 16
# the estimated end is shown once it has varied by at most the factor ALIKE over the last share STEADY of the time spent
STEADY, ALIKE = 0.5, 1.5
# an estimate is stored when the time spent has grown by this factor since the last one
NEXT = 1.02


class Pace:
    """Amount of work done as a function of the seconds spent on it.

    The remaining time is extrapolated from the second half of the work done. With ``eases``: if this half took less
    than twice as long as the quarter before it, as with growing steps, the same ratio is assumed for each further
    doubling of the work; if it took more, the work is assumed to go on at its present rate. Parts of a run that
    alternate have a ``Pace`` each; ``running`` counts the seconds of one.
    """

    def __init__(self, work: float = 0.0, eases: bool = True) -> None:
        self.seconds, self.eases = 0.0, eases
        self.at, self.work = [0.0], [work]

    @contextmanager
    def running(self) -> Iterator[None]:
        """Add the duration of the block to the seconds spent."""
        began = time.monotonic()
        try:
            yield
        finally:
            self.seconds += time.monotonic() - began

    def mark(self, work: float, seconds: float | None = None, within: Sequence[float] = ()) -> None:
        """Store the total amount of work done after the given seconds (default: those counted by ``running``).

        ``within`` are amounts between the last mark and this one, equally spaced in time.
        """
        if seconds is not None:
            self.seconds = seconds
        if self.seconds == self.at[-1]:
            self.work[-1] = work
            return
        began, first, count = self.at[-1], self.work[-1], len(within)
        for k in range(0, count, max(1, count // WITHIN)):
            if self.work[-1] < within[k] < work:
                self.at.append(began + (self.seconds - began) * (k + 1) / (count + 1))
                self.work.append(float(within[k]))
        self.at.append(self.seconds)
        self.work.append(max(work, first))
        if len(self.at) > MARKS:
            self._thin(4.0 * (self.work[-1] - self.work[0]) / MARKS)

    def left(self, whole: float) -> float | None:
        """Return the estimated seconds [s] until the whole work is done, or None if there is no estimate yet."""
        start, done, now = self.work[0], self.work[-1] - self.work[0], self.at[-1]
        if self.work[-1] >= whole:
            return 0.0
        half = now - self._seconds(start + 0.5 * done) if done > 0.0 else 0.0
        if half <= 0.0:
            return None
        quarter = now - half - self._seconds(start + 0.25 * done)
        ratio = min(max(half / quarter, 1.0), 2.0) if self.eases and quarter > 0.0 else 2.0
        doublings = math.log2((whole - start) / done)
        if ratio - 1.0 < 1e-3:
            return half * doublings
        return half * ratio * (ratio**doublings - 1.0) / (ratio - 1.0)

    def _thin(self, least: float) -> None:
        """Keep only marks at least this amount of work apart, and the one just before each."""
        kept, last = [0], self.work[0]
        for k in range(1, len(self.work) - 1):
            if max(self.work[k], self.work[k + 1]) - last >= least:
                kept.append(k)
                last = max(last, self.work[k] if self.work[k] - last >= least else last)
        kept.append(len(self.work) - 1)
        self.at, self.work = [self.at[k] for k in kept], [self.work[k] for k in kept]

    def _seconds(self, work: float) -> float:
        """Return the time [s] at which this amount of work was done."""
        k = min(max(bisect_left(self.work, work), 1), len(self.work) - 1)
        (a, b), (s, t) = self.work[k - 1:k + 1], self.at[k - 1:k + 1]
        return s + (t - s) * min(max((work - a) / (b - a), 0.0), 1.0) if b > a else t


class SteadyEstimate:
    """Filter that passes on the remaining time once the estimated total time has been nearly constant for a while."""

    def __init__(self) -> None:
        self.totals: list[tuple[float, float]] = []
        self.settled = False  # estimates have been collected for long enough

    def __call__(self, spent: float, left: float | None) -> float | None:
        """Return the remaining time [s] after ``spent`` seconds, or None if it is unknown or still varies."""
        if left is None:
            return None
        whole = spent + left
        if not self.totals or spent >= NEXT * self.totals[-1][0]:
            self.totals.append((spent, whole))
        old, self.totals = self.totals[0][0], [one for one in self.totals if one[0] >= STEADY * spent]
        wholes = [whole, *(one for _, one in self.totals)]
        self.settled = self.settled or old < STEADY * spent
        return left if self.settled and max(wholes) <= ALIKE * min(wholes) else None
