"""Forces and tangents of all point laws; contact points on one curve are evaluated together, and skipped if distant."""

from __future__ import annotations

from ..elements.point_laws import APART
from .compiled_laws import call_accept, call_accept_run, call_forces_of_run
from .lowlevel.arrays import vector
from .lowlevel.jit import inlined, inner, kernel, seldom
from .lowlevel.records import array_at
from .matrices.matrix import scatter
from .points import (
    add_to,
    amplitude_of,
    coordinates_of_item,
    does_not_act,
    fields_of_item,
    largest_size,
    law_or_distance,
    rates_of_item,
    stiffness_of,
    work_arrays,
)

# fraction of the largest entry of a matrix: a smaller skew part counts as zero
SKEW = 1e-12
# which forces of an item are nonzero: none; only the one on its multiplier (inactive constraint: multiplier = 0); all
NOTHING, MULTIPLIER, ALL = range(3)
# for ``point_tangent``, instead of the factor of rates: the constraints alone
CONSTRAINTS = -1.0


@inner
def _both_fields(points, i, d, v, u, w):  # type: ignore[no-untyped-def]
    """Fill the fields u and the rates w of item i together, without drift."""
    n, m = points.dof[i + 1] - points.dof[i], points.field[i + 1] - points.field[i]
    dofs, span = coordinates_of_item(points, i)
    for k in range(m):
        u[k] = w[k] = 0.0
    for c in range(n):
        low, x, y = span[c, 0], d[dofs[c]], v[dofs[c]]
        us, ws = array_at(u, low, (span[c, 1] - low,)), array_at(w, low, (span[c, 1] - low,))
        row = array_at(points.G, points.entry[i] + c * m + low, (len(us),))
        for k in range(len(us)):
            us[k] += row[k] * x
            ws[k] += row[k] * y


@inlined
def _rows(x, i, count):  # type: ignore[no-untyped-def]
    """Return ``count`` rows of a table from row i on."""
    return array_at(x, i * x.shape[1], (count, x.shape[1]))


@inner
def _store_distance(points, i, d, apart):  # type: ignore[no-untyped-def]
    """Store the distance ``apart`` of the items from i on to acting, and d as the point where it holds."""
    points.apart[i] = apart
    if apart > 0.0:
        n, first = points.dof[i + 1] - points.dof[i], points.dof[i]
        dofs, there = array_at(points.dofs, first, (n,)), array_at(points.there, first, (n,))
        for c in range(n):
            there[c] = d[dofs[c]]


@inner
def _evaluate_run(points, i, d, v, amps, u, w, a, f, H, C, alone):  # type: ignore[no-untyped-def]
    """Fill f, H, C with the sum over the items from i on that share fields; return (energy, power, which forces act).

    The third result is NOTHING, MULTIPLIER or ALL; with MULTIPLIER only the last entries of f and H are filled.
    ``alone``: H and C are not needed.
    """
    b, m, run = points.field[i], points.field[i + 1] - points.field[i], points.run[i]
    if does_not_act(points, i, d):
        if points.multiplier[i] < 0:
            return 0.0, 0.0, NOTHING
        f[m - 1], H[m * m - 1] = d[points.multiplier[i]], 1.0
        return 0.0, 0.0, MULTIPLIER
    if points.forces_of_run[i] == 0:
        rates_of_item(points, i, v, w)
        fields_of_item(points, i, d, u)
        amplitude_of(points, i, amps, u, w, a)
        energy, power = law_or_distance(points, i, u, w, a, f, H, C, m)
        if power == APART:
            _store_distance(points, i, d, 0.0 if points.fed[i, 0] >= 0 else energy)
            return 0.0, 0.0, MULTIPLIER if points.multiplier[i] >= 0 else NOTHING
        points.apart[i] = 0.0
        opens = points.restitution[i] >= 0.0 and H[m * m - 1] != 0.0
        return energy, power, MULTIPLIER if opens else ALL
    _both_fields(points, i, d, v, u, w)
    amplitude_of(points, i, amps, u, w, a)
    wide = 0 if alone else m
    f[:m] = 0.0
    H[:wide * m] = 0.0
    C[:wide * m] = 0.0
    energy, power = call_forces_of_run(points.forces_of_run[i], (
        points.p0[b:b + m], u[:m], w[:m], _rows(points.par, i, run), a, _rows(points.mem, i, run), f[:m],
        array_at(H, 0, (wide, wide)), array_at(C, 0, (wide, wide))))
    acts = power != APART
    _store_distance(points, i, d, 0.0 if acts or points.fed[i, 0] >= 0 else energy)
    return (energy, power, ALL) if acts else (0.0, 0.0, NOTHING)


@kernel
def point_forces(points, d, v, amps, Q):  # type: ignore[no-untyped-def]
    """Add the forces at d with rates v to Q (n_full,); return (energy, dissipated power).

    ``amps`` (signals, 3) are the values of the signals with their first and second time derivatives.
    """
    energy, power = 0.0, 0.0
    if len(points.forces) == 0:
        return energy, power
    u, w, a, f, H, C = work_arrays(points)
    i = 0
    while i < len(points.forces):
        U, lost, acts = _evaluate_run(points, i, d, v, amps, u, w, a, f, H, C, True)
        energy += U
        power += lost
        if acts == ALL:
            add_to(points, i, f, Q)
        elif acts == MULTIPLIER:
            Q[points.multiplier[i]] += f[points.field[i + 1] - points.field[i] - 1]
        i += points.run[i]
    return energy, power


@inner
def _assemble(points, i, H, C, c, rows, values):  # type: ignore[no-untyped-def]
    """Add the symmetric part of W (H + c C) W^T of the curve that begins at item i to the matrix; store the skew part.

    Returns whether the skew part is nonzero. ``rows`` (unknowns fields,) is work space.
    """
    assembly, m = points.assembly, points.field[i + 1] - points.field[i]
    begin, n = array_at(assembly.begin, 3 * i, (3,)), assembly.begin[i + 1, 0] - assembly.begin[i, 0]
    W, span = array_at(assembly.W, begin[1], (n, m)), array_at(assembly.span, 2 * begin[0], (n, 2))
    size = n * (n + 1) // 2
    slot, skew = array_at(assembly.slot, begin[2], (size,)), array_at(assembly.skew, begin[2], (size,))
    for k in range(m * m):
        H[k] += c * C[k]
    for r in range(n):
        line, low = array_at(rows, r * m, (m,)), span[r, 0]
        for q in range(m):
            line[q] = 0.0
        for p in range(span[r, 1] - low):
            x, own = array_at(W, r * m + low, (m,))[p], array_at(H, (low + p) * m, (m,))
            for q in range(m):
                line[q] += x * own[q]
    k, largest, least = 0, 0.0, 0.0
    for r in range(n):
        for s in range(r + 1):
            x, y = _product(rows, r * m, W, s * m, span, s), _product(rows, s * m, W, r * m, span, r)
            values[slot[k]] += 0.5 * (x + y)
            skew[k] = 0.5 * (x - y)
            largest, least, k = max(largest, abs(x + y)), max(least, abs(x - y)), k + 1
    return least > SKEW * largest


@inlined
def _product(x, i, y, j, span, s):  # type: ignore[no-untyped-def]
    """Return the product of the row of x at entry i and the row of y at entry j, over the fields of span[s]."""
    low, total = span[s, 0], 0.0
    a, b = array_at(x, i + low, (span[s, 1] - low,)), array_at(y, j + low, (span[s, 1] - low,))
    for q in range(len(a)):
        total += a[q] * b[q]
    return total


@inner
def add_skew(points, x, y, places):  # type: ignore[no-untyped-def]
    """Add N x to y (n,), where N is the skew part of all items that their last symmetric tangents leave out.

    Returns whether N is nonzero.
    """
    assembly, found = points.assembly, False
    for i in range(len(assembly.has_skew)):
        if assembly.has_skew[i]:
            found = True
            first, n = assembly.begin[i, 0], assembly.begin[i + 1, 0] - assembly.begin[i, 0]
            if n == 0:
                _add_skew_between(points, i, x, y, places)
                continue
            unknown, k = array_at(assembly.unknown, first, (n,)), 0
            skew = array_at(assembly.skew, assembly.begin[i, 2], (n * n,))
            for r in range(n):
                total, a = 0.0, unknown[r]
                for s in range(r):
                    total += skew[k + s] * x[unknown[s]]
                    y[unknown[s]] -= skew[k + s] * x[a]
                y[a] += total
                k += r + 1
    return found


@inner
def _add_skew_between(points, i, x, y, places):  # type: ignore[no-untyped-def]
    """Same as ``add_skew`` for an item between bodies, whose coordinates change (cf. ``matrices.matrix.scatter``)."""
    place, start, unknown, factor = places
    dofs, _ = coordinates_of_item(points, i)
    n = len(dofs)
    skew, moves, acts = array_at(points.assembly.skew, points.assembly.begin[i, 2], (n * n,)), vector(n), vector(n)
    for r in range(n):
        k = place[dofs[r]]
        moves[r] = x[k] if k >= 0 else 0.0
        for q in range(start[-2 - k] if k < -1 else 0, start[-1 - k] if k < -1 else 0):
            moves[r] += factor[q] * x[unknown[q]]
    for r in range(n):
        for s in range(r):
            z = skew[r * (r + 1) // 2 + s]
            acts[r] += z * moves[s]
            acts[s] -= z * moves[r]
    for r in range(n):
        k = place[dofs[r]]
        if k >= 0:
            y[k] += acts[r]
        for q in range(start[-2 - k] if k < -1 else 0, start[-1 - k] if k < -1 else 0):
            y[unknown[q]] += factor[q] * acts[r]


@inner
def _split_skew(K, skew):  # type: ignore[no-untyped-def]
    """Replace K (n, n) by its symmetric part and store the skew part; return whether that is nonzero."""
    k, largest, least = 0, 0.0, 0.0
    for r in range(len(K)):
        for s in range(r + 1):
            mean, skew[k] = 0.5 * (K[r, s] + K[s, r]), 0.5 * (K[r, s] - K[s, r])
            largest, least, k = max(largest, abs(mean)), max(least, abs(skew[k])), k + 1
            K[r, s] = K[s, r] = mean
    return least > SKEW * largest


@inner
def point_tangent(points, d, v, amps, c, Q, matrix, places):  # type: ignore[no-untyped-def]
    """Add the forces to Q and the symmetric part of H + c C to the matrix of the unknowns; return the energy.

    With c = CONSTRAINTS, laws without multipliers are left out, and H alone is added.
    """
    energy, alone = 0.0, c == CONSTRAINTS
    c = 0.0 if alone else c
    if len(points.forces) == 0:
        return energy
    u, w, a, f, H, C = work_arrays(points)
    most, assembly = largest_size(points.dof), points.assembly
    entries, rows = vector(most * most), vector(len(f) * max(1, assembly.most_unknowns))
    values = array_at(matrix.values, 0, (matrix.values.size,))
    i = 0
    while i < len(points.forces):
        if alone and points.multiplier[i] < 0:
            i += points.run[i]
            continue
        U, _, acts = _evaluate_run(points, i, d, v, amps, u, w, a, f, H, C, False)
        energy += U
        in_place = len(assembly.has_skew) > 0 and assembly.begin[i + 1, 0] > assembly.begin[i, 0]
        keeps = len(assembly.has_skew) > 0 and not in_place and assembly.begin[i + 1, 2] > assembly.begin[i, 2]
        if in_place or keeps:
            assembly.has_skew[i] = False
        if acts == MULTIPLIER:
            last = points.field[i + 1] - points.field[i] - 1
            Q[points.multiplier[i]] += f[last]
            scatter(matrix, array_at(H, last * (last + 2), (1, 1)), array_at(points.multiplier, i, (1, 1)), 0, places)
        elif acts == ALL:
            add_to(points, i, f, Q)
            first, n = points.dof[i], points.dof[i + 1] - points.dof[i]
            if in_place:
                assembly.has_skew[i] = _assemble(points, i, H, C, c, rows, values)
            else:
                K = array_at(entries, 0, (n, n))
                stiffness_of(points, i, H, C, 1.0, c, not keeps, rows, K)
                if keeps:
                    assembly.has_skew[i] = _split_skew(K, array_at(assembly.skew, assembly.begin[i, 2], (n * n,)))
                scatter(matrix, K, points.dofs[first:first + n].reshape((1, n)), 0, places)
        i += points.run[i]
    return energy


@kernel
@seldom
def point_accept(points, d, amps):  # type: ignore[no-untyped-def]
    """Update the history variables of all point laws at the accepted state d."""
    if len(points.forces) == 0:
        return
    u, w, a, _, _, _ = work_arrays(points)
    i = 0
    while i < len(points.forces):
        b, m, run = points.field[i], points.field[i + 1] - points.field[i], points.run[i]
        if points.forces_of_run[i] != 0:
            # even if apart: the anchor of friction belongs to the last accepted state
            fields_of_item(points, i, d, u)
            amplitude_of(points, i, amps, u, w, a)
            call_accept_run(points.accept_run[i], (points.p0[b:b + m], u[:m], _rows(points.par, i, run),
                                                       _rows(points.mem, i, run)))
        elif points.accept[i] != 0:
            fields_of_item(points, i, d, u)
            amplitude_of(points, i, amps, u, w, a)
            call_accept(points.accept[i], (points.p0[b:b + m], u[:m], points.par[i], points.mem[i]))
        i += run
