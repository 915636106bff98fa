"""What laws of springs, dampers, loads that turn and constraints are made of: functions of the motion of a few fields.

A law sees fields p = p0 + u with rates w: components of positions, section directions in the frame of their
reference (p0 = (length, 0)), section rotations, and, last, the multiplier of a constraint. ``forces(p0, u, w, par,
a, mem, f, H, C)`` returns (energy, dissipated power) and fills what is zero on entry: generalised forces f of elastic
sign, H = df/du and C = df/dw. ``mean(p0, u0, u1, w, par, a0, a1, mem, f)`` returns the energy at u1 and the dissipated
power and fills the forces of a step from u0 to u1 with mean rates w: those with a potential do its exact difference as
work on u1 - u0, and no angular momentum is lost between fields that turn together; of constraints g is met at u1,
with a discrete gradient that does the work of the change of g. The amplitude a = (value, rate, second rate) is that
of the load; a field that a signal prescribes holds that signal. ``par`` are constants, ``mem`` the last angles of
directions whose turns are counted.

Functions of arrays and numbers alone: the kernels compile them as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

# how a section turns: it does not (the ground), by a field theta, or by two fields of a direction
GROUND, THETA, DIRECTION = 0, 1, 2
MAX_PAR, MAX_MEM = 8, 2
# that prescribe fields of one law
MAX_SIGNALS = 3
# of a spring or load, beside what places it
MAX_CONSTANTS = 5


def turn(x, ux, uy, near):  # type: ignore[no-untyped-def]
    """Return the angle from direction (x, 0) to (x + ux, uy), on the turn nearest to ``near``."""
    angle = np.arctan2(uy, x + ux)
    return angle + 2.0 * np.pi * np.floor((near - angle) / (2.0 * np.pi) + 0.5)


def half_sine(x):  # type: ignore[no-untyped-def]
    """Return sin(x/2)/(x/2)."""
    if abs(x) < 1e-3:
        return 1.0 - x * x / 24.0
    return np.sin(0.5 * x) / (0.5 * x)


def turn_hessian(px, py, at, factor, H):  # type: ignore[no-untyped-def]
    """Add factor d2theta/dp2 of the direction p at fields at, at + 1."""
    q = factor / (px * px + py * py) ** 2
    H[at, at] += 2.0 * px * py * q
    H[at, at + 1] += (py * py - px * px) * q
    H[at + 1, at] += (py * py - px * px) * q
    H[at + 1, at + 1] -= 2.0 * px * py * q


def match_work(f, u0, u1, work, after, before, m):  # type: ignore[no-untyped-def]
    """Scale the force f (m,) in the middle of a step, or one at its ends where f vanishes, to do this work.

    So an obstacle pushes along its normal alone. Where that would take more force than at any of the three places, as
    where a point passes along a curve, the change of f of least size does (Gonzalez 2000).
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
    """Turn the gradient in f and the Hessian in H into those of lambda g, lambda the last field."""
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
    """A law: its forces and those of a step, and what it remembers.

    ``symmetric`` tells whether H is, ``constraint`` whether the last field is a multiplier. ``accept(p0, u, par, mem)``
    updates ``mem`` at an accepted state. These may call other functions of numbers and arrays, and make arrays with
    ``work_vector`` and ``work_matrix``.

    ``along`` and ``accept_along`` do the same for many items that share their fields (``Items.runs``), whose rows
    ``par`` and ``mem`` then are: forces and energies are sums. ``along`` may be asked for forces alone, with H and C of
    no size. Where nothing acts it returns the power APART and, in place of the energy, a sum of changes of fields below
    which nothing can act. ``accept_along`` is given no fields, p0 and u of no size, where it would return that.
    """

    name: str
    forces: Callable[..., Any]
    mean: Callable[..., Any]
    symmetric: bool = True
    constraint: bool = False
    accept: Callable[..., Any] | None = None
    along: Callable[..., Any] | None = None
    accept_along: Callable[..., Any] | None = None


# the dissipated power that tells that no item acts
APART = -np.inf

# formulas of a case by the address that laws know them by, and what evaluates them; kernels have their own of both
FORMULAS: dict[int, Any] = {}
RUN: list[Callable[..., Any]] = []


def formula_at(address):  # type: ignore[no-untyped-def]
    """Return the formula at an address: ``values`` (n,) of its quantities, ``out`` (1 + n,) of ``evaluate_formula``."""
    return FORMULAS[int(address)]


def evaluate_formula(formula, k, s):  # type: ignore[no-untyped-def]
    """Fill ``formula.out`` with function k at s and ``formula.values``, and its derivatives by these."""
    RUN[0](formula.programs, k, s, formula.values, formula.out)


def work_vector(n):  # type: ignore[no-untyped-def]
    """Return zeros (n,), for as long as the law works; not to be called in loops, nor returned."""
    return np.zeros(n)


def work_matrix(n, m):  # type: ignore[no-untyped-def]
    """Return zeros (n, m), as ``work_vector`` does."""
    return np.zeros((n, m))
