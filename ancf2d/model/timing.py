"""When loads and prescribed motions act: their signals over the load factor or time, and what they must be."""

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
    """offset + factor * amplitude(t) over time; without an amplitude, constant 1 stands in its place.

    Kernels take signals as programs, which also give the two rates.
    """

    # whether only the motion tells its value; whether it tells the time in the place of its rate
    fed = clocked = False

    amplitude: Function | None = None
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
        if self.amplitude is None:
            return self.offset + self.factor, 0.0, 0.0
        value, rate, second = self.amplitude.jet(t)
        return self.offset + self.factor * value, self.factor * rate, self.factor * second


@dataclass(frozen=True)
class Answer(Signal):
    """A signal that is a function of quantities of the motion; it has the value of the state last looked at."""

    fed = True

    level: list[float] = field(default_factory=lambda: [math.nan], compare=False)

    def __call__(self, t: float) -> float:
        """Return the value at the state last looked at."""
        return self.level[0]

    def rate(self, t: float) -> float:
        """Return 0: the motion tells how it changes."""
        return 0.0

    def derivatives(self, t: float) -> tuple[float, float, float]:
        """Return the value at the state last looked at."""
        return self.level[0], 0.0, 0.0


@dataclass(frozen=True)
class Clocked(Signal):
    """A signal that tells the time in the place of its rate: what loads follow that are formulas in t."""

    clocked = True

    def derivatives(self, t: float) -> tuple[float, float, float]:
        """Return the value at time t, and the time."""
        return self(t), t, 0.0


def rates_of(course: Callable[[float], float] | None, t: float) -> tuple[float, float]:
    """Return the first two derivatives by time of what a load or motion follows; only signals have any."""
    return course.derivatives(t)[1:] if isinstance(course, Signal) else (0.0, 0.0)


Course = Callable[[float], float]


class Timing:
    """What a load or motion follows: the load factor where it has no amplitude of its own, else that amplitude."""

    def __call__(self, t: float) -> float:
        """Return what stands for a missing amplitude at load factor or time t."""
        return t

    def follow(self, amplitude: Amplitude | None) -> Course:
        """Return the factor on a load."""
        return self if amplitude is None else amplitude.value

    def window(self, active: Active | None) -> Active | Latch | None:
        """Return what tells when something acts."""
        return active

    def factor(self, load: Any) -> Course:
        """Return the factor on a load, zero while it does not act."""
        return self.follow(amplitude_of(load, self.window(getattr(load, "active", None))))

    def motion(self, value: float | Amplitude, start: float) -> Course:
        """Return how far a prescribed motion is from ``start``, its value in the reference.

        A number is reached by what stands for a missing amplitude.
        """
        if isinstance(value, int | float):
            way = float(value) - start
            return lambda t: way * self(t)
        return Signal(value, 1.0, -start)

    @contextmanager
    def preload(self) -> Iterator[None]:
        """Return a block in which t raises what is constant: nothing here."""
        yield


class TimeTiming(Timing):
    """Over time: what has no amplitude is constant. Everything is a Signal, which kernels can evaluate.

    ``answers`` are those that are functions of the motion, each once, ``latches`` tell when things act that wait for
    conditions.
    """

    def __init__(self) -> None:
        self.answers: dict[Amplitude, Answer] = {}
        self.latches: dict[Active, Latch] = {}

    def window(self, active: Active | None) -> Active | Latch | None:
        """Return what tells when something acts: of what waits for the same conditions, the same."""
        if active is None or not active.waits:
            return active
        return self.latches.setdefault(active, Latch(active))

    def follow(self, amplitude: Amplitude | None) -> Signal:
        """Return the factor on a load."""
        if amplitude is not None and amplitude.quantities:
            return self.answers.setdefault(amplitude, Answer(amplitude))
        return Signal(amplitude)

    def motion(self, value: float | Amplitude, start: float) -> Signal:
        """Return how far a prescribed motion is from ``start``; a number is the value at all times."""
        if isinstance(value, int | float):
            return Signal(None, float(value), -start)
        return Signal(value, 1.0, -start)


class Drive:
    """What a prescribed motion follows that is an input of small motions: it rests, and ``amplitude`` oscillates."""

    def __init__(self, name: str, amplitude: float) -> None:
        self.name, self.amplitude = name, amplitude

    def __call__(self, t: float) -> float:
        """Return 0."""
        return 0.0


class InputTiming(Timing):
    """For motions that are inputs: they rest in the state about which they move."""

    def __init__(self, name: str) -> None:
        self.name = name

    def motion(self, value: float | Amplitude, start: float) -> Drive:
        """Return the motion whose amplitude is the number prescribed, or the scale of what it follows over time."""
        return Drive(self.name, float(value) if isinstance(value, int | float) else value.scale)


class PathTiming(Timing):
    """Along a path the load factor scales what has no amplitude; the rest is constant, at its value for t = 1.

    While ``preloading``, t raises the constant part from the reference and the rest is absent: a path begins
    at load factor 0 from the equilibrium of what is constant. ``constant`` tells whether there is any.
    """

    def __init__(self) -> None:
        self.preloading = self.constant = False

    def __call__(self, t: float) -> float:
        """Return the load factor, 0 while preloading."""
        return 0.0 if self.preloading else t

    def follow(self, amplitude: Amplitude | None) -> Course:
        """Return the factor on a load, raised from 0 while preloading where it is constant."""
        return self if amplitude is None else self._hold(amplitude.value(1.0))

    def motion(self, value: float | Amplitude, start: float) -> Course:
        """Return how far a prescribed motion is from ``start``, raised from 0 while preloading where it is constant."""
        if isinstance(value, int | float):
            return super().motion(value, start)
        return self._hold(value.value(1.0) - start)

    def _hold(self, value: float) -> Course:
        self.constant = True
        return lambda t: value * t if self.preloading else value

    @contextmanager
    def preload(self) -> Iterator[None]:
        """Let t raise the constant part inside the block."""
        self.preloading = True
        try:
            yield
        finally:
            self.preloading = False
