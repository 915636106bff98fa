"""Prismatic joints: a point stays on the axis of a deformed body. Formulas and table: elements.sliding.

Signatures are those of kernels.points; rates and signals that a joint does not need are there for that alone.
"""

from __future__ import annotations

import math

import numpy as np

from ..elements import sliding
from .jit import kernel, kernel_with_memory
from .matrix import scatter

_point_at, _axis_of, _step = kernel(sliding.point_at), kernel(sliding.axis_of), kernel(sliding.step)
_measure, _rows_at, _second = kernel(sliding.measure), kernel(sliding.rows_at), kernel(sliding.second)
_END = sliding.END
# relative motion below this share of the distance from the origin cannot be told from round-off
_STILL = 1e-7


@kernel_with_memory
def _foot(table, i, d):  # type: ignore[no-untyped-def]
    """Return (element, z, (g, nx, ny, tx, ty, c)) of joint i, from the foot point last accepted."""
    count = table.elements[i]
    axis = np.zeros((count, 2, table.terms[i]))
    _axis_of(table, i, d, axis)
    x, y = _point_at(table, i, d)
    m, z, settled = int(table.memory[i, 0]), table.memory[i, 1], False
    tries = 0
    while not settled and tries < 2 * count + 2:
        m, z, settled = _step(axis, x, y, m, z)
        tries += 1
    return m, z, _measure(axis, x, y, m, z)


@kernel
def _size(table, i):  # type: ignore[no-untyped-def]
    """Return how many coordinates joint i touches at a time."""
    return 2 * (table.points[i] + table.shapes[i])


@kernel_with_memory
def _linearised(table, i, d):  # type: ignore[no-untyped-def]
    """Return (g, tx, ty, c), coordinates (k + 1,), the multiplier last, and the rows N, A, B (3, k)."""
    m, z, (g, nx, ny, tx, ty, c) = _foot(table, i, d)
    k = _size(table, i)
    dofs, rows = np.zeros(k + 1, dtype=np.int64), np.zeros((3, k))
    _rows_at(table, i, m, z, nx, ny, tx, ty, dofs, rows)
    dofs[k] = table.multiplier[i]
    return g, tx, ty, c, dofs, rows


@kernel
def _add(table, i, g, dofs, row, multiplier, Q):  # type: ignore[no-untyped-def]
    for a in range(len(row)):
        Q[dofs[a]] += multiplier * row[a]
    Q[table.multiplier[i]] += g - table.gap[i]


@kernel_with_memory
def sliding_forces(table, d, v, amps, Q):  # type: ignore[no-untyped-def]
    """Add lambda dg/dq and, at the multipliers, g to Q (n_full,); not a number where a point is off the end."""
    for i in range(len(table.multiplier)):
        g, _, _, _, dofs, rows = _linearised(table, i, d)
        _add(table, i, g, dofs, rows[0], d[table.multiplier[i]], Q)


@kernel_with_memory
def sliding_tangent(table, d, v, amps, c, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    """As ``sliding_forces``, and add the derivative to the matrix of the unknowns."""
    for i in range(len(table.multiplier)):
        g, tx, ty, bend, dofs, rows = _linearised(table, i, d)
        multiplier, k = d[table.multiplier[i]], len(dofs) - 1
        _add(table, i, g, dofs, rows[0], multiplier, Q)
        K = np.zeros((k + 1, k + 1))
        _second(g, tx, ty, bend, rows, K)
        for a in range(k):
            for b in range(k):
                K[a, b] *= multiplier
            K[k, a] = K[a, k] = rows[0, a]
        scatter(matrix, K, dofs.reshape((1, k + 1)), 0, place, indptr, index, value)


@kernel_with_memory
def _mean_row(table, i, d0, d1, g0, g1):  # type: ignore[no-untyped-def]
    """Return coordinates and the discrete gradient G of a step: G.(d1 - d0) = g1 - g0.

    It is the gradient at the mean configuration, and a force c on the point with its counterpart on the body where the
    point is: W + (a/|t|) t B are the rows of their relative motion there, a the distance of the point in the mean
    configuration, the lever of c. Neither part has a resultant or a moment. c is along the relative motion w of the
    step; where there is none, no force can do work.
    """
    d = 0.5 * (d0 + d1)
    g, tx, ty, _, dofs, rows = _linearised(table, i, d)
    T = tx * tx + ty * ty
    size = math.sqrt(T)
    across, along, turned = 0.0, 0.0, 0.0
    for a in range(len(dofs) - 1):
        change = d1[dofs[a]] - d0[dofs[a]]
        across += rows[0, a] * change
        along += rows[1, a] * change
        turned += rows[2, a] * change
    along = (along + g * turned) / size
    square = across * across + along * along
    x, y = _point_at(table, i, d)
    still = (_STILL * max(abs(x), abs(y), size))**2
    if square > 0.0:
        factor = (g1 - g0 - across) / max(square, still)
        for a in range(len(dofs) - 1):
            rows[0, a] += factor * (across * rows[0, a] + along * (rows[1, a] + g * rows[2, a]) / size)
    return dofs, rows[0]


@kernel_with_memory
def sliding_mean_forces(table, d0, d1, v, amps0, amps1, Q):  # type: ignore[no-untyped-def]
    """Add the forces of a step that keeps energy and momentum: lambda of d1 times the discrete gradient, g at d1."""
    for i in range(len(table.multiplier)):
        _, _, start = _foot(table, i, d0)
        _, _, end = _foot(table, i, d1)
        dofs, row = _mean_row(table, i, d0, d1, start[0], end[0])
        _add(table, i, end[0], dofs, row, d1[table.multiplier[i]], Q)


@kernel_with_memory
def sliding_constraint_rates(table, d, v, amps, out_velocity, out_acceleration):  # type: ignore[no-untyped-def]
    """Set 0 and v^T g_qq v at the multipliers: rates obey g_q v = 0, accelerations g_q v' = -v^T g_qq v."""
    for i in range(len(table.multiplier)):
        g, tx, ty, bend, dofs, rows = _linearised(table, i, d)
        along, turned = 0.0, 0.0
        for a in range(len(dofs) - 1):
            along += rows[1, a] * v[dofs[a]]
            turned += rows[2, a] * v[dofs[a]]
        T = tx * tx + ty * ty
        out_velocity[table.multiplier[i]] = 0.0
        out_acceleration[table.multiplier[i]] = -(2.0 * along * turned + bend / T * along * along
                                                  + g * turned * turned) / (T - g * bend)


@kernel
def sliding_violation(table, d, amps):  # type: ignore[no-untyped-def]
    """Return the largest change of distance beside the size of the coordinates it is formed from."""
    worst = 0.0
    for i in range(len(table.multiplier)):
        _, _, at = _foot(table, i, d)
        g = abs(at[0] - table.gap[i]) / table.scale[i]
        if not g <= worst:
            worst = g
    return worst


@kernel
def sliding_accept(table, d):  # type: ignore[no-untyped-def]
    """Take the foot points of the accepted state d as where the next searches begin."""
    for i in range(len(table.multiplier)):
        m, z, at = _foot(table, i, d)
        if not math.isnan(at[0]):
            table.memory[i, 0], table.memory[i, 1] = m, z


@kernel
def sliding_check(table, d):  # type: ignore[no-untyped-def]
    """Return the number of the first joint whose point is off the end of its body, or -1."""
    for i in range(len(table.multiplier)):
        m, z, at = _foot(table, i, d)
        if math.isnan(at[0]) or (m == 0 and z < -_END) or (m == table.elements[i] - 1 and z > _END):
            return i
    return -1


@kernel_with_memory
def sliding_noise(table, d, out):  # type: ignore[no-untyped-def]
    """Add what a unit relative error of every coordinate's share in a force can sum up to (n_full,)."""
    for i in range(len(table.multiplier)):
        g, tx, ty, bend, dofs, rows = _linearised(table, i, d)
        multiplier, k = abs(d[table.multiplier[i]]), len(dofs) - 1
        H = np.zeros((k, k))
        _second(g, tx, ty, bend, rows, H)
        e = np.zeros(k)
        for a in range(k):
            e[a] = abs(table.e0[dofs[a]]) + abs(d[dofs[a]])
            out[dofs[k]] += abs(rows[0, a]) * e[a]
        for a in range(k):
            s = abs(rows[0, a])
            for b in range(k):
                s += abs(H[a, b]) * e[b]
            out[dofs[a]] += multiplier * s
