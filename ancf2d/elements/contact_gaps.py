"""The gap between a point of a body and the curve of an element of another body, or of the same one.

The point rho(q) is on a face, an end or the axis of its element, as in ``contact_geometry``. It may touch a
curve c(z) of the other element: a face, the axis, or the straight end of a body. The foot point, where
R = rho - c(z) is normal to t = c'(z), gives the gap g = nu.R with the unit normal nu out of the body. With the rows
W = dR/dq, N = nu.W, A = t.W, B = nu.dc'/dq and T = t.t, b = nu.c'', D = T - g b

    dz/dq = (A + g B)/D,    d2g/dq2 = nu.R_qq - (A B + B A + (b/T) A A + g B B)/D;

at a kink (foot point at the end of an element), g = +-|R| and d2g = nu.R_qq + (tau.W)(tau.W)/g, tau normal to nu.

Functions of arrays and numbers alone, which the kernels compile unchanged.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .contact_derivatives import add_second_derivative, derivative_along, field_count, slope_derivative_along
from .contact_geometry import (
    AT,
    AT_1,
    AT_2,
    BULGE,
    BY,
    FACE,
    HOME,
    MEMORY,
    OF_TANGENT,
    OF_THETA,
    OPPOSITE,
    PLACE,
    PLACEMENT,
    RHO,
    SECTION,
    TERMS,
    WIDE,
    curve_derivative,
    interpolate,
    offset,
    offset_at,
    position_at,
)

# par from OPPOSITE on: section, powers and offset of the other curve at SECTION to BULGE, as for the own one
# (and POSE, which is STILL); SIGN of its outside (1 left of its direction, -1 right); its START (S in m) and SPAN [m]
# along the body; the lengths [m] of the surface BEFORE and AFTER it (inf: the body is closed) and HALF of its own; z of
# the element if it is an END of the body (0 along the body), with the height of its middle and half of its height
# (END_MIDDLE, END_HALF); the SUPPORTED_PART, held by supports in a motion (1: its first end, 2: its last one, 4: all);
# and the NUMBER of its surface
SIGN, START, SPAN, BEFORE, AFTER, HALF, END = range(5, 12)
END_MIDDLE, END_HALF, SUPPORTED_PART, NUMBER = range(13, 17)
CURVE_SIZE = 17
# then of the point: its DEEPEST allowed penetration, S [m] of it (POINT_S) and the length POINT_SPAN of its element,
# the LEAST_DISTANCE along the body below which places are too near to touch (with the length OWN_LOOP of a closed
# body), the end whose CORNER it is, whether it touches only places further ONWARD, whether it touches BOTH_SIDES, into
# how many OPPOSITE_INTERVALS contact points divide an element to which it leaves contact where it is opposite to one
# (0: it does not), the length LOOP of the closed body opposite to it (0: open), whether supports hold it in a motion
# (SUPPORTED_POINT), and the length FADE at the ends of a surface along which its pressure fades (``shares_at``;
# 0: it does not)
(DEEPEST, POINT_S, POINT_SPAN, LEAST_DISTANCE, OWN_LOOP, CORNER, ONWARD, BOTH_SIDES, OPPOSITE_INTERVALS, LOOP,
 SUPPORTED_POINT, FADE) = range(CURVE_SIZE, CURVE_SIZE + 12)
BODY_SIZE = CURVE_SIZE + 12
# mem: z of the FOOT point; the FOOT_KIND: within the curve or at an end (constants below); the SIDE of an axis that the
# point is on; and the NUMBER of the SURFACE that friction holds it on, at the place ANCHOR, or 0
FOOT, FOOT_KIND, SIDE, SURFACE = range(MEMORY, MEMORY + 4)
BODY_MEMORY = MEMORY + 4
NOWHERE, WITHIN, AT_FIRST, AT_LAST = 0.0, 1.0, 2.0, 3.0
# greatest number of iterations for a foot point; steps below _ROUND that no longer shrink are round-off
_TRIES, _ROUND = 25, 1e-11
# |z| beyond this is off the end of an element, so that a point between two elements is within both
PAST_END = 1.0 + 1e-6
# cosine of the angle between outward normals, with the sign reversed, from which on a layer has its whole pressure
OPPOSED = 0.5
# where depth and distance from an end differ by less than this times their sum, neither counts alone
BLEND = 1.0 / 3.0
# last part of the deepest penetration, in which the pressure of a layer fades
LAST_PART = 1.0 / 3.0
# largest |z|: an element's polynomial is used up to here beyond its ends
REACH = 1.5


class Facing(NamedTuple):
    """Points that may touch bodies, and the curves of these bodies, as flat arrays.

    item, way : (k,) its number among the point laws, and the body it may touch; own : (k, 2) number of its own
    fields and coordinates; arms : (ways + 1,) where the arms of each body start; first : (arms + 1,) where the curves
    of each arm start, tree : (arms + 1,) where its tree starts; curve : (curves, CURVE_SIZE) constants of a curve;
    beside : (curves, 2) the curves before and after it on its face, or itself; sizes : (curves, 2) its fields and
    coordinates;
    at : (curves, 3) where its entries of dofs, G and p0 start; now, chords : (curves, 5), boxes : (., 8) work arrays
    for fields, chords and the tree (``kernels.chords``).
    """

    item: Any
    way: Any
    own: Any
    arms: Any
    first: Any
    tree: Any
    curve: Any
    beside: Any
    sizes: Any
    at: Any
    dofs: Any
    G: Any
    p0: Any
    now: Any
    chords: Any
    boxes: Any


def line_at(par, p0, u, z):  # type: ignore[no-untyped-def]
    """Return (x, y, tx, ty, kx, ky): position on a curve at z, and its derivatives by z.

    Unlike ``curve_at`` without derivatives by the fields, which a search does not need.
    """
    y, slope = offset_at(par, z)
    return _line_beside(par, p0, u, z, y, slope, 2.0 * par[BULGE])


def _line_beside(par, p0, u, z, y, slope, bulge):  # type: ignore[no-untyped-def]
    """Return the same at a distance y from the axis, with the derivatives ``slope`` and ``bulge`` by z."""
    terms, section = int(par[TERMS]), int(par[SECTION])
    x0, x1, x2, x3 = _powers(p0, u, 0, terms, z)
    y0, y1, y2, y3 = _powers(p0, u, terms, terms, z)
    if section == OF_THETA:
        angle, first, second, _ = _powers(p0, u, 2 * terms, terms, z)
        c, s = np.cos(angle), np.sin(angle)
    elif section == OF_TANGENT and (y != 0.0 or slope != 0.0 or bulge != 0.0):
        # the normal turns at the rate w = X''.n/L, L = |X'|
        L = np.sqrt(x1 * x1 + y1 * y1)
        c, s = x1 / L, y1 / L
        first = (y2 * c - x2 * s) / L
        second = ((y3 * c - x3 * s) - 2.0 * first * (x2 * c + y2 * s)) / L
    else:
        return x0, y0, x1, y1, x2, y2
    # derivatives of y n along the section and across it
    turn, along, across = y * first, y * second + 2.0 * slope * first, bulge - y * first * first
    return (x0 - y * s, y0 + y * c, x1 - turn * c - slope * s, y1 - turn * s + slope * c,
            x2 - along * c - across * s, y2 - along * s + across * c)


def _powers(p0, u, at, terms, z):  # type: ignore[no-untyped-def]
    """Return a polynomial with the coefficients p0 + u from ``at`` on, and its three derivatives, at z."""
    v0, v1, v2, v3 = 0.0, 0.0, 0.0, 0.0
    for j in range(terms - 1, -1, -1):
        v3 = v3 * z + 3.0 * v2
        v2 = v2 * z + 2.0 * v1
        v1 = v1 * z + v0
        v0 = v0 * z + p0[at + j] + u[at + j]
    return v0, v1, v2, v3


def trace_at(par, p0, u, z):  # type: ignore[no-untyped-def]
    """Return (x, y, tx, ty, kx, ky) of ``line_at`` for a curve that may be touched, which may be an end of a body."""
    if par[END] == 0.0:
        return line_at(par, p0, u, z)
    x, y, _, _, _, _ = _line_beside(par, p0, u, par[END], 0.0, 0.0, 0.0)
    a, b, _, _, _, _ = _line_beside(par, p0, u, par[END], par[END_HALF], 0.0, 0.0)
    at = par[END_MIDDLE] / par[END_HALF] + z
    return x + at * (a - x), y + at * (b - y), a - x, b - y, 0.0, 0.0


def curve_at(par, p0, u, z, work, across):  # type: ignore[no-untyped-def]
    """Fill work at z of a curve; return its derivatives (tx, ty, kx, ky) by z.

    Along an end of a body only the height in the section changes; ``across`` then has c' and its derivatives.
    """
    if par[END] == 0.0:
        position_at(par, p0, u, z, work)
        tx, ty = curve_derivative(par, work, AT_1, 1)
        kx, ky = curve_derivative(par, work, AT_2, 2)
        return tx, ty, kx, ky
    interpolate(par, p0, u, par[END], across)
    offset(par, par[END_HALF], across)
    interpolate(par, p0, u, par[END], work)
    offset(par, par[END_MIDDLE] + z * par[END_HALF], work)
    across[RHO] -= across[AT]
    across[RHO + 1] -= across[AT + 1]
    across[BY] -= 1.0
    across[BY + WIDE + 1] -= 1.0
    return across[RHO], across[RHO + 1], 0.0, 0.0


def tangent_row(par, z, vx, vy, work, across, out):  # type: ignore[no-untyped-def]
    """Set out (fields,) to the derivative of c' along (vx, vy)."""
    if par[END] != 0.0:
        derivative_along(par, par[END], vx, vy, across, out, 0)
    else:
        slope_derivative_along(par, z, vx, vy, work, out, 0)


def foot_point(par, p0, u, x, y, z):  # type: ignore[no-untyped-def]
    """Return z of the foot point of (x, y) on a curve, by Newton's method from z."""
    last = 1.0
    for _ in range(_TRIES):
        x0, y0, tx, ty, kx, ky = trace_at(par, p0, u, z)
        rx, ry = x - x0, y - y0
        T = tx * tx + ty * ty
        step = (rx * tx + ry * ty) / max(T - rx * kx - ry * ky, 0.1 * T)
        # converged: to the last digit, within round-off, or at the limit of the curve
        then = min(max(z + step, -REACH), REACH)
        if abs(step) < 1e-14 or last <= abs(step) < _ROUND or then == z:
            break
        last, z = abs(step), then
    return z


def gap_between(par, p0, u, mem, own, work, across):  # type: ignore[no-untyped-def]
    """Return (g, nu_x, nu_y, z): gap, its gradient by the position of the point, and the foot point; NaN if none.

    ``own`` is filled at the point, ``work`` and ``across`` at the foot point.
    """
    other, m = par[OPPOSITE:], field_count(par)
    position_at(par, p0, u, mem[PLACE] if mem[PLACEMENT] > 0.0 else par[HOME], own)
    x, y = own[RHO], own[RHO + 1]
    sign = other[SIGN] if other[BOTH_SIDES] == 0.0 else mem[SIDE]
    if mem[FOOT_KIND] == NOWHERE or sign == 0.0:
        return np.nan, 0.0, 0.0, 0.0
    z = mem[FOOT]
    if mem[FOOT_KIND] == WITHIN:
        z = foot_point(other, p0[m:], u[m:], x, y, z)
        tx, ty, _, _ = curve_at(other, p0[m:], u[m:], z, work, across)
        size = sign / np.sqrt(tx * tx + ty * ty)
        nx, ny = -ty * size, tx * size
        return nx * (x - work[RHO]) + ny * (y - work[RHO + 1]), nx, ny, z
    tx, ty, _, _ = curve_at(other, p0[m:], u[m:], z, work, across)
    rx, ry = x - work[RHO], y - work[RHO + 1]
    distance, across_it = np.sqrt(rx * rx + ry * ry), sign * (tx * ry - ty * rx)
    if distance == 0.0:
        size = sign / np.sqrt(tx * tx + ty * ty)
        return 0.0, -ty * size, tx * size, z
    turned = -1.0 if across_it < 0.0 else 1.0
    return turned * distance, turned * rx / distance, turned * ry / distance, z


def is_past_end(other, found):  # type: ignore[no-untyped-def]
    """Return whether a point is beyond an end of a surface that no curve continues; its corner is a contact point."""
    return (found == AT_FIRST and other[BEFORE] == 0.0) or (found == AT_LAST and other[AFTER] == 0.0)


def shares_at(par, mem, nx, ny, g, z, own):  # type: ignore[no-untyped-def]
    """Return two shares of its energy that a point has, with derivatives: (share, by z, zz, g, gg, zg, share, by angle,
    twice).

    They are 0 where a point begins or ceases to touch at any depth: the first one, by z and the gap, at the ends of the
    surface and at the DEEPEST penetration; the second one, by the angle between both outward normals, where they are at
    right angles. ``own`` is filled at the point.
    """
    other = par[OPPOSITE:]
    if other[FADE] == 0.0:
        return 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
    a, au, av, auu, auv, avv = _share_beside(other[BEFORE] + (1.0 + z) * other[HALF], -g, other[FADE])
    b, bu, bv, buu, buv, bvv = _share_beside(other[AFTER] + (1.0 - z) * other[HALF], -g, other[FADE])
    way = other[HALF] if mem[FOOT_KIND] == WITHIN else 0.0
    c, s = -1.0, 0.0
    if other[BOTH_SIDES] == 0.0:
        tx, ty = curve_derivative(par, own, AT_1, 1)
        L, face, end = np.sqrt(tx * tx + ty * ty), par[FACE], other[CORNER]
        mx, my = (end * tx - face * ty) / L, (face * tx + end * ty) / L
        c, s = mx * nx + my * ny, nx * my - ny * mx
    t, t1, t2 = _rise(-c / OPPOSED)
    r, r1, r2 = _rise((1.0 + g / other[DEEPEST]) / LAST_PART)
    room = 1.0 / (LAST_PART * other[DEEPEST])
    by_z, by_g = way * (au * b - a * bu), -av * b - a * bv
    return (a * b * r, by_z * r, way * way * (auu * b - 2.0 * au * bu + a * buu) * r, by_g * r + a * b * r1 * room,
            (avv * b + 2.0 * av * bv + a * bvv) * r + (2.0 * by_g * r1 + a * b * r2 * room) * room,
            way * (av * bu + a * buv - auv * b - au * bv) * r + by_z * r1 * room,
            t, t1 * s / OPPOSED, t2 * (s / OPPOSED)**2 + t1 * c / OPPOSED)


def share_of_energy(other, g, z, c):  # type: ignore[no-untyped-def]
    """Return the product of both shares of ``shares_at`` where the outward normals have the cosine c."""
    before = _share_beside(other[BEFORE] + (1.0 + z) * other[HALF], -g, other[FADE])[0]
    after = _share_beside(other[AFTER] + (1.0 - z) * other[HALF], -g, other[FADE])[0]
    return before * after * _rise((1.0 + g / other[DEEPEST]) / LAST_PART)[0] * _rise(-c / OPPOSED)[0]


def _share_beside(e, depth, fade):  # type: ignore[no-untyped-def]
    """Return the share (e/h)^2 s(h/r) of a point at a distance e from the end of a surface, and its derivatives by e
    and depth: (., e, d, ee, ed, dd).

    s is ``_rise``, r the length ``fade``, and h a smooth maximum of e and depth. So share times depth^2 is the same for
    both surfaces that meet at a right angle, where the distance from the end of one is the depth in the other.
    """
    if e >= fade and e * (1.0 - BLEND) >= depth * (1.0 + BLEND):
        return 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if e <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    both, h, hu, hv, curved = e + depth, max(e, depth), 1.0, 0.0, 0.0
    t = (e - depth) / both
    if t < 0.0:
        hu, hv = 0.0, 1.0
    if abs(t) < BLEND:
        h, curved = both * (0.5 + 0.25 * (t * t / BLEND + BLEND)), 0.5 / (BLEND * both)
        hu = 0.5 + 0.25 * (BLEND + (2.0 - t) * t / BLEND)
        hv = 0.5 + 0.25 * (BLEND - (2.0 + t) * t / BLEND)
    # q = s(h/r)/h^2
    q, q1, q2 = 1.0 / (h * h), -2.0 / (h * h * h), 6.0 / (h * h * h * h)
    if h < fade:
        q, q1, q2 = (3.0 - 2.0 * h / fade) / (fade * fade), -2.0 / (fade * fade * fade), 0.0
    ee = e * e
    return (ee * q, 2.0 * e * q + ee * q1 * hu, ee * q1 * hv,
            2.0 * q + 4.0 * e * q1 * hu + ee * (q2 * hu * hu + q1 * curved * (1.0 - t)**2),
            2.0 * e * q1 * hv + ee * (q2 * hu * hv - q1 * curved * (1.0 - t * t)),
            ee * (q2 * hv * hv + q1 * curved * (1.0 + t)**2))


def _rise(x):  # type: ignore[no-untyped-def]
    """Return a smooth step from 0 at x = 0 to 1 at x = 1, and its two derivatives."""
    at = min(max(x, 0.0), 1.0)
    return at * at * (3.0 - 2.0 * at), 6.0 * at * (1.0 - at), 6.0 - 12.0 * at if at == x else 0.0


def relative_row(par, own, work, across, z, mem, vx, vy, out):  # type: ignore[no-untyped-def]
    """Set out (fields of both) to the derivative of R along (vx, vy) at a fixed z."""
    other, m = par[OPPOSITE:], field_count(par)
    derivative_along(par, mem[PLACE] if mem[PLACEMENT] > 0.0 else par[HOME], vx, vy, own, out, 0)
    derivative_along(other, z if other[END] == 0.0 else other[END], -vx, -vy, work, out[m:], 0)


def gap_derivatives(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, H):  # type: ignore[no-untyped-def]
    """Set rows 0 to 2 to N, A and B (fields,), and add the second derivative of the gap to H."""
    other, m = par[OPPOSITE:], field_count(par)
    n = m + field_count(other)
    at = z if other[END] == 0.0 else other[END]
    tx, ty, kx, ky = curve_at(other, p0[m:], u[m:], z, work, across)
    relative_row(par, own, work, across, z, mem, nx, ny, rows[0])
    add_second_derivative(par, mem[PLACE] if mem[PLACEMENT] > 0.0 else par[HOME], nx, ny, own, H, 0)
    add_second_derivative(other, at, -nx, -ny, work, H, m)
    for q in range(n):
        rows[2, q] = 0.0
    if mem[FOOT_KIND] != WITHIN:
        relative_row(par, own, work, across, z, mem, -ny, nx, rows[1])
        for p in range(n):
            for q in range(n):
                H[p, q] += rows[1, p] * rows[1, q] / g if g != 0.0 else 0.0
        return
    relative_row(par, own, work, across, z, mem, tx, ty, rows[1])
    tangent_row(other, z, nx, ny, work, across, rows[2][m:])
    T, b = tx * tx + ty * ty, nx * kx + ny * ky
    for p in range(n):
        A, B = rows[1, p], rows[2, p]
        for q in range(n):
            H[p, q] -= (A * rows[2, q] + B * rows[1, q] + b / T * A * rows[1, q] + g * B * rows[2, q]) / (T - g * b)


def foot_and_angle(par, p0, u, mem, g, nx, ny, z, own, work, across, rows):  # type: ignore[no-untyped-def]
    """Set rows 5 and 6 (fields,) to the derivatives of z and of the angle from nu to the outward normal of the point's
    own surface; rows 2 and 3 are B and A, or row 3, at a kink, tau.W.
    """
    other, m = par[OPPOSITE:], field_count(par)
    tx, ty = curve_derivative(par, own, AT_1, 1)
    T = tx * tx + ty * ty
    slope_derivative_along(par, par[HOME], -ty / T, tx / T, own, rows[6], 0)
    tx, ty, kx, ky = curve_at(other, p0[m:], u[m:], z, work, across)
    T, b = tx * tx + ty * ty, nx * kx + ny * ky
    for q in range(m + field_count(other)):
        if mem[FOOT_KIND] == WITHIN:
            rows[5, q] = (rows[3, q] + g * rows[2, q]) / (T - g * b)
            rows[6, q] -= other[SIGN] / np.sqrt(T) * (rows[2, q] + b * rows[5, q])
        else:
            rows[6, q] -= rows[3, q] / g


def place_on(other, z, tx, ty):  # type: ignore[no-untyped-def]
    """Return the place of z on its surface (S [m], or z on an end), and the length of a unit of it."""
    size = np.sqrt(tx * tx + ty * ty)
    if other[SPAN] == 0.0:
        return z, size
    return other[START] + 0.5 * (z + 1.0) * other[SPAN], 2.0 * size / other[SPAN]


def place_opposite(par, p0, u, mem, z, work, across):  # type: ignore[no-untyped-def]
    """Return the place opposite to a point on the other surface, the length of a unit of it, and the surface.

    They are NaN at a kink, where the foot point does not move.
    """
    if mem[FOOT_KIND] != WITHIN:
        return np.nan, np.nan, np.nan
    other, m = par[OPPOSITE:], field_count(par)
    tx, ty, _, _ = curve_at(other, p0[m:], u[m:], z, work, across)
    place, unit = place_on(other, z, tx, ty)
    return place, unit, other[NUMBER]


def distance_along(loop, place, anchor):  # type: ignore[no-untyped-def]
    """Return the distance from anchor to place along a surface, the shorter way around one of length ``loop``."""
    way = place - anchor
    return way - loop * np.floor(way / loop + 0.5) if loop > 0.0 else way
