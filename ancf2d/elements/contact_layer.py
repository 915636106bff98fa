"""The law of a layer between a curve of an element and an obstacle: pressure and friction at all points of the curve.

In the frame of the obstacle, with pose (R, x), a point rho is at q = R^T (rho - x) plus a constant. With the unit
vectors nu normal and t tangential to the obstacle there, and its curvature k, the gap has the gradient N = nu.q_u by
the fields and the Hessian nu.q_uu + k T T, T = t.q_u; the place on the obstacle has the gradient ds T and, for ds = 1,
the Hessian t.q_uu - k (N T + T N). q_uu comes from the rotation of sections and of the pose only.

Functions of arrays and numbers alone, which the kernels compile unchanged. Loops start at zero, so that the compiler
need not handle negative indices.
"""

from __future__ import annotations

import numpy as np

from .contact_geometry import (
    ANCHOR,
    AWAY,
    BY_ANGLE,
    BY_DIRECTION,
    CIRCLE,
    CURVE,
    DAMPING,
    FACE,
    FRICTION,
    HOME,
    LENGTH,
    OF_TANGENT,
    OF_THETA,
    OPPOSITE,
    OUTSIDE,
    POLYLINE,
    POSE,
    POSE_X,
    POSE_Y,
    SECTION,
    SHAPE,
    START_GAP,
    STICK,
    STIFFNESS,
    STILL,
    TERMS,
    WEIGHT,
    bound_on_distance,
    distance_at,
    largest_offset,
    next_start_gap,
    offset_at,
    place_at,
)
from .point_laws import APART, work_matrix

# rows of work: the fields, powers of z and their derivatives, N, T, and other derivatives by the fields
HERE, POWERS, SLOPES, ACROSS, ALONG, RATE, OTHER = range(7)
ROWS = 7
# result of ``to_obstacle_frame`` for an obstacle that does not rotate
NO_ROTATION = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def slip(par, s, anchor):  # type: ignore[no-untyped-def]
    """Return the slip from ``anchor`` to s along the obstacle, the shorter way around; 0 if anchor is NaN."""
    if np.isnan(anchor):
        return 0.0
    way = s - anchor
    if int(par[SHAPE]) == CIRCLE:
        round_ = 2.0 * np.pi * abs(par[OPPOSITE + 2])
    elif int(par[SHAPE]) == POLYLINE and par[OPPOSITE + 1] > 0.0:
        round_ = par[OPPOSITE + 1]
    else:
        return way
    return way - round_ * np.floor(way / round_ + 0.5)


def coulomb_force(par, way, pressed):  # type: ignore[no-untyped-def]
    """Return (friction force along s for a slip, whether it slides): elastic up to Coulomb's limit."""
    force, most = -par[STICK] * way, par[FRICTION] * pressed
    if abs(force) <= most:
        return force, False
    return (most if force > 0.0 else -most), True


def sets_of(par):  # type: ignore[no-untyped-def]
    """Return the number of sets of coefficients of the curve, and the index of the first field of the pose."""
    sets = 3 if int(par[SECTION]) == OF_THETA else 2
    return sets, sets * int(par[TERMS])


def position_at(par, work, z):  # type: ignore[no-untyped-def]
    """Fill the powers of z; return rho, drho/dz, and the derivatives of rho by the section (theta or tangent).

    The latter are those of x and y by theta or by the first component of the tangent, then by its second component.
    """
    terms, section, P, S = int(par[TERMS]), int(par[SECTION]), work[POWERS], work[SLOPES]
    xs, ys = work[HERE, :terms], work[HERE, terms:2 * terms]
    x, y, x1, y1, x2, y2, m0, m1, m2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
    for j in range(terms):
        P[j], S[j] = m0, m1
        x, y, x1, y1 = x + xs[j] * m0, y + ys[j] * m0, x1 + xs[j] * m1, y1 + ys[j] * m1
        x2, y2 = x2 + xs[j] * m2, y2 + ys[j] * m2
        m0, m1, m2 = m0 * z, m1 * z + m0, m2 * z + 2.0 * m1
    (h, slope), a, b, c, d = offset_at(par, z), 0.0, 0.0, 0.0, 0.0
    if section == OF_THETA:
        ts, t, t1 = work[HERE, 2 * terms:], 0.0, 0.0
        for j in range(terms):
            t, t1 = t + ts[j] * P[j], t1 + ts[j] * S[j]
        ex, ey = np.cos(t), np.sin(t)
        a, b = -h * ex, -h * ey
        x, y, x1, y1 = x + b, y - a, x1 + a * t1 - slope * ey, y1 + b * t1 + slope * ex
    elif section == OF_TANGENT and (h != 0.0 or slope != 0.0):
        L = np.sqrt(x1 * x1 + y1 * y1)
        ex, ey = x1 / L, y1 / L
        x, y = x - h * ey, y + h * ex
        a, b, c, d = h * ex * ey / L, h * ey * ey / L, -h * ex * ex / L, -h * ex * ey / L
        x1, y1 = x1 + a * x2 + c * y2 - slope * ey, y1 + b * x2 + d * y2 + slope * ex
    return x, y, x1, y1, a, b, c, d


def to_obstacle_frame(par, fields, x, y):  # type: ignore[no-untyped-def]
    """Return q, the direction (c, s) of the obstacle, and (x, y)/LENGTH, the derivatives of q by this direction."""
    pose = int(par[POSE])
    if pose == BY_ANGLE:
        c, s = np.cos(fields[2]), np.sin(fields[2])
    elif pose == BY_DIRECTION:
        c, s = fields[2] / par[LENGTH], fields[3] / par[LENGTH]
    else:
        return x, y, 1.0, 0.0, 0.0, 0.0
    x, y = x - fields[0], y - fields[1]
    return c * x + s * y, c * y - s * x, c, s, x / par[LENGTH], y / par[LENGTH]


def row_of(par, work, x, y, bends, q, out):  # type: ignore[no-untyped-def]
    """Fill out (fields,) with v.q_u for a vector v in the frame of the obstacle."""
    terms, section, pose = int(par[TERMS]), int(par[SECTION]), int(par[POSE])
    P, S, us, vs = work[POWERS], work[SLOPES], out[:terms], out[terms:2 * terms]
    vx, vy = q[2] * x - q[3] * y, q[3] * x + q[2] * y
    a, b = vx * bends[0] + vy * bends[1], vx * bends[2] + vy * bends[3]
    for j in range(terms):
        us[j], vs[j] = vx * P[j], vy * P[j]
    _, at = sets_of(par)
    if section == OF_TANGENT:
        for j in range(terms):
            us[j] += a * S[j]
            vs[j] += b * S[j]
    elif section == OF_THETA:
        ts = out[2 * terms:]
        for j in range(terms):
            ts[j] = a * P[j]
    if pose == BY_ANGLE:
        out[at], out[at + 1], out[at + 2] = -vx, -vy, x * q[1] - y * q[0]
    elif pose == BY_DIRECTION:
        out[at], out[at + 1], out[at + 2], out[at + 3] = -vx, -vy, x * q[4] + y * q[5], x * q[5] - y * q[4]


def second_derivatives_by_section(par, work, vx, vy, bends):  # type: ignore[no-untyped-def]
    """Return the second derivatives of v.rho by the section: by theta, or by the tangent components xx, xy and yy."""
    section, h = int(par[SECTION]), offset_at(par, par[HOME])[0]
    if section == OF_THETA:
        return vy * bends[0] - vx * bends[1], 0.0, 0.0
    if section != OF_TANGENT or h == 0.0:
        return 0.0, 0.0, 0.0
    terms, S, e0, e1 = int(par[TERMS]), work[SLOPES], 0.0, 0.0
    xs, ys = work[HERE, :terms], work[HERE, terms:2 * terms]
    for j in range(terms):
        e0, e1 = e0 + xs[j] * S[j], e1 + ys[j] * S[j]
    L = np.sqrt(e0 * e0 + e1 * e1)
    e0, e1, share = e0 / L, e1 / L, h / (L * L)
    # second derivative of e: (3 e e e - e I - I e)/L^2; n.v = e0 vy - e1 vx
    turned = e0 * vy - e1 * vx
    return (share * (3.0 * e0 * e0 * turned - turned - 2.0 * e0 * vy),
            share * (3.0 * e0 * e1 * turned - e1 * vy + e0 * vx),
            share * (3.0 * e1 * e1 * turned - turned + 2.0 * e1 * vx))


def bend(par, work, x, y, bends, q, H):  # type: ignore[no-untyped-def]
    """Add v.q_uu for a vector v in the frame of the obstacle to H."""
    terms, pose, m, row = int(par[TERMS]), int(par[POSE]), len(H), work[OTHER]
    sets, at = sets_of(par)
    if int(par[SECTION]) != CURVE:
        xx, xy, yy = second_derivatives_by_section(par, work, q[2] * x - q[3] * y, q[3] * x + q[2] * y, bends)
        first, P = (2 * terms, work[POWERS]) if sets == 3 else (0, work[SLOPES])
        for i in range(terms):
            one, two = H[first + i, first:], H[terms + i]
            for j in range(terms):
                f = P[i] * P[j]
                one[j] += f * xx
                if sets == 2:
                    one[terms + j] += f * xy
                    two[j] += f * xy
                    two[terms + j] += f * yy
    if pose == BY_ANGLE:
        row_of(par, work, -y, x, bends, q, row)
        for j in range(m):
            H[at + 2, j] += row[j]
            H[j, at + 2] += row[j]
        H[at + 2, at + 2] -= row[at + 2]
    elif pose == BY_DIRECTION:
        x, y = x / par[LENGTH], y / par[LENGTH]
        for k in range(at + 2, at + 4):
            row_of(par, work, x, y, bends, NO_ROTATION, row)
            x, y = -y, x
            for j in range(m):
                H[k, j] += row[j]
                H[j, k] += row[j]


def rates(par, work, w, bends, q):  # type: ignore[no-untyped-def]
    """Return the rates of rho relative to the obstacle's origin (2), of q (2), and of theta or tangent (2)."""
    terms, section, pose = int(par[TERMS]), int(par[SECTION]), int(par[POSE])
    P, S, us, vs, x, y, a, b = work[POWERS], work[SLOPES], w[:terms], w[terms:2 * terms], 0.0, 0.0, 0.0, 0.0
    for j in range(terms):
        x, y = x + us[j] * P[j], y + vs[j] * P[j]
    if section == OF_TANGENT:
        for j in range(terms):
            a, b = a + us[j] * S[j], b + vs[j] * S[j]
    elif section == OF_THETA:
        ts = w[2 * terms:]
        for j in range(terms):
            a += ts[j] * P[j]
    x, y = x + a * bends[0] + b * bends[2], y + a * bends[1] + b * bends[3]
    if pose == STILL:
        return x, y, x, y, a, b
    moves = w[sets_of(par)[1]:]
    x, y = x - moves[0], y - moves[1]
    seen_x, seen_y = q[2] * x + q[3] * y, q[2] * y - q[3] * x
    if pose == BY_ANGLE:
        return x, y, seen_x + moves[2] * q[1], seen_y - moves[2] * q[0], a, b
    return (x, y, seen_x + moves[2] * q[4] + moves[3] * q[5], seen_y + moves[2] * q[5] - moves[3] * q[4], a, b)


def rate_derivative(par, work, nx, ny, w, moving, bends, q, out):  # type: ignore[no-untyped-def]
    """Fill out (fields,) with the derivative nu.q_uu w of nu.dq/dt at constant nu."""
    terms, pose = int(par[TERMS]), int(par[POSE])
    sets, at = sets_of(par)
    for j in range(len(out)):
        out[j] = 0.0
    vx, vy, turns = moving[0], moving[1], w[at:]
    if pose == BY_ANGLE:
        row_of(par, work, -turns[2] * ny, turns[2] * nx, bends, q, out)
        out[at + 2] += nx * (q[2] * vy - q[3] * vx) - ny * (q[2] * vx + q[3] * vy)
    elif pose == BY_DIRECTION:
        c, s, L = turns[2], turns[3], par[LENGTH]
        row_of(par, work, (c * nx - s * ny) / L, (c * ny + s * nx) / L, bends, NO_ROTATION, out)
        out[at + 2], out[at + 3] = (nx * vx + ny * vy) / L, (nx * vy - ny * vx) / L
    if int(par[SECTION]) != CURVE:
        xx, xy, yy = second_derivatives_by_section(par, work, q[2] * nx - q[3] * ny, q[3] * nx + q[2] * ny, bends)
        own, P = (out[2 * terms:], work[POWERS]) if sets == 3 else (out, work[SLOPES])
        a, b = xx * moving[4] + xy * moving[5], xy * moving[4] + yy * moving[5]
        for j in range(terms):
            own[j] += a * P[j]
            if sets == 2:
                own[terms + j] += b * P[j]


def add_stiffness(par, work, force, held, stick, share, k, sheared, H, C):  # type: ignore[no-untyped-def]
    """Add the derivatives of a point's force to H and C, except for q_uu, from N, T and row RATE."""
    weight, m = par[WEIGHT], len(H)
    N, T, slope = work[ACROSS], work[ALONG], work[RATE]
    stiff, damping = weight * par[STIFFNESS], weight * par[DAMPING]
    for j in range(m):
        # derivative of the normal force, with the sign reversed
        slope[j] = stiff * N[j] + damping * (slope[j] + k * sheared * T[j])
    for i in range(m):
        line, row = H[i], N[i] - share * T[i]
        both, turn = (stick - force * k) * T[i] + held * k * N[i], held * k * T[i]
        for j in range(m):
            line[j] += row * slope[j] + both * T[j] + turn * N[j]
    if damping > 0.0:
        for i in range(m):
            line, row = C[i], damping * (N[i] - share * T[i])
            for j in range(m):
                line[j] += row * N[j]


def point_at_home(par, work):  # type: ignore[no-untyped-def]
    """Return drho/dz, derivatives of rho by the section, the result of ``to_obstacle_frame``, and the point there."""
    x, y, x1, y1, a, b, c, d = position_at(par, work, par[HOME])
    q = to_obstacle_frame(par, work[HERE, sets_of(par)[1]:], x, y)
    if int(par[POSE]) == STILL:
        return x1, y1, (a, b, c, d), q, (q[0], q[1])
    return x1, y1, (a, b, c, d), q, (par[POSE_X] + q[0], par[POSE_Y] + q[1])


def faces_away(par, x1, y1, nx, ny, bends, q):  # type: ignore[no-untyped-def]
    """Return whether the point is on a face that looks away from the obstacle; that of a thin body overlaps it too."""
    if par[FACE] == 0.0:
        return False
    if int(par[SECTION]) == OF_THETA:
        x1, y1 = -par[FACE] * bends[0], -par[FACE] * bends[1]
    tx, ty = q[2] * x1 + q[3] * y1, q[2] * y1 - q[3] * x1
    return par[FACE] * (tx * ny - ty * nx) > par[AWAY] * np.sqrt(tx * tx + ty * ty)


def safe_change(par, gap, length, offset, q):  # type: ignore[no-untyped-def]
    """Return a sum of changes of fields below which a curve cannot touch, at most ``offset`` from its axis; ``length``
    bounds the distance of its points.

    ``gap`` is that of one point. Sections may rotate by any angle, and a rotation of the pose moves a place by its
    distance. Half of the gap is used, because the direction of a pose may have another length until a step converges.
    """
    pose, far = int(par[POSE]), 0.5 * (gap - length) - offset
    if pose == STILL:
        return far
    distance = np.sqrt(q[0] * q[0] + q[1] * q[1]) + length
    return far / max(1.0, distance / par[LENGTH] if pose == BY_DIRECTION else distance)


def friction_terms(par, place, part, anchor, force):  # type: ignore[no-untyped-def]
    """Return the friction force along t, its stiffness (sticking) and its ratio to the normal force (sliding)."""
    if par[FRICTION] == 0.0:
        return 0.0, 0.0, 0.0
    s, ds = place_at(par, place[0], place[1], part)
    way = slip(par, s, anchor)
    held, slides = coulomb_force(par, way, force)
    if slides:
        # Coulomb's limit follows the pressure
        return held * ds, 0.0, (par[FRICTION] if way > 0.0 else -par[FRICTION]) * ds
    return held * ds, par[STICK] * ds * ds, 0.0


def layer(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Pressure max(0, -k g - c dg/dt) per length at points of a curve, with friction that is elastic up to a limit.

    ``par`` and ``mem`` have a row for each point; f, H and C are sums over them. H and C may have size 0. Returns
    (energy, power), or (the result of ``safe_change``, APART) if no point acts.
    """
    energy, power, acts, far, m = 0.0, 0.0, False, 0.0, len(u)
    work = work_matrix(ROWS, m)
    here, row = work[HERE], work[OTHER]
    for j in range(m):
        here[j] = p0[j] + u[j]
    for i in range(len(par)):
        one = par[i]
        x1, y1, bends, q, place = point_at_home(one, work)
        g, nx, ny, k, part = distance_at(one, place[0], place[1], -1.0)
        if g >= 0.0:
            if i == 0:
                far = safe_change(one, g, bound_on_distance(one, p0, u, one[HOME]), largest_offset(one), q)
                if far > 0.0:
                    break
            continue
        if mem[i, START_GAP] != OUTSIDE:
            g -= mem[i, START_GAP]
            if g >= 0.0:
                continue
        elif faces_away(one, x1, y1, nx, ny, bends, q):
            continue
        acts, weight = True, one[WEIGHT]
        moving = rates(one, work, w, bends, q)
        rate, sheared = nx * moving[2] + ny * moving[3], nx * moving[3] - ny * moving[2]
        pressure = -one[STIFFNESS] * g - one[DAMPING] * rate
        energy += 0.5 * weight * one[STIFFNESS] * g * g
        if pressure <= 0.0:
            power -= weight * one[STIFFNESS] * g * rate
            continue
        force = weight * pressure
        held, stick, share = friction_terms(one, place, part, mem[i, ANCHOR], force)
        power += weight * one[DAMPING] * rate * rate - held * sheared
        px, py = force * nx - held * ny, force * ny + held * nx
        row_of(one, work, px, py, bends, q, row)
        for j in range(m):
            f[j] -= row[j]
        if len(H) > 0:
            row_of(one, work, nx, ny, bends, q, work[ACROSS])
            row_of(one, work, -ny, nx, bends, q, work[ALONG])
            rate_derivative(one, work, nx, ny, w, moving, bends, q, work[RATE])
            add_stiffness(one, work, force, held, stick, share, k, sheared, H, C)
            bend(one, work, -px, -py, bends, q, H)
    return (energy, power) if acts else (far, APART)


def layer_at(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Same as ``layer`` for one point; return (energy, power), 0 if it does not act."""
    energy, power = layer(p0, u, w, par.reshape((1, len(par))), a, mem.reshape((1, len(mem))), f, H, C)
    return (0.0, 0.0) if power == APART else (energy, power)


def accept_layer(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Update, at an accepted state, the gap from which each point of a curve presses, and its friction anchor."""
    work = work_matrix(ROWS, len(u))
    here = work[HERE]
    for j in range(len(u)):
        here[j] = p0[j] + u[j]
    for i in range(len(par)):
        one, anchor = par[i], mem[i, ANCHOR]
        x1, y1, bends, q, place = point_at_home(one, work)
        g, nx, ny, _, part = distance_at(one, place[0], place[1], -1.0)
        begin = next_start_gap(mem[i, START_GAP], g, not faces_away(one, x1, y1, nx, ny, bends, q))
        mem[i, START_GAP] = begin
        if one[FRICTION] == 0.0:
            continue
        s, _ = place_at(one, place[0], place[1], part)
        depth = max(begin - g, 0.0) if g < 0.0 else 0.0
        held, slides = coulomb_force(one, slip(one, s, anchor), one[WEIGHT] * one[STIFFNESS] * depth)
        if slides or np.isnan(anchor):
            mem[i, ANCHOR] = s + held / one[STICK]


def accept_layer_at(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Same as ``accept_layer`` for one point."""
    accept_layer(p0, u, par.reshape((1, len(par))), mem.reshape((1, len(mem))))
