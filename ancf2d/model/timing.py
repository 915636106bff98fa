"""Signals of loads and prescribed motions over the load factor or time, and the times at which these act."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from ..case import Active, Amplitude, Latch, amplitude_of
from ..case.programs import Function


@dataclass(frozen=True)
class Signal:
    """A function offset + factor * amplitude(t) of time, with amplitude 1 if None.

    Kernels evaluate signals as programs, which also return the two derivatives.
    """

    # feedback: the value depends on the motion; clocked: ``derivatives`` returns the time instead of the rate
    feedback = clocked = False

    amplitude: Function | None = None
    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, t: float) -> float:
        """Return the value at time t; raises ComputationError if an expression has none."""
        return self.offset + self.factor * (1.0 if self.amplitude is None else self.amplitude.value(t))

    def rate(self, t: float) -> float:
        """Return the time derivative, at a corner the one to its right; raises ComputationError if there is none."""
        return 0.0 if self.amplitude is None else self.factor * self.amplitude.rate(t)

    def derivatives(self, t: float) -> tuple[float, float, float]:
        """Return the value at time t and its first two derivatives, nan where undefined."""
        if self.amplitude is None:
            return self.offset + self.factor, 0.0, 0.0
        value, rate, second = self.amplitude.jet(t)
        return self.offset + self.factor * value, self.factor * rate, self.factor * second


@dataclass(frozen=True)
class FeedbackSignal(Signal):
    """A signal that depends on quantities of the motion; its value is that of the last evaluated state."""

    feedback = True

    level: list[float] = field(default_factory=lambda: [math.nan], compare=False)

    def __call__(self, t: float) -> float:
        """Return the value at the last evaluated state."""
        return self.level[0]

    def rate(self, t: float) -> float:
        """Return 0: the rate depends on the motion."""
        return 0.0

    def derivatives(self, t: float) -> tuple[float, float, float]:
        """Return the value at the last evaluated state, with zero rates."""
        return self.level[0], 0.0, 0.0


@dataclass(frozen=True)
class Clocked(Signal):
    """A signal that has the time instead of its rate, for loads that are formulas in t."""

    clocked = True

    def derivatives(self, t: float) -> tuple[float, float, float]:
        """Return the value at time t, and the time."""
        return self(t), t, 0.0


# a function of load factor or time
TimeFunction = Callable[[float], float]


def rates_of(course: TimeFunction | None, t: float) -> tuple[float, float]:
    """Return the first two time derivatives of a load's or motion's course; 0 if it is no signal."""
    return course.derivatives(t)[1:] if isinstance(course, Signal) else (0.0, 0.0)


class Timing:
    """Timing over a load factor: without an amplitude of their own, loads and motions follow the load factor."""

    def __call__(self, t: float) -> float:
        """Return the default amplitude at load factor or time t."""
        return t

    def function_of(self, amplitude: Amplitude | None) -> TimeFunction:
        """Return the factor of a load."""
        return self if amplitude is None else amplitude.value

    def window(self, active: Active | None) -> Active | Latch | None:
        """Return the window in which something acts."""
        return active

    def factor(self, load: Any) -> TimeFunction:
        """Return the factor of a load, zero while it does not act."""
        return self.function_of(amplitude_of(load, self.window(getattr(load, "active", None))))

    def motion(self, value: float | Amplitude, start: float) -> TimeFunction:
        """Return the change of a prescribed motion from ``start``, its value in the reference.

        A plain number is reached in proportion to the default amplitude.
        """
        if isinstance(value, int | float):
            way = float(value) - start
            return lambda t: way * self(t)
        return Signal(value, 1.0, -start)

    @contextmanager
    def preload(self) -> Iterator[None]:
        """Return a context in which t scales the constant part; here it has no effect."""
        yield


class TimeTiming(Timing):
    """Timing over time: without an amplitude, loads are constant. Everything is a Signal, which kernels can evaluate.

    ``feedback`` are the signals that depend on the motion, each once; ``latches`` switch by conditions.
    """

    def __init__(self) -> None:
        self.feedback: dict[Amplitude, FeedbackSignal] = {}
        self.latches: dict[Active, Latch] = {}

    def window(self, active: Active | None) -> Active | Latch | None:
        """Return the window in which something acts; items that wait for the same conditions share one latch."""
        if active is None or not active.waits:
            return active
        return self.latches.setdefault(active, Latch(active))

    def function_of(self, amplitude: Amplitude | None) -> Signal:
        """Return the factor of a load."""
        if amplitude is not None and amplitude.quantities:
            return self.feedback.setdefault(amplitude, FeedbackSignal(amplitude))
        return Signal(amplitude)

    def motion(self, value: float | Amplitude, start: float) -> Signal:
        """Return the change of a prescribed motion from ``start``; a plain number is constant in time."""
        if isinstance(value, int | float):
            return Signal(None, float(value), -start)
        return Signal(value, 1.0, -start)


class InputMotion:
    """A prescribed motion that is an input of small motions: at rest, with oscillation ``amplitude``."""

    def __init__(self, name: str, amplitude: float) -> None:
        self.name, self.amplitude = name, amplitude

    def __call__(self, t: float) -> float:
        """Return 0."""
        return 0.0


class InputTiming(Timing):
    """Timing of motions that are inputs of small motions: at rest in the state of linearisation."""

    def __init__(self, name: str) -> None:
        self.name = name

    def motion(self, value: float | Amplitude, start: float) -> InputMotion:
        """Return the motion whose amplitude is the prescribed number, or the scale of its amplitude over time."""
        return InputMotion(self.name, float(value) if isinstance(value, int | float) else value.scale)


class PathTiming(Timing):
    """Timing along a path: the load factor scales loads without an amplitude; others have their value for t = 1.

    While ``preloading``, t scales the constant part from the reference and the rest is absent: a path starts at load
    factor 0 from the equilibrium of the constant part. ``constant``: whether there is such a part.
    """

    def __init__(self) -> None:
        self.preloading = self.constant = False

    def __call__(self, t: float) -> float:
        """Return the load factor, 0 while preloading."""
        return 0.0 if self.preloading else t

    def function_of(self, amplitude: Amplitude | None) -> TimeFunction:
        """Return the factor of a load; while preloading, a constant one is scaled by t."""
        return self if amplitude is None else self._hold(amplitude.value(1.0))

    def motion(self, value: float | Amplitude, start: float) -> TimeFunction:
        """Return the change of a prescribed motion from ``start``; while preloading, a constant one is scaled by t."""
        if isinstance(value, int | float):
            return super().motion(value, start)
        return self._hold(value.value(1.0) - start)

    def _hold(self, value: float) -> TimeFunction:
        self.constant = True
        return lambda t: value * t if self.preloading else value

    @contextmanager
    def preload(self) -> Iterator[None]:
        """Return a context in which t scales the constant part."""
        self.preloading = True
        try:
            yield
        finally:
            self.preloading = False
