"""What is best of several settings that each have a cost and an error: the Pareto front, and the cheapest one."""

from __future__ import annotations

import math
from collections.abc import Sequence


def pareto(cost: Sequence[float], error: Sequence[float]) -> list[bool]:
    """Return of each point whether no other one beats it: has no more of both, and less of one.

    Points that are not finite are never on the front, nor do they beat any.
    """
    front, best = [False] * len(cost), (math.inf, math.inf)
    known = [i for i in range(len(cost)) if math.isfinite(cost[i]) and math.isfinite(error[i])]
    for i in sorted(known, key=lambda i: (cost[i], error[i])):
        if error[i] < best[1] or (cost[i], error[i]) == best:
            front[i], best = True, (cost[i], error[i])
    return front


def cheapest(cost: Sequence[float], error: Sequence[float], wanted: float) -> int | None:
    """Return the number of the cheapest point with an error of at most ``wanted``, None where there is none."""
    good = [i for i in range(len(cost)) if math.isfinite(cost[i]) and error[i] <= wanted]
    return min(good, key=lambda i: (cost[i], error[i])) if good else None
