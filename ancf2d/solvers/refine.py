"""Linear solves with all digits that the model holds, beyond those of its assembled matrix."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..elements.shape import Array

# relative corrections that small are round-off of the result itself
GOAL = 1e-15
# rounds begin from the residual itself; within one, conjugate directions gain this factor in so many steps at most
ROUNDS, GAIN, STEPS = 5, 1e-4, 20
# what is known no better may be round-off alone
DOUBTFUL = 1e-8

Map = Callable[[Array], Array]


def refined(apply: Map, precondition: Map, norm: Callable[[Array], float], b: Array, floor: float,
            still: Callable[[], float] = lambda: 0.0) -> tuple[Array, float]:
    """Return z with A z = b, and how far z is known, relative to its size: no better than ``floor``.

    ``apply`` is A with all its digits (through the strains), ``precondition`` solves with the factors of the assembled
    matrix, in which round-off of the stiff motions can hide the soft ones of long or many elements. Where z is in doubt
    and no larger than ``still()``, what round-off of the forces alone does, nothing moves. z is not finite where the
    factors are not.
    """
    z, known = _refined(apply, precondition, norm, b, floor)
    if known > DOUBTFUL and np.isfinite(norm(y := precondition(b))) and norm(y) <= still():
        # what there is to know is in multipliers
        return y, 0.0
    return z, known


def _refined(apply: Map, precondition: Map, norm: Callable[[Array], float], b: Array, floor: float,
             ) -> tuple[Array, float]:
    """Return z and how far it is known.

    Where plain refinement would not contract, conjugate directions with the factors do: one step for each motion that
    is wrong in them. Where these do not find the solution either, no digit is known: infinity.
    """
    z, known = np.zeros_like(b), np.inf
    for _ in range(ROUNDS):
        r = b - apply(z) if z.any() else b.copy()
        y = precondition(r)
        change, size = norm(y), norm(z)
        if not np.isfinite(change):
            return (y, np.inf) if size == 0.0 else (z, known)
        if change == size == 0.0:
            # nothing moves: y corrects the multipliers
            return z + y, 0.0
        if change <= max(GOAL, 0.1 * floor) * size:
            # the norm does not see multipliers, which y may still correct by much
            return z + y, max(change / size, floor)
        if size > 0.0 and change >= 0.5 * known * size:
            return z, max(known, floor)
        known = change / size if size > 0.0 else np.inf
        more, gained = _directions(apply, precondition, norm, r, y)
        z = z + more
        if not gained:
            return z, np.inf
    return z, max(known, floor)


def _directions(apply: Map, precondition: Map, norm: Callable[[Array], float], r: Array, y: Array,
                ) -> tuple[Array, bool]:
    """Return an approximate A^-1 r by preconditioned conjugate gradients, and whether it is one (y = M^-1 r)."""
    z, p, wanted = np.zeros_like(r), y, GAIN * norm(y)
    rho = float(r @ y)
    if rho == 0.0:
        # multipliers alone can do no work: plain refinement
        return y, True
    for _ in range(STEPS):
        Ap = apply(p)
        curvature = float(p @ Ap)
        if curvature == 0.0 or not np.isfinite(curvature):
            return z, False
        z = z + (rho / curvature) * p
        new = r - (rho / curvature) * Ap
        y = precondition(new)
        if norm(y) <= wanted:
            return z, True
        # Polak and Ribiere's form, as the factors are not exactly symmetric in finite digits
        rho, beta = float(new @ y), float((new - r) @ y) / rho
        if rho == 0.0:
            return z, True
        r, p = new, y + beta * p
    return z, False
