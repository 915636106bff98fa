"""Expressions as truncated Taylor series of their variable, at many places at once: exact derivatives of any order.

A series is an array (order + 1, places) of Taylor coefficients (not derivatives), real or complex.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .syntax import Call, Chain, Choice, Comparison, Constant, Negative, Power, Quantity, Tree, Variable

Series = NDArray[Any]
WHOLE = 64  # whole exponents up to this one are computed as products, which are valid for zero and negative bases

_COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal, "==": np.equal, "!=": np.not_equal,
}


def constant(value: Any, like: Series) -> Series:
    """Return the series of a constant."""
    out = np.zeros_like(like)
    out[0] = value
    return out


def product(a: Series, b: Series) -> Series:
    """Return the series of a b."""
    return np.stack([sum(a[i] * b[k - i] for i in range(k + 1)) for k in range(len(a))])


def quotient(a: Series, b: Series) -> Series:
    """Return the series of a / b."""
    out = np.empty_like(a)
    for k in range(len(a)):
        out[k] = (a[k] - sum(out[i] * b[k - i] for i in range(k))) / b[0]
    return out


def power(a: Series, r: float) -> Series:
    """Return the series of a^r for a constant exponent."""
    if r == round(r) and abs(r) <= WHOLE:
        out = constant(1.0, a)
        for _ in range(abs(int(r))):
            out = product(out, a)
        return out if r >= 0 else quotient(constant(1.0, a), out)
    out = np.empty_like(a)
    out[0] = a[0] ** r
    for k in range(1, len(a)):
        out[k] = sum((r * i - (k - i)) * a[i] * out[k - i] for i in range(1, k + 1)) / (k * a[0])
    return out


def derivative(a: Series) -> Series:
    """Return the series of da/ds, one order shorter."""
    return np.arange(1, len(a))[:, None] * a[1:]


def exponential(a: Series) -> Series:
    """Return the series of exp a."""
    out = np.empty_like(a)
    out[0] = np.exp(a[0])
    for k in range(1, len(a)):
        out[k] = sum(i * a[i] * out[k - i] for i in range(1, k + 1)) / k
    return out


def _logarithm(a: Series) -> Series:
    out = np.empty_like(a)
    out[0] = np.log(a[0])
    for k in range(1, len(a)):
        out[k] = (a[k] - sum(i * out[i] * a[k - i] for i in range(1, k)) / k) / a[0]
    return out


def _raised(a: Series, b: Series) -> Series:
    """Return a^b; the exponent must be one constant at all places, or the base positive."""
    if not np.any(b[1:]) and np.all(b[0] == b[0, 0]):
        return power(a, float(b[0, 0]))
    return exponential(product(b, _logarithm(a)))


_FUNCTIONS: dict[str, Callable[[Series], Series]] = {
    "sin": lambda a: exponential(1j * a).imag,
    "cos": lambda a: exponential(1j * a).real,
    "exp": exponential,
    "sqrt": lambda a: power(a, 0.5),
    "abs": lambda a: np.where(a[0] < 0.0, -a, a),
}
_CHAIN: dict[str, Callable[[Series, Series], Series]] = {
    "+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": product, "/": quotient,
}


def series(tree: Tree, s: NDArray[np.floating], order: int) -> Series:
    """Return the Taylor coefficients (order + 1, places) of an expression at s (places,), nan where it has no value."""
    variable = np.zeros((order + 1, len(s)))
    variable[0] = s
    if order:
        variable[1] = 1.0
    with np.errstate(all="ignore"):
        return _evaluated(tree, variable)


def _evaluated(tree: Tree, s: Series) -> Series:
    match tree:
        case Constant(value):
            return constant(value, s)
        case Variable():
            return s
        case Quantity():
            return constant(np.nan, s)
        case Negative(operand):
            return -_evaluated(operand, s)
        case Power(base, exponent):
            return _raised(_evaluated(base, s), _evaluated(exponent, s))
        case Call(name, argument):
            return _FUNCTIONS[name](_evaluated(argument, s))
        case Choice(condition, chosen, other):
            return np.where(_evaluated(condition, s)[0] != 0.0, _evaluated(chosen, s), _evaluated(other, s))
        case Comparison(first, rest):
            left, holds = _evaluated(first, s)[0], np.ones(s.shape[1], dtype=bool)
            for op, node in rest:
                right = _evaluated(node, s)[0]
                holds &= _COMPARE[op](left, right)
                left = right
            return constant(holds, s)
        case Chain(first, rest):
            out = _evaluated(first, s)
            for op, node in rest:
                out = _CHAIN[op](out, _evaluated(node, s))
            return out
