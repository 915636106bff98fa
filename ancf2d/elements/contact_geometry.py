"""The gap between a curve of an element and an obstacle, and the terms of its derivatives.

The curve is the axis or a face of one element, rho(z) with z from -1 to 1. A law has its coefficients, in powers of z,
as fields: x and y of the curve itself; or, for sections that stay rigid, x and y of the axis and, if it is a
coordinate, the rotation, from which rho = r + y n follows. The fields of a moving obstacle come next: x, y and angle,
or x, y and the direction of a rigid body. A hard contact has its multiplier last.

With X (n,) the position, rotation or tangent at z, the distance y from the axis if it varies along the element, and the
pose of the obstacle, rho(X) is the point in the frame of the obstacle. Its gap g has the gradient nu (a unit vector)
and the Hessian k t t^T, with t normal to nu and k = 1/distance from the centre of curvature.

Functions of arrays and numbers alone, which the kernels compile unchanged.
"""

from __future__ import annotations

import numpy as np

# how rho depends on the interpolated fields: it is one of them, or an offset from an axis with rotating sections
CURVE, OF_THETA, OF_TANGENT = 0, 1, 2
# pose of an obstacle: fixed, by x, y and angle, or by x, y and a direction
STILL, BY_ANGLE, BY_DIRECTION = 0, 1, 2
# BODY: not an obstacle, but another body (contact_gaps)
HALF_PLANE, CIRCLE, POLYLINE, BODY = 0, 1, 2, 3
# par: position on the body, constants of the contact, pose of the obstacle in the reference, compliance of a point
# between nodes (``contact_sliding``), shape of the obstacle, and what is OPPOSITE: its numbers, or another curve. A
# curve is at y = OFFSET + SLOPE z + BULGE z^2 from an axis with rotating sections. A face cannot touch where its normal
# has a cosine of more than AWAY with the gradient of the gap.
(SECTION, TERMS, OFFSET, SLOPE, BULGE, HOME, WEIGHT, STIFFNESS, DAMPING, FRICTION, STICK, TOUCH, POSE, POSE_X, POSE_Y,
 LENGTH, FACE, AWAY, BENDING, SHEAR, SHAPE, OPPOSITE) = range(22)
# the same places in hard contact: the constant c of ``contact.hard``, and half of the interval, in z, that a point may
# move in about its HOME
AUGMENTATION, HALF_INTERVAL = STIFFNESS, DAMPING
# mem: PLACE: z along the element; PLACEMENT: 0 fixed at home, 1 sliding about a corner, 2 fixed at PLACE on the curve
# of the beam, 3 on that of the element itself, -1 and -2 not in use (on either curve), -3 supports hold its gap;
# FEATURE: the part of a polyline opposite to it; ANCHOR: the place on the obstacle that friction holds it to; STATUS:
# closed (1), open (0), decided by force and gap (-1), or the same after it has pulled (-2): it then closes only if it
# is inside; SLIP_STATUS: sticks (2), slides with friction of this sign along s (1 or -1), decided by the forces (0), or
# without friction in the step of a motion in which it closes, where the impact includes it (3); AFTER_IMPACT: friction
# force along s just after an impact, inf if there was none; START_GAP: the gap from which it presses
# (``next_start_gap``)
PLACE, PLACEMENT, FEATURE, ANCHOR, STATUS, SLIP_STATUS, AFTER_IMPACT, START_GAP = range(8)
MEMORY = 8
SUPPORTED, UNUSED_ON_ELEMENT, UNUSED, AT_HOME, SLIDING, ON_BEAM, ON_ELEMENT = -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0
STICKS, CLOSES, NO_IMPACT = 2.0, 3.0, np.inf
PULLED, BY_FORCE, OPEN, CLOSED = -2.0, -1.0, 0.0, 1.0
OUTSIDE, UNTOUCHED = np.inf, -np.inf
# most entries of X
WIDE = 9
# rows of work: X, X', X'' (WIDE each), rho (2), its derivatives by X (2, WIDE) and (2, WIDE, WIDE), small vectors and
# matrices
AT, AT_1, AT_2, RHO, BY, BY_BY, VECTOR, MATRIX, ROW, OTHER = 0, 9, 18, 27, 29, 47, 209, 227, 308, 348
WORK = 388
# most fields of a contact
MOST_FIELDS = 100
# largest cosine between outward normals of surfaces that may touch where pressure does not fade
FACE_COSINE = -0.3
# exponent of the depth in a layer as a function of the force, for round surfaces
POWER = 2.0 / 3.0


def count_of(par):  # type: ignore[no-untyped-def]
    """Return the numbers of entries of X that belong to the body and to the obstacle."""
    pose = int(par[POSE])
    return 2 + int(par[SECTION]) + (1 if tapers(par) else 0), (0 if pose == STILL else 2 + pose)


def tapers(par):  # type: ignore[no-untyped-def]
    """Return whether the distance of the curve from the axis varies along it; it is then an entry of X."""
    return par[SLOPE] != 0.0 or par[BULGE] != 0.0


def offset_at(par, z):  # type: ignore[no-untyped-def]
    """Return the distance y of the curve from the axis at z, and dy/dz."""
    if not tapers(par):
        return par[OFFSET], 0.0
    return par[OFFSET] + z * (par[SLOPE] + z * par[BULGE]), par[SLOPE] + 2.0 * z * par[BULGE]


def largest_offset(par):  # type: ignore[no-untyped-def]
    """Return a bound on the distance of the curve from the axis, |z| <= 1."""
    return abs(par[OFFSET]) + abs(par[SLOPE]) + abs(par[BULGE])


def interpolate(par, p0, u, z, work):  # type: ignore[no-untyped-def]
    """Fill X, dX/dz and d2X/dz2 at z from the fields p0 + u."""
    terms, section = int(par[TERMS]), int(par[SECTION])
    sets = 3 if section == OF_THETA else 2
    for k in range(RHO):
        work[k] = 0.0
    for c in range(sets):
        v0, v1, v2, v3 = 0.0, 0.0, 0.0, 0.0
        for j in range(terms - 1, -1, -1):
            a = p0[c * terms + j] + u[c * terms + j]
            v3 = v3 * z + 3.0 * v2
            v2 = v2 * z + 2.0 * v1
            v1 = v1 * z + v0
            v0 = v0 * z + a
        work[AT + c], work[AT_1 + c], work[AT_2 + c] = v0, v1, v2
        if section == OF_TANGENT:
            work[AT + 2 + c], work[AT_1 + 2 + c], work[AT_2 + 2 + c] = v1, v2, v3
    body, pose = count_of(par)
    if tapers(par):
        work[AT + body - 1], work[AT_1 + body - 1] = offset_at(par, z)
        work[AT_2 + body - 1] = 2.0 * par[BULGE]
    for i in range(pose):
        work[AT + body + i] = p0[sets * terms + i] + u[sets * terms + i]


def offset(par, y, work):  # type: ignore[no-untyped-def]
    """Fill rho at y and its first and second derivatives by the interpolated fields, in the global frame."""
    section, varies = int(par[SECTION]), tapers(par)
    for k in range(RHO, VECTOR):
        work[k] = 0.0
    work[RHO], work[RHO + 1] = work[AT], work[AT + 1]
    work[BY], work[BY + WIDE + 1] = 1.0, 1.0
    if section == OF_THETA:
        c, s = np.cos(work[AT + 2]), np.sin(work[AT + 2])
        work[RHO] -= y * s
        work[RHO + 1] += y * c
        work[BY + 2], work[BY + WIDE + 2] = -y * c, -y * s
        work[BY_BY + 2 * (WIDE + 1)], work[BY_BY + WIDE * WIDE + 2 * (WIDE + 1)] = y * s, -y * c
        if varies:
            work[BY + 3], work[BY + WIDE + 3] = -s, c
            _set_pair(work, 3, 2, -c, -s)
    elif section == OF_TANGENT and (varies or y != 0.0):
        dx, dy = work[AT + 2], work[AT + 3]
        L = np.sqrt(dx * dx + dy * dy)
        e0, e1 = dx / L, dy / L
        work[RHO] -= y * e1
        work[RHO + 1] += y * e0
        if varies:
            work[BY + 4], work[BY + WIDE + 4] = -e1, e0
        for j in range(2):
            ej = e1 if j == 1 else e0
            # derivative of e: (1 - e e)/L; n = (-e1, e0)
            d0, d1 = (1.0 - j - e0 * ej) / L, (j - e1 * ej) / L
            work[BY + 2 + j], work[BY + WIDE + 2 + j] = -y * d1, y * d0
            if varies:
                _set_pair(work, 4, 2 + j, -d1, d0)
            for k in range(2):
                ek = e1 if k == 1 else e0
                jk = 1.0 if j == k else 0.0
                f0 = (3.0 * e0 * ej * ek - e0 * jk - (1 - j) * ek - (1 - k) * ej) / (L * L)
                f1 = (3.0 * e1 * ej * ek - e1 * jk - j * ek - k * ej) / (L * L)
                at = BY_BY + WIDE * (2 + j) + 2 + k
                work[at], work[at + WIDE * WIDE] = -y * f1, y * f0


def _set_pair(work, a, b, x, y):  # type: ignore[no-untyped-def]
    """Set the second derivative (x, y) of rho by entries a and b of X."""
    work[BY_BY + WIDE * a + b], work[BY_BY + WIDE * b + a] = x, x
    work[BY_BY + WIDE * (WIDE + a) + b], work[BY_BY + WIDE * (WIDE + b) + a] = y, y


def to_obstacle_frame(par, work):  # type: ignore[no-untyped-def]
    """Transform rho and its derivatives to the frame of the obstacle, and add derivatives by its pose."""
    pose = int(par[POSE])
    if pose == STILL:
        return
    body, _ = count_of(par)
    x, y = work[RHO] - work[AT + body], work[RHO + 1] - work[AT + body + 1]
    if pose == BY_ANGLE:
        c, s = np.cos(work[AT + body + 2]), np.sin(work[AT + body + 2])
    else:
        c, s = work[AT + body + 2] / par[LENGTH], work[AT + body + 3] / par[LENGTH]
    work[RHO], work[RHO + 1] = par[POSE_X] + c * x + s * y, par[POSE_Y] - s * x + c * y
    # the last fields rotate the obstacle: d(c, s) by each of them
    for k in range(pose):
        at = body + 2 + k
        if pose == BY_ANGLE:
            dc, ds = -s, c
            _set_pair(work, at, at, -(c * x + s * y), s * x - c * y)
        else:
            dc, ds = (1.0 - k) / par[LENGTH], k / par[LENGTH]
        work[BY + at], work[BY + WIDE + at] = dc * x + ds * y, -ds * x + dc * y
        for b in range(body + 2):
            if b < body:
                jx, jy = work[BY + b], work[BY + WIDE + b]
            else:
                jx, jy = (-1.0, 0.0) if b == body else (0.0, -1.0)
            _set_pair(work, at, b, dc * jx + ds * jy, -ds * jx + dc * jy)
    for b in range(body):
        jx, jy = work[BY + b], work[BY + WIDE + b]
        work[BY + b], work[BY + WIDE + b] = c * jx + s * jy, -s * jx + c * jy
        for k in range(body):
            one = BY_BY + WIDE * b + k
            two = one + WIDE * WIDE
            work[one], work[two] = c * work[one] + s * work[two], -s * work[one] + c * work[two]
    work[BY + body], work[BY + WIDE + body] = -c, s
    work[BY + body + 1], work[BY + WIDE + body + 1] = -s, -c


def corner(par, i, x, y):  # type: ignore[no-untyped-def]
    """Return (gap, nu, k, s, ds) of a point opposite to corner i of a polyline."""
    n, closed, at = int(par[OPPOSITE]), par[OPPOSITE + 1] > 0.0, OPPOSITE + 2
    vx, vy = par[at + 3 * i], par[at + 3 * i + 1]
    dx, dy = x - vx, y - vy
    D = np.sqrt(dx * dx + dy * dy)
    before, after = (i - 1 + n) % n, (i + 1) % n
    nx, ny = 0.0, 0.0
    if closed or i > 0:
        ex, ey = vx - par[at + 3 * before], vy - par[at + 3 * before + 1]
        L = np.sqrt(ex * ex + ey * ey)
        nx, ny = nx - ey / L, ny + ex / L
    if closed or i < n - 1:
        ex, ey = par[at + 3 * after] - vx, par[at + 3 * after + 1] - vy
        L = np.sqrt(ex * ex + ey * ey)
        nx, ny = nx - ey / L, ny + ex / L
    sign = 1.0 if dx * nx + dy * ny >= 0.0 or not (closed or 0 < i < n - 1) else -1.0
    if D == 0.0:
        L = np.sqrt(nx * nx + ny * ny)
        return 0.0, nx / L, ny / L, 0.0, par[at + 3 * i + 2], 0.0
    return sign * D, sign * dx / D, sign * dy / D, sign / D, par[at + 3 * i + 2], 0.0


def side_of(par, i, x, y):  # type: ignore[no-untyped-def]
    """Return (gap, nu, k, s, ds) of a point opposite to the line of segment i of a polyline."""
    n, at = int(par[OPPOSITE]), OPPOSITE + 2
    j = (i + 1) % n
    ax, ay = par[at + 3 * i], par[at + 3 * i + 1]
    ex, ey = par[at + 3 * j] - ax, par[at + 3 * j + 1] - ay
    L = np.sqrt(ex * ex + ey * ey)
    ex, ey = ex / L, ey / L
    return (-ey * (x - ax) + ex * (y - ay), -ey, ex, 0.0, par[at + 3 * i + 2] + ex * (x - ax) + ey * (y - ay), -1.0)


def feature_at(par, x, y):  # type: ignore[no-untyped-def]
    """Return the nearest part of a polyline: 2 i for segment i, 2 i + 1 for corner i."""
    n, closed, at = int(par[OPPOSITE]), par[OPPOSITE + 1] > 0.0, OPPOSITE + 2
    best, found = np.inf, 0
    for i in range(n if closed else n - 1):
        j = (i + 1) % n
        ax, ay = par[at + 3 * i], par[at + 3 * i + 1]
        ex, ey = par[at + 3 * j] - ax, par[at + 3 * j + 1] - ay
        s = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
        what = 2 * i
        if s <= 0.0:
            s, what = 0.0, 2 * i + 1
        elif s >= 1.0:
            s, what = 1.0, 2 * j + 1
        dx, dy = x - ax - s * ex, y - ay - s * ey
        D = dx * dx + dy * dy
        if best > D:
            best, found = D, what
    return found


def distance_at(par, x, y, feature):  # type: ignore[no-untyped-def]
    """Return (g, nu_x, nu_y, k, part): the gap, its gradient and curvature, and the part of a polyline used.

    ``feature`` is this part, or -1 for the nearest one.
    """
    shape = int(par[SHAPE])
    if shape == HALF_PLANE:
        nx, ny = par[OPPOSITE + 2], par[OPPOSITE + 3]
        return nx * (x - par[OPPOSITE]) + ny * (y - par[OPPOSITE + 1]), nx, ny, 0.0, 0
    if shape == CIRCLE:
        dx, dy, R = x - par[OPPOSITE], y - par[OPPOSITE + 1], par[OPPOSITE + 2]
        # a negative radius: the body is inside the circle
        sign = 1.0 if R > 0.0 else -1.0
        D = max(np.sqrt(dx * dx + dy * dy), 1e-12 * abs(R))
        return sign * D - R, sign * dx / D, sign * dy / D, sign / D, 0
    what = feature_at(par, x, y) if feature < 0 else int(feature)
    g, nx, ny, k, _, _ = side_of(par, what // 2, x, y) if what % 2 == 0 else corner(par, what // 2, x, y)
    return g, nx, ny, k, what


def place_at(par, x, y, part):  # type: ignore[no-untyped-def]
    """Return (s, ds): the arc length on the obstacle opposite to (x, y), and its derivative along (-nu_y, nu_x)."""
    shape = int(par[SHAPE])
    dx, dy = x - par[OPPOSITE], y - par[OPPOSITE + 1]
    if shape == HALF_PLANE:
        return par[OPPOSITE + 2] * dy - par[OPPOSITE + 3] * dx, 1.0
    if shape == CIRCLE:
        R = par[OPPOSITE + 2]
        return abs(R) * np.arctan2(dy, dx), R / max(np.sqrt(dx * dx + dy * dy), 1e-12 * abs(R))
    _, _, _, _, s, ds = side_of(par, part // 2, x, y) if part % 2 == 0 else corner(par, part // 2, x, y)
    return s, ds


def gap_at(par, x, y, feature):  # type: ignore[no-untyped-def]
    """Return (g, nu_x, nu_y, k, s, ds), as from ``distance_at`` and ``place_at``."""
    g, nx, ny, k, part = distance_at(par, x, y, feature)
    s, ds = place_at(par, x, y, part)
    return g, nx, ny, k, s, ds


def bound_on_distance(par, p0, u, z):  # type: ignore[no-untyped-def]
    """Return a bound on the distance of points of the curve from the point at z, for the obstacle; inf if gaps jump.

    It uses |z^j| <= 1. The gap changes by no more than this distance, except at the ends of an open polyline.
    """
    if int(par[SHAPE]) == POLYLINE and par[OPPOSITE + 1] <= 0.0:
        return np.inf
    terms, square = int(par[TERMS]), 0.0
    for c in range(2):
        away, power = 0.0, 1.0
        for j in range(1, terms):
            power *= abs(z)
            away += (1.0 + power) * abs(p0[c * terms + j] + u[c * terms + j])
        square += away * away
    # rigid sections may rotate by any angle
    size = np.sqrt(square) + 2.0 * largest_offset(par)
    if int(par[POSE]) == BY_DIRECTION:
        at = (3 if int(par[SECTION]) == OF_THETA else 2) * terms + 2
        dx, dy = p0[at] + u[at], p0[at + 1] + u[at + 1]
        size *= np.sqrt(dx * dx + dy * dy) / par[LENGTH]
    return size


def curve_derivative(par, work, first, order):  # type: ignore[no-untyped-def]
    """Return drho/dz (order 1) or d2rho/dz2 (order 2), from derivatives of rho by X and X' or X'' (at ``first``)."""
    body, _ = count_of(par)
    rx, ry = 0.0, 0.0
    for a in range(body):
        rx += work[BY + a] * work[first + a]
        ry += work[BY + WIDE + a] * work[first + a]
        if order == 2:
            for b in range(body):
                q = work[AT_1 + a] * work[AT_1 + b]
                rx += work[BY_BY + WIDE * a + b] * q
                ry += work[BY_BY + WIDE * (WIDE + a) + b] * q
    return rx, ry


def position_at(par, p0, u, z, work):  # type: ignore[no-untyped-def]
    """Fill X, rho and its derivatives at z."""
    interpolate(par, p0, u, z, work)
    offset(par, offset_at(par, z)[0], work)
    to_obstacle_frame(par, work)


def opens_by_force(par, mem, force, g):  # type: ignore[no-untyped-def]
    """Return whether a hard contact point with a free choice is open, given its force and gap.

    It is closed if force - c g >= -c TOUCH. A point that has pulled is open at any gap that is 0 up to round-off,
    because the force there would close it and pull again.
    """
    touch = -par[TOUCH] if mem[STATUS] == PULLED else par[TOUCH]
    return mem[STATUS] < OPEN and force < par[AUGMENTATION] * (g - touch)


def faces_away(par, nx, ny, work):  # type: ignore[no-untyped-def]
    """Return whether the point is on a face that looks away from the obstacle; that of a thin body overlaps it too."""
    if par[FACE] == 0.0:
        return False
    if int(par[SECTION]) == OF_THETA:
        # normal of the section, which two elements share at a node
        tx, ty = -par[FACE] * work[BY + 2], -par[FACE] * work[BY + WIDE + 2]
    else:
        tx, ty = curve_derivative(par, work, AT_1, 1)
    return par[FACE] * (tx * ny - ty * nx) > par[AWAY] * np.sqrt(tx * tx + ty * ty)


def next_start_gap(last, gap, faces):  # type: ignore[no-untyped-def]
    """Return the gap from which a point presses after an accepted state, given its value before.

    It matters whether a point faces the obstacle when it enters. A point from OUTSIDE then presses from gap 0 on. One
    that enters with its back is UNTOUCHED until it faces the obstacle, and then presses from its gap at that time. So
    no energy appears or vanishes when a body turns inside an obstacle or passes its middle.
    """
    if gap >= 0.0:
        return OUTSIDE
    if last == OUTSIDE:
        return 0.0 if faces else UNTOUCHED
    return gap if last == UNTOUCHED and faces else last
