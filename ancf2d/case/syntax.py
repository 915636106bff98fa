"""The expression language of amplitudes and profiles: parses a text into a tree."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, NamedTuple

MAX_LENGTH = 2000
MAX_DEPTH = 60
FUNCTION_NAMES = ("sin", "cos", "exp", "sqrt", "abs")
COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")
# reserved names
WORDS = ("pi", "if", "else", *FUNCTION_NAMES)
IDENTIFIER = re.compile(r"[A-Za-z_]\w*", re.ASCII)
# words and signs of other languages, and what to write instead: comparisons are 1 or 0
_BOTH = "for both conditions, multiply them: (t > 1)*(t < 2)"
_ONE = "for one of two conditions, add them: (t < 1) + (t > 2)"
_INSTEAD = {"and": _BOTH, "&": _BOTH, "or": _ONE, "|": _ONE, "=": "equality is written ==",
            ",": "functions have one argument; the smaller of two numbers is a if a < b else b"}
_NAMES = "pi, " + ", ".join(FUNCTION_NAMES)
_TOKEN = re.compile(r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
                    r"|(?P<name>[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)|(?P<op><=|>=|==|!=|\*\*|[-+*/^()<>]))")


def _nearest(word: str, names: Collection[str]) -> str:
    """Return the name most like a word, or an empty text if none is near."""
    from difflib import get_close_matches

    return next(iter(get_close_matches(word, list(names)[:10000], n=1)), "") if len(word) <= 80 else ""


class ExpressionError(ValueError):
    """A text that is not an expression; ``column`` counts from 0 in it, ``near`` is a name that was probably meant.

    ``each`` are all mistakes found in the text, of which this is the first.
    """

    def __init__(self, message: str, column: int, near: str = "") -> None:
        super().__init__(message)
        self.column, self.near, self.each = column, near, [self]


class Names(NamedTuple):
    """The meanings of names in an expression.

    ``variable`` is t or s, the variable of the function; ``numbers`` are the parameters of the case with their values;
    ``quantities`` are those of the running motion, such as arm.theta. ``probes`` serve to explain unknown names.
    """

    variable: str = "t"
    numbers: Mapping[str, float] = {}
    quantities: Collection[str] = ()
    probes: Collection[str] = ()


class Constant(NamedTuple):
    """A number."""

    value: float


class Variable(NamedTuple):
    """The variable: t, or s along a body."""


class Quantity(NamedTuple):
    """A quantity of the running motion: of a probe, of a point or a spring, or the output of a controller."""

    name: str


class Negative(NamedTuple):
    """-operand."""

    operand: Tree


class Power(NamedTuple):
    """base ^ exponent."""

    base: Tree
    exponent: Tree


class Chain(NamedTuple):
    """``first``, then + - * / with each operand of ``rest`` from left to right; flat, so long sums are not deep."""

    first: Tree
    rest: tuple[tuple[str, Tree], ...]


class Call(NamedTuple):
    """A function applied to an argument."""

    name: str
    argument: Tree


class Comparison(NamedTuple):
    """1 if each operand compares as stated with the one before it, else 0; stops at the first failure."""

    first: Tree
    rest: tuple[tuple[str, Tree], ...]


class Choice(NamedTuple):
    """``chosen`` if ``condition`` else ``other``; only one of the two is evaluated."""

    condition: Tree
    chosen: Tree
    other: Tree


Tree = Constant | Variable | Quantity | Negative | Power | Chain | Call | Comparison | Choice


def syntax(text: str, names: Names | str = "t") -> Tree:
    """Return the tree of an expression, with numbers for parameters. Raises ExpressionError if the text is invalid.

    ``names`` may be just the name of the variable; a ``Formula`` has its own names, which are used instead.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the expression is longer than {MAX_LENGTH} characters", 0)
    own = text.names if isinstance(text, Formula) else names
    return _Parser(text, Names(own) if isinstance(own, str) else own).whole()


class Formula(str):
    """The text of an expression with the meanings of the names that it uses; equal if text and names are equal."""

    names: Names

    def __new__(cls, text: str, names: Names) -> Formula:
        """Return the text with the meanings of its names."""
        self = super().__new__(cls, text)
        self.names = names
        return self

    def __getnewargs__(self) -> Any:
        """Return the arguments that make a copy."""
        return str(self), self.names

    def __eq__(self, other: object) -> bool:
        """Return whether text and names are the same."""
        return isinstance(other, Formula) and str.__eq__(self, other) and self.names == other.names

    def __ne__(self, other: object) -> bool:
        """Return whether text or names differ."""
        return not self == other

    def __hash__(self) -> int:
        """Return the hash of the text."""
        return str.__hash__(self)


def formula(text: str, names: Names) -> str:
    """Return an expression as a ``Formula`` with the names that it uses, or as plain text if it uses none.

    Raises ExpressionError if the text is not an expression.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the expression is longer than {MAX_LENGTH} characters", 0)
    parser = _Parser(text, names)
    parser.whole()
    if not parser.used:
        return text
    numbers = {k: v for k, v in names.numbers.items() if k in parser.used}
    return Formula(text, Names(names.variable, numbers, tuple(sorted(parser.used - set(numbers)))))


def quantities_of(text: str | None) -> tuple[str, ...]:
    """Return the names of the quantities of the running motion that an expression uses."""
    return tuple(text.names.quantities) if isinstance(text, Formula) else ()


def compares(tree: Tree) -> bool:
    """Return whether an expression contains a comparison; only then it can serve as a condition."""
    if isinstance(tree, Comparison):
        return True
    if not isinstance(tree, tuple):
        return False
    return any(compares(part) for part in tree)  # type: ignore[arg-type]


class _Parser:
    """A recursive-descent parser: conditional < comparison < sum < product < sign < power < atom."""

    def __init__(self, text: str, names: Names) -> None:
        self.text, self.names = text, names
        self.used: set[str] = set()
        # unknown names, after which parsing goes on
        self.wrong: dict[str, ExpressionError] = {}
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
                hint = _INSTEAD.get(text[column], "")
                raise ExpressionError(f"'{text[column]}' is not allowed{hint and '; '}{hint}", column)
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
        last: list[ExpressionError] = []
        try:
            result = self.conditional()
            if self.tokens[self.at][0] != "end":
                raise self.unexpected()
        except ExpressionError as error:
            last = [error]
        if found := [*self.wrong.values(), *last]:
            found[0].each = found
            raise found[0]
        return result

    def unexpected(self) -> ExpressionError:
        text = self.peek()
        return self.fail(f"'{text}' is unexpected" + (f"; {_INSTEAD[text]}" if text in _INSTEAD else ""))

    def conditional(self) -> Tree:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.fail(f"the expression is nested more than {MAX_DEPTH} deep")
        value = self.comparison()
        if self.peek() == "if":
            self.take()
            condition = self.comparison()
            if self.peek() != "else":
                raise self.unexpected() if self.peek() in _INSTEAD else self.fail("'else' is missing after 'a if c'")
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
        raise self.fail("the expression ends too early") if kind == "end" else self.unexpected()

    def named(self, text: str) -> Tree:
        variable, quantity, number = (text == self.names.variable, text in self.names.quantities,
                                      text in self.names.numbers)
        own = variable or quantity
        if variable + quantity + number > 1:
            what = "parameter" if number else "controller or state"
            raise self.fail(f"'{text}' has a meaning of its own here; give the {what} another name")
        if own or text in self.names.numbers:
            self.take()
            if text == self.names.variable:
                return Variable()
            self.used.add(text)
            return Constant(self.names.numbers[text]) if text in self.names.numbers else Quantity(text)
        if text == "pi":
            self.take()
            return Constant(math.pi)
        if text in ("if", "else"):
            raise self.fail(f"a value is missing before '{text}'")
        if text not in FUNCTION_NAMES:
            self.wrong.setdefault(text, self.unknown(text))
        self.take()
        if text in self.wrong and self.peek() != "(":
            return Constant(1.0)
        if self.peek() != "(":
            raise self.fail(f"'(' is missing after {text}")
        self.take()
        argument = self.conditional()
        self.close()
        return Call(text, argument)

    def unknown(self, text: str) -> ExpressionError:
        """Return the error for a name: a probe without a quantity, or an unknown name."""
        probe, dot, quantity = text.partition(".")
        own = [name for name in self.names.quantities if name.startswith(f"{probe}.")]
        column = self.tokens[self.at][2]
        if own and not dot:
            return ExpressionError(f"'{text}' is a probe, whose quantities are {', '.join(own)}", column)
        if own:
            known = ", ".join(name.partition(".")[2] for name in own)
            why = "section forces follow from the motion and cannot act back on it" if quantity in "NQM" else ""
            return ExpressionError(f"'{text}' is unknown{': ' + why if why else ''}; an expression can use {known} of "
                                   f"'{probe}'", column,
                                   _nearest(text, own) if not why else "")
        if dot and (self.names.probes or self.names.quantities):
            return ExpressionError(f"'{text}' is unknown: there is no probe '{probe}' in output.probes", column,
                                   _nearest(text, self.names.quantities))
        plain = [name for name in (*self.names.quantities, *self.names.numbers) if "." not in name]
        known = ", ".join([self.names.variable, _NAMES, *plain])
        return ExpressionError(f"'{text}' is unknown; known names are {known}", column,
                               _nearest(text, (*self.names.quantities, *self.names.numbers)))

    def close(self) -> None:
        if self.peek() != ")":
            raise self.unexpected() if self.peek() in _INSTEAD else self.fail("')' is missing")
        self.take()


def renamed(tree: Tree, meaning: Mapping[str, Tree]) -> Tree:
    """Return a tree with some quantities replaced by trees, and the variable too if ``meaning`` has an empty name."""
    match tree:
        case Quantity(name):
            return meaning.get(name, tree)
        case Variable():
            return meaning.get("", tree)
        case Negative(operand):
            return Negative(renamed(operand, meaning))
        case Power(base, exponent):
            return Power(renamed(base, meaning), renamed(exponent, meaning))
        case Chain(first, rest) | Comparison(first, rest):
            return type(tree)(renamed(first, meaning), tuple((op, renamed(x, meaning)) for op, x in rest))
        case Call(name, argument):
            return Call(name, renamed(argument, meaning))
        case Choice(condition, chosen, other):
            return Choice(renamed(condition, meaning), renamed(chosen, meaning), renamed(other, meaning))
    return tree


def named_in(tree: Tree) -> Iterator[str]:
    """Yield the names of the quantities in a tree."""
    if isinstance(tree, Quantity):
        yield tree.name
    elif isinstance(tree, tuple):
        for part in tree:
            yield from named_in(part)  # type: ignore[arg-type]
