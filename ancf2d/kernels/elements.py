"""Element kernels, generic in the element type and the formulation.

With u = B d (fields in the element frame), eps = eps(u) - eps* and sigma = D eps, where eps* are natural strains and
the internal strains of laws with memory:
U = eps.sigma/2, Q_e = B^T J^T sigma, K = B^T (J^T D J + sigma . d2eps/du2) B, J = d eps/du.

Forces of an energy-momentum step from d0 to d1 apply the mean stress to the discrete Jacobian: with
J (u1 - u0) = eps1 - eps0 and sigma = D (eps0 + eps1)/2, the forces B^T J^T sigma do the work U(d1) - U(d0) along
d1 - d0 and have no moment about the mid-configuration. Kelvin-Voigt stress adds D tau (eps1 - eps0)/h. Natural strains
are subtracted from both strains; if they change, they do the work -sigma . (eps*1 - eps*0).
"""

from __future__ import annotations

from .batch import (
    add_forces,
    batch_length,
    clear_rows,
    gather,
    is_rotated,
    layout,
    matrices,
    points_of,
    row_of,
    sizes,
    spread,
    subtract_natural,
)
from .forces import (
    ACTION,
    COMMIT,
    FORCE,
    POWER,
    RATE,
    RATE_GEOMETRIC,
    SLOPE,
    STEP,
    STEP_TANGENT,
    STRAINS,
    TANGENT,
    TOTAL_STRAINS,
    WORK,
    call_batch,
    is_prescribed,
    results,
)
from .lanes import vectors_of
from .lowlevel.arrays import vector
from .lowlevel.jit import inlined, inner, kernel, seldom, shared
from .lowlevel.records import STRIDE, array_at, row, whole
from .matrices.matrix import scatter_packed
from .stress_free import NOW


# loops over batches; inlined if few kernels use them, which makes less code than a separate function
@inlined
def _sums(what, group, factor, d, e):  # type: ignore[no-untyped-def]
    """Return the two results of quantity ``what`` (``forces.element_batch``), summed over all elements."""
    energy, lost, first, last = 0.0, 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        U, W = call_batch(group.plan.forces, (what, group, d, e, first, count, 0, factor))
        energy += U
        lost += W
        first += count
    return energy, lost


@inner
def _add_forces(what, group, factor, d, e, Q):  # type: ignore[no-untyped-def]
    """Same as ``_sums``, and add the forces of all elements to Q."""
    energy, lost, first, last = 0.0, 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        U, W = call_batch(group.plan.forces, (what, group, d, e, first, count, 0, factor))
        energy += U
        lost += W
        add_forces(group, results(group, count)[0], first, count, Q)
        first += count
    return energy, lost


@inlined
def _add_tangents(what, group, factor, d, e, scale, Q, matrix, places):  # type: ignore[no-untyped-def]
    """Same as ``_add_forces``, and add ``scale`` times the tangents to the matrix of the unknowns."""
    energy, lost, first, last = 0.0, 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        U, W = call_batch(group.plan.forces, (what, group, d, e, first, count, 0, factor))
        energy += U
        lost += W
        Qe, Ke = results(group, count)
        add_forces(group, Qe, first, count, Q)
        scatter_packed(matrix, Ke, scale, group.plan.entries, group.dofs, first, places)
        first += count
    return energy, lost


@shared
def force(group, d, Q):  # type: ignore[no-untyped-def]
    """Add the elastic forces Q_e of all elements to Q; return the strain energy."""
    return _add_forces(FORCE, group, 0.0, d, d, Q)[0]


@shared
def force_tangent(group, d, scale, Q, matrix, places):  # type: ignore[no-untyped-def]
    """Add Q_e to Q and ``scale`` K to the matrix of the unknowns; return the strain energy."""
    return _add_tangents(TANGENT, group, 0.0, d, d, scale, Q, matrix, places)[0]


@kernel
def viscous_force(group, tau, d, v, Q):  # type: ignore[no-untyped-def]
    """Add the Kelvin-Voigt forces B^T J^T D tau (J B v - eps*') of all elements to Q; rigid motions cause none.

    Returns the power dissipated by the strain rates less those of natural strains.
    """
    return _add_forces(RATE, group, tau, d, v, Q)[0]


@shared
def natural_slope(group, d, Q):  # type: ignore[no-untyped-def]
    """Add -B^T J^T D eps*' of all elements to Q: the rate of their forces due to the rates of natural strains.

    Returns eps*'^T D eps*'/2, the corresponding energy if nothing moves.
    """
    return _add_forces(SLOPE, group, 0.0, d, d, Q)[0]


@kernel
def natural_power(group, tau, d, v):  # type: ignore[no-untyped-def]
    """Return the power -sigma . eps*' that natural strains feed in at rates v; sigma includes Kelvin-Voigt stress."""
    return _sums(POWER, group, tau, d, v)[0]


@shared
def tangent_action(group, d, v, out):  # type: ignore[no-untyped-def]
    """Add K(d) v to ``out`` (full coordinates), computed through the strains caused by v.

    In fine meshes the entries of K are large and cancel. Strains take these differences once, so this product keeps
    digits that the assembled matrix has lost.
    """
    _add_forces(ACTION, group, 0.0, d, v, out)


@kernel
def viscous_action(group, tau, d, v, lam, by_d, by_v, other):  # type: ignore[no-untyped-def]
    """Add C lam to by_v: the derivative of lam . Q by v, with Q the Kelvin-Voigt forces. ``other`` is work space.

    The derivative by d is by_d - by_v. It is formed from the RATE_GEOMETRIC forces, which are quadratic in the rates w:
    by_d gets half their difference at w = v + lam and w = v - lam.
    """
    for k in range(2):
        sign = 1.0 - 2.0 * k
        for i in range(len(d)):
            other[i] = v[i] + sign * lam[i]
        _add_forces(RATE_GEOMETRIC, group, 0.5 * sign * tau, d, other, by_d)
    _add_forces(RATE, group, tau, d, lam, by_v)


@kernel
def commit(group, d):  # type: ignore[no-untyped-def]
    """Update the history variables of a law with memory at the accepted state d; return the energy dissipated since.

    It is the work of the stress at d on the change of internal strains.
    """
    return _sums(COMMIT, group, 0.0, d, d)[1]


@kernel
def total_strains(group, d, first, out):  # type: ignore[no-untyped-def]
    """Write the strains at d, internal strains not subtracted, to ``out`` (n,) from ``first`` on, ordered as states."""
    at, slot = layout(group.law)
    law, work, memory, k = group.law, group.plan.work, group.memory, group.law.strains
    _, _, ns, S = sizes(group)
    begin, last = 0, len(group.dofs)
    while begin < last:
        count = batch_length(group, begin, last)
        for part in range(group.plan.parts):
            call_batch(group.plan.forces, (TOTAL_STRAINS, group, d, d, begin, count, part, 0.0))
            for m in range(count):
                for s in range(S):
                    place = first + (memory.row[begin + m] * memory.states.shape[1] + part * S + s) * ns
                    for p in range(points_of(law)):
                        for i in range(k):
                            eps = (p * at.rows + slot.eps + i) * STRIDE + s * count + m
                            out[place + p * k + i] = work[eps]
        begin += count


@kernel
def mean_force(group, tau_over_h, d0, d1, Q):  # type: ignore[no-untyped-def]
    """Add B^T J^T D ((eps0 + eps1)/2 + tau/h (eps1 - eps0)) of all elements to Q, J the discrete Jacobian.

    Returns (strain energy at d1, energy dissipated in the step).
    """
    return _add_forces(STEP, group, tau_over_h, d0, d1, Q)


@kernel
def mean_force_tangent(group, tau_over_h, d0, d1, Q, matrix, places):  # type: ignore[no-untyped-def]
    """Same as ``mean_force``, and add the symmetric tangent by d1 to the matrix of the unknowns."""
    return _add_tangents(STEP_TANGENT, group, tau_over_h, d0, d1, 1.0, Q, matrix, places)


@kernel
def natural_work(group, tau_over_h, d0, d1):  # type: ignore[no-untyped-def]
    """Return the work -sigma . (eps*1 - eps*0) of changing natural strains in a step, sigma as in ``mean_force``."""
    return _sums(WORK, group, tau_over_h, d0, d1)[1]


@kernel
def element_matrices(group, d, Q, K):  # type: ignore[no-untyped-def]
    """Fill Q (ne, n) and K (ne, n, n) of all elements in global components; return their energy."""
    energy, first, last = 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        energy += call_batch(group.plan.forces, (TANGENT, group, d, d, first, count, 0, 0.0))[0]
        Qe, Ke = results(group, count)
        for m in range(count):
            for a in range(len(Qe)):
                Q[first + m, a] = Qe[a, m]
            for x in range(len(Ke)):
                a, b = group.plan.entries[x, 0], group.plan.entries[x, 1]
                K[first + m, a, b] = Ke[x, m]
                K[first + m, b, a] = Ke[x, m]
        first += count
    return energy


@shared
@seldom
def force_noise(record, d, out):  # type: ignore[no-untyped-def]
    """Add to out (n_full,) the sum of the sizes of all products in Q_e = B^T J^T D eps(B d).

    Times the unit round-off this bounds the error of the forces, including cancellation inside elements.
    """
    group = whole(record)
    law, plan = group.law, group.plan
    at, slot = layout(law)
    n, nu, _, S = sizes(group)
    size = nu * S * n
    B, held = vector(size), -1
    first, last = 0, len(group.dofs)
    while first < last:
        count = batch_length(record, first, last)
        lanes = vectors_of(S * count)
        for part in range(plan.parts):
            call_batch(plan.forces, (STRAINS, record, d, d, first, count, part, 0.0))
            q = group.cls[first] * plan.parts + part
            if q != held:
                source = array_at(law.B, q * size, (size,))
                for k in range(size):
                    B[k] = abs(source[k])
                held = q
            de = array_at(plan.work, matrices(group, at)[0], (n, count))
            for a in range(n):
                for m in range(count):
                    de[a, m] = abs(d[group.dofs[first + m, a]])
            spread(group, B, count, slot.u0)
            _turn_sizes(group, slot.u0, lanes)
            _pull_sizes(group, part, first, count, lanes)
            _turn_sizes(group, slot.g, lanes)
            gather(group, B, part, count)
        add_forces(record, results(record, count)[0], first, count, out)
        first += count


@inner
def _turn_sizes(group, slot, lanes):  # type: ignore[no-untyped-def]
    """Rotate the sizes of fields by the absolute rotation matrix, which is the same into and out of element frames."""
    if is_rotated(group):
        work, vectors, k = group.plan.work, group.plan.vectors, group.law.fields
        at, _ = layout(group.law)
        c, s = row(work, at.turn), row(work, at.turn + 1)
        for v in range(len(vectors)):
            x, y = row(work, row_of(vectors[v, 0], k, at, slot)), row(work, row_of(vectors[v, 1], k, at, slot))
            for l in range(lanes):
                a, b = x[l], y[l]
                x[l], y[l] = abs(c[l]) * a + abs(s[l]) * b, abs(s[l]) * a + abs(c[l]) * b


@inner
def _pull_sizes(group, part, first, count, lanes):  # type: ignore[no-untyped-def]
    """Set g to |J|^T |D| (|J| u0 + |eps*| + |eps_i|); if the state has them, the sizes summed in eps_i are used."""
    work, NU, NS, points = group.plan.work, group.law.fields, group.law.strains, points_of(group.law)
    at, slot = layout(group.law)
    for p in range(points):
        clear_rows(work, p * at.rows + slot.eps0, NS, lanes)
        clear_rows(work, p * at.rows + slot.t, NS, lanes)
        clear_rows(work, p * at.rows + slot.g, NU, lanes)
    subtract_natural(group, part, first, count, NOW, slot.eps0)
    for p in range(points):
        for k in range(NS):
            size = row(work, p * at.rows + slot.eps0 + k)
            for l in range(lanes):
                size[l] = abs(size[l])
            if group.law.state > 0:
                sums = group.law.state >= 2 * NS and not is_prescribed(group)
                inner = row(work, p * at.rows + slot.new + (k + NS if sums else k))
                for l in range(lanes):
                    size[l] += abs(inner[l])
        for k in range(NS * NU):
            _add_size(work, p * at.rows + slot.J + k, p * at.rows + slot.u0 + k % NU,
                      p * at.rows + slot.eps0 + k // NU, lanes)
    for p in range(points):
        for k in range(points * NS * NS):
            _add_size(work, at.D + p * points * NS * NS + k, k // (NS * NS) * at.rows + slot.eps0 + k % NS,
                      p * at.rows + slot.t + k // NS % NS, lanes)
        for k in range(NS * NU):
            _add_size(work, p * at.rows + slot.J + k, p * at.rows + slot.t + k // NU,
                      p * at.rows + slot.g + k % NU, lanes)


@inner
def _add_size(work, factor, source, target, lanes):  # type: ignore[no-untyped-def]
    """Add |row ``factor``| times row ``source`` to row ``target``."""
    a, x, y = row(work, factor), row(work, source), row(work, target)
    for l in range(lanes):
        y[l] += abs(a[l]) * x[l]


@kernel
def stations(group, d, eps_out, sigma_out):  # type: ignore[no-untyped-def]
    """Fill strains and stresses D eps at every station at d: (ne, stations, n_eps) each."""
    at, slot = layout(group.law)
    work, k = group.plan.work, group.law.strains
    _, _, ns, S = sizes(group)
    for ie in range(len(group.dofs)):
        for part in range(group.plan.parts):
            call_batch(group.plan.forces, (STRAINS, group, d, d, ie, 1, part, 0.0))
            for p in range(ns):
                for s in range(S):
                    eps_out[ie, part * S + s, p] = row(work, row_of(p, k, at, slot.eps))[s]
                    sigma_out[ie, part * S + s, p] = row(work, row_of(p, k, at, slot.sigma))[s]
