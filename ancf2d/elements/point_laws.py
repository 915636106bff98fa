"""Point laws of springs, dampers, rotating loads and constraints: functions of a few fields and their rates.

The fields are p = p0 + u with rates w: components of positions, section directions in the frame of their reference
(p0 = (length, 0)), section rotations, and, last, the multiplier of a constraint. ``forces(p0, u, w, par, a, mem, f,
H, C)`` returns (energy, dissipated power) and fills generalised forces f (with the sign of elastic forces),
H = df/du and C = df/dw, all zero on entry. ``mean(p0, u0, u1, w, par, a0, a1, mem, f)`` returns the energy at u1 and
the dissipated power, and fills the forces of a step from u0 to u1 with mean rates w: forces with a potential do
exactly its difference as work on u1 - u0, and conserve angular momentum between fields that rotate together;
constraints satisfy g = 0 at u1, with a discrete gradient that does the work of the change of g. The amplitude
a = (value, rate, second rate) is that of the load; a field prescribed by a signal has the value of that signal.
``par`` are constants; ``mem`` holds the last angles of directions whose turns are counted.

The functions use only numbers and arrays, so that the kernels can compile them unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

# how the rotation of a section is given: none (the ground), a field theta, or two fields of a direction
GROUND, THETA, DIRECTION = 0, 1, 2
MAX_PAR, MAX_MEM = 8, 2
# greatest number of signals that prescribe fields of one law
MAX_SIGNALS = 3
# greatest number of constants of a spring or load, without those that place it
MAX_CONSTANTS = 5


def angle_near(x, ux, uy, near):  # type: ignore[no-untyped-def]
    """Return the angle from direction (x, 0) to (x + ux, uy), on the full turn nearest to ``near``."""
    angle = np.arctan2(uy, x + ux)
    return angle + 2.0 * np.pi * np.floor((near - angle) / (2.0 * np.pi) + 0.5)


def half_sine(x):  # type: ignore[no-untyped-def]
    """Return sin(x/2)/(x/2)."""
    if abs(x) < 1e-3:
        return 1.0 - x * x / 24.0
    return np.sin(0.5 * x) / (0.5 * x)


def turn_hessian(px, py, at, factor, H):  # type: ignore[no-untyped-def]
    """Add factor d2theta/dp2 to H, where theta is the angle of the direction p in fields at and at + 1."""
    q = factor / (px * px + py * py) ** 2
    H[at, at] += 2.0 * px * py * q
    H[at, at + 1] += (py * py - px * px) * q
    H[at + 1, at] += (py * py - px * px) * q
    H[at + 1, at + 1] -= 2.0 * px * py * q


def match_work(f, u0, u1, work, after, before, m):  # type: ignore[no-untyped-def]
    """Change the mid-step force f (m,) so that it does the given work on u1 - u0; ``after``, ``before``: at its ends.

    f is scaled (or the force at an end, if f vanishes), so that an obstacle pushes along its normal only. If that would
    take a larger force than at all three places, e.g. where a point passes along a curve, the least change of f in norm
    is added instead (Gonzalez 2000).
    """
    along, square, least_work = 0.0, 0.0, work
    middle, end, start = 0.0, 0.0, 0.0
    for i in range(m):
        change = u1[i] - u0[i]
        middle, end, start = middle + f[i] * f[i], end + after[i] * after[i], start + before[i] * before[i]
        square, least_work = square + change * change, least_work - f[i] * change
    push = f if middle > 0.0 else (after if end > 0.0 else before)
    own = middle if middle > 0.0 else (end if end > 0.0 else start)
    for i in range(m):
        along += push[i] * (u1[i] - u0[i])
    if work * along > 0.0 and work * work * own <= (1.0 + 1e-6) * max(middle, end, start) * along * along:
        share = work / along
        for i in range(m):
            f[i] = share * push[i]
    elif square > 0.0:
        for i in range(m):
            f[i] += least_work / square * (u1[i] - u0[i])


def with_multiplier(g, u, f, H):  # type: ignore[no-untyped-def]
    """Replace the gradient f and Hessian H of g by those of lambda g, where lambda is the last field."""
    m = len(u) - 1
    for i in range(m):
        for j in range(m):
            H[i, j] *= u[m]
        H[i, m] = f[i]
        H[m, i] = f[i]
        f[i] *= u[m]
    f[m] = g


@dataclass(frozen=True)
class PointLaw:
    """A point law: its forces at a state, its forces over a step, and its history variables.

    ``symmetric``: whether H is symmetric; ``constraint``: whether the last field is a multiplier. ``accept(p0, u, par,
    mem)`` updates ``mem`` at an accepted state. The functions may call other functions of numbers and arrays, and
    allocate arrays by ``work_vector`` and ``work_matrix``. If the item does not act, ``forces`` may return the power
    APART and, instead of the energy, a sum of changes of fields below which it cannot act.

    ``forces_of_run`` and ``accept_run`` do the same for many items that share their fields (``Items.runs``); ``par``
    and ``mem`` then have one row per item, and forces and energies are sums. H and C have size 0 if ``forces_of_run``
    is called for forces only.
    """

    name: str
    forces: Callable[..., Any]
    mean: Callable[..., Any]
    symmetric: bool = True
    constraint: bool = False
    accept: Callable[..., Any] | None = None
    forces_of_run: Callable[..., Any] | None = None
    accept_run: Callable[..., Any] | None = None


# dissipated power that signals that no item acts
APART = -np.inf

# formulas of a case by the address stored in laws, and the function that evaluates them; compiled laws use others
FORMULA_RECORDS: dict[int, Any] = {}
RUN: list[Callable[..., Any]] = []


def formula_at(address):  # type: ignore[no-untyped-def]
    """Return the formula at an address, with ``values`` (n,) of its quantities and ``out`` (1 + n,) for its results."""
    return FORMULA_RECORDS[int(address)]


def evaluate_formula(formula, k, s):  # type: ignore[no-untyped-def]
    """Fill ``formula.out`` with function k at s and ``formula.values``, and its derivatives by these values."""
    RUN[0](formula.programs, k, s, formula.values, formula.out)


def work_vector(n):  # type: ignore[no-untyped-def]
    """Return zeros (n,), valid only during the call of the law; do not call in loops, do not return."""
    return np.zeros(n)


def work_matrix(n, m):  # type: ignore[no-untyped-def]
    """Return zeros (n, m), with the same restrictions as ``work_vector``."""
    return np.zeros((n, m))
