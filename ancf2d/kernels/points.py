"""Springs, dampers, loads that turn and constraints of points: laws (``elements.point_laws``) over a table."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..elements.point_laws import APART
from .compiled_laws import call_accept, call_forces, call_mean
from .lowlevel.arrays import vector
from .lowlevel.jit import inlined, inner, kernel
from .lowlevel.records import array_at
from .matrices.matrix import scatter


class Points(NamedTuple):
    """Items of point laws. Item i has fields p0 + G d[dofs] and coordinates dofs.

    forces, mean, accept : (n,) addresses of the law's functions, 0 for what it has not or nobody asks for; field, dof,
    entry : (n + 1,) where the fields, coordinates and entries of G of item i begin in p0, dofs and G (columns of G one
    after another); par : (n, constants); mem : (n, numbers) last angles, and what else laws remember;
    signal : (n, 3) rows of the amplitudes, -1 for a constant 1; fed : (n, 3) fields that these signals prescribe, or
    -1;
    multiplier : (n,) full coordinate of the multiplier, or -1; scale : (n,) size of the constraint's terms;
    on : (n,) whether it acts: where it does not, a law has no force and a constraint no multiplier; drift : rates that
    fields have while their coordinates rest;
    restitution : (n,) what an impact returns to one-sided constraints, nan: contacts with a law, -1: no contact; run :
    (n,) how many items from here on share fields, coordinates and amplitude: their forces are summed up first.
    """

    forces: Any
    mean: Any
    accept: Any
    field: Any
    dof: Any
    entry: Any
    dofs: Any
    G: Any
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


# fields of an item from which on it is worth knowing which coordinates each depends on
MANY = 24


@inlined
def weights_of_item(points, i):  # type: ignore[no-untyped-def]
    """Return G^T (coordinates, fields) of item i."""
    n, m = points.dof[i + 1] - points.dof[i], points.field[i + 1] - points.field[i]
    return array_at(points.G, points.entry[i], (n, m))


@inner
def fields_of_item(points, i, d, out):  # type: ignore[no-untyped-def]
    """Fill G d of item i."""
    first, m = points.dof[i], points.field[i + 1] - points.field[i]
    G = weights_of_item(points, i)
    for k in range(m):
        out[k] = 0.0
    for c in range(points.dof[i + 1] - first):
        x = d[points.dofs[first + c]]
        for k in range(m):
            out[k] += G[c, k] * x


@inner
def rates_of_item(points, i, v, out):  # type: ignore[no-untyped-def]
    """Fill the rates of the fields of item i."""
    fields_of_item(points, i, v, out)
    for k in range(points.field[i + 1] - points.field[i]):
        out[k] += points.drift[points.field[i] + k]


@inner
def amplitude_of(points, i, amps, u, w, a):  # type: ignore[no-untyped-def]
    """Fill the amplitude of item i, and the fields that its signals prescribe with their rates."""
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
    first, m = points.dof[i], points.field[i + 1] - points.field[i]
    G = weights_of_item(points, i)
    for c in range(points.dof[i + 1] - first):
        s = 0.0
        for k in range(m):
            s += G[c, k] * f[k]
        Q[points.dofs[first + c]] += s


@inner
def evaluate_item(points, i, d, v, amps, u, w, a, f, H, C):  # type: ignore[no-untyped-def]
    """Fill fields, rates, amplitude and f, H, C of item i; return (energy, dissipated power)."""
    rates_of_item(points, i, v, w)
    return evaluate_at(points, i, d, amps, u, w, a, f, H, C)


@inner
def evaluate_at(points, i, d, amps, u, w, a, f, H, C):  # type: ignore[no-untyped-def]
    """Do as ``evaluate_item`` does with the rates in w."""
    fields_of_item(points, i, d, u)
    amplitude_of(points, i, amps, u, w, a)
    return law_of_item(points, i, u, w, a, f, H, C, points.field[i + 1] - points.field[i])


@inner
def law_of_item(points, i, u, w, a, f, H, C, wide):  # type: ignore[no-untyped-def]
    """Fill f (m,), H and C (m, m), both row by row, of item i from its fields and amplitude.

    Returns (energy, dissipated power). ``wide`` is m, or 0 where forces are asked for alone.
    """
    b, m = points.field[i], points.field[i + 1] - points.field[i]
    f[:m] = 0.0
    H[:wide * m] = 0.0
    C[:wide * m] = 0.0
    if not points.on[i]:
        if points.multiplier[i] >= 0:
            f[m - 1] = u[m - 1]
            H[m * m - 1] = 1.0
        return 0.0, 0.0
    return call_forces(points.forces[i], (points.p0[b:b + m], u[:m], w[:m], points.par[i], a, points.mem[i], f[:m],
                                          array_at(H, 0, (wide, wide)), array_at(C, 0, (wide, wide))))


@inlined
def _acts(f, H, C, m, wide):  # type: ignore[no-untyped-def]
    for p in range(m):
        if f[p] != 0.0:
            return True
    found = False
    for p in range(m * wide):
        found |= H[p] != 0.0 or C[p] != 0.0
    return found


@inner
def _evaluate_run(points, i, u, w, a, f, H, C, own, alone):  # type: ignore[no-untyped-def]
    """Fill f, H, C with the sum over the items from i on that share these fields; return (energy, power, whether any
    acts). ``alone``: H and C are not asked for. ``own`` (fields + 2 fields^2,) is room."""
    m = points.field[i + 1] - points.field[i]
    wide = 0 if alone and points.run[i] > 1 else m
    energy, power = law_of_item(points, i, u, w, a, f, H, C, wide)
    if power == APART:
        return energy, 0.0, False
    acts = points.run[i] == 1 or _acts(f, H, C, m, wide)
    f1, H1, C1 = array_at(own, 0, (m,)), array_at(own, m, (m * m,)), array_at(own, m + m * m, (m * m,))
    for k in range(i + 1, i + points.run[i]):
        U, lost = law_of_item(points, k, u, w, a, f1, H1, C1, wide)
        if lost == APART:
            break
        energy += U
        power += lost
        if _acts(f1, H1, C1, m, wide):
            acts = True
            for p in range(m):
                f[p] += f1[p]
            for p in range(m * wide):
                H[p] += H1[p]
                C[p] += C1[p]
    return energy, power, acts


@inlined
def _most(begin):  # type: ignore[no-untyped-def]
    """Return how many entries an item has at most, from where those of each begin."""
    most = 0
    for i in range(len(begin) - 1):
        most = max(most, begin[i + 1] - begin[i])
    return most


@inlined
def work_arrays(points):  # type: ignore[no-untyped-def]
    """Return u, w, a, f, H, C."""
    n = _most(points.field)
    return vector(n), vector(n), vector(3), vector(n), vector(n * n), vector(n * n)


@kernel
def point_forces(points, d, v, amps, Q):  # type: ignore[no-untyped-def]
    """Add the forces at d with rates v to Q (n_full,); return (energy, dissipated power).

    ``amps`` (signals, 3) are the values of the signals with their first and second time derivatives.
    """
    energy, power = 0.0, 0.0
    if len(points.forces) == 0:
        return energy, power
    u, w, a, f, H, C = work_arrays(points)
    own, i = vector(len(f) + 2 * len(H)), 0
    while i < len(points.forces):
        rates_of_item(points, i, v, w)
        fields_of_item(points, i, d, u)
        amplitude_of(points, i, amps, u, w, a)
        U, lost, acts = _evaluate_run(points, i, u, w, a, f, H, C, own, True)
        energy += U
        power += lost
        if acts:
            add_to(points, i, f, Q)
        i += points.run[i]
    return energy, power


@inner
def _along(points, i, H, C, h, c, symmetric, row, K):  # type: ignore[no-untyped-def]
    """Fill K (n, n) with G^T (h H + c C) G of item i, or its symmetric part; ``row`` (fields + 2 n,) is room.

    H is overwritten.
    """
    m, n = points.field[i + 1] - points.field[i], points.dof[i + 1] - points.dof[i]
    G, A, D = weights_of_item(points, i), array_at(H, 0, (m, m)), array_at(C, 0, (m, m))
    for p in range(m):
        for q in range(m):
            A[p, q] = h * A[p, q] + c * D[p, q]
    if symmetric:
        for p in range(m):
            for q in range(p):
                A[p, q] = A[q, p] = 0.5 * (A[p, q] + A[q, p])
    low, high = 0, m
    # few fields of a long tendon depend on a coordinate each, those of its elements
    if m > MANY:
        for s in range(n):
            low, high = m, 0
            for q in range(m):
                if G[s, q] != 0.0:
                    low, high = min(low, q), q + 1
            row[m + 2 * s], row[m + 2 * s + 1] = low, high
    for r in range(n):
        for q in range(m):
            row[q] = 0.0
        for p in range(m):
            g = G[r, p]
            if g != 0.0:
                for q in range(m):
                    row[q] += g * A[p, q]
        for s in range(r + 1 if symmetric else n):
            if m > MANY:
                low, high = int(row[m + 2 * s]), int(row[m + 2 * s + 1])
            x = 0.0
            for q in range(low, high):
                x += row[q] * G[s, q]
            K[r, s] = x
    if symmetric:
        for r in range(n):
            for s in range(r):
                K[s, r] = K[r, s]


@kernel
def point_tangent(points, d, v, amps, c, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    """Add the forces to Q and the symmetric part of H + c C to the matrix of the unknowns; return the energy."""
    energy = 0.0
    if len(points.forces) == 0:
        return energy
    u, w, a, f, H, C = work_arrays(points)
    most = _most(points.dof)
    entries, row = vector(most * most), vector(len(f) + 2 * most)
    own, i = vector(len(f) + 2 * len(H)), 0
    while i < len(points.forces):
        rates_of_item(points, i, v, w)
        fields_of_item(points, i, d, u)
        amplitude_of(points, i, amps, u, w, a)
        U, _, acts = _evaluate_run(points, i, u, w, a, f, H, C, own, False)
        energy += U
        if acts:
            add_to(points, i, f, Q)
            first, n = points.dof[i], points.dof[i + 1] - points.dof[i]
            K = array_at(entries, 0, (n, n))
            _along(points, i, H, C, 1.0, c, True, row, K)
            dofs = points.dofs[first:first + n].reshape((1, n))
            scatter(matrix, K, dofs, 0, place, indptr, index, value)
        i += points.run[i]
    return energy


@kernel
def point_matrices(points, d, v, amps, linear, energy, Q, K, C):  # type: ignore[no-untyped-def]
    """Fill energies (n,), forces Q (n, k), stiffness K and damping C (n, k, k) of items with k coordinates each.

    ``linear``: what a signal prescribes enters to first order only, as in linear theory about the reference.
    """
    u, w, a, f, H, D = work_arrays(points)
    row = vector(len(f) + 2 * _most(points.dof))
    for i in range(len(points.forces)):
        m, n, fed = points.field[i + 1] - points.field[i], len(Q[i]), points.fed[i, 0]
        fields_of_item(points, i, d, u)
        rates_of_item(points, i, v, w)
        held = u[fed]
        amplitude_of(points, i, amps, u, w, a)
        first_order = linear and fed >= 0
        if first_order:
            u[fed] = held
        energy[i] = law_of_item(points, i, u, w, a, f, H, D, m)[0]
        if first_order:
            f[m - 1] += H[fed * m + m - 1] * a[0]
        Q[i] = 0.0
        G = weights_of_item(points, i)
        for c in range(n):
            for p in range(m):
                Q[i, c] += G[c, p] * f[p]
        _along(points, i, H, D, 1.0, 0.0, False, row, K[i])
        _along(points, i, H, D, 0.0, 1.0, False, row, C[i])


@kernel
def point_mean_forces(points, d0, d1, v, amps0, amps1, lam_from_d1, Q):  # type: ignore[no-untyped-def]
    """Add the forces of a step from d0 to d1 with mean rates v to Q; return (energy at d1, dissipated power).

    Forces with a potential do exactly its difference as work; constraints are met at d1, with multipliers of d1
    (``lam_from_d1``) or else the mean of both.
    """
    energy, power = 0.0, 0.0
    if len(points.forces) == 0:
        return energy, power
    u0, w, a0, f, _, _ = work_arrays(points)
    u1, a1 = vector(_most(points.field)), vector(3)
    for i in range(len(points.forces)):
        b, m = points.field[i], points.field[i + 1] - points.field[i]
        fields_of_item(points, i, d0, u0)
        fields_of_item(points, i, d1, u1)
        fields_of_item(points, i, v, w)
        amplitude_of(points, i, amps0, u0, w, a0)
        amplitude_of(points, i, amps1, u1, w, a1)
        if points.multiplier[i] >= 0 and not lam_from_d1:
            u1[m - 1] = 0.5 * (u0[m - 1] + u1[m - 1])
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
def point_constraint_rates(points, d, v, amps, out_velocity, out_acceleration):  # type: ignore[no-untyped-def]
    """Set g_t and v^T g_qq v + 2 g_qt v + g_tt at the multiplier of each constraint g(q, t) = 0 (n_full,) each.

    Rates and accelerations that keep it obey g_q v = -g_t and g_q v' = -(the second).
    """
    if len(points.forces) == 0:
        return
    u, w, a, f, H, C = work_arrays(points)
    for i in range(len(points.forces)):
        if points.multiplier[i] < 0:
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


@kernel
def point_accept(points, d, amps):  # type: ignore[no-untyped-def]
    """Let laws remember the accepted state d."""
    if len(points.forces) == 0:
        return
    u, w, a, _, _, _ = work_arrays(points)
    for i in range(len(points.forces)):
        if points.accept[i] != 0:
            b, m = points.field[i], points.field[i + 1] - points.field[i]
            fields_of_item(points, i, d, u)
            amplitude_of(points, i, amps, u, w, a)
            call_accept(points.accept[i], (points.p0[b:b + m], u[:m], points.par[i], points.mem[i]))
