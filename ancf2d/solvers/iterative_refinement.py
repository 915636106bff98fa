"""Linear solves with the full accuracy of the model, beyond that of its assembled matrix."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..elements.shape import Array

# relative corrections that are round-off of the result itself
GOAL = 1e-15
# number of rounds, each from a new residual; reduction of the error per round, and largest number of its steps
ROUNDS, GAIN, STEPS = 5, 1e-4, 20
# results with a larger relative error may be round-off alone
DOUBTFUL = 1e-8

Map = Callable[[Array], Array]


def refined(apply: Map, precondition: Map, norm: Callable[[Array], float], b: Array, floor: float,
            noise: Callable[[], float] = lambda: 0.0) -> tuple[Array, float]:
    """Return z with A z = b, and its relative error, which is at least ``floor``.

    ``apply`` is A with full accuracy (through the strains). ``precondition`` solves with the factors of the assembled
    matrix, where round-off of stiff motions can hide the soft ones of long bodies or many elements. If z is inaccurate
    and no larger than ``noise()``, the effect of round-off in the forces, nothing moves. z is not finite if the factors
    are not.
    """
    z, known = _refined(apply, precondition, norm, b, floor)
    if known > DOUBTFUL and np.isfinite(norm(y := precondition(b))) and norm(y) <= noise():
        # only the multipliers are nonzero
        return y, 0.0
    return z, known


def _refined(apply: Map, precondition: Map, norm: Callable[[Array], float], b: Array, floor: float,
             ) -> tuple[Array, float]:
    """Return z and its relative error.

    Where simple refinement would not converge, conjugate gradients with the factors do, with one step for each motion
    that is wrong in the factors. If they fail, too, the error is infinite.
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
            # the norm ignores multipliers, to which y may still be a large correction
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
    """Return an approximate A^-1 r by preconditioned conjugate gradients, and whether they converged (y = M^-1 r).

    Overwrites r and y.
    """
    z, p, wanted = np.zeros_like(r), y, GAIN * norm(y)
    rho = float(r @ y)
    if rho == 0.0:
        # only multipliers are nonzero, and these do no work: simple refinement
        return y, True
    for _ in range(STEPS):
        Ap = apply(p)
        curvature = float(p @ Ap)
        if curvature == 0.0 or not np.isfinite(curvature):
            return z, False
        z += (rho / curvature) * p
        Ap *= rho / curvature
        new = np.subtract(r, Ap, out=Ap)
        y = precondition(new)
        if norm(y) <= wanted:
            return z, True
        # Polak-Ribiere formula, because of round-off the factors are not exactly symmetric
        rho, beta = float(new @ y), float(np.subtract(new, r, out=r) @ y) / rho
        if rho == 0.0:
            return z, True
        p *= beta
        p += y
        r = new
    return z, False
