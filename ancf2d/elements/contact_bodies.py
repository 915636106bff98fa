"""Contact of a point of a body with the curve of an element: of another body, or of the same one.

The point rho(q) is on a face, an end or the axis of its element, as in ``contact_geometry``. What it may touch is a
curve c(z) of the other element: a face, the axis, or the straight end of a body. The foot point, where
R = rho - c(z) is normal to t = c'(z), gives the gap g = nu.R with the unit normal nu out of the body. With the rows
W = dR/dq, N = nu.W, A = t.W, B = nu.dc'/dq and T = t.t, b = nu.c'', D = T - g b

    dz/dq = (A + g B)/D,    d2g/dq2 = nu.R_qq - (A B + B A + (b/T) A A + g B B)/D;

at a kink, where the foot point is the end of an element, g = +-|R| and d2g = nu.R_qq + (tau.W)(tau.W)/g, tau across nu.
Forces are minus N times the pressure, so that the two bodies are in balance, in force and moment. Those of friction are
along |t| dz/dq, how far the foot point moves on the curve, for the same reason.

Functions of arrays and numbers alone, which kernels compile as they are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import contact
from .contact_geometry import (
    ANCHOR,
    AT,
    AT_1,
    AT_2,
    BY,
    BY_BY,
    BY_CHOICE,
    DAMPING,
    FREE,
    FRICTION,
    HELD,
    HOME,
    MATRIX,
    MEMORY,
    OF_THETA,
    OFFSET,
    OPEN,
    ORIGIN,
    PLACE,
    RHO,
    ROW,
    SECTION,
    STICK,
    STIFFNESS,
    TERMS,
    TOUCH,
    VECTOR,
    WEIGHT,
    WORK,
    along,
    count_of,
    offset,
    spread,
    spread_both,
    stand,
    take,
)
from .contact_layer import drag
from .point_laws import PointLaw, work_matrix, work_vector

# par from ORIGIN on: section, powers and offset of the other curve at SECTION, TERMS and OFFSET, as of one's own; on
# which side its outside is (1 left of its way, -1 right); S [m] where it begins, and how far it goes along the body;
# which of its ends go on as another curve (1 the first, 2 the last); z of the element where it is an end of the body
# (0 along the body), and heights of its middle and half of it
SIGN, BEGINS, GOES, JOINED, END, MIDDLE, HALF = 3, 4, 5, 6, 7, 8, 9
CURVE_SIZE = 11
# and of the point: how deep it may be at most, S [m] of it and how far its element goes, what along the body is too
# near to touch (with the length of a closed one), at which end it is a corner, whether it touches only what is further
# on, whether both sides do, into how many pieces the points there divide an element if it leaves contact to these
# where it is opposite to one (0: it does not), and the length of a closed body that it is opposite to (0: it is open)
DEEPEST, OWN, OWN_GOES, APART, ROUND, CORNER, ONWARD, BOTH, YIELDS, LOOP = range(CURVE_SIZE, CURVE_SIZE + 10)
BODY_SIZE = CURVE_SIZE + 10
# mem: z of the foot point, whether it is one (0 there is none), or an end of the element (-1, 1), and of an axis the
# side of it that the point is on; and which surface (``surface_of``) friction holds it to, at the place ANCHOR
FOOT, FOUND, SIDE, ON = range(MEMORY, MEMORY + 4)
BODY_MEMORY = MEMORY + 4
NOWHERE, WITHIN, AT_FIRST, AT_LAST = 0.0, 1.0, 2.0, 3.0
_TRIES = 25
# how far beyond the ends of an element its polynomial is followed
REACH = 1.5


class Facing(NamedTuple):
    """Points that may touch bodies, and the curves of these, as flat arrays.

    item, way : (k,) its place among the point laws, and which curves it may touch; own : (k,) how many of its fields
    and coordinates are its own, (k, 2); first : (ways + 1,) where the curves of each begin, tree : (ways + 1,) where
    its tree does; curve : (curves, CURVE_SIZE) constants of a curve; sizes : (curves, 2) its fields and coordinates;
    dofs, G, p0 and at : (curves, 3) where those of each begin; now, boxes : (., 4) room for fields and tree.
    """

    item: Any
    way: Any
    own: Any
    first: Any
    tree: Any
    curve: Any
    sizes: Any
    at: Any
    dofs: Any
    G: Any
    p0: Any
    now: Any
    boxes: Any


def size_of(par):  # type: ignore[no-untyped-def]
    """Return how many fields a curve has."""
    return (3 if int(par[SECTION]) == OF_THETA else 2) * int(par[TERMS])


def curve_at(par, p0, u, z, work, across):  # type: ignore[no-untyped-def]
    """Fill work at z of a curve; return its derivatives (tx, ty, kx, ky) by z.

    Along an end of a body the section alone changes: ``across`` then has c' and its derivatives.
    """
    if par[END] == 0.0:
        stand(par, p0, u, z, work)
        tx, ty = along(par, work, AT_1, 1)
        kx, ky = along(par, work, AT_2, 2)
        return tx, ty, kx, ky
    take(par, p0, u, par[END], across)
    par[OFFSET] = par[HALF]
    offset(par, across)
    take(par, p0, u, par[END], work)
    par[OFFSET] = par[MIDDLE] + z * par[HALF]
    offset(par, work)
    across[RHO] -= across[AT]
    across[RHO + 1] -= across[AT + 1]
    across[BY] -= 1.0
    across[BY + 9] -= 1.0
    return across[RHO], across[RHO + 1], 0.0, 0.0


def row(par, z, vx, vy, work, out):  # type: ignore[no-untyped-def]
    """Set out (fields,) to the derivative of rho along (vx, vy)."""
    body, _ = count_of(par)
    for a in range(body):
        work[VECTOR + a] = vx * work[BY + a] + vy * work[BY + 8 + a]
    spread(par, z, work, VECTOR, 0, out, 0)


def slope_row(par, z, vx, vy, work, across, out):  # type: ignore[no-untyped-def]
    """Set out (fields,) to the derivative of c' along (vx, vy)."""
    if par[END] != 0.0:
        row(par, par[END], vx, vy, across, out)
        return
    body, _ = count_of(par)
    for a in range(body):
        v = 0.0
        for b in range(body):
            v += (vx * work[BY_BY + 8 * a + b] + vy * work[BY_BY + 64 + 8 * a + b]) * work[AT_1 + b]
        work[VECTOR + a], work[VECTOR + 8 + a] = v, vx * work[BY + a] + vy * work[BY + 8 + a]
    spread(par, z, work, VECTOR, 0, out, 0)
    spread(par, z, work, VECTOR + 8, 1, work, ROW)
    for q in range(size_of(par)):
        out[q] += work[ROW + q]


def bend(par, z, vx, vy, work, H, first):  # type: ignore[no-untyped-def]
    """Add the second derivative of rho along (vx, vy) to H, rows and columns from ``first`` on."""
    body, _ = count_of(par)
    for a in range(body):
        for b in range(body):
            work[MATRIX + 8 * a + b] = vx * work[BY_BY + 8 * a + b] + vy * work[BY_BY + 64 + 8 * a + b]
    spread_both(par, z, work, H, first, 1.0)


def foot_on(par, p0, u, x, y, z, work, across):  # type: ignore[no-untyped-def]
    """Return z of the foot point of (x, y) on a curve, by Newton's method from z; work is left there."""
    for _ in range(_TRIES):
        tx, ty, kx, ky = curve_at(par, p0, u, z, work, across)
        rx, ry = x - work[RHO], y - work[RHO + 1]
        T = tx * tx + ty * ty
        step = (rx * tx + ry * ty) / max(T - rx * kx - ry * ky, 0.1 * T)
        if abs(step) < 1e-14:
            break
        z = min(max(z + step, -REACH), REACH)
    return z


def gap_between(par, p0, u, mem, own, work, across):  # type: ignore[no-untyped-def]
    """Return (g, nu_x, nu_y, z): gap, its gradient by where the point is, and the foot point; nan where there is none.

    ``own`` is filled at the point, ``work`` and ``across`` at the foot point.
    """
    other, m = par[ORIGIN:], size_of(par)
    stand(par, p0, u, mem[PLACE] if mem[FREE] > 0.0 else par[HOME], own)
    x, y = own[RHO], own[RHO + 1]
    sign = other[SIGN] if other[BOTH] == 0.0 else mem[SIDE]
    if mem[FOUND] == NOWHERE or sign == 0.0:
        return np.nan, 0.0, 0.0, 0.0
    z = mem[FOOT]
    if mem[FOUND] == WITHIN:
        z = foot_on(other, p0[m:], u[m:], x, y, z, work, across)
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


def rows_between(par, own, work, across, z, mem, vx, vy, out):  # type: ignore[no-untyped-def]
    """Set out (fields of both) to the derivative of R along (vx, vy) at a fixed z."""
    other, m = par[ORIGIN:], size_of(par)
    row(par, mem[PLACE] if mem[FREE] > 0.0 else par[HOME], vx, vy, own, out)
    row(other, z if other[END] == 0.0 else other[END], -vx, -vy, work, out[m:])


def bent_between(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, H):  # type: ignore[no-untyped-def]
    """Set rows 0 to 2 to N, A and B (fields,), and add the second derivative of the gap to H."""
    other, m = par[ORIGIN:], size_of(par)
    n = m + size_of(other)
    at = z if other[END] == 0.0 else other[END]
    tx, ty, kx, ky = curve_at(other, p0[m:], u[m:], z, work, across)
    rows_between(par, own, work, across, z, mem, nx, ny, rows[0])
    bend(par, mem[PLACE] if mem[FREE] > 0.0 else par[HOME], nx, ny, own, H, 0)
    bend(other, at, -nx, -ny, work, H, m)
    for q in range(n):
        rows[2, q] = 0.0
    if mem[FOUND] != WITHIN:
        rows_between(par, own, work, across, z, mem, -ny, nx, rows[1])
        for p in range(n):
            for q in range(n):
                H[p, q] += rows[1, p] * rows[1, q] / g if g != 0.0 else 0.0
        return
    rows_between(par, own, work, across, z, mem, tx, ty, rows[1])
    slope_row(other, z, nx, ny, work, across, rows[2][m:])
    T, b = tx * tx + ty * ty, nx * kx + ny * ky
    for p in range(n):
        A, B = rows[1, p], rows[2, p]
        for q in range(n):
            H[p, q] -= (A * rows[2, q] + B * rows[1, q] + b / T * A * rows[1, q] + g * B * rows[2, q]) / (T - g * b)


def surface_of(other):  # type: ignore[no-untyped-def]
    """Return which surface of its body a curve is part of: a face (-1, 1), an end (-2, 2) or the axis (3)."""
    return 3.0 if other[BOTH] > 0.0 else other[SIGN] if other[END] == 0.0 else 2.0 * other[END]


def place_on(other, z, tx, ty):  # type: ignore[no-untyped-def]
    """Return where z is on its surface (S [m], or z of an end), and how far a unit of that is."""
    size = np.sqrt(tx * tx + ty * ty)
    if other[END] != 0.0:
        return z, size
    return other[BEGINS] + 0.5 * (z + 1.0) * other[GOES], 2.0 * size / other[GOES]


def slip_on(other, mem, place, unit):  # type: ignore[no-untyped-def]
    """Return how far a place is from that which friction holds to, none on another surface, the short way around."""
    if mem[ON] != surface_of(other):
        return 0.0
    way = place - mem[ANCHOR]
    if other[LOOP] > 0.0:
        way -= other[LOOP] * np.floor(way / other[LOOP] + 0.5)
    return unit * way


def rub_between(par, p0, u, w, mem, g, z, nx, ny, pressed, own, work, across, rows, f, H,
                C):  # type: ignore[no-untyped-def]
    """Add friction to f, H and C; return the power that it takes.

    Rows are N, how the force across changes (with the sign turned), B and A; two more are filled. With F = R.t,
    d2z/dq2 = (F_qq + F_qz z_q + z_q F_qz + F_zz z_q z_q)/D; H leaves out what the depth makes of it.
    """
    other, m, n = par[ORIGIN:], size_of(par), len(w)
    at, turn = z if other[END] == 0.0 else other[END], work_matrix(n, n)
    tx, ty, kx, ky = curve_at(other, p0[m:], u[m:], z, work, across)
    T, b, k = tx * tx + ty * ty, nx * kx + ny * ky, tx * kx + ty * ky
    L, D, rate = np.sqrt(T), T - g * b, 0.0
    way = slip_on(other, mem, *place_on(other, z, tx, ty))
    held, slides = drag(par, way, pressed)
    bend(par, mem[PLACE] if mem[FREE] > 0.0 else par[HOME], tx, ty, own, turn, 0)
    bend(other, at, -tx, -ty, work, turn, m)
    for q in range(n):
        rows[4, q] = 0.0
    slope_row(other, z, tx, ty, work, across, rows[4][m:])
    for q in range(n):
        # dz/dq
        rows[5, q] = (rows[3, q] + g * rows[2, q]) / D
        rate += L * rows[5, q] * w[q]
    share = 0.0 if not slides else par[FRICTION] if held > 0.0 else -par[FRICTION]
    stick = 0.0 if slides else par[STICK] * L
    for p in range(n):
        N, B, A, t, zp = rows[0, p], rows[2, p], rows[3, p], rows[4, p], rows[5, p]
        f[p] -= held * L * zp
        cross = b * N + k / T * A - 2.0 * t
        for q in range(n):
            zq = rows[5, q]
            bent = turn[p, q] + N * rows[2, q] + B * rows[0, q] + (A * rows[4, q] + t * rows[3, q]) / T
            bent += cross * zq + zp * (b * rows[0, q] + k / T * rows[3, q] - 2.0 * rows[4, q]) - 3.0 * k * zp * zq
            longer = (rows[4, q] + k * zq) / L
            H[p, q] -= held * (L * bent / D + zp * longer)
            H[p, q] += stick * zp * (L * zq + way / L * longer) + share * L * zp * rows[1, q]
            C[p, q] += share * L * zp * par[WEIGHT] * par[DAMPING] * rows[0, q]
    return -held * rate


def compliant(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Pressure max(0, -k g - c dg/dt) per length at a point of a body, and its opposite where it is on the other.

    With friction that is elastic up to Coulomb's limit; at a kink, where no place on the curve moves, there is none.
    """
    own, work, across, rows = work_vector(WORK), work_vector(WORK), work_vector(WORK), work_matrix(6, len(u))
    n, weight, stiffness, damping = len(u), par[WEIGHT], par[STIFFNESS], par[DAMPING]
    g, nx, ny, z = gap_between(par, p0, u, mem, own, work, across)
    if not g < 0.0:
        return 0.0, 0.0
    bent_between(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, H)
    rate = 0.0
    for q in range(n):
        rate += rows[0, q] * w[q]
    pressure, energy = -stiffness * g - damping * rate, 0.5 * weight * stiffness * g * g
    if pressure <= 0.0:
        for p in range(n):
            for q in range(n):
                H[p, q] = 0.0
        return energy, weight * stiffness * g * -rate
    for p in range(n):
        slope = 0.0
        rows[3, p] = rows[1, p]
        for q in range(n):
            slope += H[p, q] * w[q]
        # of the pressure, with the sign turned
        rows[1, p] = weight * (stiffness * rows[0, p] + damping * slope)
    for p in range(n):
        N = rows[0, p]
        f[p] = -weight * pressure * N
        for q in range(n):
            H[p, q] = -weight * pressure * H[p, q] + N * rows[1, q]
            C[p, q] = weight * damping * N * rows[0, q]
    power = weight * damping * rate * rate
    if par[FRICTION] > 0.0 and mem[FOUND] == WITHIN:
        power += rub_between(par, p0, u, w, mem, g, z, nx, ny, weight * pressure, own, work, across, rows, f, H, C)
    return energy, power


def hard(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """No penetration: the multiplier, the last field, is minus the force; see ``contact.hard``."""
    m, c = len(u) - 1, par[STIFFNESS]
    force = -u[m]
    f[m], H[m, m] = force / c, -1.0 / c
    if mem[FREE] < 0.0 or mem[HELD] == OPEN:
        return 0.0, 0.0
    own, work, across, rows = work_vector(WORK), work_vector(WORK), work_vector(WORK), work_matrix(3, m)
    g, nx, ny, z = gap_between(par, p0, u, mem, own, work, across)
    if np.isnan(g) or (mem[HELD] == BY_CHOICE and force - c * g < -c * par[TOUCH]):
        return 0.0, 0.0
    H[m, m] = 0.0
    bent_between(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, H)
    for p in range(m):
        f[p] = -force * rows[0, p]
        for q in range(m):
            H[p, q] *= -force
        H[p, m] = H[m, p] = rows[0, p]
    f[m] = g
    return 0.0, 0.0


def accept(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Keep the side of an axis that the point is on, from where it comes to be beside it, and what friction holds."""
    other, m = par[ORIGIN:], size_of(par)
    own, work, across = work_vector(WORK), work_vector(WORK), work_vector(WORK)
    if other[BOTH] != 0.0:
        if mem[FOUND] != WITHIN:
            mem[SIDE] = 0.0
        elif mem[SIDE] == 0.0:
            mem[SIDE] = 1.0
            if gap_between(par, p0, u, mem, own, work, across)[0] < 0.0:
                mem[SIDE] = -1.0
    if par[FRICTION] == 0.0:
        return
    g, _, _, z = gap_between(par, p0, u, mem, own, work, across)
    if not np.isnan(g) and mem[FOUND] == WITHIN:
        tx, ty, _, _ = curve_at(other, p0[m:], u[m:], z, work, across)
        place, unit = place_on(other, z, tx, ty)
        pressed = par[WEIGHT] * par[STIFFNESS] * max(-g, 0.0)
        held, slides = drag(par, slip_on(other, mem, place, unit), pressed)
        if slides or mem[ON] != surface_of(other):
            mem[ANCHOR] = place + held / (par[STICK] * unit)
        mem[ON] = surface_of(other)
    elif not g < 0.0:
        # apart from everything
        mem[ON] = 0.0


COMPLIANT_BODIES = PointLaw("contact_of_bodies", compliant, contact.over_step(compliant, 0), accept=accept)
HARD_BODIES = PointLaw("hard_contact_of_bodies", hard, contact.over_step(hard, 1), constraint=True, accept=accept)
