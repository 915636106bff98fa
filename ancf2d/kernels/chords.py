"""Bounds of the curves that contact points may touch: their chords, and a binary tree of boxes around them, with cones
of their normals."""

from __future__ import annotations

import math

from ..elements import contact_gaps, contact_geometry
from ..elements.contact_gaps import END, PAST_END, SIGN
from ..elements.contact_geometry import BULGE, OF_TANGENT, OF_THETA, SECTION, SLOPE, TERMS
from .compiled_laws import part
from .lowlevel.jit import inner

# distance of two unit vectors, if nothing is known about them
ANY = 2.0

_trace_at, _largest_offset = part(contact_gaps.trace_at), part(contact_geometry.largest_offset)


@inner
def fill_curves(table, d, none):  # type: ignore[no-untyped-def]
    """Fill the fields of all curves at d (n_full,), their chords, and the boxes around them.

    chords (curves, 5): the middle, half of the vector from the first end to the last, and a bound on the distance of
    each point of the curve from the point of the chord with the same z. boxes (., 8): low x and y, high x and y, a
    unit vector n with a bound on its distance from the normals of the curves, and a lower bound on n . r of the curves.
    ``none`` : zeros, one for each field.
    """
    for c in range(len(table.curve)):
        m, n = table.sizes[c, 0], table.sizes[c, 1]
        dof, entry, field = table.at[c, 0], table.at[c, 1], table.at[c, 2]
        for k in range(m):
            s = table.p0[field + k]
            for q in range(n):
                s += table.G[entry + k * n + q] * d[table.dofs[dof + q]]
            table.now[field + k] = s
        _fill_chord(table.curve[c], table.now[field:], none, table.chords[c])
    for arm in range(len(table.tree) - 1):
        first, n, root = table.first[arm], table.first[arm + 1] - table.first[arm], table.tree[arm]
        for k in range(n):
            x, y, dx, dy, off = table.chords[first + k]
            box, dx, dy = table.boxes[root + n - 1 + k], abs(dx) + off, abs(dy) + off
            box[0], box[1], box[2], box[3] = x - dx, y - dy, x + dx, y + dy
            box[4], box[5], box[6] = normals_of(table.curve[first + k, SIGN], table.chords[first + k])
        for k in range(n - 2, -1, -1):
            one, two = table.boxes[root + 2 * k + 1], table.boxes[root + 2 * k + 2]
            for j in range(2):
                table.boxes[root + k, j] = min(one[j], two[j])
                table.boxes[root + k, 2 + j] = max(one[2 + j], two[2 + j])
            _join_normals(one, two, table.boxes[root + k])
        for k in range(n):
            x, y, dx, dy, off = table.chords[first + k]
            box, j = table.boxes[root + n - 1 + k], n - 1 + k
            box[7] = box[4] * x + box[5] * y - abs(box[4] * dx + box[5] * dy) - off
            while j > 0:
                j = (j - 1) // 2
                box = table.boxes[root + j]
                box[7] = min(box[7], box[4] * x + box[5] * y - abs(box[4] * dx + box[5] * dy) - off)


@inner
def length_of(x, y):  # type: ignore[no-untyped-def]
    """Return the length of a vector, faster than ``math.hypot``, which avoids overflow."""
    return math.sqrt(x * x + y * y)


@inner
def normals_of(sign, chord):  # type: ignore[no-untyped-def]
    """Return the normal of a chord, and a bound on its distance from those of the curve; ``sign``: the curve's SIGN."""
    size = max(length_of(chord[2], chord[3]), 1e-300)
    # r' differs from the chord by at most twice the distance, and so the normal by a little more
    off = 3.0 * chord[4] / size if 2.0 * chord[4] < size else ANY
    return -sign * chord[3] / size, sign * chord[2] / size, off


@inner
def _join_normals(one, two, out):  # type: ignore[no-untyped-def]
    """Set the normal of a box, and the bound on its distance from others, by those of the two boxes in it."""
    x, y = one[4] + two[4], one[5] + two[5]
    size = length_of(x, y)
    out[4], out[5], out[6], out[7] = 1.0, 0.0, ANY, math.inf
    if size > 0.0:
        out[4], out[5] = x / size, y / size
        first = length_of(out[4] - one[4], out[5] - one[5]) + one[6]
        second = length_of(out[4] - two[4], out[5] - two[5]) + two[6]
        # a little more for round-off
        out[6] = min(max(first, second) + 1e-12, ANY)


@inner
def _fill_chord(par, fields, none, chord):  # type: ignore[no-untyped-def]
    """Set chord (5,) of one curve r(z): it is at most max|r''|/2 from its chord, and r' twice as much from half of it.
    """
    ax, ay, _, _, _, _ = _trace_at(par, fields, none, -1.0)
    bx, by, _, _, _, _ = _trace_at(par, fields, none, 1.0)
    chord[0], chord[1], chord[2], chord[3] = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (bx - ax), 0.5 * (by - ay)
    # points slightly past the end of a curve belong to it
    chord[4] = 2.0 * (PAST_END - 1.0) * (abs(chord[2]) + abs(chord[3]))
    if par[END] != 0.0:
        return
    terms, section, y = int(par[TERMS]), int(par[SECTION]), _largest_offset(par)
    slope, bulge = abs(par[SLOPE]) + 2.0 * abs(par[BULGE]), 2.0 * abs(par[BULGE])
    _, second, third = _sizes(fields, 0, terms, 2)
    off = 0.5 * second
    if section == OF_THETA:
        rate, change, _ = _sizes(fields, 2 * terms, terms, 1)
        off += 0.5 * (y * (change + rate * rate) + bulge) + slope * rate
    elif section == OF_TANGENT and y != 0.0:
        # |X'| >= short; the normal turns at a rate of at most |X''|/|X'|
        short = math.sqrt(fields[1]**2 + fields[terms + 1]**2) - second
        rate = second / short if short > 0.0 else math.inf
        off += 0.5 * (y * (third / short + 3.0 * rate * rate) + bulge) + slope * rate if short > 0.0 else math.inf
    chord[4] += off


@inner
def _sizes(fields, at, terms, sets):  # type: ignore[no-untyped-def]
    """Return bounds on three derivatives of one polynomial, or of two (x, y), with coefficients from ``at`` on."""
    first, second, third = 0.0, 0.0, 0.0
    for j in range(1, terms):
        size = abs(fields[at + j]) if sets == 1 else length_of(fields[at + j], fields[at + terms + j])
        first += j * size
        second += j * (j - 1) * size
        third += j * (j - 1) * (j - 2) * size
    return first, second, third


@inner
def lies_behind(box, x, y, depth):  # type: ignore[no-untyped-def]
    """Return whether (x, y) is more than ``depth`` behind the tangent at each point of the curves in a box."""
    far = length_of(max(x - box[0], box[2] - x), max(y - box[1], box[3] - y))
    return box[4] * x + box[5] * y - box[7] + box[6] * far < -depth


@inner
def distance_from_box(box, x, y):  # type: ignore[no-untyped-def]
    """Return the squared distance of (x, y) from a box (low x, low y, high x, high y)."""
    dx, dy = max(box[0] - x, 0.0, x - box[2]), max(box[1] - y, 0.0, y - box[3])
    return dx * dx + dy * dy


@inner
def nearest_on_chord(chord, x, y):  # type: ignore[no-untyped-def]
    """Return z, |z| <= 1, of the point of a chord nearest to (x, y), and a lower bound on the distance of the curve."""
    rx, ry, dx, dy = x - chord[0], y - chord[1], chord[2], chord[3]
    z = min(max((rx * dx + ry * dy) / max(dx * dx + dy * dy, 1e-300), -1.0), 1.0)
    rx, ry = rx - z * dx, ry - z * dy
    return z, max(math.sqrt(rx * rx + ry * ry) - chord[4], 0.0)
