"""What loads and prescribed motions of a dynamic case follow: an amplitude over time, scaled and shifted."""

from __future__ import annotations

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
