"""Laws of contact between a point of a body and the curve of an element (``contact_gaps``): compliant, and hard.

Forces are minus N times the pressure, so that the two bodies are in equilibrium, in force and moment. For the same
reason, friction acts along |t| dz/dq, the displacement of the foot point on the curve.

Functions of arrays and numbers alone, which the kernels compile unchanged.
"""

from __future__ import annotations

import numpy as np

from . import contact
from .contact import friction_force
from .contact_derivatives import add_second_derivative, field_count
from .contact_gaps import (
    BOTH_SIDES,
    END,
    FOOT_KIND,
    LOOP,
    NUMBER,
    SIDE,
    SURFACE,
    WITHIN,
    curve_at,
    distance_along,
    foot_and_angle,
    gap_between,
    gap_derivatives,
    is_past_end,
    place_on,
    place_opposite,
    shares_at,
    tangent_row,
)
from .contact_geometry import (
    AFTER_IMPACT,
    ANCHOR,
    AUGMENTATION,
    BY_FORCE,
    CLOSED,
    CLOSES,
    DAMPING,
    FRICTION,
    HOME,
    NO_IMPACT,
    OPEN,
    OPPOSITE,
    PLACE,
    PLACEMENT,
    SLIP_STATUS,
    STATUS,
    STICK,
    STIFFNESS,
    WEIGHT,
    WORK,
    opens_by_force,
)
from .point_laws import APART, PointLaw, work_matrix, work_vector


def slip_from_anchor(other, mem, place, unit):  # type: ignore[no-untyped-def]
    """Return the slip from the friction anchor to a place, or 0 if the anchor is on another surface."""
    return unit * distance_along(other[LOOP], place, mem[ANCHOR]) if mem[SURFACE] == other[NUMBER] else 0.0


def foot_derivatives(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, bent):  # type: ignore[no-untyped-def]
    """Set rows 4 and 5 to t.dc'/dq and dz/dq, and ``bent``, zero on entry, to d2z/dq2 but for terms proportional to the
    depth; return |t| and t.c''.

    Rows 0, 2 and 3 are N, B and A. With F = R.t, d2z/dq2 = (F_qq + F_qz z_q + z_q F_qz + F_zz z_q z_q)/D.
    """
    other, m, n = par[OPPOSITE:], field_count(par), field_count(par) + field_count(par[OPPOSITE:])
    tx, ty, kx, ky = curve_at(other, p0[m:], u[m:], z, work, across)
    T, b, k = tx * tx + ty * ty, nx * kx + ny * ky, tx * kx + ty * ky
    D = T - g * b
    add_second_derivative(par, mem[PLACE] if mem[PLACEMENT] > 0.0 else par[HOME], tx, ty, own, bent, 0)
    add_second_derivative(other, z if other[END] == 0.0 else other[END], -tx, -ty, work, bent, m)
    for q in range(n):
        rows[4, q], rows[5, q] = 0.0, (rows[3, q] + g * rows[2, q]) / D
    tangent_row(other, z, tx, ty, work, across, rows[4][m:])
    for p in range(n):
        N, B, A, t, zp = rows[0, p], rows[2, p], rows[3, p], rows[4, p], rows[5, p]
        cross = b * N + k / T * A - 2.0 * t
        for q in range(n):
            zq = rows[5, q]
            bent[p, q] += N * rows[2, q] + B * rows[0, q] + (A * rows[4, q] + t * rows[3, q]) / T
            bent[p, q] += cross * zq + zp * (b * rows[0, q] + k / T * rows[3, q] - 2.0 * rows[4, q] - 3.0 * k * zq)
            bent[p, q] /= D
    return np.sqrt(T), k


def add_friction_between(par, p0, u, w, mem, g, z, nx, ny, pressed, damped, own, work, across, rows, f, H,
                         C):  # type: ignore[no-untyped-def]
    """Add friction to f, H and C; return its power, and the derivative of its force by the normal force.

    Rows 0 to 3 are N, the derivative of the normal force with the sign reversed, B and A; rows 4 and 5 are filled, row
    5 with dz/dq. The normal force changes by ``damped`` N with rates. H omits the terms of ``foot_derivatives``.
    """
    other, m, n, rate = par[OPPOSITE:], field_count(par), field_count(par) + field_count(par[OPPOSITE:]), 0.0
    bent = work_matrix(n, n)
    L, k = foot_derivatives(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, bent)
    tx, ty, _, _ = curve_at(other, p0[m:], u[m:], z, work, across)
    way = slip_from_anchor(other, mem, *place_on(other, z, tx, ty))
    held, slides = friction_force(par, mem, way, pressed)
    share, stick = 0.0, 0.0
    if not slides:
        stick = par[STICK] * L
    elif mem[SLIP_STATUS] != 0.0:
        # as the solver prescribes: between equilibria the normal force may pull
        share = mem[SLIP_STATUS] * par[FRICTION]
    else:
        share = par[FRICTION] if held > 0.0 else -par[FRICTION]
    for p in range(n):
        zp = rows[5, p]
        rate += L * zp * w[p]
        f[p] -= held * L * zp
        for q in range(n):
            longer = (rows[4, q] + k * rows[5, q]) / L
            H[p, q] -= held * (L * bent[p, q] + zp * longer)
            H[p, q] += stick * zp * (L * rows[5, q] + way / L * longer) + share * L * zp * rows[1, q]
            C[p, q] += share * L * zp * damped * rows[0, q]
    return -held * rate, share * L


def compliant(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Pressure max(0, -k g - c dg/dt) per length at a point of a body, and the opposite force on the other body.

    A point has shares of it and of its energy (``shares_at``), so that this energy is a continuous function of the
    position. Friction is elastic up to Coulomb's limit; at a kink there is none, because the foot point does not move
    there.
    """
    own, work, across, rows = work_vector(WORK), work_vector(WORK), work_vector(WORK), work_matrix(7, len(u))
    n, stiffness, damping = len(u), par[STIFFNESS], par[DAMPING]
    g, nx, ny, z = gap_between(par, p0, u, mem, own, work, across)
    if not g < 0.0:
        return 0.0, APART
    shares = shares_at(par, mem, nx, ny, g, z, own)
    weight, whole = par[WEIGHT] * shares[0] * shares[6], 0.5 * par[WEIGHT] * stiffness * g * g
    if weight == 0.0:
        return 0.0, APART
    gap_derivatives(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, H)
    rate = 0.0
    for q in range(n):
        rate += rows[0, q] * w[q]
    pressure, power = -stiffness * g - damping * rate, weight * damping * rate * rate
    if pressure <= 0.0:
        pressure, stiffness, damping, power = 0.0, 0.0, 0.0, weight * stiffness * g * -rate
    for p in range(n):
        slope = 0.0
        rows[3, p] = rows[1, p]
        for q in range(n):
            slope += H[p, q] * w[q]
        # derivative of the pressure, with the sign reversed
        rows[1, p] = weight * (stiffness * rows[0, p] + damping * slope)
    for p in range(n):
        f[p] = -weight * pressure * rows[0, p]
        for q in range(n):
            H[p, q] *= whole * shares[3] * shares[6] - weight * pressure
            C[p, q] = weight * damping * rows[0, p] * rows[0, q]
    add_change_of_shares(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, pressure, whole, shares, f, H)
    for p in range(n):
        for q in range(n):
            H[p, q] += rows[0, p] * rows[1, q]
    if par[FRICTION] > 0.0 and mem[FOOT_KIND] == WITHIN and pressure > 0.0:
        power += add_friction_between(par, p0, u, w, mem, g, z, nx, ny, weight * pressure, weight * damping, own, work,
                                      across, rows, f, H, C)[0]
    return shares[0] * shares[6] * whole, power


def add_change_of_shares(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, pressure, whole, shares, f,
                         H):  # type: ignore[no-untyped-def]
    """Add to f and H what the change of the shares of an energy ``whole`` adds to them, and to row 1 that of the
    pressure, with its sign reversed.

    H omits terms proportional to the depth cubed (``foot_derivatives``), and the second derivatives of the angle.
    """
    foot_and_angle(par, p0, u, mem, g, nx, ny, z, own, work, across, rows)
    part, by_z, by_zz, by_g, by_gg, by_zg, turned, by_angle, twice = shares
    n, by_gap = len(f), par[WEIGHT] * par[STIFFNESS] * g
    for p in range(n):
        zp, gp, ap = rows[5, p], rows[0, p], rows[6, p]
        change = turned * (by_z * zp + by_g * gp) + part * by_angle * ap
        f[p] += whole * change
        rows[1, p] -= par[WEIGHT] * pressure * change
        z_too = turned * (by_zz * zp + by_zg * gp) + by_z * by_angle * ap
        g_too = by_gap * change + whole * (turned * (by_zg * zp + by_gg * gp) + by_g * by_angle * ap)
        angle_too = by_angle * (by_z * zp + by_g * gp) + part * twice * ap
        for q in range(n):
            H[p, q] += g_too * rows[0, q] + whole * (z_too * rows[5, q] + angle_too * rows[6, q])
    if by_z == 0.0:
        return
    bent = work_matrix(n, n)
    foot_derivatives(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, bent)
    for p in range(n):
        for q in range(n):
            H[p, q] += whole * turned * by_z * bent[p, q]


def add_normal_force(p0, u, par, mem, f, H, own, work, across, rows):  # type: ignore[no-untyped-def]
    """Fill f and H of a hard contact point; return gap, its gradient and the foot point, or NaN if the point is open.

    A point that the solver holds closed continues along the curve beyond an end of the other body.
    """
    m, c = len(u) - 1, par[AUGMENTATION]
    force = -u[m]
    f[m], H[m, m] = force / c, -1.0 / c
    if mem[PLACEMENT] < 0.0 or mem[STATUS] == OPEN:
        return np.nan, 0.0, 0.0, 0.0
    if mem[STATUS] == CLOSED and is_past_end(par[OPPOSITE:], mem[FOOT_KIND]):
        mem[FOOT_KIND] = WITHIN
    g, nx, ny, z = gap_between(par, p0, u, mem, own, work, across)
    if np.isnan(g) or opens_by_force(par, mem, force, g):
        return np.nan, 0.0, 0.0, 0.0
    H[m, m] = 0.0
    gap_derivatives(par, p0, u, mem, g, nx, ny, z, own, work, across, rows, H)
    for p in range(m):
        f[p] = -force * rows[0, p]
        for q in range(m):
            H[p, q] *= -force
        H[p, m] = H[m, p] = rows[0, p]
    f[m] = g
    return g, nx, ny, z


def hard(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Contact without penetration: the last field is the multiplier, minus the force; see ``contact.hard``."""
    own, work, across, rows = work_vector(WORK), work_vector(WORK), work_vector(WORK), work_matrix(3, len(u) - 1)
    add_normal_force(p0, u, par, mem, f, H, own, work, across, rows)
    return 0.0, 0.0


def hard_rough(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Contact without penetration, with Coulomb friction along the other curve; none at a kink (fixed foot point)."""
    m, own, work, across = len(u) - 1, work_vector(WORK), work_vector(WORK), work_vector(WORK)
    rows = work_matrix(6, m)
    g, nx, ny, z = add_normal_force(p0, u, par, mem, f, H, own, work, across, rows)
    if np.isnan(g) or par[FRICTION] == 0.0 or mem[FOOT_KIND] != WITHIN or mem[SLIP_STATUS] == CLOSES or (
            u[m] >= 0.0 and mem[SLIP_STATUS] == 0.0):
        return 0.0, 0.0
    for p in range(m):
        # the normal force is an unknown, so it does not depend on the coordinates
        rows[3, p], rows[1, p] = rows[1, p], 0.0
    power, share = add_friction_between(par, p0, u, w, mem, g, z, nx, ny, -u[m], 0.0, own, work, across, rows, f, H, C)
    for p in range(m):
        H[p, m] += share * rows[5, p]
    return 0.0, power


def update_side(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Update the side of an axis that the point is on: set when it comes opposite to the axis, 0 beyond its ends."""
    if par[OPPOSITE + BOTH_SIDES] == 0.0:
        return
    if mem[FOOT_KIND] != WITHIN:
        mem[SIDE] = 0.0
    elif mem[SIDE] == 0.0:
        mem[SIDE] = 1.0
        own, work, across = work_vector(WORK), work_vector(WORK), work_vector(WORK)
        if gap_between(par, p0, u, mem, own, work, across)[0] < 0.0:
            mem[SIDE] = -1.0


def update_anchor(p0, u, par, mem, pressed):  # type: ignore[no-untyped-def]
    """Update the friction anchor at an accepted state; return the gap. If ``pressed`` is negative, the normal force
    of the layer is used."""
    own, work, across = work_vector(WORK), work_vector(WORK), work_vector(WORK)
    behind, mem[AFTER_IMPACT] = mem[AFTER_IMPACT], NO_IMPACT
    g, nx, ny, z = gap_between(par, p0, u, mem, own, work, across)
    if np.isnan(g) or mem[FOOT_KIND] != WITHIN:
        return g
    place, unit, surface = place_opposite(par, p0, u, mem, z, work, across)
    if pressed < 0.0:
        shares = shares_at(par, mem, nx, ny, g, z, own)
        pressed = shares[0] * shares[6] * par[WEIGHT] * par[STIFFNESS] * max(-g, 0.0)
    held, slides = friction_force(par, mem, slip_from_anchor(par[OPPOSITE:], mem, place, unit), pressed)
    if behind != NO_IMPACT:
        held, slides = behind, True
    if slides or mem[SURFACE] != surface:
        mem[ANCHOR] = place + held / (par[STICK] * unit)
    mem[SURFACE] = surface
    return g


def accept(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Update the side of an axis that the point is on, and the friction anchor of a layer, at an accepted state."""
    update_side(p0, u, par, mem)
    if par[FRICTION] > 0.0:
        g = update_anchor(p0, u, par, mem, -1.0)
        if np.isnan(g) or (mem[FOOT_KIND] != WITHIN and g >= 0.0):
            # no contact: the anchor is dropped
            mem[SURFACE] = 0.0


def accept_rough(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Update the side of an axis that the point is on, and the friction anchor if the point is closed."""
    update_side(p0, u, par, mem)
    if par[FRICTION] > 0.0 and mem[PLACEMENT] >= 0.0 and mem[STATUS] != OPEN:
        pressed = max(-u[len(u) - 1], 0.0)
        update_anchor(p0, u, par, mem, pressed)
        if mem[STATUS] == BY_FORCE:
            # same as in ``contact.accept_hard``
            mem[SLIP_STATUS] = 0.0 if pressed > 0.0 else CLOSES


COMPLIANT_BODIES = PointLaw("contact_of_bodies", compliant, contact.over_step(compliant, 0), accept=accept)
HARD_BODIES = PointLaw("hard_contact_of_bodies", hard, contact.over_step(hard, 1), constraint=True, accept=update_side)
ROUGH_BODIES = PointLaw("rough_contact_of_bodies", hard_rough, contact.over_step(hard_rough, 1), constraint=True,
                        accept=accept_rough)
