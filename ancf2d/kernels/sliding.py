"""Prismatic joints: a point keeps its distance from the axis of a deformed body. Formulas and table: elements.sliding.

Signatures are those of kernels.points, including arguments that joints do not use. Forces of a conserving step need no
signals, but work space for the mean configuration.
"""

from __future__ import annotations

import math

from ..elements import sliding
from .compiled_laws import part
from .lowlevel.arrays import array, matrices, numbers, vector
from .lowlevel.jit import inner, kernel, seldom
from .matrices.matrix import scatter

_point_at, _find, _rows_at, _second = (part(f) for f in (
    sliding.point_at, sliding.foot, sliding.rows_at, sliding.second))
_END = sliding.END
# relative motion below this fraction of the distance from the origin is lost in round-off
_STILL = 1e-7


@inner
def _foot(table, i, d):  # type: ignore[no-untyped-def]
    """Return (element, z, (g, nx, ny, tx, ty, c)) of joint i; the search starts at the last accepted foot point."""
    return _find(table, i, d, matrices(2, 2, table.terms[i]))


@inner
def _size(table, i):  # type: ignore[no-untyped-def]
    """Return how many coordinates joint i acts on at a time (without the multiplier)."""
    return 2 * (table.points[i] + table.shapes[i])


@inner
def _linearise(table, i, d, dofs, rows):  # type: ignore[no-untyped-def]
    """Fill coordinates (k + 1,), the multiplier last, and the rows N, A, B (3, k); return (g, tx, ty, c)."""
    m, z, (g, nx, ny, tx, ty, c) = _foot(table, i, d)
    _rows_at(table, i, m, z, nx, ny, tx, ty, dofs, rows)
    dofs[rows.shape[1]] = table.multiplier[i]
    return g, tx, ty, c


@inner
def _add(table, i, g, dofs, row, multiplier, Q):  # type: ignore[no-untyped-def]
    for a in range(len(row)):
        Q[dofs[a]] += multiplier * row[a]
    Q[table.multiplier[i]] += g - table.gap[i]


@inner
def _force(table, i, d, Q):  # type: ignore[no-untyped-def]
    if not table.on[i]:
        Q[table.multiplier[i]] += d[table.multiplier[i]]
        return
    k = _size(table, i)
    dofs, rows = numbers(table.dofs, k + 1), array(3, k)
    g, _, _, _ = _linearise(table, i, d, dofs, rows)
    _add(table, i, g, dofs, rows[0], d[table.multiplier[i]], Q)


@kernel
def sliding_forces(table, d, v, amps, Q):  # type: ignore[no-untyped-def]
    """Add lambda dg/dq and, at the multipliers, the change of g to Q (n_full,); nan if a point is off the end."""
    for i in range(len(table.multiplier)):
        _force(table, i, d, Q)


@inner
def _fill(table, i, d, dofs, rows, K):  # type: ignore[no-untyped-def]
    """Fill coordinates and rows as in ``_linearise``, and the stiffness K (k + 1, k + 1); return g."""
    k, multiplier = rows.shape[1], d[table.multiplier[i]]
    g, tx, ty, bend = _linearise(table, i, d, dofs, rows)
    _second(g, tx, ty, bend, rows, K)
    for a in range(k):
        for b in range(k):
            K[a, b] *= multiplier
        K[k, a] = K[a, k] = rows[0, a]
    K[k, k] = 0.0
    return g


@inner
def _fill_inactive(table, i, dofs, rows, K):  # type: ignore[no-untyped-def]
    """Fill coordinates and the stiffness K (k + 1, k + 1) of an inactive joint: its equation is multiplier = 0."""
    k = rows.shape[1]
    _rows_at(table, i, int(table.memory[i, 0]), 0.0, 0.0, 0.0, 0.0, 0.0, dofs, rows)
    dofs[k] = table.multiplier[i]
    for a in range(k + 1):
        for b in range(k + 1):
            K[a, b] = 0.0
    K[k, k] = 1.0


@inner
def _tangent(table, i, d, Q, matrix, places):  # type: ignore[no-untyped-def]
    k = _size(table, i)
    dofs, rows, K = numbers(table.dofs, k + 1), array(3, k), array(k + 1, k + 1)
    if table.on[i]:
        g = _fill(table, i, d, dofs, rows, K)
        _add(table, i, g, dofs, rows[0], d[table.multiplier[i]], Q)
    else:
        _fill_inactive(table, i, dofs, rows, K)
        Q[table.multiplier[i]] += d[table.multiplier[i]]
    scatter(matrix, K, dofs.reshape((1, k + 1)), 0, places)


@kernel
@seldom
def sliding_matrix(table, i, d, dofs, Q, K):  # type: ignore[no-untyped-def]
    """Fill coordinates, forces (k + 1,) and stiffness (k + 1, k + 1) of joint i; the next search starts here.

    Returns whether the point is beside the body, not off its ends.
    """
    rows = array(3, len(Q) - 1)
    if not table.on[i]:
        _fill_inactive(table, i, dofs, rows, K)
        Q[:] = 0.0
        Q[len(Q) - 1] = d[table.multiplier[i]]
        return True
    m, z, at = _foot(table, i, d)
    if math.isnan(at[0]):
        return False
    g = _fill(table, i, d, dofs, rows, K)
    for a in range(len(Q) - 1):
        Q[a] = d[table.multiplier[i]] * rows[0, a]
    Q[len(Q) - 1] = g - table.gap[i]
    table.memory[i, 0], table.memory[i, 1] = m, z
    return True


@inner
def sliding_tangent(table, d, v, amps, c, Q, matrix, places):  # type: ignore[no-untyped-def]
    """Same as ``sliding_forces``, and add the derivative to the matrix of the unknowns."""
    for i in range(len(table.multiplier)):
        _tangent(table, i, d, Q, matrix, places)


@inner
def _mean_row(table, i, d, d0, d1, change, dofs, rows):  # type: ignore[no-untyped-def]
    """Fill coordinates and, in the first row, the discrete gradient G of a step: G.(d1 - d0) = change of g.

    It is the gradient at the mean configuration d plus a force c on the point, with the reaction on the body at the
    same place. The rows of their relative motion are W + (a/|t|) t B, where a is the distance of the point in the mean
    configuration, the lever of c. Neither part has a resultant or a moment. c is along the relative motion w of the
    step; without relative motion no force can do work.
    """
    g, tx, ty, _ = _linearise(table, i, d, dofs, rows)
    size = math.sqrt(tx * tx + ty * ty)
    across, along, turned = 0.0, 0.0, 0.0
    for a in range(rows.shape[1]):
        moved = d1[dofs[a]] - d0[dofs[a]]
        across += rows[0, a] * moved
        along += rows[1, a] * moved
        turned += rows[2, a] * moved
    along = (along + g * turned) / size
    square = across * across + along * along
    x, y = _point_at(table, i, d)
    still = (_STILL * max(abs(x), abs(y), size))**2
    if square > 0.0:
        factor = (change - across) / max(square, still)
        for a in range(rows.shape[1]):
            rows[0, a] += factor * (across * rows[0, a] + along * (rows[1, a] + g * rows[2, a]) / size)


@inner
def _mean_force(table, i, d, d0, d1, Q):  # type: ignore[no-untyped-def]
    if not table.on[i]:
        Q[table.multiplier[i]] += d1[table.multiplier[i]]
        return
    k = _size(table, i)
    dofs, rows = numbers(table.dofs, k + 1), array(3, k)
    _, _, start = _foot(table, i, d0)
    _, _, end = _foot(table, i, d1)
    _mean_row(table, i, d, d0, d1, end[0] - start[0], dofs, rows)
    _add(table, i, end[0], dofs, rows[0], d1[table.multiplier[i]], Q)


@kernel
def sliding_mean_forces(table, d0, d1, mid, Q):  # type: ignore[no-untyped-def]
    """Add the forces of an energy-momentum step to Q: lambda of d1 times the discrete gradient, and g at d1.

    ``mid`` (n_full,) is work space.
    """
    for k in range(len(mid)):
        mid[k] = 0.5 * (d0[k] + d1[k])
    for i in range(len(table.multiplier)):
        _mean_force(table, i, mid, d0, d1, Q)


@inner
def _constraint_rates(table, i, d, v, out_velocity, out_acceleration):  # type: ignore[no-untyped-def]
    k = _size(table, i)
    dofs, rows = numbers(table.dofs, k + 1), array(3, k)
    g, tx, ty, bend = _linearise(table, i, d, dofs, rows)
    along, turned = 0.0, 0.0
    for a in range(k):
        along += rows[1, a] * v[dofs[a]]
        turned += rows[2, a] * v[dofs[a]]
    T = tx * tx + ty * ty
    out_velocity[dofs[k]] = 0.0
    out_acceleration[dofs[k]] = -(2.0 * along * turned + bend / T * along * along
                                  + g * turned * turned) / (T - g * bend)


@kernel
@seldom
def sliding_constraint_rates(table, d, v, amps, out_velocity, out_acceleration):  # type: ignore[no-untyped-def]
    """Set 0 and v^T g_qq v at the multipliers: rates satisfy g_q v = 0, accelerations g_q v' = -v^T g_qq v."""
    for i in range(len(table.multiplier)):
        if table.on[i]:
            _constraint_rates(table, i, d, v, out_velocity, out_acceleration)
        else:
            out_velocity[table.multiplier[i]] = out_acceleration[table.multiplier[i]] = 0.0


@kernel
def sliding_violation(table, d, amps):  # type: ignore[no-untyped-def]
    """Return the largest change of distance, relative to the size of the coordinates it is computed from."""
    worst = 0.0
    for i in range(len(table.multiplier)):
        if not table.on[i]:
            continue
        _, _, at = _foot(table, i, d)
        g = abs(at[0] - table.gap[i]) / table.scale[i]
        if not g <= worst:
            worst = g
    return worst


@kernel
@seldom
def sliding_accept(table, d):  # type: ignore[no-untyped-def]
    """Store the foot points of the accepted state d, where the next searches start."""
    for i in range(len(table.multiplier)):
        if not table.on[i]:
            continue
        m, z, at = _foot(table, i, d)
        if not math.isnan(at[0]):
            table.memory[i, 0], table.memory[i, 1] = m, z


@kernel
@seldom
def sliding_check(table, d):  # type: ignore[no-untyped-def]
    """Return the number of the first joint whose point is off the end of its body, or -1."""
    for i in range(len(table.multiplier)):
        if not table.on[i]:
            continue
        m, z, at = _foot(table, i, d)
        if math.isnan(at[0]) or (m == 0 and z < -_END) or (m == table.elements[i] - 1 and z > _END):
            return i
    return -1


@inner
def _noise(table, i, d, out):  # type: ignore[no-untyped-def]
    k, multiplier = _size(table, i), abs(d[table.multiplier[i]])
    dofs, rows, H, e = numbers(table.dofs, k + 1), array(3, k), array(k, k), vector(k)
    g, tx, ty, bend = _linearise(table, i, d, dofs, rows)
    _second(g, tx, ty, bend, rows, H)
    for a in range(k):
        e[a] = abs(table.e0[dofs[a]]) + abs(d[dofs[a]])
        out[dofs[k]] += abs(rows[0, a]) * e[a]
    for a in range(k):
        s = abs(rows[0, a])
        for b in range(k):
            s += abs(H[a, b]) * e[b]
        out[dofs[a]] += multiplier * s


@kernel
@seldom
def sliding_noise(table, d, out):  # type: ignore[no-untyped-def]
    """Add to out (n_full,) the sum of the sizes of all terms in the forces; times the unit round-off it bounds errors.
    """
    for i in range(len(table.multiplier)):
        if table.on[i]:
            _noise(table, i, d, out)
