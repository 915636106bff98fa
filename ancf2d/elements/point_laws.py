"""Laws of springs, dampers, loads that turn and constraints, each as a function of the motion of a few fields.

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
MAX_FIELDS, MAX_PAR, MAX_MEM = 6, 8, 2
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


def follower(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """A force that turns with a section: position, then rotation; par: force in the reference (x, y), how it turns."""
    if par[2] == THETA:
        c, s = np.cos(p0[2] + u[2]), np.sin(p0[2] + u[2])
    else:
        px, py = p0[2] + u[2], p0[3] + u[3]
        L = np.sqrt(px * px + py * py)
        c, s = px / L, py / L
    fx, fy = a[0] * (c * par[0] - s * par[1]), a[0] * (s * par[0] + c * par[1])
    f[0], f[1] = -fx, -fy
    if par[2] == THETA:
        H[0, 2], H[1, 2] = fy, -fx
    else:
        H[0, 2], H[0, 3] = -fy * s / L, fy * c / L
        H[1, 2], H[1, 3] = fx * s / L, -fx * c / L
    return 0.0, 0.0


def follower_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """The force in the middle of the step."""
    if par[2] == THETA:
        angle = p0[2] + 0.5 * (u0[2] + u1[2])
        c, s = np.cos(angle), np.sin(angle)
    else:
        px, py = p0[2] + 0.5 * (u0[2] + u1[2]), p0[3] + 0.5 * (u0[3] + u1[3])
        L = np.sqrt(px * px + py * py)
        c, s = px / L, py / L
    a = 0.5 * (a0[0] + a1[0])
    f[0], f[1] = -a * (c * par[0] - s * par[1]), -a * (s * par[0] + c * par[1])
    return 0.0, 0.0


def moment(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """A moment conjugate to the rotation of a direction or to theta; par: moment, how it turns."""
    M = par[0] * a[0]
    if par[1] == THETA:
        f[0] = -M
        return 0.0, 0.0
    px, py = p0[0] + u[0], p0[1] + u[1]
    f[0], f[1] = M * py / (px * px + py * py), -M * px / (px * px + py * py)
    turn_hessian(px, py, 0, -M, H)
    return 0.0, 0.0


def moment_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """The moment in the middle of the step."""
    M = 0.5 * (a0[0] + a1[0]) * par[0]
    if par[1] == THETA:
        f[0] = -M
        return 0.0, 0.0
    px, py = p0[0] + 0.5 * (u0[0] + u1[0]), p0[1] + 0.5 * (u0[1] + u1[1])
    f[0], f[1] = M * py / (px * px + py * py), -M * px / (px * px + py * py)
    return 0.0, 0.0


def at_angle(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """A direction at the angle of another field: p x (cos, sin)(theta) = 0."""
    x, y = p0[0] + u[0], p0[1] + u[1]
    c, s = np.cos(p0[2] + u[2]), np.sin(p0[2] + u[2])
    g = x * s - y * c
    f[0], f[1], f[2] = s, -c, x * c + y * s
    H[0, 2], H[2, 0], H[1, 2], H[2, 1], H[2, 2] = c, c, s, s, -g
    with_multiplier(g, u, f, H)
    return 0.0, 0.0


def at_angle_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """Products of means; sine and cosine change by what they do over the chord."""
    t0, t1, lam = p0[2] + u0[2], p0[2] + u1[2], u1[3]
    xm, ym = p0[0] + 0.5 * (u0[0] + u1[0]), p0[1] + 0.5 * (u0[1] + u1[1])
    chord = half_sine(t1 - t0)
    half = 0.5 * (t0 + t1)
    f[0], f[1] = 0.5 * lam * (np.sin(t0) + np.sin(t1)), -0.5 * lam * (np.cos(t0) + np.cos(t1))
    f[2] = lam * chord * (xm * np.cos(half) + ym * np.sin(half))
    f[3] = (p0[0] + u1[0]) * np.sin(t1) - (p0[1] + u1[1]) * np.cos(t1)
    return 0.0, 0.0


def aligned(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Two directions that keep their angle: p_a x p_b = 0."""
    ax, ay, bx, by = p0[0] + u[0], p0[1] + u[1], p0[2] + u[2], p0[3] + u[3]
    f[0], f[1], f[2], f[3] = by, -bx, -ay, ax
    H[0, 3], H[3, 0], H[1, 2], H[2, 1] = 1.0, 1.0, -1.0, -1.0
    with_multiplier(ax * by - ay * bx, u, f, H)
    return 0.0, 0.0


def aligned_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """The gradient in the middle: exact of a quadratic form."""
    lam = u1[4]
    f[0], f[1] = lam * (p0[3] + 0.5 * (u0[3] + u1[3])), -lam * (p0[2] + 0.5 * (u0[2] + u1[2]))
    f[2], f[3] = -lam * (p0[1] + 0.5 * (u0[1] + u1[1])), lam * (p0[0] + 0.5 * (u0[0] + u1[0]))
    f[4] = (p0[0] + u1[0]) * (p0[3] + u1[3]) - (p0[1] + u1[1]) * (p0[2] + u1[2])
    return 0.0, 0.0


def fixed_length(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """A distance that stays: (|p|^2 - L^2)/(2 L) = 0 from the displacements; par: L."""
    L = par[0]
    f[0], f[1] = (p0[0] + u[0]) / L, (p0[1] + u[1]) / L
    H[0, 0], H[1, 1] = 1.0 / L, 1.0 / L
    with_multiplier(((p0[0] + 0.5 * u[0]) * u[0] + (p0[1] + 0.5 * u[1]) * u[1]) / L, u, f, H)
    return 0.0, 0.0


def fixed_length_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """The gradient in the middle: exact of a quadratic form."""
    L, lam = par[0], u1[2]
    for i in range(2):
        f[i] = lam * (p0[i] + 0.5 * (u0[i] + u1[i])) / L
    f[2] = ((p0[0] + 0.5 * u1[0]) * u1[0] + (p0[1] + 0.5 * u1[1]) * u1[1]) / L
    return 0.0, 0.0


@dataclass(frozen=True)
class PointLaw:
    """A law: its forces and those of a step, and what it remembers.

    ``symmetric`` tells whether H is, ``constraint`` whether the last field is a multiplier. ``accept(p0, u, par, mem)``
    updates ``mem`` at an accepted state. ``helpers`` are functions of its own that these call.
    """

    name: str
    forces: Callable[..., Any]
    mean: Callable[..., Any]
    symmetric: bool = True
    constraint: bool = False
    accept: Callable[..., Any] | None = None
    helpers: tuple[Callable[..., Any], ...] = ()


def position_law(name: str, force: Callable[..., Any], potential: bool) -> PointLaw:
    """Return the law of a load from its force as a function of position.

    ``force(x, y, par)`` returns fx, fy and dfx/dx, dfx/dy, dfy/dx, dfy/dy; ``potential`` tells whether dfx/dy = dfy/dx.
    """
    def forces(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
        fx, fy, xx, xy, yx, yy = force(p0[0] + u[0], p0[1] + u[1], par)
        f[0], f[1] = -a[0] * fx, -a[0] * fy
        H[0, 0], H[0, 1], H[1, 0], H[1, 1] = -a[0] * xx, -a[0] * xy, -a[0] * yx, -a[0] * yy
        return 0.0, 0.0

    def mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
        # the force in the middle of the step
        a = 0.5 * (a0[0] + a1[0])
        fx, fy, _, _, _, _ = force(p0[0] + 0.5 * (u0[0] + u1[0]), p0[1] + 0.5 * (u0[1] + u1[1]), par)
        f[0], f[1] = -a * fx, -a * fy
        return 0.0, 0.0
    return PointLaw(name, forces, mean, symmetric=potential, helpers=(force,))


LAWS = {law.name: law for law in (
    PointLaw("follower", follower, follower_mean, symmetric=False),
    PointLaw("moment", moment, moment_mean),
    PointLaw("at_angle", at_angle, at_angle_mean, constraint=True),
    PointLaw("aligned", aligned, aligned_mean, constraint=True),
    PointLaw("fixed_length", fixed_length, fixed_length_mean, constraint=True),
)}
HELPERS = (turn, half_sine, turn_hessian, with_multiplier)
