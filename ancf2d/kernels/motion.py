"""The state that time stepping carries from step to step, and what a step answers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

# numbers that go from step to step; LIMIT: of adaptive steps since Newton's method failed at a longer one, 0 for none
TIME, STEP_SIZE, CONTRACTION, SIZE, OLD_ERROR, OLD_STEP, WORK, LOST, COUNT, GRID, REJECTED, TRIES, LIMIT = range(13)
# of a tangent that serves several steps: its time, their length (0: none), how many, what it and they cost
HELD_TIME, HELD_STEP, HELD_STEPS, HELD_COST = range(13, 17)
NUMBERS = 17

# what a step answers
DONE, NOT_CONVERGED, NOT_FINITE, SINGULAR = range(4)


class Motion(NamedTuple):
    """z, v, a : (n,) unknowns (multipliers included), their rates and second rates at the time numbers[TIME].

    extra : (k, n) what a method keeps of earlier steps; numbers : step sizes, error and work so far (see above);
    turned : (2, sections) rotations, counted through full turns, and their rates, of ``kernels.points.Turning``.
    """

    z: Any
    v: Any
    a: Any
    extra: Any
    numbers: Any
    turned: Any


class Step(NamedTuple):
    """Where a step ends: z, v, a (n,), dense (k, n): what the interpolation over the step is made of."""

    z: Any
    v: Any
    a: Any
    dense: Any


def motion(n: int, kept: int, sections: int) -> Motion:
    """Return a motion of n unknowns at rest, with ``kept`` rows for the method and sections whose turns count."""
    out = Motion(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((kept, n)), np.zeros(NUMBERS),
                 np.zeros((2, sections)))
    # how fast Newton converges is not known yet
    out.numbers[CONTRACTION] = 1.0
    return out
