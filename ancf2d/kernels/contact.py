"""Gaps of contact points, and where along an element a body penetrates an obstacle most."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from numba import types

from ..elements import contact_geometry as geometry
from ..elements import contact_sliding as sliding
from ..elements.contact_gaps import line_at
from ..elements.contact_geometry import (
    AT_HOME,
    CIRCLE,
    FEATURE,
    HALF_INTERVAL,
    HOME,
    MEMORY,
    ON_BEAM,
    ON_ELEMENT,
    OPPOSITE,
    PLACE,
    PLACEMENT,
    POLYLINE,
    POSE,
    POSE_X,
    POSE_Y,
    RHO,
    SHAPE,
    SLIDING,
    STATUS,
    STILL,
    WORK,
)
from ..elements.contact_layer import sets_of, to_obstacle_frame
from .body_passages import bodies_cross, body_deepest, may_be_deep
from .compiled_laws import part
from .facing import body_gaps, face
from .lowlevel.arrays import vector
from .lowlevel.jit import inner, kernel, seldom
from .points import amplitude_of, fields_of_item

# samples of an interval between contact points; penetration next to an existing point counts from this fraction of the
# beam's local deflection there
SAMPLES, SHARE_OF_DEFLECTION = 9, 0.25
# fractions of the extent: a path less deep than this does not pass through an obstacle; depth that counts as touching
DEPTH, TOUCHES = 1e-3, 1e-9
# a point has passed through if the cosine between the normals where it enters and leaves is below the first number,
# or below the second one on a path deeper than the third (fraction of the extent)
TURNED, TURNED_DEEP, DEEP = -0.5, 0.5, 2e-2
# the depth is integrated on either side of the deepest point of an interval, over this many lengths, each twice as long
# as the one before, with this many midpoints each
HALVES, PIECES = 12, 4

_feature_at, _gap_at, _distance_at, _bound_on_distance, _faces_away, _position_at = (part(f) for f in (
    geometry.feature_at, geometry.gap_at, geometry.distance_at, geometry.bound_on_distance, geometry.faces_away,
    geometry.position_at))
_line_at, _to_frame, _sets_of = part(line_at), part(to_obstacle_frame), part(sets_of)
_gap_at_place, _foot_of_centre, _sliding_place, _slopes, _compliance, _compliance_between = (part(f) for f in (
    sliding.gap_at_place, sliding.foot_of_centre, sliding.sliding_place, sliding.slopes, sliding.compliance,
    sliding.compliance_between))


@kernel
@seldom
def contact_gaps(points, d, amps, gaps, along, faces):  # type: ignore[no-untyped-def]
    """Fill gap, position on the obstacle and whether the point looks towards it (n,) for all points at d (n_full,)."""
    u, w, a, work = vector(200), vector(200), vector(3), vector(WORK)
    for i in range(len(points.forces)):
        b, m = points.field[i], points.field[i + 1] - points.field[i]
        fields_of_item(points, i, d, u)
        amplitude_of(points, i, amps, u, w, a)
        z = points.par[i, HOME] if points.mem[i, PLACEMENT] == AT_HOME else points.mem[i, PLACE]
        _position_at(points.par[i], points.p0[b:b + m], u, z, work)
        feature = -1.0 if points.mem[i, PLACEMENT] == AT_HOME else points.mem[i, FEATURE]
        gaps[i], nx, ny, _, along[i], _ = _gap_at(points.par[i], work[RHO], work[RHO + 1], feature)
        if points.mem[i, PLACEMENT] == SLIDING or points.mem[i, PLACEMENT] == ON_BEAM:
            gaps[i] -= u[m - 1] * _compliance(points.par[i], z)[0]
        faces[i] = not _faces_away(points.par[i], nx, ny, work)


@inner
def place_seen(par, p0, u, z, work):  # type: ignore[no-untyped-def]
    """Return x and y of a place of a curve in the frame of its obstacle, without derivatives. Overwrites work."""
    x, y, _, _, _, _ = _line_at(par, p0, u, z)
    if int(par[POSE]) == STILL:
        return x, y
    _, at = _sets_of(par)
    for k in range(2 + int(par[POSE])):
        work[k] = p0[at + k] + u[at + k]
    x, y, _, _, _, _ = _to_frame(par, work, x, y)
    return par[POSE_X] + x, par[POSE_Y] + y


@inner
def is_crossed(par, x, y, g, dx, dy, depth):  # type: ignore[no-untyped-def]
    """Return whether the straight path (dx, dy) from (x, y), where the gap is g, leads ``depth`` into an obstacle."""
    length = math.sqrt(dx * dx + dy * dy)
    s = max(g, depth)
    while s < length:
        # the obstacle is at least as far away as the gap
        g = _distance_at(par, x + s / length * dx, y + s / length * dy, -1.0)[0]
        if g < -depth:
            return True
        s += max(g, depth)
    return False


@inner
def _entry_normal(par, x, y, dx, dy, depth):  # type: ignore[no-untyped-def]
    """Return the normal of an obstacle where the straight path (dx, dy) from (x, y) first comes within ``depth``."""
    length, s = math.sqrt(dx * dx + dy * dy), 0.0
    g, nx, ny, _, _ = _distance_at(par, x, y, -1.0)
    while g > depth and s < length:
        s += g
        g, nx, ny, _, _ = _distance_at(par, x + s / length * dx, y + s / length * dy, -1.0)
    return nx, ny


@inner
def _passes_through(par, p0, u, v, z, extent, work):  # type: ignore[no-untyped-def]
    """Return whether place z of a curve passes through an obstacle between fields u and v: see ``obstacle_crossed``."""
    depth, near = DEPTH * extent, TOUCHES * extent
    x, y = place_seen(par, p0, u, z, work)
    dx, dy = place_seen(par, p0, v, z, work)
    dx, dy = dx - x, dy - y
    g = _distance_at(par, x, y, -1.0)[0]
    g_end, mx, my, _, _ = _distance_at(par, x + dx, y + dy, -1.0)
    if g <= -near or math.sqrt(dx * dx + dy * dy) <= g + g_end or not is_crossed(par, x, y, g, dx, dy, depth):
        return False
    nx, ny = _entry_normal(par, x, y, dx, dy, depth)
    if g_end <= -near:
        return nx * mx + ny * my < TURNED
    mx, my = _entry_normal(par, x + dx, y + dy, -dx, -dy, depth)
    turned = nx * mx + ny * my
    return turned < TURNED or (turned < TURNED_DEEP and is_crossed(par, x, y, g, dx, dy, DEEP * extent))


@kernel
@seldom
def obstacle_crossed(points, free, before, amps_before, d, amps, extent):  # type: ignore[no-untyped-def]
    """Return whether a point passes through its obstacle, or past its middle, on the straight path between two states.

    Points are checked at home; those that may move (``free``) at samples of their interval. A path passes through if
    the surface where it leaves, or the one nearest to its end, is turned by more than 120 degrees from the one where it
    enters, or by more than 60 degrees if it leads deep; otherwise the point slides along. ``extent`` is that of the
    scene.
    """
    u, v, w, a, work = vector(200), vector(200), vector(200), vector(3), vector(WORK)
    for i in range(len(points.forces)):
        if points.mem[i, PLACEMENT] != AT_HOME and not free[i]:
            continue
        par, b, m = points.par[i], points.field[i], points.field[i + 1] - points.field[i]
        fields_of_item(points, i, before, u)
        amplitude_of(points, i, amps_before, u, w, a)
        fields_of_item(points, i, d, v)
        amplitude_of(points, i, amps, v, w, a)
        half = par[HALF_INTERVAL] if free[i] else 0.0
        for k in range(SAMPLES if free[i] else 1):
            z = par[HOME] - half + 2.0 * half * k / (SAMPLES - 1)
            if _passes_through(par, points.p0[b:b + m], u, v, z, extent, work):
                return True
    return False


@kernel
@seldom
def gap_slopes(points, d, amps, slope, bend):  # type: ignore[no-untyped-def]
    """Fill slope = g_z and bend = g_zz (n,) of the gap of each point that was placed off its home, at d (n_full,)."""
    u, w, a, work = vector(200), vector(200), vector(3), vector(WORK)
    for i in range(len(points.forces)):
        if points.mem[i, PLACEMENT] <= 0.0:
            continue
        par, z, b, m = points.par[i], points.mem[i, PLACE], points.field[i], points.field[i + 1] - points.field[i]
        fields_of_item(points, i, d, u)
        amplitude_of(points, i, amps, u, w, a)
        _position_at(par, points.p0[b:b + m], u, z, work)
        _, nx, ny, k, _ = _distance_at(par, work[RHO], work[RHO + 1], points.mem[i, FEATURE])
        slope[i], bend[i], _, _ = _slopes(par, z, 0.0, nx, ny, k, work)


@inner
def _try_from(par, p0, u, mem, work, z, feature, low, high, about, best):  # type: ignore[no-untyped-def]
    """Minimise the gap to one ``feature`` of the obstacle from z; store the minimum in ``best`` if it is the deepest.

    ``about``: the minimum is found as the foot point of the centre of a circle.
    """
    mem[PLACE], mem[FEATURE] = z, feature
    found = _foot_of_centre(par, p0, u, z, work) if about else _sliding_place(par, p0, u, mem, 0.0, work)
    if math.isnan(found) or not low <= found <= high:
        return
    g, nx, ny, _, _, _ = _gap_at_place(par, mem, found, 0.0, work)
    # the gap to a corner can also be negative outside of the obstacle, behind the corner
    inside = feature < 0.0 or _distance_at(par, work[RHO], work[RHO + 1], -1.0)[0] < 0.0
    if g < best[0] and inside and not _faces_away(par, nx, ny, work):
        best[0], best[1], best[2] = g, found, feature


@kernel
@seldom
def deepest(points, free, d, amps, depth, place, feature):  # type: ignore[no-untyped-def]
    """Fill the largest penetration (depth) in the interval of each point that may move, its place, and the feature.

    ``free`` (n,) : which points may move; depth (n,) is 0 if nothing penetrates inside the interval.
    """
    u, w, a, work = vector(200), vector(200), vector(3), vector(WORK)
    mem, best, g, zs = vector(MEMORY), vector(3), vector(SAMPLES), vector(SAMPLES)
    xs, ys = vector(SAMPLES), vector(SAMPLES)
    for i in range(len(points.forces)):
        depth[i] = 0.0
        if not free[i]:
            continue
        b, m = points.field[i], points.field[i + 1] - points.field[i]
        par, p0 = points.par[i], points.p0[b:b + m]
        fields_of_item(points, i, d, u)
        amplitude_of(points, i, amps, u, w, a)
        low, high = par[HOME] - par[HALF_INTERVAL], par[HOME] + par[HALF_INTERVAL]
        longest, at = 0.0, 0
        taken = points.mem[i, STATUS] > 0.0 and points.mem[i, PLACEMENT] > 0.0
        if not taken and _is_apart(par, p0, u, work):
            continue
        for k in range(SAMPLES):
            zs[k] = low + (high - low) * k / (SAMPLES - 1)
            xs[k], ys[k] = place_seen(par, p0, u, zs[k], work)
            g[k] = _distance_at(par, xs[k], ys[k], -1.0)[0]
            if taken and points.mem[i, PLACEMENT] != ON_ELEMENT:
                g[k] -= u[m - 1] * _compliance_between(par, zs[k], points.mem[i, PLACE])
            if k > 0:
                longest = max(longest, math.hypot(xs[k] - xs[k - 1], ys[k] - ys[k - 1]))
            if g[k] < g[at]:
                at = k
        # the gap changes at most by the distance along the curve
        if g[at] > longest:
            continue
        best[0] = 0.0
        if taken:
            depth[i], place[i], feature[i] = _next_to_point(par, u[m - 1], points.mem[i], xs[at], ys[at], zs[at], g[at])
            continue
        if int(par[SHAPE]) != POLYLINE:
            circle = int(par[SHAPE]) == CIRCLE
            if not circle or par[OPPOSITE + 2] > 0.0 or 0 < at < SAMPLES - 1:
                # a circle whose centre is closer than the samples are to each other
                small = circle and par[OPPOSITE + 2] > 0.0 and par[OPPOSITE + 2] + g[at] < longest
                _try_from(par, p0, u, mem, work, zs[at], -1.0, low, high, small, best)
        else:
            _try_polyline(par, p0, u, mem, work, zs, xs, ys, g, longest, best)
        depth[i], place[i], feature[i] = -best[0], best[1], best[2]


@kernel
@seldom
def overlaps(points, d, amps, place, x, w, exact, summed):  # type: ignore[no-untyped-def]
    """Fill the integral of the depth over z on each interval (n,) at d (n_full,), and its sum over points x (n, m).

    ``place`` (n,) is the deepest point of each interval; ``w`` (n, m) are the weights of x in [0, 1].
    """
    u, v, a, work = vector(200), vector(200), vector(3), vector(WORK)
    for i in range(len(points.forces)):
        b, m = points.field[i], points.field[i + 1] - points.field[i]
        par, p0 = points.par[i], points.p0[b:b + m]
        fields_of_item(points, i, d, u)
        amplitude_of(points, i, amps, u, v, a)
        low, length = par[HOME] - par[HALF_INTERVAL], 2.0 * par[HALF_INTERVAL]
        exact[i], summed[i] = 0.0, 0.0
        if _is_apart(par, p0, u, work):
            continue
        for k in range(x.shape[1]):
            summed[i] += length * w[i, k] * _depth(par, p0, u, low + length * x[i, k], work)
        if summed[i] == 0.0 and _depth(par, p0, u, place[i], work) == 0.0:
            continue
        for side in range(2):
            way = low - place[i] if side == 0 else low + length - place[i]
            far = way
            for half in range(HALVES + 1):
                near = 0.5 * far if half < HALVES else 0.0
                step = (far - near) / PIECES
                for k in range(PIECES):
                    exact[i] += abs(step) * _depth(par, p0, u, place[i] + near + (k + 0.5) * step, work)
                far = near


@inner
def _is_apart(par, p0, u, work):  # type: ignore[no-untyped-def]
    """Return whether all of a curve is further from the obstacle than its length."""
    x, y = place_seen(par, p0, u, par[HOME], work)
    return _distance_at(par, x, y, -1.0)[0] > _bound_on_distance(par, p0, u, par[HOME])


@inner
def _depth(par, p0, u, z, work):  # type: ignore[no-untyped-def]
    """Return the depth of the curve in the obstacle at z, or 0 if it is the back of the curve."""
    x, y = place_seen(par, p0, u, z, work)
    g, nx, ny, _, _ = _distance_at(par, x, y, -1.0)
    if g >= 0.0:
        return 0.0
    _position_at(par, p0, u, z, work)
    return 0.0 if _faces_away(par, nx, ny, work) else -g


@inner
def _next_to_point(par, multiplier, mem, x, y, z, g):  # type: ignore[no-untyped-def]
    """Return (depth, z, feature) if sample z penetrates another feature than the existing point of the interval, by
    more than a share of the beam's local deflection there; else zeros."""
    what = float(_feature_at(par, x, y)) if int(par[SHAPE]) == POLYLINE else mem[FEATURE]
    soft = 0.0 if mem[PLACEMENT] == ON_ELEMENT else _compliance(par, mem[PLACE])[0]
    if what == mem[FEATURE] or g >= SHARE_OF_DEFLECTION * multiplier * soft:
        return 0.0, 0.0, 0.0
    return -g, z, what


@inner
def _try_polyline(par, p0, u, mem, work, zs, xs, ys, g, longest, best):  # type: ignore[no-untyped-def]
    """Call ``_try`` for the sides of a polyline close to samples (x, y) with gaps g, and for its convex corners."""
    low, high = zs[0], zs[SAMPLES - 1]
    for k in range(SAMPLES):
        if g[k] <= longest:
            what = _feature_at(par, xs[k], ys[k])
            if what % 2 == 0:
                _try_from(par, p0, u, mem, work, zs[k], float(what), low, high, False, best)
    n, c = int(par[OPPOSITE]), OPPOSITE + 2
    for v in range(n):
        if not _convex(par, v, n):
            continue
        near, far = -1, 2.0 * longest
        for k in range(SAMPLES):
            D = math.hypot(xs[k] - par[c + 3 * v], ys[k] - par[c + 3 * v + 1])
            if far > D:
                near, far = k, D
        if near >= 0:
            _try_from(par, p0, u, mem, work, zs[near], 2.0 * v + 1.0, low, high, False, best)


@inner
def _convex(par, v, n):  # type: ignore[no-untyped-def]
    """Return whether vertex v of a polyline is a convex corner of the solid; ends of an open polyline are not."""
    c = OPPOSITE + 2
    if par[OPPOSITE + 1] < 0.0 and (v == 0 or v == n - 1):
        return False
    before, after = (v - 1 + n) % n, (v + 1) % n
    ax, ay = par[c + 3 * v] - par[c + 3 * before], par[c + 3 * v + 1] - par[c + 3 * before + 1]
    bx, by = par[c + 3 * after] - par[c + 3 * v], par[c + 3 * after + 1] - par[c + 3 * v + 1]
    return ax * by - ay * bx < 0.0


def contact_compilations(problem: Any, obstacles: bool, bodies: bool, sided: bool, soft: bool, moves: bool
                         ) -> list[Callable[[], object]]:
    """Return callables that compile the kernels of contact search, for a model with contacts of these kinds.

    ``sided``: some are hard; ``soft``: some have a law; ``moves``: for a motion, which checks its steps by ``tunnels``.
    """
    points, facing = (problem.place[name][1] for name in ("points", "facing"))
    x, xx, b = types.float64[::1], types.float64[:, ::1], types.boolean[::1]
    out: list[Callable[[], object]] = []
    if bodies:
        out += [partial(face.compile, (facing, points, x, types.float64, types.int64)),
                partial(body_gaps.compile, (facing, points, x, x, xx)),
                partial(may_be_deep.compile, (facing, points, x, types.float64, types.float64))]
        if not moves:
            out.append(partial(bodies_cross.compile, (facing, points, x, x)))
        if sided:
            out.append(partial(body_deepest.compile, (facing, points, b, x, x, x)))
    if obstacles:
        out += [partial(contact_gaps.compile, (points, x, xx, x, x, b)),
                partial(gap_slopes.compile, (points, x, xx, x, x))]
        if not moves:
            out.append(partial(obstacle_crossed.compile, (points, b, x, xx, x, xx, types.float64)))
        if sided or soft:
            out.append(partial(deepest.compile, (points, b, x, xx, x, x, x)))
        if soft:
            out.append(partial(overlaps.compile, (points, x, xx, x, xx, xx, x, x)))
    return out
