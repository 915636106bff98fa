"""Steps of batches of elements: gather fields into lanes, strains, stresses, second derivatives, scatter of forces."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .compiled_laws import D_J, GEOMETRIC, J_D_J, STRESS, operate
from .lanes import BatchPlan, matrices_at, point_rows, station_rows, vectors_of
from .lowlevel.blas import multiply, multiply_transposed
from .lowlevel.jit import inlined, inner
from .lowlevel.records import STRIDE, array_at, row
from .stress_free import Memory, Natural, natural_strain, no_memory, no_natural


class Law(NamedTuple):
    """The sampled law of one body.

    address, internal : addresses of the law's operations and internal strains; fields, strains, references, state :
    numbers of one point; timed : whether states end with the time since the last. B : (classes, fields, stations,
    n_dof); ref : (classes, any, stations); D : (classes, strains, strains, stations), quadrature weight and volume
    included; rows of a station are those of all its points in turn. Parts of a class count as classes.
    """

    address: int
    internal: int
    fields: int
    strains: int
    references: int
    state: int
    timed: bool
    B: Any
    ref: Any
    D: Any


class Group(NamedTuple):
    """Elements of one type and formulation, as the kernels see them.

    law : sampled law; natural : natural strains; memory : history of the law; cls : (ne,) class of each element; turn :
    (ne, 2) or (1, 2) cosine and sine of the element frame; dofs : (ne, n_dof) coordinates; plan : batches, work buffer.
    """

    law: Law
    natural: Natural
    memory: Memory
    cls: Any
    turn: Any
    dofs: Any
    plan: Any


def no_group() -> Group:
    """Return a group without elements, which has the record type of all groups."""
    x, n = np.zeros(0), np.zeros(0, dtype=np.int64)
    table, index = np.zeros((0, 2)), np.zeros((0, 2), dtype=np.int64)
    law = Law(0, 0, 1, 1, 1, 0, False, np.zeros((0, 1, 1, 1)), np.zeros((0, 1, 1)), np.zeros((0, 1, 1, 1)))
    plan = BatchPlan(1, 1, index, index, index, index, index, index, table, n, x, 0, 0)
    return Group(law, no_natural(), no_memory(), n, table, index, plan)


@inner
def sizes(group):  # type: ignore[no-untyped-def]
    """Return (n_dof, fields, strains, stations)."""
    return group.law.B.shape[3], group.law.B.shape[1], group.law.D.shape[1], group.law.B.shape[2]


@inner
def points_of(law):  # type: ignore[no-untyped-def]
    """Return the number of points of a station."""
    return law.B.shape[1] // law.fields


@inner
def layout(law):  # type: ignore[no-untyped-def]
    """Return (``StationRows`` in the work buffer, ``PointRows`` of a point)."""
    return (station_rows(law.fields, law.strains, law.references, law.state, points_of(law)),
            point_rows(law.fields, law.strains, law.references, law.state))


@inner
def row_of(i, size, at, slot):  # type: ignore[no-untyped-def]
    """Return the row of value i of a slot, where all points have ``size`` values each."""
    return (i // size) * at.rows + slot + i % size


@inner
def batch_length(group, first, last):  # type: ignore[no-untyped-def]
    """Return the length of the batch that starts at element ``first``: a run of one class until ``last``, cut evenly.
    """
    most = group.plan.most
    run = 1
    while first + run < last and run < 2 * most and group.cls[first + run] == group.cls[first]:
        run += 1
    if run > most:
        run = min(most, (run + 1) // 2) if run < 2 * most else most
    return run


@inner
def copy_rows(work, source, step, target, stride, m, lanes):  # type: ignore[no-untyped-def]
    """Copy m rows of ``lanes`` numbers; starts and strides count entries of the work buffer."""
    for i in range(m):
        x, y = array_at(work, source + i * step, (lanes,)), array_at(work, target + i * stride, (lanes,))
        for l in range(lanes):
            y[l] = x[l]


@inner
def clear_rows(work, k, m, lanes):  # type: ignore[no-untyped-def]
    """Set rows k, ..., k + m - 1 to zero."""
    for i in range(m):
        target = row(work, k + i)
        for l in range(lanes):
            target[l] = 0.0


@inner
def combine_rows(work, a, x, b, y, out, m, lanes):  # type: ignore[no-untyped-def]
    """Set m rows from ``out`` on to a x + b y."""
    for i in range(m):
        p, q, target = row(work, x + i), row(work, y + i), row(work, out + i)
        for l in range(lanes):
            target[l] = a * p[l] + b * q[l]


@inner
def turn_rows(work, x, y, turn, sign, lanes):  # type: ignore[no-untyped-def]
    """Rotate the vectors in rows x and y out of the element frames (sign 1) or into them (-1)."""
    p, q, c, s = row(work, x), row(work, y), row(work, turn), row(work, turn + 1)
    for l in range(lanes):
        a, b = p[l], q[l]
        p[l] = c[l] * a - sign * s[l] * b
        q[l] = c[l] * b + sign * s[l] * a


@inner
def pad(work, k, m, lanes):  # type: ignore[no-untyped-def]
    """Pad m rows to full vectors with their first lane."""
    for i in range(m):
        target = row(work, k + i)
        for l in range(lanes, vectors_of(lanes)):
            target[l] = target[0]


@inner
def repeat(work, k, values, first, stations, count):  # type: ignore[no-untyped-def]
    """Fill row k with values (stations,) that are the same for all elements of the batch."""
    target, source = row(work, k), array_at(values, first, (stations,))
    for s in range(stations):
        for m in range(count):
            target[s * count + m] = source[s]
    pad(work, k, 1, stations * count)


@inner
def set_constants(law, q, count, work):  # type: ignore[no-untyped-def]
    """Fill the lanes of reference values and stiffnesses of class q: D in blocks (point, point)."""
    at, slot = layout(law)
    ns, S = law.D.shape[1], law.D.shape[3]
    k, points = law.strains, points_of(law)
    for i in range(law.ref.shape[1]):
        repeat(work, row_of(i, law.references, at, slot.ref), law.ref, (q * law.ref.shape[1] + i) * S, S, count)
    for i in range(ns):
        for j in range(ns):
            block = (i // k) * points + j // k
            repeat(work, at.D + block * k * k + (i % k) * k + j % k, law.D, ((q * ns + i) * ns + j) * S, S, count)


@inner
def is_rotated(group):  # type: ignore[no-untyped-def]
    """Return whether any element frame is rotated."""
    return len(group.turn) > 1 or group.turn[0, 0] != 1.0 or group.turn[0, 1] != 0.0


@inner
def begin(group, part, first, count):  # type: ignore[no-untyped-def]
    """Prepare a batch: constants of its class, cosine and sine of each lane; return the class index of this part."""
    law, plan = group.law, group.plan
    S = law.B.shape[2]
    q = group.cls[first] * plan.parts + part
    if plan.loaded[0] != q or plan.loaded[1] != count:
        set_constants(law, q, count, plan.work)
        plan.loaded[0], plan.loaded[1] = q, count
    if is_rotated(group):
        at, _ = layout(law)
        for k in range(2):
            target = row(plan.work, at.turn + k)
            for s in range(S):
                for m in range(count):
                    target[s * count + m] = group.turn[first + m if len(group.turn) > 1 else 0, k]
        pad(plan.work, at.turn, 2, S * count)
    return q


@inner
def matrices(group, at):  # type: ignore[no-untyped-def]
    """Return where displacements, flat lanes, forces, tangents and products start in the work buffer."""
    law, plan = group.law, group.plan
    return matrices_at(at, law.B.shape[3], max(law.B.shape[1], len(plan.pairs)), len(plan.entries))


@inner
def turn_fields(group, slot, sign, lanes):  # type: ignore[no-untyped-def]
    """Rotate the vectors among the fields of a slot out of the element frames (sign 1) or into them (-1)."""
    vectors, NU = group.plan.vectors, group.law.fields
    at, _ = layout(group.law)
    for v in range(len(vectors)):
        turn_rows(group.plan.work, row_of(vectors[v, 0], NU, at, slot), row_of(vectors[v, 1], NU, at, slot),
                  at.turn, sign, lanes)


@inner
def to_lanes(group, q, first, count, d, slot):  # type: ignore[no-untyped-def]
    """Fill a slot with the fields B d of a batch, in the frames of its elements."""
    law, plan = group.law, group.plan
    n, nu, _, S = sizes(group)
    at, _ = layout(law)
    start, _, _, _, _ = matrices(group, at)
    de = array_at(plan.work, start, (n, count))
    for a in range(n):
        for m in range(count):
            de[a, m] = d[group.dofs[first + m, a]]
    spread(group, array_at(law.B, q * nu * S * n, (nu * S * n,)), count, slot)
    if is_rotated(group):
        turn_fields(group, slot, -1.0, vectors_of(S * count))


@inlined
def spread(group, B, count, slot):  # type: ignore[no-untyped-def]
    """Fill a slot with B (fields, stations, n_dof), given flat, times the displacements of a batch."""
    law, plan = group.law, group.plan
    n, nu, _, S = sizes(group)
    at, _ = layout(law)
    start, flat, _, _, _ = matrices(group, at)
    multiply(plan.dgemm, B, 0, plan.work, start, plan.work, flat, nu * S, n, count, False)
    lanes = S * count
    for p in range(points_of(law)):
        copy_rows(plan.work, flat + p * law.fields * lanes, lanes, (p * at.rows + slot) * STRIDE, STRIDE, law.fields,
                  lanes)
        pad(plan.work, p * at.rows + slot, law.fields, lanes)


@inner
def from_lanes(group, part, q, count):  # type: ignore[no-untyped-def]
    """Add the forces B^T g (n, count) of this part (part 0: set them); slot g is rotated out of the element frames."""
    law = group.law
    n, nu, _, S = sizes(group)
    _, slot = layout(law)
    if is_rotated(group):
        turn_fields(group, slot.g, 1.0, vectors_of(S * count))
    gather(group, array_at(law.B, q * nu * S * n, (nu * S * n,)), part, count)


@inlined
def gather(group, B, part, count):  # type: ignore[no-untyped-def]
    """Add the forces B^T g (n, count) of this part (part 0: set them); B (fields, stations, n_dof) is given flat."""
    law, plan = group.law, group.plan
    n, nu, _, S = sizes(group)
    at, slot = layout(law)
    _, flat, start, _, _ = matrices(group, at)
    lanes = S * count
    for p in range(points_of(law)):
        copy_rows(plan.work, (p * at.rows + slot.g) * STRIDE, STRIDE, flat + p * law.fields * lanes, lanes, law.fields,
                  lanes)
    multiply_transposed(plan.dgemm, B, 0, plan.work, flat, plan.work, start, n, nu * S, count, part > 0)


@inner
def each_point(group, what, lanes):  # type: ignore[no-untyped-def]
    """Perform an operation of the law at every point of the stations."""
    law = group.law
    at, _ = layout(law)
    for p in range(points_of(law)):
        operate(law.address, (what, group.plan.work, p * at.rows, law.references, law.state, lanes))


@inner
def load_stiffness(group, p, q, lanes):  # type: ignore[no-untyped-def]
    """Copy the block of D that couples points p and q to slot D of point q."""
    points, k = points_of(group.law), group.law.strains * group.law.strains
    if points > 1:
        at, slot = layout(group.law)
        copy_rows(group.plan.work, (at.D + (p * points + q) * k) * STRIDE, STRIDE, (q * at.rows + slot.D) * STRIDE,
                  STRIDE, k, lanes)


@inner
def add_stresses(group, keep, factor, lanes):  # type: ignore[no-untyped-def]
    """Set sigma to ``keep`` sigma + ``factor`` D eps, where ``keep`` is 0 or 1."""
    law, work = group.law, group.plan.work
    at, slot = layout(law)
    points = points_of(law)
    for p in range(points):
        sigma = p * at.rows + slot.sigma
        if keep == 0.0:
            clear_rows(work, sigma, law.strains, lanes)
        for q in range(points):
            if group.plan.coupled[p, q]:
                load_stiffness(group, p, q, lanes)
                operate(law.address, (STRESS, work, q * at.rows, law.references, law.state, lanes))
                combine_rows(work, factor, q * at.rows + slot.t, 1.0, sigma, sigma, law.strains, lanes)


@inner
def subtract_natural(group, part, first, count, what, slot):  # type: ignore[no-untyped-def]
    """Subtract natural strains (NOW, RATES, BEFORE or CHANGE) from the strains in a slot."""
    law, natural, plan = group.law, group.natural, group.plan
    if len(natural.amount) > 0:
        at, _ = layout(law)
        for i in range(law.D.shape[1]):
            target, quadratic = row(plan.work, row_of(i, law.strains, at, slot)), natural.quadratic[i % law.strains]
            for m in range(count):
                q = natural.pattern[first + m] * plan.parts + part
                for s in range(law.B.shape[2]):
                    target[s * count + m] -= natural_strain(natural, what, q, i, s, quadratic)


@inner
def material(group, factor, lanes):  # type: ignore[no-untyped-def]
    """Fill H with ``factor`` J^T D J, in blocks of points p <= q."""
    law, work = group.law, group.plan.work
    at, slot = layout(law)
    points, k = points_of(law), law.fields * law.fields
    for p in range(points):
        for q in range(p, points):
            block = at.H + (p * points + q) * k
            if group.plan.coupled[p, q]:
                load_stiffness(group, p, q, lanes)
                operate(law.address, (D_J, work, q * at.rows, law.references, law.state, lanes))
                if p != q or factor != 1.0:
                    DJ = q * at.rows + slot.DJ
                    combine_rows(work, factor, DJ, 0.0, DJ, p * at.rows + slot.DJ, law.strains * law.fields, lanes)
                operate(law.address, (J_D_J, work, p * at.rows, law.references, law.state, lanes))
                if points > 1:
                    copy_rows(work, (p * at.rows + slot.H) * STRIDE, STRIDE, block * STRIDE, STRIDE, k, lanes)
            else:
                clear_rows(work, block, k, lanes)


@inner
def add_geometric(group, keep, lanes):  # type: ignore[no-untyped-def]
    """Set the upper halves of the diagonal blocks of H to ``keep`` H + sigma . d2eps/du2, where ``keep`` is 0 or 1."""
    law, work = group.law, group.plan.work
    at, slot = layout(law)
    points, k = points_of(law), law.fields * law.fields
    for p in range(points):
        H, block = p * at.rows + slot.H, at.H + (p * points + p) * k
        if points > 1 or keep == 0.0:
            clear_rows(work, H, k, lanes)
        operate(law.address, (GEOMETRIC, work, p * at.rows, law.references, law.state, lanes))
        if points > 1:
            combine_rows(work, 1.0, H, keep, block, block, k, lanes)


@inner
def add_geometric_forces(group, lanes):  # type: ignore[no-untyped-def]
    """Add H u0 to g, with H given by the upper halves of its diagonal blocks."""
    law, work = group.law, group.plan.work
    at, slot = layout(law)
    NU, points = law.fields, points_of(law)
    for i in range(NU * points):
        p, g = i // NU, row(work, row_of(i, NU, at, slot.g))
        for j in range(p * NU, p * NU + NU):
            H = row(work, at.H + (p * points + p) * NU * NU + min(i, j) % NU * NU + max(i, j) % NU)
            w = row(work, row_of(j, NU, at, slot.u0))
            for l in range(lanes):
                g[l] += H[l] * w[l]


@inner
def combine(group, a, x, b, y, out, m, lanes):  # type: ignore[no-untyped-def]
    """Set slot ``out`` of every point (m rows) to a x + b y of slots x and y."""
    at, _ = layout(group.law)
    for p in range(points_of(group.law)):
        k = p * at.rows
        combine_rows(group.plan.work, a, k + x, b, k + y, k + out, m, lanes)


@inner
def product(group, a, b, lanes):  # type: ignore[no-untyped-def]
    """Return the inner product of two slots of strains over all points and exactly ``lanes`` lanes (no padding)."""
    at, _ = layout(group.law)
    total = 0.0
    for p in range(points_of(group.law)):
        for i in range(group.law.strains):
            x, y = row(group.plan.work, p * at.rows + a + i), row(group.plan.work, p * at.rows + b + i)
            for l in range(lanes):
                total += x[l] * y[l]
    return total


@inner
def add_forces(group, Qe, first, count, Q):  # type: ignore[no-untyped-def]
    """Add the forces Qe (n, count) of a batch to Q."""
    for m in range(count):
        for a in range(len(Qe)):
            Q[group.dofs[first + m, a]] += Qe[a, m]
