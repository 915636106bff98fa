"""Springs, dampers, loads that turn and constraints of points: laws (``elements.point_laws``) over a table."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..elements.point_laws import APART
from .compiled_laws import call_accept, call_forces, call_mean
from .lowlevel.arrays import vector
from .lowlevel.jit import inlined, inner, kernel
from .lowlevel.records import array_at
from .matrix import scatter


class Points(NamedTuple):
    """Items of point laws. Item i has fields p0 + G d[dofs] and coordinates dofs.

    forces, mean, accept : (n,) addresses of the law's functions, 0 for what it has not or nobody asks for; field, dof,
    entry : (n + 1,) where the fields, coordinates and entries of G of item i begin in p0, dofs and G (rows of G one
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


@inner
def fields_of_item(points, i, d, out):  # type: ignore[no-untyped-def]
    """Fill G d of item i."""
    first, m = points.dof[i], points.field[i + 1] - points.field[i]
    n = points.dof[i + 1] - first
    at = points.entry[i]
    for k in range(m):
        s = 0.0
        for c in range(n):
            s += points.G[at + k * n + c] * d[points.dofs[first + c]]
        out[k] = s


@inner
def _rates(points, i, v, out):  # type: ignore[no-untyped-def]
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
def _add(points, i, f, Q):  # type: ignore[no-untyped-def]
    """Add G^T f of item i to Q."""
    first, m = points.dof[i], points.field[i + 1] - points.field[i]
    n = points.dof[i + 1] - first
    at = points.entry[i]
    for k in range(m):
        if f[k] != 0.0:
            for c in range(n):
                Q[points.dofs[first + c]] += points.G[at + k * n + c] * f[k]


@inner
def evaluate_item(points, i, d, v, amps, u, w, a, f, H, C):  # type: ignore[no-untyped-def]
    """Fill fields, rates, amplitude and f, H, C of item i; return (energy, dissipated power)."""
    _rates(points, i, v, w)
    return evaluate_at(points, i, d, amps, u, w, a, f, H, C)


@inner
def evaluate_at(points, i, d, amps, u, w, a, f, H, C):  # type: ignore[no-untyped-def]
    """Do as ``evaluate_item`` does with the rates in w."""
    fields_of_item(points, i, d, u)
    amplitude_of(points, i, amps, u, w, a)
    return _law(points, i, u, w, a, f, H, C)


@inner
def _law(points, i, u, w, a, f, H, C):  # type: ignore[no-untyped-def]
    """Fill f (m,), H and C (m, m), both row by row, of item i from its fields and amplitude.

    Returns (energy, dissipated power).
    """
    b, m = points.field[i], points.field[i + 1] - points.field[i]
    f[:m] = 0.0
    H[:m * m] = 0.0
    C[:m * m] = 0.0
    if not points.on[i]:
        if points.multiplier[i] >= 0:
            f[m - 1] = u[m - 1]
            H[m * m - 1] = 1.0
        return 0.0, 0.0
    return call_forces(points.forces[i], (points.p0[b:b + m], u[:m], w[:m], points.par[i], a, points.mem[i], f[:m],
                                          array_at(H, 0, (m, m)), array_at(C, 0, (m, m))))


@inlined
def _acts(f, H, C, m):  # type: ignore[no-untyped-def]
    for p in range(m):
        if f[p] != 0.0:
            return True
    found = False
    for p in range(m * m):
        found |= H[p] != 0.0 or C[p] != 0.0
    return found


@inner
def _evaluate_run(points, i, u, w, a, f, H, C, own):  # type: ignore[no-untyped-def]
    """Fill f, H, C with the sum over the items from i on that share these fields; return (energy, power, whether any
    acts). ``own`` (fields + 2 fields^2,) is room."""
    m = points.field[i + 1] - points.field[i]
    energy, power = _law(points, i, u, w, a, f, H, C)
    if power == APART:
        return energy, 0.0, False
    if points.run[i] <= 1:
        return energy, power, True
    acts = _acts(f, H, C, m)
    f1, H1, C1 = array_at(own, 0, (m,)), array_at(own, m, (m * m,)), array_at(own, m + m * m, (m * m,))
    for k in range(i + 1, i + points.run[i]):
        U, lost = _law(points, k, u, w, a, f1, H1, C1)
        if lost == APART:
            break
        energy += U
        power += lost
        if _acts(f1, H1, C1, m):
            acts = True
            for p in range(m):
                f[p] += f1[p]
            for p in range(m * m):
                H[p] += H1[p]
                C[p] += C1[p]
    return energy, power, acts


@inlined
def _most_fields(points):  # type: ignore[no-untyped-def]
    most = 0
    for i in range(len(points.forces)):
        most = max(most, points.field[i + 1] - points.field[i])
    return most


@inlined
def work_arrays(points):  # type: ignore[no-untyped-def]
    """Return u, w, a, f, H, C."""
    n = _most_fields(points)
    return vector(n), vector(n), vector(3), vector(n), vector(n * n), vector(n * n)


@inlined
def _most_coordinates(points):  # type: ignore[no-untyped-def]
    most = 0
    for i in range(len(points.forces)):
        most = max(most, points.dof[i + 1] - points.dof[i])
    return most


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
        _rates(points, i, v, w)
        fields_of_item(points, i, d, u)
        amplitude_of(points, i, amps, u, w, a)
        U, lost, acts = _evaluate_run(points, i, u, w, a, f, H, C, own)
        energy += U
        power += lost
        if acts:
            _add(points, i, f, Q)
        i += points.run[i]
    return energy, power


@inner
def _along(points, i, H, C, h, c, symmetric, row, K):  # type: ignore[no-untyped-def]
    """Fill K (n, n) with G^T (h H + c C) G of item i, or its symmetric part; ``row`` (n + 2 fields,) is room."""
    m, n = points.field[i + 1] - points.field[i], points.dof[i + 1] - points.dof[i]
    at, low, high = points.entry[i], 0, n
    K[:] = 0.0
    # the fields of a long tendon depend on few of its coordinates each, those of one element
    if m > MANY:
        for q in range(m):
            low, high = n, 0
            for s in range(n):
                if points.G[at + q * n + s] != 0.0:
                    low, high = min(low, s), s + 1
            row[n + 2 * q], row[n + 2 * q + 1] = low, high
    for p in range(m):
        row[:n] = 0.0
        empty = True
        for q in range(m):
            x = h * H[p * m + q] + c * C[p * m + q]
            if symmetric:
                x = 0.5 * (x + h * H[q * m + p] + c * C[q * m + p])
            if x != 0.0:
                empty = False
                if m > MANY:
                    low, high = int(row[n + 2 * q]), int(row[n + 2 * q + 1])
                for s in range(low, high):
                    row[s] += x * points.G[at + q * n + s]
        if empty:
            continue
        for r in range(n):
            g = points.G[at + p * n + r]
            if g != 0.0:
                for s in range(n):
                    K[r, s] += g * row[s]


@kernel
def point_tangent(points, d, v, amps, c, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    """Add the forces to Q and the symmetric part of H + c C to the matrix of the unknowns; return the energy."""
    energy = 0.0
    if len(points.forces) == 0:
        return energy
    u, w, a, f, H, C = work_arrays(points)
    most = _most_coordinates(points)
    entries, row = vector(most * most), vector(most + 2 * len(f))
    own, i = vector(len(f) + 2 * len(H)), 0
    while i < len(points.forces):
        _rates(points, i, v, w)
        fields_of_item(points, i, d, u)
        amplitude_of(points, i, amps, u, w, a)
        U, _, acts = _evaluate_run(points, i, u, w, a, f, H, C, own)
        energy += U
        if acts:
            _add(points, i, f, Q)
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
    row = vector(_most_coordinates(points) + 2 * len(f))
    for i in range(len(points.forces)):
        m, n, at, fed = points.field[i + 1] - points.field[i], len(Q[i]), points.entry[i], points.fed[i, 0]
        fields_of_item(points, i, d, u)
        _rates(points, i, v, w)
        if linear and fed >= 0:
            held = u[fed]
            amplitude_of(points, i, amps, u, w, a)
            u[fed] = held
            energy[i] = _law(points, i, u, w, a, f, H, D)[0]
            f[m - 1] += H[fed * m + m - 1] * a[0]
        else:
            amplitude_of(points, i, amps, u, w, a)
            energy[i] = _law(points, i, u, w, a, f, H, D)[0]
        Q[i] = 0.0
        for p in range(m):
            for c in range(n):
                Q[i, c] += points.G[at + p * n + c] * f[p]
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
    u1, a1 = vector(_most_fields(points)), vector(3)
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
            _add(points, i, f, Q)
            continue
        U, lost = call_mean(points.mean[i], (points.p0[b:b + m], u0[:m], u1[:m], w[:m], points.par[i], a0, a1,
                                             points.mem[i], f[:m]))
        energy += U
        power += lost
        _add(points, i, f, Q)
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
        _law(points, i, u, w, a, f, H, C)
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
