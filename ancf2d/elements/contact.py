"""Laws of contact between a point of a body and an obstacle: compliant (``contact_layer``), and hard.

A point of hard contact may lie between nodes and slide there (``contact_sliding``).

Functions of arrays and numbers alone, which the kernels compile unchanged.
"""

from __future__ import annotations

import numpy as np

from .contact_derivatives import add_hessian_by_fields, derivative_along, field_count
from .contact_geometry import (
    AFTER_IMPACT,
    ANCHOR,
    AT_HOME,
    AUGMENTATION,
    BY,
    BY_BY,
    BY_FORCE,
    CLOSES,
    FEATURE,
    FRICTION,
    HOME,
    MATRIX,
    NO_IMPACT,
    ON_BEAM,
    OPEN,
    OPPOSITE,
    OTHER,
    OUTSIDE,
    PLACE,
    PLACEMENT,
    POLYLINE,
    POSE_X,
    POSE_Y,
    RHO,
    ROW,
    SHAPE,
    SLIDING,
    SLIP_STATUS,
    START_GAP,
    STATUS,
    STICK,
    STICKS,
    TOUCH,
    WIDE,
    WORK,
    count_of,
    faces_away,
    gap_at,
    next_start_gap,
    offset_at,
    opens_by_force,
    position_at,
)
from .contact_layer import accept_layer, accept_layer_at, coulomb_force, layer, layer_at, safe_change, slip
from .contact_sliding import add_sliding_hessian, compliance, gap_at_place, sliding_place
from .point_laws import APART, PointLaw, match_work, work_matrix, work_vector


def add_gap_hessian(par, z, nx, ny, k, work, H):  # type: ignore[no-untyped-def]
    """Add the Hessian nu.rho_qq + k A A of the gap of a fixed point to H."""
    body, pose = count_of(par)
    n = body + pose
    for a in range(n):
        ta = -ny * work[BY + a] + nx * work[BY + WIDE + a]
        for b in range(n):
            tb = -ny * work[BY + b] + nx * work[BY + WIDE + b]
            bend = nx * work[BY_BY + WIDE * a + b] + ny * work[BY_BY + WIDE * (WIDE + a) + b]
            work[MATRIX + WIDE * a + b] = bend + k * ta * tb
    add_hessian_by_fields(par, z, work, H, 0, 1.0)


def friction_force(par, mem, way, pressed):  # type: ignore[no-untyped-def]
    """Return (friction force along s for a slip, whether it slides), by Coulomb's law or as mem[SLIP_STATUS] says."""
    if mem[SLIP_STATUS] == 0.0:
        return coulomb_force(par, way, pressed)
    if mem[SLIP_STATUS] == STICKS:
        return -par[STICK] * way, False
    if mem[SLIP_STATUS] == CLOSES:
        return 0.0, True
    return mem[SLIP_STATUS] * par[FRICTION] * pressed, True


def add_friction(par, z, nx, ny, k, ds, force, stiff, work, f, H):  # type: ignore[no-untyped-def]
    """Add a friction force along s to f, and its derivative at constant pressure to H; leave ds/dq in work (ROW)."""
    body, pose = count_of(par)
    n = body + pose
    for a in range(n):
        na, ta = nx * work[BY + a] + ny * work[BY + WIDE + a], -ny * work[BY + a] + nx * work[BY + WIDE + a]
        for b in range(n):
            nb, tb = nx * work[BY + b] + ny * work[BY + WIDE + b], -ny * work[BY + b] + nx * work[BY + WIDE + b]
            bend = -ny * work[BY_BY + WIDE * a + b] + nx * work[BY_BY + WIDE * (WIDE + a) + b]
            work[MATRIX + WIDE * a + b] = ds * (bend - k * (na * tb + ta * nb))
    add_hessian_by_fields(par, z, work, H, 0, -force)
    derivative_along(par, z, -ds * ny, ds * nx, work, work, ROW)
    m = field_count(par)
    for p in range(m):
        f[p] -= force * work[ROW + p]
        for q in range(m):
            H[p, q] += stiff * work[ROW + p] * work[ROW + q]


def slip_rate(work, w, m):  # type: ignore[no-untyped-def]
    """Return the slip rate on the obstacle at rates w (m,).

    Friction power is the force times this rate, so the small energy in the spring of a sticking point counts as lost.
    """
    rate = 0.0
    for q in range(m):
        rate += work[ROW + q] * w[q]
    return rate


def hard(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Contact without penetration: the last field is the multiplier, minus the force; a point that would pull is open.

    Closed points are stationary points of U + lambda g, open ones of U - lambda^2/(2 c) (Alart & Curnier 1991). A point
    is closed if -lambda - c g > 0, unless the solver prescribes its status (mem[STATUS]). Returns (0, power), or (the
    result of ``safe_change``, APART) if the point is open by its gap.
    """
    m, c = len(u) - 1, par[AUGMENTATION]
    force = -u[m]
    f[m], H[m, m] = force / c, -1.0 / c
    if mem[PLACEMENT] < 0.0 or mem[STATUS] == OPEN:
        return 0.0, 0.0
    work, stays = work_vector(WORK), mem[PLACEMENT] == AT_HOME
    z, feature = par[HOME] if stays else mem[PLACE], -1.0 if stays else mem[FEATURE]
    found = sliding_place(par, p0, u, mem, force, work) if mem[PLACEMENT] == SLIDING else np.nan
    moves = not np.isnan(found)
    if moves:
        z = found
        g, nx, ny, k, s, ds = gap_at_place(par, mem, z, force, work)
    else:
        position_at(par, p0, u, z, work)
        g, nx, ny, k, s, ds = gap_at(par, work[RHO], work[RHO + 1], feature)
    outside = mem[START_GAP] == OUTSIDE
    g -= 0.0 if outside else mem[START_GAP]
    if opens_by_force(par, mem, force, g) or (mem[STATUS] < OPEN and outside and faces_away(par, nx, ny, work)):
        return (change_to_touch(par, g - par[TOUCH], work) if stays and outside else 0.0), APART
    soft, slope = 0.0, 0.0
    if mem[PLACEMENT] == SLIDING or mem[PLACEMENT] == ON_BEAM:
        soft, slope, _ = compliance(par, z)
    H[m, m], slope = -soft, 0.5 * slope * force
    if moves:
        H[m, m] += 0.5 * slope * compliance(par, z)[1] * add_sliding_hessian(par, z, nx, ny, k, force, work, H, m)
    else:
        add_gap_hessian(par, z, nx, ny, k, work, H)
    derivative_along(par, z, nx, ny, work, work, ROW)
    for p in range(m):
        f[p] = -force * work[ROW + p]
        for q in range(m):
            H[p, q] *= -force
        H[p, m] = H[m, p] = work[ROW + p] - (slope * work[OTHER + p] if moves else 0.0)
    f[m] = g + soft * force
    if par[FRICTION] == 0.0 or moves or mem[SLIP_STATUS] == CLOSES or (force <= 0.0 and mem[SLIP_STATUS] == 0.0):
        return 0.0, 0.0
    way = slip(par, s, mem[ANCHOR])
    return 0.0, -add_coulomb_friction(par, mem, z, nx, ny, k, way, ds, force, work, f, H) * slip_rate(work, w, m)


def add_coulomb_friction(par, mem, z, nx, ny, k, way, ds, force, work, f, H):  # type: ignore[no-untyped-def]
    """Add friction under a normal force to f and H; return the friction force, and leave ds/dq in work (ROW)."""
    held, slides = friction_force(par, mem, way, force)
    add_friction(par, z, nx, ny, k, ds, held, 0.0 if slides else par[STICK], work, f, H)
    if slides:
        # between equilibria, the normal force of a sliding point may pull
        m, sign = len(f) - 1, 1.0 if (held if mem[SLIP_STATUS] == 0.0 else mem[SLIP_STATUS]) < 0.0 else -1.0
        for p in range(m):
            # Coulomb's limit grows with the normal force, which is minus the multiplier
            H[p, m] -= sign * par[FRICTION] * work[ROW + p]
    return held


def change_to_touch(par, g, work):  # type: ignore[no-untyped-def]
    """Return a sum of changes of fields below which a point with the gap g, at home, cannot touch, or 0."""
    if int(par[SHAPE]) == POLYLINE and par[OPPOSITE + 1] <= 0.0:
        # gaps jump at the ends of open polylines
        return 0.0
    offset, place = abs(offset_at(par, par[HOME])[0]), (work[RHO] - par[POSE_X], work[RHO + 1] - par[POSE_Y])
    return max(safe_change(par, g, 0.0, offset, place), 0.0)


def over_step(law, extra):  # type: ignore[no-untyped-def]
    """Return ``mean`` of a law: forces of a step whose work is the difference of the energy (Gonzalez 1996).

    Damping and friction are added with their mid-step forces and powers. ``extra`` is the number of multipliers among
    the fields (0 or 1).
    """
    def mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
        m = len(u1) - extra
        n = len(u1)
        keep = work_matrix(5, n)
        H, C = work_matrix(n, n), work_matrix(n, n)
        for i in range(n):
            keep[0, i] = 0.5 * (u0[i] + u1[i])
        if extra == 1:
            keep[0, m] = u1[m]
        # zero rates and no friction first: dissipative forces are added below
        friction, lost = par[FRICTION], 0.0
        par[FRICTION] = 0.0
        law(p0, keep[0], keep[1], par, a1, mem, f, H, C)
        before, _ = law(p0, u0, keep[1], par, a0, mem, keep[2], H, C)
        after, _ = law(p0, u1, keep[1], par, a1, mem, keep[3], H, C)
        par[FRICTION] = friction
        if extra == 1:
            before, after = u1[m] * keep[2, m], u1[m] * keep[3, m]
            f[m] = keep[3, m]
        else:
            _, lost = law(p0, keep[0], w, par, a1, mem, keep[4], H, C)
            if lost == APART:
                lost = 0.0
            for i in range(m):
                keep[4, i] -= f[i]
        match_work(f, u0, u1, after - before, keep[3], keep[2], m)
        for i in range(m):
            f[i] += keep[4, i]
        return after if extra == 0 else 0.0, lost
    return mean


def _update_history(par, p0, u, mem, z, pressed):  # type: ignore[no-untyped-def]
    """Update, at an accepted state, the friction anchor and, in motion, the gap from which the point presses.
    """
    work = work_vector(WORK)
    position_at(par, p0, u, z, work)
    g, nx, ny, _, s, _ = gap_at(par, work[RHO], work[RHO + 1], -1.0)
    if mem[STATUS] == BY_FORCE:
        # the gap of a pressing point is START_GAP, up to round-off
        kept = pressed > 0.0 and mem[START_GAP] != OUTSIDE
        mem[START_GAP] = mem[START_GAP] if kept else 0.0 if pressed > 0.0 else next_start_gap(
            mem[START_GAP], g + par[TOUCH], not faces_away(par, nx, ny, work))
    if par[FRICTION] == 0.0:
        return
    held, slides = friction_force(par, mem, slip(par, s, mem[ANCHOR]), pressed)
    if mem[AFTER_IMPACT] != NO_IMPACT:
        held, slides, mem[AFTER_IMPACT] = mem[AFTER_IMPACT], True, NO_IMPACT
    if slides or np.isnan(mem[ANCHOR]):
        mem[ANCHOR] = s + held / par[STICK]


def accept_hard(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Update the start of the search for a sliding point, and the friction history, at an accepted state."""
    if mem[PLACEMENT] == SLIDING:
        z = sliding_place(par, p0, u, mem, -u[len(u) - 1], work_vector(WORK))
        if not np.isnan(z):
            mem[PLACE] = z
    elif mem[PLACEMENT] >= AT_HOME and mem[STATUS] != OPEN:
        pressed = max(-u[len(u) - 1], 0.0)
        _update_history(par, p0, u, mem, par[HOME] if mem[PLACEMENT] == AT_HOME else mem[PLACE], pressed)
        if mem[STATUS] == BY_FORCE and par[FRICTION] > 0.0:
            # forces of a step are not impulses: a point that closes in the next step gets the friction of its impact
            mem[SLIP_STATUS] = 0.0 if pressed > 0.0 else CLOSES


COMPLIANT = PointLaw("compliant_contact", layer_at, over_step(layer_at, 0), accept=accept_layer_at, forces_of_run=layer,
                     accept_run=accept_layer)
HARD = PointLaw("hard_contact", hard, over_step(hard, 1), constraint=True, accept=accept_hard)
