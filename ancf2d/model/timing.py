"""When loads and prescribed motions act: over the load factor or time, or, along a path, scaled or constant."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Signal = Callable[[float], float]


class Timing:
    """What a load or motion follows: the default where it has no amplitude of its own, else that amplitude."""

    def __init__(self, default: Signal) -> None:
        self.default = default

    def __call__(self, t: float) -> float:
        """Return the default amplitude at load factor or time t."""
        return self.default(t)

    def given(self, signal: Signal, start: float = 0.0) -> Signal:
        """Return what follows an amplitude of its own; ``start`` is its value in the reference."""
        return signal

    @contextmanager
    def preload(self) -> Iterator[None]:
        """Return a block in which t raises what is constant: nothing here."""
        yield


class PathTiming(Timing):
    """Along a path the load factor scales what has no amplitude; the rest is constant, at its value for t = 1.

    While ``preloading``, t raises the constant part from the reference and the rest is absent: a path begins
    at load factor 0 from the equilibrium of what is constant. ``constant`` tells whether there is any.
    """

    def __init__(self) -> None:
        super().__init__(self._scaled)
        self.preloading = self.constant = False

    def _scaled(self, t: float) -> float:
        return 0.0 if self.preloading else t

    def given(self, signal: Signal, start: float = 0.0) -> Signal:
        """Return the constant value, raised from ``start`` while preloading."""
        self.constant = True
        value = signal(1.0)
        return lambda t: start + (value - start) * t if self.preloading else value

    @contextmanager
    def preload(self) -> Iterator[None]:
        """Let t raise the constant part inside the block."""
        self.preloading = True
        try:
            yield
        finally:
            self.preloading = False
