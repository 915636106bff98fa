"""What loads and prescribed motions of a dynamic case follow: an amplitude over time, scaled and shifted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..case import Amplitude


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
        if self.amplitude is None:
            return self.offset + self.factor, 0.0, 0.0
        value, rate, second = self.amplitude.jet(t)
        return self.offset + self.factor * value, self.factor * rate, self.factor * second


def rates_of(course: Callable[[float], float] | None, t: float) -> tuple[float, float]:
    """Return the first two derivatives by time of what a load or motion follows; only signals have any."""
    return course.derivatives(t)[1:] if isinstance(course, Signal) else (0.0, 0.0)
