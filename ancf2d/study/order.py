"""Observed orders, extrapolated values and their error bars from a sequence of meshes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

# differences below this share of the values' scale are round-off (or residuals of iterations)
ROUND_OFF = 1e-10
# differences below this share that no longer decrease are round-off too
SUSPECT = 1e-7
ASSUMED_ORDER = 2.0  # assumed for two meshes, and largest order trusted outside the asymptotic range
LEAST_ORDER, LEAST_UNCONFIRMED = 0.5, 1.0  # lower orders are signs of meshes that are too coarse
CONFIRMED, DOUBTFUL = 1.25, 3.0  # safety factors of the grid convergence index


@dataclass(frozen=True)
class Estimate:
    """Limit estimated from a sequence of meshes.

    ``value`` and ``error_bar`` are None if the sequence has no visible limit, ``order`` if it is undefined; ``note``
    gives the reason in words and is empty if all is well.
    """

    value: float | None
    error_bar: float | None
    order: float | None
    asymptotic: bool
    note: str = ""


def observed_order(n: Sequence[float], f: Sequence[float]) -> float | None:
    """Return p of f(n) = f* + C n^-p through three levels n[0] < n[1] < n[2] with any ratios.

    Solves (f0 - f1)/(f1 - f2) = ((n1/n0)^p - 1)/(1 - (n1/n2)^p), whose right-hand side grows with p. None if the
    differences change sign or vanish, or no p in [-20, 60] fits. p <= 0 means that they grow. Source: Celik et al., J.
    Fluids Eng. 130 (2008) 078001.
    """
    first, second = f[0] - f[1], f[1] - f[2]
    if first * second <= 0.0 or not math.isfinite(first * second):
        return None
    a, b = math.log(n[1] / n[0]), math.log(n[2] / n[1])
    target = math.log(first / second)

    def gap(p: float) -> float:
        if abs(p) < 1e-12:
            return math.log(a / b) - target
        # log of expm1(a p)/(-expm1(-b p)), without overflow
        above = a * p + math.log(-math.expm1(-a * p)) if p > 0 else math.log(-math.expm1(a * p))
        below = math.log(-math.expm1(-b * p)) if p > 0 else -b * p + math.log(-math.expm1(b * p))
        return above - below - target

    low, high = -20.0, 60.0
    if gap(low) > 0.0 or gap(high) < 0.0:
        return None
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gap(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)


def order_from_errors(n: Sequence[float], errors: Sequence[float]) -> float | None:
    """Return the order between two levels with known errors, or None if one of them vanishes."""
    if not (errors[0] > 0.0 and errors[1] > 0.0):
        return None
    return math.log(errors[0] / errors[1]) / math.log(n[1] / n[0])


def round_off_level(f: Sequence[float], scale: float) -> int | None:
    """Return the first level that agrees with the next one to round-off, or None if there is none.

    Differences are judged relative to ``scale`` > 0.
    """
    gaps = [abs(b - a) / scale for a, b in pairwise(f)]
    for k, gap in enumerate(gaps):
        if gap <= ROUND_OFF or (k > 0 and SUSPECT > gap >= 0.9 * gaps[k - 1]):
            return k
    return None


def estimate(n: Sequence[float], f: Sequence[float], scale: float) -> Estimate:
    """Return limit, error bar and order of a sequence of values f on meshes n[0] < n[1] < ...

    Round-off is judged relative to ``scale`` > 0. The error bar is the grid convergence index: 1.25 times the
    extrapolated step in the asymptotic range, 3 times outside. Source: Roache, J. Fluids Eng. 116 (1994) 405.
    """
    if not f:
        return Estimate(None, None, None, False, "no mesh has a value")
    if len(f) == 1:
        return Estimate(f[0], None, None, False, "only one mesh: no estimate")
    k = round_off_level(f, scale)
    if k is not None:
        return _settled(n, f, k, scale)
    if len(f) == 2:
        value, bar = _extrapolate(n, f, ASSUMED_ORDER, DOUBTFUL)
        return Estimate(value, bar, None, False, f"only two meshes: order {ASSUMED_ORDER:g} is assumed")
    return _limit(n, f)


def _settled(n: Sequence[float], f: Sequence[float], k: int, scale: float) -> Estimate:
    order = observed_order(n[k - 2:k + 1], f[k - 2:k + 1]) if k >= 2 else None
    bar = max(abs(v - f[k + 1]) for v in f[k:])
    note = "converged to round-off" + (": order undefined" if order is None else "")
    return Estimate(f[k + 1], max(bar, 2.0**-52 * scale), order, True, note)


def _limit(n: Sequence[float], f: Sequence[float]) -> Estimate:
    p = observed_order(n[-3:], f[-3:])
    before = observed_order(n[-4:-1], f[-4:-1]) if len(f) > 3 else None
    if p is None:
        spread = max(f[-3:]) - min(f[-3:])
        return Estimate(f[-1], DOUBTFUL * spread, None, False,
                        "not asymptotic: the last three values do not converge from one side; finer meshes are needed")
    if p <= 0.0:
        return Estimate(None, None, p, False, "not asymptotic: the differences grow; finer meshes are needed")
    confirmed = len(f) == 3 or (before is not None and abs(p - before) <= max(0.15 * p, 0.2))
    if confirmed and p >= (LEAST_UNCONFIRMED if len(f) == 3 else LEAST_ORDER):
        value, bar = _extrapolate(n, f, p, CONFIRMED)
        return Estimate(value, bar, p, True, "three meshes: the order is unconfirmed" if len(f) == 3 else "")
    value, _ = _extrapolate(n, f, max(p, LEAST_ORDER), DOUBTFUL)
    trusted = min(p, before if before is not None and before > 0 else p, ASSUMED_ORDER)
    _, bar = _extrapolate(n, f, max(trusted, LEAST_ORDER), DOUBTFUL)
    then = "no order" if before is None else f"{before:.2f}"
    why = f"it was {then} one mesh before" if not confirmed else "it is too low to trust"
    return Estimate(value, bar, p, False, f"not asymptotic: the order is {p:.2f}, {why}; finer meshes are needed")


def _extrapolate(n: Sequence[float], f: Sequence[float], p: float, safety: float) -> tuple[float, float]:
    step = (f[-1] - f[-2]) / math.expm1(p * math.log(n[-1] / n[-2]))
    return f[-1] + step, safety * abs(step)
