"""Amplitudes: a factor over time, or over the load factor in static cases."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

from ...errors import ComputationError
from ..binder import INVALID, Binder, Issue, Path, dotted
from ..declare import key, record
from ..expression import Dual, closure
from ..kinds import Flag, ListOf, Number, Text
from ..nodes import Mark, Node, Scalar
from ..syntax import ExpressionError, Tree, syntax

SCALE_DOC = "Factor by which the amplitude is multiplied"


@record
class Constant:
    """The same value at all times."""

    tag = "constant"
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    def value(self, t: float) -> float:
        """Return the amplitude at t."""
        return self.scale

    def rate(self, t: float) -> float:
        """Return the derivative by t at t."""
        return 0.0


@record
class Ramp:
    """Rises from 0 at t0 to 1 at t1 and stays there."""

    tag = "ramp"
    t0: float = key(Number("s"), "Where the rise begins", default=0.0)
    t1: float = key(Number("s"), "Where the rise ends", default=1.0)
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    def check(self) -> Iterator[Issue]:
        """Yield a ramp that does not run forward."""
        if not self.t0 < self.t1:
            yield Issue(("t1",), f"{{}}: t0 must be less than t1, got t0 {self.t0:g} "
                        f"and t1 {self.t1:g}")

    def value(self, t: float) -> float:
        """Return the amplitude at t."""
        return self.scale * min(1.0, max(0.0, (t - self.t0) / (self.t1 - self.t0)))

    def rate(self, t: float) -> float:
        """Return the derivative by t at t, at a corner the one to its right."""
        return self.scale / (self.t1 - self.t0) if self.t0 <= t < self.t1 else 0.0


@record
class Table:
    """Values at times; before the first and after the last it stays constant."""

    tag = "table"
    t: tuple[float, ...] = key(ListOf(Number("s"), "numbers", 1), "Times, increasing",
                               example=[0, 1, 2])
    value_: tuple[float, ...] = key(ListOf(Number(), "numbers", 1), "Value at each time",
                                    example=[0, 1, 0])
    smooth: bool = key(Flag(), "Interpolate with monotone cubics of continuous slope, level at both ends, instead of "
                       "straight lines; between two points the curve stays between their values",
                       default=False)
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    def check(self) -> Iterator[Issue]:
        """Yield lists of different lengths, and times that do not increase."""
        if len(self.t) != len(self.value_):
            yield Issue(("value",), f"{{}}: t has {len(self.t)} numbers and value has "
                        f"{len(self.value_)}", "as many values as times")
        for i in range(1, len(self.t)):
            if not self.t[i - 1] < self.t[i]:
                yield Issue(("t", i), f"{{}}.t must increase, got {self.t[i]:g} "
                            f"after {self.t[i - 1]:g}")
                break

    @cached_property
    def slopes(self) -> tuple[float, ...]:
        """Slopes at the times of the smooth table: Fritsch and Butland 1984, zero at the ends."""
        t, v = self.t, self.value_
        slopes = [0.0] * len(t)
        for i in range(1, len(t) - 1):
            h0, h1 = t[i] - t[i - 1], t[i + 1] - t[i]
            d0, d1 = (v[i] - v[i - 1]) / h0, (v[i + 1] - v[i]) / h1
            if d0 * d1 > 0:
                w0, w1 = 2 * h1 + h0, h1 + 2 * h0
                slopes[i] = (w0 + w1) / (w0 / d0 + w1 / d1)
        return tuple(slopes)

    def value(self, t: float) -> float:
        """Return the amplitude at t."""
        return self._at(t)[0]

    def rate(self, t: float) -> float:
        """Return the derivative by t at t, at a corner the one to its right."""
        return self._at(t)[1]

    def _at(self, t: float) -> tuple[float, float]:
        i = bisect_right(self.t, t) - 1
        if i < 0:
            return self.scale * self.value_[0], 0.0
        if i >= len(self.t) - 1:
            return self.scale * self.value_[-1], 0.0
        h = self.t[i + 1] - self.t[i]
        a, d = self.value_[i], self.value_[i + 1] - self.value_[i]
        x = (t - self.t[i]) / h
        if not self.smooth:
            return self.scale * (a + d * x), self.scale * d / h
        m0, m1 = h * self.slopes[i], h * self.slopes[i + 1]
        c2, c3 = 3 * d - 2 * m0 - m1, m0 + m1 - 2 * d
        return (self.scale * (a + x * (m0 + x * (c2 + x * c3))),
                self.scale * (m0 + x * (2 * c2 + x * 3 * c3)) / h)


@record
class Sine:
    """sin(2 pi frequency t + phase)."""

    tag = "sine"
    frequency: float = key(Number("Hz", ge=0), "Frequency, in Hz", example=2)
    phase: float = key(Number("rad"), "Phase", default=0.0)
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    def value(self, t: float) -> float:
        """Return the amplitude at t."""
        return self.scale * math.sin(2 * math.pi * self.frequency * t + self.phase)

    def rate(self, t: float) -> float:
        """Return the derivative by t at t."""
        omega = 2 * math.pi * self.frequency
        return self.scale * omega * math.cos(omega * t + self.phase)


class ExpressionText(Text):
    """Text in the expression language; a number stands for itself."""

    def __init__(self, variable: str = "t") -> None:
        super().__init__(f"an expression in {variable}", number=True)
        self.variable = variable

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        text = super().bind(node, path, binder)
        if text is INVALID:
            return INVALID
        try:
            syntax(text, self.variable)
        except ExpressionError as error:
            return binder.fail(place_inside(node, error.column), path, f"{dotted(path)}: {error}")
        return text


def place_inside(node: Node, column: int) -> Mark:
    """Return the mark of a character inside a scalar; of the scalar where that cannot be told."""
    mark = node.mark
    if not isinstance(node, Scalar) or not 0 < mark.line <= len(mark.origin.lines):
        return mark
    start = mark.column + (0 if node.plain else 1)
    written = mark.origin.lines[mark.line - 1][start - 1:]
    return Mark(mark.origin, mark.line, start + column) if written.startswith(node.text) else mark


@record
class Expression:
    """A formula in t: + - * / ^, comparisons, sin cos exp sqrt abs, pi, ``a if c else b``."""

    tag = "expression"
    variable = "t"
    value_: str = key(ExpressionText(), "The formula",
                      example="sin(2*pi*t) if t < 0.5 else 0")
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    @cached_property
    def tree(self) -> Tree:
        """The formula as a tree, parsed once."""
        return syntax(self.value_, self.variable)

    @cached_property
    def function(self) -> Callable[[Any], Any]:
        """The formula as a function of its variable; takes a float or a Dual."""
        return closure(self.tree)

    def value(self, t: float) -> float:
        """Return the amplitude at t; ComputationError where the formula has no value there."""
        return self.scale * self._finite(float(t), "value", t)

    def rate(self, t: float) -> float:
        """Return the derivative by t at t, exact; ComputationError where there is none."""
        return self.scale * self._finite(Dual(float(t), 1.0), "rate", t)

    def _finite(self, argument: Any, what: str, t: float) -> float:
        try:
            result = self.function(argument)
        except ZeroDivisionError:
            reason = "it divides by zero"
        except OverflowError:
            reason = "it is too large"
        except ValueError:
            reason = "a square root or a power is not real"
        else:
            value = (result.d if isinstance(result, Dual) else
                     0.0 if what == "rate" else float(result))
            if math.isfinite(value):
                return value
            reason = f"it is {value}"
        raise ComputationError(f"the expression '{self.value_}' has no {what} at "
                               f"{self.variable} = {t:g}: {reason}", at={self.variable: t},
                               advice="guard the expression with 'a if c else b'")


Amplitude = Constant | Ramp | Table | Sine | Expression
