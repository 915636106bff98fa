"""Point laws item by item: springs, dampers, turning loads and constraints in a table (``elements.point_laws``)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..elements.point_laws import APART
from .compiled_laws import call_forces, call_mean
from .lowlevel.arrays import vector
from .lowlevel.jit import inlined, inner, kernel, seldom
from .lowlevel.records import array_at


class Assembly(NamedTuple):
    """Direct assembly for contact curves (``Points.run``) and hard contact points with friction: unknowns and slots.

    Points that rub on other bodies have changing coordinates: for them only ``skew`` exists, by their coordinates.

    begin : (n + 1, 3) where the unknowns, rows of W and entries of each item begin; unknown (k,) : the unknowns that an
    item acts on; W (k, fields) : W^T maps them to the fields, with ``span`` (k, 2) as in ``Points``; slot : place in
    the matrix of each entry of the lower half, row by row; skew : skew part of the last tangent, and has_skew
    (n,) : whether it is not zero; most_unknowns : largest number of unknowns of an item. Empty in statics.
    """

    begin: Any
    unknown: Any
    W: Any
    span: Any
    slot: Any
    skew: Any
    has_skew: Any
    most_unknowns: int


class Points(NamedTuple):
    """Items of point laws. Item i has the fields p0 + G d[dofs] and acts on the coordinates dofs.

    forces, mean, accept, forces_of_run, accept_run : (n,) addresses of the law's functions, 0 if it has none or it is
    not needed; field, dof, entry : (n + 1,) where the fields, coordinates and entries of G of item i begin in p0, dofs
    and G (columns of G one after another); span : (coordinates, 2) first and last + 1 field that each coordinate
    changes; par : (n, constants); mem : (n, numbers) last angles and other history variables; signal : (n, 3) rows of
    the amplitudes, -1 for a constant 1; fed : (n, 3) fields that these signals prescribe, or -1; multiplier : (n,) full
    coordinate of the multiplier, or -1; scale : (n,) size of the constraint's terms; on : (n,) whether the item is
    active (an inactive law has no force, an inactive constraint a zero multiplier); drift : rates of the fields while
    their coordinates are constant; restitution : (n,) coefficient of one-sided constraints, nan: contacts with a law,
    -1: no contact; run : (n,) how many items from here on share fields, coordinates and amplitude, which
    ``forces_of_run`` evaluates together. apart : (n,) change of the fields below which the item or run cannot act,
    from the coordinates ``there`` (coordinates,), where a unit of a coordinate counts ``lever`` (coordinates,);
    infinite for points far from all bodies that they may face (``facing``).
    """

    forces: Any
    mean: Any
    accept: Any
    forces_of_run: Any
    accept_run: Any
    field: Any
    dof: Any
    entry: Any
    dofs: Any
    G: Any
    span: Any
    p0: Any
    par: Any
    mem: Any
    signal: Any
    fed: Any
    multiplier: Any
    scale: Any
    on: Any
    drift: Any
    restitution: Any
    run: Any
    apart: Any
    lever: Any
    there: Any
    assembly: Assembly


@inlined
def weights_of_item(points, i):  # type: ignore[no-untyped-def]
    """Return G^T (coordinates, fields) of item i."""
    n, m = points.dof[i + 1] - points.dof[i], points.field[i + 1] - points.field[i]
    return array_at(points.G, points.entry[i], (n, m))


@inlined
def coordinates_of_item(points, i):  # type: ignore[no-untyped-def]
    """Return the coordinates (n,) of item i, and the range of fields (n, 2) that each changes."""
    first, n = points.dof[i], points.dof[i + 1] - points.dof[i]
    return array_at(points.dofs, first, (n,)), array_at(points.span, 2 * first, (n, 2))


@inner
def fields_of_first(points, i, n, d, out):  # type: ignore[no-untyped-def]
    """Fill out with the contribution of the first n coordinates of item i to G d."""
    m = points.field[i + 1] - points.field[i]
    dofs, span = coordinates_of_item(points, i)
    for k in range(m):
        out[k] = 0.0
    for c in range(n):
        low, x = span[c, 0], d[dofs[c]]
        own = array_at(out, low, (span[c, 1] - low,))
        row = array_at(points.G, points.entry[i] + c * m + low, (len(own),))
        for k in range(len(own)):
            own[k] += row[k] * x


@inner
def fields_of_item(points, i, d, out):  # type: ignore[no-untyped-def]
    """Fill out with the fields G d of item i, without p0."""
    fields_of_first(points, i, points.dof[i + 1] - points.dof[i], d, out)


@inner
def rates_of_item(points, i, v, out):  # type: ignore[no-untyped-def]
    """Fill out with the rates of the fields of item i, drift included."""
    fields_of_item(points, i, v, out)
    for k in range(points.field[i + 1] - points.field[i]):
        out[k] += points.drift[points.field[i] + k]


@inner
def amplitude_of(points, i, amps, u, w, a):  # type: ignore[no-untyped-def]
    """Fill a (3,) with the amplitude of item i and its derivatives; set the fields (u) and rates (w) given by signals.
    """
    k = points.signal[i, 0]
    a[0], a[1], a[2] = 1.0, 0.0, 0.0
    if k >= 0:
        for order in range(3):
            a[order] = amps[k, order]
    for j in range(3):
        if points.fed[i, j] >= 0:
            u[points.fed[i, j]] = amps[points.signal[i, j], 0]
            w[points.fed[i, j]] = amps[points.signal[i, j], 1]


@inner
def add_to(points, i, f, Q):  # type: ignore[no-untyped-def]
    """Add G^T f of item i to Q."""
    n, m = points.dof[i + 1] - points.dof[i], points.field[i + 1] - points.field[i]
    dofs, span = coordinates_of_item(points, i)
    for c in range(n):
        low, s = span[c, 0], 0.0
        own = array_at(f, low, (span[c, 1] - low,))
        row = array_at(points.G, points.entry[i] + c * m + low, (len(own),))
        for k in range(len(own)):
            s += row[k] * own[k]
        Q[dofs[c]] += s


@inner
def evaluate_item(points, i, d, v, amps, u, w, a, f, H, C):  # type: ignore[no-untyped-def]
    """Fill fields, rates, amplitude and f, H, C of item i; return (energy, dissipated power)."""
    rates_of_item(points, i, v, w)
    return evaluate_at(points, i, d, amps, u, w, a, f, H, C)


@inner
def evaluate_at(points, i, d, amps, u, w, a, f, H, C):  # type: ignore[no-untyped-def]
    """Same as ``evaluate_item``, with the rates already in w."""
    fields_of_item(points, i, d, u)
    amplitude_of(points, i, amps, u, w, a)
    return law_of_item(points, i, u, w, a, f, H, C, points.field[i + 1] - points.field[i])


@inner
def is_inactive(points, i):  # type: ignore[no-untyped-def]
    """Return whether item i is inactive: switched off, or a point with no body nearby."""
    return not points.on[i] or points.apart[i] == np.inf


@inner
def does_not_act(points, i, d):  # type: ignore[no-untyped-def]
    """Return whether the items from i on are inactive or still out of reach: the coordinates have moved less than the
    last known distance to acting, and the multiplier is zero.
    """
    if is_inactive(points, i):
        return True
    if points.apart[i] <= 0.0 or (points.multiplier[i] >= 0 and d[points.multiplier[i]] != 0.0):
        return False
    n, first, way = points.dof[i + 1] - points.dof[i], points.dof[i], 0.0
    dofs, lever = array_at(points.dofs, first, (n,)), array_at(points.lever, first, (n,))
    there = array_at(points.there, first, (n,))
    for c in range(n):
        way += lever[c] * abs(d[dofs[c]] - there[c])
    return way < points.apart[i]


@inner
def law_of_item(points, i, u, w, a, f, H, C, wide):  # type: ignore[no-untyped-def]
    """Fill f (m,), H and C (m, m), both row by row, of item i from its fields and amplitude.

    Returns (energy, dissipated power). ``wide`` is m, or 0 if only forces are needed.
    """
    energy, power = law_or_distance(points, i, u, w, a, f, H, C, wide)
    return (0.0, 0.0) if power == APART else (energy, power)


@inner
def law_or_distance(points, i, u, w, a, f, H, C, wide):  # type: ignore[no-untyped-def]
    """Same as ``law_of_item``, but returns (distance to acting, APART) if the law does not act."""
    b, m = points.field[i], points.field[i + 1] - points.field[i]
    f[:m] = 0.0
    H[:wide * m] = 0.0
    C[:wide * m] = 0.0
    if is_inactive(points, i):
        if points.multiplier[i] >= 0:
            f[m - 1] = u[m - 1]
            H[m * m - 1] = 1.0
        return 0.0, 0.0
    return call_forces(points.forces[i], (points.p0[b:b + m], u[:m], w[:m], points.par[i], a, points.mem[i], f[:m],
                                          array_at(H, 0, (wide, wide)), array_at(C, 0, (wide, wide))))


@inlined
def largest_size(begin):  # type: ignore[no-untyped-def]
    """Return the largest number of entries of an item, from the offsets (n + 1,) of the entries."""
    most = 0
    for i in range(len(begin) - 1):
        most = max(most, begin[i + 1] - begin[i])
    return most


@inlined
def work_arrays(points):  # type: ignore[no-untyped-def]
    """Return work arrays u, w, a, f, H, C for any item of the table."""
    n = largest_size(points.field)
    return vector(n), vector(n), vector(3), vector(n), vector(n * n), vector(n * n)


@inner
def stiffness_of(points, i, H, C, h, c, symmetric, row, K):  # type: ignore[no-untyped-def]
    """Fill K (n, n) with G^T (h H + c C) G of item i, or its symmetric part; ``row`` (fields,) is work space.

    Overwrites H.
    """
    m, n = points.field[i + 1] - points.field[i], points.dof[i + 1] - points.dof[i]
    A = array_at(H, 0, (m, m))
    for p in range(m * m):
        H[p] = h * H[p] + c * C[p]
    if symmetric:
        for p in range(m):
            for q in range(p):
                A[p, q] = A[q, p] = 0.5 * (A[p, q] + A[q, p])
    _, span = coordinates_of_item(points, i)
    line = array_at(row, 0, (m,))
    for r in range(n):
        for q in range(m):
            line[q] = 0.0
        low = span[r, 0]
        for p in range(span[r, 1] - low):
            g, own = array_at(points.G, points.entry[i] + r * m + low, (m,))[p], array_at(H, (low + p) * m, (m,))
            for q in range(m):
                line[q] += g * own[q]
        for s in range(r + 1 if symmetric else n):
            low, x = span[s, 0], 0.0
            part = array_at(row, low, (span[s, 1] - low,))
            own = array_at(points.G, points.entry[i] + s * m + low, (len(part),))
            for q in range(len(part)):
                x += part[q] * own[q]
            K[r, s] = x
    if symmetric:
        for r in range(n):
            for s in range(r):
                K[s, r] = K[r, s]


@kernel
def point_matrices(points, d, v, amps, linear, energy, Q, K, C):  # type: ignore[no-untyped-def]
    """Fill energies (n,), forces Q (n, k), stiffness K and damping C (n, k, k) of items with k coordinates each.

    C, or both, are left out if their size is 0. ``linear``: fields prescribed by a signal enter to first order only, as
    in linear theory about the reference.
    """
    u, w, a, f, H, D = work_arrays(points)
    row = vector(len(f))
    for i in range(len(points.forces)):
        m, n, fed = points.field[i + 1] - points.field[i], len(Q[i]), points.fed[i, 0]
        if points.multiplier[i] < 0 and is_inactive(points, i):
            energy[i], Q[i] = 0.0, 0.0
            if len(K) > 0:
                K[i] = 0.0
            if len(C) > 0:
                C[i] = 0.0
            continue
        fields_of_item(points, i, d, u)
        rates_of_item(points, i, v, w)
        held = u[fed]
        amplitude_of(points, i, amps, u, w, a)
        first_order = linear and fed >= 0
        if first_order:
            u[fed] = held
        # forces of points on curves do not need H
        wide = 0 if len(K) == 0 and points.forces_of_run[i] != 0 and not first_order else m
        energy[i] = law_of_item(points, i, u, w, a, f, H, D, wide)[0]
        if first_order:
            f[m - 1] += H[fed * m + m - 1] * a[0]
        Q[i] = 0.0
        G = weights_of_item(points, i)
        for c in range(n):
            for p in range(m):
                Q[i, c] += G[c, p] * f[p]
        if len(K) == 0:
            continue
        stiffness_of(points, i, H, D, 1.0, 0.0, False, row, K[i])
        if len(C) > 0:
            stiffness_of(points, i, H, D, 0.0, 1.0, False, row, C[i])


@kernel
def point_mean_forces(points, d0, d1, v, amps0, amps1, Q):  # type: ignore[no-untyped-def]
    """Add the forces of a step from d0 to d1 with mean rates v to Q; return (energy at d1, dissipated power).

    The work of forces with a potential is exactly the difference of the potential. Constraints are satisfied at d1,
    with the multipliers of d1.
    """
    energy, power = 0.0, 0.0
    if len(points.forces) == 0:
        return energy, power
    u0, w, a0, f, _, _ = work_arrays(points)
    u1, a1 = vector(largest_size(points.field)), vector(3)
    for i in range(len(points.forces)):
        b, m = points.field[i], points.field[i + 1] - points.field[i]
        fields_of_item(points, i, d0, u0)
        fields_of_item(points, i, d1, u1)
        fields_of_item(points, i, v, w)
        amplitude_of(points, i, amps0, u0, w, a0)
        amplitude_of(points, i, amps1, u1, w, a1)
        f[:m] = 0.0
        if not points.on[i]:
            if points.multiplier[i] >= 0:
                f[m - 1] = u1[m - 1]
            add_to(points, i, f, Q)
            continue
        U, lost = call_mean(points.mean[i], (points.p0[b:b + m], u0[:m], u1[:m], w[:m], points.par[i], a0, a1,
                                             points.mem[i], f[:m]))
        energy += U
        power += lost
        add_to(points, i, f, Q)
    return energy, power


@kernel
@seldom
def point_constraint_rates(points, d, v, amps, out_velocity, out_acceleration):  # type: ignore[no-untyped-def]
    """Set g_t and v^T g_qq v + 2 g_qt v + g_tt at the multiplier of each constraint g(q, t) = 0 (n_full,) each.

    Consistent rates and accelerations satisfy g_q v = -g_t and g_q v' = -(the second).
    """
    if len(points.forces) == 0:
        return
    u, w, a, f, H, C = work_arrays(points)
    for i in range(len(points.forces)):
        if points.multiplier[i] < 0:
            continue
        if does_not_act(points, i, d):
            out_velocity[points.multiplier[i]] = out_acceleration[points.multiplier[i]] = 0.0
            continue
        m = points.field[i + 1] - points.field[i]
        fields_of_item(points, i, d, u)
        fields_of_item(points, i, v, w)
        amplitude_of(points, i, amps, u, w, a)
        u[m - 1] = 1.0
        law_of_item(points, i, u, w, a, f, H, C, points.field[i + 1] - points.field[i])
        velocity, acceleration = 0.0, 0.0
        for j in range(3):
            if points.fed[i, j] >= 0:
                velocity += f[points.fed[i, j]] * amps[points.signal[i, j], 1]
                acceleration += f[points.fed[i, j]] * amps[points.signal[i, j], 2]
        for p in range(m - 1):
            for q in range(m - 1):
                acceleration += w[p] * H[p * m + q] * w[q]
        out_velocity[points.multiplier[i]] = velocity
        out_acceleration[points.multiplier[i]] = acceleration
