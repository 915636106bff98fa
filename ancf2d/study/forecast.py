"""Predicted cost of solutions from measured ones: budgets of studies, and their remaining time."""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Callable, Hashable, Sequence
from functools import partial
from statistics import fmean, median
from typing import TypeVar

from .pool import ALONE, Workers
from .record import Progress

R = TypeVar("R")

# exponents of cost over size: assumed for one measured solution, and the limits for two
USUAL_GROWTH, SLOWEST_GROWTH, FASTEST_GROWTH = 1.3, 0.5, 3.0
# number of elements whose cost equals the part that does not depend on the mesh
OVERHEAD = 100
# least seconds between two estimates, and that pause in multiples of the time of an estimate, which many jobs make long
EVERY, RARELY = 0.1, 300.0
# a job that exceeds its prediction is assumed to need this share of its time so far
OVERDUE = 0.2


class Budget:
    """A number of seconds from its creation, by a clock that never goes back."""

    def __init__(self, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.seconds, self.clock = seconds, clock
        self.began = clock()

    @property
    def spent(self) -> float:
        """Seconds since the creation."""
        return self.clock() - self.began

    def affords(self, predicted: float) -> bool:
        """Return whether a task of ``predicted`` seconds ends in time."""
        return self.spent + predicted < self.seconds


def predicted_cost(sizes: Sequence[float], seconds: Sequence[float], size: float) -> float | None:
    """Return the predicted time [s] of a solution from the last two measured ones; None if there are none.

    Cost grows with a power of size; a power below 1 indicates a constant part plus growth in proportion to size.
    """
    if not sizes:
        return None
    growth, n, t = USUAL_GROWTH, sizes[-1], seconds[-1]
    if len(sizes) > 1 and sizes[-2] != n and min(seconds[-2:]) > 0.0:
        growth = math.log(t / seconds[-2]) / math.log(n / sizes[-2])
    if SLOWEST_GROWTH < growth < 1.0 and len(sizes) > 1:
        return t + (t - seconds[-2]) / (n - sizes[-2]) * (size - n)
    return t * float(size / n) ** min(max(growth, SLOWEST_GROWTH), FASTEST_GROWTH)


# the number of adaptive steps grows with this power of the tolerance
ORDER = 0.2


def steps_of(dt: float | None, tolerance: float | None) -> float:
    """Return a number proportional to the steps of a motion; 1 if neither is given."""
    return 1.0 / dt if dt else tolerance**-ORDER if tolerance else 1.0


# called with the share of a study's time that has passed, and the seconds left (None if not known yet)
Done = Callable[[float, "float | None"], None]


class Forecast:
    """The remaining time of some jobs, which workers start in their order; ``done`` is called with it.

    Each job has a kind and a size: larger jobs of one kind cost more (``predicted_cost``). The clock starts with the
    forecast.
    """

    def __init__(self, jobs: Sequence[tuple[Hashable, float]] = (), workers: Workers = ALONE,
                 done: Done = lambda share, left: None, clock: Callable[[], float] = lambda: time.monotonic()) -> None:
        self.jobs, self.done, self.clock = list(jobs), done, clock
        self.workers, self.processes = workers, max(workers.processes, 1)
        self.origin, self.reported, self.pause = clock(), 0.0, EVERY
        self.began = dict.fromkeys(range(min(self.processes, len(self.jobs))), 0.0)
        self.seconds: dict[int, float] = {}
        self.known: dict[Hashable, dict[float, list[float]]] = {}

    @property
    def spent(self) -> float:
        """Seconds since the creation."""
        return self.clock() - self.origin

    def record(self, i: int, result: object, seconds: float) -> None:
        """Record that job ``i`` ended after so many seconds; the next one starts."""
        now = self.spent
        if not self.seconds:  # processes are ready only now
            self.began = {k: max(began, now - seconds) for k, began in self.began.items()}
        self.seconds[i] = seconds
        self.note(*self.jobs[i], seconds)
        if len(self.began) < len(self.jobs):
            self.began[len(self.began)] = now
        self.tick()

    def tick(self, running: float | None = None) -> None:
        """Report the progress of the jobs; ``running`` [s] is the time that the running job still needs, if known."""
        now, count = self.spent, len(self.seconds) / max(len(self.jobs), 1)
        if 0.0 < count < 1.0 and now - self.reported < self.pause:
            return
        self.reported, left = now, self.left(running)
        self.pause = max(EVERY, RARELY * (self.spent - now))
        self.done(count if left is None else self.spent / max(self.spent + left, 1e-9), left)

    def followed(self, solve: Callable[..., R]) -> Callable[..., R]:
        """Return a function of a job that, in this process, also updates the forecast with the states of its run."""
        if self.workers != ALONE:
            return solve
        return partial(solve, progress=Progress(state=lambda state: self.tick(state.left)))

    def note(self, kind: Hashable, size: float, seconds: float) -> None:
        """Record the time of a job."""
        self.known.setdefault(kind, {}).setdefault(size, []).append(seconds)

    def predicted(self, kind: Hashable, size: float) -> float | None:
        """Return the predicted time [s] of a job, or None if it is not known yet.

        A kind with a single known size is assumed to grow as the others do.
        """
        own, others = self.known.get(kind, {}), [k for name, k in self.known.items() if name != kind and len(k) > 1]
        if len(own) > 1 or (own and not others):
            return _cost(own, size)
        for first, seconds in own.items():
            return median(seconds) * fmean(_cost(k, size) / max(_cost(k, first), 1e-9) for k in others)
        return fmean(_cost(k, size) for k in self.known.values()) if self.known else None

    def left(self, running: float | None = None) -> float | None:
        """Return the seconds until all jobs are done, or None if not known yet; ``running`` as in ``tick``."""
        if self.workers.scheduler is not None:
            return None  # the number of workers there is unknown
        now, free, costs = self.spent, [0.0] * self.processes, {}
        for i, job in enumerate(self.jobs):
            if i in self.seconds:
                continue
            if running is not None and i in self.began:
                heapq.heapreplace(free, running)
                continue
            if job not in costs:
                costs[job] = self.predicted(*job)
            cost = costs[job]
            if cost is None:
                return None
            so_far = now - self.began.get(i, now)
            heapq.heapreplace(free, free[0] + max(cost - so_far, OVERDUE * so_far))
        return max(free)


def _cost(known: dict[float, list[float]], size: float) -> float:
    """Return the predicted time of a job of a size from the seconds of jobs of other sizes."""
    if size in known:
        return median(known[size])
    if len(known) == 1:
        return next(median(seconds) * (size + OVERHEAD) / (n + OVERHEAD) for n, seconds in known.items())
    near = sorted(sorted(known, key=lambda n: abs(math.log(n / size)))[:2])
    found = predicted_cost(near, [median(known[n]) for n in near], size)
    assert found is not None
    return found
