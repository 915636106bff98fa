"""The expression language of amplitudes and profiles: a text as a tree, parsed by hand."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

MAX_LENGTH = 2000
MAX_DEPTH = 60
FUNCTION_NAMES = ("sin", "cos", "exp", "sqrt", "abs")
COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")
_NAMES = "pi, " + ", ".join(FUNCTION_NAMES)
_TOKEN = re.compile(r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
                    r"|(?P<name>[A-Za-z_]\w*)|(?P<op><=|>=|==|!=|\*\*|[-+*/^()<>]))")


class ExpressionError(ValueError):
    """A text that is no expression; ``column`` counts from 0 inside it."""

    def __init__(self, message: str, column: int) -> None:
        super().__init__(message)
        self.column = column


class Constant(NamedTuple):
    """A number."""

    value: float


class Time(NamedTuple):
    """The variable: t, or s along a body."""


class Negative(NamedTuple):
    """-operand."""

    operand: Tree


class Power(NamedTuple):
    """base ^ exponent."""

    base: Tree
    exponent: Tree


class Chain(NamedTuple):
    """first, then from left to right + - or * / with each operand of ``rest``; flat, so that long sums are not deep."""

    first: Tree
    rest: tuple[tuple[str, Tree], ...]


class Call(NamedTuple):
    """One of the functions of an argument."""

    name: str
    argument: Tree


class Comparison(NamedTuple):
    """1 where each operand compares with the one before it as said, else 0; stops at the first that does not."""

    first: Tree
    rest: tuple[tuple[str, Tree], ...]


class Choice(NamedTuple):
    """chosen if condition else other; only one of the two is evaluated."""

    condition: Tree
    chosen: Tree
    other: Tree


Tree = Constant | Time | Negative | Power | Chain | Call | Comparison | Choice


def syntax(text: str, variable: str = "t") -> Tree:
    """Return the tree of an expression in ``variable``. Raises ExpressionError where the text is none."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the expression is longer than {MAX_LENGTH} characters", 0)
    return _Parser(text, variable).whole()


class _Parser:
    """Recursive descent: conditional < comparison < sum < product < sign < power < atom."""

    def __init__(self, text: str, variable: str) -> None:
        self.text, self.variable = text, variable
        self.tokens = list(self.split(text))
        self.at = 0
        self.depth = 0

    @staticmethod
    def split(text: str) -> Iterator[tuple[str, str, int]]:
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

    def whole(self) -> Tree:
        result = self.conditional()
        if self.tokens[self.at][0] != "end":
            raise self.fail(f"'{self.peek()}' is unexpected")
        return result

    def conditional(self) -> Tree:
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
            value = Choice(condition, value, self.conditional())
        self.depth -= 1
        return value

    def comparison(self) -> Tree:
        first = self.sum()
        rest: list[tuple[str, Tree]] = []
        while self.peek() in COMPARISONS:
            rest.append((self.take()[1], self.sum()))
        return Comparison(first, tuple(rest)) if rest else first

    def chain(self, symbols: str, operand: Callable[[], Tree]) -> Tree:
        """Parse a left-associative chain."""
        first = operand()
        rest: list[tuple[str, Tree]] = []
        while self.peek() and self.peek() in symbols:
            rest.append((self.take()[1], operand()))
        return Chain(first, tuple(rest)) if rest else first

    def sum(self) -> Tree:
        return self.chain("+-", self.product)

    def product(self) -> Tree:
        return self.chain("*/", self.sign)

    def sign(self) -> Tree:
        negative = False
        while self.peek() in ("-", "+"):
            negative ^= self.take()[1] == "-"
        operand = self.power()
        return Negative(operand) if negative else operand

    def power(self) -> Tree:
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
        return Power(base, exponent)

    def atom(self) -> Tree:
        kind, text, _ = self.tokens[self.at]
        if kind == "number":
            value = float(text)
            if math.isinf(value):
                raise self.fail("the number is too large")
            self.take()
            return Constant(value)
        if kind == "name":
            return self.named(text)
        if text == "(":
            self.take()
            inner = self.conditional()
            self.close()
            return inner
        raise self.fail("the expression ends too early" if kind == "end"
                        else f"'{text}' is unexpected")

    def named(self, text: str) -> Tree:
        if text == self.variable:
            self.take()
            return Time()
        if text == "pi":
            self.take()
            return Constant(math.pi)
        if text in ("if", "else"):
            raise self.fail(f"a value is missing before '{text}'")
        if text not in FUNCTION_NAMES:
            raise self.fail(f"'{text}' is unknown; known names are {self.variable}, {_NAMES}")
        self.take()
        if self.peek() != "(":
            raise self.fail(f"'(' is missing after {text}")
        self.take()
        argument = self.conditional()
        self.close()
        return Call(text, argument)

    def close(self) -> None:
        if self.peek() != ")":
            raise self.fail("')' is missing")
        self.take()
