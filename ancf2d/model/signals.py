"""What loads and prescribed motions of a dynamic case follow: an amplitude over time, scaled and shifted."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..case import Amplitude, Expression, Ramp, Sine, Table, syntax
from ..elements import jets


@dataclass(frozen=True)
class Signal:
    """offset + factor * amplitude(t) over time; without an amplitude, constant 1 stands in its place.

    Kernels take signals as programs, which also give the two rates.
    """

    amplitude: Amplitude | None = None
    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, t: float) -> float:
        """Return the value at time t; ComputationError where an expression has none."""
        return self.offset + self.factor * (1.0 if self.amplitude is None else self.amplitude.value(t))

    def rate(self, t: float) -> float:
        """Return the derivative by t, at a corner the one to its right; ComputationError where there is none."""
        return 0.0 if self.amplitude is None else self.factor * self.amplitude.rate(t)

    def derivatives(self, t: float) -> tuple[float, float, float]:
        """Return the value at time t and its first two derivatives, nan where there is none."""
        out = np.empty((1, 3))
        with np.errstate(all="ignore"):
            jets.run(_program(self), 0, t, out, 0)
        value, rate, second = out[0].tolist()
        return value, rate, second


@lru_cache(maxsize=256)
def _program(signal: Signal) -> jets.Programs:
    return programs([signal])


def rates_of(course: Callable[[float], float] | None, t: float) -> tuple[float, float]:
    """Return the first two derivatives by time of what a load or motion follows; only signals have any."""
    return course.derivatives(t)[1:] if isinstance(course, Signal) else (0.0, 0.0)


class _Assembler:
    """Writes programs of the stack machine."""

    def __init__(self) -> None:
        self.code: list[int] = []
        self.arg: list[int] = []
        self.data: list[float] = []
        self.depth = self.height = 0

    def emit(self, op: int, grows: int, *numbers: float) -> int:
        """Append an instruction with its numbers and by how much the stack grows; return where it is."""
        self.code.append(op)
        self.arg.append(len(self.data))
        self.data += numbers
        self.height += grows
        self.depth = max(self.depth, self.height)
        return len(self.code) - 1

    def land(self, jumps: list[int]) -> None:
        """Let jumps go to what follows."""
        for at in jumps:
            self.arg[at] = len(self.code)

    def amplitude(self, amplitude: Amplitude | None) -> None:
        """Put an amplitude on the stack, without its scale."""
        match amplitude:
            case Ramp():
                self.emit(jets.RAMP, 1, amplitude.t0, amplitude.t1)
            case Table():
                self.emit(jets.SMOOTH_TABLE if amplitude.smooth else jets.TABLE, 1,
                          len(amplitude.t), *amplitude.t, *amplitude.value_, *amplitude.slopes)
            case Sine():
                self.emit(jets.SINE, 1, 2 * math.pi * amplitude.frequency, amplitude.phase)
            case Expression():
                self.tree(amplitude.tree)
            case _:
                self.emit(jets.NUMBER, 1, 1.0)

    def tree(self, tree: syntax.Tree) -> None:
        """Put an expression on the stack."""
        match tree:
            case syntax.Constant(value):
                self.emit(jets.NUMBER, 1, value)
            case syntax.Time():
                self.emit(jets.TIME, 1)
            case syntax.Negative(operand):
                self.tree(operand)
                self.emit(jets.NEGATE, 0)
            case syntax.Power(base, exponent):
                self.tree(base)
                self.tree(exponent)
                self.emit(jets.POWER, -1)
            case syntax.Chain(first, rest):
                self.tree(first)
                for op, operand in rest:
                    self.tree(operand)
                    self.emit(_BINARY[op], -1)
            case syntax.Call(name, argument):
                self.tree(argument)
                self.emit(_FUNCTIONS[name], 0)
            case syntax.Comparison(first, rest):
                self.comparison(first, rest)
            case syntax.Choice(condition, chosen, other):
                self.choice(condition, chosen, other)

    def comparison(self, first: syntax.Tree, rest: tuple[tuple[str, syntax.Tree], ...]) -> None:
        """Compare from left to right; what fails jumps over the rest."""
        self.tree(first)
        failed = []
        for op, operand in rest[:-1]:
            self.tree(operand)
            self.emit(jets.KEEP, 1)
            self.emit(_COMPARE[op], -1)
            failed.append(self.emit(jets.UNLESS, -1))
        op, operand = rest[-1]
        self.tree(operand)
        self.emit(_COMPARE[op], -1)
        self.land(failed)

    def choice(self, condition: syntax.Tree, chosen: syntax.Tree, other: syntax.Tree) -> None:
        """Evaluate one of two."""
        self.tree(condition)
        otherwise = self.emit(jets.BRANCH, -1)
        self.tree(chosen)
        done = self.emit(jets.JUMP, -1)
        self.land([otherwise])
        self.tree(other)
        self.land([done])


_BINARY = {"+": jets.ADD, "-": jets.SUBTRACT, "*": jets.MULTIPLY, "/": jets.DIVIDE}
_COMPARE = {"<": jets.LESS, "<=": jets.LESS_EQUAL, ">": jets.GREATER, ">=": jets.GREATER_EQUAL, "==": jets.EQUAL,
            "!=": jets.UNEQUAL}
_FUNCTIONS = {"sin": jets.SIN, "cos": jets.COS, "exp": jets.EXP, "sqrt": jets.SQRT, "abs": jets.ABS}


def programs(signals: Sequence[Signal]) -> jets.Programs:
    """Return the programs of signals for ``kernels.amplitudes.evaluate``; there may be none."""
    out, first = _Assembler(), [0]
    for signal in signals:
        out.height = 0
        out.amplitude(signal.amplitude)
        scale = 1.0 if signal.amplitude is None else signal.amplitude.scale
        out.emit(jets.SCALE, 0, signal.factor * scale, signal.offset)
        first.append(len(out.code))
    return jets.Programs(np.array(first, dtype=np.int64), np.array(out.code, dtype=np.int64),
                         np.array(out.arg, dtype=np.int64), np.array(out.data, dtype=np.float64),
                         np.array([-np.inf, np.inf]), np.zeros((3, max(out.depth, 1))))
