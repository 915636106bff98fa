"""Expressions in t, evaluated over floats or dual numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from .syntax import Call, Chain, Choice, Comparison, Constant, Negative, Power, Time, Tree, syntax

# an operand is a float or a Dual; t is bound at evaluation
Closure = Callable[[Any], Any]


class Dual:
    """A value with its derivative by t (forward-mode differentiation)."""

    __slots__ = ("d", "v")

    def __init__(self, v: float, d: float = 0.0) -> None:
        self.v, self.d = v, d


def _parts(a: Any) -> tuple[float, float]:
    return (a.v, a.d) if isinstance(a, Dual) else (a, 0.0)


def _binary(value: Callable[[float, float], float],
            rate: Callable[[float, float, float, float], float]) -> Callable[[Any, Any], Any]:
    def apply(a: Any, b: Any) -> Any:
        if not isinstance(a, Dual) and not isinstance(b, Dual):
            return value(a, b)
        (av, ad), (bv, bd) = _parts(a), _parts(b)
        return Dual(value(av, bv), rate(av, ad, bv, bd))
    return apply


def _power_rate(a: float, ad: float, b: float, bd: float) -> float:
    # the exponent's part first: where it stands still, a negative base is fine
    part = 0.0 if bd == 0 else math.pow(a, b) * math.log(a) * bd
    return part + (0.0 if ad == 0 or b == 0 else b * math.pow(a, b - 1) * ad)


def _unary(value: Callable[[float], float],
           rate: Callable[[float], float]) -> Callable[[Any], Any]:
    def apply(a: Any) -> Any:
        if not isinstance(a, Dual):
            return value(a)
        return Dual(value(a.v), 0.0 if a.d == 0 else rate(a.v) * a.d)
    return apply


def _magnitude(a: Any) -> Any:
    """Return |a|; where it passes zero, the derivative is the one to its right."""
    if not isinstance(a, Dual):
        return abs(a)
    return Dual(abs(a.v), abs(a.d) if a.v == 0 else math.copysign(1.0, a.v) * a.d)


_BINARY = {
    "+": _binary(lambda a, b: a + b, lambda a, ad, b, bd: ad + bd),
    "-": _binary(lambda a, b: a - b, lambda a, ad, b, bd: ad - bd),
    "*": _binary(lambda a, b: a * b, lambda a, ad, b, bd: ad * b + a * bd),
    "/": _binary(lambda a, b: a / b, lambda a, ad, b, bd: (ad - a / b * bd) / b),
    "^": _binary(math.pow, _power_rate),
}
_COMPARE: dict[str, Callable[[float, float], bool]] = {
    "<": lambda a, b: a < b, "<=": lambda a, b: a <= b, ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b, "==": lambda a, b: a == b, "!=": lambda a, b: a != b,
}
FUNCTIONS = {
    "sin": _unary(math.sin, math.cos),
    "cos": _unary(math.cos, lambda a: -math.sin(a)),
    "exp": _unary(math.exp, math.exp),
    "sqrt": _unary(math.sqrt, lambda a: 0.5 / math.sqrt(a)),
    "abs": _magnitude,
}
_NEGATE = _unary(lambda a: -a, lambda a: -1.0)


def parse(text: str) -> Closure:
    """Return the function of t that an expression describes, for floats and for Duals.

    Raises ExpressionError where the text is none. Work is bounded by the length of the text:
    the language has no loops and no names but t, pi and five functions.
    """
    return closure(syntax(text))


def closure(tree: Tree) -> Closure:
    """Return the function of t that a tree describes, for floats and for Duals."""
    match tree:
        case Constant(value):
            return lambda t: value
        case Time():
            return lambda t: t
        case Negative(operand):
            inner = closure(operand)
            return lambda t: _NEGATE(inner(t))
        case Power(base, exponent):
            a, b, power = closure(base), closure(exponent), _BINARY["^"]
            return lambda t: power(a(t), b(t))
        case Call(name, argument):
            function, inner = FUNCTIONS[name], closure(argument)
            return lambda t: function(inner(t))
        case Choice(condition, chosen, other):
            c, a, b = closure(condition), closure(chosen), closure(other)
            return lambda t: a(t) if _parts(c(t))[0] else b(t)
        case Comparison(first, rest):
            return _comparison(closure(first), [(_COMPARE[op], closure(node)) for op, node in rest])
        case Chain(first, rest):
            return _chain(closure(first), [(_BINARY[op], closure(node)) for op, node in rest])


def _comparison(first: Closure, rest: list[tuple[Callable[[float, float], bool], Closure]]) -> Closure:
    def compare(t: Any) -> float:
        left = _parts(first(t))[0]
        for holds, operand in rest:
            right = _parts(operand(t))[0]
            if not holds(left, right):
                return 0.0
            left = right
        return 1.0
    return compare


def _chain(first: Closure, rest: list[tuple[Callable[[Any, Any], Any], Closure]]) -> Closure:
    def apply(t: Any) -> Any:
        value = first(t)
        for operate, operand in rest:
            value = operate(value, operand(t))
        return value
    return apply
