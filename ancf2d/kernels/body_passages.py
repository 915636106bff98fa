"""Detect contact points that pass through a body between two states and are outside it in both."""

from __future__ import annotations

import math

import numpy as np

from ..elements import contact_derivatives, contact_gaps, contact_geometry
from ..elements.contact_gaps import BOTH_SIDES, DEEPEST, FOOT_KIND, SIDE, WITHIN
from ..elements.contact_geometry import HOME, OPPOSITE, PLACE, PLACEMENT, RHO, WORK
from .compiled_laws import part
from .facing import face, fill_curves
from .lowlevel.arrays import copy, vector
from .lowlevel.jit import inner, kernel_with_memory, seldom
from .points import fields_of_item

# fractions of the largest penetration allowed: largest motion between two samples, and penetration that counts as 0
PART, SAME = 0.2, 1e-6

_curve_at, _gap_between, _field_count, _position_at = (part(f) for f in (
    contact_gaps.curve_at, contact_gaps.gap_between, contact_derivatives.field_count, contact_geometry.position_at))


@inner
def _positions(table, points, d, out):  # type: ignore[no-untyped-def]
    """Fill out (k + 2 curves, 2) with the positions of the points, then of both ends of the curves, at d (n_full,)."""
    fill_curves(table, d)
    u, none, work, across, n = vector(200), vector(200), vector(WORK), vector(WORK), len(table.item)
    par_of = vector(table.curve.shape[1])
    for k in range(n):
        i = table.item[k]
        par, mem, b = points.par[i], points.mem[i], points.field[i]
        z = mem[PLACE] if mem[PLACEMENT] > 0.0 else par[HOME]
        fields_of_item(points, i, d, u)
        _position_at(par, points.p0[b:b + _field_count(par)], u, z, work)
        out[k, 0], out[k, 1] = work[RHO], work[RHO + 1]
    for k in range(2 * len(table.curve)):
        copy(table.curve[k // 2], par_of)
        _curve_at(par_of, table.now[table.at[k // 2, 2]:], none, 2.0 * (k % 2) - 1.0, work, across)
        out[n + k, 0], out[n + k, 1] = work[RHO], work[RHO + 1]


@inner
def _find_gaps(table, points, d, gaps, side):  # type: ignore[no-untyped-def]
    """Fill the gaps (k,) of points at d (n_full,), inf for points that face nothing; return the smallest gap.

    ``side`` (k,) : side of an axis that each point is on, found here where it is 0.
    """
    near = np.inf
    for k in range(len(table.item)):
        points.mem[table.item[k], SIDE] = side[k]
    face(table, points, d, False)
    u, own, work, across = vector(200), vector(WORK), vector(WORK), vector(WORK)
    for k in range(len(table.item)):
        i = table.item[k]
        mem, b, e = points.mem[i], points.field[i], points.field[i + 1]
        fields_of_item(points, i, d, u)
        both = points.par[i, OPPOSITE + BOTH_SIDES] > 0.0
        if both and mem[FOOT_KIND] == WITHIN and side[k] == 0.0:
            mem[SIDE] = 1.0
            g = _gap_between(points.par[i], points.p0[b:e], u, mem, own, work, across)[0]
            mem[SIDE] = side[k] = -1.0 if g < 0.0 else 1.0
        g = _gap_between(points.par[i], points.p0[b:e], u, mem, own, work, across)[0]
        gaps[k] = np.inf if np.isnan(g) or mem[PLACEMENT] < 0.0 else g
        near = min(near, gaps[k])
    return near


@kernel_with_memory
@seldom
def bodies_cross(table, points, d0, d1):  # type: ignore[no-untyped-def]
    """Return whether a point passes through a body along the straight path from d0 (n_full,) to d1, apart at both.

    Between samples of the path no point moves further than the smallest gap, or a fraction of the body's height.
    """
    n = len(table.item)
    one, two = np.zeros((n + 2 * len(table.curve), 2)), np.zeros((n + 2 * len(table.curve), 2))
    _positions(table, points, d0, one)
    _positions(table, points, d1, two)
    mx, my, way = 0.0, 0.0, 0.0
    for k in range(len(one)):
        mx, my = mx + (two[k, 0] - one[k, 0]) / len(one), my + (two[k, 1] - one[k, 1]) / len(one)
    for k in range(len(one)):
        dx, dy = two[k, 0] - one[k, 0] - mx, two[k, 1] - one[k, 1] - my
        way = max(way, 2.0 * math.sqrt(dx * dx + dy * dy))
    thin = np.inf
    for i in table.item:
        thin = min(thin, points.par[i, OPPOSITE + DEEPEST])
    if way < PART * thin:
        return False
    kept, side, first, last, gaps = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    d = np.zeros(len(d0))
    for k in range(n):
        side[k] = kept[k] = points.mem[table.item[k], SIDE]
    _find_gaps(table, points, d1, last, side)
    copy(kept, side)
    s, through, near = 0.0, False, _find_gaps(table, points, d0, first, side)
    while not through:
        s += max(near, PART * thin) / way
        if s >= 1.0:
            break
        for k in range(len(d)):
            d[k] = d0[k] + s * (d1[k] - d0[k])
        near = _find_gaps(table, points, d, gaps, side)
        for k in range(n):
            through |= first[k] > -SAME * thin and last[k] > 0.0 and gaps[k] < -PART * thin
    for k in range(n):
        points.mem[table.item[k], SIDE] = kept[k]
    return through
