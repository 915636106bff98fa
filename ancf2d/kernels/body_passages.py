"""Penetrations that contact points miss: where a body is deepest in another one between its points, points that pass
through a body between two states and are outside it in both, and points that are too deep to face a surface."""

from __future__ import annotations

import math

import numpy as np

from ..elements import contact_gaps
from ..elements.contact_gaps import BOTH_SIDES, DEEPEST, FOOT_KIND, SIDE, WITHIN
from ..elements.contact_geometry import HALF_INTERVAL, HOME, OPPOSITE, PLACE, PLACEMENT, WORK
from .chords import distance_from_box, fill_curves, nearest_on_chord
from .compiled_laws import part
from .facing import DEEP, EVERY, face, find_curve
from .lowlevel.arrays import copy, numbers, vector
from .lowlevel.jit import inner, kernel, kernel_with_memory, seldom
from .points import fields_of_first, fields_of_item, is_inactive

# fractions of the largest penetration allowed: largest motion between two samples, and penetration that counts as 0
PART, SAME = 0.2, 1e-6
# samples of an interval between contact points, and golden sections around the deepest one
SAMPLES, SECTIONS, GOLDEN = 9, 40, 0.6180339887498949

_line_at, _gap_between, _is_past_end = (part(f) for f in (
    contact_gaps.line_at, contact_gaps.gap_between, contact_gaps.is_past_end))


@inner
def _positions(table, points, d, out):  # type: ignore[no-untyped-def]
    """Fill out (k + 2 curves, 2) with the positions of the points, then of both ends of the curves, at d (n_full,)."""
    u, none, n = vector(200), vector(200), len(table.item)
    fill_curves(table, d, none)
    for k in range(n):
        i = table.item[k]
        par, mem = points.par[i], points.mem[i]
        fields_of_first(points, i, table.own[k, 1], d, u)
        z = mem[PLACE] if mem[PLACEMENT] > 0.0 else par[HOME]
        out[k, 0], out[k, 1], _, _, _, _ = _line_at(par, points.p0[points.field[i]:], u, z)
    for c in range(len(table.curve)):
        x, y, dx, dy, _ = table.chords[c]
        out[n + 2 * c, 0], out[n + 2 * c, 1] = x - dx, y - dy
        out[n + 2 * c + 1, 0], out[n + 2 * c + 1, 1] = x + dx, y + dy


@inner
def _find_gaps(table, points, d, within, gaps, side):  # type: ignore[no-untyped-def]
    """Fill the gaps (k,) of points at d (n_full,), inf for points that face nothing ``within`` a distance; return the
    smallest one.

    ``side`` (k,) : side of an axis that each point is on, found here where it is 0.
    """
    near = np.inf
    for k in range(len(table.item)):
        points.mem[table.item[k], SIDE] = side[k]
    face(table, points, d, within, EVERY)
    u, own, work, across = vector(200), vector(WORK), vector(WORK), vector(WORK)
    for k in range(len(table.item)):
        i = table.item[k]
        mem, b, e = points.mem[i], points.field[i], points.field[i + 1]
        gaps[k] = np.inf
        if is_inactive(points, i):
            continue
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

    Between samples of the path no point moves further than the smallest gap, or a fraction of the body's height. No
    point comes nearer to a curve than their distance less ``way``, so distant ones are not searched.
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
    _find_gaps(table, points, d1, way, last, side)
    copy(kept, side)
    s, through, near = 0.0, False, _find_gaps(table, points, d0, way, first, side)
    while not through:
        s += max(near, PART * thin) / way
        if s >= 1.0:
            break
        for k in range(len(d)):
            d[k] = d0[k] + s * (d1[k] - d0[k])
        near = _find_gaps(table, points, d, way, gaps, side)
        for k in range(n):
            through |= first[k] > -SAME * thin and last[k] > 0.0 and gaps[k] < -PART * thin
    for k in range(n):
        points.mem[table.item[k], SIDE] = kept[k]
    return through


@kernel
@seldom
def may_be_deep(table, points, d, least, most):  # type: ignore[no-untyped-def]
    """Return whether a point may be ``least`` deep in the other body at d (n_full,), by chords of its curves.

    No point in the body is more than ``most`` away from them, which is half of its height.
    """
    u, none, waiting = vector(200), vector(200), numbers(table.item, DEEP)
    fill_curves(table, d, none)
    for k in range(len(table.item)):
        i = table.item[k]
        fields_of_first(points, i, table.own[k, 1], d, u)
        x, y, _, _, _, _ = _line_at(points.par[i], points.p0[points.field[i]:], u, points.par[i, HOME])
        for arm in range(table.arms[table.way[k]], table.arms[table.way[k] + 1]):
            boxed = distance_from_box(table.boxes[table.tree[arm]], x, y) == 0.0
            if boxed and _is_between(table, arm, x, y, least, most, waiting):
                return True
    return False


@inner
def _is_between(table, arm, x, y, least, most, waiting):  # type: ignore[no-untyped-def]
    """Return whether the distance of a point from the curves of an arm may be between two values."""
    first, n, root = table.first[arm], table.first[arm + 1] - table.first[arm], table.tree[arm]
    waiting[0], count, found = 0, 1, False
    while count > 0:
        count -= 1
        k = waiting[count]
        if distance_from_box(table.boxes[root + k], x, y) > most * most:
            continue
        if k < n - 1:
            waiting[count], waiting[count + 1] = 2 * k + 1, 2 * k + 2
            count += 2
            continue
        chord = table.chords[first + k - (n - 1)]
        distance = nearest_on_chord(chord, x, y)[1]
        if distance + 2.0 * chord[4] < least:
            return False
        found |= distance <= most
    return found


@inner
def _gap_from(table, points, k, d, z, within, arrays):  # type: ignore[no-untyped-def]
    """Return the gap of point k at position z of its element, inf if it faces nothing ``within`` a distance, or only an
    end."""
    u, best, room, none, own, work, across, waiting = arrays
    i = table.item[k]
    points.mem[i, PLACE] = z
    fields_of_item(points, i, d, u)
    points.apart[i] = 0.0
    find_curve(table, points, k, u, z, within, best, room, none, waiting)
    if points.apart[i] == np.inf or _is_past_end(points.par[i, OPPOSITE:], points.mem[i, FOOT_KIND]):
        return np.inf
    fields_of_item(points, i, d, u)
    b, e = points.field[i], points.field[i + 1]
    g = _gap_between(points.par[i], points.p0[b:e], u, points.mem[i], own, work, across)[0]
    return np.inf if np.isnan(g) else g


@kernel
@seldom
def body_deepest(table, points, free, d, depth, place):  # type: ignore[no-untyped-def]
    """Fill the largest penetration (depth) within the interval of each point that may move, and its position (place).

    ``free`` (n,) : which points may move; depth (n,) is 0 if there is no maximum inside the interval. Call it after
    ``face`` at d (n_full,).
    """
    room, g, kept = vector(points.par.shape[1]), vector(SAMPLES), vector(points.mem.shape[1])
    arrays = (vector(200), vector(7), room, vector(200), vector(WORK), vector(WORK), vector(WORK),
              numbers(table.item, DEEP))
    for k in range(len(table.item)):
        i = table.item[k]
        depth[i] = 0.0
        if not free[i]:
            continue
        copy(points.mem[i], kept)
        points.mem[i, PLACEMENT] = 1.0
        half, at = points.par[i, HALF_INTERVAL], 0
        low, step = points.par[i, HOME] - half, 2.0 * half / (SAMPLES - 1)
        for s in range(SAMPLES):
            g[s] = _gap_from(table, points, k, d, low + s * step, points.par[i, OPPOSITE + DEEPEST], arrays)
            at = s if g[s] < g[at] else at
        if 0 < at < SAMPLES - 1 and g[at] < 0.0:
            # golden section search between the neighbours
            a, e = low + (at - 1) * step, low + (at + 1) * step
            for _ in range(SECTIONS):
                one, two = e - GOLDEN * (e - a), a + GOLDEN * (e - a)
                if _gap_from(table, points, k, d, one, np.inf, arrays) < _gap_from(table, points, k, d, two, np.inf,
                                                                                   arrays):
                    e = two
                else:
                    a = one
            place[i] = 0.5 * (a + e)
            depth[i] = -_gap_from(table, points, k, d, place[i], np.inf, arrays)
        copy(kept, points.mem[i])
