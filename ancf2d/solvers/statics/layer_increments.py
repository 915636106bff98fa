"""Increments of Newton's method on contact layers: shortened if they overshoot, accelerated if they are slow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...elements.shape import Array

# an increment overshoots if the residual at its end opposes it, with more than this share of the work at its start
TOO_FAR = 0.5
# the search ends if the work of the residual is below this share of that at the start, or after some evaluations
FOUND, MOST = 0.2, 12
# increments are slow if each is more than this share of the one before; number of earlier ones that predict the next
SLOW, MEMORY = 0.3, 3


class LayerIncrements:
    """The increments of one solution by Newton's method, in a model with contact layers.

    Between sets of pressing points, full increments may go to and fro for ever. The energy of layers is convex where
    bodies hardly rotate, and has a minimum along each increment, where the residual does no work on it (Nocedal &
    Wright 2006, chapter 3). With friction, tangents omit terms, so increments may decrease slowly; then those before
    predict the limit (Anderson 1965). ``weights`` (n,) of the variables, which are the unknowns and on paths the load
    factor, give the size of an increment.
    """

    def __init__(self, weights: Array) -> None:
        self.weights = weights
        # the last increment (n,), and the work of the residual on it at its start
        self.step: Array = np.zeros(0)
        self.work = 0.0
        # variables and increments (n,) since the last one that was shortened
        self.known: list[tuple[Array, Array]] = []

    def next(self, before: Array, z: Array, R: Array) -> Array:
        """Return the increment of the variables ``before`` to be made, (n,), for that of Newton's method, z.

        R (n_unknowns,) is the residual before it.
        """
        last = self._size(self.known[-1][1]) if self.known else 0.0
        slow = SLOW * last < self._size(z) < last
        self.known = [*self.known[-MEMORY:], (before, z.copy())]
        self.step = self._accelerated() if slow else z.copy()
        self.work = self._work(R)
        return self.step

    def _size(self, z: Array) -> float:
        return float(np.abs(self.weights * z).max(initial=0.0))

    def _work(self, R: Array) -> float:
        return float(self.step[:len(R)] @ R)

    def _accelerated(self) -> Array:
        """Return the increment to the point at which, by the last increments, Newton's method would stand still."""
        x, z = (np.array(each) for each in zip(*self.known, strict=True))
        changes, weights = np.diff(z, axis=0), self.weights
        shares = np.linalg.lstsq((weights * changes).T, weights * z[-1], rcond=1e-8)[0]
        return z[-1] - shares @ (np.diff(x, axis=0) + changes)

    def shortened(self, R: Array, residual: Callable[[Array], Array]) -> bool:
        """Return whether the last increment overshoots and was shortened, for the residual R at its end.

        ``residual(x)`` sets the variables to x (n,) and returns the residual there; the last x is where to go on.
        """
        end = self._work(R) if len(self.step) else 0.0
        if self.work >= 0.0 or end <= -TOO_FAR * self.work:
            return False
        before, self.known = self.known[-1][0], []
        low, high, at_low, at_high = 0.0, 1.0, self.work, end
        for _ in range(MOST):
            s = low + (high - low) * min(max(at_low / (at_low - at_high), 0.1), 0.9)
            found = self._work(residual(before + s * self.step))
            if abs(found) <= -FOUND * self.work:
                break
            if found < 0.0:
                low, at_low = s, found
            else:
                high, at_high = s, found
        return True
