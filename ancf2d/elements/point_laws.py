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


def over_sine(x):  # type: ignore[no-untyped-def]
    """Return x/sin x."""
    if abs(x) < 1e-3:
        return 1.0 + x * x / 6.0 * (1.0 + 7.0 * x * x / 60.0)
    return x / np.sin(x)


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


def stretch_of(p0, u, rest, start):  # type: ignore[no-untyped-def]
    """Return (x, y, length, length - rest) of p0 + u, the stretch from the displacements."""
    x, y = p0[0] + u[0], p0[1] + u[1]
    L = np.sqrt(x * x + y * y)
    s = start - rest
    if L + start > 0.0:
        s += (2.0 * (p0[0] * u[0] + p0[1] * u[1]) + u[0] * u[0] + u[1] * u[1]) / (L + start)
    return x, y, L, s


def linear(s, rate, par):  # type: ignore[no-untyped-def]
    """A linear spring and damper: k s and c ds/dt; par: k, c."""
    k, c = par[0], par[1]
    return 0.5 * k * s * s, k * s + c * rate, k, c


def linear_mean(s0, s1, rate, par):  # type: ignore[no-untyped-def]
    """The mean of k s, whose work is the difference of the energy, and the damper's force."""
    k, c = par[0], par[1]
    return 0.5 * k * (s0 + s1) + c * rate, c * rate * rate


def step_of(scalar):  # type: ignore[no-untyped-def]
    """Return the mean over a step of any function of elongation and rate: its work is the difference of the energy."""
    def mean(s0, s1, rate, par):  # type: ignore[no-untyped-def]
        middle, change = 0.5 * (s0 + s1), s1 - s0
        N = scalar(middle, 0.0, par)[1]
        drag = scalar(middle, rate, par)[1] - N
        # over shorter steps the difference of the energies is round-off, and the middle all there is to know
        if abs(change) > 1e-4 * (abs(s0) + abs(s1)):
            N += (scalar(s1, 0.0, par)[0] - scalar(s0, 0.0, par)[0] - N * change) / change
        return N + drag, drag * rate
    return mean


def along(scalar, scalar_mean):  # type: ignore[no-untyped-def]
    """Return the law of a force along p, a function of its elongation; par: rest, reference length, own constants.

    ``scalar(s, rate, par)`` returns energy, force and the force's derivatives by elongation and rate;
    ``scalar_mean(s0, s1, rate, par)`` the force of a step and the power that it dissipates. Without length there is no
    direction: no spring force, and the damper acts against any rate.
    """
    def forces(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
        x, y, L, s = stretch_of(p0, u, par[0], par[1])
        if L == 0.0:
            energy, _, k, c = scalar(s, 0.0, par[2:])
            for i in range(2):
                H[i, i], C[i, i], f[i] = k, c, c * w[i]
            return energy, c * (w[0] * w[0] + w[1] * w[1])
        nx, ny = x / L, y / L
        rate = nx * w[0] + ny * w[1]
        across = nx * w[1] - ny * w[0]
        energy, N, k, c = scalar(s, rate, par[2:])
        f[0], f[1] = N * nx, N * ny
        # d n/dp = t t^T/L with t = (-ny, nx)
        H[0, 0] = k * nx * nx + (N * ny * ny - c * across * nx * ny) / L
        H[0, 1] = k * nx * ny + (-N * nx * ny + c * across * nx * nx) / L
        H[1, 0] = k * nx * ny + (-N * nx * ny - c * across * ny * ny) / L
        H[1, 1] = k * ny * ny + (N * nx * nx + c * across * nx * ny) / L
        C[0, 0], C[0, 1], C[1, 0], C[1, 1] = c * nx * nx, c * nx * ny, c * nx * ny, c * ny * ny
        return energy, (N - scalar(s, 0.0, par[2:])[1]) * rate

    def mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
        # along the mean of both p over the mean length
        x0, y0, L0, s0 = stretch_of(p0, u0, par[0], par[1])
        x1, y1, L1, s1 = stretch_of(p0, u1, par[0], par[1])
        energy, _, _, c = scalar(s1, 0.0, par[2:])
        if L0 + L1 == 0.0:
            f[0], f[1] = c * w[0], c * w[1]
            return energy, c * (w[0] * w[0] + w[1] * w[1])
        nx, ny = (x0 + x1) / (L0 + L1), (y0 + y1) / (L0 + L1)
        N, lost = scalar_mean(s0, s1, nx * w[0] + ny * w[1], par[2:])
        f[0], f[1] = N * nx, N * ny
        return energy, lost
    return forces, mean


def about(scalar, scalar_mean):  # type: ignore[no-untyped-def]
    """Return the law of a moment on the angle from a to b, as ``along``; par: rest, how a and b turn, own constants."""
    def forces(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
        twist, at = -par[0], 0
        for end in range(2):
            sign = 2.0 * end - 1.0
            kind = int(par[1 + end])
            if kind == THETA:
                twist += sign * (p0[at] + u[at])
                f[at] = sign
            elif kind == DIRECTION:
                px, py = p0[at] + u[at], p0[at + 1] + u[at + 1]
                twist += sign * turn(p0[at], u[at], u[at + 1], mem[end])
                f[at], f[at + 1] = -sign * py / (px * px + py * py), sign * px / (px * px + py * py)
            at += kind
        rate = 0.0
        for i in range(at):
            rate += f[i] * w[i]
        energy, M, k, c = scalar(twist, rate, par[3:])
        # the second derivatives of the angle, first by themselves for what they do on the rates
        i = 0
        for end in range(2):
            kind = int(par[1 + end])
            if kind == DIRECTION:
                turn_hessian(p0[i] + u[i], p0[i + 1] + u[i + 1], i, 2.0 * end - 1.0, C)
            i += kind
        for i in range(at):
            slope = 0.0
            for j in range(at):
                slope += C[i, j] * w[j]
            for j in range(at):
                H[j, i] += c * f[j] * slope
        for i in range(at):
            for j in range(at):
                H[i, j] += k * f[i] * f[j] + M * C[i, j]
                C[i, j] = c * f[i] * f[j]
        for i in range(at):
            f[i] *= M
        return energy, (M - scalar(twist, 0.0, par[3:])[1]) * rate

    def mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
        # on a discrete gradient of the angle: between two directions it is one of their products v_a x v_b and
        # v_a . v_b, taken at the middle, so that angular momentum is kept; a single direction turns against the ground
        old, new, at = -par[0], -par[0], 0
        for end in range(2):
            sign = 2.0 * end - 1.0
            kind = int(par[1 + end])
            if kind == THETA:
                old += sign * (p0[at] + u0[at])
                new += sign * (p0[at] + u1[at])
                f[at] = sign
            elif kind == DIRECTION:
                x0, y0 = p0[at] + u0[at], p0[at + 1] + u0[at + 1]
                x1, y1 = p0[at] + u1[at], p0[at + 1] + u1[at + 1]
                before = turn(p0[at], u0[at], u0[at + 1], mem[end])
                after = turn(p0[at], u1[at], u1[at + 1], before)
                old += sign * before
                new += sign * after
                q = 0.5 * sign * over_sine(after - before) / np.sqrt((x0 * x0 + y0 * y0) * (x1 * x1 + y1 * y1))
                f[at], f[at + 1] = -q * (y0 + y1), q * (x0 + x1)
            at += kind
        if par[1] == DIRECTION and par[2] == DIRECTION:
            relative_gradient(p0, u0, u1, new - old, f)
        rate = 0.0
        for i in range(at):
            rate += f[i] * w[i]
        M, lost = scalar_mean(old, new, rate, par[3:])
        for i in range(at):
            f[i] *= M
        return scalar(new, 0.0, par[3:])[0], lost
    return forces, mean


def relative_gradient(p0, u0, u1, change, f):  # type: ignore[no-untyped-def]
    """Fill f with D: D . (u1 - u0) = change of the angle from direction (p_0, p_1) to direction (p_2, p_3)."""
    ax, ay = p0[0] + 0.5 * (u0[0] + u1[0]), p0[1] + 0.5 * (u0[1] + u1[1])
    bx, by = p0[2] + 0.5 * (u0[2] + u1[2]), p0[3] + 0.5 * (u0[3] + u1[3])
    scale, s, c = 1.0, 0.0, 0.0
    for k in range(2):
        u = u0 if k == 0 else u1
        axk, ayk, bxk, byk = p0[0] + u[0], p0[1] + u[1], p0[2] + u[2], p0[3] + u[3]
        sk, ck = axk * byk - ayk * bxk, axk * bxk + ayk * byk
        s += 0.5 * sk
        c += 0.5 * ck
        scale *= np.sqrt(sk * sk + ck * ck)
    q = over_sine(change) / scale
    # q (c ds - s dc) with ds, dc at the middle
    f[0], f[1] = q * (c * by - s * bx), q * (-c * bx - s * by)
    f[2], f[3] = q * (-c * ay - s * ax), q * (c * ax - s * ay)


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


def count_turns(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Set the last angles of a torsion spring's directions to those at u."""
    at = 0
    for end in range(2):
        kind = int(par[1 + end])
        if kind == DIRECTION:
            mem[end] = turn(p0[at], u[at], u[at + 1], mem[end])
        at += kind


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


def spring_law(name: str, angle: bool, scalar: Callable[..., Any], mean: Callable[..., Any] | None = None) -> PointLaw:
    """Return the law of a spring from its force as a function of elongation, or of its moment as one of the angle.

    ``scalar`` and ``mean`` are those of ``along``; without ``mean`` a step's force is found from the energy.
    """
    over_step = step_of(scalar) if mean is None else mean
    forces, forces_of_step = (about if angle else along)(scalar, over_step)
    return PointLaw(name, forces, forces_of_step, accept=count_turns if angle else None, helpers=(scalar, over_step))


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
    spring_law("translational", False, linear, linear_mean),
    spring_law("rotational", True, linear, linear_mean),
    PointLaw("follower", follower, follower_mean, symmetric=False),
    PointLaw("moment", moment, moment_mean),
    PointLaw("at_angle", at_angle, at_angle_mean, constraint=True),
    PointLaw("aligned", aligned, aligned_mean, constraint=True),
    PointLaw("fixed_length", fixed_length, fixed_length_mean, constraint=True),
)}
HELPERS = (turn, over_sine, half_sine, turn_hessian, with_multiplier, stretch_of, relative_gradient)
