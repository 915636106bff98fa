"""The expression language of amplitudes: parsed by hand, evaluated over floats or dual numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

MAX_LENGTH = 2000
MAX_DEPTH = 60
_TOKEN = re.compile(r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
                    r"|(?P<name>[A-Za-z_]\w*)|(?P<op><=|>=|==|!=|\*\*|[-+*/^()<>]))")

# an operand is a float or a Dual; t is bound at evaluation
Closure = Callable[[Any], Any]


class ExpressionError(ValueError):
    """A text that is no expression; ``column`` counts from 0 inside it."""

    def __init__(self, message: str, column: int) -> None:
        super().__init__(message)
        self.column = column


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
    "abs": _unary(abs, lambda a: math.copysign(1.0, a) if a else 0.0),
}
_NEGATE = _unary(lambda a: -a, lambda a: -1.0)
NAMES = "t, pi, " + ", ".join(FUNCTIONS)


def parse(text: str) -> Closure:
    """Return the function of t that an expression describes, for floats and for Duals.

    Raises ExpressionError where the text is none. Work is bounded by the length of the text:
    the language has no loops and no names but t, pi and five functions.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the expression is longer than {MAX_LENGTH} characters", 0)
    return _Parser(text).whole()


class _Parser:
    """Recursive descent: conditional < comparison < sum < product < sign < power < atom."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = list(self.split(text))
        self.at = 0
        self.depth = 0

    @staticmethod
    def split(text: str) -> Any:
        """Yield (kind, text, column) of every token, then the end."""
        at = 0
        while at < len(text.rstrip()):
            match = _TOKEN.match(text, at)
            if match is None:
                column = at + len(text[at:]) - len(text[at:].lstrip())
                raise ExpressionError(f"'{text[column]}' is not allowed", column)
            kind = str(match.lastgroup)
            yield kind, match[kind], match.start(kind)
            at = match.end()
        yield "end", "", len(text.rstrip())

    def peek(self) -> str:
        return self.tokens[self.at][1]

    def take(self) -> tuple[str, str, int]:
        token = self.tokens[self.at]
        self.at += 1
        return token

    def fail(self, message: str) -> ExpressionError:
        return ExpressionError(message, self.tokens[self.at][2])

    def whole(self) -> Closure:
        result = self.conditional()
        if self.tokens[self.at][0] != "end":
            raise self.fail(f"'{self.peek()}' is unexpected")
        return result

    def conditional(self) -> Closure:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.fail(f"the expression is nested more than {MAX_DEPTH} deep")
        value = self.comparison()
        if self.peek() == "if":
            self.take()
            condition = self.comparison()
            if self.peek() != "else":
                raise self.fail("'else' is missing after 'a if c'")
            self.take()
            other = self.conditional()
            chosen = value
            value = lambda t: chosen(t) if _parts(condition(t))[0] else other(t)  # noqa: E731
        self.depth -= 1
        return value

    def comparison(self) -> Closure:
        first = self.sum()
        chain: list[tuple[Callable[[float, float], bool], Closure]] = []
        while self.peek() in _COMPARE:
            chain.append((_COMPARE[self.take()[1]], self.sum()))
        if not chain:
            return first

        def compare(t: Any) -> float:
            left = _parts(first(t))[0]
            for holds, operand in chain:
                right = _parts(operand(t))[0]
                if not holds(left, right):
                    return 0.0
                left = right
            return 1.0
        return compare

    def chain(self, symbols: str, operand: Callable[[], Closure]) -> Closure:
        """Parse a left-associative chain; a flat loop, so that long sums are not deep."""
        first = operand()
        rest: list[tuple[Callable[[Any, Any], Any], Closure]] = []
        while self.peek() and self.peek() in symbols:
            rest.append((_BINARY[self.take()[1]], operand()))
        if not rest:
            return first

        def apply(t: Any) -> Any:
            value = first(t)
            for operate, closure in rest:
                value = operate(value, closure(t))
            return value
        return apply

    def sum(self) -> Closure:
        return self.chain("+-", self.product)

    def product(self) -> Closure:
        return self.chain("*/", self.sign)

    def sign(self) -> Closure:
        negative = False
        while self.peek() in ("-", "+"):
            negative ^= self.take()[1] == "-"
        operand = self.power()
        return (lambda t: _NEGATE(operand(t))) if negative else operand

    def power(self) -> Closure:
        base = self.atom()
        if self.peek() == "**":
            raise self.fail("'**' is not allowed; a power is written ^")
        if self.peek() != "^":
            return base
        self.take()
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.fail(f"the expression is nested more than {MAX_DEPTH} deep")
        exponent = self.sign()
        self.depth -= 1
        power = _BINARY["^"]
        return lambda t: power(base(t), exponent(t))

    def atom(self) -> Closure:
        kind, text, _ = self.tokens[self.at]
        if kind == "number":
            value = float(text)
            if math.isinf(value):
                raise self.fail("the number is too large")
            self.take()
            return lambda t: value
        if kind == "name":
            return self.named(text)
        if text == "(":
            self.take()
            inner = self.conditional()
            self.close()
            return inner
        raise self.fail("the expression ends too early" if kind == "end"
                        else f"'{text}' is unexpected")

    def named(self, text: str) -> Closure:
        if text == "t":
            self.take()
            return lambda t: t
        if text == "pi":
            self.take()
            return lambda t: math.pi
        if text in ("if", "else"):
            raise self.fail(f"a value is missing before '{text}'")
        if text not in FUNCTIONS:
            raise self.fail(f"'{text}' is not known; known are {NAMES}")
        self.take()
        if self.peek() != "(":
            raise self.fail(f"'(' is missing after {text}")
        self.take()
        function, argument = FUNCTIONS[text], self.conditional()
        self.close()
        return lambda t: function(argument(t))

    def close(self) -> None:
        if self.peek() != ")":
            raise self.fail("')' is missing")
        self.take()
