"""Error estimates from the sequence of solved levels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from ..goal import sequence
from ..order import Estimate, estimate, observed_order, round_off_level
from .setting import Level

# range of orders used for estimates, largest ratio of two neighbouring orders that agree, and the safety factor
LEAST, MOST, ALIKE, SAFETY = 0.5, 8.0, 2.0, 1.75
# largest order used if it is unconfirmed, or if values oscillate, and the safety factor there
UNCONFIRMED, SWINGING, DOUBTFUL = 3.0, 2.0, 2.0
# of the goal: if coarser meshes differ by more, the order is unreliable and at most ROUGH is used
FAR, ROUGH = 0.1, 2.0
# orders by which changes between meshes are assumed to have decreased since (last first), if zones end within elements
OF_ZONES = 0.0, 1.5, 2.0
# levels among which the best is sought, and the share of the last estimate below which an earlier level is better
RECENT, SPOILT = 4, 0.1
# levels without which no order is confirmed
CONFIRMING = 3
# least value used for the order before the last one, if these disagree
NONE_BEFORE = 1.0


def relative_distance(level: Level, finest: Level) -> float:
    """Return the relative distance between the answers of two solved levels."""
    if level.answer is None or finest.answer is None:
        return math.inf
    return level.answer.distance(finest.answer) / finest.answer.size


def choose(levels: Sequence[Level], wanted: float) -> tuple[Level | None, float, Estimate]:
    """Return the coarsest solved level with an error below ``wanted``, its error, and the estimate.

    The error of the finest level is estimated from the order; those of the others also include their distance to it.
    Returns the finest level if none suffices, or None if there are no levels.
    """
    found, last = judge(levels)
    if not levels:
        return None, last, found
    for level in levels:
        error = max(last + (0.0 if level is levels[-1] else relative_distance(level, levels[-1])), level.missed_by)
        if error <= wanted:
            return level, error, found
    return levels[-1], last, found


def best(levels: Sequence[Level], wanted: float) -> tuple[Level | None, float, Estimate]:
    """Return the result of ``choose``; if no level suffices, an earlier level if its estimate is far smaller.

    Round-off grows with the mesh: the finest may be worse than those before.
    """
    level, last, found = choose(levels, wanted)
    for n in range(len(levels) - 1, max(len(levels) - RECENT, CONFIRMING), -1):
        before, error = judge(levels[:n])
        if last > wanted and error < SPOILT * last:
            return levels[n - 1], error, before
    return level, last, found


def usable_levels(levels: Sequence[Level]) -> Sequence[Level]:
    """Return the levels after the last one that misses an obstacle."""
    return levels[next((n for n in range(len(levels), 0, -1) if levels[n - 1].missed_by), 0):]


def judge(levels: Sequence[Level]) -> tuple[Estimate, float]:
    """Return the estimate from solved levels, and the relative error of the last one (infinite if unknown).

    Meshes whose contact points miss an obstacle may agree by accident: they do not count in the estimate of others.
    """
    found, error = _by_order(usable_levels(levels) or levels)
    missed_by = levels[-1].missed_by if levels else 0.0
    if not missed_by:
        return found, error
    note = "an obstacle is between the contact points of a body"
    return Estimate(None, None, None, False, note), max(missed_by, error) if math.isfinite(error) else missed_by


def _by_order(levels: Sequence[Level]) -> tuple[Estimate, float]:
    """Return the estimate from solved levels, and the relative error of the last one (infinite if unknown).

    Two neighbouring orders are averaged if they roughly agree, else the smaller one is used: meshes on the way to an
    accuracy are seldom asymptotic yet, and growing orders are too optimistic. For values that oscillate about their
    limit, the order follows from the decrease of the differences.
    """
    answers = [level.answer for level in levels if level.answer is not None]
    n = [float(level.setting.elements) for level in levels if level.answer is not None]
    if not answers:
        return Estimate(None, None, None, False, "no mesh has a value"), math.inf
    if n[-1] == 0.0:
        return Estimate(None, None, None, True, "every body is rigid, so there is no mesh error"), 0.0
    f, size = sequence(answers), answers[-1].size
    # agreement is round-off only if the last meshes show it; others may agree by accident
    if len(f) < 3 or round_off_level(f[-2:], size) is not None or round_off_level(f[-3:], size) == 1:
        found = estimate(n[-3:], f[-3:], size)
        return found, math.inf if found.error_bar is None else found.error_bar / size
    order, before = observed_order(n[-3:], f[-3:]), observed_order(n[-4:-1], f[-4:-1]) if len(f) > 3 else None
    gaps, ratio = (abs(f[-2] - f[-3]), abs(f[-1] - f[-2])), math.log(n[-1] / n[-2])
    if levels[-1].kinks or answers[-1].jumps:
        # an observed order says nothing about the next mesh; the last changes bound the next one
        error = DOUBTFUL * max(gaps)
        why = "a point slides along a body, so its kink moves through the elements" if levels[-1].kinks else (
            "the peak may differ between meshes")
        return Estimate(f[-1], error, None, False, f"{why}: no order"), error / size
    if levels[-1].zones:
        return _of_zones(n, f, size)
    if (order is not None and order <= LEAST) or gaps[1] >= gaps[0]:
        error = 3.0 * max(gaps)
        return Estimate(None, error, order, False, "not asymptotic: the differences do not decrease"), error / size
    if order is None:
        trusted = min(max(math.log(gaps[0] / gaps[1]) / ratio, 1.0), SWINGING)
        error = DOUBTFUL * gaps[1] / math.expm1(trusted * ratio)
        return Estimate(f[-1], error, None, False, "the values oscillate about their limit"), error / size
    alike = before is not None and order / ALIKE < before < order * ALIKE
    if alike:
        assert before is not None
        trusted, safety = min(0.5 * (order + before), order, MOST), SAFETY
    else:
        most = ROUGH if gaps[0] > FAR * size else UNCONFIRMED
        trusted = min(order, most, order if before is None else max(before, NONE_BEFORE))
        safety = DOUBTFUL
    step = (f[-1] - f[-2]) / math.expm1(trusted * ratio)
    note = "" if alike else "the order is not confirmed"
    return Estimate(f[-1] + step, safety * abs(step), trusted, alike, note), safety * abs(step) / size


def _of_zones(n: Sequence[float], f: Sequence[float], size: float) -> tuple[Estimate, float]:
    """Same as ``_by_order`` for values f on meshes n with zones of yield or contact that end within elements.

    The fraction of an element that such a zone covers varies at random between meshes, so a small change proves little.
    """
    p = OF_ZONES[1]
    last = [abs(b - a) * (k / n[-1])**order for (a, b), k, order in zip(
        list(pairwise(f))[::-1], n[:0:-1], OF_ZONES, strict=False)]
    error = DOUBTFUL * max(last) / math.expm1(p * math.log(n[-1] / n[-2]))
    return Estimate(f[-1], error, p, False, "zones of yield, nonlinear curves or contact end within elements: no order "
                    f"can be observed, and changes are assumed to fall like h^{p:g}"), error / size
