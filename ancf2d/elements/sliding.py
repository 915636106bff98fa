"""A point on the axis of a deformed body: its foot point, its distance and their derivatives.

Functions of arrays alone, compiled by the kernels and called uncompiled in statics.

The axis of an element is r(z) = sum_j c_j z^j, z from -1 to 1. The foot point of p satisfies r'(z).(p - r(z)) = 0. The
distance g = n.(p - r(z)), with n = r'/|r'| turned by +90 degrees, keeps its sign along the body and over time. W = S_p
- S(z), and the rows (over coordinates q) are N = n.W, A = r'.W, B = n.S'. The motion of the foot point cancels in
dg = N dq and gives d2g = -(A B + B A + (c/T) A A + g B B)/D, with T = r'.r', c = n.r'', D = T - g c.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .shape import Array

Index = NDArray[np.int64]

# largest |z|: an element's polynomial is used up to a quarter of its length beyond its ends
REACH = 1.5
# element of a point that is off its body
OFF = -1
# largest |z| at the end of a body that counts as on it: allows for round-off of a point at the end
END = 1.0 + 1e-6


class Sliding(NamedTuple):
    """Prismatic joints as flat arrays.

    Per joint (n,): ``multiplier`` full coordinate of the multiplier; ``gap`` distance in the reference [m], which the
    joint keeps; ``scale`` magnitude of the coordinates that the distance is computed from [m]; ``points`` entries of
    ``point_dofs`` (., 2) and ``point_weights``, starting at ``point_first``: x and y of the point; ``elements`` entries
    of ``coef_first``, starting at ``element_first``: where the coefficients (``shapes``, ``terms``) of the element's
    shape functions as powers of z start in ``coef``; ``dof_first`` into ``dofs`` (., 2): x and y of each shape
    function, element by element. ``memory`` (n, 2): element and z of the last accepted foot point; ``on``: whether the
    joint is active. ``e0`` (n_q,): nodal coordinates in the reference.
    """

    e0: Array
    multiplier: Index
    gap: Array
    scale: Array
    points: Index
    point_first: Index
    point_dofs: Index
    point_weights: Array
    shapes: Index
    terms: Index
    elements: Index
    element_first: Index
    coef_first: Index
    coef: Array
    dof_first: Index
    dofs: Index
    memory: Array
    on: NDArray[np.bool_]


class Moving(NamedTuple):
    """Point laws at points that move along bodies, at the share s(t) of the length.

    Per item (k,): ``item`` its number among the point laws; ``mass`` [kg]; ``signal`` the row of s in the amplitudes;
    ``sign`` and ``base`` (k, 2): its first two fields are base + sign r(s); ``derivatives``: how many derivatives of r
    by s the following fields have; ``stretches``: whether the length of p0 is a constant of the law; ``element`` that
    the point is on, or OFF; ``begin`` the first element of its body in ``starts``, ``lengths`` (shares of the arc
    length) and ``coef_first``; ``shapes``, ``terms`` of the shape functions, whose powers of z start at ``coef_first``
    in ``coef``; ``dof_first`` into ``dofs`` (., 2): x and y of each shape function, element by element. ``fixed``: the
    mass matrix without these masses, empty if none has a mass.
    """

    item: Index
    mass: Array
    signal: Index
    sign: Array
    base: Array
    derivatives: Index
    stretches: Index
    element: Index
    begin: Index
    starts: Array
    lengths: Array
    coef_first: Index
    shapes: Index
    terms: Index
    coef: Array
    dof_first: Index
    dofs: Index
    fixed: Array


def point_at(table, i, d):  # type: ignore[no-untyped-def]
    """Return x and y of the sliding point of joint i at displacements d."""
    x, y = 0.0, 0.0
    for k in range(table.point_first[i], table.point_first[i] + table.points[i]):
        a, b = table.point_dofs[k, 0], table.point_dofs[k, 1]
        x += table.point_weights[k] * (table.e0[a] + d[a])
        y += table.point_weights[k] * (table.e0[b] + d[b])
    return x, y


def axis_of(table, i, m, d, out):  # type: ignore[no-untyped-def]
    """Fill the coefficients c_j (2, terms) of the axis of element m at displacements d."""
    shapes, terms = table.shapes[i], table.terms[i]
    at, coef = table.dof_first[i] + m * shapes, table.coef_first[table.element_first[i] + m]
    for j in range(terms):
        x, y = 0.0, 0.0
        for k in range(shapes):
            a, b = table.dofs[at + k, 0], table.dofs[at + k, 1]
            s = table.coef[coef + k * terms + j]
            x += s * (table.e0[a] + d[a])
            y += s * (table.e0[b] + d[b])
        out[0, j] = x
        out[1, j] = y


def nearest(axis, x, y, z):  # type: ignore[no-untyped-def]
    """Return z of the foot point of (x, y) on the axis of an element, by Newton's method started at z."""
    for _ in range(50):
        rx, ry, tx, ty, kx, ky = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(axis.shape[1] - 1, -1, -1):
            kx, ky = kx * z + 2.0 * tx, ky * z + 2.0 * ty
            tx, ty = tx * z + rx, ty * z + ry
            rx, ry = rx * z + axis[0, j], ry * z + axis[1, j]
        T = tx * tx + ty * ty
        slope = max(T - kx * (x - rx) - ky * (y - ry), 0.1 * T)
        new = min(max(z + (tx * (x - rx) + ty * (y - ry)) / slope, -REACH), REACH)
        moved = abs(new - z)
        z = new
        # quadratic convergence: the next step would be round-off
        if moved < 1e-8:
            break
    return z


def beyond(one, two, x, y):  # type: ignore[no-untyped-def]
    """Return whether (x, y) lies beyond the border between an element (axis ``one``) and the next (axis ``two``).

    The border is the bisector of the two end tangents: there both sides have the same distance, even if the axis has
    a kink, and every point belongs to exactly one side. Axes are coefficients (2, terms).
    """
    rx, ry, ax, ay, bx, by = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(one.shape[1] - 1, -1, -1):
        ax, ay = ax + rx, ay + ry
        rx, ry = rx + one[0, j], ry + one[1, j]
        sign = 1.0 if j % 2 == 1 else -1.0
        bx, by = bx + sign * j * two[0, j], by + sign * j * two[1, j]
    a, b = math.sqrt(ax * ax + ay * ay), math.sqrt(bx * bx + by * by)
    return (x - rx) * (ax / a + bx / b) + (y - ry) * (ay / a + by / b) > 0.0


def foot(table, i, d, axes):  # type: ignore[no-untyped-def]
    """Return (element, z, (g, nx, ny, tx, ty, c)) of joint i, searching from the last accepted foot point.

    ``axes`` (2, 2, terms) is a work array.
    """
    count, own, other = table.elements[i], axes[0], axes[1]
    x, y = point_at(table, i, d)
    m, z = int(table.memory[i, 0]), table.memory[i, 1]
    axis_of(table, i, m, d, own)
    for _ in range(2 * count + 2):
        z = nearest(own, x, y, z)
        if z > 0.0 and m + 1 < count:
            axis_of(table, i, m + 1, d, other)
            if not beyond(own, other, x, y):
                break
            m, z = m + 1, -1.0
        elif z < 0.0 and m > 0:
            axis_of(table, i, m - 1, d, other)
            if beyond(other, own, x, y):
                break
            m, z = m - 1, 1.0
        else:
            break
        axis_of(table, i, m, d, own)
    return m, z, measure(own, x, y, z)


def measure(axis, x, y, z):  # type: ignore[no-untyped-def]
    """Return (g, nx, ny, tx, ty, c) at z: distance, unit normal, r' and n.r''; g is NaN if |z| >= REACH."""
    rx, ry, tx, ty, kx, ky = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(axis.shape[1] - 1, -1, -1):
        kx, ky = kx * z + 2.0 * tx, ky * z + 2.0 * ty
        tx, ty = tx * z + rx, ty * z + ry
        rx, ry = rx * z + axis[0, j], ry * z + axis[1, j]
    size = math.sqrt(tx * tx + ty * ty)
    nx, ny = -ty / size, tx / size
    g = nx * (x - rx) + ny * (y - ry)
    if not abs(z) < REACH:
        g = math.nan
    return g, nx, ny, tx, ty, nx * kx + ny * ky


def rows_at(table, i, m, z, nx, ny, tx, ty, dofs, rows):  # type: ignore[no-untyped-def]
    """Fill the coordinates (k,) that joint i acts on at z of element m, and the rows N, A and B (3, k)."""
    k = 0
    for p in range(table.point_first[i], table.point_first[i] + table.points[i]):
        w = table.point_weights[p]
        for c in range(2):
            dofs[k + c] = table.point_dofs[p, c]
            rows[2, k + c] = 0.0
        rows[0, k], rows[0, k + 1] = w * nx, w * ny
        rows[1, k], rows[1, k + 1] = w * tx, w * ty
        k += 2
    terms, coef = table.terms[i], table.coef_first[table.element_first[i] + m]
    at = table.dof_first[i] + m * table.shapes[i]
    for p in range(table.shapes[i]):
        s, ds = 0.0, 0.0
        for j in range(terms - 1, -1, -1):
            ds = ds * z + s
            s = s * z + table.coef[coef + p * terms + j]
        for c in range(2):
            dofs[k + c] = table.dofs[at + p, c]
        rows[0, k], rows[0, k + 1] = -s * nx, -s * ny
        rows[1, k], rows[1, k + 1] = -s * tx, -s * ty
        rows[2, k], rows[2, k + 1] = ds * nx, ds * ny
        k += 2


def second(g, tx, ty, c, rows, out):  # type: ignore[no-untyped-def]
    """Fill the second derivative (k, k) of the distance, computed from its rows."""
    T = tx * tx + ty * ty
    D = T - g * c
    n = rows.shape[1]
    for a in range(n):
        for b in range(n):
            out[a, b] = -(rows[1, a] * rows[2, b] + rows[2, a] * rows[1, b] + c / T * rows[1, a] * rows[1, b]
                          + g * rows[2, a] * rows[2, b]) / D
