"""Derivatives of smooth functions by differences of high order with suitable steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...elements.shape import Array
from ...errors import CaseError

# relative difference of second- and fourth-order differences that is small enough: the error is its square
SMOOTH = 3e-5
# factor on a step that is too long, and the largest number of attempts
SHORTER, TRIES = 0.1, 3
# relative round-off of values
NOISE = 1e-14
# derivatives at 0 of the polynomials through 0, h, 2h, 3h, 4h and through 0, h, 2h, 3h
FORWARD, LOWER = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12.0, np.array([-11.0, 18.0, -9.0, 2.0, 0.0]) / 6.0


class UnsuitedError(Exception):
    """The result depends on a number in a way that its equations do not cover; the text says why."""


@dataclass
class Quotient:
    """A derivative (m,) by differences with steps of h, and its estimated error (m,), excluding that of kinks.

    ``noise`` (m,) is the part of the error from round-off.
    """

    value: Array
    error: Array
    h: float
    kink: Array | float = 0.0
    noise: Array | float = 0.0


def derivative(f: Callable[[float], Array], h: float, weights: Array | None = None, unknown: float = 0.0,
               middle: Array | None = None, round_off: Array | float = 0.0) -> Quotient:
    """Return f'(0) of fourth order of a smooth f with values (m,), by differences with steps near h > 0.

    The differences are central, unless f raises CaseError on one side; then they are one-sided. Steps are shortened
    where differences of lower order show that f is not smooth over them, unless round-off would then exceed the present
    error, and lengthened where ``round_off`` (m,), the absolute round-off of f, dominates the error. Exceptions of f on
    both sides are passed on. Values are compared through ``weights`` (m,); ``unknown`` is their uncertainty, so
    weighted, in addition to round-off. If ``middle``, f(0), is given, half of the jump of f' there is part of the
    error. If several steps were tried, the error is at most the difference of their derivatives.
    """
    tried: list[Quotient] = []
    for _ in range(TRIES):
        tried.append(_at(f, h, middle, round_off))
        best = min(tried, key=lambda found: _worst(found, weights, unknown))
        if _worst(best, weights, 0.0) <= SMOOTH**2 or _at_round_off(tried[-1], weights):
            break
        h *= SHORTER
    others = [np.abs(best.value - other.value) for other in tried if other is not best]
    error = np.minimum(best.error, np.max(others, axis=0)) if others else best.error
    best = replace(best, error=np.maximum(error, round_off / best.h) + best.kink, kink=0.0)
    return _lengthened(f, best, weights, middle, round_off) if np.any(round_off) else best


def _lengthened(f: Callable[[float], Array], best: Quotient, weights: Array | None, middle: Array | None,
                round_off: Array | float) -> Quotient:
    """Return the derivative with steps as long as they reduce the total error of one found with shorter steps."""
    for _ in range(TRIES):
        noise = replace(best, error=np.asarray(best.noise))
        if _worst(noise, weights, 0.0) < 0.5 * _worst(best, weights, 0.0):
            break
        try:
            longer = _at(f, best.h / SHORTER, middle, round_off)
        except CaseError:
            break
        if _worst(longer, weights, 0.0) >= _worst(best, weights, 0.0):
            break
        best = replace(longer, error=longer.error + longer.kink, kink=0.0)
    return best


def _worst(found: Quotient, weights: Array | None, unknown: float) -> float:
    """Return the largest error relative to the largest derivative."""
    w = 1.0 if weights is None else weights
    largest = float(np.max(w * np.abs(found.value), initial=0.0))
    error = float(np.max(w * (found.error + found.kink), initial=0.0)) + unknown / found.h
    return error / largest if largest > 0.0 else 0.0


def _at_round_off(found: Quotient, weights: Array | None) -> bool:
    """Return whether the round-off of a shorter step alone would exceed the present total error."""
    shorter = replace(found, error=np.asarray(found.noise / SHORTER), kink=0.0)
    return _worst(shorter, weights, 0.0) >= _worst(found, weights, 0.0) > 0.0


def _at(f: Callable[[float], Array], h: float, middle: Array | None, round_off: Array | float) -> Quotient:
    try:
        below = [f(-h), f(-2 * h)]
    except CaseError:
        return _one_sided(f, h, round_off)
    try:
        above = [f(h), f(2 * h)]
    except CaseError:
        return _one_sided(f, -h, round_off, below)
    found = central(above, below, h, round_off)
    if middle is not None:
        # the second difference is proportional to h at a kink, else to its square
        near, far = (above[k] + below[k] - 2 * middle for k in (0, 1))
        found.kink = np.abs(4 * near - far) / (4 * h)
    return found


def central(above: list[Array], below: list[Array], h: float, round_off: Array | float = 0.0) -> Quotient:
    """Return f'(0) from f at h, 2 h and at -h, -2 h.

    With D2 and D4 of second and fourth order, the truncation error is estimated as |D4 - D2|^2/|D4|, the next term of
    the series if terms decrease at a constant ratio. The round-off of f divided by h is added, ``round_off`` (m,) in
    addition to that of its last digits.
    """
    near, far = (above[0] - below[0]) / (2 * h), (above[1] - below[1]) / (4 * h)
    value = near + (near - far) / 3.0
    size = np.maximum(np.abs(above[1]), np.abs(below[1]))
    noise = (NOISE * size + round_off) / abs(h)
    return Quotient(value, error_of(value, near) + noise, abs(h), noise=noise)


def _one_sided(f: Callable[[float], Array], h: float, round_off: Array | float,
               known: list[Array] | None = None) -> Quotient:
    values = np.array([f(0.0), *(known or [f(h), f(2 * h)]), f(3 * h), f(4 * h)])
    value, other = FORWARD @ values / h, LOWER @ values / h
    # the polynomial of lower order has third order already, so the difference itself is the estimate
    noise = (NOISE * np.abs(values).max(0) + round_off) / abs(h)
    return Quotient(value, np.abs(value - other) * 0.1 + noise, abs(h), noise=noise)


def error_of(value: Array, near: Array) -> Array:
    """Return the error of differences, given those of lower order, ``near``, as ``central`` estimates it."""
    gap = np.abs(value - near)
    share = np.divide(gap, np.abs(value), out=np.ones_like(gap), where=value != 0.0)
    return gap * np.minimum(share, 1.0)
