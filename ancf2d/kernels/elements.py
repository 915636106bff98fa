"""Element kernels, generic in the element type and the formulation.

With u = B d (fields in the element's own frame), eps = eps(u), sigma = D eps:
U = eps.sigma/2, Q_e = B^T J^T sigma, K = B^T (J^T D J + sigma . d2eps/du2) B, J = d eps/du.
"""

from __future__ import annotations

from .batch import add_forces, batch_length, layout, place_of, sizes
from .forces import ACTION, FORCE, RATE, STRAINS, TANGENT, call_batch, results
from .jit import inner, kernel, shared
from .lanes import row
from .matrix import scatter_packed
from .stack import vector


@shared
def force(group, d, Q):  # type: ignore[no-untyped-def]
    """Add the elastic forces Q_e of all elements to Q; return the strain energy."""
    energy, first, last = 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        energy += call_batch(group.plan.forces, (FORCE, group, d, d, first, count, 0, 0.0))[0]
        add_forces(group, results(group, count)[0], first, count, Q)
        first += count
    return energy


@shared
def force_tangent(group, d, scale, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    """Add Q_e to Q and ``scale`` K to the matrix of the unknowns; return the strain energy."""
    energy, first, last = 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        energy += call_batch(group.plan.forces, (TANGENT, group, d, d, first, count, 0, 0.0))[0]
        Qe, Ke = results(group, count)
        add_forces(group, Qe, first, count, Q)
        scatter_packed(matrix, Ke, scale, group.plan.entries, group.dofs, first, place, indptr, index, value)
        first += count
    return energy


@kernel
def viscous_force(group, tau, d, v, Q):  # type: ignore[no-untyped-def]
    """Add the Kelvin-Voigt forces B^T J^T D tau J B v of all elements to Q, which rigid motion has none of.

    Returns the power that they take out, eps'^T D tau eps'.
    """
    power, first, last = 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        power += call_batch(group.plan.forces, (RATE, group, d, v, first, count, 0, tau))[0]
        add_forces(group, results(group, count)[0], first, count, Q)
        first += count
    return power


@shared
def tangent_action(group, d, v, out):  # type: ignore[no-untyped-def]
    """Add K(d) v to ``out`` (full coordinates) by way of the strains that v makes.

    The entries of K of fine meshes are large and cancel; strains are small differences taken once, so that this
    keeps digits which the formed matrix has lost.
    """
    first, last = 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        call_batch(group.plan.forces, (ACTION, group, d, v, first, count, 0, 0.0))
        add_forces(group, results(group, count)[0], first, count, out)
        first += count


@kernel
def element_matrices(group, d, start, Q, K):  # type: ignore[no-untyped-def]
    """Fill Q (m, n) and K (m, n, n) of elements start, start + 1, ... in global components; return their energy."""
    energy, first, last = 0.0, start, start + len(Q)
    while first < last:
        count = batch_length(group, first, last)
        energy += call_batch(group.plan.forces, (TANGENT, group, d, d, first, count, 0, 0.0))[0]
        Qe, Ke = results(group, count)
        for m in range(count):
            for a in range(len(Qe)):
                Q[first - start + m, a] = Qe[a, m]
            for x in range(len(Ke)):
                a, b = group.plan.entries[x, 0], group.plan.entries[x, 1]
                K[first - start + m, a, b] = Ke[x, m]
                K[first - start + m, b, a] = Ke[x, m]
        first += count
    return energy


@shared
def force_noise(group, d, out):  # type: ignore[no-untyped-def]
    """Add what a unit relative error of every product of Q_e = B^T J^T D eps(B d) can sum up to.

    Times the unit round-off this bounds the error of the forces, cancellation inside the element included.
    """
    law, plan = group.law, group.plan
    at, slot = layout(law)
    n, nu, ns, S = sizes(group)
    ub, sb, tb, db, fb = vector(nu), vector(ns), vector(ns), vector(n), vector(n)
    first, last = 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        for part in range(plan.parts):
            call_batch(plan.forces, (STRAINS, group, d, d, first, count, part, 0.0))
            q = group.cls[first] * plan.parts + part
            for m in range(count):
                for a in range(n):
                    db[a], fb[a] = abs(d[group.dofs[first + m, a]]), 0.0
                for s in range(S):
                    for i in range(nu):
                        u = 0.0
                        for a in range(n):
                            u += abs(law.B[q, i, s, a]) * db[a]
                        ub[i] = u
                    _turn_sizes(group, first + m, ub)
                    sb[:] = 0.0
                    _add_sizes(group, at.rows, slot.J, s * count + m, ub, sb, False)
                    for p in range(ns):
                        tb[p] = 0.0
                        for r in range(ns):
                            tb[p] += abs(law.D[q, p, r, s]) * sb[r]
                    ub[:] = 0.0
                    _add_sizes(group, at.rows, slot.J, s * count + m, ub, tb, True)
                    _turn_sizes(group, first + m, ub)
                    for i in range(nu):
                        for a in range(n):
                            fb[a] += abs(law.B[q, i, s, a]) * ub[i]
                for a in range(n):
                    out[group.dofs[first + m, a]] += fb[a]
        first += count


@inner
def _turn_sizes(group, ie, fields):  # type: ignore[no-untyped-def]
    """Turn the sizes of fields into the frame of an element, or out of it: both ways they can sum up alike."""
    t, vectors = ie if len(group.turn) > 1 else 0, group.plan.vectors
    c, s = abs(group.turn[t, 0]), abs(group.turn[t, 1])
    for v in range(len(vectors)):
        x, y = fields[vectors[v, 0]], fields[vectors[v, 1]]
        fields[vectors[v, 0]], fields[vectors[v, 1]] = c * x + s * y, s * x + c * y


@inner
def _add_sizes(group, size, J, s, fields, strains, transposed):  # type: ignore[no-untyped-def]
    """Add |J| fields of lane s to strains or, transposed, |J|^T strains to fields."""
    NU, NS = group.law.fields, group.law.strains
    for p in range(len(fields) // NU):
        for r in range(NS):
            for i in range(NU):
                entry = abs(row(group.plan.work, p * size + J + r * NU + i)[s])
                if transposed:
                    fields[p * NU + i] += entry * strains[p * NS + r]
                else:
                    strains[p * NS + r] += entry * fields[p * NU + i]


@kernel
def stations(group, d, eps_out, sigma_out):  # type: ignore[no-untyped-def]
    """Fill the strains and D eps at every station: (ne, stations, n_eps) each."""
    at, slot = layout(group.law)
    work, k = group.plan.work, group.law.strains
    _, _, ns, S = sizes(group)
    for ie in range(len(group.dofs)):
        for part in range(group.plan.parts):
            call_batch(group.plan.forces, (STRAINS, group, d, d, ie, 1, part, 0.0))
            for p in range(ns):
                for s in range(S):
                    eps_out[ie, part * S + s, p] = row(work, place_of(p, k, at, slot.eps))[s]
                    sigma_out[ie, part * S + s, p] = row(work, place_of(p, k, at, slot.sigma))[s]
