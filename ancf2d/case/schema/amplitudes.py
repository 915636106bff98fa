"""Amplitudes: a factor over time, or over the load factor in static cases."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Any

from .. import jets
from ..binder import INVALID, Binder, Issue, Path, dotted
from ..declare import key, record
from ..kinds import Flag, ListOf, Number, Text
from ..nodes import Mark, Node, Scalar
from ..programs import Assembler, Function
from ..syntax import ExpressionError, Tree, formula, quantities_of, syntax

SCALE_DOC = "Factor by which the amplitude is multiplied"


@record
class Constant(Function):
    """The same value at all times."""

    tag = "constant"
    polynomial = constant = True
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    def emit(self, out: Assembler) -> None:
        """Append the instructions that put it on the stack, without its scale."""
        out.emit(jets.NUMBER, 1, 1.0)


@record
class Ramp(Function):
    """Rises from 0 at t0 to 1 at t1 and stays there."""

    tag = "ramp"
    polynomial = True
    t0: float = key(Number("s"), "Start of the rise", default=0.0)
    t1: float = key(Number("s"), "End of the rise", default=1.0)
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the ramp does not run forward in time."""
        if not self.t0 < self.t1:
            yield Issue(("t1",), f"{{}}: t0 must be less than t1, got t0 {self.t0:g} "
                        f"and t1 {self.t1:g}")

    @property
    def knots(self) -> tuple[float, ...]:  # type: ignore[override]
        """The times at which its slope jumps."""
        return self.t0, self.t1

    def emit(self, out: Assembler) -> None:
        """Append the instructions that put it on the stack, without its scale."""
        out.emit(jets.RAMP, 1, self.t0, self.t1)


@record
class Table(Function):
    """Values at times, constant before the first and after the last."""

    tag = "table"
    polynomial = True
    t: tuple[float, ...] = key(ListOf(Number("s"), "numbers", 1), "Times, in ascending order",
                               example=[0, 1, 2])
    value_: tuple[float, ...] = key(ListOf(Number(), "numbers", 1), "Value at each time",
                                    example=[0, 1, 0])
    smooth: bool = key(Flag(), "Interpolate with monotone cubics of continuous slope, level at both ends, instead of "
                       "straight lines; between two points the curve stays between their values",
                       default=False)
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the lists have different lengths, or the times do not increase."""
        if len(self.t) != len(self.value_):
            yield Issue(("value",), f"{{}}: t has {len(self.t)} numbers and value has "
                        f"{len(self.value_)}", "as many values as times")
        for i in range(1, len(self.t)):
            last, t = self.t[i - 1:i + 1]
            if not last < t:
                yield Issue(("t", i), f"{{}}.t must increase, got {t:g} after {last:g}", "" if t < last else
                            f"ascending times, or for a jump an expression such as '1 if t < {t:g} else 0'")
                break

    @property
    def knots(self) -> tuple[float, ...]:  # type: ignore[override]
        """The times at which it may not be smooth."""
        return self.t

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
                mean = w0 / d0 + w1 / d1
                slopes[i] = (w0 + w1) / mean if mean else math.copysign(math.inf, d0)
        return tuple(slopes)

    def emit(self, out: Assembler) -> None:
        """Append the instructions that put it on the stack, without its scale."""
        out.emit(jets.SMOOTH_TABLE if self.smooth else jets.TABLE, 1, len(self.t), *self.t, *self.value_,
                 *self.slopes)


@record
class Sine(Function):
    """sin(2 pi frequency t + phase)."""

    tag = "sine"
    frequency: float = key(Number("Hz", ge=0), "Frequency, in Hz", example=2)
    phase: float = key(Number("rad"), "Phase", default=0.0)
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    def emit(self, out: Assembler) -> None:
        """Append the instructions that put it on the stack, without its scale."""
        out.emit(jets.SINE, 1, 2 * math.pi * self.frequency, self.phase)


class ExpressionText(Text):
    """Text in the expression language; a number is accepted as a constant expression.

    ``local`` are quantities that it may use besides the variable and the parameters of the case; with ``feedback`` it
    may also use quantities of probes, and controllers.
    """

    def __init__(self, variable: str = "t", local: tuple[str, ...] = (), feedback: bool = False) -> None:
        super().__init__(f"an expression in {', '.join((variable, *local))}", number=True)
        self.variable, self.local, self.feedback = variable, local, feedback

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        text = super().bind(node, path, binder)
        if text is INVALID:
            return INVALID
        try:
            return formula(text, binder.names(self.variable, self.local, self.feedback))
        except ExpressionError as error:
            for one in error.each:
                binder.fail(place_inside(node, one.column), path, f"{dotted(path)}: {one}", near=one.near)
            return INVALID


def place_inside(node: Node, column: int) -> Mark:
    """Return the mark of a character inside a scalar, or of the scalar if the file writes its text differently."""
    mark = node.mark
    if not isinstance(node, Scalar) or not 0 < mark.line <= len(mark.origin.lines):
        return mark
    start = mark.column + (0 if node.plain else 1)
    written = mark.origin.lines[mark.line - 1][start - 1:]
    return Mark(mark.origin, mark.line, start + column) if written.startswith(node.text) else mark


@record
class Expression(Function):
    """A formula in t: + - * / ^, comparisons, sin cos exp sqrt abs, pi, ``a if c else b``, parameters.

    In dynamic cases it may use probes and controllers, too: the load then depends on the motion.
    """

    tag = "expression"
    variable = "t"
    value_: str = key(ExpressionText(feedback=True), "The formula",
                      example="sin(2*pi*t) if t < 0.5 else 0")
    scale: float = key(Number(), SCALE_DOC, default=1.0)

    @cached_property
    def tree(self) -> Tree:  # type: ignore[override]
        """The formula as a tree, parsed once."""
        return syntax(self.value_, self.variable)

    def emit(self, out: Assembler) -> None:
        """Append the instructions that put it on the stack, without its scale."""
        out.tree(self.tree)

    def described(self) -> str:
        """Return the name of the expression for messages."""
        return f"the expression '{self.value_}'"

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities of a motion that the formula uses: of probes, and controllers."""
        return quantities_of(self.value_)


Amplitude = Constant | Ramp | Table | Sine | Expression
