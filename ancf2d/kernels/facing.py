"""Search for the element of a body that each contact point of another body, or of the same one, faces.

The curves at which a body may be touched are the leaves of a binary tree of boxes, in their order along the body. The
boxes are updated for every state, and each point descends to the curve with the nearest foot point, so the cost is
linear in the number of points and curves up to a logarithm. If only forces are needed, points that are too far away to
have one are skipped.
"""

from __future__ import annotations

import math

import numpy as np

from ..elements import contact_derivatives, contact_gaps
from ..elements.contact_gaps import (
    AT_FIRST,
    AT_LAST,
    BODY_SIZE,
    BOTH_SIDES,
    CORNER,
    CURVE_SIZE,
    DEEPEST,
    FADE,
    FOOT,
    FOOT_KIND,
    LEAST_DISTANCE,
    NOWHERE,
    ONWARD,
    OPPOSITE_INTERVALS,
    OWN_LOOP,
    PAST_END,
    POINT_S,
    POINT_SPAN,
    SIDE,
    SIGN,
    SPAN,
    START,
    SUPPORTED_PART,
    SUPPORTED_POINT,
    WITHIN,
)
from ..elements.contact_geometry import (
    AUGMENTATION,
    CLOSED,
    FACE,
    FACE_COSINE,
    FRICTION,
    HOME,
    OPEN,
    OPPOSITE,
    PLACE,
    PLACEMENT,
    STATUS,
    TOUCH,
    UNUSED,
    UNUSED_ON_ELEMENT,
    WORK,
)
from .chords import distance_from_box, fill_curves, lies_behind, nearest_on_chord, normals_of
from .compiled_laws import part
from .lowlevel.arrays import copy, numbers, vector
from .lowlevel.jit import inner, kernel, seldom
from .points import fields_of_first, fields_of_item, weights_of_item

# largest cosine between outward normals of a corner and a surface that may touch
CORNER_COSINE = 0.5
# results of ``_place_beyond``
AT_END, ON_NEXT, IN_GAP = range(3)
# equal positions, and energies
SAME, SAME_ENERGY = 1e-6, 1e-9
# instead of a distance, for ``face``: that at which each point may have a force; the same, but any distance for points
# of an axis, which remember their side
IN_RANGE, IN_RANGE_OR_BESIDE, EVERY = 0.0, -1.0, -1
# most nodes of the tree that wait during a descent: two for each level
DEEP = 128

_is_past_end, _line_at, _trace_at, _foot_point, _gap_between, _place_opposite, _share_of_energy, _field_count = (
    part(f) for f in (contact_gaps.is_past_end, contact_gaps.line_at, contact_gaps.trace_at, contact_gaps.foot_point,
                      contact_gaps.gap_between, contact_gaps.place_opposite, contact_gaps.share_of_energy,
                      contact_derivatives.field_count))


@inner
def _can_touch(par, point, curve, chord, tx, ty):  # type: ignore[no-untyped-def]
    """Return whether a point may touch any place of a curve, by its position and chord; tangent etc. as in ``_faces``.
    """
    first, last = curve[START] - point[POINT_S], curve[START] + curve[SPAN] - point[POINT_S]
    if max(abs(first), abs(last)) < point[LEAST_DISTANCE] or (point[ONWARD] > 0.0 and last <= 0.0):
        return False
    nx, ny, off = normals_of(curve[SIGN], chord)
    return _faces(par, point, nx, ny, tx, ty, off)


@inner
def _faces(par, other, nx, ny, tx, ty, off):  # type: ignore[no-untyped-def]
    """Return whether a point on a body with tangent (tx, ty) faces a surface with a normal within ``off`` of (nx, ny).
    """
    if other[BOTH_SIDES] > 0.0:
        return True
    face, end = _cosines(par, other, nx, ny, tx, ty)
    if par[FACE] != 0.0 and other[CORNER] != 0.0:
        return face - off < CORNER_COSINE and end - off < CORNER_COSINE
    return face + end - off < (0.0 if other[FADE] > 0.0 else FACE_COSINE)


@inner
def _cosines(par, other, nx, ny, tx, ty):  # type: ignore[no-untyped-def]
    """Return the cosines between a normal and those of the face and of the end that a point is on, else 0."""
    size = math.sqrt(tx * tx + ty * ty)
    return par[FACE] * (tx * ny - ty * nx) / size, other[CORNER] * (tx * nx + ty * ny) / size


@inner
def _may_touch(par, other, s, nx, ny, tx, ty):  # type: ignore[no-untyped-def]
    """Return whether a point on a body with tangent (tx, ty) may touch at S = s [m], where the normal is (nx, ny)."""
    away = abs(s - other[POINT_S])
    if other[OWN_LOOP] > 0.0:
        away = min(away, other[OWN_LOOP] - away)
    if away < other[LEAST_DISTANCE] or (other[ONWARD] > 0.0 and s <= other[POINT_S]):
        return False
    return _faces(par, other, nx, ny, tx, ty, 0.0)


@inner
def _place_beyond(table, c, found, x, y, cx, cy, bx, by, none):  # type: ignore[no-untyped-def]
    """Return where (x, y) is beyond the end ``found`` of curve c, at (cx, cy) with the derivative (bx, by): AT_END,
    opposite to the curve that continues it (ON_NEXT), or IN_GAP between both, outside of a blunt corner.
    """
    step = 1 if found == AT_LAST else -1
    k = table.beside[c, (step + 1) // 2]
    px, py, tx, ty, _, _ = _trace_at(table.curve[k], table.now[table.at[k, 2]:], none, -1.0 * step)
    if step * ((x - px) * tx + (y - py) * ty) > 0.0:
        return ON_NEXT
    return IN_GAP if step * ((px - cx) * bx + (py - cy) * by) > SAME * (bx * bx + by * by) else AT_END


@inner
def _try_curve(table, c, par, other, none, x, y, tx, ty, z, best):  # type: ignore[no-untyped-def]
    """Replace ``best`` by the foot point on curve c if it is nearer and may touch; return whether it was replaced.

    z : where Newton's method starts.

    best : (distance squared, z, kind of foot point, side of the point, whether the point is closed, largest distance
    squared, squared depth with the share of it that counts for the energy where pressure fades).
    """
    fields, found = table.now[table.at[c, 2]:], WITHIN
    foot = z = _foot_point(other, fields, none, x, y, z)
    if z < -PAST_END:
        z, found = -1.0, AT_FIRST
    elif z > PAST_END:
        z, found = 1.0, AT_LAST
    if other[OPPOSITE_INTERVALS] > 0.0 and (best[4] != CLOSED or par[FRICTION] > 0.0):
        # positions with contact points of their own, spaced evenly along the curve, are left to these; closed points
        # without friction slide past them
        place = 0.5 * (z + 1.0) * (other[OPPOSITE_INTERVALS] if other[SPAN] > 0.0 else 1.0)
        if abs(place - round(place)) < SAME:
            return False
    cx, cy, bx, by, _, _ = _trace_at(other, fields, none, z)
    rx, ry = x - cx, y - cy
    D, size = rx * rx + ry * ry, math.sqrt(bx * bx + by * by)
    if min(best[0], best[5]) <= D:
        return False
    sign = other[SIGN]
    nx, ny = -sign * by / size, sign * bx / size
    inside = nx * rx + ny * ry < 0.0
    if inside and other[BOTH_SIDES] == 0.0 and best[4] != CLOSED and _is_past_end(other, found):
        # an end as the nearest point from inside a body counts only where the next element joins; other ends are where
        # the body stops, which closed points may slide past
        return False
    if inside and other[DEEPEST]**2 < D:
        return False
    fades, depth = other[FADE] > 0.0 and other[BOTH_SIDES] == 0.0, math.sqrt(D)
    if inside and found != WITHIN and other[BOTH_SIDES] == 0.0 and not _is_past_end(other, found):
        beyond = _place_beyond(table, c, found, x, y, cx, cy, bx, by, none)
        if beyond == ON_NEXT:
            # even if the surface ends before it comes opposite to the point
            return False
        if beyond == IN_GAP and fades:
            # the faces of both arms extend into it
            z, found, depth = foot, WITHIN, -nx * rx - ny * ry
    if not _may_touch(par, other, other[START] + 0.5 * (z + 1.0) * other[SPAN], nx, ny, tx, ty):
        return False
    best[0], best[1], best[2], best[6] = D, z, found, 0.0
    if fades and inside:
        face, end = _cosines(par, other, nx, ny, tx, ty)
        best[6] = depth * depth * _share_of_energy(other, -depth, z, face + end)
    return True


@inner
def _nearest(table, way, par, x, y, tx, ty, best, room, none, waiting):  # type: ignore[no-untyped-def]
    """Return the curve that a contact point faces, or -1 if there is none; fill ``best`` (``_try_curve``).

    Only curves nearer than the largest squared distance in ``best`` are found. Where pressure fades, a point touches
    that of the faces and ends of each arm for which its energy is largest. This energy is continuous where the point
    goes over from one to another, as its share in each vanishes at the ends of this one.
    """
    found = -1
    best[0], best[1], best[2], best[6] = np.inf, 0.0, NOWHERE, 0.0
    for arm in range(table.arms[way], table.arms[way + 1]):
        last = table.first[arm + 1]
        ends = 2 if room[FADE] > 0.0 and table.curve[last - 1, SPAN] == 0.0 else 0
        for c in range(last - ends - 1, last):
            D, z, kind, most = best[0], best[1], best[2], best[6]
            best[0], best[6] = np.inf, 0.0
            if c < last - ends:
                # any of the faces, which come before the ends
                c = _nearest_in_tree(table, arm, last - ends, par, x, y, tx, ty, best, room, none, waiting)
            elif not _is_nearer(table, c, par, x, y, tx, ty, best, room, none):
                c = -1
            if c >= 0 and (best[6] > (1.0 + SAME_ENERGY) * most
                           or (best[0] < D and best[6] >= (1.0 - SAME_ENERGY) * most)):
                found = c
            else:
                best[0], best[1], best[2], best[6] = D, z, kind, most
    return found


@inner
def _nearest_in_tree(table, arm, end, par, x, y, tx, ty, best, room, none, waiting):  # type: ignore[no-untyped-def]
    """Return the nearest curve of an arm before number ``end`` that a contact point faces, or -1; fill ``best``."""
    first, n, root, found = table.first[arm], table.first[arm + 1] - table.first[arm], table.tree[arm], -1
    waiting[0], count = 0, 1
    while count > 0:
        count -= 1
        k = waiting[count]
        near = min(best[0], best[5])
        box = table.boxes[root + k]
        if distance_from_box(box, x, y) >= near or not _faces(par, room, box[4], box[5], tx, ty, box[6]):
            continue
        if room[BOTH_SIDES] == 0.0 and lies_behind(box, x, y, room[DEEPEST]):
            # too deep inside the body
            continue
        if k >= n - 1:
            c = first + k - (n - 1)
            if c < end and _is_nearer(table, c, par, x, y, tx, ty, best, room, none):
                found = c
            continue
        one, two = 2 * k + 1, 2 * k + 2
        if distance_from_box(table.boxes[root + one], x, y) < distance_from_box(table.boxes[root + two], x, y):
            one, two = two, one
        # the nearer one is visited first
        waiting[count], waiting[count + 1] = one, two
        count += 2
    return found


@inner
def _is_nearer(table, c, par, x, y, tx, ty, best, room, none):  # type: ignore[no-untyped-def]
    """Return whether a point may touch curve c and is nearer to it than to the one in ``best``, which it replaces."""
    z, least = nearest_on_chord(table.chords[c], x, y)
    if least * least >= min(best[0], best[5]) or not _can_touch(par, room, table.curve[c], table.chords[c], tx, ty):
        return False
    copy(table.curve[c], room[:CURVE_SIZE])
    if room[BOTH_SIDES] > 0.0:
        room[SIGN] = best[3]
    return _try_curve(table, c, par, room, none, x, y, tx, ty, z, best)


@inner
def _is_supported(fixed, z):  # type: ignore[no-untyped-def]
    """Return whether supports hold the point z of a curve (``fixed``: SUPPORTED_PART of the curve)."""
    return fixed >= 4.0 or (fixed % 2.0 == 1.0 and z < SAME - 1.0) or (fixed >= 2.0 and z > 1.0 - SAME)


@inner
def find_curve(table, points, k, u, z, within, best, room, none, waiting):  # type: ignore[no-untyped-def]
    """Find the curve that point k faces from position z of its element, whose fields are in u, and store it.

    If nothing is ``within`` this distance, the point is marked as far from all.
    """
    i = table.item[k]
    par, mem = points.par[i], points.mem[i]
    points.apart[i], mem[FOOT_KIND] = np.inf, NOWHERE
    x, y, tx, ty, _, _ = _line_at(par, points.p0[points.field[i]:], u, z)
    near = False
    for arm in range(table.arms[table.way[k]], table.arms[table.way[k] + 1]):
        near = near or distance_from_box(table.boxes[table.tree[arm]], x, y) < within * within
    if not near:
        return
    for q in range(len(room)):
        room[q] = par[OPPOSITE + q] if CURVE_SIZE <= q < BODY_SIZE else 0.0
    # arc length of the point itself on its body
    room[POINT_S] += 0.5 * (z - par[HOME]) * room[POINT_SPAN]
    best[3], best[4], best[5] = mem[SIDE], mem[STATUS], within * within
    c = _nearest(table, table.way[k], par, x, y, tx, ty, best, room, none, waiting)
    if c < 0 and within < np.inf:
        return
    points.apart[i], mem[FOOT], mem[FOOT_KIND] = 0.0, best[1], best[2]
    if c >= 0 and par[OPPOSITE + SUPPORTED_POINT] != 0.0 and _is_supported(table.curve[c, SUPPORTED_PART], best[1]):
        # supports determine the gap, so no contact force can
        mem[FOOT_KIND] = NOWHERE
    if c >= 0:
        _copy_curve(table, points, k, i, c)


@inner
def _force_range(points, i, d):  # type: ignore[no-untyped-def]
    """Return the distance beyond which point i has no force at d (n_full,), whatever it faces."""
    par, k = points.par[i], points.multiplier[i]
    reach = par[OPPOSITE + DEEPEST]
    if k < 0 or points.mem[i, STATUS] == OPEN:
        return reach
    # a hard contact closes if its multiplier exceeds AUGMENTATION times the gap; a closed one has no limit
    return reach if points.mem[i, STATUS] != CLOSED and -d[k] < par[AUGMENTATION] * (reach - par[TOUCH]) else np.inf


@kernel
def face(table, points, d, within, only):  # type: ignore[no-untyped-def]
    """Find the element that every contact point between bodies faces at d (n_full,), and store it in the point laws.

    ``within`` : distance [m] of the elements that are found, at least the largest penetration allowed, or ``IN_RANGE``,
    or ``IN_RANGE_OR_BESIDE``. Points far from all are marked as such and face nothing. ``only`` : a single item, or
    ``EVERY`` point.
    """
    found = only == EVERY
    for i in table.item:
        found |= i == only
    if len(table.item) == 0 or not found:
        return
    u, none, best, room = vector(200), vector(200), vector(7), vector(points.par.shape[1])
    fill_curves(table, d, none)
    waiting = numbers(table.item, DEEP)
    for k in range(len(table.item)):
        i = table.item[k]
        beside = points.par[i, OPPOSITE + BOTH_SIDES] > 0.0
        unused = UNUSED_ON_ELEMENT <= points.mem[i, PLACEMENT] <= UNUSED
        # only points of an axis have to know their side before they are in use
        if (only != EVERY and only != i) or (unused and not beside):
            continue
        fields_of_first(points, i, table.own[k, 1], d, u)
        z = points.mem[i, PLACE] if points.mem[i, PLACEMENT] > 0.0 else points.par[i, HOME]
        reach = max(within, points.par[i, OPPOSITE + DEEPEST])
        if within <= IN_RANGE:
            reach = np.inf if beside and within == IN_RANGE_OR_BESIDE else _force_range(points, i, d)
        find_curve(table, points, k, u, z, reach, best, room, none, waiting)


@kernel
@seldom
def body_gaps(table, points, d, gaps, places):  # type: ignore[no-untyped-def]
    """Fill the gap of each point, inf if it faces nothing, after ``face`` at d (n_full,).

    ``places`` (n, 3): position of the opposite point on its surface, length of a unit of this position, and number of
    the surface; nan if there is none.
    """
    u, own, work, across = vector(200), vector(WORK), vector(WORK), vector(WORK)
    for i in table.item:
        fields_of_item(points, i, d, u)
        b, e, par = points.field[i], points.field[i + 1], points.par[i]
        g, _, _, z = _gap_between(par, points.p0[b:e], u, points.mem[i], own, work, across)
        gaps[i] = np.inf if np.isnan(g) else g
        places[i, 0], places[i, 1], places[i, 2] = np.nan, np.nan, np.nan
        if not np.isnan(g):
            places[i, 0], places[i, 1], places[i, 2] = _place_opposite(par, points.p0[b:e], u, points.mem[i], z, work,
                                                                       across)


@inner
def _copy_curve(table, points, k, i, c):  # type: ignore[no-untyped-def]
    """Copy coordinates, weights and constants of curve c into item i, after the item's own."""
    m, n = table.sizes[c, 0], table.sizes[c, 1]
    dof, entry, field = table.at[c, 0], table.at[c, 1], table.at[c, 2]
    fields, coords = table.own[k, 0], table.own[k, 1]
    G = weights_of_item(points, i)
    for q in range(n):
        points.dofs[points.dof[i] + coords + q] = table.dofs[dof + q]
    for p in range(m):
        points.p0[points.field[i] + fields + p] = table.p0[field + p]
        for q in range(n):
            G[coords + q, fields + p] = table.G[entry + p * n + q]
    for q in range(CURVE_SIZE):
        points.par[i, OPPOSITE + q] = table.curve[c, q]
