"""Point laws made from a force as a function of elongation, or from a moment as a function of an angle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..elements.point_laws import DIRECTION, THETA, PointLaw, angle_near, turn_hessian


def over_sine(x):  # type: ignore[no-untyped-def]
    """Return x/sin x."""
    if abs(x) < 1e-3:
        return 1.0 + x * x / 6.0 * (1.0 + 7.0 * x * x / 60.0)
    return x / np.sin(x)


def stretch_of(p0, u, rest, start):  # type: ignore[no-untyped-def]
    """Return (x, y, length, length - rest) of p0 + u, with the stretch computed from the displacements."""
    x, y = p0[0] + u[0], p0[1] + u[1]
    L = np.sqrt(x * x + y * y)
    s = start - rest
    if L + start > 0.0:
        s += (2.0 * (p0[0] * u[0] + p0[1] * u[1]) + u[0] * u[0] + u[1] * u[1]) / (L + start)
    return x, y, L, s


def step_of(scalar):  # type: ignore[no-untyped-def]
    """Return the mean force over a step of any force function ``scalar``; its work is the change of the energy."""
    def mean(s0, s1, rate, par):  # type: ignore[no-untyped-def]
        middle, change = 0.5 * (s0 + s1), s1 - s0
        N = scalar(middle, 0.0, par)[1]
        drag = scalar(middle, rate, par)[1] - N
        # for smaller changes the difference of energies is round-off, and the work of the mid-step force, whose error
        # is of third order in the change, is as accurate
        if abs(change) > 1e-5 * (abs(s0) + abs(s1)):
            N += (scalar(s1, 0.0, par)[0] - scalar(s0, 0.0, par)[0] - N * change) / change
        return N + drag, drag * rate
    return mean


def along(scalar, scalar_mean):  # type: ignore[no-untyped-def]
    """Return the law of a force along p, a function of its elongation; par: rest, reference length, own constants.

    ``scalar(s, rate, par)`` returns energy, force and the derivatives of the force by elongation and rate;
    ``scalar_mean(s0, s1, rate, par)`` returns the force of a step and the power that it dissipates. At zero length
    there is no direction: no spring force, and the damper acts against any rate.
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
        # acts along the mean of both p, divided by the mean length
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


def twist(p0, u, par, mem, f):  # type: ignore[no-untyped-def]
    """Return the angle from a to b less the rest angle, and its number of fields; fill f with its gradient."""
    angle, at = -par[0], 0
    for end in range(2):
        sign = 2.0 * end - 1.0
        kind = int(par[1 + end])
        if kind == THETA:
            angle += sign * (p0[at] + u[at])
            f[at] = sign
        elif kind == DIRECTION:
            px, py = p0[at] + u[at], p0[at + 1] + u[at + 1]
            angle += sign * angle_near(p0[at], u[at], u[at + 1], mem[end])
            f[at], f[at + 1] = -sign * py / (px * px + py * py), sign * px / (px * px + py * py)
        at += kind
    return angle, at


def twist_hessian(p0, u, par, H):  # type: ignore[no-untyped-def]
    """Add the second derivatives of the angle from a to b to H."""
    at = 0
    for end in range(2):
        kind = int(par[1 + end])
        if kind == DIRECTION:
            turn_hessian(p0[at] + u[at], p0[at + 1] + u[at + 1], at, 2.0 * end - 1.0, H)
        at += kind


def twist_step(p0, u0, u1, par, mem, f):  # type: ignore[no-untyped-def]
    """Return the angles at both ends of a step and their number of fields; fill f with a discrete gradient.

    Between two directions, it is formed from the products v_a x v_b and v_a . v_b at mid-step, which conserves angular
    momentum; a single direction is taken against the ground; theta is linear.
    """
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
            before = angle_near(p0[at], u0[at], u0[at + 1], mem[end])
            after = angle_near(p0[at], u1[at], u1[at + 1], before)
            old += sign * before
            new += sign * after
            q = 0.5 * sign * over_sine(after - before) / np.sqrt((x0 * x0 + y0 * y0) * (x1 * x1 + y1 * y1))
            f[at], f[at + 1] = -q * (y0 + y1), q * (x0 + x1)
        at += kind
    if par[1] == DIRECTION and par[2] == DIRECTION:
        relative_gradient(p0, u0, u1, new - old, f)
    return old, new, at


def about(scalar, scalar_mean):  # type: ignore[no-untyped-def]
    """Return the law of a moment on the angle from a to b; see ``along``. par: rest, rotation kinds of a and b, own."""
    def forces(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
        angle, n = twist(p0, u, par, mem, f)
        rate = 0.0
        for i in range(n):
            rate += f[i] * w[i]
        energy, M, k, c = scalar(angle, rate, par[3:])
        # C first holds the second derivatives of the angle, for their product with the rates
        twist_hessian(p0, u, par, C)
        for i in range(n):
            slope = 0.0
            for j in range(n):
                slope += C[i, j] * w[j]
            for j in range(n):
                H[j, i] += c * f[j] * slope
        for i in range(n):
            for j in range(n):
                H[i, j] += k * f[i] * f[j] + M * C[i, j]
                C[i, j] = c * f[i] * f[j]
        for i in range(n):
            f[i] *= M
        return energy, (M - scalar(angle, 0.0, par[3:])[1]) * rate

    def mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
        old, new, n = twist_step(p0, u0, u1, par, mem, f)
        rate = 0.0
        for i in range(n):
            rate += f[i] * w[i]
        M, lost = scalar_mean(old, new, rate, par[3:])
        for i in range(n):
            f[i] *= M
        return scalar(new, 0.0, par[3:])[0], lost
    return forces, mean


def relative_gradient(p0, u0, u1, change, f):  # type: ignore[no-untyped-def]
    """Fill f with D such that D . (u1 - u0) = change of the angle from direction (p_0, p_1) to direction (p_2, p_3)."""
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
    # q (c ds - s dc) with ds and dc at mid-step
    f[0], f[1] = q * (c * by - s * bx), q * (-c * bx - s * by)
    f[2], f[3] = q * (-c * ay - s * ax), q * (c * ax - s * ay)


def count_turns(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Update the last angles of a torsion spring's directions with those at u."""
    at = 0
    for end in range(2):
        kind = int(par[1 + end])
        if kind == DIRECTION:
            mem[end] = angle_near(p0[at], u[at], u[at + 1], mem[end])
        at += kind


def spring_law(name: str, angle: bool, scalar: Callable[..., Any], mean: Callable[..., Any] | None = None) -> PointLaw:
    """Return the law of a spring from its force as a function of elongation, or of its moment as one of the angle.

    ``scalar`` and ``mean`` are as in ``along``; without ``mean``, the force of a step is computed from the energy.
    """
    over_step = step_of(scalar) if mean is None else mean
    forces, forces_of_step = (about if angle else along)(scalar, over_step)
    return PointLaw(name, forces, forces_of_step, accept=count_turns if angle else None)
