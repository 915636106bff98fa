"""The time that the rest of some work takes, from how fast it went on so far."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Pace:
    """Work done over the seconds that it took. The pace of the latter half of the time holds for the rest.

    Parts of a run that take turns have a pace each; ``running`` counts the seconds of one.
    """

    def __init__(self, work: float = 0.0, clock: Callable[[], float] = time.monotonic) -> None:
        self.seconds, self.clock = 0.0, clock
        self.marks = deque([(0.0, work)])

    @contextmanager
    def running(self) -> Iterator[None]:
        """Count the time of a block."""
        began = self.clock()
        try:
            yield
        finally:
            self.seconds += self.clock() - began

    def mark(self, work: float, seconds: float | None = None) -> None:
        """Note how much work is done in all, after so many seconds (default: those counted)."""
        if seconds is not None:
            self.seconds = seconds
        if self.seconds == self.marks[-1][0]:
            self.marks[-1] = self.seconds, work
        else:
            self.marks.append((self.seconds, work))
        while len(self.marks) > 2 and self.marks[1][0] <= 0.5 * self.seconds:
            self.marks.popleft()

    def left(self, whole: float) -> float | None:
        """Return the seconds [s] until the whole work is done, None where nothing tells yet."""
        (began, first), (now, work) = self.marks[0], self.marks[-1]
        if work >= whole:
            return 0.0
        return None if work <= first else (now - began) * (whole - work) / (work - first)
