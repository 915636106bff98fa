"""What the sequence of solved levels tells of the error of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from ..goal import sequence
from ..order import Estimate, estimate, observed_order, round_off_level
from .setting import Level

# orders that errors are estimated by, how much neighbouring ones may differ, and what is added to be safe
LEAST, MOST, ALIKE, SAFETY = 0.5, 8.0, 2.0, 1.75
# what an order that nothing confirms may promise, one that changes sign, and what is added there
UNCONFIRMED, SWINGING, DOUBTFUL = 3.0, 2.0, 2.0
# a mesh that misses so much of the goal says little of the order: what it may promise there
FAR, ROUGH = 0.1, 2.0
# orders by which changes between meshes have fallen since, the last first, where zones end within elements
OF_ZONES = 0.0, 1.5, 2.0
# levels that the best is looked for in, and the share of the last estimate below which an earlier one is better
RECENT, SPOILT = 4, 0.1
# levels without which no order is confirmed
CONFIRMING = 3
# what the last of two orders promises at least, where the one before was none
NONE_BEFORE = 1.0


def apart(level: Level, finest: Level) -> float:
    """Return how far the answers of two solved levels are apart, relative."""
    if level.answer is None or finest.answer is None:
        return math.inf
    return level.answer.distance(finest.answer) / finest.answer.size


def choose(levels: Sequence[Level], wanted: float) -> tuple[Level | None, float, Estimate]:
    """Return the coarsest of solved levels whose error is below the wanted one, its error, and what they tell.

    The error of the finest is estimated from the order, those of the others are their distance to it beside. The
    finest where none will do, None where there are none.
    """
    found, last = judge(levels)
    if not levels:
        return None, last, found
    for level in levels:
        error = max(last + (0.0 if level is levels[-1] else apart(level, levels[-1])), level.off)
        if error <= wanted:
            return level, error, found
    return levels[-1], last, found


def best(levels: Sequence[Level], wanted: float) -> tuple[Level | None, float, Estimate]:
    """Return what ``choose`` does; where none will do, the one of the last few whose estimate is far the smallest.

    Round-off grows with the mesh: the finest may be worse than those before.
    """
    level, last, found = choose(levels, wanted)
    for n in range(len(levels) - 1, max(len(levels) - RECENT, CONFIRMING), -1):
        before, error = judge(levels[:n])
        if last > wanted and error < SPOILT * last:
            return levels[n - 1], error, before
    return level, last, found


def telling(levels: Sequence[Level]) -> Sequence[Level]:
    """Return the last of solved levels, none of which misses an obstacle."""
    return levels[next((n for n in range(len(levels), 0, -1) if levels[n - 1].off), 0):]


def judge(levels: Sequence[Level]) -> tuple[Estimate, float]:
    """Return what solved levels tell, and the estimated error of the last one, relative (infinite without one).

    Meshes that miss an obstacle, as their elements are longer than that, may agree: they say nothing of others.
    """
    found, error = _by_order(telling(levels) or levels)
    off = levels[-1].off if levels else 0.0
    if not off:
        return found, error
    note = "an obstacle is between the contact points of a body"
    return Estimate(None, None, None, False, note), max(off, error) if math.isfinite(error) else off


def _by_order(levels: Sequence[Level]) -> tuple[Estimate, float]:
    """Return what solved levels tell, and the estimated error of the last one, relative (infinite without one).

    Two neighbouring orders are averaged where they agree by and large, and the smaller one is taken where not: meshes
    on the way to an accuracy are seldom asymptotic yet, and orders that still grow promise too much. Of values that
    swing about their limit the differences tell the order.
    """
    answers = [level.answer for level in levels if level.answer is not None]
    n = [float(level.setting.elements) for level in levels if level.answer is not None]
    if not answers:
        return Estimate(None, None, None, False, "no mesh has a value"), math.inf
    if n[-1] == 0.0:
        return Estimate(None, None, None, True, "every body is rigid, so there is no mesh error"), 0.0
    f, size = sequence(answers), answers[-1].size
    # meshes that agree by chance are no round-off: the last ones have to
    if len(f) < 3 or round_off_level(f[-2:], size) is not None or round_off_level(f[-3:], size) == 1:
        found = estimate(n[-3:], f[-3:], size)
        return found, math.inf if found.error_bar is None else found.error_bar / size
    order, before = observed_order(n[-3:], f[-3:]), observed_order(n[-4:-1], f[-4:-1]) if len(f) > 3 else None
    gaps, ratio = (abs(f[-2] - f[-3]), abs(f[-1] - f[-2])), math.log(n[-1] / n[-2])
    if levels[-1].kinks or answers[-1].jumps:
        # an order between two of them says nothing of the next one; what two meshes moved bounds what a third will
        error = DOUBTFUL * max(gaps)
        why = "a point slides along a body, so its kink moves through the elements" if levels[-1].kinks else (
            "a peak may be another one on each mesh")
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
    """Return what ``_by_order`` does of values f on meshes n with zones that yield or touch and end within elements.

    How much of an element such a zone takes is a matter of chance, and so is a small change.
    """
    p = OF_ZONES[1]
    last = [abs(b - a) * (k / n[-1])**order for (a, b), k, order in zip(
        list(pairwise(f))[::-1], n[:0:-1], OF_ZONES, strict=False)]
    error = DOUBTFUL * max(last) / math.expm1(p * math.log(n[-1] / n[-2]))
    return Estimate(f[-1], error, p, False, "zones that yield, bend on a curve or touch end within elements: no order "
                    f"shows, and changes are taken to fall like h^{p:g}"), error / size
