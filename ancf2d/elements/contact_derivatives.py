"""Derivatives of the position rho(z) on a curve of an element by the fields of a contact law, by the chain rule.

``contact_geometry.position_at`` fills work with rho and its derivatives by X; those of X by the fields are powers of z.

Functions of arrays and numbers alone, which the kernels compile unchanged.
"""

from __future__ import annotations

from .contact_geometry import (
    AT_1,
    BY,
    BY_BY,
    MATRIX,
    OF_TANGENT,
    OF_THETA,
    OTHER,
    ROW,
    SECTION,
    TERMS,
    VECTOR,
    WIDE,
    count_of,
)


def field_count(par):  # type: ignore[no-untyped-def]
    """Return the number of fields of the curve and of the pose of an obstacle."""
    _, pose = count_of(par)
    return (3 if int(par[SECTION]) == OF_THETA else 2) * int(par[TERMS]) + pose


def gradient_by_fields(par, z, work, first, order, out, add):  # type: ignore[no-untyped-def]
    """Fill out from index ``add`` with derivatives (fields,) by the fields, from those (n,) by X at ``first`` of work.

    With ``order`` 1, the entries of work are derivatives by dX/dz.
    """
    terms, section = int(par[TERMS]), int(par[SECTION])
    body, pose = count_of(par)
    sets = 3 if section == OF_THETA else 2
    for c in range(sets):
        m0, m1, m2 = 1.0, 0.0, 0.0
        for j in range(terms):
            v = work[first + c] * (m0 if order == 0 else m1)
            if section == OF_TANGENT:
                v += work[first + 2 + c] * (m1 if order == 0 else m2)
            out[add + c * terms + j] = v
            m0, m1, m2 = m0 * z, m1 * z + m0, m2 * z + 2.0 * m1
    for i in range(pose):
        out[add + sets * terms + i] = work[first + body + i] if order == 0 else 0.0


def add_hessian_by_fields(par, z, work, H, first, share):  # type: ignore[no-untyped-def]
    """Add ``share`` times the matrix by X in work to H by the fields, in rows and columns from ``first`` on."""
    terms, section = int(par[TERMS]), int(par[SECTION])
    body, pose = count_of(par)
    sets = 3 if section == OF_THETA else 2
    fields = sets * terms + pose
    for a in range(body + pose):
        if 2 + section <= a < body:
            # the distance from the axis, which depends on no field
            continue
        empty = True
        for b in range(body + pose):
            work[VECTOR + b] = work[MATRIX + WIDE * a + b]
            if work[VECTOR + b] != 0.0:
                empty = False
        if empty:
            continue
        gradient_by_fields(par, z, work, VECTOR, 0, work, OTHER)
        if a >= body:
            for q in range(fields):
                H[first + sets * terms + a - body, first + q] += share * work[OTHER + q]
            continue
        c, up = (a - 2, 1) if section == OF_TANGENT and a >= 2 else (a, 0)
        m0, m1 = 1.0, 0.0
        for j in range(terms):
            m = share * (m1 if up == 1 else m0)
            if m != 0.0:
                for q in range(fields):
                    H[first + c * terms + j, first + q] += m * work[OTHER + q]
            m0, m1 = m0 * z, m1 * z + m0


def derivative_along(par, z, vx, vy, work, out, add):  # type: ignore[no-untyped-def]
    """Fill out from index ``add`` on with the derivative (fields,) of rho along (vx, vy)."""
    body, pose = count_of(par)
    for a in range(body + pose):
        work[VECTOR + a] = vx * work[BY + a] + vy * work[BY + WIDE + a]
    gradient_by_fields(par, z, work, VECTOR, 0, out, add)


def slope_derivative_along(par, z, vx, vy, work, out, add):  # type: ignore[no-untyped-def]
    """Fill out from index ``add`` on with the derivative (fields,) of drho/dz along (vx, vy)."""
    body, pose = count_of(par)
    # v.(rho_XX X' X_q + rho_X X'_q)
    for a in range(body + pose):
        s = 0.0
        for b in range(body):
            s += (vx * work[BY_BY + WIDE * a + b] + vy * work[BY_BY + WIDE * (WIDE + a) + b]) * work[AT_1 + b]
        work[VECTOR + a], work[VECTOR + WIDE + a] = s, vx * work[BY + a] + vy * work[BY + WIDE + a]
    gradient_by_fields(par, z, work, VECTOR, 0, work, ROW)
    gradient_by_fields(par, z, work, VECTOR + WIDE, 1, out, add)
    for q in range(field_count(par)):
        out[add + q] += work[ROW + q]


def add_second_derivative(par, z, vx, vy, work, H, first):  # type: ignore[no-untyped-def]
    """Add the second derivative of rho along (vx, vy) to H, in rows and columns from ``first`` on."""
    body, pose = count_of(par)
    for a in range(body + pose):
        for b in range(body + pose):
            work[MATRIX + WIDE * a + b] = vx * work[BY_BY + WIDE * a + b] + vy * work[BY_BY + WIDE * (WIDE + a) + b]
    add_hessian_by_fields(par, z, work, H, first, 1.0)
